/* The planes of the triangles, for tests that need no more. */
#ifndef VOCC_PLANES_H
#define VOCC_PLANES_H

#include "kdtree.h"
#include "platform.h"
#include "threads.h"

/* Makes tree->planes: n and d of n . x = d for each triangle of the tree, the
 * largest component of n being 1 or -1.  Each component of n is within 2^-24 of
 * its own size and 2^-40, d within 2^-24 of its own size and 2^-37 of the
 * tree's scale.  All four are 0 where double is not enough for that.  A
 * triangle with two equal corners, which nothing can cross, has n = 0 and d =
 * 1: everything is on one side.  Fails: OUT_OF_MEMORY, CANCELLED. */
VOCC_INTERNAL vocc_status vocc_make_planes(const vocc_allocator *allocator,
                                           vocc_tree *tree, int threads,
                                           vocc_ticker *ticker);

#endif
