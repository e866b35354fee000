/* Shadow queries under way: what tracing by rays and by beams share. */
#ifndef VOCC_SHADOW_H
#define VOCC_SHADOW_H

#include "beam.h"
#include "light.h"
#include "platform.h"
#include "query.h"
#include "sampler.h"
#include "shaft.h"
#include "tile.h"

/* One worker's room for tiles by beams: shadow_beams.c. */
typedef struct vocc_beam_room vocc_beam_room;

typedef struct vocc_shadow {
    vocc_query query;
    vocc_points points;
    const vocc_emitter *lights;
    size_t light_count;
    vocc_pattern pattern;
    int32_t horizon;
    uint16_t *visible;
    float *irradiance;     /* NULL: not wanted */
    uint8_t *blocked;      /* NULL, or a bit for each sample */
    size_t blocked_bytes;  /* for each point and light */
    vocc_beam_room *rooms; /* one a worker; NULL: by rays */
} vocc_shadow;

/* What a point's rays have come to. */
typedef struct vocc_tally {
    uint32_t blocked; /* samples */
    uint32_t below;   /* those of them that are below the surface */
    double open, all; /* weights, for irradiance */
} vocc_tally;

/* One light at the points of a tile, under way. */
typedef struct vocc_lighting {
    const vocc_shadow *s;
    int worker_number;
    const vocc_worker *worker;
    const vocc_tile *t;
    size_t number; /* of the light */
    const vocc_emitter *light;
    vocc_target target;
    uint8_t facing[VOCC_TILE_POINTS]; /* vocc_facing of each point */
    int facing_alike;                 /* all are the same */
    vocc_tally *tallies;              /* of each point */
    uint16_t owner[VOCC_BLOCK];       /* the point of each ray of the block */
    uint16_t sample[VOCC_BLOCK];
    double weight[VOCC_BLOCK];
    /* Triangles that the rays can meet; NULL: all below the entry node. */
    const uint32_t *among;
    int among_count;
    /* Rays start from a dome; NULL: not. */
    const vocc_dome *dome;
    vocc_beam *beam;
    const vocc_beam_kernels *beam_kernels;
    uint64_t work; /* since the last poll, in rays */
    vocc_jobs *jobs;
    vocc_shaft shaft;
    vocc_shaft_walk walk;
} vocc_lighting;

/* Samples that need no tracing take as long as a ray. */
enum { VOCC_SAMPLES_LIKE_A_RAY = 4 };

/* Work as long as that of so many rays is done. */
VOCC_INTERNAL vocc_status vocc_shadow_poll(vocc_lighting *g, uint64_t rays);

/* The bits of a point's samples; NULL if there are none. */
VOCC_INLINE uint8_t *vocc_shadow_bits(const vocc_lighting *g, size_t which)
{
    const vocc_shadow *s = g->s;
    return s->blocked ? s->blocked + (g->number * s->points.count +
                                      g->t->number[which]) *
                                         s->blocked_bytes
                      : NULL;
}

VOCC_INLINE int vocc_is_blocked(const uint8_t *bits, uint32_t sample)
{
    return bits && (bits[sample / 8] >> sample % 8 & 1);
}

VOCC_INLINE void vocc_set_blocked(uint8_t *bits, uint32_t sample)
{
    bits[sample / 8] = (uint8_t)(bits[sample / 8] | 1u << sample % 8);
}

/* All rays of the group are lit, or all dark, but for those that are blocked
 * already.  The others are added to *settled. */
VOCC_INTERNAL vocc_status vocc_shadow_settle(vocc_lighting *g,
                                             const uint16_t *which,
                                             size_t count, int dark,
                                             uint64_t *settled);

/* Traces all rays of the points; of points that may face a part of the light
 * only, those above the surface. */
VOCC_INTERNAL vocc_status vocc_shadow_trace(vocc_lighting *g,
                                            const uint16_t *which, size_t count,
                                            int part_only);

/* Begins light l: its target, how it lies to the points.  Sets the outputs of
 * those that face all of it as if it was seen whole, of the others as not
 * traced. */
VOCC_INTERNAL void vocc_shadow_begin_light(vocc_lighting *g, size_t l);

/* Writes the outputs of a point. */
VOCC_INTERNAL void vocc_shadow_store(const vocc_lighting *g, size_t which);

/* ---- shadow_beams.c -------------------------------------------------------
 */

/* Rooms for all workers of s->query; 0: there is no memory.  To be freed in
 * either case. */
VOCC_INTERNAL int vocc_beam_rooms_create(vocc_shadow *s);
VOCC_INTERNAL void vocc_beam_rooms_free(vocc_shadow *s);

/* Samples of a light that rays count otherwise than beams. */
typedef struct vocc_beam_mismatch {
    int is_set;
    size_t point, light;
    uint32_t blocked, expected;
} vocc_beam_mismatch;

/* After VOCC_ERROR_MISMATCH: of those found the one with the first point. */
VOCC_INTERNAL const vocc_beam_mismatch *
vocc_beam_rooms_mismatch(const vocc_shadow *s);

/* All lights at the points of the tile. */
VOCC_INTERNAL vocc_status vocc_shadow_beams(vocc_lighting *g);

#endif
