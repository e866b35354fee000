/* The test runner's interface: named tests, checks that print file, line and
 * values, and a random generator whose numbers are the same everywhere.
 *
 * A test file exports one table of `test_case`, ended by a NULL name, and
 * main.c lists the tables. */
#ifndef VOCC_TEST_H
#define VOCC_TEST_H

#include <stddef.h>
#include <stdint.h>

typedef struct test_case {
    const char *name; /* "file.subject" */
    void (*run)(void);
} test_case;

extern const test_case test_tools_cases[];
extern const test_case test_api_cases[];
extern const test_case test_alloc_cases[];
extern const test_case test_progress_cases[];
extern const test_case test_report_cases[];
extern const test_case test_cracks_cases[];
extern const test_case test_identical_cases[];
extern const test_case test_isa_cases[];
extern const test_case test_light_cases[];
extern const test_case test_light_types_cases[];
extern const test_case test_cells_cases[];
extern const test_case test_oracle_cases[];
extern const test_case test_region_cases[];
extern const test_case test_tree_cases[];
extern const test_case test_hostile_cases[];
extern const test_case test_threads_cases[];
extern const test_case test_classify_rays_cases[];
extern const test_case test_wide_cases[];
extern const test_case test_worked_example_cases[];
extern const test_case test_worth_cases[];

/* Records a failure of the running test.  After a number of them in one test
 * the others are counted but not printed. */
void test_fail(const char *file, int line, const char *format, ...)
#if defined(__GNUC__)
    __attribute__((format(printf, 3, 4)))
#endif
    ;

/* What failures are about from now on, put before their text: a static string,
 * or NULL. */
void test_context(const char *context);

/* 1 once the running test has failed. */
int test_failed(void);

/* Leaves the running test at once; it has failed before. */
void test_leave(void)
#if defined(__GNUC__)
    __attribute__((noreturn))
#endif
    ;

/* A line under the test's name: what it left out, and why. */
void test_note(const char *format, ...)
#if defined(__GNUC__)
    __attribute__((format(printf, 1, 2)))
#endif
    ;

/* Adds to the number of answers that the running test compared. */
void test_compared(uint64_t answers);

/* `count` scaled to the configuration: VOCC_TEST_SCALE in the environment, or
 * less than 1 under a sanitizer.  Never below `least`. */
size_t test_scaled(size_t count, size_t least);

/* For tests that ask each of many shapes in each of many ways: whether the one
 * with the number `turn`, say shape + way, is made in this configuration.  All
 * are at full scale, one of so many at least; a prime, so that the share meets
 * every other choice that goes by number. */
#define TEST_SHARES 7
int test_share(size_t turn);

/* Under a sanitizer everything takes longer and more memory. */
int test_is_sanitized(void);

/* Checks go on after a failure; REQUIREs leave the test. */
#define CHECK(condition)                                                       \
    do {                                                                       \
        if (!(condition))                                                      \
            test_fail(__FILE__, __LINE__, "%s", #condition);                   \
    } while (0)

#define REQUIRE(condition)                                                     \
    do {                                                                       \
        if (!(condition)) {                                                    \
            test_fail(__FILE__, __LINE__, "%s", #condition);                   \
            test_leave();                                                      \
        }                                                                      \
    } while (0)

#define CHECK_INT(actual, expected)                                            \
    test_check_int(__FILE__, __LINE__, #actual, (long long)(actual),           \
                   (long long)(expected))

#define CHECK_NEAR(actual, expected, tolerance)                                \
    test_check_near(__FILE__, __LINE__, #actual, (double)(actual),             \
                    (double)(expected), (double)(tolerance))

#define CHECK_STRING(actual, expected)                                         \
    test_check_string(__FILE__, __LINE__, #actual, (actual), (expected))

void test_check_int(const char *file, int line, const char *what,
                    long long actual, long long expected);
void test_check_near(const char *file, int line, const char *what,
                     double actual, double expected, double tolerance);
void test_check_string(const char *file, int line, const char *what,
                       const char *actual, const char *expected);

/* splitmix64: small, seedable, the same on every machine. */
typedef struct test_random {
    uint64_t state;
} test_random;

test_random random_seed(uint64_t seed);
uint64_t random_u64(test_random *random);
/* 0 to bound - 1 */
uint32_t random_below(test_random *random, uint32_t bound);
/* low <= x < high */
double random_in(test_random *random, double low, double high);

#endif
