"""Scenes that have too little, too much, or what cannot be: plain texts, no tracebacks."""

from __future__ import annotations

from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import Any

import bpy
import exr
import numpy as np
import pytest
from numpy.testing import assert_array_equal


@pytest.fixture
def scene(addon: ModuleType, empty: bpy.types.Scene) -> bpy.types.Scene:
    """A camera 14 above the origin, and nothing else."""
    empty.render.engine = "VOCC"
    empty.render.resolution_x, empty.render.resolution_y = 40, 30
    empty.vocc.aa = 1
    camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    camera.location = (0, 0, 14)
    empty.collection.objects.link(camera)
    empty.camera = camera
    return empty


def add_floor() -> Any:
    bpy.ops.mesh.primitive_plane_add(size=6)
    bpy.context.object.name = "Floor"
    return bpy.context.object


def add_ball() -> Any:
    bpy.ops.mesh.primitive_uv_sphere_add(radius=1, location=(0, 0, 1.5))
    bpy.context.object.name = "Ball"
    return bpy.context.object


def add_light(scene: Any, name: str = "Key", kind: str = "AREA", **values: Any) -> Any:
    light = bpy.data.objects.new(name, bpy.data.lights.new(name, kind))
    light.location = (2, 0, 6)
    for key, value in values.items():
        setattr(light.data, key, value)
    scene.collection.objects.link(light)
    return light


def notices(addon: ModuleType, scene: Any) -> tuple[str, ...]:
    return import_module(f"{addon.__name__}.report").LAST[scene.name].notices


def refusal() -> str:
    """What F12 is refused with."""
    with pytest.raises(RuntimeError) as caught:
        bpy.ops.render.render()
    text = str(caught.value)
    assert "Traceback" not in text and text.count("Error") == 1
    return text


def test_empty_scene(scene: Any, addon: ModuleType, tmp_path: Path) -> None:
    add_light(scene)
    found = exr.render(scene, tmp_path / "a.exr")
    assert (found["Shadow Key.X"] == 1).all() and not found["Combined.R"].any()
    assert notices(addon, scene) == ("There is no mesh that the camera can see",)


def test_no_lights(scene: Any, addon: ModuleType, tmp_path: Path) -> None:
    add_floor()
    found = exr.render(scene, tmp_path / "a.exr")
    assert {name.partition(".")[0] for name in found} == {"Combined"}
    assert found["Combined.R"].max() > 0.5
    assert notices(addon, scene) == ("There is no light in the render, so there is no mask",)
    scene.vocc.use_ao = True
    assert "VOcc AO.X" in exr.render(scene, tmp_path / "b.exr")
    assert notices(addon, scene) == ()


def test_no_camera(scene: Any) -> None:
    add_floor()
    scene.camera = None
    assert "no camera" in refusal().lower()


def test_panoramic_camera(scene: Any) -> None:
    add_floor()
    scene.camera.data.type = "PANO"
    assert "The camera 'Camera' is neither perspective nor orthographic" in refusal()


def test_stereoscopy(scene: Any) -> None:
    add_floor()
    scene.render.use_multiview = True
    assert "Stereoscopy is not supported" in refusal()


def test_border_without_area(scene: Any) -> None:
    add_floor()
    render = scene.render
    render.use_border = render.use_crop_to_border = True
    render.border_min_x = render.border_max_x = 0.5
    assert refusal()


def test_light_without_size(scene: Any, addon: ModuleType, tmp_path: Path) -> None:
    add_floor()
    add_light(scene, "Flat").scale.x = 0
    add_light(scene, "Key")
    found = exr.render(scene, tmp_path / "a.exr")
    covered = found["Combined.A"] == 1
    assert not found["Shadow Flat.X"][covered].any()
    assert (found["Shadow Key.X"][covered] == 1).all()
    (notice,) = notices(addon, scene)
    assert "Flat" in notice and "no area" in notice


@pytest.mark.parametrize("kind", ["POINT", "SPOT", "SUN"])
def test_lights_of_no_extent_are_hard(scene: Any, tmp_path: Path, kind: str) -> None:
    add_floor(), add_ball()
    values = {"angle": 0.0} if kind == "SUN" else {"shadow_soft_size": 0.0}
    light = add_light(scene, kind=kind, **values)
    light.rotation_euler.y = 0.3
    mask = exr.render(scene, tmp_path / "a.exr")["Shadow Key.X"]
    assert set(np.unique(mask)) == {0, 1}


@pytest.mark.parametrize("kind", ["AREA", "POINT", "SUN"])
def test_light_inside_a_mesh(scene: Any, tmp_path: Path, kind: str) -> None:
    add_floor(), add_ball()
    light = add_light(scene, kind=kind)
    light.location = (0, 0, 1.5)
    found = exr.render(scene, tmp_path / "a.exr")
    covered = found["Combined.A"] == 1
    mask = found["Shadow Key.X"][covered]
    if kind == "SUN":  # which is nowhere
        assert mask.any()
    else:
        assert not mask.any()


def test_light_in_the_plane_of_the_floor(scene: Any, tmp_path: Path) -> None:
    add_floor()
    add_light(scene, kind="POINT", shadow_soft_size=0.0).location = (5, 0, 0)
    found = exr.render(scene, tmp_path / "a.exr")
    assert not found["Shadow Key.X"][found["Combined.A"] == 1].any()


def test_200_lights(scene: Any, addon: ModuleType, tmp_path: Path) -> None:
    add_floor(), add_ball()
    scene.vocc.samples = 4
    for index in range(200):
        angle = index * 0.1
        light = add_light(scene, f"Light.{index:03}", "POINT")
        light.location = (4 * np.cos(angle), 4 * np.sin(angle), 5)
    found = exr.render(scene, tmp_path / "a.exr")
    masks = {name: mask for name, mask in found.items() if name.startswith("Shadow")}
    assert set(masks) == {f"Shadow Light_{index:03}.X" for index in range(200)}
    assert all(mask.min() < 1 for mask in masks.values())
    assert notices(addon, scene) == ()


def test_names_that_a_file_cannot_hold(scene: Any, tmp_path: Path) -> None:
    add_floor()
    names = ["Light.001", "Light_001", "💡.a/b", "x" * 60, "ü" * 31, " "]
    for name in names:
        add_light(scene, name)
    found = exr.render(scene, tmp_path / "a.exr")
    masks = [name for name in found if name.startswith("Shadow")]
    assert len(masks) == len(names)
    assert all(name.count(".") == 1 for name in masks)


def test_light_that_casts_no_shadow(scene: Any, tmp_path: Path) -> None:
    add_floor(), add_ball()
    add_light(scene, "Off", use_shadow=False)
    add_light(scene, "On")
    found = exr.render(scene, tmp_path / "a.exr")
    assert set(np.unique(found["Shadow Off.X"])) <= {0, 1}
    assert (found["Shadow Off.X"] >= found["Shadow On.X"]).all()
    # The floor is lit by it all over, under the ball as well.
    assert (found["Shadow On.X"] < found["Shadow Off.X"]).sum() > 20


def link(light: Any, which: str, obj: Any, state: str = "INCLUDE") -> None:
    collection = bpy.data.collections.new(f"{light.name} {which}")
    collection.objects.link(obj)
    collection.collection_objects[0].light_linking.link_state = state
    setattr(light.light_linking, f"{which}_collection", collection)


def test_light_linking(scene: Any, tmp_path: Path) -> None:
    floor, ball = add_floor(), add_ball()
    link(add_light(scene, "No ball"), "blocker", ball, "EXCLUDE")
    link(add_light(scene, "Floor only"), "receiver", floor)
    add_light(scene, "All")
    found = exr.render(scene, tmp_path / "a.exr")
    free, floor_only, whole = (
        found[f"Shadow {name}.X"] for name in ("No ball", "Floor only", "All")
    )
    ball.hide_render = True
    bare = exr.render(scene, tmp_path / "b.exr")["Shadow All.X"]
    assert (free >= whole).all() and (free > whole).any()
    # Where the camera sees the floor, the ball is as if it were not there.
    ball.hide_render, ball.visible_camera = False, False
    hidden = exr.render(scene, tmp_path / "c.exr")
    assert_array_equal(hidden["Shadow No ball.X"], bare)
    assert_array_equal(hidden["Shadow Floor only.X"], hidden["Shadow All.X"])
    # The ball, in the middle, is not lit at all.
    assert floor_only[15, 20] == 0 and whole[15, 20] == 1


def test_light_linking_to_nothing(scene: Any, tmp_path: Path) -> None:
    add_floor()
    light = add_light(scene)
    light.light_linking.receiver_collection = bpy.data.collections.new("Nobody")
    light.light_linking.blocker_collection = bpy.data.collections.new("Nothing")
    found = exr.render(scene, tmp_path / "a.exr")
    assert (found["Shadow Key.X"] == 1).all()  # as in Cycles: an empty collection says nothing


def test_instanced_lights(scene: Any, tmp_path: Path) -> None:
    add_floor(), add_ball()
    inner = bpy.data.collections.new("Lamp")
    bulb = bpy.data.objects.new("Bulb", bpy.data.lights.new("Bulb", "AREA"))
    inner.objects.link(bulb)
    for name, x in (("Left", -2.0), ("Right", 2.0)):
        lamp = bpy.data.objects.new(name, None)
        lamp.instance_type, lamp.instance_collection = "COLLECTION", inner
        lamp.location = (x, 0, 6)
        scene.collection.objects.link(lamp)
    add_light(scene, "Key")  # where the right lamp is
    found = exr.render(scene, tmp_path / "a.exr")
    left, right, key = (
        found[f"Shadow {name}.X"] for name in ("Bulb in Left", "Bulb in Right", "Key")
    )
    assert left[:, 20:].mean() < left[:, :20].mean()
    assert right[:, 20:].mean() > right[:, :20].mean()
    assert np.abs(right - key).mean() < 0.02


def test_excluded_and_not_solid(scene: Any, tmp_path: Path) -> None:
    add_floor()
    ball = add_ball()
    add_light(scene)
    shadow = exr.render(scene, tmp_path / "a.exr")["Shadow Key.X"]
    ball.vocc.exclude = True
    without = exr.render(scene, tmp_path / "b.exr")["Shadow Key.X"]
    assert (without > shadow).any()
    ball.vocc.exclude = False
    material = bpy.data.materials.new("Leaf")
    ball.data.materials.append(material)
    material.vocc.not_solid = True
    assert_array_equal(exr.render(scene, tmp_path / "c.exr")["Shadow Key.X"], without)


def test_hair_is_named(scene: Any, addon: ModuleType) -> None:
    add_floor()
    add_light(scene)
    curves = bpy.data.objects.new("Fur", bpy.data.hair_curves.new("Fur"))
    scene.collection.objects.link(curves)
    bpy.ops.render.render()
    report = import_module(f"{addon.__name__}.report").LAST[scene.name]
    assert [name for name, _ in report.left_out] == ["Fur"]


def test_everything_is_hidden(scene: Any, tmp_path: Path) -> None:
    for obj in (add_floor(), add_ball(), add_light(scene)):
        obj.hide_render = True
    found = exr.render(scene, tmp_path / "a.exr")
    assert not any(values.any() for values in found.values())


def test_nothing_is_asked_for(scene: Any, tmp_path: Path) -> None:
    add_floor()
    add_light(scene)
    scene.vocc.use_shadow_masks = False
    found = exr.render(scene, tmp_path / "a.exr")
    assert {name.partition(".")[0] for name in found} == {"Combined"}


def test_a_mesh_without_faces(scene: Any, tmp_path: Path) -> None:
    mesh = bpy.data.meshes.new("Wire")
    mesh.from_pydata([(0, 0, 0), (1, 0, 0)], [(0, 1)], [])
    scene.collection.objects.link(bpy.data.objects.new("Wire", mesh))
    add_floor()
    add_light(scene)
    found = exr.render(scene, tmp_path / "a.exr")
    assert found["Combined.A"].any()


def test_far_from_the_origin(scene: Any, tmp_path: Path) -> None:
    add_floor(), add_ball()
    add_light(scene)
    near = exr.render(scene, tmp_path / "a.exr")["Shadow Key.X"]
    for obj in scene.objects:
        obj.location.x += 4096
    far = exr.render(scene, tmp_path / "b.exr")["Shadow Key.X"]
    assert np.abs(near - far).mean() < 0.005
