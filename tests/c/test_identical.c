/* Guards the promise that no option changes a result: every order, occluders
 * on and off, cache, deferment list, packets and single rays, instruction set
 * and number of threads give the array of the two-sided baseline, on all
 * shapes and all kinds of rays; and so do float64, strided and broadcast rays.
 * The counters say that what is being tested was used at all. */
#include "world.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "test.h"

static const int all_caches[] = {0, 1, 8, 64, -1};
static const int all_deferments[] = {0, 1, 16, 512, -1};
static const int one_thread[] = {1, -1};

/* What must hold of the counters of one call. */
static void check_counters(const mode *m, const vocc_counters *c, size_t count,
                           const uint8_t *occluded)
{
    uint64_t blocked = 0;
    for (size_t i = 0; i < count; i++)
        blocked += occluded[i];
    CHECK_INT(c->rays, count);
    CHECK_INT(c->occluded, blocked);
    CHECK(c->occluder_hits_tree + c->occluder_hits_cache <= blocked);
    CHECK(c->active_lanes <= 4 * c->node_visits);
    CHECK(c->careful_rays <= c->rays);
    if (!m->occluders) {
        CHECK_INT(c->occluder_hits_tree, 0);
        CHECK_INT(c->occluder_hits_cache, 0);
        CHECK_INT(c->cache_lookups, 0);
        CHECK_INT(c->fallbacks, 0);
    }
    if (m->cache == 0) {
        CHECK_INT(c->occluder_hits_cache, 0);
        CHECK_INT(c->cache_lookups, 0);
    }
    if (m->order == VOCC_ORDER_STANDARD || m->order >= VOCC_ORDER_SATO ||
        m->deferment == 0)
        CHECK_INT(c->deferred, 0);
    if (!(m->extras & LAST_TRIANGLE))
        CHECK_INT(c->triangle_cache_hits, 0);
    if (m->order != VOCC_ORDER_BFS && m->order != VOCC_ORDER_QDBFS) {
        CHECK_INT(c->queue_pushes, 0);
        CHECK_INT(c->queue_pops, 0);
    }
    CHECK(c->queue_pops <= c->queue_pushes);
    if (!m->packets)
        CHECK_INT(c->active_lanes, c->node_visits);
}

/* The rays are traced in as many parts, one a mode, in turns. */
#define PARTS 4

/* All modes on all shapes; threads come below, they need more rays. */
static void all_modes(void)
{
    mode_list modes = modes_of(all_caches, all_deferments, one_thread);
    const size_t stride = modes.count / test_scaled(modes.count, 45);
    vocc_counters sum;
    memset(&sum, 0, sizeof(sum));
    for (size_t i = 0; i < shape_count(); i++) {
        shape s;
        world w;
        ray_set set;
        test_context(shape_name(i));
        shape_make(&s, i, 1);
        world_make(&w, &s, NULL);
        rays_init(&set);
        rays_adversarial(&set, &s, test_scaled(24, 8), 500 + i);
        uint8_t *expected = malloc(set.count), *actual = malloc(set.count);
        REQUIRE(expected && actual);
        const mode baseline = mode_baseline();
        trace(&w, &set, &baseline, expected, NULL);
        for (size_t k = i % stride; k < modes.count; k += stride) {
            const size_t turn = (i + k + k / PARTS) % PARTS;
            const size_t first = turn * set.count / PARTS;
            const size_t count = (turn + 1) * set.count / PARTS - first;
            /* Counting must not change a thing, either. */
            vocc_counters counters;
            memset(&counters, 0, sizeof(counters));
            trace_some(&w, &set, first, count, &modes.modes[k], actual,
                       k % 3 ? NULL : &counters);
            compare_some(__FILE__, __LINE__, s.name, &set, first, count,
                         &modes.modes[k], actual, expected + first);
            if (k % 3)
                continue;
            check_counters(&modes.modes[k], &counters, count, actual);
            sum.occluder_hits_tree += counters.occluder_hits_tree;
            sum.occluder_hits_cache += counters.occluder_hits_cache;
            sum.fallbacks += counters.fallbacks;
            sum.deferred += counters.deferred;
            sum.queue_pops += counters.queue_pops;
            sum.exact_tests += counters.exact_tests;
            sum.careful_rays += counters.careful_rays;
            sum.triangle_tests += counters.triangle_tests;
            sum.triangle_cache_hits += counters.triangle_cache_hits;
            sum.packets += counters.packets;
        }
        free(expected);
        free(actual);
        rays_free(&set);
        world_free(&w);
        shape_free(&s);
    }
    test_note("%zu modes, 1 of %zu for each shape", modes.count, stride);
    modes_free(&modes);
    CHECK(sum.occluder_hits_tree > 0);
    CHECK(sum.occluder_hits_cache > 0);
    CHECK(sum.fallbacks > 0);
    CHECK(sum.deferred > 0);
    CHECK(sum.queue_pops > 0);
    CHECK(sum.exact_tests > 0);
    CHECK(sum.careful_rays > 0);
    CHECK(sum.triangle_tests > 0);
    CHECK(sum.triangle_cache_hits > 0);
    CHECK(sum.packets > 0);
}

/* None may drop out of the tests unseen. */
static void orders_are_there(void)
{
    for (int order = VOCC_ORDER_AUTO; order <= VOCC_ORDER_RTSAH; order++)
        CHECK_INT(has_order(order), 1);
}

static void threads(void)
{
    static const int caches[] = {8, -1}, deferments[] = {512, -1};
    static const int counts[] = {2, 3, 0, -1};
    mode_list modes = modes_of(caches, deferments, counts);
    static const size_t some[] = {6, 12};
    for (size_t n = 0; n < sizeof(some) / sizeof(some[0]); n++) {
        shape s;
        world w;
        ray_set set;
        shape_make(&s, some[n], 1);
        test_context(s.name);
        world_make(&w, &s, NULL);
        rays_init(&set);
        rays_adversarial(&set, &s, test_scaled(800, 100), 600 + n);
        uint8_t *expected = malloc(set.count), *actual = malloc(set.count);
        REQUIRE(expected && actual);
        const mode baseline = mode_baseline();
        trace(&w, &set, &baseline, expected, NULL);
        vocc_counters counters[2];
        for (size_t k = 0; k < modes.count; k++) {
            const mode *m = &modes.modes[k];
            if (m->order == VOCC_ORDER_AUTO || (!m->packets && k % 3) ||
                !test_share(n + k))
                continue;
            trace(&w, &set, m, actual, NULL);
            compare_answers(__FILE__, __LINE__, s.name, &set, m, actual,
                            expected);
        }
        /* What is counted does not depend on threads either, and is added. */
        mode m = {VOCC_ORDER_QDBFS, 1, 8, 512, 1, VOCC_ISA_AUTO, 1, 0};
        memset(counters, 0, sizeof(counters));
        trace(&w, &set, &m, actual, &counters[0]);
        m.threads = 3;
        trace(&w, &set, &m, actual, &counters[1]);
        CHECK(memcmp(&counters[0], &counters[1], sizeof(counters[0])) == 0);
        trace(&w, &set, &m, actual, &counters[1]);
        CHECK_INT(counters[1].rays, 2 * counters[0].rays);
        CHECK_INT(counters[1].triangle_tests, 2 * counters[0].triangle_tests);
        free(expected);
        free(actual);
        rays_free(&set);
        world_free(&w);
        shape_free(&s);
    }
    modes_free(&modes);
}

/* Trees of other forms hold the same triangles. */
static void build_options(void)
{
    static const struct {
        int32_t max_leaf_size, max_depth, bad_refines;
        float traversal_cost, intersection_cost, empty_bonus;
    } builds[] = {
        {1, 0, 4, 1.0f, 4.0f, 0.0f},   {1 << 20, 1, 0, 1.0f, 0.5f, 0.5f},
        {2, 30, 16, 0.1f, 5.0f, 1.0f}, {16, 6, 0, 4.0f, 0.25f, 0.9f},
        {1, 60, 2, 1e-3f, 1e3f, 0.5f},
    };
    for (size_t i = 0; i < shape_count(); i++) {
        shape s;
        world w;
        ray_set set;
        test_context(shape_name(i));
        shape_make(&s, i, 0);
        world_make(&w, &s, NULL);
        rays_init(&set);
        rays_adversarial(&set, &s, test_scaled(40, 8), 700 + i);
        uint8_t *expected = malloc(set.count), *actual = malloc(set.count);
        REQUIRE(expected && actual);
        const mode baseline = mode_baseline();
        trace(&w, &set, &baseline, expected, NULL);
        world_free(&w);
        for (size_t b = 0; b < sizeof(builds) / sizeof(builds[0]); b++) {
            vocc_build_options options;
            vocc_build_options_init(&options);
            options.max_leaf_size = builds[b].max_leaf_size;
            options.max_depth = builds[b].max_depth;
            options.bad_refines = builds[b].bad_refines;
            options.traversal_cost = builds[b].traversal_cost;
            options.intersection_cost = builds[b].intersection_cost;
            options.empty_bonus = builds[b].empty_bonus;
            world_make(&w, &s, &options);
            mode m = baseline;
            for (int flags = 0; flags < 8; flags++) {
                m.occluders = flags & 1;
                m.packets = flags >> 1 & 1;
                m.order = flags & 4 ? VOCC_ORDER_QDBFS : VOCC_ORDER_STANDARD;
                m.cache = 8;
                m.isa = VOCC_ISA_AUTO;
                trace(&w, &set, &m, actual, NULL);
                compare_answers(__FILE__, __LINE__, s.name, &set, &m, actual,
                                expected);
            }
            world_free(&w);
        }
        free(expected);
        free(actual);
        rays_free(&set);
        shape_free(&s);
    }
}

/* Solids that may not hold occluders give the same answers without them. */
static void without_occluders_in_meshes(void)
{
    for (size_t i = 0; i < shape_count(); i++) {
        shape s;
        world w;
        ray_set set;
        vocc_counters counters;
        memset(&counters, 0, sizeof(counters));
        test_context(shape_name(i));
        shape_make(&s, i, 1);
        world_make(&w, &s, NULL);
        rays_init(&set);
        rays_adversarial(&set, &s, test_scaled(40, 8), 800 + i);
        uint8_t *expected = malloc(set.count), *actual = malloc(set.count);
        REQUIRE(expected && actual);
        const mode baseline = mode_baseline();
        trace(&w, &set, &baseline, expected, NULL);
        world_free(&w);
        for (int p = 0; p < s.part_count; p++)
            s.parts[p].occluder = 0;
        world_make(&w, &s, NULL);
        const mode m = {VOCC_ORDER_QDBFS, 1, 8, 512, 1, VOCC_ISA_AUTO, 1, 0};
        trace(&w, &set, &m, actual, &counters);
        compare_answers(__FILE__, __LINE__, s.name, &set, &m, actual, expected);
        CHECK_INT(counters.occluder_hits_tree + counters.occluder_hits_cache,
                  0);
        free(expected);
        free(actual);
        rays_free(&set);
        world_free(&w);
        shape_free(&s);
    }
}

/* ---- where occluders end ------------------------------------------------ */

/* A coordinate of the leaf: below, on a face, in the middle, above. */
static float along_leaf(const vocc_leaf *leaf, int k, uint32_t choice)
{
    const float low = leaf->lower[k], high = leaf->upper[k];
    switch (choice) {
    case 0:
        return low;
    case 1:
        return high;
    case 2:
        return low + 0.5f * (high - low);
    case 3:
        return low - 0.25f;
    case 4:
        return high + 0.25f;
    case 5:
        return nextafterf(low, HUGE_VALF);
    default:
        return nextafterf(high, -HUGE_VALF);
    }
}

/* Rays in the planes of leaves' faces, along their edges, through their
 * corners, that begin or end exactly there. */
static void rays_at_leaves(ray_set *set, const vocc_leaf *leaves, size_t count,
                           size_t rays)
{
    static const float ends[] = {HUGE_VALF, 1.0f, 2.0f, 0.5f};
    test_random random = random_seed(12);
    for (size_t i = 0; i < rays; i++) {
        const vocc_leaf *leaf = &leaves[random_below(&random, (uint32_t)count)];
        float org[3], dir[3];
        for (int k = 0; k < 3; k++) {
            org[k] = along_leaf(leaf, k, random_below(&random, 7));
            dir[k] =
                random_below(&random, 3)
                    ? along_leaf(leaf, k, random_below(&random, 7)) - org[k]
                    : 0.0f;
        }
        rays_add(set, RAY_BOUNDS, org, dir,
                 random_below(&random, 4) ? 0.0f : -1.0f,
                 ends[random_below(&random, 4)]);
    }
}

static void at_occluders(void)
{
    for (size_t i = 0; i < shape_count(); i++) {
        shape s;
        world w;
        ray_set set;
        size_t count = 0, opaque = 0;
        test_context(shape_name(i));
        shape_make(&s, i, 0);
        vocc_build_options build;
        vocc_build_options_init(&build);
        build.max_leaf_size = 2;
        build.max_depth = 24;
        build.bad_refines = 4;
        world_make(&w, &s, &build);
        CHECK_INT(vocc_scene_leaves(w.scene, 0, NULL, &count, NULL), VOCC_OK);
        vocc_leaf *leaves = malloc((count + 1) * sizeof(*leaves));
        REQUIRE(leaves);
        CHECK_INT(vocc_scene_leaves(w.scene, count, leaves, &count, NULL),
                  VOCC_OK);
        rays_init(&set);
        rays_at_leaves(&set, leaves, count, test_scaled(800, 50));
        for (size_t k = 0; k < count; k++)
            if (leaves[k].label == VOCC_OPAQUE)
                leaves[opaque++] = leaves[k];
        if (opaque)
            rays_at_leaves(&set, leaves, opaque, test_scaled(1200, 75));
        uint8_t *expected = malloc(set.count), *actual = malloc(set.count);
        REQUIRE(expected && actual);
        for (size_t k = 0; k < set.count; k++)
            expected[k] = oracle_occluded(&set.rays[k], &s, 0) == ORACLE_HIT;
        for (int order = VOCC_ORDER_STANDARD; order <= VOCC_ORDER_RTSAH;
             order++) {
            for (int flags = 0; flags < 8; flags++) {
                const mode m = {order,
                                flags & 1,
                                flags & 4 ? 8 : 0,
                                512,
                                flags >> 1 & 1,
                                VOCC_ISA_AUTO,
                                1,
                                0};
                if (!has_order(order))
                    continue;
                trace(&w, &set, &m, actual, NULL);
                compare_answers(__FILE__, __LINE__, s.name, &set, &m, actual,
                                expected);
            }
        }
        free(leaves);
        free(expected);
        free(actual);
        rays_free(&set);
        world_free(&w);
        shape_free(&s);
    }
}

/* ---- layouts ----------------------------------------------------------- */

static void occluded_of(const world *w, const vocc_rays *rays,
                        uint8_t *occluded)
{
    vocc_error error;
    CHECK_STATUS(vocc_occluded(w->scene, rays, occluded, NULL, &error), &error,
                 VOCC_OK);
}

static void layouts(void)
{
    shape s;
    world w;
    ray_set set;
    shape_make(&s, 12, 1);
    world_make(&w, &s, NULL);
    rays_init(&set);
    rays_adversarial(&set, &s, test_scaled(200, 20), 900);
    const size_t n = set.count;
    uint8_t *expected = malloc(n), *actual = malloc(n + 2);
    double *wide = malloc(8 * n * sizeof(*wide));
    oracle_ray *backward = malloc(n * sizeof(*backward));
    REQUIRE(expected && actual && wide && backward);
    const mode baseline = mode_baseline();
    trace(&w, &set, &baseline, expected, NULL);

    /* float64 of the same values, limits and all */
    vocc_rays rays = rays_view(&set, 0, n);
    for (size_t i = 0; i < n; i++) {
        for (int k = 0; k < 3; k++) {
            wide[8 * i + (size_t)k] = (double)set.rays[i].org[k];
            wide[8 * i + 3 + (size_t)k] = (double)set.rays[i].dir[k];
        }
        wide[8 * i + 6] = (double)set.rays[i].tmin;
        wide[8 * i + 7] = (double)set.rays[i].tmax;
        backward[n - 1 - i] = set.rays[i];
    }
    rays.org = rows_of(wide, 64, VOCC_FLOAT64);
    rays.dir = rows_of(wide + 3, 64, VOCC_FLOAT64);
    rays.tmin = rows_of(wide + 6, 64, VOCC_FLOAT64);
    rays.tmax = rows_of(wide + 7, 64, VOCC_FLOAT64);
    memset(actual, 7, n + 2);
    occluded_of(&w, &rays, actual + 1);
    CHECK(memcmp(actual + 1, expected, n) == 0);
    CHECK_INT(actual[0], 7);
    CHECK_INT(actual[n + 1], 7);

    /* mixed, and backward */
    rays = rays_view(&set, 0, n);
    rays.dir = rows_of(wide + 3, 64, VOCC_FLOAT64);
    occluded_of(&w, &rays, actual);
    CHECK(memcmp(actual, expected, n) == 0);
    const ptrdiff_t back = -(ptrdiff_t)sizeof(oracle_ray);
    rays.org = rows_of(backward[n - 1].org, 0, VOCC_FLOAT32);
    rays.dir = rows_of(backward[n - 1].dir, 0, VOCC_FLOAT32);
    rays.tmin = rows_of(&backward[n - 1].tmin, 0, VOCC_FLOAT32);
    rays.tmax = rows_of(&backward[n - 1].tmax, 0, VOCC_FLOAT32);
    rays.org.stride = rays.dir.stride = back;
    rays.tmin.stride = rays.tmax.stride = back;
    occluded_of(&w, &rays, actual);
    CHECK(memcmp(actual, expected, n) == 0);

    /* No limits given: 0 and infinity.  One row for all. */
    ray_set plain;
    rays_init(&plain);
    for (size_t i = 0; i < n; i++)
        rays_add(&plain, RAY_RANDOM, set.rays[0].org, set.rays[i].dir, 0.0f,
                 HUGE_VALF);
    trace(&w, &plain, &baseline, expected, NULL);
    memset(&rays, 0, sizeof(rays));
    rays.count = n;
    rays.org = rows_of(set.rays[0].org, 0, VOCC_FLOAT32);
    rays.dir = rows_of(set.rays[0].dir, sizeof(oracle_ray), VOCC_FLOAT32);
    occluded_of(&w, &rays, actual);
    CHECK(memcmp(actual, expected, n) == 0);
    const double limits[2] = {0.0, HUGE_VAL};
    rays.tmin = rows_of(&limits[0], 0, VOCC_FLOAT64);
    rays.tmax = rows_of(&limits[1], 0, VOCC_FLOAT64);
    occluded_of(&w, &rays, actual);
    CHECK(memcmp(actual, expected, n) == 0);
    test_compared(5 * n);

    rays_free(&plain);
    rays_free(&set);
    free(expected);
    free(actual);
    free(wide);
    free(backward);
    world_free(&w);
    shape_free(&s);
}

/* The same world 524 288 units away in float64: the same answers. */
static void far_away(void)
{
    const double far[3] = {524288.0, -131072.0, 262144.0};
    static const size_t some[] = {0, 5, 8, 14, 18};
    for (size_t n = 0; n < sizeof(some) / sizeof(some[0]); n++) {
        shape s;
        world w;
        ray_set set;
        shape_make(&s, some[n], 1);
        test_context(s.name);
        world_make(&w, &s, NULL);
        rays_init(&set);
        rays_adversarial(&set, &s, test_scaled(100, 10), 950 + n);
        uint8_t *expected = malloc(set.count), *actual = malloc(set.count);
        double *org = malloc(3 * set.count * sizeof(*org));
        REQUIRE(expected && actual && org);
        double lower[3], upper[3];
        shape_bounds(&s, lower, upper);
        /* Rays that do not survive the move exactly are put elsewhere. */
        for (size_t i = 0; i < set.count; i++) {
            for (int k = 0; k < 3; k++) {
                const double x = (double)set.rays[i].org[k];
                const double moved = x - 0.5 * (lower[k] + upper[k]);
                if (isfinite(x) &&
                    (x + far[k] - far[k] != x || (double)(float)moved != moved))
                    set.rays[i].org[k] = 0.125f;
                org[3 * i + (size_t)k] = (double)set.rays[i].org[k] + far[k];
            }
        }
        const mode baseline = mode_baseline();
        trace(&w, &set, &baseline, expected, NULL);
        vocc_scene *scene = NULL;
        vocc_error error;
        REQUIRE(vocc_scene_create(NULL, &scene, NULL) == VOCC_OK);
        for (int p = 0; p < s.part_count; p++) {
            const mesh *m = &s.parts[p].m;
            double *moved = malloc(3 * m->vertex_count * sizeof(*moved));
            REQUIRE(moved);
            for (size_t v = 0; v < 3 * m->vertex_count; v++)
                moved[v] = (double)m->vertices[v] + far[v % 3];
            CHECK_STATUS(
                vocc_scene_add_mesh(
                    scene, m->vertex_count, rows_of(moved, 24, VOCC_FLOAT64),
                    m->triangle_count, mesh_triangles(m), NULL, NULL, &error),
                &error, VOCC_OK);
            free(moved);
        }
        CHECK_STATUS(vocc_scene_build(scene, NULL, &error), &error, VOCC_OK);
        double origin[3];
        CHECK_INT(vocc_scene_origin(scene, origin), VOCC_OK);
        for (int k = 0; k < 3; k++)
            CHECK_NEAR(origin[k], far[k] + 0.5 * (lower[k] + upper[k]), 0);
        vocc_rays rays = rays_view(&set, 0, set.count);
        rays.org = rows_of(org, 24, VOCC_FLOAT64);
        CHECK_STATUS(vocc_occluded(scene, &rays, actual, NULL, &error), &error,
                     VOCC_OK);
        compare_answers(__FILE__, __LINE__, s.name, &set, &baseline, actual,
                        expected);
        vocc_scene_free(scene);
        free(expected);
        free(actual);
        free(org);
        rays_free(&set);
        world_free(&w);
        shape_free(&s);
    }
}

const test_case test_identical_cases[] = {
    {"identical.orders_are_there", orders_are_there},
    {"identical.all_modes", all_modes},
    {"identical.threads", threads},
    {"identical.build_options", build_options},
    {"identical.without_occluders", without_occluders_in_meshes},
    {"identical.at_occluders", at_occluders},
    {"identical.layouts", layouts},
    {"identical.far_away", far_away},
    {NULL, NULL},
};
