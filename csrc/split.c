#include "split.h"
#include "kdtree.h"
#include "vec3.h"

#include <string.h>

#define VOCC_LANES 4
#if VOCC_HAVE_SSE2
#include "simd_sse2.h"
#elif VOCC_HAVE_NEON
#include "simd_neon.h"
#else
#include "simd_plain.h"
#endif

enum {
    EXACT = 12, /* references up to which every bound is tried */
    BINS = 16
};

/* What the cost of a plane across each axis needs of the box. */
typedef struct shape {
    double lower[3], upper[3];
    double face[3], rim[3]; /* half area = face + rim * extent along the axis */
    double scale;           /* intersection cost / half area */
    float first[3], last[3]; /* where planes may be */
} shape;

static int shape_of(const vocc_bounds *box, const vocc_sah *sah, shape *s)
{
    double extent[3], half;
    float thin;
    int k;
    for (k = 0; k < 3; k++) {
        s->lower[k] = (double)box->lower[k];
        s->upper[k] = (double)box->upper[k];
        extent[k] = s->upper[k] - s->lower[k];
        /* Not so near to the box's faces that no float32 lies between: such a
         * leaf would have no place for a seed ray. */
        thin = vocc_absf(box->lower[k]) > vocc_absf(box->upper[k])
                   ? vocc_absf(box->lower[k])
                   : vocc_absf(box->upper[k]);
        s->first[k] = box->lower[k] + 4.0f * FLT_EPSILON * thin;
        s->last[k] = box->upper[k] - 4.0f * FLT_EPSILON * thin;
    }
    for (k = 0; k < 3; k++) {
        s->face[k] = extent[(k + 1) % 3] * extent[(k + 2) % 3];
        s->rim[k] = extent[(k + 1) % 3] + extent[(k + 2) % 3];
    }
    half = s->face[0] + s->face[1] + s->face[2];
    s->scale = sah->intersection_cost / half;
    return half > 0.0;
}

/* SAH cost of `below` and `above` triangles on the sides of a plane. */
static double cost_of(const vocc_sah *sah, const shape *s, int axis, double pos,
                      size_t below, size_t above)
{
    const double low = s->face[axis] + s->rim[axis] * (pos - s->lower[axis]),
                 high = s->face[axis] + s->rim[axis] * (s->upper[axis] - pos);
    const double cost =
        sah->traversal_cost + s->scale * (low * (double)(int64_t)below +
                                          high * (double)(int64_t)above);
    return below == 0 || above == 0 ? cost * (1.0 - sah->empty_bonus) : cost;
}

static void consider(vocc_split *best, const vocc_sah *sah, const shape *s,
                     int axis, float pos, size_t below, size_t above,
                     size_t planar)
{
    double cost;
    int planar_below = 1;
    if (!(pos > s->first[axis] && pos < s->last[axis]) ||
        (pos != 0.0f && pos < VOCC_TINY && pos > -VOCC_TINY))
        return;
    cost = cost_of(sah, s, axis, (double)pos, below + planar, above);
    if (planar) {
        const double other =
            cost_of(sah, s, axis, (double)pos, below, above + planar);
        if (other < cost) {
            cost = other;
            planar_below = 0;
        }
    }
    if (cost < best->cost) {
        best->cost = cost;
        best->axis = axis;
        best->pos = pos;
        best->planar_below = planar_below;
    }
}

/* Bits of the two halves of x, each in its half. */
static uint32_t count_halves(uint32_t x)
{
    x -= x >> 1 & 0x55555555u;
    x = (x & 0x33333333u) + (x >> 2 & 0x33333333u);
    x = (x + (x >> 4)) & 0x0F0F0F0Fu;
    return (x + (x >> 8)) & 0x00FF00FFu;
}

/* Every bound inside the box is tried; the sides are counted anew for each,
 * four references at a time, which for so few is faster than sorting. */
static void exact_split(const vocc_reference *references, int count,
                        const vocc_sah *sah, const shape *s, vocc_split *best)
{
    const uint32_t all = (1u << count) - 1u;
    int axis, i, j;
    for (axis = 0; axis < 3; axis++) {
        float lower[EXACT + VOCC_LANES], upper[EXACT + VOCC_LANES];
        for (i = 0; i < count; i++) {
            lower[i] = references[i].bounds.lower[axis];
            upper[i] = references[i].bounds.upper[axis];
        }
        for (; i & (VOCC_LANES - 1); i++) {
            lower[i] = FLT_MAX;
            upper[i] = -FLT_MAX;
        }
        for (j = 0; j < 2 * count; j++) {
            const float pos = j < count ? lower[j] : upper[j - count];
            const vfloat p = vset(pos);
            uint32_t below = 0, above = 0, counts, planar = 0;
            if (!(pos > s->first[axis] && pos < s->last[axis]))
                continue;
            for (i = 0; i < count; i += VOCC_LANES) {
                below |= vlt(vload(lower + i), p) << i;
                above |= vlt(p, vload(upper + i)) << i;
            }
            counts = count_halves(below | above << 16);
            if ((below | above) != all)
                planar = count_halves(all & ~(below | above));
            consider(best, sah, s, axis, pos, counts & 0xFFFFu, counts >> 16,
                     planar);
        }
    }
}

static int bin_of(float x, float lower, float scale)
{
    const float b = (x - lower) * scale;
    return b < (float)BINS ? (b > 0.0f ? (int)b : 0) : BINS - 1;
}

static void binned_split(const vocc_reference *references, size_t count,
                         const vocc_bounds *box, const vocc_sah *sah,
                         const shape *s, vocc_split *best)
{
    size_t first[3][BINS] = {{0}}, last[3][BINS] = {{0}}, i;
    float scale[3], lowest[3], highest[3];
    int axis, b;
    for (axis = 0; axis < 3; axis++) {
        const double bins = (double)BINS / (s->upper[axis] - s->lower[axis]);
        /* No bins across a flat box, or one too thin for float32. */
        scale[axis] = bins <= (double)FLT_MAX ? (float)bins : 0.0f;
        lowest[axis] = box->upper[axis];
        highest[axis] = box->lower[axis];
    }
    for (i = 0; i < count; i++) {
        const vocc_bounds *r = &references[i].bounds;
        for (axis = 0; axis < 3; axis++) {
            const float low = r->lower[axis], high = r->upper[axis];
            first[axis][bin_of(low, box->lower[axis], scale[axis])]++;
            last[axis][bin_of(high, box->lower[axis], scale[axis])]++;
            lowest[axis] = low < lowest[axis] ? low : lowest[axis];
            highest[axis] = high > highest[axis] ? high : highest[axis];
        }
    }
    for (axis = 0; axis < 3; axis++) {
        size_t below = 0, gone = 0;
        consider(best, sah, s, axis, lowest[axis], 0, count, 0);
        consider(best, sah, s, axis, highest[axis], count, 0, 0);
        for (b = 1; b < BINS; b++) {
            const float pos =
                (float)(s->lower[axis] + (s->upper[axis] - s->lower[axis]) *
                                             (double)b / (double)BINS);
            below += first[axis][b - 1];
            gone += last[axis][b - 1];
            consider(best, sah, s, axis, pos, below, count - gone, 0);
        }
    }
}

vocc_split vocc_find_split(const vocc_reference *references, size_t count,
                           const vocc_bounds *box, const vocc_sah *sah)
{
    shape s;
    vocc_split best;
    best.cost = DBL_MAX;
    best.axis = -1;
    best.pos = 0.0f;
    best.planar_below = 1;
    if (count == 0 || !shape_of(box, sah, &s))
        return best;
    if (count <= EXACT)
        exact_split(references, (int)count, sah, &s, &best);
    else
        binned_split(references, count, box, sah, &s, &best);
    return best;
}
