/* Sixteen floats in four SSE2 registers; see wide_plain.h for what each
 * operation does. */
#ifndef VOCC_WIDE_SSE2_H
#define VOCC_WIDE_SSE2_H

#include "platform.h"
#include "wide_pick.h"

#include <emmintrin.h>

typedef __m128 pfloat;
enum { VOCC_PART = 4, VOCC_PART_BITS = 0xf };

typedef struct wfloat {
    pfloat a, b, c, d;
} wfloat;

#define VOCC_WIDE_BINARY(name, intrinsic)                                      \
    VOCC_INLINE pfloat p##name(pfloat x, pfloat y)                             \
    {                                                                          \
        return intrinsic(x, y);                                                \
    }                                                                          \
    VOCC_INLINE wfloat w##name(wfloat x, wfloat y)                             \
    {                                                                          \
        wfloat r;                                                              \
        r.a = intrinsic(x.a, y.a);                                             \
        r.b = intrinsic(x.b, y.b);                                             \
        r.c = intrinsic(x.c, y.c);                                             \
        r.d = intrinsic(x.d, y.d);                                             \
        return r;                                                              \
    }

#define VOCC_WIDE_COMPARE(name, intrinsic)                                     \
    VOCC_INLINE unsigned p##name(pfloat x, pfloat y)                           \
    {                                                                          \
        return (unsigned)_mm_movemask_ps(intrinsic(x, y));                     \
    }                                                                          \
    VOCC_INLINE unsigned w##name(wfloat x, wfloat y)                           \
    {                                                                          \
        return vocc_wide_bits(intrinsic(x.a, y.a), intrinsic(x.b, y.b),        \
                              intrinsic(x.c, y.c), intrinsic(x.d, y.d));       \
    }

/* One bit for each lane of masks, whose lanes are all ones or all zeros:
 * saturated, they are so in fewer bits, too. */
VOCC_INLINE unsigned vocc_wide_bits(__m128 a, __m128 b, __m128 c, __m128 d)
{
    const __m128i low =
                      _mm_packs_epi32(_mm_castps_si128(a), _mm_castps_si128(b)),
                  high =
                      _mm_packs_epi32(_mm_castps_si128(c), _mm_castps_si128(d));
    return (unsigned)_mm_movemask_epi8(_mm_packs_epi16(low, high));
}

VOCC_WIDE_BINARY(add, _mm_add_ps)
VOCC_WIDE_BINARY(sub, _mm_sub_ps)
VOCC_WIDE_BINARY(mul, _mm_mul_ps)
VOCC_WIDE_BINARY(div, _mm_div_ps)
VOCC_WIDE_BINARY(min, _mm_min_ps)
VOCC_WIDE_BINARY(max, _mm_max_ps)
VOCC_WIDE_COMPARE(lt, _mm_cmplt_ps)
VOCC_WIDE_COMPARE(le, _mm_cmple_ps)

VOCC_INLINE pfloat pload(const float *p)
{
    return _mm_loadu_ps(p);
}

VOCC_INLINE void pstore(float *p, pfloat x)
{
    _mm_storeu_ps(p, x);
}

VOCC_INLINE pfloat pset(float x)
{
    return _mm_set1_ps(x);
}

VOCC_INLINE pfloat pfma(pfloat x, pfloat y, pfloat z)
{
    return _mm_add_ps(_mm_mul_ps(x, y), z);
}

VOCC_INLINE pfloat pnfma(pfloat x, pfloat y, pfloat z)
{
    return _mm_sub_ps(z, _mm_mul_ps(x, y));
}

VOCC_INLINE pfloat pabs(pfloat x)
{
    return _mm_andnot_ps(_mm_set1_ps(-0.0f), x);
}

VOCC_INLINE wfloat wload(const float *p)
{
    wfloat r;
    r.a = _mm_loadu_ps(p);
    r.b = _mm_loadu_ps(p + 4);
    r.c = _mm_loadu_ps(p + 8);
    r.d = _mm_loadu_ps(p + 12);
    return r;
}

VOCC_INLINE void wstore(float *p, wfloat x)
{
    _mm_storeu_ps(p, x.a);
    _mm_storeu_ps(p + 4, x.b);
    _mm_storeu_ps(p + 8, x.c);
    _mm_storeu_ps(p + 12, x.d);
}

VOCC_INLINE wfloat wset(float x)
{
    wfloat r;
    r.a = r.b = r.c = r.d = _mm_set1_ps(x);
    return r;
}

VOCC_INLINE wfloat wfma(wfloat x, wfloat y, wfloat z)
{
    return wadd(wmul(x, y), z);
}

VOCC_INLINE wfloat wnfma(wfloat x, wfloat y, wfloat z)
{
    return wsub(z, wmul(x, y));
}

VOCC_INLINE wfloat wabs(wfloat x)
{
    const __m128 sign = _mm_set1_ps(-0.0f);
    x.a = _mm_andnot_ps(sign, x.a);
    x.b = _mm_andnot_ps(sign, x.b);
    x.c = _mm_andnot_ps(sign, x.c);
    x.d = _mm_andnot_ps(sign, x.d);
    return x;
}

/* `yes` in lanes of `wanted` whose bit is set in all lanes of `bits`. */
VOCC_INLINE __m128 vocc_wide_choose(__m128i bits, __m128i wanted, __m128 yes,
                                    __m128 no)
{
    const __m128 mask =
        _mm_castsi128_ps(_mm_cmpeq_epi32(_mm_and_si128(bits, wanted), wanted));
    return _mm_or_ps(_mm_and_ps(mask, yes), _mm_andnot_ps(mask, no));
}

VOCC_INLINE pfloat pselect(unsigned bits, pfloat yes, pfloat no)
{
    return vocc_wide_choose(_mm_set1_epi32((int)bits),
                            _mm_setr_epi32(1, 2, 4, 8), yes, no);
}

VOCC_INLINE wfloat wselect(unsigned bits, wfloat yes, wfloat no)
{
    const __m128i all = _mm_set1_epi32((int)bits);
    wfloat r;
    r.a = vocc_wide_choose(all, _mm_setr_epi32(1, 2, 4, 8), yes.a, no.a);
    r.b = vocc_wide_choose(all, _mm_setr_epi32(0x10, 0x20, 0x40, 0x80), yes.b,
                           no.b);
    r.c = vocc_wide_choose(all, _mm_setr_epi32(0x100, 0x200, 0x400, 0x800),
                           yes.c, no.c);
    r.d = vocc_wide_choose(all, _mm_setr_epi32(0x1000, 0x2000, 0x4000, 0x8000),
                           yes.d, no.d);
    return r;
}

VOCC_INLINE float plowest(pfloat x)
{
    const __m128 m = _mm_min_ps(x, _mm_movehl_ps(x, x));
    return _mm_cvtss_f32(
        _mm_min_ss(m, _mm_shuffle_ps(m, m, _MM_SHUFFLE(1, 1, 1, 1))));
}

VOCC_INLINE float phighest(pfloat x)
{
    const __m128 m = _mm_max_ps(x, _mm_movehl_ps(x, x));
    return _mm_cvtss_f32(
        _mm_max_ss(m, _mm_shuffle_ps(m, m, _MM_SHUFFLE(1, 1, 1, 1))));
}

VOCC_INLINE float wlowest(wfloat x)
{
    return plowest(_mm_min_ps(_mm_min_ps(x.a, x.b), _mm_min_ps(x.c, x.d)));
}

VOCC_INLINE float whighest(wfloat x)
{
    return phighest(_mm_max_ps(_mm_max_ps(x.a, x.b), _mm_max_ps(x.c, x.d)));
}

#undef VOCC_WIDE_BINARY
#undef VOCC_WIDE_COMPARE

#endif
