#include "classify.h"
#include "memory.h"

#include <string.h>

/* Empty leaves that share part of a face (of positive area) have one region: a
 * surface that parted them would be listed by one of them.  So they are
 * joined, and each group of joined leaves is judged by an exact seed ray, and
 * a second one elsewhere in the group to check the first.  The slides'
 * classification shoots a ray from every leaf ("Classifying kd-nodes"). */

typedef struct empty {
    float lower[3], upper[3];
    uint32_t node;
    uint32_t parent; /* union-find */
} empty;

typedef struct group {
    uint32_t largest, second; /* leaves by volume; equal if there is one */
    double volume, second_volume;
    int32_t region; /* -1: unknown */
} group;

typedef struct flood {
    vocc_tree *tree;
    empty *empties;
    size_t count;
    vocc_ticker *ticker;
    vocc_jobs *jobs; /* in a job: what to ask whether to stop; else NULL */
    int worker;
    size_t work;
    int cancelled;
} flood;

/* Subtrees that are flooded as jobs: all at this depth. */
enum { SUBTREE_DEPTH = 6, MOST_SUBTREES = 1 << SUBTREE_DEPTH };

typedef struct subtree {
    uint32_t node;
    float lower[3], upper[3];
} subtree;

typedef struct subtrees {
    flood *flood;
    size_t count;
    subtree list[MOST_SUBTREES];
} subtrees;

#define NO_GROUP UINT32_MAX

static int count_empty(void *context, uint32_t index, const float lower[3],
                       const float upper[3])
{
    flood *f = context;
    (void)lower;
    (void)upper;
    f->count += vocc_label_of(f->tree->nodes[index]) != VOCC_BOUNDARY;
    return 0;
}

/* While the flood runs, an empty leaf's `first` is its number. */
static int store_empty(void *context, uint32_t index, const float lower[3],
                       const float upper[3])
{
    flood *f = context;
    vocc_node *n = &f->tree->nodes[index];
    empty *e;
    if (vocc_label_of(*n) == VOCC_BOUNDARY)
        return 0;
    e = &f->empties[f->count];
    memcpy(e->lower, lower, sizeof e->lower);
    memcpy(e->upper, upper, sizeof e->upper);
    e->node = index;
    e->parent = (uint32_t)f->count;
    n->at.first = (uint32_t)f->count++;
    return 0;
}

static uint32_t find(empty *empties, uint32_t i)
{
    while (empties[i].parent != i) {
        empties[i].parent = empties[empties[i].parent].parent;
        i = empties[i].parent;
    }
    return i;
}

static void unite(empty *empties, uint32_t a, uint32_t b)
{
    a = find(empties, a);
    b = find(empties, b);
    if (a < b)
        empties[b].parent = a;
    else
        empties[a].parent = b;
}

static int poll(flood *f)
{
    if ((++f->work & 0xFFFF) == 0 &&
        (f->jobs ? vocc_jobs_poll(f->jobs, f->worker)
                 : vocc_tick(f->ticker, 0.0)))
        f->cancelled = 1;
    return f->cancelled;
}

/* Joins the empty leaves on both sides of a plane across `axis`: those of
 * subtree `below` that touch it from below, those of `above` from above, where
 * their faces overlap within the rectangle lower..upper of the other axes. */
static void join_faces(flood *f, uint32_t below, uint32_t above, unsigned axis,
                       const float lower[3], const float upper[3])
{
    for (;;) {
        const vocc_node b = f->tree->nodes[below], a = f->tree->nodes[above];
        const int below_leaf = vocc_is_leaf(b), above_leaf = vocc_is_leaf(a);
        vocc_node n;
        uint32_t low_b = below, low_a = above, high_b = below, high_a = above;
        float cut[3];
        if ((below_leaf && vocc_label_of(b) == VOCC_BOUNDARY) ||
            (above_leaf && vocc_label_of(a) == VOCC_BOUNDARY) || poll(f))
            return;
        if (below_leaf && above_leaf) {
            unite(f->empties, b.at.first, a.at.first);
            return;
        }
        n = below_leaf ? a : b;
        if (vocc_axis(n) == axis) {
            /* Only the child at the plane. */
            if (below_leaf)
                above = vocc_children(a);
            else
                below = vocc_children(b) + 1;
            continue;
        }
        if (below_leaf) {
            low_a = vocc_children(a);
            high_a = low_a + 1;
        } else {
            low_b = vocc_children(b);
            high_b = low_b + 1;
        }
        if (n.at.split_pos >= upper[vocc_axis(n)]) {
            below = low_b;
            above = low_a;
            continue;
        }
        if (n.at.split_pos > lower[vocc_axis(n)]) {
            memcpy(cut, upper, sizeof cut);
            cut[vocc_axis(n)] = n.at.split_pos;
            join_faces(f, low_b, low_a, axis, lower, cut);
            memcpy(cut, lower, sizeof cut);
            cut[vocc_axis(n)] = n.at.split_pos;
            join_faces(f, high_b, high_a, axis, cut, upper);
            return;
        }
        below = high_b;
        above = high_a;
    }
}

/* Joins all leaves of a subtree: faces across its own planes last. */
static void join_node(flood *f, uint32_t index, float lower[3], float upper[3])
{
    const vocc_node n = f->tree->nodes[index];
    const unsigned axis = vocc_axis(n);
    const uint32_t below = vocc_children(n);
    float saved;
    if (vocc_is_leaf(n) || f->cancelled)
        return;
    saved = upper[axis];
    upper[axis] = n.at.split_pos;
    join_node(f, below, lower, upper);
    upper[axis] = saved;
    saved = lower[axis];
    lower[axis] = n.at.split_pos;
    join_node(f, below + 1, lower, upper);
    lower[axis] = saved;
    join_faces(f, below, below + 1, axis, lower, upper);
}

/* The nodes above SUBTREE_DEPTH: `listing` lists the subtrees below them, else
 * they are joined as in join_node. */
static void join_top(subtrees *s, uint32_t index, int depth, float lower[3],
                     float upper[3], int listing)
{
    const vocc_node n = s->flood->tree->nodes[index];
    const unsigned axis = vocc_axis(n);
    const uint32_t below = vocc_children(n);
    float saved;
    if (vocc_is_leaf(n) || s->flood->cancelled)
        return;
    if (depth == SUBTREE_DEPTH) {
        if (listing) {
            subtree *t = &s->list[s->count++];
            t->node = index;
            memcpy(t->lower, lower, sizeof t->lower);
            memcpy(t->upper, upper, sizeof t->upper);
        }
        return;
    }
    saved = upper[axis];
    upper[axis] = n.at.split_pos;
    join_top(s, below, depth + 1, lower, upper, listing);
    upper[axis] = saved;
    saved = lower[axis];
    lower[axis] = n.at.split_pos;
    join_top(s, below + 1, depth + 1, lower, upper, listing);
    lower[axis] = saved;
    if (!listing)
        join_faces(s->flood, below, below + 1, axis, lower, upper);
}

/* Leaves of different subtrees are not touched: no two jobs share any. */
static vocc_status join_subtree(void *context, size_t job, int worker,
                                vocc_jobs *jobs)
{
    subtrees *s = context;
    subtree *t = &s->list[job];
    flood f = *s->flood;
    f.jobs = jobs;
    f.worker = worker;
    join_node(&f, t->node, t->lower, t->upper);
    return f.cancelled ? VOCC_ERROR_CANCELLED : VOCC_OK;
}

static vocc_status join_leaves(const vocc_allocator *allocator, flood *f,
                               int threads)
{
    subtrees s;
    float lower[3], upper[3];
    vocc_status status;
    s.flood = f;
    s.count = 0;
    memcpy(lower, f->tree->lower, sizeof lower);
    memcpy(upper, f->tree->upper, sizeof upper);
    join_top(&s, 0, 0, lower, upper, 1);
    status =
        vocc_jobs_run(allocator, threads, s.count, join_subtree, &s, f->ticker);
    if (status == VOCC_OK) {
        join_top(&s, 0, 0, lower, upper, 0);
        status = f->cancelled ? VOCC_ERROR_CANCELLED : VOCC_OK;
    }
    return status;
}

static double volume_of(const empty *e)
{
    return ((double)e->upper[0] - (double)e->lower[0]) *
           ((double)e->upper[1] - (double)e->lower[1]) *
           ((double)e->upper[2] - (double)e->lower[2]);
}

static double area_of(const empty *e)
{
    const double x = (double)e->upper[0] - (double)e->lower[0],
                 y = (double)e->upper[1] - (double)e->lower[1],
                 z = (double)e->upper[2] - (double)e->lower[2];
    return 2.0 * (x * y + y * z + z * x);
}

/* Numbers the groups in place of the union-find's parents. */
static group *make_groups(const vocc_allocator *allocator, flood *f,
                          size_t *count)
{
    group *groups;
    uint32_t *number = vocc_allocate(allocator, f->count, sizeof *number);
    size_t i;
    if (!number)
        return NULL;
    *count = 0;
    for (i = 0; i < f->count; i++) {
        const uint32_t root = find(f->empties, (uint32_t)i);
        number[i] = root == (uint32_t)i ? (uint32_t)(*count)++ : number[root];
    }
    groups = vocc_allocate(allocator, *count, sizeof *groups);
    if (groups) {
        memset(groups, 0, (*count ? *count : 1) * sizeof *groups);
        for (i = 0; i < *count; i++)
            groups[i].largest = groups[i].second = NO_GROUP;
        for (i = 0; i < f->count; i++) {
            group *g = &groups[number[i]];
            const double volume = volume_of(&f->empties[i]);
            f->empties[i].parent = number[i];
            if (g->largest == NO_GROUP || volume > g->volume) {
                g->second = g->largest;
                g->second_volume = g->volume;
                g->largest = (uint32_t)i;
                g->volume = volume;
            } else if (g->second == NO_GROUP || volume > g->second_volume) {
                g->second = (uint32_t)i;
                g->second_volume = volume;
            }
        }
    }
    vocc_release(allocator, number);
    return groups;
}

static vocc_status seed_leaf(const vocc_allocator *allocator, const flood *f,
                             const vocc_solids *solids, uint32_t leaf,
                             uint32_t stream, vocc_regions *regions,
                             vocc_seed *seed, int32_t *region)
{
    float centre[3];
    *region = -1;
    if (!vocc_leaf_centre(f->empties[leaf].lower, f->empties[leaf].upper,
                          centre))
        return VOCC_OK;
    switch (vocc_seed_shoot(allocator, f->tree, solids, centre, stream, seed)) {
    case VOCC_SEED_OK:
        *region =
            vocc_regions_add(allocator, regions, seed->set, seed->set_count);
        return *region < 0 ? VOCC_ERROR_OUT_OF_MEMORY : VOCC_OK;
    case VOCC_SEED_NO_MEMORY:
        return VOCC_ERROR_OUT_OF_MEMORY;
    case VOCC_SEED_ON_SURFACE:
    case VOCC_SEED_NO_DIRECTION:
    default:
        return VOCC_OK;
    }
}

static vocc_status seed_groups(const vocc_allocator *allocator, const flood *f,
                               const vocc_solids *solids, group *groups,
                               size_t count, vocc_regions *regions,
                               uint64_t *rays)
{
    vocc_seed seed;
    vocc_status status = VOCC_OK;
    size_t i;
    memset(&seed, 0, sizeof seed);
    for (i = 0; i < count && status == VOCC_OK; i++) {
        group *g = &groups[i];
        int32_t check = -1;
        const uint32_t other = g->second == NO_GROUP ? g->largest : g->second;
        if (vocc_tick(f->ticker, 0.5 + 0.4 * (double)i / (double)count)) {
            status = VOCC_ERROR_CANCELLED;
            break;
        }
        status = seed_leaf(allocator, f, solids, g->largest, 2 * (uint32_t)i,
                           regions, &seed, &g->region);
        if (status == VOCC_OK && g->region >= 0) {
            status = seed_leaf(allocator, f, solids, other, 2 * (uint32_t)i + 1,
                               regions, &seed, &check);
            /* A leaf too thin for a seed cannot check; a different answer
             * makes the group useless, not wrong. */
            if (status == VOCC_OK && check >= 0 && check != g->region)
                g->region = -1;
        }
    }
    *rays = seed.rays;
    vocc_seed_free(allocator, &seed);
    return status;
}

static void set_label(vocc_node *n, unsigned label)
{
    n->bits = (n->bits & ~12u) | label << 2;
}

/* Labels, and the leaf -> bounds table. */
static vocc_status label_leaves(const vocc_allocator *allocator, flood *f,
                                const group *groups, vocc_classification *out)
{
    vocc_tree *tree = f->tree;
    size_t i, opaque = 0;
    for (i = 0; i < f->count; i++)
        opaque += groups && groups[f->empties[i].parent].region > 0;
    tree->opaque = vocc_allocate(allocator, opaque, sizeof *tree->opaque);
    if (!tree->opaque)
        return VOCC_ERROR_OUT_OF_MEMORY;
    for (i = 0; i < f->count; i++) {
        const empty *e = &f->empties[i];
        vocc_node *n = &tree->nodes[e->node];
        const int32_t region = groups ? groups[e->parent].region : 0;
        n->at.first = 0;
        if (region < 0) {
            set_label(n, VOCC_UNKNOWN);
            out->unknown_leaves++;
        } else if (region == 0) {
            set_label(n, VOCC_CLEAR);
            out->clear_leaves++;
        } else {
            vocc_opaque *o = &tree->opaque[tree->opaque_count];
            memcpy(o->lower, e->lower, sizeof o->lower);
            memcpy(o->upper, e->upper, sizeof o->upper);
            o->region = region;
            o->grown = -1;
            set_label(n, VOCC_OPAQUE);
            n->at.first = (uint32_t)tree->opaque_count++;
            out->opaque_leaves++;
            out->opaque_volume += volume_of(e);
            out->opaque_area += area_of(e);
        }
    }
    return VOCC_OK;
}

static void set_tags(vocc_tree *tree)
{
    size_t i;
    for (i = 0; i < tree->node_count; i++) {
        vocc_node *n = &tree->nodes[i];
        unsigned below, above;
        if (i == 1 || vocc_is_leaf(*n))
            continue;
        below = tree->nodes[vocc_children(*n)].bits;
        above = tree->nodes[vocc_children(*n) + 1].bits;
        below = (below & 3u) == VOCC_LEAF ? below >> 2 & 3u : 0;
        above = (above & 3u) == VOCC_LEAF ? above >> 2 & 3u : 0;
        if (below | above)
            n->bits |= VOCC_TAGGED | (below | above << 2) << VOCC_TAG_SHIFT;
    }
}

static vocc_status classify(const vocc_allocator *allocator, flood *f,
                            const vocc_solids *solids, size_t solid_count,
                            int threads, vocc_regions *regions,
                            vocc_classification *out)
{
    group *groups = NULL;
    size_t group_count = 0;
    vocc_status status = VOCC_OK;
    (void)vocc_tree_leaves(f->tree, count_empty, f);
    f->empties = vocc_allocate(allocator, f->count, sizeof *f->empties);
    if (!f->empties)
        return VOCC_ERROR_OUT_OF_MEMORY;
    f->count = 0;
    (void)vocc_tree_leaves(f->tree, store_empty, f);
    if (solid_count) {
        const double from = f->ticker->last, to = f->ticker->to;
        vocc_ticker_stage(f->ticker, from, 0.5 * (from + to));
        status = join_leaves(allocator, f, threads);
        if (status != VOCC_OK)
            return status;
        vocc_ticker_stage(f->ticker, from, to);
        groups = make_groups(allocator, f, &group_count);
        if (!groups)
            return VOCC_ERROR_OUT_OF_MEMORY;
        status = seed_groups(allocator, f, solids, groups, group_count, regions,
                             &out->seed_rays);
    }
    out->groups = group_count;
    if (status == VOCC_OK)
        status = label_leaves(allocator, f, groups, out);
    vocc_release(allocator, groups);
    if (status == VOCC_OK)
        set_tags(f->tree);
    return status;
}

static int count_boundary(void *context, uint32_t index, const float lower[3],
                          const float upper[3])
{
    flood *f = context;
    (void)lower;
    (void)upper;
    f->work += vocc_label_of(f->tree->nodes[index]) == VOCC_BOUNDARY;
    return 0;
}

vocc_status vocc_classify(const vocc_allocator *allocator, vocc_tree *tree,
                          const vocc_solids *solids, size_t solid_count,
                          int threads, vocc_regions *regions,
                          vocc_ticker *ticker, vocc_classification *out)
{
    flood f;
    vocc_status status;
    memset(&f, 0, sizeof f);
    memset(out, 0, sizeof *out);
    f.tree = tree;
    f.ticker = ticker;
    status =
        classify(allocator, &f, solids, solid_count, threads, regions, out);
    vocc_release(allocator, f.empties);
    f.work = 0;
    if (status == VOCC_OK)
        (void)vocc_tree_leaves(tree, count_boundary, &f);
    out->boundary_leaves = f.work;
    return status;
}
