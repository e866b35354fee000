/* Guards the lanes of csrc/wide_*.h: each operation of each of them that this
 * machine runs, against C on single floats. */
#include "wide.h"

#include <float.h>
#include <math.h>
#include <string.h>

#include "../../csrc/isa.h"
#include "test.h"

static uint32_t bits_of(float x)
{
    uint32_t u;
    memcpy(&u, &x, sizeof(u));
    return u;
}

static float float_of(uint32_t u)
{
    float x;
    memcpy(&x, &u, sizeof(x));
    return x;
}

static const char *what;
static const float *inputs[3];

static void wrong(const char *operation, int lane, float got, float expected)
{
    test_fail(__FILE__, __LINE__,
              "%s: %s in lane %d: %a (%08x), not %a (%08x); of %a, %a, %a",
              what, operation, lane, (double)got, (unsigned)bits_of(got),
              (double)expected, (unsigned)bits_of(expected),
              (double)inputs[0][lane], (double)inputs[1][lane],
              (double)inputs[2][lane]);
}

/* The same bits. */
static void same(const char *operation, int lane, float got, float expected)
{
    if (bits_of(got) != bits_of(expected))
        wrong(operation, lane, got, expected);
}

/* The same number; which NaN an operation makes is the machine's. */
static int equal(float got, float expected)
{
    return bits_of(got) == bits_of(expected) ||
           (got != got && expected != expected);
}

static void number(const char *operation, int lane, float got, float expected)
{
    if (!equal(got, expected))
        wrong(operation, lane, got, expected);
}

static void check_results(const float *a, const float *b, const float *c,
                          unsigned bits, const wide_results *results)
{
    const wide_results r = *results;
    unsigned lt = 0, le = 0;
    float lowest = c[0], highest = c[0];
    int has_nan = 0;
    for (int i = 0; i < 16; i++) {
        const float x = a[i], y = b[i], z = c[i];
        const float product = x * y;
        number("add", i, r.add[i], x + y);
        number("sub", i, r.sub[i], x - y);
        number("mul", i, r.mul[i], product);
        number("div", i, r.div[i], x / y);
        same("min", i, r.min[i], x < y ? x : y);
        same("max", i, r.max[i], x > y ? x : y);
        same("abs", i, r.abs[i], float_of(bits_of(x) & 0x7fffffffu));
        same("select", i, r.select[i], bits >> i & 1u ? x : y);
        same("set", i, r.set[i], a[0]);
        /* One rounding or two. */
        if (!equal(r.fma[i], product + z))
            number("fma", i, r.fma[i], fmaf(x, y, z));
        if (!equal(r.nfma[i], z - product))
            number("nfma", i, r.nfma[i], fmaf(-x, y, z));
        lt |= (unsigned)(x < y) << i;
        le |= (unsigned)(x <= y) << i;
        lowest = z < lowest ? z : lowest;
        highest = z > highest ? z : highest;
        has_nan |= z != z;
    }
    if (r.lt != lt)
        test_fail(__FILE__, __LINE__, "%s: lt: %x, not %x", what, r.lt, lt);
    if (r.le != le)
        test_fail(__FILE__, __LINE__, "%s: le: %x, not %x", what, r.le, le);
    /* Which zero is not told. */
    if (!has_nan && !(r.lowest == lowest && r.highest == highest))
        test_fail(__FILE__, __LINE__, "%s: lowest %a, highest %a, not %a, %a",
                  what, (double)r.lowest, (double)r.highest, (double)lowest,
                  (double)highest);
    test_compared(16 * 11 + 4);
}

static void check(wide_fn run, const float *a, const float *b, const float *c,
                  unsigned bits)
{
    wide_results r[2];
    int packed = 0;
    memset(r, 0x5a, sizeof(r));
    run(a, b, c, bits, r);
    inputs[0] = a;
    inputs[1] = b;
    inputs[2] = c;
    check_results(a, b, c, bits, &r[0]);
    check_results(a, b, c, bits, &r[1]);
    for (int i = 0; i < 16; i++)
        if (bits >> i & 1u) {
            same("pack", packed, r[0].packed[packed], a[i]);
            CHECK_INT(r[0].numbers[packed], i);
            packed++;
        }
    test_compared(2 * (size_t)packed);
}

static const float special[] = {
    0.0f,           -0.0f,    INFINITY,  -INFINITY,  NAN,
    FLT_MIN,        -FLT_MIN, 0x1p-149f, -0x1p-149f, 0x1.fffffcp-127f,
    FLT_MAX,        -FLT_MAX, 1.0f,      -1.0f,      0x1.000002p0f,
    0x1.fffffep-1f, 0x1p64f,  -0x1p-64f, 3.0f,       1.0f / 3.0f};

enum { SPECIAL = sizeof(special) / sizeof(special[0]) };

/* Special ones, any bits at all (but for signalling NaN), and usual numbers. */
static float any_float(test_random *random)
{
    const uint32_t kind = random_below(random, 8);
    if (kind < 2)
        return special[random_below(random, SPECIAL)];
    if (kind < 4) {
        const uint32_t u = (uint32_t)random_u64(random);
        return float_of((u & 0x7f800000u) == 0x7f800000u ? u | 0x400000u : u);
    }
    return (float)random_in(random, -4.0, 4.0);
}

static void all_of(wide_fn run)
{
    /* Not aligned. */
    float lanes[3 * 16 + 1], *a = lanes + 1, *b = a + 16, *c = b + 16;
    test_random random = random_seed(16);
    /* Every special number beside every other, in all lanes. */
    for (int i = 0; i < SPECIAL; i++) {
        for (int j = 0; j < SPECIAL; j++) {
            for (int lane = 0; lane < 16; lane++) {
                a[lane] = special[(i + lane) % SPECIAL];
                b[lane] = special[(j + lane) % SPECIAL];
                c[lane] = special[(i + 3 * j + 7 * lane) % SPECIAL];
            }
            check(run, a, b, c, (unsigned)random_u64(&random));
        }
    }
    for (int bit = 0; bit < 32; bit++)
        check(run, a, b, c, 1u << bit);
    const size_t count = test_scaled(50000, 1000);
    for (size_t i = 0; i < count && !test_failed(); i++) {
        for (int lane = 0; lane < 48; lane++)
            a[lane] = any_float(&random);
        /* One extreme, in each lane in turn, without NaN. */
        if (i % 2)
            for (int lane = 0; lane < 16; lane++)
                c[lane] = (float)random_in(&random, -1.0, 1.0) *
                          (lane == (int)(i / 2 % 16) ? 64.0f : 1.0f);
        /* Sums that cancel, where fused and separate roundings differ. */
        if (i % 4 > 1)
            for (int lane = 0; lane < 16; lane++)
                if (a[lane] * b[lane] == a[lane] * b[lane])
                    c[lane] =
                        i % 4 == 2 ? -(a[lane] * b[lane]) : a[lane] * b[lane];
        check(run, a, b, c, (unsigned)random_u64(&random));
    }
}

static void plain(void)
{
    what = "plain";
    all_of(wide_plain);
}

/* Leaves the test with a note where there is no such thing. */
static int is_there(int isa)
{
    if (vocc_isa_detect() >> isa & 1u)
        return 1;
    test_note("no %s here", vocc_isa_name(isa));
    return 0;
}

static void sse2(void)
{
    what = "sse2";
#if VOCC_HAVE_SSE2
    if (is_there(VOCC_ISA_SSE2))
        all_of(wide_sse2);
#else
    CHECK(!is_there(VOCC_ISA_SSE2));
#endif
}

static void avx2(void)
{
    what = "avx2";
#if VOCC_HAVE_AVX2
    if (is_there(VOCC_ISA_AVX2))
        all_of(wide_avx2);
#else
    CHECK(!is_there(VOCC_ISA_AVX2));
#endif
}

static void avx512(void)
{
    what = "avx512";
#if VOCC_HAVE_AVX512
    if (is_there(VOCC_ISA_AVX512))
        all_of(wide_avx512);
#else
    CHECK(!is_there(VOCC_ISA_AVX512));
#endif
}

static void neon(void)
{
    what = "neon";
#if VOCC_HAVE_NEON
    if (is_there(VOCC_ISA_NEON))
        all_of(wide_neon);
#else
    CHECK(!is_there(VOCC_ISA_NEON));
#endif
}

const test_case test_wide_cases[] = {
    {"wide.plain", plain},   {"wide.sse2", sse2}, {"wide.avx2", avx2},
    {"wide.avx512", avx512}, {"wide.neon", neon}, {NULL, NULL},
};
