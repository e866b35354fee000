/* Parts of a wfloat where one register, or none, has all lanes: the part is the
 * whole. */
#ifndef VOCC_WIDE_WHOLE_H
#define VOCC_WIDE_WHOLE_H

#include "platform.h"

typedef wfloat pfloat;
enum { VOCC_PART = 16, VOCC_PART_BITS = 0xffff };

#define VOCC_PART_BINARY(type, name)                                           \
    VOCC_INLINE type p##name(pfloat x, pfloat y)                               \
    {                                                                          \
        return w##name(x, y);                                                  \
    }

#define VOCC_PART_TERNARY(name)                                                \
    VOCC_INLINE pfloat p##name(pfloat x, pfloat y, pfloat z)                   \
    {                                                                          \
        return w##name(x, y, z);                                               \
    }

VOCC_PART_BINARY(pfloat, add)
VOCC_PART_BINARY(pfloat, sub)
VOCC_PART_BINARY(pfloat, mul)
VOCC_PART_BINARY(pfloat, div)
VOCC_PART_BINARY(pfloat, min)
VOCC_PART_BINARY(pfloat, max)
VOCC_PART_BINARY(unsigned, lt)
VOCC_PART_BINARY(unsigned, le)
VOCC_PART_TERNARY(fma)
VOCC_PART_TERNARY(nfma)

VOCC_INLINE pfloat pload(const float *p)
{
    return wload(p);
}

VOCC_INLINE void pstore(float *p, pfloat x)
{
    wstore(p, x);
}

VOCC_INLINE pfloat pset(float x)
{
    return wset(x);
}

VOCC_INLINE pfloat pabs(pfloat x)
{
    return wabs(x);
}

VOCC_INLINE pfloat pselect(unsigned bits, pfloat yes, pfloat no)
{
    return wselect(bits, yes, no);
}

VOCC_INLINE float plowest(pfloat x)
{
    return wlowest(x);
}

VOCC_INLINE float phighest(pfloat x)
{
    return whighest(x);
}

#undef VOCC_PART_BINARY
#undef VOCC_PART_TERNARY

#endif
