/* Which child of each interior node any-hit rays visit first. */
#ifndef VOCC_CHILD_ORDER_H
#define VOCC_CHILD_ORDER_H

#include "kdtree.h"
#include "platform.h"

/* Sets the bits of each vocc_first in the nodes without tags. */
VOCC_INTERNAL void vocc_order_children(vocc_tree *tree);

#endif
