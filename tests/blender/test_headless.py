"""`shadow_masks`: arrays without a file, and a scene that is left as it was."""

from __future__ import annotations

import subprocess
import sys
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
    """A ball over a floor, two lights, two cameras; rendered by Cycles."""
    empty.render.engine = "CYCLES"
    empty.render.resolution_x, empty.render.resolution_y = 40, 30
    bpy.ops.mesh.primitive_plane_add(size=8)
    bpy.ops.mesh.primitive_uv_sphere_add(radius=1, location=(0, 0, 1.5))
    for name, x in (("Key.001", 2.0), ("Fill 💡", -2.0)):
        light = bpy.data.objects.new(name, bpy.data.lights.new(name, "AREA"))
        light.location = (x, 0, 6)
        empty.collection.objects.link(light)
    for name, height in (("Near", 9.0), ("Far", 14.0)):
        camera = bpy.data.objects.new(name, bpy.data.cameras.new(name))
        camera.location = (0, 0, height)
        empty.collection.objects.link(camera)
    empty.camera = bpy.data.objects["Far"]
    empty.vocc.aa = 1
    return empty


def state(scene: Any) -> list[Any]:
    """What a call might leave changed."""
    render = scene.render
    return [
        [(layer.name, layer.use) for layer in scene.view_layers],
        [(obj.name, obj.hide_render, obj.visible_get()) for obj in scene.objects],
        (scene.camera, scene.frame_current, bpy.context.scene, bpy.context.view_layer.name),
        (render.engine, render.resolution_x, render.resolution_y, render.resolution_percentage),
        (render.use_border, render.use_compositing, render.use_sequencer, render.filepath),
        (scene.vocc.samples, scene.vocc.aa, scene.vocc.use_ao),
        [len(getattr(bpy.data, name)) for name in ("scenes", "objects", "meshes", "cameras")],
    ]


def registered(cls: type) -> bool:
    """Not so of a class that was never registered, which has no such attribute."""
    return bool(getattr(cls, "is_registered", False))


def test_a_mask_for_each_light(scene: Any, addon: ModuleType) -> None:
    masks = addon.shadow_masks(scene)
    assert set(masks) == {"Key.001", "Fill 💡"}
    for mask in masks.values():
        assert mask.shape == (30, 40) and mask.dtype == np.float32
        assert mask.flags.c_contiguous and 0 <= mask.min() < mask.max() <= 1


def test_the_top_row_comes_first(scene: Any, addon: ModuleType, tmp_path: Path) -> None:
    bpy.data.objects["Key.001"].location.y = -2
    masks = addon.shadow_masks(scene)
    scene.render.engine = "VOCC"
    found = exr.render(scene, tmp_path / "a.exr")
    assert masks["Key.001"].tobytes() == found["Shadow Key_001.X"].tobytes()
    assert masks["Fill 💡"].tobytes() == found["Shadow Fill 💡.X"].tobytes()
    # The shadow is thrown up.
    assert masks["Key.001"][:15].mean() < masks["Key.001"][15:].mean()


def test_the_same_bits_each_time(scene: Any, addon: ModuleType) -> None:
    first = addon.shadow_masks(scene, ao=True)
    import_module(f"{addon.__name__}.scenes").CACHE.clear()
    second = addon.shadow_masks(scene, ao=True, threads=2)
    assert list(first) == list(second)
    for name, mask in first.items():
        assert mask.tobytes() == second[name].tobytes()


def test_the_scene_stays_as_it_was(scene: Any, addon: ModuleType) -> None:
    scene.render.use_border = True
    before = state(scene)
    addon.shadow_masks(scene, camera="Near", lights=["Key.001"], samples=4, aa=2, size=(20, 10))
    assert state(scene) == before
    engines = [cls for cls in bpy.types.RenderEngine.__subclasses__() if registered(cls)]
    names = {getattr(cls, "bl_idname", "") for cls in engines}
    assert "VOCC" in names and "VOCC_ARRAYS" not in names


def test_lights_by_name_or_object(scene: Any, addon: ModuleType) -> None:
    masks = addon.shadow_masks(scene)
    (name,) = addon.shadow_masks(scene, lights=["Fill 💡"])
    assert name == "Fill 💡"
    chosen = addon.shadow_masks(scene, lights=[bpy.data.objects["Fill 💡"]])
    assert_array_equal(chosen["Fill 💡"], masks["Fill 💡"])
    assert addon.shadow_masks(scene, lights=[]) == {}


def test_camera_by_name_or_object(scene: Any, addon: ModuleType) -> None:
    far, near = addon.shadow_masks(scene), addon.shadow_masks(scene, camera="Near")
    assert (far["Key.001"] != near["Key.001"]).any()
    same = addon.shadow_masks(scene, bpy.data.objects["Near"])
    assert_array_equal(same["Key.001"], near["Key.001"])


def test_a_marker_does_not_take_the_camera_away(scene: Any, addon: ModuleType) -> None:
    near = addon.shadow_masks(scene, camera="Near")
    scene.timeline_markers.new("Cut", frame=0).camera = bpy.data.objects["Far"]
    again = addon.shadow_masks(scene, camera="Near")
    assert_array_equal(again["Key.001"], near["Key.001"])


def test_sizes_and_samples(scene: Any, addon: ModuleType) -> None:
    masks = addon.shadow_masks(scene, samples=2, size=(17, 9))
    assert all(mask.shape == (9, 17) for mask in masks.values())
    assert all(set(np.unique(mask)) <= {0, 0.5, 1} for mask in masks.values())
    scene.render.resolution_percentage = 50
    assert addon.shadow_masks(scene)["Key.001"].shape == (15, 20)
    scene.render.use_border, scene.render.border_max_x = True, 0.5
    assert addon.shadow_masks(scene)["Key.001"].shape == (15, 20)
    assert addon.shadow_masks(scene, size=(17, 9))["Key.001"].shape == (9, 17)


def test_occlusion(scene: Any, addon: ModuleType) -> None:
    masks = addon.shadow_masks(scene, ao=True, ao_distance=2.0, ao_samples=64)
    assert list(masks) == ["Fill 💡", "Key.001", "VOcc AO"]
    assert masks["VOcc AO"].min() < 0.8
    assert list(addon.shadow_masks(scene, masks=False, ao=True)) == ["VOcc AO"]


def test_as_it_renders(scene: Any, addon: ModuleType) -> None:
    """Not as the viewport shows it."""
    ball = bpy.data.objects["Sphere"]
    seen = addon.shadow_masks(scene)
    ball.hide_viewport = True
    assert_array_equal(addon.shadow_masks(scene)["Key.001"], seen["Key.001"])
    ball.hide_viewport, ball.hide_render = False, True
    assert (addon.shadow_masks(scene)["Key.001"] == 1).all()


def test_another_scene(scene: Any, addon: ModuleType) -> None:
    masks = addon.shadow_masks(scene)
    other = bpy.data.scenes.new("Other")
    bpy.context.window.scene = other
    assert_array_equal(addon.shadow_masks(scene)["Key.001"], masks["Key.001"])
    assert bpy.context.window.scene == other


@pytest.mark.parametrize(
    ("options", "text"),
    [
        ({"samples": 0}, "samples must be from 1 to 65534, got 0"),
        ({"aa": 17}, "aa must be from 1 to 16, got 17"),
        ({"size": (3, 10)}, "size must be from 4 to 65536 pixels each way, got 3 x 10"),
        ({"lights": ["Sun"]}, "there is no light called 'Sun'"),
        ({"lights": ["Near"]}, "there is no light called 'Near'"),
        ({"camera": "Key.001"}, "there is no camera called 'Key.001'"),
        ({"ao": True, "ao_distance": 0.0}, "ao_distance must be above 0, got 0.0"),
        ({"offset": -1.0}, "offset must be at least 0 and finite, got -1.0"),
    ],
)
def test_bad_arguments(scene: Any, addon: ModuleType, options: dict[str, Any], text: str) -> None:
    before = state(scene)
    with pytest.raises(ValueError, match=text):
        addon.shadow_masks(scene, **options)
    assert state(scene) == before


def test_an_unknown_setting(scene: Any, addon: ModuleType) -> None:
    with pytest.raises(TypeError, match="color"):
        addon.shadow_masks(scene, color=1)


def test_no_camera(scene: Any, addon: ModuleType) -> None:
    scene.camera = None
    with pytest.raises(ValueError, match="the scene 'Scene' has no camera"):
        addon.shadow_masks(scene)
    assert addon.shadow_masks(scene, camera="Near")["Key.001"].shape == (30, 40)
    assert scene.camera is None


def test_a_camera_that_cannot_be_used(scene: Any, addon: ModuleType) -> None:
    before = state(scene)
    bpy.data.cameras["Far"].type = "PANO"
    with pytest.raises(ValueError, match="neither perspective nor orthographic"):
        addon.shadow_masks(scene)
    assert state(scene) == before


def test_without_registration(scene: Any, tmp_path: Path, root: Path, addon: ModuleType) -> None:
    """A process of its own, in which the add-on is imported only; and the same bits."""
    expected = addon.shadow_masks(scene, samples=16, aa=2)["Key.001"]
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "a.blend"))
    script = tmp_path / "script.py"
    script.write_text(
        f"""
import os, sys
sys.path.append({str(root)!r})
import bpy, numpy
bpy.ops.wm.open_mainfile(filepath={str(tmp_path / "a.blend")!r})
from blender_addon import shadow_masks
numpy.save({str(tmp_path / "mask.npy")!r}, shadow_masks(samples=16, aa=2)["Key.001"])
sys.stdout.flush()
os._exit(0)
"""
    )
    subprocess.run([sys.executable, "-P", script], check=True, timeout=120, capture_output=True)
    assert np.load(tmp_path / "mask.npy").tobytes() == expected.tobytes()
