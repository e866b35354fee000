/* Larger occluders: boxes beyond one leaf. */
#ifndef VOCC_OCCLUDERS_H
#define VOCC_OCCLUDERS_H

#include "kdtree.h"
#include "platform.h"
#include "threads.h"

/* Grows the bounds of opaque leaves, the largest first, face by face, for as
 * long as no triangle meets them (occluder fusion: Schaufler et al.,
 * "Conservative Volumetric Visibility with Occluder Fusion", 2000).  The open
 * box is in the leaf's region as the leaf is, so what is cached blocks more.  A
 * leaf whose middle is in a box that has been grown has that one.  The result
 * does not depend on `threads`. */
VOCC_INTERNAL vocc_status vocc_grow_occluders(const vocc_allocator *allocator,
                                              vocc_tree *tree, int threads,
                                              vocc_ticker *ticker);

#endif
