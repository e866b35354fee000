/* Guards progress and cancelling: fractions begin at 0 or above, never fall
 * and end at 1, on the calling thread; a stop at any call gives CANCELLED and
 * leaves the scene usable. */
#include "world.h"

#include <math.h>
#include <pthread.h>
#include <stdlib.h>
#include <string.h>

#include "test.h"

typedef struct watch {
    pthread_t caller;
    int calls, stop_at; /* 0: never */
    int stopped, after_stop, fell, foreign;
    double last;
} watch;

static int on_progress(void *user, double fraction)
{
    watch *w = user;
    w->calls++;
    if (!(fraction >= w->last) || fraction > 1.0)
        w->fell++;
    w->last = fraction;
    if (!pthread_equal(w->caller, pthread_self()))
        w->foreign++;
    if (w->stopped)
        w->after_stop++;
    if (w->calls == w->stop_at) {
        w->stopped = 1;
        return 1;
    }
    return 0;
}

static watch watch_make(int stop_at)
{
    watch w;
    memset(&w, 0, sizeof(w));
    w.caller = pthread_self();
    w.stop_at = stop_at;
    return w;
}

static void check_watch(int line, const watch *w, vocc_status status,
                        const vocc_error *error)
{
    if (w->fell || w->foreign || w->after_stop)
        test_fail(__FILE__, line,
                  "progress: %d fell, %d on other threads, %d after a stop",
                  w->fell, w->foreign, w->after_stop);
    if (w->stopped) {
        if (status != VOCC_ERROR_CANCELLED ||
            error->status != VOCC_ERROR_CANCELLED || !error->message[0])
            test_fail(__FILE__, line,
                      "stopped at call %d (%g) and the status is \"%s\"",
                      w->calls, w->last, vocc_status_string((int32_t)status));
    } else {
        if (status != VOCC_OK)
            test_fail(__FILE__, line, "\"%s\"",
                      vocc_status_string((int32_t)status));
        if (w->calls == 0 || w->last != 1.0)
            test_fail(__FILE__, line, "%d calls, the last with %g", w->calls,
                      w->last);
    }
}

/* Calls to stop at: the first ones, then ever fewer. */
static int next_stop(int stop_at)
{
    return stop_at + 1 + stop_at / 2;
}

static void build_watched(int threads, int detail)
{
    shape s;
    shape_make(&s, 12, detail);
    counting *memory = counting_create();
    const vocc_allocator allocator = counting_allocator(memory);
    vocc_scene *scene = NULL;
    REQUIRE(vocc_scene_create(&allocator, &scene, NULL) == VOCC_OK);
    for (int i = 0; i < s.part_count; i++)
        CHECK_INT(add_part(scene, &s.parts[i].m, 1, NULL), VOCC_OK);
    vocc_build_options options;
    vocc_build_options_init(&options);
    options.threads = threads;
    options.progress = on_progress;
    const size_t live = counting_live_bytes(memory);
    for (int stop_at = 1; stop_at < 100000; stop_at = next_stop(stop_at)) {
        watch w = watch_make(stop_at);
        vocc_error error;
        memset(&error, 0, sizeof(error));
        options.progress_user = &w;
        const vocc_status status = vocc_scene_build(scene, &options, &error);
        check_watch(__LINE__, &w, status, &error);
        if (status == VOCC_OK || !w.stopped)
            break;
        CHECK_INT(counting_live_bytes(memory), live);
    }
    const world built = {memory, scene};
    ray_set set;
    rays_init(&set);
    rays_adversarial(&set, &s, 20, 9);
    world fresh;
    world_make(&fresh, &s, NULL);
    uint8_t *expected = malloc(set.count), *actual = malloc(set.count);
    REQUIRE(expected && actual);
    const mode m = mode_baseline();
    trace(&fresh, &set, &m, expected, NULL);
    trace(&built, &set, &m, actual, NULL);
    compare_answers(__FILE__, __LINE__, s.name, &set, &m, actual, expected);
    free(expected);
    free(actual);
    world_free(&fresh);
    rays_free(&set);
    vocc_scene_free(scene);
    counting_free(memory);
    shape_free(&s);
}

static void build(void)
{
    build_watched(1, 0);
    build_watched(1, 1);
    build_watched(2, 1);
    build_watched(3, 1);
}

enum { QUERIES = 6 };

/* Query q of them, with progress. */
static vocc_status run_query(int q, const world *w, const ray_set *set,
                             void *out, const vocc_query_options *options,
                             vocc_error *error)
{
    static const vocc_light lights[2] = {RECT(-1, 3, -1, 2, 0, 0, 0, 0, 2),
                                         RECT(-3, -1, -1, 0, 2, 0, 0, 0, 2)};
    const vocc_rays rays = rays_view(set, 0, set->count);
    vocc_array none;
    vocc_hits hits;
    vocc_ray_classification labels;
    memset(&none, 0, sizeof(none));
    memset(&hits, 0, sizeof(hits));
    labels.size = sizeof(labels);
    switch (q) {
    case 0:
        return vocc_occluded(w->scene, &rays, out, options, error);
    case 1:
        hits.prim_id = out;
        return vocc_intersect(w->scene, &rays, &hits, options, error);
    case 2:
        return vocc_region(w->scene, set->count, rays.org, out, options, error);
    case 3:
        return vocc_scene_classify_by_rays(w->scene, NULL, set->count, out,
                                           &labels, options, error);
    case 4:
        return vocc_ambient_occlusion(w->scene, set->count, rays.org, rays.dir,
                                      none, 0.5, SAMPLING(8), out, NULL,
                                      options, error);
    default:
        return vocc_light_visibility(w->scene, set->count, rays.org, rays.dir,
                                     none, 2, lights, SAMPLING(8), out, NULL,
                                     NULL, options, error);
    }
}

static void queries(void)
{
    shape s;
    ray_set set;
    world w;
    shape_make(&s, 12, 1);
    rays_init(&set);
    rays_adversarial(&set, &s, test_scaled(300, 60), 4);
    world_make(&w, &s, NULL);
    int32_t *out = malloc(4 * set.count), *expected = malloc(4 * set.count);
    REQUIRE(out && expected);
    for (int q = 0; q < QUERIES; q++) {
        vocc_query_options options;
        vocc_query_options_init(&options);
        memset(expected, 0, 4 * set.count);
        memset(out, 0, 4 * set.count);
        /* Once before: region keeps the regions that it is first to meet. */
        CHECK_INT(run_query(q, &w, &set, expected, &options, NULL), VOCC_OK);
        const size_t live = counting_live_bytes(w.memory);
        options.progress = on_progress;
        for (int threads = 1; threads < 4; threads++) {
            options.threads = threads;
            for (int stop_at = 1; stop_at < 100000;
                 stop_at = next_stop(stop_at)) {
                watch seen = watch_make(stop_at);
                vocc_error error;
                memset(&error, 0, sizeof(error));
                options.progress_user = &seen;
                const vocc_status status =
                    run_query(q, &w, &set, out, &options, &error);
                check_watch(__LINE__, &seen, status, &error);
                CHECK_INT(counting_live_bytes(w.memory), live);
                if (!seen.stopped)
                    break;
            }
            /* The last one ran to its end. */
            if (memcmp(out, expected, 4 * set.count) != 0)
                test_fail(__FILE__, __LINE__,
                          "query %d gives other answers with progress", q);
            test_compared(set.count);
        }
    }
    free(out);
    free(expected);
    world_free(&w);
    rays_free(&set);
    shape_free(&s);
}

const test_case test_progress_cases[] = {
    {"progress.build", build},
    {"progress.queries", queries},
    {NULL, NULL},
};
