"""The check against Cycles: it agrees where it should, would notice, and leaves nothing behind."""

from __future__ import annotations

from importlib import import_module
from types import ModuleType
from typing import Any

import bpy
import numpy as np
import pytest


@pytest.fixture
def cycles_check(addon: ModuleType) -> ModuleType:
    return import_module(f"{addon.__name__}.cycles_check")


@pytest.fixture
def scene(addon: ModuleType, empty: bpy.types.Scene) -> bpy.types.Scene:
    """Closed solids, one shaded smooth, on a floor of emitting matter; a lens out of focus."""
    empty.render.engine = "CYCLES"
    empty.render.resolution_x, empty.render.resolution_y = 640, 480
    bpy.ops.mesh.primitive_plane_add(size=10)
    floor = bpy.context.object
    floor.name = "Floor"
    glow = bpy.data.materials.new("Glow")
    if bpy.app.version < (5, 0):
        glow.use_nodes = True
    shader = glow.node_tree.nodes["Principled BSDF"]
    shader.inputs["Emission Strength"].default_value = 2.0
    floor.data.materials.append(glow)
    bpy.ops.mesh.primitive_uv_sphere_add(radius=0.8, location=(-1, 0, 1))
    bpy.ops.object.shade_smooth()
    bpy.ops.mesh.primitive_cube_add(size=1.2, location=(1, 0, 1))
    for index, (name, kind) in enumerate((("Area", "AREA"), ("Point", "POINT"), ("Sun", "SUN"))):
        data = bpy.data.lights.new(name, kind)
        data.energy = 2.0 if kind == "SUN" else 200.0
        if kind == "SUN":
            data.angle = 0.3
        elif kind == "AREA":
            data.size = 1.5
        else:
            data.shadow_soft_size = 0.5
        light = bpy.data.objects.new(name, data)
        light.location, light.rotation_euler.x = (index - 1.0, -1, 5), 0.2
        empty.collection.objects.link(light)
    camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    camera.location, camera.rotation_euler.x = (0, -5, 6), 0.7
    camera.data.dof.use_dof, camera.data.dof.aperture_fstop = True, 0.1
    empty.collection.objects.link(camera)
    empty.camera = camera
    return empty


def state() -> Any:
    """What a check must not change."""
    blocks = {
        kind: sorted(each.name for each in getattr(bpy.data, kind))
        for kind in ("scenes", "objects", "materials", "collections", "meshes", "lights")
    }
    lights = sorted(
        (
            each.name,
            each.hide_render,
            each.visible_camera,
            each.data.use_shadow,
        )
        for each in bpy.data.objects
        if each.type == "LIGHT"
    )
    meshes = sorted(
        (each.name, each.visible_shadow, each.shadow_terminator_geometry_offset)
        for each in bpy.data.objects
        if each.type == "MESH"
    )
    camera = bpy.context.scene.camera
    return blocks, lights, meshes, camera.data.dof.use_dof, bpy.context.scene.render.engine


def run(cycles_check: ModuleType, scene: Any, *args: Any, **options: Any) -> list[Any]:
    found: list[Any] = []
    fractions = list(cycles_check.check(scene, *args, found=found, **options))
    assert fractions == sorted(fractions) and fractions[-1] == 1.0
    return found


def test_agrees_and_leaves_nothing(cycles_check: ModuleType, scene: Any) -> None:
    before = state()
    found = run(cycles_check, scene, size=80, samples=128)
    assert state() == before
    assert [each.light for each in found] == ["Area", "Point", "Sun"]
    for each in found:
        assert each.pixels > 2000 and each.mask.shape == (60, 80)
        assert np.nanmin(each.ratio) < 0.05 and np.nanmax(each.mask) == 1.0
        assert each.rms < 0.02, each.line()
        assert 0.001 < each.noise < 0.02, each.line()
    assert cycles_check.LAST[scene.name] == tuple(found)


def test_would_notice(cycles_check: ModuleType, scene: Any) -> None:
    scene.vocc.use_auto_offset, scene.vocc.offset = False, 0.5
    (found,) = run(cycles_check, scene, [bpy.data.objects["Sun"]], size=48, samples=64)
    assert found.rms > 0.04 and found.largest > 0.5


def test_light_in_the_picture(cycles_check: ModuleType, scene: Any) -> None:
    """Cycles would show it, far brighter than what it lights."""
    light = bpy.data.objects["Point"]
    light.location, light.visible_camera = (0, 0, 2), True
    (found,) = run(cycles_check, scene, [light], size=48, samples=64)
    assert found.pixels > 500 and found.rms < 0.05
    assert light.visible_camera


def test_excluded_objects_cast_in_neither(cycles_check: ModuleType, scene: Any) -> None:
    bpy.data.objects["Sphere"].vocc.exclude = True
    (found,) = run(cycles_check, scene, [bpy.data.objects["Area"]], size=48, samples=64)
    assert found.rms < 0.03
    assert bpy.data.objects["Sphere"].visible_shadow


def test_border(cycles_check: ModuleType, scene: Any) -> None:
    r = scene.render
    r.use_border = True
    r.border_min_x, r.border_max_x, r.border_min_y, r.border_max_y = 0.25, 0.75, 0.25, 0.5
    (found,) = run(cycles_check, scene, [bpy.data.objects["Area"]], size=40, samples=64)
    assert found.mask.shape == (15, 40)
    assert found.rms < 0.03 and np.nanmin(found.ratio) < 0.3


def test_stopped_between_steps(cycles_check: ModuleType, scene: Any) -> None:
    before = state()
    steps = cycles_check.check(scene, size=32, samples=64)
    next(steps)
    assert state() != before
    steps.close()
    assert state() == before


def test_light_that_lights_nothing(cycles_check: ModuleType, scene: Any) -> None:
    light = bpy.data.objects["Area"]
    light.rotation_euler.x = np.pi
    (found,) = run(cycles_check, scene, [light], size=32, samples=64)
    assert found.pixels == 0
    assert found.line() == "Area: lights nothing that the camera sees"


def test_show(cycles_check: ModuleType, scene: Any) -> None:
    mask = np.array([[0.0, 0.5, np.nan]], np.float32)
    ratio = np.array([[0.0, 0.25, np.nan]], np.float32)
    comparison = cycles_check.Comparison("Key", 0, 0, 0, 2, mask, ratio)
    image = cycles_check.show(comparison)
    assert cycles_check.show(comparison) == image and tuple(image.size) == (9, 1)
    pixels = np.array(image.pixels[:], np.float32).reshape(9, 4)
    np.testing.assert_allclose(pixels[:, 0], [0, 0.25, 0, 0, 0.5, 0, 0, 1.0, 0])
    np.testing.assert_allclose(pixels[2::3, 2], 0.2)


@pytest.mark.parametrize(
    ("break_it", "text"),
    [
        (lambda scene: setattr(scene, "camera", None), "has no camera"),
        (lambda scene: setattr(scene.camera.data, "type", "PANO"), "perspective"),
        (
            lambda scene: [setattr(each, "use_shadow", False) for each in bpy.data.lights],
            "no light that casts a shadow",
        ),
    ],
)
def test_scenes_that_cannot_be_checked(
    cycles_check: ModuleType, scene: Any, break_it: Any, text: str
) -> None:
    break_it(scene)
    with pytest.raises(cycles_check.CheckError, match=text):
        next(cycles_check.check(scene))
    assert len(bpy.data.scenes) == 1
