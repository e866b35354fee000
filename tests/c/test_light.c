/* Guards light_visibility: the counts are those of the documented shadow rays,
 * traced one by one with the baseline, for lights outside of, inside of and
 * cutting the meshes, with all options; and the sampler is the documented one
 * to the last bit. */
#include "../../csrc/scene.h"
#include "receivers.h"
#include "world.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "test.h"

/* ---- the sampler, as documented ---------------------------------------- */

static uint32_t hash32(uint32_t x)
{
    x ^= x >> 16;
    x *= UINT32_C(0x7feb352d);
    x ^= x >> 15;
    x *= UINT32_C(0x846ca68b);
    x ^= x >> 16;
    return x;
}

/* One rounding an operation: volatile keeps a compiler from contracting. */
static float rounded(float x)
{
    volatile float y = x;
    return y;
}

static void sample_point(const vocc_light *light, uint32_t point_id,
                         uint32_t number, uint32_t sample, uint32_t samples,
                         float out[3])
{
    uint32_t nv = (uint32_t)sqrt((double)samples);
    while (samples % nv)
        nv--;
    const uint32_t nu = samples / nv;
    const uint32_t h = hash32(point_id * 2048u + number * 256u + sample);
    const float j1 = (float)(h & 0xffffu) * (1.0f / 65536.0f);
    const float j2 = (float)(h >> 16) * (1.0f / 65536.0f);
    const float a =
        rounded(rounded((float)(sample % nu) + j1) * rounded(1.0f / (float)nu));
    const float b =
        rounded(rounded((float)(sample / nu) + j2) * rounded(1.0f / (float)nv));
    for (int k = 0; k < 3; k++) {
        const float first = rounded(a * (float)light->edge_u[k]);
        const float second = rounded(b * (float)light->edge_v[k]);
        out[k] = rounded(rounded((float)light->position[k] + first) + second);
    }
}

/* ---- the reference ----------------------------------------------------- */

static int is_lit(const receivers *r, size_t i, const vocc_light *light)
{
    double sum = 0.0;
    for (size_t k = 0; k < 3; k++) {
        const double centre = light->position[k] + 0.5 * light->edge_u[k] +
                              0.5 * light->edge_v[k];
        if (!isfinite(r->points[3 * i + k]))
            return 0;
        sum += (double)r->normals[3 * i + k] *
               (centre - (double)r->points[3 * i + k]);
    }
    return sum > 0.0;
}

static void expected_counts(const world *w, const receivers *r,
                            size_t light_count, const vocc_light *lights,
                            uint32_t samples, uint16_t *visible)
{
    ray_set set;
    rays_init(&set);
    for (size_t l = 0; l < light_count; l++) {
        for (size_t i = 0; i < r->count; i++) {
            visible[l * r->count + i] = VOCC_NOT_TRACED;
            if (!is_lit(r, i, &lights[l]))
                continue;
            visible[l * r->count + i] = 0;
            for (uint32_t k = 0; k < samples; k++) {
                float to[3], dir[3];
                const uint32_t id = r->ids ? r->ids[i] : (uint32_t)i;
                sample_point(&lights[l], id, (uint32_t)l, k, samples, to);
                for (size_t c = 0; c < 3; c++)
                    dir[c] = rounded(to[c] - r->points[3 * i + c]);
                rays_add(&set, RAY_COHERENT, r->points + 3 * i, dir, 0.0f,
                         1.0f);
            }
        }
    }
    uint8_t *occluded = malloc(set.count + 1);
    REQUIRE(occluded);
    const mode baseline = mode_baseline();
    trace(w, &set, &baseline, occluded, NULL);
    size_t at = 0;
    for (size_t i = 0; i < light_count * r->count; i++) {
        if (visible[i] == VOCC_NOT_TRACED)
            continue;
        for (uint32_t k = 0; k < samples; k++)
            visible[i] = (uint16_t)(visible[i] + !occluded[at++]);
    }
    test_compared(set.count);
    free(occluded);
    rays_free(&set);
}

/* Ways of tracing rays, then beams on each instruction set. */
enum { RAY_WAYS = 12 };

/* Coordinates that beams leave to rays. */
static int is_beyond_beams(double scale)
{
    return scale < 0x1p-29 || scale > 0x1p24;
}

static vocc_status query(const world *w, const receivers *r, size_t light_count,
                         const vocc_light *lights, int32_t samples,
                         uint16_t *visible, const vocc_query_options *options,
                         vocc_error *error)
{
    vocc_array ids = rows_of(r->ids, sizeof(uint32_t), VOCC_UINT32);
    return vocc_light_visibility(
        w->scene, r->count, rows_of(r->points, 12, VOCC_FLOAT32),
        rows_of(r->normals, 12, VOCC_FLOAT32), ids, light_count, lights,
        SAMPLING(samples), visible, NULL, NULL, options, error);
}

static void compare_counts(int line, const char *what, const receivers *r,
                           size_t light_count, const uint16_t *actual,
                           const uint16_t *expected)
{
    for (size_t i = 0; i < light_count * r->count; i++) {
        if (actual[i] == expected[i])
            continue;
        const float *p = r->points + 3 * (i % r->count);
        test_fail(__FILE__, line,
                  "%s: light %zu, point %zu (%a, %a, %a): %d samples, not %d",
                  what, i / r->count, i % r->count, (double)p[0], (double)p[1],
                  (double)p[2], actual[i], expected[i]);
        return;
    }
}

static const vocc_light lights[] = {
    RECT(-0.5, 3, -0.5, 1, 0, 0, 0, 0, 1),
    RECT(1.75, 1.25, 2.25, 0.5, 0, -0.5, 0, 0.5, 0),
    RECT(-2.25, 1.75, 1.75, 0.5, 0, 0.5, 0, 0.5, 0),
    /* inside */
    RECT(-0.125, 0.0625, -0.0625, 0.125, 0, 0, 0, 0.0625, 0.0625),
    /* cutting through everything */
    RECT(-2, -2, 0.03125, 4, 0, 0, 0, 4, 0),
    /* a segment and a point */
    RECT(-1, 2, 0, 2, 0, 0, 0, 0, 0),
    RECT(0.25, 0.75, 2, 0, 0, 0, 0, 0, 0),
    /* in the plane of a box's side, and touching its corner */
    RECT(0.75, -0.75, -0.75, 0, 1.5, 0, 0, 0, 1.5),
    /* slanted: its bounds hold most of the mesh, itself it is outside */
    RECT(-2, -2.75, -1, 4, 0, 0, 0, 4, 4),
};
#define LIGHTS (sizeof(lights) / sizeof(lights[0]))

static void all_options(void)
{
    static const int caches[] = {0, 8, -1}, deferments[] = {0, 16, -1},
                     threads[] = {1, -1};
    static const int32_t counts[] = {1, 2, 7, 16, 20};
    mode_list modes = modes_of(caches, deferments, threads);
    for (size_t i = 0; i < shape_count(); i++) {
        shape s;
        world w;
        receivers r;
        test_context(shape_name(i));
        shape_make(&s, i, 1);
        world_make(&w, &s, NULL);
        receivers_make(&r, &s, test_scaled(256, 64));
        const int32_t samples = counts[i % 5];
        uint16_t *expected = malloc(LIGHTS * r.count * sizeof(*expected));
        uint16_t *actual = malloc(LIGHTS * r.count * sizeof(*actual));
        REQUIRE(expected && actual);
        expected_counts(&w, &r, LIGHTS, lights, (uint32_t)samples, expected);
        for (size_t k = 0; k < modes.count; k++) {
            /* Each shape takes a share of the modes, all get the default. */
            if (k && ((k + i) % 4 || !test_share((k + i) / 4)))
                continue;
            vocc_query_options options;
            vocc_error error;
            mode_options(&modes.modes[k], &options);
            memset(actual, 0x55, LIGHTS * r.count * sizeof(*actual));
            CHECK_STATUS(query(&w, &r, LIGHTS, lights, samples, actual,
                               k ? &options : NULL, &error),
                         &error, VOCC_OK);
            compare_counts(__LINE__, mode_text(&modes.modes[k]), &r, LIGHTS,
                           actual, expected);
            test_compared(LIGHTS * r.count);
        }
        free(expected);
        free(actual);
        receivers_free(&r);
        world_free(&w);
        shape_free(&s);
    }
    modes_free(&modes);
}

/* More points than a thread takes at once; their own ids; counters. */
static void threads(void)
{
    shape s;
    world w;
    receivers r;
    shape_make(&s, 12, 1);
    world_make(&w, &s, NULL);
    receivers_make(&r, &s, test_scaled(6000, 600));
    r.ids = malloc(r.count * sizeof(uint32_t));
    REQUIRE(r.ids);
    for (size_t i = 0; i < r.count; i++)
        r.ids[i] = hash32((uint32_t)i); /* wraps in the key */
    uint16_t *expected = malloc(3 * r.count * sizeof(*expected));
    uint16_t *actual = malloc(3 * r.count * sizeof(*actual));
    REQUIRE(expected && actual);
    expected_counts(&w, &r, 3, lights, 5, expected);
    vocc_counters first;
    for (int n = 1; n < 5; n++) {
        vocc_query_options options;
        vocc_error error;
        vocc_counters counters;
        memset(&counters, 0, sizeof(counters));
        vocc_query_options_init(&options);
        options.threads = n;
        options.counters = &counters;
        CHECK_STATUS(query(&w, &r, 3, lights, 5, actual, &options, &error),
                     &error, VOCC_OK);
        compare_counts(__LINE__, "threads", &r, 3, actual, expected);
        uint64_t traced = 0, seen = 0;
        for (size_t i = 0; i < 3 * r.count; i++) {
            traced += actual[i] == VOCC_NOT_TRACED ? 0 : 5;
            seen += actual[i] == VOCC_NOT_TRACED ? 0 : actual[i];
        }
        CHECK_INT(counters.rays, traced);
        CHECK_INT(counters.occluded, traced - seen);
        if (n == 1)
            first = counters;
        else
            CHECK(memcmp(&first, &counters, sizeof(counters)) == 0);
    }
    free(expected);
    free(actual);
    receivers_free(&r);
    world_free(&w);
    shape_free(&s);
}

/* Nothing in the way: all samples, whatever their number. */
static void sample_numbers(void)
{
    shape s;
    world w;
    shape_make(&s, 0, 0);
    world_make(&w, &s, NULL);
    float point[6] = {1.5f, 0.25f, 0, 0.25f, 1.5f, 0.125f};
    float normal[6] = {1, 0, 0, 0, 1, 0};
    const receivers r = {2, point, normal, NULL};
    static const int32_t numbers[] = {1,  2,  3,   4,   5,    12,
                                      97, 99, 100, 360, 4096, 65534};
    for (size_t i = 0; i < sizeof(numbers) / sizeof(numbers[0]); i++) {
        const vocc_light light = RECT(4, -1, -1, 0, 2, 0, 0, 0, 2);
        uint16_t visible[2] = {0, 0}, expected[2];
        vocc_error error;
        CHECK_STATUS(
            query(&w, &r, 1, &light, numbers[i], visible, NULL, &error), &error,
            VOCC_OK);
        expected_counts(&w, &r, 1, &light, (uint32_t)numbers[i], expected);
        CHECK_INT(visible[0], numbers[i]);
        CHECK_INT(visible[0], expected[0]);
        CHECK_INT(visible[1], expected[1]);
    }
    world_free(&w);
    shape_free(&s);
}

static void neighbours(void)
{
    static const struct {
        double spread, off, scale;
    } kinds[] = {{0.3, 1e-4, 1.0},   {1e-3, 1e-4, 1.0}, {2.0, 1e-2, 1.0},
                 {0.3, 1e-4, 1e-12}, {0.3, 1e-4, 1e7},  {0.3, 1e-4, 1e20}};
    /* Many samples: fans. */
    static const int32_t many[] = {24, 100, 256, 49, 300};
    vocc_counters sum;
    memset(&sum, 0, sizeof(sum));
    for (size_t i = 0; i < shape_count(); i++)
        for (size_t kind = 0; kind < sizeof(kinds) / sizeof(kinds[0]); kind++) {
            const double scale = kinds[kind].scale;
            shape s;
            world w;
            receivers r;
            vocc_light moved[LIGHTS];
            const int32_t samples =
                (i + kind) % 2 ? 4 : many[(i + kind) / 2 % 5];
            if ((kind > 1 || !test_share(1)) && kind % 3 != i % 3)
                continue;
            test_context(shape_name(i));
            shape_make(&s, i, 1);
            receivers_make_patches(&r, &s,
                                   samples > 4 ? test_scaled(200, 70)
                                               : test_scaled(1200, 200),
                                   kinds[kind].spread, kinds[kind].off);
            for (int p = 0; p < s.part_count; p++)
                mesh_move(&s.parts[p].m, 0, scale, 0, 0, 0);
            for (size_t k = 0; k < 3 * r.count; k++)
                r.points[k] = (float)((double)r.points[k] * scale);
            memcpy(moved, lights, sizeof(moved));
            for (size_t l = 0; l < LIGHTS; l++)
                for (int k = 0; k < 3; k++) {
                    moved[l].position[k] =
                        (double)(float)(lights[l].position[k] * scale);
                    moved[l].edge_u[k] =
                        (double)(float)(lights[l].edge_u[k] * scale);
                    moved[l].edge_v[k] =
                        (double)(float)(lights[l].edge_v[k] * scale);
                }
            world_make(&w, &s, NULL);
            const size_t values = LIGHTS * r.count;
            uint16_t *expected = malloc(values * sizeof(*expected));
            uint16_t *actual = malloc(values * sizeof(*actual));
            uint32_t *steps = malloc(r.count * sizeof(*steps));
            REQUIRE(expected && actual && steps);
            expected_counts(&w, &r, LIGHTS, moved, (uint32_t)samples, expected);
            for (int way = 0; way < RAY_WAYS + VOCC_ISA_NEON; way++) {
                vocc_query_options options;
                vocc_counters counters;
                vocc_error error;
                if (!test_share(i + kind + (size_t)way))
                    continue;
                memset(&counters, 0, sizeof(counters));
                vocc_query_options_init(&options);
                options.order =
                    way % 2 ? VOCC_ORDER_OPAQUE_FIRST : VOCC_ORDER_STANDARD;
                options.entry_points = way % 3 != 2;
                options.voxels = way % 3 ? 1 << way : 0;
                options.voxels = options.voxels < 1024 ? options.voxels : 1024;
                options.entry_triangles = way * 5;
                options.occluders = way % 4 != 0;
                options.isa = way & 4 ? VOCC_ISA_SCALAR : VOCC_ISA_AUTO;
                options.packets = way != 5;
                options.threads = 1 + way % 3;
                options.counters = &counters;
                options.point_steps = way > 7 ? steps : NULL;
                options.method = VOCC_METHOD_RAYS;
                if (way >= RAY_WAYS) {
                    vocc_query_options_init(&options);
                    options.method = VOCC_METHOD_BEAMS;
                    options.isa = VOCC_ISA_SCALAR + way - RAY_WAYS;
                    if (!has_isa(options.isa))
                        continue;
                    options.threads = 1 + way % 3;
                    options.counters = &counters;
                    options.verify = way == RAY_WAYS ? 1 : 0;
                }
                CHECK_STATUS(query(&w, &r, LIGHTS, moved, samples, actual,
                                   &options, &error),
                             &error, VOCC_OK);
                compare_counts(__LINE__, way % 3 ? "voxels" : "entry points",
                               &r, LIGHTS, actual, expected);
                test_compared(values);
                uint64_t traced = 0, seen = 0, stepped = 0;
                for (size_t k = 0; k < values; k++) {
                    traced +=
                        actual[k] == VOCC_NOT_TRACED ? 0 : (uint64_t)samples;
                    seen += actual[k] == VOCC_NOT_TRACED ? 0 : actual[k];
                }
                for (size_t k = 0; options.point_steps && k < r.count; k++)
                    stepped += steps[k];
                CHECK_INT(counters.rays, traced);
                CHECK_INT(counters.occluded, traced - seen);
                if (options.point_steps)
                    CHECK_INT(counters.node_visits, stepped);
                if (!options.occluders)
                    CHECK_INT(
                        counters.entry_dark_rays + counters.voxel_dark_rays, 0);
                if (way >= RAY_WAYS)
                    CHECK(is_beyond_beams(scale) ||
                          counters.beam_lit_rays + counters.beam_dark_rays +
                                  counters.beam_hidden_rays +
                                  counters.beam_tested_rays ==
                              traced);
                if (!options.entry_points && !options.voxels)
                    CHECK_INT(counters.entry_searches, 0);
                if (samples > 4)
                    continue;
                sum.entry_searches += counters.entry_searches;
                sum.entry_lit_rays += counters.entry_lit_rays;
                sum.entry_dark_rays += counters.entry_dark_rays;
                sum.entry_few_rays += counters.entry_few_rays;
                sum.voxel_lit_rays += counters.voxel_lit_rays;
                sum.voxel_dark_rays += counters.voxel_dark_rays;
                sum.rays += counters.rays;
            }
            free(expected);
            free(actual);
            free(steps);
            receivers_free(&r);
            world_free(&w);
            shape_free(&s);
        }
    test_note(
        "of %g rays, searches settle %g lit and %g dark, voxels %g and %g",
        (double)sum.rays, (double)sum.entry_lit_rays,
        (double)sum.entry_dark_rays, (double)sum.voxel_lit_rays,
        (double)sum.voxel_dark_rays);
    CHECK(sum.entry_searches > 0);
    CHECK(sum.entry_lit_rays > sum.rays / 50);
    CHECK(sum.entry_dark_rays > sum.rays / 500);
    CHECK(sum.entry_few_rays > 0);
    CHECK(sum.voxel_lit_rays > sum.rays / 50);
    CHECK(sum.voxel_dark_rays > sum.rays / 500);
}

/* Everything in a bowl is beside every shaft in it: searches that see all of it
 * settle all, and may not take longer than tracing does. */
static void concave(void)
{
    enum { N = 120, COUNT = 2000 };
    shape s;
    world w;
    memset(&s, 0, sizeof(s));
    s.name = "bowl";
    s.part_count = 1;
    mesh_init(&s.parts[0].m);
    for (int i = 0; i <= N; i++)
        for (int j = 0; j <= N; j++) {
            const double x = 2.0 * i / N - 1.0, z = 2.0 * j / N - 1.0;
            mesh_vertex(&s.parts[0].m, x, 0.05 * (x * x + z * z), z);
        }
    for (int i = 0; i < N; i++)
        for (int j = 0; j < N; j++) {
            const int32_t a = i * (N + 1) + j, b = a + N + 1;
            mesh_triangle(&s.parts[0].m, a, a + 1, b);
            mesh_triangle(&s.parts[0].m, b, a + 1, b + 1);
        }
    world_make(&w, &s, NULL);
    float *points = malloc(3 * COUNT * sizeof(float));
    uint16_t *visible = malloc(COUNT * sizeof(*visible));
    REQUIRE(points && visible);
    test_random random = random_seed(99);
    for (size_t i = 0; i < COUNT; i++) {
        const double x = random_in(&random, -1, 1),
                     z = random_in(&random, -1, 1);
        points[3 * i] = (float)x;
        points[3 * i + 1] = (float)(0.05 * (x * x + z * z) + 1e-3);
        points[3 * i + 2] = (float)z;
    }
    float up[3] = {0, 1, 0};
    const vocc_light light = RECT(-0.1, 3, -0.1, 0.2, 0, 0, 0, 0, 0.2);
    for (int32_t samples = 1; samples <= 16; samples *= 4) {
        vocc_counters traced, searched;
        uint64_t rays = (uint64_t)samples * COUNT;
        for (int entry = 0; entry < 2; entry++) {
            vocc_query_options options;
            vocc_error error;
            vocc_counters *c = entry ? &searched : &traced;
            memset(c, 0, sizeof(*c));
            vocc_query_options_init(&options);
            options.entry_points = entry;
            options.counters = c;
            CHECK_STATUS(vocc_light_visibility(
                             w.scene, COUNT, rows_of(points, 12, VOCC_FLOAT32),
                             rows_of(up, 0, VOCC_FLOAT32),
                             rows_of(NULL, 0, VOCC_UINT32), 1, &light,
                             SAMPLING(samples), visible, NULL, NULL, &options,
                             &error),
                         &error, VOCC_OK);
            for (size_t i = 0; i < COUNT; i++)
                CHECK_INT(visible[i], samples);
        }
        CHECK_INT(searched.rays, rays);
        CHECK(searched.entry_steps + searched.entry_tests +
                  searched.node_visits <
              2 * traced.node_visits + 16 * rays + 100 * COUNT);
        test_compared(2 * COUNT);
    }
    free(points);
    free(visible);
    world_free(&w);
    mesh_free(&s.parts[0].m);
}

/* Exactly in the light's plane is not above it; float64 and strides. */
static void layouts(void)
{
    shape s;
    world w;
    shape_make(&s, 0, 0);
    world_make(&w, &s, NULL);
    const vocc_light light = RECT(-1, 2, -1, 2, 0, 0, 0, 0, 2);
    float point[9] = {0, 1.5f, 0, 0, 1.5f, 0, 0, 2, 0};
    float normal[9] = {0, 1, 0, 1, 0, 0, 0, 1, 0};
    const receivers r = {3, point, normal, NULL};
    uint16_t visible[3], again[3];
    vocc_error error;
    CHECK_STATUS(query(&w, &r, 1, &light, 9, visible, NULL, &error), &error,
                 VOCC_OK);
    CHECK_INT(visible[0], 9);
    CHECK_INT(visible[1], VOCC_NOT_TRACED);
    CHECK_INT(visible[2], VOCC_NOT_TRACED);

    double wide[18];
    for (int i = 0; i < 9; i++) {
        wide[i] = (double)point[8 - i / 3 * 3 - 2 + i % 3];
        wide[9 + i] = (double)normal[i];
    }
    vocc_array points = rows_of(wide + 6, 0, VOCC_FLOAT64);
    points.stride = -24;
    const uint32_t ids[3] = {2, 1, 0};
    vocc_array point_ids = rows_of(ids + 2, 0, VOCC_UINT32);
    point_ids.stride = -(ptrdiff_t)sizeof(uint32_t);
    CHECK_STATUS(vocc_light_visibility(w.scene, 3, points,
                                       rows_of(wide + 9, 24, VOCC_FLOAT64),
                                       point_ids, 1, &light, SAMPLING(9), again,
                                       NULL, NULL, NULL, &error),
                 &error, VOCC_OK);
    CHECK(memcmp(visible, again, sizeof(visible)) == 0);
    /* One normal for all. */
    CHECK_STATUS(vocc_light_visibility(w.scene, 3, points,
                                       rows_of(wide + 9, 0, VOCC_FLOAT64),
                                       point_ids, 1, &light, SAMPLING(9), again,
                                       NULL, NULL, NULL, &error),
                 &error, VOCC_OK);
    CHECK_INT(again[0], 9);
    CHECK_INT(again[1], 9);
    CHECK_INT(again[2], VOCC_NOT_TRACED);
    world_free(&w);
    shape_free(&s);
}

/* Where the order that AUTO stands for does without occluders in the kd-tree,
 * as in a town of houses of few triangles, beams still use them; if asked to.
 */
static void occluders_of_few_triangles(void)
{
    enum { SAMPLES = 4 };
    uint64_t decided = 0;
    for (size_t index = 0; index < shape_count(); index++) {
        shape s;
        world w;
        receivers r;
        shape_make(&s, index, 1);
        test_context(s.name);
        world_make(&w, &s, NULL);
        const vocc_report *report = &w.scene->built.report;
        if (report->auto_order == VOCC_ORDER_STANDARD &&
            report->opaque_leaves > 0) {
            uint64_t dark[3];
            receivers_make_patches(&r, &s, 500, 0.05, 0.001);
            const size_t values = LIGHTS * r.count;
            uint16_t *visible = malloc(values * sizeof(*visible));
            REQUIRE(visible);
            for (int way = 0; way < 3; way++) {
                vocc_query_options options;
                vocc_counters counters;
                vocc_error error;
                memset(&counters, 0, sizeof(counters));
                vocc_query_options_init(&options);
                options.method = VOCC_METHOD_BEAMS;
                options.threads = 1;
                options.counters = &counters;
                options.occluders = way < 2;
                if (way == 1)
                    options.order = VOCC_ORDER_OPAQUE_FIRST;
                CHECK_STATUS(query(&w, &r, LIGHTS, lights, SAMPLES, visible,
                                   &options, &error),
                             &error, VOCC_OK);
                dark[way] = counters.beam_dark_rays + counters.beam_box_rays;
            }
            CHECK_INT(dark[0], dark[1]);
            CHECK_INT(dark[2], 0);
            test_compared(values);
            decided += dark[0];
            free(visible);
            receivers_free(&r);
        }
        world_free(&w);
        shape_free(&s);
    }
    test_context(NULL);
    CHECK(decided > 100);
}

/* Triangles on a grid that hide lights on it from points on it: segments end
 * beyond a triangle, beside it and, where point, edge and corner of the light
 * are in line, in its edge. */
static void hidden_by_a_triangle(void)
{
    enum { TRIANGLES = 24, SIDE = 48, COUNT = SIDE * SIDE, SAMPLES = 9 };
    static const double steps[] = {1.0 / 16, 1.0 / 8, 1.0 / 4};
    uint16_t *expected = malloc(LIGHTS * COUNT * sizeof(*expected));
    uint16_t *actual = malloc(LIGHTS * COUNT * sizeof(*actual));
    float *points = malloc(3 * COUNT * sizeof(float));
    REQUIRE(expected && actual && points);
    test_random random = random_seed(77);
    float up[3] = {0, 1, 0};
    uint64_t hidden = 0, rays = 0;
    for (int round = 0; round < (int)test_scaled(24, 6); round++) {
        const double step = steps[round % 3];
        shape s;
        world w;
        vocc_light some[LIGHTS];
        memset(&s, 0, sizeof(s));
        s.name = "triangles";
        s.part_count = 1;
        mesh *const m = &s.parts[0].m;
        mesh_init(m);
        for (int i = 0; i < TRIANGLES; i++) {
            /* On a level, or not; large, or a few cells of the grid; some cut
             * a light, or are beyond it. */
            const double size = random_below(&random, 3) ? 1.5 : 0.25,
                         x = random_in(&random, -1.5, 1.5),
                         z = random_in(&random, -1.5, 1.5),
                         top = random_below(&random, 4) ? 1.5 : 4,
                         y = random_in(&random, 0.25, top);
            const int level = random_below(&random, 2) == 0;
            for (int k = 0; k < 3; k++)
                mesh_vertex(m, x + random_in(&random, -size, size),
                            level ? y : random_in(&random, 0.25, top),
                            z + random_in(&random, -size, size));
            mesh_triangle(m, 3 * i, 3 * i + 1, 3 * i + 2);
        }
        mesh_snap(m, step);
        for (size_t l = 0; l < LIGHTS; l++) {
            const double width = step * (double)(1 + random_below(&random, 4)),
                         length = l % 3 ? width : 0;
            some[l] = (vocc_light)RECT(0, 2 + (double)(l % 2), 0, width, 0, 0,
                                       0, 0, length);
            for (int k = 0; k < 3; k += 2)
                some[l].position[k] =
                    step * floor(random_in(&random, -2, 2) / step);
        }
        for (int i = 0; i < COUNT; i++) {
            points[3 * i] = (float)(step * (i % SIDE - SIDE / 2));
            points[3 * i + 1] = 0;
            points[3 * i + 2] = (float)(step * (i / SIDE - SIDE / 2));
        }
        world_make(&w, &s, NULL);
        const receivers r = {COUNT, points, NULL, NULL};
        for (int way = 0; way < 1 + VOCC_ISA_NEON; way++) {
            vocc_query_options options;
            vocc_counters counters;
            vocc_error error;
            if (way && !has_isa(way))
                continue;
            memset(&counters, 0, sizeof(counters));
            vocc_query_options_init(&options);
            options.method = way ? VOCC_METHOD_BEAMS : VOCC_METHOD_RAYS;
            options.occluders = 0;
            options.isa = way;
            options.threads = 1;
            options.counters = &counters;
            CHECK_STATUS(
                vocc_light_visibility(
                    w.scene, COUNT, rows_of(r.points, 12, VOCC_FLOAT32),
                    rows_of(up, 0, VOCC_FLOAT32), rows_of(NULL, 0, VOCC_UINT32),
                    LIGHTS, some, SAMPLING(SAMPLES), way ? actual : expected,
                    NULL, NULL, &options, &error),
                &error, VOCC_OK);
            if (!way)
                continue;
            for (size_t k = 0; k < LIGHTS * COUNT; k++)
                if (actual[k] != expected[k])
                    test_fail(__FILE__, __LINE__,
                              "round %d, isa %d, light %zu, point %zu: %d, "
                              "not %d",
                              round, way, k / COUNT, k % COUNT, actual[k],
                              expected[k]);
            test_compared(LIGHTS * COUNT * SAMPLES);
            hidden += counters.beam_hidden_rays;
            rays += counters.rays;
        }
        world_free(&w);
        mesh_free(m);
    }
    test_note("of %g rays a triangle hides %g", (double)rays, (double)hidden);
    CHECK(hidden > rays / 10);
    free(points);
    free(actual);
    free(expected);
}

/* Beams through a hierarchy that has lost its triangles take what these block
 * for lit: `verify` has to find it, and to say where and what. */
static void verify(void)
{
    enum { SAMPLES = 7 };
    shape s;
    world w;
    receivers r;
    shape_make(&s, 12, 1);
    world_make(&w, &s, NULL);
    receivers_make_patches(&r, &s, 3000, 0.05, 0.001);
    const size_t values = LIGHTS * r.count;
    uint16_t *whole = malloc(values * sizeof(*whole));
    uint16_t *damaged = malloc(values * sizeof(*damaged));
    uint16_t *actual = malloc(values * sizeof(*actual));
    REQUIRE(whole && damaged && actual);
    vocc_query_options options;
    vocc_error error;
    vocc_query_options_init(&options);
    options.method = VOCC_METHOD_BEAMS;
    options.threads = 1;
    options.verify = 1;
    CHECK_STATUS(
        query(&w, &r, LIGHTS, lights, SAMPLES, whole, &options, &error), &error,
        VOCC_OK);
    const size_t nodes = w.scene->built.bvh.node_count;
    REQUIRE(nodes > 0);
    w.scene->built.bvh.node_count = 0;
    options.verify = 0;
    CHECK_STATUS(
        query(&w, &r, LIGHTS, lights, SAMPLES, damaged, &options, &error),
        &error, VOCC_OK);
    CHECK(memcmp(whole, damaged, values * sizeof(*whole)) != 0);
    for (int way = 0; way < 4; way++) {
        size_t point = 0, light = 0;
        unsigned blocked = 0, expected = 0;
        int end = 0;
        options.threads = way % 2 ? 3 : 1;
        options.verify = way < 2 ? 1 : 3;
        memset(&error, 0, sizeof(error));
        CHECK_STATUS(
            query(&w, &r, LIGHTS, lights, SAMPLES, actual, &options, &error),
            &error, VOCC_ERROR_MISMATCH);
        CHECK_INT(error.status, VOCC_ERROR_MISMATCH);
        CHECK_INT(sscanf(error.message,
                         "points[%zu], lights[%zu]: beams block %u samples, "
                         "rays %u%n",
                         &point, &light, &blocked, &expected, &end),
                  4);
        CHECK(end > 0 && error.message[end] == ':');
        REQUIRE(point < r.count && light < LIGHTS);
        const size_t k = light * r.count + point;
        CHECK(whole[k] != VOCC_NOT_TRACED && whole[k] != damaged[k]);
        CHECK_INT(blocked, SAMPLES - damaged[k]);
        CHECK_INT(expected, SAMPLES - whole[k]);
        CHECK_INT((point + light) % (size_t)options.verify, 0);
    }
    w.scene->built.bvh.node_count = nodes;
    options.verify = 1;
    CHECK_STATUS(
        query(&w, &r, LIGHTS, lights, SAMPLES, actual, &options, &error),
        &error, VOCC_OK);
    CHECK(memcmp(whole, actual, values * sizeof(*whole)) == 0);
    test_compared(values);
    free(whole);
    free(damaged);
    free(actual);
    receivers_free(&r);
    world_free(&w);
    shape_free(&s);
}

const test_case test_light_cases[] = {
    {"light.all_options", all_options},
    {"light.threads", threads},
    {"light.neighbours", neighbours},
    {"light.concave", concave},
    {"light.sample_numbers", sample_numbers},
    {"light.layouts", layouts},
    {"light.occluders_of_few_triangles", occluders_of_few_triangles},
    {"light.hidden_by_a_triangle", hidden_by_a_triangle},
    {"light.verify", verify},
    {NULL, NULL},
};
