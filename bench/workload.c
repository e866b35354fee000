#include "workload.h"

#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* One above and one at each corner. */
static const wl_light panels[] = {
    {{-0.5f, 3, -0.5f}, {1, 0, 0}, {0, 0, 1}},
    {{1.75f, 1.25f, 2.25f}, {0.5f, 0, -0.5f}, {0, 0.5f, 0}},
    {{-2.25f, 1.75f, 1.75f}, {0.5f, 0, 0.5f}, {0, 0.5f, 0}},
    {{-1.75f, 2.25f, -2.25f}, {-0.5f, 0, 0.5f}, {0, 0.5f, 0}},
    {{2.25f, 1.5f, -1.75f}, {-0.5f, 0, -0.5f}, {0, 0.5f, 0}},
};

/* Half a degree wide, 12, 15 and 18 degrees high; and the panel above. */
static const wl_light suns[] = {
    {{20.96875f, 4.640625f, -6.109375f},
     {0.0625f, 0, 0.21875f},
     {0, 0.21875f, 0}},
    {{6.90625f, 5.90625f, -21.03125f}, {0.1875f, 0, 0.0625f}, {0, 0.1875f, 0}},
    {{-16.078125f, 7.390625f, -15.921875f},
     {0.15625f, 0, -0.15625f},
     {0, 0.21875f, 0}},
    {{-0.5f, 3, -0.5f}, {1, 0, 0}, {0, 0, 1}},
};

/* The street is in city.ply, 1065 m to the unit, the eye 1.7 m above it. */
static const wl_scene scenes[] = {
    {"workload", 1, {0, 1.75, 2.25}, {0, 0.375, 0}, 0.28, 5, panels},
    {"crowd", 5, {0.5, 0.375, 2.5}, {0, 0.125, 0}, 0.4, 5, panels},
    {"street",
     1,
     {-1171.0 / 4096, 21.0 / 8192, 38.0 / 4096},
     {-606.0 / 4096, 30.0 / 8192, 865.0 / 4096},
     0.35,
     4,
     suns},
};

wl_scene wl_scene_named(const char *name)
{
    for (size_t i = 0; i < sizeof scenes / sizeof scenes[0]; i++)
        if (strcmp(scenes[i].name, name) == 0)
            return scenes[i];
    wl_die("--scene: workload, crowd or street, not '%s'", name);
}

void wl_die(const char *format, ...)
{
    va_list arguments;
    va_start(arguments, format);
    vfprintf(stderr, format, arguments);
    va_end(arguments);
    fputc('\n', stderr);
    exit(1);
}

void *wl_alloc(size_t count, size_t size)
{
    if (size != 0 && count > SIZE_MAX / size)
        wl_die("%zu items of %zu bytes do not fit into memory", count, size);
    void *memory = malloc(count * size > 0 ? count * size : 1);
    if (memory == NULL)
        wl_die("out of memory: %zu bytes", count * size);
    return memory;
}

/* ---- PLY ---------------------------------------------------------------- */

typedef struct ply_property {
    int is_list;
    size_t count_size, size;
    int is_index_like; /* a 4-byte integer */
    char name[32];
} ply_property;

typedef struct ply_element {
    char name[32];
    size_t count;
    int property_count;
    ply_property properties[16];
} ply_element;

static size_t ply_type_size(const char *type, const char *path)
{
    static const struct {
        const char *name;
        size_t size;
    } types[] = {{"char", 1},  {"int8", 1},    {"uchar", 1},  {"uint8", 1},
                 {"short", 2}, {"int16", 2},   {"ushort", 2}, {"uint16", 2},
                 {"int", 4},   {"int32", 4},   {"uint", 4},   {"uint32", 4},
                 {"float", 4}, {"float32", 4}, {"double", 8}, {"float64", 8}};
    for (size_t i = 0; i < sizeof types / sizeof types[0]; i++)
        if (strcmp(type, types[i].name) == 0)
            return types[i].size;
    wl_die("%s: unknown PLY type %s", path, type);
}

static int ply_is_float32(const char *type)
{
    return strcmp(type, "float") == 0 || strcmp(type, "float32") == 0;
}

static int ply_is_int32(const char *type)
{
    return strcmp(type, "int") == 0 || strcmp(type, "int32") == 0 ||
           strcmp(type, "uint") == 0 || strcmp(type, "uint32") == 0;
}

static int ply_header(FILE *file, const char *path, ply_element elements[4])
{
    char line[256], a[32], b[32], c[32], d[32];
    int element_count = 0, little_endian = 0;
    if (fgets(line, sizeof line, file) == NULL || strncmp(line, "ply", 3) != 0)
        wl_die("%s: not a PLY file", path);
    for (;;) {
        if (fgets(line, sizeof line, file) == NULL)
            wl_die("%s: the PLY header does not end", path);
        int words = sscanf(line, "%31s %31s %31s %31s", a, b, c, d);
        if (words >= 1 && strcmp(a, "end_header") == 0)
            break;
        if (words >= 2 && strcmp(a, "format") == 0)
            little_endian = strcmp(b, "binary_little_endian") == 0;
        if (words >= 3 && strcmp(a, "element") == 0) {
            if (element_count == 4)
                wl_die("%s: more than 4 PLY elements", path);
            ply_element *element = &elements[element_count++];
            memset(element, 0, sizeof *element);
            memcpy(element->name, b, sizeof b);
            element->count = (size_t)strtoull(c, NULL, 10);
        }
        if (words >= 3 && strcmp(a, "property") == 0) {
            if (element_count == 0)
                wl_die("%s: a PLY property without an element", path);
            ply_element *element = &elements[element_count - 1];
            if (element->property_count == 16)
                wl_die("%s: more than 16 PLY properties", path);
            ply_property *property =
                &element->properties[element->property_count++];
            if (strcmp(b, "list") == 0) {
                property->is_list = 1;
                property->count_size = ply_type_size(c, path);
                property->size = ply_type_size(d, path);
                property->is_index_like = ply_is_int32(d);
                if (sscanf(line, "%*s %*s %*s %*s %31s", property->name) != 1)
                    wl_die("%s: a PLY list without a name", path);
            } else {
                property->size = ply_type_size(b, path);
                memcpy(property->name, c, sizeof c);
                if (strlen(c) == 1 && c[0] >= 'x' && c[0] <= 'z' &&
                    strcmp(element->name, "vertex") == 0 && !ply_is_float32(b))
                    wl_die("%s: positions are not float32", path);
            }
        }
    }
    if (!little_endian)
        wl_die("%s: not a binary little-endian PLY", path);
    return element_count;
}

static void ply_take(FILE *file, const char *path, void *to, size_t size)
{
    if (fread(to, 1, size, file) != size)
        wl_die("%s: the file ends too early", path);
}

static void ply_vertices(FILE *file, const char *path,
                         const ply_element *element, wl_mesh *mesh)
{
    size_t stride = 0, offset[3] = {SIZE_MAX, SIZE_MAX, SIZE_MAX};
    for (int i = 0; i < element->property_count; i++) {
        const ply_property *property = &element->properties[i];
        if (property->is_list)
            wl_die("%s: a list among the vertices", path);
        if (strlen(property->name) == 1 && property->name[0] >= 'x' &&
            property->name[0] <= 'z')
            offset[property->name[0] - 'x'] = stride;
        stride += property->size;
    }
    for (int i = 0; i < 3; i++)
        if (offset[i] == SIZE_MAX)
            wl_die("%s: vertices without x, y, z", path);
    unsigned char *row = wl_alloc(stride, 1);
    mesh->vertex_count = element->count;
    mesh->vertices = wl_alloc(element->count + 4, sizeof *mesh->vertices);
    for (size_t v = 0; v < element->count; v++) {
        ply_take(file, path, row, stride);
        for (int i = 0; i < 3; i++)
            memcpy(&mesh->vertices[v][i], row + offset[i], sizeof(float));
    }
    free(row);
}

static void ply_faces(FILE *file, const char *path, const ply_element *element,
                      wl_mesh *mesh)
{
    size_t capacity = element->count + 2;
    mesh->faces = wl_alloc(capacity, sizeof *mesh->faces);
    for (size_t f = 0; f < element->count; f++) {
        for (int i = 0; i < element->property_count; i++) {
            const ply_property *property = &element->properties[i];
            unsigned char skipped[8];
            if (!property->is_list) {
                ply_take(file, path, skipped, property->size);
                continue;
            }
            uint32_t corners = 0, corner[3] = {0, 0, 0};
            if (property->count_size > 4)
                wl_die("%s: a PLY list counted in float64", path);
            ply_take(file, path, &corners, property->count_size);
            int is_face = strncmp(property->name, "vertex_ind", 10) == 0;
            if (is_face && !property->is_index_like)
                wl_die("%s: indices are not int32", path);
            for (uint32_t j = 0; j < corners; j++) {
                if (!is_face) {
                    ply_take(file, path, skipped, property->size);
                    continue;
                }
                ply_take(file, path, &corner[j < 2 ? j : 2], 4);
                if (corner[j < 2 ? j : 2] >= mesh->vertex_count)
                    wl_die("%s: face %zu: no such vertex", path, f);
                if (j < 2)
                    continue;
                if (mesh->face_count + 2 >= capacity) {
                    capacity += capacity / 2;
                    mesh->faces =
                        realloc(mesh->faces, capacity * sizeof *mesh->faces);
                    if (mesh->faces == NULL)
                        wl_die("out of memory");
                }
                memcpy(mesh->faces[mesh->face_count++], corner, sizeof corner);
                corner[1] = corner[2];
            }
        }
    }
}

void wl_mesh_bounds(const wl_mesh *mesh, double lower[3], double upper[3])
{
    for (int i = 0; i < 3; i++) {
        lower[i] = HUGE_VAL;
        upper[i] = -HUGE_VAL;
    }
    for (size_t f = 0; f < mesh->face_count; f++)
        for (int j = 0; j < 3; j++)
            for (int i = 0; i < 3; i++) {
                double x = (double)mesh->vertices[mesh->faces[f][j]][i];
                lower[i] = x < lower[i] ? x : lower[i];
                upper[i] = x > upper[i] ? x : upper[i];
            }
}

static void normalise(wl_mesh *mesh, const char *path)
{
    double lower[3], upper[3];
    wl_mesh_bounds(mesh, lower, upper);
    double extent = 0;
    for (int i = 0; i < 3; i++)
        extent = upper[i] - lower[i] > extent ? upper[i] - lower[i] : extent;
    if (!(extent > 0))
        wl_die("%s: the mesh has no extent", path);
    double scale = 1.0 / extent;
    double centre[3] = {(lower[0] + upper[0]) * 0.5, lower[1],
                        (lower[2] + upper[2]) * 0.5};
    for (size_t v = 0; v < mesh->vertex_count; v++)
        for (int i = 0; i < 3; i++)
            mesh->vertices[v][i] =
                (float)(((double)mesh->vertices[v][i] - centre[i]) * scale);
}

/* Translated copies in rows, along x first, apart by 1/4 of the mesh's extent;
 * equal positions stay equal, so closed meshes stay closed. */
static void place_copies(wl_mesh *mesh, wl_scene *scene)
{
    double lower[3], upper[3];
    size_t n = (size_t)scene->copies, nv = mesh->vertex_count;
    size_t nf = mesh->face_count;
    if (n == 1)
        return;
    if (n * n > (UINT32_MAX - 4) / nv)
        wl_die("%zu copies of %zu vertices are too many", n * n, nv);
    wl_mesh_bounds(mesh, lower, upper);
    double step_x = 1.25 * (upper[0] - lower[0]);
    double step_z = 1.25 * (upper[2] - lower[2]);
    wl_mesh all = {n * n * nv, n * n * nf,
                   wl_alloc(n * n * nv + 4, sizeof *all.vertices),
                   wl_alloc(n * n * nf + 2, sizeof *all.faces)};
    for (size_t copy = 0; copy < n * n; copy++) {
        float dx = (float)(((double)(copy % n) - (double)(n / 2)) * step_x);
        float dz = (float)(((double)(copy / n) - (double)(n / 2)) * step_z);
        for (size_t v = 0; v < nv; v++) {
            float *to = all.vertices[copy * nv + v];
            to[0] = mesh->vertices[v][0] + dx;
            to[1] = mesh->vertices[v][1];
            to[2] = mesh->vertices[v][2] + dz;
        }
        for (size_t f = 0; f < nf; f++)
            for (int j = 0; j < 3; j++)
                all.faces[copy * nf + f][j] =
                    mesh->faces[f][j] + (uint32_t)(copy * nv);
    }
    wl_mesh_free(mesh);
    *mesh = all;
    scene->eye[0] = (double)(float)(scene->eye[0] * step_x);
    scene->eye[2] = (double)(float)(scene->eye[2] * step_z);
    scene->target[0] *= step_x;
    scene->target[2] *= step_z;
}

static void add_ground(wl_mesh *mesh)
{
    static const float corners[4][3] = {
        {-16, 0, -16}, {16, 0, -16}, {16, 0, 16}, {-16, 0, 16}};
    uint32_t b = (uint32_t)mesh->vertex_count;
    const uint32_t faces[2][3] = {{b, b + 2, b + 1}, {b, b + 3, b + 2}};
    memcpy(mesh->vertices[mesh->vertex_count], corners, sizeof corners);
    memcpy(mesh->faces[mesh->face_count], faces, sizeof faces);
}

wl_mesh wl_mesh_load(const char *path, wl_scene *scene)
{
    wl_mesh mesh = {0, 0, NULL, NULL};
    ply_element elements[4];
    FILE *file = fopen(path, "rb");
    if (file == NULL)
        wl_die("%s: cannot be opened", path);
    int count = ply_header(file, path, elements);
    for (int i = 0; i < count && mesh.faces == NULL; i++) {
        if (strcmp(elements[i].name, "vertex") == 0)
            ply_vertices(file, path, &elements[i], &mesh);
        else if (strcmp(elements[i].name, "face") == 0 && mesh.vertices != NULL)
            ply_faces(file, path, &elements[i], &mesh);
        else if (elements[i].count > 0)
            wl_die("%s: unexpected PLY element %s", path, elements[i].name);
    }
    fclose(file);
    if (mesh.faces == NULL || mesh.face_count == 0)
        wl_die("%s: no triangles", path);
    normalise(&mesh, path);
    place_copies(&mesh, scene);
    add_ground(&mesh);
    return mesh;
}

void wl_mesh_free(wl_mesh *mesh)
{
    free(mesh->vertices);
    free(mesh->faces);
    memset(mesh, 0, sizeof *mesh);
}

/* ---- camera and shading points ------------------------------------------ */

static double dot(const double a[3], const double b[3])
{
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

static void cross(const double a[3], const double b[3], double out[3])
{
    out[0] = a[1] * b[2] - a[2] * b[1];
    out[1] = a[2] * b[0] - a[0] * b[2];
    out[2] = a[0] * b[1] - a[1] * b[0];
}

typedef struct camera {
    double eye[3], forward[3], right[3], up[3], tan_half_fov;
} camera;

static camera camera_make(const wl_scene *scene)
{
    camera c;
    double to[3], length;
    memcpy(c.eye, scene->eye, sizeof c.eye);
    c.tan_half_fov = scene->tan_half_fov;
    for (int i = 0; i < 3; i++)
        to[i] = scene->target[i] - scene->eye[i];
    length = sqrt(dot(to, to));
    for (int i = 0; i < 3; i++)
        c.forward[i] = to[i] / length;
    const double *f = c.forward;
    length = sqrt(f[2] * f[2] + f[0] * f[0]);
    c.right[0] = -f[2] / length;
    c.right[1] = 0;
    c.right[2] = f[0] / length;
    cross(c.right, c.forward, c.up);
    return c;
}

static void camera_direction(const camera *c, uint32_t x, uint32_t y,
                             uint32_t width, uint32_t height, float d[3])
{
    double w = width, h = height;
    double sx = ((x + 0.5) / w * 2 - 1) * c->tan_half_fov * (w / h);
    double sy = (1 - (y + 0.5) / h * 2) * c->tan_half_fov;
    for (int i = 0; i < 3; i++)
        d[i] = (float)(c->forward[i] + sx * c->right[i] + sy * c->up[i]);
}

static void shade(const wl_mesh *mesh, const double eye[3], int32_t face,
                  const float d[3], float on[6])
{
    const uint32_t *corners = mesh->faces[face];
    double a[3], ab[3], ac[3], ae[3], n[3], dd[3];
    for (int i = 0; i < 3; i++) {
        a[i] = (double)mesh->vertices[corners[0]][i];
        ab[i] = (double)mesh->vertices[corners[1]][i] - a[i];
        ac[i] = (double)mesh->vertices[corners[2]][i] - a[i];
        ae[i] = a[i] - eye[i];
        dd[i] = (double)d[i];
    }
    cross(ab, ac, n);
    double length = sqrt(dot(n, n));
    for (int i = 0; i < 3; i++)
        n[i] /= length;
    double t = dot(ae, n) / dot(dd, n);
    double sign = dot(dd, n) > 0 ? -1 : 1;
    for (int i = 0; i < 3; i++) {
        on[i] = (float)(eye[i] + t * dd[i] + (double)1e-4f * sign * n[i]);
        on[3 + i] = (float)(sign * n[i]);
    }
}

wl_gbuffer wl_gbuffer_make(const wl_mesh *mesh, const wl_scene *scene,
                           uint32_t width, uint32_t height,
                           wl_closest_fn closest, void *user)
{
    size_t pixels = (size_t)width * height;
    wl_gbuffer g = {width, height, wl_alloc(pixels, sizeof *g.on),
                    wl_alloc(pixels, sizeof *g.prim)};
    float (*org)[3] = wl_alloc(width, sizeof *org);
    float (*dir)[3] = wl_alloc(width, sizeof *dir);
    camera c = camera_make(scene);
    for (uint32_t y = 0; y < height; y++) {
        size_t row = (size_t)y * width;
        for (uint32_t x = 0; x < width; x++) {
            for (int i = 0; i < 3; i++)
                org[x][i] = (float)c.eye[i];
            camera_direction(&c, x, y, width, height, dir[x]);
        }
        closest(user, width, (const float (*)[3])org, (const float (*)[3])dir,
                g.prim + row);
        for (uint32_t x = 0; x < width; x++) {
            if (g.prim[row + x] < 0)
                memset(g.on[row + x], 0, sizeof g.on[0]);
            else
                shade(mesh, c.eye, g.prim[row + x], dir[x], g.on[row + x]);
        }
    }
    free(org);
    free(dir);
    return g;
}

static const char gbuffer_magic[8] = {'V', 'O', 'C', 'C', 'G', 'B', 'F', '1'};

int wl_gbuffer_load(wl_gbuffer *g, const char *path)
{
    FILE *file = fopen(path, "rb");
    if (file == NULL)
        return 0;
    char magic[8];
    uint32_t size[2];
    if (fread(magic, 1, 8, file) != 8 || memcmp(magic, gbuffer_magic, 8) != 0 ||
        fread(size, 4, 2, file) != 2)
        wl_die("%s: not a G-buffer", path);
    g->width = size[0];
    g->height = size[1];
    size_t pixels = (size_t)g->width * g->height;
    g->on = wl_alloc(pixels, sizeof *g->on);
    g->prim = wl_alloc(pixels, sizeof *g->prim);
    if (fread(g->on, sizeof *g->on, pixels, file) != pixels ||
        fread(g->prim, sizeof *g->prim, pixels, file) != pixels)
        wl_die("%s: the file ends too early", path);
    fclose(file);
    return 1;
}

void wl_gbuffer_save(const wl_gbuffer *g, const char *path)
{
    FILE *file = fopen(path, "wb");
    const uint32_t size[2] = {g->width, g->height};
    size_t pixels = (size_t)g->width * g->height;
    if (file == NULL || fwrite(gbuffer_magic, 1, 8, file) != 8 ||
        fwrite(size, 4, 2, file) != 2 ||
        fwrite(g->on, sizeof *g->on, pixels, file) != pixels ||
        fwrite(g->prim, sizeof *g->prim, pixels, file) != pixels ||
        fclose(file) != 0)
        wl_die("%s: cannot be written", path);
}

void wl_gbuffer_free(wl_gbuffer *g)
{
    free(g->on);
    free(g->prim);
    memset(g, 0, sizeof *g);
}

/* ---- samples ------------------------------------------------------------ */

void wl_sampler_init(wl_sampler *sampler, uint32_t samples,
                     const wl_light *lights)
{
    if (samples < 1 || samples > WL_MAX_SAMPLES)
        wl_die("samples: 1 to %d, not %u", (int)WL_MAX_SAMPLES, samples);
    uint32_t nv = (uint32_t)sqrt((double)samples);
    while (samples % nv != 0)
        nv--;
    sampler->lights = lights;
    sampler->samples = samples;
    sampler->nv = nv;
    sampler->nu = samples / nv;
    sampler->inv_nu = 1.0f / (float)sampler->nu;
    sampler->inv_nv = 1.0f / (float)sampler->nv;
    for (uint32_t s = 0; s < samples; s++) {
        sampler->i[s] = (float)(s % sampler->nu);
        sampler->j[s] = (float)(s / sampler->nu);
    }
}

int wl_facing(const wl_light *light, const float on[6])
{
    double sum = 0;
    for (int i = 0; i < 3; i++) {
        double centre = (double)light->corner[i] +
                        (double)light->edge_u[i] / 2 +
                        (double)light->edge_v[i] / 2;
        sum += (double)on[3 + i] * (centre - (double)on[i]);
    }
    return sum > 0;
}

static inline uint32_t hash32(uint32_t x)
{
    x ^= x >> 16;
    x *= 0x7feb352du;
    x ^= x >> 15;
    x *= 0x846ca68bu;
    x ^= x >> 16;
    return x;
}

/* The 16-bit halves go through int32 because that is what SIMD converts. */
static inline float jitter(uint32_t half)
{
    return (float)(int32_t)half * (1.0f / 65536);
}

void wl_directions(const wl_sampler *sampler, int k, uint32_t p,
                   const float org[3], float *restrict dx, float *restrict dy,
                   float *restrict dz)
{
    const wl_light *l = &sampler->lights[k];
    uint32_t key = p * 2048u + (uint32_t)k * 256u;
    float inv_nu = sampler->inv_nu, inv_nv = sampler->inv_nv;
    for (uint32_t s = 0; s < sampler->samples; s++) {
        uint32_t h = hash32(key + s);
        float a = (sampler->i[s] + jitter(h & 0xffff)) * inv_nu;
        float b = (sampler->j[s] + jitter(h >> 16)) * inv_nv;
        dx[s] = ((l->corner[0] + a * l->edge_u[0]) + b * l->edge_v[0]) - org[0];
        dy[s] = ((l->corner[1] + a * l->edge_u[1]) + b * l->edge_v[1]) - org[1];
        dz[s] = ((l->corner[2] + a * l->edge_u[2]) + b * l->edge_v[2]) - org[2];
    }
}

void wl_directions_of_sample(const wl_sampler *sampler, int k, uint32_t s,
                             size_t lanes, const uint32_t *restrict p,
                             const float *restrict ox, const float *restrict oy,
                             const float *restrict oz, float *restrict dx,
                             float *restrict dy, float *restrict dz)
{
    const wl_light *l = &sampler->lights[k];
    float i = sampler->i[s], j = sampler->j[s];
    float inv_nu = sampler->inv_nu, inv_nv = sampler->inv_nv;
    for (size_t n = 0; n < lanes; n++) {
        uint32_t h = hash32(p[n] * 2048u + (uint32_t)k * 256u + s);
        float a = (i + jitter(h & 0xffff)) * inv_nu;
        float b = (j + jitter(h >> 16)) * inv_nv;
        dx[n] = ((l->corner[0] + a * l->edge_u[0]) + b * l->edge_v[0]) - ox[n];
        dy[n] = ((l->corner[1] + a * l->edge_u[1]) + b * l->edge_v[1]) - oy[n];
        dz[n] = ((l->corner[2] + a * l->edge_u[2]) + b * l->edge_v[2]) - oz[n];
    }
}

/* ---- tiles and hash ----------------------------------------------------- */

size_t wl_tiles(uint32_t width, uint32_t height, size_t limit,
                uint32_t (**corners)[2])
{
    size_t across = (width + WL_TILE - 1) / WL_TILE;
    size_t all = across * ((height + WL_TILE - 1) / WL_TILE);
    size_t count = limit > 0 && limit < all ? limit : all;
    *corners = wl_alloc(count, sizeof **corners);
    for (size_t i = 0; i < count; i++) {
        size_t tile = (2 * i + 1) * all / (2 * count);
        (*corners)[i][0] = (uint32_t)(tile % across) * WL_TILE;
        (*corners)[i][1] = (uint32_t)(tile / across) * WL_TILE;
    }
    return count;
}

uint32_t wl_hash32(uint32_t x)
{
    return hash32(x);
}

uint64_t wl_hash(const uint8_t *bytes, size_t count)
{
    uint64_t hash = 0xcbf29ce484222325u;
    for (size_t i = 0; i < count; i++)
        hash = (hash ^ bytes[i]) * 0x100000001b3u;
    return hash;
}
