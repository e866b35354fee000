/* Where to split a node: the surface area heuristic (MacDonald and Booth 1990)
 * over clipped bounds, as in Wald and Havran, "On building fast kd-Trees for
 * Ray Tracing, and on doing that in O(N log N)", 2006. */
#ifndef VOCC_SPLIT_H
#define VOCC_SPLIT_H

#include "clip.h"
#include "platform.h"

/* A triangle and bounds of its part in the node. */
typedef struct vocc_reference {
    vocc_bounds bounds;
    uint32_t triangle;
    uint32_t unused; /* two vectors are copied, none of which overlap */
} vocc_reference;

typedef struct vocc_sah {
    double traversal_cost, intersection_cost;
    double empty_bonus; /* factor 1 - bonus where a child is empty */
} vocc_sah;

typedef struct vocc_split {
    double cost;
    float pos;
    int axis;         /* -1: no plane parts the box */
    int planar_below; /* where triangles in the plane go */
} vocc_split;

/* The cheapest plane strictly inside the box.  Exact over all bounds of few
 * references; over bins, and the outermost bounds, of many. */
VOCC_INTERNAL vocc_split vocc_find_split(const vocc_reference *references,
                                         size_t count, const vocc_bounds *box,
                                         const vocc_sah *sah);

#endif
