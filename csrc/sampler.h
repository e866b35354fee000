/* Stratified, jittered samples that any program can repeat: integers, and one
 * float32 rounding an operation. */
#ifndef VOCC_SAMPLER_H
#define VOCC_SAMPLER_H

#include "platform.h"

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

/* nu x nv strata: nv is the largest divisor of `samples` up to its root. */
typedef struct vocc_strata {
    uint32_t samples, nu;
    float width, height; /* 1 / nu, 1 / nv */
} vocc_strata;

VOCC_INLINE vocc_strata vocc_make_strata(uint32_t samples)
{
    vocc_strata s;
    uint32_t nv = 1, n;
    for (n = 1; n <= samples / n; n++)
        if (samples % n == 0)
            nv = n;
    s.samples = samples;
    s.nu = samples / nv;
    s.width = 1.0f / (float)s.nu;
    s.height = 1.0f / (float)nv;
    return s;
}

/* Point (a, b) of the unit square, of sample s of a light at a point. */
VOCC_INLINE void vocc_sample(const vocc_strata *strata, uint32_t point_id,
                             uint32_t light, uint32_t s, uint32_t column,
                             uint32_t row, float *a, float *b)
{
    const uint32_t h = vocc_hash32(point_id * 2048u + light * 256u + s);
    const float u = (float)(int32_t)(h & 0xFFFFu) * (1.0f / 65536.0f),
                v = (float)(int32_t)(h >> 16) * (1.0f / 65536.0f);
    *a = ((float)(int32_t)column + u) * strata->width;
    *b = ((float)(int32_t)row + v) * strata->height;
}

#endif
