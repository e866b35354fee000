/* The points of one job of a shadow query, read once for all lights. */
#ifndef VOCC_TILE_H
#define VOCC_TILE_H

#include "light.h"
#include "platform.h"
#include "threads.h"
#include "vocc.h"

/* Points a job.  Within it the order is light, point, sample: rays that follow
 * each other are alike, and one cache serves one light. */
enum { VOCC_TILE_POINTS = 256 };

/* The caller's points, and where each lies in the order of the jobs. */
typedef struct vocc_points {
    size_t count;
    vocc_array position, normal, id;
    double origin[3];   /* of the scene */
    int neighbours;     /* 1: sort the points of a tile along a Morton curve */
    uint64_t *by_voxel; /* voxel and number of each point; NULL: as given */
    int number_bits;    /* of by_voxel that are the number */
} vocc_points;

typedef struct vocc_tile {
    size_t count;    /* points that can be used */
    size_t unused;   /* points with a value that is not finite */
    double reach[3]; /* largest |coordinate| of a usable point */
    int is_patch;    /* usable points have finite normals: */
    vocc_patch patch;
    int is_row; /* `number` are the caller's points from `first` on, all */
    size_t first;
    /* Usable points, then the others. */
    size_t number[VOCC_TILE_POINTS]; /* of the caller's point */
    float point[VOCC_TILE_POINTS][3];
    double normal[VOCC_TILE_POINTS][3];
    uint32_t id[VOCC_TILE_POINTS];
    uint64_t voxel[VOCC_TILE_POINTS]; /* with by_voxel */
} vocc_tile;

/* Loads the points of a job. */
VOCC_INTERNAL void vocc_tile_load(vocc_tile *tile, const vocc_points *points,
                                  size_t job);

/* Sorts all points by the voxel that they are in, `voxels` along the longest
 * side of their bounds (1 to 1024): sets by_voxel, which is to be released.
 * Fails: OUT_OF_MEMORY, CANCELLED, LIMIT (2^34 points or more). */
VOCC_INTERNAL vocc_status vocc_points_by_voxel(const vocc_allocator *allocator,
                                               vocc_points *points, int voxels,
                                               vocc_ticker *ticker);

#endif
