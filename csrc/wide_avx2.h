/* Sixteen floats in two AVX registers, with AVX2 and FMA; see wide_plain.h for
 * what each operation does. */
#ifndef VOCC_WIDE_AVX2_H
#define VOCC_WIDE_AVX2_H

#include "platform.h"
#include "wide_pick.h"

#include <immintrin.h>

typedef __m256 pfloat;
enum { VOCC_PART = 8, VOCC_PART_BITS = 0xff };

typedef struct wfloat {
    pfloat a, b;
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
        return r;                                                              \
    }

#define VOCC_WIDE_TERNARY(name, intrinsic)                                     \
    VOCC_INLINE pfloat p##name(pfloat x, pfloat y, pfloat z)                   \
    {                                                                          \
        return intrinsic(x, y, z);                                             \
    }                                                                          \
    VOCC_INLINE wfloat w##name(wfloat x, wfloat y, wfloat z)                   \
    {                                                                          \
        wfloat r;                                                              \
        r.a = intrinsic(x.a, y.a, z.a);                                        \
        r.b = intrinsic(x.b, y.b, z.b);                                        \
        return r;                                                              \
    }

#define VOCC_WIDE_COMPARE(name, predicate)                                     \
    VOCC_INLINE unsigned p##name(pfloat x, pfloat y)                           \
    {                                                                          \
        return (unsigned)_mm256_movemask_ps(_mm256_cmp_ps(x, y, predicate));   \
    }                                                                          \
    VOCC_INLINE unsigned w##name(wfloat x, wfloat y)                           \
    {                                                                          \
        return (unsigned)_mm256_movemask_ps(                                   \
                   _mm256_cmp_ps(x.a, y.a, predicate)) |                       \
               (unsigned)_mm256_movemask_ps(                                   \
                   _mm256_cmp_ps(x.b, y.b, predicate))                         \
                   << 8;                                                       \
    }

VOCC_WIDE_BINARY(add, _mm256_add_ps)
VOCC_WIDE_BINARY(sub, _mm256_sub_ps)
VOCC_WIDE_BINARY(mul, _mm256_mul_ps)
VOCC_WIDE_BINARY(div, _mm256_div_ps)
VOCC_WIDE_BINARY(min, _mm256_min_ps)
VOCC_WIDE_BINARY(max, _mm256_max_ps)
VOCC_WIDE_TERNARY(fma, _mm256_fmadd_ps)
VOCC_WIDE_TERNARY(nfma, _mm256_fnmadd_ps)
VOCC_WIDE_COMPARE(lt, _CMP_LT_OQ)
VOCC_WIDE_COMPARE(le, _CMP_LE_OQ)

VOCC_INLINE pfloat pload(const float *p)
{
    return _mm256_loadu_ps(p);
}

VOCC_INLINE void pstore(float *p, pfloat x)
{
    _mm256_storeu_ps(p, x);
}

VOCC_INLINE pfloat pset(float x)
{
    return _mm256_set1_ps(x);
}

VOCC_INLINE pfloat pabs(pfloat x)
{
    return _mm256_andnot_ps(_mm256_set1_ps(-0.0f), x);
}

VOCC_INLINE wfloat wload(const float *p)
{
    wfloat r;
    r.a = _mm256_loadu_ps(p);
    r.b = _mm256_loadu_ps(p + 8);
    return r;
}

VOCC_INLINE void wstore(float *p, wfloat x)
{
    _mm256_storeu_ps(p, x.a);
    _mm256_storeu_ps(p + 8, x.b);
}

VOCC_INLINE wfloat wset(float x)
{
    wfloat r;
    r.a = r.b = _mm256_set1_ps(x);
    return r;
}

VOCC_INLINE wfloat wabs(wfloat x)
{
    const __m256 sign = _mm256_set1_ps(-0.0f);
    x.a = _mm256_andnot_ps(sign, x.a);
    x.b = _mm256_andnot_ps(sign, x.b);
    return x;
}

/* `yes` in lanes of `wanted` whose bit is set in all lanes of `bits`. */
VOCC_INLINE __m256 vocc_wide_choose(__m256i bits, __m256i wanted, __m256 yes,
                                    __m256 no)
{
    const __m256i mask =
        _mm256_cmpeq_epi32(_mm256_and_si256(bits, wanted), wanted);
    return _mm256_blendv_ps(no, yes, _mm256_castsi256_ps(mask));
}

VOCC_INLINE pfloat pselect(unsigned bits, pfloat yes, pfloat no)
{
    return vocc_wide_choose(
        _mm256_set1_epi32((int)bits),
        _mm256_setr_epi32(1, 2, 4, 8, 0x10, 0x20, 0x40, 0x80), yes, no);
}

VOCC_INLINE wfloat wselect(unsigned bits, wfloat yes, wfloat no)
{
    const __m256i all = _mm256_set1_epi32((int)bits);
    wfloat r;
    r.a = vocc_wide_choose(
        all, _mm256_setr_epi32(1, 2, 4, 8, 0x10, 0x20, 0x40, 0x80), yes.a,
        no.a);
    r.b = vocc_wide_choose(all,
                           _mm256_setr_epi32(0x100, 0x200, 0x400, 0x800, 0x1000,
                                             0x2000, 0x4000, 0x8000),
                           yes.b, no.b);
    return r;
}

VOCC_INLINE float plowest(pfloat x)
{
    __m128 m =
        _mm_min_ps(_mm256_castps256_ps128(x), _mm256_extractf128_ps(x, 1));
    m = _mm_min_ps(m, _mm_movehl_ps(m, m));
    return _mm_cvtss_f32(_mm_min_ss(m, _mm_movehdup_ps(m)));
}

VOCC_INLINE float phighest(pfloat x)
{
    __m128 m =
        _mm_max_ps(_mm256_castps256_ps128(x), _mm256_extractf128_ps(x, 1));
    m = _mm_max_ps(m, _mm_movehl_ps(m, m));
    return _mm_cvtss_f32(_mm_max_ss(m, _mm_movehdup_ps(m)));
}

VOCC_INLINE float wlowest(wfloat x)
{
    return plowest(_mm256_min_ps(x.a, x.b));
}

VOCC_INLINE float whighest(wfloat x)
{
    return phighest(_mm256_max_ps(x.a, x.b));
}

#undef VOCC_WIDE_BINARY
#undef VOCC_WIDE_TERNARY
#undef VOCC_WIDE_COMPARE

#endif
