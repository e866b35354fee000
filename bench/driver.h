/* The command line, clocks and output that run_vocc and run_embree share. */
#ifndef DRIVER_H
#define DRIVER_H

#include "workload.h"

#include <stdio.h>

/* What is timed: the whole pass, or the tracing of ray arrays that hold all
 * rays, or only those with a known outcome. */
typedef enum dr_kind { DR_PASS, DR_ALL, DR_BLOCKED, DR_VISIBLE } dr_kind;

/* Of the arrays: tile, pixel, light, sample; the same rays shuffled; or as many
 * segments between random points in the bounds of the mesh. */
typedef enum dr_order { DR_TILE, DR_SHUFFLE, DR_RANDOM } dr_order;

typedef struct dr_options {
    const char *mesh_path, *mesh_name, *scene_name;
    const char *gbuffer_path; /* loaded; made and written where absent */
    const char *counts_path, *dump_path, *load_path, *trace_in, *trace_out;
    const char *build_options;
    uint32_t size, samples;
    size_t tile_limit;
    int repeat, counters, build_only, build_threads;
    dr_kind kind;
    dr_order order;
} dr_options;

typedef struct dr_rays {
    size_t count;
    float (*org)[3], (*dir)[3];
} dr_rays;

/* All that a pass reads and writes.  `pixels` holds the pixels of the chosen
 * tiles in tile order, without the background; `points` and `normals` are
 * their G-buffer rows. */
typedef struct dr_job {
    dr_options options;
    wl_scene scene;
    wl_mesh mesh;
    wl_gbuffer gbuffer;
    wl_sampler sampler;
    size_t tile_count;
    uint32_t (*tiles)[2];
    size_t pixel_count;
    uint32_t *pixels;
    float (*points)[3], (*normals)[3];
    uint16_t *image; /* [lights][height][width] visible samples */
    dr_rays rays;
    uint8_t *blocked; /* of `rays`, as just traced */
} dr_job;

/* A tracer.  `prepare` turns a mode's name into what `pass` and `trace` take,
 * and does all that is not to be timed; it returns NULL, and a reason, for a
 * mode that it does not have. */
typedef struct dr_backend {
    const char *program, *usage, *reference_mode;
    void *(*open)(const dr_job *job);
    void (*close)(void *self);
    void (*describe)(void *self, FILE *json);
    wl_closest_fn closest;
    void *(*prepare)(void *self, const dr_job *job, const char *mode,
                     const char **reason);
    void (*release)(void *prepared);
    void (*pass)(void *prepared, dr_job *job);
    void (*trace)(void *prepared, const dr_rays *rays, uint8_t *blocked);
    /* Runs the pass once more and prints what it counted as members of a JSON
     * object; NULL where nothing can be counted. */
    void (*count)(void *prepared, dr_job *job, FILE *json);
} dr_backend;

double dr_wall(void);
double dr_cpu(void); /* of all threads of the process */

/* Takes the next "key=value" from *text; returns 0 at its end. */
int dr_next_setting(const char **text, char key[32], char value[32]);

int dr_main(int argc, char **argv, const dr_backend *backend);

#endif
