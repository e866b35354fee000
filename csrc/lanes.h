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

/* Compilers know it; without an instruction for it they would call theirs. */
VOCC_INLINE int vocc_count_bits(uint32_t bits)
{
    bits -= bits >> 1 & 0x55555555u;
    bits = (bits & 0x33333333u) + (bits >> 2 & 0x33333333u);
    bits = (bits + (bits >> 4)) & 0x0F0F0F0Fu;
    return (int)((bits * 0x01010101u & 0xFFFFFFFFu) >> 24);
}

VOCC_INLINE int vocc_count_bits64(uint64_t bits)
{
    return vocc_count_bits((unsigned)(bits & 0xFFFFFFFFu)) +
           vocc_count_bits((unsigned)(bits >> 32));
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
