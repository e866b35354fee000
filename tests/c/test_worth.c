/* Guards when rays are tested against occluders: always while it pays, hardly
 * ever while it does not, and again soon when it would.  That answers do not
 * depend on it: test_identical.c. */
#include <stddef.h>

#include "../../csrc/worth.h"
#include "test.h"

/* Packets of 16 rays that take `tests` each, so many of them blocked by
 * occluders where they are tested and by triangles where not; how many of
 * `count` packets are tested. */
static int run(vocc_worth *w, int count, int blocked, float tests)
{
    int tested = 0, i;
    for (i = 0; i < count; i++) {
        const int test = vocc_worth_test(w);
        if (test)
            vocc_worth_tested(w, blocked, tests);
        if (!test || blocked < 16)
            vocc_worth_traced(w, test ? 16 - blocked : 16, test ? 0 : blocked,
                              160.0f);
        tested += test;
    }
    return tested;
}

static void pays(void)
{
    vocc_worth w;
    vocc_worth_begin(&w);
    CHECK_INT(run(&w, 1000, 16, 20.0f), 1000);
    vocc_worth_begin(&w);
    CHECK_INT(run(&w, 1000, 2, 20.0f), 1000);
}

static void in_vain(void)
{
    vocc_worth w;
    int tested;
    vocc_worth_begin(&w);
    tested = run(&w, 10000, 0, 5.0f);
    CHECK(tested >= 10000 / (VOCC_MANY_SKIPPED + 1));
    CHECK(tested <= 10000 / VOCC_MANY_SKIPPED + 8);
    /* Some are blocked, but it takes too long to find them. */
    vocc_worth_begin(&w);
    tested = run(&w, 10000, 6, 500.0f);
    CHECK(tested <= 10000 / VOCC_MANY_SKIPPED + 8);
}

static void changes(void)
{
    vocc_worth w;
    int tested, i;
    vocc_worth_begin(&w);
    /* No debt is so large that it is not paid soon. */
    (void)run(&w, 1000, 0, 500.0f);
    tested = run(&w, 2 * VOCC_MANY_SKIPPED, 16, 20.0f);
    CHECK(tested >= VOCC_MANY_SKIPPED / 2);
    CHECK_INT(run(&w, 100, 16, 20.0f), 100);
    /* Nor any credit. */
    (void)run(&w, 1000, 16, 1.0f);
    CHECK(run(&w, 1000, 0, 100.0f) <= 80);
    /* Light among shadow, as where lights alternate, is no reason to stop. */
    vocc_worth_begin(&w);
    for (i = 0, tested = 0; i < 1000; i++)
        tested += run(&w, 1, i % 5 ? 0 : 16, 10.0f);
    CHECK(tested >= 900);
}

/* The dearer a blocked ray, the more an occluder may take. */
static void costs(void)
{
    vocc_worth w;
    int i;
    vocc_worth_begin(&w);
    for (i = 0; i < 100; i++)
        vocc_worth_traced(&w, 16, 12, 16.0f * 100.0f);
    CHECK_NEAR(w.ray, 100.0f, 1.0f);
    /* Lit rays are not what it saves. */
    for (i = 0; i < 100; i++)
        vocc_worth_traced(&w, 16, 7, 16.0f);
    vocc_worth_traced(&w, 0, 0, 5.0f);
    CHECK_NEAR(w.ray, 100.0f, 1.0f);
    vocc_worth_tested(&w, 2, 300.0f);
    CHECK(vocc_worth_test(&w));
    vocc_worth_begin(&w);
    vocc_worth_tested(&w, 2, 300.0f);
    CHECK(!vocc_worth_test(&w));
}

const test_case test_worth_cases[] = {
    {"worth.pays", pays},
    {"worth.in_vain", in_vain},
    {"worth.changes", changes},
    {"worth.costs", costs},
    {NULL, NULL},
};
