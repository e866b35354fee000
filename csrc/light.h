/* Area lights: their points, the side they are on, the region they lie in. */
#ifndef VOCC_LIGHT_H
#define VOCC_LIGHT_H

#include "kdtree.h"
#include "platform.h"
#include "sampler.h"
#include "shaft.h"
#include "vocc.h"

/* A rectangle in the scene's float32 coordinates. */
typedef struct vocc_light {
    float corner[3], edge_u[3], edge_v[3];
    double centre[3];
} vocc_light;

/* Moves the light by the scene's origin and rounds it.  Returns 0, and the
 * value given in *bad, if one is not a finite float32 then. */
VOCC_INTERNAL int vocc_light_init(vocc_light *light,
                                  const vocc_rect_light *source,
                                  const double origin[3], double *bad);

/* Point (a, b): fl(fl(corner + fl(a * u)) + fl(b * v)). */
VOCC_INLINE void vocc_light_point(const vocc_light *light, float a, float b,
                                  float point[3])
{
    int k;
    for (k = 0; k < 3; k++)
        point[k] =
            (light->corner[k] + a * light->edge_u[k]) + b * light->edge_v[k];
}

/* What every ray from a point with |coordinates| up to reach[] to the light
 * ends on.  Its region is VOCC_END_UNKNOWN if triangles are too near to the
 * light to name one for all. */
VOCC_INTERNAL void vocc_light_target(const vocc_light *light,
                                     const vocc_tree *tree,
                                     const double reach[3],
                                     vocc_target *target);

#endif
