/* Four floats in a NEON register of aarch64; see simd_plain.h for what each
 * does. */
#include <arm_neon.h>

typedef float32x4_t vfloat;

#define VOCC_LANE_BINARY(name, expression)                                     \
    VOCC_INLINE vfloat name(vfloat a, vfloat b)                                \
    {                                                                          \
        return expression;                                                     \
    }

#define VOCC_LANE_COMPARE(name, intrinsic)                                     \
    VOCC_INLINE unsigned name(vfloat a, vfloat b)                              \
    {                                                                          \
        return vocc_mask_bits(intrinsic(a, b));                                \
    }

/* One bit for each lane of a mask, whose lanes are all ones or all zeros. */
VOCC_INLINE unsigned vocc_mask_bits(uint32x4_t mask)
{
    static const uint32_t bits[4] = {1, 2, 4, 8};
    return vaddvq_u32(vandq_u32(mask, vld1q_u32(bits)));
}

/* Not vminq_f32 and vmaxq_f32, which give NaN if either is. */
VOCC_LANE_BINARY(vadd, vaddq_f32(a, b))
VOCC_LANE_BINARY(vsub, vsubq_f32(a, b))
VOCC_LANE_BINARY(vmul, vmulq_f32(a, b))
VOCC_LANE_BINARY(vdiv, vdivq_f32(a, b))
VOCC_LANE_BINARY(vmin, vbslq_f32(vcltq_f32(a, b), a, b))
VOCC_LANE_BINARY(vmax, vbslq_f32(vcgtq_f32(a, b), a, b))
VOCC_LANE_COMPARE(vle, vcleq_f32)
VOCC_LANE_COMPARE(vlt, vcltq_f32)
VOCC_LANE_COMPARE(veq, vceqq_f32)

VOCC_INLINE vfloat vload(const float *p)
{
    return vld1q_f32(p);
}

VOCC_INLINE void vstore(float *p, vfloat a)
{
    vst1q_f32(p, a);
}

VOCC_INLINE vfloat vset(float x)
{
    return vdupq_n_f32(x);
}

VOCC_INLINE vfloat vabs(vfloat a)
{
    return vabsq_f32(a);
}

VOCC_INLINE vfloat vneg(vfloat a)
{
    return vnegq_f32(a);
}

VOCC_INLINE vfloat vtally(vfloat count, vfloat a, vfloat b)
{
    const uint32x4_t one = vreinterpretq_u32_f32(vdupq_n_f32(1.0f));
    return vaddq_f32(count,
                     vreinterpretq_f32_u32(vandq_u32(vcltq_f32(a, b), one)));
}

VOCC_INLINE vfloat vpick(vfloat a, vfloat b, vfloat yes, vfloat no)
{
    return vbslq_f32(vcltq_f32(a, b), yes, no);
}

VOCC_INLINE void vstore_whole(uint32_t *p, vfloat a)
{
    vst1q_u32(p, vcvtq_u32_f32(a));
}

VOCC_INLINE unsigned vsigns(vfloat a)
{
    return vocc_mask_bits(vcltzq_s32(vreinterpretq_s32_f32(a)));
}

VOCC_INLINE vfloat vflip(vfloat a, vfloat b)
{
    const uint32x4_t sign = vdupq_n_u32(0x80000000u);
    return vreinterpretq_f32_u32(veorq_u32(
        vreinterpretq_u32_f32(a), vandq_u32(vreinterpretq_u32_f32(b), sign)));
}

/* Lanes y, z, x, (any) of a. */
VOCC_INLINE float32x4_t vocc_rotate_xyz(float32x4_t a)
{
    return vcopyq_laneq_f32(vextq_f32(a, a, 1), 2, a, 0);
}

/* Lanes z, x, y, (any) of a x b. */
VOCC_INLINE float32x4_t vocc_cross_zxy(float32x4_t a, float32x4_t b)
{
    return vsubq_f32(vmulq_f32(a, vocc_rotate_xyz(b)),
                     vmulq_f32(vocc_rotate_xyz(a), b));
}

VOCC_INLINE void vcrosses(const float *c, const float org[4], vfloat n[9])
{
    const float32x4_t o = vld1q_f32(org);
    const float32x4_t a = vsubq_f32(vld1q_f32(c), o),
                      b = vsubq_f32(vld1q_f32(c + 3), o),
                      d = vsubq_f32(vld1q_f32(c + 6), o);
    const float32x4_t u = vocc_cross_zxy(b, d), v = vocc_cross_zxy(d, a),
                      w = vocc_cross_zxy(a, b);
    n[0] = vdupq_laneq_f32(u, 1);
    n[1] = vdupq_laneq_f32(u, 2);
    n[2] = vdupq_laneq_f32(u, 0);
    n[3] = vdupq_laneq_f32(v, 1);
    n[4] = vdupq_laneq_f32(v, 2);
    n[5] = vdupq_laneq_f32(v, 0);
    n[6] = vdupq_laneq_f32(w, 1);
    n[7] = vdupq_laneq_f32(w, 2);
    n[8] = vdupq_laneq_f32(w, 0);
}

#undef VOCC_LANE_BINARY
#undef VOCC_LANE_COMPARE
