#include "regions.h"
#include "memory.h"
#include "sort.h"
#include "triangle.h"
#include "walk.h"

#include <math.h>
#include <string.h>

/* ---- the table of sets --------------------------------------------------- */

static uint32_t hash_set(const vocc_winding *set, size_t count)
{
    uint32_t h = 0x811C9DC5u;
    size_t i;
    for (i = 0; i < count; i++) {
        h = (h ^ (uint32_t)set[i].solid) * 0x01000193u;
        h = (h ^ (uint32_t)set[i].number) * 0x01000193u;
        h ^= h >> 15;
    }
    return h;
}

static int same_set(const vocc_regions *regions, int32_t id,
                    const vocc_winding *set, size_t count)
{
    const size_t first = regions->start[id];
    return regions->start[id + 1] - first == count &&
           (count == 0 ||
            memcmp(regions->windings + first, set, count * sizeof *set) == 0);
}

/* The slot of the set, or the free one where it belongs. */
static size_t slot_of(const vocc_regions *regions, const vocc_winding *set,
                      size_t count)
{
    size_t slot = hash_set(set, count) & (regions->table_size - 1);
    while (regions->table[slot] >= 0 &&
           !same_set(regions, regions->table[slot], set, count))
        slot = (slot + 1) & (regions->table_size - 1);
    return slot;
}

static int grow_table(const vocc_allocator *allocator, vocc_regions *regions)
{
    const size_t size = regions->table_size ? 2 * regions->table_size : 16;
    int32_t *table = vocc_allocate(allocator, size, sizeof *table);
    size_t i;
    if (!table)
        return 0;
    for (i = 0; i < size; i++)
        table[i] = -1;
    vocc_release(allocator, regions->table);
    regions->table = table;
    regions->table_size = size;
    for (i = 0; i < regions->count; i++) {
        const size_t first = regions->start[i];
        table[slot_of(regions, regions->windings + first,
                      regions->start[i + 1] - first)] = (int32_t)i;
    }
    return 1;
}

int vocc_regions_init(const vocc_allocator *allocator, vocc_regions *regions)
{
    memset(regions, 0, sizeof *regions);
    if (vocc_regions_add(allocator, regions, NULL, 0) == 0)
        return 1;
    vocc_regions_free(allocator, regions);
    return 0;
}

void vocc_regions_free(const vocc_allocator *allocator, vocc_regions *regions)
{
    vocc_release(allocator, regions->windings);
    vocc_release(allocator, regions->start);
    vocc_release(allocator, regions->table);
    memset(regions, 0, sizeof *regions);
}

int32_t vocc_regions_find(const vocc_regions *regions, const vocc_winding *set,
                          size_t count)
{
    return regions->table[slot_of(regions, set, count)];
}

int32_t vocc_regions_add(const vocc_allocator *allocator, vocc_regions *regions,
                         const vocc_winding *set, size_t count)
{
    void *windings = regions->windings, *start = regions->start;
    size_t slot;
    if (2 * (regions->count + 1) > regions->table_size &&
        !grow_table(allocator, regions))
        return -1;
    slot = slot_of(regions, set, count);
    if (regions->table[slot] >= 0)
        return regions->table[slot];
    if (regions->count >= (size_t)INT32_MAX)
        return -1;
    if (!vocc_grow(allocator, &windings, &regions->winding_capacity,
                   regions->winding_count, regions->winding_count + count,
                   sizeof *regions->windings))
        return -1;
    regions->windings = windings;
    if (!vocc_grow(allocator, &start, &regions->start_capacity,
                   regions->count ? regions->count + 1 : 0, regions->count + 2,
                   sizeof *regions->start))
        return -1;
    regions->start = start;
    regions->start[regions->count] = regions->winding_count;
    if (count)
        memcpy(regions->windings + regions->winding_count, set,
               count * sizeof *set);
    regions->winding_count += count;
    regions->start[regions->count + 1] = regions->winding_count;
    regions->table[slot] = (int32_t)regions->count;
    return (int32_t)regions->count++;
}

/* ---- seed rays ------------------------------------------------------------
 */

void vocc_seed_free(const vocc_allocator *allocator, vocc_seed *seed)
{
    vocc_release(allocator, seed->hits);
    vocc_release(allocator, seed->set);
    memset(seed, 0, sizeof *seed);
}

typedef struct shot {
    const vocc_allocator *allocator;
    const vocc_tree *tree;
    const vocc_solids *solids;
    vocc_seed *seed;
    float org[3], dir[3];
} shot;

enum { GRAZED = 1, ON_SURFACE, NO_MEMORY };

static int collect(void *context, uint32_t triangle, double *tmax)
{
    shot *s = context;
    vocc_crossing crossing;
    void *hits = s->seed->hits;
    (void)tmax;
    if (s->solids->of_triangle[triangle] < 0)
        return 0;
    /* From -1, so that a crossing at the point itself (t = 0) is seen. */
    if (!vocc_triangle_test(s->org, s->dir, -1.0f, INFINITY,
                            s->tree->corners + 9 * (size_t)triangle,
                            &crossing) ||
        crossing.t < 0.0)
        return 0;
    if (crossing.t == 0.0)
        return ON_SURFACE;
    if (crossing.on_edge)
        return GRAZED;
    if (!vocc_grow(s->allocator, &hits, &s->seed->hit_capacity,
                   s->seed->hit_count, s->seed->hit_count + 1,
                   sizeof *s->seed->hits))
        return NO_MEMORY;
    s->seed->hits = hits;
    s->seed->hits[s->seed->hit_count++] =
        (uint64_t)triangle << 1 | (crossing.det_sign > 0 ? 1u : 0u);
    return 0;
}

/* Adds one crossing to the set, which is kept in the order of solids: few. */
static int count_crossing(shot *s, int32_t solid, int32_t sign)
{
    vocc_seed *seed = s->seed;
    void *set = seed->set;
    size_t i = seed->set_count;
    while (i > 0 && seed->set[i - 1].solid > solid)
        i--;
    if (i > 0 && seed->set[i - 1].solid == solid) {
        seed->set[i - 1].number += sign;
        return 1;
    }
    if (!vocc_grow(s->allocator, &set, &seed->set_capacity, seed->set_count,
                   seed->set_count + 1, sizeof *seed->set))
        return 0;
    seed->set = set;
    memmove(seed->set + i + 1, seed->set + i,
            (seed->set_count - i) * sizeof *seed->set);
    seed->set[i].solid = solid;
    seed->set[i].number = sign;
    seed->set_count++;
    return 1;
}

static int sum_up(shot *s)
{
    vocc_seed *seed = s->seed;
    size_t i, kept = 0;
    vocc_sort(seed->hits, seed->hit_count);
    for (i = 0; i < seed->hit_count; i++) {
        const uint64_t h = seed->hits[i];
        /* Leaves mention a triangle more than once. */
        if (i > 0 && h == seed->hits[i - 1])
            continue;
        if (!count_crossing(s, s->solids->of_triangle[h >> 1], h & 1 ? 1 : -1))
            return 0;
    }
    for (i = 0; i < seed->set_count; i++) {
        vocc_winding w = seed->set[i];
        if (!s->solids->consistent[w.solid])
            w.number &= 1;
        if (w.number)
            seed->set[kept++] = w;
    }
    seed->set_count = kept;
    return 1;
}

/* Directions in no particular relation to any mesh: 23 random bits a
 * component. */
static void random_direction(uint32_t stream, uint32_t attempt, float dir[3])
{
    uint32_t x = stream * 0x9E3779B9u + attempt * 0x85EBCA6Bu + 0x6A09E667u;
    int k;
    for (k = 0; k < 3; k++) {
        x ^= x >> 16;
        x *= 0x7FEB352Du;
        x ^= x >> 15;
        x *= 0x846CA68Bu;
        x ^= x >> 16;
        dir[k] = (float)(int32_t)((x >> 8) | 1u) - 8388608.0f;
    }
}

vocc_seed_result vocc_seed_shoot(const vocc_allocator *allocator,
                                 const vocc_tree *tree,
                                 const vocc_solids *solids,
                                 const float point[3], uint32_t stream,
                                 vocc_seed *seed)
{
    shot s;
    uint32_t attempt;
    s.allocator = allocator;
    s.tree = tree;
    s.solids = solids;
    s.seed = seed;
    memcpy(s.org, point, sizeof s.org);
    for (attempt = 0; attempt < 256; attempt++) {
        int result;
        seed->hit_count = 0;
        seed->set_count = 0;
        seed->rays++;
        random_direction(stream, attempt, s.dir);
        result =
            vocc_walk(tree, s.org, s.dir, 0.0, (double)INFINITY, collect, &s);
        if (result == ON_SURFACE)
            return VOCC_SEED_ON_SURFACE;
        if (result == NO_MEMORY)
            return VOCC_SEED_NO_MEMORY;
        if (result == GRAZED)
            continue;
        return sum_up(&s) ? VOCC_SEED_OK : VOCC_SEED_NO_MEMORY;
    }
    return VOCC_SEED_NO_DIRECTION;
}
