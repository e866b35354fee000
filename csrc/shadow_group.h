/* A tile's points and a light by beams: what finding lit groups, deciding the
 * others and keeping their segments share. */
#ifndef VOCC_SHADOW_GROUP_H
#define VOCC_SHADOW_GROUP_H

#include "beam.h"
#include "platform.h"
#include "query.h"
#include "shadow.h"

enum {
    VOCC_BEAM_LIGHTS = 8,     /* at a time */
    VOCC_GROUP = 64,          /* points */
    VOCC_STORE = 16384,       /* segments of a group */
    VOCC_CHUNK = 256,         /* samples of a point at a time */
    VOCC_CELLS = 64,          /* of a light */
    VOCC_LEVELS = 7,          /* of quartering points and cells, and the
                                 group itself */
    VOCC_STEPS_LIKE_A_RAY = 8 /* nodes and clusters that take as long */
};

typedef struct vocc_range {
    uint16_t first, count;
} vocc_range;

/* One light at a tile. */
typedef struct vocc_lit_tile {
    vocc_target target;
    uint16_t which[VOCC_TILE_POINTS]; /* points that face it, in tile order */
    size_t count;
    uint8_t is_part[VOCC_TILE_POINTS]; /* by the tile's number */
    vocc_tally tallies[VOCC_TILE_POINTS];
    vocc_range pending[VOCC_TILE_POINTS / VOCC_GROUP];
    int pending_count;
    vocc_range
        uncertain[VOCC_TILE_POINTS / VOCC_GROUP]; /* not known to be outside */
    int uncertain_count;
    vocc_beam_boxes recent; /* occluders that made groups dark last */
    vocc_worth hiding;      /* looking for triangles that hide the light */
} vocc_lit_tile;

/* The segments of a group, point by point, and by the cell of the light that
 * they end in: cells along a Morton curve. */
typedef struct vocc_segments {
    int cells;
    vocc_end_frame frame; /* of the ends, and what each cell covers in it: */
    const double (*low)[3], (*high)[3];
    float tmax;
    uint32_t start[VOCC_GROUP][VOCC_CELLS + 1];
    VOCC_ALIGN(VOCC_LINE)
    float dir[3][VOCC_STORE + VOCC_WIDE], inverse[3][VOCC_STORE + VOCC_WIDE];
    uint16_t
        sample[VOCC_STORE]; /* place in the pattern, less that of the first */
    uint8_t blocked[VOCC_STORE];
} vocc_segments;

/* Cells of a light, parts of the unit square; if they are the same samples at
 * all points (is_fixed), these in the order of cells.  What a cell covers is
 * known beforehand of rectangles only: of hull and unit square alike. */
typedef struct vocc_cell_order {
    int grid, cells, is_fixed;
    uint32_t first, count; /* samples */
    uint16_t place[VOCC_CHUNK], start[VOCC_CELLS + 1];
    uint8_t cell[VOCC_CHUNK]; /* of each sample */
    double low[VOCC_CELLS][3], high[VOCC_CELLS][3];
    vocc_strata strata; /* in the order of `place` */
} vocc_cell_order;

struct vocc_beam_room {
    vocc_beam beam;
    vocc_beam_list lists[VOCC_LEVELS + 1];
    vocc_beam_rays rays;
    vocc_beam_fans fans;
    vocc_segments store;
    vocc_cell_order order;
    double low[VOCC_CELLS][3],
        high[VOCC_CELLS][3]; /* of what is no rectangle */
    vocc_lit_tile lights[VOCC_BEAM_LIGHTS];
    uint8_t outside[VOCC_TILE_POINTS];      /* points surely in region 0 */
    vocc_beam_boxes boxes[VOCC_LEVELS + 1]; /* occluders that beams meet */
    vocc_worker checker;                    /* traces again for `verify` */
    vocc_beam_mismatch mismatch;
    vocc_dome dome;
};

typedef struct vocc_beaming {
    vocc_lighting *g;
    vocc_beam_room *room;
    vocc_lit_tile *light;
    const vocc_beam_kernels *kernels;
    vocc_counters *counters;
} vocc_beaming;

/* All lit, or all dark: counts, weights and bits of the points. */
VOCC_INTERNAL vocc_status vocc_group_settle(const vocc_beaming *w, vocc_range r,
                                            int dark, uint64_t *settled);

/* The segments of a group from sample `first` on, to be decided; and what has
 * become of them. */
VOCC_INTERNAL void vocc_group_fill(const vocc_beaming *w, vocc_range r,
                                   uint32_t first, uint32_t count);
VOCC_INTERNAL void vocc_group_read(const vocc_beaming *w, vocc_range r,
                                   uint32_t first);

/* What the cells of the store cover in its frame, from the very segments of
 * points which[]: so that this holds their ends whatever the light and its
 * samples are, rounded as they are.  Cells without segments hold nothing. */
VOCC_INTERNAL void vocc_segments_measure(vocc_segments *store,
                                         const float (*point)[3],
                                         const uint16_t *which, int count,
                                         int is_direction, double (*low)[3],
                                         double (*high)[3]);

/* The part of the light that some cells cover, in the frame of the store. */
VOCC_INTERNAL void vocc_cells_end(const vocc_segments *store, int cell,
                                  int cells, double low[3], double high[3]);

/* Ambient occlusion: all points of the tile that face. */
VOCC_INTERNAL vocc_status vocc_shadow_domes(const vocc_beaming *w);

/* First round: settles the points that no triangle stands before; the others
 * go to light->pending. */
VOCC_INTERNAL vocc_status vocc_group_find_lit(const vocc_beaming *w,
                                              vocc_range r);

/* Second round: decides the points that are known to be outside; the others go
 * to light->uncertain, or are decided too if it is the last round. */
VOCC_INTERNAL vocc_status vocc_group_decide(const vocc_beaming *w, vocc_range r,
                                            int last);

#endif
