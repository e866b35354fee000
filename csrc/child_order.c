#include "child_order.h"
#include "vec3.h"

#include <math.h>
#include <string.h>

/* What a random line through a node's box meets: "Ray termination SAH" (Ize and
 * Hansen, "RTSAH Traversal Order for Occlusion Rays", 2011).  With children a
 * and b of cost C and chance to block B, each met with the probability p of its
 * surface area, and both with q = p_a + p_b - 1:
 *     a first:  C = 1 + p_a C_a + (p_b - q B_a) C_b
 * so a comes first where B_a / C_a > B_b / C_b.
 * RTSAH counts triangles; the opaque-first order also counts opaque leaves,
 * which cost nothing: they are met from the parent.
 * SATO: the child with the larger surface (Nah and Manocha, "SATO: Surface Area
 * Traversal Order for Shadow Ray Tracing", 2014). */

typedef struct chance {
    double cost, block;
} chance;

/* Of a node: with opaque leaves, and without. */
typedef struct estimate {
    double area;
    chance opaque, triangles;
} estimate;

static double area_of(const float lower[3], const float upper[3])
{
    const double x = (double)upper[0] - (double)lower[0],
                 y = (double)upper[1] - (double)lower[1],
                 z = (double)upper[2] - (double)lower[2];
    return 2.0 * (x * y + y * z + z * x);
}

/* About the area of the triangle within the box: of its projection along the
 * axis that it faces most, the part whose bounds overlap the box. */
static double area_within(const float *c, const float lower[3],
                          const float upper[3])
{
    double e1[3], e2[3], n[3], area;
    int k, axis = 0;
    for (k = 0; k < 3; k++) {
        e1[k] = (double)c[3 + k] - (double)c[k];
        e2[k] = (double)c[6 + k] - (double)c[k];
    }
    vocc_cross(e1, e2, n);
    area = 0.5 * sqrt(vocc_dot(n, n));
    for (k = 1; k < 3; k++)
        if (vocc_abs(n[k]) > vocc_abs(n[axis]))
            axis = k;
    for (k = 0; k < 3; k++) {
        float low = c[k], high = c[k], from, to;
        if (k == axis)
            continue;
        low = c[3 + k] < low ? c[3 + k] : low;
        low = c[6 + k] < low ? c[6 + k] : low;
        high = c[3 + k] > high ? c[3 + k] : high;
        high = c[6 + k] > high ? c[6 + k] : high;
        from = low > lower[k] ? low : lower[k];
        to = high < upper[k] ? high : upper[k];
        if (!(high > low) || !(to > from))
            return 0.0;
        area *= ((double)to - (double)from) / ((double)high - (double)low);
    }
    return area;
}

static estimate estimate_leaf(const vocc_tree *tree, double triangle_cost,
                              vocc_node leaf, const float lower[3],
                              const float upper[3])
{
    estimate e;
    const uint32_t *r = tree->references + leaf.at.first;
    uint32_t i;
    double area = 0.0;
    memset(&e, 0, sizeof e);
    e.area = area_of(lower, upper);
    if (vocc_label_of(leaf) == VOCC_OPAQUE)
        e.opaque.block = 1.0;
    if (vocc_label_of(leaf) != VOCC_BOUNDARY)
        return e;
    for (i = 0; i < vocc_leaf_count(leaf); i++)
        area += area_within(tree->corners + 9 * (size_t)r[i], lower, upper);
    /* A line through a convex body of surface S crosses a patch of area A in it
     * 2 A / S times on average; at least once less often. */
    e.triangles.cost = triangle_cost * (double)vocc_leaf_count(leaf);
    if (area > 0.0)
        e.triangles.block = 2.0 * area / (2.0 * area + e.area);
    e.opaque = e.triangles;
    return e;
}

/* 1 if b comes first. */
static unsigned combine(const chance *a, const chance *b, double pa, double pb,
                        chance *out)
{
    const double q = pa + pb > 1.0 ? pa + pb - 1.0 : 0.0;
    const unsigned b_first = b->block * a->cost > a->block * b->cost;
    const chance *first = b_first ? b : a, *second = b_first ? a : b;
    const double p1 = b_first ? pb : pa, p2 = b_first ? pa : pb;
    out->cost = 1.0 + p1 * first->cost + (p2 - q * first->block) * second->cost;
    out->block = p1 * first->block + p2 * second->block -
                 q * first->block * second->block;
    return b_first;
}

/* Subtrees at this depth are jobs. */
enum { SUBTREE_DEPTH = 6, MOST_SUBTREES = 1 << SUBTREE_DEPTH };

typedef struct subtree {
    uint32_t node;
    float lower[3], upper[3];
    estimate result;
} subtree;

typedef struct ordering {
    vocc_tree *tree;
    double triangle_cost; /* to a step of 1 */
    size_t count;
    subtree list[MOST_SUBTREES];
    enum { LIST, USE, NONE } subtrees; /* what to do where they begin */
    size_t next;
} ordering;

static estimate visit(ordering *o, uint32_t index, int depth, float lower[3],
                      float upper[3])
{
    vocc_node *n = &o->tree->nodes[index];
    const unsigned axis = vocc_axis(*n);
    estimate e, below, above;
    unsigned first[VOCC_FIRST_COUNT];
    double pa = 1.0, pb = 1.0;
    float saved;
    int k;
    memset(&e, 0, sizeof e);
    if (vocc_is_leaf(*n))
        return estimate_leaf(o->tree, o->triangle_cost, *n, lower, upper);
    if (depth == SUBTREE_DEPTH && o->subtrees == USE)
        return o->list[o->next++].result;
    if (depth == SUBTREE_DEPTH && o->subtrees == LIST) {
        subtree *t = &o->list[o->count++];
        t->node = index;
        memcpy(t->lower, lower, sizeof t->lower);
        memcpy(t->upper, upper, sizeof t->upper);
        return e;
    }
    e.area = area_of(lower, upper);
    saved = upper[axis];
    upper[axis] = n->at.split_pos;
    below = visit(o, vocc_children(*n), depth + 1, lower, upper);
    upper[axis] = saved;
    saved = lower[axis];
    lower[axis] = n->at.split_pos;
    above = visit(o, vocc_children(*n) + 1, depth + 1, lower, upper);
    lower[axis] = saved;
    if (o->subtrees == LIST)
        return e;
    if (e.area > 0.0) {
        pa = below.area / e.area;
        pb = above.area / e.area;
    }
    first[VOCC_FIRST_OPAQUE] =
        combine(&below.opaque, &above.opaque, pa, pb, &e.opaque);
    first[VOCC_FIRST_SATO] = above.area > below.area;
    first[VOCC_FIRST_RTSAH] =
        combine(&below.triangles, &above.triangles, pa, pb, &e.triangles);
    for (k = 0; k < VOCC_FIRST_COUNT && !(n->bits & VOCC_TAGGED); k++)
        n->bits |= first[k] << (VOCC_TAG_SHIFT + k);
    return e;
}

static void visit_top(ordering *o)
{
    float lower[3], upper[3];
    memcpy(lower, o->tree->lower, sizeof lower);
    memcpy(upper, o->tree->upper, sizeof upper);
    o->next = 0;
    (void)visit(o, 0, 0, lower, upper);
}

static vocc_status visit_subtree(void *context, size_t job, int worker,
                                 vocc_jobs *jobs)
{
    ordering *all = context;
    subtree *t = &all->list[job];
    ordering o;
    (void)worker;
    (void)jobs;
    o.tree = all->tree;
    o.triangle_cost = all->triangle_cost;
    o.subtrees = NONE;
    t->result = visit(&o, t->node, 0, t->lower, t->upper);
    return VOCC_OK;
}

vocc_status vocc_order_children(const vocc_allocator *allocator,
                                vocc_tree *tree, double triangle_cost,
                                int threads, vocc_ticker *ticker)
{
    ordering o;
    vocc_status status;
    if (!tree->triangle_count)
        return VOCC_OK;
    o.tree = tree;
    o.triangle_cost = triangle_cost;
    o.count = 0;
    o.subtrees = LIST;
    visit_top(&o);
    status =
        vocc_jobs_run(allocator, threads, o.count, visit_subtree, &o, ticker);
    if (status == VOCC_OK) {
        o.subtrees = USE;
        visit_top(&o);
    }
    return status;
}
