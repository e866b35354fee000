/* From triangles to a kd-tree. */
#ifndef VOCC_BUILD_H
#define VOCC_BUILD_H

#include "kdtree.h"
#include "platform.h"
#include "threads.h"
#include "vocc.h"

/* Builds the tree of `count` triangles (9 finite floats each).  Empty leaves
 * are labelled UNKNOWN and have no tags yet.  The tree does not depend on
 * options->threads (at least 1 here).  It has at most most_pairs pairs of nodes
 * (1 to VOCC_MAX_PAIRS), with that of the root: a node that may not be split
 * any more is a leaf, of whatever size.  A coarse tree is built faster, with
 * looser bounds of what is in small nodes.  On failure *tree holds nothing. */
VOCC_INTERNAL vocc_status vocc_build(const vocc_allocator *allocator,
                                     const float *corners, size_t count,
                                     const vocc_build_options *options,
                                     int coarse, size_t most_pairs,
                                     vocc_ticker *ticker, vocc_tree *tree);

#endif
