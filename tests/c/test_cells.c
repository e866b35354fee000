/* Guards the cells of lights: samples in lanes are those of single rays to the
 * last bit; every sample ends within what the beam to its cells aims at; and
 * beams count what rays do, on lights of all sizes and shapes. */
#include "../../csrc/isa.h"
#include "../../csrc/light.h"
#include "../../csrc/memory.h"
#include "../../csrc/sampler.h"
#include "../../csrc/scene.h"
#include "../../csrc/shadow_group.h"

#include "receivers.h"
#include "world.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "test.h"

#define PI 3.14159265358979323846

/* ---- lights of all kinds ------------------------------------------------ */

static double pick(test_random *random, const double *from, uint32_t count)
{
    return from[random_below(random, count)];
}

static void any_vector(test_random *random, double size, double out[3])
{
    for (int k = 0; k < 3; k++)
        out[k] = random_below(random, 8) ? size * random_in(random, -1, 1) : 0;
}

/* From needles to planes, from points to what holds the scene. */
static vocc_light any_light(test_random *random, double scale)
{
    static const double sizes[] = {0.5, 0.5, 1e-3, 1e-7, 4, 100, 0},
                        offs[] = {0.3, 2, 2, 3, 50, 0}, bends[] = {1, 1e-3, 0},
                        angles[] = {0,   1e-9, 0.0093,    0.2,
                                    1.2, 3,    PI - 1e-9, PI};
    vocc_light light;
    memset(&light, 0, sizeof(light));
    light.type = (int32_t)random_below(random, VOCC_LIGHT_SUN + 1);
    any_vector(random, scale * pick(random, offs, 6), light.position);
    any_vector(random, scale * pick(random, sizes, 7), light.edge_u);
    any_vector(random, scale * pick(random, sizes, 7), light.edge_v);
    if (random_below(random, 4) == 0) {
        /* Nearly or exactly along edge_u. */
        const double bend = pick(random, bends, 3),
                     along = random_in(random, -2, 2);
        for (int k = 0; k < 3; k++)
            light.edge_v[k] = bend * light.edge_v[k] + along * light.edge_u[k];
    }
    light.radius = scale * pick(random, sizes, 7);
    light.angle = pick(random, angles, 8);
    any_vector(random, 1.0, light.direction);
    if (light.direction[0] == 0 && light.direction[1] == 0)
        light.direction[random_below(random, 3)] = 1;
    light.one_sided = random_below(random, 4) == 0;
    return light;
}

static const int32_t isas[] = {VOCC_ISA_SCALAR, VOCC_ISA_SSE2, VOCC_ISA_AVX2,
                               VOCC_ISA_AVX512, VOCC_ISA_NEON};

/* Kernels of an instruction set that is there. */
static const vocc_beam_kernels *any_kernels(test_random *random)
{
    const int32_t isa = isas[random_below(random, 5)];
    return vocc_find_beam_kernels(has_isa(isa) ? isa : VOCC_ISA_SCALAR);
}

/* ---- in lanes ----------------------------------------------------------- */

static void samples_in_lanes(void)
{
    static const double no_origin[3] = {0, 0, 0}, scales[] = {1, 1e-8, 1e8};
    test_random random = random_seed(23);
    vocc_allocator allocator = vocc_default_allocator();
    static vocc_strata strata;
    for (size_t i = 0; i < test_scaled(4000, 400); i++) {
        const double scale = scales[i % 3];
        const vocc_light light = any_light(&random, scale);
        const vocc_beam_kernels *kernels = any_kernels(&random);
        const uint32_t count = 1 + random_below(&random, VOCC_CHUNK),
                       id = (uint32_t)random_u64(&random);
        float p[3], a[VOCC_CHUNK], b[VOCC_CHUNK], dirs[3][VOCC_CHUNK],
            *dir[3] = {dirs[0], dirs[1], dirs[2]};
        const double n[3] = {0, 1, 0};
        vocc_emitter e;
        vocc_aim aim;
        vocc_pattern pattern;
        REQUIRE(vocc_emitter_init(&e, &light, 0, no_origin, NULL) == VOCC_OK);
        for (int k = 0; k < 3; k++)
            p[k] = (float)(i % 11 ? scale * random_in(&random, -3, 3)
                                  : light.position[k]);
        vocc_aim_init(&aim, &e, p, n);
        REQUIRE(
            vocc_pattern_init(&pattern, &allocator, (int32_t)(i % 2), count));
        const uint32_t seed = vocc_sample_seed(id, 3);
        strata.is_jitter = pattern.sampler == VOCC_SAMPLER_JITTER;
        strata.count = count;
        strata.width = pattern.width;
        strata.height = pattern.height;
        for (uint32_t k = 0; k < count; k++) {
            strata.sample[k] = pattern.places[k].sample;
            strata.column[k] = pattern.places[k].column;
            strata.row[k] = pattern.places[k].row;
            strata.x[k] = pattern.places[k].x;
            strata.y[k] = pattern.places[k].y;
        }
        kernels->samples(&strata,
                         strata.is_jitter ? vocc_jitter_key(id, 3) : seed,
                         &aim.view, a, b, dir);
        for (uint32_t k = 0; k < count; k++) {
            float ab[2], to[3];
            vocc_sample(&pattern, id, 3, seed, &pattern.places[k], &ab[0],
                        &ab[1]);
            (void)vocc_aim_ray(&aim, ab[0], ab[1], to);
            CHECK(memcmp(&ab[0], &a[k], 4) == 0);
            CHECK(memcmp(&ab[1], &b[k], 4) == 0);
            for (int j = 0; j < 3; j++)
                CHECK(memcmp(&to[j], &dirs[j][k], 4) == 0);
        }
        test_compared(count);
        vocc_pattern_free(&pattern, &allocator);
    }
}

/* ---- ends of cells ------------------------------------------------------ */

/* What beams rely on: an end, less the beam's centre unless it is a direction,
 * is within the half axes and the slack about the middle, and within bounds. */
static void check_end(const vocc_beam *b, const double normals[][3], int count,
                      const float p[3], const float dir[3])
{
    const long double length =
        b->is_direction ? 4.0L * (long double)b->size : 1.0L;
    long double x[3];
    for (int k = 0; k < 3; k++) {
        const long double end =
            (long double)dir[k] + (b->is_direction ? 0.0L : (long double)p[k]);
        CHECK(length * end >= (long double)b->far_lower[k]);
        CHECK(length * end <= (long double)b->far_upper[k]);
        CHECK(fabsl((long double)dir[k] - (long double)b->way[k]) <=
              (long double)b->way_half[k]);
        x[k] = end - (long double)b->end[k] -
               (b->is_direction ? 0.0L : (long double)b->centre[k]);
    }
    for (int i = 0; i < count; i++) {
        const double *n = normals[i];
        long double at = 0, width = 0;
        for (int k = 0; k < 3; k++) {
            at += (long double)n[k] * x[k];
            width += fabsl((long double)n[k]) * (long double)b->end_slack;
        }
        for (int j = 0; j < 3; j++) {
            long double along = 0;
            for (int k = 0; k < 3; k++)
                along += (long double)n[k] * (long double)b->end_axis[j][k];
            width += fabsl(along);
        }
        CHECK(fabsl(at) <= width);
    }
}

/* A group of points that keeps its samples by any cells at all. */
static void samples_end_in_their_cells(void)
{
    enum { NORMALS = 7 };
    static const double no_origin[3] = {0, 0, 0}, scales[] = {1, 1e-6, 1e6},
                        spreads[] = {1e-4, 0.01, 0.3, 3, 0};
    static vocc_segments s;
    static vocc_beam beam;
    static double low[VOCC_CELLS][3], high[VOCC_CELLS][3];
    test_random random = random_seed(29);
    shape shapes;
    world w;
    uint64_t all = 0;
    shape_make(&shapes, 0, 0);
    world_make(&w, &shapes, NULL);
    for (size_t i = 0; i < test_scaled(3000, 200); i++) {
        const double scale = scales[i % 3],
                     spread = scale * pick(&random, spreads, 5);
        const vocc_light light = any_light(&random, scale);
        const vocc_beam_kernels *kernels = any_kernels(&random);
        const int count = 1 + (int)random_below(&random, VOCC_GROUP);
        float point[VOCC_GROUP][3];
        double normal[VOCC_GROUP][3], about[3], n[NORMALS][3], to[3], from[3],
            reach[3] = {0, 0, 0};
        uint16_t which[VOCC_GROUP];
        vocc_emitter e;
        vocc_target target;
        REQUIRE(vocc_emitter_init(&e, &light, 0, no_origin, NULL) == VOCC_OK);
        any_vector(&random, 3 * scale, about);
        for (int j = 0; j < count; j++) {
            which[j] = (uint16_t)(count - 1 - j);
            for (int k = 0; k < 3; k++) {
                point[j][k] =
                    (float)(about[k] + random_in(&random, -1, 1) * spread);
                if (i % 7 == 0 && j == 0)
                    point[j][k] = (float)light.position[k];
                normal[j][k] = random_in(&random, -1, 1);
                if (fabs((double)point[j][k]) > reach[k])
                    reach[k] = fabs((double)point[j][k]);
            }
        }
        vocc_emitter_target(&e, &w.scene->built.tree, reach, &target);
        vocc_emitter_frame(&e, point[0], &s.frame);
        beam.tree = &w.scene->built.tree;
        if (!vocc_beam_limits(&beam, reach, &target))
            continue;
        s.cells = 1 << 2 * random_below(&random, 4);
        uint32_t at = 0;
        for (int j = 0; j < count; j++) {
            vocc_aim aim;
            float near[2] = {0, 0};
            vocc_aim_init(&aim, &e, point[which[j]], normal[which[j]]);
            for (int c = 0; c < s.cells; c++) {
                s.start[j][c] = at;
                const double corner[2] = {random_in(&random, 0, 0.9),
                                          random_in(&random, 0, 0.9)};
                for (uint32_t k = random_below(&random, 4); k; k--) {
                    float dir[3];
                    for (int d = 0; d < 2; d++) {
                        near[d] =
                            (float)(corner[d] + random_in(&random, 0, 0.1));
                        if (random_below(&random, 8) == 0)
                            near[d] = (float)random_below(&random, 3) / 2;
                    }
                    (void)vocc_aim_ray(&aim, near[0], near[1], dir);
                    for (int d = 0; d < 3; d++)
                        s.dir[d][at] = dir[d];
                    at++;
                }
            }
            s.start[j][s.cells] = at;
        }
        vocc_segments_measure(&s, (const float (*)[3])point, which, count,
                              target.is_direction, low, high);
        beam.count = (size_t)count;
        for (int j = 0; j < count; j++)
            for (int k = 0; k < 3; k++)
                beam.point[k][j] = point[which[j]][k];
        vocc_beam_set_points(&beam, kernels, (const double (*)[3])normal,
                             which);
        for (int j = 0; j < NORMALS; j++)
            for (int k = 0; k < 3; k++)
                n[j][k] =
                    j < 3 ? s.frame.axis[j][k] : random_in(&random, -1, 1);
        for (int cells = s.cells; cells; cells /= 4)
            for (int c = 0; c < s.cells; c += cells) {
                uint64_t held = 0;
                vocc_cells_end(&s, c, cells, from, to);
                if (from[0] > to[0]) /* no samples */
                    continue;
                vocc_beam_set_end(&beam, &target, &s.frame, from, to);
                for (int j = 0; j < count; j++)
                    for (uint32_t k = s.start[j][c]; k < s.start[j][c + cells];
                         k++) {
                        const float dir[3] = {s.dir[0][k], s.dir[1][k],
                                              s.dir[2][k]};
                        check_end(&beam, (const double (*)[3])n, NORMALS,
                                  point[which[j]], dir);
                        held++;
                    }
                CHECK(held > 0);
                test_compared(held);
            }
        all++;
    }
    CHECK(all > 100);
    world_free(&w);
    shape_free(&shapes);
}

/* ---- counts ------------------------------------------------------------- */

/* How segments were decided. */
typedef struct decided {
    uint64_t lit, dark, tested;
} decided;

/* By rays, and by beams with and without occluders. */
static void compare_ways(const shape *s, const receivers *r,
                         const vocc_light *lights, size_t light_count,
                         const vocc_sampling *sampling, int with_shares,
                         test_random *random, decided *sum)
{
    const size_t values = light_count * r->count;
    uint16_t *visible = malloc(2 * values * sizeof(*visible));
    float *share = malloc(2 * values * sizeof(*share));
    world w;
    vocc_error error;
    REQUIRE(visible && share);
    world_make(&w, s, NULL);
    for (int way = 0; way < 3; way++) {
        vocc_query_options options;
        vocc_counters c;
        memset(&c, 0, sizeof(c));
        vocc_query_options_init(&options);
        options.counters = &c;
        options.method = way ? VOCC_METHOD_BEAMS : VOCC_METHOD_RAYS;
        options.occluders = way != 2;
        options.isa = isas[random_below(random, 5)];
        if (!has_isa(options.isa))
            options.isa = VOCC_ISA_AUTO;
        uint16_t *counts = visible + (way ? values : 0);
        float *shares = share + (way ? values : 0);
        CHECK_STATUS(
            vocc_light_visibility(
                w.scene, r->count, rows_of(r->points, 12, VOCC_FLOAT32),
                rows_of(r->normals, 12, VOCC_FLOAT32),
                rows_of(NULL, 0, VOCC_UINT32), light_count, lights, sampling,
                counts, with_shares ? shares : NULL, NULL, &options, &error),
            &error, VOCC_OK);
        if (!way)
            continue;
        sum->lit += c.beam_lit_rays;
        sum->dark += c.beam_dark_rays;
        sum->tested += c.beam_tested_rays;
        for (size_t k = 0; k < values; k++)
            if (counts[k] != visible[k]) {
                test_fail(__FILE__, __LINE__,
                          "light %zu of type %d, point %zu, %d samples: "
                          "%d, not %d",
                          k / r->count, (int)lights[k / r->count].type,
                          k % r->count, (int)sampling->samples, counts[k],
                          visible[k]);
                break;
            }
        if (with_shares)
            CHECK(memcmp(shares, share, values * sizeof(*share)) == 0);
        test_compared(values * (size_t)sampling->samples);
    }
    free(share);
    free(visible);
    world_free(&w);
}

static void beams_count_what_rays_do(void)
{
    enum { LIGHTS = 10 };
    test_random random = random_seed(31);
    decided sum = {0, 0, 0};
    for (size_t i = 0; i < test_scaled(4 * shape_count(), shape_count() / 2);
         i++) {
        shape s;
        receivers r;
        vocc_light lights[LIGHTS];
        vocc_sampling sampling;
        test_context(shape_name(i % shape_count()));
        shape_make(&s, i % shape_count(), 1);
        vocc_sampling_init(&sampling);
        sampling.samples = 1 + (int32_t)random_below(&random, i % 2 ? 40 : 300);
        sampling.sampler = (int32_t)random_below(&random, 2);
        sampling.horizon = random_below(&random, 3) == 0;
        receivers_make_patches(
            &r, &s, test_scaled(sampling.samples > 40 ? 200 : 600, 130), 0.3,
            1e-4);
        for (int l = 0; l < LIGHTS; l++)
            lights[l] = any_light(&random, 1.0);
        compare_ways(&s, &r, lights, LIGHTS, &sampling, i % 3 == 0, &random,
                     &sum);
        receivers_free(&r);
        shape_free(&s);
    }
    test_note("beams settle %g lit and %g dark, and test %g", (double)sum.lit,
              (double)sum.dark, (double)sum.tested);
    CHECK(sum.lit > sum.tested / 100);
    CHECK(sum.dark > sum.tested / 1000);
    CHECK(sum.tested > sum.lit / 1000);
}

/* So many triangles that what beams meet has no room on their lists; also where
 * points are on the light or far from everything. */
static void beams_that_meet_too_much(void)
{
    enum { LIGHTS = 9 };
    static const double angles[] = {1.0, 2.0, PI};
    test_random random = random_seed(37);
    decided sum = {0, 0, 0};
    for (size_t i = 0; i < test_scaled(12, 2); i++) {
        const double scale = i % 3 ? 1.0 : i % 2 ? 1e6 : 1e-5;
        shape s;
        receivers r;
        vocc_light lights[LIGHTS];
        vocc_sampling sampling;
        memset(&s, 0, sizeof(s));
        s.name = "knot";
        s.part_count = 1;
        test_context(s.name);
        mesh *const m = &s.parts[0].m;
        mesh_init(m);
        add_knot(m, 2, 3, 800, 24, 0.35);
        if (i % 2)
            add_box(m, 1, (const double[]){-0.1, -0.1, -0.1},
                    (const double[]){0.1, 0.1, 0.1});
        mesh_move(m, 0, scale, 0, 0, 0);
        vocc_sampling_init(&sampling);
        sampling.samples =
            i % 4 == 3 ? 130 : 1 + (int32_t)random_below(&random, 40);
        sampling.sampler = (int32_t)random_below(&random, 2);
        sampling.horizon = random_below(&random, 2) == 0;
        receivers_make_patches(&r, &s, test_scaled(300, 100), i % 2 ? 0.3 : 8,
                               1e-4 * scale);
        for (int l = 0; l < LIGHTS; l++) {
            lights[l] = any_light(&random, scale);
            if (l < 3) {
                lights[l].type = VOCC_LIGHT_SUN;
                lights[l].angle = angles[l];
            } else if (l < 6) {
                lights[l].type = VOCC_LIGHT_SPHERE;
                lights[l].radius = scale * random_in(&random, 0.5, 10);
            } else {
                const float *const on = &r.points[3 * (size_t)l];
                lights[l].type = l % 2 ? VOCC_LIGHT_RECT : VOCC_LIGHT_DISK;
                lights[l].one_sided = 0;
                for (int k = 0; k < 3; k++) {
                    if (l == 8 && on[k] - on[k] == 0.0f)
                        lights[l].position[k] = (double)on[k];
                    lights[l].edge_u[k] = scale * random_in(&random, -5, 5);
                    lights[l].edge_v[k] = scale * random_in(&random, -5, 5);
                }
            }
        }
        compare_ways(&s, &r, lights, LIGHTS, &sampling, i % 3 == 1, &random,
                     &sum);
        receivers_free(&r);
        mesh_free(m);
    }
    test_note("beams settle %g lit and %g dark, and test %g", (double)sum.lit,
              (double)sum.dark, (double)sum.tested);
    CHECK(sum.tested > sum.lit / 1000);
}

const test_case test_cells_cases[] = {
    {"cells.samples_in_lanes", samples_in_lanes},
    {"cells.samples_end_in_their_cells", samples_end_in_their_cells},
    {"cells.beams_count_what_rays_do", beams_count_what_rays_do},
    {"cells.beams_that_meet_too_much", beams_that_meet_too_much},
    {NULL, NULL},
};
