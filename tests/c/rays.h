/* Rays for the tests: random, coherent, and all the adversarial kinds that are
 * known to break ray tracers. */
#ifndef VOCC_TEST_RAYS_H
#define VOCC_TEST_RAYS_H

#include "oracle.h"
#include "shapes.h"
#include "test.h"

typedef enum ray_kind {
    RAY_RANDOM,
    RAY_COHERENT, /* fans from one origin, four neighbours at a time */
    RAY_AXIS,     /* parallel to an axis; the zeros have both signs */
    RAY_ZERO_COMPONENT,
    RAY_VERTEX,     /* exactly through a vertex */
    RAY_EDGE,       /* exactly through a point of an edge */
    RAY_ALONG_EDGE, /* contains an edge */
    RAY_IN_PLANE,   /* in a triangle's plane */
    RAY_ON_SURFACE, /* starts on a vertex, an edge, a triangle */
    RAY_CREASE,     /* starts a few ulp from a vertex or an edge */
    RAY_END_ON_SURFACE,
    RAY_END_INSIDE,
    RAY_BOTH_INSIDE,
    RAY_LIMITS,   /* tmin or tmax exactly at a hit, or next to it */
    RAY_TINY,     /* tmax down to the smallest denormal */
    RAY_NEGATIVE, /* tmin below 0 or -infinity */
    RAY_DENORMAL, /* directions and origins below the normal range */
    RAY_HUGE,     /* up to the largest float32 */
    RAY_BOUNDS,   /* in the planes of the bounding box */
    RAY_NOTHING,  /* NaN, infinity, no length, empty interval */
    RAY_KINDS
} ray_kind;

const char *ray_kind_name(int kind);

typedef struct ray_set {
    size_t count, capacity;
    oracle_ray *rays;
    uint8_t *kinds;
} ray_set;

void rays_init(ray_set *set);
void rays_free(ray_set *set);
void rays_add(ray_set *set, int kind, const float org[3], const float dir[3],
              float tmin, float tmax);

/* `each` rays of every kind, made for this shape. */
void rays_adversarial(ray_set *set, const shape *s, size_t each, uint64_t seed);

#endif
