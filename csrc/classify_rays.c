#include "memory.h"
#include "query.h"
#include "status.h"
#include "triangle.h"
#include "vec3.h"

#include <inttypes.h>
#include <math.h>
#include <string.h>

/* The slides' own rule ("Classifying kd-nodes"), one closest hit an empty leaf;
 * classify.c has a flood fill and seed rays for some of the leaves. */

/* Leaves a job: some milliseconds. */
enum { JOB_LEAVES = 16 * VOCC_BLOCK };

typedef struct test_ray {
    float org[3];
    uint32_t leaf; /* in the tree's order */
    uint8_t flood; /* labels by the two methods */
    uint8_t label;
} test_ray;

typedef struct leaf_query {
    vocc_query query;
    float dir[3];
    test_ray *rays;
    size_t count;
    int32_t *labels;
    size_t capacity;
    vocc_ray_classification result;
} leaf_query;

/* Scaled by a power of two, so that the numbers are neither too large nor too
 * small for float32 and those that are float32 numbers stay as they are. */
static vocc_status set_direction(const double direction[3], float dir[3],
                                 vocc_error *error)
{
    static const double generic[3] = {0.7548777, 0.5698403, 0.3247180};
    const double *d = direction ? direction : generic;
    double largest = 0.0;
    int k, exponent;
    for (k = 0; k < 3; k++) {
        if (!(vocc_abs(d[k]) <= DBL_MAX))
            return vocc_fail(error, VOCC_ERROR_INVALID_ARGUMENT, "direction", k,
                             d[k], "direction[%d] is %g: it has to be finite",
                             k, d[k]);
        largest = vocc_abs(d[k]) > largest ? vocc_abs(d[k]) : largest;
    }
    if (largest == 0.0)
        return vocc_fail(error, VOCC_ERROR_INVALID_ARGUMENT, "direction", -1,
                         0.0, "direction is 0: it has to point somewhere");
    (void)frexp(largest, &exponent);
    for (k = 0; k < 3; k++)
        dir[k] = (float)ldexp(d[k], -exponent);
    return VOCC_OK;
}

static vocc_status check_result(size_t capacity, const int32_t *labels,
                                const vocc_ray_classification *result,
                                vocc_error *error)
{
    if (capacity && !labels)
        return vocc_fail(error, VOCC_ERROR_INVALID_ARGUMENT, "labels", -1,
                         (double)NAN, "labels: NULL");
    if (!result)
        return vocc_fail(error, VOCC_ERROR_INVALID_ARGUMENT, "result", -1,
                         (double)NAN, "result: NULL");
    if (result->size != sizeof *result)
        return vocc_fail(error, VOCC_ERROR_INVALID_ARGUMENT, "result", -1,
                         (double)result->size,
                         "result: size is %" PRIu32 ", not %zu", result->size,
                         sizeof *result);
    return VOCC_OK;
}

/* ---- rays ------------------------------------------------------------------
 */

/* Writes the labels that need no ray, and lists the rays. */
static int list_leaf(void *context, uint32_t node, const float lower[3],
                     const float upper[3])
{
    leaf_query *q = context;
    const unsigned flood =
        vocc_label_of(q->query.scene->built.tree.nodes[node]);
    const uint64_t leaf = q->result.leaf_count++;
    test_ray *ray = &q->rays[q->count];
    if (leaf < q->capacity)
        q->labels[leaf] = flood == VOCC_BOUNDARY ? VOCC_BOUNDARY : VOCC_UNKNOWN;
    if (flood == VOCC_BOUNDARY)
        return 0;
    if (!vocc_leaf_centre(lower, upper, ray->org)) {
        q->result.unknown_leaves++;
        return 0;
    }
    ray->leaf = (uint32_t)leaf;
    ray->flood = (uint8_t)flood;
    q->count++;
    return 0;
}

static void load_block(const leaf_query *q, size_t first, vocc_block *block)
{
    size_t i;
    int k;
    for (i = 0; i < block->count; i++) {
        for (k = 0; k < 3; k++) {
            block->org[k][i] = q->rays[first + i].org[k];
            block->dir[k][i] = q->dir[k];
        }
        block->tmin[i] = 0.0f;
        block->tmax[i] = INFINITY;
        block->end_region[i] = 0;
    }
}

/* Whether ray i met the back of a triangle: by the exact sign of its normal
 * along the ray. */
static int met_back(const leaf_query *q, const vocc_block *block, size_t i)
{
    const float org[3] = {block->org[0][i], block->org[1][i], block->org[2][i]};
    const float *corners = q->query.scene->built.tree.corners;
    vocc_crossing crossing;
    if (block->triangle[i] == UINT32_MAX)
        return 0;
    corners += 9 * (size_t)block->slot[i];
    return vocc_triangle_test(org, q->dir, 0.0f, INFINITY, corners,
                              &crossing) &&
           crossing.det_sign > 0;
}

static vocc_status shoot(void *context, size_t job, int worker, vocc_jobs *jobs)
{
    leaf_query *q = context;
    const vocc_worker *w = &q->query.workers[worker];
    size_t first = job * JOB_LEAVES, end = first + JOB_LEAVES, i;
    (void)jobs;
    if (end > q->count)
        end = q->count;
    for (; first < end; first += w->block->count) {
        w->block->count = end - first < VOCC_BLOCK ? end - first : VOCC_BLOCK;
        load_block(q, first, w->block);
        q->query.kernels->closest(w->tracer, w->block);
        for (i = 0; i < w->block->count; i++)
            q->rays[first + i].label =
                met_back(q, w->block, i) ? VOCC_OPAQUE : VOCC_CLEAR;
    }
    return VOCC_OK;
}

static void sum_up(leaf_query *q)
{
    vocc_ray_classification *r = &q->result;
    size_t i;
    r->rays = q->count;
    for (i = 0; i < q->count; i++) {
        const test_ray *ray = &q->rays[i];
        if (ray->leaf < q->capacity)
            q->labels[ray->leaf] = ray->label;
        if (ray->label == VOCC_OPAQUE)
            r->opaque_leaves++;
        else
            r->clear_leaves++;
        r->disagreements +=
            ray->flood != VOCC_UNKNOWN && ray->flood != ray->label;
    }
}

/* ---- the call --------------------------------------------------------------
 */

static size_t count_empty(const vocc_scene *scene)
{
    const vocc_report *r = &scene->built.report;
    return (size_t)(r->opaque_leaves + r->clear_leaves + r->unknown_leaves);
}

static vocc_status classify(leaf_query *q, size_t jobs)
{
    const vocc_scene *scene = q->query.scene;
    const vocc_allocator *a = &scene->allocator;
    const vocc_tree *tree = &scene->built.tree;
    vocc_status status = VOCC_ERROR_OUT_OF_MEMORY;
    q->rays = vocc_allocate(a, count_empty(scene), sizeof *q->rays);
    if (q->rays) {
        (void)vocc_tree_leaves(tree, list_leaf, q);
        status = vocc_query_run(&q->query, jobs, shoot, q);
    }
    if (status == VOCC_OK)
        sum_up(q);
    vocc_release(a, q->rays);
    return status;
}

vocc_status vocc_scene_classify_by_rays(const vocc_scene *scene,
                                        const double direction[3],
                                        size_t capacity, int32_t *labels,
                                        vocc_ray_classification *result,
                                        const vocc_query_options *options,
                                        vocc_error *error)
{
    const double start = vocc_seconds();
    leaf_query q;
    size_t jobs;
    vocc_status status = check_result(capacity, labels, result, error);
    if (status == VOCC_OK)
        status = set_direction(direction, q.dir, error);
    if (status != VOCC_OK)
        return status;
    jobs = scene && scene->is_built
               ? (count_empty(scene) + JOB_LEAVES - 1) / JOB_LEAVES
               : 0;
    status = vocc_query_begin(&q.query, scene, options, jobs, error);
    if (status != VOCC_OK)
        return status;
    q.count = 0;
    q.labels = labels;
    q.capacity = capacity;
    memset(&q.result, 0, sizeof q.result);
    q.result.size = result->size;
    q.result.threads = q.query.worker_count;
    status = vocc_query_end(&q.query, classify(&q, jobs), error);
    if (status == VOCC_OK) {
        q.result.seconds = vocc_seconds() - start;
        *result = q.result;
    }
    return status;
}
