"""Bakes by Blender's own operator: values against pyvocc at the places that the texels show."""

from __future__ import annotations

from collections.abc import Sequence
from types import ModuleType
from typing import Any

import bpy
import numpy as np
import pytest
from numpy.typing import NDArray

import pyvocc

SAMPLES = 64
TEXELS = 32
OFFSET = 1e-4
SIZE = 4.0

# Blender looks at a texel up to 0.002 of its size beside its centre: few samples change.
MEAN_ERROR, LARGEST_ERROR = 0.002, 0.07


@pytest.fixture
def scene(addon: ModuleType, empty: bpy.types.Scene) -> bpy.types.Scene:
    """Two area lights over a small box; rendered by the add-on's engine."""
    empty.render.engine = "VOCC"
    empty.vocc.bake_samples = SAMPLES
    empty.vocc.use_auto_offset, empty.vocc.offset = False, OFFSET
    for name, x in (("Key", -1.5), ("Fill", 1.0)):
        data = bpy.data.lights.new(name, "AREA")
        data.size = 0.5
        light = bpy.data.objects.new(name, data)
        light.location = (x, 0, 4)
        empty.collection.objects.link(light)
    bpy.ops.mesh.primitive_cube_add(size=1, location=(0, 0, 1.5))
    bpy.context.object.name = "Box"
    bpy.context.object.select_set(False)
    return empty


def add_floor(name: str = "Floor", place: Sequence[float] = (0, 0, 0)) -> Any:
    """A square of SIZE whose UVs are its x and y, with an image to bake to; selected."""
    bpy.ops.mesh.primitive_plane_add(size=SIZE, location=place)
    floor = bpy.context.object
    floor.name = name
    set_image(floor)
    return floor


def set_image(obj: Any) -> Any:
    image = bpy.data.images.new(obj.name, TEXELS, TEXELS, float_buffer=True, is_data=True)
    material = bpy.data.materials.new(obj.name)
    if bpy.app.version < (5, 0):
        material.use_nodes = True
    node = material.node_tree.nodes.new("ShaderNodeTexImage")
    node.image = image
    material.node_tree.nodes.active = node
    obj.data.materials.clear()
    obj.data.materials.append(material)
    return image


def baked(name: str = "Floor") -> NDArray[np.float32]:
    """(TEXELS, TEXELS), the lowest row first; the image must be grey and opaque."""
    pixels = np.empty(TEXELS * TEXELS * 4, np.float32)
    bpy.data.images[name].pixels.foreach_get(pixels)
    pixels = pixels.reshape(TEXELS, TEXELS, 4)
    assert np.isfinite(pixels).all()
    np.testing.assert_array_equal(pixels[..., 0], pixels[..., 1])
    np.testing.assert_array_equal(pixels[..., 0], pixels[..., 2])
    return pixels[..., 0]


def bake(kind: str = "SHADOW", **options: Any) -> None:
    assert bpy.ops.object.bake(type=kind, **{"margin": 0, **options}) == {"FINISHED"}


def box(obj: Any) -> tuple[NDArray[np.float32], NDArray[np.int32]]:
    """Vertices and triangles of a mesh object in the world, by the slow ways of Blender."""
    mesh = obj.data
    mesh.calc_loop_triangles()
    vertices = [obj.matrix_world @ vertex.co for vertex in mesh.vertices]
    triangles = [tuple(each.vertices) for each in mesh.loop_triangles]
    return np.array(vertices, np.float32), np.array(triangles, np.int32)


def casters(*objects: Any) -> pyvocc.Scene:
    built = pyvocc.Scene()
    for obj in objects:
        built.add_mesh(*box(obj))
    built.build()
    return built


def rect(light: Any) -> pyvocc.RectLight:
    size = light.data.size
    x, y, z = light.location
    return pyvocc.RectLight(
        (x - size / 2, y - size / 2, z), (0, size, 0), (size, 0, 0), two_sided=False
    )


def texel_centres(height: float = 0.0) -> NDArray[np.float64]:
    """(TEXELS * TEXELS, 3), of a floor at the origin."""
    centre = ((np.arange(TEXELS) + 0.5) / TEXELS - 0.5) * SIZE
    y, x = np.meshgrid(centre, centre, indexing="ij")
    return np.stack([x, y, np.full_like(x, height + OFFSET)], axis=-1).reshape(-1, 3)


def expected(built: pyvocc.Scene, points: NDArray[Any], *lights: str) -> NDArray[np.float32]:
    """The mean of the lights' masks on a floor that faces up."""
    found = [rect(bpy.data.objects[name]) for name in sorted(lights)]
    counts = built.light_visibility(points, (0, 0, 1), found, SAMPLES)
    assert (counts != pyvocc.NOT_TRACED).all()
    return (counts.astype(np.float32) / SAMPLES).mean(axis=0).reshape(TEXELS, -1)


def assert_close(got: NDArray[np.float32], wanted: NDArray[np.float32]) -> None:
    assert wanted.min() < 0.1 and wanted.max() == 1.0, "the test needs shadow and light"
    error = np.abs(got - wanted)
    assert error.mean() < MEAN_ERROR and error.max() < LARGEST_ERROR, (error.mean(), error.max())


def test_image(scene: Any) -> None:
    floor = add_floor()
    bake()
    built = casters(floor, bpy.data.objects["Box"])
    assert_close(baked(), expected(built, texel_centres(), "Key", "Fill"))


def test_colour_attribute(scene: Any) -> None:
    bpy.ops.mesh.primitive_grid_add(x_subdivisions=16, y_subdivisions=16, size=SIZE)
    grid = bpy.context.object
    colours = grid.data.color_attributes.new("Shadow", "FLOAT_COLOR", "POINT")
    grid.data.attributes.active_color = colours
    scene.render.bake.target = "VERTEX_COLORS"
    bake(target="VERTEX_COLORS")
    got = np.empty((len(grid.data.vertices), 4), np.float32)
    colours.data.foreach_get("color", got.ravel())
    points = box(grid)[0] + np.array((0, 0, OFFSET))
    built = casters(grid, bpy.data.objects["Box"])
    lights = [rect(bpy.data.objects[name]) for name in ("Fill", "Key")]
    # Sample patterns go by the buffer's texel, which is the vertex's corner: compared at many.
    wanted = built.light_visibility(points, (0, 0, 1), lights, 1024).mean(axis=0) / 1024
    inner = (np.abs(points[:, :2]) < SIZE / 2 - 1e-3).all(axis=1)
    error = np.abs(got[inner, 0] - wanted[inner])
    assert wanted.min() < 0.1 and error.mean() < 0.005 and error.max() < 0.1
    np.testing.assert_array_equal(got[:, 0], got[:, 1])


def test_margin(scene: Any) -> None:
    floor = add_floor()
    for each in floor.data.uv_layers.active.data:
        each.uv.x = each.uv.x / 2
    bake(margin=0, use_clear=True)
    half = baked()
    assert not half[:, TEXELS // 2 :].any() and half[:, : TEXELS // 2].mean() > 0.5
    bake(margin=4, use_clear=True)
    wide = baked()
    np.testing.assert_array_equal(wide[:, : TEXELS // 2], half[:, : TEXELS // 2])
    assert (wide[:, TEXELS // 2 : TEXELS // 2 + 4] > 0).mean() > 0.5
    assert not wide[:, TEXELS // 2 + 5 :].any()


def test_several_objects(scene: Any) -> None:
    first, second = add_floor("First"), add_floor("Second", (0, 0, -1))
    first.select_set(True)
    bake()
    built = casters(first, second, bpy.data.objects["Box"])
    assert_close(baked("First"), expected(built, texel_centres(), "Key", "Fill"))
    # The second lies in the shadow of the first.
    wanted = expected(built, texel_centres(-1), "Key", "Fill")
    assert wanted.max() < 1.0
    assert np.abs(baked("Second") - wanted).max() < LARGEST_ERROR


def test_modifiers(scene: Any) -> None:
    floor = add_floor()
    up = floor.modifiers.new("Up", "DISPLACE")
    up.direction, up.strength, up.mid_level = "Z", 0.5, 0.0
    fine = floor.modifiers.new("Fine", "SUBSURF")
    fine.subdivision_type, fine.render_levels, fine.levels = "SIMPLE", 3, 0
    bake()
    floor.location.z = 0.5
    bpy.context.view_layer.update()
    built = casters(floor, bpy.data.objects["Box"])
    assert_close(baked(), expected(built, texel_centres(0.5), "Key", "Fill"))


@pytest.mark.parametrize("scale", [(-1, 1, 1), (1, -1, 1), (-1, -1, 1), (2, 1, 1)])
def test_scale(scene: Any, scale: tuple[float, ...]) -> None:
    floor = add_floor()
    floor.scale = scale
    bake()
    bpy.context.view_layer.update()
    built = casters(floor, bpy.data.objects["Box"])
    points = texel_centres() * (*scale[:2], 1)
    assert_close(baked(), expected(built, points, "Key", "Fill"))


def test_faces_down(scene: Any) -> None:
    """Turned over by its scale, the floor shows the lights its back."""
    floor = add_floor()
    floor.scale.z = -1
    bake()
    assert baked().max() == 0.0


def test_ambient_occlusion(scene: Any) -> None:
    floor = add_floor()
    scene.vocc.ao_distance = 2.0
    bake("AO")
    built = casters(floor, bpy.data.objects["Box"])
    counts = built.ambient_occlusion(texel_centres(), (0, 0, 1), 2.0, SAMPLES)
    wanted = (counts / SAMPLES).reshape(TEXELS, TEXELS)
    assert wanted.min() < 0.8 and wanted.max() == 1.0
    error = np.abs(baked() - wanted)
    assert error.mean() < MEAN_ERROR and error.max() < LARGEST_ERROR


def test_selected_lights(scene: Any) -> None:
    floor = add_floor()
    bpy.data.objects["Key"].select_set(True)
    assert bpy.ops.vocc.bake(type="SHADOW") == {"FINISHED"}
    built = casters(floor, bpy.data.objects["Box"])
    assert_close(baked(), expected(built, texel_centres(), "Key"))
    bpy.data.objects["Key"].select_set(False)
    assert bpy.ops.vocc.bake(type="SHADOW") == {"FINISHED"}
    assert_close(baked(), expected(built, texel_centres(), "Key", "Fill"))


def test_beside_another_engine(scene: Any) -> None:
    """The button bakes through the shadow scene; the selection counts as it is here."""
    scene.render.engine = "CYCLES"
    floor = add_floor()
    assert not bpy.ops.vocc.bake.poll()
    bpy.ops.vocc.setup()
    shadow = next(each for each in bpy.data.scenes if each != scene)
    shadow.vocc.bake_samples = SAMPLES
    shadow.vocc.use_auto_offset, shadow.vocc.offset = False, OFFSET
    built = casters(floor, bpy.data.objects["Box"])
    for light in ("Fill", "Key"):
        for each in scene.objects:
            each.select_set(each.name in ("Floor", light))
        assert bpy.ops.vocc.bake(type="SHADOW") == {"FINISHED"}
        assert_close(baked(), expected(built, texel_centres(), light))
        assert bpy.context.scene == scene and scene.render.engine == "CYCLES"
        assert {each.name for each in bpy.context.selected_objects} == {"Floor", light}


def test_selected_to_active(scene: Any) -> None:
    low = add_floor("Low", (0, 0, -0.5))
    high = add_floor("High")
    high.select_set(True)
    low.select_set(True)
    bpy.context.view_layer.objects.active = low
    bake(use_selected_to_active=True, cage_extrusion=0.0, max_ray_distance=0.0)
    built = casters(low, high, bpy.data.objects["Box"])
    # Without a cage nothing of the high one is found.
    assert baked("Low").max() == 0.0
    bake(use_selected_to_active=True, cage_extrusion=0.7)
    assert_close(baked("Low"), expected(built, texel_centres(), "Key", "Fill"))


def test_no_uv_map(scene: Any) -> None:
    floor = add_floor()
    floor.data.uv_layers.remove(floor.data.uv_layers[0])
    with pytest.raises(RuntimeError, match="No active UV layer"):
        bake()


def test_no_image(scene: Any) -> None:
    add_floor().data.materials.clear()
    with pytest.raises(RuntimeError, match="No active image found, add a material"):
        bake()


def test_no_light(scene: Any) -> None:
    add_floor()
    for name in ("Key", "Fill"):
        bpy.data.objects[name].hide_render = True
    with pytest.raises(RuntimeError, match="There is no light to bake in the scene 'Scene'"):
        bake()


def test_other_kinds(scene: Any) -> None:
    add_floor()
    with pytest.raises(RuntimeError, match="bakes Shadow and Ambient Occlusion, not Diffuse"):
        bake("DIFFUSE")


def test_triangles_without_area(scene: Any) -> None:
    floor = add_floor()
    mesh = bpy.data.meshes.new("Flat")
    mesh.from_pydata([(0, 0, 0), (1, 0, 0), (2, 0, 0)], [], [(0, 1, 2)])
    mesh.uv_layers.new()
    for loop, uv in zip(mesh.uv_layers.active.data, ((0, 0), (1, 0), (0, 1)), strict=True):
        loop.uv = uv
    flat = bpy.data.objects.new("Flat", mesh)
    scene.collection.objects.link(flat)
    set_image(flat)
    floor.select_set(False)
    flat.select_set(True)
    bpy.context.view_layer.objects.active = flat
    bake()
    assert not baked("Flat").any()
