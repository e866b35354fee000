/* Labels the empty leaves of a tree: CLEAR, OPAQUE, and their regions. */
#ifndef VOCC_CLASSIFY_H
#define VOCC_CLASSIFY_H

#include "kdtree.h"
#include "platform.h"
#include "regions.h"
#include "threads.h"

typedef struct vocc_classification {
    uint64_t boundary_leaves, opaque_leaves, clear_leaves, unknown_leaves;
    uint64_t groups; /* of connected empty leaves */
    uint64_t seed_rays;
    double opaque_volume, opaque_area;
} vocc_classification;

/* Sets labels, tags and tree->opaque, and adds the regions met.  solid_count 0
 * makes every empty leaf CLEAR.  The result
 * does not depend on `threads`.  On failure the tree is to be freed. */
VOCC_INTERNAL vocc_status vocc_classify(
    const vocc_allocator *allocator, vocc_tree *tree, const vocc_solids *solids,
    size_t solid_count, int threads, vocc_regions *regions, vocc_ticker *ticker,
    vocc_classification *out);

#endif
