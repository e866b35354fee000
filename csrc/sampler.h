/* Samples of the unit square that any program can repeat: integers, and one
 * float32 rounding an operation. */
#ifndef VOCC_SAMPLER_H
#define VOCC_SAMPLER_H

#include "platform.h"
#include "vocc.h"

/* A permutation of 32-bit numbers: Wellons, "Prospecting for Hash Functions",
 * 2018 (lowbias32). */
VOCC_INLINE uint32_t vocc_hash32(uint32_t x)
{
    x ^= x >> 16;
    x *= 0x7FEB352Du;
    x ^= x >> 15;
    x *= 0x846CA68Bu;
    x ^= x >> 16;
    return x;
}

/* A sample's place in the pattern, before a point's own jitter or scrambling.
 */
typedef struct vocc_place {
    uint32_t sample;
    float column, row; /* JITTER: lower corner of its stratum, in strata */
    uint32_t x, y;     /* SOBOL: coordinates in 2^-32, bits reversed */
} vocc_place;

typedef struct vocc_pattern {
    int32_t sampler;
    uint32_t samples;
    float width, height; /* of a stratum */
    vocc_place *places;  /* in the order of tracing: four in a row are near to
                            each other, packets of them are narrow */
} vocc_pattern;

/* 1 to 65534 samples.  0: out of memory; to be freed in either case. */
VOCC_INTERNAL int vocc_pattern_init(vocc_pattern *pattern,
                                    const vocc_allocator *allocator,
                                    int32_t sampler, uint32_t samples);

VOCC_INTERNAL void vocc_pattern_free(vocc_pattern *pattern,
                                     const vocc_allocator *allocator);

VOCC_INLINE uint32_t vocc_reverse_bits(uint32_t x)
{
    x = (x >> 1 & 0x55555555u) | (x & 0x55555555u) << 1;
    x = (x >> 2 & 0x33333333u) | (x & 0x33333333u) << 2;
    x = (x >> 4 & 0x0F0F0F0Fu) | (x & 0x0F0F0F0Fu) << 4;
    x = (x >> 8 & 0x00FF00FFu) | (x & 0x00FF00FFu) << 8;
    return x >> 16 | x << 16;
}

/* Owen's scrambling of a number whose bits are reversed, as a hash in which
 * bits depend on lower ones only: Laine and Karras, "Stratified Sampling for
 * Stochastic Transparency", 2011; Burley, "Practical Hash-based Owen
 * Scrambling", 2020; constants by Vegdahl, 2021. */
VOCC_INLINE uint32_t vocc_scramble(uint32_t x, uint32_t seed)
{
    x ^= x * 0x3D20ADEAu;
    x += seed;
    x *= seed >> 16 | 1u;
    x ^= x * 0x05526C56u;
    x ^= x * 0x53A22864u;
    return x;
}

/* What the samples of a light at a point have in common. */
VOCC_INLINE uint32_t vocc_sample_seed(uint32_t point_id, uint32_t light)
{
    return vocc_hash32(point_id ^ vocc_hash32(light ^ 0x9E3779B9u));
}

/* What the samples of a point and a light have in common. */
VOCC_INLINE uint32_t vocc_jitter_key(uint32_t point_id, uint32_t light)
{
    return point_id * 2048u + light * 256u;
}

VOCC_INLINE void vocc_jitter(uint32_t key, uint32_t sample, float column,
                             float row, float width, float height, float *a,
                             float *b)
{
    const uint32_t h = vocc_hash32(key + sample);
    const float u = (float)(int32_t)(h & 0xFFFFu) * (1.0f / 65536.0f),
                v = (float)(int32_t)(h >> 16) * (1.0f / 65536.0f);
    *a = (column + u) * width;
    *b = (row + v) * height;
}

/* `other` is hash32(seed). */
VOCC_INLINE void vocc_sobol(uint32_t seed, uint32_t other, uint32_t place_x,
                            uint32_t place_y, float *a, float *b)
{
    const uint32_t x = vocc_reverse_bits(vocc_scramble(place_x, seed)),
                   y = vocc_reverse_bits(vocc_scramble(place_y, other));
    *a = (float)(int32_t)(x >> 8) * 0x1p-24f;
    *b = (float)(int32_t)(y >> 8) * 0x1p-24f;
}

/* Point (a, b) of the unit square, 0 <= a, b < 1 (JITTER: up to rounding). */
VOCC_INLINE void vocc_sample(const vocc_pattern *pattern, uint32_t point_id,
                             uint32_t light, uint32_t seed,
                             const vocc_place *place, float *a, float *b)
{
    if (pattern->sampler == VOCC_SAMPLER_JITTER)
        vocc_jitter(vocc_jitter_key(point_id, light), place->sample,
                    place->column, place->row, pattern->width, pattern->height,
                    a, b);
    else
        vocc_sobol(seed, vocc_hash32(seed), place->x, place->y, a, b);
}

#endif
