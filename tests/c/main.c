/* The C test runner.
 *
 *   run              all tests
 *   run --list       their names
 *   run --only NAME  those whose name begins with NAME (may be repeated)
 *
 * VOCC_TEST_SCALE=0.1 in the environment runs a tenth of the rays; a test that
 * scales and then compares nothing fails.  Ends with
 * the line "N passed, N failed"; exit code 1 if a test failed, 2 if the
 * command line is wrong or names no test. */
#if !defined(_WIN32)
#define _POSIX_C_SOURCE 200809L
#endif
#include "test.h"

#include <setjmp.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <math.h>
#include <time.h>

#define FAILURES_PRINTED 12

static const test_case *const tables[] = {
    test_tools_cases,          test_api_cases,
    test_alloc_cases,          test_progress_cases,
    test_report_cases,         test_region_cases,
    test_tree_cases,           test_oracle_cases,
    test_identical_cases,      test_light_cases,
    test_light_types_cases,    test_cells_cases,
    test_cracks_cases,         test_hostile_cases,
    test_threads_cases,        test_classify_rays_cases,
    test_worked_example_cases, test_isa_cases,
    test_wide_cases,           test_worth_cases,
};

static struct {
    jmp_buf leave;
    int failures;
    const char *context;
    uint64_t compared;
    double scale;
    int is_scaled; /* the running test has asked for it */
} runner;

static int is_sanitized(void)
{
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
    return 1;
#elif defined(__has_feature)
#if __has_feature(address_sanitizer) || __has_feature(thread_sanitizer) ||     \
    __has_feature(memory_sanitizer)
    return 1;
#else
    return 0;
#endif
#else
    return 0;
#endif
}

int test_is_sanitized(void)
{
    return is_sanitized();
}

void test_fail(const char *file, int line, const char *format, ...)
{
    runner.failures++;
    if (runner.failures > FAILURES_PRINTED)
        return;
    const char *slash = strrchr(file, '/');
    printf("  %s:%d: ", slash ? slash + 1 : file, line);
    if (runner.context)
        printf("%s: ", runner.context);
    va_list arguments;
    va_start(arguments, format);
    vprintf(format, arguments);
    va_end(arguments);
    printf("\n");
    fflush(stdout);
}

void test_context(const char *context)
{
    runner.context = context;
}

int test_failed(void)
{
    return runner.failures != 0;
}

void test_leave(void)
{
    longjmp(runner.leave, 1);
}

void test_note(const char *format, ...)
{
    printf("  note: ");
    va_list arguments;
    va_start(arguments, format);
    vprintf(format, arguments);
    va_end(arguments);
    printf("\n");
}

void test_compared(uint64_t answers)
{
    runner.compared += answers;
}

size_t test_scaled(size_t count, size_t least)
{
    const double scaled = (double)count * runner.scale;
    runner.is_scaled = 1;
    return scaled > (double)least ? (size_t)scaled : least;
}

int test_share(size_t turn)
{
    runner.is_scaled = 1;
    return (double)(turn % TEST_SHARES) < runner.scale * TEST_SHARES;
}

void test_check_int(const char *file, int line, const char *what,
                    long long actual, long long expected)
{
    if (actual != expected)
        test_fail(file, line, "%s is %lld, not %lld", what, actual, expected);
}

void test_check_near(const char *file, int line, const char *what,
                     double actual, double expected, double tolerance)
{
    /* NaN fails. */
    if (!(fabs(actual - expected) <= tolerance))
        test_fail(file, line, "%s is %.17g, not %.17g +- %g", what, actual,
                  expected, tolerance);
}

void test_check_string(const char *file, int line, const char *what,
                       const char *actual, const char *expected)
{
    if (strcmp(actual, expected) != 0)
        test_fail(file, line, "%s is \"%s\", not \"%s\"", what, actual,
                  expected);
}

test_random random_seed(uint64_t seed)
{
    test_random random = {seed};
    (void)random_u64(&random);
    return random;
}

uint64_t random_u64(test_random *random)
{
    uint64_t z = (random->state += UINT64_C(0x9e3779b97f4a7c15));
    z = (z ^ (z >> 30)) * UINT64_C(0xbf58476d1ce4e5b9);
    z = (z ^ (z >> 27)) * UINT64_C(0x94d049bb133111eb);
    return z ^ (z >> 31);
}

uint32_t random_below(test_random *random, uint32_t bound)
{
    return (uint32_t)(((random_u64(random) >> 32) * bound) >> 32);
}

double random_in(test_random *random, double low, double high)
{
    const double unit = (double)(random_u64(random) >> 11) * 0x1p-53;
    return low + (high - low) * unit;
}

static double seconds(void)
{
#if defined(_WIN32)
    return (double)clock() / CLOCKS_PER_SEC;
#else
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return (double)now.tv_sec + 1e-9 * (double)now.tv_nsec;
#endif
}

/* Returns the number of failures. */
static int run_one(const test_case *test)
{
    runner.failures = 0;
    runner.context = NULL;
    runner.compared = 0;
    runner.is_scaled = 0;
    const double start = seconds();
    if (setjmp(runner.leave) == 0)
        test->run();
    if (runner.is_scaled && !runner.compared && !runner.failures)
        test_fail(__FILE__, __LINE__, "nothing was compared");
    if (runner.failures > FAILURES_PRINTED)
        printf("  and %d more\n", runner.failures - FAILURES_PRINTED);
    printf("%-6s %-32s %6.2f s", runner.failures ? "FAILED" : "ok", test->name,
           seconds() - start);
    if (runner.compared)
        printf("  %llu compared", (unsigned long long)runner.compared);
    printf("\n");
    fflush(stdout);
    return runner.failures;
}

static int selected(const char *name, int argc, char **argv)
{
    int any = 0;
    for (int i = 1; i + 1 < argc; i += 2) {
        any = 1;
        if (strncmp(name, argv[i + 1], strlen(argv[i + 1])) == 0)
            return 1;
    }
    return !any;
}

int main(int argc, char **argv)
{
    const int list = argc == 2 && strcmp(argv[1], "--list") == 0;
    for (int i = 1; !list && i < argc; i += 2) {
        if (strcmp(argv[i], "--only") != 0 || i + 1 == argc) {
            fprintf(stderr, "usage: %s [--list | --only NAME ...]\n", argv[0]);
            return 2;
        }
    }

    runner.scale = is_sanitized() ? 0.05 : 1.0;
    const char *scale = getenv("VOCC_TEST_SCALE");
    if (scale && atof(scale) > 0.0)
        runner.scale = atof(scale);

    int passed = 0, failed = 0;
    for (size_t i = 0; i < sizeof(tables) / sizeof(tables[0]); i++) {
        for (const test_case *test = tables[i]; test->name; test++) {
            if (list) {
                printf("%s\n", test->name);
                continue;
            }
            if (!selected(test->name, argc, argv))
                continue;
            if (run_one(test))
                failed++;
            else
                passed++;
        }
    }
    if (list)
        return 0;
    printf("%d passed, %d failed\n", passed, failed);
    if (passed + failed == 0) {
        fprintf(stderr, "no test has such a name\n");
        return 2;
    }
    return failed ? 1 : 0;
}
