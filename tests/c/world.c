#include "world.h"

#include "../../csrc/scene.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "test.h"

void check_status(const char *file, int line, const char *what,
                  vocc_status status, const vocc_error *error,
                  vocc_status expected)
{
    if (status != expected)
        test_fail(file, line, "%s gives \"%s\" (%s), not \"%s\"", what,
                  vocc_status_string((int32_t)status),
                  error && status ? error->message : "",
                  vocc_status_string((int32_t)expected));
}

/* ---- arrays ------------------------------------------------------------ */

vocc_array rows_of(const void *data, size_t stride, vocc_type type)
{
    const vocc_array array = {data, (ptrdiff_t)stride, (int32_t)type};
    return array;
}

vocc_array mesh_vertices(const mesh *m)
{
    return rows_of(m->vertices, 3 * sizeof(float), VOCC_FLOAT32);
}

vocc_array mesh_triangles(const mesh *m)
{
    return rows_of(m->triangles, 3 * sizeof(int32_t), VOCC_INT32);
}

vocc_status add_part(vocc_scene *scene, const mesh *m, int occluder,
                     vocc_error *error)
{
    vocc_mesh_options options;
    vocc_mesh_options_init(&options);
    options.occluder = occluder;
    return vocc_scene_add_mesh(scene, m->vertex_count, mesh_vertices(m),
                               m->triangle_count, mesh_triangles(m), &options,
                               NULL, error);
}

vocc_rays rays_view(const ray_set *set, size_t first, size_t count)
{
    static const oracle_ray none;
    const oracle_ray *rays = count ? set->rays + first : &none;
    vocc_rays view;
    view.count = count;
    view.org = rows_of(rays->org, sizeof(*rays), VOCC_FLOAT32);
    view.dir = rows_of(rays->dir, sizeof(*rays), VOCC_FLOAT32);
    view.tmin = rows_of(&rays->tmin, sizeof(*rays), VOCC_FLOAT32);
    view.tmax = rows_of(&rays->tmax, sizeof(*rays), VOCC_FLOAT32);
    return view;
}

/* ---- worlds ------------------------------------------------------------ */

static void world_built(world *w, const shape *s,
                        const vocc_build_options *build, size_t most_pairs,
                        int coarse)
{
    vocc_error error;
    w->memory = counting_create();
    const vocc_allocator allocator = counting_allocator(w->memory);
    CHECK_STATUS(vocc_scene_create(&allocator, &w->scene, &error), &error,
                 VOCC_OK);
    REQUIRE(w->scene);
    if (most_pairs)
        w->scene->most_pairs = most_pairs;
    if (coarse)
        w->scene->large = 0;
    for (int i = 0; i < s->part_count; i++)
        CHECK_STATUS(
            add_part(w->scene, &s->parts[i].m, s->parts[i].occluder, &error),
            &error, VOCC_OK);
    const vocc_status status = vocc_scene_build(w->scene, build, &error);
    if (status != VOCC_OK) {
        test_fail(__FILE__, __LINE__, "%s: build: %s", s->name, error.message);
        test_leave();
    }
}

void world_make(world *w, const shape *s, const vocc_build_options *build)
{
    world_limited(w, s, build, 0);
}

void world_coarse(world *w, const shape *s)
{
    world_built(w, s, NULL, 0, 1);
}

void world_limited(world *w, const shape *s, const vocc_build_options *build,
                   size_t most_pairs)
{
    world_built(w, s, build, most_pairs, 0);
}

void world_free(world *w)
{
    vocc_scene_free(w->scene);
    counting_free(w->memory);
}

/* ---- modes ------------------------------------------------------------- */

mode mode_baseline(void)
{
    const mode m = {VOCC_ORDER_STANDARD, 0, 0, 512, 0, VOCC_ISA_SCALAR, 1,
                    NO_ENTRY_POINTS};
    return m;
}

void mode_options(const mode *m, vocc_query_options *options)
{
    vocc_query_options_init(options);
    options->order = m->order;
    options->occluders = m->occluders;
    options->cache = m->cache;
    options->deferment = m->deferment;
    options->packets = m->packets;
    options->isa = m->isa;
    options->threads = m->threads;
    options->cache_policy =
        m->extras & BY_DIRECTION ? VOCC_CACHE_DIRECTION : VOCC_CACHE_RECENT;
    options->fusion = !(m->extras & NO_FUSION);
    options->triangle_cache = (m->extras & LAST_TRIANGLE) != 0;
    if (m->extras & (ENTRY_POINTS | NO_ENTRY_POINTS))
        options->entry_points = (m->extras & ENTRY_POINTS) != 0;
    if (m->extras & MANY_TRIANGLES)
        options->entry_triangles = 64;
    options->voxels = m->extras & IN_VOXELS ? 6 : 0;
    if (m->extras & BY_BEAMS)
        options->method = VOCC_METHOD_BEAMS;
}

const char *mode_text(const mode *m)
{
    static const char *const orders[] = {"auto", "standard", "extended",
                                         "bfs",  "qdbfs",    "opaque_first",
                                         "sato", "rtsah"};
    static char text[160];
    snprintf(text, sizeof(text),
             "%s, occluders %d, cache %d, deferment %d, %s, %s, %d threads, "
             "extras %d",
             orders[m->order], m->occluders, m->cache, m->deferment,
             m->packets ? "packets" : "single", vocc_isa_name(m->isa),
             m->threads, m->extras);
    return text;
}

/* Asks the library with one triangle and one ray. */
static int has_options(int order, int isa, int packets)
{
    static const float vertices[9] = {0, 0, 0, 1, 0, 0, 0, 1, 0};
    static const int32_t triangle[3] = {0, 1, 2};
    static const float org[3] = {0.25f, 0.25f, -1.0f}, dir[3] = {0, 0, 1};
    vocc_scene *scene;
    vocc_error error;
    REQUIRE(vocc_scene_create(NULL, &scene, NULL) == VOCC_OK);
    REQUIRE(vocc_scene_add_mesh(scene, 3, rows_of(vertices, 12, VOCC_FLOAT32),
                                1, rows_of(triangle, 12, VOCC_INT32), NULL,
                                NULL, NULL) == VOCC_OK);
    REQUIRE(vocc_scene_build(scene, NULL, NULL) == VOCC_OK);
    mode m = mode_baseline();
    m.order = order;
    m.isa = isa;
    m.packets = packets;
    vocc_query_options options;
    mode_options(&m, &options);
    vocc_rays rays;
    memset(&rays, 0, sizeof(rays));
    rays.count = 1;
    rays.org = rows_of(org, 12, VOCC_FLOAT32);
    rays.dir = rows_of(dir, 12, VOCC_FLOAT32);
    uint8_t occluded = 0;
    const vocc_status status =
        vocc_occluded(scene, &rays, &occluded, &options, &error);
    vocc_scene_free(scene);
    if (status == VOCC_ERROR_UNSUPPORTED)
        return 0;
    CHECK_STATUS(status, &error, VOCC_OK);
    CHECK_INT(occluded, 1);
    return 1;
}

int has_order(int order)
{
    return has_options(order, VOCC_ISA_SCALAR, 1);
}

int has_isa(int isa)
{
    const int has = has_options(VOCC_ORDER_STANDARD, isa, 1);
    /* What there is does not depend on how the rays come. */
    CHECK_INT(has_options(VOCC_ORDER_STANDARD, isa, 0), has);
    return has;
}

static int length(const int *list)
{
    int n = 0;
    while (list[n] >= 0)
        n++;
    return n;
}

mode_list modes_of(const int *caches, const int *deferments, const int *threads)
{
    /* A prime number of them: every option meets every other. */
    static const int extras[13] = {0,
                                   BY_BEAMS,
                                   BY_DIRECTION,
                                   ENTRY_POINTS,
                                   NO_FUSION | ENTRY_POINTS | MANY_TRIANGLES,
                                   LAST_TRIANGLE | NO_ENTRY_POINTS,
                                   IN_VOXELS | NO_ENTRY_POINTS,
                                   ENTRY_POINTS | BY_DIRECTION | LAST_TRIANGLE,
                                   IN_VOXELS | ENTRY_POINTS | NO_FUSION,
                                   NO_FUSION | LAST_TRIANGLE | BY_DIRECTION,
                                   ENTRY_POINTS | LAST_TRIANGLE,
                                   NO_FUSION | NO_ENTRY_POINTS,
                                   BY_BEAMS | NO_FUSION};
    mode_list list = {0, NULL};
    int orders[8], order_count = 0, isas[8], isa_count = 0;
    for (int order = VOCC_ORDER_AUTO; order <= VOCC_ORDER_RTSAH; order++)
        if (has_order(order))
            orders[order_count++] = order;
    for (int isa = VOCC_ISA_SCALAR; isa <= VOCC_ISA_NEON; isa++)
        if (has_isa(isa))
            isas[isa_count++] = isa;
    const size_t most = (size_t)(order_count * isa_count * 4 * length(caches) *
                                 length(deferments) * length(threads));
    list.modes = malloc(most * sizeof(mode));
    REQUIRE(list.modes);
    for (int o = 0; o < order_count; o++)
        for (int i = 0; i < isa_count; i++)
            for (int flags = 0; flags < 4; flags++)
                for (const int *c = caches; *c >= 0; c++)
                    for (const int *d = deferments; *d >= 0; d++)
                        for (const int *t = threads; *t >= 0; t++) {
                            const mode m = {
                                orders[o],  flags & 1,
                                *c,         *d,
                                flags >> 1, isas[i],
                                *t,         extras[list.count % 13]};
                            list.modes[list.count++] = m;
                        }
    return list;
}

void modes_free(mode_list *list)
{
    free(list->modes);
    list->modes = NULL;
    list->count = 0;
}

/* ---- answers ----------------------------------------------------------- */

void trace_some(const world *w, const ray_set *set, size_t first, size_t count,
                const mode *m, uint8_t *occluded, vocc_counters *counters)
{
    vocc_query_options options;
    vocc_error error;
    mode_options(m, &options);
    options.counters = counters;
    const vocc_rays rays = rays_view(set, first, count);
    memset(occluded, 0xee, count);
    const vocc_status status =
        vocc_occluded(w->scene, &rays, occluded, &options, &error);
    if (status != VOCC_OK) {
        test_fail(__FILE__, __LINE__, "%s: %s", mode_text(m), error.message);
        test_leave();
    }
}

void trace(const world *w, const ray_set *set, const mode *m, uint8_t *occluded,
           vocc_counters *counters)
{
    trace_some(w, set, 0, set->count, m, occluded, counters);
}

const char *ray_text(const oracle_ray *ray)
{
    static char text[320];
    snprintf(text, sizeof(text),
             "org {%a, %a, %a} dir {%a, %a, %a} tmin %a tmax %a",
             (double)ray->org[0], (double)ray->org[1], (double)ray->org[2],
             (double)ray->dir[0], (double)ray->dir[1], (double)ray->dir[2],
             (double)ray->tmin, (double)ray->tmax);
    return text;
}

void compare_some(const char *file, int line, const char *shape_name,
                  const ray_set *set, size_t first, size_t count, const mode *m,
                  const uint8_t *actual, const uint8_t *expected)
{
    test_compared(count);
    if (memcmp(actual, expected, count) == 0)
        return;
    size_t at = count, wrong = 0;
    for (size_t i = count; i-- > 0;) {
        if (actual[i] != expected[i]) {
            at = i;
            wrong++;
        }
    }
    test_fail(file, line,
              "%s: %s: %zu of %zu rays differ; ray %zu (%s) is %d, not %d: %s",
              shape_name, mode_text(m), wrong, count, first + at,
              ray_kind_name(set->kinds[first + at]), actual[at], expected[at],
              ray_text(&set->rays[first + at]));
}

void compare_answers(const char *file, int line, const char *shape_name,
                     const ray_set *set, const mode *m, const uint8_t *actual,
                     const uint8_t *expected)
{
    compare_some(file, line, shape_name, set, 0, set->count, m, actual,
                 expected);
}
