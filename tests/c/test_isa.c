/* Guards the choice of the instruction set: what is found is what the system
 * says there is, the option wins over VOCC_ISA, and what is not there is an
 * error that says so.  That all give the same answers: test_identical.c. */
#if !defined(_WIN32)
#define _POSIX_C_SOURCE 200809L
#endif
#include "world.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "../../csrc/isa.h"
#include "test.h"

#define VARIABLE "VOCC_ISA"

/* The variable as it was before the test. */
static char *saved;

static void save_variable(void)
{
    const char *value = getenv(VARIABLE);
    saved = NULL;
    if (value) {
        saved = malloc(strlen(value) + 1);
        REQUIRE(saved);
        strcpy(saved, value);
    }
    REQUIRE(unsetenv(VARIABLE) == 0);
}

static void restore_variable(void)
{
    if (saved)
        CHECK(setenv(VARIABLE, saved, 1) == 0);
    else
        CHECK(unsetenv(VARIABLE) == 0);
    free(saved);
}

static vocc_query_options options_of(int isa)
{
    vocc_query_options options;
    vocc_query_options_init(&options);
    options.isa = isa;
    return options;
}

static int best_isa(void)
{
    const unsigned found = vocc_isa_detect();
    int best = VOCC_ISA_SCALAR;
    for (int isa = VOCC_ISA_SCALAR; isa <= VOCC_ISA_NEON; isa++)
        if (found >> isa & 1u)
            best = isa;
    return best;
}

static void names(void)
{
    CHECK_STRING(vocc_isa_name(VOCC_ISA_AUTO), "auto");
    CHECK_STRING(vocc_isa_name(VOCC_ISA_SCALAR), "scalar");
    CHECK_STRING(vocc_isa_name(VOCC_ISA_SSE2), "sse2");
    CHECK_STRING(vocc_isa_name(VOCC_ISA_AVX2), "avx2");
    CHECK_STRING(vocc_isa_name(VOCC_ISA_AVX512), "avx512");
    CHECK_STRING(vocc_isa_name(VOCC_ISA_NEON), "neon");
    CHECK(vocc_isa_name(-1) == NULL);
    CHECK(vocc_isa_name(6) == NULL);
}

#if VOCC_HAVE_AVX2 && defined(__linux__)
/* Whether Linux, which knows what it saves, lists all of `flags`. */
static int system_has(const char *const *flags)
{
    /* A line has some hundred flags. */
    static char line[16384];
    FILE *file = fopen("/proc/cpuinfo", "r");
    int all = 1;
    REQUIRE(file);
    do
        REQUIRE(fgets(line, sizeof(line) - 1, file));
    while (strncmp(line, "flags", 5) != 0);
    fclose(file);
    line[strcspn(line, "\n")] = '\0';
    strcat(line, " ");
    for (; *flags; flags++) {
        char word[32];
        snprintf(word, sizeof(word), " %s ", *flags);
        all &= strstr(line, word) != NULL;
    }
    return all;
}
#endif

/* None may drop out of the tests unseen. */
static void what_there_is(void)
{
    const unsigned found = vocc_isa_detect();
    CHECK_INT(found >> VOCC_ISA_AUTO & 1u, 0);
    CHECK_INT(found >> VOCC_ISA_SCALAR & 1u, 1);
    CHECK_INT(found >> (VOCC_ISA_NEON + 1), 0);
#if defined(VOCC_SIMD) && VOCC_SIMD == 0
    CHECK_INT(found, 1u << VOCC_ISA_SCALAR);
#elif defined(__x86_64__) || defined(_M_X64)
    CHECK_INT(found >> VOCC_ISA_SSE2 & 1u, 1);
    CHECK_INT(found >> VOCC_ISA_NEON & 1u, 0);
#elif defined(__aarch64__) || defined(_M_ARM64)
    CHECK_INT(found, 1u << VOCC_ISA_SCALAR | 1u << VOCC_ISA_NEON);
#else
    CHECK_INT(found, 1u << VOCC_ISA_SCALAR);
#endif
#if VOCC_HAVE_AVX2 && defined(__linux__)
    static const char *const avx2[] = {"avx2", "fma", "bmi1", "bmi2", NULL};
    static const char *const avx512[] = {"avx512f", "avx512bw", "avx512dq",
                                         "avx512vl", NULL};
    CHECK_INT(found >> VOCC_ISA_AVX2 & 1u, system_has(avx2));
    CHECK_INT(found >> VOCC_ISA_AVX512 & 1u,
              system_has(avx2) && system_has(avx512));
#endif
    char text[64] = "";
    for (int isa = VOCC_ISA_SCALAR; isa <= VOCC_ISA_NEON; isa++) {
        CHECK_INT(has_isa(isa), found >> isa & 1u);
        if (found >> isa & 1u) {
            strcat(text, " ");
            strcat(text, vocc_isa_name(isa));
        }
    }
    test_note("there is%s", text);
}

/* Every query refuses what is not there, as vocc_query_isa does. */
static vocc_status ask(const vocc_scene *scene, int query,
                       const vocc_query_options *options, vocc_error *error)
{
    static const float org[3] = {0, 0, 3}, dir[3] = {0, 0, -1};
    const vocc_light light = RECT(0, 0, 5, 1, 0, 0, 0, 1, 0);
    vocc_rays rays;
    vocc_hits hits;
    vocc_array none;
    uint8_t occluded;
    int32_t region, label;
    uint16_t counts;
    float position[3], normal[3];
    vocc_ray_classification result;
    memset(&rays, 0, sizeof(rays));
    memset(&hits, 0, sizeof(hits));
    memset(&none, 0, sizeof(none));
    rays.count = 1;
    rays.org = rows_of(org, 12, VOCC_FLOAT32);
    rays.dir = rows_of(dir, 12, VOCC_FLOAT32);
    result.size = sizeof(result);
    switch (query) {
    case 0:
        return vocc_occluded(scene, &rays, &occluded, options, error);
    case 1:
        return vocc_intersect(scene, &rays, &hits, options, error);
    case 2:
        return vocc_region(scene, 1, rays.org, &region, options, error);
    case 3:
        return vocc_shading_points(scene, &rays, 0.0, &hits, position, normal,
                                   options, error);
    case 4:
        return vocc_light_visibility(scene, 1, rays.org, rays.dir, none, 1,
                                     &light, SAMPLING(4), &counts, NULL, NULL,
                                     options, error);
    case 5:
        return vocc_ambient_occlusion(scene, 1, rays.org, rays.dir, none, 1.0,
                                      SAMPLING(4), &counts, NULL, options,
                                      error);
    default:
        return vocc_scene_classify_by_rays(scene, NULL, 1, &label, &result,
                                           options, error);
    }
}

enum { QUERIES = 7 };

/* vocc_query_isa gives `isa`, or it and all queries fail in the same way. */
static void expect(int line, const vocc_scene *scene,
                   const vocc_query_options *options, vocc_status expected,
                   int isa, const char *argument, const char *message)
{
    vocc_error error;
    int32_t got = 77;
    for (int query = -1; query < QUERIES; query++) {
        memset(&error, 0, sizeof(error));
        const vocc_status status = query < 0
                                       ? vocc_query_isa(options, &got, &error)
                                       : ask(scene, query, options, &error);
        check_status(__FILE__, line, "the query", status, &error, expected);
        if (status == VOCC_OK || status != expected)
            continue;
        test_check_string(__FILE__, line, "argument", error.argument, argument);
        if (!strstr(error.message, argument) || !strstr(error.message, message))
            test_fail(__FILE__, line, "the message is \"%s\"", error.message);
    }
    test_check_int(__FILE__, line, "isa", got, expected == VOCC_OK ? isa : 77);
}

#define EXPECT_ISA(options, isa)                                               \
    expect(__LINE__, w.scene, options, VOCC_OK, isa, "", "")
#define EXPECT_FAILURE(options, status, argument, message)                     \
    expect(__LINE__, w.scene, options, status, 0, argument, message)

static void choice(void)
{
    shape s;
    world w;
    const unsigned found = vocc_isa_detect();
    const vocc_query_options defaults = options_of(VOCC_ISA_AUTO);
    save_variable();
    shape_make(&s, 0, 1);
    world_make(&w, &s, NULL);

    for (int isa = VOCC_ISA_SCALAR; isa <= VOCC_ISA_NEON; isa++) {
        const vocc_query_options options = options_of(isa);
        const char *name = vocc_isa_name(isa);
        const int there = (int)(found >> isa & 1u);
        test_context(name);
        if (there)
            EXPECT_ISA(&options, isa);
        else
            EXPECT_FAILURE(&options, VOCC_ERROR_UNSUPPORTED, "isa", name);
        CHECK(setenv(VARIABLE, name, 1) == 0);
        if (there) {
            EXPECT_ISA(&defaults, isa);
            EXPECT_ISA(NULL, isa);
        } else {
            EXPECT_FAILURE(&defaults, VOCC_ERROR_UNSUPPORTED, VARIABLE, name);
            EXPECT_FAILURE(&defaults, VOCC_ERROR_UNSUPPORTED, VARIABLE,
                           "have scalar");
            EXPECT_FAILURE(NULL, VOCC_ERROR_UNSUPPORTED, VARIABLE, name);
        }
        /* The option wins, and what it asks for does not hang on the variable.
         */
        for (int other = VOCC_ISA_SCALAR; other <= VOCC_ISA_NEON; other++) {
            const vocc_query_options asked = options_of(other);
            if (found >> other & 1u)
                EXPECT_ISA(&asked, other);
            else
                EXPECT_FAILURE(&asked, VOCC_ERROR_UNSUPPORTED, "isa",
                               vocc_isa_name(other));
        }
        CHECK(unsetenv(VARIABLE) == 0);
    }
    test_context(NULL);

    EXPECT_ISA(&defaults, best_isa());
    EXPECT_ISA(NULL, best_isa());
    static const char *const as_if_unset[] = {"", "auto"};
    for (int i = 0; i < 2; i++) {
        CHECK(setenv(VARIABLE, as_if_unset[i], 1) == 0);
        EXPECT_ISA(&defaults, best_isa());
    }
    static const char *const unknown[] = {
        "SSE2", "avx", "sse2 ", "2",
        "a name that is longer than a "
        "message has place for: "
        "sssssssssssssssssssssssssssssssssss"};
    const vocc_query_options scalar = options_of(VOCC_ISA_SCALAR);
    for (int i = 0; i < 5; i++) {
        CHECK(setenv(VARIABLE, unknown[i], 1) == 0);
        EXPECT_FAILURE(&defaults, VOCC_ERROR_INVALID_ARGUMENT, VARIABLE,
                       i < 4 ? unknown[i] : "a name that");
        EXPECT_FAILURE(NULL, VOCC_ERROR_INVALID_ARGUMENT, VARIABLE,
                       "auto, scalar, sse2, avx2, avx512, neon");
        EXPECT_ISA(&scalar, VOCC_ISA_SCALAR);
    }
    world_free(&w);
    shape_free(&s);
    restore_variable();
}

static void arguments(void)
{
    vocc_query_options options = options_of(VOCC_ISA_SCALAR);
    vocc_error error;
    int32_t isa;
    CHECK_STATUS(vocc_query_isa(&options, NULL, &error), &error,
                 VOCC_ERROR_INVALID_ARGUMENT);
    CHECK_STRING(error.argument, "isa");
    options.cache = 65;
    CHECK_STATUS(vocc_query_isa(&options, &isa, &error), &error,
                 VOCC_ERROR_INVALID_ARGUMENT);
    CHECK_STRING(error.argument, "cache");
    options = options_of(VOCC_ISA_NEON + 1);
    CHECK_STATUS(vocc_query_isa(&options, &isa, &error), &error,
                 VOCC_ERROR_INVALID_ARGUMENT);
    CHECK_STRING(error.argument, "isa");
    CHECK_INT(vocc_query_isa(&options, &isa, NULL),
              VOCC_ERROR_INVALID_ARGUMENT);
}

const test_case test_isa_cases[] = {
    {"isa.names", names},   {"isa.what_there_is", what_there_is},
    {"isa.choice", choice}, {"isa.arguments", arguments},
    {NULL, NULL},
};
