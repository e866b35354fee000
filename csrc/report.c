/* What a built scene tells of itself. */
#include "scene.h"
#include "status.h"

#include <inttypes.h>
#include <math.h>
#include <string.h>

/* Common to all: a built scene, a place for the answer. */
static vocc_status check(const vocc_scene *scene, const void *out,
                         const char *argument, vocc_error *error)
{
    const vocc_status status = vocc_check_built(scene, error);
    if (status != VOCC_OK)
        return status;
    if (!out)
        return vocc_fail(error, VOCC_ERROR_INVALID_ARGUMENT, argument, -1,
                         (double)NAN, "%s: NULL", argument);
    return VOCC_OK;
}

static vocc_status check_size(uint32_t size, size_t wanted, vocc_error *error)
{
    if (size == wanted)
        return VOCC_OK;
    return vocc_fail(error, VOCC_ERROR_INVALID_ARGUMENT, "report", -1,
                     (double)size, "report: size is %" PRIu32 ", not %zu", size,
                     wanted);
}

static vocc_status check_number(const char *argument, int64_t value,
                                int64_t count, vocc_error *error)
{
    if (value >= 0 && value < count)
        return VOCC_OK;
    return vocc_fail(error, VOCC_ERROR_INVALID_ARGUMENT, argument, -1,
                     (double)value,
                     "%s is %" PRId64 ": it has to be from 0 to %" PRId64,
                     argument, value, count - 1);
}

vocc_status vocc_scene_report(const vocc_scene *scene, vocc_report *report,
                              vocc_error *error)
{
    vocc_status status = check(scene, report, "report", error);
    if (status == VOCC_OK)
        status = check_size(report->size, sizeof *report, error);
    if (status == VOCC_OK)
        *report = scene->built.report;
    return status;
}

vocc_status vocc_scene_mesh_report(const vocc_scene *scene, int32_t geom_id,
                                   vocc_mesh_report *report, vocc_error *error)
{
    vocc_status status = check(scene, report, "report", error);
    if (status == VOCC_OK)
        status = check_size(report->size, sizeof *report, error);
    if (status == VOCC_OK)
        status =
            check_number("geom_id", geom_id, (int64_t)scene->mesh_count, error);
    if (status == VOCC_OK)
        *report = scene->built.analyses[geom_id].report;
    return status;
}

vocc_status vocc_scene_component_report(const vocc_scene *scene,
                                        int32_t component,
                                        vocc_component_report *report,
                                        vocc_error *error)
{
    vocc_status status = check(scene, report, "report", error);
    size_t m = 0;
    if (status == VOCC_OK)
        status = check_size(report->size, sizeof *report, error);
    if (status == VOCC_OK)
        status = check_number("component", component,
                              scene->built.report.component_count, error);
    if (status != VOCC_OK)
        return status;
    while (component >= scene->built.analyses[m].report.first_component +
                            scene->built.analyses[m].report.component_count)
        m++;
    *report = scene->built.analyses[m]
                  .components[component -
                              scene->built.analyses[m].report.first_component];
    return VOCC_OK;
}

vocc_status vocc_scene_open_edges(const vocc_scene *scene, int32_t geom_id,
                                  size_t capacity, int32_t *edges,
                                  size_t *count, vocc_error *error)
{
    const vocc_analysis *x;
    size_t i;
    vocc_status status = check(scene, count, "count", error);
    if (status == VOCC_OK && capacity && !edges)
        status = check(scene, edges, "edges", error);
    if (status == VOCC_OK)
        status =
            check_number("geom_id", geom_id, (int64_t)scene->mesh_count, error);
    if (status != VOCC_OK)
        return status;
    x = &scene->built.analyses[geom_id];
    *count = x->open_edge_count;
    for (i = 0; i < x->open_edge_count && i < capacity; i++) {
        edges[2 * i] = (int32_t)(x->open_edges[i] / 3);
        edges[2 * i + 1] = (int32_t)(x->open_edges[i] % 3);
    }
    return VOCC_OK;
}

vocc_status vocc_scene_region_info(const vocc_scene *scene, int32_t region,
                                   size_t capacity, int32_t *components,
                                   int32_t *windings, size_t *count,
                                   vocc_error *error)
{
    const vocc_regions *r;
    size_t i, first;
    vocc_status status = check(scene, count, "count", error);
    if (status == VOCC_OK && capacity && !components)
        status = check(scene, components, "components", error);
    if (status == VOCC_OK && capacity && !windings)
        status = check(scene, windings, "windings", error);
    if (status != VOCC_OK)
        return status;
    r = scene->built.regions;
    vocc_mutex_lock(scene->built.regions_mutex);
    status = check_number("region", region, (int64_t)r->count, error);
    if (status == VOCC_OK) {
        first = r->start[region];
        *count = r->start[region + 1] - first;
        for (i = 0; i < *count && i < capacity; i++) {
            components[i] =
                scene->built.solid_component[r->windings[first + i].solid];
            windings[i] = r->windings[first + i].number;
        }
    }
    vocc_mutex_unlock(scene->built.regions_mutex);
    return status;
}

typedef struct leaf_list {
    const vocc_tree *tree;
    vocc_leaf *leaves;
    size_t capacity, count;
} leaf_list;

static int add_leaf(void *context, uint32_t node, const float lower[3],
                    const float upper[3])
{
    leaf_list *list = context;
    if (list->count < list->capacity) {
        const vocc_node n = list->tree->nodes[node];
        vocc_leaf *l = &list->leaves[list->count];
        const unsigned label = vocc_label_of(n);
        memcpy(l->lower, lower, sizeof l->lower);
        memcpy(l->upper, upper, sizeof l->upper);
        l->label = (int32_t)label;
        l->region = label == VOCC_BOUNDARY || label == VOCC_UNKNOWN
                        ? -1
                        : vocc_leaf_region(list->tree, n);
        l->first = label == VOCC_BOUNDARY ? n.at.first : 0;
        l->count = vocc_leaf_count(n);
    }
    list->count++;
    return 0;
}

vocc_status vocc_scene_leaves(const vocc_scene *scene, size_t capacity,
                              vocc_leaf *leaves, size_t *count,
                              vocc_error *error)
{
    leaf_list list;
    vocc_status status = check(scene, count, "count", error);
    if (status == VOCC_OK && capacity && !leaves)
        status = check(scene, leaves, "leaves", error);
    if (status != VOCC_OK)
        return status;
    list.tree = &scene->built.tree;
    list.leaves = leaves;
    list.capacity = capacity;
    list.count = 0;
    (void)vocc_tree_leaves(list.tree, add_leaf, &list);
    *count = list.count;
    return VOCC_OK;
}

vocc_status vocc_scene_references(const vocc_scene *scene, uint64_t first,
                                  size_t count, int32_t *ids, vocc_error *error)
{
    const vocc_tree *tree;
    size_t i;
    vocc_status status = check(scene, scene, "scene", error);
    if (status != VOCC_OK)
        return status;
    tree = &scene->built.tree;
    if (first > tree->reference_count ||
        (count && first == tree->reference_count))
        return vocc_fail(error, VOCC_ERROR_INVALID_ARGUMENT, "first", -1,
                         (double)first,
                         "first is %" PRIu64 ": there are %zu references",
                         first, tree->reference_count);
    if (count > tree->reference_count - first)
        return vocc_fail(
            error, VOCC_ERROR_INVALID_ARGUMENT, "count", -1, (double)count,
            "count is %zu: there are %zu references from %" PRIu64 " on", count,
            tree->reference_count - (size_t)first, first);
    if (count) {
        status = check(scene, ids, "ids", error);
        if (status != VOCC_OK)
            return status;
    }
    for (i = 0; i < count; i++)
        vocc_scene_triangle(scene, tree->ids[tree->references[first + i]],
                            &ids[2 * i], &ids[2 * i + 1]);
    return VOCC_OK;
}
