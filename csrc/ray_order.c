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

/* Ends of rays; where they are far away, points beyond the scene. */
static void find_ends(const vocc_ray_order *o, const vocc_block *b,
                      float end[3][VOCC_BLOCK])
{
    float length[VOCC_BLOCK];
    size_t i;
    int k;
    for (i = 0; i < b->count; i++) {
        const float x = vocc_absf(b->dir[0][i]), y = vocc_absf(b->dir[1][i]),
                    z = vocc_absf(b->dir[2][i]), xy = x > y ? x : y,
                    far = 4.0f * o->size / (xy > z ? xy : z);
        length[i] = b->tmax[i] < far ? b->tmax[i] : far;
    }
    for (k = 0; k < 3; k++)
        for (i = 0; i < b->count; i++)
            end[k][i] = b->org[k][i] + length[i] * b->dir[k][i];
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
    float end[3][VOCC_BLOCK];
    size_t i;
    int k;
    find_ends(o, b, end);
    for (k = 0; k < AXES; k++) {
        const float *const at = k < 3 ? b->org[k] : end[k - 3];
        for (i = 0; i < b->count; i++) {
            o->lower[k] = at[i] < o->lower[k] ? at[i] : o->lower[k];
            o->upper[k] = at[i] > o->upper[k] ? at[i] : o->upper[k];
        }
    }
    for (k = 0; k < 2; k++) {
        const float *low = o->lower + 3 * k, *high = o->upper + 3 * k;
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
    float end[3][VOCC_BLOCK];
    int32_t cell[AXES][VOCC_BLOCK];
    uint64_t bits[VOCC_ORDER_CELLS];
    unsigned c;
    size_t i;
    int k;
    for (c = 0; c < VOCC_ORDER_CELLS; c++)
        bits[c] = spread(c) << NUMBER_BITS;
    find_ends(o, b, end);
    for (k = 0; k < AXES; k++) {
        const float *const at = k < 3 ? b->org[k] : end[k - 3];
        const float lower = o->lower[k], per_unit = o->per_unit[k / 3];
        for (i = 0; i < b->count; i++) {
            const float x = (at[i] - lower) * per_unit,
                        positive = x > 0.0f ? x : 0.0f; /* NaN: 0 */
            cell[k][i] = (int32_t)(positive < most ? positive : most);
        }
    }
    for (i = 0; i < b->count; i++)
        o->keys[0][o->count + i] =
            (o->count + i) | bits[cell[0][i]] | bits[cell[1][i]] << 1 |
            bits[cell[2][i]] << 2 | bits[cell[3][i]] << 3 |
            bits[cell[4][i]] << 4 | bits[cell[5][i]] << 5;
    o->count += b->count;
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
