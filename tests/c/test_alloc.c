/* Guards what happens when memory runs out: the k-th allocation of each call
 * fails, for k = 1, 2, ... until the call succeeds.  Each failure is
 * OUT_OF_MEMORY, leaks nothing, and the scene goes on as before it. */
#include "world.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "test.h"

/* More than any call here needs; a loop that ends there has not converged. */
#define MOST_ALLOCATIONS 20000

static void check_refused(int line, vocc_status status, const vocc_error *error,
                          uint64_t k)
{
    if (status != VOCC_ERROR_OUT_OF_MEMORY ||
        error->status != VOCC_ERROR_OUT_OF_MEMORY || !error->message[0])
        test_fail(__FILE__, line, "allocation %llu: status %d, error %d \"%s\"",
                  (unsigned long long)k, (int)status, (int)error->status,
                  error->message);
}

/* Threads of the library may share out the work in different ways, so with
 * them a k can pass or fail; without, the first k that passes is the end. */
static void create(void)
{
    for (uint64_t k = 1;; k++) {
        REQUIRE(k < MOST_ALLOCATIONS);
        counting *memory = counting_create();
        const vocc_allocator allocator = counting_allocator(memory);
        vocc_scene *scene = (vocc_scene *)(void *)memory;
        vocc_error error;
        memset(&error, 0, sizeof(error));
        counting_fail(memory, k, 0);
        const vocc_status status =
            vocc_scene_create(&allocator, &scene, &error);
        const int failed = counting_failed(memory);
        if (failed) {
            check_refused(__LINE__, status, &error, k);
            CHECK(scene == NULL);
        } else {
            CHECK_INT(status, VOCC_OK);
            vocc_scene_free(scene);
        }
        counting_free(memory);
        if (!failed)
            break;
    }
}

/* float64 far away, so that the wide path is taken too. */
static void far_vertices(const mesh *m, double **out)
{
    *out = malloc(3 * m->vertex_count * sizeof(double));
    REQUIRE(*out);
    for (size_t i = 0; i < 3 * m->vertex_count; i++)
        (*out)[i] = (double)m->vertices[i] + 524288.0;
}

static void add_mesh(void)
{
    shape s;
    shape_make(&s, 0, 0);
    const mesh *m = &s.parts[0].m;
    double *wide;
    far_vertices(m, &wide);
    for (int type = 0; type < 2; type++) {
        counting *memory = counting_create();
        const vocc_allocator allocator = counting_allocator(memory);
        vocc_scene *scene = NULL;
        REQUIRE(vocc_scene_create(&allocator, &scene, NULL) == VOCC_OK);
        const vocc_array vertices =
            type ? rows_of(wide, 24, VOCC_FLOAT64) : mesh_vertices(m);
        /* Many meshes, so that the list of meshes must grow in between. */
        for (int32_t number = 0; number < 20; number++) {
            for (uint64_t k = 1;; k++) {
                REQUIRE(k < MOST_ALLOCATIONS);
                const size_t before = counting_live_bytes(memory);
                int32_t geom_id = -3;
                vocc_error error;
                memset(&error, 0, sizeof(error));
                counting_fail(memory, k, 0);
                const vocc_status status = vocc_scene_add_mesh(
                    scene, m->vertex_count, vertices, m->triangle_count,
                    mesh_triangles(m), NULL, &geom_id, &error);
                if (!counting_failed(memory)) {
                    CHECK_INT(status, VOCC_OK);
                    CHECK_INT(geom_id, number);
                    break;
                }
                check_refused(__LINE__, status, &error, k);
                /* "holds no memory from the attempt" */
                CHECK_INT(counting_live_bytes(memory), before);
            }
        }
        counting_fail(memory, 0, 0);
        CHECK_INT(vocc_scene_build(scene, NULL, NULL), VOCC_OK);
        vocc_report report;
        report.size = sizeof(report);
        CHECK_INT(vocc_scene_report(scene, &report, NULL), VOCC_OK);
        CHECK_INT(report.mesh_count, 20);
        CHECK_INT(report.triangle_count, 20 * m->triangle_count);
        vocc_scene_free(scene);
        counting_free(memory);
    }
    free(wide);
    shape_free(&s);
}

static void build_shape(size_t index, int detail, int threads, int all_after)
{
    shape s;
    shape_make(&s, index, detail);
    counting *memory = counting_create();
    const vocc_allocator allocator = counting_allocator(memory);
    vocc_scene *scene = NULL;
    vocc_error error;
    REQUIRE(vocc_scene_create(&allocator, &scene, NULL) == VOCC_OK);
    for (int i = 0; i < s.part_count; i++)
        CHECK_INT(add_part(scene, &s.parts[i].m, s.parts[i].occluder, NULL),
                  VOCC_OK);
    vocc_build_options options;
    vocc_build_options_init(&options);
    options.threads = threads;
    const size_t before = counting_live_bytes(memory);
    const size_t blocks = counting_live_blocks(memory);
    uint64_t k = 1;
    for (;; k++) {
        REQUIRE(k < MOST_ALLOCATIONS);
        memset(&error, 0, sizeof(error));
        counting_fail(memory, k, all_after);
        const vocc_status status = vocc_scene_build(scene, &options, &error);
        if (!counting_failed(memory)) {
            CHECK_STATUS(status, &error, VOCC_OK);
            break;
        }
        /* A failed attempt that was not needed may be made good. */
        if (status == VOCC_OK) {
            test_fail(__FILE__, __LINE__,
                      "%s: allocation %llu failed and the build passed", s.name,
                      (unsigned long long)k);
            break;
        }
        check_refused(__LINE__, status, &error, k);
        CHECK_INT(counting_live_blocks(memory), blocks);
        CHECK_INT(counting_live_bytes(memory), before);
    }
    CHECK(k > 5);
    counting_fail(memory, 0, 0);

    /* The scene built after all these failures answers as a fresh one. */
    world fresh;
    world_make(&fresh, &s, NULL);
    ray_set set;
    rays_init(&set);
    rays_adversarial(&set, &s, 20, 77);
    uint8_t *expected = malloc(set.count), *actual = malloc(set.count);
    REQUIRE(expected && actual);
    mode m = mode_baseline();
    trace(&fresh, &set, &m, expected, NULL);
    const world after = {memory, scene};
    m.order = VOCC_ORDER_AUTO;
    m.occluders = 1;
    m.cache = 8;
    trace(&after, &set, &m, actual, NULL);
    compare_answers(__FILE__, __LINE__, s.name, &set, &m, actual, expected);
    free(expected);
    free(actual);
    rays_free(&set);
    world_free(&fresh);
    vocc_scene_free(scene);
    counting_free(memory);
    shape_free(&s);
}

static void build(void)
{
    for (size_t i = 0; i < shape_count(); i++)
        build_shape(i, 0, 1, (int)(i & 1));
}

static void build_threaded(void)
{
    build_shape(0, 0, 2, 0);
    build_shape(13, 0, 2, 1);
    build_shape(13, 0, 3, 0);
}

/* ---- queries ----------------------------------------------------------- */

typedef struct query_case {
    const char *name;
    vocc_status (*run)(const vocc_scene *scene, const ray_set *set,
                       const vocc_query_options *options, void *out,
                       vocc_error *error);
    size_t bytes_each;
} query_case;

static vocc_status run_occluded(const vocc_scene *scene, const ray_set *set,
                                const vocc_query_options *options, void *out,
                                vocc_error *error)
{
    const vocc_rays rays = rays_view(set, 0, set->count);
    return vocc_occluded(scene, &rays, out, options, error);
}

static vocc_status run_intersect(const vocc_scene *scene, const ray_set *set,
                                 const vocc_query_options *options, void *out,
                                 vocc_error *error)
{
    const vocc_rays rays = rays_view(set, 0, set->count);
    vocc_hits hits;
    memset(&hits, 0, sizeof(hits));
    hits.prim_id = out;
    return vocc_intersect(scene, &rays, &hits, options, error);
}

static vocc_status run_region(const vocc_scene *scene, const ray_set *set,
                              const vocc_query_options *options, void *out,
                              vocc_error *error)
{
    const vocc_rays rays = rays_view(set, 0, set->count);
    return vocc_region(scene, set->count, rays.org, out, options, error);
}

static vocc_status run_light(const vocc_scene *scene, const ray_set *set,
                             const vocc_query_options *options, void *out,
                             vocc_error *error)
{
    const vocc_rays rays = rays_view(set, 0, set->count);
    const vocc_light light = RECT(-1, 3, -1, 2, 0, 0, 0, 0, 2);
    vocc_array none;
    memset(&none, 0, sizeof(none));
    return vocc_light_visibility(scene, set->count, rays.org, rays.dir, none, 1,
                                 &light, SAMPLING(4), out, NULL, NULL, options,
                                 error);
}

static vocc_status run_occlusion(const vocc_scene *scene, const ray_set *set,
                                 const vocc_query_options *options, void *out,
                                 vocc_error *error)
{
    const vocc_rays rays = rays_view(set, 0, set->count);
    vocc_array none;
    memset(&none, 0, sizeof(none));
    return vocc_ambient_occlusion(scene, set->count, rays.org, rays.dir, none,
                                  0.5, NULL, out, NULL, options, error);
}

static vocc_status run_classify_by_rays(const vocc_scene *scene,
                                        const ray_set *set,
                                        const vocc_query_options *options,
                                        void *out, vocc_error *error)
{
    vocc_ray_classification result;
    result.size = sizeof(result);
    /* There may be fewer leaves than rays. */
    memset(out, 0, 4 * set->count);
    return vocc_scene_classify_by_rays(scene, NULL, set->count, out, &result,
                                       options, error);
}

static const query_case query_cases[] = {
    {"occluded", run_occluded, 1},
    {"intersect", run_intersect, 4},
    {"region", run_region, 4},
    {"light_visibility", run_light, 2},
    {"ambient_occlusion", run_occlusion, 2},
    {"classify_by_rays", run_classify_by_rays, 4},
};

static void query_with_failures(const world *w, const ray_set *set,
                                const query_case *query,
                                const vocc_query_options *options)
{
    const size_t bytes = set->count * query->bytes_each;
    unsigned char *expected = malloc(bytes), *actual = malloc(bytes);
    REQUIRE(expected && actual);
    vocc_error error;
    counting_fail(w->memory, 0, 0);
    /* Once before, since region keeps the regions that it is first to meet. */
    CHECK_STATUS(query->run(w->scene, set, options, expected, &error), &error,
                 VOCC_OK);
    const size_t live = counting_live_bytes(w->memory);
    for (uint64_t k = 1;; k++) {
        REQUIRE(k < MOST_ALLOCATIONS);
        memset(&error, 0, sizeof(error));
        counting_fail(w->memory, k, 0);
        const vocc_status status =
            query->run(w->scene, set, options, actual, &error);
        const int failed = counting_failed(w->memory);
        CHECK_INT(counting_live_bytes(w->memory), live);
        if (!failed) {
            CHECK_STATUS(status, &error, VOCC_OK);
            break;
        }
        check_refused(__LINE__, status, &error, k);
        counting_fail(w->memory, 0, 0);
        CHECK_INT(query->run(w->scene, set, options, actual, NULL), VOCC_OK);
        if (memcmp(actual, expected, bytes) != 0)
            test_fail(__FILE__, __LINE__,
                      "%s gives other answers after allocation %llu failed",
                      query->name, (unsigned long long)k);
        test_compared(set->count);
    }
    free(expected);
    free(actual);
}

static void queries(void)
{
    static const int orders[] = {VOCC_ORDER_STANDARD, VOCC_ORDER_EXTENDED,
                                 VOCC_ORDER_BFS, VOCC_ORDER_QDBFS};
    shape s;
    ray_set set;
    world w;
    shape_make(&s, 12, 0);
    rays_init(&set);
    rays_adversarial(&set, &s, test_scaled(40, 8), 3);
    world_make(&w, &s, NULL);
    for (size_t q = 0; q < sizeof(query_cases) / sizeof(query_cases[0]); q++) {
        for (size_t i = 0; i < sizeof(orders) / sizeof(orders[0]); i++) {
            if (!has_order(orders[i]))
                continue;
            for (int threads = 1; threads < 4; threads++) {
                vocc_query_options options;
                vocc_query_options_init(&options);
                options.order = orders[i];
                options.packets = threads & 1;
                options.threads = threads;
                query_with_failures(&w, &set, &query_cases[q], &options);
            }
        }
    }
    counting_fail(w.memory, 0, 0);
    world_free(&w);
    rays_free(&set);
    shape_free(&s);
}

/* The reports allocate nothing, or clean up. */
static void reports(void)
{
    shape s;
    world w;
    shape_make(&s, 13, 0);
    world_make(&w, &s, NULL);
    const size_t live = counting_live_bytes(w.memory);
    vocc_report report;
    vocc_mesh_report mesh_report;
    size_t count;
    report.size = sizeof(report);
    mesh_report.size = sizeof(mesh_report);
    for (uint64_t k = 1; k < 10; k++) {
        counting_fail(w.memory, k, 1);
        const vocc_status status[4] = {
            vocc_scene_report(w.scene, &report, NULL),
            vocc_scene_mesh_report(w.scene, 0, &mesh_report, NULL),
            vocc_scene_leaves(w.scene, 0, NULL, &count, NULL),
            vocc_scene_open_edges(w.scene, 0, 0, NULL, &count, NULL)};
        for (int i = 0; i < 4; i++)
            CHECK(status[i] == VOCC_OK ||
                  status[i] == VOCC_ERROR_OUT_OF_MEMORY);
        CHECK_INT(counting_live_bytes(w.memory), live);
    }
    counting_fail(w.memory, 0, 0);
    world_free(&w);
    shape_free(&s);
}

const test_case test_alloc_cases[] = {
    {"alloc.create", create},
    {"alloc.add_mesh", add_mesh},
    {"alloc.build", build},
    {"alloc.build_threaded", build_threaded},
    {"alloc.queries", queries},
    {"alloc.reports", reports},
    {NULL, NULL},
};
