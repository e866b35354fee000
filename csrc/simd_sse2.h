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

VOCC_INLINE unsigned vsigns(vfloat a)
{
    return (unsigned)_mm_movemask_ps(a);
}

VOCC_INLINE vfloat vflip(vfloat a, vfloat b)
{
    return _mm_xor_ps(a, _mm_and_ps(_mm_set1_ps(-0.0f), b));
}

#undef VOCC_LANE_BINARY
#undef VOCC_LANE_COMPARE
