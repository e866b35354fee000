/* Guards the reports: known figures for known shapes, and for every shape the
 * components, edges and volumes that sorting its edges gives. */
#include "topology.h"
#include "world.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "test.h"

static vocc_mesh_report mesh_report(const world *w, int32_t geom_id)
{
    vocc_mesh_report report;
    vocc_error error;
    memset(&report, 0, sizeof(report));
    report.size = sizeof(report);
    CHECK_STATUS(vocc_scene_mesh_report(w->scene, geom_id, &report, &error),
                 &error, VOCC_OK);
    return report;
}

static vocc_report scene_report(const world *w)
{
    vocc_report report;
    vocc_error error;
    memset(&report, 0, sizeof(report));
    report.size = sizeof(report);
    CHECK_STATUS(vocc_scene_report(w->scene, &report, &error), &error, VOCC_OK);
    return report;
}

/* Where the volume is not a round number. */
#define NO_VOLUME 1e9

/* Worked out by hand, for mesh 0 of the small shapes. */
static void known_figures(void)
{
    static const struct {
        const char *name;
        int components, closed;
        unsigned vertices, boundary, nonmanifold, inconsistent, degenerate;
        double volume;
    } known[] = {
        /* 10 * 4^n + 2 vertices */
        {"sphere", 1, 1, 42, 0, 0, 0, 0, NO_VOLUME},
        {"torus knot", 1, 1, 120, 0, 0, 0, 0, NO_VOLUME},
        {"fat knot", 1, 1, 120, 0, 0, 0, 0, NO_VOLUME},
        {"nested shells", 3, 1, 126, 0, 0, 0, 0, NO_VOLUME},
        {"inverted cube", 1, 1, 26, 0, 0, 0, 0, -3.375},
        {"overlapping cubes", 2, 1, 34, 0, 0, 0, 0, 2.0},
        /* the plane's rim: two squares a side */
        {"cube on plane", 2, 0, 35, 8, 0, 0, 0, NO_VOLUME},
        /* the hole's rim */
        {"open cube", 1, 0, 25, 8, 0, 0, 0, NO_VOLUME},
        {"13 shells", 13, 1, 140, 0, 0, 0, 0, NO_VOLUME},
        /* 2 x 2 squares in common: 8 edges of the rim, 4 inner ones, 4
         * diagonals have four triangles each */
        {"touching in one mesh", 1, 1, 43, 0, 16, 0, 0, 2.0},
        /* the furniture's corner is a vertex of the floor */
        {"hollow room", 3, 1, 59, 0, 0, 0, 0, NO_VOLUME},
        /* the figure 8's crossing is a circle of 12 edges in common; the
         * seam where the sides change has 12 edges */
        {"klein bottle", 1, 1, 132, 0, 12, 12, 0, NO_VOLUME},
        /* each of a cube's 18 edges four times; the triangle that is a point
         * has no edge and is a component by itself */
        {"doubled cube", 2, 1, 8, 0, 18, 0, 2, 2.0},
        /* each pair of the three boxes has an edge in common */
        {"pinched boxes", 1, 1, 19, 0, 3, 0, 0, 2.5},
        {"fan of slivers", 1, 1, 202, 0, 0, 0, 0, NO_VOLUME},
        {"soup", 150, 0, 450, 450, 0, 0, 0, NO_VOLUME},
        {"flat", 1, 0, 49, 24, 0, 0, 0, NO_VOLUME},
    };
    for (size_t i = 0; i < sizeof(known) / sizeof(known[0]); i++) {
        size_t index = 0;
        while (strcmp(shape_name(index), known[i].name) != 0)
            index++;
        shape s;
        world w;
        test_context(known[i].name);
        shape_make(&s, index, 0);
        world_make(&w, &s, NULL);
        const vocc_mesh_report r = mesh_report(&w, 0);
        CHECK_INT(r.component_count, known[i].components);
        CHECK_INT(r.closed, known[i].closed);
        CHECK_INT(r.welded_vertices, known[i].vertices);
        CHECK_INT(r.boundary_edges, known[i].boundary);
        CHECK_INT(r.nonmanifold_edges, known[i].nonmanifold);
        CHECK_INT(r.inconsistent_edges, known[i].inconsistent);
        CHECK_INT(r.degenerate_triangles, known[i].degenerate);
        if (known[i].volume != NO_VOLUME)
            CHECK_NEAR(r.volume, known[i].volume, 1e-9);
        world_free(&w);
        shape_free(&s);
    }
}

static double volume_of(const mesh *m, const int32_t *list, size_t count)
{
    double six = 0.0;
    for (size_t i = 0; i < count; i++) {
        double p[3][3];
        for (int j = 0; j < 3; j++)
            for (int k = 0; k < 3; k++)
                p[j][k] = (double)mesh_corner(m, (size_t)list[i], j)[k];
        six += p[0][0] * (p[1][1] * p[2][2] - p[1][2] * p[2][1]) +
               p[0][1] * (p[1][2] * p[2][0] - p[1][0] * p[2][2]) +
               p[0][2] * (p[1][0] * p[2][1] - p[1][1] * p[2][0]);
    }
    return six / 6.0;
}

static double area_of(const mesh *m, const int32_t *list, size_t count)
{
    double area = 0.0;
    for (size_t i = 0; i < count; i++) {
        const size_t t = (size_t)list[i];
        const float *a = mesh_corner(m, t, 0), *b = mesh_corner(m, t, 1),
                    *c = mesh_corner(m, t, 2);
        double n = 0.0;
        for (int k = 0; k < 3; k++) {
            const int x = (k + 1) % 3, y = (k + 2) % 3;
            const double cross =
                ((double)b[x] - (double)a[x]) * ((double)c[y] - (double)a[y]) -
                ((double)b[y] - (double)a[y]) * ((double)c[x] - (double)a[x]);
            n += cross * cross;
        }
        area += 0.5 * sqrt(n);
    }
    return area;
}

static int by_number(const void *left, const void *right)
{
    const uint64_t a = *(const uint64_t *)left, b = *(const uint64_t *)right;
    return a < b ? -1 : a > b;
}

static void check_open_edges(const world *w, const mesh *m, const topology *t,
                             int32_t geom_id)
{
    size_t count = 0;
    vocc_error error;
    CHECK_STATUS(
        vocc_scene_open_edges(w->scene, geom_id, 0, NULL, &count, &error),
        &error, VOCC_OK);
    CHECK_INT(count, t->open_edge_count);
    if (count != t->open_edge_count || count == 0)
        return;
    int32_t *edges = malloc(2 * count * sizeof(*edges));
    uint64_t *keys = malloc(count * sizeof(*keys));
    REQUIRE(edges && keys);
    CHECK_STATUS(
        vocc_scene_open_edges(w->scene, geom_id, count, edges, &count, &error),
        &error, VOCC_OK);
    for (size_t i = 0; i < count; i++) {
        const int32_t prim = edges[2 * i], corner = edges[2 * i + 1];
        REQUIRE(prim >= 0 && (size_t)prim < m->triangle_count && corner >= 0 &&
                corner < 3);
        CHECK(i == 0 || edges[2 * i - 2] <= prim);
        keys[i] = topology_edge(t, m, (size_t)prim, corner);
    }
    qsort(keys, count, sizeof(*keys), by_number);
    CHECK(memcmp(keys, t->open_edges, count * sizeof(*keys)) == 0);
    free(edges);
    free(keys);
}

static void check_component(const world *w, const mesh *m, int32_t geom_id,
                            const component *expected, int32_t number)
{
    vocc_component_report r;
    vocc_error error;
    memset(&r, 0, sizeof(r));
    r.size = sizeof(r);
    CHECK_STATUS(vocc_scene_component_report(w->scene, number, &r, &error),
                 &error, VOCC_OK);
    CHECK_INT(r.geom_id, geom_id);
    CHECK_INT(r.first_triangle, expected->first_triangle);
    CHECK_INT(r.triangle_count, expected->triangle_count);
    CHECK_INT(r.closed, expected->closed);
    CHECK_INT(r.consistent, expected->consistent);
    CHECK_INT(r.boundary_edges, expected->boundary_edges);
    CHECK_INT(r.nonmanifold_edges, expected->nonmanifold_edges);
    CHECK_INT(r.inconsistent_edges, expected->inconsistent_edges);
    if (expected->consistent)
        CHECK_NEAR(r.volume,
                   volume_of(m, expected->triangles, expected->triangle_count),
                   1e-6);
}

/* The leaves, counted and measured. */
static void check_tree_figures(const world *w, const vocc_report *r)
{
    size_t count = 0;
    vocc_error error;
    CHECK_STATUS(vocc_scene_leaves(w->scene, 0, NULL, &count, &error), &error,
                 VOCC_OK);
    vocc_leaf *leaves = malloc((count + 1) * sizeof(*leaves));
    REQUIRE(leaves);
    CHECK_STATUS(vocc_scene_leaves(w->scene, count, leaves, &count, &error),
                 &error, VOCC_OK);
    uint64_t labels[4] = {0, 0, 0, 0}, references = 0;
    double volume = 0.0, area = 0.0, all = 1.0;
    for (size_t i = 0; i < count; i++) {
        const vocc_leaf *leaf = &leaves[i];
        REQUIRE(leaf->label >= 0 && leaf->label < 4);
        labels[leaf->label]++;
        references += leaf->count;
        if (leaf->label != VOCC_OPAQUE)
            continue;
        double e[3];
        for (int k = 0; k < 3; k++)
            e[k] = (double)leaf->upper[k] - (double)leaf->lower[k];
        volume += e[0] * e[1] * e[2];
        area += 2.0 * (e[0] * e[1] + e[1] * e[2] + e[2] * e[0]);
    }
    for (int k = 0; k < 3; k++)
        all *= r->upper[k] - r->lower[k];
    CHECK_INT(labels[VOCC_BOUNDARY], r->boundary_leaves);
    CHECK_INT(labels[VOCC_CLEAR], r->clear_leaves);
    CHECK_INT(labels[VOCC_OPAQUE], r->opaque_leaves);
    CHECK_INT(labels[VOCC_UNKNOWN], r->unknown_leaves);
    CHECK_INT(r->unknown_leaves, 0);
    CHECK_INT(references, r->reference_count);
    CHECK_INT(r->node_count, 2 * count - 1);
    if (all > 0.0)
        CHECK_NEAR(r->opaque_volume_fraction, volume / all, 1e-6);
    CHECK_NEAR(r->occluder_area, area, 1e-6 * (area + 1.0));
    free(leaves);
}

static void all_shapes(void)
{
    for (size_t i = 0; i < shape_count(); i++) {
        for (int detail = 0; detail < 2; detail++) {
            shape s;
            world w;
            test_context(shape_name(i));
            shape_make(&s, i, detail);
            world_make(&w, &s, NULL);
            const vocc_report r = scene_report(&w);
            int32_t components = 0, closed = 0;
            uint64_t vertices = 0;
            double area = 0.0, lower[3], upper[3];
            for (int p = 0; p < s.part_count; p++) {
                const mesh *m = &s.parts[p].m;
                topology t;
                topology_make(&t, m);
                const vocc_mesh_report mine = mesh_report(&w, p);
                CHECK_INT(mine.occluder, s.parts[p].occluder);
                CHECK_INT(mine.triangle_count, m->triangle_count);
                CHECK_INT(mine.vertex_count, m->vertex_count);
                CHECK_INT(mine.welded_vertices, t.welded_vertices);
                CHECK_INT(mine.degenerate_triangles, t.degenerate_triangles);
                CHECK_INT(mine.first_component, components);
                CHECK_INT(mine.component_count, t.component_count);
                CHECK_INT(mine.closed, t.open_edge_count == 0);
                CHECK_INT(mine.boundary_edges, t.open_edge_count);
                uint64_t nonmanifold = 0, inconsistent = 0;
                for (size_t c = 0; c < t.component_count; c++) {
                    const component *part = &t.components[c];
                    check_component(&w, m, p, part, components + (int32_t)c);
                    nonmanifold += part->nonmanifold_edges;
                    inconsistent += part->inconsistent_edges;
                    if (part->closed && s.parts[p].occluder) {
                        closed++;
                        area +=
                            area_of(m, part->triangles, part->triangle_count);
                    }
                }
                CHECK_INT(mine.nonmanifold_edges, nonmanifold);
                CHECK_INT(mine.inconsistent_edges, inconsistent);
                check_open_edges(&w, m, &t, p);
                components += (int32_t)t.component_count;
                vertices += m->vertex_count;
                topology_free(&t);
            }
            CHECK_INT(r.mesh_count, s.part_count);
            CHECK_INT(r.component_count, components);
            CHECK_INT(r.closed_count, closed);
            CHECK_INT(r.triangle_count, shape_triangles(&s));
            CHECK_INT(r.vertex_count, vertices);
            shape_bounds(&s, lower, upper);
            for (int k = 0; k < 3; k++) {
                CHECK_NEAR(r.lower[k], lower[k], 0);
                CHECK_NEAR(r.upper[k], upper[k], 0);
            }
            /* of what can hold occluders: the closed components */
            CHECK_NEAR(r.mesh_area, area, 1e-6 * area);
            CHECK(r.depth >= 0 && r.depth <= 60);
            CHECK(r.region_count >= 1);
            CHECK(r.threads >= 1 && r.threads <= 256);
            CHECK_INT(r.auto_order,
                      r.occluder_area >= 2.75 * r.mesh_area && r.mesh_area > 0
                          ? VOCC_ORDER_OPAQUE_FIRST
                          : VOCC_ORDER_STANDARD);
            CHECK(r.tree_bytes > 0 &&
                  r.tree_bytes <= counting_live_bytes(w.memory));
            CHECK(r.seconds_components >= 0 && r.seconds_build >= 0 &&
                  r.seconds_classify >= 0 && r.seconds_occluders >= 0 &&
                  r.seconds_beams >= 0);
            CHECK(r.seconds_total >= r.seconds_components &&
                  r.seconds_total >= r.seconds_build + r.seconds_classify +
                                         r.seconds_occluders &&
                  r.seconds_total >= r.seconds_beams);
            check_tree_figures(&w, &r);
            world_free(&w);
            shape_free(&s);
        }
    }
}

/* float64 vertices far away: the figures are in the caller's coordinates, and
 * the origin is what makes float32 of them. */
static void recentred(void)
{
    const double far = 524288.0;
    shape s;
    shape_make(&s, 0, 0);
    const mesh *m = &s.parts[0].m;
    double *vertices = malloc(3 * m->vertex_count * sizeof(double));
    REQUIRE(vertices);
    for (size_t i = 0; i < 3 * m->vertex_count; i++)
        vertices[i] = (double)m->vertices[i] + far;
    vocc_scene *scene = NULL;
    vocc_error error;
    REQUIRE(vocc_scene_create(NULL, &scene, NULL) == VOCC_OK);
    CHECK_STATUS(vocc_scene_add_mesh(scene, m->vertex_count,
                                     rows_of(vertices, 24, VOCC_FLOAT64),
                                     m->triangle_count, mesh_triangles(m), NULL,
                                     NULL, &error),
                 &error, VOCC_OK);
    CHECK_STATUS(vocc_scene_build(scene, NULL, &error), &error, VOCC_OK);
    double origin[3], lower[3], upper[3];
    CHECK_INT(vocc_scene_origin(scene, origin), VOCC_OK);
    mesh_bounds(m, lower, upper);
    vocc_report r;
    r.size = sizeof(r);
    CHECK_INT(vocc_scene_report(scene, &r, NULL), VOCC_OK);
    for (int k = 0; k < 3; k++) {
        CHECK_NEAR(origin[k], far + 0.5 * (lower[k] + upper[k]), 0);
        CHECK_NEAR(r.lower[k], far + lower[k], 0);
        CHECK_NEAR(r.upper[k], far + upper[k], 0);
    }
    vocc_mesh_report mine;
    mine.size = sizeof(mine);
    CHECK_INT(vocc_scene_mesh_report(scene, 0, &mine, NULL), VOCC_OK);
    CHECK_INT(mine.welded_vertices, 42);
    CHECK_INT(mine.closed, 1);
    vocc_scene_free(scene);
    free(vertices);
    shape_free(&s);
}

const test_case test_report_cases[] = {
    {"report.known_figures", known_figures},
    {"report.all_shapes", all_shapes},
    {"report.recentred", recentred},
    {NULL, NULL},
};
