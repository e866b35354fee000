/* The lanes of a mask. */
#ifndef VOCC_LANES_H
#define VOCC_LANES_H

#include "platform.h"

#include <stdint.h>

/* The number of the lowest bit that is set; there is one. */
VOCC_INLINE int vocc_lowest_bit(unsigned bits)
{
#if defined(__GNUC__)
    return __builtin_ctz(bits);
#else
    int i = 0;
    while (!(bits >> i & 1u))
        i++;
    return i;
#endif
}

VOCC_INLINE int vocc_count_bits(unsigned bits)
{
#if defined(__GNUC__)
    return __builtin_popcount(bits);
#else
    int n = 0;
    for (; bits; bits &= bits - 1)
        n++;
    return n;
#endif
}

VOCC_INLINE int vocc_lowest_bit64(uint64_t bits)
{
#if defined(__GNUC__)
    return __builtin_ctzll(bits);
#else
    const unsigned low = (unsigned)(bits & 0xFFFFFFFFu);
    return low ? vocc_lowest_bit(low)
               : 32 + vocc_lowest_bit((unsigned)(bits >> 32));
#endif
}

#endif
