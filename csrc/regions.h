/* Regions: which solids a point off the surface lies in.
 *
 * A *solid* is a closed component that may hold occluders.  The region of a
 * point is its winding number about each solid that is wound consistently, its
 * parity about each that is not; most are 0, so only the others are stored.
 * Equal sets have one number; 0 is the empty set, the outside. */
#ifndef VOCC_REGIONS_H
#define VOCC_REGIONS_H

#include "kdtree.h"
#include "platform.h"
#include "vocc.h"

typedef struct vocc_winding {
    int32_t solid; /* growing within a set */
    int32_t number;
} vocc_winding;

/* The sets, by number. */
typedef struct vocc_regions {
    vocc_winding *windings;
    size_t winding_count, winding_capacity;
    size_t *start; /* of each set; count + 1 entries */
    size_t count, start_capacity;
    int32_t *table; /* hash table of sets; -1: free */
    size_t table_size;
} vocc_regions;

/* The outside only.  Returns 0 if there is no memory. */
VOCC_INTERNAL int vocc_regions_init(const vocc_allocator *allocator,
                                    vocc_regions *regions);
VOCC_INTERNAL void vocc_regions_free(const vocc_allocator *allocator,
                                     vocc_regions *regions);

/* The set's number, or -1 if it has none. */
VOCC_INTERNAL int32_t vocc_regions_find(const vocc_regions *regions,
                                        const vocc_winding *set, size_t count);

/* The set's number, new if need be; -1 if there is no memory. */
VOCC_INTERNAL int32_t vocc_regions_add(const vocc_allocator *allocator,
                                       vocc_regions *regions,
                                       const vocc_winding *set, size_t count);

/* The solid's surface: for each triangle of the tree its solid or -1, and for
 * each solid whether winding numbers (1) or parity (0) count. */
typedef struct vocc_solids {
    const int32_t *of_triangle;
    const uint8_t *consistent;
} vocc_solids;

/* Room that one seed ray after the other uses. */
typedef struct vocc_seed {
    uint64_t *hits;
    size_t hit_count, hit_capacity;
    vocc_winding *set; /* the answer */
    size_t set_count, set_capacity;
    uint64_t rays; /* shot so far */
} vocc_seed;

VOCC_INTERNAL void vocc_seed_free(const vocc_allocator *allocator,
                                  vocc_seed *seed);

typedef enum vocc_seed_result {
    VOCC_SEED_OK,
    VOCC_SEED_ON_SURFACE, /* of a solid */
    VOCC_SEED_NO_MEMORY,
    VOCC_SEED_NO_DIRECTION /* every ray tried grazed an edge */
} vocc_seed_result;

/* Counts the signed crossings of exact rays from `point`, which is finite;
 * `stream` chooses the directions, so that a second call can check the first.
 * A ray that meets an edge or a corner is shot again elsewhere. */
VOCC_INTERNAL vocc_seed_result vocc_seed_shoot(const vocc_allocator *allocator,
                                               const vocc_tree *tree,
                                               const vocc_solids *solids,
                                               const float point[3],
                                               uint32_t stream,
                                               vocc_seed *seed);

#endif
