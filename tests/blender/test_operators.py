"""The operators from a script: what they do, and what they say where they cannot."""

from __future__ import annotations

from importlib import import_module
from types import ModuleType, SimpleNamespace
from typing import Any

import bmesh
import bpy
import pytest


@pytest.fixture
def operators(addon: ModuleType) -> ModuleType:
    return import_module(f"{addon.__name__}.operators")


@pytest.fixture
def scene(addon: ModuleType, empty: bpy.types.Scene) -> bpy.types.Scene:
    """A cube on a floor, a light and a camera, in Cycles."""
    empty.render.engine = "CYCLES"
    empty.render.resolution_x = empty.render.resolution_y = 16
    bpy.ops.mesh.primitive_plane_add(size=6)
    bpy.context.object.name = "Floor"
    bpy.ops.mesh.primitive_cube_add(location=(0, 0, 1.5))
    light = bpy.data.objects.new("Key", bpy.data.lights.new("Key", "SUN"))
    camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    camera.location.z = 12
    for each in (light, camera):
        empty.collection.objects.link(each)
    empty.camera = camera
    return empty


def delete_faces(obj: Any, count: int) -> None:
    mesh = bmesh.new()
    mesh.from_mesh(obj.data)
    mesh.faces.ensure_lookup_table()
    bmesh.ops.delete(mesh, geom=mesh.faces[:count], context="FACES_ONLY")
    mesh.to_mesh(obj.data)
    mesh.free()


def selected_edges(obj: Any) -> set[frozenset[int]]:
    assert obj.mode == "EDIT"
    grid = bmesh.from_edit_mesh(obj.data)
    return {frozenset(v.index for v in each.verts) for each in grid.edges if each.select}


def border(obj: Any) -> set[frozenset[int]]:
    """Edges of one face."""
    uses: dict[frozenset[int], int] = {}
    for face in obj.data.polygons:
        for edge in face.edge_keys:
            uses[frozenset(edge)] = uses.get(frozenset(edge), 0) + 1
    return {edge for edge, count in uses.items() if count == 1}


def said(capfd: pytest.CaptureFixture[str]) -> str:
    """What Blender prints of an operator's reports."""
    return capfd.readouterr().out


# ---- set-up, render, report --------------------------------------------------


def test_setup(scene: Any, capfd: pytest.CaptureFixture[str]) -> None:
    assert not bpy.ops.vocc.render_masks.poll()
    assert bpy.ops.vocc.setup() == {"FINISHED"}
    assert "1 mask in the scene 'Scene Shadows'" in said(capfd)
    assert bpy.ops.vocc.setup() == {"FINISHED"} and len(bpy.data.scenes) == 2
    assert bpy.ops.vocc.render_masks.poll()


def test_setup_without_lights(scene: Any, capfd: pytest.CaptureFixture[str]) -> None:
    bpy.data.objects.remove(bpy.data.objects["Key"])
    assert bpy.ops.vocc.setup() == {"FINISHED"}
    assert "there is no light in the render" in said(capfd)


def test_setup_says_why_not(scene: Any) -> None:
    scene.render.engine = "VOCC"
    with pytest.raises(RuntimeError, match="its passes are shadow masks already"):
        bpy.ops.vocc.setup()


def test_render_and_report(scene: Any, operators: ModuleType) -> None:
    bpy.ops.vocc.setup()
    assert not bpy.ops.vocc.print_report.poll()
    assert bpy.ops.vocc.render_masks() == {"FINISHED"}
    found = operators.last_report(scene)
    assert found.masks == ("Shadow Key",) and found.size == (16, 16)
    assert {part.name: part.closed for part in found.objects} == {"Cube": True, "Floor": False}
    assert bpy.ops.vocc.print_report() == {"FINISHED"}
    assert found.summary() in bpy.data.texts["Shadow Masks Report"].as_string()
    assert bpy.ops.vocc.print_report() == {"FINISHED"} and len(bpy.data.texts) == 1


def test_render_says_why_not(scene: Any) -> None:
    bpy.ops.vocc.setup()
    scene.camera = None
    bpy.ops.vocc.setup()
    with pytest.raises(RuntimeError, match="camera"):
        bpy.ops.vocc.render_masks()


def test_bake_says_why_not(scene: Any) -> None:
    bpy.ops.object.select_all(action="DESELECT")
    assert not bpy.ops.vocc.bake.poll()
    bpy.ops.vocc.setup()
    assert not bpy.ops.vocc.bake.poll()
    bpy.data.objects["Floor"].select_set(True)
    with pytest.raises(RuntimeError, match="No active image found"):
        bpy.ops.vocc.bake(type="AO")


# ---- open edges --------------------------------------------------------------


def test_open_edges_from_object_mode(scene: Any, capfd: pytest.CaptureFixture[str]) -> None:
    cube = bpy.data.objects["Cube"]
    delete_faces(cube, 1)
    bpy.context.view_layer.objects.active = bpy.data.objects["Floor"]
    assert bpy.ops.vocc.select_open_edges(object="Cube") == {"FINISHED"}
    assert bpy.context.active_object == cube
    assert selected_edges(cube) == border(cube) and len(border(cube)) == 4
    assert tuple(bpy.context.tool_settings.mesh_select_mode) == (False, True, False)
    assert "4 open edges of 'Cube'" in said(capfd)


def test_open_edges_in_edit_mode(scene: Any) -> None:
    cube = bpy.data.objects["Cube"]
    bpy.ops.object.mode_set(mode="EDIT")
    grid = bmesh.from_edit_mesh(cube.data)
    grid.faces.ensure_lookup_table()
    # Not yet in the mesh itself; and hidden.
    bmesh.ops.delete(grid, geom=[grid.faces[0]], context="FACES_ONLY")
    for face in grid.faces:
        face.hide_set(True)
    bmesh.update_edit_mesh(cube.data)
    assert bpy.ops.vocc.select_open_edges() == {"FINISHED"}
    assert len(selected_edges(cube)) == 4
    bpy.ops.object.mode_set(mode="OBJECT")
    assert border(cube) == {frozenset(edge.vertices) for edge in cube.data.edges if edge.select}


def test_open_edges_from_the_edit_mode_of_another(scene: Any) -> None:
    cube, floor = bpy.data.objects["Cube"], bpy.data.objects["Floor"]
    bpy.ops.object.mode_set(mode="EDIT")
    assert bpy.ops.vocc.select_open_edges(object="Floor") == {"FINISHED"}
    assert cube.mode == "OBJECT" and selected_edges(floor) == border(floor)


def test_closed_meshes(scene: Any, capfd: pytest.CaptureFixture[str]) -> None:
    cube = bpy.data.objects["Cube"]
    # Split at every edge, and closed all the same.
    bpy.ops.object.mode_set(mode="EDIT")
    bpy.ops.mesh.edge_split(type="EDGE")
    bpy.ops.object.mode_set(mode="OBJECT")
    assert len(cube.data.vertices) == 24
    assert bpy.ops.vocc.select_open_edges() == {"FINISHED"}
    assert cube.mode == "OBJECT" and "'Cube' is closed" in said(capfd)


def test_open_edges_under_modifiers(scene: Any, capfd: pytest.CaptureFixture[str]) -> None:
    cube = bpy.data.objects["Cube"]
    delete_faces(cube, 1)
    cube.modifiers.new("Bend", "SIMPLE_DEFORM")
    bpy.ops.vocc.select_open_edges()
    assert len(selected_edges(cube)) == 4 and "without its modifiers" not in said(capfd)
    bpy.ops.object.mode_set(mode="OBJECT")
    cube.modifiers.new("Thick", "SOLIDIFY")
    bpy.ops.vocc.select_open_edges()
    assert len(selected_edges(cube)) == 4
    assert "4 open edges of 'Cube' (of the mesh without its modifiers)" in said(capfd)


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("Key", "'Key' is not a mesh"),
        ("Nobody", "There is no object 'Nobody' in the view layer 'ViewLayer'"),
        ("Hidden", "'Hidden' is hidden"),
    ],
)
def test_open_edges_says_why_not(scene: Any, name: str, text: str) -> None:
    hidden = bpy.data.objects.new("Hidden", bpy.data.meshes.new("Hidden"))
    scene.collection.objects.link(hidden)
    hidden.hide_set(True)
    with pytest.raises(RuntimeError, match=text):
        bpy.ops.vocc.select_open_edges(object=name)


def test_open_edges_of_nothing(scene: Any, capfd: pytest.CaptureFixture[str]) -> None:
    bpy.context.view_layer.objects.active = None
    with pytest.raises(RuntimeError, match="There is no active object"):
        bpy.ops.vocc.select_open_edges()
    blank = bpy.data.objects.new("Blank", bpy.data.meshes.new("Blank"))
    scene.collection.objects.link(blank)
    assert bpy.ops.vocc.select_open_edges(object="Blank") == {"FINISHED"}
    assert "'Blank' has no faces" in said(capfd)


# ---- check against Cycles ----------------------------------------------------


def test_check(scene: Any, capfd: pytest.CaptureFixture[str]) -> None:
    assert bpy.ops.vocc.check_against_cycles(size=16, samples=64) == {"FINISHED"}
    assert "Key: RMS difference 0.0" in said(capfd)
    assert tuple(bpy.data.images["Check Key"].size) == (48, 16)


def test_check_says_why_not(scene: Any) -> None:
    scene.camera = None
    with pytest.raises(RuntimeError, match="The scene 'Scene' has no camera"):
        bpy.ops.vocc.check_against_cycles()


class _Beside:
    """The check as it runs beside a user, and what it does with Blender."""

    def __init__(self, operators: ModuleType, steps: Any) -> None:
        self.log: list[str] = []
        self.operator = SimpleNamespace(
            _steps=steps,
            _timer=None,
            _end=lambda context: operators.CheckAgainstCycles._end(self.operator, context),
            _finish=lambda: {"FINISHED"},
            report=lambda kind, text: self.log.append(text),
        )
        self.context = SimpleNamespace(
            window_manager=SimpleNamespace(
                progress_update=lambda value: self.log.append(f"{value} %"),
                progress_end=lambda: self.log.append("end"),
                event_timer_remove=lambda timer: self.log.append("no timer"),
            ),
            workspace=SimpleNamespace(status_text_set=lambda text: None),
        )
        self.modal = lambda kind: operators.CheckAgainstCycles.modal(
            self.operator, self.context, SimpleNamespace(type=kind)
        )


def test_check_beside_a_user(operators: ModuleType) -> None:
    closed = []

    def steps() -> Any:
        try:
            yield 0.5
            yield 1.0
        finally:
            closed.append(True)

    run = _Beside(operators, steps())
    assert run.modal("MOUSEMOVE") == {"RUNNING_MODAL"} and not run.log
    assert run.modal("TIMER") == {"RUNNING_MODAL"} and run.log == ["50 %"]
    assert run.modal("ESC") == {"CANCELLED"}
    assert closed and run.log == ["50 %", "no timer", "end", "Stopped"]

    run = _Beside(operators, steps())
    assert [run.modal("TIMER") for _ in range(3)][-1] == {"FINISHED"}
    assert run.log == ["50 %", "100 %", "no timer", "end"]


def test_check_that_fails_beside_a_user(operators: ModuleType) -> None:
    def steps() -> Any:
        raise ValueError("The light 'Key' is broken")
        yield

    run = _Beside(operators, steps())
    assert run.modal("TIMER") == {"CANCELLED"}
    assert run.log == ["no timer", "end", "The light 'Key' is broken"]
