#include "box_tree.h"
#include "sort.h"

#include <float.h>
#include <string.h>

enum { PARTS = VOCC_BOX_LANES - VOCC_BOX_OWN };

/* Occluders that a node has to hold: keys[first ...], the largest first. */
typedef struct share {
    size_t first, count;
} share;

typedef struct builder {
    const vocc_opaque *all;
    uint64_t *keys; /* numbers of occluders in the lower half */
    share *shares;  /* by node */
    vocc_box_node *nodes;
    size_t node_count;
} builder;

static const vocc_opaque *box_of(const builder *b, uint64_t key)
{
    return &b->all[key & 0xFFFFFFFFu];
}

static int is_within(const vocc_opaque *a, const vocc_opaque *b)
{
    int k;
    for (k = 0; k < 3; k++)
        if (a->lower[k] < b->lower[k] || a->upper[k] > b->upper[k])
            return 0;
    return a->region == b->region;
}

/* Positive floats sort like their bits. */
static uint64_t bits_of(float x)
{
    uint32_t bits;
    memcpy(&bits, &x, sizeof bits);
    return bits;
}

/* The larger the area, the lower the key. */
static uint64_t size_key(const vocc_opaque *o, size_t number)
{
    const double x = (double)o->upper[0] - (double)o->lower[0],
                 y = (double)o->upper[1] - (double)o->lower[1],
                 z = (double)o->upper[2] - (double)o->lower[2],
                 area = x * y + y * z + z * x;
    const float rounded = area < (double)FLT_MAX ? (float)area : FLT_MAX;
    return (0x7FFFFFFFu - bits_of(rounded)) << 32 | (uint64_t)number;
}

static double middle_of(const vocc_opaque *o, int axis)
{
    return 0.5 * ((double)o->lower[axis] + (double)o->upper[axis]);
}

/* Sorts by place along the axis that the middles are widest along. */
static void sort_by_place(const builder *b, uint64_t *keys, size_t count)
{
    double low[3], high[3];
    size_t i;
    int k, axis = 0;
    for (k = 0; k < 3; k++) {
        low[k] = high[k] = middle_of(box_of(b, keys[0]), k);
        for (i = 1; i < count; i++) {
            const double x = middle_of(box_of(b, keys[i]), k);
            low[k] = x < low[k] ? x : low[k];
            high[k] = x > high[k] ? x : high[k];
        }
        if (high[k] - low[k] > high[axis] - low[axis])
            axis = k;
    }
    for (i = 0; i < count; i++) {
        const double size = high[axis] - low[axis],
                     x = middle_of(box_of(b, keys[i]), axis) - low[axis];
        keys[i] = (uint64_t)(size > 0.0 ? x / size * 0x1p31 : 0.0) << 32 |
                  (keys[i] & 0xFFFFFFFFu);
    }
    vocc_sort(keys, count);
}

/* Splits a share into parts that are near each other. */
static void split_share(const builder *b, share all, int parts, share *out)
{
    uint64_t *const keys = b->keys + all.first;
    const int half = parts / 2;
    share low = all, high = all;
    size_t i;
    if (parts == 1) {
        for (i = 0; i < all.count; i++) {
            const size_t number = (size_t)(keys[i] & 0xFFFFFFFFu);
            keys[i] = size_key(&b->all[number], number);
        }
        vocc_sort(keys, all.count);
        *out = all;
        return;
    }
    sort_by_place(b, keys, all.count);
    low.count = all.count * (size_t)half / (size_t)parts;
    high.first += low.count;
    high.count -= low.count;
    split_share(b, low, half, out);
    split_share(b, high, parts - half, out + half);
}

static void put_box(vocc_box_node *node, int lane, const vocc_opaque *o)
{
    int k;
    for (k = 0; k < 3; k++) {
        node->lower[k][lane] = o->lower[k];
        node->upper[k][lane] = o->upper[k];
    }
    node->region[lane] = o->region;
    node->boxes |= (uint16_t)(1u << lane);
}

/* A node's own occluders; the rest goes to new nodes. */
static void fill_node(builder *b, size_t number)
{
    vocc_box_node *const node = &b->nodes[number];
    const share all = b->shares[number];
    uint64_t *const keys = b->keys + all.first;
    share rest = all;
    const size_t most =
        all.count <= VOCC_BOX_LANES ? VOCC_BOX_LANES : VOCC_BOX_OWN;
    const vocc_opaque *own[VOCC_BOX_LANES];
    int lane, parts, count = 0;
    size_t i;
    memset(node, 0, sizeof *node);
    rest.count = 0;
    for (i = 0; i < all.count; i++) {
        const vocc_opaque *const o = box_of(b, keys[i]);
        for (lane = 0; lane < count; lane++)
            if (is_within(o, own[lane]))
                break;
        if (lane < count)
            continue;
        if (count < (int)most) {
            own[count] = o;
            put_box(node, count++, o);
        } else {
            keys[rest.count++] = keys[i];
        }
    }
    if (!rest.count)
        return;
    parts = rest.count < (size_t)PARTS * VOCC_BOX_LANES
                ? (int)((rest.count + VOCC_BOX_LANES - 1) / VOCC_BOX_LANES)
                : PARTS;
    split_share(b, rest, parts, b->shares + b->node_count);
    node->child = (uint32_t)b->node_count;
    node->nodes = (uint16_t)(((1u << parts) - 1u) << VOCC_BOX_OWN);
    b->node_count += (size_t)parts;
}

/* Bounds of what is below a node, in its parent's lanes; those below it have
 * theirs. */
static void set_bounds(builder *b, size_t number)
{
    vocc_box_node *const node = &b->nodes[number];
    int lane, i, k;
    for (lane = VOCC_BOX_OWN; node->nodes >> lane & 1; lane++) {
        const vocc_box_node *const below =
            &b->nodes[node->child + (uint32_t)(lane - VOCC_BOX_OWN)];
        const unsigned used = (unsigned)below->boxes | below->nodes;
        for (k = 0; k < 3; k++) {
            node->lower[k][lane] = FLT_MAX;
            node->upper[k][lane] = -FLT_MAX;
            for (i = 0; i < VOCC_BOX_LANES; i++) {
                if (!(used >> i & 1))
                    continue;
                if (below->lower[k][i] < node->lower[k][lane])
                    node->lower[k][lane] = below->lower[k][i];
                if (below->upper[k][i] > node->upper[k][lane])
                    node->upper[k][lane] = below->upper[k][i];
            }
        }
    }
}

vocc_status vocc_build_boxes(const vocc_allocator *allocator,
                             const vocc_tree *tree, vocc_box_tree *boxes)
{
    const size_t count = tree->grown_count;
    builder b;
    size_t i;
    memset(boxes, 0, sizeof *boxes);
    if (!count)
        return VOCC_OK;
    memset(&b, 0, sizeof b);
    b.all = tree->grown;
    b.keys = vocc_allocate(allocator, count, sizeof *b.keys);
    /* A node has an occluder of its own at least. */
    b.shares = vocc_allocate(allocator, count, sizeof *b.shares);
    b.nodes = vocc_allocate_lines(allocator, count, sizeof *b.nodes);
    if (b.keys && b.shares && b.nodes) {
        for (i = 0; i < count; i++)
            b.keys[i] = size_key(&tree->grown[i], i);
        vocc_sort(b.keys, count);
        b.shares[0].first = 0;
        b.shares[0].count = count;
        b.node_count = 1;
        for (i = 0; i < b.node_count; i++)
            fill_node(&b, i);
        for (i = b.node_count; i-- > 0;)
            set_bounds(&b, i);
        boxes->nodes =
            vocc_allocate_lines(allocator, b.node_count, sizeof *b.nodes);
    }
    if (boxes->nodes) {
        memcpy(boxes->nodes, b.nodes, b.node_count * sizeof *b.nodes);
        boxes->node_count = b.node_count;
    }
    vocc_release(allocator, b.keys);
    vocc_release(allocator, b.shares);
    vocc_release_lines(allocator, b.nodes);
    return boxes->nodes ? VOCC_OK : VOCC_ERROR_OUT_OF_MEMORY;
}

void vocc_free_boxes(const vocc_allocator *allocator, vocc_box_tree *boxes)
{
    vocc_release_lines(allocator, boxes->nodes);
    memset(boxes, 0, sizeof *boxes);
}
