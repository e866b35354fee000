#include "triangle.h"
#include "exact.h"
#include "vec3.h"

/* dir . (p x q) and a bound of its rounding error.  With e = 2^-53: the
 * differences p, q carry e each, the products, the difference of products, the
 * product with dir and two sums e more: less than 8 e of the sum of absolute
 * products.  That sum is itself rounded; 8.5 e covers it. */
static double edge_function(const double dir[3], const double p[3],
                            const double q[3], double *bound)
{
    const double a0 = p[1] * q[2], b0 = p[2] * q[1];
    const double a1 = p[2] * q[0], b1 = p[0] * q[2];
    const double a2 = p[0] * q[1], b2 = p[1] * q[0];
    *bound = 8.5 * (DBL_EPSILON / 2) *
             (vocc_abs(dir[0]) * (vocc_abs(a0) + vocc_abs(b0)) +
              vocc_abs(dir[1]) * (vocc_abs(a1) + vocc_abs(b1)) +
              vocc_abs(dir[2]) * (vocc_abs(a2) + vocc_abs(b2)));
    return dir[0] * (a0 - b0) + dir[1] * (a1 - b1) + dir[2] * (a2 - b2);
}

static int certain_sign(double value, double bound)
{
    return value > bound ? 1 : value < -bound ? -1 : 0;
}

/* Sign of num - t * det. */
static int compare_t(double num, double num_bound, double det, double det_bound,
                     float t, const float org[3], const float dir[3],
                     const float corners[9])
{
    const double product = (double)t * det, at = vocc_abs((double)t);
    const double value = num - product;
    const double bound =
        num_bound + at * det_bound +
        2.0 * DBL_EPSILON * (vocc_abs(num) + vocc_abs(product));
    const int sign = certain_sign(value, bound);
    return sign ? sign : vocc_exact_interval(org, dir, corners, (double)t);
}

/* num / det, known within `relative`, moved so that it rounds to the float32
 * that the exact quotient rounds to: equal crossings must compare equal, and
 * which of two is nearer must not depend on rounding. */
static double rounding_t(const float org[3], const float dir[3],
                         const float corners[9], int side, double num,
                         double det, double relative)
{
    double t = num / det, v, w, middle;
    float low = (float)(t - vocc_abs(t) * relative),
          high = (float)(t + vocc_abs(t) * relative);
    int sign;
    if (low == high)
        return t;
    vocc_exact_values(org, dir, corners, &num, &det, &v, &w);
    t = num / det;
    low = (float)(t - vocc_abs(t) * 0x1p-48);
    high = (float)(t + vocc_abs(t) * 0x1p-48);
    if (low == high || !(vocc_abs(t) < (double)FLT_MAX))
        return t;
    /* Between neighbours, hence exact in double. */
    middle = 0.5 * ((double)low + (double)high);
    sign = vocc_exact_interval(org, dir, corners, middle) * side;
    return sign < 0 ? (double)low : sign > 0 ? (double)high : middle;
}

int vocc_triangle_test(const float org[3], const float dir[3], float tmin,
                       float tmax, const float corners[9],
                       vocc_crossing *crossing)
{
    double a[3], b[3], c[3], d[3];
    double u, v, w, u_bound, v_bound, w_bound, num, num_bound, det, det_bound;
    int su, sv, sw, side, k;

    for (k = 0; k < 3; k++) {
        a[k] = (double)corners[k] - (double)org[k];
        b[k] = (double)corners[3 + k] - (double)org[k];
        c[k] = (double)corners[6 + k] - (double)org[k];
        d[k] = (double)dir[k];
    }
    u = edge_function(d, b, c, &u_bound);
    v = edge_function(d, c, a, &v_bound);
    w = edge_function(d, a, b, &w_bound);
    su = certain_sign(u, u_bound);
    sv = certain_sign(v, v_bound);
    sw = certain_sign(w, w_bound);
    if ((su > 0 || sv > 0 || sw > 0) && (su < 0 || sv < 0 || sw < 0))
        return 0;
    if (!su)
        su = vocc_exact_edge(org, dir, corners + 3, corners + 6);
    if (!sv)
        sv = vocc_exact_edge(org, dir, corners + 6, corners);
    if (!sw)
        sw = vocc_exact_edge(org, dir, corners, corners + 3);
    if ((su > 0 || sv > 0 || sw > 0) && (su < 0 || sv < 0 || sw < 0))
        return 0;
    /* All of one sign and one not zero: that is the sign of det. */
    side = su ? su : sv ? sv : sw;
    if (!side)
        return 0;

    det = u + v + w;
    det_bound = u_bound + v_bound + w_bound +
                DBL_EPSILON * (vocc_abs(u) + vocc_abs(v) + vocc_abs(w));
    /* One factor more with an error of e than an edge function: 9.5 e. */
    num = edge_function(a, b, c, &num_bound);
    num_bound *= 9.5 / 8.5;
    if (tmin >= -FLT_MAX &&
        compare_t(num, num_bound, det, det_bound, tmin, org, dir, corners) *
                side <=
            0)
        return 0;
    if (tmax <= FLT_MAX &&
        compare_t(num, num_bound, det, det_bound, tmax, org, dir, corners) *
                side >=
            0)
        return 0;

    if (crossing) {
        const double accurate = 0x1p-30;
        double relative = 0x1p-48;
        if (num_bound > accurate * vocc_abs(num) ||
            det_bound > accurate * vocc_abs(det))
            vocc_exact_values(org, dir, corners, &num, &det, &v, &w);
        else if (num != 0.0)
            relative +=
                2.0 * (num_bound / vocc_abs(num) + det_bound / vocc_abs(det));
        crossing->t = rounding_t(org, dir, corners, side, num, det, relative);
        crossing->u = v / det;
        crossing->v = w / det;
        if (crossing->u < 0.0)
            crossing->u = 0.0;
        if (crossing->u > 1.0)
            crossing->u = 1.0;
        if (crossing->v < 0.0)
            crossing->v = 0.0;
        if (crossing->v > 1.0)
            crossing->v = 1.0;
        crossing->det_sign = side;
        crossing->on_edge = !su || !sv || !sw;
    }
    return 1;
}
