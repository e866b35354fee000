/* Shadows by beams: groups of neighbouring points and a light, decided at once.
 *
 * Lights are taken some at a time.  First every group is asked whether any
 * triangle stands between: most are lit.  Such points surely lie in the region
 * of the light, outside of all solids, and so for all lights: that is what lets
 * the second round look at exits only (beam.h).  There the beam of a group is
 * split, by its points or by the light's cells, whichever is wider where it
 * meets triangles; parts are lit if they meet nothing, dark if a slice lies
 * inside an occluder; and when few segments are left they are tested. */
#include "beam.h"
#include "lanes.h"
#include "memory.h"
#include "query.h"
#include "shadow.h"
#include "vec3.h"

#include <math.h>
#include <string.h>

enum {
    LIGHTS = 8,             /* at a time */
    GROUP = 64,             /* points */
    STORE = 16384,          /* segments of a group */
    CHUNK = VOCC_BEAM_RAYS, /* samples of a point at a time */
    RECENT = VOCC_WIDE,
    BOXES = 32, /* that single segments are tested against */
    SHORT_LIST = 12,
    /* Fans from points with so many samples each, and clusters not too many. */
    FAN_SAMPLES = 24,
    FAN_LIST = 24,
    MAX_GRID = 8,
    CELLS = MAX_GRID * MAX_GRID,
    LEVELS = 7 /* of quartering points and cells, and the group itself */
};

/* Nodes and clusters that take as long as a ray. */
enum { STEPS_LIKE_A_RAY = 8 };

typedef struct range {
    uint16_t first, count;
} range;

/* One light at a tile. */
typedef struct lit_tile {
    vocc_target target;
    uint16_t which[VOCC_TILE_POINTS]; /* points that face it, in tile order */
    size_t count;
    uint8_t is_part[VOCC_TILE_POINTS]; /* by the tile's number */
    vocc_tally tallies[VOCC_TILE_POINTS];
    range pending[VOCC_TILE_POINTS / GROUP];
    int pending_count;
    range uncertain[VOCC_TILE_POINTS / GROUP]; /* not known to be outside */
    int uncertain_count;
    vocc_beam_boxes recent; /* occluders that made groups dark last */
} lit_tile;

/* The segments of a group, point by point, and by the cell of the light that
 * they end in: cells along a Morton curve. */
typedef struct segments {
    int cells;
    float tmax;
    uint32_t start[GROUP][CELLS + 1];
    float dir[3][STORE + VOCC_WIDE], inverse[3][STORE + VOCC_WIDE];
    uint16_t sample[STORE]; /* place in the pattern, less that of the first */
    uint8_t blocked[STORE];
} segments;

/* Cells of a light: the parts that they cover, and, if they are the same
 * samples at all points (is_fixed), these in the order of cells. */
typedef struct cell_order {
    int grid, cells, is_fixed;
    uint32_t first, count; /* samples */
    uint16_t place[CHUNK], start[CELLS + 1];
    uint8_t cell[CHUNK]; /* of each sample */
    double low[CELLS][2], high[CELLS][2];
    vocc_strata strata; /* in the order of `place` */
} cell_order;

struct vocc_beam_room {
    vocc_beam beam;
    vocc_beam_list lists[LEVELS + 1];
    vocc_beam_rays rays;
    vocc_beam_fans fans;
    uint32_t origin[VOCC_BEAM_RAYS]; /* of each ray, its number in the store */
    segments store;
    cell_order rectangle, whole; /* of rectangles, and of other lights */
    const cell_order *order;     /* of the light */
    lit_tile lights[LIGHTS];
    uint8_t outside[VOCC_TILE_POINTS]; /* points surely in region 0 */
    vocc_beam_boxes boxes[LEVELS + 1]; /* occluders that beams meet */
    vocc_worker checker;               /* traces again for `verify` */
    vocc_beam_mismatch mismatch;
};

typedef struct beaming {
    vocc_lighting *g;
    vocc_beam_room *room;
    lit_tile *light;
    const vocc_beam_kernels *kernels;
    vocc_counters *counters;
    const vocc_shadow *shadow;
} beaming;

int vocc_beam_rooms_create(vocc_shadow *s)
{
    const vocc_allocator *a = &s->query.scene->allocator;
    const size_t count = (size_t)s->query.worker_count;
    vocc_query_options baseline = s->query.options;
    size_t i;
    s->rooms = vocc_allocate(a, count, sizeof *s->rooms);
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
    vocc_release(a, s->rooms);
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

/* ---- the samples of a point -------------------------------------------------
 */

/* Samples from `first` on at one point; the tile's number is `which`. */
typedef struct point_samples {
    const beaming *w;
    uint16_t which;
    uint32_t id, seed;
    vocc_aim aim;
} point_samples;

static void point_begin(point_samples *p, const beaming *w, uint16_t which)
{
    const vocc_lighting *g = w->g;
    p->w = w;
    p->which = which;
    p->id = g->t->id[which];
    p->seed = vocc_sample_seed(p->id, (uint32_t)g->number);
    vocc_aim_init(&p->aim, g->light, g->t->point[which], g->t->normal[which]);
}

VOCC_INLINE float point_ray(const point_samples *p, uint32_t place, float ab[2],
                            float dir[3])
{
    const vocc_shadow *s = p->w->g->s;
    vocc_sample(&s->pattern, p->id, (uint32_t)p->w->g->number, p->seed,
                &s->pattern.places[place], &ab[0], &ab[1]);
    return vocc_aim_ray(&p->aim, ab[0], ab[1], dir);
}

/* Whether the sample has to be decided: it is above the surface and not blocked
 * already. */
static int is_wanted(const point_samples *p, uint32_t place, const float dir[3],
                     const uint8_t *bits)
{
    lit_tile *l = p->w->light;
    vocc_tally *sum = &l->tallies[p->which];
    if (l->is_part[p->which] && !vocc_aim_is_above(&p->aim, dir)) {
        sum->below++;
        sum->blocked++;
        return 0;
    }
    if (vocc_is_blocked(bits, p->w->g->s->pattern.places[place].sample)) {
        sum->blocked++;
        return 0;
    }
    return 1;
}

/* ---- groups that are settled ------------------------------------------------
 */

/* A point of a group that is all lit or all dark, some of whose samples are
 * below its surface. */
static vocc_status settle_part(const beaming *w, uint16_t which, int dark,
                               uint64_t *settled)
{
    vocc_lighting *g = w->g;
    uint8_t *const bits = vocc_shadow_bits(g, which);
    vocc_tally *sum = &w->light->tallies[which];
    point_samples p;
    uint32_t i;
    vocc_status status = VOCC_OK;
    point_begin(&p, w, which);
    for (i = 0; i < g->s->pattern.samples && status == VOCC_OK; i++) {
        float ab[2], dir[3];
        if (i % CHUNK == CHUNK - 1)
            status = vocc_shadow_poll(g, CHUNK / VOCC_SAMPLES_LIKE_A_RAY);
        (void)point_ray(&p, i, ab, dir);
        if (g->s->irradiance && !dark) {
            const double weight = vocc_aim_weight(&p.aim, dir);
            if (vocc_aim_is_above(&p.aim, dir)) {
                sum->all += weight;
                if (!vocc_is_blocked(bits, g->s->pattern.places[i].sample))
                    sum->open += weight;
            }
        }
        if (is_wanted(&p, i, dir, bits)) {
            ++*settled;
            w->counters->rays++;
            if (dark) {
                w->counters->occluded++;
                sum->blocked++;
                if (bits)
                    vocc_set_blocked(bits, g->s->pattern.places[i].sample);
            }
        }
    }
    return status == VOCC_OK ? vocc_shadow_poll(g, 1) : status;
}

static vocc_status settle(const beaming *w, range r, int dark,
                          uint64_t *settled)
{
    const uint16_t *which = w->light->which + r.first;
    vocc_status status = VOCC_OK;
    size_t i, first = 0;
    for (i = 0; i < r.count && status == VOCC_OK; i++) {
        if (!w->light->is_part[which[i]])
            continue;
        if (i > first)
            status = vocc_shadow_settle(w->g, which + first, i - first, dark,
                                        settled);
        if (status == VOCC_OK)
            status = settle_part(w, which[i], dark, settled);
        first = i + 1;
    }
    if (status == VOCC_OK && first < r.count)
        status = vocc_shadow_settle(w->g, which + first, r.count - first, dark,
                                    settled);
    return status;
}

/* ---- the store --------------------------------------------------------------
 */

/* Cell (column, row) along a Morton curve. */
static int cell_number(int column, int row)
{
    int bit, number = 0;
    for (bit = 0; bit < 3; bit++)
        number |= (column >> bit & 1) << 2 * bit | (row >> bit & 1)
                                                       << (2 * bit + 1);
    return number;
}

static void cell_place(int cell, int *column, int *row)
{
    int bit;
    *column = *row = 0;
    for (bit = 0; bit < 3; bit++) {
        *column |= (cell >> 2 * bit & 1) << bit;
        *row |= (cell >> (2 * bit + 1) & 1) << bit;
    }
}

/* Cells of the samples first .. first + count - 1.  The strata of a rectangle
 * belong to cells; other samples of it lie in squares.  Of other lights the one
 * cell is the whole. */
static void make_order(const vocc_pattern *pattern, uint32_t first,
                       uint32_t count, int is_rectangle, cell_order *order)
{
    uint16_t next[CELLS + 1];
    uint32_t i;
    int c, k;
    order->first = first;
    order->count = count;
    order->grid = !is_rectangle || count <= 4 ? 1
                  : count <= 8                ? 2
                  : count <= 64               ? 4
                                              : MAX_GRID;
    order->cells = order->grid * order->grid;
    order->is_fixed = is_rectangle && pattern->sampler == VOCC_SAMPLER_JITTER;
    memset(order->start, 0, sizeof order->start);
    for (c = 0; c < order->cells; c++) {
        int at[2];
        cell_place(c, &at[0], &at[1]);
        for (k = 0; k < 2; k++) {
            order->low[c][k] =
                order->is_fixed ? 1.0 : (double)at[k] / (double)order->grid;
            order->high[c][k] = order->is_fixed
                                    ? 0.0
                                    : (double)(at[k] + 1) / (double)order->grid;
        }
    }
    if (!order->is_fixed)
        return;
    for (i = 0; i < count; i++) {
        const vocc_place *p = &pattern->places[first + i];
        const double low[2] = {(double)p->column * (double)pattern->width,
                               (double)p->row * (double)pattern->height},
                     size[2] = {(double)pattern->width,
                                (double)pattern->height};
        int at[2];
        for (k = 0; k < 2; k++) {
            at[k] = (int)((low[k] + 0.5 * size[k]) * (double)order->grid);
            at[k] = at[k] < order->grid ? at[k] : order->grid - 1;
        }
        c = cell_number(at[0], at[1]);
        order->cell[i] = (uint8_t)c;
        order->start[c + 1]++;
        for (k = 0; k < 2; k++) {
            if (low[k] < order->low[c][k])
                order->low[c][k] = low[k];
            if (low[k] + size[k] > order->high[c][k])
                order->high[c][k] = low[k] + size[k];
        }
    }
    for (c = 0; c < order->cells; c++)
        order->start[c + 1] = (uint16_t)(order->start[c + 1] + order->start[c]);
    memcpy(next, order->start, sizeof next);
    for (i = 0; i < count; i++)
        order->place[next[order->cell[i]]++] = (uint16_t)i;
    order->strata.count = count;
    order->strata.width = pattern->width;
    order->strata.height = pattern->height;
    for (i = 0; i < count; i++) {
        const vocc_place *p = &pattern->places[first + order->place[i]];
        order->strata.sample[i] = p->sample;
        order->strata.column[i] = p->column;
        order->strata.row[i] = p->row;
    }
}

/* The segments of a point to a light whose cells are the same at all points, if
 * all of them are to be decided. */
static uint32_t store_fixed(const beaming *w, int number, uint16_t which,
                            uint32_t count, uint32_t at)
{
    const vocc_lighting *g = w->g;
    segments *s = &w->room->store;
    const cell_order *order = w->room->order;
    const vocc_emitter *e = g->light;
    int c;
    w->kernels->jitter(&order->strata,
                       g->t->id[which] * 2048u + (uint32_t)g->number * 256u,
                       e->position, e->edge_u, e->edge_v, g->t->point[which],
                       s->dir[0] + at, s->dir[1] + at, s->dir[2] + at);
    memcpy(s->sample + at, order->place, count * sizeof *s->sample);
    for (c = 0; c <= order->cells; c++)
        s->start[number][c] = at + order->start[c];
    s->tmax = 1.0f;
    return at + count;
}

/* The cell of sample i of the order, at (a, b) of the light. */
static int cell_of(const cell_order *order, uint32_t i, const float ab[2])
{
    int at[2], k;
    if (order->is_fixed)
        return order->cell[i];
    for (k = 0; k < 2; k++) {
        at[k] = (int)((double)ab[k] * (double)order->grid);
        at[k] = at[k] < order->grid ? at[k] : order->grid - 1;
    }
    return cell_number(at[0], at[1]);
}

static uint32_t store_sorted(const beaming *w, int number, uint16_t which,
                             uint32_t first, uint32_t count, uint32_t at)
{
    const vocc_lighting *g = w->g;
    segments *s = &w->room->store;
    const uint8_t *const bits = vocc_shadow_bits(g, which);
    const cell_order *order = w->room->order;
    float dirs[CHUNK][3];
    uint16_t cell[CHUNK], kept[CHUNK];
    uint32_t next[CELLS + 1], *start = s->start[number], n = 0, i;
    point_samples p;
    int c, k;
    point_begin(&p, w, which);
    memset(start, 0, sizeof s->start[number]);
    for (i = 0; i < count; i++) {
        float ab[2];
        s->tmax = point_ray(&p, first + i, ab, dirs[n]);
        if (!is_wanted(&p, first + i, dirs[n], bits))
            continue;
        c = cell_of(order, i, ab);
        cell[n] = (uint16_t)c;
        kept[n++] = (uint16_t)i;
        start[c + 1]++;
    }
    start[0] = at;
    for (c = 0; c < order->cells; c++)
        start[c + 1] += start[c];
    memcpy(next, start, sizeof next);
    for (i = 0; i < n; i++) {
        const uint32_t to = next[cell[i]]++;
        s->sample[to] = kept[i];
        for (k = 0; k < 3; k++)
            s->dir[k][to] = dirs[i][k];
    }
    return at + n;
}

/* The segments of a group from sample `first` on. */
static void fill_store(const beaming *w, range r, uint32_t first,
                       uint32_t count)
{
    vocc_beam_room *room = w->room;
    const int is_rectangle = w->g->light->type == VOCC_LIGHT_RECT;
    cell_order *order = is_rectangle ? &room->rectangle : &room->whole;
    const uint16_t *which = w->light->which + r.first;
    uint32_t at = 0;
    int i;
    if (order->first != first || order->count != count)
        make_order(&w->g->s->pattern, first, count, is_rectangle, order);
    room->order = order;
    room->store.cells = order->cells;
    for (i = 0; i < r.count; i++)
        at =
            order->is_fixed && !w->g->s->blocked && !w->light->is_part[which[i]]
                ? store_fixed(w, i, which[i], count, at)
                : store_sorted(w, i, which[i], first, count, at);
    memset(room->store.blocked, 0, at);
}

/* Adds the weights of a point's samples in the order of the pattern, as rays
 * do: sums depend on it. */
static void weigh(const beaming *w, uint16_t which, uint32_t first,
                  uint32_t from, uint32_t to)
{
    const segments *s = &w->room->store;
    vocc_tally *sum = &w->light->tallies[which];
    uint8_t is_open[CHUNK];
    point_samples p;
    uint32_t i, k;
    memset(is_open, 0, sizeof is_open);
    for (k = from; k < to; k++)
        is_open[s->sample[k]] = !s->blocked[k];
    point_begin(&p, w, which);
    for (i = 0; i < w->room->order->count; i++) {
        float ab[2], dir[3];
        double weight;
        (void)point_ray(&p, first + i, ab, dir);
        if (w->light->is_part[which] && !vocc_aim_is_above(&p.aim, dir))
            continue;
        weight = vocc_aim_weight(&p.aim, dir);
        sum->all += weight;
        if (is_open[i])
            sum->open += weight;
    }
}

/* What the store says of each point. */
static void read_store(const beaming *w, range r, uint32_t first)
{
    vocc_lighting *g = w->g;
    const segments *s = &w->room->store;
    int i;
    uint32_t k;
    for (i = 0; i < r.count; i++) {
        const uint16_t which = w->light->which[r.first + i];
        const uint32_t from = s->start[i][0], to = s->start[i][s->cells];
        uint8_t *const bits = vocc_shadow_bits(g, which);
        vocc_tally *sum = &w->light->tallies[which];
        uint32_t n = 0;
        for (k = from; k < to; k++)
            n += s->blocked[k];
        sum->blocked += n;
        w->counters->occluded += n;
        w->counters->rays += to - from;
        if (bits && n)
            for (k = from; k < to; k++)
                if (s->blocked[k])
                    vocc_set_blocked(
                        bits,
                        g->s->pattern.places[first + s->sample[k]].sample);
        if (g->s->irradiance)
            weigh(w, which, first, from, to);
    }
}

/* ---- beams ------------------------------------------------------------------
 */

/* Points of the group that the beam starts at. */
static void set_points(const beaming *w, range r)
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

static range part_of(range r, int i, int parts)
{
    const int size = (r.count + parts - 1) / parts, first = i * size;
    range p;
    p.first = (uint16_t)(r.first + first);
    p.count = (uint16_t)(first >= r.count         ? 0
                         : r.count - first < size ? r.count - first
                                                  : size);
    return p;
}

static const double no_low[2] = {0.0, 0.0}, all_high[2] = {1.0, 1.0};

/* First round. */
static vocc_status find_lit(const beaming *w, range r)
{
    vocc_beam *b = &w->room->beam;
    vocc_status status = VOCC_OK;
    int i;
    if (!r.count)
        return VOCC_OK;
    w->counters->beams++;
    set_points(w, r);
    vocc_beam_set_end(b, &w->light->target, no_low, all_high);
    b->exits = 0;
    if (!w->kernels->meets_any(b)) {
        if (w->light->target.region == 0)
            for (i = 0; i < r.count; i++)
                w->room->outside[w->light->which[r.first + i]] = 1;
        if (vocc_shadow_poll(w->g, r.count / STEPS_LIKE_A_RAY))
            return VOCC_ERROR_CANCELLED;
        return settle(w, r, 0, &w->counters->beam_lit_rays);
    }
    if (r.count > GROUP) {
        for (i = 0; i < 4 && status == VOCC_OK; i++)
            status = find_lit(w, part_of(r, i, 4));
        return status;
    }
    w->light->pending[w->light->pending_count++] = r;
    return vocc_shadow_poll(w->g, r.count);
}

/* Whether an occluder stops the whole beam: one of those that did so last, or
 * of `from` (NULL: all).  If not, *to are those that it meets. */
static int is_dark(const beaming *w, const vocc_beam_boxes *from,
                   vocc_beam_boxes *to)
{
    const vocc_beam *b = &w->room->beam;
    vocc_beam_boxes *recent = &w->light->recent;
    const int32_t region = w->light->target.region;
    int k, n;
    to->count = 0;
    if (region < 0 || !w->g->s->query.options.occluders)
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
    range points; /* of the light's list */
    int first;    /* point, in the store */
    int cell, cells;
} part;

static uint32_t count_rays(const segments *s, const part *p)
{
    uint32_t n = 0;
    int i;
    for (i = p->first; i < p->first + p->points.count; i++)
        n += s->start[i][p->cell + p->cells] - s->start[i][p->cell];
    return n;
}

static void mark_dark(segments *s, const part *p)
{
    int i;
    for (i = p->first; i < p->first + p->points.count; i++) {
        const uint32_t from = s->start[i][p->cell];
        memset(s->blocked + from, 1, s->start[i][p->cell + p->cells] - from);
    }
}

/* Of the 16 segments from `first` on, how many are known to be blocked. */
static int count_blocked(const vocc_beam_rays *r, int first)
{
    int i, n = 0;
    for (i = first; i < r->count && i < first + VOCC_WIDE; i++)
        n += !(r->open[i / VOCC_WIDE] >> i % VOCC_WIDE & 1);
    return n;
}

/* Segments that are few enough: one by one. */
static vocc_status test_rays(const beaming *w, const part *p,
                             const vocc_beam_list *list,
                             const vocc_beam_boxes *boxes)
{
    vocc_beam_room *room = w->room;
    vocc_beam *b = &room->beam;
    vocc_beam_rays *r = &room->rays;
    segments *s = &room->store;
    uint32_t k;
    const uint64_t before = b->nodes + b->clusters;
    int i, j, c, n = 0;
    unsigned any = 0;
    /* Cell by cell: segments that follow each other are alike. */
    for (c = p->cell; c < p->cell + p->cells; c++)
        for (i = 0; i < p->points.count; i++) {
            const uint32_t *const start = s->start[p->first + i];
            for (k = start[c]; k < start[c + 1]; k++, n++) {
                for (j = 0; j < 3; j++) {
                    r->org[j][n] = b->point[j][i];
                    r->dir[j][n] = s->dir[j][k];
                }
                r->owner[n] = (uint8_t)i;
                room->origin[n] = k;
            }
        }
    r->count = n;
    r->tmax = s->tmax;
    r->touching = 0;
    for (i = 0; i < n; i += VOCC_WIDE)
        r->open[i / VOCC_WIDE] =
            (uint16_t)(n - i < VOCC_WIDE ? (1u << (n - i)) - 1u : 0xFFFFu);
    w->kernels->prepare(b, r);
    w->kernels->block_by_boxes(boxes, BOXES, r);
    for (i = 0; i < n; i += VOCC_WIDE) {
        any |= r->open[i / VOCC_WIDE];
        w->counters->beam_box_rays += (uint64_t)count_blocked(r, i);
    }
    if (any)
        w->kernels->block(b, list, r);
    w->counters->beam_tested_rays += (uint64_t)n;
    for (i = 0; i < n; i++)
        s->blocked[room->origin[i]] =
            !(r->open[i / VOCC_WIDE] >> i % VOCC_WIDE & 1);
    /* A segment that meets nothing starts outside; unless on a triangle. */
    if (!r->touching && w->light->target.region == 0 && !b->exits)
        for (i = 0; i < n; i++)
            if (r->open[i / VOCC_WIDE] >> i % VOCC_WIDE & 1)
                w->room
                    ->outside[w->light->which[p->points.first + r->owner[i]]] =
                    1;
    return vocc_shadow_poll(w->g, (uint64_t)n / STEPS_LIKE_A_RAY +
                                      (b->nodes + b->clusters - before));
}

/* The part of the light that some cells cover. */
static void cells_end(const cell_order *o, int cell, int cells, double low[2],
                      double high[2])
{
    int c, k;
    for (k = 0; k < 2; k++) {
        low[k] = o->low[cell][k];
        high[k] = o->high[cell][k];
        for (c = cell + 1; c < cell + cells; c++) {
            low[k] = o->low[c][k] < low[k] ? o->low[c][k] : low[k];
            high[k] = o->high[c][k] > high[k] ? o->high[c][k] : high[k];
        }
    }
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
static int points_are_wider(const beaming *w, float near)
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
static int cells_a_block(const segments *s, const part *p)
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
static vocc_status test_fans(const beaming *w, const part *p,
                             const vocc_beam_list *list,
                             const vocc_beam_boxes *boxes)
{
    vocc_beam_room *room = w->room;
    vocc_beam *b = &room->beam;
    vocc_beam_fans *f = &room->fans;
    segments *s = &room->store;
    const uint64_t before = b->nodes + b->clusters;
    const int step = cells_a_block(s, p);
    double low[2], high[2];
    int i, j, k;
    float norm = 0.0f;
    cells_end(room->order, p->cell, p->cells, low, high);
    f->blocks = step ? p->cells / step : 0;
    for (k = 0; k < 2; k++)
        for (j = 0; j < f->blocks; j++) {
            double from[2], to[2], a, c, size = high[k] - low[k];
            cells_end(room->order, p->cell + j * step, step, from, to);
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
    return vocc_shadow_poll(w->g, (uint64_t)p->points.count / STEPS_LIKE_A_RAY +
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

static vocc_status decide_part(const beaming *w, part p, int level,
                               const vocc_beam_list *from)
{
    vocc_beam_room *room = w->room;
    vocc_beam *b = &room->beam;
    vocc_beam_list *list = &room->lists[level];
    double low[2], high[2];
    const uint32_t rays = count_rays(&room->store, &p);
    vocc_status status = VOCC_OK;
    int i;
    if (!rays)
        return VOCC_OK;
    w->counters->beams++;
    cells_end(room->order, p.cell, p.cells, low, high);
    vocc_beam_set_end(b, &w->light->target, low, high);
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
        return test_rays(w, &p, list, &room->boxes[level]);
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
static int sort_points(const beaming *w, range r, uint64_t bits)
{
    uint16_t *which = w->light->which + r.first, rest[GROUP];
    int i, n = 0, left = 0;
    for (i = 0; i < r.count; i++)
        if (bits >> i & 1)
            which[n++] = which[i];
        else
            rest[left++] = which[i];
    memcpy(which + n, rest, (size_t)left * sizeof *rest);
    return n;
}

/* Second round: a group of points that are all known to be outside, or none.
 */
static vocc_status decide(const beaming *w, range r)
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
    vocc_beam_set_end(b, &w->light->target, no_low, all_high);
    b->exits = w->light->target.region == 0;
    for (i = 0; i < r.count; i++)
        b->exits &= room->outside[w->light->which[r.first + i]];
    b->is_sharp = 1;
    w->kernels->narrow(b, NULL, &room->lists[0]);
    b->is_sharp = 0;
    if (!room->lists[0].count)
        return settle(w, r, 0, &w->counters->beam_lit_rays);
    if (is_short(&room->lists[0])) {
        const uint64_t may = w->kernels->sieve(b, &room->lists[0]);
        const int n = sort_points(w, r, may);
        range lit = r;
        lit.count = (uint16_t)(r.count - n);
        lit.first = (uint16_t)(r.first + n);
        status = settle(w, lit, 0, &w->counters->beam_lit_rays);
        if (!n || status != VOCC_OK)
            return status;
        if (n < r.count) {
            r.count = (uint16_t)n;
            set_points(w, r);
            vocc_beam_set_end(b, &w->light->target, no_low, all_high);
        }
    }
    if (is_dark(w, NULL, &room->boxes[0]))
        return settle(w, r, 1, &w->counters->beam_dark_rays);
    for (first = 0; first < samples && status == VOCC_OK; first += count) {
        part p;
        count = samples - first < CHUNK ? samples - first : CHUNK;
        if (count * r.count > STORE) {
            /* Too many for the store. */
            for (i = 0; i < 4 && status == VOCC_OK; i++)
                status = decide(w, part_of(r, i, 4));
            return status;
        }
        fill_store(w, r, first, count);
        p.points = r;
        p.first = 0;
        p.cell = 0;
        p.cells = room->store.cells;
        status = decide_part(w, p, 1, &room->lists[0]);
        read_store(w, r, first);
        if (status == VOCC_OK)
            status = vocc_shadow_poll(w->g, (uint64_t)count * r.count /
                                                VOCC_SAMPLES_LIKE_A_RAY);
    }
    return status;
}

/* Moves the points that are known to be outside to the front; how many. */
static int sort_outside(const beaming *w, range r)
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
static vocc_status decide_outside(const beaming *w, range r, int last)
{
    const int n = sort_outside(w, r);
    range certain = r, rest = r;
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

/* ---- tiles ------------------------------------------------------------------
 */

/* Points that face the light, in the order of the tile, where neighbours
 * follow each other. */
static vocc_status begin(beaming *w, size_t l)
{
    vocc_lighting *g = w->g;
    lit_tile *light = w->light;
    size_t lit = 0, parts = 0;
    g->tallies = light->tallies;
    vocc_shadow_begin_light(g, l);
    light->target = g->target;
    light->count = 0;
    light->pending_count = light->uncertain_count = light->recent.count = 0;
    while (lit < g->lit_count || parts < g->part_count) {
        const int is_part =
            lit == g->lit_count ||
            (parts < g->part_count && g->part[parts] < g->lit[lit]);
        const uint16_t which = is_part ? g->part[parts++] : g->lit[lit++];
        light->is_part[which] = (uint8_t)is_part;
        light->which[light->count++] = which;
    }
    return vocc_shadow_poll(g, g->t->count / STEPS_LIKE_A_RAY);
}

static int resume(beaming *w, size_t l)
{
    vocc_lighting *g = w->g;
    g->number = l;
    g->light = &g->s->lights[l];
    g->target = w->light->target;
    g->tallies = w->light->tallies;
    return vocc_beam_limits(&w->room->beam, g->t->reach, &g->target);
}

/* A light beyond the range of beams: by rays. */
static vocc_status by_rays(beaming *w)
{
    const lit_tile *l = w->light;
    vocc_status status = VOCC_OK;
    size_t i;
    for (i = 0; i < l->count && status == VOCC_OK; i++)
        status =
            vocc_shadow_trace(w->g, &l->which[i], 1, l->is_part[l->which[i]]);
    return status;
}

/* One in `verify` of the points of a light, traced again. */
static vocc_status verify(const beaming *w)
{
    vocc_lighting *g = w->g;
    vocc_beam_mismatch *m = &w->room->mismatch;
    const uint32_t n = (uint32_t)g->s->query.options.verify;
    const vocc_worker *const worker = g->worker;
    vocc_shadow plain = *g->s;
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
    g->s = w->shadow;
    g->worker = worker;
    g->tallies = tallies;
    return status;
}

vocc_status vocc_shadow_beams(vocc_lighting *g)
{
    const size_t lights = g->s->light_count;
    beaming w;
    size_t l, first, i;
    int n;
    vocc_status status = VOCC_OK;
    uint64_t nodes, clusters, tests, exact;
    w.g = g;
    w.shadow = g->s;
    w.room = &g->s->rooms[g->worker_number];
    nodes = w.room->beam.nodes;
    clusters = w.room->beam.clusters;
    tests = w.room->beam.ray_tests;
    exact = w.room->beam.exact_tests;
    w.kernels = vocc_find_beam_kernels(g->s->query.options.isa);
    w.counters = &g->worker->tracer->counters;
    memset(w.room->outside, 0, sizeof w.room->outside);
    for (first = 0; first < lights && status == VOCC_OK; first += LIGHTS) {
        const size_t end = first + LIGHTS < lights ? first + LIGHTS : lights;
        for (l = first; l < end && status == VOCC_OK; l++) {
            range all;
            w.light = &w.room->lights[l - first];
            status = begin(&w, l);
            all.first = 0;
            all.count = (uint16_t)w.light->count;
            if (status == VOCC_OK)
                status = resume(&w, l) ? find_lit(&w, all) : by_rays(&w);
        }
        for (l = first; l < end && status == VOCC_OK; l++) {
            w.light = &w.room->lights[l - first];
            (void)resume(&w, l);
            for (n = 0; n < w.light->pending_count && status == VOCC_OK; n++)
                status = decide_outside(&w, w.light->pending[n], 0);
        }
        for (l = first; l < end && status == VOCC_OK; l++) {
            w.light = &w.room->lights[l - first];
            (void)resume(&w, l);
            for (n = 0; n < w.light->uncertain_count && status == VOCC_OK; n++)
                status = decide_outside(&w, w.light->uncertain[n], 1);
            if (status == VOCC_OK && g->s->query.options.verify)
                status = verify(&w);
            for (i = 0; i < w.light->count; i++)
                vocc_shadow_store(g, w.light->which[i]);
        }
    }
    w.counters->beam_nodes += w.room->beam.nodes - nodes;
    w.counters->beam_clusters += w.room->beam.clusters - clusters;
    w.counters->beam_tests += w.room->beam.ray_tests - tests;
    w.counters->exact_tests += w.room->beam.exact_tests - exact;
    return status;
}
