#include "shapes.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "test.h"

#define PI 3.14159265358979323846

/* ---- meshes ------------------------------------------------------------ */

void mesh_init(mesh *m)
{
    memset(m, 0, sizeof(*m));
}

void mesh_free(mesh *m)
{
    free(m->vertices);
    free(m->triangles);
    mesh_init(m);
}

static void *grown(void *memory, size_t row, size_t *capacity)
{
    *capacity = *capacity ? *capacity * 2 : 64;
    void *bigger = realloc(memory, *capacity * row);
    if (!bigger) {
        fprintf(stderr, "the test ran out of memory\n");
        exit(3);
    }
    return bigger;
}

int32_t mesh_vertex(mesh *m, double x, double y, double z)
{
    if (m->vertex_count == m->vertex_capacity)
        m->vertices =
            grown(m->vertices, 3 * sizeof(float), &m->vertex_capacity);
    float *v = m->vertices + 3 * m->vertex_count;
    v[0] = (float)x;
    v[1] = (float)y;
    v[2] = (float)z;
    return (int32_t)m->vertex_count++;
}

void mesh_triangle(mesh *m, int32_t a, int32_t b, int32_t c)
{
    if (m->triangle_count == m->triangle_capacity)
        m->triangles =
            grown(m->triangles, 3 * sizeof(int32_t), &m->triangle_capacity);
    int32_t *t = m->triangles + 3 * m->triangle_count++;
    t[0] = a;
    t[1] = b;
    t[2] = c;
}

void mesh_append(mesh *m, const mesh *other)
{
    const int32_t first = (int32_t)m->vertex_count;
    for (size_t i = 0; i < other->vertex_count; i++) {
        const float *v = other->vertices + 3 * i;
        mesh_vertex(m, (double)v[0], (double)v[1], (double)v[2]);
    }
    for (size_t i = 0; i < other->triangle_count; i++) {
        const int32_t *t = other->triangles + 3 * i;
        mesh_triangle(m, first + t[0], first + t[1], first + t[2]);
    }
}

void mesh_move(mesh *m, size_t first, double scale, double x, double y,
               double z)
{
    const double move[3] = {x, y, z};
    for (size_t i = first; i < m->vertex_count; i++)
        for (int k = 0; k < 3; k++) {
            float *c = &m->vertices[3 * i + (size_t)k];
            *c = (float)((double)*c * scale + move[k]);
        }
}

void mesh_flip(mesh *m, size_t first)
{
    for (size_t i = first; i < m->triangle_count; i++) {
        int32_t *t = m->triangles + 3 * i;
        const int32_t swap = t[1];
        t[1] = t[2];
        t[2] = swap;
    }
}

void mesh_snap(mesh *m, double step)
{
    for (size_t i = 0; i < 3 * m->vertex_count; i++)
        m->vertices[i] =
            (float)(step * floor((double)m->vertices[i] / step + 0.5));
}

void mesh_bounds(const mesh *m, double lower[3], double upper[3])
{
    for (int k = 0; k < 3; k++) {
        lower[k] = HUGE_VAL;
        upper[k] = -HUGE_VAL;
    }
    for (size_t i = 0; i < 3 * m->triangle_count; i++) {
        const float *v = m->vertices + 3 * (size_t)m->triangles[i];
        for (int k = 0; k < 3; k++) {
            lower[k] = fmin(lower[k], (double)v[k]);
            upper[k] = fmax(upper[k], (double)v[k]);
        }
    }
}

const float *mesh_corner(const mesh *m, size_t triangle, int corner)
{
    return m->vertices +
           3 * (size_t)m->triangles[3 * triangle + (size_t)corner];
}

/* ---- generators -------------------------------------------------------- */

/* The midpoints already made, by edge: open addressing, power-of-two size. */
typedef struct midpoints {
    uint64_t *keys;
    int32_t *values;
    size_t mask;
} midpoints;

static int32_t midpoint(mesh *m, midpoints *known, size_t first, int32_t a,
                        int32_t b)
{
    const uint64_t low = (uint64_t)(a < b ? a : b);
    const uint64_t high = (uint64_t)(a < b ? b : a);
    const uint64_t key = (high << 32 | low) + 1; /* 0 is an empty slot */
    size_t slot =
        (size_t)((key * UINT64_C(0x9e3779b97f4a7c15)) >> 20) & known->mask;
    while (known->keys[slot]) {
        if (known->keys[slot] == key)
            return known->values[slot];
        slot = (slot + 1) & known->mask;
    }
    double p[3], length = 0.0;
    for (size_t k = 0; k < 3; k++) {
        p[k] = (double)m->vertices[3 * (first + (size_t)a) + k] +
               (double)m->vertices[3 * (first + (size_t)b) + k];
        length += p[k] * p[k];
    }
    length = sqrt(length);
    known->keys[slot] = key;
    known->values[slot] =
        mesh_vertex(m, p[0] / length, p[1] / length, p[2] / length) -
        (int32_t)first;
    return known->values[slot];
}

void add_icosphere(mesh *m, int level, double radius, double x, double y,
                   double z)
{
    static const signed char faces[20][3] = {
        {0, 11, 5}, {0, 5, 1},  {0, 1, 7},   {0, 7, 10}, {0, 10, 11},
        {1, 5, 9},  {5, 11, 4}, {11, 10, 2}, {10, 7, 6}, {7, 1, 8},
        {3, 9, 4},  {3, 4, 2},  {3, 2, 6},   {3, 6, 8},  {3, 8, 9},
        {4, 9, 5},  {2, 4, 11}, {6, 2, 10},  {8, 6, 7},  {9, 8, 1}};
    const size_t first = m->vertex_count;
    const double golden = 0.5 * (1.0 + sqrt(5.0));
    const double unit = 1.0 / sqrt(1.0 + golden * golden);
    for (int i = 0; i < 12; i++) {
        const double s = (i & 1 ? 1.0 : -1.0) * unit;
        const double g = (i & 2 ? -golden : golden) * unit;
        if (i < 4)
            mesh_vertex(m, s, g, 0.0);
        else if (i < 8)
            mesh_vertex(m, 0.0, s, g);
        else
            mesh_vertex(m, g, 0.0, s);
    }
    /* The table above is for this order of the corners: 0-3 in z = 0, 4-7 in
     * x = 0, 8-11 in y = 0. */
    int32_t *from = malloc(60 * sizeof(int32_t));
    size_t count = 20;
    if (!from)
        exit(3);
    for (size_t i = 0; i < 60; i++)
        from[i] = faces[i / 3][i % 3];

    for (int step = 0; step < level; step++) {
        size_t slots = 1;
        while (slots < 4 * count)
            slots *= 2;
        midpoints known = {calloc(slots, sizeof(uint64_t)),
                           malloc(slots * sizeof(int32_t)), slots - 1};
        int32_t *to = malloc(12 * count * sizeof(int32_t));
        if (!known.keys || !known.values || !to)
            exit(3);
        for (size_t i = 0; i < count; i++) {
            const int32_t a = from[3 * i], b = from[3 * i + 1],
                          c = from[3 * i + 2];
            const int32_t ab = midpoint(m, &known, first, a, b);
            const int32_t bc = midpoint(m, &known, first, b, c);
            const int32_t ca = midpoint(m, &known, first, c, a);
            const int32_t four[12] = {a,  ab, ca, ab, b,  bc,
                                      ca, bc, c,  ab, bc, ca};
            memcpy(to + 12 * i, four, sizeof(four));
        }
        free(known.keys);
        free(known.values);
        free(from);
        from = to;
        count *= 4;
    }
    for (size_t i = 0; i < count; i++)
        mesh_triangle(m, (int32_t)first + from[3 * i],
                      (int32_t)first + from[3 * i + 1],
                      (int32_t)first + from[3 * i + 2]);
    free(from);
    mesh_move(m, first, radius, x, y, z);
}

void add_box(mesh *m, int n, const double lower[3], const double upper[3])
{
    const size_t row = (size_t)n + 1;
    int32_t *ids = malloc(row * row * row * sizeof(int32_t));
    if (!ids)
        exit(3);
    memset(ids, -1, row * row * row * sizeof(int32_t));
    for (int axis = 0; axis < 3; axis++) {
        const int axis_u = (axis + 1) % 3, axis_v = (axis + 2) % 3;
        for (int side = 0; side < 2; side++) {
            for (int i = 0; i < n; i++) {
                for (int j = 0; j < n; j++) {
                    int32_t corner[4];
                    for (int k = 0; k < 4; k++) {
                        int at[3];
                        at[axis] = side * n;
                        at[axis_u] = i + (k == 1 || k == 2);
                        at[axis_v] = j + (k >= 2);
                        int32_t *id =
                            &ids[((size_t)at[0] * row + (size_t)at[1]) * row +
                                 (size_t)at[2]];
                        if (*id < 0) {
                            double p[3];
                            for (int c = 0; c < 3; c++)
                                p[c] =
                                    at[c] == n
                                        ? upper[c]
                                        : lower[c] +
                                              at[c] * (upper[c] - lower[c]) / n;
                            *id = mesh_vertex(m, p[0], p[1], p[2]);
                        }
                        corner[k] = *id;
                    }
                    const size_t first = m->triangle_count;
                    mesh_triangle(m, corner[0], corner[1], corner[2]);
                    mesh_triangle(m, corner[0], corner[2], corner[3]);
                    if (!side)
                        mesh_flip(m, first);
                }
            }
        }
    }
    free(ids);
}

static void knot_point(int p, int q, double angle, double out[3])
{
    const double r = 0.65 + 0.25 * cos(q * angle);
    out[0] = r * cos(p * angle);
    out[1] = r * sin(p * angle);
    out[2] = 0.25 * sin(q * angle);
}

static void cross(const double a[3], const double b[3], double out[3])
{
    out[0] = a[1] * b[2] - a[2] * b[1];
    out[1] = a[2] * b[0] - a[0] * b[2];
    out[2] = a[0] * b[1] - a[1] * b[0];
}

static void normalize(double a[3])
{
    const double length = sqrt(a[0] * a[0] + a[1] * a[1] + a[2] * a[2]);
    for (int k = 0; k < 3; k++)
        a[k] /= length;
}

/* Quads of a grid that wraps both ways; rows x columns vertices at `first`. */
static void add_wrapped_grid(mesh *m, int32_t first, int rows, int columns)
{
    for (int i = 0; i < rows; i++) {
        for (int j = 0; j < columns; j++) {
            const int i1 = (i + 1) % rows, j1 = (j + 1) % columns;
            const int32_t a = first + i * columns + j;
            const int32_t b = first + i1 * columns + j;
            const int32_t c = first + i1 * columns + j1;
            const int32_t d = first + i * columns + j1;
            mesh_triangle(m, a, b, c);
            mesh_triangle(m, a, c, d);
        }
    }
}

void add_knot(mesh *m, int p, int q, int segments, int ring, double thickness)
{
    const int32_t first = (int32_t)m->vertex_count;
    for (int i = 0; i < segments; i++) {
        const double angle = 2.0 * PI * i / segments;
        double here[3], next[3], tangent[3], side[3], up[3];
        /* Frame from the axis of the torus: continuous, so the tube closes. */
        knot_point(p, q, angle, here);
        knot_point(p, q, angle + 1e-4, next);
        for (int k = 0; k < 3; k++)
            tangent[k] = next[k] - here[k];
        normalize(tangent);
        const double outward[3] = {cos(p * angle), sin(p * angle), 0.5};
        cross(tangent, outward, side);
        normalize(side);
        cross(side, tangent, up);
        for (int j = 0; j < ring; j++) {
            const double c = thickness * cos(2.0 * PI * j / ring);
            const double s = thickness * sin(2.0 * PI * j / ring);
            mesh_vertex(m, here[0] + c * up[0] + s * side[0],
                        here[1] + c * up[1] + s * side[1],
                        here[2] + c * up[2] + s * side[2]);
        }
    }
    const size_t triangle = m->triangle_count;
    add_wrapped_grid(m, first, segments, ring);
    mesh_flip(m, triangle);
}

void add_plane(mesh *m, int n, double half, double y)
{
    const int32_t first = (int32_t)m->vertex_count;
    for (int i = 0; i <= n; i++)
        for (int j = 0; j <= n; j++)
            mesh_vertex(m, half * (2.0 * i / n - 1.0), y,
                        half * (2.0 * j / n - 1.0));
    for (int i = 0; i < n; i++) {
        for (int j = 0; j < n; j++) {
            const int32_t a = first + i * (n + 1) + j;
            mesh_triangle(m, a, a + 1, a + n + 2);
            mesh_triangle(m, a, a + n + 2, a + n + 1);
        }
    }
}

void add_klein_bottle(mesh *m, int n)
{
    const int32_t first = (int32_t)m->vertex_count;
    for (int i = 0; i < n; i++) {
        const double u = 2.0 * PI * i / n;
        for (int j = 0; j < n; j++) {
            const double v = 2.0 * PI * j / n;
            const double r = 0.7 + 0.3 * (cos(0.5 * u) * sin(v) -
                                          sin(0.5 * u) * sin(2.0 * v));
            mesh_vertex(
                m, r * cos(u), r * sin(u),
                0.3 * (sin(0.5 * u) * sin(v) + cos(0.5 * u) * sin(2.0 * v)));
        }
    }
    /* One turn of u maps v to -v: that seam is what makes it one-sided. */
    for (int i = 0; i < n; i++) {
        for (int j = 0; j < n; j++) {
            const int j1 = (j + 1) % n;
            const int i1 = (i + 1) % n;
            const int bj = i + 1 == n ? (n - j) % n : j;
            const int cj = i + 1 == n ? (n - j1) % n : j1;
            const int32_t a = first + i * n + j, b = first + i1 * n + bj;
            const int32_t c = first + i1 * n + cj, d = first + i * n + j1;
            mesh_triangle(m, a, b, c);
            mesh_triangle(m, a, c, d);
        }
    }
}

static int in_ball(int cells, int i, int j, int k)
{
    const double x = i + 0.5 - 0.5 * cells, y = j + 0.5 - 0.5 * cells,
                 z = k + 0.5 - 0.5 * cells;
    return x * x + y * y + z * z < 0.25 * cells * cells;
}

void add_voxel_ball(mesh *m, int cells, double radius)
{
    const size_t first = m->vertex_count;
    for (int i = 0; i < cells * cells * cells; i++) {
        const int at[3] = {i / (cells * cells), i / cells % cells, i % cells};
        if (!in_ball(cells, at[0], at[1], at[2]))
            continue;
        for (int face = 0; face < 6; face++) {
            const int axis = face / 2, side = face % 2;
            int beyond[3] = {at[0], at[1], at[2]};
            beyond[axis] += side ? 1 : -1;
            if (in_ball(cells, beyond[0], beyond[1], beyond[2]))
                continue;
            int32_t corner[4];
            for (int k = 0; k < 4; k++) {
                int p[3] = {at[0], at[1], at[2]};
                p[axis] += side;
                p[(axis + 1) % 3] += k == 1 || k == 2;
                p[(axis + 2) % 3] += k >= 2;
                corner[k] = mesh_vertex(m, p[0] - 0.5 * cells,
                                        p[1] - 0.5 * cells, p[2] - 0.5 * cells);
            }
            const size_t triangle = m->triangle_count;
            mesh_triangle(m, corner[0], corner[1], corner[2]);
            mesh_triangle(m, corner[0], corner[2], corner[3]);
            if (!side)
                mesh_flip(m, triangle);
        }
    }
    mesh_move(m, first, 2.0 * radius / cells, 0.0, 0.0, 0.0);
}

void add_fan(mesh *m, int n)
{
    const int32_t tip = mesh_vertex(m, 0.0, 1.0, 0.0);
    const int32_t base = mesh_vertex(m, 0.0, -1.0, 0.0);
    const int32_t first = (int32_t)m->vertex_count;
    for (int i = 0; i < n; i++) {
        const double angle = 2.0 * PI * i / n;
        mesh_vertex(m, cos(angle), -1.0, sin(angle));
    }
    for (int i = 0; i < n; i++) {
        const int32_t a = first + i, b = first + (i + 1) % n;
        mesh_triangle(m, tip, b, a);
        mesh_triangle(m, base, a, b);
    }
}

/* ---- shapes ------------------------------------------------------------ */

/* Small enough that every shape keeps its form, coarse enough that sums and
 * differences of a few coordinates below 4 are exact in float32. */
#define STEP 0x1p-14

static mesh *part(shape *s, int occluder)
{
    shape_part *p = &s->parts[s->part_count++];
    mesh_init(&p->m);
    p->occluder = occluder;
    return &p->m;
}

static void box(mesh *m, int n, double x0, double y0, double z0, double x1,
                double y1, double z1)
{
    const double lower[3] = {x0, y0, z0}, upper[3] = {x1, y1, z1};
    add_box(m, n, lower, upper);
}

static void inside_at(shape *s, double x, double y, double z)
{
    s->solid = 1;
    s->inside[0] = x;
    s->inside[1] = y;
    s->inside[2] = z;
}

static void make_sphere(shape *s, int detail)
{
    add_icosphere(part(s, 1), detail ? 4 : 1, 1.0, 0, 0, 0);
    inside_at(s, 0.125, 0.0625, 0.03125);
}

static void make_raw_sphere(shape *s, int detail)
{
    add_icosphere(part(s, 1), detail ? 3 : 1, 0.9, 0.01, -0.02, 0.03);
    inside_at(s, 0, 0, 0);
}

static void make_knot(shape *s, int detail)
{
    add_knot(part(s, 1), 2, 3, detail ? 160 : 24, detail ? 12 : 5, 0.1);
    double p[3];
    knot_point(2, 3, 0.0, p);
    inside_at(s, p[0], p[1], p[2]);
}

static void make_fat_knot(shape *s, int detail)
{
    add_knot(part(s, 1), 2, 3, detail ? 120 : 24, detail ? 12 : 5, 0.35);
    double p[3];
    knot_point(2, 3, 0.0, p);
    inside_at(s, p[0], p[1], p[2]);
}

/* Three spheres in one mesh: outward, and by `hollow` the middle one inward. */
static void nested(shape *s, int detail, int hollow)
{
    mesh *m = part(s, 1);
    add_icosphere(m, detail ? 3 : 1, 1.0, 0, 0, 0);
    const size_t first = m->triangle_count;
    add_icosphere(m, detail ? 3 : 1, 0.7, 0, 0, 0);
    if (hollow)
        mesh_flip(m, first);
    add_icosphere(m, detail ? 2 : 1, 0.4, 0, 0, 0);
    inside_at(s, 0.0625, 0.03125, 0);
}

static void make_nested(shape *s, int detail)
{
    nested(s, detail, 0);
}

static void make_nested_hollow(shape *s, int detail)
{
    nested(s, detail, 1);
}

static void make_inverted_cube(shape *s, int detail)
{
    mesh *m = part(s, 1);
    box(m, detail ? 8 : 2, -0.75, -0.75, -0.75, 0.75, 0.75, 0.75);
    mesh_flip(m, 0);
    inside_at(s, 0.125, 0.25, -0.0625);
}

static void make_overlapping_cubes(shape *s, int detail)
{
    mesh *m = part(s, 1);
    box(m, detail ? 6 : 1, -0.75, -0.75, -0.75, 0.25, 0.25, 0.25);
    box(m, detail ? 6 : 2, -0.25, -0.25, -0.25, 0.75, 0.75, 0.75);
    inside_at(s, 0.125, 0.0625, -0.0625);
}

static void make_overlapping_meshes(shape *s, int detail)
{
    box(part(s, 1), detail ? 6 : 1, -0.75, -0.75, -0.75, 0.25, 0.25, 0.25);
    mesh *m = part(s, 1);
    box(m, detail ? 6 : 2, -0.25, -0.5, -0.25, 0.75, 0.75, 0.75);
    mesh_flip(m, 0);
    inside_at(s, 0.125, 0.0625, -0.0625);
}

static void make_cube_on_plane(shape *s, int detail)
{
    mesh *m = part(s, 1);
    box(m, detail ? 8 : 2, -0.5, -0.5, -0.5, 0.5, 0.5, 0.5);
    /* The plane cuts the cube: the same mesh, another component. */
    add_plane(m, detail ? 8 : 2, 1.0, -0.125);
    inside_at(s, 0.125, 0.0625, 0.03125);
}

static void make_open_cube(shape *s, int detail)
{
    mesh *m = part(s, 1);
    box(m, detail ? 8 : 2, -0.75, -0.75, -0.75, 0.75, 0.75, 0.75);
    m->triangle_count -= m->triangle_count / 6; /* the last side */
}

static void make_13_shells(shape *s, int detail)
{
    mesh *m = part(s, 1);
    test_random random = random_seed(13);
    for (int i = 0; i < 13; i++) {
        const size_t first = m->triangle_count;
        const double r = random_in(&random, 0.2, 0.5);
        const double x = random_in(&random, -0.4, 0.4);
        const double y = random_in(&random, -0.4, 0.4);
        const double z = random_in(&random, -0.4, 0.4);
        if (i % 3 == 2)
            box(m, detail ? 3 : 1, x - r, y - r, z - r, x + r, y + r, z + r);
        else
            add_icosphere(m, detail ? 2 : 0, r, x, y, z);
        if (i % 4 == 3)
            mesh_flip(m, first);
    }
    /* Mixed windings can cancel: no point is known to be inside. */
}

static void make_13_meshes(shape *s, int detail)
{
    test_random random = random_seed(31);
    for (int i = 0; i < 13; i++) {
        mesh *m = part(s, i % 5 != 4);
        add_icosphere(m, detail ? 2 : 0, random_in(&random, 0.2, 0.5),
                      random_in(&random, -0.4, 0.4),
                      random_in(&random, -0.4, 0.4),
                      random_in(&random, -0.4, 0.4));
    }
}

/* Two cubes with one face in common: in one mesh their edges there have four
 * triangles, as two meshes each is closed by itself. */
static void make_touching_mesh(shape *s, int detail)
{
    mesh *m = part(s, 1);
    box(m, detail ? 6 : 2, -1.0, -0.5, -0.5, 0.0, 0.5, 0.5);
    box(m, detail ? 6 : 2, 0.0, -0.5, -0.5, 1.0, 0.5, 0.5);
    inside_at(s, 0.125, 0.0625, 0.03125);
}

static void make_touching_meshes(shape *s, int detail)
{
    box(part(s, 1), detail ? 6 : 2, -1.0, -0.5, -0.5, 0.0, 0.5, 0.5);
    /* Only a part of the face touches, with another triangulation. */
    box(part(s, 1), detail ? 5 : 1, 0.0, -0.25, -0.5, 1.0, 0.75, 0.5);
    inside_at(s, 0.125, 0.0625, 0.03125);
}

static void make_hollow_room(shape *s, int detail)
{
    mesh *m = part(s, 1);
    box(m, detail ? 8 : 2, -1, -1, -1, 1, 1, 1);
    const size_t first = m->triangle_count;
    box(m, detail ? 7 : 2, -0.875, -0.875, -0.875, 0.875, 0.875, 0.875);
    mesh_flip(m, first);
    /* furniture */
    box(m, 1, -0.5, -0.875, -0.5, 0, -0.25, 0);
    inside_at(s, -0.25, -0.5, -0.25);
}

static void make_plates(shape *s, int detail)
{
    mesh *m = part(s, 1);
    const int n = detail ? 4 : 1;
    for (int i = 0; i < 6; i++) {
        const double y = -0.5 + 0.1875 * i, x = 0.0625 * i;
        box(m, n, -1 + x, y, -1 + x, 0.5 + x, y + 1e-4, 0.5 + x);
    }
    box(m, n, 0.25, -1, -1, 0.25 + 1e-4, 1, 1);
    inside_at(s, 0, -0.5 + 0.5e-4, 0);
}

static void make_voxels(shape *s, int detail)
{
    add_voxel_ball(part(s, 1), detail ? 12 : 4, 1.0);
    inside_at(s, 0.03125, 0.0625, 0.125);
}

static void make_klein(shape *s, int detail)
{
    /* Where its parity is 1 depends on the triangulation. */
    add_klein_bottle(part(s, 1), detail ? 40 : 12);
}

static void make_flipped_sphere(shape *s, int detail)
{
    mesh *m = part(s, 1);
    add_icosphere(m, detail ? 3 : 1, 1.0, 0, 0, 0);
    for (size_t i = 0; i < m->triangle_count; i += 7) {
        int32_t *t = m->triangles + 3 * i;
        const int32_t swap = t[0];
        t[0] = t[1];
        t[1] = swap;
    }
    inside_at(s, 0.125, 0.0625, 0.03125);
}

/* Every triangle twice, and triangles without area besides. */
static void make_doubled(shape *s, int detail)
{
    mesh *m = part(s, 1);
    box(m, detail ? 4 : 1, -0.5, -0.5, -0.5, 0.5, 0.5, 0.5);
    mesh copy;
    mesh_init(&copy);
    mesh_append(&copy, m);
    mesh_append(m, &copy);
    mesh_free(&copy);
    const int32_t a = m->triangles[0], b = m->triangles[1];
    mesh_triangle(m, a, a, a);
    mesh_triangle(m, a, b, b);
    inside_at(s, 0.125, 0.0625, 0.03125);
}

/* Boxes of one mesh that meet in an edge and in a vertex only. */
static void make_pinched(shape *s, int detail)
{
    mesh *m = part(s, 1);
    const int n = detail ? 4 : 1;
    box(m, n, -1, -0.5, -1, 0, 0.5, 0);
    box(m, n, 0, -0.5, 0, 1, 0.5, 1);
    box(m, n, -1, 0.5, 0, 0, 1, 1);
    inside_at(s, -0.5, 0.0625, -0.5);
}

static void make_fan(shape *s, int detail)
{
    add_fan(part(s, 1), detail ? 600 : 200);
    inside_at(s, 0.03125, -0.5, 0.0625);
}

static void make_soup(shape *s, int detail)
{
    mesh *m = part(s, 1);
    test_random random = random_seed(7);
    for (int i = 0; i < (detail ? 1500 : 150); i++) {
        const double x = random_in(&random, -1, 1);
        const double y = random_in(&random, -1, 1);
        const double z = random_in(&random, -1, 1);
        int32_t id[3];
        for (int k = 0; k < 3; k++)
            id[k] = mesh_vertex(m, x + random_in(&random, -0.2, 0.2),
                                y + random_in(&random, -0.2, 0.2),
                                z + random_in(&random, -0.2, 0.2));
        mesh_triangle(m, id[0], id[1], id[2]);
    }
}

static void make_flat(shape *s, int detail)
{
    add_plane(part(s, 1), detail ? 20 : 6, 1.0, 0.0);
}

static const struct {
    const char *name;
    void (*make)(shape *s, int detail);
    int snapped;
} shapes[] = {
    {"sphere", make_sphere, 1},
    {"raw sphere", make_raw_sphere, 0},
    {"torus knot", make_knot, 1},
    {"raw torus knot", make_knot, 0},
    {"fat knot", make_fat_knot, 1},
    {"nested shells", make_nested, 1},
    {"nested shells, hollow", make_nested_hollow, 1},
    {"inverted cube", make_inverted_cube, 1},
    {"overlapping cubes", make_overlapping_cubes, 1},
    {"overlapping meshes", make_overlapping_meshes, 1},
    {"cube on plane", make_cube_on_plane, 1},
    {"open cube", make_open_cube, 1},
    {"13 shells", make_13_shells, 1},
    {"13 meshes", make_13_meshes, 0},
    {"touching in one mesh", make_touching_mesh, 1},
    {"touching meshes", make_touching_meshes, 1},
    {"hollow room", make_hollow_room, 1},
    {"thin plates", make_plates, 0},
    {"voxels", make_voxels, 1},
    {"klein bottle", make_klein, 1},
    {"flipped sphere", make_flipped_sphere, 1},
    {"doubled cube", make_doubled, 1},
    {"pinched boxes", make_pinched, 1},
    {"fan of slivers", make_fan, 1},
    {"soup", make_soup, 1},
    {"flat", make_flat, 1},
};

size_t shape_count(void)
{
    return sizeof(shapes) / sizeof(shapes[0]);
}

const char *shape_name(size_t index)
{
    return shapes[index].name;
}

void shape_make(shape *s, size_t index, int detail)
{
    memset(s, 0, sizeof(*s));
    s->name = shapes[index].name;
    s->outside[0] = 2.25;
    s->outside[1] = 1.75;
    s->outside[2] = 2.0;
    shapes[index].make(s, detail);
    for (int i = 0; shapes[index].snapped && i < s->part_count; i++)
        mesh_snap(&s->parts[i].m, STEP);
}

void shape_free(shape *s)
{
    for (int i = 0; i < s->part_count; i++)
        mesh_free(&s->parts[i].m);
}

size_t shape_triangles(const shape *s)
{
    size_t count = 0;
    for (int i = 0; i < s->part_count; i++)
        count += s->parts[i].m.triangle_count;
    return count;
}

void shape_bounds(const shape *s, double lower[3], double upper[3])
{
    for (int k = 0; k < 3; k++) {
        lower[k] = HUGE_VAL;
        upper[k] = -HUGE_VAL;
    }
    for (int i = 0; i < s->part_count; i++) {
        double low[3], high[3];
        mesh_bounds(&s->parts[i].m, low, high);
        for (int k = 0; k < 3; k++) {
            lower[k] = fmin(lower[k], low[k]);
            upper[k] = fmax(upper[k], high[k]);
        }
    }
}
