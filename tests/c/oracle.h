/* The oracle: what is true of a ray and a triangle, by integers alone.
 *
 * Every float32 is an integer times a power of two, so the signs that decide a
 * hit are signs of integers of at most some 1300 bits.  They are computed here
 * with a small big-integer type of the tests' own, which shares nothing with
 * the library.  A double-precision filter with a computed bound comes first
 * where speed matters; it can be switched off.
 *
 * The definition.  o = org, d = dir, v_a = a - o and so on:
 *   U = d . (v_b x v_c)   V = d . (v_c x v_a)   W = d . (v_a x v_b)
 *   det = U + V + W       num = v_a . (v_b x v_c)
 * (a, b, c) is hit iff U, V, W are all >= 0 or all <= 0, det != 0 and
 * tmin < num / det < tmax. */
#ifndef VOCC_TEST_ORACLE_H
#define VOCC_TEST_ORACLE_H

#include "shapes.h"

typedef struct oracle_ray {
    float org[3], dir[3];
    float tmin, tmax;
} oracle_ray;

/* 0 where the ray meets nothing by definition. */
int oracle_ray_is_valid(const oracle_ray *ray);

typedef enum oracle_answer {
    ORACLE_MISS = 0,
    ORACLE_HIT = 1,
    ORACLE_UNSURE = 2
} oracle_answer;

/* By double precision and its error bound alone; may be unsure. */
oracle_answer oracle_filter(const oracle_ray *ray, const float a[3],
                            const float b[3], const float c[3]);

/* By integers alone: never unsure. */
oracle_answer oracle_exact(const oracle_ray *ray, const float a[3],
                           const float b[3], const float c[3]);

/* Any triangle of the shape.  `pure`: no filter. */
oracle_answer oracle_occluded(const oracle_ray *ray, const shape *s, int pure);

/* The same by the filter alone: a hit that is certain, or a certain miss of
 * all, or unsure. */
oracle_answer oracle_occluded_filter(const oracle_ray *ray, const shape *s);

typedef struct oracle_hit {
    float t; /* the exact t rounded once; infinity: a miss */
    int32_t geom_id, prim_id;
    double u, v;
} oracle_hit;

/* The hit of one triangle (geom_id and prim_id are not set); 0: a miss. */
int oracle_triangle(const oracle_ray *ray, const float a[3], const float b[3],
                    const float c[3], oracle_hit *hit);

/* The smallest t as rounded to float32; among equals the smallest ids. */
oracle_hit oracle_intersect(const oracle_ray *ray, const shape *s);

/* Whether the corners are not all in line. */
int oracle_has_area(const float a[3], const float b[3], const float c[3]);

/* The winding number of the triangles list[0 .. count - 1] of m about a point;
 * `parity` gets the number of crossings mod 2.  1: the point is on one of
 * them. */
int oracle_winding(const float point[3], const mesh *m, const int32_t *list,
                   size_t count, int *winding, int *parity);

#endif
