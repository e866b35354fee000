#include "scene.h"
#include "build.h"
#include "child_order.h"
#include "classify.h"
#include "memory.h"
#include "occluders.h"
#include "planes.h"
#include "status.h"
#include "vec3.h"

#include <inttypes.h>
#include <math.h>
#include <string.h>

enum { JOB_TRIANGLES = 16384, LARGE = 100000 };

/* ---- create, add, free ----------------------------------------------------
 */

vocc_status vocc_scene_create(const vocc_allocator *allocator,
                              vocc_scene **scene, vocc_error *error)
{
    const vocc_allocator a = allocator ? *allocator : vocc_default_allocator();
    if (!scene)
        return vocc_fail(error, VOCC_ERROR_INVALID_ARGUMENT, "scene", -1,
                         (double)NAN, "scene: NULL");
    *scene = NULL;
    if (!a.allocate || !a.deallocate)
        return vocc_fail(error, VOCC_ERROR_INVALID_ARGUMENT, "allocator", -1,
                         (double)NAN, "allocator: a function is NULL");
    *scene = vocc_allocate(&a, 1, sizeof **scene);
    if (!*scene)
        return vocc_fail_plain(error, VOCC_ERROR_OUT_OF_MEMORY);
    memset(*scene, 0, sizeof **scene);
    (*scene)->allocator = a;
    (*scene)->most_pairs = VOCC_MAX_PAIRS;
    (*scene)->large = LARGE;
    return VOCC_OK;
}

static void built_free(const vocc_allocator *allocator, vocc_built *built)
{
    size_t i;
    vocc_tree_free(allocator, &built->tree);
    vocc_bvh_free(allocator, &built->bvh);
    vocc_release(allocator, built->mesh_first);
    for (i = 0; i < built->analysis_count; i++)
        vocc_analysis_free(allocator, &built->analyses[i]);
    vocc_release(allocator, built->analyses);
    vocc_release(allocator, built->solid_component);
    vocc_release(allocator, built->solid_consistent);
    vocc_release(allocator, built->solid_of_triangle);
    if (built->regions)
        vocc_regions_free(allocator, built->regions);
    vocc_release(allocator, built->regions);
    vocc_mutex_free(allocator, built->regions_mutex);
    memset(built, 0, sizeof *built);
}

void vocc_scene_free(vocc_scene *scene)
{
    vocc_allocator allocator;
    size_t i;
    if (!scene)
        return;
    allocator = scene->allocator;
    built_free(&allocator, &scene->built);
    for (i = 0; i < scene->mesh_count; i++)
        vocc_mesh_free(&allocator, &scene->meshes[i]);
    vocc_release(&allocator, scene->meshes);
    vocc_release(&allocator, scene);
}

void vocc_mesh_options_init(vocc_mesh_options *options)
{
    options->size = (uint32_t)sizeof *options;
    options->occluder = 1;
    options->name = NULL;
}

static vocc_status fail_null(vocc_error *error, const char *argument)
{
    return vocc_fail(error, VOCC_ERROR_INVALID_ARGUMENT, argument, -1,
                     (double)NAN, "%s: NULL", argument);
}

vocc_status vocc_scene_add_mesh(vocc_scene *scene, size_t vertex_count,
                                vocc_array vertices, size_t triangle_count,
                                vocc_array triangles,
                                const vocc_mesh_options *options,
                                int32_t *geom_id, vocc_error *error)
{
    vocc_mesh mesh;
    void *meshes;
    vocc_status status;
    if (!scene)
        return fail_null(error, "scene");
    if (scene->is_built)
        return vocc_fail_plain(error, VOCC_ERROR_FROZEN);
    if (triangle_count > VOCC_MAX_TRIANGLES - scene->triangle_count)
        return vocc_fail(error, VOCC_ERROR_LIMIT, "triangle_count", -1,
                         (double)triangle_count,
                         "triangle_count is %zu: the scene may have 2^27 "
                         "triangles and has %zu already",
                         triangle_count, scene->triangle_count);
    if (vertex_count > VOCC_MAX_VERTICES - scene->vertex_count)
        return vocc_fail(error, VOCC_ERROR_LIMIT, "vertex_count", -1,
                         (double)vertex_count,
                         "vertex_count is %zu: the scene may have 2^31 - 1 "
                         "vertices and has %zu already",
                         vertex_count, scene->vertex_count);
    status = vocc_mesh_init(&scene->allocator, &mesh, vertex_count, vertices,
                            triangle_count, triangles, options, error);
    if (status != VOCC_OK)
        return status;
    meshes = scene->meshes;
    if (!vocc_grow(&scene->allocator, &meshes, &scene->mesh_capacity,
                   scene->mesh_count, scene->mesh_count + 1,
                   sizeof *scene->meshes)) {
        vocc_mesh_free(&scene->allocator, &mesh);
        return vocc_fail_plain(error, VOCC_ERROR_OUT_OF_MEMORY);
    }
    scene->meshes = meshes;
    scene->meshes[scene->mesh_count] = mesh;
    scene->vertex_count += vertex_count;
    scene->triangle_count += triangle_count;
    if (geom_id)
        *geom_id = (int32_t)scene->mesh_count;
    scene->mesh_count++;
    return VOCC_OK;
}

/* ---- build ------------------------------------------------------------------
 */

void vocc_build_options_init(vocc_build_options *options)
{
    memset(options, 0, sizeof *options);
    options->size = (uint32_t)sizeof *options;
    options->traversal_cost = 1.0f;
    options->empty_bonus = 0.2f;
    options->max_leaf_size = 64;
}

static vocc_status check_build_options(const vocc_build_options *o,
                                       vocc_error *error)
{
    vocc_status s;
    if (o->size != sizeof *o)
        return vocc_fail(
            error, VOCC_ERROR_INVALID_ARGUMENT, "options", -1, (double)o->size,
            "options: size is %" PRIu32 ", not sizeof(vocc_build_options)",
            o->size);
    s = vocc_check_range(error, "threads", o->threads, 0, VOCC_MAX_THREADS);
    if (s == VOCC_OK)
        s = vocc_check_range(error, "traversal_cost", (double)o->traversal_cost,
                             (double)1e-6f, 1e6);
    if (s == VOCC_OK && o->intersection_cost != 0.0f)
        s = vocc_check_range(error, "intersection_cost",
                             (double)o->intersection_cost, (double)1e-6f, 1e6);
    if (s == VOCC_OK)
        s = vocc_check_range(error, "empty_bonus", (double)o->empty_bonus, 0,
                             1);
    if (s == VOCC_OK)
        s = vocc_check_range(error, "max_leaf_size", o->max_leaf_size, 1,
                             1 << 20);
    if (s == VOCC_OK)
        s = vocc_check_range(error, "max_depth", o->max_depth, 0,
                             VOCC_MAX_DEPTH);
    if (s == VOCC_OK)
        s = vocc_check_range(error, "bad_refines", o->bad_refines, 0, 16);
    return s;
}

/* The centre of all vertices, on a grid of 1/1024 of their extent, so that
 * round coordinates stay round; 0 unless float64 vertices are given that need
 * it: they are no float32 numbers, or so far off that points between them would
 * be none. */
static void find_origin(const vocc_scene *scene, double origin[3])
{
    double lower[3], upper[3], extent = 0.0, distance = 0.0, grid;
    size_t m, i;
    int k, wide = 0, given_wide = 0, exponent;
    for (k = 0; k < 3; k++) {
        origin[k] = 0.0;
        lower[k] = (double)FLT_MAX;
        upper[k] = -(double)FLT_MAX;
    }
    for (m = 0; m < scene->mesh_count; m++) {
        const vocc_mesh *mesh = &scene->meshes[m];
        wide |= mesh->wide != NULL;
        given_wide |= mesh->is_float64 && mesh->vertex_count;
        for (i = 0; i < 3 * mesh->vertex_count; i++) {
            const double x =
                mesh->wide ? mesh->wide[i] : (double)mesh->vertices[i];
            lower[i % 3] = x < lower[i % 3] ? x : lower[i % 3];
            upper[i % 3] = x > upper[i % 3] ? x : upper[i % 3];
        }
    }
    if (!given_wide)
        return;
    for (k = 0; k < 3; k++) {
        const double centre = vocc_abs(0.5 * lower[k] + 0.5 * upper[k]);
        extent = upper[k] - lower[k] > extent ? upper[k] - lower[k] : extent;
        distance = centre > distance ? centre : distance;
    }
    /* Half of more than this might not be finite in float32 any more. */
    if (extent > 0.25 * (double)FLT_MAX || extent == 0.0)
        return;
    if (!wide && distance <= 2.0 * extent)
        return;
    (void)frexp(extent, &exponent);
    grid = ldexp(1.0, exponent - 10);
    for (k = 0; k < 3; k++)
        origin[k] =
            floor((0.5 * lower[k] + 0.5 * upper[k]) / grid + 0.5) * grid;
}

/* The last mesh that begins at or before triangle `id`: empty meshes share
 * their start with the next. */
static size_t mesh_of(const uint32_t *first, size_t count, uint32_t id)
{
    size_t low = 0, high = count;
    while (high - low > 1) {
        const size_t middle = (low + high) / 2;
        if (first[middle] <= id)
            low = middle;
        else
            high = middle;
    }
    return low;
}

typedef struct gathering {
    const vocc_scene *scene;
    const vocc_built *built;
    float *corners;
} gathering;

static vocc_status gather_corners(void *context, size_t job, int worker,
                                  vocc_jobs *jobs)
{
    const gathering *g = context;
    const size_t count = g->scene->triangle_count;
    size_t i = job * JOB_TRIANGLES, m, j;
    const size_t end = i + JOB_TRIANGLES < count ? i + JOB_TRIANGLES : count;
    float *out = g->corners + 9 * i;
    (void)worker;
    (void)jobs;
    while (i < end) {
        const vocc_mesh *mesh;
        size_t first, last;
        m = mesh_of(g->built->mesh_first, g->scene->mesh_count, (uint32_t)i);
        mesh = &g->scene->meshes[m];
        first = i - g->built->mesh_first[m];
        last = end - g->built->mesh_first[m];
        if (last > mesh->triangle_count)
            last = mesh->triangle_count;
        for (j = 3 * first; j < 3 * last; j++, out += 3)
            vocc_mesh_vertex(mesh, mesh->triangles[j], g->built->origin, out);
        i += last - first;
    }
    return VOCC_OK;
}

/* Nine floats a triangle, of all meshes. */
static vocc_status all_corners(const vocc_scene *scene, const vocc_built *built,
                               int threads, vocc_ticker *ticker,
                               float **corners)
{
    gathering g;
    g.scene = scene;
    g.built = built;
    g.corners = *corners = vocc_allocate(
        &scene->allocator, scene->triangle_count, 9 * sizeof *g.corners);
    if (!g.corners)
        return VOCC_ERROR_OUT_OF_MEMORY;
    return vocc_jobs_run(&scene->allocator, threads,
                         (scene->triangle_count + JOB_TRIANGLES - 1) /
                             JOB_TRIANGLES,
                         gather_corners, &g, ticker);
}

static vocc_status number_triangles(const vocc_scene *scene, vocc_built *built)
{
    size_t m;
    uint32_t first = 0;
    built->mesh_first = vocc_allocate(&scene->allocator, scene->mesh_count + 1,
                                      sizeof *built->mesh_first);
    if (!built->mesh_first)
        return VOCC_ERROR_OUT_OF_MEMORY;
    for (m = 0; m < scene->mesh_count; m++) {
        built->mesh_first[m] = first;
        first += (uint32_t)scene->meshes[m].triangle_count;
    }
    built->mesh_first[m] = first;
    return VOCC_OK;
}

static vocc_status analyse_meshes(const vocc_scene *scene, vocc_built *built,
                                  vocc_ticker *ticker)
{
    const vocc_allocator *a = &scene->allocator;
    size_t m, i;
    int32_t components = 0;
    built->analyses =
        vocc_allocate(a, scene->mesh_count, sizeof *built->analyses);
    if (!built->analyses)
        return VOCC_ERROR_OUT_OF_MEMORY;
    for (m = 0; m < scene->mesh_count; m++) {
        vocc_analysis *x = &built->analyses[m];
        vocc_status status;
        vocc_ticker_stage(ticker, 0.15 * (double)m / (double)scene->mesh_count,
                          0.15 * (double)(m + 1) / (double)scene->mesh_count);
        status = vocc_analyse(a, &scene->meshes[m], built->origin, x, ticker);
        if (status != VOCC_OK)
            return status;
        built->analysis_count = m + 1;
        x->report.first_component = components;
        components += x->report.component_count;
        for (i = 0; i < x->component_count; i++) {
            x->components[i].geom_id = (int32_t)m;
            built->solid_count +=
                x->components[i].closed && scene->meshes[m].occluder;
        }
    }
    built->report.component_count = components;
    return VOCC_OK;
}

static vocc_status check_strict(const vocc_scene *scene,
                                const vocc_built *built, vocc_error *error)
{
    size_t m;
    for (m = 0; m < scene->mesh_count; m++) {
        const vocc_mesh_report *r = &built->analyses[m].report;
        if (r->occluder && !r->closed)
            return vocc_fail(
                error, VOCC_ERROR_OPEN_MESH, "meshes", (int64_t)m,
                (double)r->boundary_edges,
                "mesh %zu (%s) is not closed: %" PRIu64
                " boundary edges; the first is edge %d of triangle %" PRIu64,
                m, r->name, r->boundary_edges,
                (int)(built->analyses[m].open_edges[0] % 3),
                built->analyses[m].open_edges[0] / 3);
    }
    return VOCC_OK;
}

/* Numbers the solids and finds the solid of each triangle of the tree. */
static vocc_status name_solids(const vocc_scene *scene, vocc_built *built)
{
    const vocc_allocator *a = &scene->allocator;
    int32_t *solid_of = vocc_allocate(a, (size_t)built->report.component_count,
                                      sizeof *solid_of);
    size_t m, i, solids = 0;
    built->solid_component =
        vocc_allocate(a, built->solid_count, sizeof *built->solid_component);
    built->solid_consistent =
        vocc_allocate(a, built->solid_count, sizeof *built->solid_consistent);
    built->solid_of_triangle = vocc_allocate(a, built->tree.triangle_count,
                                             sizeof *built->solid_of_triangle);
    if (!solid_of || !built->solid_component || !built->solid_consistent ||
        !built->solid_of_triangle) {
        vocc_release(a, solid_of);
        return VOCC_ERROR_OUT_OF_MEMORY;
    }
    for (m = 0; m < scene->mesh_count; m++) {
        const vocc_analysis *x = &built->analyses[m];
        for (i = 0; i < x->component_count; i++) {
            const int32_t c = x->report.first_component + (int32_t)i;
            solid_of[c] = -1;
            if (!x->components[i].closed || !scene->meshes[m].occluder)
                continue;
            solid_of[c] = (int32_t)solids;
            built->solid_component[solids] = c;
            built->solid_consistent[solids] =
                (uint8_t)x->components[i].consistent;
            solids++;
        }
    }
    for (i = 0; i < built->tree.triangle_count; i++) {
        const uint32_t id = built->tree.ids[i];
        m = mesh_of(built->mesh_first, scene->mesh_count, id);
        built->solid_of_triangle[i] =
            solid_of[built->analyses[m].report.first_component +
                     built->analyses[m]
                         .component_of[id - built->mesh_first[m]]];
    }
    vocc_release(a, solid_of);
    return VOCC_OK;
}

static double area_of_solids(const vocc_built *built)
{
    double area = 0.0;
    size_t i;
    int k;
    for (i = 0; i < built->tree.triangle_count; i++) {
        const float *p = built->tree.corners + 9 * i;
        double e1[3], e2[3], n[3];
        if (built->solid_of_triangle[i] < 0)
            continue;
        for (k = 0; k < 3; k++) {
            e1[k] = (double)p[3 + k] - (double)p[k];
            e2[k] = (double)p[6 + k] - (double)p[k];
        }
        vocc_cross(e1, e2, n);
        area += 0.5 * sqrt(vocc_dot(n, n));
    }
    return area;
}

/* What AUTO stands for: docs/method.md, "Orders". */
static void choose_order(vocc_built *built)
{
    const vocc_report *r = &built->report;
    built->auto_occluders =
        r->mesh_area > 0.0 && r->occluder_area >= 2.75 * r->mesh_area;
    built->report.auto_order =
        built->auto_occluders ? VOCC_ORDER_OPAQUE_FIRST : VOCC_ORDER_STANDARD;
}

static void fill_report(const vocc_scene *scene, vocc_built *built,
                        const vocc_classification *c)
{
    vocc_report *r = &built->report;
    const vocc_tree *t = &built->tree;
    double volume = 1.0;
    int k;
    r->size = (uint32_t)sizeof *r;
    r->mesh_count = (int32_t)scene->mesh_count;
    r->closed_count = (int32_t)built->solid_count;
    r->triangle_count = scene->triangle_count;
    r->vertex_count = scene->vertex_count;
    for (k = 0; k < 3; k++) {
        const int some = t->triangle_count != 0;
        r->lower[k] = some ? (double)t->lower[k] + built->origin[k] : 0.0;
        r->upper[k] = some ? (double)t->upper[k] + built->origin[k] : 0.0;
        volume *= (double)t->upper[k] - (double)t->lower[k];
    }
    r->node_count = t->node_count - 1;
    r->boundary_leaves = c->boundary_leaves;
    r->opaque_leaves = c->opaque_leaves;
    r->clear_leaves = c->clear_leaves;
    r->unknown_leaves = c->unknown_leaves;
    r->reference_count = t->reference_count;
    r->seed_rays = c->seed_rays;
    r->depth = t->depth;
    r->region_count = (int32_t)built->regions->count;
    r->opaque_volume_fraction = volume > 0.0 ? c->opaque_volume / volume : 0.0;
    r->occluder_area = c->opaque_area;
    r->mesh_area = area_of_solids(built);
    r->tree_bytes = t->node_count * sizeof *t->nodes +
                    t->reference_count * sizeof *t->references +
                    t->triangle_count *
                        (9 * sizeof *t->corners + 4 * sizeof *t->planes +
                         sizeof *t->ids + sizeof *built->solid_of_triangle) +
                    t->opaque_count * sizeof *t->opaque;
    r->beam_bytes = built->bvh.node_count * sizeof *built->bvh.nodes +
                    built->bvh.cluster_count * sizeof *built->bvh.clusters;
    choose_order(built);
}

/* A build under way, and what its parts share. */
typedef struct building {
    const vocc_scene *scene;
    const vocc_build_options *options;
    int coarse;
    vocc_built *built;
    vocc_solids solids;
    vocc_classification classification;
} building;

static vocc_status analyse(void *context, vocc_ticker *ticker)
{
    const building *b = context;
    const double start = vocc_seconds();
    const vocc_status status = analyse_meshes(b->scene, b->built, ticker);
    b->built->report.seconds_components = vocc_seconds() - start;
    return status;
}

static vocc_status make_tree(const building *b, vocc_ticker *ticker)
{
    const vocc_allocator *a = &b->scene->allocator;
    const double start = vocc_seconds();
    float *corners;
    vocc_status status =
        all_corners(b->scene, b->built, b->options->threads, ticker, &corners);
    if (status == VOCC_OK)
        status = vocc_build(a, corners, b->scene->triangle_count, b->options,
                            b->coarse, b->scene->most_pairs, ticker,
                            &b->built->tree);
    vocc_release(a, corners);
    b->built->report.seconds_build = vocc_seconds() - start;
    return status;
}

static vocc_status find_regions(building *b, vocc_ticker *ticker)
{
    const vocc_allocator *a = &b->scene->allocator;
    const double start = vocc_seconds();
    vocc_built *const built = b->built;
    vocc_status status;
    vocc_ticker_stage(ticker, 0.8, 0.95);
    built->regions = vocc_allocate(a, 1, sizeof *built->regions);
    if (!built->regions)
        return VOCC_ERROR_OUT_OF_MEMORY;
    if (!vocc_regions_init(a, built->regions)) {
        vocc_release(a, built->regions);
        built->regions = NULL;
        return VOCC_ERROR_OUT_OF_MEMORY;
    }
    built->regions_mutex = vocc_mutex_create(a);
    if (!built->regions_mutex)
        return VOCC_ERROR_OUT_OF_MEMORY;
    status = vocc_classify(a, &built->tree, &b->solids, built->solid_count,
                           b->options->threads, built->regions, ticker,
                           &b->classification);
    built->report.seconds_classify = vocc_seconds() - start;
    return status;
}

/* Of the tree, once its leaves are labelled. */
static vocc_status prepare_rays(const building *b, vocc_ticker *ticker)
{
    const vocc_allocator *a = &b->scene->allocator;
    const double start = vocc_seconds();
    const vocc_build_options *const o = b->options;
    vocc_tree *const tree = &b->built->tree;
    vocc_status status;
    vocc_ticker_stage(ticker, 0.95, 0.96);
    status = vocc_order_children(
        a, tree, (double)o->intersection_cost / (double)o->traversal_cost,
        o->threads, ticker);
    if (status == VOCC_OK)
        status = vocc_make_planes(a, tree, o->threads, ticker);
    vocc_ticker_stage(ticker, 0.96, 0.97);
    if (status == VOCC_OK)
        status = vocc_grow_occluders(a, tree, o->threads, ticker);
    b->built->report.seconds_occluders = vocc_seconds() - start;
    return status;
}

static vocc_status make_hierarchy(void *context, vocc_ticker *ticker)
{
    const building *b = context;
    const double start = vocc_seconds();
    vocc_status status;
    vocc_ticker_stage(ticker, 0.97, 1.0);
    status = vocc_bvh_build(&b->scene->allocator, &b->built->tree, &b->solids,
                            b->options->threads, ticker, &b->built->bvh);
    b->built->report.seconds_beams = vocc_seconds() - start;
    return status;
}

/* Begins what does not depend on what the caller does next, where there is a
 * processor for it; else does it now. */
static vocc_status begin(building *b, vocc_aside_fn run, vocc_ticker *ticker,
                         vocc_aside **aside)
{
    vocc_status status = VOCC_OK;
    *aside = NULL;
    if (b->options->threads > 1)
        status = vocc_aside_begin(&b->scene->allocator, run, b, aside);
    return status == VOCC_OK && !*aside ? run(b, ticker) : status;
}

static vocc_status end(const building *b, vocc_aside *aside, vocc_status status,
                       vocc_ticker *ticker)
{
    vocc_status other;
    if (!aside)
        return status;
    other =
        vocc_aside_end(&b->scene->allocator, aside, status != VOCC_OK, ticker);
    return status == VOCC_OK ? other : status;
}

static vocc_status build_parts(building *b, vocc_ticker *ticker,
                               vocc_error *error)
{
    const vocc_allocator *a = &b->scene->allocator;
    vocc_built *const built = b->built;
    vocc_aside *aside = NULL;
    vocc_status status = number_triangles(b->scene, built);
    if (status != VOCC_OK)
        return status;
    find_origin(b->scene, built->origin);
    if (b->options->strict) {
        /* Not after minutes. */
        status = analyse(b, ticker);
        if (status == VOCC_OK)
            status = check_strict(b->scene, built, error);
    } else {
        status = begin(b, analyse, ticker, &aside);
    }
    if (status == VOCC_OK)
        status = make_tree(b, ticker);
    status = end(b, aside, status, ticker);
    if (status == VOCC_OK)
        status = name_solids(b->scene, built);
    if (status != VOCC_OK)
        return status;
    b->solids.of_triangle = built->solid_of_triangle;
    b->solids.consistent = built->solid_consistent;
    status = begin(b, make_hierarchy, ticker, &aside);
    if (status == VOCC_OK)
        status = find_regions(b, ticker);
    if (status == VOCC_OK)
        status = prepare_rays(b, ticker);
    status = end(b, aside, status, ticker);
    return status == VOCC_OK
               ? vocc_build_boxes(a, &built->tree, &built->bvh.boxes)
               : status;
}

static vocc_status build(vocc_scene *scene, const vocc_build_options *options,
                         int coarse, vocc_built *built, vocc_ticker *ticker,
                         vocc_error *error)
{
    const double start = vocc_seconds();
    building b;
    vocc_status status;
    memset(&b, 0, sizeof b);
    b.scene = scene;
    b.options = options;
    b.coarse = coarse;
    b.built = built;
    status = build_parts(&b, ticker, error);
    if (status == VOCC_ERROR_OPEN_MESH)
        return status;
    if (status != VOCC_OK)
        return vocc_fail_plain(error, status);
    built->report.threads = options->threads;
    fill_report(scene, built, &b.classification);
    built->report.seconds_total = vocc_seconds() - start;
    if (vocc_tick(ticker, 1.0))
        return vocc_fail_plain(error, VOCC_ERROR_CANCELLED);
    return VOCC_OK;
}

vocc_status vocc_scene_build(vocc_scene *scene,
                             const vocc_build_options *options,
                             vocc_error *error)
{
    vocc_build_options o;
    vocc_built built;
    vocc_ticker ticker;
    vocc_status status;
    size_t m;
    int coarse;
    if (!scene)
        return fail_null(error, "scene");
    if (scene->is_built)
        return vocc_fail_plain(error, VOCC_ERROR_FROZEN);
    vocc_build_options_init(&o);
    if (options) {
        status = check_build_options(options, error);
        if (status != VOCC_OK)
            return status;
        o = *options;
    }
    if (o.threads == 0)
        o.threads = vocc_processor_count();
    /* Where a tree takes long to build, a coarse one of half the nodes serves:
     * it takes two thirds of the time, leaves passes by beams as fast, and
     * slows rays through it by a tenth.  A small one would lose occluders that
     * beams need. */
    coarse =
        o.intersection_cost == 0.0f && scene->triangle_count > scene->large;
    if (o.intersection_cost == 0.0f)
        o.intersection_cost = coarse ? 0.4f : 0.65f;
    memset(&built, 0, sizeof built);
    vocc_ticker_init(&ticker, o.progress, o.progress_user);
    status = build(scene, &o, coarse, &built, &ticker, error);
    if (status != VOCC_OK) {
        built_free(&scene->allocator, &built);
        return status;
    }
    scene->built = built;
    scene->is_built = 1;
    /* The tree has its own copy of what rays need. */
    for (m = 0; m < scene->mesh_count; m++)
        vocc_mesh_free(&scene->allocator, &scene->meshes[m]);
    return VOCC_OK;
}

vocc_status vocc_scene_origin(const vocc_scene *scene, double origin[3])
{
    if (!scene || !origin)
        return VOCC_ERROR_INVALID_ARGUMENT;
    if (!scene->is_built)
        return VOCC_ERROR_NOT_BUILT;
    memcpy(origin, scene->built.origin, sizeof scene->built.origin);
    return VOCC_OK;
}

void vocc_scene_triangle(const vocc_scene *scene, uint32_t id, int32_t *geom_id,
                         int32_t *prim_id)
{
    const uint32_t *first = scene->built.mesh_first;
    const size_t m = mesh_of(first, scene->mesh_count, id);
    *geom_id = (int32_t)m;
    *prim_id = (int32_t)(id - first[m]);
}

vocc_status vocc_check_built(const vocc_scene *scene, vocc_error *error)
{
    if (!scene)
        return vocc_fail(error, VOCC_ERROR_INVALID_ARGUMENT, "scene", -1,
                         (double)NAN, "scene: NULL");
    return scene->is_built ? VOCC_OK
                           : vocc_fail_plain(error, VOCC_ERROR_NOT_BUILT);
}
