/* Guards the paper's classification, one test ray a leaf: it is what
 * vocc_intersect and the normals say; on closed shapes it is what the flood
 * fill says, in every direction; where the paper's prerequisite does not hold
 * it is wrong as it has to be; and it changes nothing. */
#include "world.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "test.h"

enum { DIRECTIONS = 5 };

static const double directions[DIRECTIONS][3] = {{0.813, 0.347, 0.211},
                                                 {-0.531, 0.619, 0.377},
                                                 {0.129, -0.887, 0.443},
                                                 {-0.271, -0.157, -0.911},
                                                 {0.577, 0.293, -0.761}};

typedef struct classified {
    size_t count;
    vocc_leaf *leaves;
    int32_t *labels;
    vocc_ray_classification result;
} classified;

static void classify(const world *w, const double *direction,
                     const vocc_query_options *options, classified *c)
{
    vocc_error error;
    CHECK_STATUS(vocc_scene_leaves(w->scene, 0, NULL, &c->count, &error),
                 &error, VOCC_OK);
    c->leaves = malloc((c->count + 1) * sizeof *c->leaves);
    c->labels = malloc((c->count + 1) * sizeof *c->labels);
    REQUIRE(c->leaves && c->labels);
    CHECK_STATUS(
        vocc_scene_leaves(w->scene, c->count, c->leaves, &c->count, &error),
        &error, VOCC_OK);
    memset(c->labels, 0x77, (c->count + 1) * sizeof *c->labels);
    memset(&c->result, 0x55, sizeof c->result);
    c->result.size = sizeof c->result;
    CHECK_STATUS(vocc_scene_classify_by_rays(w->scene, direction, c->count,
                                             c->labels, &c->result, options,
                                             &error),
                 &error, VOCC_OK);
    CHECK_INT(c->labels[c->count], 0x77777777);
    CHECK_INT(c->result.leaf_count, c->count);
    CHECK(c->result.seconds >= 0.0);
}

static void classified_free(classified *c)
{
    free(c->leaves);
    free(c->labels);
}

/* The figures are those of the labels. */
static void check_figures(const classified *c)
{
    uint64_t by_label[4] = {0, 0, 0, 0}, disagreements = 0;
    for (size_t i = 0; i < c->count; i++) {
        const int32_t flood = c->leaves[i].label, ray = c->labels[i];
        REQUIRE(ray >= VOCC_BOUNDARY && ray <= VOCC_UNKNOWN);
        CHECK((ray == VOCC_BOUNDARY) == (flood == VOCC_BOUNDARY));
        by_label[ray]++;
        disagreements += (flood == VOCC_OPAQUE && ray == VOCC_CLEAR) ||
                         (flood == VOCC_CLEAR && ray == VOCC_OPAQUE);
    }
    CHECK_INT(c->result.opaque_leaves, by_label[VOCC_OPAQUE]);
    CHECK_INT(c->result.clear_leaves, by_label[VOCC_CLEAR]);
    CHECK_INT(c->result.unknown_leaves, by_label[VOCC_UNKNOWN]);
    CHECK_INT(c->result.rays, by_label[VOCC_OPAQUE] + by_label[VOCC_CLEAR]);
    CHECK_INT(c->result.disagreements, disagreements);
    test_compared(c->count);
}

static void one_part(shape *s, const char *name)
{
    memset(s, 0, sizeof *s);
    s->name = name;
    s->part_count = 1;
    s->parts[0].occluder = 1;
    mesh_init(&s->parts[0].m);
    test_context(name);
}

static void centre_of(const vocc_leaf *leaf, float centre[3])
{
    for (int k = 0; k < 3; k++)
        centre[k] =
            (float)(((double)leaf->lower[k] + (double)leaf->upper[k]) / 2);
}

/* ---- what it says -------------------------------------------------------- */

/* Whether the triangle's normal points along the direction; 0 where double
 * cannot tell for sure. */
static int facing(const shape *s, int32_t geom_id, int32_t prim_id,
                  const double direction[3])
{
    const mesh *m = &s->parts[geom_id].m;
    double e1[3], e2[3], sum = 0.0, size = 0.0;
    for (int k = 0; k < 3; k++) {
        const float *a = mesh_corner(m, (size_t)prim_id, 0);
        e1[k] = (double)mesh_corner(m, (size_t)prim_id, 1)[k] - (double)a[k];
        e2[k] = (double)mesh_corner(m, (size_t)prim_id, 2)[k] - (double)a[k];
    }
    for (int k = 0; k < 3; k++) {
        const double x = e1[(k + 1) % 3] * e2[(k + 2) % 3],
                     y = e1[(k + 2) % 3] * e2[(k + 1) % 3];
        sum += direction[k] * (x - y);
        size += fabs(direction[k]) * (fabs(x) + fabs(y));
    }
    return sum > 1e-6 * size ? 1 : sum < -1e-6 * size ? -1 : 0;
}

/* Every shape, with and without a prerequisite of the paper. */
static void the_closest_hit_decides(void)
{
    size_t undecided = 0, opaque = 0;
    for (size_t index = 0; index < shape_count(); index++) {
        shape s;
        world w;
        classified c;
        shape_make(&s, index, 0);
        test_context(s.name);
        world_make(&w, &s, NULL);
        for (int d = 0; d < DIRECTIONS; d++) {
            /* As the library rounds it. */
            const float dir[3] = {(float)directions[d][0],
                                  (float)directions[d][1],
                                  (float)directions[d][2]};
            const double exact[3] = {(double)dir[0], (double)dir[1],
                                     (double)dir[2]};
            classify(&w, exact, NULL, &c);
            check_figures(&c);
            float *org = malloc((c.count + 1) * 3 * sizeof *org);
            int32_t *geom = malloc((c.count + 1) * sizeof *geom),
                    *prim = malloc((c.count + 1) * sizeof *prim);
            REQUIRE(org && geom && prim);
            for (size_t i = 0; i < c.count; i++)
                centre_of(&c.leaves[i], org + 3 * i);
            const vocc_hits hits = {NULL, geom, prim, NULL, NULL};
            vocc_rays rays;
            memset(&rays, 0, sizeof rays);
            rays.count = c.count;
            rays.org = rows_of(org, 12, VOCC_FLOAT32);
            rays.dir = rows_of(dir, 0, VOCC_FLOAT32);
            CHECK_INT(vocc_intersect(w.scene, &rays, &hits, NULL, NULL),
                      VOCC_OK);
            for (size_t i = 0; i < c.count; i++) {
                if (c.labels[i] != VOCC_OPAQUE && c.labels[i] != VOCC_CLEAR)
                    continue;
                const int side =
                    prim[i] < 0 ? -1 : facing(&s, geom[i], prim[i], exact);
                undecided += side == 0;
                opaque += c.labels[i] == VOCC_OPAQUE;
                if (side && (side > 0) != (c.labels[i] == VOCC_OPAQUE))
                    test_fail(__FILE__, __LINE__,
                              "leaf %zu, direction %d: label %d, but the first "
                              "triangle shows its %s",
                              i, d, (int)c.labels[i],
                              side > 0 ? "back" : "front");
            }
            free(org);
            free(geom);
            free(prim);
            classified_free(&c);
        }
        world_free(&w);
        shape_free(&s);
    }
    test_context(NULL);
    test_note("%zu too oblique for double", undecided);
    CHECK(opaque > 1000);
}

static void flood_and_rays_agree(void)
{
    for (int which = 0; which < 4; which++) {
        shape s;
        world w;
        mesh *m = &s.parts[0].m;
        if (which == 0) {
            one_part(&s, "sphere");
            add_icosphere(m, 4, 1.0, 0.1, -0.2, 0.3);
        } else if (which == 1) {
            one_part(&s, "knot");
            add_knot(m, 2, 3, 200, 12, 0.125);
        } else if (which == 2) {
            one_part(&s, "voxels");
            add_voxel_ball(m, 9, 4.25);
        } else {
            one_part(&s, "two spheres");
            add_icosphere(m, 3, 1.0, 0.0, 0.0, 0.0);
            add_icosphere(m, 3, 0.75, 2.0, 0.25, 0.5);
        }
        world_make(&w, &s, NULL);
        vocc_report report;
        report.size = sizeof report;
        CHECK_INT(vocc_scene_report(w.scene, &report, NULL), VOCC_OK);
        CHECK(report.opaque_leaves > 50);
        for (int d = -1; d < DIRECTIONS; d++) {
            classified c;
            classify(&w, d < 0 ? NULL : directions[d], NULL, &c);
            check_figures(&c);
            CHECK_INT(c.result.disagreements, 0);
            CHECK_INT(c.result.opaque_leaves, report.opaque_leaves);
            CHECK_INT(c.result.clear_leaves, report.clear_leaves);
            CHECK_INT(c.result.unknown_leaves, 0);
            for (size_t i = 0; i < c.count; i++)
                CHECK_INT(c.labels[i], c.leaves[i].label);
            classified_free(&c);
        }
        world_free(&w);
        shape_free(&s);
    }
    test_context(NULL);
}

/* ---- where the prerequisite does not hold -------------------------------- */

/* Inside out: a leaf within sees fronts, so it is called CLEAR; one outside is
 * called OPAQUE if its ray meets the solid. */
static void inverted(void)
{
    shape s;
    world w;
    classified c;
    one_part(&s, "inverted sphere");
    add_icosphere(&s.parts[0].m, 3, 1.0, 0.0, 0.0, 0.0);
    mesh_flip(&s.parts[0].m, 0);
    world_make(&w, &s, NULL);
    classify(&w, directions[0], NULL, &c);
    check_figures(&c);
    uint64_t outside_hits = 0, inside = 0;
    for (size_t i = 0; i < c.count; i++) {
        if (c.leaves[i].label == VOCC_OPAQUE) {
            inside++;
            CHECK_INT(c.labels[i], VOCC_CLEAR);
        } else if (c.leaves[i].label == VOCC_CLEAR) {
            uint8_t occluded = 9;
            float org[3];
            vocc_rays ray;
            memset(&ray, 0, sizeof ray);
            centre_of(&c.leaves[i], org);
            ray.count = 1;
            ray.org = rows_of(org, 12, VOCC_FLOAT32);
            ray.dir = rows_of(directions[0], 0, VOCC_FLOAT64);
            CHECK_INT(vocc_occluded(w.scene, &ray, &occluded, NULL, NULL),
                      VOCC_OK);
            CHECK_INT(c.labels[i], occluded ? VOCC_OPAQUE : VOCC_CLEAR);
            outside_hits += occluded;
        }
    }
    CHECK(inside > 50);
    CHECK(outside_hits > 10);
    CHECK_INT(c.result.disagreements, inside + outside_hits);
    classified_free(&c);
    world_free(&w);
    shape_free(&s);
    test_context(NULL);
}

/* An open mesh has no inside; a ray takes what is behind it for one. */
static void open_mesh(void)
{
    shape s;
    world w;
    classified c;
    one_part(&s, "open sphere");
    add_icosphere(&s.parts[0].m, 3, 1.0, 0.0, 0.0, 0.0);
    s.parts[0].m.triangle_count -= 40;
    world_make(&w, &s, NULL);
    classify(&w, directions[0], NULL, &c);
    check_figures(&c);
    for (size_t i = 0; i < c.count; i++) {
        float p[3];
        centre_of(&c.leaves[i], p);
        CHECK(c.leaves[i].label != VOCC_OPAQUE);
        CHECK(c.labels[i] != VOCC_OPAQUE ||
              p[0] * p[0] + p[1] * p[1] + p[2] * p[2] < 1.0f);
    }
    CHECK(c.result.opaque_leaves > 50);
    CHECK_INT(c.result.disagreements, c.result.opaque_leaves);
    classified_free(&c);
    world_free(&w);
    shape_free(&s);
    test_context(NULL);
}

/* Within one of two solids that overlap, a ray may meet the front of the other
 * first.  It is never the other way round. */
static void overlapping(void)
{
    shape s;
    world w;
    classified c;
    one_part(&s, "overlapping spheres");
    add_icosphere(&s.parts[0].m, 3, 1.0, 0.0, 0.0, 0.0);
    add_icosphere(&s.parts[0].m, 3, 1.0, 0.75, 0.25, 0.125);
    world_make(&w, &s, NULL);
    for (int d = 0; d < DIRECTIONS; d++) {
        classify(&w, directions[d], NULL, &c);
        check_figures(&c);
        CHECK(c.result.disagreements > 10);
        for (size_t i = 0; i < c.count; i++)
            CHECK(c.labels[i] != VOCC_OPAQUE ||
                  c.leaves[i].label == VOCC_OPAQUE);
        classified_free(&c);
    }
    world_free(&w);
    /* Rays see meshes that the flood fill is told not to fill. */
    mesh_free(&s.parts[0].m);
    one_part(&s, "no occluder");
    add_icosphere(&s.parts[0].m, 3, 1.0, 0.0, 0.0, 0.0);
    s.parts[0].occluder = 0;
    world_make(&w, &s, NULL);
    classify(&w, NULL, NULL, &c);
    check_figures(&c);
    CHECK(c.result.disagreements > 50);
    CHECK_INT(c.result.disagreements, c.result.opaque_leaves);
    classified_free(&c);
    world_free(&w);
    shape_free(&s);
    test_context(NULL);
}

/* Through the edges of a cube, in the planes of its faces: each leaf gets a
 * label, the same one whatever traces the ray. */
static void grazing(void)
{
    static const double axes[][3] = {{1, 0, 0}, {0, -1, 0}, {0, 0, 1},
                                     {1, 1, 0}, {-1, 0, 1}, {1, -1, 1}};
    static const size_t some[] = {0, 5, 8, 14, 17, 18, 22, 24};
    for (size_t k = 0; k < sizeof some / sizeof *some; k++) {
        shape s;
        world w;
        shape_make(&s, some[k], 0);
        test_context(s.name);
        world_make(&w, &s, NULL);
        for (size_t d = 0; d < sizeof axes / sizeof *axes; d++) {
            classified first, c;
            vocc_query_options options;
            vocc_query_options_init(&options);
            options.packets = 0;
            options.threads = 1;
            classify(&w, axes[d], &options, &first);
            check_figures(&first);
            for (int flags = 0; flags < 4; flags++) {
                options.packets = 1;
                options.isa = flags & 1 ? VOCC_ISA_SCALAR : VOCC_ISA_AUTO;
                options.threads = flags & 2 ? 3 : 1;
                classify(&w, axes[d], &options, &c);
                CHECK(memcmp(c.labels, first.labels,
                             c.count * sizeof *c.labels) == 0);
                classified_free(&c);
            }
            classified_free(&first);
        }
        world_free(&w);
        shape_free(&s);
    }
    test_context(NULL);
}

/* ---- ranges ----------------------------------------------------------------
 */

/* Any length will do: only powers of two are taken out. */
static void lengths_of_directions(void)
{
    shape s;
    world w;
    classified first, c;
    shape_make(&s, 2, 0);
    world_make(&w, &s, NULL);
    const double unit[3] = {0.75, -0.5, 0.3125};
    classify(&w, unit, NULL, &first);
    for (int exponent = -1060; exponent <= 1020; exponent += 130) {
        double scaled[3];
        for (int k = 0; k < 3; k++)
            scaled[k] = ldexp(unit[k], exponent);
        classify(&w, scaled, NULL, &c);
        CHECK(memcmp(c.labels, first.labels, c.count * sizeof *c.labels) == 0);
        classified_free(&c);
    }
    /* Next to nothing, but not 0. */
    const double slanted[3] = {1.0, 1e-300, -1e-320};
    classify(&w, slanted, NULL, &c);
    check_figures(&c);
    classified_free(&c);
    classified_free(&first);
    world_free(&w);
    shape_free(&s);
}

/* Coordinates beyond the float kernels, and float64 ones far from 0. */
static void sizes_of_scenes(void)
{
    static const double sizes[] = {0x1p-40, 1.0, 0x1p30, 0x1p60};
    for (size_t k = 0; k < sizeof sizes / sizeof *sizes; k++) {
        shape s;
        world w;
        classified c;
        one_part(&s, "sphere");
        add_icosphere(&s.parts[0].m, 3, sizes[k], 0.0, 0.0, 0.0);
        world_make(&w, &s, NULL);
        classify(&w, NULL, NULL, &c);
        check_figures(&c);
        CHECK(c.result.opaque_leaves > 50);
        CHECK_INT(c.result.disagreements, 0);
        classified_free(&c);
        world_free(&w);
        shape_free(&s);
    }
    shape s;
    one_part(&s, "far sphere");
    mesh *m = &s.parts[0].m;
    add_icosphere(m, 3, 1.0, 0.0, 0.0, 0.0);
    double *far = malloc(3 * m->vertex_count * sizeof *far);
    REQUIRE(far);
    for (size_t i = 0; i < 3 * m->vertex_count; i++)
        far[i] = (double)m->vertices[i] + 524288.0;
    world w;
    classified c;
    w.memory = counting_create();
    const vocc_allocator allocator = counting_allocator(w.memory);
    REQUIRE(vocc_scene_create(&allocator, &w.scene, NULL) == VOCC_OK);
    CHECK_INT(vocc_scene_add_mesh(
                  w.scene, m->vertex_count, rows_of(far, 24, VOCC_FLOAT64),
                  m->triangle_count, mesh_triangles(m), NULL, NULL, NULL),
              VOCC_OK);
    REQUIRE(vocc_scene_build(w.scene, NULL, NULL) == VOCC_OK);
    classify(&w, NULL, NULL, &c);
    check_figures(&c);
    CHECK(c.result.opaque_leaves > 50);
    CHECK_INT(c.result.disagreements, 0);
    classified_free(&c);
    world_free(&w);
    free(far);
    shape_free(&s);
    test_context(NULL);
}

/* Between two squares in one plane a leaf is empty and as flat as they are. */
static void thin_leaves(void)
{
    shape s;
    world w;
    classified c;
    one_part(&s, "two squares");
    mesh *m = &s.parts[0].m;
    add_plane(m, 4, 1.0, 0.0);
    const size_t first = m->vertex_count;
    add_plane(m, 4, 1.0, 0.0);
    mesh_move(m, first, 1.0, 4.0, 0.0, 0.0);
    world_make(&w, &s, NULL);
    classify(&w, NULL, NULL, &c);
    check_figures(&c);
    uint64_t thin = 0;
    for (size_t i = 0; i < c.count; i++) {
        float centre[3];
        int inside = 1;
        centre_of(&c.leaves[i], centre);
        for (int k = 0; k < 3; k++)
            inside &= centre[k] > c.leaves[i].lower[k] &&
                      centre[k] < c.leaves[i].upper[k];
        if (c.leaves[i].label == VOCC_BOUNDARY)
            continue;
        CHECK((c.labels[i] == VOCC_UNKNOWN) == !inside);
        thin += !inside;
    }
    CHECK(thin > 0);
    CHECK_INT(c.result.unknown_leaves, thin);
    classified_free(&c);
    world_free(&w);
    shape_free(&s);
    test_context(NULL);
}

/* ---- what it leaves alone --------------------------------------------------
 */

static void the_scene_stays_as_it_is(void)
{
    shape s;
    world w;
    classified c;
    shape_make(&s, 8, 1);
    world_make(&w, &s, NULL);
    vocc_report before, after;
    memset(&before, 0, sizeof before);
    memset(&after, 0, sizeof after);
    before.size = after.size = sizeof before;
    CHECK_INT(vocc_scene_report(w.scene, &before, NULL), VOCC_OK);
    const size_t live = counting_live_bytes(w.memory);
    vocc_counters counters;
    memset(&counters, 0, sizeof counters);
    vocc_query_options options;
    vocc_query_options_init(&options);
    options.counters = &counters;
    classify(&w, directions[1], &options, &c);
    CHECK(c.result.disagreements > 0);
    CHECK_INT(counters.rays, c.result.rays);
    CHECK(counters.node_visits > c.result.rays / 4);
    CHECK_INT(counting_live_bytes(w.memory), live);
    CHECK_INT(vocc_scene_report(w.scene, &after, NULL), VOCC_OK);
    CHECK(memcmp(&before, &after, sizeof before) == 0);
    vocc_leaf *leaves = malloc(c.count * sizeof *leaves);
    REQUIRE(leaves);
    size_t count = 0;
    CHECK_INT(vocc_scene_leaves(w.scene, c.count, leaves, &count, NULL),
              VOCC_OK);
    CHECK(memcmp(leaves, c.leaves, c.count * sizeof *leaves) == 0);
    free(leaves);

    /* A smaller capacity, up to an empty leaf: so many labels, the figures of
     * all. */
    size_t capacity = c.count - 1;
    while (c.labels[capacity] == VOCC_BOUNDARY)
        capacity--;
    int32_t *labels = malloc(c.count * sizeof *labels);
    REQUIRE(labels);
    memset(labels, 0x77, c.count * sizeof *labels);
    vocc_ray_classification few;
    memset(&few, 0, sizeof few);
    few.size = sizeof few;
    CHECK_INT(vocc_scene_classify_by_rays(w.scene, directions[1], capacity,
                                          labels, &few, NULL, NULL),
              VOCC_OK);
    CHECK(memcmp(labels, c.labels, capacity * sizeof *labels) == 0);
    CHECK_INT(labels[capacity], 0x77777777);
    free(labels);
    CHECK_INT(few.leaf_count, c.count);
    CHECK_INT(few.opaque_leaves, c.result.opaque_leaves);
    CHECK_INT(few.disagreements, c.result.disagreements);
    CHECK_INT(vocc_scene_classify_by_rays(w.scene, directions[1], 0, NULL, &few,
                                          NULL, NULL),
              VOCC_OK);
    CHECK_INT(few.clear_leaves, c.result.clear_leaves);
    classified_free(&c);
    world_free(&w);
    shape_free(&s);
}

const test_case test_classify_rays_cases[] = {
    {"classify_rays.the_closest_hit_decides", the_closest_hit_decides},
    {"classify_rays.flood_and_rays_agree", flood_and_rays_agree},
    {"classify_rays.inverted", inverted},
    {"classify_rays.open_mesh", open_mesh},
    {"classify_rays.overlapping", overlapping},
    {"classify_rays.grazing", grazing},
    {"classify_rays.lengths_of_directions", lengths_of_directions},
    {"classify_rays.sizes_of_scenes", sizes_of_scenes},
    {"classify_rays.thin_leaves", thin_leaves},
    {"classify_rays.the_scene_stays_as_it_is", the_scene_stays_as_it_is},
    {NULL, NULL},
};
