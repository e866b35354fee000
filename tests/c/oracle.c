#include "oracle.h"

#include <float.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "test.h"

/* ---- integers ---------------------------------------------------------- */

/* Sign and magnitude; `n` limbs are in use, the highest is not 0.  The
 * products of four float32 with all exponents shifted to one scale fit. */
#define LIMBS 64

typedef struct big {
    int sign; /* -1, 0, 1 */
    int n;
    uint32_t limb[LIMBS];
} big;

static void overflow(void)
{
    fprintf(stderr, "oracle: an integer is too large\n");
    abort();
}

static big big_make(int sign, uint64_t magnitude)
{
    big x = {0, 0, {0}};
    while (magnitude) {
        x.limb[x.n++] = (uint32_t)magnitude;
        magnitude >>= 32;
    }
    x.sign = x.n ? sign : 0;
    return x;
}

static int compare_magnitude(const big *a, const big *b)
{
    if (a->n != b->n)
        return a->n < b->n ? -1 : 1;
    for (int i = a->n - 1; i >= 0; i--)
        if (a->limb[i] != b->limb[i])
            return a->limb[i] < b->limb[i] ? -1 : 1;
    return 0;
}

static void trim(big *x)
{
    while (x->n && !x->limb[x->n - 1])
        x->n--;
    if (!x->n)
        x->sign = 0;
}

static void add_magnitude(big *out, const big *a, const big *b)
{
    const big *more = a->n > b->n ? a : b, *less = a->n > b->n ? b : a;
    uint64_t carry = 0;
    const int n = more->n;
    if (n + 1 > LIMBS)
        overflow();
    for (int i = 0; i < n; i++) {
        carry += (uint64_t)more->limb[i] + (i < less->n ? less->limb[i] : 0);
        out->limb[i] = (uint32_t)carry;
        carry >>= 32;
    }
    out->n = n;
    if (carry)
        out->limb[out->n++] = (uint32_t)carry;
}

/* |a| >= |b| */
static void subtract_magnitude(big *out, const big *a, const big *b)
{
    int64_t borrow = 0;
    for (int i = 0; i < a->n; i++) {
        int64_t d =
            (int64_t)a->limb[i] - borrow - (i < b->n ? (int64_t)b->limb[i] : 0);
        borrow = d < 0;
        out->limb[i] = (uint32_t)(d + (borrow ? INT64_C(0x100000000) : 0));
    }
    out->n = a->n;
}

/* a + sign * b */
static big big_sum(const big *a, const big *b, int sign)
{
    big out;
    const int b_sign = sign * b->sign;
    if (!b_sign)
        return *a;
    if (!a->sign) {
        out = *b;
        out.sign = b_sign;
        return out;
    }
    if (a->sign == b_sign) {
        out.sign = a->sign;
        add_magnitude(&out, a, b);
        return out;
    }
    const int order = compare_magnitude(a, b);
    out.sign = order < 0 ? b_sign : a->sign;
    if (order < 0)
        subtract_magnitude(&out, b, a);
    else
        subtract_magnitude(&out, a, b);
    trim(&out);
    return out;
}

static big big_product(const big *a, const big *b)
{
    big out;
    out.sign = a->sign * b->sign;
    out.n = 0;
    if (!out.sign)
        return out;
    out.n = a->n + b->n;
    if (out.n > LIMBS)
        overflow();
    memset(out.limb, 0, (size_t)out.n * sizeof(out.limb[0]));
    for (int i = 0; i < a->n; i++) {
        uint64_t carry = 0;
        for (int j = 0; j < b->n; j++) {
            carry += (uint64_t)a->limb[i] * b->limb[j] + out.limb[i + j];
            out.limb[i + j] = (uint32_t)carry;
            carry >>= 32;
        }
        out.limb[i + b->n] = (uint32_t)carry;
    }
    trim(&out);
    return out;
}

/* a * 2^shift, shift >= 0 */
static big big_shift(const big *a, int shift)
{
    big out;
    out.sign = a->sign;
    out.n = 0;
    if (!a->sign)
        return out;
    const int words = shift / 32, bits = shift % 32;
    out.n = a->n + words + 1;
    if (out.n > LIMBS)
        overflow();
    memset(out.limb, 0, (size_t)out.n * sizeof(out.limb[0]));
    for (int i = 0; i < a->n; i++) {
        const uint64_t wide = (uint64_t)a->limb[i] << bits;
        out.limb[i + words] |= (uint32_t)wide;
        out.limb[i + words + 1] |= (uint32_t)(wide >> 32);
    }
    trim(&out);
    return out;
}

/* The nearest double to a * 2^exponent, but for a few ulp. */
static double big_double(const big *a, int exponent)
{
    double sum = 0.0;
    for (int i = a->n - 1; i >= 0 && i >= a->n - 4; i--)
        sum += ldexp((double)a->limb[i], 32 * (i - a->n + 4));
    return a->sign * ldexp(sum, exponent + 32 * (a->n - 4));
}

/* ---- float32 as integers ----------------------------------------------- */

/* x = mantissa * 2^exponent with an odd mantissa, or 0. */
static void split(double x, int64_t *mantissa, int *exponent)
{
    int e;
    const double m = frexp(x, &e);
    int64_t k = (int64_t)ldexp(m, 53);
    e -= 53;
    while (k && !(k & 1)) {
        k /= 2;
        e++;
    }
    *mantissa = k;
    *exponent = k ? e : INT32_MAX;
}

static int lowest_exponent(double x, int lowest)
{
    int64_t mantissa;
    int exponent;
    split(x, &mantissa, &exponent);
    return exponent < lowest ? exponent : lowest;
}

/* x / 2^exponent, which is an integer. */
static big big_scaled(double x, int exponent)
{
    int64_t mantissa;
    int e;
    split(x, &mantissa, &e);
    if (!mantissa)
        return big_make(0, 0);
    const big k = big_make(mantissa < 0 ? -1 : 1,
                           (uint64_t)(mantissa < 0 ? -mantissa : mantissa));
    return big_shift(&k, e - exponent);
}

typedef struct big3 {
    big c[3];
} big3;

static big3 difference(const float a[3], const float b[3], int exponent)
{
    big3 out;
    for (int k = 0; k < 3; k++) {
        const big x = big_scaled((double)a[k], exponent);
        const big y = big_scaled((double)b[k], exponent);
        out.c[k] = big_sum(&x, &y, -1);
    }
    return out;
}

static big3 cross(const big3 *a, const big3 *b)
{
    big3 out;
    for (int k = 0; k < 3; k++) {
        const int i = (k + 1) % 3, j = (k + 2) % 3;
        const big x = big_product(&a->c[i], &b->c[j]);
        const big y = big_product(&a->c[j], &b->c[i]);
        out.c[k] = big_sum(&x, &y, -1);
    }
    return out;
}

static big dot(const big3 *a, const big3 *b)
{
    big sum = big_make(0, 0);
    for (int k = 0; k < 3; k++) {
        const big x = big_product(&a->c[k], &b->c[k]);
        sum = big_sum(&sum, &x, 1);
    }
    return sum;
}

/* ---- one triangle, exactly --------------------------------------------- */

/* U, V, W and det in units of 2^(2 space + way); num in units of
 * 2^(3 space). */
typedef struct exact_triangle {
    big u, v, w, det, num;
    int space, way;
} exact_triangle;

static void exact_setup(exact_triangle *x, const float org[3],
                        const float dir[3], const float a[3], const float b[3],
                        const float c[3])
{
    x->space = INT32_MAX;
    x->way = INT32_MAX;
    for (int k = 0; k < 3; k++) {
        x->space = lowest_exponent((double)org[k], x->space);
        x->space = lowest_exponent((double)a[k], x->space);
        x->space = lowest_exponent((double)b[k], x->space);
        x->space = lowest_exponent((double)c[k], x->space);
        x->way = lowest_exponent((double)dir[k], x->way);
    }
    if (x->space == INT32_MAX)
        x->space = 0;
    const big3 va = difference(a, org, x->space);
    const big3 vb = difference(b, org, x->space);
    const big3 vc = difference(c, org, x->space);
    big3 d;
    for (int k = 0; k < 3; k++)
        d.c[k] = big_scaled((double)dir[k], x->way);
    const big3 bc = cross(&vb, &vc), ca = cross(&vc, &va), ab = cross(&va, &vb);
    x->u = dot(&d, &bc);
    x->v = dot(&d, &ca);
    x->w = dot(&d, &ab);
    x->det = big_sum(&x->u, &x->v, 1);
    x->det = big_sum(&x->det, &x->w, 1);
    x->num = dot(&va, &bc);
}

/* The sign of num / det - t, for det != 0 and any double t that is not NaN. */
static int compare_t(const exact_triangle *x, double t)
{
    if (isinf(t))
        return t > 0.0 ? -1 : 1;
    int way = lowest_exponent(t, INT32_MAX);
    if (way == INT32_MAX)
        return x->num.sign * x->det.sign;
    const big scaled = big_scaled(t, way);
    const big right = big_product(&scaled, &x->det);
    /* num 2^space against right 2^(way + x->way) */
    way += x->way;
    const big left = big_shift(&x->num, x->space > way ? x->space - way : 0);
    const big moved = big_shift(&right, way > x->space ? way - x->space : 0);
    const big left_over = big_sum(&left, &moved, -1);
    return left_over.sign * x->det.sign;
}

static int exact_is_hit(const exact_triangle *x, const oracle_ray *ray)
{
    const int positive = x->u.sign >= 0 && x->v.sign >= 0 && x->w.sign >= 0;
    const int negative = x->u.sign <= 0 && x->v.sign <= 0 && x->w.sign <= 0;
    return (positive || negative) && x->det.sign != 0 &&
           compare_t(x, (double)ray->tmin) > 0 &&
           compare_t(x, (double)ray->tmax) < 0;
}

oracle_answer oracle_exact(const oracle_ray *ray, const float a[3],
                           const float b[3], const float c[3])
{
    exact_triangle x;
    exact_setup(&x, ray->org, ray->dir, a, b, c);
    return exact_is_hit(&x, ray) ? ORACLE_HIT : ORACLE_MISS;
}

/* The float32 nearest to num / det, ties to even. */
static float rounded_t(const exact_triangle *x)
{
    const double guess = big_double(&x->num, 0) / big_double(&x->det, 0);
    float t = (float)ldexp(guess, x->space - x->way);
    if (isinf(t))
        t = t > 0.0f ? FLT_MAX : -FLT_MAX;
    for (;;) {
        const float more = nextafterf(t, HUGE_VALF);
        const float less = nextafterf(t, -HUGE_VALF);
        /* Half-way points have 25 bits: exact in double.  Past FLT_MAX the
         * next float would be 2^128. */
        const double above =
            0.5 * (double)t + 0.5 * (isinf(more) ? 0x1p128 : (double)more);
        const double below =
            0.5 * (double)t + 0.5 * (isinf(less) ? -0x1p128 : (double)less);
        uint32_t bits;
        memcpy(&bits, &t, sizeof(bits));
        const int even = !(bits & 1);
        const int over = compare_t(x, above), under = compare_t(x, below);
        if (over > 0 || (over == 0 && !even))
            t = more;
        else if (under < 0 || (under == 0 && !even))
            t = less;
        else
            return t;
        if (isinf(t))
            return t;
    }
}

int oracle_triangle(const oracle_ray *ray, const float a[3], const float b[3],
                    const float c[3], oracle_hit *hit)
{
    if (oracle_filter(ray, a, b, c) == ORACLE_MISS)
        return 0;
    exact_triangle x;
    exact_setup(&x, ray->org, ray->dir, a, b, c);
    if (!exact_is_hit(&x, ray))
        return 0;
    hit->t = rounded_t(&x);
    const double det = big_double(&x.det, 0);
    hit->u = big_double(&x.v, 0) / det;
    hit->v = big_double(&x.w, 0) / det;
    return 1;
}

/* ---- one triangle, by double ------------------------------------------- */

typedef struct bounded {
    double value, error;
} bounded;

/* d . (p x q).  The entries of p and q are differences of float32, each
 * rounded once; three products and five sums follow.  (1 + eps)^8 on the sum
 * of the absolute products bounds every error; nothing overflows and nothing
 * but a zero is below double's normal range. */
static bounded triple(const double d[3], const double p[3], const double q[3])
{
    double sum = 0.0, absolute = 0.0;
    for (int k = 0; k < 3; k++) {
        const int i = (k + 1) % 3, j = (k + 2) % 3;
        const double x = p[i] * q[j], y = p[j] * q[i];
        sum += d[k] * (x - y);
        absolute += fabs(d[k]) * (fabs(x) + fabs(y));
    }
    const bounded out = {sum, 16.0 * DBL_EPSILON * absolute};
    return out;
}

/* The sign, or 2 where the bound leaves it open. */
static int certain_sign(bounded x)
{
    if (x.value > x.error)
        return 1;
    if (x.value < -x.error)
        return -1;
    return x.error == 0.0 ? 0 : 2;
}

oracle_answer oracle_filter(const oracle_ray *ray, const float a[3],
                            const float b[3], const float c[3])
{
    double d[3], va[3], vb[3], vc[3];
    for (int k = 0; k < 3; k++) {
        d[k] = (double)ray->dir[k];
        va[k] = (double)a[k] - (double)ray->org[k];
        vb[k] = (double)b[k] - (double)ray->org[k];
        vc[k] = (double)c[k] - (double)ray->org[k];
    }
    const bounded u = triple(d, vb, vc), v = triple(d, vc, va),
                  w = triple(d, va, vb);
    const int su = certain_sign(u), sv = certain_sign(v), sw = certain_sign(w);
    const int plus = su == 1 || sv == 1 || sw == 1;
    const int minus = su == -1 || sv == -1 || sw == -1;
    if (plus && minus)
        return ORACLE_MISS;
    if (su == 0 && sv == 0 && sw == 0)
        return ORACLE_MISS;
    if (su == 2 || sv == 2 || sw == 2)
        return ORACLE_UNSURE;
    const bounded num = triple(va, vb, vc);
    const bounded det = {
        u.value + v.value + w.value,
        u.error + v.error + w.error +
            4.0 * DBL_EPSILON *
                (fabs(u.value) + fabs(v.value) + fabs(w.value))};
    const float limits[2] = {ray->tmin, ray->tmax};
    for (int k = 0; k < 2; k++) {
        const double t = (double)limits[k];
        if (isinf(t)) {
            if ((t > 0.0) == (k == 0))
                return ORACLE_MISS;
            continue;
        }
        const bounded left = {num.value - t * det.value,
                              num.error + fabs(t) * det.error +
                                  4.0 * DBL_EPSILON *
                                      (fabs(num.value) + fabs(t * det.value))};
        /* det is certain here, and has the sign of U, V and W. */
        const int sign = certain_sign(left);
        if (sign == 2)
            return ORACLE_UNSURE;
        const int side = sign * (plus ? 1 : -1);
        if (side != (k == 0 ? 1 : -1))
            return ORACLE_MISS;
    }
    return ORACLE_HIT;
}

/* ---- whole shapes ------------------------------------------------------ */

int oracle_ray_is_valid(const oracle_ray *ray)
{
    int length = 0;
    for (int k = 0; k < 3; k++) {
        if (!isfinite(ray->org[k]) || !isfinite(ray->dir[k]))
            return 0;
        length |= ray->dir[k] != 0.0f;
    }
    return length && ray->tmin < ray->tmax;
}

oracle_answer oracle_occluded(const oracle_ray *ray, const shape *s, int pure)
{
    if (!oracle_ray_is_valid(ray))
        return ORACLE_MISS;
    for (int p = 0; p < s->part_count; p++) {
        const mesh *m = &s->parts[p].m;
        for (size_t i = 0; i < m->triangle_count; i++) {
            const float *a = mesh_corner(m, i, 0), *b = mesh_corner(m, i, 1),
                        *c = mesh_corner(m, i, 2);
            oracle_answer answer =
                pure ? ORACLE_UNSURE : oracle_filter(ray, a, b, c);
            if (answer == ORACLE_UNSURE)
                answer = oracle_exact(ray, a, b, c);
            if (answer == ORACLE_HIT)
                return ORACLE_HIT;
        }
    }
    return ORACLE_MISS;
}

oracle_answer oracle_occluded_filter(const oracle_ray *ray, const shape *s)
{
    if (!oracle_ray_is_valid(ray))
        return ORACLE_MISS;
    oracle_answer all = ORACLE_MISS;
    for (int p = 0; p < s->part_count; p++) {
        const mesh *m = &s->parts[p].m;
        for (size_t i = 0; i < m->triangle_count; i++) {
            const oracle_answer answer =
                oracle_filter(ray, mesh_corner(m, i, 0), mesh_corner(m, i, 1),
                              mesh_corner(m, i, 2));
            if (answer == ORACLE_HIT)
                return ORACLE_HIT;
            if (answer == ORACLE_UNSURE)
                all = ORACLE_UNSURE;
        }
    }
    return all;
}

oracle_hit oracle_intersect(const oracle_ray *ray, const shape *s)
{
    oracle_hit best = {HUGE_VALF, -1, -1, 0.0, 0.0};
    if (!oracle_ray_is_valid(ray))
        return best;
    for (int p = 0; p < s->part_count; p++) {
        const mesh *m = &s->parts[p].m;
        for (size_t i = 0; i < m->triangle_count; i++) {
            oracle_hit hit = {HUGE_VALF, -1, -1, 0.0, 0.0};
            if (!oracle_triangle(ray, mesh_corner(m, i, 0),
                                 mesh_corner(m, i, 1), mesh_corner(m, i, 2),
                                 &hit))
                continue;
            /* In order of ids: a later one must be nearer. */
            if (best.prim_id < 0 || hit.t < best.t) {
                best = hit;
                best.geom_id = p;
                best.prim_id = (int32_t)i;
            }
        }
    }
    return best;
}

/* ---- winding ----------------------------------------------------------- */

/* The triangle's corners as integers, and twice its area as a vector. */
typedef struct exact_plane {
    big3 ab, bc, ca; /* the cross products of the corners' offsets */
    big3 normal;
    big volume;
} exact_plane;

static void plane_setup(exact_plane *x, const float point[3], const float a[3],
                        const float b[3], const float c[3])
{
    int space = INT32_MAX;
    for (int k = 0; k < 3; k++) {
        space = lowest_exponent((double)point[k], space);
        space = lowest_exponent((double)a[k], space);
        space = lowest_exponent((double)b[k], space);
        space = lowest_exponent((double)c[k], space);
    }
    if (space == INT32_MAX)
        space = 0;
    const big3 va = difference(a, point, space);
    const big3 vb = difference(b, point, space);
    const big3 vc = difference(c, point, space);
    x->ab = cross(&va, &vb);
    x->bc = cross(&vb, &vc);
    x->ca = cross(&vc, &va);
    x->volume = dot(&va, &x->bc);
    for (int k = 0; k < 3; k++) {
        x->normal.c[k] = big_sum(&x->ab.c[k], &x->bc.c[k], 1);
        x->normal.c[k] = big_sum(&x->normal.c[k], &x->ca.c[k], 1);
    }
}

static int plane_exists(const exact_plane *x)
{
    return x->normal.c[0].sign || x->normal.c[1].sign || x->normal.c[2].sign;
}

int oracle_has_area(const float a[3], const float b[3], const float c[3])
{
    exact_plane x;
    plane_setup(&x, a, a, b, c);
    return plane_exists(&x);
}

/* Exactly on the triangle, which has an area. */
static int is_on(const float point[3], const float a[3], const float b[3],
                 const float c[3])
{
    for (int k = 0; k < 3; k++) {
        if ((point[k] < a[k] && point[k] < b[k] && point[k] < c[k]) ||
            (point[k] > a[k] && point[k] > b[k] && point[k] > c[k]))
            return 0;
    }
    exact_plane x;
    plane_setup(&x, point, a, b, c);
    return !x.volume.sign && plane_exists(&x) &&
           dot(&x.normal, &x.ab).sign >= 0 && dot(&x.normal, &x.bc).sign >= 0 &&
           dot(&x.normal, &x.ca).sign >= 0;
}

/* A crossing of the ray from the point: +1 outward, -1 inward, 0 none, 2: the
 * ray goes through an edge, a vertex or lies in the plane. */
static int crossing(const oracle_ray *ray, const float a[3], const float b[3],
                    const float c[3])
{
    const oracle_answer answer = oracle_filter(ray, a, b, c);
    if (answer == ORACLE_MISS)
        return 0;
    exact_triangle x;
    exact_setup(&x, ray->org, ray->dir, a, b, c);
    const int plus = x.u.sign > 0 || x.v.sign > 0 || x.w.sign > 0;
    const int minus = x.u.sign < 0 || x.v.sign < 0 || x.w.sign < 0;
    if (plus && minus)
        return 0;
    if (!x.u.sign || !x.v.sign || !x.w.sign)
        return oracle_has_area(a, b, c) ? 2 : 0;
    return compare_t(&x, 0.0) > 0 ? x.det.sign : 0;
}

int oracle_winding(const float point[3], const mesh *m, const int32_t *list,
                   size_t count, int *winding, int *parity)
{
    test_random random = random_seed(99);
    oracle_ray ray;
    memcpy(ray.org, point, sizeof(ray.org));
    ray.tmin = 0.0f;
    ray.tmax = HUGE_VALF;
    *winding = 0;
    *parity = 0;
    for (size_t i = 0; i < count; i++)
        if (is_on(point, mesh_corner(m, (size_t)list[i], 0),
                  mesh_corner(m, (size_t)list[i], 1),
                  mesh_corner(m, (size_t)list[i], 2)))
            return 1;
    for (int attempt = 0; attempt < 100; attempt++) {
        for (int k = 0; k < 3; k++)
            ray.dir[k] = (float)((int)random_below(&random, 20001) - 10000);
        int sum = 0, crossings = 0, bad = 0;
        for (size_t i = 0; i < count && !bad; i++) {
            const float *a = mesh_corner(m, (size_t)list[i], 0),
                        *b = mesh_corner(m, (size_t)list[i], 1),
                        *c = mesh_corner(m, (size_t)list[i], 2);
            const int sign = crossing(&ray, a, b, c);
            bad = sign == 2;
            sum += sign;
            crossings += sign != 0;
        }
        if (!bad) {
            *winding = sum;
            *parity = crossings & 1;
            return 0;
        }
    }
    fprintf(stderr, "oracle: no direction was free of edges\n");
    abort();
}
