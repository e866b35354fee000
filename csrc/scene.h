/* What a vocc_scene holds. */
#ifndef VOCC_SCENE_H
#define VOCC_SCENE_H

#include "bvh.h"
#include "kdtree.h"
#include "mesh.h"
#include "platform.h"
#include "regions.h"
#include "threads.h"
#include "vocc.h"

/* All that a build makes: there whole or not at all. */
typedef struct vocc_built {
    double origin[3];
    vocc_tree tree;
    vocc_bvh bvh;
    vocc_report report;
    int auto_occluders;      /* whether occluders pay in AUTO order */
    uint32_t *mesh_first;    /* first triangle of each mesh, and the total */
    vocc_analysis *analyses; /* of each mesh */
    size_t analysis_count;
    /* Components that are closed and may hold occluders. */
    int32_t *solid_component; /* global number of a solid's component */
    uint8_t *solid_consistent;
    size_t solid_count;
    int32_t *solid_of_triangle; /* of the tree's triangles; -1: none */
    /* Regions grow when a point is found in one that no leaf has. */
    vocc_regions *regions;
    vocc_mutex *regions_mutex;
} vocc_built;

struct vocc_scene {
    vocc_allocator allocator;
    vocc_mesh *meshes;
    size_t mesh_count, mesh_capacity;
    size_t vertex_count, triangle_count;
    size_t most_pairs; /* of nodes; tests set less than the format can hold */
    size_t large;      /* triangles beyond which the tree is coarse; tests: 0 */
    int is_built;
    vocc_built built;
};

VOCC_INLINE vocc_solids vocc_scene_solids(const vocc_scene *scene)
{
    vocc_solids solids;
    solids.of_triangle = scene->built.solid_of_triangle;
    solids.consistent = scene->built.solid_consistent;
    return solids;
}

/* Mesh and triangle of the mesh that triangle `id` of the scene is. */
VOCC_INTERNAL void vocc_scene_triangle(const vocc_scene *scene, uint32_t id,
                                       int32_t *geom_id, int32_t *prim_id);

/* Fails: INVALID_ARGUMENT (NULL), NOT_BUILT. */
VOCC_INTERNAL vocc_status vocc_check_built(const vocc_scene *scene,
                                           vocc_error *error);

#endif
