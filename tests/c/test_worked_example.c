/* Guards the slides' two worked examples, "Traversal Mod 2: QDBFS" and "Quick
 * descent": how many nodes breadth-first search and its quick descent visit,
 * push and pop, by the counters of the real kernels.
 *
 * The slides' trees are drawings, so these are others with the same counts.
 * The root is not queued, and a visited node is one that is loaded: an interior
 * node or a boundary leaf.  Hence breadth-first search visits one node more
 * than it pops, as on the slides.  The last node visited has the occluder for a
 * child: the tag is in the parent, so the occluder itself is neither loaded nor
 * queued. */
#include "../../csrc/memory.h"
#include "../../csrc/traverse.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "test.h"

typedef struct counts {
    uint64_t visited, pushes, pops;
} counts;

/* A tree in preorder, each node by what the ray meets of it:
 *   T  both children, the first one nearer
 *   O  only one, which follows; the other is a boundary leaf
 *   L  a boundary leaf
 *   X  both; the nearer is the occluder, the other a boundary leaf */
typedef struct example {
    const char *slide, *tree;
    counts bfs, qdbfs;
} example;

static const example examples[] = {
    {"Traversal Mod 2: QDBFS", "TTOOOTLLOXTOLL", {9, 10, 8}, {9, 8, 4}},
    {"Quick descent", "OTTOXOLOTLL", {8, 10, 7}, {7, 6, 3}},
};

/* ---- trees -----------------------------------------------------------------
 */

enum { MOST_NODES = 64 };

typedef struct drawing {
    const char *letters; /* not drawn yet */
    vocc_node nodes[MOST_NODES];
    vocc_opaque occluder;
    vocc_tree tree;
} drawing;

static vocc_node leaf_of(unsigned label)
{
    vocc_node n;
    n.at.first = 0;
    n.bits = VOCC_LEAF | label << 2;
    return n;
}

/* The ray runs along x through the whole box, at a height y of 8 to 9: planes
 * across x are met in the middle of what is left of the ray, planes across y
 * are above it. */
static void draw(drawing *d, uint32_t index, vocc_opaque box)
{
    const char letter = *d->letters++;
    const unsigned axis = letter == 'O' ? 1 : 0;
    const uint32_t first = (uint32_t)d->tree.node_count;
    const float split = letter == 'O' ? 0.5f * (9.0f + box.upper[1])
                                      : 0.5f * (box.lower[0] + box.upper[0]);
    vocc_opaque below = box, above = box;
    if (letter == 'L') {
        d->nodes[index] = leaf_of(VOCC_BOUNDARY);
        return;
    }
    d->tree.node_count += 2;
    REQUIRE(d->tree.node_count <= MOST_NODES);
    d->nodes[index].at.split_pos = split;
    d->nodes[index].bits = axis | first / 2 << VOCC_PAIR_SHIFT;
    below.upper[axis] = above.lower[axis] = split;
    if (letter == 'X') {
        d->nodes[index].bits |= VOCC_TAGGED | VOCC_OPAQUE << VOCC_TAG_SHIFT;
        d->nodes[first] = leaf_of(VOCC_OPAQUE);
        d->nodes[first + 1] = leaf_of(VOCC_BOUNDARY);
        d->occluder = below;
        return;
    }
    REQUIRE(letter == 'T' || letter == 'O');
    draw(d, first, below);
    if (letter == 'T')
        draw(d, first + 1, above);
    else
        d->nodes[first + 1] = leaf_of(VOCC_BOUNDARY);
}

static void make_tree(drawing *d, const char *letters)
{
    static const vocc_opaque box = {
        {0.0f, 0.0f, 0.0f}, {16.0f, 16.0f, 16.0f}, 1, -1};
    memset(d, 0, sizeof *d);
    d->letters = letters;
    d->tree.nodes = d->nodes;
    d->tree.node_count = 2;
    d->tree.opaque = &d->occluder;
    d->tree.opaque_count = 1;
    d->tree.scale = 16.0f;
    memcpy(d->tree.lower, box.lower, sizeof box.lower);
    memcpy(d->tree.upper, box.upper, sizeof box.upper);
    draw(d, 0, box);
    CHECK(*d->letters == '\0');
}

/* ---- counting ---------------------------------------------------------------
 */

static void trace(const vocc_tree *tree, const vocc_query_options *options,
                  size_t rays, const counts *expected)
{
    static const float org[3] = {-16.0f, 7.0f, 7.0f},
                       dir[3] = {1.0f, 0.0625f, 0.03125f};
    const vocc_allocator allocator = vocc_default_allocator();
    const vocc_kernels *kernels = vocc_find_kernels(options);
    if (!kernels)
        return;
    vocc_tracer *tracer =
        vocc_tracer_create(&allocator, tree, options, kernels);
    vocc_block *block = malloc(sizeof *block);
    REQUIRE(tracer && block);
    block->count = rays;
    for (size_t i = 0; i < rays; i++) {
        for (int k = 0; k < 3; k++) {
            block->org[k][i] = org[k];
            block->dir[k][i] = dir[k];
        }
        block->tmin[i] = 0.0f;
        block->tmax[i] = INFINITY;
        block->end_region[i] = 0;
    }
    kernels->occluded(tracer, block);
    const vocc_counters *c = &tracer->counters;
    CHECK_INT(c->packets, options->packets ? (rays + 3) / 4 : rays);
    CHECK_INT(c->node_visits + c->leaf_visits, c->packets * expected->visited);
    CHECK_INT(c->queue_pushes, c->packets * expected->pushes);
    CHECK_INT(c->queue_pops, c->packets * expected->pops);
    /* All are blocked by the occluder, before any triangle is looked at. */
    CHECK_INT(c->occluder_hits_tree, rays);
    CHECK_INT(c->triangle_tests, 0);
    for (size_t i = 0; i < rays; i++)
        CHECK_INT(block->occluded[i], 1);
    test_compared(3);
    vocc_tracer_free(&allocator, tracer);
    free(block);
}

static void the_slides_counts(void)
{
    for (size_t e = 0; e < sizeof examples / sizeof *examples; e++) {
        drawing d;
        test_context(examples[e].slide);
        make_tree(&d, examples[e].tree);
        for (int kernel = 0; kernel < 3; kernel++) {
            for (size_t rays = 1; rays <= 5; rays += 2) {
                vocc_counters counters;
                vocc_query_options options;
                vocc_query_options_init(&options);
                options.counters = &counters;
                options.cache = 0;
                options.packets = kernel > 0;
                options.isa = kernel == 1 ? VOCC_ISA_SCALAR : VOCC_ISA_AUTO;
                options.order = VOCC_ORDER_BFS;
                trace(&d.tree, &options, rays, &examples[e].bfs);
                options.order = VOCC_ORDER_QDBFS;
                trace(&d.tree, &options, rays, &examples[e].qdbfs);
            }
        }
    }
    test_context(NULL);
}

const test_case test_worked_example_cases[] = {
    {"worked_example.the_slides_counts", the_slides_counts},
    {NULL, NULL},
};
