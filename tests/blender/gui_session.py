"""What gui_smoke.py has Blender 3.4 do; each step waits for a file, and is told on a line.

What the add-on takes from Blenders newer than this one is replaced here, not there.
"""

from __future__ import annotations

import importlib
import os
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import bpy

ROOT = Path(__file__).resolve().parents[2]
GO = Path(os.environ["VOCC_GO"])

sys.dont_write_bytecode = True
sys.path[:0] = [os.environ["VOCC_SITE"]]
# The checkout last, so that pyvocc is the wheel's.
sys.path.append(str(ROOT))

# NumPy is there too where Blender's Python has none.
import numpy as np  # noqa: E402

data = importlib.import_module("blender_addon.data")
engine = importlib.import_module("blender_addon.engine")
lights = importlib.import_module("blender_addon.lights")
panels = importlib.import_module("blender_addon.panels")


def say(*words: Any) -> None:
    print(*words, flush=True)


def read_world(depsgraph: Any) -> Any:
    """As the add-on's, by what there is in 3.4: no links of lights, no index of corners."""
    parts, found = [], []
    for instance in depsgraph.object_instances:
        obj, matrix = instance.object, np.array(instance.matrix_world, float)
        if obj.type == "LIGHT":
            found.append(lights.read_light(obj, matrix, obj.name))
        elif obj.type == "MESH":
            mesh = obj.data
            mesh.calc_loop_triangles()
            vertices = np.empty((len(mesh.vertices), 3), np.float32)
            mesh.vertices.foreach_get("co", vertices.ravel())
            triangles = np.empty((len(mesh.loop_triangles), 3), np.int32)
            mesh.loop_triangles.foreach_get("vertices", triangles.ravel())
            parts.append(
                data.Part(
                    name=obj.name,
                    object_name=obj.original.name,
                    vertices=vertices,
                    triangles=triangles,
                    matrix=matrix,
                )
            )
    return data.World(parts=tuple(parts), lights=tuple(found))


def set_pass(render_pass: Any, values: Any) -> None:
    """A pass takes a list of pixels."""
    render_pass.rect = values.reshape(-1, render_pass.channels).tolist()
    if render_pass.name == "Combined":
        say("TILE")


def make_scene() -> Any:
    """Balls and an open cup on a floor under three area lights."""
    for obj in list(bpy.data.objects):
        bpy.data.objects.remove(obj)
    scene = bpy.context.scene
    bpy.ops.mesh.primitive_plane_add(size=16)
    bpy.context.object.name = "Floor"
    for index in range(16):
        x, y = divmod(index, 4)
        bpy.ops.mesh.primitive_ico_sphere_add(
            subdivisions=6, radius=0.7, location=(2 * x - 3, 2 * y - 3, 1 + 0.3 * (x + y))
        )
    bpy.ops.mesh.primitive_cylinder_add(
        vertices=512, radius=0.5, location=(0, 0, 4), end_fill_type="NOTHING"
    )
    bpy.context.object.name = "Cup"
    for name, x, y in (("Key", -5, -4), ("Fill", 5, -3), ("Rim", 0, 6)):
        light = bpy.data.objects.new(name, bpy.data.lights.new(name, "AREA"))
        light.location, light.data.size = (x, y, 8), 2.0
        light.rotation_euler = light.location.to_track_quat("Z", "Y").to_euler()
        scene.collection.objects.link(light)
    camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    camera.location = (0, -13, 10)
    camera.rotation_euler = camera.location.to_track_quat("Z", "Y").to_euler()
    scene.collection.objects.link(camera)
    scene.camera = camera
    scene.render.engine = "VOCC"
    scene.render.resolution_x, scene.render.resolution_y = 960, 540
    return scene


def show() -> None:
    """The render properties and the sidebar, and renders in place of the 3D view."""
    bpy.context.preferences.view.render_display_type = "AREA"
    for area in bpy.context.window.screen.areas:
        if area.type == "PROPERTIES":
            area.spaces.active.context = "RENDER"
        if area.type == "VIEW_3D":
            area.spaces.active.show_region_ui = True
            area.spaces.active.region_3d.view_perspective = "CAMERA"


def on_end(word: str) -> Callable[..., None]:
    def handler(*_: Any) -> None:
        say(word, time.time() if word == "CANCELLED" else f"{time.time() - started[0]:.2f}")

    return handler


started = [0.0]


def render() -> None:
    started[0] = time.time()
    bpy.ops.render.render("INVOKE_DEFAULT")
    say("RENDERING")


def steps() -> Iterator[None]:
    """Each waits to be told to go on."""
    scene = make_scene()
    show()
    say("READY")
    yield
    scene.vocc.samples, scene.vocc.aa = 24, 1
    render()
    yield
    scene.vocc.samples, scene.vocc.aa = 4096, 4
    for _ in range(3):
        render()
        yield
    say("DONE")


def tick(step: Iterator[None]) -> Callable[[], float | None]:
    next(step)

    def poll() -> float | None:
        if not GO.exists() or bpy.app.is_job_running("RENDER"):
            return 0.05
        GO.unlink()
        return None if next(step, "end") == "end" else 0.05

    return poll


addon = importlib.import_module("blender_addon")
engine.read_world, engine.set_pass = read_world, set_pass
for panel in (panels.RenderReportPanel, panels.ViewReportPanel):
    # To be looked at.
    panel.bl_options = set()
addon.register()
bpy.app.handlers.render_complete.append(on_end("COMPLETE"))
bpy.app.handlers.render_cancel.append(on_end("CANCELLED"))
# The window is there when the first timer runs.
bpy.app.timers.register(lambda: bpy.app.timers.register(tick(steps())), first_interval=1.0)
