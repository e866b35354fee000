#define _POSIX_C_SOURCE 200112L
#include "driver.h"

#include <stdlib.h>
#include <string.h>
#include <time.h>

static double seconds(clockid_t clock)
{
    struct timespec t;
    clock_gettime(clock, &t);
    return (double)t.tv_sec + (double)t.tv_nsec * 1e-9;
}

double dr_wall(void)
{
    return seconds(CLOCK_MONOTONIC);
}

double dr_cpu(void)
{
    return seconds(CLOCK_PROCESS_CPUTIME_ID);
}

int dr_next_setting(const char **text, char key[32], char value[32])
{
    int length = 0;
    if (**text == '\0')
        return 0;
    if (sscanf(*text, "%31[^=,]=%31[^,]%n", key, value, &length) != 2)
        wl_die("'%s': expected key=value,key=value", *text);
    *text += length;
    *text += **text == ',';
    return 1;
}

/* ---- the job ------------------------------------------------------------ */

static size_t image_size(const dr_job *job)
{
    const wl_gbuffer *g = &job->gbuffer;
    return (size_t)g->width * g->height * (size_t)job->scene.light_count;
}

static void image_clear(dr_job *job)
{
    for (size_t i = 0; i < image_size(job); i++)
        job->image[i] = WL_NOT_TRACED;
}

/* Bytes, with 255 for not traced, where the counts fit; else little-endian
 * pairs of bytes. */
static uint8_t *image_bytes(const dr_job *job, size_t *size)
{
    size_t count = image_size(job), width = job->sampler.samples < 255 ? 1 : 2;
    uint8_t *bytes = wl_alloc(count, width);
    for (size_t i = 0; i < count; i++) {
        bytes[i * width] = (uint8_t)(job->image[i] & 0xff);
        if (width == 2)
            bytes[i * 2 + 1] = (uint8_t)(job->image[i] >> 8);
    }
    *size = count * width;
    return bytes;
}

static void job_points(dr_job *job)
{
    const wl_gbuffer *g = &job->gbuffer;
    size_t limit = (size_t)g->width * g->height;
    job->tile_count =
        wl_tiles(g->width, g->height, job->options.tile_limit, &job->tiles);
    job->pixels = wl_alloc(limit, sizeof *job->pixels);
    job->points = wl_alloc(limit, sizeof *job->points);
    job->normals = wl_alloc(limit, sizeof *job->normals);
    job->image = wl_alloc(image_size(job), sizeof *job->image);
    image_clear(job);
    size_t n = 0;
    for (size_t tile = 0; tile < job->tile_count; tile++) {
        const uint32_t *corner = job->tiles[tile];
        for (uint32_t y = corner[1]; y < corner[1] + WL_TILE && y < g->height;
             y++)
            for (uint32_t x = corner[0];
                 x < corner[0] + WL_TILE && x < g->width; x++) {
                uint32_t p = y * g->width + x;
                if (g->prim[p] < 0)
                    continue;
                job->pixels[n] = p;
                memcpy(job->points[n], g->on[p], sizeof *job->points);
                memcpy(job->normals[n], g->on[p] + 3, sizeof *job->normals);
                n++;
            }
    }
    job->pixel_count = n;
}

static size_t ray_count(const dr_job *job)
{
    size_t pairs = 0;
    for (size_t n = 0; n < job->pixel_count; n++)
        for (int k = 0; k < job->scene.light_count; k++)
            pairs += (size_t)wl_facing(&job->scene.lights[k],
                                       job->gbuffer.on[job->pixels[n]]);
    return pairs * job->sampler.samples;
}

static dr_rays rays_make(const dr_job *job)
{
    dr_rays rays = {ray_count(job), NULL, NULL};
    uint32_t samples = job->sampler.samples;
    float d[3][WL_MAX_SAMPLES];
    rays.org = wl_alloc(rays.count, sizeof *rays.org);
    rays.dir = wl_alloc(rays.count, sizeof *rays.dir);
    size_t ray = 0;
    for (size_t n = 0; n < job->pixel_count; n++) {
        const float *on = job->gbuffer.on[job->pixels[n]];
        for (int k = 0; k < job->scene.light_count; k++) {
            if (!wl_facing(&job->scene.lights[k], on))
                continue;
            wl_directions(&job->sampler, k, job->pixels[n], on, d[0], d[1],
                          d[2]);
            for (uint32_t s = 0; s < samples; s++, ray++)
                for (int i = 0; i < 3; i++) {
                    rays.org[ray][i] = on[i];
                    rays.dir[ray][i] = d[i][s];
                }
        }
    }
    return rays;
}

/* Segments between points at random in the bounds of the mesh, six hashes of
 * 24 bits each. */
static void rays_randomise(const dr_job *job, dr_rays *rays)
{
    double lower[3], upper[3];
    float low[3], width[3];
    wl_mesh_bounds(&job->mesh, lower, upper);
    for (int i = 0; i < 3; i++) {
        low[i] = (float)lower[i];
        width[i] = (float)upper[i] - (float)lower[i];
    }
    for (size_t ray = 0; ray < rays->count; ray++)
        for (uint32_t i = 0; i < 3; i++) {
            uint32_t key = (uint32_t)ray * 8 + i;
            uint32_t a = wl_hash32(key) >> 8, b = wl_hash32(key + 3) >> 8;
            float from = low[i] + (float)a * (1.0f / 16777216) * width[i];
            float to = low[i] + (float)b * (1.0f / 16777216) * width[i];
            rays->org[ray][i] = from;
            rays->dir[ray][i] = to - from;
        }
}

static int by_key(const void *a, const void *b)
{
    uint64_t x, y;
    memcpy(&x, a, sizeof x);
    memcpy(&y, b, sizeof y);
    return (x > y) - (x < y);
}

/* Sorts the rays by a hash of their place. */
static void rays_shuffle(dr_rays *rays)
{
    uint64_t *keys = wl_alloc(rays->count, sizeof *keys);
    float (*org)[3] = wl_alloc(rays->count, sizeof *org);
    float (*dir)[3] = wl_alloc(rays->count, sizeof *dir);
    if (rays->count > UINT32_MAX)
        wl_die("--order: too many rays");
    for (size_t ray = 0; ray < rays->count; ray++)
        keys[ray] = (uint64_t)wl_hash32((uint32_t)ray) << 32 | ray;
    qsort(keys, rays->count, sizeof *keys, by_key);
    for (size_t ray = 0; ray < rays->count; ray++) {
        size_t from = (size_t)(keys[ray] & 0xffffffffu);
        memcpy(org[ray], rays->org[from], sizeof *org);
        memcpy(dir[ray], rays->dir[from], sizeof *dir);
    }
    free(keys);
    free(rays->org);
    free(rays->dir);
    rays->org = org;
    rays->dir = dir;
}

/* Keeps the rays whose outcome is `wanted`, in order. */
static void rays_keep(dr_rays *rays, const uint8_t *blocked, int wanted)
{
    size_t kept = 0;
    for (size_t ray = 0; ray < rays->count; ray++) {
        if (blocked[ray] != wanted)
            continue;
        memmove(rays->org[kept], rays->org[ray], sizeof *rays->org);
        memmove(rays->dir[kept], rays->dir[ray], sizeof *rays->dir);
        kept++;
    }
    rays->count = kept;
}

/* Keeps those of the outcome that is asked for. */
static void rays_select(dr_job *job, const dr_backend *backend, void *self)
{
    const char *reason = "";
    void *prepared =
        backend->prepare(self, job, backend->reference_mode, &reason);
    if (prepared == NULL)
        wl_die("%s: %s", backend->reference_mode, reason);
    backend->trace(prepared, &job->rays, job->blocked);
    backend->release(prepared);
    rays_keep(&job->rays, job->blocked, job->options.kind == DR_BLOCKED);
}

static dr_rays rays_load(const char *path)
{
    float row[6];
    long size;
    FILE *file = fopen(path, "rb");
    if (file == NULL || fseek(file, 0, SEEK_END) != 0 ||
        (size = ftell(file)) < 0)
        wl_die("%s: cannot be read", path);
    rewind(file);
    dr_rays rays = {(size_t)size / sizeof row, NULL, NULL};
    rays.org = wl_alloc(rays.count, sizeof *rays.org);
    rays.dir = wl_alloc(rays.count, sizeof *rays.dir);
    for (size_t ray = 0; ray < rays.count; ray++) {
        if (fread(row, sizeof row, 1, file) != 1)
            wl_die("%s: the file ends too early", path);
        memcpy(rays.org[ray], row, sizeof *rays.org);
        memcpy(rays.dir[ray], row + 3, sizeof *rays.dir);
    }
    fclose(file);
    return rays;
}

static void job_rays(dr_job *job, const dr_backend *backend, void *self)
{
    const char *path = job->options.load_path;
    job->rays = path != NULL ? rays_load(path) : rays_make(job);
    job->blocked = wl_alloc(job->rays.count, 1);
    if (job->options.order == DR_RANDOM)
        rays_randomise(job, &job->rays);
    if (job->options.kind == DR_BLOCKED || job->options.kind == DR_VISIBLE)
        rays_select(job, backend, self);
    if (job->options.order == DR_SHUFFLE)
        rays_shuffle(&job->rays);
}

static FILE *create(const char *path)
{
    FILE *file = fopen(path, "wb");
    if (file == NULL)
        wl_die("%s: cannot be written", path);
    return file;
}

static void put(FILE *file, const void *data, size_t size)
{
    if (fwrite(data, 1, size, file) != size)
        wl_die("a write failed: is the disk full?");
}

static void put_file(const char *path, const void *data, size_t size)
{
    FILE *file = create(path);
    put(file, data, size);
    fclose(file);
}

/* Writes the rays as trace_file reads them. */
static void dump(const dr_job *job)
{
    const dr_rays *rays = &job->rays;
    FILE *file = create(job->options.dump_path);
    for (size_t ray = 0; ray < rays->count; ray++) {
        put(file, rays->org[ray], sizeof *rays->org);
        put(file, rays->dir[ray], sizeof *rays->dir);
    }
    fclose(file);
}

/* Traces rays from a file of float32 rows org, dir; writes one byte a ray. */
static void trace_file(const dr_job *job, const dr_backend *backend, void *self,
                       const char *mode)
{
    const char *reason = "";
    FILE *in = fopen(job->options.trace_in, "rb");
    if (in == NULL)
        wl_die("%s: cannot be opened", job->options.trace_in);
    FILE *out = create(job->options.trace_out);
    void *prepared = backend->prepare(self, job, mode, &reason);
    if (prepared == NULL)
        wl_die("%s: %s", mode, reason);
    enum { BATCH = 4096 };
    static float rows[BATCH][6], org[BATCH][3], dir[BATCH][3];
    static uint8_t blocked[BATCH];
    size_t count;
    while ((count = fread(rows, sizeof rows[0], BATCH, in)) > 0) {
        for (size_t ray = 0; ray < count; ray++) {
            memcpy(org[ray], rows[ray], sizeof org[0]);
            memcpy(dir[ray], rows[ray] + 3, sizeof dir[0]);
        }
        const dr_rays rays = {count, org, dir};
        backend->trace(prepared, &rays, blocked);
        put(out, blocked, count);
    }
    backend->release(prepared);
    fclose(in);
    fclose(out);
}

/* ---- runs --------------------------------------------------------------- */

/* Does all of a pass but the tracing: the harness's own share of the time. */
static void pass_none(dr_job *job)
{
    size_t area = (size_t)job->gbuffer.width * job->gbuffer.height;
    uint32_t samples = job->sampler.samples;
    static float d[3][WL_MAX_SAMPLES];
    for (size_t n = 0; n < job->pixel_count; n++) {
        uint32_t p = job->pixels[n];
        const float *on = job->gbuffer.on[p];
        for (int k = 0; k < job->scene.light_count; k++) {
            if (!wl_facing(&job->scene.lights[k], on))
                continue;
            wl_directions(&job->sampler, k, p, on, d[0], d[1], d[2]);
            int above = 0;
            for (uint32_t s = 0; s < samples; s++)
                above +=
                    d[0][s] * on[3] + d[1][s] * on[4] + d[2][s] * on[5] > 0;
            job->image[(size_t)k * area + p] = (uint16_t)above;
        }
    }
}

static const char *const kind_names[] = {"pass", "all", "blocked", "visible"};
static const char *const order_names[] = {"tile", "shuffle", "random"};

static void begin_line(const dr_job *job, const dr_backend *backend,
                       const char *mode)
{
    printf("{\"program\": \"%s\", \"mesh\": \"%s\", \"mode\": \"%s\", "
           "\"scene\": \"%s\", \"triangles\": %zu, ",
           backend->program, job->options.mesh_name, mode, job->scene.name,
           job->mesh.face_count + 2);
}

/* The outcome, and its hash; writes it where that is asked for. */
static void tell_outcome(const dr_job *job)
{
    const char *path = job->options.counts_path;
    size_t size = job->rays.count, sum = 0;
    uint8_t *bytes = job->blocked;
    if (job->options.kind == DR_PASS) {
        for (size_t i = 0; i < image_size(job); i++)
            sum += job->image[i] == WL_NOT_TRACED ? 0 : job->image[i];
        bytes = image_bytes(job, &size);
        printf("\"visible\": %zu, ", sum);
    } else {
        for (size_t ray = 0; ray < size; ray++)
            sum += bytes[ray];
        printf("\"blocked\": %zu, ", sum);
    }
    printf("\"hash\": \"%016llx\", ", (unsigned long long)wl_hash(bytes, size));
    if (path != NULL)
        put_file(path, bytes, size);
    if (bytes != job->blocked)
        free(bytes);
}

static void end_line(const dr_backend *backend, void *self)
{
    printf("\"build\": {");
    backend->describe(self, stdout);
    printf("}}\n");
    fflush(stdout);
}

static void run(dr_job *job, const dr_backend *backend, void *self,
                const char *mode, int counters)
{
    const char *reason = "";
    int none = strcmp(mode, "none") == 0;
    void *prepared = none ? NULL : backend->prepare(self, job, mode, &reason);
    begin_line(job, backend, mode);
    if (!none && prepared == NULL) {
        printf("\"error\": \"%s\", ", reason);
        end_line(backend, self);
        return;
    }
    size_t rays =
        job->options.kind == DR_PASS ? ray_count(job) : job->rays.count;
    image_clear(job);
    double cpu = dr_cpu(), wall = dr_wall();
    if (none)
        pass_none(job);
    else if (job->options.kind == DR_PASS)
        backend->pass(prepared, job);
    else
        backend->trace(prepared, &job->rays, job->blocked);
    cpu = dr_cpu() - cpu;
    wall = dr_wall() - wall;
    printf("\"kind\": \"%s\", \"order\": \"%s\", \"size\": %u, \"samples\": "
           "%u, \"tiles\": %zu, "
           "\"rays\": %zu, \"cpu_s\": %.6f, \"wall_s\": %.6f, "
           "\"mrays_s\": %.4f, ",
           kind_names[job->options.kind], order_names[job->options.order],
           job->gbuffer.width, job->sampler.samples, job->tile_count, rays, cpu,
           wall, (double)rays / (cpu > 0 ? cpu : 1e-9) * 1e-6);
    if (!none)
        tell_outcome(job);
    if (job->options.kind == DR_PASS && !none && counters &&
        backend->count != NULL) {
        printf("\"counters\": {");
        backend->count(prepared, job, stdout);
        printf("}, ");
    }
    if (prepared != NULL)
        backend->release(prepared);
    end_line(backend, self);
}

/* Runs what is asked for on standard input, one mode a line; a line that
 * begins with '+' has the counters, too. */
static void serve(dr_job *job, const dr_backend *backend, void *self)
{
    char line[256];
    while (fgets(line, sizeof line, stdin) != NULL) {
        line[strcspn(line, "\r\n")] = '\0';
        if (line[0] != '\0')
            run(job, backend, self, line + (line[0] == '+'), line[0] == '+');
    }
}

/* ---- command line ------------------------------------------------------- */

static const char usage_text[] =
    "MESH.ply [option...] MODE...\n"
    "  MODE - reads modes from standard input, one a line; +MODE counts\n"
    "  --scene workload|crowd|street\n"
    "  --size N --samples N      the image and each light (256, 16)\n"
    "  --gbuf FILE               G-buffer; made and written where absent\n"
    "  --repeat N                runs of each mode, A B C A B C\n"
    "  --tile-limit N            N tiles, evenly spread\n"
    "  --rays pass|all|blocked|visible\n"
    "                            the pass, or arrays of those rays\n"
    "  --order tile|shuffle|random\n"
    "                            of the arrays; random: other segments\n"
    "  --counters                count in a further, untimed run\n"
    "  --counts FILE             write the last mode's image, a byte a count,\n"
    "                            beyond 254 samples two; of arrays, a byte\n"
    "  --dump-rays FILE          write the rays: float32 org, dir\n"
    "  --load-rays FILE          such rays in place of the workload's, for\n"
    "                            --rays other than pass\n"
    "  --trace IN OUT            trace such rays, one byte a result\n"
    "  --build-only --build-threads N --build KEY=VALUE,...\n";

static long number(const char *text, long lowest, long highest)
{
    char *end;
    long n = strtol(text, &end, 10);
    if (end == text || *end != '\0' || n < lowest || n > highest)
        wl_die("'%s': expected a number from %ld to %ld", text, lowest,
               highest);
    return n;
}

static dr_kind kind_of(const char *name)
{
    for (int i = 0; i < 4; i++)
        if (strcmp(name, kind_names[i]) == 0)
            return (dr_kind)i;
    wl_die("--rays: pass, all, blocked or visible, not '%s'", name);
}

static dr_order ray_order_of(const char *name)
{
    for (int i = 0; i < 3; i++)
        if (strcmp(name, order_names[i]) == 0)
            return (dr_order)i;
    wl_die("--order: tile, shuffle or random, not '%s'", name);
}

/* "path/bunny.ply" -> "bunny" */
static const char *stem(const char *path)
{
    const char *slash = strrchr(path, '/');
    const char *name = slash != NULL ? slash + 1 : path;
    const char *dot = strrchr(name, '.');
    size_t length = dot != NULL ? (size_t)(dot - name) : strlen(name);
    char *copy = wl_alloc(length + 1, 1);
    memcpy(copy, name, length);
    copy[length] = '\0';
    return copy;
}

static int parse(int argc, char **argv, dr_options *o, const char **modes)
{
    int mode_count = 0;
    for (int i = 1; i < argc; i++) {
        const char *name = argv[i];
        if (strcmp(name, "--counters") == 0) {
            o->counters = 1;
        } else if (strcmp(name, "--build-only") == 0) {
            o->build_only = 1;
        } else if (strcmp(name, "--trace") == 0) {
            if (i + 2 >= argc)
                wl_die("--trace needs IN and OUT");
            o->trace_in = argv[++i];
            o->trace_out = argv[++i];
        } else if (name[0] == '-' && name[1] == '-') {
            if (i + 1 >= argc)
                wl_die("%s needs a value", name);
            const char *value = argv[++i];
            if (strcmp(name, "--size") == 0)
                o->size = (uint32_t)number(value, 1, 1 << 14);
            else if (strcmp(name, "--samples") == 0)
                o->samples = (uint32_t)number(value, 1, WL_MAX_SAMPLES);
            else if (strcmp(name, "--gbuf") == 0)
                o->gbuffer_path = value;
            else if (strcmp(name, "--repeat") == 0)
                o->repeat = (int)number(value, 1, 1000000);
            else if (strcmp(name, "--tile-limit") == 0)
                o->tile_limit = (size_t)number(value, 1, 1 << 20);
            else if (strcmp(name, "--rays") == 0)
                o->kind = kind_of(value);
            else if (strcmp(name, "--order") == 0)
                o->order = ray_order_of(value);
            else if (strcmp(name, "--scene") == 0)
                o->scene_name = value;
            else if (strcmp(name, "--counts") == 0)
                o->counts_path = value;
            else if (strcmp(name, "--dump-rays") == 0)
                o->dump_path = value;
            else if (strcmp(name, "--load-rays") == 0)
                o->load_path = value;
            else if (strcmp(name, "--build-threads") == 0)
                o->build_threads = (int)number(value, 0, 256);
            else if (strcmp(name, "--build") == 0)
                o->build_options = value;
            else
                wl_die("unknown option %s", name);
        } else if (o->mesh_path == NULL) {
            o->mesh_path = name;
        } else {
            modes[mode_count++] = name;
        }
    }
    return mode_count;
}

static void job_free(dr_job *job)
{
    wl_mesh_free(&job->mesh);
    wl_gbuffer_free(&job->gbuffer);
    free(job->tiles);
    free(job->pixels);
    free(job->points);
    free(job->normals);
    free(job->image);
    free(job->rays.org);
    free(job->rays.dir);
    free(job->blocked);
}

static void job_gbuffer(dr_job *job, const dr_backend *backend, void *self)
{
    const dr_options *o = &job->options;
    if (o->gbuffer_path != NULL &&
        wl_gbuffer_load(&job->gbuffer, o->gbuffer_path)) {
        if (job->gbuffer.width != o->size || job->gbuffer.height != o->size)
            wl_die("%s: %u x %u pixels, not %u", o->gbuffer_path,
                   job->gbuffer.width, job->gbuffer.height, o->size);
        return;
    }
    job->gbuffer = wl_gbuffer_make(&job->mesh, &job->scene, o->size, o->size,
                                   backend->closest, self);
    if (o->gbuffer_path != NULL)
        wl_gbuffer_save(&job->gbuffer, o->gbuffer_path);
}

int dr_main(int argc, char **argv, const dr_backend *backend)
{
    static dr_job job;
    dr_options *o = &job.options;
    const char **modes = wl_alloc((size_t)argc, sizeof *modes);
    o->size = 256;
    o->samples = 16;
    o->repeat = 1;
    o->build_threads = 1;
    o->build_options = "";
    o->scene_name = "workload";
    int mode_count = parse(argc, argv, o, modes);
    if (o->mesh_path == NULL ||
        (mode_count == 0 && !o->build_only && o->dump_path == NULL)) {
        fprintf(stderr, "usage: run_%s %s%s", backend->program, usage_text,
                backend->usage);
        return 2;
    }
    o->mesh_name = stem(o->mesh_path);
    job.scene = wl_scene_named(o->scene_name);
    job.mesh = wl_mesh_load(o->mesh_path, &job.scene);
    wl_sampler_init(&job.sampler, o->samples, job.scene.lights);
    void *self = backend->open(&job);
    if (o->build_only) {
        begin_line(&job, backend, "build");
        end_line(backend, self);
    } else {
        if (o->trace_in != NULL) {
            trace_file(&job, backend, self, modes[0]);
        } else {
            job_gbuffer(&job, backend, self);
            job_points(&job);
            if (o->kind != DR_PASS || o->dump_path != NULL)
                job_rays(&job, backend, self);
            if (o->dump_path != NULL)
                dump(&job);
            if (mode_count == 1 && strcmp(modes[0], "-") == 0)
                serve(&job, backend, self);
            else
                for (int round = 0; round < o->repeat; round++)
                    for (int m = 0; m < mode_count; m++)
                        run(&job, backend, self, modes[m],
                            o->counters && round == 0);
        }
    }
    backend->close(self);
    job_free(&job);
    free((void *)(uintptr_t)o->mesh_name);
    free(modes);
    return 0;
}
