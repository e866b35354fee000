/* Guards the tests' own tools: an oracle, an allocator or a generator that is
 * wrong would make the other tests worthless. */
#include "topology.h"
#include "world.h"

#include <float.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "test.h"

/* ---- the oracle against plain 64-bit integers --------------------------- */

static int64_t determinant(const int64_t a[3], const int64_t b[3],
                           const int64_t c[3])
{
    return a[0] * (b[1] * c[2] - b[2] * c[1]) +
           a[1] * (b[2] * c[0] - b[0] * c[2]) +
           a[2] * (b[0] * c[1] - b[1] * c[0]);
}

static int hit_of_integers(const int64_t d[3], const int64_t a[3],
                           const int64_t b[3], const int64_t c[3], int64_t tmin,
                           int64_t tmax)
{
    const int64_t u = determinant(d, b, c), v = determinant(d, c, a),
                  w = determinant(d, a, b), det = u + v + w;
    if (!((u >= 0 && v >= 0 && w >= 0) || (u <= 0 && v <= 0 && w <= 0)) ||
        det == 0)
        return 0;
    const int64_t num = determinant(a, b, c), sign = det > 0 ? 1 : -1;
    return sign * num > sign * tmin * det && sign * num < sign * tmax * det;
}

static void oracle_on_integers(void)
{
    test_random random = random_seed(1);
    const size_t count = test_scaled(200000, 2000);
    size_t hits = 0, unsure = 0;
    for (size_t i = 0; i < count; i++) {
        const uint32_t range = i & 1 ? 5 : 2001;
        /* The whole picture scaled by powers of two must not change it. */
        const int space = (int)random_below(&random, 160) - 100;
        const int way = (int)random_below(&random, 160) - 100;
        int64_t d[3], o[3], corner[3][3], moved[3][3];
        oracle_ray ray;
        float p[3][3];
        for (int k = 0; k < 3; k++) {
            d[k] = (int64_t)random_below(&random, range) - range / 2;
            o[k] = (int64_t)random_below(&random, range) - range / 2;
            ray.dir[k] = (float)ldexp((double)d[k], way);
            ray.org[k] = (float)ldexp((double)o[k], space);
            for (int j = 0; j < 3; j++) {
                corner[j][k] =
                    (int64_t)random_below(&random, range) - range / 2;
                moved[j][k] = corner[j][k] - o[k];
                p[j][k] = (float)ldexp((double)corner[j][k], space);
            }
        }
        const int64_t tmin = (int64_t)random_below(&random, 3) - 1;
        const int64_t tmax = tmin + 1 + (int64_t)random_below(&random, 3);
        if (space - way > 120 || space - way < -120)
            continue;
        ray.tmin = (float)ldexp((double)tmin, space - way);
        ray.tmax = (float)ldexp((double)tmax, space - way);
        const int expected =
            hit_of_integers(d, moved[0], moved[1], moved[2], tmin, tmax);
        const oracle_answer exact = oracle_exact(&ray, p[0], p[1], p[2]);
        const oracle_answer filter = oracle_filter(&ray, p[0], p[1], p[2]);
        CHECK_INT(exact, expected ? ORACLE_HIT : ORACLE_MISS);
        if (filter != ORACLE_UNSURE)
            CHECK_INT(filter, expected ? ORACLE_HIT : ORACLE_MISS);
        unsure += filter == ORACLE_UNSURE;
        hits += (size_t)expected;
    }
    CHECK(hits > count / 200);
    CHECK(unsure > count / 100 && unsure < count);
    test_compared(count);
}

static void oracle_rounds_t(void)
{
    /* The plane z = 1 met at t = 1 / dz: all quotients of small integers. */
    const float a[3] = {-9, -9, 1}, b[3] = {9, -9, 1}, c[3] = {0, 9, 1};
    for (int i = 1; i < 2000; i++) {
        const oracle_ray ray = {{0, 0, 0}, {0, 0, (float)i}, 0.0f, HUGE_VALF};
        oracle_hit hit;
        REQUIRE(oracle_triangle(&ray, a, b, c, &hit));
        CHECK_NEAR(hit.t, (float)(1.0 / i), 0);
        CHECK_NEAR(hit.u, 0.25, 1e-15);
        CHECK_NEAR(hit.v, 0.5, 1e-15);
    }
    /* A denormal t, and one that is too large for float32. */
    const oracle_ray tiny = {{0, 0, 0}, {0, 0, FLT_MAX}, 0.0f, HUGE_VALF};
    const float near[3][3] = {
        {-1, -1, 0x1p-20f}, {1, -1, 0x1p-20f}, {0, 1, 0x1p-20f}};
    oracle_hit hit;
    REQUIRE(oracle_triangle(&tiny, near[0], near[1], near[2], &hit));
    CHECK_NEAR(hit.t, 0x1p-148f, 0);
    const oracle_ray far = {{0, 0, 0}, {0, 0, 0x1p-149f}, 0.0f, HUGE_VALF};
    REQUIRE(oracle_triangle(&far, a, b, c, &hit));
    CHECK(isinf(hit.t));
    test_compared(2001);
}

static void oracle_limits(void)
{
    const float a[3] = {-9, -9, 1}, b[3] = {9, -9, 1}, c[3] = {0, 9, 1};
    static const struct {
        float tmin, tmax;
        int hit;
    } cases[] = {
        {0.0f, 1.0f, 0},
        {1.0f, 2.0f, 0},
        {0.0f, 1.0000001f, 1},
        {0.99999994f, 2.0f, 1},
        {-HUGE_VALF, HUGE_VALF, 1},
        {-HUGE_VALF, 1.0f, 0},
        {1.0f, HUGE_VALF, 0},
        {-3.0f, -1.0f, 0},
        {0.0f, HUGE_VALF, 1},
        {0.5f, FLT_MAX, 1},
    };
    for (size_t i = 0; i < sizeof(cases) / sizeof(cases[0]); i++) {
        const oracle_ray ray = {
            {0, 0, 0}, {0, 0, 1}, cases[i].tmin, cases[i].tmax};
        CHECK_INT(oracle_exact(&ray, a, b, c), cases[i].hit);
        /* and from the back */
        CHECK_INT(oracle_exact(&ray, a, c, b), cases[i].hit);
    }
    /* Edge-on, and without area. */
    const oracle_ray flat = {{-20, 0, 1}, {1, 0, 0}, 0.0f, HUGE_VALF};
    CHECK_INT(oracle_exact(&flat, a, b, c), ORACLE_MISS);
    const oracle_ray through = {{-9, -9, 0}, {0, 0, 1}, 0.0f, HUGE_VALF};
    CHECK_INT(oracle_exact(&through, a, b, c), ORACLE_HIT);
    CHECK_INT(oracle_exact(&through, a, a, c), ORACLE_MISS);
    CHECK_INT(oracle_exact(&through, a, a, a), ORACLE_MISS);
}

static void oracle_windings(void)
{
    for (size_t i = 0; i < shape_count(); i++) {
        shape s;
        shape_make(&s, i, 0);
        if (s.solid) {
            float inside[3], outside[3];
            int total_inside = 0, odd = 0;
            for (int k = 0; k < 3; k++) {
                inside[k] = (float)s.inside[k];
                outside[k] = (float)s.outside[k];
            }
            for (int p = 0; p < s.part_count; p++) {
                topology t;
                topology_make(&t, &s.parts[p].m);
                for (size_t c = 0; c < t.component_count; c++) {
                    int winding, parity;
                    const component *part = &t.components[c];
                    if (!part->closed)
                        continue;
                    CHECK_INT(
                        oracle_winding(outside, &s.parts[p].m, part->triangles,
                                       part->triangle_count, &winding, &parity),
                        0);
                    CHECK_INT(parity, 0);
                    if (part->consistent)
                        CHECK_INT(winding, 0);
                    CHECK_INT(
                        oracle_winding(inside, &s.parts[p].m, part->triangles,
                                       part->triangle_count, &winding, &parity),
                        0);
                    total_inside += part->consistent && winding != 0;
                    odd += parity;
                }
                topology_free(&t);
            }
            if (total_inside + odd == 0)
                test_fail(__FILE__, __LINE__,
                          "%s: the point is inside of nothing", s.name);
        }
        shape_free(&s);
    }
    const float corner[3] = {0.75f, 0.75f, 0.75f}, centre[3] = {0, 0, 0};
    shape s;
    shape_make(&s, 7, 0);
    CHECK_STRING(s.name, "inverted cube");
    topology t;
    int winding, parity;
    topology_make(&t, &s.parts[0].m);
    CHECK_INT(t.component_count, 1);
    CHECK_INT(oracle_winding(corner, &s.parts[0].m, t.components[0].triangles,
                             t.components[0].triangle_count, &winding, &parity),
              1);
    CHECK_INT(oracle_winding(centre, &s.parts[0].m, t.components[0].triangles,
                             t.components[0].triangle_count, &winding, &parity),
              0);
    CHECK_INT(winding, -1);
    topology_free(&t);
    shape_free(&s);
}

/* ---- shapes ------------------------------------------------------------ */

static void shapes_are_valid(void)
{
    for (size_t i = 0; i < shape_count(); i++) {
        for (int detail = 0; detail < 2; detail++) {
            shape s;
            shape_make(&s, i, detail);
            CHECK(s.part_count > 0 && s.part_count <= SHAPE_MAX_PARTS);
            CHECK(shape_triangles(&s) > 0);
            CHECK(detail || shape_triangles(&s) <= 700);
            for (int p = 0; p < s.part_count; p++) {
                const mesh *m = &s.parts[p].m;
                for (size_t k = 0; k < 3 * m->triangle_count; k++)
                    REQUIRE(m->triangles[k] >= 0 &&
                            (size_t)m->triangles[k] < m->vertex_count);
                for (size_t k = 0; k < 3 * m->vertex_count; k++)
                    REQUIRE(isfinite(m->vertices[k]));
            }
            shape_free(&s);
        }
    }
}

/* Six times the signed volume: positive where normals point outward. */
static double orientation(const mesh *m)
{
    double sum = 0.0;
    for (size_t t = 0; t < m->triangle_count; t++) {
        const float *a = mesh_corner(m, t, 0), *b = mesh_corner(m, t, 1),
                    *c = mesh_corner(m, t, 2);
        for (int k = 0; k < 3; k++) {
            const int i = (k + 1) % 3, j = (k + 2) % 3;
            sum += (double)a[k] *
                   ((double)b[i] * (double)c[j] - (double)b[j] * (double)c[i]);
        }
    }
    return sum;
}

static void generators_face_outward(void)
{
    const double lower[3] = {-0.5, -1, 0}, upper[3] = {0.5, 1, 3};
    mesh m[6];
    for (int i = 0; i < 6; i++)
        mesh_init(&m[i]);
    add_icosphere(&m[0], 3, 1.0, 2, 0, 0);
    add_box(&m[1], 3, lower, upper);
    add_knot(&m[2], 2, 3, 100, 12, 0.1);
    add_voxel_ball(&m[3], 6, 1.0);
    add_fan(&m[4], 50);
    add_plane(&m[5], 3, 1.0, 2.0);
    CHECK_NEAR(orientation(&m[0]) / 6.0, 4.188, 0.1);
    CHECK_NEAR(orientation(&m[1]) / 6.0, 6.0, 1e-9);
    CHECK(orientation(&m[2]) > 0.1);
    CHECK(orientation(&m[3]) / 6.0 > 3.0);
    CHECK_NEAR(orientation(&m[4]) / 6.0, 2.09, 0.01);
    /* up, seen from below: away from the origin */
    CHECK_NEAR(orientation(&m[5]) / 6.0, 8.0 / 3.0, 1e-6);
    for (int i = 0; i < 6; i++)
        mesh_free(&m[i]);
}

static void rays_are_of_their_kind(void)
{
    shape s;
    ray_set set;
    shape_make(&s, 0, 0);
    rays_init(&set);
    rays_adversarial(&set, &s, 100, 5);
    size_t seen[RAY_KINDS] = {0}, hits[RAY_KINDS] = {0};
    for (size_t i = 0; i < set.count; i++) {
        seen[set.kinds[i]]++;
        hits[set.kinds[i]] +=
            oracle_occluded(&set.rays[i], &s, 0) == ORACLE_HIT;
        if (set.kinds[i] == RAY_NOTHING)
            CHECK(!oracle_ray_is_valid(&set.rays[i]));
    }
    for (int kind = 0; kind < RAY_KINDS; kind++) {
        if (seen[kind] < 50)
            test_fail(__FILE__, __LINE__, "only %zu rays: %s", seen[kind],
                      ray_kind_name(kind));
        /* Both answers occur, unless the kind says which. */
        const int never = kind == RAY_NOTHING || kind == RAY_BOTH_INSIDE;
        const int always = kind == RAY_END_INSIDE;
        if ((hits[kind] == 0 && !never) ||
            (hits[kind] == seen[kind] && !always))
            test_fail(__FILE__, __LINE__, "%zu of %zu rays hit: %s", hits[kind],
                      seen[kind], ray_kind_name(kind));
    }
    CHECK_INT(hits[RAY_NOTHING], 0);
    rays_free(&set);
    shape_free(&s);
}

/* ---- the allocator ----------------------------------------------------- */

static void allocator_counts(void)
{
    counting *memory = counting_create();
    const vocc_allocator a = counting_allocator(memory);
    void *blocks[500];
    for (size_t i = 0; i < 500; i++)
        blocks[i] = a.allocate(a.user, i);
    CHECK_INT(counting_live_blocks(memory), 500);
    CHECK_INT(counting_live_bytes(memory), 499 * 500 / 2);
    for (size_t i = 0; i < 500; i += 2)
        a.deallocate(a.user, blocks[i]);
    CHECK_INT(counting_live_blocks(memory), 250);
    /* A stale and a foreign pointer are refused, and counted. */
    a.deallocate(a.user, (char *)blocks[1] + 1);
    CHECK_INT(counting_faults(memory), 1);
    for (size_t i = 1; i < 500; i += 2)
        a.deallocate(a.user, blocks[i]);
    CHECK_INT(counting_live_bytes(memory), 0);
    CHECK_INT(counting_peak_bytes(memory), 499 * 500 / 2);
    CHECK_INT(counting_calls(memory), 500);
    CHECK_INT(counting_faults(memory), 1);

    counting_fail(memory, 3, 0);
    for (int i = 1; i <= 5; i++) {
        void *block = a.allocate(a.user, 8);
        CHECK((block == NULL) == (i == 3));
        if (block)
            a.deallocate(a.user, block);
    }
    CHECK_INT(counting_failed(memory), 1);
    counting_fail(memory, 2, 1);
    for (int i = 1; i <= 5; i++) {
        void *block = a.allocate(a.user, 8);
        CHECK((block == NULL) == (i >= 2));
        if (block)
            a.deallocate(a.user, block);
    }
    counting_fail(memory, 0, 0);
    void *block = a.allocate(a.user, 8);
    CHECK(block != NULL);
    a.deallocate(a.user, block);
    CHECK_INT(counting_failed(memory), 0);
    CHECK_INT(counting_live_blocks(memory), 0);
    counting_forgive(memory);
    counting_free(memory);
}

const test_case test_tools_cases[] = {
    {"tools.oracle_on_integers", oracle_on_integers},
    {"tools.oracle_rounds_t", oracle_rounds_t},
    {"tools.oracle_limits", oracle_limits},
    {"tools.oracle_windings", oracle_windings},
    {"tools.shapes_are_valid", shapes_are_valid},
    {"tools.generators_face_outward", generators_face_outward},
    {"tools.rays_are_of_their_kind", rays_are_of_their_kind},
    {"tools.allocator_counts", allocator_counts},
    {NULL, NULL},
};
