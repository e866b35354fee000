# SPDX-License-Identifier: GPL-3.0-or-later
"""Lights: what Blender says of them, and the shapes that stand for them, which are Cycles'."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

import pyvocc

from . import transform
from .data import Light, Vector


def read_light(object: Any, matrix: NDArray[np.float64], name: str) -> Light:
    """The light of an evaluated light object at `matrix`, without its links."""
    light = object.data
    values: dict[str, Any] = {}
    if light.type == "AREA":
        size_y = light.size_y if light.shape in ("RECTANGLE", "ELLIPSE") else light.size
        values = {"shape": light.shape, "size": (light.size, size_y)}
    elif light.type == "SUN":
        values = {"angle": light.angle}
    else:
        values = {"radius": light.shadow_soft_size, "is_sphere": not light.use_soft_falloff}
    return Light(
        name=name,
        object_name=object.original.name_full,
        kind=light.type,
        matrix=tuple(tuple(row) for row in matrix.tolist()),
        casts_shadow=light.use_shadow,
        **values,
    )


def moved(light: Light, origin: Vector) -> Light:
    """The light in the world moved by -origin."""
    matrix = transform.moved(np.array(light.matrix, np.float64), origin)
    return replace(light, matrix=tuple(tuple(row) for row in matrix.tolist()))


def shape_of(light: Light) -> Any:
    """The light that pyvocc samples.

    Raises:
        ValueError: the light has no size or direction; the text names it.
    """
    matrix = np.array(light.matrix, np.float64)
    x, y, z, centre = matrix[:3].T
    if not np.isfinite(matrix).all():
        raise ValueError(f"the light '{light.name}' is not at a finite place")
    if light.kind == "SUN":
        if not z.any():
            raise ValueError(f"the sun '{light.name}' is scaled to nothing, so it has no direction")
        return pyvocc.SunLight(z, light.angle)
    if light.kind != "AREA":
        # A spot's cone dims its light, which is left to the shading; its shadow has no cone.
        kind = pyvocc.SphereLight if light.is_sphere and light.radius > 0 else pyvocc.PointLight
        return kind(centre, light.radius)

    x, y = x * light.size[0], y * light.size[1]
    front = np.cross(x, y)
    if not front.any():
        raise ValueError(f"the area light '{light.name}' has no area: its size or scale is 0")
    # It shines along -z, which a mirrored light has on the other side of x and y.
    if front @ z > 0 or not z.any():
        x, y = y, x
    if light.shape in ("DISK", "ELLIPSE"):
        return pyvocc.DiskLight(centre, x / 2, y / 2, two_sided=False)
    return pyvocc.RectLight(centre - x / 2 - y / 2, x, y, two_sided=False)
