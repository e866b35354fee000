/* Guards what build, classify and traverse agree on: the layout of a node, the
 * clipping that perfect splits rest on, and the flood fill against the
 * classification of the paper (one test ray a leaf, back face = inside). */
#include "../../csrc/clip.h"
#include "../../csrc/kdtree.h"
#include "../../csrc/scene.h"
#include "../../csrc/vocc.h"

#include "world.h"

#include <float.h>
#include <inttypes.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "test.h"

static void node_layout(void)
{
    vocc_node n;
    CHECK_INT(sizeof(vocc_node), 8);
    n.at.split_pos = 1.0f;
    n.bits =
        2u | VOCC_TAGGED | 9u << VOCC_TAG_SHIFT | 0x1ABCDEFu << VOCC_PAIR_SHIFT;
    CHECK(!vocc_is_leaf(n));
    CHECK_INT(vocc_axis(n), 2);
    CHECK_INT(vocc_children(n), 2 * 0x1ABCDEFu);
    CHECK_INT(vocc_tags(n), 9);
    n.at.first = 7;
    n.bits = VOCC_LEAF | (unsigned)VOCC_OPAQUE << 2 | 0xABCDEFu << 4;
    CHECK(vocc_is_leaf(n));
    CHECK_INT(vocc_label_of(n), VOCC_OPAQUE);
    CHECK_INT(vocc_leaf_count(n), 0xABCDEF);
}

/* What a walk learns of a child from the parent alone is true, and what it
 * loads for one child brings the other with it. */
static void nodes_of_built_trees(void)
{
    size_t seen[4] = {0, 0, 0, 0}, nodes = 0;
    for (size_t index = 0; index < shape_count(); index++) {
        shape s;
        world w;
        shape_make(&s, index, 1);
        test_context(s.name);
        world_make(&w, &s, NULL);
        const vocc_tree *tree = &w.scene->built.tree;
        for (size_t i = 0; i < tree->node_count; i++) {
            const vocc_node n = tree->nodes[i];
            if (i == 1 || vocc_is_leaf(n))
                continue;
            const uint32_t first = vocc_children(n);
            const uintptr_t line = (uintptr_t)&tree->nodes[first] / 64;
            REQUIRE(first >= 2 && first + 1 < tree->node_count);
            CHECK_INT((uintptr_t)&tree->nodes[first + 1] / 64, line);
            CHECK(vocc_axis(n) < 3);
            for (unsigned side = 0; side < 2; side++) {
                const vocc_node child = tree->nodes[first + side];
                const unsigned tag = vocc_tags(n) >> 2 * side & 3u;
                CHECK_INT(tag, vocc_is_leaf(child) ? vocc_label_of(child)
                                                   : (unsigned)VOCC_BOUNDARY);
                seen[tag]++;
            }
            nodes++;
        }
        test_compared(tree->node_count);
        world_free(&w);
        shape_free(&s);
    }
    test_context(NULL);
    test_note("%zu interior nodes, tags: %zu clear, %zu opaque", nodes,
              seen[VOCC_CLEAR], seen[VOCC_OPAQUE]);
    CHECK(seen[VOCC_BOUNDARY] > 1000);
    CHECK(seen[VOCC_CLEAR] > 1000);
    CHECK(seen[VOCC_OPAQUE] > 1000);
}

/* The larger child first: for all nodes without tags.  Of the other two orders
 * (their estimates are not worked out again here) it is checked that both
 * answers occur, and that occluders make them differ. */
static double box_area(const float lower[3], const float upper[3])
{
    const double x = (double)upper[0] - (double)lower[0],
                 y = (double)upper[1] - (double)lower[1],
                 z = (double)upper[2] - (double)lower[2];
    return 2.0 * (x * y + y * z + z * x);
}

static void check_order(const vocc_tree *tree, uint32_t index,
                        const float lower[3], const float upper[3],
                        size_t above[VOCC_FIRST_COUNT], size_t *differ,
                        size_t *count)
{
    const vocc_node n = tree->nodes[index];
    float cut_upper[3], cut_lower[3];
    if (vocc_is_leaf(n))
        return;
    memcpy(cut_upper, upper, sizeof(cut_upper));
    memcpy(cut_lower, lower, sizeof(cut_lower));
    cut_upper[vocc_axis(n)] = cut_lower[vocc_axis(n)] = n.at.split_pos;
    if (!vocc_tags(n)) {
        CHECK_INT(vocc_above_first(n, VOCC_FIRST_SATO),
                  box_area(cut_lower, upper) > box_area(lower, cut_upper));
        for (int k = 0; k < VOCC_FIRST_COUNT; k++)
            above[k] += vocc_above_first(n, (vocc_first)k);
        *differ += vocc_above_first(n, VOCC_FIRST_OPAQUE) !=
                   vocc_above_first(n, VOCC_FIRST_RTSAH);
        ++*count;
    }
    check_order(tree, vocc_children(n), lower, cut_upper, above, differ, count);
    check_order(tree, vocc_children(n) + 1, cut_lower, upper, above, differ,
                count);
}

static void child_order(void)
{
    size_t above[VOCC_FIRST_COUNT] = {0}, differ = 0, count = 0;
    for (size_t i = 0; i < shape_count(); i++) {
        shape s;
        world w;
        test_context(shape_name(i));
        shape_make(&s, i, 1);
        world_make(&w, &s, NULL);
        const vocc_tree *tree = &w.scene->built.tree;
        check_order(tree, 0, tree->lower, tree->upper, above, &differ, &count);
        world_free(&w);
        shape_free(&s);
    }
    test_compared(count);
    for (int k = 0; k < VOCC_FIRST_COUNT; k++)
        CHECK(above[k] > count / 10 && above[k] < count - count / 10);
    CHECK(differ > count / 100);
}

/* ---- budgets ----------------------------------------------------------------
 */

static void same_tree(const vocc_tree *a, const vocc_tree *b)
{
    CHECK_INT(a->node_count, b->node_count);
    CHECK_INT(a->reference_count, b->reference_count);
    CHECK_INT(a->triangle_count, b->triangle_count);
    if (test_failed())
        return;
    CHECK(!memcmp(a->nodes, b->nodes, a->node_count * sizeof(*a->nodes)));
    CHECK(!memcmp(a->references, b->references,
                  a->reference_count * sizeof(*a->references)));
    CHECK(!memcmp(a->ids, b->ids, a->triangle_count * sizeof(*a->ids)));
}

static uint8_t *oracle_answers(const shape *s, const ray_set *set)
{
    uint8_t *expected = malloc(set->count);
    REQUIRE(expected);
    for (size_t k = 0; k < set->count; k++)
        expected[k] = oracle_occluded(&set->rays[k], s, 0) == ORACLE_HIT;
    return expected;
}

/* By the baseline, and by others that use all of the tree. */
static void check_answers(const world *w, const shape *s, const ray_set *set,
                          const uint8_t *expected)
{
    uint8_t *actual = malloc(set->count);
    REQUIRE(actual);
    for (int flags = 0; flags < 8; flags++) {
        mode m = mode_baseline();
        if (flags) {
            m.isa = VOCC_ISA_AUTO;
            m.occluders = flags & 1;
            m.packets = flags >> 1 & 1;
            m.order = flags & 4 ? VOCC_ORDER_AUTO : VOCC_ORDER_STANDARD;
            m.cache = 8;
            m.extras = flags == 7 ? BY_BEAMS : 0;
        }
        trace(w, set, &m, actual, NULL);
        compare_answers(__FILE__, __LINE__, s->name, set, &m, actual, expected);
    }
    free(actual);
}

/* A tree that may have few nodes has large leaves, and the right answers. */
static void few_pairs(void)
{
    static const size_t budgets[] = {1, 2, 3, 10, 1000};
    size_t at_limit = 0, largest = 0;
    for (size_t i = 0; i < shape_count(); i++) {
        shape s;
        ray_set set;
        test_context(shape_name(i));
        shape_make(&s, i, 0);
        rays_init(&set);
        rays_adversarial(&set, &s, test_scaled(60, 8), 1300 + i);
        uint8_t *expected = oracle_answers(&s, &set);
        for (size_t b = 0; b < sizeof(budgets) / sizeof(budgets[0]); b++) {
            world w;
            world_limited(&w, &s, NULL, budgets[b]);
            const vocc_tree *tree = &w.scene->built.tree;
            CHECK(tree->node_count / 2 <= budgets[b]);
            at_limit += tree->node_count / 2 == budgets[b];
            for (size_t n = 0; n < tree->node_count; n++)
                if (n != 1 && vocc_is_leaf(tree->nodes[n]) &&
                    vocc_leaf_count(tree->nodes[n]) > largest)
                    largest = vocc_leaf_count(tree->nodes[n]);
            check_answers(&w, &s, &set, expected);
            world_free(&w);
        }
        free(expected);
        rays_free(&set);
        shape_free(&s);
    }
    test_context(NULL);
    test_note("%zu trees as large as they may be, a leaf of %zu triangles",
              at_limit, largest);
    CHECK(at_limit > 20);
    CHECK(largest > 100);
}

/* Many triangles, so that subtrees are jobs: the limit and the tree are the
 * same whatever the number of threads. */
static void limit_by_threads(void)
{
    static const size_t budgets[] = {1, 2, 10, 1000, 20000, 0};
    shape s;
    memset(&s, 0, sizeof(s));
    s.name = "spheres";
    s.part_count = 1;
    s.parts[0].occluder = 1;
    mesh_init(&s.parts[0].m);
    add_icosphere(&s.parts[0].m, 5, 1.0, 0.0, 0.0, 0.0);
    add_icosphere(&s.parts[0].m, 4, 0.5, 0.25, 0.125, 0.0);
    add_icosphere(&s.parts[0].m, 4, 0.25, 1.0, 0.125, 0.0);
    for (size_t b = 0; b < sizeof(budgets) / sizeof(budgets[0]); b++) {
        world one;
        vocc_build_options options;
        vocc_build_options_init(&options);
        options.threads = 1;
        world_limited(&one, &s, &options, budgets[b]);
        const size_t pairs = one.scene->built.tree.node_count / 2;
        test_note("budget %zu: %zu pairs", budgets[b], pairs);
        CHECK(!budgets[b] || pairs <= budgets[b]);
        /* Little of a budget is left where more would be wanted. */
        CHECK(!budgets[b] || pairs > budgets[b] / 2);
        for (options.threads = 2; options.threads <= 3; options.threads++) {
            world w;
            world_limited(&w, &s, &options, budgets[b]);
            same_tree(&one.scene->built.tree, &w.scene->built.tree);
            world_free(&w);
        }
        world_free(&one);
    }
    mesh_free(&s.parts[0].m);
}

/* ---- coarse trees -----------------------------------------------------------
 */

/* What is well within a leaf's box is listed there. */
static int check_leaf(void *context, uint32_t node, const float lower[3],
                      const float upper[3])
{
    const vocc_tree *tree = context;
    const vocc_node leaf = tree->nodes[node];
    const uint32_t *r = tree->references + leaf.at.first;
    vocc_bounds within;
    for (int k = 0; k < 3; k++) {
        within.lower[k] = lower[k] + 0x1p-10f * (upper[k] - lower[k]);
        within.upper[k] = upper[k] - 0x1p-10f * (upper[k] - lower[k]);
        /* Too thin for that. */
        if (!(within.lower[k] > lower[k]) || !(within.upper[k] < upper[k]))
            return 0;
    }
    for (uint32_t t = 0; t < tree->triangle_count; t++) {
        uint32_t i = 0;
        const uint32_t count =
            vocc_label_of(leaf) == VOCC_BOUNDARY ? vocc_leaf_count(leaf) : 0;
        if (!vocc_clip_meets(tree->corners + 9 * (size_t)t, &within,
                             tree->scale))
            continue;
        while (i < count && r[i] != t)
            i++;
        if (i == count) {
            test_fail(__FILE__, __LINE__, "leaf %" PRIu32 " without %" PRIu32,
                      node, t);
            return 1;
        }
        test_compared(1);
    }
    return 0;
}

/* As meshes of many triangles have them: fewer nodes, nothing missing, and the
 * right answers. */
static void coarse(void)
{
    size_t fine_nodes = 0, coarse_nodes = 0;
    for (size_t i = 0; i < shape_count(); i++) {
        shape s;
        ray_set set;
        world fine, w;
        test_context(shape_name(i));
        shape_make(&s, i, 0);
        rays_init(&set);
        rays_adversarial(&set, &s, test_scaled(100, 12), 1700 + i);
        uint8_t *expected = oracle_answers(&s, &set);
        world_make(&fine, &s, NULL);
        world_coarse(&w, &s);
        vocc_tree *const tree = &w.scene->built.tree;
        fine_nodes += fine.scene->built.tree.node_count;
        coarse_nodes += tree->node_count;
        (void)vocc_tree_leaves(tree, check_leaf, tree);
        (void)vocc_tree_leaves(&fine.scene->built.tree, check_leaf,
                               &fine.scene->built.tree);
        check_answers(&w, &s, &set, expected);
        world_free(&fine);
        world_free(&w);
        free(expected);
        rays_free(&set);
        shape_free(&s);
    }
    test_context(NULL);
    test_note("%zu nodes, %zu in coarse trees", fine_nodes, coarse_nodes);
    CHECK(coarse_nodes < fine_nodes / 4 * 3);
}

/* By default from so many triangles on, which a cost of one's own overrules. */
static void coarse_if_large(void)
{
    shape s;
    vocc_build_options options;
    memset(&s, 0, sizeof(s));
    s.name = "spheres";
    s.part_count = 1;
    s.parts[0].occluder = 1;
    mesh_init(&s.parts[0].m);
    add_icosphere(&s.parts[0].m, 6, 1.0, 0.0, 0.0, 0.0);
    for (int large = 0; large < 2; large++) {
        world w, chosen;
        if (large)
            add_icosphere(&s.parts[0].m, 6, 0.25, 0.0, 0.0, 0.0);
        vocc_build_options_init(&options);
        options.intersection_cost = large ? 0.4f : 0.65f;
        world_make(&w, &s, NULL);
        world_make(&chosen, &s, &options);
        const vocc_report r = w.scene->built.report,
                          c = chosen.scene->built.report;
        test_note("%" PRIu64 " triangles, %" PRIu64
                  " nodes, of that cost %" PRIu64,
                  r.triangle_count, r.node_count, c.node_count);
        CHECK_INT(r.triangle_count > 100000, large);
        if (large)
            CHECK(r.node_count < c.node_count);
        else
            CHECK_INT(r.node_count, c.node_count);
        world_free(&w);
        world_free(&chosen);
    }
    mesh_free(&s.parts[0].m);
}

/* ---- clipping ---------------------------------------------------------------
 */

static float on_grid(test_random *random, int cells)
{
    return (float)random_below(random, (uint32_t)cells) / (float)cells;
}

/* Points of the triangle, in double, are never outside of the bounds of the
 * side that they are on. */
static void clip_loses_nothing(void)
{
    test_random random = random_seed(11);
    const size_t trials = test_scaled(40000, 2000);
    for (size_t i = 0; i < trials; i++) {
        /* Coarse grids make vertices and edges lie in the planes. */
        const int cells = i % 3 == 0 ? 4 : i % 3 == 1 ? 64 : 1 << 20;
        const int axis = (int)random_below(&random, 3);
        float c[9];
        vocc_bounds box, parts[2];
        for (int k = 0; k < 9; k++)
            c[k] = on_grid(&random, cells);
        for (int k = 0; k < 3; k++) {
            const float a = on_grid(&random, cells),
                        b = on_grid(&random, cells);
            box.lower[k] = a < b ? a : b;
            box.upper[k] = (a < b ? b : a) + (k == axis ? 0.25f : 0.0f);
        }
        const float split =
            box.lower[axis] + (box.upper[axis] - box.lower[axis]) *
                                  (float)random_in(&random, 0.1, 0.9);
        const int sides =
            vocc_clip_split(c, &box, axis, split, 1.25f, &parts[0], &parts[1]);
        for (int j = 0; j < 24; j++) {
            /* Dyadic weights: the points are exact on coarse grids. */
            const double u = (double)random_below(&random, 17) / 16.0,
                         v = (double)random_below(&random, 17) / 16.0 *
                             (1.0 - u);
            double p[3];
            int inside = 1;
            for (int k = 0; k < 3; k++) {
                p[k] = (double)c[k] + u * ((double)c[3 + k] - (double)c[k]) +
                       v * ((double)c[6 + k] - (double)c[k]);
                inside &= p[k] >= (double)box.lower[k] &&
                          p[k] <= (double)box.upper[k];
            }
            if (!inside)
                continue;
            test_compared(1);
            for (int side = 0; side < 2; side++) {
                if (side == 0 ? p[axis] > (double)split
                              : p[axis] < (double)split)
                    continue;
                if (!(sides >> side & 1)) {
                    test_fail(__FILE__, __LINE__,
                              "trial %zu: side %d has a point and no part", i,
                              side);
                    return;
                }
                for (int k = 0; k < 3; k++)
                    if (p[k] < (double)parts[side].lower[k] - 1e-15 ||
                        p[k] > (double)parts[side].upper[k] + 1e-15) {
                        test_fail(__FILE__, __LINE__,
                                  "trial %zu: side %d, axis %d: %.17g is not "
                                  "from %.9g to %.9g",
                                  i, side, k, p[k],
                                  (double)parts[side].lower[k],
                                  (double)parts[side].upper[k]);
                        return;
                    }
            }
        }
    }
}

/* ---- the flood fill
 * ------------------------------------------------------------ */

enum { DIRECTIONS = 5 };

/* The paper's label of each centre: a ray of its own, back face = inside. */
static void label_by_rays(const world *w, const mesh *m, const float *centres,
                          size_t count, int direction, uint8_t *inside)
{
    static const float directions[DIRECTIONS][3] = {{0.813f, 0.347f, 0.211f},
                                                    {-0.531f, 0.619f, 0.377f},
                                                    {0.129f, -0.887f, 0.443f},
                                                    {-0.271f, -0.157f, -0.911f},
                                                    {0.577f, 0.293f, -0.761f}};
    vocc_rays rays;
    vocc_hits hits;
    vocc_error error;
    memset(&rays, 0, sizeof rays);
    memset(&hits, 0, sizeof hits);
    rays.count = count;
    rays.org = rows_of(centres, 3 * sizeof(float), VOCC_FLOAT32);
    rays.dir = rows_of(directions[direction], 0, VOCC_FLOAT32);
    hits.prim_id = malloc(count * sizeof *hits.prim_id);
    REQUIRE(hits.prim_id);
    CHECK_STATUS(vocc_intersect(w->scene, &rays, &hits, NULL, &error), &error,
                 VOCC_OK);
    for (size_t i = 0; i < count; i++) {
        double e1[3], e2[3], facing = 0.0;
        inside[i] = 0;
        if (hits.prim_id[i] < 0)
            continue;
        for (int k = 0; k < 3; k++) {
            const size_t t = (size_t)hits.prim_id[i];
            e1[k] = (double)mesh_corner(m, t, 1)[k] -
                    (double)mesh_corner(m, t, 0)[k];
            e2[k] = (double)mesh_corner(m, t, 2)[k] -
                    (double)mesh_corner(m, t, 0)[k];
        }
        for (int k = 0; k < 3; k++)
            facing += (double)directions[direction][k] *
                      (e1[(k + 1) % 3] * e2[(k + 2) % 3] -
                       e1[(k + 2) % 3] * e2[(k + 1) % 3]);
        inside[i] = facing > 0.0;
    }
    free(hits.prim_id);
}

static void flood_is_one_ray_a_leaf(void)
{
    static const double lower[3] = {-1.0, -0.5, -0.25},
                        upper[3] = {0.75, 1.0, 2.0};
    for (int which = 0; which < 3; which++) {
        shape s;
        world w;
        size_t count = 0, empties = 0, agreed = 0;
        vocc_leaf *leaves;
        vocc_error error;
        memset(&s, 0, sizeof s);
        s.name = which == 0 ? "sphere" : which == 1 ? "knot" : "box";
        s.part_count = 1;
        s.parts[0].occluder = 1;
        mesh_init(&s.parts[0].m);
        if (which == 0)
            add_icosphere(&s.parts[0].m, 4, 1.0, 0.1, -0.2, 0.3);
        else if (which == 1)
            add_knot(&s.parts[0].m, 2, 3, 200, 12, 0.25);
        else
            add_box(&s.parts[0].m, 5, lower, upper);
        test_context(s.name);
        world_make(&w, &s, NULL);
        CHECK_STATUS(vocc_scene_leaves(w.scene, 0, NULL, &count, &error),
                     &error, VOCC_OK);
        leaves = malloc(count * sizeof *leaves);
        float *centres = malloc(count * 3 * sizeof *centres);
        uint8_t *inside = malloc(count * DIRECTIONS);
        REQUIRE(leaves && centres && inside);
        CHECK_STATUS(vocc_scene_leaves(w.scene, count, leaves, &count, &error),
                     &error, VOCC_OK);
        for (size_t i = 0; i < count; i++) {
            if (leaves[i].label == VOCC_BOUNDARY ||
                leaves[i].label == VOCC_UNKNOWN)
                continue;
            leaves[empties] = leaves[i];
            for (int k = 0; k < 3; k++)
                centres[3 * empties + (size_t)k] =
                    0.5f * (leaves[i].lower[k] + leaves[i].upper[k]);
            empties++;
        }
        REQUIRE(empties > 0);
        for (int d = 0; d < DIRECTIONS; d++)
            label_by_rays(&w, &s.parts[0].m, centres, empties, d,
                          inside + (size_t)d * empties);
        for (size_t i = 0; i < empties; i++) {
            int votes = 0;
            for (int d = 0; d < DIRECTIONS; d++)
                votes += inside[(size_t)d * empties + i];
            if (votes != 0 && votes != DIRECTIONS)
                continue;
            agreed++;
            test_compared(1);
            if ((leaves[i].label == VOCC_OPAQUE) != (votes != 0)) {
                test_fail(__FILE__, __LINE__,
                          "leaf %zu: label %d, but %d of %d rays say inside", i,
                          (int)leaves[i].label, votes, (int)DIRECTIONS);
                break;
            }
        }
        test_note("%s: %zu empty leaves, the rays agree on %zu", s.name,
                  empties, agreed);
        CHECK(agreed * 10 > empties * 9);
        free(leaves);
        free(centres);
        free(inside);
        world_free(&w);
        mesh_free(&s.parts[0].m);
    }
    test_context(NULL);
}

/* ---- grown occluders ------------------------------------------------------
 */

/* Whether a plane of the box has all of the triangle beyond it. */
static int is_beside(const float c[9], const vocc_opaque *box)
{
    for (int k = 0; k < 3; k++)
        if ((c[k] <= box->lower[k] && c[3 + k] <= box->lower[k] &&
             c[6 + k] <= box->lower[k]) ||
            (c[k] >= box->upper[k] && c[3 + k] >= box->upper[k] &&
             c[6 + k] >= box->upper[k]))
            return 1;
    return 0;
}

/* No sampled point of a triangle is inside of a grown box, and its centre is in
 * the region that it stands for. */
static void grown_boxes_are_free(void)
{
    size_t boxes = 0;
    for (size_t index = 0; index < shape_count(); index++) {
        shape s;
        world w;
        shape_make(&s, index, 1);
        test_context(s.name);
        world_make(&w, &s, NULL);
        const vocc_tree *tree = &w.scene->built.tree;
        for (size_t i = 0; i < tree->opaque_count; i++) {
            if (tree->opaque[i].grown < 0)
                continue;
            const vocc_opaque *box = &tree->grown[tree->opaque[i].grown];
            float centre[3];
            int32_t region = -9;
            vocc_error error;
            for (int k = 0; k < 3; k++)
                centre[k] = 0.5f * (box->lower[k] + box->upper[k]);
            CHECK_STATUS(vocc_region(w.scene, 1,
                                     rows_of(centre, 12, VOCC_FLOAT32), &region,
                                     NULL, &error),
                         &error, VOCC_OK);
            CHECK_INT(region, tree->opaque[i].region);
            CHECK_INT(box->region, tree->opaque[i].region);
            boxes++;
            for (size_t t = 0; t < tree->triangle_count; t++) {
                const float *c = tree->corners + 9 * t;
                if (is_beside(c, box))
                    continue;
                for (int j = 0; j < 28; j++) {
                    /* A lattice of 28 points over the triangle. */
                    const int a = (j * 7) % 29 % 8, b = j % 7 % (8 - a);
                    int inside = 1;
                    for (int k = 0; k < 3; k++) {
                        const double x =
                            ((double)c[k] * (7 - a - b) + (double)c[3 + k] * a +
                             (double)c[6 + k] * b) /
                            7.0;
                        inside &= x > (double)box->lower[k] &&
                                  x < (double)box->upper[k];
                    }
                    if (inside) {
                        test_fail(__FILE__, __LINE__,
                                  "grown box %zu holds a point of triangle %zu",
                                  i, t);
                        t = tree->triangle_count;
                        break;
                    }
                }
            }
            test_compared(1);
        }
        world_free(&w);
        shape_free(&s);
    }
    test_context(NULL);
    test_note("%zu grown boxes", boxes);
    CHECK(boxes > 100);
}

static int is_box_within(const vocc_opaque *a, const float lower[3],
                         const float upper[3])
{
    for (int k = 0; k < 3; k++)
        if (a->lower[k] < lower[k] || a->upper[k] > upper[k])
            return 0;
    return 1;
}

static vocc_opaque lane_box(const vocc_box_node *n, int lane)
{
    vocc_opaque o;
    memset(&o, 0, sizeof o);
    for (int k = 0; k < 3; k++) {
        o.lower[k] = n->lower[k][lane];
        o.upper[k] = n->upper[k][lane];
    }
    o.region = n->region[lane];
    return o;
}

/* Of a node's lanes: what is own is a grown box and no larger than `most`; what
 * is below is within its bounds. */
static void check_box_node(const vocc_tree *tree, const vocc_box_tree *boxes,
                           size_t number, const vocc_opaque *around, float most,
                           size_t *visits)
{
    const vocc_box_node *n = &boxes->nodes[number];
    float least = most;
    CHECK_INT(n->boxes & n->nodes, 0);
    CHECK(n->boxes);
    (*visits)++;
    for (int lane = 0; lane < VOCC_BOX_LANES; lane++) {
        const vocc_opaque o = lane_box(n, lane);
        if (!((n->boxes | n->nodes) >> lane & 1))
            continue;
        CHECK(!around || is_box_within(&o, around->lower, around->upper));
        if (n->boxes >> lane & 1) {
            const float area = (float)box_area(o.lower, o.upper);
            size_t i;
            for (i = 0; i < tree->grown_count; i++)
                if (!memcmp(tree->grown[i].lower, o.lower, sizeof o.lower) &&
                    !memcmp(tree->grown[i].upper, o.upper, sizeof o.upper) &&
                    tree->grown[i].region == o.region)
                    break;
            CHECK(i < tree->grown_count);
            /* Areas are sorted by in float32, added in another order. */
            CHECK(area <= most * 1.000001f);
            least = area < least ? area : least;
        }
    }
    for (int lane = VOCC_BOX_OWN; lane < VOCC_BOX_LANES; lane++) {
        const vocc_opaque o = lane_box(n, lane);
        const size_t child = n->child + (size_t)(lane - VOCC_BOX_OWN);
        if (!(n->nodes >> lane & 1))
            continue;
        REQUIRE(child > number && child < boxes->node_count);
        check_box_node(tree, boxes, child, &o, least, visits);
    }
}

/* Every grown box is in the hierarchy, or within another of its region; the
 * largest first; bounds hold what is below; every node is there once. */
static void grown_boxes_in_a_hierarchy(void)
{
    size_t nodes = 0, grown = 0, most = 0;
    for (size_t index = 0; index < shape_count(); index++) {
        shape s;
        world w;
        size_t visits = 0;
        shape_make(&s, index, 2);
        test_context(s.name);
        world_make(&w, &s, NULL);
        const vocc_tree *tree = &w.scene->built.tree;
        const vocc_box_tree *boxes = &w.scene->built.bvh.boxes;
        CHECK_INT(boxes->node_count > 0, tree->grown_count > 0);
        if (boxes->node_count)
            check_box_node(tree, boxes, 0, NULL, FLT_MAX, &visits);
        CHECK_INT(visits, boxes->node_count);
        for (size_t i = 0; i < tree->grown_count; i++) {
            int found = 0;
            for (size_t j = 0; j < boxes->node_count && !found; j++)
                for (int lane = 0; lane < VOCC_BOX_LANES && !found; lane++) {
                    const vocc_opaque o = lane_box(&boxes->nodes[j], lane);
                    found = boxes->nodes[j].boxes >> lane & 1 &&
                            o.region == tree->grown[i].region &&
                            is_box_within(&tree->grown[i], o.lower, o.upper);
                }
            CHECK(found);
        }
        test_compared(tree->grown_count + boxes->node_count);
        nodes += boxes->node_count;
        grown += tree->grown_count;
        most = boxes->node_count > most ? boxes->node_count : most;
        world_free(&w);
        shape_free(&s);
    }
    test_context(NULL);
    test_note("%zu grown boxes, %zu nodes, up to %zu a scene", grown, nodes,
              most);
    CHECK(most > 9);
}

const test_case test_tree_cases[] = {
    {"tree.node_layout", node_layout},
    {"tree.nodes_of_built_trees", nodes_of_built_trees},
    {"tree.child_order", child_order},
    {"tree.few_pairs", few_pairs},
    {"tree.limit_by_threads", limit_by_threads},
    {"tree.coarse", coarse},
    {"tree.coarse_if_large", coarse_if_large},
    {"tree.clip_loses_nothing", clip_loses_nothing},
    {"tree.flood_is_one_ray_a_leaf", flood_is_one_ray_a_leaf},
    {"tree.grown_boxes_are_free", grown_boxes_are_free},
    {"tree.grown_boxes_in_a_hierarchy", grown_boxes_in_a_hierarchy},
    {NULL, NULL},
};
