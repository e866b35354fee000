/* The lanes of a mask. */
#ifndef VOCC_LANES_H
#define VOCC_LANES_H

#include "platform.h"

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

#endif
