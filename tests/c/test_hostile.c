/* Guards against hostile meshes: building stays within memory that grows with
 * the number of triangles alone, the tree's depth is bounded, and answers are
 * still those of the definition. */
#include "world.h"

#include <float.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "test.h"

/* The most that a triangle may cost while its tree is built, and the fixed
 * part. */
#define BYTES_A_TRIANGLE 1024
#define BYTES_FIXED ((size_t)1 << 20)

static void one_mesh(shape *s, const char *name)
{
    memset(s, 0, sizeof(*s));
    s->name = name;
    s->part_count = 1;
    s->parts[0].occluder = 1;
    mesh_init(&s->parts[0].m);
    for (int k = 0; k < 3; k++)
        s->outside[k] = 2.0;
}

/* Builds, holds the limits, and compares a sample of rays with the oracle. */
static void check_hostile(shape *s, size_t rays_each)
{
    test_context(s->name);
    for (int threads = 1; threads < 3; threads++) {
        vocc_build_options options;
        world w;
        vocc_build_options_init(&options);
        options.threads = threads;
        world_make(&w, s, &options);
        const size_t n = shape_triangles(s);
        const size_t limit = BYTES_FIXED + n * BYTES_A_TRIANGLE;
        const size_t peak = counting_peak_bytes(w.memory);
        if (peak > limit)
            test_fail(__FILE__, __LINE__,
                      "%zu triangles took %zu bytes, %zu each", n, peak,
                      peak / n);
        vocc_report r;
        r.size = sizeof(r);
        CHECK_INT(vocc_scene_report(w.scene, &r, NULL), VOCC_OK);
        CHECK(r.depth <= 60);
        CHECK(r.reference_count <= 32 * n + 1000);
        if (threads == 1)
            test_note("%s: %zu triangles, peak %zu bytes each, %.1f references "
                      "each, depth %d",
                      s->name, n, peak / n,
                      (double)r.reference_count / (double)n, (int)r.depth);
        ray_set set;
        rays_init(&set);
        rays_adversarial(&set, s, rays_each, 31);
        uint8_t *expected = malloc(set.count), *actual = malloc(set.count);
        REQUIRE(expected && actual);
        for (size_t i = 0; i < set.count; i++)
            expected[i] = oracle_occluded(&set.rays[i], s, 0) == ORACLE_HIT;
        for (int flags = 0; flags < 4; flags++) {
            mode m = mode_baseline();
            m.occluders = flags & 1;
            m.packets = flags >> 1;
            m.order = flags & 1 ? VOCC_ORDER_QDBFS : VOCC_ORDER_STANDARD;
            m.cache = 8;
            m.isa = VOCC_ISA_AUTO;
            trace(&w, &set, &m, actual, NULL);
            compare_answers(__FILE__, __LINE__, s->name, &set, &m, actual,
                            expected);
        }
        free(expected);
        free(actual);
        rays_free(&set);
        world_free(&w);
    }
    shape_free(s);
}

static void all_identical(void)
{
    shape s;
    one_mesh(&s, "identical triangles");
    mesh *m = &s.parts[0].m;
    mesh_vertex(m, 0, 0, 0);
    mesh_vertex(m, 1, 0, 0.25);
    mesh_vertex(m, 0, 1, 0.5);
    for (size_t i = 0; i < test_scaled(20000, 2000); i++)
        mesh_triangle(m, 0, 1, 2);
    check_hostile(&s, 1);

    one_mesh(&s, "identical boxes");
    for (size_t i = 0; i < test_scaled(1000, 100); i++) {
        const double lower[3] = {-1, -1, -1}, upper[3] = {1, 1, 1};
        add_box(&s.parts[0].m, 1, lower, upper);
    }
    check_hostile(&s, 1);
}

static void all_in_one_plane(void)
{
    test_random random = random_seed(8);
    shape s;
    one_mesh(&s, "overlapping in a plane");
    mesh *m = &s.parts[0].m;
    for (size_t i = 0; i < test_scaled(5000, 500); i++) {
        int32_t id[3];
        for (int k = 0; k < 3; k++)
            id[k] = mesh_vertex(m, floor(random_in(&random, 0, 64)) / 64, 0.5,
                                floor(random_in(&random, 0, 64)) / 64);
        mesh_triangle(m, id[0], id[1], id[2]);
    }
    check_hostile(&s, 1);

    one_mesh(&s, "grid in a plane");
    add_plane(&s.parts[0].m, (int)test_scaled(100, 30), 1.0, 0.25);
    check_hostile(&s, 2);

    one_mesh(&s, "all on one line");
    m = &s.parts[0].m;
    for (size_t i = 0; i < test_scaled(3000, 300); i++) {
        const double x = random_in(&random, -1, 1);
        const int32_t a = mesh_vertex(m, x, x, x);
        const int32_t b = mesh_vertex(m, 2 * x, 2 * x, 2 * x);
        mesh_triangle(m, a, b, a);
        mesh_triangle(m, 0, a, b);
    }
    check_hostile(&s, 2);
}

static void extents(void)
{
    static const struct {
        const char *name;
        double small, large;
    } sizes[] = {
        {"1e-38", 1e-38, 1e-38},
        {"denormal", 1e-44, 1e-43},
        {"1e30", 1e30, 1e30},
        {"as large as float32", 3.4e38, 3.4e38},
        {"1e-38 beside 1e30", 1e-38, 1e30},
        {"1 beside 1e30", 1.0, 1e30},
        {"denormal beside 1", 1e-44, 1.0},
    };
    for (size_t i = 0; i < sizeof(sizes) / sizeof(sizes[0]); i++) {
        shape s;
        one_mesh(&s, sizes[i].name);
        mesh *m = &s.parts[0].m;
        add_icosphere(m, 2, sizes[i].small, 0, 0, 0);
        const size_t first = m->vertex_count;
        add_icosphere(m, 2, 1.0, 0, 0, 0);
        mesh_move(m, first, 0.5 * sizes[i].large, 0.25 * sizes[i].large, 0, 0);
        for (int k = 0; k < 3; k++)
            s.inside[k] = 0.0;
        s.solid = 1;
        check_hostile(&s, test_scaled(8, 4));
    }
}

static void soup(void)
{
    /* Long triangles all over: the worst for any tree. */
    test_random random = random_seed(9);
    shape s;
    one_mesh(&s, "long soup");
    mesh *m = &s.parts[0].m;
    for (size_t i = 0; i < test_scaled(3000, 300); i++) {
        int32_t id[3];
        for (int k = 0; k < 3; k++)
            id[k] = mesh_vertex(m, random_in(&random, -1, 1),
                                random_in(&random, -1, 1),
                                random_in(&random, -1, 1));
        mesh_triangle(m, id[0], id[1], id[2]);
    }
    check_hostile(&s, 2);

    one_mesh(&s, "magnitude soup");
    m = &s.parts[0].m;
    for (size_t i = 0; i < test_scaled(2000, 200); i++) {
        int32_t id[3];
        for (int k = 0; k < 3; k++) {
            double p[3];
            for (int c = 0; c < 3; c++)
                p[c] = ldexp(random_in(&random, -1, 1),
                             (int)random_below(&random, 270) - 145);
            id[k] = mesh_vertex(m, p[0], p[1], p[2]);
        }
        mesh_triangle(m, id[0], id[1], id[2]);
    }
    check_hostile(&s, 4);
}

static void slivers(void)
{
    shape s;
    one_mesh(&s, "fan");
    add_fan(&s.parts[0].m, (int)test_scaled(20000, 1000));
    check_hostile(&s, 2);

    /* Needles through everything, side by side. */
    one_mesh(&s, "needles");
    mesh *m = &s.parts[0].m;
    test_random random = random_seed(10);
    for (size_t i = 0; i < test_scaled(5000, 300); i++) {
        const double x = random_in(&random, -1, 1),
                     y = random_in(&random, -1, 1);
        const int32_t a = mesh_vertex(m, x, y, -1);
        const int32_t b = mesh_vertex(m, x + 1e-5, y, -1);
        const int32_t c = mesh_vertex(m, -y, x, 1);
        mesh_triangle(m, a, b, c);
    }
    check_hostile(&s, 2);
}

/* Deep and greedy options do not break the bounds either. */
static void greedy_options(void)
{
    shape s;
    world w;
    shape_make(&s, 4, 1);
    vocc_build_options options;
    vocc_build_options_init(&options);
    options.max_depth = 60;
    options.max_leaf_size = 1;
    options.bad_refines = 16;
    options.traversal_cost = 1e-5f;
    options.intersection_cost = 1e5f;
    world_make(&w, &s, &options);
    vocc_report r;
    r.size = sizeof(r);
    CHECK_INT(vocc_scene_report(w.scene, &r, NULL), VOCC_OK);
    CHECK(r.depth <= 60);
    CHECK(counting_peak_bytes(w.memory) <
          BYTES_FIXED + 16 * BYTES_A_TRIANGLE * shape_triangles(&s));
    world_free(&w);
    shape_free(&s);
}

const test_case test_hostile_cases[] = {
    {"hostile.all_identical", all_identical},
    {"hostile.all_in_one_plane", all_in_one_plane},
    {"hostile.extents", extents},
    {"hostile.soup", soup},
    {"hostile.slivers", slivers},
    {"hostile.greedy_options", greedy_options},
    {NULL, NULL},
};
