/* How many samples of each light each point sees. */
#include "array.h"
#include "light.h"
#include "memory.h"
#include "query.h"
#include "sampler.h"
#include "status.h"
#include "vec3.h"

#include <inttypes.h>
#include <math.h>
#include <string.h>

/* Points a job.  Within it the order is light, point, sample: rays that follow
 * each other are alike, and one cache serves one light. */
enum { JOB_POINTS = 256 };

typedef struct shadow {
    vocc_query query;
    size_t count;
    vocc_array points, normals, point_ids;
    const vocc_light *lights;
    size_t light_count;
    vocc_strata strata;
    vocc_stratum *order; /* in which the samples are traced */
    uint16_t *visible;
} shadow;

/* The points of a job, read once for all lights. */
typedef struct tile {
    size_t first, count;
    float point[JOB_POINTS][3];
    double normal[JOB_POINTS][3];
    uint32_t id[JOB_POINTS];
    uint8_t usable[JOB_POINTS];
    double reach[3]; /* largest |coordinate| of a usable point */
} tile;

/* Which point each ray of the block belongs to. */
typedef struct batch {
    uint16_t owner[VOCC_BLOCK];
    uint32_t blocked[JOB_POINTS];
} batch;

static void load_tile(const shadow *s, size_t job, tile *t)
{
    const double *origin = s->query.scene->built.origin;
    size_t i;
    int k;
    t->first = job * JOB_POINTS;
    t->count =
        s->count - t->first < JOB_POINTS ? s->count - t->first : JOB_POINTS;
    t->reach[0] = t->reach[1] = t->reach[2] = 0.0;
    for (i = 0; i < t->count; i++) {
        t->usable[i] = 1;
        for (k = 0; k < 3; k++) {
            t->point[i][k] =
                (float)(vocc_get_float(&s->points, t->first + i, k) -
                        origin[k]);
            t->normal[i][k] = vocc_get_float(&s->normals, t->first + i, k);
            t->usable[i] &= vocc_finitef(t->point[i][k]) != 0;
        }
        t->id[i] =
            s->point_ids.data
                ? *(const uint32_t *)vocc_row(&s->point_ids, t->first + i)
                : (uint32_t)(t->first + i);
        for (k = 0; t->usable[i] && k < 3; k++) {
            const double x = vocc_abs((double)t->point[i][k]);
            t->reach[k] = x > t->reach[k] ? x : t->reach[k];
        }
    }
}

/* Whether the light's centre is above the surface; not so if a value is NaN. */
static int faces(const tile *t, size_t i, const vocc_light *light)
{
    const double *n = t->normal[i];
    const float *p = t->point[i];
    return t->usable[i] && n[0] * (light->centre[0] - (double)p[0]) +
                                   n[1] * (light->centre[1] - (double)p[1]) +
                                   n[2] * (light->centre[2] - (double)p[2]) >
                               0.0;
}

static void trace_batch(shadow *s, const vocc_worker *w, batch *b)
{
    size_t i;
    s->query.kernels->occluded(w->tracer, w->block);
    for (i = 0; i < w->block->count; i++)
        b->blocked[b->owner[i]] += w->block->occluded[i];
    w->block->count = 0;
}

/* One light at all points of a tile. */
static vocc_status light_tile(shadow *s, const vocc_worker *w, int worker,
                              const tile *t, batch *b, size_t l,
                              vocc_jobs *jobs)
{
    const vocc_light *light = &s->lights[l];
    const int32_t end = vocc_light_region(light, w->tracer->tree, t->reach);
    uint16_t *visible = s->visible + l * s->count + t->first;
    vocc_block *block = w->block;
    uint32_t sample, polled = 0;
    size_t i;
    int k;
    memset(b->blocked, 0, sizeof b->blocked);
    w->tracer->cache.count = 0;
    block->count = 0;
    for (i = 0; i < t->count; i++) {
        visible[i] = VOCC_NOT_TRACED;
        if (!faces(t, i, light))
            continue;
        visible[i] = 0;
        for (sample = 0; sample < s->strata.samples; sample++) {
            const size_t r = block->count++;
            float a, c, p[3];
            vocc_sample(&s->strata, t->id[i], (uint32_t)l, &s->order[sample],
                        &a, &c);
            vocc_light_point(light, a, c, p);
            for (k = 0; k < 3; k++) {
                block->org[k][r] = t->point[i][k];
                block->dir[k][r] = p[k] - t->point[i][k];
            }
            block->tmin[r] = 0.0f;
            block->tmax[r] = 1.0f;
            block->end_region[r] = end;
            b->owner[r] = (uint16_t)i;
            if (block->count == VOCC_BLOCK) {
                trace_batch(s, w, b);
                if ((++polled & 15) == 0 && vocc_jobs_poll(jobs, worker))
                    return VOCC_ERROR_CANCELLED;
            }
        }
    }
    trace_batch(s, w, b);
    for (i = 0; i < t->count; i++)
        if (visible[i] != VOCC_NOT_TRACED)
            visible[i] = (uint16_t)(s->strata.samples - b->blocked[i]);
    return VOCC_OK;
}

static vocc_status shade_tile(void *context, size_t job, int worker,
                              vocc_jobs *jobs)
{
    shadow *s = context;
    const vocc_worker *w = &s->query.workers[worker];
    tile t;
    batch b;
    size_t l;
    vocc_status status = VOCC_OK;
    load_tile(s, job, &t);
    for (l = 0; l < s->light_count && status == VOCC_OK; l++)
        status = light_tile(s, w, worker, &t, &b, l, jobs);
    return status;
}

static vocc_status check_shadow(const shadow *s, const vocc_rect_light *lights,
                                int32_t samples, vocc_error *error)
{
    vocc_status status =
        vocc_check_floats(s->points, s->count, "points", error);
    if (status == VOCC_OK)
        status = vocc_check_floats(s->normals, s->count, "normals", error);
    if (status != VOCC_OK)
        return status;
    if (s->point_ids.data && s->point_ids.type != VOCC_UINT32)
        return vocc_fail(error, VOCC_ERROR_INVALID_ARGUMENT, "point_ids", -1,
                         (double)s->point_ids.type,
                         "point_ids: type %" PRId32 " is not VOCC_UINT32",
                         s->point_ids.type);
    if (!lights && s->light_count)
        return vocc_fail(error, VOCC_ERROR_INVALID_ARGUMENT, "lights", -1,
                         (double)NAN, "lights: NULL");
    if (samples < 1 || samples >= VOCC_NOT_TRACED)
        return vocc_fail(error, VOCC_ERROR_INVALID_ARGUMENT, "samples", -1,
                         (double)samples,
                         "samples is %" PRId32 ": it has to be from 1 to %d",
                         samples, VOCC_NOT_TRACED - 1);
    if (s->light_count &&
        s->count > SIZE_MAX / sizeof(uint16_t) / s->light_count)
        return vocc_fail(error, VOCC_ERROR_LIMIT, "count", -1, (double)s->count,
                         "count is %zu: too much for %zu lights", s->count,
                         s->light_count);
    if (!s->visible && s->light_count && s->count)
        return vocc_fail(error, VOCC_ERROR_INVALID_ARGUMENT, "visible", -1,
                         (double)NAN, "visible: NULL");
    return VOCC_OK;
}

vocc_status vocc_light_visibility(const vocc_scene *scene, size_t count,
                                  vocc_array points, vocc_array normals,
                                  vocc_array point_ids, size_t light_count,
                                  const vocc_rect_light *lights,
                                  int32_t samples, uint16_t *visible,
                                  const vocc_query_options *options,
                                  vocc_error *error)
{
    const size_t jobs = count / JOB_POINTS + (count % JOB_POINTS != 0);
    shadow s;
    vocc_light *moved;
    double bad = 0.0;
    vocc_status status;
    size_t l;
    s.count = count;
    s.points = points;
    s.normals = normals;
    s.point_ids = point_ids;
    s.light_count = light_count;
    s.visible = visible;
    status = check_shadow(&s, lights, samples, error);
    if (status != VOCC_OK)
        return status;
    status = vocc_query_begin(&s.query, scene, options, jobs, error);
    if (status != VOCC_OK)
        return status;
    s.strata = vocc_make_strata((uint32_t)samples);
    moved = vocc_allocate(&scene->allocator, light_count, sizeof *moved);
    s.order =
        vocc_allocate(&scene->allocator, (size_t)samples, sizeof *s.order);
    if (!moved || !s.order)
        status = VOCC_ERROR_OUT_OF_MEMORY;
    for (l = 0; status == VOCC_OK && l < light_count; l++)
        if (!vocc_light_init(&moved[l], &lights[l], scene->built.origin, &bad))
            status = VOCC_ERROR_INVALID_ARGUMENT;
    if (status == VOCC_OK) {
        vocc_order_samples(&s.strata, s.order);
        s.lights = moved;
        status = vocc_query_run(&s.query, jobs, shade_tile, &s);
    }
    vocc_release(&scene->allocator, moved);
    vocc_release(&scene->allocator, s.order);
    status = vocc_query_end(&s.query, status, error);
    if (status == VOCC_ERROR_INVALID_ARGUMENT)
        return vocc_fail(error, status, "lights", (int64_t)l - 1, bad,
                         "lights[%zu]: %g is not a finite float32 number",
                         l - 1, bad);
    return status;
}
