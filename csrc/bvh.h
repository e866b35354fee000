/* The bounding volume hierarchy that beams go through: 16 children a node, 16
 * triangles a cluster, so that one operation on 16 lanes tests all of them
 * (Wald, Benthin and Boulos, "Getting Rid of Packets", 2008).
 *
 * The kd-tree answers which region a point is in; this one only which
 * triangles a beam may meet. */
#ifndef VOCC_BVH_H
#define VOCC_BVH_H

#include "box_tree.h"
#include "kdtree.h"
#include "platform.h"
#include "regions.h"
#include "threads.h"

/* The height of a hierarchy is less than VOCC_BVH_DEPTH. */
enum { VOCC_WIDE = 16, VOCC_BVH_DEPTH = 80 };

#define VOCC_IS_CLUSTER 0x80000000u

typedef struct vocc_wide_node {
    float lower[3][VOCC_WIDE], upper[3][VOCC_WIDE];
    /* Bounds of the unit normals, along (b - a) x (c - a); -2 to 2 if a
     * triangle has to be taken from both sides or has no certain normal. */
    float normal_lower[3][VOCC_WIDE], normal_upper[3][VOCC_WIDE];
    uint32_t child[VOCC_WIDE]; /* a node, or VOCC_IS_CLUSTER and a cluster */
    uint32_t count;
    uint32_t clusters;              /* bits of children */
    uint32_t unused[VOCC_WIDE - 2]; /* rows are cache lines */
} vocc_wide_node;

typedef struct vocc_cluster {
    float corner[9][VOCC_WIDE];   /* a, b, c; unused lanes repeat the first */
    uint32_t triangle[VOCC_WIDE]; /* of the tree */
    uint32_t count;
    uint32_t both_sides; /* bits: no solid's, or of one wound inconsistently */
    /* All lie between two planes: normal . x is slab[0] to slab[1].  All are 0
     * if there is no mean normal. */
    float normal[3], slab[2];
    float longest; /* of the edges: largest difference of a coordinate */
    uint32_t unused[VOCC_WIDE - 8];
} vocc_cluster;

typedef struct vocc_bvh {
    vocc_wide_node *nodes; /* the root is node 0 */
    size_t node_count;
    vocc_cluster *clusters;
    size_t cluster_count;
    vocc_box_tree boxes; /* the tree's grown occluders: vocc_build_boxes */
} vocc_bvh;

/* Over all triangles of the tree but those with two equal corners, which
 * nothing can cross.  No nodes if there are none.  The boxes are left empty, as
 * the tree may not have grown its occluders yet.  The same whatever the number
 * of threads.  Fails: OUT_OF_MEMORY, CANCELLED. */
VOCC_INTERNAL vocc_status vocc_bvh_build(const vocc_allocator *allocator,
                                         const vocc_tree *tree,
                                         const vocc_solids *solids, int threads,
                                         vocc_ticker *ticker, vocc_bvh *bvh);
VOCC_INTERNAL void vocc_bvh_free(const vocc_allocator *allocator,
                                 vocc_bvh *bvh);

#endif
