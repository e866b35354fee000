"""A scene for measurements, made by a seeded script: subdivided solids, instances, four lights."""

from __future__ import annotations

import math
import random

import bmesh
import bpy
from mathutils import Vector, noise

SOLIDS = 4  # different meshes
# 6 x 16 x 16 quads, each 32 triangles after two levels: 49 152 for each solid.
CUTS = 15
SUBDIVISIONS = 2
GRID = 4  # solids along an edge, each with a modifier of its own
CLUSTERS = 3  # instances of a collection of all the different solids

# Name, shape, size, place. All look at the middle.
LIGHTS = (
    ("Key", "SQUARE", (2.0, 2.0), (7.0, -6.0, 9.0)),
    ("Fill", "RECTANGLE", (4.0, 1.0), (-8.0, -5.0, 7.0)),
    ("Rim", "DISK", (3.0, 3.0), (-4.0, 9.0, 8.0)),
    ("Top", "ELLIPSE", (3.0, 1.5), (2.0, 1.0, 12.0)),
)


def make_scene(seed: int) -> bpy.types.Scene:
    """The scene of a new file: about 1.4 million triangles on a floor."""
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    scene = bpy.context.scene
    random_numbers = random.Random(seed)
    meshes = [_solid(f"Solid {i}", random_numbers) for i in range(SOLIDS)]

    bpy.ops.mesh.primitive_plane_add(size=60.0)
    for i in range(GRID * GRID):
        place = Vector((2.4 * (i % GRID) - 3.6, 2.4 * (i // GRID) - 3.6, 1.0))
        _place(scene.collection, meshes[i % SOLIDS], place, random_numbers)

    cluster = bpy.data.collections.new("Cluster")
    for i, mesh in enumerate(meshes):
        _place(cluster, mesh, Vector((1.6 * (i % 2), 1.6 * (i // 2), 0.7)), random_numbers)
    for i in range(CLUSTERS):
        empty = bpy.data.objects.new(f"Cluster {i}", None)
        empty.instance_type = "COLLECTION"
        empty.instance_collection = cluster
        angle = math.tau * i / CLUSTERS
        empty.location = (8.0 * math.cos(angle), 8.0 * math.sin(angle), 0.0)
        empty.rotation_euler.z = random_numbers.uniform(0.0, math.tau)
        scene.collection.objects.link(empty)

    for name, shape, size, place in LIGHTS:
        light = bpy.data.lights.new(name, "AREA")
        light.shape, light.size, light.size_y = shape, *size
        light.energy = 500.0
        _add(scene, bpy.data.objects.new(name, light), place, (0.0, 0.0, 0.5))
    camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    _add(scene, camera, (0.0, -17.0, 11.0), (0.0, 0.0, 0.0))
    scene.camera = camera
    return scene


def _solid(name: str, random_numbers: random.Random) -> bpy.types.Mesh:
    """A sphere of quads with bumps."""
    bpy.ops.mesh.primitive_cube_add()
    cube = bpy.context.object
    mesh = cube.data
    mesh.name = name
    bpy.data.objects.remove(cube)
    shape = bmesh.new()
    shape.from_mesh(mesh)
    bmesh.ops.subdivide_edges(shape, edges=shape.edges, cuts=CUTS, use_grid_fill=True)
    where = Vector([random_numbers.uniform(-50.0, 50.0) for _ in range(3)])
    for vertex in shape.verts:
        vertex.co.normalize()
        vertex.co *= 0.8 + 0.3 * noise.fractal(1.5 * vertex.co + where, 1.0, 2.0, 3)
    shape.to_mesh(mesh)
    shape.free()
    return mesh


def _place(
    collection: bpy.types.Collection,
    mesh: bpy.types.Mesh,
    place: Vector,
    random_numbers: random.Random,
) -> None:
    solid = bpy.data.objects.new(mesh.name, mesh)
    modifier = solid.modifiers.new("Subdivision", "SUBSURF")
    modifier.levels = modifier.render_levels = SUBDIVISIONS
    solid.location = place
    solid.rotation_euler = [random_numbers.uniform(0.0, math.tau) for _ in range(3)]
    collection.objects.link(solid)


def _add(
    scene: bpy.types.Scene,
    added: bpy.types.Object,
    place: tuple[float, float, float],
    target: tuple[float, float, float],
) -> None:
    """An object there that looks at a point."""
    added.location = place
    direction = Vector(target) - Vector(place)
    added.rotation_euler = direction.to_track_quat("-Z", "Y").to_euler()
    scene.collection.objects.link(added)
