#include "rays.h"

#include <float.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static const char *const kind_names[RAY_KINDS] = {
    "random",         "coherent",     "axis-parallel",  "zero component",
    "through vertex", "through edge", "along edge",     "in plane",
    "on surface",     "crease",       "end on surface", "end inside",
    "both inside",    "limits",       "tiny",           "negative tmin",
    "denormal",       "huge",         "bounds",         "nothing"};

const char *ray_kind_name(int kind)
{
    return kind_names[kind];
}

void rays_init(ray_set *set)
{
    memset(set, 0, sizeof(*set));
}

void rays_free(ray_set *set)
{
    free(set->rays);
    free(set->kinds);
    rays_init(set);
}

void rays_add(ray_set *set, int kind, const float org[3], const float dir[3],
              float tmin, float tmax)
{
    if (set->count == set->capacity) {
        set->capacity = set->capacity ? 2 * set->capacity : 256;
        set->rays = realloc(set->rays, set->capacity * sizeof(*set->rays));
        set->kinds = realloc(set->kinds, set->capacity);
        if (!set->rays || !set->kinds) {
            fprintf(stderr, "the test ran out of memory\n");
            exit(3);
        }
    }
    oracle_ray *ray = &set->rays[set->count];
    memcpy(ray->org, org, sizeof(ray->org));
    memcpy(ray->dir, dir, sizeof(ray->dir));
    ray->tmin = tmin;
    ray->tmax = tmax;
    set->kinds[set->count++] = (uint8_t)kind;
}

/* ---- ingredients ------------------------------------------------------- */

typedef struct maker {
    ray_set *set;
    const shape *s;
    test_random random;
    double lower[3], upper[3], size;
} maker;

/* A multiple of 2^-14, as most shapes' coordinates are. */
static float grid(double x)
{
    return (float)(0x1p-14 * floor(x * 0x1p14 + 0.5));
}

static const mesh *any_triangle(maker *k, size_t *triangle)
{
    const mesh *m;
    do {
        m = &k->s->parts[random_below(&k->random, (uint32_t)k->s->part_count)]
                 .m;
    } while (m->triangle_count == 0);
    *triangle = random_below(&k->random, (uint32_t)m->triangle_count);
    return m;
}

/* Three corners, in a random rotation. */
static void any_corners(maker *k, const float *corner[3])
{
    size_t triangle;
    const mesh *m = any_triangle(k, &triangle);
    const int turn = (int)random_below(&k->random, 3);
    for (int i = 0; i < 3; i++)
        corner[i] = mesh_corner(m, triangle, (i + turn) % 3);
}

/* In the bounds, widened by `wide` of their size. */
static void any_point(maker *k, double wide, float point[3])
{
    for (int i = 0; i < 3; i++)
        point[i] = grid(random_in(&k->random, k->lower[i] - wide * k->size,
                                  k->upper[i] + wide * k->size));
}

static void point_inside(maker *k, float point[3])
{
    if (k->s->solid) {
        for (int i = 0; i < 3; i++)
            point[i] =
                (float)(k->s->inside[i] + random_in(&k->random, -0.02, 0.02));
    } else {
        any_point(k, 0.0, point);
    }
}

static float any_zero(maker *k)
{
    return random_below(&k->random, 2) ? 0.0f : -0.0f;
}

/* tmax at, before or beyond a target at t = 1. */
static float any_tmax(maker *k)
{
    static const float choices[] = {1.0f, 2.0f, HUGE_VALF, 0.75f, 1.25f, 8.0f};
    return choices[random_below(&k->random, 6)];
}

static void between(const float from[3], const float to[3], float dir[3])
{
    for (int i = 0; i < 3; i++)
        dir[i] = to[i] - from[i];
}

/* A point of the edge at a dyadic fraction: exact where the shape is on the
 * grid. */
static void on_edge(maker *k, const float a[3], const float b[3],
                    float point[3])
{
    const float f = (float)(1 + random_below(&k->random, 7)) / 8.0f;
    for (int i = 0; i < 3; i++)
        point[i] = a[i] + f * (b[i] - a[i]);
}

static void on_triangle(maker *k, const float *corner[3], float point[3])
{
    const float f = (float)(1 + random_below(&k->random, 3)) / 8.0f;
    const float g = (float)(1 + random_below(&k->random, 3)) / 8.0f;
    for (int i = 0; i < 3; i++)
        point[i] = corner[0][i] + f * (corner[1][i] - corner[0][i]) +
                   g * (corner[2][i] - corner[0][i]);
}

static void surface_point(maker *k, float point[3])
{
    const float *corner[3];
    any_corners(k, corner);
    switch (random_below(&k->random, 3)) {
    case 0:
        memcpy(point, corner[0], 3 * sizeof(float));
        break;
    case 1:
        on_edge(k, corner[0], corner[1], point);
        break;
    default:
        on_triangle(k, corner, point);
        break;
    }
}

static float moved_by_ulps(maker *k, float x)
{
    for (uint32_t n = random_below(&k->random, 4); n > 0; n--)
        x = nextafterf(x, random_below(&k->random, 2) ? HUGE_VALF : -HUGE_VALF);
    return x;
}

/* ---- one ray of each kind ---------------------------------------------- */

static void make_random(maker *k)
{
    float org[3], to[3], dir[3];
    any_point(k, 0.5, org);
    any_point(k, random_below(&k->random, 2) ? 0.0 : 0.5, to);
    between(org, to, dir);
    rays_add(k->set, RAY_RANDOM, org, dir, 0.0f, any_tmax(k));
}

static void make_coherent(maker *k)
{
    float org[3], to[3], dir[3];
    any_point(k, 0.75, org);
    any_point(k, 0.0, to);
    for (int lane = 0; lane < 4; lane++) {
        const float moved[3] = {to[0] + 0.015625f * (float)(lane & 1), to[1],
                                to[2] + 0.015625f * (float)(lane >> 1)};
        between(org, moved, dir);
        rays_add(k->set, RAY_COHERENT, org, dir, 0.0f, 1.5f);
    }
}

static void make_axis(maker *k)
{
    float org[3], dir[3];
    if (random_below(&k->random, 4))
        surface_point(k, org);
    else
        any_point(k, 0.1, org);
    const uint32_t axis = random_below(&k->random, 3);
    const float length = random_below(&k->random, 2) ? 1.0f : -1.0f;
    for (uint32_t i = 0; i < 3; i++)
        dir[i] = i == axis ? length : any_zero(k);
    /* From before the bounds, exactly on the grid. */
    if (random_below(&k->random, 4))
        org[axis] =
            grid((length > 0 ? k->lower[axis] - 1.0 : k->upper[axis] + 1.0));
    rays_add(k->set, RAY_AXIS, org, dir, 0.0f,
             random_below(&k->random, 2) ? HUGE_VALF : 1.5f);
}

static void make_zero_component(maker *k)
{
    float org[3], to[3], dir[3];
    any_point(k, 0.5, org);
    surface_point(k, to);
    const uint32_t axis = random_below(&k->random, 3);
    org[axis] = to[axis];
    between(org, to, dir);
    dir[axis] = any_zero(k);
    rays_add(k->set, RAY_ZERO_COMPONENT, org, dir, 0.0f, any_tmax(k));
}

static void make_vertex(maker *k)
{
    const float *corner[3];
    float org[3], dir[3];
    any_corners(k, corner);
    any_point(k, 0.5, org);
    between(org, corner[0], dir);
    rays_add(k->set, RAY_VERTEX, org, dir, 0.0f, any_tmax(k));
}

static void make_edge(maker *k)
{
    const float *corner[3];
    float org[3], to[3], dir[3];
    any_corners(k, corner);
    any_point(k, 0.5, org);
    on_edge(k, corner[0], corner[1], to);
    between(org, to, dir);
    rays_add(k->set, RAY_EDGE, org, dir, 0.0f, any_tmax(k));
}

static void make_along_edge(maker *k)
{
    const float *corner[3];
    float org[3], dir[3];
    any_corners(k, corner);
    between(corner[0], corner[1], dir);
    const float back = (float)random_below(&k->random, 4);
    for (int i = 0; i < 3; i++)
        org[i] = corner[0][i] - back * dir[i];
    rays_add(k->set, RAY_ALONG_EDGE, org, dir, 0.0f,
             random_below(&k->random, 2) ? back + 1.0f : HUGE_VALF);
}

static void make_in_plane(maker *k)
{
    const float *corner[3];
    float org[3], dir[3];
    any_corners(k, corner);
    const float i0 = (float)random_below(&k->random, 9) - 4.0f;
    const float j0 = (float)random_below(&k->random, 9) - 4.0f;
    const float i1 = (float)random_below(&k->random, 5) - 2.0f;
    const float j1 = (float)random_below(&k->random, 5) - 2.0f;
    for (int i = 0; i < 3; i++) {
        const float ab = corner[1][i] - corner[0][i];
        const float ac = corner[2][i] - corner[0][i];
        org[i] = corner[0][i] + i0 * ab + j0 * ac;
        dir[i] = i1 * ab + j1 * ac;
    }
    rays_add(k->set, RAY_IN_PLANE, org, dir, 0.0f, HUGE_VALF);
}

static void make_on_surface(maker *k)
{
    float org[3], to[3], dir[3];
    surface_point(k, org);
    if (random_below(&k->random, 2))
        surface_point(k, to);
    else
        any_point(k, 1.0, to);
    between(org, to, dir);
    rays_add(k->set, RAY_ON_SURFACE, org, dir, 0.0f, any_tmax(k));
}

static void make_crease(maker *k)
{
    float org[3], to[3], dir[3];
    surface_point(k, org);
    for (int i = 0; i < 3; i++)
        org[i] = moved_by_ulps(k, org[i]);
    any_point(k, 1.0, to);
    between(org, to, dir);
    rays_add(k->set, RAY_CREASE, org, dir, 0.0f, any_tmax(k));
}

static void make_end_on_surface(maker *k)
{
    float org[3], to[3], dir[3];
    any_point(k, 0.5, org);
    surface_point(k, to);
    between(org, to, dir);
    rays_add(k->set, RAY_END_ON_SURFACE, org, dir, 0.0f,
             moved_by_ulps(k, 1.0f));
}

static void make_end_inside(maker *k)
{
    float org[3], to[3], dir[3];
    any_point(k, 1.0, org);
    point_inside(k, to);
    between(org, to, dir);
    rays_add(k->set, RAY_END_INSIDE, org, dir, 0.0f, 1.0f);
}

static void make_both_inside(maker *k)
{
    float org[3], to[3], dir[3];
    point_inside(k, org);
    point_inside(k, to);
    between(org, to, dir);
    rays_add(k->set, RAY_BOTH_INSIDE, org, dir,
             random_below(&k->random, 2) ? 0.0f : -1.0f,
             random_below(&k->random, 2) ? 1.0f : 20.0f);
}

static void make_limits(maker *k)
{
    float org[3], to[3], dir[3];
    any_point(k, 0.5, org);
    surface_point(k, to);
    between(org, to, dir);
    /* At the surface, the next float, or any power of two beside it. */
    const int power = -1 - (int)random_below(&k->random, 24);
    float t = 1.0f;
    switch (random_below(&k->random, 3)) {
    case 0:
        t += ldexpf(1.0f, power);
        break;
    case 1:
        t -= ldexpf(1.0f, power);
        break;
    default:
        break;
    }
    if (random_below(&k->random, 2))
        rays_add(k->set, RAY_LIMITS, org, dir, 0.0f, t);
    else
        rays_add(k->set, RAY_LIMITS, org, dir, t, HUGE_VALF);
}

static void make_tiny(maker *k)
{
    static const float ends[] = {FLT_MIN,   0x1p-149f, 1e-30f, 1e-7f,
                                 0x1p-126f, 1e-20f,    1e-10f, 1e-5f};
    float org[3], to[3], dir[3];
    surface_point(k, org);
    if (random_below(&k->random, 2))
        for (int i = 0; i < 3; i++)
            org[i] = moved_by_ulps(k, org[i]);
    any_point(k, 1.0, to);
    between(org, to, dir);
    const float t = ends[random_below(&k->random, 8)];
    rays_add(k->set, RAY_TINY, org, dir,
             random_below(&k->random, 2) ? 0.0f : -t, t);
}

static void make_negative(maker *k)
{
    static const float starts[] = {-HUGE_VALF, -1.0f, -2.0f, -FLT_MAX, -0.0f};
    float org[3], to[3], dir[3];
    any_point(k, 0.25, org);
    surface_point(k, to);
    between(org, to, dir);
    const uint32_t end = random_below(&k->random, 3);
    rays_add(k->set, RAY_NEGATIVE, org, dir,
             starts[random_below(&k->random, 5)],
             end == 0   ? HUGE_VALF
             : end == 1 ? 0.5f
                        : -0.25f);
}

static void make_denormal(maker *k)
{
    float org[3], to[3], dir[3];
    if (random_below(&k->random, 2)) {
        any_point(k, 0.5, org);
        surface_point(k, to);
        between(org, to, dir);
        const int power = -120 - (int)random_below(&k->random, 28);
        for (int i = 0; i < 3; i++)
            dir[i] = ldexpf(dir[i], power);
        rays_add(k->set, RAY_DENORMAL, org, dir, 0.0f,
                 random_below(&k->random, 2) ? HUGE_VALF : 0x1p127f);
    } else {
        for (int i = 0; i < 3; i++)
            org[i] = ldexpf((float)random_below(&k->random, 1000), -149);
        any_point(k, 0.5, to);
        between(org, to, dir);
        if (random_below(&k->random, 2))
            dir[random_below(&k->random, 3)] = 0x1p-149f;
        rays_add(k->set, RAY_DENORMAL, org, dir, 0.0f, any_tmax(k));
    }
}

static void make_huge(maker *k)
{
    float org[3], to[3], dir[3];
    if (random_below(&k->random, 2))
        surface_point(k, to);
    else
        any_point(k, 0.5, to);
    /* From 1e38 away double tells no two points of the mesh apart, and every
     * test is settled by exact arithmetic: few of those. */
    switch (random_below(&k->random, 32) ? random_below(&k->random, 3) : 3) {
    case 0: /* from far away, straight or nearly so */
        for (int i = 0; i < 3; i++)
            org[i] = to[i];
        org[random_below(&k->random, 3)] =
            random_below(&k->random, 2) ? 1e30f : -1e30f;
        between(org, to, dir);
        rays_add(k->set, RAY_HUGE, org, dir, 0.0f,
                 random_below(&k->random, 2) ? HUGE_VALF : 2.0f);
        break;
    case 1: /* long directions */
        any_point(k, 0.5, org);
        between(org, to, dir);
        for (int i = 0; i < 3; i++)
            dir[i] = ldexpf(dir[i], 100);
        rays_add(k->set, RAY_HUGE, org, dir, 0.0f,
                 random_below(&k->random, 2) ? HUGE_VALF : 0x1p-99f);
        break;
    case 2: /* both limits far out */
        any_point(k, 0.5, org);
        between(org, to, dir);
        rays_add(k->set, RAY_HUGE, org, dir, -FLT_MAX, FLT_MAX);
        break;
    default: /* as large as float32 can hold */
        for (int i = 0; i < 3; i++) {
            org[i] = (float)random_in(&k->random, -1.0, 1.0) * FLT_MAX;
            dir[i] = -org[i];
        }
        rays_add(k->set, RAY_HUGE, org, dir, 0.0f, 2.0f);
        break;
    }
}

static void make_bounds(maker *k)
{
    float org[3], to[3], dir[3];
    any_point(k, 0.25, org);
    any_point(k, 0.25, to);
    const uint32_t axis = random_below(&k->random, 3);
    const double plane =
        random_below(&k->random, 2) ? k->lower[axis] : k->upper[axis];
    org[axis] = (float)plane;
    if (random_below(&k->random, 2))
        to[axis] = (float)plane;
    between(org, to, dir);
    rays_add(k->set, RAY_BOUNDS, org, dir, 0.0f, any_tmax(k));
}

static void make_nothing(maker *k)
{
    static const float bad[] = {NAN, HUGE_VALF, -HUGE_VALF};
    float org[3], to[3], dir[3];
    any_point(k, 0.5, org);
    surface_point(k, to);
    between(org, to, dir);
    float tmin = 0.0f, tmax = HUGE_VALF;
    const uint32_t axis = random_below(&k->random, 3);
    const float value = bad[random_below(&k->random, 3)];
    switch (random_below(&k->random, 6)) {
    case 0:
        org[axis] = value;
        break;
    case 1:
        dir[axis] = value;
        break;
    case 2:
        for (int i = 0; i < 3; i++)
            dir[i] = any_zero(k);
        break;
    case 3:
        tmin = NAN;
        break;
    case 4:
        tmax = NAN;
        break;
    default:
        tmin = random_below(&k->random, 2) ? 2.0f : HUGE_VALF;
        tmax = random_below(&k->random, 2) ? tmin : -HUGE_VALF;
        break;
    }
    rays_add(k->set, RAY_NOTHING, org, dir, tmin, tmax);
}

void rays_adversarial(ray_set *set, const shape *s, size_t each, uint64_t seed)
{
    static void (*const make[RAY_KINDS])(maker *) = {
        make_random,         make_coherent,       make_axis,
        make_zero_component, make_vertex,         make_edge,
        make_along_edge,     make_in_plane,       make_on_surface,
        make_crease,         make_end_on_surface, make_end_inside,
        make_both_inside,    make_limits,         make_tiny,
        make_negative,       make_denormal,       make_huge,
        make_bounds,         make_nothing};
    maker k;
    k.set = set;
    k.s = s;
    k.random = random_seed(seed);
    shape_bounds(s, k.lower, k.upper);
    k.size = 0.0;
    for (int i = 0; i < 3; i++)
        k.size = fmax(k.size, k.upper[i] - k.lower[i]);
    /* Kinds one after the other, so that packets are of one kind; then once
     * more all mixed, so that they are not. */
    for (int kind = 0; kind < RAY_KINDS; kind++) {
        const size_t end = set->count + each - each / 4;
        while (set->count < end)
            make[kind](&k);
    }
    for (size_t i = 0; i < each / 4 * RAY_KINDS; i++)
        make[random_below(&k.random, RAY_KINDS)](&k);
}
