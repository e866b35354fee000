/* The soft-shadow workload: mesh, camera, shading points, lights and samples,
 * the same rays on every machine.  docs/benchmark.md defines them.
 *
 * All float32 arithmetic here is one rounding an operation, in the order
 * written; compile with -ffp-contract=off.  Programs that trace the workload
 * (run_vocc, run_embree) share these functions, so that they differ in nothing
 * but the tracing. */
#ifndef WORKLOAD_H
#define WORKLOAD_H

#include <stddef.h>
#include <stdint.h>

enum {
    WL_MAX_LIGHTS = 8,    /* what the hash key has room for, */
    WL_MAX_SAMPLES = 256, /* each with so many samples */
    WL_TILE = 32,
    WL_NOT_TRACED = 0xffff
};

/* A triangle mesh of unit extent that stands on y = 0.  The ground's 4 vertices
 * and 2 triangles follow the mesh's own in the same arrays. */
typedef struct wl_mesh {
    size_t vertex_count; /* without the ground */
    size_t face_count;   /* without the ground */
    float (*vertices)[3];
    uint32_t (*faces)[3];
} wl_mesh;

/* Shading points: origin (already off the surface) and normal of each pixel. */
typedef struct wl_gbuffer {
    uint32_t width, height;
    float (*on)[6];
    int32_t *prim; /* -1: background */
} wl_gbuffer;

typedef struct wl_light {
    float corner[3], edge_u[3], edge_v[3];
} wl_light;

/* What is around a mesh. */
typedef struct wl_scene {
    const char *name;
    int copies; /* of the mesh, along x and along z */
    /* Float32 numbers; with copies, x and z are in steps from one to the next
     * until the mesh is loaded. */
    double eye[3];
    double target[3], tan_half_fov;
    int light_count;
    const wl_light *lights;
} wl_scene;

/* Strata of one light's samples. */
typedef struct wl_sampler {
    const wl_light *lights;
    uint32_t samples, nu, nv;
    float inv_nu, inv_nv;
    float i[WL_MAX_SAMPLES], j[WL_MAX_SAMPLES]; /* of each sample */
} wl_sampler;

/* Closest hits of `count` rays, t > 0, as face indices of wl_mesh or -1. */
typedef void (*wl_closest_fn)(void *user, size_t count, const float (*org)[3],
                              const float (*dir)[3], int32_t *face);

/* Ends the program with a message. */
#if defined(__GNUC__)
__attribute__((noreturn, format(printf, 1, 2)))
#endif
void wl_die(const char *format, ...);

/* malloc of count * size bytes that never fails. */
void *wl_alloc(size_t count, size_t size);

/* The scene of that name: workload, crowd or street. */
wl_scene wl_scene_named(const char *name);

/* Reads a binary little-endian PLY, normalises it and places its copies. */
wl_mesh wl_mesh_load(const char *path, wl_scene *scene);
/* The bounds of the mesh, without the ground. */
void wl_mesh_bounds(const wl_mesh *mesh, double lower[3], double upper[3]);
void wl_mesh_free(wl_mesh *mesh);

/* Fills an image by shooting one camera ray a pixel. */
wl_gbuffer wl_gbuffer_make(const wl_mesh *mesh, const wl_scene *scene,
                           uint32_t width, uint32_t height,
                           wl_closest_fn closest, void *user);
/* Returns 0 if there is no such file. */
int wl_gbuffer_load(wl_gbuffer *gbuffer, const char *path);
void wl_gbuffer_save(const wl_gbuffer *gbuffer, const char *path);
void wl_gbuffer_free(wl_gbuffer *gbuffer);

/* Keeps a pointer to the lights. */
void wl_sampler_init(wl_sampler *sampler, uint32_t samples,
                     const wl_light *lights);

/* Whether a light is traced at a pixel with this origin and normal. */
int wl_facing(const wl_light *light, const float on[6]);

/* Directions of all samples of light k from pixel p. */
void wl_directions(const wl_sampler *sampler, int k, uint32_t p,
                   const float org[3], float *dx, float *dy, float *dz);

/* Directions of sample s of light k from `lanes` pixels. */
void wl_directions_of_sample(const wl_sampler *sampler, int k, uint32_t s,
                             size_t lanes, const uint32_t *p, const float *ox,
                             const float *oy, const float *oz, float *dx,
                             float *dy, float *dz);

/* The first pixels (upper left corners) of the 32 x 32 tiles, row by row: all
 * of them, or `limit` of them evenly spread when limit > 0. */
size_t wl_tiles(uint32_t width, uint32_t height, size_t limit,
                uint32_t (**corners)[2]);

/* A well mixed permutation of the 32-bit numbers. */
uint32_t wl_hash32(uint32_t x);

/* FNV-1a, 64 bits. */
uint64_t wl_hash(const uint8_t *bytes, size_t count);

#endif
