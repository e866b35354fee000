/* From triangles to a kd-tree. */
#ifndef VOCC_BUILD_H
#define VOCC_BUILD_H

#include "kdtree.h"
#include "platform.h"
#include "threads.h"
#include "vocc.h"

/* Builds the tree of `count` triangles (9 finite floats each).  Empty leaves
 * are labelled UNKNOWN and have no tags yet.  The tree does not depend on
 * options->threads (at least 1 here).  On failure *tree holds nothing. */
VOCC_INTERNAL vocc_status vocc_build(const vocc_allocator *allocator,
                                     const float *corners, size_t count,
                                     const vocc_build_options *options,
                                     vocc_ticker *ticker, vocc_tree *tree);

#endif
