/* Guards "no cracks": segments that run exactly through each vertex and the
 * middle of each edge of closed meshes, from outside and from inside, are all
 * blocked, in every mode.
 *
 * The reference is topology, not another ray tracer: an end point outside and
 * an end point inside are in different regions, so the surface is between
 * them.  Coordinates are multiples of a power of two and small enough that
 * target - org is exact: the ray does meet the vertex, at t = 1. */
#include "topology.h"
#include "world.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "test.h"

/* Half of the shapes' own step, so that middles of edges are on it too. */
#define STEP 0x1p-15

static float on_step(double x)
{
    return (float)(STEP * floor(x / STEP + 0.5));
}

static void aim(ray_set *set, int kind, const float org[3],
                const float target[3], float tmax)
{
    float dir[3];
    for (int k = 0; k < 3; k++) {
        dir[k] = target[k] - org[k];
        /* Exact, or the test tests something else. */
        if ((double)dir[k] != (double)target[k] - (double)org[k] ||
            (double)org[k] + (double)dir[k] != (double)target[k]) {
            test_fail(__FILE__, __LINE__, "%a - %a is not exact",
                      (double)target[k], (double)org[k]);
            test_leave();
        }
    }
    rays_add(set, kind, org, dir, 0.0f, tmax);
}

/* From `org` at every vertex and every middle of an edge of m. */
static void aim_at_all(ray_set *set, const mesh *m, const float org[3],
                       float tmax)
{
    for (size_t i = 0; i < m->vertex_count; i++)
        aim(set, RAY_VERTEX, org, m->vertices + 3 * i, tmax);
    for (size_t t = 0; t < m->triangle_count; t++) {
        for (int corner = 0; corner < 3; corner++) {
            const float *a = mesh_corner(m, t, corner);
            const float *b = mesh_corner(m, t, (corner + 1) % 3);
            float middle[3];
            /* Each edge from one of its two sides. */
            if (m->triangles[3 * t + (size_t)corner] >
                m->triangles[3 * t + (size_t)((corner + 1) % 3)])
                continue;
            for (int k = 0; k < 3; k++)
                middle[k] = (float)(0.5 * ((double)a[k] + (double)b[k]));
            aim(set, RAY_EDGE, org, middle, tmax);
        }
    }
}

static void check_all_blocked(const char *name, const ray_set *set,
                              const mode *m, const uint8_t *occluded)
{
    size_t missed = 0, first = 0;
    for (size_t i = set->count; i-- > 0;) {
        if (occluded[i] != 1) {
            missed++;
            first = i;
        }
    }
    test_compared(set->count);
    if (missed)
        test_fail(__FILE__, __LINE__, "%s: %s: %zu of %zu missed; %s: %s", name,
                  mode_text(m), missed, set->count,
                  ray_kind_name(set->kinds[first]),
                  ray_text(&set->rays[first]));
}

static void trace_in_all_modes(const char *name, const world *w,
                               const ray_set *set)
{
    static const int caches[] = {8, -1}, deferments[] = {512, -1},
                     threads[] = {2, -1};
    mode_list modes = modes_of(caches, deferments, threads);
    uint8_t *occluded = malloc(set->count);
    REQUIRE(occluded);
    int32_t best;
    REQUIRE(vocc_query_isa(NULL, &best, NULL) == VOCC_OK);
    for (size_t i = 0; i < modes.count; i++) {
        const mode *m = &modes.modes[i];
        /* AUTO is one of the others; single rays have no lanes, so that one
         * instruction set is enough for them, and packets of four are the same
         * in all but plain C. */
        if (m->order == VOCC_ORDER_AUTO ||
            (m->isa != VOCC_ISA_SCALAR && !(m->packets && m->isa == best)))
            continue;
        trace(w, set, m, occluded, NULL);
        check_all_blocked(name, set, m, occluded);
    }
    free(occluded);
    modes_free(&modes);
}

/* 327 680 triangles.  From inside all the way out, and from outside to where
 * the ray is inside again: tmax is the middle of its way through the sphere. */
static void large_sphere(void)
{
    const int level = test_is_sanitized() ? 4 : 7;
    shape s;
    world w;
    ray_set inside, outside;
    memset(&s, 0, sizeof(s));
    s.name = "icosphere";
    s.part_count = 1;
    s.parts[0].occluder = 1;
    mesh *m = &s.parts[0].m;
    mesh_init(m);
    add_icosphere(m, level, 1.0, 0, 0, 0);
    mesh_snap(m, 2 * STEP);
    if (level == 7)
        CHECK_INT(m->triangle_count, 327680);
    world_make(&w, &s, NULL);
    vocc_mesh_report report;
    report.size = sizeof(report);
    CHECK_INT(vocc_scene_mesh_report(w.scene, 0, &report, NULL), VOCC_OK);
    CHECK_INT(report.closed, 1);

    rays_init(&inside);
    const float org[3] = {on_step(0.0317), on_step(-0.0153), on_step(0.0071)};
    aim_at_all(&inside, m, org, 2.0f);

    /* The sphere's chord through the target: its middle is at
     * t = (centre - org) . dir / dir . dir, inside if that is past 1. */
    rays_init(&outside);
    const float eye[3] = {on_step(1.7), on_step(1.9), on_step(-1.3)};
    ray_set all;
    rays_init(&all);
    aim_at_all(&all, m, eye, HUGE_VALF);
    size_t certified = 0;
    for (size_t i = 0; i < all.count; i++) {
        oracle_ray *ray = &all.rays[i];
        double along = 0.0, squared = 0.0, off = 0.0;
        for (int k = 0; k < 3; k++) {
            along -= (double)ray->org[k] * (double)ray->dir[k];
            squared += (double)ray->dir[k] * (double)ray->dir[k];
        }
        const double t = along / squared;
        for (int k = 0; k < 3; k++) {
            const double p = (double)ray->org[k] + t * (double)ray->dir[k];
            off += p * p;
        }
        if (t > 1.0 && off < 0.9) {
            ray->tmax = (float)t;
            certified++;
        }
        /* The others graze or leave: through a vertex they are blocked too,
         * since no fan of this mesh is edge-on to its axis. */
        rays_add(&outside, all.kinds[i], ray->org, ray->dir, 0.0f, ray->tmax);
    }
    CHECK(certified > all.count / 8);
    trace_in_all_modes("from inside", &w, &inside);
    trace_in_all_modes("from outside", &w, &outside);
    test_note("%zu triangles, %zu rays a mode", m->triangle_count,
              inside.count + outside.count);
    rays_free(&all);
    rays_free(&inside);
    rays_free(&outside);
    world_free(&w);
    shape_free(&s);
}

/* Whether some triangle is hit where the ray meets its target at t = 1: only
 * those triangles count that contain the target, found by welded vertices. */
static int is_certified(const oracle_ray *ray, const shape *s)
{
    oracle_ray around = *ray;
    around.tmin = 0.999f;
    around.tmax = 1.001f;
    return oracle_occluded(&around, s, 0) == ORACLE_HIT;
}

/* All closed shapes, from the known inside point and from outside. */
static void all_shapes(void)
{
    size_t left_out = 0, all = 0;
    for (size_t i = 0; i < shape_count(); i++) {
        shape s;
        world w;
        ray_set set;
        shape_make(&s, i, 1);
        int closed = s.solid;
        for (int p = 0; p < s.part_count; p++) {
            topology t;
            mesh_snap(&s.parts[p].m, 2 * STEP);
            topology_make(&t, &s.parts[p].m);
            closed &= t.open_edge_count == 0;
            topology_free(&t);
        }
        if (!closed) {
            shape_free(&s);
            continue;
        }
        world_make(&w, &s, NULL);
        rays_init(&set);
        const double *ends[2] = {s.inside, s.outside};
        for (int end = 0; end < 2; end++) {
            float org[3];
            for (int k = 0; k < 3; k++)
                org[k] = on_step(ends[end][k]);
            ray_set aimed;
            rays_init(&aimed);
            for (int p = 0; p < s.part_count; p++)
                aim_at_all(&aimed, &s.parts[p].m, org, HUGE_VALF);
            const size_t step = 1 + aimed.count / test_scaled(4000, 400);
            for (size_t k = 0; k < aimed.count; k += step) {
                oracle_ray *ray = &aimed.rays[k];
                /* An unbounded ray from inside ends outside: blocked.  From
                 * outside it is, unless every triangle at the target is
                 * edge-on. */
                all++;
                if (end == 1 && !is_certified(ray, &s)) {
                    left_out++;
                    continue;
                }
                rays_add(&set, aimed.kinds[k], ray->org, ray->dir, 0.0f,
                         ray->tmax);
            }
            rays_free(&aimed);
        }
        trace_in_all_modes(s.name, &w, &set);
        rays_free(&set);
        world_free(&w);
        shape_free(&s);
    }
    test_note("%zu of %zu targets are seen edge-on and left out", left_out,
              all);
    CHECK(left_out < all / 10);
}

const test_case test_cracks_cases[] = {
    {"cracks.large_sphere", large_sphere},
    {"cracks.all_shapes", all_shapes},
    {NULL, NULL},
};
