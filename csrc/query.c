#include "query.h"
#include "array.h"
#include "beam.h"
#include "isa.h"
#include "memory.h"
#include "ray_order.h"
#include "shaft.h"
#include "status.h"
#include "vec3.h"
#include "walk.h"

#include <inttypes.h>
#include <math.h>
#include <string.h>

/* ---- what all queries share ------------------------------------------------
 */

void vocc_query_options_init(vocc_query_options *options)
{
    memset(options, 0, sizeof *options);
    options->size = (uint32_t)sizeof *options;
    options->order = VOCC_ORDER_AUTO;
    options->occluders = 1;
    options->deferment = VOCC_MAX_DEFERMENT;
    options->cache = 8;
    options->fusion = 1;
    options->entry_points = -1;
    options->entry_triangles = 8;
    options->packets = 1;
    options->isa = VOCC_ISA_AUTO;
}

static vocc_status check_options(const vocc_query_options *o, vocc_error *error)
{
    vocc_status s;
    if (o->size != sizeof *o)
        return vocc_fail(
            error, VOCC_ERROR_INVALID_ARGUMENT, "options", -1, (double)o->size,
            "options: size is %" PRIu32 ", not sizeof(vocc_query_options)",
            o->size);
    s = vocc_check_range(error, "order", o->order, VOCC_ORDER_AUTO,
                         VOCC_ORDER_RTSAH);
    if (s == VOCC_OK)
        s = vocc_check_range(error, "occluders", o->occluders, 0, 1);
    if (s == VOCC_OK)
        s = vocc_check_range(error, "deferment", o->deferment, 0,
                             VOCC_MAX_DEFERMENT);
    if (s == VOCC_OK)
        s = vocc_check_range(error, "cache", o->cache, 0, VOCC_MAX_CACHE);
    if (s == VOCC_OK)
        s = vocc_check_range(error, "cache_policy", o->cache_policy,
                             VOCC_CACHE_RECENT, VOCC_CACHE_DIRECTION);
    if (s == VOCC_OK)
        s = vocc_check_range(error, "fusion", o->fusion, 0, 1);
    if (s == VOCC_OK)
        s = vocc_check_range(error, "triangle_cache", o->triangle_cache, 0, 1);
    if (s == VOCC_OK)
        s = vocc_check_range(error, "entry_points", o->entry_points, -1, 1);
    if (s == VOCC_OK)
        s = vocc_check_range(error, "entry_triangles", o->entry_triangles, 0,
                             VOCC_SHAFT_TRIANGLES);
    if (s == VOCC_OK)
        s = vocc_check_range(error, "voxels", o->voxels, 0, 1024);
    if (s == VOCC_OK)
        s = vocc_check_range(error, "method", o->method, VOCC_METHOD_AUTO,
                             VOCC_METHOD_BEAMS);
    if (s == VOCC_OK)
        s = vocc_check_range(error, "verify", o->verify, 0, INT32_MAX);
    if (s == VOCC_OK)
        s = vocc_check_range(error, "packets", o->packets, 0, 1);
    if (s == VOCC_OK)
        s = vocc_check_range(error, "isa", o->isa, VOCC_ISA_AUTO,
                             VOCC_ISA_NEON);
    if (s == VOCC_OK)
        s = vocc_check_range(error, "threads", o->threads, 0, VOCC_MAX_THREADS);
    return s;
}

vocc_status vocc_query_isa(const vocc_query_options *options, int32_t *isa,
                           vocc_error *error)
{
    if (!isa)
        return vocc_fail(error, VOCC_ERROR_INVALID_ARGUMENT, "isa", -1,
                         (double)NAN, "isa: NULL");
    if (options) {
        const vocc_status status = check_options(options, error);
        if (status != VOCC_OK)
            return status;
    }
    return vocc_isa_choose(options ? options->isa : VOCC_ISA_AUTO, isa, error);
}

static void free_workers(vocc_query *query)
{
    const vocc_allocator *a = &query->scene->allocator;
    int i;
    for (i = 0; i < query->worker_count; i++) {
        vocc_tracer_free(a, query->workers[i].tracer);
        vocc_release(a, query->workers[i].block);
    }
}

vocc_status vocc_query_begin(vocc_query *query, const vocc_scene *scene,
                             const vocc_query_options *options, size_t jobs,
                             vocc_error *error)
{
    vocc_status status = vocc_check_built(scene, error);
    if (status != VOCC_OK)
        return status;
    query->scene = scene;
    vocc_query_options_init(&query->options);
    if (options) {
        status = check_options(options, error);
        if (status != VOCC_OK)
            return status;
        query->options = *options;
    }
    if (query->options.entry_points < 0)
        query->options.entry_points = query->options.order == VOCC_ORDER_AUTO;
    query->occluders = query->options.occluders;
    if (query->options.order == VOCC_ORDER_AUTO) {
        query->options.order = scene->built.report.auto_order;
        if (!scene->built.auto_occluders)
            query->options.occluders = 0;
    }
    status = vocc_isa_choose(query->options.isa, &query->options.isa, error);
    if (status != VOCC_OK)
        return status;
    query->kernels = vocc_find_kernels(&query->options);
    if (query->options.threads == 0)
        query->options.threads = vocc_processor_count();
    if ((size_t)query->options.threads > jobs)
        query->options.threads = jobs ? (int32_t)jobs : 1;
    vocc_ticker_init(&query->ticker, query->options.progress,
                     query->options.progress_user);
    query->worker_count = 0;
    while (query->worker_count < query->options.threads) {
        vocc_worker *w = &query->workers[query->worker_count++];
        w->tracer = vocc_tracer_create(&scene->allocator, &scene->built.tree,
                                       &query->options, query->kernels);
        w->block = vocc_allocate(&scene->allocator, 1, sizeof *w->block);
        if (!w->tracer || !w->block) {
            free_workers(query);
            return vocc_fail_plain(error, VOCC_ERROR_OUT_OF_MEMORY);
        }
    }
    return VOCC_OK;
}

vocc_status vocc_query_run(vocc_query *query, size_t jobs, vocc_job_fn run,
                           void *context)
{
    const vocc_status status =
        vocc_jobs_run(&query->scene->allocator, query->worker_count, jobs, run,
                      context, &query->ticker);
    if (status == VOCC_OK && vocc_tick(&query->ticker, 1.0))
        return VOCC_ERROR_CANCELLED;
    return status;
}

static void add_counters(vocc_counters *to, const vocc_counters *from)
{
    /* All fields are uint64_t. */
    uint64_t a[sizeof *to / sizeof(uint64_t)], b[sizeof a / sizeof *a];
    size_t i;
    memcpy(a, to, sizeof a);
    memcpy(b, from, sizeof b);
    for (i = 0; i < sizeof a / sizeof *a; i++)
        a[i] += b[i];
    memcpy(to, a, sizeof a);
}

vocc_status vocc_query_end(vocc_query *query, vocc_status status,
                           vocc_error *error)
{
    int i;
    if (status == VOCC_OK && query->options.counters)
        for (i = 0; i < query->worker_count; i++)
            add_counters(query->options.counters,
                         &query->workers[i].tracer->counters);
    free_workers(query);
    return status == VOCC_OK ? VOCC_OK : vocc_fail_plain(error, status);
}

/* ---- rays
 * -------------------------------------------------------------------- */

/* Rays a job: some milliseconds.  Many are worth sorting. */
enum {
    JOB_RAYS = 16 * VOCC_BLOCK,
    MOST_JOB_RAYS = VOCC_ORDER_RAYS,
    LEAST_SORTED = 4 * VOCC_BLOCK,
    MOST_STRIDE = 64 /* bytes: of rows that are fetched before their block */
};

typedef struct ray_query {
    vocc_query query;
    const vocc_rays *rays;
    const vocc_hits *hits; /* or */
    uint8_t *occluded;
    /* One a worker; NULL: through the kd-tree. */
    vocc_beam *beams;
    vocc_ray_order **orders; /* one a worker; NULL until there is work for it */
    size_t job_rays;
    const vocc_beam_kernels *beam_kernels;
    /* With hits: NULL, or shading points. */
    float *position, *normal;
    double offset;
} ray_query;

static vocc_status check_rays(const vocc_rays *rays, vocc_error *error)
{
    vocc_status status;
    if (!rays)
        return vocc_fail(error, VOCC_ERROR_INVALID_ARGUMENT, "rays", -1,
                         (double)NAN, "rays: NULL");
    status = vocc_check_floats(rays->org, rays->count, "org", error);
    if (status == VOCC_OK)
        status = vocc_check_floats(rays->dir, rays->count, "dir", error);
    if (status == VOCC_OK && rays->tmin.data)
        status = vocc_check_floats(rays->tmin, rays->count, "tmin", error);
    if (status == VOCC_OK && rays->tmax.data)
        status = vocc_check_floats(rays->tmax, rays->count, "tmax", error);
    return status;
}

/* Where rows are: `first` and so on; or after it by the numbers of `which`. */
typedef struct places {
    size_t first, count;
    const uint16_t *which;
} places;

VOCC_INLINE size_t place(const places *p, size_t i)
{
    return p->first + (p->which ? (size_t)p->which[i] : i);
}

static void load_vectors(vocc_array array, const double origin[3],
                         const places *p, float *x, float *y, float *z)
{
    const int moved = origin[0] != 0.0 || origin[1] != 0.0 || origin[2] != 0.0;
    size_t i;
    if (array.type == VOCC_FLOAT32 && !moved && !p->which) {
        const char *row = vocc_row(&array, p->first);
        for (i = 0; i < p->count; i++, row += array.stride) {
            const float *v = (const float *)(const void *)row;
            x[i] = v[0];
            y[i] = v[1];
            z[i] = v[2];
        }
        return;
    }
    if (array.type == VOCC_FLOAT32 && !moved) {
        for (i = 0; i < p->count; i++) {
            const float *v = vocc_row(&array, place(p, i));
            x[i] = v[0];
            y[i] = v[1];
            z[i] = v[2];
        }
        return;
    }
    for (i = 0; i < p->count; i++) {
        const size_t row = place(p, i);
        x[i] = (float)(vocc_get_float(&array, row, 0) - origin[0]);
        y[i] = (float)(vocc_get_float(&array, row, 1) - origin[1]);
        z[i] = (float)(vocc_get_float(&array, row, 2) - origin[2]);
    }
}

static void load_scalars(vocc_array array, float none, const places *p,
                         float *out)
{
    size_t i;
    if (!array.data || array.stride == 0) {
        const float all =
            array.data ? (float)vocc_get_float(&array, 0, 0) : none;
        for (i = 0; i < p->count; i++)
            out[i] = all;
        return;
    }
    for (i = 0; i < p->count; i++)
        out[i] = (float)vocc_get_float(&array, place(p, i), 0);
}

/* Vectors of the block that begins at a row, which may be beyond the last. */
static void fetch_rows(const vocc_array *array, size_t first, size_t count)
{
    const size_t stride = (size_t)array->stride;
    size_t at = 0;
    if (array->stride <= 0 || stride > MOST_STRIDE || first >= count)
        return;
    count = count - first < VOCC_BLOCK ? count - first : VOCC_BLOCK;
    for (at = 0; at < count * stride; at += 64)
        VOCC_PREFETCH((const char *)vocc_row(array, first) + at);
}

static void load_block(const ray_query *q, const places *p, vocc_block *block)
{
    static const double nowhere[3] = {0.0, 0.0, 0.0};
    size_t i;
    block->count = p->count;
    load_vectors(q->rays->org, q->query.scene->built.origin, p, block->org[0],
                 block->org[1], block->org[2]);
    load_vectors(q->rays->dir, nowhere, p, block->dir[0], block->dir[1],
                 block->dir[2]);
    load_scalars(q->rays->tmin, 0.0f, p, block->tmin);
    load_scalars(q->rays->tmax, INFINITY, p, block->tmax);
    for (i = 0; i < block->count; i++)
        block->end_region[i] = block->tmax[i] > FLT_MAX ? 0 : VOCC_END_UNKNOWN;
}

static void store_hits(const ray_query *q, size_t first,
                       const vocc_block *block)
{
    const vocc_hits *h = q->hits;
    size_t i;
    for (i = 0; i < block->count; i++) {
        int32_t geom_id = -1, prim_id = -1;
        if (block->triangle[i] != UINT32_MAX)
            vocc_scene_triangle(q->query.scene, block->triangle[i], &geom_id,
                                &prim_id);
        if (h->t)
            h->t[first + i] = block->t[i];
        if (h->geom_id)
            h->geom_id[first + i] = geom_id;
        if (h->prim_id)
            h->prim_id[first + i] = prim_id;
        if (h->u)
            h->u[first + i] = block->u[i];
        if (h->v)
            h->v[first + i] = block->v[i];
    }
}

/* Not NaN and not infinite. */
static double usable(double x)
{
    if (x != x)
        return 0.0;
    return x > DBL_MAX ? DBL_MAX : x < -DBL_MAX ? -DBL_MAX : x;
}

/* Where ray i of the block, number `ray` of all, meets its triangle. */
static void find_shading_point(const ray_query *q, size_t ray,
                               const vocc_block *block, size_t i,
                               float position[3], float normal[3])
{
    const float *corners = q->query.scene->built.tree.corners;
    double a[3], u[3], v[3], n[3], d[3], org[3], to[3], length, slope, t, side;
    int k;
    if (block->triangle[i] == UINT32_MAX) {
        for (k = 0; k < 3; k++) {
            position[k] = NAN;
            normal[k] = 0.0f;
        }
        return;
    }
    corners += 9 * (size_t)block->slot[i];
    for (k = 0; k < 3; k++) {
        a[k] = (double)corners[k];
        u[k] = (double)corners[3 + k] - a[k];
        v[k] = (double)corners[6 + k] - a[k];
        d[k] = (double)block->dir[k][i];
        org[k] = vocc_get_float(&q->rays->org, ray, k) -
                 q->query.scene->built.origin[k];
        to[k] = a[k] - org[k];
    }
    vocc_cross(u, v, n);
    length = sqrt(vocc_dot(n, n));
    for (k = 0; k < 3; k++)
        n[k] /= length;
    slope = vocc_dot(d, n);
    t = vocc_dot(to, n) / slope;
    if (!(vocc_abs(t) <= DBL_MAX))
        t = (double)block->t[i];
    /* Not above 0 is the front, as it is for a slope that is not a number. */
    side = slope > 0.0 ? -1.0 : 1.0;
    for (k = 0; k < 3; k++) {
        const double x = usable(n[k]);
        position[k] = (float)((org[k] + t * d[k]) + q->offset * side * x);
        normal[k] = (float)(side * x);
    }
}

static void store_shading_points(const ray_query *q, size_t first,
                                 const vocc_block *block)
{
    size_t i;
    for (i = 0; i < block->count; i++) {
        float position[3], normal[3];
        find_shading_point(q, first + i, block, i, position, normal);
        if (q->position)
            memcpy(q->position + 3 * (first + i), position, sizeof position);
        if (q->normal)
            memcpy(q->normal + 3 * (first + i), normal, sizeof normal);
    }
}

/* Whether most rays are like their neighbours, so that packets of 16 stay
 * together as they come. */
static int is_coherent(const vocc_block *b, float scale)
{
    size_t packets = 0, alike = 0, i, j;
    for (i = 0; i + VOCC_WIDE <= b->count; i += VOCC_WIDE) {
        float reach = 0.0f, apart = 0.0f, turned = 0.0f;
        int k;
        for (k = 0; k < 3; k++) {
            const float d = vocc_absf(b->dir[k][i]);
            reach = d > reach ? d : reach;
            for (j = i + 1; j < i + VOCC_WIDE; j++) {
                const float o = vocc_absf(b->org[k][j] - b->org[k][i]),
                            t = vocc_absf(b->dir[k][j] - b->dir[k][i]);
                apart = o > apart ? o : apart;
                turned = t > turned ? t : turned;
            }
        }
        packets++;
        alike += apart <= scale * 0x1p-6f && turned <= reach * 0x1p-1f;
    }
    return alike * 4 >= packets * 3;
}

/* The rays of the block through the hierarchy. */
static void trace_wide(const ray_query *q, int worker)
{
    const vocc_worker *w = &q->query.workers[worker];
    vocc_beam *b = &q->beams[worker];
    vocc_counters *c = &w->tracer->counters;
    uint16_t odd[VOCC_BLOCK];
    const uint64_t nodes = b->nodes, clusters = b->clusters,
                   tests = b->ray_tests, exact = b->exact_tests;
    const size_t count =
        q->beam_kernels->trace_rays(b, w->block, q->query.occluders, odd);
    size_t i;
    for (i = 0; i < count; i++) {
        w->block->occluded[odd[i]] = 0;
        if (vocc_is_void(w->block, odd[i]))
            continue;
        c->careful_rays++;
        vocc_trace_careful(w->tracer, w->block, odd[i], 0);
    }
    c->rays += w->block->count;
    for (i = 0; i < w->block->count; i++)
        c->occluded += w->block->occluded[i];
    c->beam_nodes += b->nodes - nodes;
    c->beam_clusters += b->clusters - clusters;
    c->beam_tests += b->ray_tests - tests;
    c->exact_tests += b->exact_tests - exact;
}

/* Places of the next block, from `i` of a job's rays on. */
static places next_block(const ray_query *q, size_t job, size_t count, size_t i)
{
    places p;
    p.first = job * q->job_rays + i;
    p.count = count - i < VOCC_BLOCK ? count - i : VOCC_BLOCK;
    p.which = NULL;
    return p;
}

/* *order is NULL where the rays are to be taken as they come. */
static vocc_status sort_rays(const ray_query *q, size_t job, size_t count,
                             int worker, const vocc_ray_order **order)
{
    vocc_block *const block = q->query.workers[worker].block;
    const vocc_scene *scene = q->query.scene;
    const float scale = scene->built.tree.scale;
    vocc_ray_order *o = q->orders[worker];
    size_t i, blocks = 0, coherent = 0;
    *order = NULL;
    if (count < LEAST_SORTED)
        return VOCC_OK;
    if (!o)
        o = q->orders[worker] = vocc_allocate(&scene->allocator, 1, sizeof *o);
    if (!o)
        return VOCC_ERROR_OUT_OF_MEMORY;
    vocc_ray_order_begin(o, scale);
    for (i = 0; i + VOCC_BLOCK <= count; i += 8 * VOCC_BLOCK) {
        const places p = next_block(q, job, count, i);
        load_block(q, &p, block);
        blocks++;
        coherent += is_coherent(block, scale) != 0;
        vocc_ray_order_look(o, block);
    }
    if (4 * coherent >= 3 * blocks)
        return VOCC_OK;
    for (i = 0; i < count; i += VOCC_BLOCK) {
        const places p = next_block(q, job, count, i);
        load_block(q, &p, block);
        vocc_ray_order_add(o, block);
    }
    vocc_ray_order_sort(o);
    *order = o;
    return VOCC_OK;
}

static void store_occluded(const ray_query *q, const places *p,
                           const vocc_block *block)
{
    size_t i;
    if (!p->which)
        memcpy(q->occluded + p->first, block->occluded, p->count);
    else
        for (i = 0; i < p->count; i++)
            q->occluded[place(p, i)] = block->occluded[i];
}

static vocc_status trace_rays(void *context, size_t job, int worker,
                              vocc_jobs *jobs)
{
    ray_query *q = context;
    const vocc_worker *w = &q->query.workers[worker];
    const size_t rest = q->rays->count - job * q->job_rays,
                 count = rest < q->job_rays ? rest : q->job_rays;
    const vocc_ray_order *order = NULL;
    size_t i;
    (void)jobs;
    /* So that counters do not depend on which worker took which job. */
    vocc_tracer_forget(w->tracer);
    if (q->beams) {
        const vocc_status status = sort_rays(q, job, count, worker, &order);
        vocc_worth_begin(&q->beams[worker].worth);
        if (status != VOCC_OK)
            return status;
    }
    for (i = 0; i < count; i += VOCC_BLOCK) {
        places p = next_block(q, job, count, i);
        if (order) {
            p.first = job * q->job_rays;
            p.which = order->number + i;
        }
        load_block(q, &p, w->block);
        if (!order) {
            fetch_rows(&q->rays->org, p.first + p.count, q->rays->count);
            fetch_rows(&q->rays->dir, p.first + p.count, q->rays->count);
        }
        if (q->hits) {
            q->query.kernels->closest(w->tracer, w->block);
            store_hits(q, p.first, w->block);
            if (q->position || q->normal)
                store_shading_points(q, p.first, w->block);
            continue;
        }
        if (q->beams)
            trace_wide(q, worker);
        else
            q->query.kernels->occluded(w->tracer, w->block);
        store_occluded(q, &p, w->block);
    }
    return VOCC_OK;
}

/* Through the hierarchy, unless the options ask for the kd-tree. */
static vocc_status make_beams(ray_query *q, const vocc_query_options *asked)
{
    const vocc_scene *scene = q->query.scene;
    int32_t method = asked ? asked->method : VOCC_METHOD_AUTO;
    int i;
    q->beams = NULL;
    q->orders = NULL;
    if (method == VOCC_METHOD_AUTO)
        method = !asked || (asked->order == VOCC_ORDER_AUTO && asked->packets)
                     ? VOCC_METHOD_BEAMS
                     : VOCC_METHOD_RAYS;
    if (q->hits || method == VOCC_METHOD_RAYS)
        return VOCC_OK;
    q->beams = vocc_allocate_lines(
        &scene->allocator, (size_t)q->query.worker_count, sizeof *q->beams);
    q->orders = vocc_allocate(&scene->allocator, (size_t)q->query.worker_count,
                              sizeof *q->orders);
    if (!q->beams || !q->orders)
        return VOCC_ERROR_OUT_OF_MEMORY;
    q->beam_kernels = vocc_find_beam_kernels(q->query.options.isa);
    memset(q->beams, 0, (size_t)q->query.worker_count * sizeof *q->beams);
    for (i = 0; i < q->query.worker_count; i++) {
        q->beams[i].tree = &scene->built.tree;
        q->beams[i].bvh = &scene->built.bvh;
        q->orders[i] = NULL;
    }
    return VOCC_OK;
}

/* So many that threads have some each, whatever their number: counters must not
 * depend on it. */
static size_t rays_a_job(const ray_query *q)
{
    const size_t share = q->rays->count / 32;
    return q->hits || share < JOB_RAYS ? JOB_RAYS
           : share < MOST_JOB_RAYS     ? share
                                       : MOST_JOB_RAYS;
}

static void free_beams(ray_query *q)
{
    const vocc_allocator *a = &q->query.scene->allocator;
    int i;
    for (i = 0; q->orders && i < q->query.worker_count; i++)
        vocc_release(a, q->orders[i]);
    vocc_release(a, q->orders);
    vocc_release_lines(a, q->beams);
}

static vocc_status run_rays(const vocc_scene *scene, ray_query *q,
                            const vocc_query_options *options,
                            vocc_error *error)
{
    size_t jobs;
    vocc_status status;
    q->job_rays = rays_a_job(q);
    jobs = q->rays->count / q->job_rays + (q->rays->count % q->job_rays != 0);
    status = vocc_query_begin(&q->query, scene, options, jobs, error);
    if (status != VOCC_OK)
        return status;
    status = make_beams(q, options);
    if (status == VOCC_OK)
        status = vocc_query_run(&q->query, jobs, trace_rays, q);
    free_beams(q);
    return vocc_query_end(&q->query, status, error);
}

vocc_status vocc_intersect(const vocc_scene *scene, const vocc_rays *rays,
                           const vocc_hits *hits,
                           const vocc_query_options *options, vocc_error *error)
{
    return vocc_shading_points(scene, rays, 0.0, hits, NULL, NULL, options,
                               error);
}

vocc_status vocc_shading_points(const vocc_scene *scene, const vocc_rays *rays,
                                double offset, const vocc_hits *hits,
                                float *position, float *normal,
                                const vocc_query_options *options,
                                vocc_error *error)
{
    ray_query q;
    const vocc_status status = check_rays(rays, error);
    if (status != VOCC_OK)
        return status;
    if (!hits)
        return vocc_fail(error, VOCC_ERROR_INVALID_ARGUMENT, "hits", -1,
                         (double)NAN, "hits: NULL");
    if (!(offset >= 0.0 && offset <= DBL_MAX))
        return vocc_fail(
            error, VOCC_ERROR_INVALID_ARGUMENT, "offset", -1, offset,
            "offset is %.10g: it has to be finite and at least 0", offset);
    q.rays = rays;
    q.hits = hits;
    q.position = position;
    q.normal = normal;
    q.offset = offset;
    q.occluded = NULL;
    return run_rays(scene, &q, options, error);
}

vocc_status vocc_occluded(const vocc_scene *scene, const vocc_rays *rays,
                          uint8_t *occluded, const vocc_query_options *options,
                          vocc_error *error)
{
    ray_query q;
    const vocc_status status = check_rays(rays, error);
    if (status != VOCC_OK)
        return status;
    if (!occluded && rays->count)
        return vocc_fail(error, VOCC_ERROR_INVALID_ARGUMENT, "occluded", -1,
                         (double)NAN, "occluded: NULL");
    q.rays = rays;
    q.hits = NULL;
    q.occluded = occluded;
    return run_rays(scene, &q, options, error);
}

/* ---- regions of points
 * --------------------------------------------------------- */

enum {
    JOB_POINTS = 1024,
    ON_SURFACE = -1,
    NOT_A_POINT = -2,
    NEW_REGION = -3 /* to be added when all workers are done */
};

typedef struct point_query {
    vocc_query query;
    size_t count;
    vocc_array points;
    int32_t *region;
} point_query;

/* The region of point i; its set is left in *seed if it has no number yet. */
static vocc_status find_region(point_query *q, size_t i, vocc_seed *seed)
{
    static const double exactly[3] = {0.0, 0.0, 0.0};
    const vocc_scene *scene = q->query.scene;
    const vocc_solids solids = vocc_scene_solids(scene);
    places one;
    float p[3];
    double wide[3];
    int k;
    one.first = i;
    one.count = 1;
    one.which = NULL;
    load_vectors(q->points, scene->built.origin, &one, &p[0], &p[1], &p[2]);
    for (k = 0; k < 3; k++) {
        wide[k] = (double)p[k];
        if (!vocc_finitef(p[k])) {
            q->region[i] = NOT_A_POINT;
            return VOCC_OK;
        }
    }
    if (vocc_locate(&scene->built.tree, wide, exactly, &q->region[i]))
        return VOCC_OK;
    switch (vocc_seed_shoot(&scene->allocator, &scene->built.tree, &solids, p,
                            0, seed)) {
    case VOCC_SEED_OK:
        vocc_mutex_lock(scene->built.regions_mutex);
        q->region[i] =
            vocc_regions_find(scene->built.regions, seed->set, seed->set_count);
        vocc_mutex_unlock(scene->built.regions_mutex);
        if (q->region[i] < 0)
            q->region[i] = NEW_REGION;
        return VOCC_OK;
    case VOCC_SEED_ON_SURFACE:
        q->region[i] = ON_SURFACE;
        return VOCC_OK;
    case VOCC_SEED_NO_MEMORY:
        return VOCC_ERROR_OUT_OF_MEMORY;
    case VOCC_SEED_NO_DIRECTION:
    default:
        return VOCC_ERROR_LIMIT;
    }
}

static vocc_status locate_points(void *context, size_t job, int worker,
                                 vocc_jobs *jobs)
{
    point_query *q = context;
    vocc_seed seed;
    vocc_status status = VOCC_OK;
    size_t i = job * JOB_POINTS, end = i + JOB_POINTS;
    memset(&seed, 0, sizeof seed);
    if (end > q->count)
        end = q->count;
    for (; i < end && status == VOCC_OK; i++) {
        if (i % 64 == 0 && vocc_jobs_poll(jobs, worker))
            status = VOCC_ERROR_CANCELLED;
        else
            status = find_region(q, i, &seed);
    }
    vocc_seed_free(&q->query.scene->allocator, &seed);
    return status;
}

/* Numbers regions that no leaf has, in the order of the points. */
static vocc_status add_regions(point_query *q)
{
    const vocc_scene *scene = q->query.scene;
    vocc_seed seed;
    vocc_status status = VOCC_OK;
    size_t i;
    memset(&seed, 0, sizeof seed);
    for (i = 0; i < q->count && status == VOCC_OK; i++) {
        if (q->region[i] != NEW_REGION)
            continue;
        status = find_region(q, i, &seed);
        if (status == VOCC_OK && q->region[i] == NEW_REGION) {
            vocc_mutex_lock(scene->built.regions_mutex);
            q->region[i] =
                vocc_regions_add(&scene->allocator, scene->built.regions,
                                 seed.set, seed.set_count);
            vocc_mutex_unlock(scene->built.regions_mutex);
            if (q->region[i] < 0)
                status = VOCC_ERROR_OUT_OF_MEMORY;
        }
    }
    vocc_seed_free(&scene->allocator, &seed);
    return status;
}

vocc_status vocc_region(const vocc_scene *scene, size_t count,
                        vocc_array points, int32_t *region,
                        const vocc_query_options *options, vocc_error *error)
{
    point_query q;
    const size_t jobs = count / JOB_POINTS + (count % JOB_POINTS != 0);
    vocc_status status = vocc_check_floats(points, count, "points", error);
    if (status != VOCC_OK)
        return status;
    if (!region && count)
        return vocc_fail(error, VOCC_ERROR_INVALID_ARGUMENT, "region", -1,
                         (double)NAN, "region: NULL");
    status = vocc_query_begin(&q.query, scene, options, jobs, error);
    if (status != VOCC_OK)
        return status;
    q.count = count;
    q.points = points;
    q.region = region;
    status = vocc_query_run(&q.query, jobs, locate_points, &q);
    if (status == VOCC_OK)
        status = add_regions(&q);
    return vocc_query_end(&q.query, status, error);
}
