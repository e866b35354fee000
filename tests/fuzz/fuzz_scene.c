/* A libFuzzer target: meshes, build options and rays from arbitrary bytes.
 *
 * It aborts where the library breaks its promises: a crash or a sanitizer's
 * finding, memory not freed, an answer that depends on an option, a hit that
 * vocc_intersect and vocc_occluded do not agree on.  Not part of `make test`.
 *
 *   clang -std=c99 -g -O1 -ffp-contract=off -pthread \
 *       -fsanitize=fuzzer,address,undefined \
 *       csrc/[a-z]*.c tests/fuzz/fuzz_scene.c -lm -o build/fuzz_scene
 *   mkdir -p build/corpus && build/fuzz_scene -max_len=4096 build/corpus
 *
 * One input again, without libFuzzer (any compiler):
 *
 *   cc -std=c99 -g -DFUZZ_REPLAY -ffp-contract=off -pthread csrc/[a-z]*.c \
 *       tests/fuzz/fuzz_scene.c -lm -o build/fuzz_replay
 *   build/fuzz_replay build/crash-...
 *
 * The bytes are read in order; where they end, zeros follow.  Coordinates are
 * drawn from a small table of likely troublemakers or taken as raw float32. */
#include "../../csrc/vocc.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define MOST_VERTICES 24
#define MOST_TRIANGLES 48
#define MOST_RAYS 32
#define MOST_MESHES 3

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

/* ---- the bytes --------------------------------------------------------- */

typedef struct bytes {
    const uint8_t *data;
    size_t left;
} bytes;

static uint32_t take(bytes *b, size_t count)
{
    uint32_t value = 0;
    while (count--) {
        value <<= 8;
        if (b->left) {
            value |= *b->data++;
            b->left--;
        }
    }
    return value;
}

static float take_float(bytes *b)
{
    static const float likely[] = {
        0.0f,      -0.0f,      1.0f,   -1.0f,     0.5f,       -0.5f,
        2.0f,      -2.0f,      0.25f,  1.5f,      3.0f,       -3.0f,
        0x1p-149f, -0x1p-149f, 1e-38f, 1e30f,     -1e30f,     3.4e38f,
        -3.4e38f,  0x1p-20f,   1e-4f,  0.333333f, 0.9999999f, 1.0000001f};
    const uint32_t kind = take(b, 1);
    if (kind < 224)
        return likely[kind % (sizeof(likely) / sizeof(likely[0]))];
    const uint32_t bits = take(b, 4);
    float value;
    memcpy(&value, &bits, sizeof(value));
    return value;
}

static void expect(int condition, const char *what)
{
    if (condition)
        return;
    fprintf(stderr, "fuzz_scene: %s\n", what);
    abort();
}

/* ---- an allocator that counts and can fail ----------------------------- */

typedef struct heap {
    long live, countdown; /* 0: never fails */
} heap;

static void *allocate(void *user, size_t size)
{
    heap *h = user;
    if (h->countdown && --h->countdown == 0)
        return NULL;
    void *memory = malloc(size ? size : 1);
    h->live += memory != NULL;
    return memory;
}

static void deallocate(void *user, void *memory)
{
    heap *h = user;
    h->live--;
    free(memory);
}

/* ---- one input --------------------------------------------------------- */

static void add_mesh(vocc_scene *scene, bytes *b)
{
    float vertices[3 * MOST_VERTICES];
    int32_t triangles[3 * MOST_TRIANGLES];
    const uint32_t vertex_count = take(b, 1) % (MOST_VERTICES + 1);
    const uint32_t triangle_count = take(b, 1) % (MOST_TRIANGLES + 1);
    for (uint32_t i = 0; i < 3 * vertex_count; i++)
        vertices[i] = take_float(b);
    for (uint32_t i = 0; i < 3 * triangle_count; i++) {
        const uint32_t index = take(b, 1);
        /* Mostly in range, so that most meshes are accepted. */
        triangles[i] = index == 255       ? (int32_t)take(b, 4)
                       : vertex_count > 0 ? (int32_t)(index % vertex_count)
                                          : 0;
    }
    vocc_mesh_options options;
    vocc_error error;
    vocc_mesh_options_init(&options);
    options.occluder = (int32_t)(take(b, 1) & 1);
    const vocc_array rows = {vertices, 12, VOCC_FLOAT32};
    const vocc_array corners = {triangles, 12, VOCC_INT32};
    const vocc_status status =
        vocc_scene_add_mesh(scene, vertex_count, rows, triangle_count, corners,
                            &options, NULL, &error);
    expect(status == VOCC_OK || error.message[0] != 0, "no message");
}

static void query(const vocc_scene *scene, bytes *b)
{
    float rays[8 * MOST_RAYS];
    const uint32_t count = 1 + take(b, 1) % MOST_RAYS;
    for (uint32_t i = 0; i < 8 * count; i++)
        rays[i] = take_float(b);
    for (uint32_t i = 0; i < count; i++) {
        if (take(b, 1) & 1) {
            rays[8 * i + 6] = 0.0f;
            rays[8 * i + 7] = HUGE_VALF;
        }
    }
    vocc_rays view;
    view.count = count;
    view.org.data = rays;
    view.dir.data = rays + 3;
    view.tmin.data = rays + 6;
    view.tmax.data = rays + 7;
    view.org.stride = view.dir.stride = 32;
    view.tmin.stride = view.tmax.stride = 32;
    view.org.type = view.dir.type = VOCC_FLOAT32;
    view.tmin.type = view.tmax.type = VOCC_FLOAT32;

    uint8_t first[MOST_RAYS], other[MOST_RAYS];
    vocc_query_options options;
    vocc_query_options_init(&options);
    options.threads = 1;
    options.order = VOCC_ORDER_STANDARD;
    options.occluders = 0;
    options.packets = 0;
    options.isa = VOCC_ISA_SCALAR;
    expect(vocc_occluded(scene, &view, first, &options, NULL) == VOCC_OK,
           "the baseline failed");
    for (int order = VOCC_ORDER_AUTO; order <= VOCC_ORDER_QDBFS; order++) {
        for (int flags = 0; flags < 8; flags++) {
            options.order = order;
            options.occluders = flags & 1;
            options.packets = flags >> 1 & 1;
            options.isa = flags & 4 ? VOCC_ISA_AUTO : VOCC_ISA_SCALAR;
            options.cache = (int32_t)(take(b, 1) % 65);
            options.deferment = (int32_t)(take(b, 2) % 513);
            const vocc_status status =
                vocc_occluded(scene, &view, other, &options, NULL);
            if (status == VOCC_ERROR_UNSUPPORTED)
                continue;
            expect(status == VOCC_OK, "a query failed");
            expect(memcmp(first, other, count) == 0,
                   "an option changed an answer");
        }
    }
    int32_t prim[MOST_RAYS], region[MOST_RAYS];
    vocc_hits hits;
    memset(&hits, 0, sizeof(hits));
    hits.prim_id = prim;
    expect(vocc_intersect(scene, &view, &hits, NULL, NULL) == VOCC_OK,
           "intersect failed");
    for (uint32_t i = 0; i < count; i++)
        expect((prim[i] >= 0) == (first[i] == 1),
               "intersect and occluded do not agree");
    expect(vocc_region(scene, count, view.org, region, NULL, NULL) == VOCC_OK,
           "region failed");
    uint16_t visible[MOST_RAYS];
    float share[MOST_RAYS];
    vocc_light light;
    vocc_sampling sampling;
    vocc_array none;
    memset(&none, 0, sizeof(none));
    vocc_sampling_init(&sampling);
    for (int k = 0; k < 3; k++) {
        light.position[k] = (double)take_float(b);
        light.edge_u[k] = (double)take_float(b);
        light.edge_v[k] = (double)take_float(b);
        light.direction[k] = (double)take_float(b);
    }
    light.radius = (double)take_float(b);
    light.angle = (double)take_float(b);
    light.type = (int32_t)(take(b, 1) % (VOCC_LIGHT_SUN + 2));
    light.one_sided = (int32_t)(take(b, 1) % 2);
    sampling.samples = 1 + (int32_t)(take(b, 1) % 20);
    sampling.sampler = (int32_t)(take(b, 1) % 2);
    sampling.horizon = (int32_t)(take(b, 1) % 2);
    if (vocc_light_visibility(scene, count, view.org, view.dir, none, 1, &light,
                              &sampling, visible, share, NULL, NULL,
                              NULL) == VOCC_OK) {
        uint16_t again[MOST_RAYS];
        vocc_query_options plain;
        vocc_query_options_init(&plain);
        plain.order = VOCC_ORDER_STANDARD;
        plain.occluders = 0;
        expect(vocc_light_visibility(scene, count, view.org, view.dir, none, 1,
                                     &light, &sampling, again, NULL, NULL,
                                     &plain, NULL) == VOCC_OK,
               "light_visibility failed");
        for (uint32_t i = 0; i < count; i++) {
            expect(visible[i] == again[i], "light_visibility does not agree");
            expect(visible[i] == VOCC_NOT_TRACED
                       ? share[i] != share[i]
                       : share[i] >= 0.0f && share[i] <= 1.0f,
                   "irradiance is not a share");
        }
    }
    (void)vocc_ambient_occlusion(scene, count, view.org, view.dir, none,
                                 (double)take_float(b), &sampling, visible,
                                 NULL, NULL, NULL);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    bytes b = {data, size};
    heap h = {0, 0};
    const vocc_allocator allocator = {allocate, deallocate, &h};
    vocc_scene *scene = NULL;
    vocc_build_options options;
    expect(vocc_scene_create(&allocator, &scene, NULL) == VOCC_OK, "create");
    const uint32_t meshes = take(&b, 1) % (MOST_MESHES + 1);
    for (uint32_t i = 0; i < meshes; i++)
        add_mesh(scene, &b);
    vocc_build_options_init(&options);
    options.threads = 1;
    options.max_leaf_size = 1 + (int32_t)(take(&b, 1) % 64);
    options.max_depth = (int32_t)(take(&b, 1) % 61);
    options.bad_refines = (int32_t)(take(&b, 1) % 17);
    options.empty_bonus = (float)(take(&b, 1) % 5) / 4.0f;
    options.intersection_cost = 0.25f * (float)(1 + take(&b, 1) % 32);
    /* A build that runs out of memory first, sometimes. */
    const long live = h.live;
    h.countdown = (long)(take(&b, 1) % 64);
    vocc_status status = vocc_scene_build(scene, &options, NULL);
    h.countdown = 0;
    if (status == VOCC_ERROR_OUT_OF_MEMORY) {
        expect(h.live == live, "a failed build kept memory");
        status = vocc_scene_build(scene, &options, NULL);
    }
    expect(status == VOCC_OK, "build failed");
    query(scene, &b);
    vocc_scene_free(scene);
    expect(h.live == 0, "memory was not freed");
    return 0;
}

#ifdef FUZZ_REPLAY
int main(int argc, char **argv)
{
    for (int i = 1; i < argc; i++) {
        static uint8_t buffer[1 << 16];
        FILE *file = fopen(argv[i], "rb");
        if (!file) {
            fprintf(stderr, "%s: cannot be read\n", argv[i]);
            return 2;
        }
        const size_t size = fread(buffer, 1, sizeof(buffer), file);
        fclose(file);
        LLVMFuzzerTestOneInput(buffer, size);
        printf("%s: ok\n", argv[i]);
    }
    return 0;
}
#endif
