/* An order of rays in which neighbours in space follow each other: so that
 * packets stay together and what they meet is in the cache.  (Moon, Byun, Kim,
 * Claudio, Kim, Ban, Nam and Yoon, "Cache-Oblivious Ray Reordering", 2010.) */
#ifndef VOCC_RAY_ORDER_H
#define VOCC_RAY_ORDER_H

#include "platform.h"
#include "traverse.h"

enum {
    VOCC_ORDER_RAYS = 1 << 15, /* sorted together */
    VOCC_ORDER_CELLS = 64,     /* an axis, of origins and of ends */
    VOCC_ORDER_DIGIT = 1 << 12
};

typedef struct vocc_ray_order {
    float size; /* largest |coordinate| of the scene */
    /* Of origins and ends, as far as they are known: the others are put into
     * the outermost cells. */
    float lower[6], upper[6], per_unit[2];
    size_t count;
    uint64_t keys[2][VOCC_ORDER_RAYS]; /* above the rays' numbers */
    uint32_t first[3][VOCC_ORDER_DIGIT];
    uint16_t number[VOCC_ORDER_RAYS]; /* of the rays, in order */
} vocc_ray_order;

/* Begins anew. */
VOCC_INTERNAL void vocc_ray_order_begin(vocc_ray_order *order, float size);
/* Tells the bounds of rays like those to be sorted. */
VOCC_INTERNAL void vocc_ray_order_look(vocc_ray_order *order,
                                       const vocc_block *block);
/* Adds rays, VOCC_ORDER_RAYS at most; their numbers count from 0. */
VOCC_INTERNAL void vocc_ray_order_add(vocc_ray_order *order,
                                      const vocc_block *block);
/* Sets order->number. */
VOCC_INTERNAL void vocc_ray_order_sort(vocc_ray_order *order);

#endif
