/* Sixteen floats in four NEON registers of aarch64; see wide_plain.h for what
 * each operation does. */
#ifndef VOCC_WIDE_NEON_H
#define VOCC_WIDE_NEON_H

#include "platform.h"
#include "wide_pick.h"

#include <arm_neon.h>

typedef float32x4_t pfloat;
enum { VOCC_PART = 4, VOCC_PART_BITS = 0xf };

typedef struct wfloat {
    pfloat a, b, c, d;
} wfloat;

#define VOCC_WIDE_BINARY(name, function)                                       \
    VOCC_INLINE pfloat p##name(pfloat x, pfloat y)                             \
    {                                                                          \
        return function(x, y);                                                 \
    }                                                                          \
    VOCC_INLINE wfloat w##name(wfloat x, wfloat y)                             \
    {                                                                          \
        wfloat r;                                                              \
        r.a = function(x.a, y.a);                                              \
        r.b = function(x.b, y.b);                                              \
        r.c = function(x.c, y.c);                                              \
        r.d = function(x.d, y.d);                                              \
        return r;                                                              \
    }

/* The intrinsics have the sum's other term first. */
#define VOCC_WIDE_TERNARY(name, intrinsic)                                     \
    VOCC_INLINE pfloat p##name(pfloat x, pfloat y, pfloat z)                   \
    {                                                                          \
        return intrinsic(z, x, y);                                             \
    }                                                                          \
    VOCC_INLINE wfloat w##name(wfloat x, wfloat y, wfloat z)                   \
    {                                                                          \
        wfloat r;                                                              \
        r.a = intrinsic(z.a, x.a, y.a);                                        \
        r.b = intrinsic(z.b, x.b, y.b);                                        \
        r.c = intrinsic(z.c, x.c, y.c);                                        \
        r.d = intrinsic(z.d, x.d, y.d);                                        \
        return r;                                                              \
    }

#define VOCC_WIDE_COMPARE(name, intrinsic)                                     \
    VOCC_INLINE unsigned p##name(pfloat x, pfloat y)                           \
    {                                                                          \
        return vocc_part_bits(intrinsic(x, y));                                \
    }                                                                          \
    VOCC_INLINE unsigned w##name(wfloat x, wfloat y)                           \
    {                                                                          \
        return vocc_wide_bits(intrinsic(x.a, y.a), intrinsic(x.b, y.b),        \
                              intrinsic(x.c, y.c), intrinsic(x.d, y.d));       \
    }

/* Not vminq_f32 and vmaxq_f32, which give NaN if either is. */
VOCC_INLINE float32x4_t vocc_wide_min(float32x4_t x, float32x4_t y)
{
    return vbslq_f32(vcltq_f32(x, y), x, y);
}

VOCC_INLINE float32x4_t vocc_wide_max(float32x4_t x, float32x4_t y)
{
    return vbslq_f32(vcgtq_f32(x, y), x, y);
}

/* One bit for each lane of masks, whose lanes are all ones or all zeros: of
 * each the low byte, its bit, and sums of eight. */
VOCC_INLINE unsigned vocc_wide_bits(uint32x4_t a, uint32x4_t b, uint32x4_t c,
                                    uint32x4_t d)
{
    static const uint8_t each[16] = {1, 2, 4, 8, 16, 32, 64, 128,
                                     1, 2, 4, 8, 16, 32, 64, 128};
    const uint16x8_t low = vuzp1q_u16(vreinterpretq_u16_u32(a),
                                      vreinterpretq_u16_u32(b)),
                     high = vuzp1q_u16(vreinterpretq_u16_u32(c),
                                       vreinterpretq_u16_u32(d));
    const uint8x16_t bits = vandq_u8(
        vuzp1q_u8(vreinterpretq_u8_u16(low), vreinterpretq_u8_u16(high)),
        vld1q_u8(each));
    return (unsigned)vaddv_u8(vget_low_u8(bits)) |
           (unsigned)vaddv_u8(vget_high_u8(bits)) << 8;
}

VOCC_INLINE unsigned vocc_part_bits(uint32x4_t mask)
{
    static const uint32_t each[4] = {1, 2, 4, 8};
    return vaddvq_u32(vandq_u32(mask, vld1q_u32(each)));
}

VOCC_WIDE_BINARY(add, vaddq_f32)
VOCC_WIDE_BINARY(sub, vsubq_f32)
VOCC_WIDE_BINARY(mul, vmulq_f32)
VOCC_WIDE_BINARY(div, vdivq_f32)
VOCC_WIDE_BINARY(min, vocc_wide_min)
VOCC_WIDE_BINARY(max, vocc_wide_max)
VOCC_WIDE_TERNARY(fma, vfmaq_f32)
VOCC_WIDE_TERNARY(nfma, vfmsq_f32)
VOCC_WIDE_COMPARE(lt, vcltq_f32)
VOCC_WIDE_COMPARE(le, vcleq_f32)

VOCC_INLINE pfloat pload(const float *p)
{
    return vld1q_f32(p);
}

VOCC_INLINE void pstore(float *p, pfloat x)
{
    vst1q_f32(p, x);
}

VOCC_INLINE pfloat pset(float x)
{
    return vdupq_n_f32(x);
}

VOCC_INLINE pfloat pabs(pfloat x)
{
    return vabsq_f32(x);
}

VOCC_INLINE wfloat wload(const float *p)
{
    wfloat r;
    r.a = vld1q_f32(p);
    r.b = vld1q_f32(p + 4);
    r.c = vld1q_f32(p + 8);
    r.d = vld1q_f32(p + 12);
    return r;
}

VOCC_INLINE void wstore(float *p, wfloat x)
{
    vst1q_f32(p, x.a);
    vst1q_f32(p + 4, x.b);
    vst1q_f32(p + 8, x.c);
    vst1q_f32(p + 12, x.d);
}

VOCC_INLINE wfloat wset(float x)
{
    wfloat r;
    r.a = r.b = r.c = r.d = vdupq_n_f32(x);
    return r;
}

VOCC_INLINE wfloat wabs(wfloat x)
{
    x.a = vabsq_f32(x.a);
    x.b = vabsq_f32(x.b);
    x.c = vabsq_f32(x.c);
    x.d = vabsq_f32(x.d);
    return x;
}

VOCC_INLINE pfloat pselect(unsigned bits, pfloat yes, pfloat no)
{
    static const uint32_t each[4] = {1, 2, 4, 8};
    return vbslq_f32(vtstq_u32(vdupq_n_u32(bits), vld1q_u32(each)), yes, no);
}

VOCC_INLINE float plowest(pfloat x)
{
    return vminvq_f32(x);
}

VOCC_INLINE float phighest(pfloat x)
{
    return vmaxvq_f32(x);
}

VOCC_INLINE wfloat wselect(unsigned bits, wfloat yes, wfloat no)
{
    static const uint32_t each[16] = {
        0x1,   0x2,   0x4,   0x8,   0x10,   0x20,   0x40,   0x80,
        0x100, 0x200, 0x400, 0x800, 0x1000, 0x2000, 0x4000, 0x8000};
    const uint32x4_t all = vdupq_n_u32(bits);
    wfloat r;
    r.a = vbslq_f32(vtstq_u32(all, vld1q_u32(each)), yes.a, no.a);
    r.b = vbslq_f32(vtstq_u32(all, vld1q_u32(each + 4)), yes.b, no.b);
    r.c = vbslq_f32(vtstq_u32(all, vld1q_u32(each + 8)), yes.c, no.c);
    r.d = vbslq_f32(vtstq_u32(all, vld1q_u32(each + 12)), yes.d, no.d);
    return r;
}

VOCC_INLINE float wlowest(wfloat x)
{
    return vminvq_f32(vminq_f32(vminq_f32(x.a, x.b), vminq_f32(x.c, x.d)));
}

VOCC_INLINE float whighest(wfloat x)
{
    return vmaxvq_f32(vmaxq_f32(vmaxq_f32(x.a, x.b), vmaxq_f32(x.c, x.d)));
}

#undef VOCC_WIDE_BINARY
#undef VOCC_WIDE_TERNARY
#undef VOCC_WIDE_COMPARE

#endif
