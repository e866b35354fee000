/* Groups of points and a light: all lit, all dark, or split.
 *
 * First every group is asked whether any triangle stands between: most are lit.
 * Such points surely lie in the region of the light, outside of all solids, and
 * so for all lights: that is what lets the second round look at exits only
 * (beam.h).  There the beam of a group is split, by its points or by the
 * light's cells, whichever is wider where it meets triangles; parts are lit if
 * they meet nothing, dark if a slice lies inside an occluder; and when few
 * segments are left, or few clusters before points with many samples, they are
 * tested: against the list of what the beam meets, or if that is too long, as
 * single rays. */
#include "lanes.h"
#include "shadow_group.h"
#include "vec3.h"

#include <string.h>

enum {
    RECENT = VOCC_WIDE,
    SHORT_LIST = 12,
    /* Fans from points with so many samples each, and clusters not too many. */
    FAN_SAMPLES = 24,
    FAN_LIST = 24
};

/* Points of the group that the beam starts at. */
static void set_points(const vocc_beaming *w, vocc_range r)
{
    const vocc_tile *t = w->g->t;
    vocc_beam *b = &w->room->beam;
    const uint16_t *which = w->light->which + r.first;
    size_t i;
    int k;
    b->count = r.count;
    for (i = 0; i < r.count; i++)
        for (k = 0; k < 3; k++)
            b->point[k][i] = t->point[which[i]][k];
    vocc_beam_set_points(b, w->kernels, t->normal, which);
}

static vocc_range part_of(vocc_range r, int i, int parts)
{
    const int size = (r.count + parts - 1) / parts, first = i * size;
    vocc_range p;
    p.first = (uint16_t)(r.first + first);
    p.count = (uint16_t)(first >= r.count         ? 0
                         : r.count - first < size ? r.count - first
                                                  : size);
    return p;
}

/* The beam aims at all of the light. */
static void set_whole_end(const vocc_beaming *w)
{
    static const double low[3] = {0.0, 0.0, 0.0}, high[3] = {1.0, 1.0, 1.0};
    vocc_end_frame frame;
    vocc_beam_hull_frame(&w->light->target, &frame);
    vocc_beam_set_end(&w->room->beam, &w->light->target, &frame, low, high);
}

/* First round. */
vocc_status vocc_group_find_lit(const vocc_beaming *w, vocc_range r)
{
    vocc_beam *b = &w->room->beam;
    vocc_status status = VOCC_OK;
    int i;
    if (!r.count)
        return VOCC_OK;
    w->counters->beams++;
    set_points(w, r);
    set_whole_end(w);
    b->exits = 0;
    if (!w->kernels->meets_any(b)) {
        if (w->light->target.region == 0)
            for (i = 0; i < r.count; i++)
                w->room->outside[w->light->which[r.first + i]] = 1;
        if (vocc_shadow_poll(w->g, r.count / VOCC_STEPS_LIKE_A_RAY))
            return VOCC_ERROR_CANCELLED;
        return vocc_group_settle(w, r, 0, &w->counters->beam_lit_rays);
    }
    if (r.count > VOCC_GROUP) {
        for (i = 0; i < 4 && status == VOCC_OK; i++)
            status = vocc_group_find_lit(w, part_of(r, i, 4));
        return status;
    }
    w->light->pending[w->light->pending_count++] = r;
    return vocc_shadow_poll(w->g, r.count);
}

/* Whether an occluder stops the whole beam: one of those that did so last, or
 * of `from` (NULL: all).  If not, *to are those that it meets. */
static int is_dark(const vocc_beaming *w, const vocc_beam_boxes *from,
                   vocc_beam_boxes *to)
{
    const vocc_beam *b = &w->room->beam;
    vocc_beam_boxes *recent = &w->light->recent;
    const int32_t region = w->light->target.region;
    int k, n;
    to->count = 0;
    if (region < 0 || !w->g->s->query.occluders)
        return 0;
    if (!from && w->kernels->hold(b, recent, region, to))
        return 1;
    if (!w->kernels->hold(b, from, region, to))
        return 0;
    n = recent->count < RECENT ? recent->count++ : RECENT - 1;
    for (k = 0; k < 3; k++) {
        recent->lower[k][n] = recent->lower[k][0];
        recent->upper[k][n] = recent->upper[k][0];
        recent->lower[k][0] = to->lower[k][0];
        recent->upper[k][0] = to->upper[k][0];
    }
    return 1;
}

/* A part of a group: points first .. of it, and some cells. */
typedef struct part {
    vocc_range points; /* of the light's list */
    int first;         /* point, in the store */
    int cell, cells;
} part;

static uint32_t count_rays(const vocc_segments *s, const part *p)
{
    uint32_t n = 0;
    int i;
    for (i = p->first; i < p->first + p->points.count; i++)
        n += s->start[i][p->cell + p->cells] - s->start[i][p->cell];
    return n;
}

static void mark_dark(vocc_segments *s, const part *p)
{
    int i;
    for (i = p->first; i < p->first + p->points.count; i++) {
        const uint32_t from = s->start[i][p->cell];
        memset(s->blocked + from, 1, s->start[i][p->cell + p->cells] - from);
    }
}

/* Segments that are few enough: one by one. */
static vocc_status test_rays(const vocc_beaming *w, const part *p,
                             const vocc_beam_list *list,
                             const vocc_beam_boxes *boxes)
{
    vocc_beam_room *room = w->room;
    vocc_beam *b = &room->beam;
    vocc_beam_rays *r = &room->rays;
    vocc_segments *s = &room->store;
    const uint64_t before = b->nodes + b->clusters;
    int i, j, k, n = 0;
    int left = 0;
    for (i = 0; i < p->points.count; i++) {
        const uint32_t *const start = s->start[p->first + i] + p->cell;
        const int count = (int)(start[p->cells] - start[0]);
        for (j = 0; j < 3; j++) {
            const float from = b->point[j][i], *const dir =
                                                   s->dir[j] + start[0];
            for (k = 0; k < count; k++) {
                r->org[j][n + k] = from;
                r->dir[j][n + k] = dir[k];
            }
        }
        memset(r->owner + n, i, (size_t)count);
        n += count;
    }
    r->count = n;
    r->tmax = s->tmax;
    r->touching = 0;
    for (i = 0; i < n; i += VOCC_WIDE)
        r->open[i / VOCC_WIDE] =
            (uint16_t)(n - i < VOCC_WIDE ? (1u << (n - i)) - 1u : 0xFFFFu);
    w->kernels->prepare(b, r);
    w->kernels->block_by_boxes(b, boxes, r);
    for (i = 0; i < n; i += VOCC_WIDE)
        left += vocc_count_bits(r->open[i / VOCC_WIDE]);
    w->counters->beam_box_rays += (uint64_t)(n - left);
    if (left)
        w->kernels->block(b, list, r);
    w->counters->beam_tested_rays += (uint64_t)n;
    for (i = 0, n = 0; i < p->points.count; i++) {
        const uint32_t *const start = s->start[p->first + i] + p->cell;
        uint32_t at;
        for (at = start[0]; at < start[p->cells]; at++, n++)
            s->blocked[at] = !(r->open[n / VOCC_WIDE] >> n % VOCC_WIDE & 1);
    }
    /* A segment that meets nothing starts outside; unless on a triangle. */
    if (!r->touching && w->light->target.region == 0 && !b->exits)
        for (i = 0; i < n; i++)
            if (r->open[i / VOCC_WIDE] >> i % VOCC_WIDE & 1)
                w->room
                    ->outside[w->light->which[p->points.first + r->owner[i]]] =
                    1;
    return vocc_shadow_poll(w->g, (uint64_t)n / VOCC_STEPS_LIKE_A_RAY +
                                      (b->nodes + b->clusters - before));
}

/* The segments of the worker's block through the hierarchy; place[]: where they
 * are in the store. */
static vocc_status trace_block(const vocc_beaming *w, const uint32_t *place)
{
    vocc_lighting *g = w->g;
    vocc_beam *b = &w->room->beam;
    vocc_block *const block = g->worker->block;
    const uint64_t before = b->nodes + b->clusters;
    const size_t rays = block->count;
    uint16_t odd[VOCC_BLOCK];
    size_t i, n;
    n = w->kernels->trace_rays(b, block, g->s->query.occluders, odd);
    for (i = 0; i < n; i++) {
        block->occluded[odd[i]] = 0;
        if (vocc_is_void(block, odd[i]))
            continue;
        w->counters->careful_rays++;
        vocc_trace_careful(g->worker->tracer, block, odd[i], 0);
    }
    for (i = 0; i < rays; i++)
        w->room->store.blocked[place[i]] = block->occluded[i];
    w->counters->beam_tested_rays += rays;
    block->count = 0;
    return vocc_shadow_poll(g, (uint64_t)rays / VOCC_STEPS_LIKE_A_RAY +
                                   (b->nodes + b->clusters - before));
}

/* Segments that a list is too long for: through the hierarchy, in packets of
 * neighbours. */
static vocc_status trace_packets(const vocc_beaming *w, const part *p)
{
    const vocc_segments *s = &w->room->store;
    vocc_block *const block = w->g->worker->block;
    const int32_t region = w->light->target.region;
    uint32_t place[VOCC_BLOCK];
    vocc_status status = VOCC_OK;
    int c, i, k;
    block->count = 0;
    for (c = p->cell; c < p->cell + p->cells; c++)
        for (i = 0; i < p->points.count; i++) {
            const uint32_t *const start = s->start[p->first + i];
            const float *const point =
                w->g->t->point[w->light->which[p->points.first + i]];
            uint32_t at;
            for (at = start[c]; at < start[c + 1] && status == VOCC_OK; at++) {
                const size_t n = block->count++;
                for (k = 0; k < 3; k++) {
                    block->org[k][n] = point[k];
                    block->dir[k][n] = s->dir[k][at];
                }
                block->tmin[n] = 0.0f;
                block->tmax[n] = s->tmax;
                block->end_region[n] = region;
                place[n] = at;
                if (block->count == VOCC_BLOCK)
                    status = trace_block(w, place);
            }
        }
    if (status == VOCC_OK)
        status = trace_block(w, place);
    /* Packets have made the beam theirs. */
    set_points(w, p->points);
    return status;
}

static double widest(const float lower[3], const float upper[3])
{
    double most = 0.0;
    int k;
    for (k = 0; k < 3; k++) {
        const double x = (double)upper[k] - (double)lower[k];
        most = x > most ? x : most;
    }
    return most;
}

/* Whether the beam is wider by its points than by its light, where it meets
 * triangles. */
static int points_are_wider(const vocc_beaming *w, float near)
{
    const vocc_beam *b = &w->room->beam;
    const double t = (double)near,
                 length = b->is_direction ? 4.0 * (double)b->size : 1.0;
    double end = 0.0;
    int j, k;
    for (k = 0; k < 3; k++) {
        double half = 0.0;
        for (j = 0; j < 3; j++)
            half += vocc_abs((double)b->end_axis[j][k]);
        end = half > end ? half : end;
    }
    return (1.0 - t) * widest(b->lower, b->upper) > t * length * 2.0 * end;
}

/* Cells to a block of a fan: no more than 16 samples of any point; 0 if blocks
 * would be too many. */
static int cells_a_block(const vocc_segments *s, const part *p)
{
    int step = p->cells, i, c;
    for (i = p->first; i < p->first + p->points.count; i++) {
        const uint32_t *const start = s->start[i];
        for (c = p->cell; c < p->cell + p->cells; c += step)
            while (start[c + step] - start[c] > VOCC_WIDE) {
                step /= 2;
                if (!step || p->cells / step > VOCC_FAN_BLOCKS)
                    return 0;
            }
    }
    return step;
}

/* Points with many segments each: one by one. */
static vocc_status test_fans(const vocc_beaming *w, const part *p,
                             const vocc_beam_list *list,
                             const vocc_beam_boxes *boxes)
{
    vocc_beam_room *room = w->room;
    vocc_beam *b = &room->beam;
    vocc_beam_fans *f = &room->fans;
    vocc_segments *s = &room->store;
    const uint64_t before = b->nodes + b->clusters;
    const int step = cells_a_block(s, p);
    double low[3], high[3];
    int i, j, k;
    float norm = 0.0f;
    vocc_cells_end(s, p->cell, p->cells, low, high);
    f->blocks = step ? p->cells / step : 0;
    for (k = 0; k < 2; k++)
        for (j = 0; j < f->blocks; j++) {
            double from[3], to[3], a, c, size = high[k] - low[k];
            vocc_cells_end(s, p->cell + j * step, step, from, to);
            if (from[k] > to[k]) /* no samples */
                from[k] = to[k] = low[k];
            a = size > 0.0 ? (2.0 * (from[k] - low[k]) - size) / size : 0.0;
            c = size > 0.0 ? (2.0 * (to[k] - low[k]) - size) / size : 0.0;
            f->middle[k][j] = (float)(0.5 * (a + c));
            f->half[k][j] = (float)(0.5 * (c - a) + 0x1p-20);
        }
    for (k = 0; k < 3; k++)
        for (j = 0; j < f->blocks; j++) {
            const float m = b->far_middle[k] +
                            f->middle[0][j] * b->far_axis[0][k] +
                            f->middle[1][j] * b->far_axis[1][k],
                        h = f->half[0][j] * vocc_absf(b->far_axis[0][k]) +
                            f->half[1][j] * vocc_absf(b->far_axis[1][k]) +
                            b->far_rest[k];
            f->far_lower[k][j] = m - h;
            f->far_upper[k][j] = m + h;
        }
    f->tmax = s->tmax;
    for (k = 0; k < 3; k++) {
        f->dir[k] = s->dir[k];
        f->inverse[k] = s->inverse[k];
        norm += vocc_absf(b->way[k]) + b->way_half[k];
    }
    f->norm = norm * (1.0f + 0x1p-20f);
    f->touching = 0;
    f->open_points = 0;
    for (i = 0; i < p->points.count; i++) {
        const uint32_t *const start = s->start[p->first + i];
        f->open_blocks[i] = 0;
        for (j = 0; j < f->blocks; j++) {
            const uint32_t from = start[p->cell + j * step],
                           n = start[p->cell + (j + 1) * step] - from;
            f->first[i][j] = from;
            f->open[i][j] = (uint16_t)((1u << n) - 1u);
            if (n)
                f->open_blocks[i] |= (uint16_t)(1u << j);
        }
        if (f->open_blocks[i])
            f->open_points |= (uint64_t)1 << i;
    }
    w->kernels->block_fans(b, list, boxes, f);
    for (i = 0; i < p->points.count; i++) {
        const uint32_t *const start = s->start[p->first + i];
        unsigned any = 0;
        for (j = 0; j < f->blocks; j++) {
            const uint32_t from = f->first[i][j],
                           n = start[p->cell + (j + 1) * step] - from;
            uint32_t m;
            w->counters->beam_tested_rays += n;
            any |= f->open[i][j];
            for (m = 0; m < n; m++)
                s->blocked[from + m] = !(f->open[i][j] >> m & 1);
        }
        if (any && !(f->touching >> i & 1) && w->light->target.region == 0 &&
            !b->exits)
            room->outside[w->light->which[p->points.first + i]] = 1;
    }
    return vocc_shadow_poll(w->g,
                            (uint64_t)p->points.count / VOCC_STEPS_LIKE_A_RAY +
                                (b->nodes + b->clusters - before));
}

static int is_clusters(const vocc_beam_list *list)
{
    int i;
    for (i = 0; i < list->count; i++)
        if (!(list->child[i] & VOCC_IS_CLUSTER))
            return 0;
    return 1;
}

static vocc_status decide_part(const vocc_beaming *w, part p, int level,
                               const vocc_beam_list *from)
{
    vocc_beam_room *room = w->room;
    vocc_beam *b = &room->beam;
    vocc_beam_list *list = &room->lists[level];
    double low[3], high[3];
    const uint32_t rays = count_rays(&room->store, &p);
    vocc_status status = VOCC_OK;
    int i;
    if (!rays)
        return VOCC_OK;
    w->counters->beams++;
    vocc_cells_end(&room->store, p.cell, p.cells, low, high);
    vocc_beam_set_end(b, &w->light->target, &room->store.frame, low, high);
    w->kernels->narrow(b, from, list);
    if (!list->count) {
        w->counters->beam_lit_rays += rays;
        return VOCC_OK;
    }
    if (is_dark(w, &room->boxes[level - 1], &room->boxes[level])) {
        w->counters->beam_dark_rays += rays;
        mark_dark(&room->store, &p);
        return VOCC_OK;
    }
    if (rays >= (uint32_t)(FAN_SAMPLES * p.points.count) &&
        list->count <= FAN_LIST && cells_a_block(&room->store, &p) &&
        (rays <= VOCC_BEAM_RAYS || is_clusters(list)))
        return test_fans(w, &p, list, &room->boxes[level]);
    /* A cell at one point has no more. */
    if (rays <= VOCC_BEAM_RAYS)
        return list->closed ? trace_packets(w, &p)
                            : test_rays(w, &p, list, &room->boxes[level]);
    if (p.cells == 1 ||
        (p.points.count > 1 && points_are_wider(w, list->near))) {
        const int parts = p.points.count > 4 ? 4 : p.points.count;
        for (i = 0; i < parts && status == VOCC_OK; i++) {
            part q = p;
            q.points = part_of(p.points, i, parts);
            q.first = p.first + q.points.first - p.points.first;
            if (!q.points.count)
                continue;
            set_points(w, q.points);
            status = decide_part(w, q, level + 1, list);
        }
        set_points(w, p.points);
    } else {
        for (i = 0; i < 4 && status == VOCC_OK; i++) {
            part q = p;
            q.cells = p.cells / 4;
            q.cell = p.cell + i * q.cells;
            status = decide_part(w, q, level + 1, list);
        }
    }
    if (status == VOCC_OK)
        status = vocc_shadow_poll(w->g, p.points.count);
    return status;
}

/* Few clusters and no nodes: it pays to ask for each point. */
static int is_short(const vocc_beam_list *list)
{
    return list->count <= SHORT_LIST && is_clusters(list);
}

/* Moves the points whose bits are set to the front; how many. */
static int sort_points(const vocc_beaming *w, vocc_range r, uint64_t bits)
{
    uint16_t *which = w->light->which + r.first, rest[VOCC_GROUP];
    int i, n = 0, left = 0;
    for (i = 0; i < r.count; i++)
        if (bits >> i & 1)
            which[n++] = which[i];
        else
            rest[left++] = which[i];
    memcpy(which + n, rest, (size_t)left * sizeof *rest);
    return n;
}

/* Settles the points whose bits are set; the beam is that of the others. */
static vocc_status settle_points(const vocc_beaming *w, vocc_range *r,
                                 uint64_t bits, int dark, uint64_t *counter)
{
    vocc_range some = *r;
    const int n = sort_points(w, *r, ~bits);
    if (n == r->count)
        return VOCC_OK;
    some.first = (uint16_t)(r->first + n);
    some.count = (uint16_t)(r->count - n);
    r->count = (uint16_t)n;
    if (n) {
        set_points(w, *r);
        set_whole_end(w);
    }
    return vocc_group_settle(w, some, dark, counter);
}

/* A look at a cluster takes as long as so many tests of 16 boxes, with a fan
 * for each point. */
#define TESTS_A_CLUSTER 64.0f

/* Points of the group from which a triangle hides the light. */
static uint64_t find_hidden(const vocc_beaming *w, uint32_t samples)
{
    vocc_beam *b = &w->room->beam;
    const uint64_t before = b->clusters,
                   hidden = w->kernels->hide(b, &w->room->lists[0]);
    vocc_worth_tested(&w->light->hiding,
                      (int)samples * vocc_count_bits64(hidden),
                      TESTS_A_CLUSTER * (float)(b->clusters - before));
    return hidden;
}

/* Second round: a group of points that are all known to be outside, or none.
 */
static vocc_status decide(const vocc_beaming *w, vocc_range r)
{
    vocc_beam_room *room = w->room;
    vocc_beam *b = &room->beam;
    const uint32_t samples = w->g->s->pattern.samples;
    uint32_t first, count;
    vocc_status status = VOCC_OK;
    int i;
    if (!r.count)
        return VOCC_OK;
    w->counters->beams++;
    set_points(w, r);
    set_whole_end(w);
    b->exits = w->light->target.region == 0;
    for (i = 0; i < r.count; i++)
        b->exits &= room->outside[w->light->which[r.first + i]];
    w->kernels->narrow(b, NULL, &room->lists[0]);
    if (!room->lists[0].count)
        return vocc_group_settle(w, r, 0, &w->counters->beam_lit_rays);
    if (vocc_worth_test(&w->light->hiding))
        status = settle_points(w, &r, find_hidden(w, samples), 1,
                               &w->counters->beam_hidden_rays);
    if (status == VOCC_OK && r.count && is_short(&room->lists[0]))
        status = settle_points(w, &r, ~w->kernels->sieve(b, &room->lists[0]), 0,
                               &w->counters->beam_lit_rays);
    if (!r.count || status != VOCC_OK)
        return status;
    if (is_dark(w, NULL, &room->boxes[0]))
        return vocc_group_settle(w, r, 1, &w->counters->beam_dark_rays);
    for (first = 0; first < samples && status == VOCC_OK; first += count) {
        part p;
        count = samples - first < VOCC_CHUNK ? samples - first : VOCC_CHUNK;
        if (count * r.count > VOCC_STORE) {
            /* Too many for the store. */
            for (i = 0; i < 4 && status == VOCC_OK; i++)
                status = decide(w, part_of(r, i, 4));
            return status;
        }
        vocc_group_fill(w, r, first, count);
        p.points = r;
        p.first = 0;
        p.cell = 0;
        p.cells = room->store.cells;
        status = decide_part(w, p, 1, &room->lists[0]);
        vocc_group_read(w, r, first);
        if (status == VOCC_OK)
            status = vocc_shadow_poll(w->g, (uint64_t)count * r.count /
                                                VOCC_SAMPLES_LIKE_A_RAY);
    }
    return status;
}

/* Moves the points that are known to be outside to the front; how many. */
static int sort_outside(const vocc_beaming *w, vocc_range r)
{
    const uint16_t *which = w->light->which + r.first;
    uint64_t bits = 0;
    int i;
    for (i = 0; i < r.count; i++)
        if (w->light->target.region != 0 || w->room->outside[which[i]])
            bits |= (uint64_t)1 << i;
    return sort_points(w, r, bits);
}

/* Points that are known to be outside; the others are left for later, when
 * other lights may have told. */
vocc_status vocc_group_decide(const vocc_beaming *w, vocc_range r, int last)
{
    const int n = sort_outside(w, r);
    vocc_range certain = r, rest = r;
    vocc_status status;
    certain.count = (uint16_t)n;
    rest.first = (uint16_t)(r.first + n);
    rest.count = (uint16_t)(r.count - n);
    status = decide(w, certain);
    if (last && status == VOCC_OK)
        return decide(w, rest);
    if (rest.count)
        w->light->uncertain[w->light->uncertain_count++] = rest;
    return status;
}
