/* Guards concurrent use: several threads query one scene at once, with all
 * kinds of queries and threads of their own, and get what one thread gets.
 * Meant to run under the thread sanitizer. */
#include "world.h"

#include <math.h>
#include <pthread.h>
#include <stdlib.h>
#include <string.h>

#include "test.h"

#define USERS 4

typedef struct answers {
    uint8_t *occluded;
    int32_t *prim_id, *region, *region_size;
    float *t;
    uint16_t *visible;
    int32_t *label; /* of as many leaves as there are rays */
} answers;

static void answers_make(answers *a, size_t n)
{
    a->occluded = calloc(n, 1);
    a->prim_id = calloc(n, sizeof(int32_t));
    a->region = calloc(n, sizeof(int32_t));
    a->region_size = calloc(n, sizeof(int32_t));
    a->t = calloc(n, sizeof(float));
    a->visible = calloc(n, sizeof(uint16_t));
    a->label = calloc(n, sizeof(int32_t));
    REQUIRE(a->occluded && a->prim_id && a->region && a->region_size && a->t &&
            a->visible && a->label);
}

static void answers_free(answers *a)
{
    free(a->occluded);
    free(a->prim_id);
    free(a->region);
    free(a->region_size);
    free(a->t);
    free(a->visible);
    free(a->label);
}

typedef struct user {
    const vocc_scene *scene;
    const ray_set *set;
    int number;
    answers out;
    int errors;
} user;

static int ignore_progress(void *context, double fraction)
{
    (void)context;
    (void)fraction;
    return 0;
}

/* Everything once; no checks here, the runner is not for several threads. */
static void *use(void *context)
{
    user *u = context;
    const size_t n = u->set->count;
    const vocc_rays rays = rays_view(u->set, 0, n);
    const vocc_light light = RECT(-1, 3, -1, 2, 0, 0, 0, 0, 2);
    vocc_array none;
    vocc_hits hits;
    vocc_query_options options;
    vocc_counters counters;
    vocc_ray_classification labels;
    labels.size = sizeof(labels);
    memset(&none, 0, sizeof(none));
    memset(&hits, 0, sizeof(hits));
    memset(&counters, 0, sizeof(counters));
    vocc_query_options_init(&options);
    options.threads = 1 + u->number % 3;
    options.packets = u->number != 3;
    options.order = u->number & 1 ? VOCC_ORDER_QDBFS : VOCC_ORDER_STANDARD;
    options.counters = &counters;
    options.progress = ignore_progress;
    hits.t = u->out.t;
    hits.prim_id = u->out.prim_id;
    /* Not all begin with the same query. */
    for (int step = 0; step < 5; step++) {
        vocc_status status = VOCC_OK;
        size_t count;
        switch ((step + u->number) % 5) {
        case 0:
            status =
                vocc_occluded(u->scene, &rays, u->out.occluded, &options, NULL);
            break;
        case 1:
            status = vocc_intersect(u->scene, &rays, &hits, &options, NULL);
            break;
        case 2:
            status = vocc_region(u->scene, n, rays.org, u->out.region, &options,
                                 NULL);
            /* Regions met for the first time are shared by all users. */
            for (size_t i = 0; i < n; i++) {
                u->out.region_size[i] = 0;
                if (u->out.region[i] < 0)
                    continue;
                u->errors +=
                    vocc_scene_region_info(u->scene, u->out.region[i], 0, NULL,
                                           NULL, &count, NULL) != VOCC_OK;
                u->out.region_size[i] = (int32_t)count;
            }
            break;
        case 3:
            status = vocc_scene_classify_by_rays(
                u->scene, NULL, n, u->out.label, &labels, &options, NULL);
            break;
        default:
            status = vocc_light_visibility(
                u->scene, n, rays.org, rays.dir, none, 1, &light, SAMPLING(3),
                u->out.visible, NULL, NULL, &options, NULL);
            break;
        }
        u->errors += status != VOCC_OK;
    }
    return NULL;
}

static void compare_users(const user *a, const user *b)
{
    const size_t n = a->set->count;
    CHECK(memcmp(a->out.occluded, b->out.occluded, n) == 0);
    CHECK(memcmp(a->out.prim_id, b->out.prim_id, n * sizeof(int32_t)) == 0);
    CHECK(memcmp(a->out.t, b->out.t, n * sizeof(float)) == 0);
    CHECK(memcmp(a->out.visible, b->out.visible, n * sizeof(uint16_t)) == 0);
    CHECK(memcmp(a->out.label, b->out.label, n * sizeof(int32_t)) == 0);
    /* The numbers of regions that no leaf has depend on who asks first; which
     * they are does not. */
    for (size_t i = 0; i < n; i++) {
        CHECK((a->out.region[i] < 0 ? a->out.region[i] : 0) ==
              (b->out.region[i] < 0 ? b->out.region[i] : 0));
        CHECK_INT(a->out.region_size[i], b->out.region_size[i]);
    }
    test_compared(5 * n);
}

static void many_users(void)
{
    static const size_t some[] = {5, 12, 13, 17};
    for (size_t k = 0; k < sizeof(some) / sizeof(some[0]); k++) {
        shape s;
        world alone, shared;
        ray_set set;
        test_context(shape_name(some[k]));
        shape_make(&s, some[k], !test_is_sanitized());
        rays_init(&set);
        rays_adversarial(&set, &s, test_scaled(400, 60), 1000 + k);
        world_make(&alone, &s, NULL);
        world_make(&shared, &s, NULL);
        user one;
        memset(&one, 0, sizeof(one));
        one.scene = alone.scene;
        one.set = &set;
        answers_make(&one.out, set.count);
        use(&one);
        CHECK_INT(one.errors, 0);

        user users[USERS];
        pthread_t threads[USERS];
        memset(users, 0, sizeof(users));
        for (int i = 0; i < USERS; i++) {
            users[i].scene = shared.scene;
            users[i].set = &set;
            users[i].number = i;
            answers_make(&users[i].out, set.count);
        }
        for (int i = 0; i < USERS; i++)
            REQUIRE(pthread_create(&threads[i], NULL, use, &users[i]) == 0);
        for (int i = 0; i < USERS; i++)
            CHECK_INT(pthread_join(threads[i], NULL), 0);
        for (int i = 0; i < USERS; i++) {
            CHECK_INT(users[i].errors, 0);
            compare_users(&users[i], &one);
            answers_free(&users[i].out);
        }
        answers_free(&one.out);
        world_free(&alone);
        world_free(&shared);
        rays_free(&set);
        shape_free(&s);
    }
}

/* Scenes do not share anything: built at once, by threads of their own. */
typedef struct builder {
    const shape *s;
    uint64_t leaves;
    int errors;
} builder;

static void *build(void *context)
{
    builder *b = context;
    vocc_scene *scene = NULL;
    vocc_build_options options;
    vocc_report report;
    vocc_build_options_init(&options);
    options.threads = 2;
    report.size = sizeof(report);
    b->errors += vocc_scene_create(NULL, &scene, NULL) != VOCC_OK;
    for (int i = 0; i < b->s->part_count; i++)
        b->errors += add_part(scene, &b->s->parts[i].m, 1, NULL) != VOCC_OK;
    b->errors += vocc_scene_build(scene, &options, NULL) != VOCC_OK;
    b->errors += vocc_scene_report(scene, &report, NULL) != VOCC_OK;
    b->leaves =
        report.boundary_leaves + report.opaque_leaves + report.clear_leaves;
    vocc_scene_free(scene);
    return NULL;
}

static void many_builders(void)
{
    shape s;
    shape_make(&s, 12, 1);
    builder builders[USERS];
    pthread_t threads[USERS];
    memset(builders, 0, sizeof(builders));
    for (int i = 0; i < USERS; i++) {
        builders[i].s = &s;
        REQUIRE(pthread_create(&threads[i], NULL, build, &builders[i]) == 0);
    }
    for (int i = 0; i < USERS; i++) {
        CHECK_INT(pthread_join(threads[i], NULL), 0);
        CHECK_INT(builders[i].errors, 0);
        CHECK_INT(builders[i].leaves, builders[0].leaves);
    }
    CHECK(builders[0].leaves > 10);
    shape_free(&s);
}

const test_case test_threads_cases[] = {
    {"threads.many_users", many_users},
    {"threads.many_builders", many_builders},
    {NULL, NULL},
};
