/* Exact signs of the determinants that decide whether a ray crosses a
 * triangle, for any finite float32 input.
 *
 * Arithmetic on expansions (sums of doubles that do not overlap): Shewchuk,
 * "Adaptive Precision Floating-Point Arithmetic and Fast Robust Geometric
 * Predicates", 1997.  Differences of float32 numbers are exact in two doubles;
 * products of four of them and a fifth factor stay within 2^-1074 .. 2^1023,
 * so nothing underflows or overflows. */
#ifndef VOCC_EXACT_H
#define VOCC_EXACT_H

#include "platform.h"

/* Sign (-1, 0, 1) of dir . ((p - org) x (q - org)). */
VOCC_INTERNAL int vocc_exact_edge(const float org[3], const float dir[3],
                                  const float p[3], const float q[3]);

/* Sign of num - t * det, where num = A . (B x C), det = dir . (B x C + C x A +
 * A x B) and A, B, C are the corners less org: the crossing of the plane lies
 * at num / det.  t is finite. */
VOCC_INTERNAL int vocc_exact_interval(const float org[3], const float dir[3],
                                      const float corners[9], double t);

/* num, det and the edge functions of corners 1 and 2 (dir . (C x A), dir .
 * (A x B)), each within 2^-50 of the exact value, relatively. */
VOCC_INTERNAL void vocc_exact_values(const float org[3], const float dir[3],
                                     const float corners[9], double *num,
                                     double *det, double *edge1, double *edge2);

#endif
