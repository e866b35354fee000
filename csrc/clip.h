/* Bounds of the parts of a triangle in two boxes: perfect splits.
 * Source: Havran, "Heuristic Ray Shooting Algorithms", 2000, 4.4.4 ("split
 * clipping"); Wald and Havran 2006. */
#ifndef VOCC_CLIP_H
#define VOCC_CLIP_H

#include "platform.h"

typedef struct vocc_bounds {
    float lower[3], upper[3];
} vocc_bounds;

/* Cuts the part of the triangle (9 floats) in the closed box `inside` at the
 * plane x[axis] = split, and gives bounds of what lies on each side: no point
 * of it is lost.  `inside` bounds that part already and the results are within
 * it.  scale: the largest |coordinate| of all triangles.
 * Returns 1 | 2: bit 0 if anything is below, bit 1 if anything is above. */
VOCC_INTERNAL int vocc_clip_split(const float corners[9],
                                  const vocc_bounds *inside, int axis,
                                  float split, float scale, vocc_bounds *below,
                                  vocc_bounds *above);

/* Whether the triangle may meet the closed box; never a false no. */
VOCC_INTERNAL int vocc_clip_meets(const float corners[9],
                                  const vocc_bounds *box, float scale);

#endif
