#include "walk.h"
#include "clip.h"
#include "vec3.h"

#include <math.h>
#include <string.h>

/* (plane - org) / dir has two roundings: within 2^-52 of the exact t,
 * relatively.  Intervals are widened by more than that, so that no leaf is
 * lost (Ize, "Robust BVH Ray Traversal", 2013). */
#define WIDEN 0x1p-50

typedef struct walker {
    const vocc_tree *tree;
    double org[3], dir[3];
    double tmax;
    vocc_candidate_fn visit;
    void *context;
} walker;

static double low_t(double t)
{
    return t - vocc_abs(t) * WIDEN;
}

static double high_t(double t)
{
    return t + vocc_abs(t) * WIDEN;
}

static int visit_leaf(walker *w, vocc_node leaf)
{
    const uint32_t *r = w->tree->references + leaf.at.first;
    uint32_t i;
    if (vocc_label_of(leaf) != VOCC_BOUNDARY)
        return 0;
    for (i = 0; i < vocc_leaf_count(leaf); i++) {
        const int stop = w->visit(w->context, r[i], &w->tmax);
        if (stop)
            return stop;
    }
    return 0;
}

static int walk(walker *w, uint32_t index, double t_near, double t_far)
{
    for (;;) {
        const vocc_node n = w->tree->nodes[index];
        const unsigned axis = vocc_axis(n);
        double split, org, dir, t;
        uint32_t first, second;
        int stop;
        if (t_far > high_t(w->tmax))
            t_far = high_t(w->tmax);
        if (t_near > t_far)
            return 0;
        if (vocc_is_leaf(n))
            return visit_leaf(w, n);
        split = (double)n.at.split_pos;
        org = w->org[axis];
        dir = w->dir[axis];
        first = vocc_children(n);
        if (dir == 0.0) {
            if (org > split) {
                index = first + 1;
                continue;
            }
            if (org == split) {
                stop = walk(w, first + 1, t_near, t_far);
                if (stop)
                    return stop;
            }
            index = first;
            continue;
        }
        second = first + 1;
        if (dir < 0.0) {
            second = first;
            first = second + 1;
        }
        t = (split - org) / dir;
        if (low_t(t) > t_far) {
            index = first;
            continue;
        }
        if (high_t(t) >= t_near) {
            stop =
                walk(w, first, t_near, high_t(t) < t_far ? high_t(t) : t_far);
            if (stop)
                return stop;
        }
        index = second;
        if (low_t(t) > t_near)
            t_near = low_t(t);
    }
}

int vocc_walk(const vocc_tree *tree, const float org[3], const float dir[3],
              double tmin, double tmax, vocc_candidate_fn visit, void *context)
{
    walker w;
    double t_near = tmin, t_far = tmax;
    int k;
    w.tree = tree;
    w.tmax = tmax;
    w.visit = visit;
    w.context = context;
    for (k = 0; k < 3; k++) {
        const double lower = (double)tree->lower[k],
                     upper = (double)tree->upper[k];
        w.org[k] = (double)org[k];
        w.dir[k] = (double)dir[k];
        if (w.dir[k] == 0.0) {
            if (w.org[k] < lower || w.org[k] > upper)
                return 0;
        } else {
            double t0 = (lower - w.org[k]) / w.dir[k],
                   t1 = (upper - w.org[k]) / w.dir[k];
            if (w.dir[k] < 0.0) {
                const double t = t0;
                t0 = t1;
                t1 = t;
            }
            t_near = low_t(t0) > t_near ? low_t(t0) : t_near;
            t_far = high_t(t1) < t_far ? high_t(t1) : t_far;
        }
    }
    return walk(&w, 0, t_near, t_far);
}

int vocc_locate(const vocc_tree *tree, const double point[3],
                const double radius[3], int32_t *region)
{
    uint32_t index = 0;
    int k;
    *region = 0;
    for (k = 0; k < 3; k++)
        if (!(point[k] + radius[k] >= (double)tree->lower[k] &&
              point[k] - radius[k] <= (double)tree->upper[k]))
            /* Also for a NaN; such points are not given. */
            return 1;
    for (;;) {
        const vocc_node n = tree->nodes[index];
        const unsigned axis = vocc_axis(n);
        if (vocc_is_leaf(n)) {
            if (vocc_label_of(n) != VOCC_CLEAR &&
                vocc_label_of(n) != VOCC_OPAQUE)
                return 0;
            *region = vocc_leaf_region(tree, n);
            break;
        }
        if (point[axis] + radius[axis] < (double)n.at.split_pos)
            index = vocc_children(n);
        else if (point[axis] - radius[axis] > (double)n.at.split_pos)
            index = vocc_children(n) + 1;
        else
            return 0;
    }
    /* Leaves at the rim: the point may still be on the tree's bounds. */
    for (k = 0; k < 3; k++)
        if (!(point[k] - radius[k] > (double)tree->lower[k] &&
              point[k] + radius[k] < (double)tree->upper[k]))
            return 0;
    return 1;
}

/* Whether no triangle meets the box; *region is set by the first empty leaf
 * that it overlaps. */
static int is_free(const vocc_tree *tree, uint32_t index,
                   const vocc_bounds *box, int32_t *region)
{
    vocc_node n = tree->nodes[index];
    uint32_t i;
    while (!vocc_is_leaf(n)) {
        const unsigned axis = vocc_axis(n);
        uint32_t child = vocc_children(n);
        if (box->lower[axis] > n.at.split_pos) {
            child++;
        } else if (!(box->upper[axis] < n.at.split_pos)) {
            if (!is_free(tree, child, box, region))
                return 0;
            child++;
        }
        n = tree->nodes[child];
    }
    switch (vocc_label_of(n)) {
    case VOCC_BOUNDARY:
        for (i = 0; i < vocc_leaf_count(n); i++)
            if (vocc_clip_meets(
                    tree->corners +
                        9 * (size_t)tree->references[n.at.first + i],
                    box, tree->scale))
                return 0;
        return 1;
    case VOCC_UNKNOWN:
        return 0;
    default:
        if (*region < 0)
            *region = vocc_leaf_region(tree, n);
        return 1;
    }
}

static float float_below(double x)
{
    const float f = (float)x;
    return (double)f > x ? nextafterf(f, -INFINITY) : f;
}

int vocc_locate_box(const vocc_tree *tree, const double lower[3],
                    const double upper[3], int32_t *region)
{
    vocc_bounds box;
    int k, sticks_out = 0;
    *region = -1;
    for (k = 0; k < 3; k++) {
        if (!(vocc_abs(lower[k]) < (double)FLT_MAX &&
              vocc_abs(upper[k]) < (double)FLT_MAX))
            return 0;
        box.lower[k] = float_below(lower[k]);
        box.upper[k] = -float_below(-upper[k]);
    }
    for (k = 0; k < 3; k++) {
        if (box.upper[k] < tree->lower[k] || box.lower[k] > tree->upper[k]) {
            *region = 0;
            return 1;
        }
        sticks_out |=
            box.upper[k] > tree->upper[k] || box.lower[k] < tree->lower[k];
    }
    if (sticks_out)
        *region = 0;
    return is_free(tree, 0, &box, region) && *region >= 0;
}

int vocc_box_is_free(const vocc_tree *tree, const float lower[3],
                     const float upper[3])
{
    vocc_bounds box;
    int32_t region = 0;
    memcpy(box.lower, lower, sizeof box.lower);
    memcpy(box.upper, upper, sizeof box.upper);
    return is_free(tree, 0, &box, &region);
}
