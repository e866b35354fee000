/* Rays through the tree.
 *
 * Callers hand over blocks of rays; a kernel takes VOCC_LANES of them at a time
 * as a packet.  The kernels are one body (traverse_body.inc) compiled for each
 * kind of lanes; they differ in speed only. */
#ifndef VOCC_TRAVERSE_H
#define VOCC_TRAVERSE_H

#include "kdtree.h"
#include "platform.h"
#include "vocc.h"

enum {
    VOCC_BLOCK = 256,    /* rays a block */
    VOCC_MAX_LANES = 16, /* the blocks' arrays are padded for so many */
    VOCC_MAX_DEFERMENT = 512,
    VOCC_MAX_CACHE = 64
};

/* Where a ray ends, if that is known: a region's number, or: */
enum {
    VOCC_END_UNKNOWN = -1,    /* to be located when an occluder would decide */
    VOCC_END_UNCERTIFIED = -2 /* not to be had: triangles decide */
};

/* Rays and results.  Occlusion sets `occluded`.  Closest hits set `t` (infinite
 * for a miss), `u`, `v`, and `triangle`, a triangle of the scene. */
typedef struct vocc_block {
    size_t count;
    float org[3][VOCC_BLOCK + VOCC_MAX_LANES];
    float dir[3][VOCC_BLOCK + VOCC_MAX_LANES];
    float tmin[VOCC_BLOCK + VOCC_MAX_LANES];
    float tmax[VOCC_BLOCK + VOCC_MAX_LANES];
    int32_t end_region[VOCC_BLOCK + VOCC_MAX_LANES];
    uint8_t occluded[VOCC_BLOCK + VOCC_MAX_LANES];
    float t[VOCC_BLOCK + VOCC_MAX_LANES];
    float u[VOCC_BLOCK + VOCC_MAX_LANES];
    float v[VOCC_BLOCK + VOCC_MAX_LANES];
    uint32_t triangle[VOCC_BLOCK + VOCC_MAX_LANES]; /* of the scene */
    uint32_t slot[VOCC_BLOCK + VOCC_MAX_LANES];     /* of the tree */
} vocc_block;

/* The occluder cache (slides, "Reusing volumetric occluders").
 * RECENT: the occluders that blocked a ray last, most recent first.
 * DIRECTION: the last one for each cell of a cube map of directions, as
 * Radiance keeps the last object for each source (SHADCACHE). */
typedef struct vocc_occluder_cache {
    int size;        /* entries, or cells along an edge; 0: no cache */
    uint32_t *cells; /* 6 * size * size numbers of boxes, and 1; 0: none;
                        with GROWN: of tree->grown.  NULL: by recency */
    int count;
    vocc_opaque entries[VOCC_MAX_CACHE];
} vocc_occluder_cache;

#define VOCC_CELL_GROWN 0x80000000u

/* What one worker needs to trace. */
typedef struct vocc_tracer {
    const vocc_tree *tree;
    int32_t order; /* not AUTO */
    int occluders;
    int deferment;
    int counting;
    vocc_occluder_cache cache;
    int fusion;
    int triangle_cache;
    uint32_t last_triangle; /* that blocked; UINT32_MAX: none */
    /* Where rays start: all that they can meet is below this node. */
    uint32_t entry;
    float entry_lower[3], entry_upper[3];
    vocc_counters counters;
    void *queue; /* VOCC_QUEUE_ENTRIES of the kernel's own entries */
    struct {
        uint32_t first, count;
    } deferred[VOCC_MAX_DEFERMENT];
} vocc_tracer;

enum { VOCC_QUEUE_ENTRIES = 1024 };

typedef void (*vocc_trace_fn)(vocc_tracer *tracer, vocc_block *block);

/* shaft.h */
struct vocc_shaft;
struct vocc_shaft_walk;
typedef int (*vocc_shaft_fn)(vocc_tracer *tracer,
                             const struct vocc_shaft *shaft,
                             struct vocc_shaft_walk *walk);

typedef struct vocc_kernels {
    vocc_trace_fn occluded;
    vocc_trace_fn closest;
    vocc_shaft_fn walk_shaft; /* a vocc_shaft_result */
    /* Rays of a shaft that can cross these triangles only. */
    void (*occluded_among)(vocc_tracer *tracer, vocc_block *block,
                           const uint32_t *triangles, int count);
    size_t queue_entry_bytes;
} vocc_kernels;

/* The kernels for options->packets and options->isa, which is not AUTO; NULL if
 * this build does not have them. */
VOCC_INTERNAL const vocc_kernels *
vocc_find_kernels(const vocc_query_options *options);

extern VOCC_INTERNAL const vocc_kernels vocc_kernels_single;
extern VOCC_INTERNAL const vocc_kernels vocc_kernels_plain4;
#if VOCC_HAVE_SSE2
extern VOCC_INTERNAL const vocc_kernels vocc_kernels_sse2;
#endif
#if VOCC_HAVE_NEON
extern VOCC_INTERNAL const vocc_kernels vocc_kernels_neon;
#endif

/* A tracer for checked options.  Returns NULL if there is no memory. */
VOCC_INTERNAL vocc_tracer *vocc_tracer_create(const vocc_allocator *allocator,
                                              const vocc_tree *tree,
                                              const vocc_query_options *options,
                                              const vocc_kernels *kernels);
VOCC_INTERNAL void vocc_tracer_free(const vocc_allocator *allocator,
                                    vocc_tracer *tracer);

/* Empties the caches and starts at the root: so that counters do not depend on
 * which worker took which job. */
VOCC_INTERNAL void vocc_tracer_forget(vocc_tracer *tracer);

/* Rays start at this node, or at the root. */
VOCC_INTERNAL void vocc_tracer_enter(vocc_tracer *tracer, uint32_t node,
                                     const float lower[3],
                                     const float upper[3]);
VOCC_INTERNAL void vocc_tracer_at_root(vocc_tracer *tracer);

/* ---- for the kernels ----------------------------------------------------- */

/* One ray, in double: any finite float32 values. */
VOCC_INTERNAL void vocc_trace_careful(vocc_tracer *tracer, vocc_block *block,
                                      size_t ray, int closest);

/* Whether a ray meets nothing by definition (see vocc_rays). */
VOCC_INTERNAL int vocc_is_void(const vocc_block *block, size_t ray);

/* The region that ray's end lies in, or VOCC_END_UNCERTIFIED. */
VOCC_INTERNAL int32_t vocc_certify_end(const vocc_tree *tree,
                                       const vocc_block *block, size_t ray);

/* Puts an occluder in front, or in the cell of a ray's direction. */
VOCC_INTERNAL void vocc_cache_insert(vocc_tracer *tracer,
                                     const vocc_opaque *leaf,
                                     const vocc_block *block, size_t ray);
/* Moves entry i to the front. */
VOCC_INTERNAL void vocc_cache_touch(vocc_occluder_cache *cache, int i);
/* The box in the cell of a ray's direction; NULL if there is none. */
VOCC_INTERNAL const vocc_opaque *
vocc_cache_cell(const vocc_tracer *tracer, const vocc_block *block, size_t ray);

#endif
