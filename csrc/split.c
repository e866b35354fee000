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
    BINS = 16,
    /* Candidates along an axis, in whole vectors. */
    MOST_EXACT = 2 * EXACT + VOCC_LANES,
    MOST_BINNED = BINS + VOCC_LANES
};

/* What the cost of a plane across an axis needs of the box: the cost of a
 * reference on a side is face + rim * half the extent of the side.  (Half: the
 * whole may not be finite.) */
typedef struct shape {
    float lower, upper; /* halves */
    float face, rim;
    float first, last; /* planes lie between */
} shape;

typedef struct search {
    shape shapes[3];
    float traversal_cost;
    float keep;    /* of the cost where a side is empty */
    int near_zero; /* planes may be too near to 0: VOCC_TINY */
    /* The best so far of each lane; its kind is 2 * axis + planar_below. */
    vfloat cost, pos, kind;
} search;

static int begin(search *s, const vocc_bounds *box, const vocc_sah *sah)
{
    double extent[3], scale;
    int k;
    for (k = 0; k < 3; k++)
        extent[k] = (double)box->upper[k] - (double)box->lower[k];
    scale =
        extent[0] * extent[1] + extent[1] * extent[2] + extent[2] * extent[0];
    if (!(scale > 0.0))
        return 0;
    scale = sah->intersection_cost / scale;
    s->near_zero = 0;
    for (k = 0; k < 3; k++) {
        const double a = extent[(k + 1) % 3], b = extent[(k + 2) % 3];
        shape *const x = &s->shapes[k];
        /* Not so near to the box's faces that no float32 lies between: such a
         * leaf would have no place for a seed ray. */
        const float low = vocc_absf(box->lower[k]),
                    high = vocc_absf(box->upper[k]),
                    thin = 4.0f * FLT_EPSILON * (low > high ? low : high);
        x->lower = 0.5f * box->lower[k];
        x->upper = 0.5f * box->upper[k];
        x->face = (float)(a * b * scale);
        x->rim = (float)(2.0 * (a + b) * scale);
        x->first = box->lower[k] + thin;
        x->last = box->upper[k] - thin;
        s->near_zero |= x->first < VOCC_TINY && x->last > -VOCC_TINY;
    }
    s->traversal_cost = (float)sah->traversal_cost;
    s->keep = (float)(1.0 - sah->empty_bonus);
    s->cost = vset(FLT_MAX);
    s->pos = vset(0.0f);
    s->kind = vset(-1.0f);
    return 1;
}

/* SAH costs of planes with `below` and `above` references on the sides. */
VOCC_INLINE void try_planes(search *s, int axis, int planar_below, vfloat pos,
                            vfloat below, vfloat above)
{
    const shape *const x = &s->shapes[axis];
    const vfloat half = vmul(pos, vset(0.5f)), face = vset(x->face),
                 rim = vset(x->rim), one = vset(1.0f), none = vset(FLT_MAX),
                 kind = vset((float)(2 * axis + planar_below)),
                 low = vadd(face, vmul(rim, vsub(half, vset(x->lower)))),
                 high = vadd(face, vmul(rim, vsub(vset(x->upper), half))),
                 all = vadd(vset(s->traversal_cost),
                            vadd(vmul(low, below), vmul(high, above)));
    vfloat cost = vmul(all, vmax(vset(s->keep), vmin(vmin(below, above), one)));
    cost = vpick(vset(x->first), pos, cost, none);
    cost = vpick(pos, vset(x->last), cost, none);
    if (s->near_zero) {
        const vfloat zero = vset(0.0f), tiny = vset(VOCC_TINY);
        cost = vpick(vabs(pos), tiny, vpick(zero, vabs(pos), none, cost), cost);
    }
    s->pos = vpick(cost, s->cost, pos, s->pos);
    s->kind = vpick(cost, s->cost, kind, s->kind);
    s->cost = vmin(cost, s->cost);
}

/* Every bound inside the box is tried; the sides are counted anew for each,
 * which for so few is faster than sorting. */
static void exact_split(search *s, const vocc_reference *references, int count)
{
    /* Lower bounds, then upper ones. */
    float bounds[3][MOST_EXACT], flat[3][EXACT];
    int flats[3] = {0, 0, 0}, axis, i, j;
    for (i = 0; i < count; i++)
        for (axis = 0; axis < 3; axis++) {
            const float lower = references[i].bounds.lower[axis],
                        upper = references[i].bounds.upper[axis];
            bounds[axis][i] = flat[axis][flats[axis]] = lower;
            bounds[axis][count + i] = upper;
            flats[axis] += lower == upper;
        }
    for (axis = 0; axis < 3; axis++) {
        const float *const lower = bounds[axis], *const upper = lower + count;
        for (i = 2 * count; i % VOCC_LANES; i++)
            bounds[axis][i] = lower[0];
        for (j = 0; j < 2 * count; j += VOCC_LANES) {
            const vfloat pos = vload(lower + j);
            vfloat below = vset(0.0f), above = below, planar;
            for (i = 0; i < count; i++) {
                below = vtally(below, vset(lower[i]), pos);
                above = vtally(above, pos, vset(upper[i]));
            }
            if (!flats[axis]) {
                try_planes(s, axis, 1, pos, below, above);
                continue;
            }
            planar = vset((float)flats[axis]);
            for (i = 0; i < flats[axis]; i++) {
                const vfloat at = vset(flat[axis][i]), none = vset(0.0f);
                planar = vsub(planar, vtally(vtally(none, at, pos), pos, at));
            }
            try_planes(s, axis, 1, pos, vadd(below, planar), above);
            try_planes(s, axis, 0, pos, below, vadd(above, planar));
        }
    }
}

static void binned_split(search *s, const vocc_reference *references,
                         size_t count, const vocc_bounds *box)
{
    uint32_t first[3][BINS] = {{0}}, last[3][BINS] = {{0}}, low[4], high[4];
    float scale[5], lower[5], lowest[4], highest[4];
    vfloat least, most;
    size_t i;
    int axis, b;
    for (axis = 0; axis < 3; axis++) {
        const double bins = (double)BINS / ((double)box->upper[axis] -
                                            (double)box->lower[axis]);
        /* No bins across a flat box, or one too thin for float32. */
        scale[axis + 1] = bins <= (double)FLT_MAX ? (float)bins : 0.0f;
        lower[axis + 1] = box->lower[axis];
    }
    scale[0] = lower[0] = 0.0f;
    scale[4] = lower[4] = 0.0f;
    least = vset(FLT_MAX);
    most = vset(-FLT_MAX);
    for (i = 0; i < count; i++) {
        /* x, y, z and one more; one more and x, y, z. */
        const float *const bounds = references[i].bounds.lower;
        const vfloat l = vload(bounds), u = vload(bounds + 2),
                     zero = vset(0.0f), end = vset((float)(BINS - 1));
        least = vmin(least, l);
        most = vmax(most, u);
        vstore_whole(
            low,
            vmin(vmax(vmul(vsub(l, vload(lower + 1)), vload(scale + 1)), zero),
                 end));
        vstore_whole(
            high,
            vmin(vmax(vmul(vsub(u, vload(lower)), vload(scale)), zero), end));
        for (axis = 0; axis < 3; axis++) {
            first[axis][low[axis]]++;
            last[axis][high[axis + 1]]++;
        }
    }
    vstore(lowest, least);
    vstore(highest, most);
    for (axis = 0; axis < 3; axis++) {
        float pos[MOST_BINNED], below[MOST_BINNED], above[MOST_BINNED];
        uint32_t begun = 0, left = (uint32_t)count;
        pos[0] = lowest[axis];
        below[0] = 0.0f;
        above[0] = (float)count;
        for (b = 1; b < BINS; b++) {
            const float t = (float)b / (float)BINS;
            begun += first[axis][b - 1];
            left -= last[axis][b - 1];
            pos[b] = box->lower[axis] * (1.0f - t) + box->upper[axis] * t;
            below[b] = (float)begun;
            above[b] = (float)left;
        }
        for (b = BINS; b < MOST_BINNED; b++) {
            pos[b] = highest[axis + 1];
            below[b] = (float)count;
            above[b] = 0.0f;
        }
        for (b = 0; b < MOST_BINNED; b += VOCC_LANES)
            try_planes(s, axis, 1, vload(pos + b), vload(below + b),
                       vload(above + b));
    }
}

vocc_split vocc_find_split(const vocc_reference *references, size_t count,
                           const vocc_bounds *box, const vocc_sah *sah)
{
    search s;
    vocc_split best;
    float costs[VOCC_LANES], places[VOCC_LANES], kinds[VOCC_LANES];
    int lane, least = 0;
    best.cost = DBL_MAX;
    best.axis = -1;
    best.pos = 0.0f;
    best.planar_below = 1;
    if (count == 0 || !begin(&s, box, sah))
        return best;
    if (count <= EXACT)
        exact_split(&s, references, (int)count);
    else
        binned_split(&s, references, count, box);
    vstore(costs, s.cost);
    vstore(places, s.pos);
    vstore(kinds, s.kind);
    for (lane = 1; lane < VOCC_LANES; lane++)
        least = costs[lane] < costs[least] ? lane : least;
    if (kinds[least] >= 0.0f) {
        best.cost = (double)costs[least];
        best.axis = (int)kinds[least] / 2;
        best.pos = places[least];
        best.planar_below = (int)kinds[least] % 2;
    }
    return best;
}
