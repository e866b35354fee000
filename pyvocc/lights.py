"""Area lights."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from ._values import Vector, vector
from .errors import InvalidType


@dataclass(frozen=True)
class RectLight:
    """A rectangle that emits from both sides: corner + a edge_u + b edge_v, a and b in [0, 1].

    Attributes:
        corner: a corner of the rectangle, in the scene's unit of length.
        edge_u: the edge from the corner along which the sample index runs first.
        edge_v: the other edge from the corner.

    Any sequence of three finite numbers is accepted for each and kept as a tuple of floats.
    The edges need not be perpendicular; an edge of length zero makes a line or a point light.

    Raises:
        InvalidArgument: not three numbers, or one that is not finite.
        InvalidType: not numbers.
    """

    corner: Vector
    edge_u: Vector
    edge_v: Vector

    def __post_init__(self) -> None:
        for name in ("corner", "edge_u", "edge_v"):
            object.__setattr__(self, name, vector(name, getattr(self, name)))

    @property
    def center(self) -> Vector:
        """corner + edge_u / 2 + edge_v / 2: a light is traced where this is above the surface."""
        c, u, v = self.corner, self.edge_u, self.edge_v
        return (
            c[0] + u[0] / 2 + v[0] / 2,
            c[1] + u[1] / 2 + v[1] / 2,
            c[2] + u[2] / 2 + v[2] / 2,
        )


def checked_lights(lights: Iterable[RectLight]) -> tuple[RectLight, ...]:
    """The lights as a tuple; a TypeError names the first that is none."""
    if isinstance(lights, RectLight):
        raise InvalidType(
            "lights must be a sequence of RectLight, not one RectLight", argument="lights"
        )
    try:
        result = tuple(lights)
    except TypeError:
        raise InvalidType(
            f"lights must be a sequence of RectLight, not {type(lights).__name__}",
            argument="lights",
        ) from None
    for index, light in enumerate(result):
        if not isinstance(light, RectLight):
            raise InvalidType(
                f"lights[{index}] must be a RectLight, not {type(light).__name__}",
                argument="lights",
                index=index,
            )
    return result
