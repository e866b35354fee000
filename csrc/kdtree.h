/* The kd-tree: the contract between build, classify and traverse.
 *
 * Every point of every triangle lies in the closed box of a leaf that lists
 * the triangle.  So an empty leaf's open box holds no surface; its faces may
 * touch some.
 *
 * A node is 8 bytes.  The two children of an interior node are a pair that
 * starts at an even index, in one cache line.  The root is node 0; node 1 is
 * not used.  `bits` of an interior node:
 *     1..0   split_axis, 0 to 2
 *     2      1: a child is an empty leaf.  Then
 *     4..3       tag of the child below the plane
 *     6..5       tag of the child above;
 *            0: both children have to be visited.  Then
 *     5..3       for each vocc_first, 1 if the child above comes first
 *     31..7  index of the pair: the children are nodes 2 * pair, 2 * pair + 1
 * and of a leaf:
 *     1..0   3
 *     3..2   label
 *     31..4  number of references
 * A tag is the child's label if it is an empty leaf; 0 (VOCC_BOUNDARY) if it
 * has to be visited.  A walk sees from the parent that a child is empty or a
 * volumetric occluder (slides, "Volumetric occluder intersection").  Where both
 * children are visited no tag is needed, so the orders that do not depend on
 * the ray have a bit there. */
#ifndef VOCC_KDTREE_H
#define VOCC_KDTREE_H

#include "platform.h"
#include "vocc.h"

#define VOCC_LEAF 3u
#define VOCC_TAGGED 4u
#define VOCC_TAG_SHIFT 3
#define VOCC_PAIR_SHIFT 7
#define VOCC_MAX_PAIRS ((size_t)1 << (32 - VOCC_PAIR_SHIFT))
#define VOCC_MAX_DEPTH 60

/* No plane lies at 0 < |split_pos| < VOCC_TINY, nor do the tree's bounds: so a
 * plane less a ray's origin, where that is 0 or not tiny either, is 0 or not
 * below 2^-94, and t is never subnormal in float32. */
#define VOCC_TINY 0x1p-70f

/* Orders that say once for all rays which child is visited first:
 * child_order.c. */
typedef enum vocc_first {
    VOCC_FIRST_OPAQUE,
    VOCC_FIRST_SATO,
    VOCC_FIRST_RTSAH,
    VOCC_FIRST_COUNT
} vocc_first;

typedef struct vocc_node {
    union {
        float split_pos; /* interior */
        uint32_t first;  /* BOUNDARY: of its references; OPAQUE: number of its
                            bounds in vocc_tree.opaque */
    } at;
    uint32_t bits;
} vocc_node;

/* ISO C99 has no static assertion. */
typedef char vocc_a_node_is_8_bytes[sizeof(vocc_node) == 8 ? 1 : -1];

typedef struct vocc_opaque {
    float lower[3], upper[3];
    int32_t region;
    int32_t grown; /* a box of vocc_tree.grown that is worth more; -1: none */
} vocc_opaque;

typedef struct vocc_tree {
    vocc_node *nodes;
    size_t node_count;    /* with the unused node 1 */
    uint32_t *references; /* triangles of the leaves */
    size_t reference_count;
    float *corners; /* 9 a triangle, in the order of first reference, and 1 */
    float *planes;  /* 4 a triangle: planes.h */
    uint32_t *ids;  /* triangle of the scene, for each of the tree's */
    size_t triangle_count;
    vocc_opaque *opaque; /* leaf -> bounds table of the volumetric occluders */
    size_t opaque_count;
    vocc_opaque *grown; /* boxes beyond one leaf, for the occluder cache */
    size_t grown_count;
    float lower[3], upper[3]; /* of all triangles; lower > upper if none */
    float scale;              /* largest |coordinate| of a triangle */
    int depth;
} vocc_tree;

VOCC_INLINE int vocc_is_leaf(vocc_node n)
{
    return (n.bits & 3u) == VOCC_LEAF;
}

VOCC_INLINE unsigned vocc_axis(vocc_node n)
{
    return n.bits & 3u;
}

VOCC_INLINE uint32_t vocc_children(vocc_node n)
{
    return (n.bits >> VOCC_PAIR_SHIFT) * 2u;
}

/* Both tags, that of the child below in the lower two bits; 0: none. */
VOCC_INLINE unsigned vocc_tags(vocc_node n)
{
    return n.bits & VOCC_TAGGED ? n.bits >> VOCC_TAG_SHIFT & 15u : 0;
}

/* For a node without tags: 1 if the child above comes first. */
VOCC_INLINE unsigned vocc_above_first(vocc_node n, vocc_first order)
{
    return n.bits >> (VOCC_TAG_SHIFT + (unsigned)order) & 1u;
}

VOCC_INLINE unsigned vocc_label_of(vocc_node leaf)
{
    return (leaf.bits >> 2) & 3u;
}

VOCC_INLINE uint32_t vocc_leaf_count(vocc_node leaf)
{
    return leaf.bits >> 4;
}

/* Region of an empty leaf that is CLEAR or OPAQUE. */
VOCC_INLINE int32_t vocc_leaf_region(const vocc_tree *tree, vocc_node leaf)
{
    return vocc_label_of(leaf) == VOCC_OPAQUE
               ? tree->opaque[leaf.at.first].region
               : 0;
}

/* A float32 point strictly inside a leaf; 0 if there is none. */
VOCC_INLINE int vocc_leaf_centre(const float lower[3], const float upper[3],
                                 float centre[3])
{
    int k;
    for (k = 0; k < 3; k++) {
        centre[k] = (float)(0.5 * ((double)lower[k] + (double)upper[k]));
        if (!(centre[k] > lower[k] && centre[k] < upper[k]))
            return 0;
    }
    return 1;
}

VOCC_INTERNAL void vocc_tree_free(const vocc_allocator *allocator,
                                  vocc_tree *tree);

/* Calls visit for each leaf, in the tree's order, with its bounds.  A non-zero
 * answer stops the walk and is returned. */
typedef int (*vocc_leaf_fn)(void *context, uint32_t node, const float lower[3],
                            const float upper[3]);
VOCC_INTERNAL int vocc_tree_leaves(const vocc_tree *tree, vocc_leaf_fn visit,
                                   void *context);

#endif
