/* How many samples of each light each point sees. */
#include "array.h"
#include "light.h"
#include "memory.h"
#include "query.h"
#include "sampler.h"
#include "shaft.h"
#include "status.h"
#include "tile.h"
#include "vec3.h"

#include <inttypes.h>
#include <math.h>
#include <string.h>

typedef struct shadow {
    vocc_query query;
    vocc_points points;
    const vocc_light *lights;
    size_t light_count;
    vocc_strata strata;
    vocc_stratum *order; /* in which the samples are traced */
    uint16_t *visible;
} shadow;

/* One light at the points of a tile, under way. */
typedef struct lighting {
    const shadow *s;
    int worker_number;
    const vocc_worker *worker;
    const vocc_tile *t;
    size_t number; /* of the light */
    const vocc_light *light;
    vocc_target target;
    uint16_t lit[VOCC_TILE_POINTS]; /* the points that face the light */
    uint16_t owner[VOCC_BLOCK];     /* the point of each ray of the block */
    uint32_t blocked[VOCC_TILE_POINTS];
    /* Triangles that the rays can meet; NULL: all below the entry node. */
    const uint32_t *among;
    int among_count;
    uint64_t work; /* since the last poll, in rays */
    vocc_jobs *jobs;
    vocc_shaft shaft;
    vocc_shaft_walk walk;
} lighting;

/* ---- rays -------------------------------------------------------------------
 */

/* Some milliseconds. */
enum { POLL_RAYS = 16 * VOCC_BLOCK };

/* Work as long as that of so many rays is done. */
static vocc_status poll(lighting *g, uint64_t rays)
{
    g->work += rays;
    if (g->work < POLL_RAYS)
        return VOCC_OK;
    g->work = 0;
    return vocc_jobs_poll(g->jobs, g->worker_number) ? VOCC_ERROR_CANCELLED
                                                     : VOCC_OK;
}

/* Whether the light's centre is above the surface; not so if a value is NaN. */
static int faces(const vocc_tile *t, size_t i, const vocc_light *light)
{
    const double *n = t->normal[i];
    const float *p = t->point[i];
    return n[0] * (light->centre[0] - (double)p[0]) +
               n[1] * (light->centre[1] - (double)p[1]) +
               n[2] * (light->centre[2] - (double)p[2]) >
           0.0;
}

static vocc_status trace_block(lighting *g)
{
    vocc_block *block = g->worker->block;
    const size_t rays = block->count;
    size_t i;
    if (g->among)
        g->s->query.kernels->occluded_among(g->worker->tracer, block, g->among,
                                            g->among_count);
    else
        g->s->query.kernels->occluded(g->worker->tracer, block);
    for (i = 0; i < rays; i++)
        g->blocked[g->owner[i]] += block->occluded[i];
    block->count = 0;
    return poll(g, rays);
}

/* All samples at one point. */
static vocc_status trace_point(lighting *g, uint16_t which)
{
    const shadow *s = g->s;
    const float *const point = g->t->point[which];
    vocc_block *block = g->worker->block;
    uint32_t sample;
    int k;
    for (sample = 0; sample < s->strata.samples; sample++) {
        const size_t r = block->count++;
        float a, b, p[3];
        vocc_sample(&s->strata, g->t->id[which], (uint32_t)g->number,
                    &s->order[sample], &a, &b);
        vocc_light_point(g->light, a, b, p);
        for (k = 0; k < 3; k++) {
            block->org[k][r] = point[k];
            block->dir[k][r] = p[k] - point[k];
        }
        block->tmin[r] = 0.0f;
        block->tmax[r] = 1.0f;
        block->end_region[r] = g->target.region;
        g->owner[r] = which;
        if (block->count == VOCC_BLOCK) {
            const vocc_status status = trace_block(g);
            if (status != VOCC_OK)
                return status;
        }
    }
    return VOCC_OK;
}

static vocc_status trace_group(lighting *g, const uint16_t *which, size_t count)
{
    uint32_t *const steps = g->s->query.options.point_steps;
    const uint64_t *const visits = &g->worker->tracer->counters.node_visits;
    vocc_status status = VOCC_OK;
    size_t i;
    for (i = 0; i < count && status == VOCC_OK; i++) {
        const uint64_t before = *visits;
        status = trace_point(g, which[i]);
        /* Packets of this point only. */
        if (steps && status == VOCC_OK)
            status = trace_block(g);
        if (steps)
            steps[g->t->number[which[i]]] += (uint32_t)(*visits - before);
    }
    return status == VOCC_OK ? trace_block(g) : status;
}

/* ---- groups of points -------------------------------------------------------
 */

/* A group that a shaft cannot settle is quartered until it is as small as
 * this: a walk costs about as much as the rays of some points. */
enum { SMALLEST_GROUP = 4, MOST_SKIPPED = 64 };

/* A walk may look at so many nodes and triangles, and at as many more for each
 * ray: that is less than tracing the rays takes.  A concave receiver would have
 * it look at all of its triangles, which are all beside the shaft. */
enum { FREE_STEPS = 64, STEPS_A_RAY = 8, MOST_SAMPLES = 64 };

/* Steps of a walk that take as long as a ray. */
enum { STEPS_LIKE_A_RAY = 8 };

static vocc_status walk_group(lighting *g, const uint16_t *which, size_t count,
                              vocc_shaft_result *found)
{
    vocc_tracer *tracer = g->worker->tracer;
    const vocc_counters *const c = &tracer->counters;
    const uint64_t before = c->entry_steps + c->entry_tests;
    const uint32_t samples = g->s->strata.samples < MOST_SAMPLES
                                 ? g->s->strata.samples
                                 : MOST_SAMPLES;
    *found = VOCC_SHAFT_MANY;
    tracer->counters.entry_searches++;
    if (!vocc_shaft_init(&g->shaft, tracer->tree, g->t->point, which, count,
                         &g->target)) {
        vocc_shaft_walk_at_root(&g->walk, tracer->tree);
        return VOCC_OK;
    }
    g->walk.budget =
        FREE_STEPS + STEPS_A_RAY * (int64_t)count * (int64_t)samples;
    *found = (vocc_shaft_result)g->s->query.kernels->walk_shaft(
        tracer, &g->shaft, &g->walk);
    return poll(g, 1 + (c->entry_steps + c->entry_tests - before) /
                           STEPS_LIKE_A_RAY);
}

/* All rays of the group are lit, or all dark. */
static uint64_t settle_group(lighting *g, const uint16_t *which, size_t count,
                             int dark)
{
    const uint32_t samples = g->s->strata.samples;
    const uint64_t rays = (uint64_t)count * samples;
    size_t i;
    g->worker->tracer->counters.rays += rays;
    if (dark) {
        g->worker->tracer->counters.occluded += rays;
        for (i = 0; i < count; i++)
            g->blocked[which[i]] = samples;
    }
    return rays;
}

static vocc_status light_group(lighting *g, const uint16_t *which, size_t count)
{
    vocc_tracer *tracer = g->worker->tracer;
    vocc_counters *counters = &tracer->counters;
    vocc_shaft_result found;
    vocc_status status = walk_group(g, which, count, &found);
    if (status != VOCC_OK)
        return status;
    switch (found) {
    case VOCC_SHAFT_LIT:
        counters->entry_lit_rays += settle_group(g, which, count, 0);
        break;
    case VOCC_SHAFT_DARK:
        counters->entry_dark_rays += settle_group(g, which, count, 1);
        break;
    case VOCC_SHAFT_FEW:
        counters->entry_few_rays += (uint64_t)count * g->s->strata.samples;
        g->among = g->walk.triangles;
        g->among_count = g->walk.count;
        status = trace_group(g, which, count);
        g->among = NULL;
        break;
    case VOCC_SHAFT_MANY:
    default:
        if (count > SMALLEST_GROUP) {
            const size_t part = (count + 3) / 4;
            size_t i;
            for (i = 0; i < count && status == VOCC_OK; i += part)
                status = light_group(g, which + i,
                                     count - i < part ? count - i : part);
        } else {
            vocc_tracer_enter(tracer, g->walk.entry, g->walk.entry_lower,
                              g->walk.entry_upper);
            status = trace_group(g, which, count);
            vocc_tracer_at_root(tracer);
        }
    }
    return status;
}

/* Groups of neighbours: as large as the last ones could be; and where searches
 * settle nothing, fewer and fewer of them. */
static vocc_status light_neighbours(lighting *g, const uint16_t *which,
                                    size_t count)
{
    const vocc_counters *const c = &g->worker->tracer->counters;
    size_t size = VOCC_SHAFT_POINTS, i = 0, skip = 0, part;
    vocc_status status = VOCC_OK;
    for (; i < count && status == VOCC_OK; i += part) {
        const uint64_t searches = c->entry_searches,
                       settled = c->entry_lit_rays + c->entry_dark_rays +
                                 c->entry_few_rays;
        part = count - i < size ? count - i : size;
        status = light_group(g, which + i, part);
        if (c->entry_searches - searches == 1 && part == size)
            size = 2 * size < VOCC_SHAFT_POINTS ? 2 * size : VOCC_SHAFT_POINTS;
        else if (c->entry_searches - searches > 1)
            size = size / 2 > SMALLEST_GROUP ? size / 2 : SMALLEST_GROUP;
        if (c->entry_lit_rays + c->entry_dark_rays + c->entry_few_rays !=
            settled) {
            skip = 0;
            continue;
        }
        size = SMALLEST_GROUP;
        i += part;
        skip = 2 * skip + SMALLEST_GROUP < MOST_SKIPPED
                   ? 2 * skip + SMALLEST_GROUP
                   : MOST_SKIPPED;
        part = count - i < skip ? count - i : skip;
        if (status == VOCC_OK)
            status = trace_group(g, which + i, part);
    }
    return status;
}

/* Without groups, or what voxels leave. */
static vocc_status light_points(lighting *g, const uint16_t *which,
                                size_t count)
{
    return g->s->query.options.entry_points ? light_neighbours(g, which, count)
                                            : trace_group(g, which, count);
}

/* Voxel occlusion testing (Woo and Amanatides, "Voxel Occlusion Testing: A
 * Shadow Determination Accelerator for Ray Tracing", 1990): a voxel is null if
 * the light is seen from all of it, full if from nowhere in it; only in the
 * others rays are traced.  Here "all of it" are the points asked for, up to
 * VOCC_SHAFT_POINTS at a time. */
static vocc_status light_voxels(lighting *g, const uint16_t *which,
                                size_t count)
{
    vocc_counters *counters = &g->worker->tracer->counters;
    vocc_shaft_result found;
    vocc_status status = VOCC_OK;
    size_t i, n;
    for (i = 0; i < count && status == VOCC_OK; i += n) {
        for (n = 1; i + n < count && n < VOCC_SHAFT_POINTS &&
                    g->t->voxel[which[i + n]] == g->t->voxel[which[i]];)
            n++;
        status = walk_group(g, which + i, n, &found);
        if (status != VOCC_OK)
            break;
        switch (found) {
        case VOCC_SHAFT_LIT:
            counters->voxel_lit_rays += settle_group(g, which + i, n, 0);
            break;
        case VOCC_SHAFT_DARK:
            counters->voxel_dark_rays += settle_group(g, which + i, n, 1);
            break;
        case VOCC_SHAFT_FEW:
        case VOCC_SHAFT_MANY:
        default:
            status = light_points(g, which + i, n);
        }
    }
    return status;
}

/* One light at all points of a tile. */
static vocc_status light_tile(lighting *g, size_t l)
{
    const shadow *s = g->s;
    const vocc_tile *t = g->t;
    uint16_t *visible = s->visible + l * s->points.count;
    vocc_status status;
    size_t i, count = 0;
    g->number = l;
    g->light = &s->lights[l];
    vocc_light_target(g->light, g->worker->tracer->tree, t->reach, &g->target);
    memset(g->blocked, 0, sizeof g->blocked);
    vocc_tracer_forget(g->worker->tracer);
    g->walk.box_count = 0;
    for (i = 0; i < t->count + t->unused; i++)
        visible[t->number[i]] = VOCC_NOT_TRACED;
    for (i = 0; i < t->count; i++)
        if (faces(t, i, g->light))
            g->lit[count++] = (uint16_t)i;
    status = poll(g, t->count / STEPS_LIKE_A_RAY);
    if (status == VOCC_OK)
        status = s->query.options.voxels ? light_voxels(g, g->lit, count)
                                         : light_points(g, g->lit, count);
    for (i = 0; i < count; i++)
        visible[t->number[g->lit[i]]] =
            (uint16_t)(s->strata.samples - g->blocked[g->lit[i]]);
    return status;
}

static vocc_status shade_tile(void *context, size_t job, int worker,
                              vocc_jobs *jobs)
{
    const shadow *s = context;
    vocc_tile t;
    lighting g;
    size_t l;
    vocc_status status = VOCC_OK;
    vocc_tile_load(&t, &s->points, job);
    g.s = s;
    g.worker_number = worker;
    g.worker = &s->query.workers[worker];
    g.worker->block->count = 0;
    g.t = &t;
    g.among = NULL;
    g.work = 0;
    g.jobs = jobs;
    g.walk.most = s->query.options.entry_triangles;
    for (l = 0; l < s->light_count && status == VOCC_OK; l++)
        status = light_tile(&g, l);
    return status;
}

/* ---- the call ---------------------------------------------------------------
 */

static vocc_status check_shadow(const shadow *s, const vocc_rect_light *lights,
                                int32_t samples, vocc_error *error)
{
    const vocc_points *p = &s->points;
    vocc_status status =
        vocc_check_floats(p->position, p->count, "points", error);
    if (status == VOCC_OK)
        status = vocc_check_floats(p->normal, p->count, "normals", error);
    if (status != VOCC_OK)
        return status;
    if (p->id.data && p->id.type != VOCC_UINT32)
        return vocc_fail(error, VOCC_ERROR_INVALID_ARGUMENT, "point_ids", -1,
                         (double)p->id.type,
                         "point_ids: type %" PRId32 " is not VOCC_UINT32",
                         p->id.type);
    if (!lights && s->light_count)
        return vocc_fail(error, VOCC_ERROR_INVALID_ARGUMENT, "lights", -1,
                         (double)NAN, "lights: NULL");
    if (samples < 1 || samples >= VOCC_NOT_TRACED)
        return vocc_fail(error, VOCC_ERROR_INVALID_ARGUMENT, "samples", -1,
                         (double)samples,
                         "samples is %" PRId32 ": it has to be from 1 to %d",
                         samples, VOCC_NOT_TRACED - 1);
    if (s->light_count &&
        p->count > SIZE_MAX / sizeof(uint16_t) / s->light_count)
        return vocc_fail(error, VOCC_ERROR_LIMIT, "count", -1, (double)p->count,
                         "count is %zu: too much for %zu lights", p->count,
                         s->light_count);
    if (!s->visible && s->light_count && p->count)
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
    const size_t jobs =
        count / VOCC_TILE_POINTS + (count % VOCC_TILE_POINTS != 0);
    shadow s;
    vocc_light *moved;
    double bad = 0.0;
    vocc_status status;
    size_t l;
    memset(&s.points, 0, sizeof s.points);
    s.points.count = count;
    s.points.position = points;
    s.points.normal = normals;
    s.points.id = point_ids;
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
    memcpy(s.points.origin, scene->built.origin, sizeof s.points.origin);
    s.points.neighbours = s.query.options.entry_points;
    if (status == VOCC_OK && s.query.options.voxels && light_count)
        status = vocc_points_by_voxel(&scene->allocator, &s.points,
                                      s.query.options.voxels, &s.query.ticker);
    if (status == VOCC_OK) {
        if (s.query.options.point_steps)
            memset(s.query.options.point_steps, 0,
                   count * sizeof *s.query.options.point_steps);
        vocc_order_samples(&s.strata, s.order);
        s.lights = moved;
        status = vocc_query_run(&s.query, jobs, shade_tile, &s);
    }
    vocc_release(&scene->allocator, moved);
    vocc_release(&scene->allocator, s.order);
    vocc_release(&scene->allocator, s.points.by_voxel);
    status = vocc_query_end(&s.query, status, error);
    if (status == VOCC_ERROR_INVALID_ARGUMENT)
        return vocc_fail(error, status, "lights", (int64_t)l - 1, bad,
                         "lights[%zu]: %g is not a finite float32 number",
                         l - 1, bad);
    return status;
}
