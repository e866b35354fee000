# SPDX-License-Identifier: GPL-3.0-or-later
"""Masks on the texels of an object: what Blender's Bake button asks of a render engine."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import bpy
import numpy as np
from numpy.typing import NDArray

import pyvocc

from .compat import bake_texels, corner_triangles, set_pass
from .data import Settings, Vector, World
from .extract import read_world
from .masks import PointJob, pixel_order
from .properties import settings_of
from .transform import moved, to_world

# Texels that are traced in one go: their masks fit in memory for many lights.
CHUNK = 1 << 19

SHADOW, AO = "SHADOW", "AO"

Progress = Callable[[float], bool]


class Texels(NamedTuple):
    """Texels that show a surface, in the world.

    Attributes:
        index: (n,) of the texel in its image, the lowest row first.
        position: (n, 3) float64, on the surface.
        normal: (n, 3) float64 of unit length, outward; NaN on a triangle without area.
    """

    index: NDArray[np.intp]
    position: NDArray[np.float64]
    normal: NDArray[np.float64]


def bake(
    engine: bpy.types.RenderEngine,
    depsgraph: bpy.types.Depsgraph,
    obj: bpy.types.Object,
    pass_type: str,
    pass_filter: int,
    width: int,
    height: int,
) -> None:
    """Fills the texels of an object; the arguments are those of `RenderEngine.bake`.

    SHADOW is the mean mask of the lights that are selected, of all if none is. Errors of the
    scene are reported to the user.
    """
    result = engine.begin_result(0, 0, width, height, layer="", view="")
    try:
        passes = {each.name: each for each in result.layers[0].passes}
        world = read_world(depsgraph)
        texels = texels_of(obj, *bake_texels(passes, width, height), world.origin)
        values = np.zeros(width * height, np.float32)
        values[texels.index] = _values(engine, depsgraph, obj, pass_type, world, texels)
        picture = np.ones((height, width, 4), np.float32)
        picture[..., :3] = values.reshape(height, width, 1)
        set_pass(passes["Combined"], picture)
    except pyvocc.Cancelled:
        engine.end_result(result, cancel=True)
        return
    except (ValueError, MemoryError, pyvocc.Error) as error:
        engine.end_result(result, cancel=True)
        text = str(error) or "There is not enough memory"
        engine.report({"ERROR"}, text)
        return
    engine.end_result(result)


def texels_of(
    obj: bpy.types.Object,
    triangle: NDArray[np.int32],
    u: NDArray[np.float32],
    v: NDArray[np.float32],
    origin: Vector = (0.0, 0.0, 0.0),
) -> Texels:
    """Where the texels of an evaluated mesh object are.

    Args:
        obj: evaluated.
        triangle: (height, width) loop triangle that a texel shows; -1 for none.
        u, v: (height, width) weights of the triangle's first two corners.
        origin: subtracted from all positions.
    """
    mesh = obj.data
    corners = corner_triangles(mesh)
    vertices = np.empty((len(mesh.vertices), 3), np.float32)
    mesh.attributes["position"].data.foreach_get("vector", vertices.ravel())
    vertex_of_corner = np.empty(len(mesh.loops), np.int32)
    mesh.attributes[".corner_vert"].data.foreach_get("value", vertex_of_corner)
    matrix = moved(np.array(obj.matrix_world, np.float64), origin)
    world = to_world(vertices, matrix).astype(np.float64)

    # Neighbours in the image, which are mostly neighbours in the world, are traced together.
    height, width = triangle.shape
    index = pixel_order(width, height)
    index = index[triangle.ravel()[index] >= 0]
    a, b, c = world[vertex_of_corner[corners[triangle.ravel()[index]]]].transpose(1, 0, 2)
    u, v = (each.ravel()[index].astype(np.float64)[:, None] for each in (u, v))
    normal = np.cross(b - a, c - a)
    if np.linalg.det(matrix[:3, :3]) < 0:
        normal = -normal
    with np.errstate(invalid="ignore"):
        normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    return Texels(index, u * a + v * b + (1.0 - u - v) * c, normal)


def _values(
    engine: bpy.types.RenderEngine,
    depsgraph: bpy.types.Depsgraph,
    obj: bpy.types.Object,
    pass_type: str,
    world: World,
    texels: Texels,
) -> NDArray[np.float32]:
    """The mask at each texel."""
    settings = _settings(depsgraph.scene, pass_type)
    if settings.masks:
        world = dataclasses.replace(world, lights=_chosen(depsgraph, world))

    def progress(fraction: float) -> bool:
        engine.update_progress(fraction)
        return engine.test_break()

    job = PointJob(world, settings)
    job.prepare(progress)
    for notice in job.notices:
        engine.report({"WARNING"}, notice)
    values = np.empty(len(texels.index), np.float32)
    for part, share in _chunks(len(values), progress):
        normals = texels.normal[part]
        points = texels.position[part] + job.offset * normals
        ids = texels.index[part].astype(np.uint32)
        if settings.masks:
            owners = [obj.original.name_full]
            values[part] = job.masks(points, normals, ids, owners, 0, share).mean(axis=0)
        else:
            values[part] = job.occlusion(points, normals, ids, share)
    return values


def _settings(scene: bpy.types.Scene, pass_type: str) -> Settings:
    if pass_type not in (SHADOW, AO):
        raise ValueError(
            f"Volumetric Occluders bakes Shadow and Ambient Occlusion, not "
            f"{pass_type.replace('_', ' ').title()}"
        )
    samples = scene.vocc.bake_samples
    return dataclasses.replace(
        settings_of(scene),
        samples=samples,
        ao_samples=samples,
        masks=pass_type == SHADOW,
        ao=pass_type == AO,
    )


def _chosen(depsgraph: bpy.types.Depsgraph, world: World) -> tuple[Any, ...]:
    """The lights that are selected, or all."""
    selected = {
        each.original.name_full
        for each in depsgraph.view_layer_eval.objects.selected
        if each.type == "LIGHT"
    }
    lights = tuple(light for light in world.lights if not selected or light.object_name in selected)
    if not lights:
        which = "None of the selected lights renders" if selected else "There is no light to bake"
        raise ValueError(f"{which} in the scene '{depsgraph.scene.name}'")
    return lights


def _chunks(count: int, progress: Progress) -> Iterator[tuple[slice, Progress]]:
    for start in range(0, count, CHUNK):
        size = min(CHUNK, count - start)
        yield (
            slice(start, start + size),
            lambda done, start=start, size=size: progress((start + done * size) / count),
        )
