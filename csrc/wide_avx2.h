/* Sixteen floats in two AVX registers, with AVX2 and FMA; see wide_plain.h for
 * what each operation does. */
#ifndef VOCC_WIDE_AVX2_H
#define VOCC_WIDE_AVX2_H

#include "platform.h"
#include "wide_pick.h"

#include <immintrin.h>

typedef struct wfloat {
    __m256 a, b;
} wfloat;

#define VOCC_WIDE_BINARY(name, intrinsic)                                      \
    VOCC_INLINE wfloat name(wfloat x, wfloat y)                                \
    {                                                                          \
        wfloat r;                                                              \
        r.a = intrinsic(x.a, y.a);                                             \
        r.b = intrinsic(x.b, y.b);                                             \
        return r;                                                              \
    }

#define VOCC_WIDE_TERNARY(name, intrinsic)                                     \
    VOCC_INLINE wfloat name(wfloat x, wfloat y, wfloat z)                      \
    {                                                                          \
        wfloat r;                                                              \
        r.a = intrinsic(x.a, y.a, z.a);                                        \
        r.b = intrinsic(x.b, y.b, z.b);                                        \
        return r;                                                              \
    }

#define VOCC_WIDE_COMPARE(name, predicate)                                     \
    VOCC_INLINE unsigned name(wfloat x, wfloat y)                              \
    {                                                                          \
        return (unsigned)_mm256_movemask_ps(                                   \
                   _mm256_cmp_ps(x.a, y.a, predicate)) |                       \
               (unsigned)_mm256_movemask_ps(                                   \
                   _mm256_cmp_ps(x.b, y.b, predicate))                         \
                   << 8;                                                       \
    }

VOCC_WIDE_BINARY(wadd, _mm256_add_ps)
VOCC_WIDE_BINARY(wsub, _mm256_sub_ps)
VOCC_WIDE_BINARY(wmul, _mm256_mul_ps)
VOCC_WIDE_BINARY(wdiv, _mm256_div_ps)
VOCC_WIDE_BINARY(wmin, _mm256_min_ps)
VOCC_WIDE_BINARY(wmax, _mm256_max_ps)
VOCC_WIDE_TERNARY(wfma, _mm256_fmadd_ps)
VOCC_WIDE_TERNARY(wnfma, _mm256_fnmadd_ps)
VOCC_WIDE_COMPARE(wlt, _CMP_LT_OQ)
VOCC_WIDE_COMPARE(wle, _CMP_LE_OQ)

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

VOCC_INLINE float wlowest(wfloat x)
{
    const __m256 half = _mm256_min_ps(x.a, x.b);
    __m128 m = _mm_min_ps(_mm256_castps256_ps128(half),
                          _mm256_extractf128_ps(half, 1));
    m = _mm_min_ps(m, _mm_movehl_ps(m, m));
    return _mm_cvtss_f32(_mm_min_ss(m, _mm_movehdup_ps(m)));
}

VOCC_INLINE float whighest(wfloat x)
{
    const __m256 half = _mm256_max_ps(x.a, x.b);
    __m128 m = _mm_max_ps(_mm256_castps256_ps128(half),
                          _mm256_extractf128_ps(half, 1));
    m = _mm_max_ps(m, _mm_movehl_ps(m, m));
    return _mm_cvtss_f32(_mm_max_ss(m, _mm_movehdup_ps(m)));
}

#undef VOCC_WIDE_BINARY
#undef VOCC_WIDE_TERNARY
#undef VOCC_WIDE_COMPARE

#endif
