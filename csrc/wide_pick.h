/* Moving some of 16 values next to each other, where there is no instruction
 * for it. */
#ifndef VOCC_WIDE_PICK_H
#define VOCC_WIDE_PICK_H

#include "lanes.h"
#include "platform.h"

/* Lanes in order. */
typedef struct wpick {
    int count;
    uint8_t lane[16];
} wpick;

VOCC_INLINE wpick wpick_lanes(unsigned bits)
{
    wpick p;
    p.count = 0;
    for (; bits; bits &= bits - 1)
        p.lane[p.count++] = (uint8_t)vocc_lowest_bit(bits);
    return p;
}

VOCC_INLINE void wpack(float *to, const float *from, wpick p)
{
    int i;
    for (i = 0; i < p.count; i++)
        to[i] = from[p.lane[i]];
}

VOCC_INLINE void wpack_numbers(uint32_t *to, const uint32_t *from, wpick p)
{
    int i;
    for (i = 0; i < p.count; i++)
        to[i] = from[p.lane[i]];
}

VOCC_INLINE void wpack_places(uint16_t *to, int first, wpick p)
{
    int i;
    for (i = 0; i < p.count; i++)
        to[i] = (uint16_t)(first + p.lane[i]);
}

#endif
