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
    case VOCC_ISA_AUTO:
    case VOCC_ISA_SSE2:
        four = &vocc_kernels_sse2;
        break;
#else
    case VOCC_ISA_AUTO:
        four = &vocc_kernels_plain4;
        break;
#endif
    default:
        break;
    }
    return four && !options->packets ? &vocc_kernels_single : four;
}

vocc_tracer *vocc_tracer_create(const vocc_allocator *allocator,
                                const vocc_tree *tree,
                                const vocc_query_options *options,
                                const vocc_kernels *kernels)
{
    vocc_tracer *tracer = vocc_allocate(allocator, 1, sizeof *tracer);
    if (!tracer)
        return NULL;
    memset(tracer, 0, sizeof *tracer);
    tracer->tree = tree;
    tracer->order = options->order;
    tracer->occluders = options->occluders;
    tracer->deferment = options->deferment;
    tracer->counting = options->counters != NULL;
    tracer->cache.size = options->occluders ? options->cache : 0;
    if (options->order >= VOCC_ORDER_BFS) {
        tracer->queue = vocc_allocate(allocator, VOCC_QUEUE_ENTRIES,
                                      kernels->queue_entry_bytes);
        if (!tracer->queue) {
            vocc_release(allocator, tracer);
            return NULL;
        }
    }
    return tracer;
}

void vocc_tracer_free(const vocc_allocator *allocator, vocc_tracer *tracer)
{
    if (tracer)
        vocc_release(allocator, tracer->queue);
    vocc_release(allocator, tracer);
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
    uint32_t id; /* of the closest */
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
    c.id = UINT32_MAX;
    if (closest) {
        (void)vocc_walk(c.tree, c.org, c.dir, (double)c.tmin, (double)c.tmax,
                        closest_hit, &c);
        block->t[ray] = c.t;
        block->u[ray] = c.u;
        block->v[ray] = c.v;
        block->triangle[ray] = c.id;
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

void vocc_cache_insert(vocc_occluder_cache *cache, const vocc_opaque *occluder)
{
    if (cache->count < cache->size)
        cache->count++;
    memmove(cache->entries + 1, cache->entries,
            (size_t)(cache->count - 1) * sizeof *cache->entries);
    cache->entries[0] = *occluder;
}

void vocc_cache_touch(vocc_occluder_cache *cache, int i)
{
    const vocc_opaque used = cache->entries[i];
    memmove(cache->entries + 1, cache->entries,
            (size_t)i * sizeof *cache->entries);
    cache->entries[0] = used;
}
