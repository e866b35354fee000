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
    uint32_t triangle[VOCC_BLOCK + VOCC_MAX_LANES];
} vocc_block;

/* The occluder cache: the occluders that blocked a ray last, most recent
 * first (slides, "Reusing volumetric occluders"). */
typedef struct vocc_occluder_cache {
    int size; /* 0: no cache */
    int count;
    vocc_opaque entries[VOCC_MAX_CACHE];
} vocc_occluder_cache;

/* What one worker needs to trace. */
typedef struct vocc_tracer {
    const vocc_tree *tree;
    int32_t order; /* not AUTO */
    int occluders;
    int deferment;
    int counting;
    vocc_occluder_cache cache;
    vocc_counters counters;
    void *queue; /* VOCC_QUEUE_ENTRIES of the kernel's own entries */
    struct {
        uint32_t first, count;
    } deferred[VOCC_MAX_DEFERMENT];
} vocc_tracer;

enum { VOCC_QUEUE_ENTRIES = 1024 };

typedef void (*vocc_trace_fn)(vocc_tracer *tracer, vocc_block *block);

typedef struct vocc_kernels {
    vocc_trace_fn occluded;
    vocc_trace_fn closest;
    size_t queue_entry_bytes;
} vocc_kernels;

/* The kernels for options->packets and options->isa; NULL if this build does
 * not have them. */
VOCC_INTERNAL const vocc_kernels *
vocc_find_kernels(const vocc_query_options *options);

extern VOCC_INTERNAL const vocc_kernels vocc_kernels_single;
extern VOCC_INTERNAL const vocc_kernels vocc_kernels_plain4;
#if VOCC_HAVE_SSE2
extern VOCC_INTERNAL const vocc_kernels vocc_kernels_sse2;
#endif

/* A tracer for checked options.  Returns NULL if there is no memory. */
VOCC_INTERNAL vocc_tracer *vocc_tracer_create(const vocc_allocator *allocator,
                                              const vocc_tree *tree,
                                              const vocc_query_options *options,
                                              const vocc_kernels *kernels);
VOCC_INTERNAL void vocc_tracer_free(const vocc_allocator *allocator,
                                    vocc_tracer *tracer);

/* ---- for the kernels ----------------------------------------------------- */

/* One ray, in double: any finite float32 values. */
VOCC_INTERNAL void vocc_trace_careful(vocc_tracer *tracer, vocc_block *block,
                                      size_t ray, int closest);

/* Whether a ray meets nothing by definition (see vocc_rays). */
VOCC_INTERNAL int vocc_is_void(const vocc_block *block, size_t ray);

/* The region that ray's end lies in, or VOCC_END_UNCERTIFIED. */
VOCC_INTERNAL int32_t vocc_certify_end(const vocc_tree *tree,
                                       const vocc_block *block, size_t ray);

/* Puts an occluder in front. */
VOCC_INTERNAL void vocc_cache_insert(vocc_occluder_cache *cache,
                                     const vocc_opaque *occluder);
/* Moves entry i to the front. */
VOCC_INTERNAL void vocc_cache_touch(vocc_occluder_cache *cache, int i);

#endif
