/* VOCC_LANES floats in plain C: the reference of the SIMD kernels.  The same
 * operations with the same roundings, so the same bits.
 *
 * vmin and vmax give their second operand if either is NaN, as minps and maxps
 * do; comparisons with NaN are false.  Comparisons give one bit a lane. */
#ifndef VOCC_LANES
#error "define VOCC_LANES first"
#endif

typedef struct vfloat {
    float f[VOCC_LANES];
} vfloat;

#define VOCC_LANE_LOOP for (lane = 0; lane < VOCC_LANES; lane++)

#define VOCC_LANE_BINARY(name, expression)                                     \
    VOCC_INLINE vfloat name(vfloat a, vfloat b)                                \
    {                                                                          \
        vfloat r;                                                              \
        int lane;                                                              \
        VOCC_LANE_LOOP                                                         \
        {                                                                      \
            const float x = a.f[lane], y = b.f[lane];                          \
            r.f[lane] = (expression);                                          \
        }                                                                      \
        return r;                                                              \
    }

#define VOCC_LANE_COMPARE(name, expression)                                    \
    VOCC_INLINE unsigned name(vfloat a, vfloat b)                              \
    {                                                                          \
        unsigned bits = 0;                                                     \
        int lane;                                                              \
        VOCC_LANE_LOOP                                                         \
        {                                                                      \
            const float x = a.f[lane], y = b.f[lane];                          \
            bits |= (unsigned)(expression) << lane;                            \
        }                                                                      \
        return bits;                                                           \
    }

VOCC_LANE_BINARY(vadd, x + y)
VOCC_LANE_BINARY(vsub, x - y)
VOCC_LANE_BINARY(vmul, x *y)
VOCC_LANE_BINARY(vdiv, x / y)
VOCC_LANE_BINARY(vmin, x < y ? x : y)
VOCC_LANE_BINARY(vmax, x > y ? x : y)
VOCC_LANE_COMPARE(vle, x <= y)
VOCC_LANE_COMPARE(vlt, x < y)
VOCC_LANE_COMPARE(veq, x == y)

VOCC_INLINE vfloat vload(const float *p)
{
    vfloat r;
    int lane;
    VOCC_LANE_LOOP r.f[lane] = p[lane];
    return r;
}

VOCC_INLINE void vstore(float *p, vfloat a)
{
    int lane;
    VOCC_LANE_LOOP p[lane] = a.f[lane];
}

VOCC_INLINE vfloat vset(float x)
{
    vfloat r;
    int lane;
    VOCC_LANE_LOOP r.f[lane] = x;
    return r;
}

VOCC_INLINE vfloat vabs(vfloat a)
{
    int lane;
    VOCC_LANE_LOOP a.f[lane] = vocc_absf(a.f[lane]);
    return a;
}

VOCC_INLINE vfloat vneg(vfloat a)
{
    int lane;
    VOCC_LANE_LOOP a.f[lane] = -a.f[lane];
    return a;
}

/* count, and one more where a < b. */
VOCC_INLINE vfloat vtally(vfloat count, vfloat a, vfloat b)
{
    int lane;
    VOCC_LANE_LOOP count.f[lane] += a.f[lane] < b.f[lane] ? 1.0f : 0.0f;
    return count;
}

/* `yes` where a < b, else `no`. */
VOCC_INLINE vfloat vpick(vfloat a, vfloat b, vfloat yes, vfloat no)
{
    int lane;
    VOCC_LANE_LOOP no.f[lane] =
        a.f[lane] < b.f[lane] ? yes.f[lane] : no.f[lane];
    return no;
}

/* Rounds numbers from 0 to 2^31 down. */
VOCC_INLINE void vstore_whole(uint32_t *p, vfloat a)
{
    int lane;
    VOCC_LANE_LOOP p[lane] = (uint32_t)a.f[lane];
}

/* One bit a lane: the sign bit. */
VOCC_INLINE unsigned vsigns(vfloat a)
{
    unsigned bits = 0;
    int lane;
    VOCC_LANE_LOOP
    {
        uint32_t u;
        memcpy(&u, &a.f[lane], sizeof u);
        bits |= (unsigned)(u >> 31) << lane;
    }
    return bits;
}

/* a with its sign flipped where b is negative (sign bit). */
VOCC_INLINE vfloat vflip(vfloat a, vfloat b)
{
    int lane;
    VOCC_LANE_LOOP
    {
        uint32_t u;
        memcpy(&u, &b.f[lane], sizeof u);
        a.f[lane] = u >> 31 ? -a.f[lane] : a.f[lane];
    }
    return a;
}

/* For one origin in all lanes: B x C, C x A, A x B, where A, B, C are the
 * corners c[0..2], c[3..5], c[6..8] less org.  May read c[9]. */
VOCC_INLINE void vcrosses(const float *c, const float org[4], vfloat n[9])
{
    float m[3][3];
    int i, k;
    for (i = 0; i < 3; i++)
        for (k = 0; k < 3; k++)
            m[i][k] = c[3 * i + k] - org[k];
    for (i = 0; i < 3; i++)
        for (k = 0; k < 3; k++) {
            const float *a = m[(i + 1) % 3], *b = m[(i + 2) % 3];
            const int y = (k + 1) % 3, z = (k + 2) % 3;
            n[3 * i + k] = vset(a[y] * b[z] - a[z] * b[y]);
        }
}

#undef VOCC_LANE_LOOP
#undef VOCC_LANE_BINARY
#undef VOCC_LANE_COMPARE
