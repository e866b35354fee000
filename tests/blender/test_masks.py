"""Masks of whole scenes: against closed forms, against pyvocc and against Cycles."""

from __future__ import annotations

import math
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import Any

import bpy
import exr
import numpy as np
import pytest
from numpy.typing import NDArray

import pyvocc

# Heights of the lights and of the edge that throws the shadow, and half the size of the lights.
TOP, EDGE, RADIUS = 4.0, 2.0, 1.0
SUN = math.radians(40)

Doubles = NDArray[np.float64]


@pytest.fixture
def scene(addon: ModuleType, empty: bpy.types.Scene) -> bpy.types.Scene:
    empty.render.engine = "VOCC"
    empty.render.resolution_x, empty.render.resolution_y = 48, 36
    empty.vocc.aa = 1
    return empty


def add_camera(scene: Any, place: tuple[float, float, float], **lens: Any) -> Any:
    camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    camera.location = place
    for name, value in lens.items():
        setattr(camera.data, name, value)
    scene.collection.objects.link(camera)
    scene.camera = camera
    return camera


def add_light(scene: Any, kind: str, place: tuple[float, float, float], **values: Any) -> Any:
    light = bpy.data.objects.new("Key", bpy.data.lights.new("Key", kind))
    light.location = place
    light.visible_camera = False
    for name, value in values.items():
        setattr(light.data, name, value)
    scene.collection.objects.link(light)
    return light


# ---- closed forms --------------------------------------------------------------------------------
# A half-plane at height EDGE ends along the y axis; the light is over it at height TOP. What a
# point of the floor sees of the light is cut off by the plane through the point and the edge.


def segment(c: Doubles) -> Doubles:
    """The share of the unit disk where its x is above c."""
    c = np.clip(c, -1, 1)
    return (np.arccos(c) - c * np.sqrt(1 - c * c)) / np.pi


def cap(slope: Doubles, radius: Doubles) -> Doubles:
    """The share of a cone's solid angle on the far side of a plane through its apex.

    Args:
        slope: angle between the plane and the cone's axis, positive where less is cut off.
        radius: half angle of the cone.
    """
    sine = np.clip(np.sin(slope) / np.sin(radius), -1, 1)
    tangent = np.clip(np.tan(slope) / np.tan(radius), -1, 1)
    cut = 2 * np.arccos(sine) - 2 * np.cos(radius) * np.arccos(tangent)
    return cut / (2 * np.pi * (1 - np.cos(radius)))


def slope_of(x: Doubles, y: Doubles, to: tuple[Doubles, Doubles, Doubles]) -> Doubles:
    """Angle of a direction above the plane through (x, y, 0) and the edge."""
    length = np.sqrt(to[0] ** 2 + to[1] ** 2 + to[2] ** 2)
    return np.arcsin((EDGE * to[0] + x * to[2]) / (np.sqrt(EDGE**2 + x**2) * length))


def rectangle(x: Doubles, y: Doubles) -> Doubles:
    first = -x * (TOP - EDGE) / EDGE
    return np.clip((RADIUS - first) / (2 * RADIUS), 0, 1)


def disk(x: Doubles, y: Doubles) -> Doubles:
    return segment(-x * (TOP - EDGE) / EDGE / RADIUS)


def facing_disk(x: Doubles, y: Doubles) -> Doubles:
    distance = np.sqrt(x * x + y * y + TOP**2)
    slope = slope_of(x, y, (-x, -y, np.full_like(x, TOP)))
    return 1 - segment(distance * np.tan(slope) / RADIUS)


def sphere(x: Doubles, y: Doubles) -> Doubles:
    distance = np.sqrt(x * x + y * y + TOP**2)
    slope = slope_of(x, y, (-x, -y, np.full_like(x, TOP)))
    return 1 - cap(slope, np.arcsin(RADIUS / distance))


def sun(x: Doubles, y: Doubles) -> Doubles:
    slope = slope_of(x, y, (np.zeros_like(x), np.zeros_like(x), np.ones_like(x)))
    return 1 - cap(slope, np.full_like(x, SUN / 2))


@pytest.mark.parametrize(
    ("exact", "kind", "values"),
    [
        (rectangle, "AREA", {"shape": "SQUARE", "size": 2 * RADIUS}),
        (rectangle, "AREA", {"shape": "RECTANGLE", "size": 2 * RADIUS, "size_y": 0.5}),
        (disk, "AREA", {"shape": "DISK", "size": 2 * RADIUS}),
        (disk, "AREA", {"shape": "ELLIPSE", "size": 2 * RADIUS, "size_y": 3.0}),
        (facing_disk, "POINT", {"shadow_soft_size": RADIUS, "use_soft_falloff": True}),
        (facing_disk, "SPOT", {"shadow_soft_size": RADIUS, "use_soft_falloff": True}),
        (sphere, "POINT", {"shadow_soft_size": RADIUS, "use_soft_falloff": False}),
        (sun, "SUN", {"angle": SUN}),
    ],
    ids=["square", "rectangle", "disk", "ellipse", "point", "spot", "sphere", "sun"],
)
def test_penumbra(
    scene: Any,
    addon: ModuleType,
    exact: Callable[[Doubles, Doubles], Doubles],
    kind: str,
    values: dict[str, Any],
) -> None:
    bpy.ops.mesh.primitive_plane_add(size=40)
    bpy.ops.mesh.primitive_plane_add(size=40, location=(-20, 0, EDGE))
    bpy.context.object.visible_camera = False
    add_light(scene, kind, (0, 0, TOP), **values)
    add_camera(scene, (0, 0, 10), type="ORTHO", ortho_scale=4.0)
    mask = addon.shadow_masks(scene, samples=1024)["Key"]
    height, width = mask.shape
    x = ((np.arange(width) + 0.5) / width - 0.5) * 4.0
    y = (0.5 - (np.arange(height) + 0.5) / height) * 4.0 * height / width
    wanted = exact(*np.meshgrid(x, y))
    penumbra = (wanted > 0) & (wanted < 1)
    assert np.count_nonzero(penumbra) > 0.2 * mask.size
    assert np.abs(mask - wanted)[penumbra].mean() <= 0.005
    assert np.abs(mask - wanted)[~penumbra].max() <= 0.005


# ---- the same arrays through pyvocc --------------------------------------------------------------


def add_solids() -> list[Any]:
    """A floor, and a few solids above it, moved, turned and mirrored."""
    bpy.ops.mesh.primitive_plane_add(size=12)
    found = [bpy.context.object]
    bpy.ops.mesh.primitive_monkey_add(location=(-0.8, 0.3, 1.3), rotation=(0.3, 0.2, 0.5))
    found.append(bpy.context.object)
    bpy.ops.mesh.primitive_torus_add(location=(1.6, -0.4, 1.0), rotation=(1.0, 0.4, 0))
    bpy.context.object.scale = (-0.8, 0.9, 1.1)
    found.append(bpy.context.object)
    return found


def test_masks_are_those_of_pyvocc(scene: Any, addon: ModuleType, tmp_path: Path) -> None:
    part = {name: import_module(f"{addon.__name__}.{name}") for name in ("camera", "transform")}
    objects = add_solids()
    add_camera(scene, (1, -6, 7), lens=35).rotation_euler = (0.75, 0, 0.15)
    add_light(scene, "AREA", (2, -2, 5), size=1.5)
    scene.vocc.aa, scene.vocc.samples = 2, 32
    made = exr.render(scene, tmp_path / "a.exr")["Shadow Key.X"]

    traced = pyvocc.Scene()
    for obj in objects:
        mesh = obj.data
        mesh.calc_loop_triangles()
        vertices = np.array([vertex.co for vertex in mesh.vertices], np.float32)
        triangles = np.array([triangle.vertices for triangle in mesh.loop_triangles], np.int32)
        matrix = np.array(obj.matrix_world, np.float64)
        traced.add_mesh(part["transform"].to_world(vertices, matrix), triangles)
    traced.build()
    width, height = scene.render.resolution_x, scene.render.resolution_y
    view = part["camera"].view_of(scene, scene.camera, width, height)
    y, x = np.divmod(np.arange(2 * width * 2 * height), 2 * width)
    org, dir = part["camera"].camera_rays(view, x / 2 + 0.25, y / 2 + 0.25)
    at = pyvocc.shading_points(traced, org, dir)
    ids = (y // 2 * width + x // 2) * 4 + y % 2 * 2 + x % 2
    area = pyvocc.RectLight((1.25, -2.75, 5), (0, 1.5, 0), (1.5, 0, 0), two_sided=False)
    counts = traced.light_visibility(at.position, at.normal, [area], 32, ids)[0]
    share = np.where(counts == pyvocc.NOT_TRACED, 0, counts / np.float32(32))
    share[at.geom_id < 0] = 1
    mean = share.reshape(height, 2, width, 2).mean(axis=(1, 3), dtype=np.float64)
    assert mean.min() == 0 and mean.max() == 1 and np.unique(mean).size > 30
    assert made.tobytes() == np.flipud(mean).astype(np.float32).tobytes()


# ---- Cycles --------------------------------------------------------------------------------------


def ratio_by_cycles(scene: Any, folder: Path, light: Any) -> tuple[Any, Any]:
    """Direct light with shadows by that without, and where there is any."""
    scene.render.engine = "CYCLES"
    scene.cycles.samples, scene.cycles.use_adaptive_sampling = 256, False
    scene.cycles.use_denoising, scene.cycles.max_bounces = False, 0
    # A mask of one ray a pixel is of the pixels' centres.
    scene.cycles.pixel_filter_type, scene.cycles.filter_width = "BLACKMAN_HARRIS", 0.01
    scene.view_layers[0].use_pass_diffuse_direct = True
    pictures = []
    for shadow in (True, False):
        light.data.use_shadow = shadow
        found = exr.render(scene, folder / f"{shadow}.exr")
        name = "Diffuse Direct.R" if "Diffuse Direct.R" in found else "DiffDir.R"
        pictures.append(found[name])
    light.data.use_shadow = True
    scene.render.engine = "VOCC"
    lit = pictures[1] > 0.01 * pictures[1].max()
    return np.divide(*pictures, where=lit, out=np.zeros_like(pictures[0])), lit


@pytest.mark.parametrize(
    ("kind", "values"),
    [
        ("AREA", {"shape": "SQUARE", "size": 1.5}),
        ("AREA", {"shape": "ELLIPSE", "size": 1.5, "size_y": 0.7}),
        ("POINT", {"shadow_soft_size": 0.5, "use_soft_falloff": True}),
        ("POINT", {"shadow_soft_size": 0.5, "use_soft_falloff": False}),
        ("SPOT", {"shadow_soft_size": 0.5, "use_soft_falloff": True, "spot_size": 2.5}),
        ("SUN", {"angle": 0.8}),
    ],
    ids=["square", "ellipse", "point", "sphere", "spot", "sun"],
)
def test_masks_are_those_of_cycles(
    scene: Any, addon: ModuleType, tmp_path: Path, kind: str, values: dict[str, Any]
) -> None:
    add_solids()
    add_camera(scene, (1, -6, 7), lens=35).rotation_euler = (0.75, 0, 0.15)
    light = add_light(scene, kind, (1.5, -1.5, 4), energy=5 if kind == "SUN" else 500, **values)
    light.rotation_euler = (0.3, 0.3, 0)
    expected, lit = ratio_by_cycles(scene, tmp_path, light)
    scene.vocc.weighting, scene.vocc.samples = "IRRADIANCE", 256
    mask = addon.shadow_masks(scene)["Key"]
    assert np.count_nonzero(lit) > 0.4 * lit.size
    assert np.count_nonzero((expected[lit] > 0.05) & (expected[lit] < 0.95)) > 0.05 * lit.size
    assert np.sqrt(np.mean((mask - expected)[lit] ** 2)) <= 0.03


def test_occlusion_is_that_of_cycles(scene: Any, addon: ModuleType, tmp_path: Path) -> None:
    add_solids()
    add_camera(scene, (1, -6, 7), lens=35).rotation_euler = (0.75, 0, 0.15)
    scene.world = scene.world or bpy.data.worlds.new("World")
    scene.world.light_settings.distance = 2.0
    scene.render.engine = "CYCLES"
    scene.cycles.samples, scene.cycles.use_adaptive_sampling = 256, False
    scene.cycles.use_denoising = False
    scene.cycles.pixel_filter_type, scene.cycles.filter_width = "BLACKMAN_HARRIS", 0.01
    scene.render.film_transparent = True
    scene.view_layers[0].use_pass_ambient_occlusion = True
    found = exr.render(scene, tmp_path / "a.exr")
    expected = found.get("Ambient Occlusion.R", found.get("AO.R"))
    scene.render.engine = "VOCC"
    scene.vocc.ao_distance, scene.vocc.ao_samples = 2.0, 256
    mask = addon.shadow_masks(scene, ao=True, masks=False)["VOcc AO"]
    seen = found["Combined.A"] == 1
    assert np.count_nonzero(seen) > 0.4 * seen.size and mask[seen].min() < 0.5
    assert np.sqrt(np.mean((mask - expected)[seen] ** 2)) <= 0.03
