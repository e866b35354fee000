/* A shape as a built scene, the ways of querying it, and the comparison of
 * their answers: what the test files share. */
#ifndef VOCC_TEST_WORLD_H
#define VOCC_TEST_WORLD_H

#include "../../csrc/vocc.h"

#include "counting.h"
#include "rays.h"
#include "shapes.h"

typedef struct world {
    counting *memory;
    vocc_scene *scene;
} world;

/* Leaves the test if the build fails.  `build` may be NULL. */
void world_make(world *w, const shape *s, const vocc_build_options *build);
/* The same with a tree of at most so many pairs of nodes; 0: no limit. */
void world_limited(world *w, const shape *s, const vocc_build_options *build,
                   size_t most_pairs);
/* The same with a tree as meshes of many triangles have it. */
void world_coarse(world *w, const shape *s);
/* Frees the scene; anything not freed is a failure. */
void world_free(world *w);

/* Fails with the error's text unless the status is as expected. */
void check_status(const char *file, int line, const char *what,
                  vocc_status status, const vocc_error *error,
                  vocc_status expected);
#define CHECK_STATUS(call, error, expected)                                    \
    check_status(__FILE__, __LINE__, #call, (call), (error), (expected))

/* ---- arrays ------------------------------------------------------------ */

vocc_array rows_of(const void *data, size_t stride, vocc_type type);
vocc_array mesh_vertices(const mesh *m);  /* FLOAT32 */
vocc_array mesh_triangles(const mesh *m); /* INT32 */
vocc_status add_part(vocc_scene *scene, const mesh *m, int occluder,
                     vocc_error *error);
/* Rays first .. first + count - 1 of the set, strided in place. */
vocc_rays rays_view(const ray_set *set, size_t first, size_t count);

/* ---- lights ----------------------------------------------------------- */

#define RECT(x, y, z, ux, uy, uz, vx, vy, vz)                                  \
    {.position = {x, y, z},                                                    \
     .edge_u = {ux, uy, uz},                                                   \
     .edge_v = {vx, vy, vz},                                                   \
     .type = VOCC_LIGHT_RECT}

/* The sampling that needs fewest lines to repeat. */
#define SAMPLING(samples)                                                      \
    (&(vocc_sampling){sizeof(vocc_sampling), (samples), VOCC_SAMPLER_JITTER,   \
                      VOCC_HORIZON_CENTRE})

/* ---- modes ------------------------------------------------------------- */

/* What else there is, in turns; the rest has its default. */
enum {
    BY_DIRECTION = 1,  /* the cache */
    NO_FUSION = 2,     /* leaves in it, not grown boxes */
    LAST_TRIANGLE = 4, /* tested first */
    ENTRY_POINTS = 8,  /* for lights */
    NO_ENTRY_POINTS = 16,
    MANY_TRIANGLES = 32, /* kept by a search */
    IN_VOXELS = 64,      /* for lights */
    BY_BEAMS = 128       /* the hierarchy in place of the tree */
};

typedef struct mode {
    int order, occluders, cache, deferment, packets, isa, threads, extras;
} mode;

/* The order without occluders that everything is compared with: single rays,
 * plain C, one thread. */
mode mode_baseline(void);
void mode_options(const mode *m, vocc_query_options *options);
const char *mode_text(const mode *m); /* static buffer */

/* Whether this build of the library has it. */
int has_order(int order);
int has_isa(int isa);

typedef struct mode_list {
    size_t count;
    mode *modes;
} mode_list;

/* Every order, occluders, packets and isa, with the given choices for the
 * rest (each list ends with -1).  Where an option has no effect by definition
 * it is varied too. */
mode_list modes_of(const int *caches, const int *deferments,
                   const int *threads);
void modes_free(mode_list *list);

/* ---- answers ----------------------------------------------------------- */

/* `set` through vocc_occluded; leaves the test if the call fails. */
void trace(const world *w, const ray_set *set, const mode *m, uint8_t *occluded,
           vocc_counters *counters);
/* Only the rays first .. first + count - 1, into occluded[0 .. count - 1]. */
void trace_some(const world *w, const ray_set *set, size_t first, size_t count,
                const mode *m, uint8_t *occluded, vocc_counters *counters);

/* Fails for the first ray where the answers differ, and says all of it. */
void compare_answers(const char *file, int line, const char *shape_name,
                     const ray_set *set, const mode *m, const uint8_t *actual,
                     const uint8_t *expected);
/* The same of `count` rays from `first` on; both arrays begin there. */
void compare_some(const char *file, int line, const char *shape_name,
                  const ray_set *set, size_t first, size_t count, const mode *m,
                  const uint8_t *actual, const uint8_t *expected);

/* A ray as text, with hexadecimal floats; static buffer. */
const char *ray_text(const oracle_ray *ray);

#endif
