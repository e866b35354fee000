#include "mesh.h"
#include "array.h"
#include "memory.h"
#include "sort.h"
#include "status.h"
#include "vec3.h"

#include <inttypes.h>
#include <math.h>
#include <string.h>

/* ---- the checked copy ---------------------------------------------------- */

static vocc_status copy_vertices(const vocc_allocator *allocator,
                                 vocc_mesh *mesh, vocc_array vertices,
                                 vocc_error *error)
{
    const size_t n = mesh->vertex_count;
    size_t i;
    int k, wide = 0;
    for (i = 0; i < n; i++) {
        for (k = 0; k < 3; k++) {
            const double x = vocc_get_float(&vertices, i, k);
            if (!(vocc_abs(x) <= (double)FLT_MAX))
                return vocc_fail(
                    error, VOCC_ERROR_INVALID_ARGUMENT, "vertices", (int64_t)i,
                    x, "vertices[%zu][%d] is %g: not a finite float32 value", i,
                    k, x);
            wide |= (double)(float)x != x;
        }
    }
    if (wide)
        mesh->wide = vocc_allocate(allocator, n, 3 * sizeof *mesh->wide);
    else
        mesh->vertices =
            vocc_allocate(allocator, n, 3 * sizeof *mesh->vertices);
    if (!mesh->wide && !mesh->vertices)
        return vocc_fail_plain(error, VOCC_ERROR_OUT_OF_MEMORY);
    for (i = 0; i < n; i++) {
        for (k = 0; k < 3; k++) {
            const double x = vocc_get_float(&vertices, i, k);
            if (wide)
                mesh->wide[3 * i + (size_t)k] = x;
            else
                mesh->vertices[3 * i + (size_t)k] = (float)x;
        }
    }
    return VOCC_OK;
}

/* A vertex index of any integer type; *value is what the user gave. */
static int read_index(const vocc_array *triangles, size_t row, int k,
                      size_t limit, uint32_t *index, double *value)
{
    const void *p = vocc_row(triangles, row);
    int64_t i;
    switch (triangles->type) {
    case VOCC_INT32:
        i = ((const int32_t *)p)[k];
        break;
    case VOCC_UINT32:
        i = ((const uint32_t *)p)[k];
        break;
    case VOCC_INT64:
        i = ((const int64_t *)p)[k];
        break;
    default: {
        const uint64_t u = ((const uint64_t *)p)[k];
        *value = (double)u;
        *index = (uint32_t)u;
        return u < limit;
    }
    }
    *value = (double)i;
    *index = (uint32_t)i;
    return i >= 0 && (uint64_t)i < limit;
}

static vocc_status copy_triangles(const vocc_allocator *allocator,
                                  vocc_mesh *mesh, vocc_array triangles,
                                  vocc_error *error)
{
    const size_t n = mesh->triangle_count;
    size_t i;
    int k;
    double value = 0.0;
    mesh->triangles = vocc_allocate(allocator, n, 3 * sizeof(uint32_t));
    if (!mesh->triangles)
        return vocc_fail_plain(error, VOCC_ERROR_OUT_OF_MEMORY);
    for (i = 0; i < n; i++)
        for (k = 0; k < 3; k++)
            if (!read_index(&triangles, i, k, mesh->vertex_count,
                            &mesh->triangles[3 * i + (size_t)k], &value))
                return vocc_fail(error, VOCC_ERROR_INVALID_ARGUMENT,
                                 "triangles", (int64_t)i, value,
                                 "triangles[%zu][%d] is %.0f: not an index "
                                 "into %zu vertices",
                                 i, k, value, mesh->vertex_count);
    return VOCC_OK;
}

/* Copies at most 63 bytes, and no part of a UTF-8 character. */
static void copy_name(char out[64], const char *name)
{
    size_t n = strlen(name);
    if (n > 63) {
        n = 63;
        while (n > 0 && ((unsigned char)name[n] & 0xC0) == 0x80)
            n--;
    }
    memcpy(out, name, n);
    out[n] = '\0';
}

vocc_status vocc_mesh_init(const vocc_allocator *allocator, vocc_mesh *mesh,
                           size_t vertex_count, vocc_array vertices,
                           size_t triangle_count, vocc_array triangles,
                           const vocc_mesh_options *options, vocc_error *error)
{
    vocc_status status;
    memset(mesh, 0, sizeof *mesh);
    mesh->occluder = 1;
    if (options) {
        if (options->size != sizeof *options)
            return vocc_fail(error, VOCC_ERROR_INVALID_ARGUMENT, "options", -1,
                             (double)options->size,
                             "options: size is %" PRIu32
                             ", not sizeof(vocc_mesh_options)",
                             options->size);
        mesh->occluder = options->occluder != 0;
        if (options->name)
            copy_name(mesh->name, options->name);
    }
    status = vocc_check_floats(vertices, vertex_count, "vertices", error);
    if (status != VOCC_OK)
        return status;
    if (triangles.type < VOCC_INT32 || triangles.type > VOCC_UINT64)
        return vocc_fail(error, VOCC_ERROR_INVALID_ARGUMENT, "triangles", -1,
                         (double)triangles.type,
                         "triangles: type %d is not an integer vocc_type",
                         (int)triangles.type);
    if (!triangles.data && triangle_count)
        return vocc_fail(error, VOCC_ERROR_INVALID_ARGUMENT, "triangles", -1,
                         (double)NAN, "triangles: data is NULL");
    if (vertex_count > VOCC_MAX_VERTICES)
        return vocc_fail(error, VOCC_ERROR_LIMIT, "vertex_count", -1,
                         (double)vertex_count,
                         "vertex_count is %zu: at most 2^31 - 1", vertex_count);
    if (triangle_count > VOCC_MAX_TRIANGLES)
        return vocc_fail(error, VOCC_ERROR_LIMIT, "triangle_count", -1,
                         (double)triangle_count,
                         "triangle_count is %zu: at most 2^27", triangle_count);
    mesh->is_float64 = vertices.type == VOCC_FLOAT64;
    mesh->vertex_count = vertex_count;
    mesh->triangle_count = triangle_count;
    status = copy_vertices(allocator, mesh, vertices, error);
    if (status == VOCC_OK)
        status = copy_triangles(allocator, mesh, triangles, error);
    if (status != VOCC_OK)
        vocc_mesh_free(allocator, mesh);
    return status;
}

void vocc_mesh_free(const vocc_allocator *allocator, vocc_mesh *mesh)
{
    vocc_release(allocator, mesh->vertices);
    vocc_release(allocator, mesh->wide);
    vocc_release(allocator, mesh->triangles);
    mesh->vertices = NULL;
    mesh->wide = NULL;
    mesh->triangles = NULL;
}

void vocc_mesh_vertex(const vocc_mesh *mesh, uint32_t i, const double origin[3],
                      float out[3])
{
    int k;
    for (k = 0; k < 3; k++) {
        const size_t j = 3 * (size_t)i + (size_t)k;
        const double x = mesh->wide ? mesh->wide[j] : (double)mesh->vertices[j];
        out[k] = (float)(x - origin[k]);
    }
}

/* ---- components ---------------------------------------------------------- */

typedef struct work {
    const vocc_mesh *mesh;
    const double *origin;
    vocc_ticker *ticker;
    float *position;   /* 3 a vertex */
    uint32_t *welded;  /* number of the position of a vertex; NONE: unused */
    uint32_t *table;   /* hash table of vertices; NONE: free */
    size_t table_size; /* a power of two */
    size_t weld_count;
    size_t *start;    /* of the half-edges of a welded vertex; count + 1 */
    uint64_t *edges;  /* other vertex << 32 | 3 * triangle + corner */
    uint32_t *parent; /* union-find over triangles */
    uint8_t *bad;     /* triangle with two equal corners: no edges */
} work;

#define NONE UINT32_MAX

static uint32_t hash_position(const float p[3])
{
    uint32_t h = 0, bits;
    int k;
    for (k = 0; k < 3; k++) {
        memcpy(&bits, &p[k], sizeof bits);
        h = (h ^ bits) * 0x9E3779B1u;
        h ^= h >> 15;
    }
    h *= 0x85EBCA77u;
    return h ^ (h >> 13);
}

static int weld(work *w)
{
    const vocc_mesh *mesh = w->mesh;
    size_t i;
    int k;
    for (i = 0; i < mesh->vertex_count; i++)
        w->welded[i] = NONE;
    for (i = 0; i < w->table_size; i++)
        w->table[i] = NONE;
    for (i = 0; i < 3 * mesh->triangle_count; i++) {
        const uint32_t v = mesh->triangles[i];
        float *p = w->position + 3 * (size_t)v;
        size_t slot;
        if ((i & 0xFFFF) == 0 &&
            vocc_tick(w->ticker,
                      0.4 * (double)i / (double)(3 * mesh->triangle_count)))
            return 0;
        if (w->welded[v] != NONE)
            continue;
        vocc_mesh_vertex(mesh, v, w->origin, p);
        for (k = 0; k < 3; k++)
            p[k] += 0.0f; /* -0 and 0 are one place */
        slot = hash_position(p) & (w->table_size - 1);
        while (w->table[slot] != NONE &&
               memcmp(p, w->position + 3 * (size_t)w->table[slot],
                      3 * sizeof *p) != 0)
            slot = (slot + 1) & (w->table_size - 1);
        if (w->table[slot] == NONE) {
            w->table[slot] = v;
            w->welded[v] = (uint32_t)w->weld_count++;
        } else {
            w->welded[v] = w->welded[w->table[slot]];
        }
    }
    return 1;
}

static uint32_t corner_vertex(const work *w, size_t half)
{
    return w->welded[w->mesh->triangles[half]];
}

static size_t next_half(size_t half)
{
    return half % 3 == 2 ? half - 2 : half + 1;
}

/* Sorts all half-edges by their two welded vertices. */
static void collect_edges(work *w)
{
    const size_t halves = 3 * w->mesh->triangle_count;
    size_t half, i, sum = 0;
    for (i = 0; i <= w->weld_count; i++)
        w->start[i] = 0;
    for (half = 0; half < halves; half++) {
        const uint32_t a = corner_vertex(w, half),
                       b = corner_vertex(w, next_half(half));
        if (a != b)
            w->start[a < b ? a : b]++;
    }
    for (i = 0; i <= w->weld_count; i++) {
        const size_t n = w->start[i];
        w->start[i] = sum;
        sum += n;
    }
    for (half = 0; half < halves; half++) {
        const uint32_t a = corner_vertex(w, half),
                       b = corner_vertex(w, next_half(half));
        if (a != b)
            w->edges[w->start[a < b ? a : b]++] =
                (uint64_t)(a < b ? b : a) << 32 | (uint64_t)half;
    }
    /* Each start has moved to its end: shift back by one. */
    for (i = w->weld_count; i > 0; i--)
        w->start[i] = w->start[i - 1];
    w->start[0] = 0;
    for (i = 0; i < w->weld_count; i++)
        vocc_sort(w->edges + w->start[i], w->start[i + 1] - w->start[i]);
}

static uint32_t find(uint32_t *parent, uint32_t i)
{
    while (parent[i] != i) {
        parent[i] = parent[parent[i]];
        i = parent[i];
    }
    return i;
}

/* The smaller number becomes the root: components come out in order. */
static void unite(uint32_t *parent, uint32_t a, uint32_t b)
{
    a = find(parent, a);
    b = find(parent, b);
    if (a < b)
        parent[b] = a;
    else
        parent[a] = b;
}

/* Calls for each edge: its half-edges are edges[first .. last - 1]. */
typedef void (*edge_fn)(work *w, vocc_analysis *out, uint32_t from,
                        size_t first, size_t last);

static int for_each_edge(work *w, vocc_analysis *out, edge_fn visit,
                         double from, double to)
{
    size_t i, first, last;
    for (i = 0; i < w->weld_count; i++) {
        if ((i & 0x3FFF) == 0 &&
            vocc_tick(w->ticker,
                      from + (to - from) * (double)i / (double)w->weld_count))
            return 0;
        for (first = w->start[i]; first < w->start[i + 1]; first = last) {
            last = first + 1;
            while (last < w->start[i + 1] &&
                   w->edges[last] >> 32 == w->edges[first] >> 32)
                last++;
            visit(w, out, (uint32_t)i, first, last);
        }
    }
    return 1;
}

static uint32_t edge_triangle(const work *w, size_t e)
{
    return (uint32_t)((w->edges[e] & 0xFFFFFFFFu) / 3);
}

static void unite_edge(work *w, vocc_analysis *out, uint32_t from, size_t first,
                       size_t last)
{
    size_t e;
    (void)out;
    (void)from;
    for (e = first + 1; e < last; e++)
        unite(w->parent, edge_triangle(w, first), edge_triangle(w, e));
}

static void judge_edge(work *w, vocc_analysis *out, uint32_t from, size_t first,
                       size_t last)
{
    const uint32_t triangle = edge_triangle(w, first);
    vocc_component_report *c = &out->components[out->component_of[triangle]];
    size_t e, count = 0, forward = 0, half = 0;
    for (e = first; e < last; e++) {
        const size_t h = (size_t)(w->edges[e] & 0xFFFFFFFFu);
        /* Two equal corners make an edge pair that cancels itself. */
        if (w->bad[h / 3])
            continue;
        if (!count)
            half = h;
        count++;
        forward += corner_vertex(w, h) == from;
    }
    if (count & 1) {
        c->boundary_edges++;
        out->open_edges[out->open_edge_count++] = half;
    } else if (2 * forward != count) {
        c->inconsistent_edges++;
    }
    if (count > 2)
        c->nonmanifold_edges++;
}

static void count_open_edge(work *w, vocc_analysis *out, uint32_t from,
                            size_t first, size_t last)
{
    size_t e, count = 0;
    (void)from;
    for (e = first; e < last; e++)
        count += !w->bad[(w->edges[e] & 0xFFFFFFFFu) / 3];
    out->open_edge_count += count & 1;
}

/* Signed volume under each triangle, about the mesh's first vertex; area too,
 * to find triangles without. */
static void measure(work *w, vocc_analysis *out)
{
    const vocc_mesh *mesh = w->mesh;
    const float *p0 = mesh->triangle_count
                          ? w->position + 3 * (size_t)mesh->triangles[0]
                          : NULL;
    size_t i;
    int j, k;
    for (i = 0; i < mesh->triangle_count; i++) {
        double p[3][3], e1[3], e2[3], n[3];
        vocc_component_report *c = &out->components[out->component_of[i]];
        for (j = 0; j < 3; j++)
            for (k = 0; k < 3; k++)
                p[j][k] =
                    (double)w->position[3 * (size_t)mesh
                                                ->triangles[3 * i + (size_t)j] +
                                        (size_t)k] -
                    (double)p0[k];
        for (k = 0; k < 3; k++) {
            e1[k] = p[1][k] - p[0][k];
            e2[k] = p[2][k] - p[0][k];
        }
        vocc_cross(e1, e2, n);
        c->volume += vocc_dot(p[0], n) / 6.0;
        out->report.degenerate_triangles +=
            n[0] == 0.0 && n[1] == 0.0 && n[2] == 0.0;
    }
}

static int name_components(const vocc_allocator *allocator, work *w,
                           vocc_analysis *out)
{
    const size_t n = w->mesh->triangle_count;
    size_t i;
    for (i = 0; i < n; i++)
        out->component_count += find(w->parent, (uint32_t)i) == (uint32_t)i;
    out->components =
        vocc_allocate(allocator, out->component_count, sizeof *out->components);
    if (!out->components)
        return 0;
    memset(out->components, 0,
           (out->component_count ? out->component_count : 1) *
               sizeof *out->components);
    out->component_count = 0;
    for (i = 0; i < n; i++) {
        const uint32_t root = find(w->parent, (uint32_t)i);
        if (root == (uint32_t)i) {
            vocc_component_report *c = &out->components[out->component_count];
            c->size = (uint32_t)sizeof *c;
            c->first_triangle = i;
            out->component_of[i] = (int32_t)out->component_count++;
        } else {
            out->component_of[i] = out->component_of[root];
        }
        out->components[out->component_of[i]].triangle_count++;
    }
    return 1;
}

static void sum_up(work *w, vocc_analysis *out)
{
    vocc_mesh_report *r = &out->report;
    size_t i;
    r->closed = 1;
    for (i = 0; i < out->component_count; i++) {
        vocc_component_report *c = &out->components[i];
        c->closed = c->boundary_edges == 0;
        c->consistent = c->closed && c->inconsistent_edges == 0;
        r->closed &= c->closed;
        r->boundary_edges += c->boundary_edges;
        r->nonmanifold_edges += c->nonmanifold_edges;
        r->inconsistent_edges += c->inconsistent_edges;
        r->volume += c->volume;
    }
    r->size = (uint32_t)sizeof *r;
    r->occluder = w->mesh->occluder;
    memcpy(r->name, w->mesh->name, sizeof r->name);
    r->triangle_count = w->mesh->triangle_count;
    r->vertex_count = w->mesh->vertex_count;
    r->welded_vertices = w->weld_count;
    r->component_count = (int32_t)out->component_count;
}

static vocc_status analyse(const vocc_allocator *allocator, work *w,
                           vocc_analysis *out)
{
    const size_t nv = w->mesh->vertex_count, nt = w->mesh->triangle_count;
    size_t i;
    w->table_size = 16;
    while (w->table_size < 2 * nv)
        w->table_size *= 2;
    w->position = vocc_allocate(allocator, nv, 3 * sizeof *w->position);
    w->welded = vocc_allocate(allocator, nv, sizeof *w->welded);
    w->table = vocc_allocate(allocator, w->table_size, sizeof *w->table);
    if (!w->position || !w->welded || !w->table)
        return VOCC_ERROR_OUT_OF_MEMORY;
    if (!weld(w))
        return VOCC_ERROR_CANCELLED;
    vocc_release(allocator, w->table);
    w->table = NULL;

    w->start = vocc_allocate(allocator, w->weld_count + 1, sizeof *w->start);
    w->edges = vocc_allocate(allocator, 3 * nt, sizeof *w->edges);
    w->parent = vocc_allocate(allocator, nt, sizeof *w->parent);
    w->bad = vocc_allocate(allocator, nt, sizeof *w->bad);
    out->component_of = vocc_allocate(allocator, nt, sizeof(int32_t));
    if (!w->start || !w->edges || !w->parent || !w->bad || !out->component_of)
        return VOCC_ERROR_OUT_OF_MEMORY;
    for (i = 0; i < nt; i++) {
        const uint32_t a = corner_vertex(w, 3 * i),
                       b = corner_vertex(w, 3 * i + 1),
                       c = corner_vertex(w, 3 * i + 2);
        w->parent[i] = (uint32_t)i;
        w->bad[i] = a == b || b == c || c == a;
    }
    collect_edges(w);
    if (!for_each_edge(w, out, unite_edge, 0.6, 0.7))
        return VOCC_ERROR_CANCELLED;
    if (!name_components(allocator, w, out))
        return VOCC_ERROR_OUT_OF_MEMORY;

    if (!for_each_edge(w, out, count_open_edge, 0.7, 0.8))
        return VOCC_ERROR_CANCELLED;
    out->open_edges =
        vocc_allocate(allocator, out->open_edge_count, sizeof *out->open_edges);
    if (!out->open_edges)
        return VOCC_ERROR_OUT_OF_MEMORY;
    out->open_edge_count = 0;
    if (!for_each_edge(w, out, judge_edge, 0.8, 1.0))
        return VOCC_ERROR_CANCELLED;
    vocc_sort(out->open_edges, out->open_edge_count);
    measure(w, out);
    sum_up(w, out);
    return VOCC_OK;
}

vocc_status vocc_analyse(const vocc_allocator *allocator, const vocc_mesh *mesh,
                         const double origin[3], vocc_analysis *analysis,
                         vocc_ticker *ticker)
{
    work w;
    vocc_status status;
    memset(&w, 0, sizeof w);
    memset(analysis, 0, sizeof *analysis);
    w.mesh = mesh;
    w.origin = origin;
    w.ticker = ticker;
    status = analyse(allocator, &w, analysis);
    vocc_release(allocator, w.position);
    vocc_release(allocator, w.welded);
    vocc_release(allocator, w.table);
    vocc_release(allocator, w.start);
    vocc_release(allocator, w.edges);
    vocc_release(allocator, w.parent);
    vocc_release(allocator, w.bad);
    if (status != VOCC_OK)
        vocc_analysis_free(allocator, analysis);
    return status;
}

void vocc_analysis_free(const vocc_allocator *allocator,
                        vocc_analysis *analysis)
{
    vocc_release(allocator, analysis->components);
    vocc_release(allocator, analysis->component_of);
    vocc_release(allocator, analysis->open_edges);
    analysis->components = NULL;
    analysis->component_of = NULL;
    analysis->open_edges = NULL;
}
