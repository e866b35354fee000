/* Sixteen floats in an AVX-512 register.  The interface that all wide_*.h
 * have:
 * - wfloat, 16 lanes; masks are the low 16 bits of an unsigned, lane 0 lowest;
 * - pfloat, VOCC_PART lanes of a wfloat, as many as a register has, with the
 *   same operations, p for w: where 16 lanes in several registers would be too
 *   many of them, loops go over the parts;
 * - wfma(a, b, c) is a * b + c, with one rounding or two: what is computed with
 *   it has to allow for either; wnfma(a, b, c) is c - a * b;
 * - wmin and wmax give b where a lane is NaN;
 * - comparisons with NaN are false;
 * - wpack_places writes first + lane of the lanes picked, likewise.
 * - wpack and wpack_numbers move the lanes that wpick_lanes has picked to the
 *   front of `to`, where 16 values may be written. */
#ifndef VOCC_WIDE_AVX512_H
#define VOCC_WIDE_AVX512_H

#include "platform.h"

#include <immintrin.h>

typedef __m512 wfloat;

VOCC_INLINE wfloat wload(const float *p)
{
    return _mm512_loadu_ps(p);
}

VOCC_INLINE void wstore(float *p, wfloat a)
{
    _mm512_storeu_ps(p, a);
}

VOCC_INLINE wfloat wset(float x)
{
    return _mm512_set1_ps(x);
}

VOCC_INLINE wfloat wadd(wfloat a, wfloat b)
{
    return _mm512_add_ps(a, b);
}

VOCC_INLINE wfloat wsub(wfloat a, wfloat b)
{
    return _mm512_sub_ps(a, b);
}

VOCC_INLINE wfloat wmul(wfloat a, wfloat b)
{
    return _mm512_mul_ps(a, b);
}

VOCC_INLINE wfloat wdiv(wfloat a, wfloat b)
{
    return _mm512_div_ps(a, b);
}

VOCC_INLINE wfloat wfma(wfloat a, wfloat b, wfloat c)
{
    return _mm512_fmadd_ps(a, b, c);
}

VOCC_INLINE wfloat wnfma(wfloat a, wfloat b, wfloat c)
{
    return _mm512_fnmadd_ps(a, b, c);
}

VOCC_INLINE wfloat wmin(wfloat a, wfloat b)
{
    return _mm512_min_ps(a, b);
}

VOCC_INLINE wfloat wmax(wfloat a, wfloat b)
{
    return _mm512_max_ps(a, b);
}

VOCC_INLINE wfloat wabs(wfloat a)
{
    return _mm512_abs_ps(a);
}

VOCC_INLINE unsigned wlt(wfloat a, wfloat b)
{
    return _mm512_cmp_ps_mask(a, b, _CMP_LT_OQ);
}

VOCC_INLINE unsigned wle(wfloat a, wfloat b)
{
    return _mm512_cmp_ps_mask(a, b, _CMP_LE_OQ);
}

/* `yes` where the bit is set, else `no`. */
VOCC_INLINE wfloat wselect(unsigned bits, wfloat yes, wfloat no)
{
    return _mm512_mask_blend_ps((__mmask16)bits, no, yes);
}

typedef __mmask16 wpick;

VOCC_INLINE wpick wpick_lanes(unsigned bits)
{
    return (__mmask16)bits;
}

/* Through a register: compressing stores are slow on some machines. */
VOCC_INLINE void wpack(float *to, const float *from, wpick p)
{
    _mm512_storeu_ps(to, _mm512_maskz_compress_ps(p, _mm512_loadu_ps(from)));
}

VOCC_INLINE void wpack_numbers(uint32_t *to, const uint32_t *from, wpick p)
{
    _mm512_storeu_si512(
        to, _mm512_maskz_compress_epi32(p, _mm512_loadu_si512(from)));
}

VOCC_INLINE void wpack_places(uint16_t *to, int first, wpick p)
{
    const __m512i lanes =
        _mm512_setr_epi32(0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15);
    _mm256_storeu_si256(
        (__m256i *)to,
        _mm512_cvtepi32_epi16(_mm512_maskz_compress_epi32(
            p, _mm512_add_epi32(lanes, _mm512_set1_epi32(first)))));
}

/* The smallest and the largest lane; no lane is NaN. */
VOCC_INLINE float wlowest(wfloat a)
{
    return _mm512_reduce_min_ps(a);
}

VOCC_INLINE float whighest(wfloat a)
{
    return _mm512_reduce_max_ps(a);
}

#include "wide_whole.h"

#endif
