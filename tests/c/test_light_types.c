/* Guards the types of lights: samples end on the light's hull, on the side of
 * the surface that is claimed; counts and irradiance are the same in every
 * mode, with both samplers and horizons; ambient occlusion, too. */
#include "../../csrc/light.h"
#include "../../csrc/memory.h"
#include "../../csrc/sampler.h"
#include "../../csrc/scene.h"

#include "receivers.h"
#include "world.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "test.h"

#define FULL 6.283185307179586

static const vocc_light lights[] = {
    {.type = VOCC_LIGHT_RECT,
     .position = {-0.5, 3, -0.5},
     .edge_u = {1, 0, 0},
     .edge_v = {0, 0, 1},
     .one_sided = 1},
    {.type = VOCC_LIGHT_DISK,
     .position = {2, 1.5, 2},
     .edge_u = {0.5, 0, -0.5},
     .edge_v = {0, 0.25, 0}},
    {.type = VOCC_LIGHT_DISK, /* cuts through everything */
     .position = {0, 0, 0.03125},
     .edge_u = {2, 0, 0},
     .edge_v = {0, 2, 0},
     .one_sided = 1},
    {.type = VOCC_LIGHT_SPHERE, .position = {-1, 2.5, 1}, .radius = 0.5},
    {.type = VOCC_LIGHT_SPHERE, .position = {0, 0, 0}, .radius = 0.125},
    {.type = VOCC_LIGHT_SPHERE, .position = {0, 0.5, 0}, .radius = 5},
    {.type = VOCC_LIGHT_POINT, .position = {1.5, 2, -1}, .radius = 0.25},
    {.type = VOCC_LIGHT_POINT, .position = {0.25, 0.75, 2}},
    {.type = VOCC_LIGHT_SPOT,
     .position = {0, 3, 1},
     .direction = {0, -1, -0.25},
     .angle = 0.7,
     .radius = 0.1},
    {.type = VOCC_LIGHT_SPOT,
     .position = {0, 0.01, 0},
     .direction = {0, 0, 3},
     .angle = FULL},
    {.type = VOCC_LIGHT_SUN, .direction = {1, 2, 0.5}, .angle = 0.0093},
    {.type = VOCC_LIGHT_SUN, .direction = {0, 0, 1e-30}},
    {.type = VOCC_LIGHT_SUN, .direction = {-1, 0.01, 0}, .angle = 0.5},
    {.type = VOCC_LIGHT_SUN, .direction = {0, -1, 0}, .angle = FULL / 2},
};
#define LIGHTS (sizeof(lights) / sizeof(lights[0]))

static vocc_light scaled(const vocc_light *light, double scale)
{
    vocc_light result = *light;
    for (int k = 0; k < 3; k++) {
        result.position[k] *= scale;
        result.edge_u[k] *= scale;
        result.edge_v[k] *= scale;
    }
    result.radius *= scale;
    return result;
}

/* ---- samples ----------------------------------------------------------- */

/* What shafts rely on: every ray ends within the target's bounds, and no plane
 * that has the target's corners on one side has the end on the other. */
static void check_end(const vocc_target *target, const float p[3],
                      const float dir[3], const double n[3])
{
    double low = HUGE_VAL, high = -HUGE_VAL, end = 0.0, length = 0.0;
    for (int k = 0; k < 3; k++) {
        const double x =
            (double)dir[k] + (target->is_direction ? 0.0 : (double)p[k]);
        if (!(x >= target->lower[k] && x <= target->upper[k]))
            test_fail(__FILE__, __LINE__,
                      "axis %d: %.17g is not in %.17g, %.17g", k, x,
                      target->lower[k], target->upper[k]);
        end += n[k] * x;
        length += fabs(n[k]);
    }
    for (int i = 0; i < target->corners; i++) {
        double x = 0.0;
        for (int k = 0; k < 3; k++)
            x += n[k] * (double)target->corner[i][k];
        low = x < low ? x : low;
        high = x > high ? x : high;
    }
    CHECK(end >= low - length * target->slack);
    CHECK(end <= high + length * target->slack);
}

static void samples_end_on_the_light(void)
{
    static const double no_origin[3] = {0.0, 0.0, 0.0},
                        scales[] = {1.0, 1e-6, 1e6};
    test_random random = random_seed(7);
    vocc_pattern pattern;
    vocc_allocator allocator = vocc_default_allocator();
    shape s;
    world w;
    uint64_t all = 0, part = 0, none = 0;
    shape_make(&s, 0, 0);
    world_make(&w, &s, NULL);
    REQUIRE(vocc_pattern_init(&pattern, &allocator, VOCC_SAMPLER_SOBOL, 16));
    for (size_t i = 0; i < test_scaled(6000, 600); i++) {
        const double scale = scales[i % 3];
        const vocc_light light = scaled(&lights[i / 3 % LIGHTS], scale);
        vocc_emitter e;
        vocc_target target;
        vocc_aim aim;
        float p[3];
        double n[3], reach[3];
        for (int k = 0; k < 3; k++) {
            p[k] = (float)(scale * random_in(&random, -3, 3));
            if (i % 7 == 0)
                p[k] = (float)light.position[k];
            n[k] = random_in(&random, -1, 1);
            reach[k] = fabs((double)p[k]);
        }
        REQUIRE(vocc_emitter_init(&e, &light, 0, no_origin, NULL) == VOCC_OK);
        vocc_emitter_target(&e, &w.scene->built.tree, reach, &target);
        vocc_aim_init(&aim, &e, p, n);
        const vocc_facing facing =
            vocc_emitter_facing(&e, p, n, VOCC_HORIZON_SAMPLE);
        all += facing == VOCC_FACING_ALL;
        part += facing == VOCC_FACING_PART;
        none += facing == VOCC_FACING_NONE;
        const int reached =
            e.type != VOCC_LIGHT_SPOT && !e.one_sided; /* by all points */
        for (uint32_t k = 0; k < 16; k++) {
            float a, b, dir[3];
            vocc_sample(&pattern, (uint32_t)i, 3, (uint32_t)i * 77u,
                        &pattern.places[k], &a, &b);
            if (i % 5 == 0) {
                a = k & 1 ? 1.0f : 0.0f;
                b = k & 2 ? 1.0f : 0.0f;
            }
            const float tmax = vocc_aim_ray(&aim, a, b, dir);
            CHECK((tmax == 1.0f) == (e.type != VOCC_LIGHT_SUN));
            check_end(&target, p, dir, n);
            const int above = vocc_aim_is_above(&aim, dir);
            if (facing == VOCC_FACING_ALL)
                CHECK(above);
            if (facing == VOCC_FACING_NONE && reached)
                CHECK(!above);
            CHECK(vocc_aim_weight(&aim, dir) >= 0.0);
        }
        test_compared(16);
    }
    CHECK(all > 100);
    CHECK(part > 100);
    CHECK(none > 100);
    vocc_pattern_free(&pattern, &allocator);
    world_free(&w);
    shape_free(&s);
}

/* Points of a patch, and its corners; what is said of all is so at each. */
static void patches_face_alike(void)
{
    enum { POINTS = 24 };
    static const double no_origin[3] = {0.0, 0.0, 0.0},
                        sizes[] = {0.0, 1e-6, 0.05, 1.0},
                        lengths[] = {1.0, 1e-310, 1e308};
    test_random random = random_seed(11);
    uint64_t said[3] = {0, 0, 0};
    for (size_t i = 0; i < test_scaled(6000, 600); i++) {
        const int32_t horizon =
            i % 2 ? VOCC_HORIZON_SAMPLE : VOCC_HORIZON_CENTRE;
        const double size = sizes[i / 2 % 4], length = lengths[i % 3];
        double middle[3], n[3], normal[POINTS][3];
        float point[POINTS][3];
        uint8_t facing[POINTS];
        vocc_facing all = VOCC_FACING_NONE;
        vocc_patch patch;
        vocc_emitter e;
        REQUIRE(vocc_emitter_init(&e, &lights[i / 8 % LIGHTS], 0, no_origin,
                                  NULL) == VOCC_OK);
        for (int k = 0; k < 3; k++) {
            middle[k] = random_in(&random, -3, 3);
            n[k] = random_in(&random, -0.5, 0.5);
            for (int j = 0; j < POINTS; j++) {
                double at = random_in(&random, -1, 1),
                       turn = random_in(&random, -1, 1);
                if (j < 8)
                    at = turn = j >> k & 1 ? 1.0 : -1.0;
                point[j][k] = (float)(middle[k] + size * at);
                normal[j][k] = length * (n[k] + 0.5 * size * turn);
                if (j == 0 || (double)point[j][k] < patch.lower[k])
                    patch.lower[k] = (double)point[j][k];
                if (j == 0 || (double)point[j][k] > patch.upper[k])
                    patch.upper[k] = (double)point[j][k];
                if (j == 0 || normal[j][k] < patch.normal_lower[k])
                    patch.normal_lower[k] = normal[j][k];
                if (j == 0 || normal[j][k] > patch.normal_upper[k])
                    patch.normal_upper[k] = normal[j][k];
            }
        }
        vocc_emitter_face(&e, POINTS, (const float (*)[3])point,
                          (const double (*)[3])normal, horizon, facing);
        const int alike = vocc_emitter_facing_patch(&e, &patch, horizon, &all);
        for (int j = 0; j < POINTS; j++) {
            CHECK_INT(facing[j],
                      vocc_emitter_facing(&e, point[j], normal[j], horizon));
            if (alike)
                CHECK_INT(facing[j], all);
        }
        said[alike ? all : VOCC_FACING_PART]++;
        test_compared(POINTS);
    }
    CHECK(said[VOCC_FACING_ALL] > 100);
    CHECK(said[VOCC_FACING_PART] > 100);
    CHECK(said[VOCC_FACING_NONE] > 100);
}

/* Every cell of 2^-i by 2^-j, i + j = m, has one of 2^m samples: a (0, m,
 * 2)-net before and after the scrambling. */
static void samples_are_a_net(void)
{
    enum { M = 8, N = 1 << M };
    vocc_allocator allocator = vocc_default_allocator();
    vocc_pattern pattern;
    float a[N], b[N];
    REQUIRE(vocc_pattern_init(&pattern, &allocator, VOCC_SAMPLER_SOBOL, N));
    for (uint32_t id = 0; id < 20; id++) {
        for (uint32_t k = 0; k < N; k++) {
            vocc_sample(&pattern, id, 1, vocc_sample_seed(id, 1),
                        &pattern.places[k], &a[k], &b[k]);
            CHECK(a[k] >= 0.0f && a[k] < 1.0f && b[k] >= 0.0f && b[k] < 1.0f);
        }
        for (int i = 0; i <= M; i++) {
            unsigned char seen[N];
            memset(seen, 0, sizeof(seen));
            for (int k = 0; k < N; k++)
                seen[((int)(a[k] * (float)(1 << i)) << (M - i)) +
                     (int)(b[k] * (float)(1 << (M - i)))]++;
            for (int k = 0; k < N; k++)
                CHECK_INT(seen[k], 1);
        }
        /* Packets are narrow. */
        for (int k = 0; k < N; k += 4)
            for (int j = 1; j < 4; j++) {
                CHECK((int)(a[k] * 8) == (int)(a[k + j] * 8));
                CHECK((int)(b[k] * 8) == (int)(b[k + j] * 8));
            }
    }
    vocc_pattern_free(&pattern, &allocator);
}

/* ---- modes ------------------------------------------------------------- */

static void compare_bytes(int line, const char *what, const void *actual,
                          const void *expected, size_t count, size_t size)
{
    for (size_t i = 0; i < count; i++)
        if (memcmp((const char *)actual + i * size,
                   (const char *)expected + i * size, size) != 0) {
            test_fail(__FILE__, line, "%s: value %zu of %zu differs", what, i,
                      count);
            return;
        }
    test_compared(count);
}

/* Rays in all ways, and beams on all instruction sets, without occluders as
 * well. */
enum { RAY_WAYS = 8, ISAS = VOCC_ISA_NEON, WAYS = RAY_WAYS + 2 * ISAS };

/* One way of the many, by number; 0: the baseline. */
static void set_way(vocc_query_options *o, int way, vocc_counters *counters)
{
    vocc_query_options_init(o);
    o->counters = counters;
    if (way == 0) {
        const mode baseline = mode_baseline();
        mode_options(&baseline, o);
        return;
    }
    if (way >= RAY_WAYS) {
        o->method = VOCC_METHOD_BEAMS;
        o->isa = VOCC_ISA_SCALAR + (way - RAY_WAYS) % ISAS;
        if (!has_isa(o->isa))
            o->isa = VOCC_ISA_AUTO;
        o->occluders = way < RAY_WAYS + ISAS;
        o->threads = 1 + way % 3;
        o->verify = way % 2 ? 3 : 0;
        return;
    }
    o->method = VOCC_METHOD_RAYS;
    o->order = way % 3 == 0   ? VOCC_ORDER_AUTO
               : way % 3 == 1 ? VOCC_ORDER_OPAQUE_FIRST
                              : VOCC_ORDER_QDBFS;
    o->entry_points = way % 4 != 1;
    o->voxels = way % 4 == 3 ? 5 * way : 0;
    o->occluders = way != 5;
    o->packets = way != 6;
    o->isa = way & 4 ? VOCC_ISA_SCALAR : VOCC_ISA_AUTO;
    o->threads = 1 + way % 3;
    o->entry_triangles = way == 4 ? 0 : 8 * way;
}

static void all_ways(void)
{
    static const double scales[] = {1.0, 1e-12, 1e7};
    vocc_counters sum, ambient;
    memset(&sum, 0, sizeof(sum));
    memset(&ambient, 0, sizeof(ambient));
    for (size_t i = 0; i < shape_count(); i++) {
        const double scale = i % 4 ? 1.0 : scales[i / 4 % 3];
        shape s;
        world w;
        receivers r;
        vocc_light moved[LIGHTS];
        vocc_sampling sampling;
        vocc_error error;
        test_context(shape_name(i));
        shape_make(&s, i, 1);
        /* Many samples: fans. */
        const int is_many = i % 3 == 1;
        if (i % 2)
            receivers_make(
                &r, &s, is_many ? test_scaled(120, 50) : test_scaled(700, 100));
        else
            receivers_make_patches(
                &r, &s, is_many ? test_scaled(200, 70) : test_scaled(1200, 200),
                0.3, 1e-4);
        for (int p = 0; p < s.part_count; p++)
            mesh_move(&s.parts[p].m, 0, scale, 0, 0, 0);
        for (size_t k = 0; k < 3 * r.count; k++)
            r.points[k] = (float)((double)r.points[k] * scale);
        for (size_t l = 0; l < LIGHTS; l++)
            moved[l] = scaled(&lights[l], scale);
        world_make(&w, &s, NULL);
        const size_t values = LIGHTS * r.count;
        /* Of the baseline, then of another way. */
        uint16_t *visible = malloc(2 * values * sizeof(*visible));
        float *share = malloc(2 * values * sizeof(*share));
        uint16_t *open = malloc(2 * r.count * sizeof(*open));
        REQUIRE(open);
        REQUIRE(visible && share);
        vocc_sampling_init(&sampling);
        sampling.samples =
            is_many ? 24 + (int32_t)(i * 71 % 277) : 1 + (int32_t)(i * 5 % 17);
        sampling.sampler = i % 3 == 2 || i % 6 == 4;
        sampling.horizon = i % 5 == 4;
        for (int way = 0; way < WAYS; way++) {
            vocc_query_options options;
            vocc_counters c;
            if (way && !test_share(i + (size_t)way))
                continue;
            uint16_t *counts = way ? visible + values : visible;
            float *shares = way ? share + values : share;
            const vocc_array points = rows_of(r.points, 12, VOCC_FLOAT32),
                             normals = rows_of(r.normals, 12, VOCC_FLOAT32),
                             ids = rows_of(NULL, 0, VOCC_UINT32);
            memset(&c, 0, sizeof(c));
            set_way(&options, way, &c);
            CHECK_STATUS(vocc_light_visibility(
                             w.scene, r.count, points, normals, ids, LIGHTS,
                             moved, &sampling, way == 2 ? NULL : counts,
                             way == 3 ? NULL : shares, NULL, &options, &error),
                         &error, VOCC_OK);
            if (way < RAY_WAYS)
                sum.rays += c.rays;
            sum.entry_lit_rays += c.entry_lit_rays;
            sum.entry_dark_rays += c.entry_dark_rays;
            if (way && way != 2)
                compare_bytes(__LINE__, "counts", counts, visible, values,
                              sizeof(*counts));
            if (way && way != 3)
                compare_bytes(__LINE__, "irradiance", shares, share, values,
                              sizeof(*shares));
            sum.beam_lit_rays += c.beam_lit_rays;
            sum.beam_dark_rays += c.beam_dark_rays;
            sum.beam_hidden_rays += c.beam_hidden_rays;
            sum.beam_tested_rays += c.beam_tested_rays;
            memset(&c, 0, sizeof(c));
            uint16_t *opens = way ? open + r.count : open;
            CHECK_STATUS(vocc_ambient_occlusion(
                             w.scene, r.count, points, normals, ids,
                             i % 6 ? 0.3 * scale : HUGE_VAL, &sampling, opens,
                             NULL, &options, &error),
                         &error, VOCC_OK);
            CHECK_INT(c.entry_searches, 0);
            if (way >= RAY_WAYS && scale > 1e-9) {
                CHECK_INT(c.beam_lit_rays + c.beam_tested_rays, c.rays);
                ambient.beam_lit_rays += c.beam_lit_rays;
                ambient.beam_tested_rays += c.beam_tested_rays;
            }
            if (way)
                compare_bytes(__LINE__, "ambient occlusion", opens, open,
                              r.count, sizeof(*open));
        }
        free(open);
        free(visible);
        free(share);
        receivers_free(&r);
        world_free(&w);
        shape_free(&s);
    }
    test_note("of %g rays, searches settle %g lit and %g dark",
              (double)sum.rays, (double)sum.entry_lit_rays,
              (double)sum.entry_dark_rays);
    test_note("beams settle %g lit, %g dark and %g hidden, and test %g",
              (double)sum.beam_lit_rays, (double)sum.beam_dark_rays,
              (double)sum.beam_hidden_rays, (double)sum.beam_tested_rays);
    test_note("of ambient occlusion they settle %g and test %g",
              (double)ambient.beam_lit_rays, (double)ambient.beam_tested_rays);
    CHECK(ambient.beam_lit_rays > ambient.beam_tested_rays / 100);
    CHECK(ambient.beam_tested_rays > sum.rays / 100);
    CHECK(sum.beam_lit_rays > sum.rays / 100);
    CHECK(sum.beam_dark_rays > sum.rays / 1000);
    CHECK(sum.beam_hidden_rays > sum.rays / 1000);
    CHECK(sum.beam_tested_rays > sum.rays / 100);
    CHECK(sum.entry_lit_rays > sum.rays / 100);
    CHECK(sum.entry_dark_rays > sum.rays / 1000);
}

/* ---- several scenes ---------------------------------------------------- */

/* Every other triangle, from `first` on. */
static vocc_scene *half_scene(const shape *s, size_t first)
{
    vocc_scene *scene;
    vocc_error error;
    CHECK_STATUS(vocc_scene_create(NULL, &scene, &error), &error, VOCC_OK);
    for (int p = 0; p < s->part_count; p++) {
        const mesh *m = &s->parts[p].m;
        vocc_array triangles = mesh_triangles(m);
        triangles.data =
            (const char *)triangles.data + (ptrdiff_t)first * triangles.stride;
        triangles.stride *= 2;
        CHECK_STATUS(vocc_scene_add_mesh(scene, m->vertex_count,
                                         mesh_vertices(m),
                                         (m->triangle_count + 1 - first) / 2,
                                         triangles, NULL, NULL, &error),
                     &error, VOCC_OK);
    }
    CHECK_STATUS(vocc_scene_build(scene, NULL, &error), &error, VOCC_OK);
    return scene;
}

/* One scene after the other, with the bits of what is blocked, gives what one
 * scene of all gives; and the bits are the answers. */
static void several_scenes(void)
{
    enum { SAMPLES = 11, BYTES = 2 };
    for (size_t i = 0; i < shape_count(); i++) {
        shape s;
        world w;
        receivers r;
        vocc_sampling sampling;
        vocc_error error;
        test_context(shape_name(i));
        shape_make(&s, i, 1);
        if (i % 2)
            receivers_make(&r, &s, test_scaled(500, 50));
        else
            receivers_make_patches(&r, &s, test_scaled(800, 100), 0.3, 1e-4);
        world_make(&w, &s, NULL);
        const vocc_array points = rows_of(r.points, 12, VOCC_FLOAT32),
                         normals = rows_of(r.normals, 12, VOCC_FLOAT32),
                         ids = rows_of(NULL, 0, VOCC_UINT32);
        const size_t values = LIGHTS * r.count;
        uint16_t *visible = malloc(2 * values * sizeof(*visible));
        float *share = malloc(2 * values * sizeof(*share));
        uint8_t *bits = calloc(values, BYTES);
        REQUIRE(visible && share && bits);
        vocc_sampling_init(&sampling);
        sampling.samples = SAMPLES;
        CHECK_STATUS(vocc_light_visibility(w.scene, r.count, points, normals,
                                           ids, LIGHTS, lights, &sampling,
                                           visible, share, NULL, NULL, &error),
                     &error, VOCC_OK);
        for (size_t half = 0; half < 2; half++) {
            vocc_scene *scene = half_scene(&s, half);
            vocc_query_options options;
            set_way(&options, 1 + (int)((i + 3 * half) % (WAYS - 1)), NULL);
            options.verify = 0; /* not with blocked */
            CHECK_STATUS(vocc_light_visibility(scene, r.count, points, normals,
                                               ids, LIGHTS, lights, &sampling,
                                               visible + values, share + values,
                                               bits, &options, &error),
                         &error, VOCC_OK);
            vocc_scene_free(scene);
        }
        compare_bytes(__LINE__, "counts", visible + values, visible, values,
                      sizeof(*visible));
        compare_bytes(__LINE__, "irradiance", share + values, share, values,
                      sizeof(*share));
        for (size_t k = 0; k < values; k++) {
            int set = 0;
            for (int n = 0; n < SAMPLES; n++)
                set += bits[BYTES * k + (size_t)n / 8] >> n % 8 & 1;
            /* Samples below the horizon are dark, but not blocked. */
            if (visible[k] != VOCC_NOT_TRACED)
                CHECK(visible[k] + set <= SAMPLES);
            else
                CHECK_INT(set, 0);
        }
        /* Everything is known: nothing is traced. */
        vocc_query_options options;
        vocc_counters c;
        memset(&c, 0, sizeof(c));
        set_way(&options, 0, &c);
        memset(bits, 0xff, BYTES * values);
        CHECK_STATUS(vocc_light_visibility(
                         w.scene, r.count, points, normals, ids, LIGHTS, lights,
                         &sampling, visible, NULL, bits, &options, &error),
                     &error, VOCC_OK);
        CHECK_INT(c.rays, 0);
        for (size_t k = 0; k < values; k++)
            CHECK(visible[k] == 0 || visible[k] == VOCC_NOT_TRACED);
        /* Ambient occlusion likewise. */
        memset(bits, 0, BYTES * r.count);
        CHECK_STATUS(vocc_ambient_occlusion(w.scene, r.count, points, normals,
                                            ids, 0.5, &sampling, visible, NULL,
                                            NULL, &error),
                     &error, VOCC_OK);
        for (int turn = 0; turn < 3; turn++) {
            const int way = 1 + turn * (RAY_WAYS - 1);
            if (!test_share(i + (size_t)turn))
                continue;
            memset(bits, 0, BYTES * r.count);
            for (size_t half = 0; half < 2; half++) {
                vocc_scene *scene = half_scene(&s, half);
                set_way(&options, way, NULL);
                options.verify = 0;
                CHECK_STATUS(vocc_ambient_occlusion(scene, r.count, points,
                                                    normals, ids, 0.5,
                                                    &sampling, visible + values,
                                                    bits, &options, &error),
                             &error, VOCC_OK);
                vocc_scene_free(scene);
            }
            compare_bytes(__LINE__, "ambient occlusion", visible + values,
                          visible, r.count, sizeof(*visible));
        }
        free(visible);
        free(share);
        free(bits);
        receivers_free(&r);
        world_free(&w);
        shape_free(&s);
    }
}

/* ---- meaning ----------------------------------------------------------- */

/* Over a half-plane's edge, a light is seen to half; at its horizon, too. */
static void horizons(void)
{
    shape s;
    world w;
    shape_make(&s, 0, 0);
    world_make(&w, &s, NULL);
    const vocc_light light = {
        .type = VOCC_LIGHT_SPHERE, .position = {0, 9, 0}, .radius = 1};
    /* The centre is just above, and just below the horizon; far below. */
    float point[9] = {0, 8.999f, 5, 0, 9.001f, 5, 0, 11, 5},
          normal[3] = {0, 1, 0}, share[3];
    uint16_t visible[3];
    vocc_sampling sampling;
    vocc_error error;
    vocc_sampling_init(&sampling);
    sampling.samples = 1024;
    for (int centre = 0; centre < 2; centre++) {
        sampling.horizon = centre;
        CHECK_STATUS(vocc_light_visibility(
                         w.scene, 3, rows_of(point, 12, VOCC_FLOAT32),
                         rows_of(normal, 0, VOCC_FLOAT32),
                         rows_of(NULL, 0, VOCC_UINT32), 1, &light, &sampling,
                         visible, share, NULL, NULL, &error),
                     &error, VOCC_OK);
        if (centre) {
            CHECK_INT(visible[0], 1024);
            CHECK_INT(visible[1], VOCC_NOT_TRACED);
        } else {
            CHECK(visible[0] > 500 && visible[0] < 530);
            CHECK(visible[1] > 494 && visible[1] < 524);
        }
        CHECK_INT(visible[2], VOCC_NOT_TRACED);
        CHECK(share[0] == 1.0f);
        CHECK(centre ? isnan(share[1]) : share[1] == 1.0f);
        CHECK(isnan(share[2]));
    }
    world_free(&w);
    shape_free(&s);
}

const test_case test_light_types_cases[] = {
    {"light_types.samples_end_on_the_light", samples_end_on_the_light},
    {"light_types.patches_face_alike", patches_face_alike},
    {"light_types.samples_are_a_net", samples_are_a_net},
    {"light_types.all_ways", all_ways},
    {"light_types.several_scenes", several_scenes},
    {"light_types.horizons", horizons},
    {NULL, NULL},
};
