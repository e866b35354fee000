#include "traverse.h"
#include "memory.h"
#include "triangle.h"
#include "vec3.h"
#include "walk.h"

#include <math.h>
#include <string.h>

const vocc_kernels *vocc_find_kernels(const vocc_query_options *options)
{
    const vocc_kernels *four = NULL;
    switch (options->isa) {
    case VOCC_ISA_SCALAR:
        four = &vocc_kernels_plain4;
        break;
#if VOCC_HAVE_SSE2
    /* Four lanes gain nothing from more. */
    case VOCC_ISA_SSE2:
    case VOCC_ISA_AVX2:
    case VOCC_ISA_AVX512:
        four = &vocc_kernels_sse2;
        break;
#endif
#if VOCC_HAVE_NEON
    case VOCC_ISA_NEON:
        four = &vocc_kernels_neon;
        break;
#endif
    default:
        break;
    }
    return four && !options->packets ? &vocc_kernels_single : four;
}

static size_t cell_count(const vocc_occluder_cache *cache)
{
    return 6 * (size_t)cache->size * (size_t)cache->size;
}

vocc_tracer *vocc_tracer_create(const vocc_allocator *allocator,
                                const vocc_tree *tree,
                                const vocc_query_options *options,
                                const vocc_kernels *kernels)
{
    vocc_tracer *tracer = vocc_allocate(allocator, 1, sizeof *tracer);
    int failed = 0;
    if (!tracer)
        return NULL;
    memset(tracer, 0, sizeof *tracer);
    tracer->tree = tree;
    tracer->order = options->order;
    tracer->occluders = options->occluders;
    tracer->deferment = options->deferment;
    tracer->counting = options->counters || options->point_steps;
    tracer->cache.size = options->occluders ? options->cache : 0;
    tracer->fusion = options->fusion;
    tracer->triangle_cache = options->triangle_cache;
    if (options->order == VOCC_ORDER_BFS || options->order == VOCC_ORDER_QDBFS)
        failed |= !(tracer->queue = vocc_allocate(allocator, VOCC_QUEUE_ENTRIES,
                                                  kernels->queue_entry_bytes));
    if (options->cache_policy == VOCC_CACHE_DIRECTION && tracer->cache.size)
        failed |= !(tracer->cache.cells =
                        vocc_allocate(allocator, cell_count(&tracer->cache),
                                      sizeof *tracer->cache.cells));
    if (failed) {
        vocc_tracer_free(allocator, tracer);
        return NULL;
    }
    vocc_tracer_forget(tracer);
    return tracer;
}

void vocc_tracer_free(const vocc_allocator *allocator, vocc_tracer *tracer)
{
    if (tracer) {
        vocc_release(allocator, tracer->queue);
        vocc_release(allocator, tracer->cache.cells);
    }
    vocc_release(allocator, tracer);
}

void vocc_tracer_forget(vocc_tracer *tracer)
{
    vocc_occluder_cache *c = &tracer->cache;
    c->count = 0;
    if (c->cells)
        memset(c->cells, 0, cell_count(c) * sizeof *c->cells);
    tracer->last_triangle = UINT32_MAX;
    vocc_tracer_at_root(tracer);
}

void vocc_tracer_enter(vocc_tracer *tracer, uint32_t node, const float lower[3],
                       const float upper[3])
{
    tracer->entry = node;
    memcpy(tracer->entry_lower, lower, sizeof tracer->entry_lower);
    memcpy(tracer->entry_upper, upper, sizeof tracer->entry_upper);
}

void vocc_tracer_at_root(vocc_tracer *tracer)
{
    vocc_tracer_enter(tracer, 0, tracer->tree->lower, tracer->tree->upper);
}

int vocc_is_void(const vocc_block *block, size_t ray)
{
    float largest = 0.0f;
    int k;
    for (k = 0; k < 3; k++) {
        const float d = vocc_absf(block->dir[k][ray]);
        if (!vocc_finitef(block->org[k][ray]) || !vocc_finitef(d))
            return 1;
        largest = d > largest ? d : largest;
    }
    return largest == 0.0f || !(block->tmin[ray] < block->tmax[ray]);
}

/* ---- the careful ray ------------------------------------------------------
 */

typedef struct careful {
    const vocc_tree *tree;
    float org[3], dir[3], tmin, tmax;
    float t, u, v;
    uint32_t id, slot; /* of the closest, in scene and tree */
} careful;

static int any_hit(void *context, uint32_t triangle, double *tmax)
{
    const careful *c = context;
    (void)tmax;
    return vocc_triangle_test(c->org, c->dir, c->tmin, c->tmax,
                              c->tree->corners + 9 * (size_t)triangle, NULL);
}

static int closest_hit(void *context, uint32_t triangle, double *tmax)
{
    careful *c = context;
    vocc_crossing crossing;
    if (vocc_triangle_test(c->org, c->dir, c->tmin, c->tmax,
                           c->tree->corners + 9 * (size_t)triangle,
                           &crossing)) {
        const float t = (float)crossing.t;
        const uint32_t id = c->tree->ids[triangle];
        if (c->id == UINT32_MAX || t < c->t || (t == c->t && id < c->id)) {
            c->t = t;
            c->u = (float)crossing.u;
            c->v = (float)crossing.v;
            c->id = id;
            c->slot = triangle;
            /* Whatever rounds to the same float is still of interest. */
            if (t < FLT_MAX && t > -FLT_MAX)
                *tmax = (double)nextafterf(t, INFINITY);
        }
    }
    return 0;
}

void vocc_trace_careful(vocc_tracer *tracer, vocc_block *block, size_t ray,
                        int closest)
{
    careful c;
    int k;
    c.tree = tracer->tree;
    for (k = 0; k < 3; k++) {
        c.org[k] = block->org[k][ray];
        c.dir[k] = block->dir[k][ray];
    }
    c.tmin = block->tmin[ray];
    c.tmax = block->tmax[ray];
    c.t = INFINITY;
    c.u = c.v = 0.0f;
    c.id = c.slot = UINT32_MAX;
    if (closest) {
        (void)vocc_walk(c.tree, c.org, c.dir, (double)c.tmin, (double)c.tmax,
                        closest_hit, &c);
        block->t[ray] = c.t;
        block->u[ray] = c.u;
        block->v[ray] = c.v;
        block->triangle[ray] = c.id;
        block->slot[ray] = c.slot;
    } else {
        block->occluded[ray] = (uint8_t)vocc_walk(
            c.tree, c.org, c.dir, (double)c.tmin, (double)c.tmax, any_hit, &c);
    }
}

/* ---- ends -------------------------------------------------------------------
 */

int32_t vocc_certify_end(const vocc_tree *tree, const vocc_block *block,
                         size_t ray)
{
    double end[3], radius[3];
    const float tmax = block->tmax[ray];
    int32_t region;
    int k;
    /* An unbounded ray (it has a direction) leaves all bounds. */
    if (tmax > FLT_MAX)
        return 0;
    for (k = 0; k < 3; k++) {
        const double step = (double)tmax * (double)block->dir[k][ray],
                     org = (double)block->org[k][ray];
        /* The product of two floats is exact in double; one rounding. */
        end[k] = org + step;
        radius[k] = DBL_EPSILON * (vocc_abs(org) + vocc_abs(step));
    }
    return vocc_locate(tree, end, radius, &region) ? region
                                                   : VOCC_END_UNCERTIFIED;
}

/* ---- the occluder cache
 * ------------------------------------------------------ */

/* The cell of a cube map around the origin that the ray's direction is in. */
static size_t cell_of(const vocc_occluder_cache *cache, const vocc_block *block,
                      size_t ray)
{
    const int n = cache->size;
    float d[3], scale;
    int k, axis = 0, at[2];
    for (k = 0; k < 3; k++) {
        d[k] = block->dir[k][ray];
        if (vocc_absf(d[k]) > vocc_absf(d[axis]))
            axis = k;
    }
    scale = 0.5f * (float)n / vocc_absf(d[axis]);
    for (k = 0; k < 2; k++) {
        at[k] = (int)(d[(axis + 1 + k) % 3] * scale + 0.5f * (float)n);
        at[k] = at[k] >= n ? n - 1 : at[k];
    }
    return (((size_t)axis * 2 + (d[axis] < 0.0f)) * (size_t)n + (size_t)at[0]) *
               (size_t)n +
           (size_t)at[1];
}

void vocc_cache_insert(vocc_tracer *tracer, const vocc_opaque *leaf,
                       const vocc_block *block, size_t ray)
{
    const vocc_tree *tree = tracer->tree;
    vocc_occluder_cache *cache = &tracer->cache;
    const int grown = tracer->fusion && leaf->grown >= 0;
    if (cache->cells) {
        cache->cells[cell_of(cache, block, ray)] =
            grown ? VOCC_CELL_GROWN | ((uint32_t)leaf->grown + 1)
                  : (uint32_t)(leaf - tree->opaque) + 1;
        return;
    }
    if (cache->count < cache->size)
        cache->count++;
    memmove(cache->entries + 1, cache->entries,
            (size_t)(cache->count - 1) * sizeof *cache->entries);
    cache->entries[0] = grown ? tree->grown[leaf->grown] : *leaf;
}

const vocc_opaque *vocc_cache_cell(const vocc_tracer *tracer,
                                   const vocc_block *block, size_t ray)
{
    const uint32_t cell =
        tracer->cache.cells[cell_of(&tracer->cache, block, ray)];
    if (!cell)
        return NULL;
    return cell & VOCC_CELL_GROWN
               ? &tracer->tree->grown[(cell & ~VOCC_CELL_GROWN) - 1]
               : &tracer->tree->opaque[cell - 1];
}

void vocc_cache_touch(vocc_occluder_cache *cache, int i)
{
    const vocc_opaque used = cache->entries[i];
    memmove(cache->entries + 1, cache->entries,
            (size_t)i * sizeof *cache->entries);
    cache->entries[0] = used;
}
