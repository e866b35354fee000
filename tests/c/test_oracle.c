/* Guards the definition of a hit: the baseline, and with it every mode, gives
 * what integers say, with nothing left out; the closest hit is the closest,
 * ties go to the smallest ids.  Against double precision alone, rays that its
 * error bound leaves open are counted and left out. */
#include "world.h"

#include <float.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "test.h"

static void occluded_exact(void)
{
    size_t blocked = 0, all = 0;
    for (size_t i = 0; i < shape_count(); i++) {
        shape s;
        world w;
        ray_set set;
        shape_make(&s, i, 0);
        world_make(&w, &s, NULL);
        rays_init(&set);
        rays_adversarial(&set, &s, test_scaled(160, 12), 100 + i);
        uint8_t *expected = malloc(set.count), *actual = malloc(set.count);
        REQUIRE(expected && actual);
        for (size_t k = 0; k < set.count; k++) {
            /* Some without the filter, which could share an error. */
            expected[k] =
                oracle_occluded(&set.rays[k], &s, k % 32 == 0) == ORACLE_HIT;
            blocked += expected[k];
        }
        all += set.count;
        mode m = mode_baseline();
        trace(&w, &set, &m, actual, NULL);
        compare_answers(__FILE__, __LINE__, s.name, &set, &m, actual, expected);
        m.order = VOCC_ORDER_AUTO;
        m.occluders = 1;
        m.cache = 8;
        m.packets = 1;
        m.isa = VOCC_ISA_AUTO;
        trace(&w, &set, &m, actual, NULL);
        compare_answers(__FILE__, __LINE__, s.name, &set, &m, actual, expected);
        free(expected);
        free(actual);
        rays_free(&set);
        world_free(&w);
        shape_free(&s);
    }
    CHECK(blocked > all / 8 && blocked < all);
}

static void occluded_double(void)
{
    size_t unsure = 0, all = 0;
    for (size_t i = 0; i < shape_count(); i++) {
        shape s;
        world w;
        ray_set set;
        shape_make(&s, i, 1);
        world_make(&w, &s, NULL);
        rays_init(&set);
        rays_adversarial(&set, &s, test_scaled(60, 4), 200 + i);
        uint8_t *actual = malloc(set.count);
        REQUIRE(actual);
        const mode m = mode_baseline();
        trace(&w, &set, &m, actual, NULL);
        for (size_t k = 0; k < set.count; k++) {
            const oracle_answer answer =
                oracle_occluded_filter(&set.rays[k], &s);
            if (answer == ORACLE_UNSURE)
                unsure++;
            else if (actual[k] != answer)
                test_fail(__FILE__, __LINE__,
                          "%s: ray %zu (%s) is %d, not %d: %s", s.name, k,
                          ray_kind_name(set.kinds[k]), actual[k], (int)answer,
                          ray_text(&set.rays[k]));
        }
        all += set.count;
        test_compared(set.count);
        free(actual);
        rays_free(&set);
        world_free(&w);
        shape_free(&s);
    }
    test_note("%zu of %zu rays are too close for double and left out", unsure,
              all);
    CHECK(unsure < all / 2);
}

/* ---- the smallest meshes ----------------------------------------------- */

/* A few triangles on a tiny grid and rays on it: almost every ray meets edges,
 * vertices and planes exactly. */
static void grids(void)
{
    test_random random = random_seed(55);
    const size_t worlds = test_scaled(400, 20);
    for (size_t i = 0; i < worlds; i++) {
        shape s;
        memset(&s, 0, sizeof(s));
        s.name = "grid";
        s.part_count = 1 + (int)random_below(&random, 2);
        const int range = 2 + (int)random_below(&random, 3);
        const double scale = ldexp(1.0, (int)random_below(&random, 121) - 60);
        const int coarse = random_below(&random, 4) != 0;
        for (int p = 0; p < s.part_count; p++) {
            mesh *m = &s.parts[p].m;
            mesh_init(m);
            s.parts[p].occluder = 1;
            const int vertices = 4 + (int)random_below(&random, 8);
            for (int v = 0; v < vertices; v++)
                mesh_vertex(
                    m, scale * (int)random_below(&random, (uint32_t)range),
                    scale * (int)random_below(&random, (uint32_t)range),
                    scale * (int)random_below(&random, (uint32_t)range));
            const uint32_t triangles = 1 + random_below(&random, 16);
            for (uint32_t t = 0; t < triangles; t++)
                mesh_triangle(
                    m, (int32_t)random_below(&random, (uint32_t)vertices),
                    (int32_t)random_below(&random, (uint32_t)vertices),
                    (int32_t)random_below(&random, (uint32_t)vertices));
            /* A tetrahedron closes often enough to give occluders. */
            if (random_below(&random, 2)) {
                mesh_triangle(m, 0, 1, 2);
                mesh_triangle(m, 0, 3, 1);
                mesh_triangle(m, 1, 3, 2);
                mesh_triangle(m, 2, 3, 0);
            }
        }
        ray_set set;
        rays_init(&set);
        for (int r = 0; r < 300; r++) {
            float org[3], dir[3];
            for (int k = 0; k < 3; k++) {
                const int unit = coarse ? 1 : 4;
                org[k] = (float)(scale / unit *
                                 ((int)random_below(
                                      &random, (uint32_t)(unit * range + 4)) -
                                  2));
                dir[k] = (float)(scale * ((int)random_below(&random, 7) - 3));
            }
            rays_add(&set, RAY_RANDOM, org, dir,
                     random_below(&random, 4) ? 0.0f : -1.0f,
                     random_below(&random, 3)
                         ? HUGE_VALF
                         : (float)random_below(&random, 3) + 0.5f);
        }
        world w;
        world_make(&w, &s, NULL);
        uint8_t expected[300], actual[300];
        for (int r = 0; r < 300; r++)
            expected[r] =
                oracle_occluded(&set.rays[r], &s, r % 8 == 0) == ORACLE_HIT;
        const mode modes[3] = {
            mode_baseline(),
            {VOCC_ORDER_STANDARD, 1, 8, 512, 1, VOCC_ISA_AUTO, 1, 0},
            {VOCC_ORDER_QDBFS, 1, 1, 1, 1, VOCC_ISA_AUTO, 1, 0}};
        for (int k = 0; k < 3; k++) {
            trace(&w, &set, &modes[k], actual, NULL);
            compare_answers(__FILE__, __LINE__, s.name, &set, &modes[k], actual,
                            expected);
        }
        rays_free(&set);
        world_free(&w);
        shape_free(&s);
        if (test_failed())
            break;
    }
}

/* Coordinates of every magnitude in one mesh. */
static void magnitudes(void)
{
    test_random random = random_seed(66);
    const size_t worlds = test_scaled(100, 8);
    for (size_t i = 0; i < worlds; i++) {
        shape s;
        memset(&s, 0, sizeof(s));
        s.name = "magnitudes";
        s.part_count = 1;
        s.parts[0].occluder = 1;
        mesh *m = &s.parts[0].m;
        mesh_init(m);
        for (int v = 0; v < 12; v++) {
            double p[3];
            for (int k = 0; k < 3; k++)
                p[k] = random_below(&random, 8)
                           ? ldexp(random_in(&random, -1, 1),
                                   (int)random_below(&random, 275) - 148)
                           : 0.0;
            mesh_vertex(m, p[0], p[1], p[2]);
        }
        for (int t = 0; t < 12; t++)
            mesh_triangle(m, (int32_t)random_below(&random, 12),
                          (int32_t)random_below(&random, 12),
                          (int32_t)random_below(&random, 12));
        mesh_triangle(m, 0, 1, 2);
        mesh_triangle(m, 0, 3, 1);
        mesh_triangle(m, 1, 3, 2);
        mesh_triangle(m, 2, 3, 0);
        ray_set set;
        rays_init(&set);
        rays_adversarial(&set, &s, 12, i);
        /* and from vertex to vertex, as far as float32 goes */
        for (int r = 0; r < 100; r++) {
            const float *a = m->vertices + 3 * random_below(&random, 12);
            const float *b = m->vertices + 3 * random_below(&random, 12);
            float org[3], dir[3];
            for (int k = 0; k < 3; k++) {
                dir[k] = b[k] - a[k];
                org[k] = a[k] - dir[k];
            }
            rays_add(&set, RAY_VERTEX, org, dir, 0.0f, HUGE_VALF);
            for (int k = 0; k < 3; k++) {
                org[k] = a[k];
                dir[k] = (float)ldexp(random_in(&random, -1, 1),
                                      (int)random_below(&random, 275) - 148);
            }
            rays_add(&set, RAY_HUGE, org, dir, -HUGE_VALF,
                     random_below(&random, 2) ? HUGE_VALF : 1.0f);
        }
        world w;
        world_make(&w, &s, NULL);
        uint8_t *expected = malloc(set.count), *actual = malloc(set.count);
        REQUIRE(expected && actual);
        for (size_t k = 0; k < set.count; k++)
            expected[k] = oracle_occluded(&set.rays[k], &s, 0) == ORACLE_HIT;
        const mode modes[3] = {
            mode_baseline(),
            {VOCC_ORDER_STANDARD, 1, 8, 512, 1, VOCC_ISA_AUTO, 1, 0},
            {VOCC_ORDER_QDBFS, 1, 8, 16, 1, VOCC_ISA_AUTO, 1, 0}};
        for (int k = 0; k < 3; k++) {
            trace(&w, &set, &modes[k], actual, NULL);
            compare_answers(__FILE__, __LINE__, s.name, &set, &modes[k], actual,
                            expected);
        }
        free(expected);
        free(actual);
        rays_free(&set);
        world_free(&w);
        shape_free(&s);
        if (test_failed())
            break;
    }
}

/* ---- closest hits ------------------------------------------------------ */

typedef struct hit_arrays {
    float *t, *u, *v;
    int32_t *geom_id, *prim_id;
} hit_arrays;

static void hits_make(hit_arrays *h, size_t count)
{
    float *floats = malloc((3 * count + 1) * sizeof(float));
    int32_t *ids = malloc((2 * count + 1) * sizeof(int32_t));
    REQUIRE(floats && ids);
    h->t = floats;
    h->u = floats + count;
    h->v = floats + 2 * count;
    h->geom_id = ids;
    h->prim_id = ids + count;
}

static void hits_free(hit_arrays *h)
{
    free(h->t);
    free(h->geom_id);
}

static void intersect(const world *w, const ray_set *set,
                      const vocc_query_options *options, hit_arrays *h)
{
    const vocc_rays rays = rays_view(set, 0, set->count);
    const vocc_hits hits = {h->t, h->geom_id, h->prim_id, h->u, h->v};
    vocc_error error;
    CHECK_STATUS(vocc_intersect(w->scene, &rays, &hits, options, &error),
                 &error, VOCC_OK);
}

static int same_float(float a, float b)
{
    return memcmp(&a, &b, sizeof(a)) == 0;
}

/* The exact t rounded once, the smallest ids of that t; u and v of that
 * triangle. */
static void check_hit(const shape *s, const ray_set *set, size_t i,
                      const hit_arrays *h)
{
    const oracle_ray *ray = &set->rays[i];
    const oracle_hit best = oracle_intersect(ray, s);
    const float t = h->t[i], u = h->u[i], v = h->v[i];
    int right = h->geom_id[i] == best.geom_id && h->prim_id[i] == best.prim_id;
    if (best.prim_id < 0)
        right &= isinf(t) && t > 0 && same_float(u, 0) && same_float(v, 0);
    else
        right &= t == best.t && fabs((double)u - best.u) < 1e-7 &&
                 fabs((double)v - best.v) < 1e-7;
    if (!right)
        test_fail(__FILE__, __LINE__,
                  "%s: ray %zu (%s): %d %d at %a (u %g, v %g), not %d %d at %a "
                  "(u %g, v %g): %s",
                  s->name, i, ray_kind_name(set->kinds[i]), (int)h->geom_id[i],
                  (int)h->prim_id[i], (double)t, (double)u, (double)v,
                  (int)best.geom_id, (int)best.prim_id, (double)best.t, best.u,
                  best.v, ray_text(ray));
}

static void closest_hits(void)
{
    size_t hit = 0, all = 0;
    for (size_t i = 0; i < shape_count(); i++) {
        shape s;
        world w;
        ray_set set;
        hit_arrays h;
        shape_make(&s, i, 0);
        world_make(&w, &s, NULL);
        rays_init(&set);
        rays_adversarial(&set, &s, test_scaled(100, 8), 300 + i);
        hits_make(&h, set.count);
        intersect(&w, &set, NULL, &h);
        for (size_t k = 0; k < set.count; k++) {
            check_hit(&s, &set, k, &h);
            hit += h.prim_id[k] >= 0;
        }
        all += set.count;
        test_compared(set.count);

        /* Hits and blocked rays are the same rays. */
        uint8_t *blocked = malloc(set.count);
        REQUIRE(blocked);
        const mode m = mode_baseline();
        trace(&w, &set, &m, blocked, NULL);
        for (size_t k = 0; k < set.count; k++)
            CHECK_INT(h.prim_id[k] >= 0, blocked[k]);
        free(blocked);
        hits_free(&h);
        rays_free(&set);
        world_free(&w);
        shape_free(&s);
    }
    CHECK(hit > all / 8 && hit < all);
}

/* Ties by hand: two copies of one triangle in two meshes, in both orders. */
static void ties(void)
{
    static const int32_t triangles[2][6] = {{0, 1, 2, 0, 1, 2},
                                            {2, 1, 0, 1, 2, 0}};
    static const float vertices[9] = {-1, -1, 0, 1, -1, 0, 0, 1, 0};
    counting *memory = counting_create();
    const vocc_allocator allocator = counting_allocator(memory);
    vocc_scene *scene = NULL;
    REQUIRE(vocc_scene_create(&allocator, &scene, NULL) == VOCC_OK);
    for (int i = 0; i < 2; i++)
        CHECK_INT(vocc_scene_add_mesh(
                      scene, 3, rows_of(vertices, 12, VOCC_FLOAT32), 2,
                      rows_of(triangles[i], 12, VOCC_INT32), NULL, NULL, NULL),
                  VOCC_OK);
    CHECK_INT(vocc_scene_build(scene, NULL, NULL), VOCC_OK);
    const world w = {memory, scene};
    ray_set set;
    hit_arrays h;
    rays_init(&set);
    for (int i = -7; i < 8; i++) {
        const float org[3] = {(float)i / 64.0f, 0.125f, 1},
                    dir[3] = {0, 0, -0.5f};
        rays_add(&set, RAY_RANDOM, org, dir, 0.0f, HUGE_VALF);
    }
    hits_make(&h, set.count);
    intersect(&w, &set, NULL, &h);
    for (size_t i = 0; i < set.count; i++) {
        CHECK_INT(h.geom_id[i], 0);
        CHECK_INT(h.prim_id[i], 0);
        CHECK_NEAR(h.t[i], 2, 0);
        /* (1 - u - v) v0 + u v1 + v v2 */
        const float x = -(1 - h.u[i] - h.v[i]) + h.u[i];
        const float y = -(1 - h.v[i]) + h.v[i];
        CHECK_NEAR(x, set.rays[i].org[0], 1e-6);
        CHECK_NEAR(y, 0.125, 1e-6);
    }
    test_compared(set.count);
    hits_free(&h);
    rays_free(&set);
    vocc_scene_free(scene);
    counting_free(memory);
}

/* t, ids, u and v to the last bit, in all ways of asking. */
static void closest_hits_identical(void)
{
    for (size_t i = 0; i < shape_count(); i++) {
        shape s;
        world w;
        ray_set set;
        hit_arrays first, other;
        shape_make(&s, i, 1);
        world_make(&w, &s, NULL);
        rays_init(&set);
        rays_adversarial(&set, &s, test_scaled(24, 2), 400 + i);
        hits_make(&first, set.count);
        hits_make(&other, set.count);
        vocc_query_options options;
        mode m = mode_baseline();
        mode_options(&m, &options);
        intersect(&w, &set, &options, &first);
        for (int isa = VOCC_ISA_SCALAR; isa <= VOCC_ISA_NEON; isa++) {
            if (!has_isa(isa))
                continue;
            for (int flags = 0; flags < 4; flags++) {
                for (int threads = 1; threads < 4; threads++) {
                    m.isa = isa;
                    m.packets = flags & 1;
                    m.occluders = flags >> 1;
                    m.order = VOCC_ORDER_AUTO;
                    m.threads = threads;
                    mode_options(&m, &options);
                    intersect(&w, &set, &options, &other);
                    test_compared(set.count);
                    if (memcmp(first.t, other.t,
                               3 * set.count * sizeof(float)) == 0 &&
                        memcmp(first.geom_id, other.geom_id,
                               2 * set.count * sizeof(int32_t)) == 0)
                        continue;
                    for (size_t k = 0; k < set.count; k++) {
                        if (same_float(first.t[k], other.t[k]) &&
                            same_float(first.u[k], other.u[k]) &&
                            same_float(first.v[k], other.v[k]) &&
                            first.geom_id[k] == other.geom_id[k] &&
                            first.prim_id[k] == other.prim_id[k])
                            continue;
                        test_fail(
                            __FILE__, __LINE__,
                            "%s: %s: ray %zu (%s): %d %d at %a (%a, %a), not "
                            "%d %d at %a (%a, %a): %s",
                            s.name, mode_text(&m), k,
                            ray_kind_name(set.kinds[k]), (int)other.geom_id[k],
                            (int)other.prim_id[k], (double)other.t[k],
                            (double)other.u[k], (double)other.v[k],
                            (int)first.geom_id[k], (int)first.prim_id[k],
                            (double)first.t[k], (double)first.u[k],
                            (double)first.v[k], ray_text(&set.rays[k]));
                        break;
                    }
                }
            }
        }
        hits_free(&first);
        hits_free(&other);
        rays_free(&set);
        world_free(&w);
        shape_free(&s);
    }
}

const test_case test_oracle_cases[] = {
    {"oracle.occluded_exact", occluded_exact},
    {"oracle.occluded_double", occluded_double},
    {"oracle.grids", grids},
    {"oracle.magnitudes", magnitudes},
    {"oracle.closest_hits", closest_hits},
    {"oracle.ties", ties},
    {"oracle.closest_hits_identical", closest_hits_identical},
    {NULL, NULL},
};
