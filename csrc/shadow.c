/* How many samples of each light each point sees; ambient occlusion is a light
 * that is a hemisphere. */
#include "shadow.h"
#include "array.h"
#include "memory.h"
#include "status.h"
#include "vec3.h"
#include "walk.h"

#include <inttypes.h>
#include <math.h>
#include <string.h>

/* ---- rays -------------------------------------------------------------------
 */

/* Some milliseconds. */
enum { POLL_RAYS = 16 * VOCC_BLOCK };

vocc_status vocc_shadow_poll(vocc_lighting *g, uint64_t rays)
{
    g->work += rays;
    if (g->work < POLL_RAYS)
        return VOCC_OK;
    g->work = 0;
    return vocc_jobs_poll(g->jobs, g->worker_number) ? VOCC_ERROR_CANCELLED
                                                     : VOCC_OK;
}

/* The block from the dome. */
static void trace_dome(const vocc_lighting *g)
{
    vocc_block *const block = g->worker->block;
    vocc_counters *const c = &g->worker->tracer->counters;
    size_t i;
    g->beam_kernels->trace_dome(g->beam, g->dome, block);
    c->rays += block->count;
    c->beam_tested_rays += block->count;
    for (i = 0; i < block->count; i++)
        c->occluded += block->occluded[i];
}

static vocc_status trace_block(vocc_lighting *g)
{
    vocc_block *block = g->worker->block;
    const size_t rays = block->count;
    size_t i;
    if (g->dome)
        trace_dome(g);
    else if (g->among)
        g->s->query.kernels->occluded_among(g->worker->tracer, block, g->among,
                                            g->among_count);
    else
        g->s->query.kernels->occluded(g->worker->tracer, block);
    for (i = 0; i < rays; i++)
        g->tallies[g->owner[i]].blocked += block->occluded[i];
    if (g->s->irradiance)
        for (i = 0; i < rays; i++)
            if (!block->occluded[i])
                g->tallies[g->owner[i]].open += g->weight[i];
    if (g->s->blocked)
        for (i = 0; i < rays; i++)
            if (block->occluded[i])
                vocc_set_blocked(vocc_shadow_bits(g, g->owner[i]),
                                 g->sample[i]);
    block->count = 0;
    return vocc_shadow_poll(g, rays);
}

/* The region that every ray from the point ends in, or that the point is in:
 * an occluder of another region blocks the rays in either case. */
static int32_t certain_region(const vocc_lighting *g, const float point[3])
{
    static const double exactly[3] = {0.0, 0.0, 0.0};
    const double p[3] = {(double)point[0], (double)point[1], (double)point[2]};
    int32_t region;
    if (g->target.region >= 0)
        return g->target.region;
    return vocc_locate(g->worker->tracer->tree, p, exactly, &region)
               ? region
               : VOCC_END_UNKNOWN;
}

/* All samples at one point; only those above the surface, if part_only. */
static vocc_status trace_point(vocc_lighting *g, uint16_t which, int part_only)
{
    const vocc_shadow *s = g->s;
    const float *const point = g->t->point[which];
    const uint32_t id = g->t->id[which], number = (uint32_t)g->number,
                   seed = vocc_sample_seed(id, number);
    const int32_t region =
        g->dome ? g->target.region : certain_region(g, point);
    const uint8_t *const bits = vocc_shadow_bits(g, which);
    vocc_block *block = g->worker->block;
    vocc_tally *sum = &g->tallies[which];
    vocc_aim aim;
    uint32_t i, skipped = 0;
    int k;
    vocc_aim_init(&aim, g->light, point, g->t->normal[which]);
    for (i = 0; i < s->pattern.samples; i++) {
        const vocc_place *place = &s->pattern.places[i];
        const size_t r = block->count;
        float a, b, dir[3];
        vocc_sample(&s->pattern, id, number, seed, place, &a, &b);
        block->tmax[r] = vocc_aim_ray(&aim, a, b, dir);
        if (part_only && !vocc_aim_is_above(&aim, dir)) {
            sum->below++;
            sum->blocked++;
            skipped++;
            continue;
        }
        if (s->irradiance) {
            g->weight[r] = vocc_aim_weight(&aim, dir);
            sum->all += g->weight[r];
        }
        if (vocc_is_blocked(bits, place->sample)) {
            sum->blocked++;
            skipped++;
            continue;
        }
        for (k = 0; k < 3; k++) {
            block->org[k][r] = point[k];
            block->dir[k][r] = dir[k];
        }
        block->tmin[r] = 0.0f;
        block->end_region[r] = region;
        g->owner[r] = which;
        g->sample[r] = (uint16_t)place->sample;
        block->count++;
        if (block->count == VOCC_BLOCK) {
            const vocc_status status = trace_block(g);
            if (status != VOCC_OK)
                return status;
        }
    }
    return vocc_shadow_poll(g, skipped / VOCC_SAMPLES_LIKE_A_RAY);
}

/* The weights of a point whose samples need no tracing. */
static void weigh_point(vocc_lighting *g, uint16_t which)
{
    const vocc_shadow *s = g->s;
    const uint32_t id = g->t->id[which], number = (uint32_t)g->number,
                   seed = vocc_sample_seed(id, number);
    const uint8_t *const bits = vocc_shadow_bits(g, which);
    vocc_tally *sum = &g->tallies[which];
    vocc_aim aim;
    uint32_t i;
    vocc_aim_init(&aim, g->light, g->t->point[which], g->t->normal[which]);
    for (i = 0; i < s->pattern.samples; i++) {
        const vocc_place *place = &s->pattern.places[i];
        float a, b, dir[3];
        double weight;
        vocc_sample(&s->pattern, id, number, seed, place, &a, &b);
        (void)vocc_aim_ray(&aim, a, b, dir);
        weight = vocc_aim_weight(&aim, dir);
        sum->all += weight;
        if (!vocc_is_blocked(bits, place->sample))
            sum->open += weight;
    }
}

vocc_status vocc_shadow_trace(vocc_lighting *g, const uint16_t *which,
                              size_t count, int part_only)
{
    uint32_t *const steps = g->s->query.options.point_steps;
    const uint64_t *const visits = &g->worker->tracer->counters.node_visits;
    vocc_status status = VOCC_OK;
    size_t i;
    for (i = 0; i < count && status == VOCC_OK; i++) {
        const uint64_t before = *visits;
        status = trace_point(g, which[i], part_only);
        /* Packets of this point only. */
        if (steps && status == VOCC_OK)
            status = trace_block(g);
        if (steps)
            steps[g->t->number[which[i]]] += (uint32_t)(*visits - before);
    }
    return status == VOCC_OK ? trace_block(g) : status;
}

static vocc_status trace_group(vocc_lighting *g, const uint16_t *which,
                               size_t count)
{
    return vocc_shadow_trace(g, which, count, 0);
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

static vocc_status walk_group(vocc_lighting *g, const uint16_t *which,
                              size_t count, vocc_shaft_result *found)
{
    vocc_tracer *tracer = g->worker->tracer;
    const vocc_counters *const c = &tracer->counters;
    const uint64_t before = c->entry_steps + c->entry_tests;
    const uint32_t samples = g->s->pattern.samples < MOST_SAMPLES
                                 ? g->s->pattern.samples
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
    return vocc_shadow_poll(g, 1 + (c->entry_steps + c->entry_tests - before) /
                                       STEPS_LIKE_A_RAY);
}

/* All rays of the group are lit, or all dark, but for those that are blocked
 * already.  The others are added to *settled. */
vocc_status vocc_shadow_settle(vocc_lighting *g, const uint16_t *which,
                               size_t count, int dark, uint64_t *settled)
{
    const uint32_t samples = g->s->pattern.samples;
    uint64_t rays = (uint64_t)count * samples;
    vocc_status status = VOCC_OK;
    size_t i;
    uint32_t k;
    for (i = 0; i < count && g->s->blocked && status == VOCC_OK; i++) {
        uint8_t *const bits = vocc_shadow_bits(g, which[i]);
        for (k = 0; k < samples; k++)
            if (!dark && !bits[k / 8]) {
                k |= 7;
            } else if (vocc_is_blocked(bits, k)) {
                g->tallies[which[i]].blocked++;
                rays--;
            } else if (dark) {
                vocc_set_blocked(bits, k);
            }
        if (!dark && g->s->irradiance && g->tallies[which[i]].blocked)
            weigh_point(g, which[i]);
        status = vocc_shadow_poll(g, samples / VOCC_SAMPLES_LIKE_A_RAY);
    }
    g->worker->tracer->counters.rays += rays;
    if (dark) {
        g->worker->tracer->counters.occluded += rays;
        for (i = 0; i < count; i++)
            g->tallies[which[i]].blocked = samples;
    }
    *settled += rays;
    return status;
}

static vocc_status light_group(vocc_lighting *g, const uint16_t *which,
                               size_t count)
{
    vocc_tracer *tracer = g->worker->tracer;
    vocc_counters *counters = &tracer->counters;
    vocc_shaft_result found;
    vocc_status status = walk_group(g, which, count, &found);
    if (status != VOCC_OK)
        return status;
    switch (found) {
    case VOCC_SHAFT_LIT:
        status =
            vocc_shadow_settle(g, which, count, 0, &counters->entry_lit_rays);
        break;
    case VOCC_SHAFT_DARK:
        status =
            vocc_shadow_settle(g, which, count, 1, &counters->entry_dark_rays);
        break;
    case VOCC_SHAFT_FEW:
        counters->entry_few_rays += (uint64_t)count * g->s->pattern.samples;
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
static vocc_status light_neighbours(vocc_lighting *g, const uint16_t *which,
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
static vocc_status light_points(vocc_lighting *g, const uint16_t *which,
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
static vocc_status light_voxels(vocc_lighting *g, const uint16_t *which,
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
            status = vocc_shadow_settle(g, which + i, n, 0,
                                        &counters->voxel_lit_rays);
            break;
        case VOCC_SHAFT_DARK:
            status = vocc_shadow_settle(g, which + i, n, 1,
                                        &counters->voxel_dark_rays);
            break;
        case VOCC_SHAFT_FEW:
        case VOCC_SHAFT_MANY:
        default:
            status = light_points(g, which + i, n);
        }
    }
    return status;
}

void vocc_shadow_store(const vocc_lighting *g, size_t which)
{
    const vocc_shadow *s = g->s;
    const vocc_tally *sum = &g->tallies[which];
    const size_t at = g->number * s->points.count + g->t->number[which];
    const uint32_t samples = s->pattern.samples;
    if (sum->below == samples)
        return;
    if (s->visible)
        s->visible[at] = (uint16_t)(samples - sum->blocked);
    if (s->irradiance) {
        const double share = sum->open / sum->all;
        if (sum->blocked == sum->below)
            s->irradiance[at] = 1.0f;
        else if (sum->blocked == samples)
            s->irradiance[at] = 0.0f;
        else /* weights may be too small or too large for a sum */
            s->irradiance[at] = share >= 0.0
                                    ? (float)share
                                    : (float)(samples - sum->blocked) /
                                          (float)(samples - sum->below);
    }
}

static uint16_t begun_visible(const vocc_shadow *s, vocc_facing facing)
{
    return facing == VOCC_FACING_ALL ? (uint16_t)s->pattern.samples
                                     : VOCC_NOT_TRACED;
}

static float begun_irradiance(vocc_facing facing)
{
    return facing == VOCC_FACING_ALL ? 1.0f : NAN;
}

/* Outputs from `at` on. */
static void begin_row(const vocc_shadow *s, size_t at, size_t count,
                      vocc_facing facing)
{
    const uint16_t visible = begun_visible(s, facing);
    const float irradiance = begun_irradiance(facing);
    size_t i;
    for (i = at; s->visible && i < at + count; i++)
        s->visible[i] = visible;
    for (i = at; s->irradiance && i < at + count; i++)
        s->irradiance[i] = irradiance;
}

void vocc_shadow_begin_light(vocc_lighting *g, size_t l)
{
    vocc_facing facing = VOCC_FACING_NONE;
    const vocc_shadow *s = g->s;
    const vocc_tile *t = g->t;
    const size_t first = l * s->points.count;
    size_t i;
    g->number = l;
    g->light = &s->lights[l];
    if (g->light->type == VOCC_LIGHT_HEMISPHERE) {
        memset(&g->target, 0, sizeof g->target);
        g->target.region =
            vocc_finitef(g->light->distance) ? VOCC_END_UNKNOWN : 0;
    } else {
        vocc_emitter_target(g->light, g->worker->tracer->tree, t->reach,
                            &g->target);
    }
    g->facing_alike =
        t->is_patch &&
        vocc_emitter_facing_patch(g->light, &t->patch, s->horizon, &facing);
    if (g->facing_alike)
        memset(g->facing, (int)facing, t->count);
    else
        vocc_emitter_face(g->light, t->count, t->point, t->normal, s->horizon,
                          g->facing);
    memset(g->facing + t->count, VOCC_FACING_NONE, t->unused);
    if (g->facing_alike && t->is_row && !t->unused) {
        begin_row(s, first + t->first, t->count, facing);
        return;
    }
    for (i = 0; s->visible && i < t->count + t->unused; i++)
        s->visible[first + t->number[i]] =
            begun_visible(s, (vocc_facing)g->facing[i]);
    for (i = 0; s->irradiance && i < t->count + t->unused; i++)
        s->irradiance[first + t->number[i]] =
            begun_irradiance((vocc_facing)g->facing[i]);
}

/* One light at all points of a tile. */
static vocc_status light_tile(vocc_lighting *g, size_t l)
{
    const vocc_shadow *s = g->s;
    uint16_t lit[VOCC_TILE_POINTS], part[VOCC_TILE_POINTS];
    vocc_tally tallies[VOCC_TILE_POINTS];
    size_t lit_count = 0, part_count = 0, i;
    vocc_status status;
    vocc_tracer_forget(g->worker->tracer);
    g->walk.box_count = 0;
    g->tallies = tallies;
    memset(tallies, 0, sizeof tallies);
    vocc_shadow_begin_light(g, l);
    for (i = 0; i < g->t->count; i++)
        if (g->facing[i] == VOCC_FACING_ALL)
            lit[lit_count++] = (uint16_t)i;
        else if (g->facing[i] == VOCC_FACING_PART)
            part[part_count++] = (uint16_t)i;
    status = vocc_shadow_poll(g, g->t->count / STEPS_LIKE_A_RAY);
    if (status == VOCC_OK)
        status = s->query.options.voxels ? light_voxels(g, lit, lit_count)
                                         : light_points(g, lit, lit_count);
    if (status == VOCC_OK)
        status = vocc_shadow_trace(g, part, part_count, 1);
    for (i = 0; i < lit_count; i++)
        vocc_shadow_store(g, lit[i]);
    for (i = 0; i < part_count; i++)
        vocc_shadow_store(g, part[i]);
    return status;
}

static vocc_status shade_tile(void *context, size_t job, int worker,
                              vocc_jobs *jobs)
{
    const vocc_shadow *s = context;
    vocc_tile t;
    vocc_lighting g;
    size_t l;
    vocc_status status = VOCC_OK;
    vocc_tile_load(&t, &s->points, job);
    g.s = s;
    g.worker_number = worker;
    g.worker = &s->query.workers[worker];
    g.worker->block->count = 0;
    g.t = &t;
    g.among = NULL;
    g.dome = NULL;
    g.work = 0;
    g.jobs = jobs;
    g.walk.most = s->query.options.entry_triangles;
    if (s->rooms)
        return vocc_shadow_beams(&g);
    for (l = 0; l < s->light_count && status == VOCC_OK; l++)
        status = light_tile(&g, l);
    return status;
}

/* ---- the calls --------------------------------------------------------------
 */

void vocc_sampling_init(vocc_sampling *sampling)
{
    memset(sampling, 0, sizeof *sampling);
    sampling->size = (uint32_t)sizeof *sampling;
    sampling->samples = 16;
    sampling->sampler = VOCC_SAMPLER_SOBOL;
    sampling->horizon = VOCC_HORIZON_SAMPLE;
}

static vocc_status check_sampling(const vocc_sampling *s, vocc_error *error)
{
    vocc_status status;
    if (s->size != sizeof *s)
        return vocc_fail(
            error, VOCC_ERROR_INVALID_ARGUMENT, "sampling", -1, (double)s->size,
            "sampling: size is %" PRIu32 ", not sizeof(vocc_sampling)",
            s->size);
    status =
        vocc_check_range(error, "samples", s->samples, 1, VOCC_NOT_TRACED - 1);
    if (status == VOCC_OK)
        status = vocc_check_range(error, "sampler", s->sampler,
                                  VOCC_SAMPLER_SOBOL, VOCC_SAMPLER_JITTER);
    if (status == VOCC_OK)
        status = vocc_check_range(error, "horizon", s->horizon,
                                  VOCC_HORIZON_SAMPLE, VOCC_HORIZON_CENTRE);
    return status;
}

static vocc_status check_points(const vocc_points *p, vocc_error *error)
{
    vocc_status status =
        vocc_check_floats(p->position, p->count, "points", error);
    if (status == VOCC_OK)
        status = vocc_check_floats(p->normal, p->count, "normals", error);
    if (status == VOCC_OK && p->id.data && p->id.type != VOCC_UINT32)
        return vocc_fail(error, VOCC_ERROR_INVALID_ARGUMENT, "point_ids", -1,
                         (double)p->id.type,
                         "point_ids: type %" PRId32 " is not VOCC_UINT32",
                         p->id.type);
    return status;
}

/* What beams cost does not pay where there are fewer rays for each triangle;
 * for ambient occlusion, fewer rays. */
enum { RAYS_A_TRIANGLE = 12, AMBIENT_RAYS = 1024 };

/* The method that the options, which are checked, mean. */
static int32_t method_of(const vocc_shadow *s, const vocc_query_options *asked,
                         uint32_t samples, int is_ambient)
{
    const double rays =
        (double)s->points.count * (double)s->light_count * (double)samples;
    const double least =
        is_ambient
            ? (double)AMBIENT_RAYS
            : (double)RAYS_A_TRIANGLE * (double)s->query.scene->triangle_count;
    if (asked && asked->method != VOCC_METHOD_AUTO)
        return asked->method;
    return (!asked ||
            (asked->order == VOCC_ORDER_AUTO && asked->entry_points < 0 &&
             !asked->voxels && asked->packets && !asked->point_steps)) &&
                   rays >= least
               ? VOCC_METHOD_BEAMS
               : VOCC_METHOD_RAYS;
}

/* What beams cannot do. */
static vocc_status check_beams(const vocc_shadow *s, vocc_error *error)
{
    const vocc_query_options *o = &s->query.options;
    if (o->point_steps)
        return vocc_fail(error, VOCC_ERROR_UNSUPPORTED, "point_steps", -1,
                         (double)NAN,
                         "point_steps: beams have no steps of single points");
    if (o->verify && s->blocked)
        return vocc_fail(error, VOCC_ERROR_UNSUPPORTED, "verify", -1,
                         (double)o->verify,
                         "verify is %" PRId32 ": not with blocked", o->verify);
    return VOCC_OK;
}

static vocc_status tell_mismatch(const vocc_shadow *s, vocc_error *error)
{
    const vocc_beam_mismatch *m = vocc_beam_rooms_mismatch(s);
    return vocc_fail(error, VOCC_ERROR_MISMATCH, "points", (int64_t)m->point,
                     (double)m->blocked,
                     "points[%zu], lights[%zu]: beams block %" PRIu32
                     " samples, rays %" PRIu32
                     ": a fault of the library or of the machine",
                     m->point, m->light, m->blocked, m->expected);
}

/* Runs the query; s has points, lights and outputs, which are checked. */
static vocc_status run_shadow(vocc_shadow *s, const vocc_scene *scene,
                              const vocc_sampling *sampling,
                              const vocc_query_options *options, int may_group,
                              vocc_error *error)
{
    const size_t count = s->points.count;
    const size_t jobs =
        count / VOCC_TILE_POINTS + (count % VOCC_TILE_POINTS != 0);
    vocc_status status =
        vocc_query_begin(&s->query, scene, options, jobs, error);
    if (status != VOCC_OK)
        return status;
    s->rooms = NULL;
    s->query.options.method =
        method_of(s, options, (uint32_t)sampling->samples, !may_group);
    if (s->query.options.method == VOCC_METHOD_BEAMS) {
        status = check_beams(s, error);
        if (status != VOCC_OK) {
            (void)vocc_query_end(&s->query, status, NULL);
            return status;
        }
        s->query.options.voxels = 0;
        if (!vocc_beam_rooms_create(s))
            status = VOCC_ERROR_OUT_OF_MEMORY;
    }
    if (!may_group)
        s->query.options.entry_points = s->query.options.voxels = 0;
    s->horizon = sampling->horizon;
    s->blocked_bytes = ((size_t)sampling->samples + 7) / 8;
    memcpy(s->points.origin, scene->built.origin, sizeof s->points.origin);
    s->points.neighbours = s->query.options.entry_points || s->rooms;
    if (!vocc_pattern_init(&s->pattern, &scene->allocator, sampling->sampler,
                           (uint32_t)sampling->samples))
        status = VOCC_ERROR_OUT_OF_MEMORY;
    if (status == VOCC_OK && s->query.options.voxels && s->light_count)
        status =
            vocc_points_by_voxel(&scene->allocator, &s->points,
                                 s->query.options.voxels, &s->query.ticker);
    if (status == VOCC_OK) {
        if (s->query.options.point_steps)
            memset(s->query.options.point_steps, 0,
                   count * sizeof *s->query.options.point_steps);
        status = vocc_query_run(&s->query, jobs, shade_tile, s);
    }
    vocc_pattern_free(&s->pattern, &scene->allocator);
    vocc_release(&scene->allocator, s->points.by_voxel);
    if (status == VOCC_ERROR_MISMATCH) {
        (void)tell_mismatch(s, error);
        error = NULL;
    }
    if (status == VOCC_ERROR_LIMIT) {
        (void)vocc_fail(error, status, "count", -1, (double)count,
                        "count is %zu: voxels are for fewer than 2^34 points",
                        count);
        error = NULL;
    }
    vocc_beam_rooms_free(s);
    return vocc_query_end(&s->query, status, error);
}

static void set_points(vocc_shadow *s, size_t count, vocc_array points,
                       vocc_array normals, vocc_array point_ids)
{
    memset(&s->points, 0, sizeof s->points);
    s->points.count = count;
    s->points.position = points;
    s->points.normal = normals;
    s->points.id = point_ids;
}

static vocc_status check_outputs(const vocc_shadow *s, const vocc_light *lights,
                                 vocc_error *error)
{
    if (!lights && s->light_count)
        return vocc_fail(error, VOCC_ERROR_INVALID_ARGUMENT, "lights", -1,
                         (double)NAN, "lights: NULL");
    if (s->light_count &&
        s->points.count > SIZE_MAX / sizeof(float) / s->light_count)
        return vocc_fail(error, VOCC_ERROR_LIMIT, "count", -1,
                         (double)s->points.count,
                         "count is %zu: too much for %zu lights",
                         s->points.count, s->light_count);
    if (!s->visible && !s->irradiance && s->light_count && s->points.count)
        return vocc_fail(error, VOCC_ERROR_INVALID_ARGUMENT, "visible", -1,
                         (double)NAN, "visible: NULL");
    return VOCC_OK;
}

vocc_status
vocc_light_visibility(const vocc_scene *scene, size_t count, vocc_array points,
                      vocc_array normals, vocc_array point_ids,
                      size_t light_count, const vocc_light *lights,
                      const vocc_sampling *sampling, uint16_t *visible,
                      float *irradiance, uint8_t *blocked,
                      const vocc_query_options *options, vocc_error *error)
{
    vocc_shadow s;
    vocc_sampling defaults;
    vocc_emitter *emitters;
    vocc_status status;
    size_t l;
    set_points(&s, count, points, normals, point_ids);
    s.light_count = light_count;
    s.visible = visible;
    s.irradiance = irradiance;
    s.blocked = blocked;
    vocc_sampling_init(&defaults);
    sampling = sampling ? sampling : &defaults;
    status = check_points(&s.points, error);
    if (status == VOCC_OK)
        status = check_outputs(&s, lights, error);
    if (status == VOCC_OK)
        status = check_sampling(sampling, error);
    if (status == VOCC_OK)
        status = vocc_check_built(scene, error);
    if (status != VOCC_OK)
        return status;
    emitters = vocc_allocate(&scene->allocator, light_count, sizeof *emitters);
    if (!emitters)
        return vocc_fail_plain(error, VOCC_ERROR_OUT_OF_MEMORY);
    for (l = 0; status == VOCC_OK && l < light_count; l++)
        status = vocc_emitter_init(&emitters[l], &lights[l], l,
                                   scene->built.origin, error);
    s.lights = emitters;
    if (status == VOCC_OK)
        status = run_shadow(&s, scene, sampling, options, 1, error);
    vocc_release(&scene->allocator, emitters);
    return status;
}

vocc_status vocc_ambient_occlusion(const vocc_scene *scene, size_t count,
                                   vocc_array points, vocc_array normals,
                                   vocc_array point_ids, double distance,
                                   const vocc_sampling *sampling,
                                   uint16_t *open, uint8_t *blocked,
                                   const vocc_query_options *options,
                                   vocc_error *error)
{
    vocc_shadow s;
    vocc_sampling defaults;
    vocc_emitter hemisphere;
    vocc_status status;
    set_points(&s, count, points, normals, point_ids);
    s.lights = &hemisphere;
    s.light_count = 1;
    s.visible = open;
    s.irradiance = NULL;
    s.blocked = blocked;
    vocc_sampling_init(&defaults);
    sampling = sampling ? sampling : &defaults;
    status = check_points(&s.points, error);
    if (status == VOCC_OK && !open && count)
        status = vocc_fail(error, VOCC_ERROR_INVALID_ARGUMENT, "open", -1,
                           (double)NAN, "open: NULL");
    if (status == VOCC_OK)
        status = check_sampling(sampling, error);
    if (status == VOCC_OK)
        status = vocc_emitter_hemisphere(&hemisphere, distance, error);
    if (status != VOCC_OK)
        return status;
    return run_shadow(&s, scene, sampling, options, 0, error);
}
