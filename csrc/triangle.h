/* Does a ray cross a triangle?  The exact answer, for one ray.
 *
 * A triangle is nine floats: corners a, b, c.  With A = a - org, ... :
 *   edge functions   U = dir . (B x C), V = dir . (C x A), W = dir . (A x B)
 *   det = U + V + W = dir . ((b - a) x (c - a)),  num = A . (B x C)
 * The ray crosses it iff U, V, W are all >= 0 or all <= 0, det is not 0, and
 * tmin < num / det < tmax.  Shared edges have the same |U| from both sides, so
 * there are no cracks; a ray in the triangle's plane has det = 0. */
#ifndef VOCC_TRIANGLE_H
#define VOCC_TRIANGLE_H

#include "platform.h"

typedef struct vocc_crossing {
    double t;     /* num / det: rounds to the float32 that the exact one does */
    double u, v;  /* weights of corners b and c, in [0, 1] */
    int det_sign; /* 1: the ray leaves through the back (along the normal) */
    int on_edge;  /* an edge function is 0: through an edge or a corner */
} vocc_crossing;

/* Exact: doubles with a forward error bound first, then expansions.  All of
 * org, dir and corners are finite; tmin < tmax may be infinite.  Returns 1 for
 * a crossing and fills *crossing, if that is not NULL. */
VOCC_INTERNAL int vocc_triangle_test(const float org[3], const float dir[3],
                                     float tmin, float tmax,
                                     const float corners[9],
                                     vocc_crossing *crossing);

#endif
