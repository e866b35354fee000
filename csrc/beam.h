/* Beams: all segments from some points to a part of a light, decided together.
 *
 * A segment is in the slice (1 - t) * points + t * ends at parameter t, a box;
 * so what no slice meets, no segment meets.  A beam carries the list of boxes
 * (nodes and clusters of the hierarchy) that its slices meet; a part of it, of
 * fewer points or a smaller part of the light, looks at that list only.  An
 * empty list: all are lit.  What stays undecided until few segments are left is
 * tested segment by segment, 16 of them against a box or a triangle, or one
 * against 16.
 * (Reshetov, Soupikov and Hurley 2005 search entry points so; Ghazanfarpour and
 * Hasenfratz, "A Beam Tracing Method with Precise Antialiasing for Polyhedral
 * Scenes", 1998, split beams.)
 *
 * Edge functions (triangle.h) from a segment's Pluecker coordinates: with
 * origin o and corners A, B, C relative to the beam's centre, and E = B - A,
 *     dir . ((A - o) x (B - o)) = dir . (A x E) + E . (o x dir).
 * A x E is the same for all segments of the beam.  Edges in place of second
 * corners make the rounding error grow with the size of the triangle, not with
 * its distance.
 *
 * Exits only: a segment that starts and ends outside of a solid leaves it if it
 * enters it, so of solids only the triangles that a segment leaves through
 * matter (docs/method.md, "Beams").  A lit receiver's own surroundings are none
 * of those. */
#ifndef VOCC_BEAM_H
#define VOCC_BEAM_H

#include "bvh.h"
#include "kdtree.h"
#include "platform.h"
#include "shaft.h"
#include "traverse.h"
#include "view.h"
#include "worth.h"

enum {
    VOCC_BEAM_POINTS = 256,
    VOCC_BEAM_RAYS = 512, /* tested together */
    VOCC_BEAM_BLOCKS = VOCC_BEAM_RAYS / VOCC_WIDE,
    VOCC_FAN_POINTS = 64,
    VOCC_FAN_BLOCKS = 16, /* of 16 samples */
    VOCC_BEAM_LIST = 512, /* boxes; what has no room stays in its parent */
    VOCC_BEAM_BOXES = 64,
    VOCC_BEAM_BOX_NODES = 64, /* of the hierarchy of occluders, to look at */
    VOCC_DOME = 64,           /* nodes and clusters */
    VOCC_DOME_POINTS = 16,
    VOCC_BEAM_STACK = VOCC_WIDE * VOCC_BVH_DEPTH
};

/* Boxes that a beam meets, with their nodes and clusters. */
typedef struct vocc_beam_list {
    int count;
    int closed; /* nodes, of which all below may be met: the rest of a list that
                   is too long */
    float near; /* where the slices meet them, on average */
    VOCC_ALIGN(VOCC_LINE) float lower[3][VOCC_BEAM_LIST + VOCC_WIDE];
    float upper[3][VOCC_BEAM_LIST + VOCC_WIDE];
    uint32_t child[VOCC_BEAM_LIST + VOCC_WIDE];
} vocc_beam_list;

/* Occluders that a beam meets. */
typedef struct vocc_beam_boxes {
    int count;
    int cut; /* there are more, none larger than these */
    VOCC_ALIGN(VOCC_LINE) float lower[3][VOCC_BEAM_BOXES + VOCC_WIDE];
    float upper[3][VOCC_BEAM_BOXES + VOCC_WIDE];
} vocc_beam_boxes;

/* Rays that go on alone, in turns: so that what one of them is to look at next
 * is on its way to the cache meanwhile.  80 KB, too much for a C stack. */
typedef struct vocc_walks {
    int depth[VOCC_WIDE];
    uint32_t stack[VOCC_WIDE][VOCC_DOME + VOCC_BEAM_STACK];
} vocc_walks;

typedef struct vocc_beam {
    const vocc_tree *tree;
    const vocc_bvh *bvh;
    int exits;  /* solids' triangles: only those that segments leave through */
    float size; /* largest |coordinate| of the scene, points and light */
    float margin; /* by which slices are widened */

    /* The points. */
    size_t count;
    VOCC_ALIGN(VOCC_LINE) float point[3][VOCC_BEAM_POINTS];
    float lower[3], upper[3];
    float centre[3];
    float axis[3][3]; /* half axes of a box around the points */
    float reach;      /* no coordinate of a point less `centre` is larger */

    /* What they aim at: a box of points, or of directions. */
    int is_direction;
    float end[3];         /* its centre, less `centre` if it is a point */
    float end_axis[3][3]; /* half axes */
    float far_lower[3], far_upper[3]; /* bounds of the ends at t = 1; of
                                         directions, less the point */
    /* The same as a middle, the first two half axes and bounds of the rest. */
    float far_middle[3], far_axis[2][3], far_rest[3];
    float end_slack, end_reach;
    float end_width; /* of the ends, at t = 1 */
    float twist[3];  /* bounds of |o x x|: o a point, x from `end` to an end */

    /* Slices: at t = 0, and 1 / (what is added until t = 1). */
    float slice_lower[3], slice_upper[3], step_lower[3], step_upper[3];
    float way[3], way_half[3]; /* bounds of all directions */

    uint32_t stack[VOCC_BEAM_STACK];
    vocc_walks walks;
    vocc_worth worth;

    /* What was done. */
    uint64_t nodes, clusters, ray_tests, exact_tests;
} vocc_beam;

/* Sixteen beams, as a vocc_beam's slices; bits of those whose steps are
 * positive. */
typedef struct vocc_slices {
    VOCC_ALIGN(VOCC_LINE) float lower[3][VOCC_WIDE], upper[3][VOCC_WIDE];
    float step_lower[3][VOCC_WIDE], step_upper[3][VOCC_WIDE];
    unsigned rising_lower[3], rising_upper[3];
} vocc_slices;

/* Segments that are tested together. */
typedef struct vocc_beam_rays {
    int count;
    float tmax;                    /* of all */
    uint8_t owner[VOCC_BEAM_RAYS]; /* point of the beam */
    float norm;                    /* no |dir|, 1-norm, is larger */
    VOCC_ALIGN(VOCC_LINE) float org[3][VOCC_BEAM_RAYS + VOCC_WIDE];
    float dir[3][VOCC_BEAM_RAYS + VOCC_WIDE];
    float from[3][VOCC_BEAM_RAYS + VOCC_WIDE];    /* org - centre */
    float inverse[3][VOCC_BEAM_RAYS + VOCC_WIDE]; /* 1 / dir */
    float offset[3][VOCC_BEAM_RAYS + VOCC_WIDE];  /* - org / dir */
    float moment[3][VOCC_BEAM_RAYS + VOCC_WIDE];  /* from x dir */
    /* Bits: not known to be blocked. */
    uint16_t open[VOCC_BEAM_BLOCKS];
    int touching; /* set if an origin may lie on a triangle that was tested */
} vocc_beam_rays;

/* Segments from each of the beam's points to samples in blocks of up to 16,
 * each in a part of the light of its own. */
typedef struct vocc_beam_fans {
    int blocks;
    float tmax, norm; /* of all: as vocc_beam_rays */
    /* Blocks along the first two axes of the ends, -1 to 1. */
    VOCC_ALIGN(VOCC_LINE) float middle[2][VOCC_WIDE], half[2][VOCC_WIDE];
    float far_lower[3][VOCC_WIDE], far_upper[3][VOCC_WIDE]; /* their ends */
    const float *dir[3];
    float *inverse[3];                   /* room for 1 / dir */
    vocc_slices slices[VOCC_FAN_POINTS]; /* of blocks, if they are many */
    uint32_t first[VOCC_FAN_POINTS][VOCC_FAN_BLOCKS]; /* in dir */
    /* Bits: not known to be blocked. */
    uint16_t open[VOCC_FAN_POINTS][VOCC_FAN_BLOCKS];
    uint16_t open_blocks[VOCC_FAN_POINTS];
    uint64_t open_points;
    uint64_t touching; /* points that may lie on a triangle that was tested */
} vocc_beam_fans;

/* Some samples of a pattern (sampler.h) in an order of their own. */
typedef struct vocc_strata {
    int is_jitter;
    uint32_t count;
    uint32_t x[VOCC_BEAM_RAYS], y[VOCC_BEAM_RAYS]; /* SOBOL; the rest: JITTER */
    uint32_t sample[VOCC_BEAM_RAYS];
    float column[VOCC_BEAM_RAYS], row[VOCC_BEAM_RAYS];
    float width, height; /* of a stratum */
} vocc_strata;

/* Sixteen nodes or clusters that rays of a dome may meet. */
typedef struct vocc_dome_part {
    VOCC_ALIGN(VOCC_LINE) float lower[3][VOCC_WIDE], upper[3][VOCC_WIDE];
    uint32_t child[VOCC_WIDE];
} vocc_dome_part;

/* The hemispheres above points between `lower` and `upper`.  What their rays
 * meet is within `length` of its point; the square of its distance from the
 * points' bounds is at most `reach`; and normal . x is at least `least`, less
 * `spread` times the distance from the point. */
typedef struct vocc_dome {
    float lower[3], upper[3], normal[3], least, spread, length, reach;
    int most_nodes; /* to open */
    int occluders;  /* rays are tested against them */
    int count;      /* of what rays may meet */
    vocc_dome_part part[VOCC_DOME / VOCC_WIDE];
} vocc_dome;

typedef struct vocc_beam_kernels {
    /* Whether the beam meets any triangle of the hierarchy. */
    int (*meets_any)(vocc_beam *beam);
    /* Of the boxes of `from` (NULL: all the hierarchy) those that the beam
     * meets, opened where they are few. */
    void (*narrow)(vocc_beam *beam, const vocc_beam_list *from,
                   vocc_beam_list *to);
    /* For 64 points at most: bits of those from which one triangle of the
     * list's clusters hides all ends. */
    uint64_t (*hide)(vocc_beam *beam, const vocc_beam_list *list);
    /* For 64 points at most and a list of clusters only: bits of the points
     * from which any of their triangles may be met.  Clusters that no point may
     * meet are taken off. */
    uint64_t (*sieve)(vocc_beam *beam, vocc_beam_list *list);
    /* Bounds of the points: `lower` and `upper`, and from the first point along
     * three axes. */
    void (*measure)(vocc_beam *beam, float (*axis)[3], float low[3],
                    float high[3]);
    /* Places in the unit square of the samples of strata, as vocc_sample (key:
     * vocc_jitter_key or vocc_sample_seed), and directions to them. */
    void (*samples)(const vocc_strata *strata, uint32_t key,
                    const vocc_view *view, float *a, float *b, float *dir[3]);
    /* Sets from, inverse, moment, norm. */
    void (*prepare)(const vocc_beam *beam, vocc_beam_rays *rays);
    /* Whether one of the occluders (NULL, or if they are cut: of all those of
     * another region than `region`, that of all ends, as far as nodes are
     * looked at) holds a whole slice: all is dark; it is then the only one in
     * `to`.  Else `to` gets those that the beam meets. */
    int (*hold)(const vocc_beam *beam, const vocc_beam_boxes *from,
                int32_t region, vocc_beam_boxes *to);
    /* Clears the bits of segments that pass through one of the boxes. */
    void (*block_by_boxes)(const vocc_beam *beam, const vocc_beam_boxes *boxes,
                           vocc_beam_rays *rays);
    /* For a list of clusters only: clears the bits of segments that cross one
     * of their triangles. */
    void (*block)(vocc_beam *beam, const vocc_beam_list *list,
                  vocc_beam_rays *rays);
    void (*block_fans)(vocc_beam *beam, const vocc_beam_list *list,
                       const vocc_beam_boxes *boxes, vocc_beam_fans *fans);
    /* Single rays, tested against occluders or not: sets block->occluded but of
     * those that the bounds do not hold for; these go to odd[], their number is
     * returned. */
    size_t (*trace_rays)(vocc_beam *beam, vocc_block *block, int occluders,
                         uint16_t *odd);
    /* Finds what the rays of the dome may meet. */
    void (*raise_dome)(vocc_beam *beam, vocc_dome *dome);
    /* Rays of the dome: sets block->occluded. */
    void (*trace_dome)(vocc_beam *beam, const vocc_dome *dome,
                       vocc_block *block);
} vocc_beam_kernels;

/* The limits that the bounds are proven for: 0 if the tree, the points within
 * reach[] or the target are beyond.  Sets beam->size, margin, is_direction. */
VOCC_INTERNAL int vocc_beam_limits(vocc_beam *beam, const double reach[3],
                                   const vocc_target *target);

/* Sets up the points: beam->point, count; normal[which[i]] is that of point i.
 */
VOCC_INTERNAL void vocc_beam_set_points(vocc_beam *beam,
                                        const vocc_beam_kernels *kernels,
                                        const double (*normal)[3],
                                        const uint16_t *which);

/* The frame whose unit cube is the target's hull. */
VOCC_INTERNAL void vocc_beam_hull_frame(const vocc_target *target,
                                        vocc_end_frame *frame);

/* Sets up what they aim at: ends of the target that are, but for its slack,
 * between low and high in the frame, whose first two axes are those along which
 * fans are cut into blocks.  After vocc_beam_set_points. */
VOCC_INTERNAL void vocc_beam_set_end(vocc_beam *beam, const vocc_target *target,
                                     const vocc_end_frame *frame,
                                     const double low[3], const double high[3]);

/* Sets up the dome of some points, for rays of a length up to `distance` whose
 * directions are of unit length and on the side of the point's normal, as
 * rounded to float32.  After vocc_beam_limit_domes has said that the bounds
 * hold. */
VOCC_INTERNAL void vocc_beam_set_dome(const vocc_beam *beam, vocc_dome *dome,
                                      const float (*point)[3],
                                      const double (*normal)[3],
                                      const uint16_t *which, size_t count,
                                      float distance);
VOCC_INTERNAL int vocc_beam_limit_domes(vocc_beam *beam, const double reach[3]);

/* For an isa that is there (vocc_isa_choose). */
VOCC_INTERNAL const vocc_beam_kernels *vocc_find_beam_kernels(int32_t isa);

extern VOCC_INTERNAL const vocc_beam_kernels vocc_beam_kernels_plain;
#if VOCC_HAVE_SSE2
extern VOCC_INTERNAL const vocc_beam_kernels vocc_beam_kernels_sse2;
#endif
#if VOCC_HAVE_AVX2
extern VOCC_INTERNAL const vocc_beam_kernels vocc_beam_kernels_avx2;
#endif
#if VOCC_HAVE_AVX512
extern VOCC_INTERNAL const vocc_beam_kernels vocc_beam_kernels_avx512;
#endif
#if VOCC_HAVE_NEON
extern VOCC_INTERNAL const vocc_beam_kernels vocc_beam_kernels_neon;
#endif

#endif
