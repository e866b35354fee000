# SPDX-License-Identifier: GPL-3.0-or-later
"""The render engine: shadow masks as passes, tile by tile."""

from __future__ import annotations

import time
import traceback
from collections.abc import Callable, Collection, Iterator
from dataclasses import replace
from typing import NamedTuple

import bpy
import numpy as np

import pyvocc

from . import report as reports
from .bake import bake as bake_masks
from .camera import view_of
from .compat import bring_up_to_date, set_pass
from .data import Settings
from .extract import read_world
from .masks import COMBINED, MaskJob
from .names import AO_PASS, pass_names
from .properties import settings_of
from .report import Report

# Sub-pixels along an edge of a tile: large enough to cost no speed, small enough to be seen early
# and for the memory of many lights.
TILE = 256

# Seconds between two looks at whether the user wants to stop.
POLL = 0.03

# Of the whole progress, what building takes.
BUILD_SHARE = 0.1

# Warnings of one render that are shown one by one.
SHOWN_NOTICES = 5


# How an object makes instances of its children.
_BY_MESH = ("VERTS", "FACES")

# What the user's scene may lead to; the texts say why.
ERRORS = (ValueError, MemoryError, pyvocc.Error)


class Region(NamedTuple):
    """The rectangle of the full frame that is rendered, in pixels from its lower left."""

    x: int
    y: int
    width: int
    height: int


class VoccEngine(bpy.types.RenderEngine):
    """Shadow masks of every light, and ambient occlusion."""

    bl_idname = "VOCC"
    bl_label = "Volumetric Occluders"
    # Previews of materials are left to Blender's own engines, and so is the viewport.
    bl_use_preview = False
    bl_use_eevee_viewport = True

    def update_render_passes(
        self, scene: bpy.types.Scene = None, renderlayer: bpy.types.ViewLayer = None
    ) -> None:
        """Tells the compositor which passes there will be."""
        settings = settings_of(scene)
        # In a render it is a copy of the view layer that knows no collections.
        layer = scene.view_layers[renderlayer.name]
        names = [*pass_names(light_names(layer))] if settings.masks else []
        if settings.ao:
            names.append(AO_PASS)
        self.register_pass(scene, renderlayer, COMBINED, 4, "RGBA", "COLOR")
        for name in names:
            self.register_pass(scene, renderlayer, name, 1, "X", "VALUE")

    def render(self, depsgraph: bpy.types.Depsgraph) -> None:
        """F12."""
        render(self, depsgraph)

    def bake(
        self,
        depsgraph: bpy.types.Depsgraph,
        obj: bpy.types.Object,
        pass_type: str,
        pass_filter: int,
        width: int,
        height: int,
    ) -> None:
        """The Bake button."""
        bake_masks(self, depsgraph, obj, pass_type, pass_filter, width, height)


def render(engine: bpy.types.RenderEngine, depsgraph: bpy.types.Depsgraph) -> None:
    """Renders a view layer; errors of the scene are reported to the user.

    Args:
        engine: that Blender has called.
        depsgraph: given by Blender.
    """
    try:
        report = _render(engine, depsgraph)
    except pyvocc.Cancelled:
        return
    except ERRORS as error:
        text = str(error) or "there is not enough memory"
        engine.report({"ERROR"}, text[:1].upper() + text[1:])
        return
    except Exception as error:
        # A fault of the add-on's. If it left the engine, Blender could crash.
        traceback.print_exc()
        engine.report({"ERROR"}, f"Internal error, see the console: {error!r}")
        return
    reports.LAST[report.scene] = report
    for notice in report.notices[:SHOWN_NOTICES]:
        engine.report({"WARNING"}, notice)
    if len(report.notices) > SHOWN_NOTICES:
        engine.report({"WARNING"}, f"and {len(report.notices) - SHOWN_NOTICES} more warnings")
    if bpy.app.background:
        print(f"{report.scene}: {report.summary()}")


def prepared_job(
    engine: bpy.types.RenderEngine,
    depsgraph: bpy.types.Depsgraph,
    settings: Settings,
    camera: bpy.types.Object | None = None,
    lights: Collection[str] | None = None,
) -> tuple[MaskJob, Region]:
    """What is needed to compute tiles, and the rectangle that they make up.

    Args:
        engine, depsgraph: as in `render`.
        settings: how masks are made.
        camera: the original object, instead of the scene's.
        lights: names of the original light objects wanted; None for all.

    Raises:
        One of `ERRORS`; pyvocc.Cancelled if the user stops it.
    """
    scene = depsgraph.scene
    if scene.render.use_multiview:
        raise ValueError("Stereoscopy is not supported: turn it off in the output properties")
    camera = camera or engine.camera_override or scene.camera
    if camera is None:
        raise ValueError(f"The scene '{scene.name}' has no camera")
    width, height = engine.resolution_x, engine.resolution_y
    view = view_of(scene, camera.evaluated_get(depsgraph), width, height)

    engine.update_stats("", "Reading the scene")
    start = time.perf_counter()
    world = read_world(depsgraph)
    if lights is not None:
        chosen = tuple(light for light in world.lights if light.object_name in lights)
        world = replace(world, lights=chosen)
    job = MaskJob(world, view, settings)
    job.points.seconds = {"extract": time.perf_counter() - start, **job.points.seconds}
    engine.update_stats("", "Building the tree")
    job.prepare(Poll(engine).part(0.0, BUILD_SHARE))
    return job, region_of(scene.render, width, height)


def _render(engine: bpy.types.RenderEngine, depsgraph: bpy.types.Depsgraph) -> Report:
    job, region = prepared_job(engine, depsgraph, settings_of(depsgraph.scene))
    layer = depsgraph.view_layer_eval.name
    for name in job.pass_names:
        engine.add_pass(name, 1, "X", layer=layer)
    poll = Poll(engine)
    found = tiles(region.width, region.height, job.settings.aa)
    share = (1.0 - BUILD_SHARE) / len(found)
    for index, (x, y, width, height) in enumerate(found):
        engine.update_stats("", f"Tile {index + 1} of {len(found)}")
        progress = poll.part(BUILD_SHARE + share * index, BUILD_SHARE + share * (index + 1))
        result = engine.begin_result(x, y, width, height, layer=layer)
        try:
            passes = job.tile(region.x + x, region.y + y, width, height, progress)
        except BaseException:
            engine.end_result(result, cancel=True)
            raise
        with job.points.timed("hand back"):
            for target in result.layers[0].passes:
                if target.name in passes:
                    set_pass(target, passes[target.name])
            engine.end_result(result)
    engine.update_progress(1.0)
    return job.report(depsgraph.scene.name, (region.width, region.height))


def light_names(layer: bpy.types.ViewLayer) -> list[str]:
    """Names of the lights that a view layer renders, as `extract` makes them, in order.

    Lights that geometry nodes or the vertices and faces of a mesh make are known only when they
    are rendered: they get a pass, but no socket in the compositor.
    """
    names: list[str] = []
    bring_up_to_date(layer)
    for object in _rendered(layer.layer_collection):
        # Its instances are rendered in its place.
        is_pattern = object.parent is not None and object.parent.instance_type in _BY_MESH
        if object.type == "LIGHT" and not is_pattern:
            names.append(object.name)
        names += (f"{light.name} in {object.name}" for light in _instanced(object))
    return sorted(names)


def _rendered(layer: bpy.types.LayerCollection) -> Iterator[bpy.types.Object]:
    """The objects of a collection and of those in it, each once."""
    found: dict[bpy.types.Object, None] = {}
    waiting = [layer]
    while waiting:
        each = waiting.pop()
        if each.collection.hide_render:
            continue
        waiting += each.children
        if not each.exclude:
            found.update((object, None) for object in each.collection.objects)
    return (object for object in found if not object.hide_render)


def _instanced(instancer: bpy.types.Object) -> Iterator[bpy.types.Object]:
    """The lights in the collection that an object is an instance of, and in those in it."""
    if instancer.instance_type != "COLLECTION" or instancer.instance_collection is None:
        return
    for object in instancer.instance_collection.all_objects:
        if object.hide_render:
            continue
        if object.type == "LIGHT":
            yield object
        yield from _instanced(object)


class Poll:
    """Progress from pyvocc to Blender, and ESC back."""

    def __init__(self, engine: bpy.types.RenderEngine) -> None:
        self._engine = engine
        self._last = -POLL

    def part(self, lower: float, upper: float) -> Callable[[float], bool]:
        """The progress callback of a part of the whole."""

        def progress(fraction: float) -> bool:
            now = time.perf_counter()
            if now - self._last < POLL:
                return False
            self._last = now
            self._engine.update_progress(lower + fraction * (upper - lower))
            return self.stopped()

        return progress

    def stopped(self) -> bool:
        """The user wants to stop."""
        return bool(self._engine.test_break())


def region_of(render: bpy.types.RenderSettings, width: int, height: int) -> Region:
    """What the render border leaves of the frame."""
    if not render.use_border:
        return Region(0, 0, width, height)
    # As Blender rounds them: products in single precision, cut.
    left, right = (
        int(np.float32(edge) * np.float32(width))
        for edge in (render.border_min_x, render.border_max_x)
    )
    lower, upper = (
        int(np.float32(edge) * np.float32(height))
        for edge in (render.border_min_y, render.border_max_y)
    )
    return Region(left, lower, right - left, upper - lower)


def tiles(width: int, height: int, aa: int) -> list[tuple[int, int, int, int]]:
    """x, y, width and height of the tiles, those in the middle first."""
    edge = max(TILE // aa, 1)

    def distance(tile: tuple[int, int, int, int]) -> float:
        x, y, w, h = tile
        return (x + w / 2 - width / 2) ** 2 + (y + h / 2 - height / 2) ** 2

    found = [
        (x, y, min(edge, width - x), min(edge, height - y))
        for y in range(0, height, edge)
        for x in range(0, width, edge)
    ]
    return sorted(found, key=distance)


def _panels() -> Iterator[type[bpy.types.Panel]]:
    """Blender's own panels whose settings this engine honours."""
    for panel in bpy.types.Panel.__subclasses__():
        engines = getattr(panel, "COMPAT_ENGINES", ())
        general = "BLENDER_RENDER" in engines and not any(
            name in panel.__name__ for name in ("freestyle", "stereoscopy", "output_views")
        )
        # Those two have the size of lights, and whether they cast shadows.
        if general or panel.__name__ in ("DATA_PT_EEVEE_light", "DATA_PT_EEVEE_light_shadow"):
            yield panel


def register() -> None:
    """Makes the engine known to Blender."""
    bpy.utils.register_class(VoccEngine)
    for panel in _panels():
        panel.COMPAT_ENGINES.add(VoccEngine.bl_idname)


def unregister() -> None:
    """Without it Blender hangs or crashes when it exits."""
    for panel in _panels():
        panel.COMPAT_ENGINES.discard(VoccEngine.bl_idname)
    bpy.utils.unregister_class(VoccEngine)
