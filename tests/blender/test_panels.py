"""Every panel drawn in every situation, checked against this Blender's own description."""

from __future__ import annotations

from dataclasses import replace
from importlib import import_module
from types import ModuleType
from typing import Any

import bpy
import numpy as np
import pytest
from fake_layout import FakeLayout, Item, draw, texts


@pytest.fixture
def panels(addon: ModuleType) -> ModuleType:
    return import_module(f"{addon.__name__}.panels")


@pytest.fixture
def report(addon: ModuleType) -> Any:
    return import_module(f"{addon.__name__}.report")


@pytest.fixture
def scene(addon: ModuleType, report: ModuleType, empty: bpy.types.Scene) -> Any:
    empty.render.engine = "CYCLES"
    report.LAST.clear()
    import_module(f"{addon.__name__}.cycles_check").LAST.clear()
    yield empty
    report.LAST.clear()


@pytest.fixture
def full(scene: Any) -> Any:
    """A mesh, a light and a camera."""
    bpy.ops.mesh.primitive_cube_add()
    add_light(scene, "Key")
    camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    scene.collection.objects.link(camera)
    scene.camera = camera
    return scene


def add_light(scene: Any, name: str) -> Any:
    light = bpy.data.objects.new(name, bpy.data.lights.new(name, "AREA"))
    scene.collection.objects.link(light)
    return light


def a_report(report: ModuleType, scene: str) -> Any:
    return report.Report(
        scene=scene,
        size=(1920, 1080),
        masks=("Shadow Key",),
        samples=16,
        aa=2,
        triangles=123456,
        objects=(
            report.ObjectReport("Floor", 1, 2000, False, 4, "4 open edges"),
            report.ObjectReport("Cube", 2, 12, True, 0, ""),
        ),
        left_out=(("Hair", "hair curves are not meshes"),),
        notices=("Key: the area light 'Key' has no area: its size or scale is 0; its mask is 0",),
        rays=10_000_000,
        settled={"occluders": 4_000_000, "triangles": 6_000_000},
        seconds={"extract": 0.1, "build": 0.2, "trace": 1.0},
        builds=1,
    )


def all_panels(panels: ModuleType) -> list[type]:
    found = [each for each in vars(panels).values() if isinstance(each, type)]
    return [each for each in found if issubclass(each, bpy.types.Panel)]


def draw_all(panels: ModuleType, **context: Any) -> dict[str, list[Item] | None]:
    return {each.bl_idname: draw(each, **context) for each in all_panels(panels)}


def operators(items: list[Item]) -> list[str]:
    return [item.name for item in items if item.kind == "operator"]


def test_both_places_show_the_same(panels: ModuleType, full: Any, report: ModuleType) -> None:
    bpy.ops.vocc.setup()
    report.LAST["Scene Shadows"] = a_report(report, "Scene Shadows")
    shown = draw_all(panels, material=None)
    for name, items in shown.items():
        if name.startswith("VOCC_PT_render"):
            twin = shown[name.replace("VOCC_PT_render", "VOCC_PT_view")]
            assert [repr(item) for item in items] == [repr(item) for item in twin]
    for panel in all_panels(panels):
        assert panel.is_registered
        parent = getattr(panel, "bl_parent_id", None)
        assert parent is None or parent.split("_")[2] == panel.bl_idname.split("_")[2]


def test_nothing_there(panels: ModuleType, scene: Any) -> None:
    shown = draw_all(panels, material=None)
    assert operators(shown["VOCC_PT_render"]) == ["vocc.setup"]
    assert [name for name, items in shown.items() if items is not None] == [
        "VOCC_PT_render",
        "VOCC_PT_view",
    ]


def test_every_kind_of_active_object(panels: ModuleType, full: Any) -> None:
    bpy.ops.object.text_add()
    bpy.ops.object.empty_add()
    for obj in (None, *bpy.data.objects):
        bpy.context.view_layer.objects.active = obj
        shown = draw_all(panels, material=None)["VOCC_PT_object"]
        assert (shown is not None) == (obj is not None and obj.type in ("MESH", "FONT"))


def test_set_up(panels: ModuleType, full: Any) -> None:
    bpy.ops.vocc.setup()
    shown = draw_all(panels, material=None)
    main = shown["VOCC_PT_render"]
    assert operators(main) == ["vocc.render_masks"]
    assert [item.text for item in main] == ["Render Masks"]
    rows = shown["VOCC_PT_render_compositing"]
    assert [item.text for item in rows] == ["Key", "", "", "px"]
    assert all(item.active for item in rows)
    assert shown["VOCC_PT_render_passes"] and shown["VOCC_PT_render_report"] is None
    # The same is to be seen from the shadow scene.
    shadow = bpy.data.scenes["Scene Shadows"]
    assert repr(draw_all(panels, material=None, scene=shadow)) == repr(shown)


def test_out_of_date(panels: ModuleType, full: Any) -> None:
    bpy.ops.vocc.setup()
    add_light(full, "Rim")
    main = draw(panels.RenderPanel)
    assert operators(main) == ["vocc.setup", "vocc.render_masks"]
    assert main[0].text == "Update Shadow Passes"
    bpy.ops.vocc.setup()
    assert operators(draw(panels.RenderPanel)) == ["vocc.render_masks"]


def test_warnings(panels: ModuleType, full: Any, report: ModuleType) -> None:
    bpy.ops.vocc.setup()
    report.LAST["Scene Shadows"] = a_report(report, "Scene Shadows")
    full.camera = None
    full.render.use_compositing = False
    shown = draw_all(panels, material=None)
    text = " ".join(texts(shown["VOCC_PT_render"]))
    for expected in (
        "The scene has no camera",
        "The compositor is off",
        "the area light 'Key' has no area",
        "Left out: Hair",
        "Open, so slower: Floor",
    ):
        assert expected in text
    assert not any(item.active for item in shown["VOCC_PT_render_compositing"])


def test_masks_that_lead_nowhere(panels: ModuleType, full: Any) -> None:
    bpy.ops.vocc.setup()
    tree = getattr(full, "compositing_node_group", None) or full.node_tree
    node = tree.nodes["Shadow Masks"]
    tree.links.remove(node.outputs[0].links[0])
    text = " ".join(texts(draw(panels.RenderPanel)))
    assert "Link the node 'Shadow Masks' in the compositor" in text
    tree.nodes.remove(node)
    text = " ".join(texts(draw(panels.RenderPanel)))
    assert "The masks' node is gone" in text


def test_report(panels: ModuleType, full: Any, report: ModuleType) -> None:
    bpy.ops.vocc.setup()
    found = a_report(report, "Scene Shadows")
    report.LAST["Scene Shadows"] = found
    items = draw(panels.RenderReportPanel)
    text = "\n".join(texts(items))
    for expected in (
        "1.30 s for 1 mask, 1920 x 1080",
        "123 k triangles",
        "1 of 2 objects closed",
        "Floor: 4 open edges",
        "Hair: hair curves are not meshes",
        "10 M rays, 10.0 million a second",
        "occluders\n40.0 %",
        "Trace\n1.00 s",
    ):
        assert expected in text
    (select,) = (item for item in items if item.name == "vocc.select_open_edges")
    assert select.values == {"object": "Floor"}

    many = tuple(replace(found.objects[0], name=f"Part {i}") for i in range(200))
    report.LAST["Scene Shadows"] = replace(found, objects=many, left_out=found.left_out * 50)
    items = draw(panels.RenderReportPanel)
    assert operators(items).count("vocc.select_open_edges") == 12
    assert "and 188 more in the full report" in texts(items)
    assert len(draw(panels.RenderPanel)) < 40

    report.LAST["Scene Shadows"] = report.Report("Scene Shadows", (4, 4), (), 1, 1, 0)
    assert draw(panels.RenderReportPanel)


def test_object(panels: ModuleType, full: Any, report: ModuleType) -> None:
    bpy.ops.vocc.setup()
    report.LAST["Scene Shadows"] = a_report(report, "Scene Shadows")
    cube = bpy.data.objects["Cube"]
    items = draw(panels.ObjectPanel, object=cube)
    assert [item.name for item in items if item.kind == "prop"] == ["exclude"]
    assert "Closed: stops shadow rays inside" in texts(items)
    cube.name = "Floor"
    items = draw(panels.ObjectPanel, object=cube)
    assert operators(items) == ["vocc.select_open_edges"] and "4 open edges" in texts(items)


def test_material(panels: ModuleType, full: Any) -> None:
    material = bpy.data.materials.new("Leaf")
    assert draw(panels.MaterialPanel, material=None) is None
    assert [each.name for each in draw(panels.MaterialPanel, material=material)] == ["not_solid"]


def test_passes_and_bake_follow_the_settings(panels: ModuleType, full: Any) -> None:
    full.render.engine = "VOCC"
    assert operators(draw(panels.RenderPanel)) == ["vocc.render_masks"]
    items = {item.name: item for item in draw(panels.RenderPassesPanel)}
    assert items["samples"].active and not items["ao_samples"].active and "offset" not in items
    full.vocc.use_shadow_masks, full.vocc.use_ao, full.vocc.use_auto_offset = False, True, False
    items = {item.name: item for item in draw(panels.RenderPassesPanel)}
    assert not items["samples"].active and items["ao_samples"].active and "offset" in items
    assert draw(panels.RenderCompositingPanel) is None

    items = draw(panels.RenderBakePanel)
    assert [item.values["type"] for item in items if item.kind == "operator"] == ["SHADOW", "AO"]
    assert "1 selected mesh, all lights" in texts(items)
    assert "margin" in [item.name for item in items]
    bpy.data.objects["Key"].select_set(True)
    full.render.bake.target = "VERTEX_COLORS"
    items = draw(panels.RenderBakePanel)
    assert "1 selected mesh, 1 selected light" in texts(items)
    assert "margin" not in [item.name for item in items]


def test_check(panels: ModuleType, full: Any, addon: ModuleType) -> None:
    cycles_check = import_module(f"{addon.__name__}.cycles_check")
    bpy.ops.vocc.setup()
    assert operators(draw(panels.RenderCheckPanel)) == ["vocc.check_against_cycles"]
    blank = np.zeros((1, 1), np.float32)
    cycles_check.LAST["Scene"] = (
        cycles_check.Comparison("Key", 0.01, 0.2, 0.005, 100, blank, blank),
        cycles_check.Comparison("Back", 0, 0, 0, 0, blank, blank),
    )
    text = list(texts(draw(panels.RenderCheckPanel)))
    assert text[1:] == [
        "Key",
        "differs by 0.0100 (RMS)",
        "noise of Cycles 0.0050",
        "Back",
        "lights nothing that is seen",
    ]


def test_many_lights(panels: ModuleType, full: Any) -> None:
    for index in range(40):
        add_light(full, f"Light {index} 💡.001")
    bpy.ops.vocc.setup()
    items = draw(panels.RenderCompositingPanel)
    assert sum(item.kind == "prop" for item in items) == 3 * 12
    assert "and 29 more in the compositor" in texts(items)


@pytest.mark.parametrize(
    "mistake",
    [
        lambda layout: layout.lable(text="x"),
        lambda layout: layout.label(txt="x"),
        lambda layout: layout.label(text="x", icon="NO_SUCH"),
        lambda layout: layout.label(text=1),
        lambda layout: layout.prop(bpy.context.scene.vocc, "no_such"),
        lambda layout: layout.prop(bpy.context.scene.vocc),
        lambda layout: layout.operator("vocc.no_such"),
        lambda layout: setattr(layout.operator("vocc.setup"), "no_such", 1),
        lambda layout: setattr(layout.operator("vocc.bake"), "type", "NO_SUCH"),
        lambda layout: setattr(layout.row(), "no_such", 1),
    ],
)
def test_mistakes_are_found(scene: Any, mistake: Any) -> None:
    with pytest.raises(AssertionError):
        mistake(FakeLayout([]))
