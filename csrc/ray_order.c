#include "ray_order.h"
#include "vec3.h"

#include <string.h>

/* A key: Morton's curve through the cells of origins and ends, six bits each,
 * above 16 bits for the ray's number. */
enum { AXES = 6, CELL_BITS = 6, DIGIT_BITS = 12, NUMBER_BITS = 16 };

/* Bits of a cell, six apart. */
static uint64_t spread(unsigned cell)
{
    uint64_t bits = 0;
    int i;
    for (i = 0; i < CELL_BITS; i++)
        bits |= (uint64_t)(cell >> i & 1u) << AXES * i;
    return bits;
}

/* Origin and end; where that is far away, a point beyond the scene. */
static void ends_of(const vocc_ray_order *o, const vocc_block *b, size_t i,
                    float at[AXES])
{
    float largest = 0.0f, length;
    int k;
    for (k = 0; k < 3; k++)
        largest = vocc_absf(b->dir[k][i]) > largest ? vocc_absf(b->dir[k][i])
                                                    : largest;
    length = 4.0f * o->size / largest;
    length = b->tmax[i] < length ? b->tmax[i] : length;
    for (k = 0; k < 3; k++) {
        at[k] = b->org[k][i];
        at[3 + k] = b->org[k][i] + length * b->dir[k][i];
    }
}

void vocc_ray_order_begin(vocc_ray_order *o, float size)
{
    int k;
    o->size = size;
    o->count = 0;
    for (k = 0; k < AXES; k++) {
        o->lower[k] = FLT_MAX;
        o->upper[k] = -FLT_MAX;
    }
}

void vocc_ray_order_look(vocc_ray_order *o, const vocc_block *b)
{
    size_t i;
    int k;
    for (i = 0; i < b->count; i++) {
        float at[AXES];
        ends_of(o, b, i, at);
        for (k = 0; k < AXES; k++) {
            o->lower[k] = at[k] < o->lower[k] ? at[k] : o->lower[k];
            o->upper[k] = at[k] > o->upper[k] ? at[k] : o->upper[k];
        }
    }
    for (k = 0; k < 2; k++) {
        const float *const low = o->lower + 3 * k, *const high =
                                                       o->upper + 3 * k;
        float width = high[0] - low[0];
        width = high[1] - low[1] > width ? high[1] - low[1] : width;
        width = high[2] - low[2] > width ? high[2] - low[2] : width;
        o->per_unit[k] =
            width > FLT_MIN ? (float)VOCC_ORDER_CELLS / width : 0.0f;
    }
}

void vocc_ray_order_add(vocc_ray_order *o, const vocc_block *b)
{
    const float most = (float)(VOCC_ORDER_CELLS - 1);
    uint64_t bits[VOCC_ORDER_CELLS];
    unsigned cell;
    size_t i;
    int k;
    for (cell = 0; cell < VOCC_ORDER_CELLS; cell++)
        bits[cell] = spread(cell) << NUMBER_BITS;
    for (i = 0; i < b->count; i++) {
        uint64_t key = o->count;
        float at[AXES];
        ends_of(o, b, i, at);
        for (k = 0; k < AXES; k++) {
            const float x = (at[k] - o->lower[k]) * o->per_unit[k / 3];
            /* NaN: 0. */
            key |= bits[(int)(x > 0.0f ? x < most ? x : most : 0.0f)] << k;
        }
        o->keys[0][o->count++] = key;
    }
}

/* By the digits, the lowest first. */
void vocc_ray_order_sort(vocc_ray_order *o)
{
    const uint64_t mask = VOCC_ORDER_DIGIT - 1;
    size_t i;
    int pass;
    memset(o->first, 0, sizeof o->first);
    for (i = 0; i < o->count; i++) {
        const uint64_t key = o->keys[0][i] >> NUMBER_BITS;
        o->first[0][key & mask]++;
        o->first[1][key >> DIGIT_BITS & mask]++;
        o->first[2][key >> 2 * DIGIT_BITS & mask]++;
    }
    for (pass = 0; pass < 3; pass++) {
        const uint64_t *const from = o->keys[pass & 1];
        uint64_t *const to = o->keys[~pass & 1];
        uint32_t *const first = o->first[pass], sum = 0;
        for (i = 0; i <= mask; i++) {
            const uint32_t count = first[i];
            first[i] = sum;
            sum += count;
        }
        for (i = 0; i < o->count; i++) {
            const uint64_t key = from[i];
            to[first[key >> (NUMBER_BITS + DIGIT_BITS * pass) & mask]++] = key;
        }
    }
    for (i = 0; i < o->count; i++)
        o->number[i] = (uint16_t)(o->keys[1][i] & 0xFFFFu);
}
