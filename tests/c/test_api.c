/* Guards the documented errors: each bad argument of each public function
 * gives its status, names the argument, the row and the value in a readable
 * sentence, and leaves the scene as it was. */
#include "world.h"

#include <float.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "test.h"

static const float corner_vertices[12] = {0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1};
static const int32_t corner_triangles[12] = {0, 2, 1, 0, 1, 3,
                                             0, 3, 2, 1, 2, 3};

static vocc_array vertices_ok(void)
{
    return rows_of(corner_vertices, 12, VOCC_FLOAT32);
}

static vocc_array triangles_ok(void)
{
    return rows_of(corner_triangles, 12, VOCC_INT32);
}

static vocc_scene *empty_scene(void)
{
    vocc_scene *scene = NULL;
    REQUIRE(vocc_scene_create(NULL, &scene, NULL) == VOCC_OK);
    return scene;
}

static vocc_scene *tetrahedron(void)
{
    vocc_scene *scene = empty_scene();
    REQUIRE(vocc_scene_add_mesh(scene, 4, vertices_ok(), 4, triangles_ok(),
                                NULL, NULL, NULL) == VOCC_OK);
    REQUIRE(vocc_scene_build(scene, NULL, NULL) == VOCC_OK);
    return scene;
}

/* The error is filled: status, argument, row, value, and a message that
 * has what matters in it. */
static void check_error(int line, vocc_status status, const vocc_error *error,
                        vocc_status expected, const char *argument,
                        int64_t index, double value)
{
    if (status != expected) {
        test_fail(__FILE__, line, "status \"%s\", not \"%s\"",
                  vocc_status_string((int32_t)status),
                  vocc_status_string((int32_t)expected));
        return;
    }
    if (error->status != (int32_t)expected)
        test_fail(__FILE__, line, "error.status is %d", (int)error->status);
    if (strcmp(error->argument, argument) != 0)
        test_fail(__FILE__, line, "error.argument is \"%s\", not \"%s\"",
                  error->argument, argument);
    if (error->index != index)
        test_fail(__FILE__, line, "error.index is %lld, not %lld (%s)",
                  (long long)error->index, (long long)index, error->message);
    if (!(error->value == value || (isnan(error->value) && isnan(value))))
        test_fail(__FILE__, line, "error.value is %g, not %g (%s)",
                  error->value, value, error->message);
    if (strlen(error->message) < 8 ||
        memchr(error->message, 0, sizeof(error->message)) == NULL)
        test_fail(__FILE__, line, "error.message is \"%.190s\"",
                  error->message);
    if (expected == VOCC_ERROR_INVALID_ARGUMENT &&
        strstr(error->message, argument) == NULL)
        test_fail(__FILE__, line, "\"%s\" does not name %s", error->message,
                  argument);
    if (index >= 0) {
        char text[32];
        snprintf(text, sizeof(text), "%lld", (long long)index);
        if (strstr(error->message, text) == NULL)
            test_fail(__FILE__, line, "\"%s\" does not name row %s",
                      error->message, text);
    }
}

#define EXPECT(call, expected, argument, index, value)                         \
    do {                                                                       \
        vocc_error error;                                                      \
        memset(&error, 0x5a, sizeof(error));                                   \
        const vocc_status status = (call);                                     \
        check_error(__LINE__, status, &error, (expected), (argument), (index), \
                    (double)(value));                                          \
    } while (0)

#define INVALID VOCC_ERROR_INVALID_ARGUMENT

/* ---- strings, create, free --------------------------------------------- */

static void strings(void)
{
    for (int32_t i = VOCC_OK; i <= VOCC_ERROR_THREAD; i++) {
        CHECK(strlen(vocc_status_string(i)) > 1);
        for (int32_t j = VOCC_OK; j < i; j++)
            CHECK(strcmp(vocc_status_string(i), vocc_status_string(j)) != 0);
    }
    CHECK(strlen(vocc_status_string(-1)) > 1);
    CHECK(strlen(vocc_status_string(INT32_MAX)) > 1);
    char version[32];
    snprintf(version, sizeof(version), "%d.%d.%d", VOCC_VERSION_MAJOR,
             VOCC_VERSION_MINOR, VOCC_VERSION_PATCH);
    CHECK_STRING(vocc_version(), version);
}

static void create(void)
{
    EXPECT(vocc_scene_create(NULL, NULL, &error), INVALID, "scene", -1, NAN);
    CHECK_INT(vocc_scene_create(NULL, NULL, NULL), INVALID);

    counting *memory = counting_create();
    vocc_allocator allocator = counting_allocator(memory);
    vocc_scene *scene = (vocc_scene *)(void *)memory;
    allocator.allocate = NULL;
    EXPECT(vocc_scene_create(&allocator, &scene, &error), INVALID, "allocator",
           -1, NAN);
    CHECK(scene == NULL);
    allocator = counting_allocator(memory);
    allocator.deallocate = NULL;
    scene = (vocc_scene *)(void *)memory;
    EXPECT(vocc_scene_create(&allocator, &scene, &error), INVALID, "allocator",
           -1, NAN);
    CHECK(scene == NULL);
    CHECK_INT(counting_calls(memory), 0);

    /* The allocator is copied. */
    allocator = counting_allocator(memory);
    CHECK_INT(vocc_scene_create(&allocator, &scene, NULL), VOCC_OK);
    memset(&allocator, 0, sizeof(allocator));
    CHECK(counting_live_blocks(memory) > 0);
    vocc_scene_free(scene);
    vocc_scene_free(NULL);
    counting_free(memory);
}

/* ---- add_mesh ---------------------------------------------------------- */

static void add_mesh_pointers(void)
{
    vocc_scene *scene = empty_scene();
    EXPECT(vocc_scene_add_mesh(NULL, 4, vertices_ok(), 4, triangles_ok(), NULL,
                               NULL, &error),
           INVALID, "scene", -1, NAN);
    vocc_array null_rows = vertices_ok();
    null_rows.data = NULL;
    EXPECT(vocc_scene_add_mesh(scene, 4, null_rows, 4, triangles_ok(), NULL,
                               NULL, &error),
           INVALID, "vertices", -1, NAN);
    null_rows = triangles_ok();
    null_rows.data = NULL;
    EXPECT(vocc_scene_add_mesh(scene, 4, vertices_ok(), 4, null_rows, NULL,
                               NULL, &error),
           INVALID, "triangles", -1, NAN);
    /* Everything without an error struct. */
    CHECK_INT(vocc_scene_add_mesh(scene, 4, vertices_ok(), 4, null_rows, NULL,
                                  NULL, NULL),
              INVALID);

    vocc_mesh_options options;
    vocc_mesh_options_init(&options);
    CHECK_INT(options.size, sizeof(options));
    CHECK_INT(options.occluder, 1);
    CHECK(options.name == NULL);
    options.size = sizeof(options) - 4;
    EXPECT(vocc_scene_add_mesh(scene, 4, vertices_ok(), 4, triangles_ok(),
                               &options, NULL, &error),
           INVALID, "options", -1, (double)(sizeof(options) - 4));
    options.size = 0;
    EXPECT(vocc_scene_add_mesh(scene, 4, vertices_ok(), 4, triangles_ok(),
                               &options, NULL, &error),
           INVALID, "options", -1, 0.0);

    /* Nothing was added by all of that. */
    int32_t geom_id = -5;
    CHECK_INT(vocc_scene_add_mesh(scene, 4, vertices_ok(), 4, triangles_ok(),
                                  NULL, &geom_id, NULL),
              VOCC_OK);
    CHECK_INT(geom_id, 0);
    CHECK_INT(vocc_scene_build(scene, NULL, NULL), VOCC_OK);
    vocc_report report;
    report.size = sizeof(report);
    CHECK_INT(vocc_scene_report(scene, &report, NULL), VOCC_OK);
    CHECK_INT(report.mesh_count, 1);
    CHECK_INT(report.triangle_count, 4);
    vocc_scene_free(scene);
}

static void add_mesh_types(void)
{
    static const int32_t not_floats[] = {0, VOCC_INT32, VOCC_UINT64, 7, -1};
    static const int32_t not_integers[] = {0, VOCC_FLOAT32, VOCC_FLOAT64, 7,
                                           INT32_MAX};
    vocc_scene *scene = empty_scene();
    for (size_t i = 0; i < sizeof(not_floats) / sizeof(not_floats[0]); i++) {
        vocc_array bad = vertices_ok();
        bad.type = not_floats[i];
        EXPECT(vocc_scene_add_mesh(scene, 4, bad, 4, triangles_ok(), NULL, NULL,
                                   &error),
               INVALID, "vertices", -1, (double)not_floats[i]);
        bad = triangles_ok();
        bad.type = not_integers[i];
        EXPECT(vocc_scene_add_mesh(scene, 4, vertices_ok(), 4, bad, NULL, NULL,
                                   &error),
               INVALID, "triangles", -1, (double)not_integers[i]);
    }
    vocc_scene_free(scene);
}

static void add_mesh_values(void)
{
    static const float bad_floats[] = {NAN, HUGE_VALF, -HUGE_VALF};
    static const double bad_doubles[] = {(double)NAN, HUGE_VAL, -HUGE_VAL,
                                         1e300,       -1e39,    3.5e38};
    vocc_scene *scene = empty_scene();
    for (int at = 0; at < 12; at++) {
        for (size_t i = 0; i < 3; i++) {
            float v[12];
            memcpy(v, corner_vertices, sizeof(v));
            v[at] = bad_floats[i];
            EXPECT(vocc_scene_add_mesh(scene, 4, rows_of(v, 12, VOCC_FLOAT32),
                                       4, triangles_ok(), NULL, NULL, &error),
                   INVALID, "vertices", at / 3, (double)bad_floats[i]);
        }
        for (size_t i = 0; i < 6; i++) {
            double v[12];
            for (int k = 0; k < 12; k++)
                v[k] = (double)corner_vertices[k];
            v[at] = bad_doubles[i];
            EXPECT(vocc_scene_add_mesh(scene, 4, rows_of(v, 24, VOCC_FLOAT64),
                                       4, triangles_ok(), NULL, NULL, &error),
                   INVALID, "vertices", at / 3, bad_doubles[i]);
        }
    }
    /* The first offender is the one that is named. */
    float two[12];
    memcpy(two, corner_vertices, sizeof(two));
    two[4] = NAN;
    two[10] = HUGE_VALF;
    EXPECT(vocc_scene_add_mesh(scene, 4, rows_of(two, 12, VOCC_FLOAT32), 4,
                               triangles_ok(), NULL, NULL, &error),
           INVALID, "vertices", 1, NAN);
    vocc_scene_free(scene);
}

static void add_mesh_indices(void)
{
    vocc_scene *scene = empty_scene();
    for (int at = 0; at < 12; at++) {
        int32_t i32[12];
        uint32_t u32[12];
        int64_t i64[12];
        uint64_t u64[12];
        for (int k = 0; k < 12; k++) {
            i32[k] = corner_triangles[k];
            u32[k] = (uint32_t)corner_triangles[k];
            i64[k] = corner_triangles[k];
            u64[k] = (uint64_t)corner_triangles[k];
        }
        static const int64_t bad[] = {
            4,         -1,        INT32_MAX,        INT32_MIN,
            INT64_MAX, INT64_MIN, INT64_C(1) << 32, (INT64_C(1) << 32) + 1,
            UINT32_MAX};
        for (size_t i = 0; i < sizeof(bad) / sizeof(bad[0]); i++) {
            if (bad[i] >= INT32_MIN && bad[i] <= INT32_MAX) {
                i32[at] = (int32_t)bad[i];
                EXPECT(vocc_scene_add_mesh(scene, 4, vertices_ok(), 4,
                                           rows_of(i32, 12, VOCC_INT32), NULL,
                                           NULL, &error),
                       INVALID, "triangles", at / 3, (double)bad[i]);
            }
            if (bad[i] >= 0 && bad[i] <= UINT32_MAX) {
                u32[at] = (uint32_t)bad[i];
                EXPECT(vocc_scene_add_mesh(scene, 4, vertices_ok(), 4,
                                           rows_of(u32, 12, VOCC_UINT32), NULL,
                                           NULL, &error),
                       INVALID, "triangles", at / 3, (double)bad[i]);
            }
            i64[at] = bad[i];
            EXPECT(vocc_scene_add_mesh(scene, 4, vertices_ok(), 4,
                                       rows_of(i64, 24, VOCC_INT64), NULL, NULL,
                                       &error),
                   INVALID, "triangles", at / 3, (double)bad[i]);
            u64[at] = (uint64_t)bad[i]; /* huge for the negative ones */
            EXPECT(vocc_scene_add_mesh(scene, 4, vertices_ok(), 4,
                                       rows_of(u64, 24, VOCC_UINT64), NULL,
                                       NULL, &error),
                   INVALID, "triangles", at / 3, (double)u64[at]);
        }
    }
    /* No vertices at all: every index is too large. */
    EXPECT(vocc_scene_add_mesh(scene, 0, vertices_ok(), 1, triangles_ok(), NULL,
                               NULL, &error),
           INVALID, "triangles", 0, 0.0);
    vocc_scene_free(scene);
}

static void add_mesh_counts(void)
{
    static const size_t too_many[] = {SIZE_MAX, SIZE_MAX / 2, SIZE_MAX / 12 + 1,
                                      (size_t)1 << 31};
    vocc_scene *scene = empty_scene();
    vocc_array one = vertices_ok();
    one.stride = 0;
    for (size_t i = 0; i < sizeof(too_many) / sizeof(too_many[0]); i++) {
        /* One row stands for all: the count is bad, not the memory. */
        EXPECT(vocc_scene_add_mesh(scene, too_many[i], one, 4, triangles_ok(),
                                   NULL, NULL, &error),
               VOCC_ERROR_LIMIT, "vertex_count", -1, (double)too_many[i]);
        vocc_array row = triangles_ok();
        row.stride = 0;
        EXPECT(vocc_scene_add_mesh(scene, 4, vertices_ok(), too_many[i], row,
                                   NULL, NULL, &error),
               VOCC_ERROR_LIMIT, "triangle_count", -1, (double)too_many[i]);
    }
    vocc_array row = triangles_ok();
    row.stride = 0;
    EXPECT(vocc_scene_add_mesh(scene, 4, vertices_ok(), ((size_t)1 << 27) + 1,
                               row, NULL, NULL, &error),
           VOCC_ERROR_LIMIT, "triangle_count", -1,
           (double)(((size_t)1 << 27) + 1));
    vocc_scene_free(scene);
}

/* Strides, types and alignment that must work give the same scene. */
static void add_mesh_layouts(void)
{
    struct padded {
        char gap;
        float v[3];
        double w[3];
        int64_t i64[3];
        uint64_t u64[3];
        uint32_t u32[3];
        int32_t i32[3];
    } rows[4], backward[4];
    for (int i = 0; i < 4; i++) {
        for (int k = 0; k < 3; k++) {
            rows[i].v[k] = corner_vertices[3 * i + k];
            rows[i].w[k] = (double)corner_vertices[3 * i + k];
            rows[i].i32[k] = corner_triangles[3 * i + k];
            rows[i].u32[k] = (uint32_t)corner_triangles[3 * i + k];
            rows[i].i64[k] = corner_triangles[3 * i + k];
            rows[i].u64[k] = (uint64_t)corner_triangles[3 * i + k];
        }
    }
    for (int i = 0; i < 4; i++)
        backward[i] = rows[3 - i];
    const size_t stride = sizeof(rows[0]);
    vocc_array float_rows[4] = {rows_of(rows[0].v, stride, VOCC_FLOAT32),
                                rows_of(rows[0].w, stride, VOCC_FLOAT64),
                                rows_of(backward[3].v, stride, VOCC_FLOAT32),
                                rows_of(backward[3].w, stride, VOCC_FLOAT64)};
    float_rows[2].stride = -float_rows[2].stride;
    float_rows[3].stride = -float_rows[3].stride;
    vocc_array index_rows[5] = {rows_of(rows[0].i32, stride, VOCC_INT32),
                                rows_of(rows[0].u32, stride, VOCC_UINT32),
                                rows_of(rows[0].i64, stride, VOCC_INT64),
                                rows_of(rows[0].u64, stride, VOCC_UINT64),
                                rows_of(backward[3].i64, stride, VOCC_INT64)};
    index_rows[4].stride = -index_rows[4].stride;

    vocc_scene *scene = empty_scene();
    for (int i = 0; i < 20; i++) {
        int32_t geom_id = -1;
        vocc_error error;
        CHECK_STATUS(vocc_scene_add_mesh(scene, 4, float_rows[i % 4], 4,
                                         index_rows[i / 4], NULL, &geom_id,
                                         &error),
                     &error, VOCC_OK);
        CHECK_INT(geom_id, i);
    }
    /* They are copies. */
    memset(rows, 0, sizeof(rows));
    memset(backward, 0, sizeof(backward));
    CHECK_INT(vocc_scene_build(scene, NULL, NULL), VOCC_OK);
    for (int i = 0; i < 20; i++) {
        vocc_mesh_report report;
        report.size = sizeof(report);
        CHECK_INT(vocc_scene_mesh_report(scene, i, &report, NULL), VOCC_OK);
        CHECK_INT(report.closed, 1);
        CHECK_NEAR(report.volume, 1.0 / 6.0, 1e-12);
    }
    vocc_scene_free(scene);
}

static void add_mesh_names(void)
{
    static const struct {
        const char *given, *kept;
    } names[] = {
        {NULL, ""},
        {"", ""},
        {"bunny", "bunny"},
        {"123456789 123456789 123456789 123456789 123456789 123456789 123",
         "123456789 123456789 123456789 123456789 123456789 123456789 123"},
        {"123456789 123456789 123456789 123456789 123456789 123456789 1234567",
         "123456789 123456789 123456789 123456789 123456789 123456789 123"},
        /* A character of two bytes is not cut in half. */
        {"123456789 123456789 123456789 123456789 123456789 123456789 12\xc3"
         "\xa4",
         "123456789 123456789 123456789 123456789 123456789 123456789 12"},
    };
    vocc_scene *scene = empty_scene();
    const int count = (int)(sizeof(names) / sizeof(names[0]));
    for (int i = 0; i < count; i++) {
        vocc_mesh_options options;
        vocc_mesh_options_init(&options);
        options.name = names[i].given;
        options.occluder = i % 2;
        CHECK_INT(vocc_scene_add_mesh(scene, 4, vertices_ok(), 4,
                                      triangles_ok(), &options, NULL, NULL),
                  VOCC_OK);
    }
    CHECK_INT(vocc_scene_build(scene, NULL, NULL), VOCC_OK);
    for (int i = 0; i < count; i++) {
        vocc_mesh_report report;
        report.size = sizeof(report);
        CHECK_INT(vocc_scene_mesh_report(scene, i, &report, NULL), VOCC_OK);
        CHECK_STRING(report.name, names[i].kept);
        CHECK_INT(report.occluder, i % 2);
    }
    vocc_scene_free(scene);
}

/* ---- build ------------------------------------------------------------- */

static void build_options(void)
{
    vocc_scene *scene = empty_scene();
    CHECK_INT(vocc_scene_add_mesh(scene, 4, vertices_ok(), 4, triangles_ok(),
                                  NULL, NULL, NULL),
              VOCC_OK);
    EXPECT(vocc_scene_build(NULL, NULL, &error), INVALID, "scene", -1, NAN);
    vocc_build_options defaults;
    memset(&defaults, 0x5a, sizeof(defaults));
    vocc_build_options_init(&defaults);
    CHECK_INT(defaults.size, sizeof(defaults));
    CHECK_INT(defaults.threads, 0);
    CHECK_NEAR(defaults.traversal_cost, 1.0, 0);
    CHECK_NEAR(defaults.intersection_cost, 0.0f, 0);
    CHECK_NEAR(defaults.empty_bonus, 0.2f, 0);
    CHECK_INT(defaults.max_leaf_size, 64);
    CHECK_INT(defaults.max_depth, 0);
    CHECK_INT(defaults.bad_refines, 0);
    CHECK_INT(defaults.strict, 0);
    CHECK(defaults.progress == NULL);

    vocc_build_options o = defaults;
    o.size++;
    EXPECT(vocc_scene_build(scene, &o, &error), INVALID, "options", -1,
           (double)o.size);
#define BAD(field, bad_value)                                                  \
    do {                                                                       \
        o = defaults;                                                          \
        o.field = (bad_value);                                                 \
        EXPECT(vocc_scene_build(scene, &o, &error), INVALID, #field, -1,       \
               (double)(bad_value));                                           \
    } while (0)
    BAD(threads, -1);
    BAD(threads, 257);
    BAD(threads, INT32_MIN);
    BAD(traversal_cost, 0.0f);
    BAD(traversal_cost, -1.0f);
    BAD(traversal_cost, NAN);
    BAD(traversal_cost, HUGE_VALF);
    BAD(intersection_cost, -2.5f);
    BAD(intersection_cost, NAN);
    BAD(intersection_cost, HUGE_VALF);
    BAD(empty_bonus, -0.5f);
    BAD(empty_bonus, 1.5f);
    BAD(empty_bonus, NAN);
    BAD(max_leaf_size, 0);
    BAD(max_leaf_size, -3);
    BAD(max_leaf_size, (1 << 20) + 1);
    BAD(max_depth, -1);
    BAD(max_depth, 61);
    BAD(bad_refines, -1);
    BAD(bad_refines, 17);
#undef BAD
    /* Still usable. */
    CHECK_INT(vocc_scene_build(scene, &defaults, NULL), VOCC_OK);
    vocc_scene_free(scene);
}

static void life_cycle(void)
{
    vocc_scene *scene = empty_scene();
    const float org[3] = {0.25f, 0.25f, -1}, dir[3] = {0, 0, 1};
    vocc_rays rays;
    memset(&rays, 0, sizeof(rays));
    rays.count = 1;
    rays.org = rows_of(org, 12, VOCC_FLOAT32);
    rays.dir = rows_of(dir, 12, VOCC_FLOAT32);
    uint8_t occluded = 9;
    int32_t ids[2] = {0, 0};
    size_t count = 0;
    vocc_hits hits;
    memset(&hits, 0, sizeof(hits));
    hits.geom_id = ids;
    const vocc_light light = RECT(0, 0, 3, 1, 0, 0, 0, 1, 0);
    uint16_t visible = 0;
    vocc_array none;
    memset(&none, 0, sizeof(none));
    vocc_report report;
    vocc_mesh_report mesh_report;
    vocc_component_report component_report;
    vocc_leaf leaf;
    report.size = sizeof(report);
    mesh_report.size = sizeof(mesh_report);
    component_report.size = sizeof(component_report);

    /* Before the build: every query and report says so. */
    EXPECT(vocc_occluded(scene, &rays, &occluded, NULL, &error),
           VOCC_ERROR_NOT_BUILT, "", -1, NAN);
    EXPECT(vocc_intersect(scene, &rays, &hits, NULL, &error),
           VOCC_ERROR_NOT_BUILT, "", -1, NAN);
    EXPECT(vocc_region(scene, 1, rays.org, ids, NULL, &error),
           VOCC_ERROR_NOT_BUILT, "", -1, NAN);
    EXPECT(vocc_light_visibility(scene, 1, rays.org, rays.dir, none, 1, &light,
                                 SAMPLING(4), &visible, NULL, NULL, NULL,
                                 &error),
           VOCC_ERROR_NOT_BUILT, "", -1, NAN);
    EXPECT(vocc_scene_report(scene, &report, &error), VOCC_ERROR_NOT_BUILT, "",
           -1, NAN);
    EXPECT(vocc_scene_leaves(scene, 1, &leaf, &count, &error),
           VOCC_ERROR_NOT_BUILT, "", -1, NAN);
    EXPECT(vocc_scene_references(scene, 0, 0, ids, &error),
           VOCC_ERROR_NOT_BUILT, "", -1, NAN);
    EXPECT(vocc_scene_region_info(scene, 0, 0, NULL, NULL, &count, &error),
           VOCC_ERROR_NOT_BUILT, "", -1, NAN);
    EXPECT(vocc_scene_component_report(scene, 0, &component_report, &error),
           VOCC_ERROR_NOT_BUILT, "", -1, NAN);
    CHECK_INT(occluded, 9);
    double origin[3];
    CHECK_INT(vocc_scene_origin(scene, origin), VOCC_ERROR_NOT_BUILT);

    CHECK_INT(vocc_scene_add_mesh(scene, 4, vertices_ok(), 4, triangles_ok(),
                                  NULL, NULL, NULL),
              VOCC_OK);
    CHECK_INT(vocc_scene_build(scene, NULL, NULL), VOCC_OK);
    /* After it: frozen. */
    EXPECT(vocc_scene_add_mesh(scene, 4, vertices_ok(), 4, triangles_ok(), NULL,
                               NULL, &error),
           VOCC_ERROR_FROZEN, "", -1, NAN);
    EXPECT(vocc_scene_build(scene, NULL, &error), VOCC_ERROR_FROZEN, "", -1,
           NAN);
    CHECK_INT(vocc_scene_origin(scene, origin), VOCC_OK);
    CHECK_NEAR(origin[0], 0, 0);
    CHECK_NEAR(origin[1], 0, 0);
    CHECK_NEAR(origin[2], 0, 0);
    CHECK_INT(vocc_scene_origin(scene, NULL), INVALID);
    CHECK_INT(vocc_scene_origin(NULL, origin), INVALID);
    CHECK_INT(vocc_occluded(scene, &rays, &occluded, NULL, NULL), VOCC_OK);
    CHECK_INT(occluded, 1);
    vocc_scene_free(scene);
}

static void strict(void)
{
    vocc_build_options options;
    vocc_build_options_init(&options);
    options.strict = 1;
    /* Mesh 1 is open, and an occluder: refused, by its number. */
    vocc_scene *scene = empty_scene();
    CHECK_INT(vocc_scene_add_mesh(scene, 4, vertices_ok(), 4, triangles_ok(),
                                  NULL, NULL, NULL),
              VOCC_OK);
    CHECK_INT(vocc_scene_add_mesh(scene, 4, vertices_ok(), 3, triangles_ok(),
                                  NULL, NULL, NULL),
              VOCC_OK);
    vocc_error error;
    memset(&error, 0, sizeof(error));
    CHECK_INT(vocc_scene_build(scene, &options, &error), VOCC_ERROR_OPEN_MESH);
    CHECK_INT(error.status, VOCC_ERROR_OPEN_MESH);
    CHECK_INT(error.index, 1);
    CHECK(strlen(error.message) > 8);
    /* The scene is as it was: it can be built without `strict`. */
    options.strict = 0;
    CHECK_STATUS(vocc_scene_build(scene, &options, &error), &error, VOCC_OK);
    vocc_scene_free(scene);

    options.strict = 1;
    scene = empty_scene();
    vocc_mesh_options exempt;
    vocc_mesh_options_init(&exempt);
    exempt.occluder = 0;
    CHECK_INT(vocc_scene_add_mesh(scene, 4, vertices_ok(), 3, triangles_ok(),
                                  &exempt, NULL, NULL),
              VOCC_OK);
    CHECK_INT(vocc_scene_add_mesh(scene, 4, vertices_ok(), 4, triangles_ok(),
                                  NULL, NULL, NULL),
              VOCC_OK);
    CHECK_STATUS(vocc_scene_build(scene, &options, &error), &error, VOCC_OK);
    vocc_scene_free(scene);
}

/* ---- reports ----------------------------------------------------------- */

static void report_arguments(void)
{
    vocc_scene *scene = tetrahedron();
    vocc_report report;
    vocc_mesh_report mesh_report;
    vocc_component_report component_report;
    vocc_leaf leaf;
    int32_t ids[2];
    size_t count = 0;
    memset(&report, 0, sizeof(report));
    report.size = sizeof(report);
    EXPECT(vocc_scene_report(NULL, &report, &error), INVALID, "scene", -1, NAN);
    EXPECT(vocc_scene_report(scene, NULL, &error), INVALID, "report", -1, NAN);
    report.size = 12;
    EXPECT(vocc_scene_report(scene, &report, &error), INVALID, "report", -1,
           12.0);

    mesh_report.size = sizeof(mesh_report);
    EXPECT(vocc_scene_mesh_report(NULL, 0, &mesh_report, &error), INVALID,
           "scene", -1, NAN);
    EXPECT(vocc_scene_mesh_report(scene, 0, NULL, &error), INVALID, "report",
           -1, NAN);
    EXPECT(vocc_scene_mesh_report(scene, 1, &mesh_report, &error), INVALID,
           "geom_id", -1, 1.0);
    EXPECT(vocc_scene_mesh_report(scene, -1, &mesh_report, &error), INVALID,
           "geom_id", -1, -1.0);
    mesh_report.size = 0;
    EXPECT(vocc_scene_mesh_report(scene, 0, &mesh_report, &error), INVALID,
           "report", -1, 0.0);

    component_report.size = sizeof(component_report);
    EXPECT(vocc_scene_component_report(NULL, 0, &component_report, &error),
           INVALID, "scene", -1, NAN);
    EXPECT(vocc_scene_component_report(scene, 0, NULL, &error), INVALID,
           "report", -1, NAN);
    EXPECT(vocc_scene_component_report(scene, 1, &component_report, &error),
           INVALID, "component", -1, 1.0);
    EXPECT(vocc_scene_component_report(scene, -7, &component_report, &error),
           INVALID, "component", -1, -7.0);
    component_report.size = 1;
    EXPECT(vocc_scene_component_report(scene, 0, &component_report, &error),
           INVALID, "report", -1, 1.0);

    EXPECT(vocc_scene_open_edges(NULL, 0, 0, NULL, &count, &error), INVALID,
           "scene", -1, NAN);
    EXPECT(vocc_scene_open_edges(scene, 2, 0, NULL, &count, &error), INVALID,
           "geom_id", -1, 2.0);
    EXPECT(vocc_scene_open_edges(scene, 0, 1, NULL, &count, &error), INVALID,
           "edges", -1, NAN);
    EXPECT(vocc_scene_open_edges(scene, 0, 0, NULL, NULL, &error), INVALID,
           "count", -1, NAN);

    EXPECT(vocc_scene_region_info(NULL, 1, 0, NULL, NULL, &count, &error),
           INVALID, "scene", -1, NAN);
    EXPECT(vocc_scene_region_info(scene, -1, 0, NULL, NULL, &count, &error),
           INVALID, "region", -1, -1.0);
    EXPECT(vocc_scene_region_info(scene, 99, 0, NULL, NULL, &count, &error),
           INVALID, "region", -1, 99.0);
    EXPECT(vocc_scene_region_info(scene, 1, 0, NULL, NULL, NULL, &error),
           INVALID, "count", -1, NAN);
    EXPECT(vocc_scene_region_info(scene, 1, 1, NULL, ids, &count, &error),
           INVALID, "components", -1, NAN);
    EXPECT(vocc_scene_region_info(scene, 1, 1, ids, NULL, &count, &error),
           INVALID, "windings", -1, NAN);

    EXPECT(vocc_scene_leaves(NULL, 1, &leaf, &count, &error), INVALID, "scene",
           -1, NAN);
    EXPECT(vocc_scene_leaves(scene, 1, NULL, &count, &error), INVALID, "leaves",
           -1, NAN);
    EXPECT(vocc_scene_leaves(scene, 1, &leaf, NULL, &error), INVALID, "count",
           -1, NAN);

    report.size = sizeof(report);
    CHECK_INT(vocc_scene_report(scene, &report, NULL), VOCC_OK);
    const uint64_t references = report.reference_count;
    CHECK(references >= 4);
    EXPECT(vocc_scene_references(NULL, 0, 1, ids, &error), INVALID, "scene", -1,
           NAN);
    EXPECT(vocc_scene_references(scene, 0, 1, NULL, &error), INVALID, "ids", -1,
           NAN);
    EXPECT(vocc_scene_references(scene, references, 1, ids, &error), INVALID,
           "first", -1, (double)references);
    EXPECT(vocc_scene_references(scene, 0, (size_t)references + 1, ids, &error),
           INVALID, "count", -1, (double)references + 1.0);
    EXPECT(vocc_scene_references(scene, 1, SIZE_MAX, ids, &error), INVALID,
           "count", -1, (double)SIZE_MAX);
    CHECK_INT(vocc_scene_references(scene, references, 0, NULL, NULL), VOCC_OK);

    vocc_scene_free(scene);
}

/* A capacity below the count writes that many and no more. */
static void capacities(void)
{
    vocc_scene *scene = empty_scene();
    CHECK_INT(vocc_scene_add_mesh(scene, 4, vertices_ok(), 3, triangles_ok(),
                                  NULL, NULL, NULL),
              VOCC_OK);
    CHECK_INT(vocc_scene_add_mesh(scene, 4, vertices_ok(), 4, triangles_ok(),
                                  NULL, NULL, NULL),
              VOCC_OK);
    CHECK_INT(vocc_scene_build(scene, NULL, NULL), VOCC_OK);

    size_t count = 0;
    int32_t edges[6];
    memset(edges, 0x77, sizeof(edges));
    CHECK_INT(vocc_scene_open_edges(scene, 0, 0, NULL, &count, NULL), VOCC_OK);
    CHECK_INT(count, 3);
    CHECK_INT(vocc_scene_open_edges(scene, 0, 1, edges, &count, NULL), VOCC_OK);
    CHECK_INT(count, 3);
    CHECK(edges[0] >= 0 && edges[0] < 3 && edges[1] >= 0 && edges[1] < 3);
    CHECK_INT(edges[2], 0x77777777);
    CHECK_INT(vocc_scene_open_edges(scene, 1, 3, edges, &count, NULL), VOCC_OK);
    CHECK_INT(count, 0);

    const float inside[3] = {0.1f, 0.1f, 0.1f};
    int32_t region = -9;
    CHECK_INT(vocc_region(scene, 1, rows_of(inside, 12, VOCC_FLOAT32), &region,
                          NULL, NULL),
              VOCC_OK);
    CHECK(region > 0);
    int32_t components[2] = {77, 77}, windings[2] = {77, 77};
    CHECK_INT(
        vocc_scene_region_info(scene, region, 0, NULL, NULL, &count, NULL),
        VOCC_OK);
    CHECK_INT(count, 1);
    CHECK_INT(vocc_scene_region_info(scene, region, 2, components, windings,
                                     &count, NULL),
              VOCC_OK);
    CHECK_INT(count, 1);
    CHECK_INT(components[0], 1);
    CHECK_INT(windings[0], 1);
    CHECK_INT(components[1], 77);
    CHECK_INT(windings[1], 77);
    CHECK_INT(
        vocc_scene_region_info(scene, 0, 2, components, windings, &count, NULL),
        VOCC_OK);
    CHECK_INT(count, 0);
    vocc_scene_free(scene);
}

static void capacity_of_leaves(void)
{
    shape s;
    world w;
    size_t count = 0, again = 0;
    shape_make(&s, 0, 0);
    world_make(&w, &s, NULL);
    CHECK_INT(vocc_scene_leaves(w.scene, 0, NULL, &count, NULL), VOCC_OK);
    REQUIRE(count > 1);
    vocc_leaf *leaves = malloc((count + 1) * sizeof(*leaves));
    REQUIRE(leaves);
    memset(leaves, 0x77, (count + 1) * sizeof(*leaves));
    CHECK_INT(vocc_scene_leaves(w.scene, count - 1, leaves, &again, NULL),
              VOCC_OK);
    CHECK_INT(again, count);
    CHECK(leaves[count - 2].label >= VOCC_BOUNDARY &&
          leaves[count - 2].label <= VOCC_OPAQUE);
    CHECK_INT(leaves[count - 1].label, 0x77777777);
    CHECK_INT(vocc_scene_leaves(w.scene, count + 1, leaves, &again, NULL),
              VOCC_OK);
    CHECK(leaves[count - 1].label >= VOCC_BOUNDARY &&
          leaves[count - 1].label <= VOCC_OPAQUE);
    CHECK_INT(leaves[count].label, 0x77777777);
    free(leaves);
    world_free(&w);
    shape_free(&s);
}

/* ---- queries ----------------------------------------------------------- */

typedef vocc_status (*query_fn)(const vocc_scene *scene, const vocc_rays *rays,
                                const vocc_query_options *options,
                                vocc_error *error);

static vocc_status call_occluded(const vocc_scene *scene, const vocc_rays *rays,
                                 const vocc_query_options *options,
                                 vocc_error *error)
{
    uint8_t out[4];
    return vocc_occluded(scene, rays, out, options, error);
}

static vocc_status call_intersect(const vocc_scene *scene,
                                  const vocc_rays *rays,
                                  const vocc_query_options *options,
                                  vocc_error *error)
{
    float t[4];
    vocc_hits hits;
    memset(&hits, 0, sizeof(hits));
    hits.t = t;
    return vocc_intersect(scene, rays, &hits, options, error);
}

static vocc_status call_region(const vocc_scene *scene, const vocc_rays *rays,
                               const vocc_query_options *options,
                               vocc_error *error)
{
    int32_t out[4];
    return vocc_region(scene, rays->count, rays->org, out, options, error);
}

static vocc_status call_light(const vocc_scene *scene, const vocc_rays *rays,
                              const vocc_query_options *options,
                              vocc_error *error)
{
    const vocc_light light = RECT(0, 0, 3, 1, 0, 0, 0, 1, 0);
    uint16_t out[4];
    vocc_array none;
    memset(&none, 0, sizeof(none));
    return vocc_light_visibility(scene, rays->count, rays->org, rays->dir, none,
                                 1, &light, SAMPLING(4), out, NULL, NULL,
                                 options, error);
}

static vocc_status call_classify_by_rays(const vocc_scene *scene,
                                         const vocc_rays *rays,
                                         const vocc_query_options *options,
                                         vocc_error *error)
{
    int32_t labels[4];
    vocc_ray_classification result;
    result.size = sizeof(result);
    return vocc_scene_classify_by_rays(scene, NULL, rays->count, labels,
                                       &result, options, error);
}

static const float two_org[6] = {0.25f, 0.25f, -1, 2, 2, 2};
static const float two_dir[6] = {0, 0, 1, 0, 1, 0};

static vocc_rays two_rays(void)
{
    vocc_rays rays;
    memset(&rays, 0, sizeof(rays));
    rays.count = 2;
    rays.org = rows_of(two_org, 12, VOCC_FLOAT32);
    rays.dir = rows_of(two_dir, 12, VOCC_FLOAT32);
    return rays;
}

static void query_options_of(query_fn query)
{
    vocc_scene *scene = tetrahedron();
    const vocc_rays rays = two_rays();
    vocc_query_options defaults;
    memset(&defaults, 0x5a, sizeof(defaults));
    vocc_query_options_init(&defaults);
    CHECK_INT(defaults.size, sizeof(defaults));
    CHECK_INT(defaults.order, VOCC_ORDER_AUTO);
    CHECK_INT(defaults.occluders, 1);
    CHECK_INT(defaults.deferment, 512);
    CHECK_INT(defaults.cache, 8);
    CHECK_INT(defaults.cache_policy, VOCC_CACHE_RECENT);
    CHECK_INT(defaults.fusion, 1);
    CHECK_INT(defaults.triangle_cache, 0);
    CHECK_INT(defaults.entry_points, -1);
    CHECK_INT(defaults.entry_triangles, 8);
    CHECK_INT(defaults.voxels, 0);
    CHECK(defaults.point_steps == NULL);
    CHECK_INT(defaults.packets, 1);
    CHECK_INT(defaults.isa, VOCC_ISA_AUTO);
    CHECK_INT(defaults.threads, 0);
    CHECK(defaults.progress == NULL);
    CHECK(defaults.counters == NULL);

    EXPECT(query(NULL, &rays, NULL, &error), INVALID, "scene", -1, NAN);
    vocc_query_options o = defaults;
    o.size = 8;
    EXPECT(query(scene, &rays, &o, &error), INVALID, "options", -1, 8.0);
#define BAD(field, bad_value)                                                  \
    do {                                                                       \
        o = defaults;                                                          \
        o.field = (bad_value);                                                 \
        EXPECT(query(scene, &rays, &o, &error), INVALID, #field, -1,           \
               (double)(bad_value));                                           \
    } while (0)
    BAD(order, -1);
    BAD(order, 8);
    BAD(occluders, 2);
    BAD(cache_policy, -1);
    BAD(cache_policy, 2);
    BAD(fusion, 2);
    BAD(triangle_cache, -1);
    BAD(entry_points, -2);
    BAD(entry_points, 2);
    BAD(entry_triangles, -1);
    BAD(entry_triangles, 65);
    BAD(voxels, -1);
    BAD(voxels, 1025);
    BAD(packets, 2);
    BAD(deferment, -1);
    BAD(deferment, 513);
    BAD(cache, -1);
    BAD(cache, 65);
    BAD(isa, -1);
    BAD(isa, 99);
    BAD(threads, -1);
    BAD(threads, 257);
#undef BAD
    CHECK_INT(query(scene, &rays, &defaults, NULL), VOCC_OK);
    CHECK_INT(query(scene, &rays, NULL, NULL), VOCC_OK);
    vocc_scene_free(scene);
}

static void query_options(void)
{
    query_options_of(call_occluded);
    query_options_of(call_intersect);
    query_options_of(call_region);
    query_options_of(call_light);
    query_options_of(call_classify_by_rays);
}

static void ray_arguments_of(query_fn query)
{
    vocc_scene *scene = tetrahedron();
    vocc_rays rays = two_rays();
    if (query == call_occluded || query == call_intersect) {
        const float limit[2] = {0, 1};
        rays.org.data = NULL;
        EXPECT(query(scene, &rays, NULL, &error), INVALID, "org", -1, NAN);
        rays = two_rays();
        rays.dir.data = NULL;
        EXPECT(query(scene, &rays, NULL, &error), INVALID, "dir", -1, NAN);
        rays = two_rays();
        rays.org.type = VOCC_INT32;
        EXPECT(query(scene, &rays, NULL, &error), INVALID, "org", -1,
               (double)VOCC_INT32);
        rays = two_rays();
        rays.dir.type = 0;
        EXPECT(query(scene, &rays, NULL, &error), INVALID, "dir", -1, 0.0);
        rays = two_rays();
        rays.tmin = rows_of(limit, 4, VOCC_UINT32);
        EXPECT(query(scene, &rays, NULL, &error), INVALID, "tmin", -1,
               (double)VOCC_UINT32);
        rays = two_rays();
        rays.tmax = rows_of(limit, 4, (vocc_type)42);
        EXPECT(query(scene, &rays, NULL, &error), INVALID, "tmax", -1, 42.0);
        EXPECT(query(scene, NULL, NULL, &error), INVALID, "rays", -1, NAN);
    }
    /* No rays: nothing is read, nothing is written. */
    rays = two_rays();
    rays.count = 0;
    rays.org.data = NULL;
    rays.dir.data = NULL;
    vocc_error error;
    CHECK_STATUS(query(scene, &rays, NULL, &error), &error, VOCC_OK);
    vocc_scene_free(scene);
}

static void ray_arguments(void)
{
    ray_arguments_of(call_occluded);
    ray_arguments_of(call_intersect);
    ray_arguments_of(call_region);
    ray_arguments_of(call_light);

    vocc_scene *scene = tetrahedron();
    const vocc_rays rays = two_rays();
    EXPECT(vocc_occluded(scene, &rays, NULL, NULL, &error), INVALID, "occluded",
           -1, NAN);
    EXPECT(vocc_intersect(scene, &rays, NULL, NULL, &error), INVALID, "hits",
           -1, NAN);
    vocc_hits hits;
    memset(&hits, 0, sizeof(hits));
    static const double offsets[] = {-1.0, HUGE_VAL, (double)NAN};
    for (int i = 0; i < 3; i++)
        EXPECT(vocc_shading_points(scene, &rays, offsets[i], &hits, NULL, NULL,
                                   NULL, &error),
               INVALID, "offset", -1, offsets[i]);
    int32_t region[2];
    vocc_array bad = rays.org;
    EXPECT(vocc_region(scene, 2, rays.org, NULL, NULL, &error), INVALID,
           "region", -1, NAN);
    bad.data = NULL;
    EXPECT(vocc_region(scene, 2, bad, region, NULL, &error), INVALID, "points",
           -1, NAN);
    bad = rays.org;
    bad.type = VOCC_UINT64;
    EXPECT(vocc_region(scene, 2, bad, region, NULL, &error), INVALID, "points",
           -1, (double)VOCC_UINT64);
    /* All outputs of intersect may be absent. */
    vocc_hits none;
    memset(&none, 0, sizeof(none));
    CHECK_INT(vocc_intersect(scene, &rays, &none, NULL, NULL), VOCC_OK);
    vocc_scene_free(scene);
}

static void light_arguments(void)
{
    vocc_scene *scene = tetrahedron();
    const vocc_array points = rows_of(two_org, 12, VOCC_FLOAT32);
    const vocc_array normals = rows_of(two_dir, 12, VOCC_FLOAT32);
    const uint32_t ids[2] = {3, 5};
    const vocc_array point_ids = rows_of(ids, 4, VOCC_UINT32);
    const vocc_light light = RECT(0, 0, 3, 1, 0, 0, 0, 1, 0);
    uint16_t out[2];
    vocc_array none, bad;
    memset(&none, 0, sizeof(none));
#define LIGHT(points_, normals_, ids_, n, lights_, samples_, out_)             \
    vocc_light_visibility(scene, 2, points_, normals_, ids_, n, lights_,       \
                          SAMPLING(samples_), out_, NULL, NULL, NULL, &error)
    EXPECT(LIGHT(none, normals, none, 1, &light, 4, out), INVALID, "points", -1,
           0.0);
    bad = points;
    bad.data = NULL;
    EXPECT(LIGHT(bad, normals, none, 1, &light, 4, out), INVALID, "points", -1,
           NAN);
    bad = normals;
    bad.data = NULL;
    EXPECT(LIGHT(points, bad, none, 1, &light, 4, out), INVALID, "normals", -1,
           NAN);
    bad.type = VOCC_INT64;
    EXPECT(LIGHT(points, bad, none, 1, &light, 4, out), INVALID, "normals", -1,
           (double)VOCC_INT64);
    bad = point_ids;
    bad.type = VOCC_INT32;
    EXPECT(LIGHT(points, normals, bad, 1, &light, 4, out), INVALID, "point_ids",
           -1, (double)VOCC_INT32);
    EXPECT(LIGHT(points, normals, none, 1, NULL, 4, out), INVALID, "lights", -1,
           NAN);
    EXPECT(LIGHT(points, normals, none, 1, &light, 0, out), INVALID, "samples",
           -1, 0.0);
    EXPECT(LIGHT(points, normals, none, 1, &light, -1, out), INVALID, "samples",
           -1, -1.0);
    EXPECT(LIGHT(points, normals, none, 1, &light, 65535, out), INVALID,
           "samples", -1, 65535.0);
    EXPECT(LIGHT(points, normals, none, 1, &light, 4, NULL), INVALID, "visible",
           -1, NAN);
    vocc_light bad_lights[3] = {light, light, light};
    bad_lights[2].edge_u[1] = (double)NAN;
    EXPECT(LIGHT(points, normals, none, 3, bad_lights, 4, out), INVALID,
           "lights", 2, NAN);
    bad_lights[1].position[0] = HUGE_VAL;
    EXPECT(LIGHT(points, normals, none, 3, bad_lights, 4, out), INVALID,
           "lights", 1, HUGE_VAL);
#undef LIGHT
    /* No lights: nothing to do. */
    CHECK_INT(vocc_light_visibility(scene, 2, points, normals, none, 0, NULL,
                                    NULL, NULL, NULL, NULL, NULL, NULL),
              VOCC_OK);
    /* The result would not fit in memory. */
    EXPECT(
        vocc_light_visibility(scene, SIZE_MAX / 2, points, normals, none, 4,
                              (const vocc_light[4]){light, light, light, light},
                              SAMPLING(4), out, NULL, NULL, NULL, &error),
        VOCC_ERROR_LIMIT, "count", -1, (double)(SIZE_MAX / 2));
    vocc_scene_free(scene);
}

static void classify_arguments(void)
{
    vocc_scene *scene = tetrahedron();
    vocc_ray_classification result;
    int32_t labels[64];
    double direction[3] = {0.0, 0.0, 0.0};
    memset(&result, 0x5a, sizeof(result));
    result.size = sizeof(result);
#define CLASSIFY(scene_, direction_, capacity_, labels_, result_)              \
    vocc_scene_classify_by_rays(scene_, direction_, capacity_, labels_,        \
                                result_, NULL, &error)
    EXPECT(CLASSIFY(NULL, NULL, 64, labels, &result), INVALID, "scene", -1,
           NAN);
    EXPECT(CLASSIFY(scene, NULL, 1, NULL, &result), INVALID, "labels", -1, NAN);
    EXPECT(CLASSIFY(scene, NULL, 64, labels, NULL), INVALID, "result", -1, NAN);
    EXPECT(CLASSIFY(scene, direction, 64, labels, &result), INVALID,
           "direction", -1, 0.0);
    direction[1] = -0.0;
    EXPECT(CLASSIFY(scene, direction, 64, labels, &result), INVALID,
           "direction", -1, 0.0);
    direction[1] = (double)NAN;
    EXPECT(CLASSIFY(scene, direction, 64, labels, &result), INVALID,
           "direction", 1, NAN);
    direction[0] = -HUGE_VAL;
    EXPECT(CLASSIFY(scene, direction, 64, labels, &result), INVALID,
           "direction", 0, -HUGE_VAL);
    result.size = 4;
    EXPECT(CLASSIFY(scene, NULL, 64, labels, &result), INVALID, "result", -1,
           4.0);
    /* A refusal writes nothing. */
    CHECK_INT(result.rays, 0x5a5a5a5a5a5a5a5a);
    result.size = sizeof(result);
    vocc_scene *unbuilt = empty_scene();
    EXPECT(CLASSIFY(unbuilt, NULL, 64, labels, &result), VOCC_ERROR_NOT_BUILT,
           "", -1, NAN);
    vocc_scene_free(unbuilt);
    vocc_error error;
    CHECK_STATUS(CLASSIFY(scene, NULL, 0, NULL, &result), &error, VOCC_OK);
    CHECK(result.leaf_count > 0 && result.leaf_count <= 64);
    CHECK_INT(result.threads, 1);
#undef CLASSIFY
    vocc_scene_free(scene);
}

/* A failed query writes nothing outside its arrays, and the scene still
 * answers. */
static void failed_queries_leave_the_scene(void)
{
    vocc_scene *scene = tetrahedron();
    const vocc_rays rays = two_rays();
    vocc_query_options bad;
    vocc_query_options_init(&bad);
    bad.cache = 1000;
    uint8_t occluded[4] = {9, 9, 9, 9};
    CHECK_INT(vocc_occluded(scene, &rays, occluded, &bad, NULL), INVALID);
    CHECK_INT(occluded[2], 9);
    CHECK_INT(occluded[3], 9);
    CHECK_INT(vocc_occluded(scene, &rays, occluded, NULL, NULL), VOCC_OK);
    CHECK_INT(occluded[0], 1);
    CHECK_INT(occluded[1], 0);
    CHECK_INT(occluded[2], 9);
    vocc_scene_free(scene);
}

/* ---- empty ------------------------------------------------------------- */

static void check_empty(vocc_scene *scene, int meshes)
{
    vocc_error error;
    CHECK_STATUS(vocc_scene_build(scene, NULL, &error), &error, VOCC_OK);
    vocc_report report;
    report.size = sizeof(report);
    CHECK_INT(vocc_scene_report(scene, &report, NULL), VOCC_OK);
    CHECK_INT(report.mesh_count, meshes);
    CHECK_INT(report.component_count, 0);
    CHECK_INT(report.triangle_count, 0);
    CHECK_INT(report.reference_count, 0);
    CHECK_INT(report.opaque_leaves, 0);
    CHECK_NEAR(report.opaque_volume_fraction, 0, 0);
    CHECK_NEAR(report.occluder_area, 0, 0);
    const vocc_rays rays = two_rays();
    uint8_t occluded[2] = {9, 9};
    for (int order = 0; order <= VOCC_ORDER_QDBFS; order++) {
        for (int packets = 0; packets < 2; packets++) {
            vocc_query_options options;
            vocc_query_options_init(&options);
            options.order = order;
            options.packets = packets;
            const vocc_status status =
                vocc_occluded(scene, &rays, occluded, &options, &error);
            if (status == VOCC_ERROR_UNSUPPORTED)
                continue;
            CHECK_STATUS(status, &error, VOCC_OK);
            CHECK_INT(occluded[0], 0);
            CHECK_INT(occluded[1], 0);
        }
    }
    float t[2] = {0, 0}, u[2] = {9, 9}, v[2] = {9, 9};
    int32_t geom[2] = {9, 9}, prim[2] = {9, 9};
    const vocc_hits hits = {t, geom, prim, u, v};
    CHECK_STATUS(vocc_intersect(scene, &rays, &hits, NULL, &error), &error,
                 VOCC_OK);
    for (int i = 0; i < 2; i++) {
        CHECK(isinf(t[i]) && t[i] > 0);
        CHECK_INT(geom[i], -1);
        CHECK_INT(prim[i], -1);
        CHECK_NEAR(u[i], 0, 0);
        CHECK_NEAR(v[i], 0, 0);
    }
    int32_t region[2] = {9, 9};
    CHECK_STATUS(vocc_region(scene, 2, rays.org, region, NULL, &error), &error,
                 VOCC_OK);
    CHECK_INT(region[0], 0);
    CHECK_INT(region[1], 0);
    const vocc_light light = RECT(0, 3, 0, 1, 0, 0, 0, 0, 1);
    uint16_t visible[2] = {9, 9};
    vocc_array none;
    memset(&none, 0, sizeof(none));
    CHECK_STATUS(vocc_light_visibility(scene, 2, rays.org,
                                       rows_of(two_dir + 3, 0, VOCC_FLOAT32),
                                       none, 1, &light, SAMPLING(7), visible,
                                       NULL, NULL, NULL, &error),
                 &error, VOCC_OK);
    CHECK_INT(visible[0], 7);
    CHECK_INT(visible[1], 7);
    size_t count = 9;
    CHECK_STATUS(vocc_scene_leaves(scene, 0, NULL, &count, &error), &error,
                 VOCC_OK);
    CHECK(count <= 1);
    vocc_ray_classification labels;
    labels.size = sizeof(labels);
    CHECK_STATUS(vocc_scene_classify_by_rays(scene, NULL, 0, NULL, &labels,
                                             NULL, &error),
                 &error, VOCC_OK);
    CHECK_INT(labels.leaf_count, count);
    CHECK_INT(labels.rays, 0);
    CHECK_INT(labels.disagreements, 0);
    vocc_scene_free(scene);
}

static void empty_scenes(void)
{
    check_empty(empty_scene(), 0);

    vocc_array nothing = vertices_ok();
    nothing.data = NULL;
    vocc_array no_triangles = triangles_ok();
    no_triangles.data = NULL;
    vocc_scene *scene = empty_scene();
    CHECK_INT(vocc_scene_add_mesh(scene, 0, nothing, 0, no_triangles, NULL,
                                  NULL, NULL),
              VOCC_OK);
    CHECK_INT(vocc_scene_add_mesh(scene, 4, vertices_ok(), 0, no_triangles,
                                  NULL, NULL, NULL),
              VOCC_OK);
    check_empty(scene, 2);
}

const test_case test_api_cases[] = {
    {"api.strings", strings},
    {"api.create", create},
    {"api.add_mesh_pointers", add_mesh_pointers},
    {"api.add_mesh_types", add_mesh_types},
    {"api.add_mesh_values", add_mesh_values},
    {"api.add_mesh_indices", add_mesh_indices},
    {"api.add_mesh_counts", add_mesh_counts},
    {"api.add_mesh_layouts", add_mesh_layouts},
    {"api.add_mesh_names", add_mesh_names},
    {"api.build_options", build_options},
    {"api.life_cycle", life_cycle},
    {"api.strict", strict},
    {"api.report_arguments", report_arguments},
    {"api.capacities", capacities},
    {"api.capacity_of_leaves", capacity_of_leaves},
    {"api.query_options", query_options},
    {"api.ray_arguments", ray_arguments},
    {"api.light_arguments", light_arguments},
    {"api.classify_arguments", classify_arguments},
    {"api.failed_queries", failed_queries_leave_the_scene},
    {"api.empty_scenes", empty_scenes},
    {NULL, NULL},
};
