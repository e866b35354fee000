#include "sampler.h"
#include "memory.h"
#include "sort.h"

/* nu x nv strata: nv is the largest divisor of `samples` up to its root. */
static uint32_t divisor_up_to_root(uint32_t samples)
{
    uint32_t nv = 1, n;
    for (n = 1; n <= samples / n; n++)
        if (samples % n == 0)
            nv = n;
    return nv;
}

static void set_stratum(vocc_place *place, uint32_t nu, uint32_t sample)
{
    place->sample = sample;
    place->column = (float)(sample % nu);
    place->row = (float)(sample / nu);
    place->x = place->y = 0;
}

static void make_strata(vocc_pattern *p)
{
    const uint32_t nv = divisor_up_to_root(p->samples), nu = p->samples / nv;
    vocc_place *to = p->places;
    uint32_t i, j;
    p->width = 1.0f / (float)nu;
    p->height = 1.0f / (float)nv;
    /* 2 x 2 where they can be. */
    for (j = 0; j + 1 < nv; j += 2)
        for (i = 0; i + 1 < nu; i += 2) {
            set_stratum(to++, nu, j * nu + i);
            set_stratum(to++, nu, j * nu + i + 1);
            set_stratum(to++, nu, (j + 1) * nu + i);
            set_stratum(to++, nu, (j + 1) * nu + i + 1);
        }
    /* What an odd width or height leaves over. */
    for (j = 0; nu % 2 && j < (nv & ~1u); j++)
        set_stratum(to++, nu, j * nu + nu - 1);
    for (i = 0; nv % 2 && i < nu; i++)
        set_stratum(to++, nu, (nv - 1) * nu + i);
}

/* The second dimension of Sobol's sequence: its direction numbers are the rows
 * of Pascal's triangle modulo 2.  (The first is the index, bits reversed.) */
static uint32_t sobol_y(uint32_t index)
{
    uint32_t direction = 0x80000000u, y = 0;
    for (; index; index >>= 1) {
        if (index & 1u)
            y ^= direction;
        direction ^= direction >> 1;
    }
    return y;
}

/* The upper 16 bits of both, interleaved. */
static uint64_t morton(uint32_t x, uint32_t y)
{
    uint64_t code = 0;
    int bit;
    for (bit = 31; bit >= 16; bit--)
        code = code << 2 | (uint64_t)(y >> bit & 1u) << 1 | (x >> bit & 1u);
    return code;
}

/* Scrambling maps each cell of 2^-k by 2^-k to one such cell: samples that are
 * neighbours along a Morton curve stay together at every point. */
static void make_sobol(vocc_pattern *p, uint64_t *keys)
{
    uint32_t i;
    p->width = p->height = 0.0f;
    for (i = 0; i < p->samples; i++)
        keys[i] = morton(vocc_reverse_bits(i), sobol_y(i)) << 16 | i;
    vocc_sort(keys, p->samples);
    for (i = 0; i < p->samples; i++) {
        vocc_place *place = &p->places[i];
        place->sample = (uint32_t)(keys[i] & 0xFFFFu);
        place->column = place->row = 0.0f;
        place->x = place->sample;
        place->y = vocc_reverse_bits(sobol_y(place->sample));
    }
}

int vocc_pattern_init(vocc_pattern *p, const vocc_allocator *allocator,
                      int32_t sampler, uint32_t samples)
{
    p->sampler = sampler;
    p->samples = samples;
    p->places = vocc_allocate(allocator, samples, sizeof *p->places);
    if (!p->places)
        return 0;
    if (sampler == VOCC_SAMPLER_JITTER) {
        make_strata(p);
    } else {
        uint64_t *keys = vocc_allocate(allocator, samples, sizeof *keys);
        if (!keys)
            return 0;
        make_sobol(p, keys);
        vocc_release(allocator, keys);
    }
    return 1;
}

void vocc_pattern_free(vocc_pattern *p, const vocc_allocator *allocator)
{
    vocc_release(allocator, p->places);
}
