/* The segments of a group of points to a light: made, kept by the cells of the
 * light that they end in, and counted. */
#include "shadow_group.h"

#include <float.h>
#include <math.h>
#include <string.h>

/* Cells along an edge of a light. */
enum { MAX_GRID = 8 };

/* ---- the samples of a point -------------------------------------------------
 */

/* Samples from `first` on at one point; the tile's number is `which`. */
typedef struct point_samples {
    const vocc_beaming *w;
    uint16_t which;
    uint32_t id, seed;
    vocc_aim aim;
} point_samples;

static void point_begin(point_samples *p, const vocc_beaming *w, uint16_t which)
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
    vocc_lit_tile *l = p->w->light;
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
static vocc_status settle_part(const vocc_beaming *w, uint16_t which, int dark,
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
        if (i % VOCC_CHUNK == VOCC_CHUNK - 1)
            status = vocc_shadow_poll(g, VOCC_CHUNK / VOCC_SAMPLES_LIKE_A_RAY);
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

vocc_status vocc_group_settle(const vocc_beaming *w, vocc_range r, int dark,
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

/* Cells of the samples first .. first + count - 1.  Strata belong to cells;
 * other samples lie in squares. */
static void make_order(const vocc_pattern *pattern, uint32_t first,
                       uint32_t count, vocc_cell_order *order)
{
    uint16_t next[VOCC_CELLS + 1];
    uint32_t i;
    int c, k;
    order->first = first;
    order->count = count;
    order->grid = count <= 4 ? 1 : count <= 8 ? 2 : count <= 64 ? 4 : MAX_GRID;
    order->cells = order->grid * order->grid;
    order->is_fixed = pattern->sampler == VOCC_SAMPLER_JITTER;
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
        order->low[c][2] = 0.0;
        order->high[c][2] = 1.0;
    }
    for (i = 0; order->is_fixed && i < count; i++) {
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
        order->place[order->is_fixed ? next[order->cell[i]]++ : i] =
            (uint16_t)i;
    order->strata.is_jitter = order->is_fixed;
    order->strata.count = count;
    order->strata.width = pattern->width;
    order->strata.height = pattern->height;
    for (i = 0; i < count; i++) {
        const vocc_place *p = &pattern->places[first + order->place[i]];
        order->strata.sample[i] = p->sample;
        order->strata.column[i] = p->column;
        order->strata.row[i] = p->row;
        order->strata.x[i] = p->x;
        order->strata.y[i] = p->y;
    }
}

/* Segments of all samples in the order of `order`. */
static void make_segments(const point_samples *p, float *a, float *b,
                          float *dir[3])
{
    const vocc_beaming *w = p->w;
    const vocc_cell_order *order = &w->room->order;
    w->kernels->samples(&order->strata,
                        order->is_fixed
                            ? vocc_jitter_key(p->id, (uint32_t)w->g->number)
                            : p->seed,
                        &p->aim.view, a, b, dir);
}

/* The segments of a point whose cells are the same at all points, if all of
 * them are to be decided. */
static uint32_t store_fixed(const vocc_beaming *w, int number, uint16_t which,
                            uint32_t at)
{
    vocc_segments *s = &w->room->store;
    const vocc_cell_order *order = &w->room->order;
    float a[VOCC_CHUNK], b[VOCC_CHUNK], *dir[3];
    point_samples p;
    int c, k;
    point_begin(&p, w, which);
    for (k = 0; k < 3; k++)
        dir[k] = s->dir[k] + at;
    make_segments(&p, a, b, dir);
    memcpy(s->sample + at, order->place, order->count * sizeof *s->sample);
    for (c = 0; c <= order->cells; c++)
        s->start[number][c] = at + order->start[c];
    return at + order->count;
}

/* Cells at (a, b) of the unit square; a and b may be 1, by rounding. */
static void find_cells(const vocc_cell_order *order, const float *a,
                       const float *b, uint8_t *cell)
{
    const float grid = (float)order->grid;
    const int last = order->grid - 1;
    uint32_t i;
    for (i = 0; order->is_fixed && i < order->count; i++)
        cell[i] = order->cell[order->place[i]];
    for (i = 0; !order->is_fixed && i < order->count; i++) {
        const int column = (int)(a[i] * grid), row = (int)(b[i] * grid);
        cell[i] = (uint8_t)cell_number(column < last ? column : last,
                                       row < last ? row : last);
    }
}

static uint32_t store_sorted(const vocc_beaming *w, int number, uint16_t which,
                             uint32_t at)
{
    const vocc_lighting *g = w->g;
    vocc_segments *s = &w->room->store;
    const uint8_t *const bits = vocc_shadow_bits(g, which);
    const vocc_cell_order *order = &w->room->order;
    float a[VOCC_CHUNK], b[VOCC_CHUNK], dirs[3][VOCC_CHUNK],
        *dir[3] = {dirs[0], dirs[1], dirs[2]};
    uint8_t cell[VOCC_CHUNK];
    uint16_t kept[VOCC_CHUNK];
    uint32_t next[VOCC_CELLS + 1], *start = s->start[number], n = 0, i;
    const int are_all = !bits && !w->light->is_part[which];
    point_samples p;
    int c, k;
    point_begin(&p, w, which);
    make_segments(&p, a, b, dir);
    memset(start, 0, sizeof s->start[number]);
    find_cells(order, a, b, cell);
    for (i = 0; i < order->count; i++) {
        const float d[3] = {dirs[0][i], dirs[1][i], dirs[2][i]};
        kept[n] = (uint16_t)i;
        n += are_all || is_wanted(&p, order->first + order->place[i], d, bits);
    }
    for (i = 0; i < n; i++)
        start[cell[kept[i]] + 1]++;
    start[0] = at;
    for (c = 0; c < order->cells; c++)
        start[c + 1] += start[c];
    memcpy(next, start, sizeof next);
    for (i = 0; i < n; i++) {
        const uint32_t from = kept[i], to = next[cell[from]]++;
        s->sample[to] = order->place[from];
        for (k = 0; k < 3; k++)
            s->dir[k][to] = dirs[k][from];
    }
    return at + n;
}

/* With coordinates and |dir| up to S, what is computed here in double from
 * float32 numbers is off by less than 2^-47 S, and the frame's axes are
 * orthonormal within 2^-50: far below the target's slack, 2^-20 S. */
void vocc_segments_measure(vocc_segments *s, const float (*point)[3],
                           const uint16_t *which, int count, int is_direction,
                           double (*low)[3], double (*high)[3])
{
    int i, c, j, k;
    s->low = (const double (*)[3])low;
    s->high = (const double (*)[3])high;
    for (c = 0; c < s->cells; c++)
        for (j = 0; j < 3; j++) {
            low[c][j] = DBL_MAX;
            high[c][j] = -DBL_MAX;
        }
    for (i = 0; i < count; i++) {
        double from[3] = {0.0, 0.0, 0.0};
        for (j = 0; j < 3; j++)
            for (k = 0; k < 3; k++)
                from[j] += s->frame.axis[j][k] *
                           ((is_direction ? 0.0 : (double)point[which[i]][k]) -
                            s->frame.origin[k]);
        for (c = 0; c < s->cells; c++) {
            uint32_t at;
            for (at = s->start[i][c]; at < s->start[i][c + 1]; at++) {
                const double x = (double)s->dir[0][at],
                             y = (double)s->dir[1][at],
                             z = (double)s->dir[2][at];
                for (j = 0; j < 3; j++) {
                    const double *const a = s->frame.axis[j];
                    const double to =
                        from[j] + (a[0] * x + a[1] * y + a[2] * z);
                    low[c][j] = to < low[c][j] ? to : low[c][j];
                    high[c][j] = to > high[c][j] ? to : high[c][j];
                }
            }
        }
    }
}

/* The segments of a group from sample `first` on. */
void vocc_group_fill(const vocc_beaming *w, vocc_range r, uint32_t first,
                     uint32_t count)
{
    vocc_beam_room *room = w->room;
    vocc_segments *s = &room->store;
    const int is_rectangle = w->g->light->type == VOCC_LIGHT_RECT;
    vocc_cell_order *order = &room->order;
    const uint16_t *which = w->light->which + r.first;
    uint32_t at = 0;
    int i;
    if (order->first != first || order->count != count)
        make_order(&w->g->s->pattern, first, count, order);
    s->cells = order->cells;
    s->tmax = w->light->target.is_direction ? INFINITY : 1.0f;
    for (i = 0; i < r.count; i++)
        at =
            order->is_fixed && !w->g->s->blocked && !w->light->is_part[which[i]]
                ? store_fixed(w, i, which[i], at)
                : store_sorted(w, i, which[i], at);
    memset(s->blocked, 0, at);
    if (is_rectangle) {
        vocc_beam_hull_frame(&w->light->target, &s->frame);
        s->low = (const double (*)[3])order->low;
        s->high = (const double (*)[3])order->high;
    } else {
        const vocc_tile *t = w->g->t;
        vocc_emitter_frame(w->g->light, t->point[which[r.count / 2]],
                           &s->frame);
        vocc_segments_measure(s, t->point, which, r.count,
                              w->light->target.is_direction, room->low,
                              room->high);
    }
}

/* Adds the weights of a point's samples in the order of the pattern, as rays
 * do: sums depend on it. */
static void weigh(const vocc_beaming *w, uint16_t which, uint32_t first,
                  uint32_t from, uint32_t to)
{
    const vocc_segments *s = &w->room->store;
    vocc_tally *sum = &w->light->tallies[which];
    uint8_t is_open[VOCC_CHUNK];
    point_samples p;
    uint32_t i, k;
    memset(is_open, 0, sizeof is_open);
    for (k = from; k < to; k++)
        is_open[s->sample[k]] = !s->blocked[k];
    point_begin(&p, w, which);
    for (i = 0; i < w->room->order.count; i++) {
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
void vocc_group_read(const vocc_beaming *w, vocc_range r, uint32_t first)
{
    vocc_lighting *g = w->g;
    const vocc_segments *s = &w->room->store;
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

void vocc_cells_end(const vocc_segments *s, int cell, int cells, double low[3],
                    double high[3])
{
    int c, k;
    for (k = 0; k < 3; k++) {
        low[k] = s->low[cell][k];
        high[k] = s->high[cell][k];
        for (c = cell + 1; c < cell + cells; c++) {
            low[k] = s->low[c][k] < low[k] ? s->low[c][k] : low[k];
            high[k] = s->high[c][k] > high[k] ? s->high[c][k] : high[k];
        }
    }
}
