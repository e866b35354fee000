"""F12: passes in files, animation, border, ESC, progressive tiles."""

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

import pyvocc

SIZE = (45, 33)


@pytest.fixture
def engine(addon: ModuleType) -> ModuleType:
    return import_module(f"{addon.__name__}.engine")


@pytest.fixture
def scene(addon: ModuleType, empty: bpy.types.Scene) -> bpy.types.Scene:
    """A ball over a floor under one area light, seen from above."""
    import_module(f"{addon.__name__}.scenes").CACHE.clear()
    import_module(f"{addon.__name__}.report").LAST.clear()
    empty.render.engine = "VOCC"
    empty.render.resolution_x, empty.render.resolution_y = SIZE
    empty.vocc.aa = 1
    bpy.ops.mesh.primitive_plane_add(size=8)
    bpy.context.object.name = "Floor"
    bpy.ops.mesh.primitive_uv_sphere_add(radius=1, location=(0, 0, 1.5))
    bpy.context.object.name = "Ball"
    add_light(empty, "Key", (2, 0, 6))
    camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    camera.location = (0, 0, 14)
    empty.collection.objects.link(camera)
    empty.camera = camera
    return empty


def add_light(scene: Any, name: str, place: tuple[float, float, float]) -> Any:
    light = bpy.data.objects.new(name, bpy.data.lights.new(name, "AREA"))
    light.location = place
    scene.collection.objects.link(light)
    return light


def last(addon: ModuleType, scene: Any) -> Any:
    return import_module(f"{addon.__name__}.report").LAST[scene.name]


def test_passes_are_in_the_file(scene: Any, tmp_path: Path) -> None:
    add_light(scene, "Fill.001", (-2, 0, 6))
    add_light(scene, "灯 💡", (0, 3, 6))
    scene.vocc.use_ao = True
    found = exr.render(scene, tmp_path / "a.exr")
    assert set(found) == {
        *(f"Combined.{channel}" for channel in "RGBA"),
        "Shadow Fill_001.X",
        "Shadow Key.X",
        "Shadow 灯 💡.X",
        "VOcc AO.X",
    }
    for name, values in found.items():
        assert values.shape == SIZE[::-1] and values.dtype == np.float32, name
        assert values.min() >= 0 and values.max() <= 1, name
    # Each light throws the shadow to the other side.
    left, right = (found[f"Shadow {name}.X"] for name in ("Key", "Fill_001"))
    assert left[:, :22].mean() < left[:, 23:].mean()
    assert right[:, :22].mean() > right[:, 23:].mean()
    assert found["Shadow 灯 💡.X"][17:].mean() < found["Shadow 灯 💡.X"][:16].mean()


def test_the_compositor_knows_the_passes(scene: Any) -> None:
    add_light(scene, "Fill.001", (-2, 0, 6))
    hidden = add_light(scene, "Hidden", (0, 0, 6))
    hidden.hide_render = True
    inner = bpy.data.collections.new("Lamp")
    inner.objects.link(bpy.data.objects.new("Bulb", bpy.data.lights.new("Bulb", "POINT")))
    lamp = bpy.data.objects.new("Lamp A", None)
    lamp.instance_type, lamp.instance_collection = "COLLECTION", inner
    scene.collection.objects.link(lamp)
    scene.vocc.use_ao = True
    scene.view_layers[0].update_render_passes()
    tree = bpy.data.node_groups.new("Tree", "CompositorNodeTree")
    if bpy.app.version >= (5, 0):
        scene.compositing_node_group = tree
    else:
        scene.use_nodes = True
        tree = scene.node_tree
    node = tree.nodes.new("CompositorNodeRLayers")
    node.scene = scene
    names = [socket.name for socket in node.outputs if socket.enabled]
    wanted = ["Shadow Bulb in Lamp A", "Shadow Fill_001", "Shadow Key", "VOcc AO"]
    assert [name for name in names if name.startswith(("Shadow", "VOcc"))] == wanted


def test_registered_passes_are_those_rendered(scene: Any, tmp_path: Path, engine: Any) -> None:
    excluded = bpy.data.collections.new("Excluded")
    off = bpy.data.collections.new("Off")
    for collection in (excluded, off):
        scene.collection.children.link(collection)
        name = f"In {collection.name}"
        collection.objects.link(bpy.data.objects.new(name, bpy.data.lights.new(name, "POINT")))
    scene.view_layers[0].layer_collection.children["Excluded"].exclude = True
    off.hide_render = True
    inner = bpy.data.collections.new("Lamp")
    inner.objects.link(bpy.data.objects.new("Bulb", bpy.data.lights.new("Bulb", "POINT")))
    for name in ("Lamp A", "Lamp B"):
        lamp = bpy.data.objects.new(name, None)
        lamp.instance_type, lamp.instance_collection = "COLLECTION", inner
        scene.collection.objects.link(lamp)
    outer = bpy.data.collections.new("Lamps")
    outer.objects.link(bpy.data.objects["Lamp B"])
    row = bpy.data.objects.new("Row", None)
    row.instance_type, row.instance_collection = "COLLECTION", outer
    scene.collection.objects.link(row)
    rendered = [name for name in exr.render(scene, tmp_path / "a.exr") if name[:6] == "Shadow"]
    names = engine.light_names(scene.view_layers[0])
    assert names == ["Bulb in Lamp A", "Bulb in Lamp B", "Bulb in Row", "Key"]
    assert sorted(rendered) == [f"Shadow {name}.X" for name in names]


def test_lights_on_vertices(scene: Any, tmp_path: Path, engine: Any) -> None:
    mesh = bpy.data.meshes.new("Row")
    mesh.from_pydata([(-2, 0, 6), (2, 0, 6)], [], [])
    row = bpy.data.objects.new("Row", mesh)
    row.instance_type = "VERTS"
    scene.collection.objects.link(row)
    bulb = add_light(scene, "Bulb", (0, 0, 0))
    bulb.parent = row
    found = exr.render(scene, tmp_path / "a.exr")
    names = sorted(name for name in found if name[:6] == "Shadow")
    assert names == ["Shadow Bulb in Row 2.X", "Shadow Bulb in Row.X", "Shadow Key.X"]
    assert_array_equal(found["Shadow Bulb in Row 2.X"] < 1, found["Shadow Key.X"] < 1)
    assert engine.light_names(scene.view_layers[0]) == ["Key"]


def test_each_view_layer_has_its_own(scene: Any, tmp_path: Path) -> None:
    layer = scene.view_layers.new("Without Ball")
    balls = bpy.data.collections.new("Balls")
    scene.collection.children.link(balls)
    ball = bpy.data.objects["Ball"]
    scene.collection.objects.unlink(ball)
    balls.objects.link(ball)
    layer.layer_collection.children["Balls"].exclude = True
    found = exr.render(scene, tmp_path / "a.exr")
    assert found["Shadow Key.X"].min() < 1
    assert found["Without Ball.Shadow Key.X"].min() == 1


def test_border_is_a_crop(scene: Any, tmp_path: Path) -> None:
    scene.vocc.aa, scene.vocc.use_ao = 2, True
    whole = exr.render(scene, tmp_path / "a.exr")
    render = scene.render
    render.use_border = True
    for left, right, lower, upper in ((0.3, 0.7, 0.1, 0.55), (1 / 3, 0.9, 0.2, 0.8)):
        render.border_min_x, render.border_max_x = left, right
        render.border_min_y, render.border_max_y = lower, upper
        render.use_crop_to_border = True
        part = exr.render(scene, tmp_path / "b.exr")
        height, width = part["Shadow Key.X"].shape
        x, y = int(np.float32(left) * SIZE[0]), SIZE[1] - int(np.float32(lower) * SIZE[1])
        for name, values in part.items():
            expected = whole[name][y - height : y, x : x + width]
            assert values.tobytes() == expected.tobytes(), name
        render.use_crop_to_border = False
        full = exr.render(scene, tmp_path / "c.exr")
        for name, values in full.items():
            assert values.shape == SIZE[::-1]
            inside = values[y - height : y, x : x + width]
            assert inside.tobytes() == part[name].tobytes(), name
            assert np.count_nonzero(values) == np.count_nonzero(inside), name


def test_resolution_percentage(scene: Any, tmp_path: Path) -> None:
    scene.render.resolution_percentage = 50
    assert exr.render(scene, tmp_path / "a.exr")["Shadow Key.X"].shape == (16, 22)


def test_animation(scene: Any, tmp_path: Path, addon: ModuleType) -> None:
    """The light and the camera move: nothing is built again; then the ball does."""
    light, camera, ball = (bpy.data.objects[name] for name in ("Key", "Camera", "Ball"))
    for frame in (1, 2, 3):
        light.location.x = 2.0 - frame
        light.keyframe_insert("location", frame=frame)
        camera.location.y = 0.2 * frame
        camera.keyframe_insert("location", frame=frame)
    scene.frame_start, scene.frame_end = 1, 3
    import_module(f"{addon.__name__}.compat").set_multilayer_exr(scene.render.image_settings)
    scene.render.filepath = f"{tmp_path}/f"

    builds = []
    handlers = bpy.app.handlers.render_post
    handlers.append(lambda *_: builds.append(last(addon, scene).builds))
    try:
        bpy.ops.render.render(animation=True)
        assert builds == [1, 0, 0]
        frames = [exr.passes(tmp_path / f"f000{frame}.exr") for frame in (1, 2, 3)]
        for a, b in ((0, 1), (1, 2)):
            assert (frames[a]["Shadow Key.X"] != frames[b]["Shadow Key.X"]).any()

        ball.keyframe_insert("location", frame=1)
        ball.location.z += 0.5
        ball.keyframe_insert("location", frame=3)
        builds.clear()
        bpy.ops.render.render(animation=True)
        # The first frame is as before.
        assert builds == [0, 1, 1]
    finally:
        handlers.pop()


def test_a_frame_is_the_same_on_its_own(scene: Any, tmp_path: Path) -> None:
    a = exr.render(scene, tmp_path / "a.exr")
    b = exr.render(scene, tmp_path / "b.exr")
    for name, values in a.items():
        assert_array_equal(values, b[name])


def test_tiles_come_one_by_one(
    scene: Any, tmp_path: Path, engine: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole = exr.render(scene, tmp_path / "a.exr")
    monkeypatch.setattr(engine, "TILE", 8)
    sizes = []
    tile = engine.MaskJob.tile

    def recorded(self: Any, x: int, y: int, width: int, height: int, progress: Any) -> Any:
        sizes.append((width, height))
        return tile(self, x, y, width, height, progress)

    monkeypatch.setattr(engine.MaskJob, "tile", recorded)
    tiled = exr.render(scene, tmp_path / "b.exr")
    assert len(sizes) == 6 * 5 and sizes[0] == (8, 8)
    for name, values in whole.items():
        assert values.tobytes() == tiled[name].tobytes(), name


def test_tiles_cover_the_region_once(engine: Any) -> None:
    for width, height, aa in ((1, 1, 1), (300, 200, 2), (1920, 1080, 3), (40, 40, 300)):
        seen = np.zeros((height, width), int)
        for x, y, w, h in engine.tiles(width, height, aa):
            seen[y : y + h, x : x + w] += 1
        assert (seen == 1).all()
    # The middle comes first.
    x, y, w, h = engine.tiles(1920, 1080, 2)[0]
    assert x <= 960 <= x + w and y <= 540 <= y + h


def test_escape_stops_within_a_tile(
    scene: Any, addon: ModuleType, engine: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    scene.vocc.samples = 65534
    scene.render.resolution_percentage = 1000
    asked = []

    def stopped(self: Any) -> bool:
        asked.append(0)
        return len(asked) > 3

    monkeypatch.setattr(engine.Poll, "stopped", stopped)
    bpy.ops.render.render()
    # Rendered to its end it would take hours.
    assert len(asked) == 4
    assert scene.name not in import_module(f"{addon.__name__}.report").LAST


def test_progress_goes_from_0_to_1(
    scene: Any, engine: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    told: list[float] = []
    part = engine.Poll.part

    def recorded(self: Any, lower: float, upper: float) -> Any:
        progress = part(self, lower, upper)

        def told_too(fraction: float) -> bool:
            told.append(lower + fraction * (upper - lower))
            return progress(fraction)

        return told_too

    monkeypatch.setattr(engine.Poll, "part", recorded)
    scene.vocc.samples = 1024
    bpy.ops.render.render()
    assert told == sorted(told) and 0 <= told[0] < 0.1 < 0.9 < told[-1] <= 1


def test_the_report(scene: Any, addon: ModuleType) -> None:
    bpy.ops.render.render()
    report = last(addon, scene)
    assert report.size == SIZE and report.masks == ("Shadow Key",)
    assert [(each.name, each.closed) for each in report.objects] == [
        ("Floor", False),
        ("Ball", True),
    ]
    assert list(report.seconds) == ["extract", "build", "camera", "trace", "hand back"]
    assert report.rays > 0 and report.notices == ()


def test_a_summary_is_printed(scene: Any, capfd: pytest.CaptureFixture[str]) -> None:
    bpy.ops.render.render()
    lines = [line for line in capfd.readouterr().out.splitlines() if "1 mask of 45 x 33" in line]
    assert len(lines) == 1


def test_the_picture_shows_the_shadow(scene: Any, tmp_path: Path) -> None:
    found = exr.render(scene, tmp_path / "a.exr")
    grey, mask, covered = (found[name] for name in ("Combined.R", "Shadow Key.X", "Combined.A"))
    assert_array_equal(grey, found["Combined.G"])
    assert_array_equal(grey, found["Combined.B"])
    assert set(np.unique(covered)) == {0, 1} and not grey[covered == 0].any()
    dark, lit = (mask == 0) & (covered == 1), (mask == 1) & (covered == 1)
    assert dark.any() and grey[dark].mean() < 0.5 * grey[lit].mean()


def test_settings_come_from_the_scene(scene: Any, addon: ModuleType) -> None:
    settings_of = import_module(f"{addon.__name__}.properties").settings_of
    values = scene.vocc
    assert (settings_of(scene).offset, settings_of(scene).threads) == (None, 1)
    values.samples, values.aa, values.use_shadow_masks = 5, 3, False
    values.use_ao, values.ao_distance, values.ao_samples = True, 2.5, 7
    values.use_auto_offset, values.offset, values.weighting = False, 0.25, "IRRADIANCE"
    scene.render.threads_mode = "AUTO"
    data = import_module(f"{addon.__name__}.data")
    assert settings_of(scene) == data.Settings(
        samples=5,
        aa=3,
        masks=False,
        ao=True,
        ao_distance=2.5,
        ao_samples=7,
        irradiance=True,
        offset=0.25,
        threads=0,
    )


def test_previews_are_not_ours(engine: Any) -> None:
    assert not engine.VoccEngine.bl_use_preview
    assert "view_draw" not in vars(engine.VoccEngine)


def test_blenders_panels_stay_in_sight(engine: Any) -> None:
    shown = (
        "RENDER_PT_format",
        "DATA_PT_lens",
        "DATA_PT_EEVEE_light",
        "DATA_PT_EEVEE_light_shadow",
    )
    hidden = ("RENDER_PT_freestyle", "RENDER_PT_stereoscopy")
    for name in shown:
        assert "VOCC" in getattr(bpy.types, name).COMPAT_ENGINES, name
    for name in hidden:
        assert "VOCC" not in getattr(bpy.types, name).COMPAT_ENGINES, name
    engine.unregister()
    try:
        for name in shown:
            assert "VOCC" not in getattr(bpy.types, name).COMPAT_ENGINES, name
    finally:
        engine.register()


def test_not_enough_memory_is_told(
    scene: Any, engine: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: Any, **__: Any) -> None:
        raise pyvocc.OutOfMemory("no memory for 4 GB")

    monkeypatch.setattr(engine.MaskJob, "tile", fail)
    with pytest.raises(RuntimeError, match=r"^Error: No memory for 4 GB$"):
        bpy.ops.render.render()
