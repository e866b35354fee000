/* Shafts: all segments from some points to one convex target, at once.
 *
 * A segment starts in the box of the points and ends in the box of the target;
 * at parameter t it is in the box (1 - t) * points + t * target, the slice.
 * What no slice meets, no segment meets.  So one walk through the tree finds
 * all triangles that the segments can cross ("deep entry points": Reshetov,
 * Soupikov and Hurley, "Multi-Level Ray Tracing Algorithm", 2005, go on from
 * the node where they find the first), or an occluder that holds a whole slice:
 * it stops them all.
 *
 * A target may be infinitely far: segments then run along each of its
 * directions for as long as triangles are, and more. */
#ifndef VOCC_SHAFT_H
#define VOCC_SHAFT_H

#include "platform.h"
#include "traverse.h"

enum {
    VOCC_SHAFT_POINTS = 64,
    VOCC_SHAFT_TRIANGLES = 64, /* most that a walk may keep */
    VOCC_SHAFT_BOXES = 4,      /* occluders tried before the walk */
    VOCC_TARGET_CORNERS = 8
};

/* What the segments end on: points, or directions of length 1 (about). */
typedef struct vocc_target {
    int is_direction;
    int corners; /* of a convex hull: 4 or 8 */
    float corner[VOCC_TARGET_CORNERS][3];
    double slack; /* how far an end is from the hull on an axis, at most */
    double lower[3], upper[3]; /* bounds of all ends */
    int32_t region;            /* of all ends, or VOCC_END_UNKNOWN */
} vocc_target;

/* Coordinates about the ends: origin + sum of s[j] * axis[j]. */
typedef struct vocc_end_frame {
    double origin[3], axis[3][3];
} vocc_end_frame;

typedef struct vocc_shaft {
    size_t count;
    int corners;
    int is_direction; /* corners are steps from the points */
    /* Points, and corners of the target: padded by copies of the last. */
    float point[3][VOCC_SHAFT_POINTS + VOCC_MAX_LANES];
    float corner[3][VOCC_TARGET_CORNERS + VOCC_MAX_LANES];
    /* The slices: at t = 0, and what is added until t = 1. */
    double lower[3], upper[3], lower_step[3], upper_step[3];
    double lower_inverse[3], upper_inverse[3]; /* 1 / step */
    double size[3]; /* largest |coordinate| of a slice */
    /* What n . x - d may be off for a plane, but for 2^-21 |d|. */
    float point_error, corner_error;
    int32_t region; /* of all ends */
} vocc_shaft;

typedef enum vocc_shaft_result {
    VOCC_SHAFT_LIT,  /* no segment meets a triangle */
    VOCC_SHAFT_DARK, /* all do */
    VOCC_SHAFT_FEW,  /* only those that are listed may be met */
    VOCC_SHAFT_MANY  /* not decided */
} vocc_shaft_result;

/* What a walk found. */
typedef struct vocc_shaft_walk {
    int most;       /* triangles that may be kept, up to VOCC_SHAFT_TRIANGLES */
    int64_t budget; /* nodes and triangles that may be looked at */
    int count;
    uint32_t triangles[VOCC_SHAFT_TRIANGLES];
    /* Where rays of this shaft may start: all that they can meet is below. */
    uint32_t entry;
    float entry_lower[3], entry_upper[3];
    /* Occluders that stopped a shaft last, for the next ones. */
    int box_count;
    vocc_opaque boxes[VOCC_SHAFT_BOXES];
} vocc_shaft_walk;

/* Sets up the shaft from `count` points (1 to VOCC_SHAFT_POINTS), numbers
 * which[] of point[].  Returns 0 if the values are outside the range that the
 * bounds are proven for. */
VOCC_INTERNAL int vocc_shaft_init(vocc_shaft *shaft, const vocc_tree *tree,
                                  const float (*point)[3],
                                  const uint16_t *which, size_t count,
                                  const vocc_target *target);

/* The walk has found nothing yet: rays start at the root. */
VOCC_INTERNAL void vocc_shaft_walk_at_root(vocc_shaft_walk *walk,
                                           const vocc_tree *tree);

/* Whether some slice lies strictly inside the box. */
VOCC_INTERNAL int vocc_shaft_within(const vocc_shaft *shaft,
                                    const float lower[3], const float upper[3]);

#endif
