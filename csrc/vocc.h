/* vocc: exact shadows and visibility on closed meshes.
 *
 * This is the only public header.  It is C99 and also compiles as C++.
 *
 * WHAT IT ANSWERS
 * A ray is org + t * dir with t strictly between tmin and tmax.  It is
 * *occluded* iff the scene has a triangle that it crosses.  The answer is that
 * of exact arithmetic on the float32 coordinates given: a ray through an edge
 * or a vertex meets every triangle there, a triangle seen exactly edge-on (the
 * ray lies in its plane) is not met by itself, its neighbours are.  Hence a
 * closed mesh has no cracks, and no option (order, occluders, cache, deferment,
 * packets, isa, threads) can change a single result.  docs/method.md has the
 * proof.
 *
 * HOW IT IS USED
 *   1. vocc_scene_create     an empty scene
 *   2. vocc_scene_add_mesh   as often as there are meshes; arrays are copied
 *   3. vocc_scene_build      kd-tree, regions; the scene is then frozen
 *   4. vocc_intersect, vocc_shading_points, vocc_occluded, vocc_region,
 *      vocc_light_visibility, vocc_ambient_occlusion
 *   5. vocc_scene_free
 *
 * ERRORS
 * Every call that can fail returns a status; VOCC_OK is 0.  Where a call takes
 * a `vocc_error *`, it may be NULL; if it is not, a failure fills it with the
 * offending argument, index and value.  A call that fails leaves the scene as
 * it was, and holds no memory from the attempt.  A failed query leaves its
 * output arrays in an unspecified state, and writes nothing outside them.  The
 * library keeps no global state, never prints and never exits.
 *
 * THREADS
 * A scene may be used by one thread at a time until it is built; after that
 * any number of threads may query it at once.  Calls use threads of their own
 * (option `threads`); results do not depend on how many.  Progress callbacks
 * run on the calling thread only.
 *
 * UNITS AND RANGES
 * Coordinates are in the caller's unit of length.  All finite values are
 * accepted.  float64 coordinates are moved by a common origin (the centre of
 * the scene's bounds) before they are rounded to float32, unless all of them
 * are float32 numbers and near to zero already; see vocc_scene_origin.
 */
#ifndef VOCC_H
#define VOCC_H

#include <stddef.h>
#include <stdint.h>

#define VOCC_VERSION_MAJOR 0
#define VOCC_VERSION_MINOR 1
#define VOCC_VERSION_PATCH 0

#if defined(_WIN32) && defined(VOCC_SHARED)
#ifdef VOCC_BUILDING
#define VOCC_API __declspec(dllexport)
#else
#define VOCC_API __declspec(dllimport)
#endif
#elif defined(__GNUC__)
#define VOCC_API __attribute__((visibility("default")))
#else
#define VOCC_API
#endif

#ifdef __cplusplus
extern "C" {
#endif

/* <cffi> : the text between this marker and the next is read by Python's cffi
 * (which drops comments and VOCC_API). */

/* ---- status and errors ------------------------------------------------- */

typedef enum vocc_status {
    VOCC_OK = 0,
    VOCC_ERROR_INVALID_ARGUMENT = 1, /* a value, range, type or pointer */
    VOCC_ERROR_OUT_OF_MEMORY = 2,
    VOCC_ERROR_CANCELLED = 3,   /* the progress callback asked to stop */
    VOCC_ERROR_NOT_BUILT = 4,   /* a query before vocc_scene_build */
    VOCC_ERROR_FROZEN = 5,      /* add_mesh or build after a build */
    VOCC_ERROR_LIMIT = 6,       /* more than the format can hold */
    VOCC_ERROR_UNSUPPORTED = 7, /* not in this library or on this machine */
    VOCC_ERROR_OPEN_MESH = 8,   /* `strict`, and a mesh is not closed */
    VOCC_ERROR_THREAD = 9,      /* the system gave no thread or lock */
    VOCC_ERROR_MISMATCH = 10    /* `verify` found a difference: a fault of this
                                   library, or of the machine */
} vocc_status;

/* What went wrong.  `argument` is the parameter's name as in this header, or
 * empty; `index` is the row of the first offender, or -1; `value` the
 * offending number, or NaN; `message` a sentence with all of it. */
typedef struct vocc_error {
    int32_t status; /* a vocc_status */
    char argument[44];
    int64_t index;
    double value;
    char message[192];
} vocc_error;

/* The status in words, in English; never NULL.  The string is static. */
VOCC_API const char *vocc_status_string(int32_t status);

/* "major.minor.patch" of the library that is linked. */
VOCC_API const char *vocc_version(void);

/* ---- callbacks --------------------------------------------------------- */

/* Told the fraction done, 0 to 1, never falling; returns non-zero to stop.
 * Called on the thread that made the call, at most a few hundred times a
 * second and at least every 0.1 s. */
typedef int (*vocc_progress_fn)(void *user, double fraction);

/* An allocator.  `allocate` returns memory aligned as malloc's, or NULL;
 * `deallocate` takes what `allocate` gave, never NULL.  Both are called from
 * several threads at once during builds and threaded queries. */
typedef struct vocc_allocator {
    void *(*allocate)(void *user, size_t size);
    void (*deallocate)(void *user, void *memory);
    void *user;
} vocc_allocator;

/* ---- arrays ------------------------------------------------------------ */

typedef enum vocc_type {
    VOCC_FLOAT32 = 1,
    VOCC_FLOAT64 = 2,
    VOCC_INT32 = 3,
    VOCC_UINT32 = 4,
    VOCC_INT64 = 5,
    VOCC_UINT64 = 6
} vocc_type;

/* A borrowed array of rows.  The components of a row are contiguous; rows are
 * `stride` bytes apart (0: one row for all; negative is allowed).  `data` needs
 * only the alignment of its type.  The number of rows is given by the call. */
typedef struct vocc_array {
    const void *data;
    ptrdiff_t stride;
    int32_t type; /* a vocc_type */
} vocc_array;

/* ---- scene ------------------------------------------------------------- */

typedef struct vocc_scene vocc_scene;

/* Makes an empty scene in *scene.  `allocator` may be NULL (malloc, free); it
 * is copied and serves the scene and every call on it.
 * Fails: INVALID_ARGUMENT, OUT_OF_MEMORY; *scene is then NULL. */
VOCC_API vocc_status vocc_scene_create(const vocc_allocator *allocator,
                                       vocc_scene **scene, vocc_error *error);

/* Frees the scene and all that it holds.  NULL does nothing. */
VOCC_API void vocc_scene_free(vocc_scene *scene);

typedef struct vocc_mesh_options {
    uint32_t size; /* sizeof(vocc_mesh_options) */
    int32_t
        occluder; /* 1: closed parts may hold occluders; 0: triangles only */
    const char *name; /* UTF-8, copied, cut after 63 bytes; NULL: no name */
} vocc_mesh_options;

/* Fills *options with the defaults: occluder 1, no name. */
VOCC_API void vocc_mesh_options_init(vocc_mesh_options *options);

/* Adds a mesh.  `vertices`: vertex_count rows of 3 FLOAT32 or FLOAT64, finite;
 * a FLOAT64 beyond float32's range is an error.  `triangles`: triangle_count
 * rows of 3 integers (any integer vocc_type), each below vertex_count.
 * Degenerate and repeated triangles are accepted; a triangle without area is
 * never hit.  Both arrays are copied.  Empty meshes are accepted.
 * *geom_id gets 0, 1, 2, ... in order of adding; it may be NULL.
 * Fails: INVALID_ARGUMENT (argument, row, value), OUT_OF_MEMORY, LIMIT (more
 * than 2^27 triangles or 2^31 - 1 vertices in the scene), FROZEN. */
VOCC_API vocc_status vocc_scene_add_mesh(vocc_scene *scene, size_t vertex_count,
                                         vocc_array vertices,
                                         size_t triangle_count,
                                         vocc_array triangles,
                                         const vocc_mesh_options *options,
                                         int32_t *geom_id, vocc_error *error);

typedef struct vocc_build_options {
    uint32_t size;           /* sizeof(vocc_build_options) */
    int32_t threads;         /* 0: one a processor; at most 256 */
    float traversal_cost;    /* SAH: one step; > 0, default 1 */
    float intersection_cost; /* SAH: one triangle test; > 0, or 0, the default:
                                0.65, for more than 100 000 triangles 0.4 */
    float empty_bonus;       /* SAH: share saved by an empty child, 0 to 1,
                                default 0.2 */
    int32_t max_leaf_size;   /* split above this count even where the SAH would
                                not; 1 to 2^20, default 64 */
    int32_t max_depth;       /* 0: 8 + 1.6 log2(triangles); at most 60 */
    int32_t bad_refines;     /* splits in a row that the SAH finds too dear but
                                are tried; 0 to 16, default 0 */
    int32_t strict;          /* 1: a mesh that is not closed is an error
                                (meshes with occluder = 0 are exempt) */
    vocc_progress_fn progress; /* NULL: none */
    void *progress_user;
} vocc_build_options;

/* Fills *options with the defaults. */
VOCC_API void vocc_build_options_init(vocc_build_options *options);

/* Builds the kd-tree and classifies its leaves; the scene is then frozen.
 * options may be NULL (defaults).  An empty scene can be built.  The tree does
 * not depend on `threads`.  On failure the scene is as it was before.
 * Fails: INVALID_ARGUMENT, OUT_OF_MEMORY, CANCELLED, FROZEN, LIMIT, OPEN_MESH
 * (`index` is the geom_id), THREAD. */
VOCC_API vocc_status vocc_scene_build(vocc_scene *scene,
                                      const vocc_build_options *options,
                                      vocc_error *error);

/* The point that is subtracted from float64 coordinates before they are
 * rounded to float32: (0, 0, 0) if no mesh needed it. */
VOCC_API vocc_status vocc_scene_origin(const vocc_scene *scene,
                                       double origin[3]);

/* ---- report ------------------------------------------------------------ */

/* The built scene in figures. */
typedef struct vocc_report {
    uint32_t size; /* sizeof(vocc_report), set by the caller */
    int32_t mesh_count;
    int32_t component_count; /* edge-connected components of all meshes */
    int32_t closed_count;    /* those that are closed and may hold occluders */
    uint64_t triangle_count;
    uint64_t vertex_count;
    double lower[3], upper[3]; /* bounds of all triangles */
    uint64_t node_count;       /* interior nodes and leaves */
    uint64_t boundary_leaves, opaque_leaves, clear_leaves;
    uint64_t unknown_leaves;  /* empty, but too thin for a seed ray: never
                                 used as occluders */
    uint64_t reference_count; /* triangle references in leaves */
    uint64_t seed_rays;
    int32_t depth;
    int32_t region_count;          /* with 0, the outside */
    double opaque_volume_fraction; /* of the scene's bounds */
    double occluder_area;          /* surface of all opaque leaves */
    double mesh_area;    /* surface of the meshes that hold occluders */
    uint64_t tree_bytes; /* nodes, references, triangles, bounds table */
    uint64_t beam_bytes; /* the hierarchy that beams go through */
    /* Of the parts, some of which run side by side, and of the whole. */
    double seconds_components, seconds_build, seconds_classify;
    double seconds_occluders; /* child order, planes, grown boxes */
    double seconds_beams;     /* the hierarchy that beams go through */
    double seconds_total;
    int32_t auto_order; /* the vocc_order that AUTO stands for */
    int32_t threads;    /* used by the build */
} vocc_report;

VOCC_API vocc_status vocc_scene_report(const vocc_scene *scene,
                                       vocc_report *report, vocc_error *error);

/* One mesh. */
typedef struct vocc_mesh_report {
    uint32_t size; /* sizeof(vocc_mesh_report), set by the caller */
    int32_t occluder;
    char name[64];
    uint64_t triangle_count, vertex_count;
    uint64_t welded_vertices;      /* distinct positions that triangles use */
    uint64_t degenerate_triangles; /* without area */
    int32_t first_component, component_count;
    int32_t closed;              /* 1: every component is closed */
    uint64_t boundary_edges;     /* with an odd number of triangles */
    uint64_t nonmanifold_edges;  /* with more than two triangles */
    uint64_t inconsistent_edges; /* wound alike from both sides */
    double volume;               /* signed, in cubed units; sum of components */
} vocc_mesh_report;

VOCC_API vocc_status vocc_scene_mesh_report(const vocc_scene *scene,
                                            int32_t geom_id,
                                            vocc_mesh_report *report,
                                            vocc_error *error);

/* One edge-connected component of one mesh.  Vertices at equal positions are
 * one vertex. */
typedef struct vocc_component_report {
    uint32_t size; /* sizeof(vocc_component_report), set by the caller */
    int32_t geom_id;
    uint64_t triangle_count;
    uint64_t first_triangle; /* smallest prim_id in it */
    int32_t closed;          /* 1: every edge has an even count */
    int32_t consistent;      /* 1: closed and wound consistently */
    uint64_t boundary_edges, nonmanifold_edges, inconsistent_edges;
    double volume; /* signed; positive: normals point outward */
} vocc_component_report;

VOCC_API vocc_status vocc_scene_component_report(const vocc_scene *scene,
                                                 int32_t component,
                                                 vocc_component_report *report,
                                                 vocc_error *error);

/* Where a mesh is open: its boundary edges (odd number of triangles), each as
 * a prim_id of one of its triangles and the edge's corner there (0: v0v1, 1:
 * v1v2, 2: v2v0), in order of prim_id.  Writes at most `capacity` rows of
 * edges[][2]; *count gets how many there are. */
VOCC_API vocc_status vocc_scene_open_edges(const vocc_scene *scene,
                                           int32_t geom_id, size_t capacity,
                                           int32_t *edges, size_t *count,
                                           vocc_error *error);

/* The solids that region r > 0 lies in: component indices and, for each, the
 * winding number (or 1, the parity, where a component is not consistent).
 * Writes at most `capacity` entries; *count gets how many there are. */
VOCC_API vocc_status vocc_scene_region_info(const vocc_scene *scene,
                                            int32_t region, size_t capacity,
                                            int32_t *components,
                                            int32_t *windings, size_t *count,
                                            vocc_error *error);

typedef enum vocc_label {
    VOCC_BOUNDARY = 0, /* holds triangles */
    VOCC_CLEAR = 1,    /* empty, outside every solid (region 0) */
    VOCC_OPAQUE = 2,   /* empty, inside: a volumetric occluder */
    VOCC_UNKNOWN = 3   /* empty, not used */
} vocc_label;

/* One leaf of the kd-tree, for inspection and pictures. */
typedef struct vocc_leaf {
    float lower[3], upper[3]; /* relative to vocc_scene_origin */
    int32_t label;            /* a vocc_label */
    int32_t region;           /* of an empty leaf; -1 for the others */
    uint32_t first;           /* of its references */
    uint32_t count;
} vocc_leaf;

/* Writes the leaves in the tree's order, at most `capacity`; *count gets how
 * many there are. */
VOCC_API vocc_status vocc_scene_leaves(const vocc_scene *scene, size_t capacity,
                                       vocc_leaf *leaves, size_t *count,
                                       vocc_error *error);

/* Writes the triangles that references first .. first + count - 1 stand for,
 * as rows of ids[][2]: geom_id, prim_id. */
VOCC_API vocc_status vocc_scene_references(const vocc_scene *scene,
                                           uint64_t first, size_t count,
                                           int32_t *ids, vocc_error *error);

/* ---- queries ----------------------------------------------------------- */

typedef enum vocc_order {
    VOCC_ORDER_AUTO = 0,     /* chosen when the scene was built; it also does
                                without occluders in the kd-tree where they do
                                not pay there */
    VOCC_ORDER_STANDARD = 1, /* front to back; triangles at once */
    VOCC_ORDER_EXTENDED = 2, /* front to back; triangles deferred */
    VOCC_ORDER_BFS = 3,      /* breadth first; triangles deferred */
    VOCC_ORDER_QDBFS = 4,    /* breadth first with quick descent; deferred */
    VOCC_ORDER_OPAQUE_FIRST = 5, /* depth first; of two children the one where
                                    a block is cheaper to find, opaque leaves
                                    counted; triangles deferred */
    VOCC_ORDER_SATO = 6, /* depth first, the child of larger surface first (Nah
                            and Manocha 2014); triangles at once */
    VOCC_ORDER_RTSAH = 7 /* depth first, as opaque-first, with triangles only
                            (Ize and Hansen 2011); triangles at once */
} vocc_order;

/* Which occluders the cache holds. */
typedef enum vocc_cache_policy {
    VOCC_CACHE_RECENT = 0,   /* those that blocked last, most recent first */
    VOCC_CACHE_DIRECTION = 1 /* by the ray's direction: the last one in its cell
                                of a cube map (as Radiance's shadow cache) */
} vocc_cache_policy;

/* Instruction sets: SCALAR is in every library, SSE2 in every one for x86-64,
 * NEON in every one for aarch64; AVX2 and AVX512 need an x86-64 machine that
 * has them (found out at run time) and a compiler that knows them. */
typedef enum vocc_isa {
    VOCC_ISA_AUTO = 0,   /* see vocc_query_isa */
    VOCC_ISA_SCALAR = 1, /* plain C */
    VOCC_ISA_SSE2 = 2,
    VOCC_ISA_AVX2 = 3,   /* with FMA, BMI1 and BMI2 */
    VOCC_ISA_AVX512 = 4, /* F, BW, DQ and VL; and all of AVX2 */
    VOCC_ISA_NEON = 5
} vocc_isa;

/* How vocc_light_visibility and vocc_occluded find their answer; it is the same
 * by each. */
typedef enum vocc_method {
    /* RAYS if `order` is not AUTO or `packets` is 0; for lights also if
     * `entry_points`, `voxels` or `point_steps` are set or there are less than
     * 12 rays a triangle.  Else BEAMS. */
    VOCC_METHOD_AUTO = 0,
    /* Through the kd-tree, four at a time: `order` and the options below it. */
    VOCC_METHOD_RAYS = 1,
    /* Through a hierarchy of 16 children a node: groups of points and parts of
     * a light at once; the rays of vocc_occluded 16 at a time, sorted where
     * neighbours are far apart. */
    VOCC_METHOD_BEAMS = 2
} vocc_method;

/* What a query did.  A packet counts once however many lanes it has. */
typedef struct vocc_counters {
    uint64_t rays;     /* traced; those that meet nothing by definition
                          (see vocc_rays) are counted, too */
    uint64_t occluded; /* blocked rays (vocc_intersect: hits) */
    uint64_t packets;
    uint64_t node_visits;         /* interior nodes: traversal steps */
    uint64_t leaf_visits;         /* boundary leaves */
    uint64_t triangle_tests;      /* packet x triangle */
    uint64_t active_lanes;        /* sum of live lanes over node_visits */
    uint64_t exact_tests;         /* ray x triangle settled beyond float32 */
    uint64_t occluder_hits_tree;  /* rays blocked by an opaque leaf */
    uint64_t occluder_hits_cache; /* rays blocked by a cached occluder */
    uint64_t cache_lookups;       /* packet x cached box */
    uint64_t triangle_cache_hits; /* rays blocked by the last triangle */
    uint64_t fallbacks; /* rays whose end could not be certified when an
                           occluder was about to decide */
    uint64_t deferred;  /* leaves put on the deferment list */
    uint64_t queue_pushes, queue_pops;
    uint64_t careful_rays;   /* traced in double: values outside the range of
                                the float kernels */
    uint64_t entry_searches; /* of entry points and for voxels: groups of
                                points x light */
    uint64_t entry_steps, entry_tests; /* nodes and triangles looked at there */
    uint64_t entry_lit_rays, entry_dark_rays; /* rays that need no tracing */
    uint64_t entry_few_rays; /* rays tested against a short list instead */
    uint64_t voxel_lit_rays, voxel_dark_rays; /* rays that need no tracing */
    /* By beams: */
    uint64_t beam_lit_rays, beam_dark_rays; /* that a whole beam settles;
                                               the latter: an occluder */
    uint64_t beam_hidden_rays; /* of points that one triangle hides it from */
    uint64_t beam_tested_rays; /* the others */
    uint64_t beam_box_rays;    /* those of them that an occluder blocks */
    uint64_t beams;            /* groups, and parts of them, looked at */
    uint64_t beam_nodes;       /* 16 children each */
    uint64_t beam_clusters;    /* 16 triangles each, against a beam */
    uint64_t beam_tests;       /* ray x cluster, or 16 rays x triangle */
} vocc_counters;

typedef struct vocc_query_options {
    uint32_t size;        /* sizeof(vocc_query_options) */
    int32_t order;        /* a vocc_order, default AUTO; ignored by intersect */
    int32_t occluders;    /* 1 (default): use volumetric occluders */
    int32_t deferment;    /* boundary leaves on the deferment list, 0 to 512
                             (default); when it is full its triangles are tested */
    int32_t cache;        /* occluders in the cache, 0 to 64, default 8; by
                             direction: cells along an edge of the cube map */
    int32_t cache_policy; /* a vocc_cache_policy, default RECENT */
    int32_t fusion;       /* 1 (default): the cache holds boxes grown beyond
                             their leaf, where there are; 0: leaves */
    int32_t triangle_cache; /* 1: test the triangle that blocked last before
                               the tree (Haines and Greenberg 1986); default
                               0 */
    int32_t entry_points; /* 1: vocc_light_visibility looks for what the rays of
                             neighbouring points to a light can meet, all at
                             once (Reshetov et al. 2005), and traces the rays
                             that this does not settle from there; 0: not; -1
                             (default): in AUTO order only */
    int32_t entry_triangles; /* such a search gives up when it has found more
                                triangles, 0 to 64, default 8 */
    int32_t voxels;  /* vocc_light_visibility settles points by the voxel that
                        they are in, where the light is seen from all of it or
                        from nowhere in it (Woo and Amanatides 1990); so many
                        along the longest side of the points' bounds, up to
                        1024; 0 (default): not */
    int32_t method;  /* a vocc_method, default AUTO: the same answer by each */
    int32_t verify;  /* n > 0: vocc_light_visibility and vocc_ambient_occlusion
                        by beams trace one in n of the points (of each light)
                        again, ray by ray without occluders, and fail (MISMATCH)
                        if a count differs; not with `blocked` (UNSUPPORTED).
                        0 (default): not */
    int32_t packets; /* 1 (default): 4 rays at a time; 0: single rays */
    int32_t isa;     /* a vocc_isa, default AUTO; one that the machine or the
                        library lacks: UNSUPPORTED */
    int32_t threads; /* 0: one a processor; at most 256 */
    vocc_progress_fn progress; /* NULL: none */
    void *progress_user;
    vocc_counters *counters; /* NULL: not counted, at no cost; else added to */
    uint32_t *point_steps;   /* vocc_light_visibility: NULL, or gets for each
                                point the traversal steps (node_visits, not
                                entry_steps) of its rays, modulo 2^32; packets
                                then hold rays of one point */
} vocc_query_options;

/* Fills *options with the defaults. */
VOCC_API void vocc_query_options_init(vocc_query_options *options);

/* *isa: the instruction set (a vocc_isa, not AUTO) that a query with these
 * options uses; options may be NULL (defaults).  It is options->isa; for AUTO
 * the one that the environment variable VOCC_ISA names (scalar, sse2, avx2,
 * avx512 or neon); where that is not set, empty or "auto", the best that
 * machine and library have.  Queries read VOCC_ISA when they begin: no other
 * thread may be changing the environment then.
 * Fails: INVALID_ARGUMENT (an option, or VOCC_ISA with an unknown name),
 * UNSUPPORTED (isa or VOCC_ISA: not on this machine or not in this library; the
 * message says what there is). */
VOCC_API vocc_status vocc_query_isa(const vocc_query_options *options,
                                    int32_t *isa, vocc_error *error);

/* "auto", "scalar", "sse2", "avx2", "avx512", "neon"; NULL for another number.
 */
VOCC_API const char *vocc_isa_name(int32_t isa);

/* Rays.  `org`, `dir`: rows of 3 FLOAT32 or FLOAT64.  `tmin`, `tmax`: rows of
 * 1; data NULL means 0 and infinity.  `dir` need not be normalised; t is in
 * its units.  FLOAT64 values are rounded to float32 (org after the scene's
 * origin is subtracted).  A ray with a NaN or infinite org or dir, a
 * zero-length dir, a NaN tmin or tmax, or tmin >= tmax meets nothing; that is
 * a result, not an error.  tmin may be negative or -infinity. */
typedef struct vocc_rays {
    size_t count;
    vocc_array org;
    vocc_array dir;
    vocc_array tmin;
    vocc_array tmax;
} vocc_rays;

/* Outputs of vocc_intersect: contiguous arrays of rays.count; any may be NULL.
 * A miss has t = infinity, geom_id = prim_id = -1, u = v = 0.  The hit point is
 * (1 - u - v) v0 + u v1 + v v2.  The closest hit has the smallest t as rounded
 * to float32; among equals the smallest (geom_id, prim_id). */
typedef struct vocc_hits {
    float *t;
    int32_t *geom_id;
    int32_t *prim_id;
    float *u;
    float *v;
} vocc_hits;

/* Closest hits.  options may be NULL (defaults).
 * Fails: INVALID_ARGUMENT, NOT_BUILT, OUT_OF_MEMORY, CANCELLED, UNSUPPORTED,
 * THREAD. */
VOCC_API vocc_status vocc_intersect(const vocc_scene *scene,
                                    const vocc_rays *rays,
                                    const vocc_hits *hits,
                                    const vocc_query_options *options,
                                    vocc_error *error);

/* What rays see first, as shadow rays start from it: vocc_intersect, and for
 * each ray the point where it meets the plane of its triangle, moved by
 * `offset` (>= 0) along the triangle's unit normal on the side of org:
 * position[3 i], less vocc_scene_origin, and normal[3 i]; NaN and 0 for a miss.
 * They are computed in double from org and the triangle and rounded once; t is
 * used where the triangle is edge-on in double.  position, normal: NULL, or 3
 * floats a ray.  hits: as for vocc_intersect.  Fails as vocc_intersect. */
VOCC_API vocc_status vocc_shading_points(const vocc_scene *scene,
                                         const vocc_rays *rays, double offset,
                                         const vocc_hits *hits, float *position,
                                         float *normal,
                                         const vocc_query_options *options,
                                         vocc_error *error);

/* Any hit: occluded[i] = 1 or 0 for each ray.  Fails as vocc_intersect. */
VOCC_API vocc_status vocc_occluded(const vocc_scene *scene,
                                   const vocc_rays *rays, uint8_t *occluded,
                                   const vocc_query_options *options,
                                   vocc_error *error);

/* The region of each point (`points`: rows of 3 FLOAT32 or FLOAT64): 0 outside
 * every closed solid, > 0 inside (see vocc_scene_region_info), -1 exactly on
 * the surface of a closed solid, -2 for a NaN or infinite point.  Fails as
 * vocc_intersect; LIMIT if more than 2^31 - 1 distinct regions would be met. */
VOCC_API vocc_status vocc_region(const vocc_scene *scene, size_t count,
                                 vocc_array points, int32_t *region,
                                 const vocc_query_options *options,
                                 vocc_error *error);

/* What vocc_scene_classify_by_rays found. */
typedef struct vocc_ray_classification {
    uint32_t size;   /* sizeof(vocc_ray_classification), set by the caller */
    int32_t threads; /* used */
    uint64_t leaf_count; /* of every label, as vocc_scene_leaves counts them */
    uint64_t rays;       /* one an empty leaf that has a centre in float32 */
    uint64_t opaque_leaves, clear_leaves;
    uint64_t unknown_leaves; /* empty, but too thin for a ray */
    uint64_t disagreements;  /* OPAQUE by the flood fill and CLEAR by the ray,
                                or the other way round */
    double seconds;
} vocc_ray_classification;

/* The classification of the paper, to be compared with that of the build: from
 * the centre of each empty leaf one ray along `direction`, and the leaf is
 * OPAQUE if the first triangle is met from behind (the ray runs along its
 * normal (v1 - v0) x (v2 - v0)), else CLEAR.  Unlike the flood fill it takes
 * every triangle for part of a solid and every normal for one that points
 * outward, and a ray through an edge meets one of two triangles, so it may be
 * wrong; hence nothing else uses its labels, and the scene is not changed.
 *
 * direction: finite and not 0, of any length; rounded to float32 when it has
 * been scaled by a power of two.  NULL: one in no relation to any mesh.
 * Writes a vocc_label for each of the first `capacity` leaves, in the order of
 * vocc_scene_leaves: BOUNDARY, CLEAR, OPAQUE, or UNKNOWN where a leaf is too
 * thin for a ray.  *result is about all leaves.  Of the options, order,
 * occluders and what belongs to them have no effect.
 * Fails as vocc_intersect. */
VOCC_API vocc_status vocc_scene_classify_by_rays(
    const vocc_scene *scene, const double direction[3], size_t capacity,
    int32_t *labels, vocc_ray_classification *result,
    const vocc_query_options *options, vocc_error *error);

typedef enum vocc_light_type {
    VOCC_LIGHT_RECT,   /* position + a edge_u + b edge_v, a and b from 0 to 1 */
    VOCC_LIGHT_DISK,   /* position + x edge_u + y edge_v, x^2 + y^2 <= 1: an
                          ellipse if the half axes differ */
    VOCC_LIGHT_SPHERE, /* of `radius` around position; samples are spread over
                          the solid angle that a point sees */
    VOCC_LIGHT_POINT,  /* a disk of `radius` around position that faces the
                          point it lights; radius 0: one point */
    VOCC_LIGHT_SPOT,   /* as POINT, for points within the cone of `angle`
                          around `direction` only */
    VOCC_LIGHT_SUN     /* infinitely far towards `direction`; its disk has the
                          angular diameter `angle` */
} vocc_light_type;

/* A light: its type, and the fields that the type names; the rest is ignored.
 * Edges need not be perpendicular, and may be 0. */
typedef struct vocc_light {
    double position[3];
    double edge_u[3], edge_v[3];
    double radius;       /* >= 0 */
    double direction[3]; /* of any length but 0; SPOT: away from the light */
    double angle;        /* full, in radians: SUN 0 to pi, SPOT 0 to 2 pi */
    int32_t type;        /* a vocc_light_type */
    int32_t one_sided;   /* RECT, DISK: 1: it emits only on the side that
                            edge_u x edge_v points to; 0: on both */
} vocc_light;

typedef enum vocc_sampler {
    VOCC_SAMPLER_SOBOL, /* Sobol's first two dimensions, Owen-scrambled by a
                           hash of point id and light: the lower error */
    VOCC_SAMPLER_JITTER /* nu x nv strata, jittered by a hash of point_id * 2048
                           + light * 256 + sample: repeated in few lines by
                           any program */
} vocc_sampler;

typedef enum vocc_horizon {
    VOCC_HORIZON_SAMPLE, /* a sample that is not above the surface is dark; a
                            point with none above is not traced */
    VOCC_HORIZON_CENTRE  /* all samples are traced if the light's centre (SUN:
                            direction) is above the surface, else none */
} vocc_horizon;

/* Which rays are traced. */
typedef struct vocc_sampling {
    uint32_t size;   /* sizeof(vocc_sampling) */
    int32_t samples; /* of each light at each point, 1 to 65534; default 16 */
    int32_t sampler; /* a vocc_sampler, default SOBOL */
    int32_t horizon; /* a vocc_horizon, default SAMPLE; not for ambient
                        occlusion */
} vocc_sampling;

/* Fills *sampling with the defaults. */
VOCC_API void vocc_sampling_init(vocc_sampling *sampling);

#define VOCC_NOT_TRACED 65535

/* How many samples of each light each point sees: visible[l * count + i] for
 * light l and point i, 0 to samples; VOCC_NOT_TRACED where nothing is traced:
 * the point is turned away from the light (see vocc_horizon: "above" is normal
 * . (sample - point) > 0 in double), behind a one-sided light, outside the cone
 * of a SPOT, or it has a NaN or infinite coordinate or a NaN normal.
 *
 * points, normals: `count` rows of 3 FLOAT32 or FLOAT64; normals need not have
 * unit length.  The points are the ray origins: the caller has moved them off
 * the surface.  point_ids: rows of 1 UINT32, or data NULL for 0, 1, 2, ...
 * sampling: NULL for the defaults.
 *
 * irradiance: NULL, or float[light_count * count]: of the irradiance that the
 * light's samples would give a diffuse surface there (cosine at the surface,
 * cosine at a RECT, DISK, POINT or SPOT, inverse square of the distance, all
 * in double), the share that is not blocked; NaN where nothing is traced.
 * visible may be NULL then.
 *
 * blocked: NULL, or (samples + 7) / 8 bytes for each value of visible, read and
 * written: bit k % 8 of byte k / 8 is sample k.  A sample whose bit is set is
 * blocked and not traced; the bits of those found blocked are set.  So meshes
 * in several scenes block together: a call for each, with the same lights,
 * points and bits (0 at first); the last one's results hold for all.  (Rays are
 * the same in all scenes if their vocc_scene_origin is.)
 *
 * The shadow ray runs from the point O to the sample S on the light: direction
 * S - O, 0 < t < 1; to a SUN 0 < t.  docs/method.md has the formulas; none uses
 * anything but +, -, *, / and sqrt: the same rays on every machine.
 * Fails as vocc_intersect. */
VOCC_API vocc_status vocc_light_visibility(
    const vocc_scene *scene, size_t count, vocc_array points,
    vocc_array normals, vocc_array point_ids, size_t light_count,
    const vocc_light *lights, const vocc_sampling *sampling, uint16_t *visible,
    float *irradiance, uint8_t *blocked, const vocc_query_options *options,
    vocc_error *error);

/* Ambient occlusion: how many of sampling->samples rays from each point, spread
 * over the hemisphere of its normal by cosine, meet nothing within `distance`
 * (> 0; infinity is allowed): open[i], 0 to samples; VOCC_NOT_TRACED where the
 * point is not finite or the normal has no direction.  The rest as for
 * vocc_light_visibility; light number 0 in the hash. */
VOCC_API vocc_status vocc_ambient_occlusion(
    const vocc_scene *scene, size_t count, vocc_array points,
    vocc_array normals, vocc_array point_ids, double distance,
    const vocc_sampling *sampling, uint16_t *open, uint8_t *blocked,
    const vocc_query_options *options, vocc_error *error);

/* </cffi> */

#ifdef __cplusplus
}
#endif

#endif
