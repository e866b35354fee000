#include "split.h"
#include "kdtree.h"

enum {
    EXACT = 24, /* references up to which every bound is tried */
    BINS = 16
};

/* Half the surface area of a box, with the extent along each axis. */
typedef struct area {
    double extent[3];
    double half;
} area;

static area area_of(const vocc_bounds *box)
{
    area a;
    int k;
    for (k = 0; k < 3; k++)
        a.extent[k] = (double)box->upper[k] - (double)box->lower[k];
    a.half = a.extent[0] * a.extent[1] + a.extent[1] * a.extent[2] +
             a.extent[2] * a.extent[0];
    return a;
}

/* SAH cost of `below` and `above` triangles on the sides of a plane. */
static double cost_of(const vocc_sah *sah, const vocc_bounds *box,
                      const area *a, int axis, float pos, size_t below,
                      size_t above)
{
    const int i = (axis + 1) % 3, j = (axis + 2) % 3;
    const double face = a->extent[i] * a->extent[j],
                 rim = a->extent[i] + a->extent[j];
    const double low = face + rim * ((double)pos - (double)box->lower[axis]),
                 high = face + rim * ((double)box->upper[axis] - (double)pos);
    double cost = sah->traversal_cost +
                  sah->intersection_cost *
                      (low * (double)below + high * (double)above) / a->half;
    if (below == 0 || above == 0)
        cost *= 1.0 - sah->empty_bonus;
    return cost;
}

static void consider(vocc_split *best, const vocc_sah *sah,
                     const vocc_bounds *box, const area *a, int axis, float pos,
                     size_t below, size_t above, size_t planar)
{
    double cost;
    int planar_below = 1;
    if (!(pos > box->lower[axis] && pos < box->upper[axis]))
        return;
    if (pos != 0.0f && pos < VOCC_TINY && pos > -VOCC_TINY)
        return;
    cost = cost_of(sah, box, a, axis, pos, below + planar, above);
    if (planar) {
        const double other =
            cost_of(sah, box, a, axis, pos, below, above + planar);
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

static void exact_split(const vocc_reference *references, int count,
                        const vocc_bounds *box, const vocc_sah *sah,
                        const area *a, vocc_split *best)
{
    int axis, i, j;
    for (axis = 0; axis < 3; axis++) {
        float lower[EXACT], upper[EXACT];
        for (i = 0; i < count; i++) {
            lower[i] = references[i].bounds.lower[axis];
            upper[i] = references[i].bounds.upper[axis];
        }
        for (j = 0; j < 2 * count; j++) {
            const float pos = j < count ? lower[j] : upper[j - count];
            int below = 0, above = 0, either = 0;
            if (!(pos > box->lower[axis] && pos < box->upper[axis]))
                continue;
            for (i = 0; i < count; i++) {
                below += lower[i] < pos;
                above += upper[i] > pos;
                either += (lower[i] < pos) | (upper[i] > pos);
            }
            consider(best, sah, box, a, axis, pos, (size_t)below, (size_t)above,
                     (size_t)(count - either));
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
                         const area *a, vocc_split *best)
{
    size_t first[3][BINS] = {{0}}, last[3][BINS] = {{0}}, i;
    float scale[3], lowest[3], highest[3];
    int axis, b;
    for (axis = 0; axis < 3; axis++) {
        const double s = (double)BINS / a->extent[axis];
        /* No bins across a flat box, or one too thin for float32. */
        scale[axis] = s <= (double)FLT_MAX ? (float)s : 0.0f;
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
        consider(best, sah, box, a, axis, lowest[axis], 0, count, 0);
        consider(best, sah, box, a, axis, highest[axis], count, 0, 0);
        for (b = 1; b < BINS; b++) {
            const float pos =
                (float)((double)box->lower[axis] +
                        a->extent[axis] * (double)b / (double)BINS);
            below += first[axis][b - 1];
            gone += last[axis][b - 1];
            consider(best, sah, box, a, axis, pos, below, count - gone, 0);
        }
    }
}

vocc_split vocc_find_split(const vocc_reference *references, size_t count,
                           const vocc_bounds *box, const vocc_sah *sah)
{
    const area a = area_of(box);
    vocc_split best;
    best.cost = DBL_MAX;
    best.axis = -1;
    best.pos = 0.0f;
    best.planar_below = 1;
    if (!(a.half > 0.0) || count == 0)
        return best;
    if (count <= EXACT)
        exact_split(references, (int)count, box, sah, &a, &best);
    else
        binned_split(references, count, box, sah, &a, &best);
    return best;
}
