"""Lights: what shadow rays end on.

Lengths are in the scene's unit, angles in radians. Vectors are any sequence of three finite
numbers, kept as a tuple of floats. A bad value raises InvalidArgument or InvalidType.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TypeAlias

from ._values import Vector, flag, number, vector
from .errors import InvalidArgument, InvalidType

# The fields of a vocc_light that its type needs.
Fields: TypeAlias = Mapping[str, Vector | float | int]


@dataclass(frozen=True)
class RectLight:
    """A parallelogram: corner + a edge_u + b edge_v, a and b in [0, 1].

    Attributes:
        corner: a corner.
        edge_u, edge_v: the edges from there; not necessarily perpendicular. An edge of length
            zero makes a line or a point.
        two_sided: it emits on both sides; else only where edge_u x edge_v points to.
    """

    corner: Vector
    edge_u: Vector
    edge_v: Vector
    two_sided: bool = True

    def __post_init__(self) -> None:
        _set_vectors(self, "corner", "edge_u", "edge_v")
        object.__setattr__(self, "two_sided", bool(flag("two_sided", self.two_sided)))

    @property
    def center(self) -> Vector:
        """corner + edge_u / 2 + edge_v / 2."""
        c, u, v = self.corner, self.edge_u, self.edge_v
        return (
            c[0] + u[0] / 2 + v[0] / 2,
            c[1] + u[1] / 2 + v[1] / 2,
            c[2] + u[2] / 2 + v[2] / 2,
        )

    def _fields(self) -> Fields:
        return {
            "position": self.corner,
            "edge_u": self.edge_u,
            "edge_v": self.edge_v,
            "one_sided": not self.two_sided,
        }


@dataclass(frozen=True)
class DiskLight:
    """A disk or an ellipse: center + x axis_u + y axis_v, x^2 + y^2 <= 1.

    Attributes:
        center: its middle.
        axis_u, axis_v: half axes; a disk if they are perpendicular and equally long.
        two_sided: it emits on both sides; else only where axis_u x axis_v points to.
    """

    center: Vector
    axis_u: Vector
    axis_v: Vector
    two_sided: bool = True

    def __post_init__(self) -> None:
        _set_vectors(self, "center", "axis_u", "axis_v")
        object.__setattr__(self, "two_sided", bool(flag("two_sided", self.two_sided)))

    def _fields(self) -> Fields:
        return {
            "position": self.center,
            "edge_u": self.axis_u,
            "edge_v": self.axis_v,
            "one_sided": not self.two_sided,
        }


@dataclass(frozen=True)
class SphereLight:
    """A sphere; samples are spread evenly over the solid angle that a point sees.

    Attributes:
        center: its middle.
        radius: at least 0; a point inside sees all of it.
    """

    center: Vector
    radius: float

    def __post_init__(self) -> None:
        _set_vectors(self, "center")
        _set_radius(self)

    def _fields(self) -> Fields:
        return {"position": self.center, "radius": self.radius}


@dataclass(frozen=True)
class PointLight:
    """A point, or a disk around it that faces whatever it lights, as renderers have it.

    Attributes:
        center: where it is.
        radius: of the disk, at least 0; default 0, a point with hard shadows.
    """

    center: Vector
    radius: float = 0.0

    def __post_init__(self) -> None:
        _set_vectors(self, "center")
        _set_radius(self)

    def _fields(self) -> Fields:
        return {"position": self.center, "radius": self.radius}


@dataclass(frozen=True)
class SpotLight:
    """A PointLight for the points within a cone; the others are NOT_TRACED.

    Attributes:
        center: where it is.
        direction: where its cone points, of any length but 0.
        angle: of the whole cone, 0 to 2 pi.
        radius: of the disk, at least 0; default 0.
    """

    center: Vector
    direction: Vector
    angle: float
    radius: float = 0.0

    def __post_init__(self) -> None:
        _set_vectors(self, "center", "direction")
        _check_direction(self.direction)
        _set_angle(self, 2 * math.pi)
        _set_radius(self)

    def _fields(self) -> Fields:
        return {
            "position": self.center,
            "direction": self.direction,
            "angle": self.angle,
            "radius": self.radius,
        }


@dataclass(frozen=True)
class SunLight:
    """A disk infinitely far away; samples are spread evenly over its solid angle.

    Attributes:
        direction: towards it, of any length but 0.
        angle: its angular diameter, 0 to pi; default 0, hard shadows. The sun's is 0.0093.
    """

    direction: Vector
    angle: float = 0.0

    def __post_init__(self) -> None:
        _set_vectors(self, "direction")
        _check_direction(self.direction)
        _set_angle(self, math.pi)

    def _fields(self) -> Fields:
        return {"direction": self.direction, "angle": self.angle}


Light: TypeAlias = RectLight | DiskLight | SphereLight | PointLight | SpotLight | SunLight
LIGHT_TYPES = (RectLight, DiskLight, SphereLight, PointLight, SpotLight, SunLight)


def checked_lights(lights: Iterable[Light]) -> tuple[Light, ...]:
    """The lights as a tuple; a TypeError names the first that is none."""
    if isinstance(lights, LIGHT_TYPES):
        raise InvalidType(
            f"lights must be a sequence of lights, not one {type(lights).__name__}",
            argument="lights",
        )
    try:
        result = tuple(lights)
    except TypeError:
        raise InvalidType(
            f"lights must be a sequence of lights, not {type(lights).__name__}",
            argument="lights",
        ) from None
    for index, light in enumerate(result):
        if not isinstance(light, LIGHT_TYPES):
            names = ", ".join(kind.__name__ for kind in LIGHT_TYPES)
            raise InvalidType(
                f"lights[{index}] must be one of {names}, not {type(light).__name__}",
                argument="lights",
                index=index,
            )
    return result


# The names of a vocc_light's fields where a class has others.
_NAMES: Mapping[type, Mapping[str, str]] = {
    RectLight: {"position": "corner"},
    DiskLight: {"position": "center", "edge_u": "axis_u", "edge_v": "axis_v"},
    SphereLight: {"position": "center"},
    PointLight: {"position": "center"},
    SpotLight: {"position": "center"},
    SunLight: {},
}


def named_in_python(error: InvalidArgument, lights: Sequence[Light]) -> InvalidArgument:
    """The library's error, with the name that a light's field has here."""
    if error.argument != "lights" or error.index is None:
        return error
    message = str(error)
    for theirs, ours in _NAMES[type(lights[error.index])].items():
        start = f"lights[{error.index}].{theirs} "
        if message.startswith(start):
            message = f"lights[{error.index}].{ours} {message.removeprefix(start)}"
            break
    return InvalidArgument(message, argument="lights", index=error.index, value=error.value)


def _set_vectors(light: Light, *names: str) -> None:
    for name in names:
        object.__setattr__(light, name, vector(name, getattr(light, name)))


def _set_radius(light: SphereLight | PointLight | SpotLight) -> None:
    radius = number("radius", light.radius)
    if not 0 <= radius < math.inf:
        raise InvalidArgument(
            f"radius must be finite and at least 0, got {radius}", argument="radius", value=radius
        )
    object.__setattr__(light, "radius", radius)


def _set_angle(light: SpotLight | SunLight, most: float) -> None:
    angle = number("angle", light.angle)
    if not 0 <= angle <= most:
        raise InvalidArgument(
            f"angle must be from 0 to {most:.6g} radians, got {angle}",
            argument="angle",
            value=angle,
        )
    object.__setattr__(light, "angle", angle)


def _check_direction(direction: Vector) -> None:
    if not any(direction):
        raise InvalidArgument(
            "direction must point somewhere, got (0, 0, 0)", argument="direction", value=direction
        )
