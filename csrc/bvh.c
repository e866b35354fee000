#include "bvh.h"
#include "frame.h"
#include "memory.h"
#include "vec3.h"

#include <math.h>
#include <string.h>

#define VOCC_LANES 4
#if VOCC_HAVE_SSE2
#include "simd_sse2.h"
#elif VOCC_HAVE_NEON
#include "simd_neon.h"
#else
#include "simd_plain.h"
#endif

/* Binned surface area heuristic (Wald, "On fast Construction of SAH-based
 * Bounding Volume Hierarchies", 2007), in units of whole clusters. */
enum { BINS = 16, MAX_DEPTH = 48, JOB_ITEMS = 16384 };

typedef struct box {
    float lower[3], upper[3];
} box;

typedef struct item {
    box bounds;
    float zero; /* so that the upper bounds are a vector */
    uint32_t triangle;
} item;

/* A node of two children, before they are gathered to wide ones. */
typedef struct pair {
    box bounds, normals;
    uint32_t child[2]; /* pairs; or a cluster and UINT32_MAX */
} pair;

/* Items below a pair.  Whole clusters are cut off in front, so that the first
 * item tells a cluster's number; and above n clusters are 2 n - 1 pairs. */
typedef struct subtree {
    size_t first, count;
    uint32_t number; /* of the pair */
    int depth;
} subtree;

typedef struct builder {
    const vocc_tree *tree;
    const vocc_solids *solids;
    item *items;
    pair *pairs;
    /* Pairs with more than JOB_ITEMS, those of each wave after their parents,
     * then the subtrees below them. */
    subtree *open, *jobs;
    size_t open_first, open_count, job_count;
    vocc_bvh *bvh;
} builder;

static void box_none(box *b)
{
    int k;
    for (k = 0; k < 3; k++) {
        b->lower[k] = FLT_MAX;
        b->upper[k] = -FLT_MAX;
    }
}

static void box_add(box *b, const box *other)
{
    int k;
    for (k = 0; k < 3; k++) {
        b->lower[k] =
            other->lower[k] < b->lower[k] ? other->lower[k] : b->lower[k];
        b->upper[k] =
            other->upper[k] > b->upper[k] ? other->upper[k] : b->upper[k];
    }
}

static void box_add_point(box *b, const float p[3])
{
    int k;
    for (k = 0; k < 3; k++) {
        b->lower[k] = p[k] < b->lower[k] ? p[k] : b->lower[k];
        b->upper[k] = p[k] > b->upper[k] ? p[k] : b->upper[k];
    }
}

static double box_area(const box *b)
{
    const double x = (double)b->upper[0] - (double)b->lower[0],
                 y = (double)b->upper[1] - (double)b->lower[1],
                 z = (double)b->upper[2] - (double)b->lower[2];
    return x * y + y * z + z * x;
}

/* Twice the centre, as the sum of floats that cannot overflow. */
static float middle(const item *i, int axis)
{
    return 0.5f * i->bounds.lower[axis] + 0.5f * i->bounds.upper[axis];
}

/* ---- splitting --------------------------------------------------------------
 */

typedef struct bin {
    float lower[4], upper[4]; /* x, y, z, any; any, x, y, z */
    size_t count;
} bin;

static double clusters_of(size_t count)
{
    return (double)((count + VOCC_WIDE - 1) / VOCC_WIDE);
}

static void bin_none(bin *b)
{
    vstore(b->lower, vset(FLT_MAX));
    vstore(b->upper, vset(-FLT_MAX));
    b->count = 0;
}

VOCC_INLINE void bin_add(bin *b, vfloat lower, vfloat upper, size_t count)
{
    vstore(b->lower, vmin(vload(b->lower), lower));
    vstore(b->upper, vmax(vload(b->upper), upper));
    b->count += count;
}

static double bin_area(const bin *b)
{
    const double x = (double)b->upper[1] - (double)b->lower[0],
                 y = (double)b->upper[2] - (double)b->lower[1],
                 z = (double)b->upper[3] - (double)b->lower[2];
    return x * y + y * z + z * x;
}

/* x, y and z of the lower bounds, x, y and z of the upper ones. */
VOCC_INLINE vfloat lower_of(const item *i)
{
    return vload(i->bounds.lower);
}

VOCC_INLINE vfloat upper_of(const item *i)
{
    return vload(i->bounds.lower + 2);
}

/* middle() of x, y and z. */
VOCC_INLINE vfloat middles(const item *i)
{
    const vfloat half = vset(0.5f);
    return vadd(vmul(half, vload(i->bounds.lower)),
                vmul(half, vload(i->bounds.upper)));
}

/* The bin of each item along each axis. */
static void fill_bins(const item *items, size_t count, const box *centres,
                      bin bins[3][BINS])
{
    const vfloat zero = vset(0.0f), end = vset((float)(BINS - 1));
    float low[4] = {0}, scale[4] = {0};
    size_t i;
    int axis, b;
    for (axis = 0; axis < 3; axis++) {
        const float size = centres->upper[axis] - centres->lower[axis];
        low[axis] = centres->lower[axis];
        if (size > FLT_MIN)
            scale[axis] = (float)BINS * (1.0f - 0x1p-20f) / size;
        for (b = 0; b < BINS; b++)
            bin_none(&bins[axis][b]);
    }
    for (i = 0; i < count; i++) {
        const vfloat lower = lower_of(&items[i]), upper = upper_of(&items[i]);
        uint32_t at[4];
        vstore_whole(at, vmin(vmax(vmul(vsub(middles(&items[i]), vload(low)),
                                        vload(scale)),
                                   zero),
                              end));
        for (axis = 0; axis < 3; axis++)
            bin_add(&bins[axis][at[axis]], lower, upper, 1);
    }
}

/* The best of BINS - 1 planes: its cost, and how many items are below it. */
static double best_plane(const bin bins[BINS], size_t count, size_t *below)
{
    double upper[BINS], best = (double)INFINITY;
    bin sum;
    int b;
    bin_none(&sum);
    for (b = BINS - 1; b > 0; b--) {
        bin_add(&sum, vload(bins[b].lower), vload(bins[b].upper),
                bins[b].count);
        upper[b] = bin_area(&sum);
    }
    bin_none(&sum);
    for (b = 0; b + 1 < BINS; b++) {
        double cost;
        bin_add(&sum, vload(bins[b].lower), vload(bins[b].upper),
                bins[b].count);
        if (sum.count == 0 || sum.count == count)
            continue;
        cost = bin_area(&sum) * clusters_of(sum.count) +
               upper[b + 1] * clusters_of(count - sum.count);
        if (cost < best) {
            best = cost;
            *below = sum.count;
        }
    }
    return best;
}

static void swap_items(item *a, item *b)
{
    const item t = *a;
    *a = *b;
    *b = t;
}

/* The `wanted` items with the smallest centres to the front: Hoare's
 * quickselect; the pivot is the middle of three. */
static void select_items(item *items, size_t count, size_t wanted, int axis)
{
    size_t from = 0, to = count;
    while (to - from > 1) {
        const float x = middle(&items[from], axis),
                    y = middle(&items[from + (to - from) / 2], axis),
                    z = middle(&items[to - 1], axis);
        const float pivot = x < y ? (y < z   ? y
                                     : x < z ? z
                                             : x)
                                  : (x < z   ? x
                                     : y < z ? z
                                             : y);
        size_t i = from, j = to - 1;
        for (;;) {
            while (middle(&items[i], axis) < pivot)
                i++;
            while (middle(&items[j], axis) > pivot)
                j--;
            if (i >= j)
                break;
            swap_items(&items[i++], &items[j--]);
        }
        /* from .. j are at most the pivot, i .. to - 1 at least. */
        j = i == j ? j + 1 : i;
        if (wanted < j) {
            if (j == to)
                j = to - 1;
            to = j;
        } else if (wanted > j) {
            from = j;
        } else {
            return;
        }
    }
}

/* Reorders the items; returns how many go to the first child: whole clusters,
 * so that one of all clusters is less than full. */
static size_t split(item *items, size_t count, int depth)
{
    box centres;
    size_t i, below = count / 2, units;
    double best = (double)INFINITY;
    int axis = 0, k;
    vfloat low = vset(FLT_MAX), high = vset(-FLT_MAX);
    float ends[2][4];
    for (i = 0; i < count; i++) {
        const vfloat c = middles(&items[i]);
        low = vmin(low, c);
        high = vmax(high, c);
    }
    vstore(ends[0], low);
    vstore(ends[1], high);
    memcpy(centres.lower, ends[0], sizeof centres.lower);
    memcpy(centres.upper, ends[1], sizeof centres.upper);
    for (k = 1; k < 3; k++)
        if (centres.upper[k] - centres.lower[k] >
            centres.upper[axis] - centres.lower[axis])
            axis = k;
    if (depth < MAX_DEPTH) {
        bin bins[3][BINS];
        fill_bins(items, count, &centres, bins);
        for (k = 0; k < 3; k++) {
            size_t n = 0;
            double cost;
            if (!(centres.upper[k] - centres.lower[k] > FLT_MIN))
                continue;
            cost = best_plane(bins[k], count, &n);
            if (cost < best) {
                best = cost;
                below = n;
                axis = k;
            }
        }
    }
    /* Whole clusters on one side. */
    units = (below + VOCC_WIDE / 2) / VOCC_WIDE;
    if (units < 1)
        units = 1;
    if (units * VOCC_WIDE >= count)
        units = (count - 1) / VOCC_WIDE;
    below = units * VOCC_WIDE;
    select_items(items, count, below, axis);
    return below;
}

/* ---- clusters and normals ---------------------------------------------------
 */

static int is_both_sided(const builder *b, uint32_t triangle)
{
    const int32_t solid = b->solids->of_triangle[triangle];
    return solid < 0 || !b->solids->consistent[solid];
}

/* Bounds of the unit normal; 0 if double is not enough for one. */
static int unit_normal(const float *c, box *normal)
{
    double e1[3], e2[3], n[3], length, products = 0.0;
    int k;
    for (k = 0; k < 3; k++) {
        e1[k] = (double)c[3 + k] - (double)c[k];
        e2[k] = (double)c[6 + k] - (double)c[k];
    }
    vocc_cross(e1, e2, n);
    for (k = 0; k < 3; k++) {
        const int i = (k + 1) % 3, j = (k + 2) % 3;
        products += vocc_abs(e1[i] * e2[j]) + vocc_abs(e1[j] * e2[i]);
    }
    length = sqrt(vocc_dot(n, n));
    if (!(length > 0x1p-500) || !(products <= 0x1p20 * length))
        return 0;
    for (k = 0; k < 3; k++) {
        normal->lower[k] = (float)(n[k] / length - 0x1p-22);
        normal->upper[k] = (float)(n[k] / length + 0x1p-22);
    }
    return 1;
}

/* The planes across the mean normal that a cluster lies between. */
static void set_slab(vocc_cluster *c)
{
    double sum[3] = {0.0, 0.0, 0.0}, lower = 0.0, upper = 0.0;
    uint32_t i;
    int k, corner;
    for (i = 0; i < c->count; i++) {
        double u[3], v[3], n[3];
        for (k = 0; k < 3; k++) {
            u[k] = (double)c->corner[3 + k][i] - (double)c->corner[k][i];
            v[k] = (double)c->corner[6 + k][i] - (double)c->corner[k][i];
        }
        vocc_cross(u, v, n);
        for (k = 0; k < 3; k++)
            sum[k] += n[k];
    }
    if (!vocc_normalize(sum, sum))
        sum[0] = sum[1] = sum[2] = 0.0;
    for (k = 0; k < 3; k++)
        c->normal[k] = (float)sum[k];
    for (i = 0; i < c->count; i++)
        for (corner = 0; corner < 3; corner++) {
            double at = 0.0, size = 0.0;
            for (k = 0; k < 3; k++) {
                const double x =
                    (double)c->normal[k] * (double)c->corner[3 * corner + k][i];
                at += x;
                size += vocc_abs(x);
            }
            size *= 0x1p-50;
            if ((i == 0 && corner == 0) || at - size < lower)
                lower = at - size;
            if ((i == 0 && corner == 0) || at + size > upper)
                upper = at + size;
        }
    c->slab[0] = (float)(lower - vocc_abs(lower) * 0x1p-23);
    c->slab[1] = (float)(upper + vocc_abs(upper) * 0x1p-23);
}

static float larger(float a, float b)
{
    return a > b ? a : b;
}

static float extent(float a, float b, float c)
{
    const float low = a < b ? a : b, high = larger(a, b);
    return larger(high, c) - (low < c ? low : c);
}

static void make_cluster(const builder *b, const item *items, size_t count,
                         uint32_t number, box *normals)
{
    vocc_cluster *cluster = &b->bvh->clusters[number];
    size_t i;
    int k;
    cluster->count = (uint32_t)count;
    cluster->both_sides = 0;
    cluster->longest = 0.0f;
    box_none(normals);
    for (i = 0; i < VOCC_WIDE; i++) {
        const uint32_t triangle = items[i < count ? i : 0].triangle;
        const float *c = b->tree->corners + 9 * (size_t)triangle;
        cluster->triangle[i] = triangle;
        for (k = 0; k < 9; k++)
            cluster->corner[k][i] = c[k];
        for (k = 0; k < 3; k++)
            cluster->longest =
                larger(cluster->longest, extent(c[k], c[3 + k], c[6 + k]));
        if (i < count) {
            const int both = is_both_sided(b, triangle);
            box normal;
            if (both)
                cluster->both_sides |= 1u << i;
            if (both || !unit_normal(c, &normal))
                for (k = 0; k < 3; k++) {
                    normal.lower[k] = -2.0f;
                    normal.upper[k] = 2.0f;
                }
            box_add(normals, &normal);
        }
    }
    set_slab(cluster);
}

static subtree first_child(subtree t, size_t below)
{
    t.count = below;
    t.number++;
    t.depth++;
    return t;
}

static subtree second_child(subtree t, size_t below)
{
    t.first += below;
    t.count -= below;
    t.number += 2 * (uint32_t)(below / VOCC_WIDE);
    t.depth++;
    return t;
}

static void add_children(const builder *b, pair *p)
{
    p->bounds = b->pairs[p->child[0]].bounds;
    p->normals = b->pairs[p->child[0]].normals;
    box_add(&p->bounds, &b->pairs[p->child[1]].bounds);
    box_add(&p->normals, &b->pairs[p->child[1]].normals);
}

static void build_cluster(const builder *b, subtree t)
{
    pair *p = &b->pairs[t.number];
    size_t i;
    box_none(&p->bounds);
    for (i = 0; i < t.count; i++)
        box_add(&p->bounds, &b->items[t.first + i].bounds);
    p->child[0] = (uint32_t)(t.first / VOCC_WIDE);
    p->child[1] = UINT32_MAX;
    make_cluster(b, b->items + t.first, t.count, p->child[0], &p->normals);
}

/* Splits; returns how many items go to the first child. */
static size_t divide(const builder *b, subtree t)
{
    pair *p = &b->pairs[t.number];
    const size_t below = split(b->items + t.first, t.count, t.depth);
    p->child[0] = first_child(t, below).number;
    p->child[1] = second_child(t, below).number;
    return below;
}

static void build_pair(const builder *b, subtree t)
{
    size_t below;
    if (t.count <= VOCC_WIDE) {
        build_cluster(b, t);
        return;
    }
    below = divide(b, t);
    build_pair(b, first_child(t, below));
    build_pair(b, second_child(t, below));
    add_children(b, &b->pairs[t.number]);
}

static vocc_status build_job(void *context, size_t job, int worker,
                             vocc_jobs *jobs)
{
    const builder *b = context;
    (void)worker;
    (void)jobs;
    build_pair(b, b->jobs[job]);
    return VOCC_OK;
}

static vocc_status divide_job(void *context, size_t job, int worker,
                              vocc_jobs *jobs)
{
    const builder *b = context;
    (void)worker;
    (void)jobs;
    (void)divide(b, b->open[b->open_first + job]);
    return VOCC_OK;
}

/* To be divided in the next wave, or left to one job. */
static void leave(builder *b, subtree t)
{
    if (t.count > JOB_ITEMS)
        b->open[b->open_count++] = t;
    else
        b->jobs[b->job_count++] = t;
}

/* The top in waves, whose pairs are divided side by side. */
static vocc_status build_pairs(builder *b, size_t count,
                               const vocc_allocator *allocator, int threads,
                               vocc_ticker *ticker)
{
    subtree all;
    vocc_status status = VOCC_OK;
    all.first = 0;
    all.count = count;
    all.number = 0;
    all.depth = 0;
    leave(b, all);
    while (status == VOCC_OK && b->open_first < b->open_count) {
        const size_t end = b->open_count;
        status = vocc_jobs_run(allocator, threads, end - b->open_first,
                               divide_job, b, ticker);
        for (; status == VOCC_OK && b->open_first < end; b->open_first++) {
            const subtree t = b->open[b->open_first];
            const size_t below =
                VOCC_WIDE * (size_t)(b->pairs[t.number].child[1] - t.number) /
                2;
            leave(b, first_child(t, below));
            leave(b, second_child(t, below));
        }
    }
    if (status == VOCC_OK)
        status = vocc_jobs_run(allocator, threads, b->job_count, build_job, b,
                               ticker);
    /* Parents stand before their children. */
    while (status == VOCC_OK && b->open_count)
        add_children(b, &b->pairs[b->open[--b->open_count].number]);
    return status;
}

/* ---- wide nodes -------------------------------------------------------------
 */

static int is_cluster(const pair *p)
{
    return p->child[1] == UINT32_MAX;
}

/* Opens the largest child until there are VOCC_WIDE; neighbours stay next to
 * each other. */
static int gather(const builder *b, uint32_t top, uint32_t child[VOCC_WIDE])
{
    int count = 1, i;
    child[0] = top;
    while (count < VOCC_WIDE) {
        int largest = -1;
        double area = -1.0;
        for (i = 0; i < count; i++) {
            const pair *p = &b->pairs[child[i]];
            if (!is_cluster(p) && box_area(&p->bounds) > area) {
                area = box_area(&p->bounds);
                largest = i;
            }
        }
        if (largest < 0)
            break;
        for (i = count++; i > largest + 1; i--)
            child[i] = child[i - 1];
        child[largest + 1] = b->pairs[child[largest]].child[1];
        child[largest] = b->pairs[child[largest]].child[0];
    }
    return count;
}

static uint32_t make_wide(builder *b, uint32_t top)
{
    const uint32_t number = (uint32_t)b->bvh->node_count++;
    vocc_wide_node *node = &b->bvh->nodes[number];
    uint32_t child[VOCC_WIDE];
    const int count = gather(b, top, child);
    int i, k;
    node->count = (uint32_t)count;
    node->clusters = 0;
    for (i = 0; i < VOCC_WIDE; i++) {
        const pair *p = &b->pairs[child[i < count ? i : 0]];
        for (k = 0; k < 3; k++) {
            node->lower[k][i] = p->bounds.lower[k];
            node->upper[k][i] = p->bounds.upper[k];
            node->normal_lower[k][i] = p->normals.lower[k];
            node->normal_upper[k][i] = p->normals.upper[k];
        }
        if (i >= count) {
            node->child[i] = UINT32_MAX;
        } else if (is_cluster(p)) {
            node->child[i] = VOCC_IS_CLUSTER | p->child[0];
            node->clusters |= 1u << i;
        } else {
            node->child[i] = make_wide(b, child[i]);
        }
    }
    return number;
}

/* ---- the whole --------------------------------------------------------------
 */

static size_t load_items(const vocc_tree *tree, item *items)
{
    size_t i, count = 0;
    for (i = 0; i < tree->triangle_count; i++) {
        const float *c = tree->corners + 9 * i;
        if (vocc_equal(c, c + 3) || vocc_equal(c + 3, c + 6) ||
            vocc_equal(c + 6, c))
            continue;
        items[count].triangle = (uint32_t)i;
        items[count].zero = 0.0f;
        box_none(&items[count].bounds);
        box_add_point(&items[count].bounds, c);
        box_add_point(&items[count].bounds, c + 3);
        box_add_point(&items[count].bounds, c + 6);
        count++;
    }
    return count;
}

/* Gives back what was reserved for more nodes. */
static int fit_nodes(const vocc_allocator *allocator, vocc_bvh *bvh)
{
    vocc_wide_node *const nodes =
        vocc_allocate_lines(allocator, bvh->node_count, sizeof *nodes);
    if (!nodes)
        return 0;
    memcpy(nodes, bvh->nodes, bvh->node_count * sizeof *nodes);
    vocc_release_lines(allocator, bvh->nodes);
    bvh->nodes = nodes;
    return 1;
}

static vocc_status build_tree(builder *b, size_t count,
                              const vocc_allocator *allocator, int threads,
                              vocc_ticker *ticker)
{
    const size_t clusters = count / VOCC_WIDE + (count % VOCC_WIDE != 0);
    vocc_bvh *bvh = b->bvh;
    vocc_status status;
    b->pairs = vocc_allocate(allocator, 2 * clusters, sizeof *b->pairs);
    b->open = vocc_allocate(allocator, clusters, sizeof *b->open);
    b->jobs = vocc_allocate(allocator, clusters, sizeof *b->jobs);
    bvh->clusters =
        vocc_allocate_lines(allocator, clusters, sizeof *bvh->clusters);
    bvh->nodes = vocc_allocate_lines(allocator, clusters, sizeof *bvh->nodes);
    if (!b->pairs || !b->open || !b->jobs || !bvh->clusters || !bvh->nodes)
        return VOCC_ERROR_OUT_OF_MEMORY;
    bvh->cluster_count = clusters;
    status = build_pairs(b, count, allocator, threads, ticker);
    if (status != VOCC_OK)
        return status;
    (void)make_wide(b, 0);
    return fit_nodes(allocator, bvh) ? VOCC_OK : VOCC_ERROR_OUT_OF_MEMORY;
}

vocc_status vocc_bvh_build(const vocc_allocator *allocator,
                           const vocc_tree *tree, const vocc_solids *solids,
                           int threads, vocc_ticker *ticker, vocc_bvh *bvh)
{
    builder b;
    size_t count;
    vocc_status status = VOCC_ERROR_OUT_OF_MEMORY;
    memset(bvh, 0, sizeof *bvh);
    memset(&b, 0, sizeof b);
    b.tree = tree;
    b.solids = solids;
    b.bvh = bvh;
    b.items = vocc_allocate(allocator, tree->triangle_count, sizeof *b.items);
    if (b.items) {
        count = load_items(tree, b.items);
        status =
            count ? build_tree(&b, count, allocator, threads, ticker) : VOCC_OK;
    }
    vocc_release(allocator, b.jobs);
    vocc_release(allocator, b.open);
    vocc_release(allocator, b.pairs);
    vocc_release(allocator, b.items);
    if (status != VOCC_OK)
        vocc_bvh_free(allocator, bvh);
    return status;
}

void vocc_bvh_free(const vocc_allocator *allocator, vocc_bvh *bvh)
{
    vocc_release_lines(allocator, bvh->nodes);
    vocc_release_lines(allocator, bvh->clusters);
    vocc_free_boxes(allocator, &bvh->boxes);
    memset(bvh, 0, sizeof *bvh);
}
