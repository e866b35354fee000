/* Sixteen floats in plain C: the reference of wide_*.h, which all have this
 * interface:
 * - wfloat, 16 lanes; masks are the low 16 bits of an unsigned, lane 0 lowest;
 * - pfloat, VOCC_PART lanes of a wfloat, as many as a register has, with the
 *   same operations, p for w: where 16 lanes in several registers would be too
 *   many of them, loops go over the parts;
 * - wfma(x, y, z) is x * y + z, with one rounding or two: what is computed with
 *   it has to allow for either; wnfma(x, y, z) is z - x * y;
 * - wmin and wmax give their second operand where either is NaN, or both are 0;
 * - comparisons with NaN are false;
 * - wpack and wpack_numbers move the lanes that wpick_lanes has picked to the
 *   front of `to`, where 16 values may be written. */
#ifndef VOCC_WIDE_PLAIN_H
#define VOCC_WIDE_PLAIN_H

#include "platform.h"
#include "wide_pick.h"

#include <string.h>

typedef struct wfloat {
    float f[16];
} wfloat;

#define VOCC_WIDE_LOOP for (lane = 0; lane < 16; lane++)

#define VOCC_WIDE_BINARY(name, expression)                                     \
    VOCC_INLINE wfloat name(wfloat a, wfloat b)                                \
    {                                                                          \
        int lane;                                                              \
        VOCC_WIDE_LOOP                                                         \
        {                                                                      \
            const float x = a.f[lane], y = b.f[lane];                          \
            a.f[lane] = (expression);                                          \
        }                                                                      \
        return a;                                                              \
    }

#define VOCC_WIDE_TERNARY(name, expression)                                    \
    VOCC_INLINE wfloat name(wfloat a, wfloat b, wfloat c)                      \
    {                                                                          \
        int lane;                                                              \
        VOCC_WIDE_LOOP                                                         \
        {                                                                      \
            const float x = a.f[lane], y = b.f[lane], z = c.f[lane];           \
            a.f[lane] = (expression);                                          \
        }                                                                      \
        return a;                                                              \
    }

#define VOCC_WIDE_COMPARE(name, expression)                                    \
    VOCC_INLINE unsigned name(wfloat a, wfloat b)                              \
    {                                                                          \
        unsigned bits = 0;                                                     \
        int lane;                                                              \
        VOCC_WIDE_LOOP                                                         \
        {                                                                      \
            const float x = a.f[lane], y = b.f[lane];                          \
            bits |= (unsigned)(expression) << lane;                            \
        }                                                                      \
        return bits;                                                           \
    }

VOCC_WIDE_BINARY(wadd, x + y)
VOCC_WIDE_BINARY(wsub, x - y)
VOCC_WIDE_BINARY(wmul, x *y)
VOCC_WIDE_BINARY(wdiv, x / y)
VOCC_WIDE_BINARY(wmin, x < y ? x : y)
VOCC_WIDE_BINARY(wmax, x > y ? x : y)
VOCC_WIDE_TERNARY(wfma, x *y + z)
VOCC_WIDE_TERNARY(wnfma, z - x * y)
VOCC_WIDE_COMPARE(wlt, x < y)
VOCC_WIDE_COMPARE(wle, x <= y)

VOCC_INLINE wfloat wload(const float *p)
{
    wfloat r;
    memcpy(r.f, p, sizeof r.f);
    return r;
}

VOCC_INLINE void wstore(float *p, wfloat a)
{
    memcpy(p, a.f, sizeof a.f);
}

VOCC_INLINE wfloat wset(float x)
{
    wfloat r;
    int lane;
    VOCC_WIDE_LOOP r.f[lane] = x;
    return r;
}

/* Without its sign bit. */
VOCC_INLINE wfloat wabs(wfloat a)
{
    int lane;
    VOCC_WIDE_LOOP
    {
        uint32_t u;
        memcpy(&u, &a.f[lane], sizeof u);
        u &= 0x7fffffffu;
        memcpy(&a.f[lane], &u, sizeof u);
    }
    return a;
}

/* `yes` where the bit is set, else `no`. */
VOCC_INLINE wfloat wselect(unsigned bits, wfloat yes, wfloat no)
{
    int lane;
    VOCC_WIDE_LOOP yes.f[lane] = bits >> lane & 1u ? yes.f[lane] : no.f[lane];
    return yes;
}

/* The smallest and the largest lane; no lane is NaN. */
VOCC_INLINE float wlowest(wfloat a)
{
    float m = a.f[0];
    int lane;
    VOCC_WIDE_LOOP m = a.f[lane] < m ? a.f[lane] : m;
    return m;
}

VOCC_INLINE float whighest(wfloat a)
{
    float m = a.f[0];
    int lane;
    VOCC_WIDE_LOOP m = a.f[lane] > m ? a.f[lane] : m;
    return m;
}

#undef VOCC_WIDE_LOOP
#undef VOCC_WIDE_BINARY
#undef VOCC_WIDE_TERNARY
#undef VOCC_WIDE_COMPARE

#include "wide_whole.h"

#endif
