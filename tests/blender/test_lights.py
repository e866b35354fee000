"""Lights as they are read, and light linking and the lit side of area lights against Cycles."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any

import bpy
import numpy as np
import pytest

Scene = bpy.types.Scene
Read = Callable[[], Any]


@pytest.fixture
def view(addon: ModuleType) -> Read:
    """Reads the viewport's depsgraph."""
    from blender_addon.extract import read_world

    return lambda: read_world(bpy.context.evaluated_depsgraph_get())


def new_light(kind: str, name: str = "Key", parent: Any = None, **values: Any) -> Any:
    object = bpy.data.objects.new(name, bpy.data.lights.new(name, kind))
    for key, value in values.items():
        setattr(object.data, key, value)
    (parent or bpy.context.scene.collection).objects.link(object)
    return object


def instance_of(collection: bpy.types.Collection, name: str, x: float = 0) -> bpy.types.Object:
    instance = bpy.data.objects.new(name, None)
    instance.instance_type = "COLLECTION"
    instance.instance_collection = collection
    instance.location.x = x
    bpy.context.scene.collection.objects.link(instance)
    return instance


# ---- what is read -------------------------------------------------------------


def test_every_kind(empty: Scene, view: Read) -> None:
    new_light("POINT", "Bulb", shadow_soft_size=0.25)
    new_light("SPOT", "Ball", shadow_soft_size=0.5, use_soft_falloff=False)
    new_light("SUN", "Sun", angle=0.2, use_shadow=False)
    for shape in ("SQUARE", "RECTANGLE", "DISK", "ELLIPSE"):
        new_light("AREA", shape, shape=shape, size=2.0, size_y=3.0)
    bpy.data.objects["Bulb"].location = (1, 2, 3)
    lights = {light.name: light for light in view().lights}
    bulb, ball, sun = lights["Bulb"], lights["Ball"], lights["Sun"]
    assert (bulb.kind, bulb.radius, bulb.is_sphere) == ("POINT", 0.25, False)
    assert [row[3] for row in bulb.matrix] == [1, 2, 3, 1]
    assert (ball.kind, ball.radius, ball.is_sphere) == ("SPOT", 0.5, True)
    assert (sun.kind, sun.angle) == ("SUN", pytest.approx(0.2))
    assert (sun.casts_shadow, bulb.casts_shadow) == (False, True)
    assert {name: lights[name].size for name in ("SQUARE", "RECTANGLE", "DISK", "ELLIPSE")} == {
        "SQUARE": (2, 2),
        "RECTANGLE": (2, 3),
        "DISK": (2, 2),
        "ELLIPSE": (2, 3),
    }


def test_names_of_instanced_lights(empty: Scene, view: Read) -> None:
    lamp = bpy.data.collections.new("Lamp")
    new_light("POINT", "Bulb", lamp)
    new_light("SUN", "Sun")
    street = bpy.data.collections.new("Street")
    for x in range(3):
        inner = instance_of(lamp, f"Post {x}", x)
        bpy.context.scene.collection.objects.unlink(inner)
        street.objects.link(inner)
    instance_of(lamp, "Desk", 9)
    instance_of(street, "Road")
    lights = view().lights
    assert {light.name: light.matrix[0][3] for light in lights} == {
        "Sun": 0,
        "Bulb in Desk": 9,
        "Bulb in Road": 0,
        "Bulb in Road 2": 1,
        "Bulb in Road 3": 2,
    }
    assert {light.object_name for light in lights} == {"Bulb", "Sun"}


def test_a_number_that_is_a_name_already(empty: Scene, view: Read) -> None:
    lamp = bpy.data.collections.new("Lamp")
    new_light("POINT", "Bulb", lamp)
    new_light("POINT", "Bulb in Post 2")
    post = bpy.data.collections.new("Post")
    for x in range(2):
        inner = instance_of(lamp, f"Arm {x}")
        bpy.context.scene.collection.objects.unlink(inner)
        post.objects.link(inner)
    instance_of(post, "Post")
    assert [light.name for light in view().lights] == [
        "Bulb in Post 2",
        "Bulb in Post",
        "Bulb in Post 3",
    ]


def test_a_portal_is_no_light(empty: Scene, view: Read) -> None:
    new_light("AREA", "Window").data.cycles.is_portal = True
    new_light("POINT", "Bulb").data.cycles.is_portal = True  # has no effect
    world = view()
    assert [light.name for light in world.lights] == ["Bulb"]
    assert world.left_out == (("Window", "it is a portal, which does not shine"),)


def test_hidden_lights_are_not_read(empty: Scene, view: Read) -> None:
    new_light("POINT", "Off").hide_render = True
    new_light("POINT", "Gone").hide_viewport = True
    new_light("POINT", "On")
    assert [light.name for light in view().lights] == ["On"]


# ---- against Cycles ------------------------------------------------------------------


def tile(name: str, x: float, z: float = 0, parent: Any = None) -> bpy.types.Object:
    """A white square of 1 x 1, seen by the camera of `lit_tiles` if it is at -1 or 1."""
    mesh = bpy.data.meshes.new(name)
    square = [(-0.5, -0.5, 0), (0.5, -0.5, 0), (0.5, 0.5, 0), (-0.5, 0.5, 0)]
    mesh.from_pydata(square, [], [(0, 1, 2, 3)])
    object = bpy.data.objects.new(name, mesh)
    object.location = (x, 0, z)
    (parent or bpy.context.scene.collection).objects.link(object)
    return object


def lit_tiles(file: Path) -> tuple[bool, bool]:
    """Whether Cycles shows light at x = -1 and at x = 1, looking down on z = 0."""
    scene = bpy.context.scene
    camera = bpy.data.cameras.new("Camera")
    camera.type, camera.ortho_scale = "ORTHO", 4
    scene.camera = bpy.data.objects.new("Camera", camera)
    scene.camera.location.z = 20
    scene.collection.objects.link(scene.camera)
    scene.render.engine = "CYCLES"
    scene.cycles.samples = 16
    scene.cycles.max_bounces = 0
    scene.cycles.use_denoising = False
    scene.render.resolution_x, scene.render.resolution_y = 16, 8
    scene.render.image_settings.file_format = "OPEN_EXR"
    scene.render.filepath = str(file)
    bpy.ops.render.render(write_still=True)
    image = bpy.data.images.load(str(file))
    pixels = np.empty((8, 16, image.channels), np.float32)
    image.pixels.foreach_get(pixels.ravel())
    return bool(pixels[4, 4, 0] > 0), bool(pixels[4, 12, 0] > 0)


# Of a light's collection: what it holds and how. A, B: the tiles; AB: a collection of both.
Links = list[tuple[str, str]]
LINKS: dict[str, Links] = {
    "empty": [],
    "include A": [("A", "INCLUDE")],
    "exclude A": [("A", "EXCLUDE")],
    "include A, exclude B": [("A", "INCLUDE"), ("B", "EXCLUDE")],
    "include both, exclude A": [("AB", "INCLUDE"), ("A", "EXCLUDE")],
    "exclude both, include A": [("AB", "EXCLUDE"), ("A", "INCLUDE")],
    "include nothing": [("none", "INCLUDE")],
    "include another": [("other", "INCLUDE")],
    "exclude another": [("other", "EXCLUDE")],
    "instance A": [("instance of A", "INCLUDE")],
    "not instance A": [("instance of A", "EXCLUDE")],
    "objects, not instance B": [("A", "INCLUDE"), ("B", "INCLUDE"), ("instance of B", "EXCLUDE")],
    "instances, not object B": [
        ("instance of A", "INCLUDE"),
        ("instance of B", "INCLUDE"),
        ("B", "EXCLUDE"),
    ],
}


def link(light: bpy.types.Object, which: str, links: Links) -> None:
    collection = bpy.data.collections.new("Links")
    setattr(light.light_linking, which, collection)
    for name, state in links:
        if name in bpy.data.objects:
            collection.objects.link(bpy.data.objects[name])
            collection.collection_objects[-1].light_linking.link_state = state
        else:
            collection.children.link(bpy.data.collections[name])
            collection.collection_children[-1].light_linking.link_state = state


@pytest.mark.parametrize("which", ["receiver_collection", "blocker_collection"])
@pytest.mark.parametrize(
    ("case", "instanced"),
    [
        *((case, True) for case in LINKS),
        *((case, False) for case in LINKS if "instance" not in case),
    ],
)
def test_light_linking(
    empty: Scene, view: Read, tmp_path: Path, case: str, which: str, instanced: bool
) -> None:
    receives = which == "receiver_collection"
    both = bpy.data.collections.new("AB")
    bpy.data.collections.new("none")
    bpy.data.objects.new("other", None)
    for name, x in (("A", -1), ("B", 1)):
        if not receives:
            tile(f"under {name}", x)
        z = 0 if receives else 1
        if instanced:
            collection = bpy.data.collections.new(f"only {name}")
            both.objects.link(tile(name, 0, z, collection))
            instance = instance_of(collection, f"instance of {name}", x)
            instance.visible_camera = receives
        else:
            object = tile(name, x, z)
            object.visible_camera = receives
            both.objects.link(object)
    light = new_light("SUN", energy=3.0)
    link(light, which, LINKS[case])

    world = view()
    (read,) = world.lights
    found = read.receivers if receives else read.blockers
    mine = []
    for name in ("A", "B"):
        (part,) = [part for part in world.parts if part.object_name == name]
        mine.append((found is None or part.link_name in found) == receives)
    assert tuple(mine) == lit_tiles(tmp_path / "lit.exr")


def test_only_a_collection_with_links_limits_a_light(empty: Scene, view: Read) -> None:
    tile("A", 0)
    link(new_light("SUN", "Free"), "receiver_collection", [])
    link(new_light("SUN", "Bound"), "blocker_collection", [("A", "EXCLUDE")])
    lights = {light.name: light for light in view().lights}
    assert (lights["Free"].receivers, lights["Free"].blockers) == (None, None)
    assert (lights["Bound"].receivers, lights["Bound"].blockers) == (None, frozenset())


@pytest.mark.parametrize("of", [{"light"}, {"instance"}, {"light", "instance"}])
def test_links_of_an_instanced_light(
    empty: Scene, view: Read, tmp_path: Path, of: set[str]
) -> None:
    tile("A", -1)
    tile("B", 1)
    lamp = bpy.data.collections.new("Lamp")
    light = new_light("SUN", parent=lamp, energy=3.0)
    instance = instance_of(lamp, "Desk")
    if "light" in of:
        link(light, "receiver_collection", [("A", "INCLUDE")])
    if "instance" in of:
        link(instance, "receiver_collection", [("B", "INCLUDE")])
    (read,) = view().lights
    receivers = {"A", "B"} if read.receivers is None else read.receivers
    assert ("A" in receivers, "B" in receivers) == lit_tiles(tmp_path / "lit.exr")


@pytest.mark.parametrize("shape", ["RECTANGLE", "ELLIPSE"])
@pytest.mark.parametrize(
    "scale", [(1, 2, 3), (-1, 1, 1), (1, -1, 1), (-1, -1, 1), (1, 1, -1), (-1, -1, -1)]
)
def test_the_side_that_an_area_light_shines_to(
    empty: Scene, view: Read, tmp_path: Path, scale: tuple[float, float, float], shape: str
) -> None:
    from blender_addon.lights import shape_of

    tile("A", -1)
    tile("B", 1)
    # Nearly upright, between the tiles and just above them: it lights one of them.
    light = new_light("AREA", shape=shape, energy=100.0)
    light.location.z = 1
    light.rotation_euler.y = 1.5
    light.scale = scale
    (read,) = view().lights
    area = shape_of(read)
    u, v = (area.edge_u, area.edge_v) if shape == "RECTANGLE" else (area.axis_u, area.axis_v)
    front = np.cross(u, v)
    assert (front[0] < 0, front[0] > 0) == lit_tiles(tmp_path / "lit.exr")
