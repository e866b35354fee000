#include "tile.h"
#include "array.h"
#include "memory.h"
#include "vec3.h"

#include <string.h>

/* The bits of a number below 2^10, three places apart. */
static uint32_t spread(uint32_t x)
{
    uint32_t bits = x;
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
static uint32_t grid_cell(const grid *g, const float p[3])
{
    uint32_t code = 0;
    int k;
    for (k = 0; k < 3; k++)
        code |=
            spread((uint32_t)(int32_t)(((double)p[k] - g->lower[k]) * g->scale))
            << k;
    return code;
}

/* vocc_get_float of a row. */
static void get_row(const vocc_array *array, size_t row, double out[3])
{
    const void *const p = vocc_row(array, row);
    int k;
    if (array->type == VOCC_FLOAT32)
        for (k = 0; k < 3; k++)
            out[k] = (double)((const float *)p)[k];
    else
        for (k = 0; k < 3; k++)
            out[k] = ((const double *)p)[k];
}

/* 0 if a coordinate is not finite. */
static int load_position(const vocc_points *points, size_t i, float p[3])
{
    double x[3];
    int k;
    get_row(&points->position, i, x);
    for (k = 0; k < 3; k++)
        p[k] = (float)(x[k] - points->origin[k]);
    return (p[0] - p[0]) + (p[1] - p[1]) + (p[2] - p[2]) == 0.0f;
}

/* Cells along the longest side of a tile's bounds: 2^6, some for each point. */
enum {
    TILE_BITS = 6,
    TILE_PASSES = 3,
    TILE_DIGITS = 1 << TILE_BITS,
    INDEX_BITS = 8
};

/* grid_cell for numbers below 2^6: three at once, 21 bits apart. */
static uint32_t tile_cell(const grid *g, const float p[3])
{
    uint64_t bits = 0;
    int k;
    for (k = 0; k < 3; k++)
        bits |= (uint64_t)(uint32_t)(int32_t)(((double)p[k] - g->lower[k]) *
                                              g->scale)
                << 21 * k;
    bits = (bits | bits << 8) & 0x00C03C0601E0300Fu;
    bits = (bits | bits << 4) & 0x00C30C06186030C3u;
    bits = (bits | bits << 2) & 0x0249241249209249u;
    return (uint32_t)(bits | bits >> 20 | bits >> 40) & ((1u << 18) - 1);
}

/* Sorts keys by the digits above their index, in which they are in order
 * already. */
static void sort_tile(uint32_t *keys, size_t count)
{
    uint32_t spare[VOCC_TILE_POINTS];
    uint16_t start[TILE_PASSES][TILE_DIGITS] = {{0}};
    uint32_t *from = keys, *to = spare;
    size_t i;
    int pass, d;
    for (i = 0; i < count; i++)
        for (pass = 0; pass < TILE_PASSES; pass++)
            start[pass][keys[i] >> (INDEX_BITS + pass * TILE_BITS) &
                        (TILE_DIGITS - 1)]++;
    for (pass = 0; pass < TILE_PASSES; pass++) {
        const int shift = INDEX_BITS + pass * TILE_BITS;
        uint32_t *const other = from;
        unsigned sum = 0;
        if (start[pass][from[0] >> shift & (TILE_DIGITS - 1)] == count)
            continue;
        for (d = 0; d < TILE_DIGITS; d++) {
            const unsigned n = start[pass][d];
            start[pass][d] = (uint16_t)sum;
            sum += n;
        }
        for (i = 0; i < count; i++)
            to[start[pass][from[i] >> shift & (TILE_DIGITS - 1)]++] = from[i];
        from = to;
        to = other;
    }
    if (from != keys)
        memcpy(keys, from, count * sizeof *keys);
}

/* Returns 0 if the normal is finite, else NaN. */
static double load_point(vocc_tile *t, vocc_patch *patch, size_t slot,
                         const vocc_points *points, size_t number,
                         const float p[3])
{
    double n[3];
    int k;
    t->number[slot] = number;
    t->id[slot] = points->id.data
                      ? *(const uint32_t *)vocc_row(&points->id, number)
                      : (uint32_t)number;
    get_row(&points->normal, number, n);
    for (k = 0; k < 3; k++) {
        t->point[slot][k] = p[k];
        t->normal[slot][k] = n[k];
        patch->normal_lower[k] =
            n[k] < patch->normal_lower[k] ? n[k] : patch->normal_lower[k];
        patch->normal_upper[k] =
            n[k] > patch->normal_upper[k] ? n[k] : patch->normal_upper[k];
    }
    return (n[0] - n[0]) + (n[1] - n[1]) + (n[2] - n[2]);
}

void vocc_tile_load(vocc_tile *t, const vocc_points *points, size_t job)
{
    const size_t first = job * VOCC_TILE_POINTS;
    const size_t count = points->count - first < VOCC_TILE_POINTS
                             ? points->count - first
                             : VOCC_TILE_POINTS;
    float p[VOCC_TILE_POINTS][3];
    uint64_t voxel[VOCC_TILE_POINTS];
    uint32_t keys[VOCC_TILE_POINTS];
    size_t number[VOCC_TILE_POINTS], i;
    double not_finite = 0.0;
    vocc_patch patch;
    grid g;
    int k;
    grid_begin(&g);
    t->count = t->unused = 0;
    for (i = 0; i < count; i++) {
        number[i] = first + i;
        if (points->by_voxel) {
            const uint64_t key = points->by_voxel[first + i];
            voxel[i] = key >> points->number_bits;
            number[i] =
                (size_t)(key & (((uint64_t)1 << points->number_bits) - 1));
        }
        VOCC_PREFETCH(vocc_row(&points->normal, number[i]));
        if (load_position(points, number[i], p[i])) {
            grid_add(&g, p[i]);
            keys[t->count++] = (uint32_t)i;
        } else {
            t->number[count - ++t->unused] = number[i];
        }
    }
    for (k = 0; k < 3; k++) {
        const double lower = vocc_abs(g.lower[k]), upper = vocc_abs(g.upper[k]);
        t->reach[k] = !t->count ? 0.0 : lower > upper ? lower : upper;
        patch.lower[k] = g.lower[k];
        patch.upper[k] = g.upper[k];
        patch.normal_lower[k] = DBL_MAX;
        patch.normal_upper[k] = -DBL_MAX;
    }
    t->is_row = !points->by_voxel;
    t->first = first;
    if (points->neighbours && !points->by_voxel && t->count) {
        grid_end(&g, TILE_DIGITS);
        for (i = 0; i < t->count; i++)
            keys[i] |= tile_cell(&g, p[keys[i]]) << INDEX_BITS;
        sort_tile(keys, t->count);
    }
    for (i = 0; i < t->count; i++) {
        const size_t from = keys[i] & (VOCC_TILE_POINTS - 1);
        not_finite += load_point(t, &patch, i, points, number[from], p[from]);
        if (points->by_voxel)
            t->voxel[i] = voxel[from];
    }
    t->patch = patch;
    t->is_patch = t->count > 0 && not_finite == 0.0;
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
        keys[i] = (uint64_t)(load_position(points, i, p) ? grid_cell(&g, p) : 0)
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
