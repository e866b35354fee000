/* What a mesh's components are and where it is open, worked out by sorting:
 * the reference for the library's reports. */
#ifndef VOCC_TEST_TOPOLOGY_H
#define VOCC_TEST_TOPOLOGY_H

#include "shapes.h"

typedef struct component {
    size_t triangle_count, first_triangle;
    size_t boundary_edges, nonmanifold_edges, inconsistent_edges;
    int closed, consistent;
    int32_t *triangles; /* in order */
} component;

typedef struct topology {
    size_t welded_vertices;
    size_t degenerate_triangles;
    size_t component_count;
    component *components; /* by first_triangle */
    int32_t *component_of; /* a triangle */
    size_t open_edge_count;
    uint64_t *open_edges; /* low welded vertex << 32 | high one; sorted */
    int32_t *welded;      /* a vertex's position; -1: not used */
} topology;

void topology_make(topology *t, const mesh *m);
void topology_free(topology *t);
/* The key of the edge at `corner` of `triangle`, as in open_edges. */
uint64_t topology_edge(const topology *t, const mesh *m, size_t triangle,
                       int corner);

#endif
