/* Shadows by beams: the lights of a tile, some at a time; a round for what is
 * lit, then the rest, and what is uncertain when all lights have told which
 * points are outside. */
#include "memory.h"
#include "shadow_group.h"

#include <string.h>

int vocc_beam_rooms_create(vocc_shadow *s)
{
    const vocc_allocator *a = &s->query.scene->allocator;
    const size_t count = (size_t)s->query.worker_count;
    vocc_query_options baseline = s->query.options;
    size_t i;
    s->rooms = vocc_allocate_lines(a, count, sizeof *s->rooms);
    if (!s->rooms)
        return 0;
    memset(s->rooms, 0, count * sizeof *s->rooms);
    baseline.order = VOCC_ORDER_STANDARD;
    baseline.occluders = baseline.cache = baseline.triangle_cache = 0;
    for (i = 0; i < count; i++) {
        s->rooms[i].beam.tree = &s->query.scene->built.tree;
        s->rooms[i].beam.bvh = &s->query.scene->built.bvh;
        if (!s->query.options.verify)
            continue;
        s->rooms[i].checker.tracer = vocc_tracer_create(
            a, s->rooms[i].beam.tree, &baseline, s->query.kernels);
        s->rooms[i].checker.block =
            vocc_allocate(a, 1, sizeof *s->rooms[i].checker.block);
        if (!s->rooms[i].checker.tracer || !s->rooms[i].checker.block)
            return 0;
    }
    return 1;
}

void vocc_beam_rooms_free(vocc_shadow *s)
{
    const vocc_allocator *a = &s->query.scene->allocator;
    int i;
    for (i = 0; s->rooms && i < s->query.worker_count; i++) {
        vocc_tracer_free(a, s->rooms[i].checker.tracer);
        vocc_release(a, s->rooms[i].checker.block);
    }
    vocc_release_lines(a, s->rooms);
    s->rooms = NULL;
}

const vocc_beam_mismatch *vocc_beam_rooms_mismatch(const vocc_shadow *s)
{
    const vocc_beam_mismatch *first = NULL;
    int i;
    for (i = 0; i < s->query.worker_count; i++) {
        const vocc_beam_mismatch *m = &s->rooms[i].mismatch;
        if (m->is_set && (!first || m->point < first->point))
            first = m;
    }
    return first;
}

/* ---- tiles ------------------------------------------------------------------
 */

/* Points that face the light, in the order of the tile, where neighbours
 * follow each other.  *all_tallied: the tallies of all of them matter; else
 * they are lit whole, as the outputs say already, but for those that find_lit
 * leaves pending. */
static vocc_status begin(vocc_beaming *w, size_t l, int *all_tallied)
{
    vocc_lighting *g = w->g;
    const vocc_shadow *s = g->s;
    vocc_lit_tile *light = w->light;
    size_t count = 0, i;
    int parts = 0;
    g->tallies = light->tallies;
    vocc_shadow_begin_light(g, l);
    light->target = g->target;
    light->pending_count = light->uncertain_count = 0;
    light->recent.count = light->recent.cut = 0;
    vocc_worth_begin(&light->hiding);
    if (g->facing_alike) {
        if (g->facing[0] != VOCC_FACING_NONE)
            for (; count < g->t->count; count++)
                light->which[count] = (uint16_t)count;
        memset(light->is_part, 0, g->t->count);
    } else {
        for (i = 0; i < g->t->count; i++) {
            light->which[count] = (uint16_t)i;
            count += g->facing[i] != VOCC_FACING_NONE;
            light->is_part[i] = g->facing[i] == VOCC_FACING_PART;
            parts |= light->is_part[i];
        }
    }
    light->count = count;
    *all_tallied = parts || s->blocked || s->query.options.verify ||
                   g->light->type == VOCC_LIGHT_HEMISPHERE;
    if (*all_tallied)
        memset(light->tallies, 0, sizeof light->tallies);
    return vocc_shadow_poll(g, g->t->count / VOCC_STEPS_LIKE_A_RAY);
}

static int resume(vocc_beaming *w, size_t l)
{
    vocc_lighting *g = w->g;
    g->number = l;
    g->light = &g->s->lights[l];
    g->target = w->light->target;
    g->tallies = w->light->tallies;
    return vocc_beam_limits(&w->room->beam, g->t->reach, &g->target);
}

/* A light beyond the range of beams: by rays. */
static vocc_status by_rays(vocc_beaming *w)
{
    const vocc_lit_tile *l = w->light;
    vocc_status status = VOCC_OK;
    size_t i;
    memset(w->light->tallies, 0, sizeof w->light->tallies);
    for (i = 0; i < l->count && status == VOCC_OK; i++)
        status =
            vocc_shadow_trace(w->g, &l->which[i], 1, l->is_part[l->which[i]]);
    return status;
}

static void clear_pending(const vocc_beaming *w)
{
    vocc_lit_tile *l = w->light;
    int n, i;
    for (n = 0; n < l->pending_count; n++)
        for (i = 0; i < l->pending[n].count; i++)
            memset(&l->tallies[l->which[l->pending[n].first + i]], 0,
                   sizeof *l->tallies);
}

static void store(const vocc_beaming *w, size_t first, size_t count)
{
    size_t i;
    for (i = first; i < first + count; i++)
        vocc_shadow_store(w->g, w->light->which[i]);
}

/* One in `verify` of the points of a light, traced again. */
static vocc_status verify(const vocc_beaming *w)
{
    vocc_lighting *g = w->g;
    vocc_beam_mismatch *m = &w->room->mismatch;
    const uint32_t n = (uint32_t)g->s->query.options.verify;
    const vocc_worker *const worker = g->worker;
    const vocc_shadow *const shadow = g->s;
    vocc_shadow plain = *shadow;
    vocc_tally *const tallies = g->tallies;
    vocc_tally again[VOCC_TILE_POINTS];
    vocc_status status = VOCC_OK;
    size_t i;
    plain.irradiance = NULL;
    g->s = &plain;
    g->worker = &w->room->checker;
    g->worker->block->count = 0;
    g->tallies = again;
    for (i = 0; i < w->light->count && status == VOCC_OK; i++) {
        const uint16_t which = w->light->which[i];
        const size_t point = g->t->number[which];
        if ((point + g->number) % n)
            continue;
        memset(&again[which], 0, sizeof *again);
        status = vocc_shadow_trace(g, &w->light->which[i], 1,
                                   w->light->is_part[which]);
        if (status == VOCC_OK &&
            again[which].blocked != tallies[which].blocked) {
            m->is_set = 1;
            m->point = point;
            m->light = g->number;
            m->blocked = tallies[which].blocked;
            m->expected = again[which].blocked;
            status = VOCC_ERROR_MISMATCH;
        }
    }
    g->s = shadow;
    g->worker = worker;
    g->tallies = tallies;
    return status;
}

vocc_status vocc_shadow_beams(vocc_lighting *g)
{
    const size_t lights = g->s->light_count;
    vocc_beaming w;
    size_t l, first;
    int n, tallied[VOCC_BEAM_LIGHTS];
    vocc_status status = VOCC_OK;
    uint64_t nodes, clusters, tests, exact;
    w.g = g;
    w.room = &g->s->rooms[g->worker_number];
    nodes = w.room->beam.nodes;
    clusters = w.room->beam.clusters;
    tests = w.room->beam.ray_tests;
    exact = w.room->beam.exact_tests;
    w.kernels = vocc_find_beam_kernels(g->s->query.options.isa);
    g->beam = &w.room->beam;
    g->beam_kernels = w.kernels;
    w.counters = &g->worker->tracer->counters;
    memset(w.room->outside, 0, sizeof w.room->outside);
    vocc_worth_begin(&w.room->beam.worth);
    for (first = 0; first < lights && status == VOCC_OK;
         first += VOCC_BEAM_LIGHTS) {
        const size_t end = first + VOCC_BEAM_LIGHTS < lights
                               ? first + VOCC_BEAM_LIGHTS
                               : lights;
        for (l = first; l < end && status == VOCC_OK; l++) {
            int *const all_tallied = &tallied[l - first];
            vocc_range all;
            w.light = &w.room->lights[l - first];
            status = begin(&w, l, all_tallied);
            all.first = 0;
            all.count = (uint16_t)w.light->count;
            if (status != VOCC_OK)
                break;
            if (g->light->type == VOCC_LIGHT_HEMISPHERE) {
                status = vocc_shadow_domes(&w);
            } else if (resume(&w, l)) {
                status = vocc_group_find_lit(&w, all);
                if (!*all_tallied)
                    clear_pending(&w);
            } else {
                *all_tallied = 1;
                status = by_rays(&w);
            }
        }
        for (l = first; l < end && status == VOCC_OK; l++) {
            w.light = &w.room->lights[l - first];
            if (!w.light->pending_count)
                continue;
            (void)resume(&w, l);
            for (n = 0; n < w.light->pending_count && status == VOCC_OK; n++)
                status = vocc_group_decide(&w, w.light->pending[n], 0);
        }
        for (l = first; l < end && status == VOCC_OK; l++) {
            const vocc_range *pending;
            w.light = &w.room->lights[l - first];
            pending = w.light->pending;
            if (!w.light->pending_count && !tallied[l - first])
                continue;
            (void)resume(&w, l);
            for (n = 0; n < w.light->uncertain_count && status == VOCC_OK; n++)
                status = vocc_group_decide(&w, w.light->uncertain[n], 1);
            if (status == VOCC_OK && g->s->query.options.verify)
                status = verify(&w);
            if (tallied[l - first])
                store(&w, 0, w.light->count);
            else
                for (n = 0; n < w.light->pending_count; n++)
                    store(&w, pending[n].first, pending[n].count);
        }
    }
    w.counters->beam_nodes += w.room->beam.nodes - nodes;
    w.counters->beam_clusters += w.room->beam.clusters - clusters;
    w.counters->beam_tests += w.room->beam.ray_tests - tests;
    w.counters->exact_tests += w.room->beam.exact_tests - exact;
    return status;
}
