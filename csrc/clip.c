#include "clip.h"

#include <math.h>
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

static float round_down(double x)
{
    const float f = (float)x;
    return (double)f > x ? nextafterf(f, -INFINITY) : f;
}

static float round_up(double x)
{
    const float f = (float)x;
    return (double)f < x ? nextafterf(f, INFINITY) : f;
}

static void bound(const polygon *p, const vocc_bounds *inside, double margin,
                  vocc_bounds *out)
{
    int i, k;
    for (k = 0; k < 3; k++) {
        double low = p->p[0][k], high = low;
        for (i = 1; i < p->n; i++) {
            const double x = p->p[i][k];
            low = x < low ? x : low;
            high = x > high ? x : high;
        }
        out->lower[k] = round_down(low - 2.0 * margin);
        out->upper[k] = round_up(high + 2.0 * margin);
        if (out->lower[k] < inside->lower[k])
            out->lower[k] = inside->lower[k];
        if (out->upper[k] > inside->upper[k])
            out->upper[k] = inside->upper[k];
        /* The margin may have kept a polygon just outside. */
        if (out->lower[k] > inside->upper[k])
            out->lower[k] = inside->upper[k];
        if (out->upper[k] < inside->lower[k])
            out->upper[k] = inside->lower[k];
    }
}

int vocc_clip_split(const float corners[9], const vocc_bounds *inside, int axis,
                    float split, float scale, vocc_bounds *below,
                    vocc_bounds *above)
{
    const double margin = MARGIN * (double)scale;
    polygon a, b, side, *all;
    vocc_bounds box;
    int sides = 0;
    load(corners, &a);
    all = clip_to_box(&a, &b, inside, margin);
    cut(all, axis, (double)split + margin, 1.0, &side);
    if (side.n) {
        box = *inside;
        box.upper[axis] = split;
        bound(&side, &box, margin, below);
        sides |= 1;
    }
    cut(all, axis, (double)split - margin, -1.0, &side);
    if (side.n) {
        box = *inside;
        box.lower[axis] = split;
        bound(&side, &box, margin, above);
        sides |= 2;
    }
    return sides;
}

int vocc_clip_meets(const float corners[9], const vocc_bounds *box, float scale)
{
    polygon a, b;
    load(corners, &a);
    return clip_to_box(&a, &b, box, MARGIN * (double)scale)->n != 0;
}
