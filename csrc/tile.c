#include "tile.h"
#include "array.h"
#include "memory.h"
#include "sort.h"
#include "vec3.h"

#include <string.h>

/* The bits of a number below 2^10, three places apart. */
static uint64_t spread(uint32_t x)
{
    uint64_t bits = x;
    bits = (bits | bits << 16) & 0x030000FFu;
    bits = (bits | bits << 8) & 0x0300F00Fu;
    bits = (bits | bits << 4) & 0x030C30C3u;
    bits = (bits | bits << 2) & 0x09249249u;
    return bits;
}

/* A grid over the bounds of some points. */
typedef struct grid {
    double lower[3], upper[3], scale;
} grid;

static void grid_begin(grid *g)
{
    int k;
    for (k = 0; k < 3; k++) {
        g->lower[k] = (double)FLT_MAX;
        g->upper[k] = -(double)FLT_MAX;
    }
}

static void grid_add(grid *g, const float p[3])
{
    int k;
    for (k = 0; k < 3; k++) {
        const double x = (double)p[k];
        g->lower[k] = x < g->lower[k] ? x : g->lower[k];
        g->upper[k] = x > g->upper[k] ? x : g->upper[k];
    }
}

static void grid_end(grid *g, int cells)
{
    double extent = 0.0;
    int k;
    for (k = 0; k < 3; k++)
        if (g->upper[k] - g->lower[k] > extent)
            extent = g->upper[k] - g->lower[k];
    g->scale = extent > 0.0 ? (double)cells * (1.0 - 0x1p-30) / extent : 0.0;
}

/* Morton code of the cell: 30 bits. */
static uint64_t grid_cell(const grid *g, const float p[3])
{
    uint64_t code = 0;
    int k;
    for (k = 0; k < 3; k++)
        code |= spread((uint32_t)(((double)p[k] - g->lower[k]) * g->scale))
                << k;
    return code;
}

static int load_position(const vocc_points *points, size_t i, float p[3])
{
    int k, usable = 1;
    for (k = 0; k < 3; k++) {
        p[k] = (float)(vocc_get_float(&points->position, i, k) -
                       points->origin[k]);
        usable &= vocc_finitef(p[k]) != 0;
    }
    return usable;
}

static void load_point(vocc_tile *t, size_t slot, const vocc_points *points,
                       size_t number, const float p[3], uint64_t voxel)
{
    int k;
    t->number[slot] = number;
    t->voxel[slot] = voxel;
    t->id[slot] = points->id.data
                      ? *(const uint32_t *)vocc_row(&points->id, number)
                      : (uint32_t)number;
    for (k = 0; k < 3; k++) {
        const double x = vocc_abs((double)p[k]);
        t->point[slot][k] = p[k];
        t->normal[slot][k] = vocc_get_float(&points->normal, number, k);
        if (x > t->reach[k])
            t->reach[k] = x;
    }
}

void vocc_tile_load(vocc_tile *t, const vocc_points *points, size_t job)
{
    const size_t first = job * VOCC_TILE_POINTS;
    const size_t count = points->count - first < VOCC_TILE_POINTS
                             ? points->count - first
                             : VOCC_TILE_POINTS;
    float p[VOCC_TILE_POINTS][3];
    uint64_t keys[VOCC_TILE_POINTS], voxel[VOCC_TILE_POINTS];
    size_t number[VOCC_TILE_POINTS], i;
    grid g;
    grid_begin(&g);
    t->count = t->unused = 0;
    t->reach[0] = t->reach[1] = t->reach[2] = 0.0;
    for (i = 0; i < count; i++) {
        number[i] = first + i;
        voxel[i] = 0;
        if (points->by_voxel) {
            const uint64_t key = points->by_voxel[first + i];
            voxel[i] = key >> points->number_bits;
            number[i] =
                (size_t)(key & (((uint64_t)1 << points->number_bits) - 1));
        }
        if (load_position(points, number[i], p[i])) {
            grid_add(&g, p[i]);
            keys[t->count++] = (uint64_t)i;
        } else {
            t->number[count - ++t->unused] = number[i];
        }
    }
    if (points->neighbours && !points->by_voxel) {
        grid_end(&g, 1024);
        for (i = 0; i < t->count; i++)
            keys[i] |= grid_cell(&g, p[keys[i]]) << 16;
        vocc_sort(keys, t->count);
    }
    for (i = 0; i < t->count; i++) {
        const size_t from = (size_t)(keys[i] & 0xFFFFu);
        load_point(t, i, points, number[from], p[from], voxel[from]);
    }
}

/* ---- voxels -----------------------------------------------------------------
 */

enum { CELL_BITS = 30, DIGIT_BITS = 10, DIGITS = 1 << DIGIT_BITS };

/* Points between ticks. */
enum { TICK_POINTS = 1 << 16 };

static int tick(vocc_ticker *ticker, size_t i)
{
    return i % TICK_POINTS == 0 && vocc_tick(ticker, 0.0);
}

/* One pass of a radix sort: by the digit from bit `shift` on; equal ones keep
 * their order. */
static int sort_digit(const uint64_t *from, uint64_t *to, size_t count,
                      int shift, vocc_ticker *ticker)
{
    size_t start[DIGITS] = {0}, i, sum = 0;
    int d;
    for (i = 0; i < count; i++) {
        if (tick(ticker, i))
            return 0;
        start[from[i] >> shift & (DIGITS - 1)]++;
    }
    for (d = 0; d < DIGITS; d++) {
        const size_t n = start[d];
        start[d] = sum;
        sum += n;
    }
    for (i = 0; i < count; i++) {
        if (tick(ticker, i))
            return 0;
        to[start[from[i] >> shift & (DIGITS - 1)]++] = from[i];
    }
    return 1;
}

static int sort_voxels(vocc_points *points, uint64_t *spare, int voxels,
                       vocc_ticker *ticker)
{
    uint64_t *keys = points->by_voxel;
    grid g;
    float p[3];
    size_t i;
    int bit;
    grid_begin(&g);
    for (i = 0; i < points->count; i++) {
        if (tick(ticker, i))
            return 0;
        if (load_position(points, i, p))
            grid_add(&g, p);
    }
    grid_end(&g, voxels);
    for (i = 0; i < points->count; i++) {
        if (tick(ticker, i))
            return 0;
        keys[i] = (load_position(points, i, p) ? grid_cell(&g, p) : 0)
                      << points->number_bits |
                  (uint64_t)i;
    }
    /* The numbers are in order already. */
    for (bit = 0; bit < CELL_BITS; bit += DIGIT_BITS) {
        const uint64_t *from = bit / DIGIT_BITS % 2 ? spare : keys;
        if (!sort_digit(from, bit / DIGIT_BITS % 2 ? keys : spare,
                        points->count, points->number_bits + bit, ticker))
            return 0;
    }
    /* An odd number of passes. */
    memcpy(keys, spare, points->count * sizeof *keys);
    return 1;
}

vocc_status vocc_points_by_voxel(const vocc_allocator *allocator,
                                 vocc_points *points, int voxels,
                                 vocc_ticker *ticker)
{
    uint64_t *spare;
    vocc_status status = VOCC_OK;
    points->number_bits = 1;
    while (points->count >> points->number_bits)
        points->number_bits++;
    if (points->number_bits + CELL_BITS > 64)
        return VOCC_ERROR_LIMIT;
    points->by_voxel =
        vocc_allocate(allocator, points->count, sizeof *points->by_voxel);
    spare = vocc_allocate(allocator, points->count, sizeof *spare);
    if (!points->by_voxel || !spare)
        status = VOCC_ERROR_OUT_OF_MEMORY;
    else if (!sort_voxels(points, spare, voxels, ticker))
        status = VOCC_ERROR_CANCELLED;
    vocc_release(allocator, spare);
    return status;
}
