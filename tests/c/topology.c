#include "topology.h"

#include <stdlib.h>
#include <string.h>

#include "oracle.h"

typedef struct place {
    float p[3];
    int32_t vertex;
} place;

typedef struct half_edge {
    uint64_t key;
    size_t half; /* 3 * triangle + corner */
    int forward;
} half_edge;

static int by_position(const void *left, const void *right)
{
    const place *a = left, *b = right;
    for (int k = 0; k < 3; k++)
        if (a->p[k] != b->p[k])
            return a->p[k] < b->p[k] ? -1 : 1;
    return 0;
}

static int by_key(const void *left, const void *right)
{
    const half_edge *a = left, *b = right;
    if (a->key != b->key)
        return a->key < b->key ? -1 : 1;
    return a->half < b->half ? -1 : a->half > b->half;
}

static void *zeroed(size_t count, size_t size)
{
    void *memory = calloc(count ? count : 1, size);
    if (!memory)
        exit(3);
    return memory;
}

static void weld(topology *t, const mesh *m)
{
    const size_t corners = 3 * m->triangle_count;
    place *places = zeroed(corners, sizeof(*places));
    for (size_t i = 0; i < corners; i++) {
        places[i].vertex = m->triangles[i];
        memcpy(places[i].p, m->vertices + 3 * (size_t)m->triangles[i],
               sizeof(places[i].p));
    }
    qsort(places, corners, sizeof(*places), by_position);
    t->welded = zeroed(m->vertex_count, sizeof(int32_t));
    for (size_t i = 0; i < m->vertex_count; i++)
        t->welded[i] = -1;
    for (size_t i = 0; i < corners; i++) {
        if (i && by_position(&places[i - 1], &places[i]) != 0)
            t->welded_vertices++;
        t->welded[places[i].vertex] = (int32_t)t->welded_vertices;
    }
    t->welded_vertices += corners != 0;
    free(places);
}

static int32_t root_of(int32_t *parent, int32_t i)
{
    while (parent[i] != i)
        i = parent[i] = parent[parent[i]];
    return i;
}

uint64_t topology_edge(const topology *t, const mesh *m, size_t triangle,
                       int corner)
{
    const int32_t *ids = m->triangles + 3 * triangle;
    const uint64_t a = (uint64_t)t->welded[ids[corner]];
    const uint64_t b = (uint64_t)t->welded[ids[(corner + 1) % 3]];
    return a < b ? a << 32 | b : b << 32 | a;
}

/* Two corners at one place: its edges cancel out. */
static int is_collapsed(const topology *t, const mesh *m, size_t triangle)
{
    const int32_t *ids = m->triangles + 3 * triangle;
    return t->welded[ids[0]] == t->welded[ids[1]] ||
           t->welded[ids[1]] == t->welded[ids[2]] ||
           t->welded[ids[2]] == t->welded[ids[0]];
}

static void connect(topology *t, const mesh *m, const half_edge *edges,
                    size_t count)
{
    int32_t *parent = zeroed(m->triangle_count, sizeof(int32_t));
    for (size_t i = 0; i < m->triangle_count; i++)
        parent[i] = (int32_t)i;
    for (size_t i = 1; i < count; i++) {
        if (edges[i].key != edges[i - 1].key)
            continue;
        const int32_t a = root_of(parent, (int32_t)(edges[i - 1].half / 3));
        const int32_t b = root_of(parent, (int32_t)(edges[i].half / 3));
        parent[a > b ? a : b] = a > b ? b : a;
    }
    t->component_of = zeroed(m->triangle_count, sizeof(int32_t));
    t->components = zeroed(m->triangle_count, sizeof(component));
    for (size_t i = 0; i < m->triangle_count; i++) {
        const int32_t root = root_of(parent, (int32_t)i);
        if ((size_t)root == i) {
            t->components[t->component_count].first_triangle = i;
            t->component_of[i] = (int32_t)t->component_count++;
        }
        t->component_of[i] = t->component_of[root];
        t->components[t->component_of[i]].triangle_count++;
    }
    for (size_t i = 0; i < t->component_count; i++) {
        t->components[i].triangles =
            zeroed(t->components[i].triangle_count, sizeof(int32_t));
        t->components[i].triangle_count = 0;
    }
    for (size_t i = 0; i < m->triangle_count; i++) {
        component *c = &t->components[t->component_of[i]];
        c->triangles[c->triangle_count++] = (int32_t)i;
    }
    free(parent);
}

static void judge(topology *t, const mesh *m, const half_edge *edges,
                  size_t count)
{
    t->open_edges = zeroed(count, sizeof(uint64_t));
    for (size_t i = 0, next; i < count; i = next) {
        size_t forward = 0, all = 0;
        for (next = i; next < count && edges[next].key == edges[i].key;
             next++) {
            if (is_collapsed(t, m, edges[next].half / 3))
                continue;
            all++;
            forward += (size_t)edges[next].forward;
        }
        component *c = &t->components[t->component_of[edges[i].half / 3]];
        if (all % 2) {
            c->boundary_edges++;
            t->open_edges[t->open_edge_count++] = edges[i].key;
        } else if (2 * forward != all) {
            c->inconsistent_edges++;
        }
        c->nonmanifold_edges += all > 2;
    }
    for (size_t i = 0; i < t->component_count; i++) {
        component *c = &t->components[i];
        c->closed = c->boundary_edges == 0;
        c->consistent = c->closed && c->inconsistent_edges == 0;
    }
}

void topology_make(topology *t, const mesh *m)
{
    memset(t, 0, sizeof(*t));
    weld(t, m);
    half_edge *edges = zeroed(3 * m->triangle_count, sizeof(*edges));
    size_t count = 0;
    for (size_t half = 0; half < 3 * m->triangle_count; half++) {
        const int32_t *ids = m->triangles + half / 3 * 3;
        const int corner = (int)(half % 3);
        const int32_t a = t->welded[ids[corner]];
        const int32_t b = t->welded[ids[(corner + 1) % 3]];
        if (a == b)
            continue;
        edges[count].key = topology_edge(t, m, half / 3, corner);
        edges[count].half = half;
        edges[count++].forward = a < b;
    }
    qsort(edges, count, sizeof(*edges), by_key);
    connect(t, m, edges, count);
    judge(t, m, edges, count);
    free(edges);
    for (size_t i = 0; i < m->triangle_count; i++)
        t->degenerate_triangles += !oracle_has_area(
            mesh_corner(m, i, 0), mesh_corner(m, i, 1), mesh_corner(m, i, 2));
}

void topology_free(topology *t)
{
    for (size_t i = 0; i < t->component_count; i++)
        free(t->components[i].triangles);
    free(t->components);
    free(t->component_of);
    free(t->open_edges);
    free(t->welded);
}
