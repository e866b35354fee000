/* Volumetric occluders in a hierarchy for beams, the largest on top: a node has
 * up to eight occluders, larger than all below it, and up to eight nodes. */
#ifndef VOCC_BOX_TREE_H
#define VOCC_BOX_TREE_H

#include "kdtree.h"
#include "memory.h"
#include "platform.h"

enum { VOCC_BOX_LANES = 16, VOCC_BOX_OWN = 8 };

typedef struct vocc_box_node {
    /* Occluders, then bounds of all occluders below a node. */
    float lower[3][VOCC_BOX_LANES], upper[3][VOCC_BOX_LANES];
    int32_t region[VOCC_BOX_LANES];      /* of occluders */
    uint32_t child;                      /* the first; the others follow it */
    uint16_t boxes, nodes;               /* bits of lanes */
    uint32_t unused[VOCC_BOX_LANES - 2]; /* rows are cache lines */
} vocc_box_node;

typedef struct vocc_box_tree {
    vocc_box_node *nodes; /* the root is node 0; each comes before those below
                             it, and before those of the next level */
    size_t node_count;
} vocc_box_tree;

/* Of the tree's grown occluders; those within another are left out, as far as
 * they meet it on their way down.  No nodes if there are none.  Fails:
 * OUT_OF_MEMORY. */
VOCC_INTERNAL vocc_status vocc_build_boxes(const vocc_allocator *allocator,
                                           const vocc_tree *tree,
                                           vocc_box_tree *boxes);
VOCC_INTERNAL void vocc_free_boxes(const vocc_allocator *allocator,
                                   vocc_box_tree *boxes);

#endif
