/* Traces the workload through the library's public interface.
 *
 * Modes: NAME[:KEY=VALUE,...]
 *   NAME  baseline   standard order, no occluders
 *         standard, extended, bfs, qdbfs, auto   that order, with occluders
 *         beams, rays   that method, else the defaults
 *   order=... (as NAME), occluders=, cache=, deferment=, packets=, threads=,
 *   isa=auto|scalar|sse2|avx2|avx512|neon, method=auto|rays|beams, verify= */
#include "driver.h"
#include "vocc.h"

#include <inttypes.h>
#include <stdlib.h>
#include <string.h>

typedef struct vb_self {
    const dr_job *job;
    vocc_scene *scene;
    double wall, cpu;
} vb_self;

typedef struct vb_mode {
    vb_self *self;
    vocc_query_options options;
    vocc_light lights[WL_MAX_LIGHTS];
    uint16_t *visible; /* [lights][points] */
} vb_mode;

enum { ORDERS = 8 };
static const char *const orders[ORDERS] = {"auto", "standard", "extended",
                                           "bfs",  "qdbfs",    "opaque_first",
                                           "sato", "rtsah"};

static void check(vocc_status status, const vocc_error *error)
{
    if (status != VOCC_OK)
        wl_die("vocc: %s", error->message);
}

static vocc_array rows(const void *data, size_t stride, vocc_type type)
{
    const vocc_array array = {data, (ptrdiff_t)stride, type};
    return array;
}

static double to_number(const char *key, const char *value)
{
    char *end;
    double x = strtod(value, &end);
    if (end == value || *end != '\0')
        wl_die("%s: '%s' is not a number", key, value);
    return x;
}

/* ---- scene -------------------------------------------------------------- */

static void build_options(vocc_build_options *options, const char *text)
{
    char key[32], value[32];
    while (dr_next_setting(&text, key, value)) {
        double x = to_number(key, value);
        if (strcmp(key, "traversal_cost") == 0)
            options->traversal_cost = (float)x;
        else if (strcmp(key, "intersection_cost") == 0)
            options->intersection_cost = (float)x;
        else if (strcmp(key, "empty_bonus") == 0)
            options->empty_bonus = (float)x;
        else if (strcmp(key, "max_leaf_size") == 0)
            options->max_leaf_size = (int32_t)x;
        else if (strcmp(key, "max_depth") == 0)
            options->max_depth = (int32_t)x;
        else if (strcmp(key, "bad_refines") == 0)
            options->bad_refines = (int32_t)x;
        else
            wl_die("--build: unknown setting %s", key);
    }
}

static void add(vocc_scene *scene, const char *name, size_t nv,
                const float (*vertices)[3], size_t nf,
                const uint32_t (*faces)[3])
{
    vocc_mesh_options options;
    vocc_error error;
    vocc_mesh_options_init(&options);
    options.name = name;
    check(vocc_scene_add_mesh(
              scene, nv, rows(vertices, sizeof *vertices, VOCC_FLOAT32), nf,
              rows(faces, sizeof *faces, VOCC_UINT32), &options, NULL, &error),
          &error);
}

static void *vb_open(const dr_job *job)
{
    static const uint32_t ground[2][3] = {{0, 2, 1}, {0, 3, 2}};
    const wl_mesh *m = &job->mesh;
    vb_self *self = wl_alloc(1, sizeof *self);
    vocc_build_options options;
    vocc_error error;
    self->job = job;
    check(vocc_scene_create(NULL, &self->scene, &error), &error);
    add(self->scene, job->options.mesh_name, m->vertex_count,
        (const float (*)[3])m->vertices, m->face_count,
        (const uint32_t (*)[3])m->faces);
    add(self->scene, "ground", 4,
        (const float (*)[3])m->vertices + m->vertex_count, 2, ground);
    vocc_build_options_init(&options);
    options.threads = job->options.build_threads;
    build_options(&options, job->options.build_options);
    self->cpu = dr_cpu();
    self->wall = dr_wall();
    check(vocc_scene_build(self->scene, &options, &error), &error);
    self->cpu = dr_cpu() - self->cpu;
    self->wall = dr_wall() - self->wall;
    return self;
}

static void vb_close(void *user)
{
    vb_self *self = user;
    vocc_scene_free(self->scene);
    free(self);
}

static void vb_describe(void *user, FILE *json)
{
    const vb_self *self = user;
    vocc_report r;
    vocc_error error;
    memset(&r, 0, sizeof r);
    r.size = sizeof r;
    check(vocc_scene_report(self->scene, &r, &error), &error);
    double triangles = (double)r.triangle_count;
    fprintf(json,
            "\"wall_s\": %.6f, \"cpu_s\": %.6f, \"components_s\": %.6f, "
            "\"tree_s\": %.6f, \"classify_s\": %.6f, \"occluders_s\": %.6f, "
            "\"beams_s\": %.6f, \"threads\": %d, "
            "\"bytes\": %" PRIu64 ", \"bytes_per_triangle\": %.2f, ",
            self->wall, self->cpu, r.seconds_components, r.seconds_build,
            r.seconds_classify, r.seconds_occluders, r.seconds_beams,
            (int)r.threads, r.tree_bytes + r.beam_bytes,
            (double)(r.tree_bytes + r.beam_bytes) / triangles);
    fprintf(json,
            "\"nodes\": %" PRIu64 ", \"boundary\": %" PRIu64
            ", \"opaque\": %" PRIu64 ", \"clear\": %" PRIu64
            ", \"unknown\": %" PRIu64 ", \"references\": %" PRIu64
            ", \"seed_rays\": %" PRIu64 ", \"depth\": %d, \"regions\": %d, ",
            r.node_count, r.boundary_leaves, r.opaque_leaves, r.clear_leaves,
            r.unknown_leaves, r.reference_count, r.seed_rays, (int)r.depth,
            (int)r.region_count);
    fprintf(json,
            "\"opaque_volume\": %.6f, \"area_ratio\": %.4f, "
            "\"auto_order\": \"%s\"",
            r.opaque_volume_fraction,
            r.mesh_area > 0 ? r.occluder_area / r.mesh_area : 0.0,
            orders[r.auto_order]);
}

/* ---- modes -------------------------------------------------------------- */

static int order_of(const char *name, size_t length)
{
    for (int i = 0; i < ORDERS; i++)
        if (strlen(orders[i]) == length && memcmp(orders[i], name, length) == 0)
            return i;
    return -1;
}

static int isa_of(const char *name)
{
    for (int i = VOCC_ISA_AUTO; i <= VOCC_ISA_NEON; i++)
        if (strcmp(vocc_isa_name(i), name) == 0)
            return i;
    wl_die("isa: auto, scalar, sse2, avx2, avx512 or neon, not '%s'", name);
}

static int setting(vocc_query_options *o, const char *key, const char *value)
{
    if (strcmp(key, "order") == 0)
        return (o->order = order_of(value, strlen(value))) >= 0;
    if (strcmp(key, "isa") == 0) {
        o->isa = isa_of(value);
        return 1;
    }
    if (strcmp(key, "method") == 0) {
        o->method = strcmp(value, "rays") == 0    ? VOCC_METHOD_RAYS
                    : strcmp(value, "beams") == 0 ? VOCC_METHOD_BEAMS
                                                  : VOCC_METHOD_AUTO;
        return o->method != VOCC_METHOD_AUTO || strcmp(value, "auto") == 0;
    }
    int32_t n = (int32_t)to_number(key, value);
    if (strcmp(key, "occluders") == 0)
        o->occluders = n;
    else if (strcmp(key, "deferment") == 0)
        o->deferment = n;
    else if (strcmp(key, "cache") == 0)
        o->cache = n;
    else if (strcmp(key, "cache_policy") == 0)
        o->cache_policy = n;
    else if (strcmp(key, "fusion") == 0)
        o->fusion = n;
    else if (strcmp(key, "triangle_cache") == 0)
        o->triangle_cache = n;
    else if (strcmp(key, "entry_points") == 0)
        o->entry_points = n;
    else if (strcmp(key, "entry_triangles") == 0)
        o->entry_triangles = n;
    else if (strcmp(key, "voxels") == 0)
        o->voxels = n;
    else if (strcmp(key, "verify") == 0)
        o->verify = n;
    else if (strcmp(key, "packets") == 0)
        o->packets = n;
    else if (strcmp(key, "threads") == 0)
        o->threads = n;
    else
        return 0;
    return 1;
}

static void vb_trace(void *prepared, const dr_rays *rays, uint8_t *blocked)
{
    const vb_mode *mode = prepared;
    const vocc_rays r = {
        rays->count, rows(rays->org, sizeof *rays->org, VOCC_FLOAT32),
        rows(rays->dir, sizeof *rays->dir, VOCC_FLOAT32),
        rows(NULL, 0, VOCC_FLOAT32), rows(&(const float){1}, 0, VOCC_FLOAT32)};
    vocc_error error;
    check(vocc_occluded(mode->self->scene, &r, blocked, &mode->options, &error),
          &error);
}

/* An order or instruction set may be missing from this build of the library:
 * tracing one ray tells. */
static int supported(const vb_mode *mode, const char **reason)
{
    static const float org[3] = {0, 8, 0}, dir[3] = {0, 1, 0};
    const vocc_rays r = {
        1, rows(org, 0, VOCC_FLOAT32), rows(dir, 0, VOCC_FLOAT32),
        rows(NULL, 0, VOCC_FLOAT32), rows(NULL, 0, VOCC_FLOAT32)};
    uint8_t blocked;
    vocc_status status =
        vocc_occluded(mode->self->scene, &r, &blocked, &mode->options, NULL);
    *reason = vocc_status_string((int32_t)status);
    return status == VOCC_OK;
}

static void *vb_prepare(void *user, const dr_job *job, const char *text,
                        const char **reason)
{
    char key[32], value[32];
    vb_mode *mode = wl_alloc(1, sizeof *mode);
    size_t length = strcspn(text, ":");
    vocc_query_options *o = &mode->options;
    mode->self = user;
    vocc_query_options_init(o);
    o->threads = 1;
    if (length == 8 && memcmp(text, "baseline", 8) == 0) {
        o->order = VOCC_ORDER_STANDARD;
        o->occluders = 0;
        o->cache = 0;
        o->entry_points = 0;
    } else if (length == 5 && memcmp(text, "beams", 5) == 0) {
        o->method = VOCC_METHOD_BEAMS;
    } else if (length == 4 && memcmp(text, "rays", 4) == 0) {
        o->method = VOCC_METHOD_RAYS;
    } else if ((o->order = order_of(text, length)) < 0) {
        *reason = "unknown mode";
        free(mode);
        return NULL;
    }
    text += length + (text[length] == ':');
    while (dr_next_setting(&text, key, value))
        if (!setting(o, key, value)) {
            *reason = "unknown setting";
            free(mode);
            return NULL;
        }
    if (!supported(mode, reason)) {
        free(mode);
        return NULL;
    }
    memset(mode->lights, 0, sizeof mode->lights); /* RECT, two-sided */
    for (int k = 0; k < job->scene.light_count; k++)
        for (int i = 0; i < 3; i++) {
            const wl_light *light = &job->scene.lights[k];
            mode->lights[k].position[i] = (double)light->corner[i];
            mode->lights[k].edge_u[i] = (double)light->edge_u[i];
            mode->lights[k].edge_v[i] = (double)light->edge_v[i];
        }
    size_t count = job->pixel_count * (size_t)job->scene.light_count;
    mode->visible = wl_alloc(count, sizeof *mode->visible);
    /* So that the pages are there before the clock starts. */
    memset(mode->visible, 0xff, count * sizeof *mode->visible);
    return mode;
}

static void vb_release(void *prepared)
{
    vb_mode *mode = prepared;
    free(mode->visible);
    free(mode);
}

static void vb_closest(void *user, size_t count, const float (*org)[3],
                       const float (*dir)[3], int32_t *face)
{
    vb_self *self = user;
    int32_t *geometry = wl_alloc(count, sizeof *geometry);
    const vocc_rays rays = {count, rows(org, sizeof *org, VOCC_FLOAT32),
                            rows(dir, sizeof *dir, VOCC_FLOAT32),
                            rows(NULL, 0, VOCC_FLOAT32),
                            rows(NULL, 0, VOCC_FLOAT32)};
    const vocc_hits hits = {NULL, geometry, face, NULL, NULL};
    vocc_error error;
    check(vocc_intersect(self->scene, &rays, &hits, NULL, &error), &error);
    for (size_t i = 0; i < count; i++)
        if (geometry[i] == 1)
            face[i] += (int32_t)self->job->mesh.face_count;
    free(geometry);
}

static void vb_pass(void *prepared, dr_job *job)
{
    vb_mode *mode = prepared;
    size_t count = job->pixel_count;
    size_t lights = (size_t)job->scene.light_count;
    vocc_sampling sampling;
    vocc_error error;
    vocc_sampling_init(&sampling);
    sampling.samples = (int32_t)job->sampler.samples;
    sampling.sampler = VOCC_SAMPLER_JITTER;
    sampling.horizon = VOCC_HORIZON_CENTRE;
    check(vocc_light_visibility(
              mode->self->scene, count,
              rows(job->points, sizeof *job->points, VOCC_FLOAT32),
              rows(job->normals, sizeof *job->normals, VOCC_FLOAT32),
              rows(job->pixels, sizeof *job->pixels, VOCC_UINT32), lights,
              mode->lights, &sampling, mode->visible, NULL, NULL,
              &mode->options, &error),
          &error);
    size_t area = (size_t)job->gbuffer.width * job->gbuffer.height;
    for (size_t k = 0; k < lights; k++)
        for (size_t n = 0; n < count; n++) {
            uint16_t visible = mode->visible[k * count + n];
            job->image[k * area + job->pixels[n]] =
                visible == VOCC_NOT_TRACED ? WL_NOT_TRACED : visible;
        }
}

static void vb_count(void *prepared, dr_job *job, FILE *json)
{
    vb_mode *mode = prepared;
    vocc_counters c;
    memset(&c, 0, sizeof c);
    mode->options.counters = &c;
    vb_pass(mode, job);
    mode->options.counters = NULL;
    const struct {
        const char *name;
        uint64_t value;
    } all[] = {{"rays", c.rays},
               {"occluded", c.occluded},
               {"packets", c.packets},
               {"node_visits", c.node_visits},
               {"leaf_visits", c.leaf_visits},
               {"triangle_tests", c.triangle_tests},
               {"active_lanes", c.active_lanes},
               {"exact_tests", c.exact_tests},
               {"occluder_hits_tree", c.occluder_hits_tree},
               {"occluder_hits_cache", c.occluder_hits_cache},
               {"cache_lookups", c.cache_lookups},
               {"triangle_cache_hits", c.triangle_cache_hits},
               {"fallbacks", c.fallbacks},
               {"deferred", c.deferred},
               {"queue_pushes", c.queue_pushes},
               {"queue_pops", c.queue_pops},
               {"careful_rays", c.careful_rays},
               {"entry_searches", c.entry_searches},
               {"entry_steps", c.entry_steps},
               {"entry_tests", c.entry_tests},
               {"entry_lit_rays", c.entry_lit_rays},
               {"entry_dark_rays", c.entry_dark_rays},
               {"entry_few_rays", c.entry_few_rays},
               {"voxel_lit_rays", c.voxel_lit_rays},
               {"voxel_dark_rays", c.voxel_dark_rays},
               {"beam_lit_rays", c.beam_lit_rays},
               {"beam_dark_rays", c.beam_dark_rays},
               {"beam_hidden_rays", c.beam_hidden_rays},
               {"beam_tested_rays", c.beam_tested_rays},
               {"beam_box_rays", c.beam_box_rays},
               {"beams", c.beams},
               {"beam_nodes", c.beam_nodes},
               {"beam_clusters", c.beam_clusters},
               {"beam_tests", c.beam_tests}};
    for (size_t i = 0; i < sizeof all / sizeof all[0]; i++)
        fprintf(json, "%s\"%s\": %" PRIu64, i > 0 ? ", " : "", all[i].name,
                all[i].value);
}

int main(int argc, char **argv)
{
    static const dr_backend backend = {
        "vocc",
        "modes: baseline, standard, extended, bfs, qdbfs, auto, with\n"
        "  :occluders=,cache=,deferment=,packets=,threads=,isa=,order=;\n"
        "  none: all but the tracing\n"
        "--build: traversal_cost, intersection_cost, empty_bonus,\n"
        "  max_leaf_size, max_depth, bad_refines\n",
        "baseline",
        vb_open,
        vb_close,
        vb_describe,
        vb_closest,
        vb_prepare,
        vb_release,
        vb_pass,
        vb_trace,
        vb_count};
    return dr_main(argc, argv, &backend);
}
