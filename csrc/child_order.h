/* Which child of each interior node any-hit rays visit first. */
#ifndef VOCC_CHILD_ORDER_H
#define VOCC_CHILD_ORDER_H

#include "kdtree.h"
#include "platform.h"
#include "threads.h"

/* Sets the bits of each vocc_first in the nodes without tags; they do not
 * depend on `threads`.  triangle_cost: of a test, to a step of 1. */
VOCC_INTERNAL vocc_status vocc_order_children(const vocc_allocator *allocator,
                                              vocc_tree *tree,
                                              double triangle_cost, int threads,
                                              vocc_ticker *ticker);

#endif
