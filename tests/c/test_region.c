/* Guards regions and the tree that they come from: vocc_region against exact
 * winding numbers, inside, outside, on the surface and on split planes; leaves
 * tile the bounds, list what overlaps them, and agree with their neighbours. */
#include "topology.h"
#include "world.h"

#include <float.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "test.h"

/* ---- the reference ----------------------------------------------------- */

#define MOST_SOLIDS 64

typedef struct windings {
    int on_surface;
    size_t count;
    int32_t components[MOST_SOLIDS], numbers[MOST_SOLIDS];
} windings;

/* All closed components of the shape's meshes that may hold occluders. */
typedef struct solids {
    const shape *s;
    topology parts[SHAPE_MAX_PARTS];
} solids;

static void solids_make(solids *all, const shape *s)
{
    all->s = s;
    for (int p = 0; p < s->part_count; p++)
        topology_make(&all->parts[p], &s->parts[p].m);
}

static void solids_free(solids *all)
{
    for (int p = 0; p < all->s->part_count; p++)
        topology_free(&all->parts[p]);
}

static windings expected_windings(const solids *all, const float point[3])
{
    windings out;
    memset(&out, 0, sizeof(out));
    int32_t first = 0;
    for (int p = 0; p < all->s->part_count; p++) {
        const topology *t = &all->parts[p];
        for (size_t c = 0; c < t->component_count; c++) {
            const component *part = &t->components[c];
            int winding, parity;
            if (!part->closed || !all->s->parts[p].occluder)
                continue;
            if (oracle_winding(point, &all->s->parts[p].m, part->triangles,
                               part->triangle_count, &winding, &parity)) {
                out.on_surface = 1;
                return out;
            }
            const int number = part->consistent ? winding : parity;
            if (number == 0)
                continue;
            REQUIRE(out.count < MOST_SOLIDS);
            out.components[out.count] = first + (int32_t)c;
            out.numbers[out.count++] = number;
        }
        first += (int32_t)t->component_count;
    }
    return out;
}

static void check_region(const world *w, const float point[3], int32_t region,
                         const windings *expected)
{
    int wrong = 0;
    if (expected->on_surface) {
        wrong = region != -1;
    } else if (expected->count == 0) {
        wrong = region != 0;
    } else if (region <= 0) {
        wrong = 1;
    } else {
        int32_t components[MOST_SOLIDS], numbers[MOST_SOLIDS];
        size_t count = 0;
        vocc_error error;
        CHECK_STATUS(vocc_scene_region_info(w->scene, region, MOST_SOLIDS,
                                            components, numbers, &count,
                                            &error),
                     &error, VOCC_OK);
        wrong = count != expected->count;
        for (size_t i = 0; !wrong && i < count; i++)
            wrong = components[i] != expected->components[i] ||
                    numbers[i] != expected->numbers[i];
    }
    if (wrong)
        test_fail(
            __FILE__, __LINE__,
            "the point (%a, %a, %a) has region %d; it is %s%zu solids, "
            "the first %d with number %d",
            (double)point[0], (double)point[1], (double)point[2], (int)region,
            expected->on_surface ? "on the surface, " : "in ", expected->count,
            (int)expected->components[0], (int)expected->numbers[0]);
}

/* ---- points ------------------------------------------------------------ */

typedef struct points {
    size_t count, capacity;
    float *p;
} points;

static void add_point(points *set, double x, double y, double z)
{
    if (set->count == set->capacity) {
        set->capacity = set->capacity ? 2 * set->capacity : 256;
        set->p = realloc(set->p, set->capacity * 3 * sizeof(float));
        REQUIRE(set->p);
    }
    float *p = set->p + 3 * set->count++;
    p[0] = (float)x;
    p[1] = (float)y;
    p[2] = (float)z;
}

static void add_floats(points *set, const float p[3])
{
    add_point(set, (double)p[0], (double)p[1], (double)p[2]);
}

static void add_moved(points *set, const float p[3], test_random *random)
{
    float moved[3];
    for (int k = 0; k < 3; k++) {
        const uint32_t way = random_below(random, 3);
        moved[k] = way == 0   ? p[k]
                   : way == 1 ? nextafterf(p[k], HUGE_VALF)
                              : nextafterf(p[k], -HUGE_VALF);
    }
    add_floats(set, moved);
}

static vocc_leaf *leaves_of(const world *w, size_t *count)
{
    vocc_error error;
    CHECK_STATUS(vocc_scene_leaves(w->scene, 0, NULL, count, &error), &error,
                 VOCC_OK);
    vocc_leaf *leaves = malloc((*count + 1) * sizeof(*leaves));
    REQUIRE(leaves);
    CHECK_STATUS(vocc_scene_leaves(w->scene, *count, leaves, count, &error),
                 &error, VOCC_OK);
    return leaves;
}

static void make_points(points *set, const world *w, const shape *s, size_t n)
{
    test_random random = random_seed(2024);
    double lower[3], upper[3];
    size_t leaf_count;
    shape_bounds(s, lower, upper);
    for (size_t i = 0; i < n; i++) {
        double p[3];
        for (int k = 0; k < 3; k++)
            p[k] = random_in(&random, lower[k] - 0.1, upper[k] + 0.1);
        add_point(set, p[0], p[1], p[2]);
        /* On the grid: often exactly in planes of the mesh. */
        for (int k = 0; k < 3; k++)
            p[k] = floor(p[k] * 16.0) / 16.0;
        add_point(set, p[0], p[1], p[2]);

        const mesh *m =
            &s->parts[random_below(&random, (uint32_t)s->part_count)].m;
        const size_t t = random_below(&random, (uint32_t)m->triangle_count);
        const float *a = mesh_corner(m, t, 0), *b = mesh_corner(m, t, 1),
                    *c = mesh_corner(m, t, 2);
        float on[3];
        add_floats(set, a);
        add_moved(set, a, &random);
        for (int k = 0; k < 3; k++)
            on[k] = a[k] + 0.5f * (b[k] - a[k]);
        add_floats(set, on);
        for (int k = 0; k < 3; k++)
            on[k] += 0.25f * (c[k] - a[k]);
        add_floats(set, on);
        add_moved(set, on, &random);
        /* In line with edges and planes, outside of the triangle. */
        for (int k = 0; k < 3; k++)
            on[k] = a[k] + 2.0f * (b[k] - a[k]);
        add_floats(set, on);
    }
    vocc_leaf *leaves = leaves_of(w, &leaf_count);
    for (size_t i = 0; i < n && leaf_count; i++) {
        const vocc_leaf *leaf =
            &leaves[random_below(&random, (uint32_t)leaf_count)];
        float p[3];
        for (int k = 0; k < 3; k++) {
            const uint32_t at = random_below(&random, 3);
            p[k] = at == 0   ? leaf->lower[k]
                   : at == 1 ? leaf->upper[k]
                             : 0.5f * (leaf->lower[k] + leaf->upper[k]);
        }
        add_floats(set, p);
        add_moved(set, p, &random);
    }
    free(leaves);
    add_point(set, 1e30, 0, 0);
    const float farthest[3] = {-FLT_MAX, FLT_MAX, FLT_MAX};
    add_floats(set, farthest);
    add_point(set, 0x1p-149, -0x1p-149, 0x1p-149);
    add_point(set, 0, 0, 0);
    add_point(set, -0.0, 0, -0.0);
    for (int corner = 0; corner < 8; corner++)
        add_point(set, corner & 1 ? lower[0] : upper[0],
                  corner & 2 ? lower[1] : upper[1],
                  corner & 4 ? lower[2] : upper[2]);
}

static void query_regions(const world *w, const points *set, int threads,
                          int32_t *region)
{
    vocc_query_options options;
    vocc_error error;
    vocc_query_options_init(&options);
    options.threads = threads;
    CHECK_STATUS(vocc_region(w->scene, set->count,
                             rows_of(set->p, 12, VOCC_FLOAT32), region,
                             &options, &error),
                 &error, VOCC_OK);
}

static void winding_numbers(void)
{
    for (size_t i = 0; i < shape_count(); i++) {
        shape s;
        world w;
        solids all;
        points set = {0, 0, NULL};
        test_context(shape_name(i));
        shape_make(&s, i, 0);
        world_make(&w, &s, NULL);
        solids_make(&all, &s);
        make_points(&set, &w, &s, test_scaled(150, 20));
        int32_t *region = malloc(set.count * sizeof(*region));
        REQUIRE(region);
        query_regions(&w, &set, 1, region);
        size_t surface = 0, inside = 0;
        for (size_t k = 0; k < set.count; k++) {
            const float *p = set.p + 3 * k;
            const windings expected = expected_windings(&all, p);
            check_region(&w, p, region[k], &expected);
            surface += (size_t)expected.on_surface;
            inside += expected.count != 0;
        }
        if (s.solid) {
            CHECK(surface > set.count / 50);
            CHECK(inside > 0);
        }
        test_compared(set.count);

        /* As float64 too, and the same numbers for any number of threads on
         * a scene that was not asked before. */
        double *wide = malloc(3 * set.count * sizeof(*wide));
        int32_t *again = malloc(set.count * sizeof(*again));
        REQUIRE(wide && again);
        for (size_t k = 0; k < 3 * set.count; k++)
            wide[k] = (double)set.p[k];
        vocc_error error;
        CHECK_STATUS(vocc_region(w.scene, set.count,
                                 rows_of(wide, 24, VOCC_FLOAT64), again, NULL,
                                 &error),
                     &error, VOCC_OK);
        CHECK(memcmp(region, again, set.count * sizeof(*region)) == 0);
        for (int threads = 2; threads < 4; threads++) {
            world other;
            world_make(&other, &s, NULL);
            query_regions(&other, &set, threads, again);
            CHECK(memcmp(region, again, set.count * sizeof(*region)) == 0);
            world_free(&other);
        }
        free(wide);
        free(again);
        free(region);
        free(set.p);
        solids_free(&all);
        world_free(&w);
        shape_free(&s);
    }
}

static void points_that_are_none(void)
{
    static const float bad[] = {NAN, HUGE_VALF, -HUGE_VALF};
    shape s;
    world w;
    shape_make(&s, 0, 0);
    world_make(&w, &s, NULL);
    for (int axis = 0; axis < 3; axis++) {
        for (int i = 0; i < 3; i++) {
            float p[6] = {0.125f, 0.125f, 0.125f, 0.125f, 0.125f, 0.125f};
            int32_t region[2] = {9, 9};
            p[axis] = bad[i];
            CHECK_INT(vocc_region(w.scene, 2, rows_of(p, 12, VOCC_FLOAT32),
                                  region, NULL, NULL),
                      VOCC_OK);
            CHECK_INT(region[0], -2);
            CHECK(region[1] > 0);
        }
    }
    /* Beyond float32 is infinite. */
    const double far[3] = {1e300, 0, 0};
    int32_t region = 9;
    CHECK_INT(vocc_region(w.scene, 1, rows_of(far, 24, VOCC_FLOAT64), &region,
                          NULL, NULL),
              VOCC_OK);
    CHECK_INT(region, -2);
    world_free(&w);
    shape_free(&s);
}

/* By hand: three spheres, outward or with the middle one inward. */
static void nested_numbers(void)
{
    static const double radius[4] = {1.5, 0.85, 0.5, 0.25};
    static const int numbers[2][4][3] = {
        {{0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {1, 1, 1}},
        {{0, 0, 0}, {1, 0, 0}, {1, -1, 0}, {1, -1, 1}}};
    for (int hollow = 0; hollow < 2; hollow++) {
        shape s;
        world w;
        shape_make(&s, hollow ? 6 : 5, 1);
        test_context(s.name);
        world_make(&w, &s, NULL);
        int32_t seen[4];
        for (int depth = 0; depth < 4; depth++) {
            const float p[3] = {(float)radius[depth], 0.01f, 0.02f};
            CHECK_INT(vocc_region(w.scene, 1, rows_of(p, 12, VOCC_FLOAT32),
                                  &seen[depth], NULL, NULL),
                      VOCC_OK);
            int32_t components[3] = {-1, -1, -1}, windings_seen[3] = {0, 0, 0};
            size_t count = 0;
            CHECK_INT(vocc_scene_region_info(w.scene, seen[depth], 3,
                                             components, windings_seen, &count,
                                             NULL),
                      VOCC_OK);
            CHECK_INT(count, depth);
            for (int k = 0; k < depth; k++) {
                CHECK_INT(components[k], k);
                CHECK_INT(windings_seen[k], numbers[hollow][depth][k]);
            }
            for (int k = 0; k < depth; k++)
                CHECK(seen[k] != seen[depth]);
        }
        CHECK_INT(seen[0], 0);
        world_free(&w);
        shape_free(&s);
    }
}

/* ---- leaves ------------------------------------------------------------ */

static double extent(const vocc_leaf *leaf, int k)
{
    return (double)leaf->upper[k] - (double)leaf->lower[k];
}

static void check_tiling(const world *w, const vocc_leaf *leaves, size_t count)
{
    vocc_report r;
    r.size = sizeof(r);
    CHECK_INT(vocc_scene_report(w->scene, &r, NULL), VOCC_OK);
    double volume = 0.0, all = 1.0;
    for (size_t i = 0; i < count; i++) {
        double v = 1.0;
        for (int k = 0; k < 3; k++) {
            CHECK(leaves[i].lower[k] <= leaves[i].upper[k]);
            CHECK((double)leaves[i].lower[k] >= r.lower[k] &&
                  (double)leaves[i].upper[k] <= r.upper[k]);
            v *= extent(&leaves[i], k);
        }
        volume += v;
    }
    for (int k = 0; k < 3; k++)
        all *= r.upper[k] - r.lower[k];
    CHECK_NEAR(volume, all, 1e-9 * all);
    /* Every point is in a leaf, and in the open box of at most one. */
    test_random random = random_seed(17);
    for (size_t i = 0; i < test_scaled(300, 40); i++) {
        double p[3];
        for (int k = 0; k < 3; k++)
            p[k] = i & 1
                       ? (double)leaves[random_below(&random, (uint32_t)count)]
                             .lower[k]
                       : random_in(&random, r.lower[k], r.upper[k]);
        size_t closed = 0, open = 0;
        for (size_t j = 0; j < count; j++) {
            int in_closed = 1, in_open = 1;
            for (int k = 0; k < 3; k++) {
                const double low = (double)leaves[j].lower[k];
                const double high = (double)leaves[j].upper[k];
                in_closed &= p[k] >= low && p[k] <= high;
                in_open &= p[k] > low && p[k] < high;
            }
            closed += (size_t)in_closed;
            open += (size_t)in_open;
        }
        CHECK(closed >= 1);
        CHECK(open <= 1);
        CHECK(open == 0 || closed == 1);
    }
}

/* Triangles sampled at points: a leaf that holds the point well inside lists
 * the triangle, and some leaf that holds the point does. */
static void check_references(const world *w, const shape *s,
                             const vocc_leaf *leaves, size_t count)
{
    test_random random = random_seed(23);
    int32_t **lists = malloc((count + 1) * sizeof(*lists));
    REQUIRE(lists);
    for (size_t i = 0; i < count; i++) {
        lists[i] = malloc((leaves[i].count + 1) * 2 * sizeof(int32_t));
        REQUIRE(lists[i]);
        vocc_error error;
        CHECK_STATUS(vocc_scene_references(w->scene, leaves[i].first,
                                           leaves[i].count, lists[i], &error),
                     &error, VOCC_OK);
        CHECK((leaves[i].label == VOCC_BOUNDARY) == (leaves[i].count != 0));
        CHECK((leaves[i].label == VOCC_BOUNDARY) == (leaves[i].region == -1));
        for (uint32_t r = 0; r < leaves[i].count; r++) {
            const int32_t geom = lists[i][2 * r], prim = lists[i][2 * r + 1];
            REQUIRE(geom >= 0 && geom < s->part_count && prim >= 0 &&
                    (size_t)prim < s->parts[geom].m.triangle_count);
        }
    }
    double lower[3], upper[3], size = 0.0;
    shape_bounds(s, lower, upper);
    for (int k = 0; k < 3; k++)
        size = fmax(size, fmax(fabs(lower[k]), fabs(upper[k])));
    for (int p = 0; p < s->part_count; p++) {
        const mesh *m = &s->parts[p].m;
        for (size_t t = 0; t < m->triangle_count; t++) {
            for (int sample = 0; sample < 8; sample++) {
                /* Corners are exact; other points up to rounding. */
                double weight[3], point[3];
                double slack = 0.0;
                if (sample < 3) {
                    for (int k = 0; k < 3; k++)
                        weight[k] = k == sample;
                } else {
                    weight[0] = random_in(&random, 0, 1);
                    weight[1] = random_in(&random, 0, 1 - weight[0]);
                    weight[2] = 1 - weight[0] - weight[1];
                    slack = 1e-14 * size;
                }
                for (int k = 0; k < 3; k++)
                    point[k] = weight[0] * (double)mesh_corner(m, t, 0)[k] +
                               weight[1] * (double)mesh_corner(m, t, 1)[k] +
                               weight[2] * (double)mesh_corner(m, t, 2)[k];
                size_t listed = 0;
                for (size_t i = 0; i < count; i++) {
                    int holds = 1, well = 1;
                    for (int k = 0; k < 3; k++) {
                        const double low = (double)leaves[i].lower[k];
                        const double high = (double)leaves[i].upper[k];
                        holds &=
                            point[k] >= low - slack && point[k] <= high + slack;
                        well &=
                            point[k] > low + slack && point[k] < high - slack;
                    }
                    if (!holds)
                        continue;
                    int found = 0;
                    for (uint32_t r = 0; r < leaves[i].count && !found; r++)
                        found = lists[i][2 * r] == p &&
                                lists[i][2 * r + 1] == (int32_t)t;
                    listed += (size_t)found;
                    if (well && !found)
                        test_fail(__FILE__, __LINE__,
                                  "leaf %zu (label %d) does not list triangle "
                                  "%d %zu, which is inside of it at (%a, %a, "
                                  "%a)",
                                  i, (int)leaves[i].label, p, t, point[0],
                                  point[1], point[2]);
                }
                if (!listed)
                    test_fail(__FILE__, __LINE__,
                              "no leaf at (%a, %a, %a) lists triangle %d %zu",
                              point[0], point[1], point[2], p, t);
                test_compared(1);
            }
        }
    }
    for (size_t i = 0; i < count; i++)
        free(lists[i]);
    free(lists);
}

/* The area, as it were, that two leaves' faces have in common. */
static int share_a_face(const vocc_leaf *a, const vocc_leaf *b)
{
    for (int axis = 0; axis < 3; axis++) {
        if (a->upper[axis] != b->lower[axis] &&
            b->upper[axis] != a->lower[axis])
            continue;
        int overlap = 1;
        for (int other = 0; other < 3; other++) {
            if (other == axis)
                continue;
            const float low = a->lower[other] > b->lower[other]
                                  ? a->lower[other]
                                  : b->lower[other];
            const float high = a->upper[other] < b->upper[other]
                                   ? a->upper[other]
                                   : b->upper[other];
            overlap &= low < high;
        }
        if (overlap)
            return 1;
    }
    return 0;
}

static void check_empty_leaves(const world *w, const vocc_leaf *leaves,
                               size_t count)
{
    size_t compared = 0;
    for (size_t i = 0; i < count; i++) {
        const vocc_leaf *leaf = &leaves[i];
        if (leaf->label == VOCC_BOUNDARY)
            continue;
        CHECK((leaf->label == VOCC_CLEAR) == (leaf->region == 0));
        CHECK((leaf->label == VOCC_OPAQUE) == (leaf->region > 0));
        float centre[3];
        int strictly = 1;
        for (int k = 0; k < 3; k++) {
            centre[k] = (float)(0.5 * ((double)leaf->lower[k] +
                                       (double)leaf->upper[k]));
            strictly &=
                centre[k] > leaf->lower[k] && centre[k] < leaf->upper[k];
        }
        if (!strictly)
            continue;
        int32_t region = -9;
        CHECK_INT(vocc_region(w->scene, 1, rows_of(centre, 12, VOCC_FLOAT32),
                              &region, NULL, NULL),
                  VOCC_OK);
        if (region != leaf->region)
            test_fail(__FILE__, __LINE__,
                      "leaf %zu has region %d, its centre (%a, %a, %a) %d", i,
                      (int)leaf->region, (double)centre[0], (double)centre[1],
                      (double)centre[2], (int)region);
        compared++;
        /* Neighbours: all of them in small trees, some in large ones. */
        for (size_t j = i + 1; j < count && j < i + 3000; j++) {
            if (leaves[j].label == VOCC_BOUNDARY ||
                leaves[j].region == leaf->region ||
                !share_a_face(leaf, &leaves[j]))
                continue;
            test_fail(__FILE__, __LINE__,
                      "leaves %zu and %zu share a face and have regions %d "
                      "and %d",
                      i, j, (int)leaf->region, (int)leaves[j].region);
        }
    }
    test_compared(compared);
}

static void check_leaves(const shape *s, const vocc_build_options *build,
                         int detail)
{
    world w;
    size_t count;
    world_make(&w, s, build);
    vocc_leaf *leaves = leaves_of(&w, &count);
    check_tiling(&w, leaves, count);
    check_empty_leaves(&w, leaves, count);
    if (!detail)
        check_references(&w, s, leaves, count);
    free(leaves);
    world_free(&w);
}

static void leaves(void)
{
    for (size_t i = 0; i < shape_count(); i++) {
        shape s;
        test_context(shape_name(i));
        shape_make(&s, i, 0);
        vocc_build_options options;
        vocc_build_options_init(&options);
        options.threads = 1;
        check_leaves(&s, &options, 0);
        /* As deep as it goes, and hardly split. */
        options.max_leaf_size = 1;
        options.max_depth = 24;
        options.bad_refines = 4;
        options.intersection_cost = 4.0f;
        check_leaves(&s, &options, 0);
        options.max_leaf_size = 4;
        options.max_depth = 3;
        check_leaves(&s, &options, 0);
        shape_free(&s);
        if (test_is_sanitized())
            continue;
        shape_make(&s, i, 1);
        check_leaves(&s, NULL, 1);
        shape_free(&s);
    }
}

/* "The tree does not depend on threads." */
static void same_tree_for_any_threads(void)
{
    for (size_t i = 0; i < shape_count(); i++) {
        shape s;
        test_context(shape_name(i));
        shape_make(&s, i, !test_is_sanitized());
        vocc_leaf *first = NULL;
        size_t first_count = 0;
        for (int threads = 1; threads < 4; threads++) {
            vocc_build_options options;
            world w;
            size_t count;
            vocc_build_options_init(&options);
            options.threads = threads;
            world_make(&w, &s, &options);
            vocc_leaf *these = leaves_of(&w, &count);
            if (threads == 1) {
                first = these;
                first_count = count;
            } else {
                CHECK_INT(count, first_count);
                if (count == first_count)
                    for (size_t k = 0; k < count; k++)
                        if (memcmp(&these[k], &first[k], sizeof(*these)) != 0) {
                            test_fail(__FILE__, __LINE__,
                                      "leaf %zu differs with %d threads", k,
                                      threads);
                            break;
                        }
                test_compared(count);
                free(these);
            }
            world_free(&w);
        }
        free(first);
        shape_free(&s);
    }
}

const test_case test_region_cases[] = {
    {"region.winding_numbers", winding_numbers},
    {"region.points_that_are_none", points_that_are_none},
    {"region.nested_numbers", nested_numbers},
    {"region.leaves", leaves},
    {"region.same_tree_for_any_threads", same_tree_for_any_threads},
    {NULL, NULL},
};
