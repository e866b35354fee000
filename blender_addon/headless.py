# SPDX-License-Identifier: GPL-3.0-or-later
"""Masks as arrays, for scripts and data sets."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from typing import Any

import bpy
import numpy as np

from .data import Settings
from .engine import Poll, prepared_job, tiles
from .masks import Floats
from .properties import settings_of

_ENGINE = "VOCC_ARRAYS"


def shadow_masks(
    scene: bpy.types.Scene | None = None,
    camera: bpy.types.Object | str | None = None,
    lights: Iterable[bpy.types.Object | str] | None = None,
    samples: int | None = None,
    aa: int | None = None,
    size: tuple[int, int] | None = None,
    ao: bool = False,
    **settings: Any,
) -> dict[str, Floats]:
    """The shadow mask of each light of a scene, as the camera sees it at the current frame.

    The same scene gives the same arrays, bit for bit. The add-on need not be switched on. The
    scene is left as it was; the image "Render Result" shows the last masks.

    Args:
        scene: default: the current one.
        camera: an object of type CAMERA, or its name; default: the scene's.
        lights: light objects or their names; default: all that render.
        samples: of each light and sub-pixel, 1 to 65534.
        aa: sub-pixels along an edge of a pixel; 1 takes the pixels' centres.
        size: width and height in pixels; default: the scene's.
        ao: ambient occlusion as well.
        **settings: other fields of `blender_addon.data.Settings`: masks, ao_distance,
            ao_samples, irradiance, offset, threads. What is not given is as in the scene's
            settings.

    Returns:
        float32 (height, width) by the name of the light, the top row first: 1 lit, 0 dark. An
        instance of a light has a name of its own. Ambient occlusion is called "VOcc AO".

    Raises:
        ValueError: says what is wrong with an argument or with the scene.
        RuntimeError: another render is under way.
    """
    scene = scene or bpy.context.scene
    chosen = dataclasses.replace(settings_of(scene), ao=ao, **settings)
    if samples is not None:
        chosen = dataclasses.replace(chosen, samples=samples)
    if aa is not None:
        chosen = dataclasses.replace(chosen, aa=aa)
    check(chosen)
    camera = _object(camera, "CAMERA") or scene.camera
    if camera is None:
        raise ValueError(f"the scene '{scene.name}' has no camera")
    names = None
    if lights is not None:
        names = {_object(light, "LIGHT").name_full for light in lights}
    output = {"use_compositing": False, "use_sequencer": False, **_size(size)}
    with _changed(scene, camera=camera), _changed(scene.render, **output):
        return _render(scene, camera, names, chosen)


def check(settings: Settings) -> None:
    """Raises a ValueError that names the setting that is out of range."""
    for name, lower, upper in (
        ("samples", 1, 65534),
        ("aa", 1, 16),
        ("ao_samples", 1, 65534),
        ("threads", 0, 256),
    ):
        value = getattr(settings, name)
        if not lower <= value <= upper:
            raise ValueError(f"{name} must be from {lower} to {upper}, got {value}")
    if not settings.ao_distance > 0:
        raise ValueError(f"ao_distance must be above 0, got {settings.ao_distance}")
    if settings.offset is not None and not 0 <= settings.offset < float("inf"):
        raise ValueError(f"offset must be at least 0 and finite, got {settings.offset}")


class _ArrayEngine(bpy.types.RenderEngine):
    """Blender shows a scene as it is in renders to engines alone. Registered for one call."""

    bl_idname = _ENGINE
    bl_label = "Shadow Masks to Arrays"
    bl_use_preview = False

    # Of the call under way: what it wants, and what is raised on the way.
    work: Callable[[bpy.types.RenderEngine, bpy.types.Depsgraph], None] | None = None
    error: BaseException | None = None

    def render(self, depsgraph: bpy.types.Depsgraph) -> None:
        cls = type(self)
        try:
            cls.work(self, depsgraph)
        except BaseException as error:
            cls.error = error


def _render(
    scene: bpy.types.Scene,
    camera: bpy.types.Object,
    lights: set[str] | None,
    settings: Settings,
) -> dict[str, Floats]:
    images: dict[str, Floats] = {}

    def work(engine: bpy.types.RenderEngine, depsgraph: bpy.types.Depsgraph) -> None:
        images.update(_arrays(engine, depsgraph, settings, camera, lights))

    layer = next((layer for layer in scene.view_layers if layer.use), scene.view_layers[0])
    bpy.utils.register_class(_ArrayEngine)
    _ArrayEngine.work, _ArrayEngine.error = staticmethod(work), None
    try:
        with _changed(scene.render, engine=_ENGINE):
            bpy.ops.render.render(scene=scene.name, layer=layer.name)
        error = _ArrayEngine.error
    finally:
        _ArrayEngine.work = _ArrayEngine.error = None
        bpy.utils.unregister_class(_ArrayEngine)
    if error is not None:
        raise error
    return images


def _arrays(
    engine: bpy.types.RenderEngine,
    depsgraph: bpy.types.Depsgraph,
    settings: Settings,
    camera: bpy.types.Object,
    lights: set[str] | None,
) -> dict[str, Floats]:
    job, region = prepared_job(engine, depsgraph, settings, camera, lights)
    images = {name: np.empty((region.height, region.width), np.float32) for name in job.pass_names}
    poll = Poll(engine).part(0.0, 1.0)
    for x, y, width, height in tiles(region.width, region.height, settings.aa):
        passes = job.tile(region.x + x, region.y + y, width, height, poll)
        for name, image in images.items():
            image[y : y + height, x : x + width] = passes[name]
    keys = {pass_name: light for light, pass_name in job.light_passes.items()}
    return {keys.get(name, name): np.flipud(image).copy() for name, image in images.items()}


def _object(value: bpy.types.Object | str | None, kind: str) -> bpy.types.Object | None:
    """The object of that type, given as itself or by its name."""
    if value is None:
        return None
    found = bpy.data.objects.get(value) if isinstance(value, str) else value
    if found is None or found.type != kind:
        raise ValueError(f"there is no {kind.lower()} called '{getattr(value, 'name', value)}'")
    return found


def _size(size: tuple[int, int] | None) -> dict[str, Any]:
    """The settings of a picture of that size."""
    if size is None:
        return {"use_border": False}
    width, height = size
    if not (4 <= width <= 65536 and 4 <= height <= 65536):
        raise ValueError(f"size must be from 4 to 65536 pixels each way, got {width} x {height}")
    return {
        "use_border": False,
        "resolution_x": width,
        "resolution_y": height,
        "resolution_percentage": 100,
    }


@contextmanager
def _changed(owner: Any, **values: Any) -> Iterator[None]:
    """The attributes with these values, and then with their old ones."""
    old = {name: getattr(owner, name) for name in values}
    try:
        for name, value in values.items():
            setattr(owner, name, value)
        yield
    finally:
        for name, value in old.items():
            setattr(owner, name, value)
