/* The careful way through the tree: one ray, in double, for any finite float32
 * ray.  It serves seed rays, the regions of points, and rays whose values are
 * outside the range that the float kernels are proven for. */
#ifndef VOCC_WALK_H
#define VOCC_WALK_H

#include "kdtree.h"
#include "platform.h"

/* Told a triangle (of the tree) that the ray may meet; may lower *tmax to end
 * the walk there.  Non-zero stops the walk and is returned. */
typedef int (*vocc_candidate_fn)(void *context, uint32_t triangle,
                                 double *tmax);

/* Visits the triangles of every leaf whose closed box the ray meets with
 * tmin <= t <= tmax, front to back; a triangle may come several times.  dir is
 * not zero.  Returns 0 at the end. */
VOCC_INTERNAL int vocc_walk(const vocc_tree *tree, const float org[3],
                            const float dir[3], double tmin, double tmax,
                            vocc_candidate_fn visit, void *context);

/* The label and region of the empty leaf whose open box surely holds all
 * points within `radius` of `point`; or a point that is surely outside the
 * tree's bounds: region 0.  Returns 0 where that is not certain. */
VOCC_INTERNAL int vocc_locate(const vocc_tree *tree, const double point[3],
                              const double radius[3], int32_t *region);

/* The same for all points of a closed box: certain if no triangle meets it. */
VOCC_INTERNAL int vocc_locate_box(const vocc_tree *tree, const double lower[3],
                                  const double upper[3], int32_t *region);

/* Whether no triangle meets the closed box.  All its points then have one
 * region. */
VOCC_INTERNAL int vocc_box_is_free(const vocc_tree *tree, const float lower[3],
                                   const float upper[3]);

#endif
