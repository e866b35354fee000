#include "build.h"
#include "memory.h"
#include "mesh.h"
#include "split.h"
#include "vec3.h"

#include <math.h>
#include <string.h>

/* The tree is built in waves of tasks that run side by side: the first is the
 * whole; a task leaves nodes of a size that only depends on the mesh, half of
 * the last wave's, to the next wave.  Each writes arrays of its own, which are
 * laid out one after the other at the end. */
enum { WAVES = 6, JOB_TRIANGLES = 16384 };

/* References from which a coarse tree clips triangles at a split; of fewer, it
 * divides the bounds: a seventh less time, for rays that are a twentieth
 * slower. */
enum { COARSE_CLIPPED = 33 };

typedef struct settings {
    const float *corners;
    vocc_sah sah;
    float scale; /* largest |coordinate| */
    size_t max_leaf_size;
    size_t least_clipped; /* references from which triangles are clipped */
    int max_depth, bad_refines;
} settings;

/* A node still to be built. */
typedef struct pending {
    size_t count;
    vocc_bounds box;
    int depth;
    int bad;       /* splits in a row that the SAH found too dear */
    size_t budget; /* references that splits below may add */
    size_t pairs;  /* nodes below that may be split */
} pending;

/* Of a node's references, with room to split it. */
#define ROOM(count) (2 * (count) + 64)

/* Of a tree's references, so that a leaf's first fits 32 bits. */
#define MOST_ADDED(count) (12 * (count) + 64)
typedef char vocc_references_fit_32_bits
    [VOCC_MAX_TRIANGLES + MOST_ADDED(VOCC_MAX_TRIANGLES) < UINT32_MAX ? 1 : -1];
typedef char vocc_a_leaf_may_hold_all_triangles
    [VOCC_MAX_TRIANGLES < (uint32_t)1 << 28 ? 1 : -1];

/* A subtree left to a job. */
typedef struct task {
    pending node;
    vocc_reference *references;
    size_t parent;        /* task of the wave before */
    uint32_t place;       /* node of the parent's that it is */
    uint32_t root, pairs; /* node of the tree that it is; pairs before its */
    size_t first;         /* of its references in the tree */
    struct task *tasks;   /* left to the next wave */
    size_t task_count;
    vocc_node *nodes;
    size_t node_count;
    uint32_t *leaves; /* triangles of its leaves */
    size_t leaf_count;
    int depth;
} task;

typedef struct wave {
    task *tasks;
    size_t count;
    size_t task_size; /* of the next */
} wave;

typedef struct forest {
    const vocc_allocator *allocator;
    const settings *settings;
    vocc_tree *tree;
    size_t least; /* count of references that is left to no other task */
    int wave;
    wave waves[WAVES];
} forest;

typedef struct builder {
    const vocc_allocator *allocator;
    const settings *settings;
    vocc_node *nodes;
    size_t node_count, node_capacity;
    uint32_t *leaves;
    size_t leaf_count, leaf_capacity;
    /* References of the open nodes, a stack: a node's are the last `count`. */
    vocc_reference *stack;
    size_t stack_count, stack_capacity;
    int depth;
    /* Nodes of at most task_size become tasks. */
    size_t task_size;
    task *tasks;
    size_t task_count, task_capacity;
    size_t task_pairs; /* nodes that they may split */
    /* To report, and to be stopped. */
    vocc_jobs *jobs;
    int worker;
    size_t work;
    vocc_status status;
} builder;

static int fail(builder *b, vocc_status status)
{
    b->status = status;
    return 0;
}

static int grow(builder *b, void *items, size_t *capacity, size_t used,
                size_t wanted, size_t size)
{
    /* items is the address of a pointer to objects of any one type. */
    void *memory;
    memcpy(&memory, items, sizeof memory);
    if (!vocc_grow(b->allocator, &memory, capacity, used, wanted, size))
        return fail(b, VOCC_ERROR_OUT_OF_MEMORY);
    memcpy(items, &memory, sizeof memory);
    return 1;
}

/* Called with the number of references looked at. */
static int poll(builder *b, size_t work)
{
    b->work += work;
    if (b->work < 16384)
        return 1;
    b->work = 0;
    if (vocc_jobs_poll(b->jobs, b->worker))
        return fail(b, VOCC_ERROR_CANCELLED);
    return 1;
}

static int make_leaf(builder *b, uint32_t index, const pending *node)
{
    const vocc_reference *r = b->stack + (b->stack_count - node->count);
    size_t i;
    if (!grow(b, &b->leaves, &b->leaf_capacity, b->leaf_count,
              b->leaf_count + node->count, sizeof *b->leaves))
        return 0;
    b->nodes[index].at.first = (uint32_t)b->leaf_count;
    b->nodes[index].bits =
        VOCC_LEAF |
        (uint32_t)(node->count ? VOCC_BOUNDARY : VOCC_UNKNOWN) << 2 |
        (uint32_t)node->count << 4;
    for (i = 0; i < node->count; i++)
        b->leaves[b->leaf_count++] = r[i].triangle;
    b->stack_count -= node->count;
    if (node->depth > b->depth)
        b->depth = node->depth;
    return 1;
}

static int make_task(builder *b, uint32_t index, const pending *node)
{
    task *t;
    if (!grow(b, &b->tasks, &b->task_capacity, b->task_count, b->task_count + 1,
              sizeof *b->tasks))
        return 0;
    t = &b->tasks[b->task_count];
    memset(t, 0, sizeof *t);
    t->references =
        vocc_allocate(b->allocator, ROOM(node->count), sizeof *t->references);
    if (!t->references)
        return fail(b, VOCC_ERROR_OUT_OF_MEMORY);
    b->stack_count -= node->count;
    memcpy(t->references, b->stack + b->stack_count,
           node->count * sizeof *t->references);
    t->node = *node;
    t->place = index;
    b->task_count++;
    b->task_pairs += node->pairs;
    return 1;
}

/* Which sides of the plane a reference's bounds are on. */
static int sides_of(const vocc_bounds *r, const vocc_split *split)
{
    const int below = r->lower[split->axis] < split->pos;
    const int above = r->upper[split->axis] > split->pos;
    const int planar = !(below | above);
    return (below | (planar & split->planar_below)) |
           (above | (planar & !split->planar_below)) << 1;
}

/* Replaces the node's references on the stack by those of the child below,
 * then those of the child above. */
static int partition(builder *b, const pending *node, const vocc_split *split,
                     size_t *below, size_t *above)
{
    const size_t begin = b->stack_count - node->count;
    size_t i, low = 0, high = 0;
    vocc_reference *from, *up;
    /* The child below takes the place of what has been read; the child above
     * waits beyond. */
    if (!grow(b, &b->stack, &b->stack_capacity, b->stack_count,
              b->stack_count + node->count, sizeof *b->stack))
        return 0;
    from = b->stack + begin;
    up = b->stack + b->stack_count;
    for (i = 0; i < node->count; i++) {
        int sides = sides_of(&from[i].bounds, split);
        if (sides == 3 && node->count < b->settings->least_clipped) {
            const vocc_reference r = from[i];
            from[low] = up[high] = r;
            from[low].bounds.upper[split->axis] = split->pos;
            up[high].bounds.lower[split->axis] = split->pos;
        } else if (sides == 3) {
            const vocc_reference r = from[i];
            sides = vocc_clip_split(
                b->settings->corners + 9 * (size_t)r.triangle, &r.bounds,
                split->axis, split->pos, b->settings->scale, &from[low].bounds,
                &up[high].bounds);
            from[low].triangle = up[high].triangle = r.triangle;
        } else {
            /* To both: which of two it is cannot be foretold. */
            from[low] = up[high] = from[i];
        }
        low += (size_t)(sides & 1);
        high += (size_t)(sides >> 1);
    }
    memmove(from + low, up, high * sizeof *from);
    b->stack_count = begin + low + high;
    *below = low;
    *above = high;
    return 1;
}

/* Whether to split, by cost: pbrt's rule, which tries a few splits that do not
 * pay by themselves. */
static int worth_it(const settings *s, const pending *node,
                    const vocc_split *split, int *bad)
{
    const double leaf_cost = s->sah.intersection_cost * (double)node->count;
    *bad = node->bad;
    if (split->axis < 0 || node->depth >= s->max_depth)
        return 0;
    if (split->cost <= leaf_cost)
        return 1;
    if (node->count > s->max_leaf_size)
        return 1;
    ++*bad;
    return *bad <= s->bad_refines &&
           (split->cost <= 4.0 * leaf_cost || node->count >= 16);
}

/* Whether so few references are a leaf wherever the best plane is: one step
 * costs more than testing them all. */
static int cannot_pay(const settings *s, size_t count)
{
    return !s->bad_refines && count <= s->max_leaf_size &&
           s->sah.traversal_cost * (1.0 - s->sah.empty_bonus) >=
               s->sah.intersection_cost * (double)count * (1.0 - 0x1p-20);
}

/* The part of a budget for the first of two children. */
static size_t share(size_t budget, const pending child[2])
{
    return (size_t)((double)budget * (double)child[0].count /
                    (double)(child[0].count + child[1].count + 1));
}

/* Nodes split so far, or promised to tasks. */
static size_t pairs_used(const builder *b)
{
    return b->node_count / 2 + b->task_pairs;
}

static int build_node(builder *b, uint32_t index, const pending *node)
{
    vocc_split split;
    pending child[2];
    uint32_t pair;
    size_t added, spare, used;
    int bad;
    if (node->count == 0 || node->pairs == 0)
        return make_leaf(b, index, node);
    if (b->task_size && node->count <= b->task_size)
        return make_task(b, index, node);
    if (!poll(b, node->count))
        return 0;
    if (cannot_pay(b->settings, node->count))
        return make_leaf(b, index, node);
    split = vocc_find_split(b->stack + (b->stack_count - node->count),
                            node->count, &node->box, &b->settings->sah);
    if (!worth_it(b->settings, node, &split, &bad))
        return make_leaf(b, index, node);
    /* On hostile input (all triangles alike) the SAH would copy them into
     * every leaf along a diagonal: the budget ends that.  A split can at most
     * double the references. */
    if (node->budget < node->count) {
        size_t i, both = 0;
        for (i = b->stack_count - node->count; i < b->stack_count; i++)
            both += sides_of(&b->stack[i].bounds, &split) == 3;
        if (both > node->budget)
            return make_leaf(b, index, node);
    }
    child[0] = child[1] = *node;
    if (!partition(b, node, &split, &child[0].count, &child[1].count))
        return 0;
    added = child[0].count + child[1].count > node->count
                ? child[0].count + child[1].count - node->count
                : 0;
    spare = node->budget > added ? node->budget - added : 0;
    child[0].budget = share(spare, child);
    child[1].budget = spare - child[0].budget;
    child[0].pairs = share(node->pairs - 1, child);
    child[1].pairs = node->pairs - 1 - child[0].pairs;
    child[0].depth = child[1].depth = node->depth + 1;
    child[0].bad = child[1].bad = bad;
    child[0].box.upper[split.axis] = split.pos;
    child[1].box.lower[split.axis] = split.pos;

    if (!grow(b, &b->nodes, &b->node_capacity, b->node_count, b->node_count + 2,
              sizeof *b->nodes))
        return 0;
    pair = (uint32_t)(b->node_count / 2);
    b->node_count += 2;
    memset(&b->nodes[2 * pair], 0, 2 * sizeof *b->nodes);
    b->nodes[index].at.split_pos = split.pos;
    b->nodes[index].bits = (uint32_t)split.axis | pair << VOCC_PAIR_SHIFT;
    /* The child above lies on top of the stack; it leaves to the other what it
     * does not need. */
    used = pairs_used(b);
    if (!build_node(b, 2 * pair + 1, &child[1]))
        return 0;
    child[0].pairs += child[1].pairs - (pairs_used(b) - used);
    return build_node(b, 2 * pair, &child[0]);
}

static void free_tasks(const vocc_allocator *allocator, task *tasks,
                       size_t count)
{
    size_t i, j;
    for (i = 0; i < count; i++) {
        task *t = &tasks[i];
        for (j = 0; j < t->task_count; j++)
            vocc_release(allocator, t->tasks[j].references);
        vocc_release(allocator, t->tasks);
        vocc_release(allocator, t->references);
        vocc_release(allocator, t->nodes);
        vocc_release(allocator, t->leaves);
    }
    vocc_release(allocator, tasks);
}

static void builder_free(builder *b)
{
    free_tasks(b->allocator, b->tasks, b->task_count);
    vocc_release(b->allocator, b->nodes);
    vocc_release(b->allocator, b->leaves);
    vocc_release(b->allocator, b->stack);
}

/* Room for the root and the unused node 1, and for what is usual below. */
static int begin_nodes(builder *b, size_t count)
{
    const size_t usual = b->task_size ? 0 : 4 * count;
    if (!grow(b, &b->nodes, &b->node_capacity, 0, 2 + usual,
              sizeof *b->nodes) ||
        !grow(b, &b->leaves, &b->leaf_capacity, 0, usual, sizeof *b->leaves))
        return 0;
    memset(b->nodes, 0, 2 * sizeof *b->nodes);
    b->node_count = 2;
    return 1;
}

static vocc_status run_task(void *context, size_t job, int worker,
                            vocc_jobs *jobs)
{
    const forest *f = context;
    task *t = &f->waves[f->wave].tasks[job];
    builder b;
    memset(&b, 0, sizeof b);
    b.allocator = f->allocator;
    b.settings = f->settings;
    b.jobs = jobs;
    b.worker = worker;
    b.stack = t->references;
    b.stack_count = t->node.count;
    b.stack_capacity = ROOM(t->node.count);
    t->references = NULL;
    if (f->wave + 1 < WAVES && t->node.count > f->least) {
        b.task_size = f->waves[f->wave].task_size;
        while (b.task_size >= t->node.count)
            b.task_size /= 2;
        if (b.task_size < f->least)
            b.task_size = f->least;
    }
    if (begin_nodes(&b, t->node.count) && build_node(&b, 0, &t->node)) {
        t->nodes = b.nodes;
        t->node_count = b.node_count;
        t->leaves = b.leaves;
        t->leaf_count = b.leaf_count;
        t->depth = b.depth;
        t->tasks = b.tasks;
        t->task_count = b.task_count;
        b.nodes = NULL;
        b.leaves = NULL;
        b.tasks = NULL;
        b.task_count = 0;
    }
    builder_free(&b);
    return b.status;
}

/* The tasks that those of a wave have left. */
static vocc_status next_wave(forest *f)
{
    wave *const from = &f->waves[f->wave], *const to = from + 1;
    size_t i, j, count = 0;
    for (i = 0; i < from->count; i++)
        count += from->tasks[i].task_count;
    to->tasks = vocc_allocate(f->allocator, count, sizeof *to->tasks);
    if (!to->tasks)
        return VOCC_ERROR_OUT_OF_MEMORY;
    for (i = 0; i < from->count; i++) {
        task *t = &from->tasks[i];
        for (j = 0; j < t->task_count; j++) {
            to->tasks[to->count] = t->tasks[j];
            to->tasks[to->count++].parent = i;
        }
        vocc_release(f->allocator, t->tasks);
        t->tasks = NULL;
        t->task_count = 0;
    }
    return VOCC_OK;
}

static void forest_free(forest *f)
{
    int w;
    for (w = 0; w < WAVES; w++)
        free_tasks(f->allocator, f->waves[w].tasks, f->waves[w].count);
}

/* Moves a subtree's node to where its arrays begin in the whole. */
static vocc_node moved(vocc_node n, uint32_t pairs, uint32_t leaves)
{
    if (!vocc_is_leaf(n))
        n.bits += pairs << VOCC_PAIR_SHIFT;
    else if (vocc_label_of(n) == VOCC_BOUNDARY)
        n.at.first += leaves;
    return n;
}

/* Copies a task of a wave to where it belongs. */
static vocc_status place_task(void *context, size_t job, int worker,
                              vocc_jobs *jobs)
{
    const forest *f = context;
    const task *t = &f->waves[f->wave].tasks[job];
    const uint32_t first = (uint32_t)t->first;
    vocc_node *const nodes = f->tree->nodes + 2 * (size_t)t->pairs;
    size_t i;
    (void)worker;
    (void)jobs;
    f->tree->nodes[t->root] = moved(t->nodes[0], t->pairs, first);
    for (i = 2; i < t->node_count; i++)
        nodes[i] = moved(t->nodes[i], t->pairs, first);
    if (t->leaf_count)
        memcpy(f->tree->references + first, t->leaves,
               t->leaf_count * sizeof *t->leaves);
    return VOCC_OK;
}

/* Lays the tasks out in one array each. */
static vocc_status join(forest *f, int threads, vocc_ticker *ticker)
{
    vocc_tree *const tree = f->tree;
    vocc_status status = VOCC_OK;
    size_t i;
    int w;
    tree->node_count = 2;
    for (w = 0; w < WAVES; w++)
        for (i = 0; i < f->waves[w].count; i++) {
            task *t = &f->waves[w].tasks[i];
            t->pairs = (uint32_t)(tree->node_count / 2 - 1);
            t->first = tree->reference_count;
            t->root = t->place;
            /* Node 0 of the parent is where that stands itself. */
            if (w) {
                const task *parent = &f->waves[w - 1].tasks[t->parent];
                t->root = t->root ? t->root + 2 * parent->pairs : parent->root;
            }
            tree->node_count += t->node_count - 2;
            tree->reference_count += t->leaf_count;
            if (t->depth > tree->depth)
                tree->depth = t->depth;
        }
    tree->nodes = vocc_allocate_lasting(f->allocator, tree->node_count,
                                        sizeof *tree->nodes);
    tree->references = vocc_allocate_lasting(
        f->allocator, tree->reference_count, sizeof *tree->references);
    if (!tree->nodes || !tree->references)
        return VOCC_ERROR_OUT_OF_MEMORY;
    memset(tree->nodes, 0, 2 * sizeof *tree->nodes);
    /* A task's root takes the place of a node of its parent. */
    for (f->wave = 0; f->wave < WAVES && status == VOCC_OK; f->wave++)
        status = vocc_jobs_run(f->allocator, threads, f->waves[f->wave].count,
                               place_task, f, ticker);
    return status;
}

static vocc_status copy_triangles(void *context, size_t job, int worker,
                                  vocc_jobs *jobs)
{
    const forest *f = context;
    const vocc_tree *tree = f->tree;
    size_t i = job * JOB_TRIANGLES;
    const size_t end = i + JOB_TRIANGLES < tree->triangle_count
                           ? i + JOB_TRIANGLES
                           : tree->triangle_count;
    (void)worker;
    (void)jobs;
    for (; i < end; i++)
        memcpy(tree->corners + 9 * i,
               f->settings->corners + 9 * (size_t)tree->ids[i],
               9 * sizeof *tree->corners);
    return VOCC_OK;
}

/* Stores triangles in the order in which leaves mention them first: what a ray
 * meets together lies together. */
static vocc_status sort_triangles(forest *f, size_t count, int threads,
                                  vocc_ticker *ticker)
{
    const uint32_t none = UINT32_MAX;
    vocc_tree *const tree = f->tree;
    uint32_t *number = vocc_allocate(f->allocator, count, sizeof *number);
    size_t i, next = 0;
    /* One float more: SIMD loads the last corner as four. */
    tree->corners = vocc_allocate_lasting(f->allocator, 9 * count + 1,
                                          sizeof *tree->corners);
    tree->ids = vocc_allocate(f->allocator, count, sizeof *tree->ids);
    if (!number || !tree->corners || !tree->ids) {
        vocc_release(f->allocator, number);
        return VOCC_ERROR_OUT_OF_MEMORY;
    }
    tree->corners[9 * count] = 0.0f;
    for (i = 0; i < count; i++)
        number[i] = none;
    for (i = 0; i < tree->reference_count; i++) {
        const uint32_t t = tree->references[i];
        if (number[t] == none) {
            tree->ids[next] = t;
            number[t] = (uint32_t)next++;
        }
        tree->references[i] = number[t];
    }
    tree->triangle_count = next;
    vocc_release(f->allocator, number);
    return vocc_jobs_run(f->allocator, threads,
                         (next + JOB_TRIANGLES - 1) / JOB_TRIANGLES,
                         copy_triangles, f, ticker);
}

/* One reference a triangle, with the bounds of all; NULL: no memory. */
static vocc_reference *begin_references(const vocc_allocator *allocator,
                                        const float *corners, size_t count,
                                        vocc_bounds *box, float *scale)
{
    vocc_reference *references =
        vocc_allocate(allocator, ROOM(count), sizeof *references);
    size_t i;
    int j, k;
    for (k = 0; k < 3; k++) {
        box->lower[k] = count ? FLT_MAX : 1.0f;
        box->upper[k] = count ? -FLT_MAX : -1.0f;
    }
    *scale = 0.0f;
    if (!references)
        return NULL;
    for (i = 0; i < count; i++) {
        vocc_bounds *r = &references[i].bounds;
        references[i].triangle = (uint32_t)i;
        for (k = 0; k < 3; k++) {
            r->lower[k] = r->upper[k] = corners[9 * i + (size_t)k];
            for (j = 1; j < 3; j++) {
                const float x = corners[9 * i + (size_t)(3 * j + k)];
                r->lower[k] = x < r->lower[k] ? x : r->lower[k];
                r->upper[k] = x > r->upper[k] ? x : r->upper[k];
            }
            if (r->lower[k] < box->lower[k])
                box->lower[k] = r->lower[k];
            if (r->upper[k] > box->upper[k])
                box->upper[k] = r->upper[k];
        }
    }
    for (k = 0; k < 3; k++) {
        /* Outward, away from tiny values: see VOCC_TINY. */
        if (vocc_absf(box->lower[k]) < VOCC_TINY)
            box->lower[k] = box->lower[k] < 0.0f ? -VOCC_TINY : 0.0f;
        if (vocc_absf(box->upper[k]) < VOCC_TINY)
            box->upper[k] = box->upper[k] > 0.0f ? VOCC_TINY : 0.0f;
    }
    for (k = 0; k < 3; k++) {
        const float low = vocc_absf(box->lower[k]),
                    high = vocc_absf(box->upper[k]);
        *scale = low > *scale ? low : *scale;
        *scale = high > *scale ? high : *scale;
    }
    return references;
}

static int default_depth(size_t count)
{
    int depth = 8 + (int)(1.6 * log2((double)count + 1.0));
    return depth > VOCC_MAX_DEPTH ? VOCC_MAX_DEPTH : depth;
}

static vocc_status run_waves(forest *f, size_t count, int threads,
                             vocc_ticker *ticker)
{
    const double from = ticker->last, to = 0.8;
    vocc_status status = VOCC_OK;
    for (f->wave = 0; f->wave < WAVES && status == VOCC_OK; f->wave++) {
        wave *w = &f->waves[f->wave];
        w->task_size = count >> (f->wave + 1);
        /* The last takes most of the time. */
        vocc_ticker_stage(ticker, from + (to - from) * 0.05 * (double)f->wave,
                          f->wave + 1 < WAVES ? from + (to - from) * 0.05 *
                                                           (double)(f->wave + 1)
                                              : to);
        status =
            vocc_jobs_run(f->allocator, threads, w->count, run_task, f, ticker);
        if (status == VOCC_OK && f->wave + 1 < WAVES)
            status = next_wave(f);
    }
    return status;
}

static vocc_status build(forest *f, const float *corners, size_t count,
                         size_t most_pairs, int threads, settings *s,
                         vocc_ticker *ticker)
{
    vocc_tree *const tree = f->tree;
    task *root = vocc_allocate(f->allocator, 1, sizeof *root);
    vocc_status status;
    if (!root)
        return VOCC_ERROR_OUT_OF_MEMORY;
    memset(root, 0, sizeof *root);
    f->waves[0].tasks = root;
    f->waves[0].count = 1;
    root->references = begin_references(f->allocator, corners, count,
                                        &root->node.box, &s->scale);
    if (!root->references)
        return VOCC_ERROR_OUT_OF_MEMORY;
    memcpy(tree->lower, root->node.box.lower, sizeof tree->lower);
    memcpy(tree->upper, root->node.box.upper, sizeof tree->upper);
    tree->scale = s->scale;
    root->node.count = count;
    root->node.budget = MOST_ADDED(count);
    root->node.pairs = most_pairs - 1;
    f->least = count / 32 > 2048 ? count / 32 : 2048;
    status = run_waves(f, count, threads, ticker);
    if (status == VOCC_OK)
        status = join(f, threads, ticker);
    if (status == VOCC_OK)
        status = sort_triangles(f, count, threads, ticker);
    return status;
}

vocc_status vocc_build(const vocc_allocator *allocator, const float *corners,
                       size_t count, const vocc_build_options *options,
                       int coarse, size_t most_pairs, vocc_ticker *ticker,
                       vocc_tree *tree)
{
    settings s;
    forest f;
    vocc_status status;
    memset(tree, 0, sizeof *tree);
    memset(&f, 0, sizeof f);
    s.corners = corners;
    s.sah.traversal_cost = (double)options->traversal_cost;
    s.sah.intersection_cost = (double)options->intersection_cost;
    s.sah.empty_bonus = (double)options->empty_bonus;
    s.max_leaf_size = (size_t)options->max_leaf_size;
    s.least_clipped = coarse ? COARSE_CLIPPED : 0;
    s.max_depth =
        options->max_depth ? options->max_depth : default_depth(count);
    s.bad_refines = options->bad_refines;
    f.allocator = allocator;
    f.settings = &s;
    f.tree = tree;
    status =
        build(&f, corners, count, most_pairs, options->threads, &s, ticker);
    forest_free(&f);
    if (status != VOCC_OK)
        vocc_tree_free(allocator, tree);
    return status;
}
