#include "occluders.h"
#include "memory.h"
#include "sort.h"
#include "walk.h"

#include <string.h>

enum {
    /* Segments meet large leaves first: of one solid, more than these do not
     * pay. */
    LEAST_GROWN = 1024,
    MOST_GROWN = 1 << 16,
    LEAVES_A_GROWN = 64,
    JOB_LEAVES = 64,
    HISTOGRAM = 1 << 16,
    ROUNDS = 2,
    HALVINGS = 4
};

typedef struct growth {
    vocc_tree *tree;
    const uint64_t *keys; /* leaf numbers in the lower half, largest last */
    size_t count;
} growth;

/* Positive floats sort like their bits. */
static uint32_t area_key(const vocc_opaque *o)
{
    const double x = (double)o->upper[0] - (double)o->lower[0],
                 y = (double)o->upper[1] - (double)o->lower[1],
                 z = (double)o->upper[2] - (double)o->lower[2];
    const double area = x * y + y * z + z * x;
    const float rounded = area < (double)FLT_MAX ? (float)area : FLT_MAX;
    uint32_t key;
    memcpy(&key, &rounded, sizeof key);
    return key;
}

/* Moves one face of a free box outward, as far as the box's extent at most. */
static void grow_face(const vocc_tree *tree, vocc_opaque *o, int axis, int up)
{
    float step = o->upper[axis] - o->lower[axis];
    float *const face = up ? &o->upper[axis] : &o->lower[axis];
    const float limit = up ? tree->upper[axis] : tree->lower[axis];
    vocc_opaque added = *o;
    float *const near_face = up ? &added.lower[axis] : &added.upper[axis],
                 *const far_face = up ? &added.upper[axis] : &added.lower[axis];
    int i;
    *near_face = *face;
    for (i = 0; i < HALVINGS; i++, step *= 0.5f) {
        float moved = up ? *face + step : *face - step;
        if (up ? moved > limit : moved < limit)
            moved = limit;
        if (moved == *face)
            return;
        *far_face = moved;
        if (vocc_box_is_free(tree, added.lower, added.upper)) {
            *face = moved;
            return;
        }
    }
}

/* The open box may touch triangles of the neighbours, the closed one that is
 * tested may not: begin a little inside. */
static int shrink(const vocc_tree *tree, vocc_opaque *o)
{
    int k;
    for (k = 0; k < 3; k++) {
        const float margin = (o->upper[k] - o->lower[k]) * (1.0f / 64.0f);
        o->lower[k] += margin;
        o->upper[k] -= margin;
    }
    return vocc_box_is_free(tree, o->lower, o->upper);
}

static double volume_of(const vocc_opaque *o)
{
    return ((double)o->upper[0] - (double)o->lower[0]) *
           ((double)o->upper[1] - (double)o->lower[1]) *
           ((double)o->upper[2] - (double)o->lower[2]);
}

static vocc_status grow_some(void *context, size_t job, int worker,
                             vocc_jobs *jobs)
{
    const growth *g = context;
    size_t i = job * JOB_LEAVES, end = i + JOB_LEAVES;
    (void)worker;
    (void)jobs;
    for (; i < end && i < g->count; i++) {
        const uint32_t number = (uint32_t)(g->keys[i] & 0xFFFFFFFFu);
        vocc_opaque *leaf = &g->tree->opaque[number];
        vocc_opaque grown = *leaf;
        int round, axis;
        g->tree->grown[i] = grown;
        if (!shrink(g->tree, &grown))
            continue;
        for (round = 0; round < ROUNDS; round++)
            for (axis = 0; axis < 3; axis++) {
                grow_face(g->tree, &grown, axis, 0);
                grow_face(g->tree, &grown, axis, 1);
            }
        /* It need not hold all of the leaf. */
        if (volume_of(&grown) > 1.25 * volume_of(leaf)) {
            g->tree->grown[i] = grown;
            leaf->grown = (int32_t)i;
        }
    }
    return VOCC_OK;
}

static size_t count_grown(const vocc_tree *tree)
{
    const size_t n = tree->opaque_count / LEAVES_A_GROWN;
    return n < LEAST_GROWN ? LEAST_GROWN : n < MOST_GROWN ? n : MOST_GROWN;
}

/* The least 16 upper bits of a key such that at most `most` leaves have these
 * or more; or 0. */
static uint32_t find_threshold(const vocc_tree *tree, size_t most,
                               size_t *histogram)
{
    size_t i, count = 0;
    uint32_t bin = HISTOGRAM;
    memset(histogram, 0, HISTOGRAM * sizeof *histogram);
    for (i = 0; i < tree->opaque_count; i++)
        histogram[area_key(&tree->opaque[i]) >> 16]++;
    while (bin > 0 && count + histogram[bin - 1] <= most)
        count += histogram[--bin];
    return bin;
}

vocc_status vocc_grow_occluders(const vocc_allocator *allocator,
                                vocc_tree *tree, int threads,
                                vocc_ticker *ticker)
{
    growth g;
    vocc_status status;
    size_t i;
    uint32_t threshold;
    const size_t most = count_grown(tree);
    uint64_t *keys = vocc_allocate(allocator, most, sizeof *keys);
    size_t *histogram = vocc_allocate(allocator, HISTOGRAM, sizeof *histogram);
    tree->grown = vocc_allocate(allocator, most, sizeof *tree->grown);
    if (!keys || !histogram || !tree->grown) {
        vocc_release(allocator, keys);
        vocc_release(allocator, histogram);
        return VOCC_ERROR_OUT_OF_MEMORY;
    }
    threshold = find_threshold(tree, most, histogram);
    g.tree = tree;
    g.keys = keys;
    g.count = 0;
    for (i = 0; i < tree->opaque_count; i++) {
        const uint32_t key = area_key(&tree->opaque[i]);
        if (key >> 16 >= threshold)
            keys[g.count++] = (uint64_t)key << 32 | (uint64_t)i;
    }
    vocc_sort(keys, g.count);
    tree->grown_count = g.count;
    status = vocc_jobs_run(allocator, threads,
                           (g.count + JOB_LEAVES - 1) / JOB_LEAVES, grow_some,
                           &g, ticker);
    vocc_release(allocator, keys);
    vocc_release(allocator, histogram);
    return status;
}
