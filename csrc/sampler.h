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
    uint32_t samples, nu, nv;
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
    s.nv = nv;
    s.width = 1.0f / (float)s.nu;
    s.height = 1.0f / (float)nv;
    return s;
}

/* A sample and the lower corner of its stratum, in strata. */
typedef struct vocc_stratum {
    uint32_t sample;
    float column, row;
} vocc_stratum;

VOCC_INLINE void vocc_set_stratum(const vocc_strata *strata, uint32_t sample,
                                  vocc_stratum *out)
{
    out->sample = sample;
    out->column = (float)(sample % strata->nu);
    out->row = (float)(sample / strata->nu);
}

/* Lists the samples so that four in a row are neighbours, 2 x 2 where they can
 * be: packets of them are narrow.  order[] has room for all. */
VOCC_INLINE void vocc_order_samples(const vocc_strata *strata,
                                    vocc_stratum *order)
{
    const uint32_t nu = strata->nu, nv = strata->nv;
    uint32_t i, j, n = 0;
    for (j = 0; j + 1 < nv; j += 2)
        for (i = 0; i + 1 < nu; i += 2) {
            vocc_set_stratum(strata, j * nu + i, &order[n++]);
            vocc_set_stratum(strata, j * nu + i + 1, &order[n++]);
            vocc_set_stratum(strata, (j + 1) * nu + i, &order[n++]);
            vocc_set_stratum(strata, (j + 1) * nu + i + 1, &order[n++]);
        }
    /* What an odd width or height leaves over. */
    for (j = 0; nu % 2 && j < (nv & ~1u); j++)
        vocc_set_stratum(strata, j * nu + nu - 1, &order[n++]);
    for (i = 0; nv % 2 && i < nu; i++)
        vocc_set_stratum(strata, (nv - 1) * nu + i, &order[n++]);
}

/* Point (a, b) of the unit square, of a sample of a light at a point. */
VOCC_INLINE void vocc_sample(const vocc_strata *strata, uint32_t point_id,
                             uint32_t light, const vocc_stratum *stratum,
                             float *a, float *b)
{
    const uint32_t h =
        vocc_hash32(point_id * 2048u + light * 256u + stratum->sample);
    const float u = (float)(int32_t)(h & 0xFFFFu) * (1.0f / 65536.0f),
                v = (float)(int32_t)(h >> 16) * (1.0f / 65536.0f);
    *a = (stratum->column + u) * strata->width;
    *b = (stratum->row + v) * strata->height;
}

#endif
