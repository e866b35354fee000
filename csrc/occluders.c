#include "occluders.h"
#include "memory.h"
#include "sort.h"
#include "walk.h"

#include <string.h>

/* Enough is grown when boxes hold the middles of leaves of so much of the
 * volume of all: of one solid a few hundred do, of a town some for each house.
 */
#define SHARE 0.94

/* A box is worth more than a leaf if it is so much larger. */
#define WORTH 1.25

enum {
    LEAST_GROWN = 1024,
    /* Enough in any case: so many, or one for so many leaves. */
    ENOUGH_GROWN = 4096,
    LEAVES_A_GROWN = 64,
    MOST_GROWN = 1 << 16,
    /* Leaves to look at for one whose middle no box holds. */
    CANDIDATES = 16,
    /* Those that grow at the same time do not know of each other. */
    WAVE = 64,
    WAVE_SHARE = 4,
    JOB_LEAVES = 8,
    HISTOGRAM = 1 << 16,
    ROUNDS = 2,
    HALVINGS = 4
};

typedef struct growth {
    vocc_tree *tree;
    size_t most;
    double held;      /* volume of the leaves whose middles boxes hold */
    uint32_t *leaf;   /* those of a wave */
    vocc_opaque *box; /* what they grow to */
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
        vocc_opaque grown = g->tree->opaque[g->leaf[i]];
        int round, axis;
        g->box[i] = grown;
        if (!shrink(g->tree, &grown))
            continue;
        for (round = 0; round < ROUNDS; round++)
            for (axis = 0; axis < 3; axis++) {
                grow_face(g->tree, &grown, axis, 0);
                grow_face(g->tree, &grown, axis, 1);
            }
        /* It need not hold all of the leaf. */
        if (volume_of(&grown) > WORTH * volume_of(&g->box[i]))
            g->box[i] = grown;
    }
    return VOCC_OK;
}

static int holds_middle(const vocc_opaque *box, const vocc_opaque *leaf)
{
    int k;
    for (k = 0; k < 3; k++) {
        const double middle =
            0.5 * ((double)leaf->lower[k] + (double)leaf->upper[k]);
        if (middle < (double)box->lower[k] || middle > (double)box->upper[k])
            return 0;
    }
    return 1;
}

/* Names the last box to the leaves below a node whose middles it holds, where
 * it is worth more than they are. */
static void name_box(growth *g, uint32_t index)
{
    const size_t number = g->tree->grown_count - 1;
    const vocc_opaque *const box = &g->tree->grown[number];
    vocc_node n = g->tree->nodes[index];
    while (!vocc_is_leaf(n)) {
        const unsigned axis = vocc_axis(n);
        uint32_t child = vocc_children(n);
        if (box->lower[axis] >= n.at.split_pos) {
            child++;
        } else if (box->upper[axis] > n.at.split_pos) {
            name_box(g, child);
            child++;
        }
        n = g->tree->nodes[child];
    }
    if (vocc_label_of(n) == VOCC_OPAQUE) {
        vocc_opaque *const leaf = &g->tree->opaque[n.at.first];
        if (leaf->grown < 0 && holds_middle(box, leaf) &&
            volume_of(box) > WORTH * volume_of(leaf)) {
            leaf->grown = (int32_t)number;
            g->held += volume_of(leaf);
        }
    }
}

/* Takes what a wave has grown, but of leaves whose middle another box of it
 * holds. */
static void take_wave(growth *g)
{
    size_t i;
    for (i = 0; i < g->count; i++) {
        vocc_opaque *const leaf = &g->tree->opaque[g->leaf[i]];
        const size_t number = g->tree->grown_count;
        if (leaf->grown >= 0)
            continue;
        g->tree->grown[number] = g->box[i];
        g->tree->grown_count++;
        if (volume_of(&g->box[i]) > WORTH * volume_of(leaf)) {
            name_box(g, 0);
            if (leaf->grown >= 0)
                continue;
            /* It need not hold the leaf's middle. */
            leaf->grown = (int32_t)number;
        }
        g->held += volume_of(leaf);
    }
}

static size_t count_grown(const vocc_tree *tree)
{
    const size_t n = tree->opaque_count / LEAVES_A_GROWN;
    return n < ENOUGH_GROWN ? ENOUGH_GROWN : n < MOST_GROWN ? n : MOST_GROWN;
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

/* Leaves in waves, the largest first; those whose middle a box holds need none
 * of their own. */
static vocc_status grow_waves(const vocc_allocator *allocator, growth *g,
                              const uint64_t *keys, size_t count, int threads,
                              vocc_ticker *ticker)
{
    vocc_tree *const tree = g->tree;
    double volume = 0.0;
    size_t i, next = count;
    for (i = 0; i < tree->opaque_count; i++)
        volume += volume_of(&tree->opaque[i]);
    while (next > 0 && tree->grown_count < g->most &&
           (tree->grown_count < LEAST_GROWN || g->held < SHARE * volume)) {
        const size_t share = tree->grown_count / WAVE_SHARE,
                     wave = share > WAVE ? share : WAVE,
                     room = g->most - tree->grown_count;
        vocc_status status;
        for (g->count = 0; next > 0 && g->count < wave && g->count < room;) {
            const uint32_t leaf = (uint32_t)(keys[--next] & 0xFFFFFFFFu);
            if (tree->opaque[leaf].grown < 0)
                g->leaf[g->count++] = leaf;
        }
        status = vocc_jobs_run(allocator, threads,
                               (g->count + JOB_LEAVES - 1) / JOB_LEAVES,
                               grow_some, g, ticker);
        if (status != VOCC_OK)
            return status;
        take_wave(g);
    }
    return VOCC_OK;
}

vocc_status vocc_grow_occluders(const vocc_allocator *allocator,
                                vocc_tree *tree, int threads,
                                vocc_ticker *ticker)
{
    vocc_status status = VOCC_ERROR_OUT_OF_MEMORY;
    size_t i, count = 0, candidates;
    uint64_t *keys;
    size_t *histogram;
    growth g;
    g.tree = tree;
    g.held = 0.0;
    g.most = count_grown(tree);
    if (g.most > tree->opaque_count)
        g.most = tree->opaque_count;
    candidates = g.most * CANDIDATES;
    if (candidates > tree->opaque_count)
        candidates = tree->opaque_count;
    keys = vocc_allocate(allocator, candidates, sizeof *keys);
    histogram = vocc_allocate(allocator, HISTOGRAM, sizeof *histogram);
    g.leaf = vocc_allocate(allocator, g.most, sizeof *g.leaf);
    g.box = vocc_allocate(allocator, g.most, sizeof *g.box);
    tree->grown_count = 0;
    tree->grown = vocc_allocate(allocator, g.most, sizeof *tree->grown);
    if (keys && histogram && g.leaf && g.box && tree->grown) {
        const uint32_t threshold = find_threshold(tree, candidates, histogram);
        for (i = 0; i < tree->opaque_count; i++) {
            const uint32_t key = area_key(&tree->opaque[i]);
            if (key >> 16 >= threshold)
                keys[count++] = (uint64_t)key << 32 | (uint64_t)i;
        }
        vocc_sort(keys, count);
        status = grow_waves(allocator, &g, keys, count, threads, ticker);
    }
    vocc_release(allocator, g.box);
    vocc_release(allocator, g.leaf);
    vocc_release(allocator, histogram);
    vocc_release(allocator, keys);
    return status;
}
