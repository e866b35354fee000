/* A mesh as the library holds it: a checked copy, its edge-connected
 * components, and what is known of their closedness. */
#ifndef VOCC_MESH_H
#define VOCC_MESH_H

#include "platform.h"
#include "threads.h"
#include "vocc.h"

#define VOCC_MAX_TRIANGLES ((size_t)1 << 27)
#define VOCC_MAX_VERTICES ((size_t)INT32_MAX)

typedef struct vocc_mesh {
    char name[64];
    int occluder;
    int is_float64; /* as given */
    size_t vertex_count, triangle_count;
    float *vertices;     /* 3 a vertex; NULL if wide is used */
    double *wide;        /* float64 vertices that are no float32 numbers */
    uint32_t *triangles; /* 3 a triangle */
} vocc_mesh;

/* Copies and checks the arrays of vocc_scene_add_mesh into *mesh.  On failure
 * *mesh holds nothing. */
VOCC_INTERNAL vocc_status vocc_mesh_init(
    const vocc_allocator *allocator, vocc_mesh *mesh, size_t vertex_count,
    vocc_array vertices, size_t triangle_count, vocc_array triangles,
    const vocc_mesh_options *options, vocc_error *error);
VOCC_INTERNAL void vocc_mesh_free(const vocc_allocator *allocator,
                                  vocc_mesh *mesh);

/* Coordinates of vertex i less `origin`, as the tree will have them. */
VOCC_INTERNAL void vocc_mesh_vertex(const vocc_mesh *mesh, uint32_t i,
                                    const double origin[3], float out[3]);

/* The components of one mesh. */
typedef struct vocc_analysis {
    vocc_mesh_report report; /* first_component is 0: local */
    vocc_component_report *components;
    size_t component_count;
    int32_t *component_of; /* a triangle; local */
    uint64_t *open_edges;  /* 3 * prim_id + corner, growing */
    size_t open_edge_count;
} vocc_analysis;

/* Welds vertices by exact position, splits the surface into edge-connected
 * components and judges each.  On failure *analysis holds nothing. */
VOCC_INTERNAL vocc_status vocc_analyse(const vocc_allocator *allocator,
                                       const vocc_mesh *mesh,
                                       const double origin[3],
                                       vocc_analysis *analysis,
                                       vocc_ticker *ticker);
VOCC_INTERNAL void vocc_analysis_free(const vocc_allocator *allocator,
                                      vocc_analysis *analysis);

#endif
