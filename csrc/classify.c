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
} empty;

typedef struct group {
    uint32_t largest, second; /* leaves by volume; equal if there is one */
    double volume, second_volume;
    int32_t region; /* -1: unknown */
} group;

typedef struct flood {
    vocc_tree *tree;
    empty *empties;
    uint32_t *parents; /* union-find */
    size_t count;
    int joining; /* not if there are no solids: all is CLEAR */
    vocc_ticker *ticker;
    vocc_jobs *jobs; /* in a job: what to ask whether to stop; else NULL */
    int worker;
    size_t work;
    int cancelled;
} flood;

/* Subtrees that are flooded as jobs: all at this depth, and leaves above. */
enum { SUBTREE_DEPTH = 6, MOST_SUBTREES = 1 << SUBTREE_DEPTH };

typedef struct subtree {
    uint32_t node;
    float lower[3], upper[3];
    size_t empties, boundaries; /* leaves */
    size_t first;               /* number of its first empty leaf */
} subtree;

typedef struct subtrees {
    flood *flood;
    size_t count;
    subtree list[MOST_SUBTREES];
} subtrees;

#define NO_GROUP UINT32_MAX

static void count_leaves(const vocc_tree *tree, uint32_t index, subtree *t)
{
    const vocc_node n = tree->nodes[index];
    if (!vocc_is_leaf(n)) {
        count_leaves(tree, vocc_children(n), t);
        count_leaves(tree, vocc_children(n) + 1, t);
    } else if (vocc_label_of(n) == VOCC_BOUNDARY) {
        t->boundaries++;
    } else {
        t->empties++;
    }
}

/* While the flood runs, an empty leaf's `first` is its number. */
static void store_empty(flood *f, uint32_t index, const float lower[3],
                        const float upper[3])
{
    vocc_node *n = &f->tree->nodes[index];
    empty *e;
    if (vocc_label_of(*n) == VOCC_BOUNDARY)
        return;
    e = &f->empties[f->count];
    memcpy(e->lower, lower, sizeof e->lower);
    memcpy(e->upper, upper, sizeof e->upper);
    e->node = index;
    f->parents[f->count] = (uint32_t)f->count;
    n->at.first = (uint32_t)f->count++;
}

static uint32_t find(uint32_t *parents, uint32_t i)
{
    while (parents[i] != i) {
        parents[i] = parents[parents[i]];
        i = parents[i];
    }
    return i;
}

static void unite(uint32_t *parents, uint32_t a, uint32_t b)
{
    a = find(parents, a);
    b = find(parents, b);
    if (a < b)
        parents[b] = a;
    else
        parents[a] = b;
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
            unite(f->parents, b.at.first, a.at.first);
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

/* Stores and joins all leaves of a subtree: faces across its own planes
 * last. */
static void flood_node(flood *f, uint32_t index, float lower[3], float upper[3])
{
    const vocc_node n = f->tree->nodes[index];
    const unsigned axis = vocc_axis(n);
    const uint32_t below = vocc_children(n);
    float saved;
    if (vocc_is_leaf(n)) {
        store_empty(f, index, lower, upper);
        return;
    }
    if (f->cancelled)
        return;
    saved = upper[axis];
    upper[axis] = n.at.split_pos;
    flood_node(f, below, lower, upper);
    upper[axis] = saved;
    saved = lower[axis];
    lower[axis] = n.at.split_pos;
    flood_node(f, below + 1, lower, upper);
    lower[axis] = saved;
    if (f->joining)
        join_faces(f, below, below + 1, axis, lower, upper);
}

/* The nodes above SUBTREE_DEPTH: `listing` lists the subtrees below them, else
 * they are joined as in flood_node. */
static void visit_top(subtrees *s, uint32_t index, int depth, float lower[3],
                      float upper[3], int listing)
{
    const vocc_node n = s->flood->tree->nodes[index];
    const unsigned axis = vocc_axis(n);
    const uint32_t below = vocc_children(n);
    float saved;
    if (vocc_is_leaf(n) || depth == SUBTREE_DEPTH) {
        if (listing) {
            subtree *t = &s->list[s->count++];
            memset(t, 0, sizeof *t);
            t->node = index;
            memcpy(t->lower, lower, sizeof t->lower);
            memcpy(t->upper, upper, sizeof t->upper);
        }
        return;
    }
    saved = upper[axis];
    upper[axis] = n.at.split_pos;
    visit_top(s, below, depth + 1, lower, upper, listing);
    upper[axis] = saved;
    saved = lower[axis];
    lower[axis] = n.at.split_pos;
    visit_top(s, below + 1, depth + 1, lower, upper, listing);
    lower[axis] = saved;
    if (!listing && !s->flood->cancelled)
        join_faces(s->flood, below, below + 1, axis, lower, upper);
}

static vocc_status count_subtree(void *context, size_t job, int worker,
                                 vocc_jobs *jobs)
{
    subtrees *s = context;
    (void)worker;
    (void)jobs;
    count_leaves(s->flood->tree, s->list[job].node, &s->list[job]);
    return VOCC_OK;
}

/* Leaves of different subtrees are not touched: no two jobs share any. */
static vocc_status flood_subtree(void *context, size_t job, int worker,
                                 vocc_jobs *jobs)
{
    subtrees *s = context;
    subtree *t = &s->list[job];
    flood f = *s->flood;
    f.jobs = jobs;
    f.worker = worker;
    f.count = t->first;
    flood_node(&f, t->node, t->lower, t->upper);
    return f.cancelled ? VOCC_ERROR_CANCELLED : VOCC_OK;
}

static vocc_status flood_leaves(const vocc_allocator *allocator, flood *f,
                                int threads, size_t *boundaries)
{
    subtrees s;
    float lower[3], upper[3];
    vocc_status status;
    size_t i;
    s.flood = f;
    s.count = 0;
    memcpy(lower, f->tree->lower, sizeof lower);
    memcpy(upper, f->tree->upper, sizeof upper);
    visit_top(&s, 0, 0, lower, upper, 1);
    status = vocc_jobs_run(allocator, threads, s.count, count_subtree, &s,
                           f->ticker);
    if (status != VOCC_OK)
        return status;
    for (i = 0; i < s.count; i++) {
        s.list[i].first = f->count;
        f->count += s.list[i].empties;
        *boundaries += s.list[i].boundaries;
    }
    f->empties = vocc_allocate(allocator, f->count, sizeof *f->empties);
    f->parents = vocc_allocate(allocator, f->count, sizeof *f->parents);
    if (!f->empties || !f->parents)
        return VOCC_ERROR_OUT_OF_MEMORY;
    status = vocc_jobs_run(allocator, threads, s.count, flood_subtree, &s,
                           f->ticker);
    if (status == VOCC_OK && f->joining) {
        visit_top(&s, 0, 0, lower, upper, 0);
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
        const uint32_t root = find(f->parents, (uint32_t)i);
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
            f->parents[i] = number[i];
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
        opaque += groups && groups[f->parents[i]].region > 0;
    tree->opaque = vocc_allocate(allocator, opaque, sizeof *tree->opaque);
    if (!tree->opaque)
        return VOCC_ERROR_OUT_OF_MEMORY;
    for (i = 0; i < f->count; i++) {
        const empty *e = &f->empties[i];
        vocc_node *n = &tree->nodes[e->node];
        const int32_t region = groups ? groups[f->parents[i]].region : 0;
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
    size_t boundaries = 0;
    vocc_status status;
    const double from = f->ticker->last, to = f->ticker->to;
    f->joining = solid_count != 0;
    vocc_ticker_stage(f->ticker, from, 0.5 * (from + to));
    status = flood_leaves(allocator, f, threads, &boundaries);
    out->boundary_leaves = boundaries;
    if (status != VOCC_OK)
        return status;
    if (solid_count) {
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
    vocc_release(allocator, f.parents);
    return status;
}
