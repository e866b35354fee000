/* Four floats in an SSE2 register; see simd_plain.h for what each does. */
#include <emmintrin.h>

typedef __m128 vfloat;

#define VOCC_LANE_BINARY(name, intrinsic)                                      \
    VOCC_INLINE vfloat name(vfloat a, vfloat b)                                \
    {                                                                          \
        return intrinsic(a, b);                                                \
    }

#define VOCC_LANE_COMPARE(name, intrinsic)                                     \
    VOCC_INLINE unsigned name(vfloat a, vfloat b)                              \
    {                                                                          \
        return (unsigned)_mm_movemask_ps(intrinsic(a, b));                     \
    }

VOCC_LANE_BINARY(vadd, _mm_add_ps)
VOCC_LANE_BINARY(vsub, _mm_sub_ps)
VOCC_LANE_BINARY(vmul, _mm_mul_ps)
VOCC_LANE_BINARY(vdiv, _mm_div_ps)
VOCC_LANE_BINARY(vmin, _mm_min_ps)
VOCC_LANE_BINARY(vmax, _mm_max_ps)
VOCC_LANE_COMPARE(vle, _mm_cmple_ps)
VOCC_LANE_COMPARE(vlt, _mm_cmplt_ps)
VOCC_LANE_COMPARE(veq, _mm_cmpeq_ps)

VOCC_INLINE vfloat vload(const float *p)
{
    return _mm_loadu_ps(p);
}

VOCC_INLINE void vstore(float *p, vfloat a)
{
    _mm_storeu_ps(p, a);
}

VOCC_INLINE vfloat vset(float x)
{
    return _mm_set1_ps(x);
}

VOCC_INLINE vfloat vabs(vfloat a)
{
    return _mm_andnot_ps(_mm_set1_ps(-0.0f), a);
}

VOCC_INLINE vfloat vneg(vfloat a)
{
    return _mm_xor_ps(_mm_set1_ps(-0.0f), a);
}

VOCC_INLINE vfloat vtally(vfloat count, vfloat a, vfloat b)
{
    return _mm_add_ps(count, _mm_and_ps(_mm_cmplt_ps(a, b), _mm_set1_ps(1.0f)));
}

VOCC_INLINE vfloat vpick(vfloat a, vfloat b, vfloat yes, vfloat no)
{
    const __m128 mask = _mm_cmplt_ps(a, b);
    return _mm_or_ps(_mm_and_ps(mask, yes), _mm_andnot_ps(mask, no));
}

VOCC_INLINE void vstore_whole(uint32_t *p, vfloat a)
{
    _mm_storeu_si128((__m128i *)p, _mm_cvttps_epi32(a));
}

VOCC_INLINE unsigned vsigns(vfloat a)
{
    return (unsigned)_mm_movemask_ps(a);
}

VOCC_INLINE vfloat vflip(vfloat a, vfloat b)
{
    return _mm_xor_ps(a, _mm_and_ps(_mm_set1_ps(-0.0f), b));
}

/* The lanes of a in the order i, j, k, l. */
#define VOCC_SHUFFLE(a, i, j, k, l)                                            \
    _mm_shuffle_ps((a), (a), _MM_SHUFFLE(l, k, j, i))

VOCC_INLINE __m128 vocc_cross_xyz(__m128 a, __m128 b)
{
    const __m128 a1 = VOCC_SHUFFLE(a, 1, 2, 0, 3),
                 a2 = VOCC_SHUFFLE(a, 2, 0, 1, 3),
                 b1 = VOCC_SHUFFLE(b, 1, 2, 0, 3),
                 b2 = VOCC_SHUFFLE(b, 2, 0, 1, 3);
    return _mm_sub_ps(_mm_mul_ps(a1, b2), _mm_mul_ps(a2, b1));
}

VOCC_INLINE void vcrosses(const float *c, const float org[4], vfloat n[9])
{
    const __m128 o = _mm_load_ps(org);
    const __m128 a = _mm_sub_ps(_mm_loadu_ps(c), o),
                 b = _mm_sub_ps(_mm_loadu_ps(c + 3), o),
                 d = _mm_sub_ps(_mm_loadu_ps(c + 6), o);
    const __m128 u = vocc_cross_xyz(b, d), v = vocc_cross_xyz(d, a),
                 w = vocc_cross_xyz(a, b);
    n[0] = VOCC_SHUFFLE(u, 0, 0, 0, 0);
    n[1] = VOCC_SHUFFLE(u, 1, 1, 1, 1);
    n[2] = VOCC_SHUFFLE(u, 2, 2, 2, 2);
    n[3] = VOCC_SHUFFLE(v, 0, 0, 0, 0);
    n[4] = VOCC_SHUFFLE(v, 1, 1, 1, 1);
    n[5] = VOCC_SHUFFLE(v, 2, 2, 2, 2);
    n[6] = VOCC_SHUFFLE(w, 0, 0, 0, 0);
    n[7] = VOCC_SHUFFLE(w, 1, 1, 1, 1);
    n[8] = VOCC_SHUFFLE(w, 2, 2, 2, 2);
}

#undef VOCC_SHUFFLE
#undef VOCC_LANE_BINARY
#undef VOCC_LANE_COMPARE
