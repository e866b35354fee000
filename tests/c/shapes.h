/* Meshes for the tests, made of code alone: the closed shapes whose shadows
 * must have no crack, and the open, doubled, inverted and degenerate ones that
 * must be told from them. */
#ifndef VOCC_TEST_SHAPES_H
#define VOCC_TEST_SHAPES_H

#include <stddef.h>
#include <stdint.h>

typedef struct mesh {
    size_t vertex_count, vertex_capacity;
    float *vertices; /* rows of 3 */
    size_t triangle_count, triangle_capacity;
    int32_t *triangles; /* rows of 3 */
} mesh;

void mesh_init(mesh *m);
void mesh_free(mesh *m);
int32_t mesh_vertex(mesh *m, double x, double y, double z);
void mesh_triangle(mesh *m, int32_t a, int32_t b, int32_t c);
/* Appends a copy of `other`. */
void mesh_append(mesh *m, const mesh *other);
/* From vertex `first` on: scale, then move. */
void mesh_move(mesh *m, size_t first, double scale, double x, double y,
               double z);
/* From triangle `first` on: the other winding. */
void mesh_flip(mesh *m, size_t first);
/* Rounds every coordinate to a multiple of `step` (a power of two), so that
 * differences of coordinates are exact in float32. */
void mesh_snap(mesh *m, double step);
void mesh_bounds(const mesh *m, double lower[3], double upper[3]);
/* Corner 0, 1 or 2 of a triangle. */
const float *mesh_corner(const mesh *m, size_t triangle, int corner);

/* The generators append to m; normals point outward. */

/* 20 * 4^level triangles on the sphere about (x, y, z). */
void add_icosphere(mesh *m, int level, double radius, double x, double y,
                   double z);
/* A box with n x n x 2 triangles a side. */
void add_box(mesh *m, int n, const double lower[3], const double upper[3]);
/* A closed tube along the (p, q) torus knot: segments x ring quads. */
void add_knot(mesh *m, int p, int q, int segments, int ring, double thickness);
/* A square of 2 * n * n triangles at height y, normal up; an open mesh. */
void add_plane(mesh *m, int n, double half, double y);
/* The figure-8 immersion of the Klein bottle: closed, one-sided. */
void add_klein_bottle(mesh *m, int n);
/* The boundary of the unit cells with centres in a ball: all triangles lie in
 * planes of a grid, some edges have four of them. */
void add_voxel_ball(mesh *m, int cells, double radius);
/* A closed cone over n slivers whose tip angles are far below 1e-3. */
void add_fan(mesh *m, int n);

/* What a shape is, as far as a test needs to know. */
typedef struct shape_part {
    mesh m;
    int occluder; /* as in vocc_mesh_options */
} shape_part;

#define SHAPE_MAX_PARTS 13

typedef struct shape {
    const char *name;
    int part_count;
    shape_part parts[SHAPE_MAX_PARTS];
    /* Points known to be inside of a solid and outside of all of them; a
     * segment between them is blocked.  `solid` is 0 where nothing is closed.
     */
    int solid;
    double inside[3], outside[3];
} shape;

size_t shape_count(void);
const char *shape_name(size_t index);
/* `detail` 0: some hundred triangles, for oracles; 1: some thousand. */
void shape_make(shape *s, size_t index, int detail);
void shape_free(shape *s);
size_t shape_triangles(const shape *s);
void shape_bounds(const shape *s, double lower[3], double upper[3]);

#endif
