#include "clip.h"

#include <string.h>

/* Proof that nothing is lost.  All is in double; M is the largest coordinate.
 * A cut of an edge whose (exact) end points are doubles, at a plane that is a
 * double, is off by at most 2^-50 M along the edge: the two differences and
 * the quotient have relative errors of 2^-53, and both ends are doubles as
 * they stand.  So k cuts give a polygon within k 2^-50 M of the true one, if
 * each plane is moved outward by more than the error so far: a true point
 * within the closed half-space has a point of the polygon near it that is
 * within the moved half-space.  Planes are moved by MARGIN * M = 2^-42 M, which
 * is beyond 7 cuts' error, and the bounds grow by 2 MARGIN M, which is less
 * than half a float32 step of M. */
#define MARGIN 0x1p-42

/* A triangle cut by 7 planes has at most 10 corners; rounding may make it a
 * little less than convex, and add some. */
enum { MOST = 16 };

typedef struct polygon {
    double p[MOST][3];
    int n;
} polygon;

/* Keeps the side where sign * (x[axis] - plane) <= 0; or all of it, which loses
 * nothing, should the corners not fit. */
static void cut(const polygon *in, int axis, double plane, double sign,
                polygon *out)
{
    int i, k, n = 0;
    for (i = 0; i < in->n; i++) {
        const double *a = in->p[i], *b = in->p[i + 1 == in->n ? 0 : i + 1];
        const double da = sign * (a[axis] - plane),
                     db = sign * (b[axis] - plane);
        if (n + 2 > MOST) {
            *out = *in;
            return;
        }
        if (da <= 0.0)
            memcpy(out->p[n++], a, sizeof out->p[0]);
        if ((da < 0.0 && db > 0.0) || (da > 0.0 && db < 0.0)) {
            /* From the end inside, so that both windings cut alike. */
            const double *from = da < 0.0 ? a : b, *to = da < 0.0 ? b : a;
            const double s = (plane - from[axis]) / (to[axis] - from[axis]);
            for (k = 0; k < 3; k++)
                out->p[n][k] = from[k] + s * (to[k] - from[k]);
            out->p[n][axis] = plane;
            n++;
        }
    }
    out->n = n;
}

static void load(const float corners[9], polygon *out)
{
    int i;
    out->n = 3;
    for (i = 0; i < 9; i++)
        out->p[i / 3][i % 3] = (double)corners[i];
}

/* Cuts at those planes of the box that the polygon crosses.  Returns where the
 * result is, one of a and b. */
static polygon *clip_to_box(polygon *a, polygon *b, const vocc_bounds *box,
                            double margin)
{
    int axis, i;
    for (axis = 0; axis < 3; axis++) {
        const double lower = (double)box->lower[axis] - margin,
                     upper = (double)box->upper[axis] + margin;
        int low = 0, high = 0;
        for (i = 0; i < a->n; i++) {
            low |= a->p[i][axis] < lower;
            high |= a->p[i][axis] > upper;
        }
        if (low) {
            polygon *t = a;
            cut(a, axis, lower, -1.0, b);
            a = b;
            b = t;
        }
        if (high) {
            polygon *t = a;
            cut(a, axis, upper, 1.0, b);
            a = b;
            b = t;
        }
    }
    return a;
}

/* The next float, if `steps` is 1, or x, if it is 0; nextafterf is no match for
 * it.  Away from zero the bits of a float count up. */
static float step(float x, int toward_infinity, int steps)
{
    uint32_t bits;
    memcpy(&bits, &x, sizeof bits);
    if ((bits >> 31 != 0) == toward_infinity)
        steps = -steps;
    bits += (uint32_t)steps;
    memcpy(&x, &bits, sizeof x);
    return x;
}

static float round_down(double x)
{
    const float f = (float)x;
    return step(f, 0, (double)f > x);
}

static float round_up(double x)
{
    const float f = (float)x;
    return step(f, 1, (double)f < x);
}

typedef struct extent {
    double lower[3], upper[3];
} extent;

static void none(extent *e)
{
    int k;
    for (k = 0; k < 3; k++) {
        e->lower[k] = DBL_MAX;
        e->upper[k] = -DBL_MAX;
    }
}

static void add(extent *e, const double p[3])
{
    int k;
    for (k = 0; k < 3; k++) {
        e->lower[k] = p[k] < e->lower[k] ? p[k] : e->lower[k];
        e->upper[k] = p[k] > e->upper[k] ? p[k] : e->upper[k];
    }
}

/* Where an edge from below the plane to above crosses it. */
static void add_crossing(extent *e, const double *from, const double *to,
                         int axis, double plane)
{
    const double s = (plane - from[axis]) / (to[axis] - from[axis]);
    double p[3];
    int k;
    for (k = 0; k < 3; k++)
        p[k] = from[k] + s * (to[k] - from[k]);
    p[axis] = plane;
    add(e, p);
}

/* Bounds of the parts up to `high` and from `low` on: two cuts at once, of
 * which only the bounds are needed. */
static void divide(const polygon *all, int axis, double low, double high,
                   extent *below, extent *above)
{
    int i;
    none(below);
    none(above);
    for (i = 0; i < all->n; i++) {
        const double *a = all->p[i], *b = all->p[i + 1 == all->n ? 0 : i + 1];
        if (a[axis] <= high)
            add(below, a);
        if (a[axis] >= low)
            add(above, a);
        if (a[axis] > b[axis]) {
            const double *t = a;
            a = b;
            b = t;
        }
        if (a[axis] < high && b[axis] > high)
            add_crossing(below, a, b, axis, high);
        if (a[axis] < low && b[axis] > low)
            add_crossing(above, a, b, axis, low);
    }
}

/* Rounds outward; 0 if there is nothing. */
static int finish(const extent *e, const vocc_bounds *inside, int axis,
                  float lower, float upper, double margin, vocc_bounds *out)
{
    int k;
    if (e->lower[0] > e->upper[0])
        return 0;
    for (k = 0; k < 3; k++) {
        const float least = k == axis ? lower : inside->lower[k],
                    most = k == axis ? upper : inside->upper[k],
                    low = round_down(e->lower[k] - 2.0 * margin),
                    high = round_up(e->upper[k] + 2.0 * margin);
        /* The margin may have kept a polygon just outside. */
        out->lower[k] = low < least ? least : low > most ? most : low;
        out->upper[k] = high > most ? most : high < least ? least : high;
    }
    return 1;
}

int vocc_clip_split(const float corners[9], const vocc_bounds *inside, int axis,
                    float split, float scale, vocc_bounds *below,
                    vocc_bounds *above)
{
    const double margin = MARGIN * (double)scale;
    polygon a, b;
    extent low, high;
    load(corners, &a);
    divide(clip_to_box(&a, &b, inside, margin), axis, (double)split - margin,
           (double)split + margin, &low, &high);
    return finish(&low, inside, axis, inside->lower[axis], split, margin,
                  below) |
           finish(&high, inside, axis, split, inside->upper[axis], margin,
                  above)
               << 1;
}

int vocc_clip_meets(const float corners[9], const vocc_bounds *box, float scale)
{
    polygon a, b;
    load(corners, &a);
    return clip_to_box(&a, &b, box, MARGIN * (double)scale)->n != 0;
}
