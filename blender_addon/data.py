# SPDX-License-Identifier: GPL-3.0-or-later
"""What the parts of the add-on hand to each other: plain values, nothing of Blender's."""

from __future__ import annotations

from dataclasses import dataclass, field
from math import inf

import numpy as np
from numpy.typing import NDArray

Vector = tuple[float, float, float]


@dataclass(frozen=True, eq=False)
class Part:
    """One evaluated mesh, or one instance of it, in world space.

    Attributes:
        name: of the object; an instance is named after the object that makes it as well.
        object_name: full name of the original object that owns the mesh data.
        vertices: (n, 3) float32 in the mesh's own space.
        triangles: (m, 3) int32, wound so that they face outward in world space.
        matrix: (4, 4) float64, from the mesh's space to the world.
        is_caster: it casts shadows.
        is_receiver: the camera sees it.
        casting: (m,) bool, triangles that cast; None for all of them.
        link_name: full name of the original object that light linking knows it by; that of an
            instance may be the object that makes it.
    """

    name: str
    object_name: str
    vertices: NDArray[np.float32]
    triangles: NDArray[np.int32]
    matrix: NDArray[np.float64]
    is_caster: bool = True
    is_receiver: bool = True
    casting: NDArray[np.bool_] | None = None
    link_name: str = ""

    def __post_init__(self) -> None:
        if not self.link_name:
            object.__setattr__(self, "link_name", self.object_name)


@dataclass(frozen=True)
class Light:
    """A light as Blender describes it, its shape not interpreted yet.

    Attributes:
        name: unique among the lights of a scene; an instance is named after its parent as well.
        object_name: full name of the original light object.
        kind: "POINT", "SPOT", "SUN" or "AREA".
        matrix: (4, 4) float64, rows of the light's matrix_world.
        radius: of a point or spot light, in world units.
        is_sphere: a point or spot light is a ball, not a disk that faces the shaded point.
        angle: of a sun, the full angle of its disk in radians.
        shape: of an area light: "SQUARE", "RECTANGLE", "DISK" or "ELLIPSE".
        size: of an area light, along its x and y axes, before the matrix.
        casts_shadow: False if nothing blocks it.
        blockers: link names of the parts that may block it; None for all.
        receivers: link names of the parts that it lights; None for all.
    """

    name: str
    object_name: str
    kind: str
    matrix: tuple[tuple[float, ...], ...]
    radius: float = 0.0
    is_sphere: bool = False
    angle: float = 0.0
    shape: str = "SQUARE"
    size: tuple[float, float] = (1.0, 1.0)
    casts_shadow: bool = True
    blockers: frozenset[str] | None = None
    receivers: frozenset[str] | None = None


@dataclass(frozen=True, eq=False)
class View:
    """A camera's image plane in world space.

    Attributes:
        width, height: of the full frame in pixels.
        lower_left, right, up: (3,) float64, the frame's corner and its edges, in camera space.
        matrix: (4, 4) float64, from camera space to the world, without scale.
        is_orthographic: rays are parallel.
        near, far: distances of the clipping planes from the camera's plane.
    """

    width: int
    height: int
    lower_left: NDArray[np.float64]
    right: NDArray[np.float64]
    up: NDArray[np.float64]
    matrix: NDArray[np.float64]
    is_orthographic: bool = False
    near: float = 0.0
    far: float = inf


@dataclass(frozen=True)
class Settings:
    """How masks are made.

    Attributes:
        samples: of each light and sub-pixel.
        aa: sub-pixels along an edge of a pixel.
        masks: a mask for each light is wanted.
        ao: ambient occlusion is wanted.
        ao_distance: how far occluders count, in world units.
        ao_samples: of each sub-pixel.
        irradiance: weigh samples as they light the surface, rather than alike.
        all_lights: lights that cast no shadow are taken for lights that do.
        offset: of shading points from the surface in world units; None for the smallest.
        threads: 0 for one a processor.
    """

    samples: int = 16
    aa: int = 2
    masks: bool = True
    ao: bool = False
    ao_distance: float = 1.0
    ao_samples: int = 16
    irradiance: bool = False
    all_lights: bool = False
    offset: float | None = None
    threads: int = 0


@dataclass(frozen=True, eq=False)
class World:
    """What a depsgraph holds for the masks.

    Attributes:
        parts, lights: their matrices lead to the world moved by -origin.
        left_out: objects that are shown but not used, each with the reason.
        origin: near to everything, so that float32 does for what is far from the world's own.
    """

    parts: tuple[Part, ...]
    lights: tuple[Light, ...]
    left_out: tuple[tuple[str, str], ...] = field(default=())
    origin: Vector = (0.0, 0.0, 0.0)
