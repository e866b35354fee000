#include "exact.h"

/* Sizes of the expansions below, in terms. */
enum {
    DIFFERENCE = 2,           /* p - org */
    CROSS = 16,               /* a component of a cross product */
    EDGE = 3 * 2 * CROSS,     /* dir . cross */
    DET = 3 * EDGE,           /* three edge functions */
    NUM = 3 * 2 * 2 * CROSS,  /* difference . cross */
    INTERVAL = NUM + 2 * DET, /* num - t * det */
};

static void two_sum(double a, double b, double *sum, double *error)
{
    double s = a + b, bb = s - a;
    *error = (a - (s - bb)) + (b - bb);
    *sum = s;
}

/* Dekker's product without fused multiply-add. */
static void two_product(double a, double b, double *product, double *error)
{
    const double splitter = 134217729.0; /* 2^27 + 1 */
    double p = a * b, c, ah, al, bh, bl;
    c = splitter * a;
    ah = c - (c - a);
    al = a - ah;
    c = splitter * b;
    bh = c - (c - b);
    bl = b - bh;
    *error = al * bl - (((p - ah * bh) - al * bh) - ah * bl);
    *product = p;
}

/* h = e + f, zeros dropped; the terms grow in magnitude.  h must not be e or
 * f.  Returns the number of terms, at least 1. */
static int expansion_sum(const double *e, int m, const double *f, int n,
                         double *h)
{
    int i = 0, j = 0, k = 0;
    double q = 0.0, error;
    while (i < m || j < n) {
        double next;
        if (j == n || (i < m && (e[i] < 0.0 ? -e[i] : e[i]) <
                                    (f[j] < 0.0 ? -f[j] : f[j])))
            next = e[i++];
        else
            next = f[j++];
        two_sum(q, next, &q, &error);
        if (error != 0.0)
            h[k++] = error;
    }
    if (q != 0.0 || k == 0)
        h[k++] = q;
    return k;
}

/* h = e * b; twice the terms at most. */
static int expansion_scale(const double *e, int m, double b, double *h)
{
    int i, k = 0;
    double q, low;
    two_product(e[0], b, &q, &low);
    if (low != 0.0)
        h[k++] = low;
    for (i = 1; i < m; i++) {
        double high, sum;
        two_product(e[i], b, &high, &low);
        two_sum(q, low, &sum, &low);
        if (low != 0.0)
            h[k++] = low;
        two_sum(high, sum, &q, &low);
        if (low != 0.0)
            h[k++] = low;
    }
    if (q != 0.0 || k == 0)
        h[k++] = q;
    return k;
}

/* p - q in two terms. */
static int difference(float p, float q, double h[DIFFERENCE])
{
    double sum, error;
    int k = 0;
    two_sum((double)p, -(double)q, &sum, &error);
    if (error != 0.0)
        h[k++] = error;
    if (sum != 0.0 || k == 0)
        h[k++] = sum;
    return k;
}

/* h = (p - org) of one point. */
typedef struct point {
    double e[3][DIFFERENCE];
    int n[3];
} point;

static void make_point(const float p[3], const float org[3], point *out)
{
    int k;
    for (k = 0; k < 3; k++)
        out->n[k] = difference(p[k], org[k], out->e[k]);
}

/* h = e * f for an f of at most two terms. */
static int expansion_product(const double *e, int m, const double *f, int n,
                             double *h)
{
    double low[2 * CROSS], high[2 * CROSS];
    int a, b;
    a = expansion_scale(e, m, f[0], low);
    if (n == 1) {
        for (b = 0; b < a; b++)
            h[b] = low[b];
        return a;
    }
    b = expansion_scale(e, m, f[1], high);
    return expansion_sum(low, a, high, b, h);
}

/* Component k of p x q. */
static int cross(const point *p, const point *q, int k, double h[CROSS])
{
    const int i = (k + 1) % 3, j = (k + 2) % 3;
    double a[CROSS / 2], b[CROSS / 2];
    int m, n, t;
    m = expansion_product(p->e[i], p->n[i], q->e[j], q->n[j], a);
    n = expansion_product(p->e[j], p->n[j], q->e[i], q->n[i], b);
    for (t = 0; t < n; t++)
        b[t] = -b[t];
    return expansion_sum(a, m, b, n, h);
}

/* dir . (p x q) */
static int edge(const float dir[3], const point *p, const point *q,
                double h[EDGE])
{
    double c[CROSS], s[2 * CROSS], t[EDGE];
    int k, n = 0, m, i;
    for (k = 0; k < 3; k++) {
        m = cross(p, q, k, c);
        m = expansion_scale(c, m, (double)dir[k], s);
        if (k == 0) {
            for (i = 0; i < m; i++)
                h[i] = s[i];
            n = m;
        } else {
            for (i = 0; i < n; i++)
                t[i] = h[i];
            n = expansion_sum(t, n, s, m, h);
        }
    }
    return n;
}

static int determinant(const float dir[3], const point p[3], double h[DET])
{
    double a[EDGE], b[EDGE], ab[2 * EDGE];
    int m = edge(dir, &p[1], &p[2], a), n = edge(dir, &p[2], &p[0], b);
    n = expansion_sum(a, m, b, n, ab);
    m = edge(dir, &p[0], &p[1], a);
    return expansion_sum(ab, n, a, m, h);
}

static int numerator(const point p[3], double h[NUM])
{
    double c[CROSS], s[4 * CROSS], t[NUM];
    int k, n = 0, m, i;
    for (k = 0; k < 3; k++) {
        m = cross(&p[1], &p[2], k, c);
        m = expansion_product(c, m, p[0].e[k], p[0].n[k], s);
        for (i = 0; i < n; i++)
            t[i] = h[i];
        if (k == 0) {
            for (i = 0; i < m; i++)
                h[i] = s[i];
            n = m;
        } else {
            n = expansion_sum(t, n, s, m, h);
        }
    }
    return n;
}

/* The last term of an expansion has its sign, and dominates it. */
static int sign_of(const double *e, int n)
{
    return e[n - 1] > 0.0 ? 1 : e[n - 1] < 0.0 ? -1 : 0;
}

static double estimate(const double *e, int n)
{
    double sum = 0.0;
    int i;
    for (i = 0; i < n; i++)
        sum += e[i];
    return sum;
}

static void make_points(const float org[3], const float corners[9], point p[3])
{
    int k;
    for (k = 0; k < 3; k++)
        make_point(corners + 3 * k, org, &p[k]);
}

int vocc_exact_edge(const float org[3], const float dir[3], const float p[3],
                    const float q[3])
{
    point a, b;
    double h[EDGE];
    make_point(p, org, &a);
    make_point(q, org, &b);
    return sign_of(h, edge(dir, &a, &b, h));
}

int vocc_exact_interval(const float org[3], const float dir[3],
                        const float corners[9], double t)
{
    point p[3];
    double num[NUM], det[DET], scaled[2 * DET], h[INTERVAL];
    int m, n;
    make_points(org, corners, p);
    m = numerator(p, num);
    n = determinant(dir, p, det);
    n = expansion_scale(det, n, -t, scaled);
    return sign_of(h, expansion_sum(num, m, scaled, n, h));
}

void vocc_exact_values(const float org[3], const float dir[3],
                       const float corners[9], double *num, double *det,
                       double *edge1, double *edge2)
{
    point p[3];
    double n[NUM], d[DET], e[EDGE];
    make_points(org, corners, p);
    *num = estimate(n, numerator(p, n));
    *det = estimate(d, determinant(dir, p, d));
    *edge1 = estimate(e, edge(dir, &p[2], &p[0], e));
    *edge2 = estimate(e, edge(dir, &p[0], &p[1], e));
}
