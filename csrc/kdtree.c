#include "kdtree.h"
#include "memory.h"

#include <string.h>

void vocc_tree_free(const vocc_allocator *allocator, vocc_tree *tree)
{
    vocc_release(allocator, tree->nodes);
    vocc_release(allocator, tree->references);
    vocc_release(allocator, tree->corners);
    vocc_release(allocator, tree->planes);
    vocc_release(allocator, tree->ids);
    vocc_release(allocator, tree->opaque);
    vocc_release(allocator, tree->grown);
    memset(tree, 0, sizeof *tree);
}

static int walk(const vocc_tree *tree, uint32_t index, float lower[3],
                float upper[3], vocc_leaf_fn visit, void *context)
{
    const vocc_node n = tree->nodes[index];
    const unsigned axis = vocc_axis(n);
    float saved;
    int stop;
    if (vocc_is_leaf(n))
        return visit(context, index, lower, upper);
    saved = upper[axis];
    upper[axis] = n.at.split_pos;
    stop = walk(tree, vocc_children(n), lower, upper, visit, context);
    upper[axis] = saved;
    if (stop)
        return stop;
    saved = lower[axis];
    lower[axis] = n.at.split_pos;
    stop = walk(tree, vocc_children(n) + 1, lower, upper, visit, context);
    lower[axis] = saved;
    return stop;
}

int vocc_tree_leaves(const vocc_tree *tree, vocc_leaf_fn visit, void *context)
{
    float lower[3], upper[3];
    memcpy(lower, tree->lower, sizeof lower);
    memcpy(upper, tree->upper, sizeof upper);
    return walk(tree, 0, lower, upper, visit, context);
}
