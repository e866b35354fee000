#include "beam.h"
#include "frame.h"
#include "vec3.h"

#include <math.h>
#include <string.h>

/* Coordinates, in units of which the bounds of beam_body.inc hold: products of
 * three lie within 2^-90 .. 2^93. */
#define MAX_SIZE 0x1p30
#define MIN_SIZE 0x1p-30

/* The slices are widened by so much of the largest coordinate: beam_body.inc
 * finds t within 4 u, and what it compares is as far off. */
#define WIDER 0x1p-19

#define MAX_INVERSE 1e30

static float up(double x)
{
    return (float)(x + vocc_abs(x) * 0x1p-22);
}

static float down(double x)
{
    return (float)(x - vocc_abs(x) * 0x1p-22);
}

static double larger(double a, double b)
{
    return a > b ? a : b;
}

static float inverse(double step)
{
    const double x = 1.0 / step;
    return (float)(x > MAX_INVERSE    ? MAX_INVERSE
                   : x < -MAX_INVERSE ? -MAX_INVERSE
                                      : x);
}

int vocc_beam_limits(vocc_beam *b, const double reach[3],
                     const vocc_target *target)
{
    double size = (double)b->tree->scale, length;
    int k;
    for (k = 0; k < 3; k++)
        size = larger(size, reach[k]);
    length = target->is_direction ? 4.0 * size : 1.0;
    for (k = 0; k < 3; k++)
        size = larger(size, length * larger(vocc_abs(target->lower[k]),
                                            vocc_abs(target->upper[k])));
    b->size = up(size);
    b->margin = up(WIDER * size);
    b->is_direction = target->is_direction;
    return size <= MAX_SIZE && size >= MIN_SIZE;
}

/* Normals that tell how the points lie. */
enum { SOME_NORMALS = 8 };

/* A box around the points whose third axis is about their mean normal: thin
 * where they lie in a plane. */
void vocc_beam_set_points(vocc_beam *b, const vocc_beam_kernels *kernels,
                          const double (*normal)[3], const uint16_t *which)
{
    /* The axes, the coordinates along them and the centre are rounded. */
    const double margin = 0x1p-21 * (double)b->size;
    const size_t step = b->count / SOME_NORMALS + 1;
    double axis[3][3], sum[3] = {0.0, 0.0, 0.0}, middle[3], half[3],
                       reach = 0.0;
    float rounded[3][3], low[3], high[3];
    size_t i;
    int k, j;
    for (i = 0; i < b->count; i += step)
        for (k = 0; k < 3; k++)
            sum[k] += normal[which[i]][k];
    if (!vocc_normalize(sum, axis[2])) {
        axis[2][0] = axis[2][1] = 0.0;
        axis[2][2] = 1.0;
    }
    vocc_make_frame(axis[2], axis[0], axis[1]);
    for (j = 0; j < 3; j++)
        for (k = 0; k < 3; k++)
            rounded[j][k] = (float)axis[j][k];
    for (k = 0; k < 3; k++)
        for (i = b->count; i % VOCC_WIDE; i++)
            b->point[k][i] = b->point[k][0];
    kernels->measure(b, rounded, low, high);
    for (j = 0; j < 3; j++) {
        middle[j] = 0.5 * ((double)low[j] + (double)high[j]);
        half[j] =
            0.5 * ((double)high[j] - (double)low[j]) * (1.0 + 0x1p-19) + margin;
    }
    for (k = 0; k < 3; k++) {
        double centre = (double)b->point[k][0];
        for (j = 0; j < 3; j++) {
            centre += middle[j] * axis[j][k];
            b->axis[j][k] = (float)(half[j] * axis[j][k]);
            reach += vocc_abs(half[j] * axis[j][k]);
        }
        b->centre[k] = (float)centre;
    }
    b->reach = up(reach);
}

/* Corner i & 1 << j of the target's hull is at the end of axis j. */
void vocc_beam_hull_frame(const vocc_target *target, vocc_end_frame *frame)
{
    const int axes = target->corners == 4 ? 2 : 3;
    int j, k;
    for (k = 0; k < 3; k++) {
        frame->origin[k] = (double)target->corner[0][k];
        frame->axis[2][k] = 0.0;
        for (j = 0; j < axes; j++)
            frame->axis[j][k] =
                (double)target->corner[1 << j][k] - frame->origin[k];
    }
}

/* Half axes of a part of the ends, and its centre. */
static void set_part(const vocc_end_frame *frame, const double low[3],
                     const double high[3], double axis[3][3], double centre[3])
{
    int j, k;
    for (k = 0; k < 3; k++) {
        centre[k] = frame->origin[k];
        for (j = 0; j < 3; j++) {
            axis[j][k] = 0.5 * (high[j] - low[j]) * frame->axis[j][k];
            centre[k] += 0.5 * (low[j] + high[j]) * frame->axis[j][k];
        }
    }
}

/* Bounds of |o x x|, o one of the points and x from the centre to an end. */
static void set_twist(vocc_beam *b, double axis[3][3], double slack)
{
    double o[3][3], size[3], twist[3];
    int i, j, k;
    for (i = 0; i < 3; i++)
        for (k = 0; k < 3; k++)
            o[i][k] = (double)b->axis[i][k];
    for (k = 0; k < 3; k++)
        size[k] = vocc_abs(o[0][k]) + vocc_abs(o[1][k]) + vocc_abs(o[2][k]);
    for (k = 0; k < 3; k++)
        twist[k] = slack * (size[(k + 1) % 3] + size[(k + 2) % 3]);
    for (j = 0; j < 3; j++)
        for (i = 0; i < 3; i++) {
            double cross[3];
            vocc_cross(o[i], axis[j], cross);
            for (k = 0; k < 3; k++)
                twist[k] += vocc_abs(cross[k]);
        }
    for (k = 0; k < 3; k++)
        b->twist[k] = up(twist[k]);
}

void vocc_beam_set_end(vocc_beam *b, const vocc_target *target,
                       const vocc_end_frame *frame, const double low[3],
                       const double high[3])
{
    const int is_direction = target->is_direction;
    const double margin = (double)b->margin, size = (double)b->size,
                 slack = target->slack + 0x1p-22 * size;
    /* From a point no triangle is farther than sqrt(3) times 2 size. */
    const double length = is_direction ? 4.0 * size : 1.0;
    double axis[3][3], centre[3], reach = slack, width = 0.0;
    int j, k;
    set_part(frame, low, high, axis, centre);
    set_twist(b, axis, slack);
    for (j = 0; j < 3; j++)
        for (k = 0; k < 3; k++)
            b->end_axis[j][k] = (float)axis[j][k];
    for (k = 0; k < 3; k++) {
        const double spread = vocc_abs(axis[0][k]) + vocc_abs(axis[1][k]),
                     rest = vocc_abs(axis[2][k]), half = slack + spread + rest,
                     end_lower = larger(centre[k] - half, target->lower[k]),
                     end_upper = -larger(-centre[k] - half, -target->upper[k]),
                     end = is_direction ? centre[k]
                                        : centre[k] - (double)b->centre[k];
        /* Points and ends, and the steps between them, widened. */
        const double base_lower = (double)b->lower[k],
                     base_upper = (double)b->upper[k],
                     most_lower =
                         length * end_lower + (is_direction ? base_lower : 0.0),
                     most_upper =
                         length * end_upper + (is_direction ? base_upper : 0.0),
                     least = is_direction ? end_lower : end_lower - base_upper,
                     most = is_direction ? end_upper : end_upper - base_lower;
        for (j = 0; j < 2; j++)
            b->far_axis[j][k] = (float)(length * axis[j][k]);
        b->far_rest[k] = up(length * (slack + rest) + 0x1p-20 * size);
        b->far_middle[k] = (float)(length * centre[k]);
        b->end[k] = (float)end;
        width = larger(width, 2.0 * length * half);
        reach += spread + rest + vocc_abs(end);
        b->far_lower[k] = down(length * end_lower);
        b->far_upper[k] = up(length * end_upper);
        b->slice_lower[k] = down(base_lower - margin);
        b->slice_upper[k] = up(base_upper + margin);
        b->step_lower[k] =
            inverse(most_lower - margin - (double)b->slice_lower[k]);
        b->step_upper[k] =
            inverse(most_upper + margin - (double)b->slice_upper[k]);
        b->way[k] = (float)(0.5 * (least + most));
        b->way_half[k] = up(0.5 * (most - least) + 0x1p-22 * size);
    }
    b->end_width = (float)width;
    b->end_slack = up(slack);
    /* Segments from any of the points are not longer. */
    b->end_reach = up(reach + (double)b->reach);
}

int vocc_beam_limit_domes(vocc_beam *b, const double reach[3])
{
    double size = (double)b->tree->scale;
    int k;
    for (k = 0; k < 3; k++)
        size = larger(size, reach[k]);
    b->size = up(size);
    return size <= MAX_SIZE && size >= MIN_SIZE;
}

/* For a point p with the unit normal n, and x on one of its rays,
 *     w . x >= w . p - |w - n| |x - p| + n . (x - p).
 * With u = 2^-24, S the size and |dir| < 1 + 8 u: directions are rounded once
 * on each axis, so that n . dir is above -2 u; a triangle is less than 4 S
 * away, and n . (x - p) above -8 u S.  w is rounded (4 u S), its product with a
 * corner has up to 3 roundings (6 u S), w . p and the sum have one each (4 u
 * S): together less than 32 u S.  Products with `spread` are within 8 u of
 * themselves, squares of distances within 8 u and those of |dir| within 17 u.
 */
void vocc_beam_set_dome(const vocc_beam *b, vocc_dome *d,
                        const float (*point)[3], const double (*normal)[3],
                        const uint16_t *which, size_t count, float distance)
{
    const double far = (double)distance, size = (double)b->size;
    double unit[VOCC_DOME_POINTS][3], sum[3] = {0.0, 0.0, 0.0}, w[3],
                                      least = 0.0, spread = 0.0;
    size_t i;
    int k;
    for (i = 0; i < count; i++) {
        (void)vocc_normalize(normal[which[i]], unit[i]);
        for (k = 0; k < 3; k++)
            sum[k] += unit[i][k];
    }
    if (count == 1 || !vocc_normalize(sum, w))
        memcpy(w, unit[0], sizeof w);
    for (i = 0; i < count; i++) {
        const float *const p = point[which[i]];
        double height = 0.0, square = 0.0;
        for (k = 0; k < 3; k++) {
            const double turned = w[k] - unit[i][k];
            height += w[k] * (double)p[k];
            square += turned * turned;
            if (i == 0 || p[k] < d->lower[k])
                d->lower[k] = p[k];
            if (i == 0 || p[k] > d->upper[k])
                d->upper[k] = p[k];
        }
        if (i == 0 || height < least)
            least = height;
        spread = larger(spread, square);
    }
    for (k = 0; k < 3; k++)
        d->normal[k] = (float)w[k];
    d->least = down(least - 0x1p-19 * size);
    d->spread = up(sqrt(spread) * (1.0 + 0x1p-20));
    d->length = d->reach = FLT_MAX;
    if (far < 4.0 * size) {
        /* Squares of what is nearer may be subnormal or 0. */
        d->reach = up(larger(far * far * (1.0 + 0x1p-19), 0x1p-120));
        d->length = up(far * (1.0 + 0x1p-20) + 0x1p-120);
    }
}

const vocc_beam_kernels *vocc_find_beam_kernels(int32_t isa)
{
    switch (isa) {
#if VOCC_HAVE_SSE2
    case VOCC_ISA_SSE2:
        return &vocc_beam_kernels_sse2;
#endif
#if VOCC_HAVE_AVX2
    case VOCC_ISA_AVX2:
        return &vocc_beam_kernels_avx2;
#endif
#if VOCC_HAVE_AVX512
    case VOCC_ISA_AVX512:
        return &vocc_beam_kernels_avx512;
#endif
#if VOCC_HAVE_NEON
    case VOCC_ISA_NEON:
        return &vocc_beam_kernels_neon;
#endif
    default:
        return &vocc_beam_kernels_plain;
    }
}
