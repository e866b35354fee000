/* Traces the workload with Embree 3, for comparison.
 *
 * Modes: ROBUST-KIND[:KEY=VALUE,...]
 *   ROBUST  robust | fast (the scene's robust flag)
 *   KIND    1       rtcOccluded1, a ray at a time
 *           4       rtcOccluded4, 4 samples of one pixel and light
 *           s16     rtcOccluded16, one sample of 16 pixels (4 x 4 neighbours)
 *           x16     rtcOccluded16, all samples of 2 x 2 pixels, packed
 *           p16     rtcOccluded16, 4 x 4 neighbouring strata of one pixel
 *           stream  rtcOccluded1M, all samples of 8 x 8 pixels
 *   isa=..., quality=high|medium, coherent=0|1
 * Packets of s16 and x16 are full: pixels that a light is not traced at are
 * left out, not masked. */
#include "driver.h"

#include <embree3/rtcore.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <xmmintrin.h>

enum { MAX_SCENES = 8, STREAM_PIXELS = 8 };

typedef struct em_scene {
    char device_config[64];
    int robust, medium;
    RTCDevice device;
    RTCScene scene;
    ptrdiff_t bytes;
    double wall, cpu;
} em_scene;

typedef struct em_self {
    const dr_job *job;
    int scene_count;
    em_scene scenes[MAX_SCENES];
} em_self;

typedef enum em_kind { EM_1, EM_4, EM_S16, EM_X16, EM_P16, EM_STREAM } em_kind;

typedef struct em_mode {
    RTCScene scene;
    em_kind kind;
    struct RTCIntersectContext context;
    struct RTCRay *stream;          /* STREAM_PIXELS^2 * samples */
    uint16_t **stream_count;        /* of each ray: the counter it adds to */
    uint16_t order[WL_MAX_SAMPLES]; /* the samples by blocks of 4 x 4 strata */
} em_mode;

/* ---- scenes ------------------------------------------------------------- */

static void on_error(void *user, enum RTCError code, const char *text)
{
    (void)user;
    wl_die("Embree: error %d: %s", (int)code, text);
}

static bool on_memory(void *user, ssize_t bytes, bool post)
{
    (void)post;
    __atomic_fetch_add((ptrdiff_t *)user, (ptrdiff_t)bytes, __ATOMIC_RELAXED);
    return true;
}

static void attach(em_scene *s, const float (*vertices)[3], size_t nv,
                   const uint32_t (*faces)[3], size_t nf, uint32_t first)
{
    RTCGeometry g = rtcNewGeometry(s->device, RTC_GEOMETRY_TYPE_TRIANGLE);
    float (*v)[3] = rtcSetNewGeometryBuffer(g, RTC_BUFFER_TYPE_VERTEX, 0,
                                            RTC_FORMAT_FLOAT3, sizeof *v, nv);
    uint32_t (*f)[3] = rtcSetNewGeometryBuffer(g, RTC_BUFFER_TYPE_INDEX, 0,
                                               RTC_FORMAT_UINT3, sizeof *f, nf);
    memcpy(v, vertices, nv * sizeof *v);
    for (size_t n = 0; n < nf; n++)
        for (int j = 0; j < 3; j++)
            f[n][j] = faces[n][j] - first;
    rtcSetGeometryBuildQuality(g, s->medium ? RTC_BUILD_QUALITY_MEDIUM
                                            : RTC_BUILD_QUALITY_HIGH);
    rtcCommitGeometry(g);
    rtcAttachGeometry(s->scene, g);
    rtcReleaseGeometry(g);
}

static em_scene *scene_get(em_self *self, const char *isa, int robust,
                           int medium)
{
    const dr_job *job = self->job;
    char config[64];
    int threads = job->options.build_threads;
    if (isa[0] != '\0')
        snprintf(config, sizeof config, "threads=%d,isa=%s", threads, isa);
    else
        snprintf(config, sizeof config, "threads=%d", threads);
    for (int i = 0; i < self->scene_count; i++) {
        em_scene *s = &self->scenes[i];
        if (strcmp(s->device_config, config) == 0 && s->robust == robust &&
            s->medium == medium)
            return s;
    }
    if (self->scene_count == MAX_SCENES)
        wl_die("more than %d different Embree scenes", (int)MAX_SCENES);
    em_scene *s = &self->scenes[self->scene_count++];
    memcpy(s->device_config, config, sizeof config);
    s->robust = robust;
    s->medium = medium;
    s->device = rtcNewDevice(config);
    if (s->device == NULL)
        wl_die("Embree: no device for %s", config);
    rtcSetDeviceErrorFunction(s->device, on_error, NULL);
    s->scene = rtcNewScene(s->device);
    rtcSetSceneFlags(s->scene,
                     robust ? RTC_SCENE_FLAG_ROBUST : RTC_SCENE_FLAG_NONE);
    rtcSetSceneBuildQuality(s->scene, medium ? RTC_BUILD_QUALITY_MEDIUM
                                             : RTC_BUILD_QUALITY_HIGH);
    const wl_mesh *m = &job->mesh;
    attach(s, (const float (*)[3])m->vertices, m->vertex_count,
           (const uint32_t (*)[3])m->faces, m->face_count, 0);
    attach(s, (const float (*)[3])m->vertices + m->vertex_count, 4,
           (const uint32_t (*)[3])m->faces + m->face_count, 2,
           (uint32_t)m->vertex_count);
    rtcSetDeviceMemoryMonitorFunction(s->device, on_memory, &s->bytes);
    s->cpu = dr_cpu();
    s->wall = dr_wall();
    rtcCommitScene(s->scene);
    s->cpu = dr_cpu() - s->cpu;
    s->wall = dr_wall() - s->wall;
    return s;
}

static void *em_open(const dr_job *job)
{
    em_self *self = wl_alloc(1, sizeof *self);
    memset(self, 0, sizeof *self);
    self->job = job;
    if (job->options.build_only) {
        scene_get(self, "", 1, 0);
        scene_get(self, "", 0, 0);
    }
    return self;
}

static void em_close(void *user)
{
    em_self *self = user;
    for (int i = 0; i < self->scene_count; i++) {
        rtcReleaseScene(self->scenes[i].scene);
        rtcReleaseDevice(self->scenes[i].device);
    }
    free(self);
}

static void em_describe(void *user, FILE *json)
{
    const em_self *self = user;
    double triangles = (double)(self->job->mesh.face_count + 2);
    for (int i = 0; i < self->scene_count; i++) {
        const em_scene *s = &self->scenes[i];
        fprintf(json,
                "%s\"%s %s %s\": {\"wall_s\": %.6f, \"cpu_s\": %.6f, "
                "\"bytes\": %td, \"bytes_per_triangle\": %.2f}",
                i > 0 ? ", " : "", s->robust ? "robust" : "fast",
                s->medium ? "medium" : "high", s->device_config, s->wall,
                s->cpu, s->bytes, (double)s->bytes / triangles);
    }
}

/* ---- modes -------------------------------------------------------------- */

static void order_samples(const wl_sampler *sampler, uint16_t *order)
{
    size_t n = 0;
    for (uint32_t j = 0; j < sampler->nv; j += 4)
        for (uint32_t i = 0; i < sampler->nu; i += 4)
            for (uint32_t y = j; y < j + 4 && y < sampler->nv; y++)
                for (uint32_t x = i; x < i + 4 && x < sampler->nu; x++)
                    order[n++] = (uint16_t)(y * sampler->nu + x);
}

static void *em_prepare(void *user, const dr_job *job, const char *text,
                        const char **reason)
{
    static const char *const kinds[] = {"1",   "4",   "s16",
                                        "x16", "p16", "stream"};
    char key[32], value[32], isa[32] = "";
    int robust = strncmp(text, "robust-", 7) == 0, medium = 0, coherent = 0;
    if (!robust && strncmp(text, "fast-", 5) != 0) {
        *reason = "modes begin with robust- or fast-";
        return NULL;
    }
    text += robust ? 7 : 5;
    size_t length = strcspn(text, ":");
    int kind = -1;
    for (int i = 0; i < 6; i++)
        if (length == strlen(kinds[i]) && memcmp(text, kinds[i], length) == 0)
            kind = i;
    if (kind < 0) {
        *reason = "unknown kind of query";
        return NULL;
    }
    text += length + (text[length] == ':');
    while (dr_next_setting(&text, key, value)) {
        if (strcmp(key, "isa") == 0)
            memcpy(isa, value, sizeof isa);
        else if (strcmp(key, "quality") == 0)
            medium = strcmp(value, "medium") == 0;
        else if (strcmp(key, "coherent") == 0)
            coherent = strcmp(value, "1") == 0;
        else {
            *reason = "unknown setting";
            return NULL;
        }
    }
    em_mode *mode = wl_alloc(1, sizeof *mode);
    size_t rays = (size_t)STREAM_PIXELS * STREAM_PIXELS * job->sampler.samples;
    mode->scene = scene_get(user, isa, robust, medium)->scene;
    mode->kind = (em_kind)kind;
    mode->stream = wl_alloc(rays, sizeof *mode->stream);
    mode->stream_count = wl_alloc(rays, sizeof *mode->stream_count);
    order_samples(&job->sampler, mode->order);
    rtcInitIntersectContext(&mode->context);
    mode->context.flags = coherent ? RTC_INTERSECT_CONTEXT_FLAG_COHERENT
                                   : RTC_INTERSECT_CONTEXT_FLAG_INCOHERENT;
    return mode;
}

static void em_release(void *prepared)
{
    em_mode *mode = prepared;
    free(mode->stream);
    free(mode->stream_count);
    free(mode);
}

static void ray_init(struct RTCRay *ray, const float org[3], float dx, float dy,
                     float dz)
{
    ray->org_x = org[0];
    ray->org_y = org[1];
    ray->org_z = org[2];
    ray->dir_x = dx;
    ray->dir_y = dy;
    ray->dir_z = dz;
    ray->tnear = 0;
    ray->tfar = 1;
    ray->time = 0;
    ray->mask = UINT32_MAX;
    ray->id = 0;
    ray->flags = 0;
}

static void em_closest(void *user, size_t count, const float (*org)[3],
                       const float (*dir)[3], int32_t *face)
{
    em_self *self = user;
    RTCScene scene = scene_get(self, "", 1, 0)->scene;
    struct RTCIntersectContext context;
    rtcInitIntersectContext(&context);
    for (size_t i = 0; i < count; i++) {
        struct RTCRayHit query;
        ray_init(&query.ray, org[i], dir[i][0], dir[i][1], dir[i][2]);
        query.ray.tfar = INFINITY;
        query.hit.geomID = RTC_INVALID_GEOMETRY_ID;
        query.hit.instID[0] = RTC_INVALID_GEOMETRY_ID;
        rtcIntersect1(scene, &context, &query);
        if (query.hit.geomID == RTC_INVALID_GEOMETRY_ID)
            face[i] = -1;
        else
            face[i] =
                (int32_t)query.hit.primID +
                (query.hit.geomID == 1 ? (int32_t)self->job->mesh.face_count
                                       : 0);
    }
}

/* ---- passes ------------------------------------------------------------- */

static uint16_t *counter(dr_job *job, int k, uint32_t p)
{
    size_t area = (size_t)job->gbuffer.width * job->gbuffer.height;
    return &job->image[(size_t)k * area + p];
}

static void pass_1(em_mode *mode, dr_job *job)
{
    float dx[WL_MAX_SAMPLES], dy[WL_MAX_SAMPLES], dz[WL_MAX_SAMPLES];
    uint32_t samples = job->sampler.samples;
    for (size_t n = 0; n < job->pixel_count; n++) {
        uint32_t p = job->pixels[n];
        const float *on = job->gbuffer.on[p];
        for (int k = 0; k < job->scene.light_count; k++) {
            if (!wl_facing(&job->scene.lights[k], on))
                continue;
            wl_directions(&job->sampler, k, p, on, dx, dy, dz);
            uint32_t visible = 0;
            for (uint32_t s = 0; s < samples; s++) {
                struct RTCRay ray;
                ray_init(&ray, on, dx[s], dy[s], dz[s]);
                rtcOccluded1(mode->scene, &mode->context, &ray);
                visible += ray.tfar >= 0;
            }
            *counter(job, k, p) = (uint16_t)visible;
        }
    }
}

static void pass_4(em_mode *mode, dr_job *job)
{
    float d[3][WL_MAX_SAMPLES + 4];
    uint32_t samples = job->sampler.samples;
    memset(d, 0, sizeof d);
    for (size_t n = 0; n < job->pixel_count; n++) {
        uint32_t p = job->pixels[n];
        const float *on = job->gbuffer.on[p];
        for (int k = 0; k < job->scene.light_count; k++) {
            if (!wl_facing(&job->scene.lights[k], on))
                continue;
            wl_directions(&job->sampler, k, p, on, d[0], d[1], d[2]);
            uint32_t visible = 0;
            for (uint32_t s = 0; s < samples; s += 4) {
                struct RTCRay4 ray;
                int __attribute__((aligned(16))) valid[4];
                for (uint32_t i = 0; i < 4; i++) {
                    valid[i] = s + i < samples ? -1 : 0;
                    ray.org_x[i] = on[0];
                    ray.org_y[i] = on[1];
                    ray.org_z[i] = on[2];
                    ray.dir_x[i] = d[0][s + i];
                    ray.dir_y[i] = d[1][s + i];
                    ray.dir_z[i] = d[2][s + i];
                    ray.tnear[i] = 0;
                    ray.tfar[i] = 1;
                    ray.time[i] = 0;
                    ray.mask[i] = UINT32_MAX;
                    ray.id[i] = 0;
                    ray.flags[i] = 0;
                }
                rtcOccluded4(valid, mode->scene, &mode->context, &ray);
                for (uint32_t i = 0; i < 4; i++)
                    visible += (uint32_t)(valid[i] & (ray.tfar[i] >= 0));
            }
            *counter(job, k, p) = (uint16_t)visible;
        }
    }
}

/* Up to 16 rays whose org and dir are set already; the rest is masked.  A bit
 * for each visible ray. */
static uint32_t trace_16(em_mode *mode, struct RTCRay16 *ray, size_t lanes)
{
    int __attribute__((aligned(64))) valid[16];
    for (size_t i = 0; i < 16; i++) {
        valid[i] = i < lanes ? -1 : 0;
        ray->tnear[i] = 0;
        ray->tfar[i] = 1;
        ray->time[i] = 0;
        ray->mask[i] = UINT32_MAX;
        ray->id[i] = 0;
        ray->flags[i] = 0;
    }
    rtcOccluded16(valid, mode->scene, &mode->context, ray);
    uint32_t visible = 0;
    for (size_t i = 0; i < 16; i++)
        visible |= (uint32_t)(ray->tfar[i] >= 0) << i;
    return visible & (lanes < 16 ? (1u << lanes) - 1 : 0xffffu);
}

/* The pixels of a tile that light k is traced at, in blocks of `block` squared
 * neighbours.  Sets their counters to 0. */
static size_t facing_pixels(dr_job *job, const uint32_t corner[2],
                            uint32_t block, int k,
                            uint32_t pixels[WL_TILE * WL_TILE])
{
    const wl_gbuffer *g = &job->gbuffer;
    size_t count = 0;
    for (uint32_t by = 0; by < WL_TILE; by += block)
        for (uint32_t bx = 0; bx < WL_TILE; bx += block)
            for (uint32_t i = 0; i < block * block; i++) {
                uint32_t x = corner[0] + bx + i % block;
                uint32_t y = corner[1] + by + i / block;
                if (x >= g->width || y >= g->height)
                    continue;
                uint32_t p = y * g->width + x;
                if (g->prim[p] < 0 ||
                    !wl_facing(&job->scene.lights[k], g->on[p]))
                    continue;
                *counter(job, k, p) = 0;
                pixels[count++] = p;
            }
    return count;
}

static void pass_s16(em_mode *mode, dr_job *job)
{
    uint32_t pixels[WL_TILE * WL_TILE];
    for (size_t tile = 0; tile < job->tile_count; tile++)
        for (int k = 0; k < job->scene.light_count; k++) {
            size_t count = facing_pixels(job, job->tiles[tile], 4, k, pixels);
            for (size_t n = 0; n < count; n += 16) {
                size_t lanes = count - n < 16 ? count - n : 16;
                float org[3][16];
                uint16_t visible[16] = {0};
                for (size_t i = 0; i < lanes; i++)
                    for (int c = 0; c < 3; c++)
                        org[c][i] = job->gbuffer.on[pixels[n + i]][c];
                for (uint32_t s = 0; s < job->sampler.samples; s++) {
                    struct RTCRay16 ray;
                    memcpy(ray.org_x, org[0], sizeof ray.org_x);
                    memcpy(ray.org_y, org[1], sizeof ray.org_y);
                    memcpy(ray.org_z, org[2], sizeof ray.org_z);
                    wl_directions_of_sample(&job->sampler, k, s, lanes,
                                            pixels + n, org[0], org[1], org[2],
                                            ray.dir_x, ray.dir_y, ray.dir_z);
                    uint32_t mask = trace_16(mode, &ray, lanes);
                    for (size_t i = 0; i < 16; i++)
                        visible[i] = (uint16_t)(visible[i] + (mask >> i & 1));
                }
                for (size_t i = 0; i < lanes; i++)
                    *counter(job, k, pixels[n + i]) = visible[i];
            }
        }
}

/* Rays sample by sample over `group` pixels: neighbours in a packet differ
 * little in both origin and target. */
static void pass_x16(em_mode *mode, dr_job *job)
{
    enum { GROUP = 4 };
    uint32_t pixels[WL_TILE * WL_TILE], samples = job->sampler.samples;
    float d[GROUP][3][WL_MAX_SAMPLES];
    for (size_t tile = 0; tile < job->tile_count; tile++)
        for (int k = 0; k < job->scene.light_count; k++) {
            size_t count = facing_pixels(job, job->tiles[tile], 2, k, pixels);
            for (size_t n = 0; n < count; n += GROUP) {
                size_t group = count - n < GROUP ? count - n : GROUP;
                uint32_t visible[GROUP] = {0};
                for (size_t i = 0; i < group; i++)
                    wl_directions(&job->sampler, k, pixels[n + i],
                                  job->gbuffer.on[pixels[n + i]], d[i][0],
                                  d[i][1], d[i][2]);
                uint32_t s = 0;
                size_t i = 0;
                while (s < samples) {
                    struct RTCRay16 ray;
                    uint8_t owner[16];
                    size_t lane = 0;
                    for (; lane < 16 && s < samples; lane++) {
                        const float *on = job->gbuffer.on[pixels[n + i]];
                        ray.org_x[lane] = on[0];
                        ray.org_y[lane] = on[1];
                        ray.org_z[lane] = on[2];
                        ray.dir_x[lane] = d[i][0][s];
                        ray.dir_y[lane] = d[i][1][s];
                        ray.dir_z[lane] = d[i][2][s];
                        owner[lane] = (uint8_t)i;
                        if (++i == group) {
                            i = 0;
                            s++;
                        }
                    }
                    uint32_t mask = trace_16(mode, &ray, lane);
                    for (size_t l = 0; l < lane; l++)
                        visible[owner[l]] += mask >> l & 1;
                }
                for (i = 0; i < group; i++)
                    *counter(job, k, pixels[n + i]) = (uint16_t)visible[i];
            }
        }
}

/* Many samples: a pixel and a light fill packets alone. */
static void pass_p16(em_mode *mode, dr_job *job)
{
    uint32_t samples = job->sampler.samples;
    float d[3][WL_MAX_SAMPLES];
    for (size_t n = 0; n < job->pixel_count; n++) {
        uint32_t p = job->pixels[n];
        const float *on = job->gbuffer.on[p];
        for (int k = 0; k < job->scene.light_count; k++) {
            if (!wl_facing(&job->scene.lights[k], on))
                continue;
            wl_directions(&job->sampler, k, p, on, d[0], d[1], d[2]);
            int visible = 0;
            for (uint32_t s = 0; s < samples; s += 16) {
                struct RTCRay16 ray;
                uint32_t lanes = samples - s < 16 ? samples - s : 16;
                for (uint32_t i = 0; i < 16; i++) {
                    uint32_t sample = mode->order[i < lanes ? s + i : s];
                    ray.org_x[i] = on[0];
                    ray.org_y[i] = on[1];
                    ray.org_z[i] = on[2];
                    ray.dir_x[i] = d[0][sample];
                    ray.dir_y[i] = d[1][sample];
                    ray.dir_z[i] = d[2][sample];
                }
                visible += __builtin_popcount(trace_16(mode, &ray, lanes));
            }
            *counter(job, k, p) = (uint16_t)visible;
        }
    }
}

static void pass_stream(em_mode *mode, dr_job *job)
{
    uint32_t pixels[WL_TILE * WL_TILE], samples = job->sampler.samples;
    const size_t group = (size_t)STREAM_PIXELS * STREAM_PIXELS;
    float dx[WL_MAX_SAMPLES], dy[WL_MAX_SAMPLES], dz[WL_MAX_SAMPLES];
    for (size_t tile = 0; tile < job->tile_count; tile++)
        for (int k = 0; k < job->scene.light_count; k++) {
            size_t count =
                facing_pixels(job, job->tiles[tile], STREAM_PIXELS, k, pixels);
            for (size_t n = 0; n < count; n += group) {
                unsigned rays = 0;
                for (size_t i = n; i < count && i < n + group; i++) {
                    const float *on = job->gbuffer.on[pixels[i]];
                    wl_directions(&job->sampler, k, pixels[i], on, dx, dy, dz);
                    for (uint32_t s = 0; s < samples; s++, rays++) {
                        ray_init(&mode->stream[rays], on, dx[s], dy[s], dz[s]);
                        mode->stream_count[rays] = counter(job, k, pixels[i]);
                    }
                }
                rtcOccluded1M(mode->scene, &mode->context, mode->stream, rays,
                              sizeof *mode->stream);
                for (unsigned ray = 0; ray < rays; ray++)
                    if (mode->stream[ray].tfar >= 0)
                        ++*mode->stream_count[ray];
            }
        }
}

/* Embree's manual asks for denormals to be flushed; no ray here has any. */
static unsigned begin_flushing(void)
{
    unsigned before = _mm_getcsr();
    _mm_setcsr(before | 0x8040);
    return before;
}

static void em_pass(void *prepared, dr_job *job)
{
    static void (*const passes[])(em_mode *, dr_job *) = {
        pass_1, pass_4, pass_s16, pass_x16, pass_p16, pass_stream};
    em_mode *mode = prepared;
    unsigned before = begin_flushing();
    passes[mode->kind](mode, job);
    _mm_setcsr(before);
}

/* ---- arrays of rays ----------------------------------------------------- */

static void array_1(em_mode *mode, const dr_rays *rays, uint8_t *blocked)
{
    for (size_t n = 0; n < rays->count; n++) {
        struct RTCRay ray;
        const float *d = rays->dir[n];
        ray_init(&ray, rays->org[n], d[0], d[1], d[2]);
        rtcOccluded1(mode->scene, &mode->context, &ray);
        blocked[n] = ray.tfar < 0;
    }
}

static void array_4(em_mode *mode, const dr_rays *rays, uint8_t *blocked)
{
    for (size_t n = 0; n < rays->count; n += 4) {
        struct RTCRay4 ray;
        int __attribute__((aligned(16))) valid[4];
        for (size_t i = 0; i < 4; i++) {
            size_t at = n + i < rays->count ? n + i : n;
            valid[i] = n + i < rays->count ? -1 : 0;
            ray.org_x[i] = rays->org[at][0];
            ray.org_y[i] = rays->org[at][1];
            ray.org_z[i] = rays->org[at][2];
            ray.dir_x[i] = rays->dir[at][0];
            ray.dir_y[i] = rays->dir[at][1];
            ray.dir_z[i] = rays->dir[at][2];
            ray.tnear[i] = 0;
            ray.tfar[i] = 1;
            ray.time[i] = 0;
            ray.mask[i] = UINT32_MAX;
            ray.id[i] = 0;
            ray.flags[i] = 0;
        }
        rtcOccluded4(valid, mode->scene, &mode->context, &ray);
        for (size_t i = 0; i < 4 && n + i < rays->count; i++)
            blocked[n + i] = ray.tfar[i] < 0;
    }
}

static void array_16(em_mode *mode, const dr_rays *rays, uint8_t *blocked)
{
    for (size_t n = 0; n < rays->count; n += 16) {
        struct RTCRay16 ray;
        size_t lanes = rays->count - n < 16 ? rays->count - n : 16;
        for (size_t i = 0; i < 16; i++) {
            size_t at = i < lanes ? n + i : n;
            ray.org_x[i] = rays->org[at][0];
            ray.org_y[i] = rays->org[at][1];
            ray.org_z[i] = rays->org[at][2];
            ray.dir_x[i] = rays->dir[at][0];
            ray.dir_y[i] = rays->dir[at][1];
            ray.dir_z[i] = rays->dir[at][2];
        }
        uint32_t visible = trace_16(mode, &ray, lanes);
        for (size_t i = 0; i < lanes; i++)
            blocked[n + i] = !(visible >> i & 1);
    }
}

static void array_stream(em_mode *mode, const dr_rays *rays, uint8_t *blocked)
{
    const size_t group = (size_t)STREAM_PIXELS * STREAM_PIXELS;
    for (size_t n = 0; n < rays->count; n += group) {
        size_t count = rays->count - n < group ? rays->count - n : group;
        for (size_t i = 0; i < count; i++) {
            const float *d = rays->dir[n + i];
            ray_init(&mode->stream[i], rays->org[n + i], d[0], d[1], d[2]);
        }
        rtcOccluded1M(mode->scene, &mode->context, mode->stream,
                      (unsigned)count, sizeof *mode->stream);
        for (size_t i = 0; i < count; i++)
            blocked[n + i] = mode->stream[i].tfar < 0;
    }
}

static void em_trace(void *prepared, const dr_rays *rays, uint8_t *blocked)
{
    static void (*const arrays[])(em_mode *, const dr_rays *, uint8_t *) = {
        array_1, array_4, array_16, array_16, array_16, array_stream};
    em_mode *mode = prepared;
    unsigned before = begin_flushing();
    arrays[mode->kind](mode, rays, blocked);
    _mm_setcsr(before);
}

int main(int argc, char **argv)
{
    static const dr_backend backend = {
        "embree",
        "modes: robust-KIND or fast-KIND, KIND 1, 4, s16, x16, p16 or stream,\n"
        "  with :isa=sse4.2|avx|avx2|avx512,quality=high|medium,coherent=0|1;\n"
        "  none: all but the tracing\n",
        "robust-1",
        em_open,
        em_close,
        em_describe,
        em_closest,
        em_prepare,
        em_release,
        em_pass,
        em_trace,
        NULL};
    return dr_main(argc, argv, &backend);
}
