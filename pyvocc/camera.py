"""Cameras: from pixels to rays."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ._values import Vector, number, size_2d, vector
from .errors import InvalidArgument


@dataclass(frozen=True, init=False)
class PerspectiveCamera:
    """A pinhole camera.

    Args:
        eye: where it is, in the scene's unit of length.
        target: the point in the middle of the image.
        up: what points up in the image; not along the line of sight.
        tan_half_fov: tangent of half the vertical field of view, > 0; default 0.28.
        fov: the vertical field of view in degrees, between 0 and 180; instead of tan_half_fov.

    Raises:
        InvalidArgument: a value that is not finite or out of range; eye and target at one
            point; up along the line of sight; both tan_half_fov and fov.
        InvalidType: not numbers.
    """

    eye: Vector
    target: Vector
    up: Vector
    tan_half_fov: float

    def __init__(
        self,
        eye: Vector,
        target: Vector,
        up: Vector = (0.0, 1.0, 0.0),
        *,
        tan_half_fov: float | None = None,
        fov: float | None = None,
    ) -> None:
        object.__setattr__(self, "eye", vector("eye", eye))
        object.__setattr__(self, "target", vector("target", target))
        object.__setattr__(self, "up", vector("up", up))
        object.__setattr__(self, "tan_half_fov", _tan_half_fov(tan_half_fov, fov))
        self._basis()

    @property
    def fov(self) -> float:
        """The vertical field of view in degrees."""
        return math.degrees(2 * math.atan(self.tan_half_fov))

    def _basis(self) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        """Forward, right and up, of unit length."""
        forward = _unit(np.subtract(self.target, self.eye))
        if forward is None:
            raise InvalidArgument(
                f"target must differ from eye: both are at {self.eye}", argument="target"
            )
        up = np.asarray(self.up)
        right = _unit(_cross(forward, up))
        if right is None:
            raise InvalidArgument(
                f"up must be a direction other than the line of sight, got {self.up}",
                argument="up",
            )
        return forward, right, _cross(right, forward)

    def rays(
        self,
        size: tuple[int, int] = (1024, 1024),
        pixels: NDArray[np.integer] | None = None,
    ) -> tuple[NDArray[np.float64], NDArray[np.float32]]:
        """The rays through the pixels' centres.

        Args:
            size: width and height of the image in pixels, each at least 1.
            pixels: indices y * width + x of the pixels wanted, any shape; y = 0 is the top
                row. Default: all, as an array of shape (height, width).

        Returns:
            org: (3,) float64, the eye, for all rays.
            dir: pixels.shape + (3,) float32, not normalised: along the line of sight its
                length is 1.
        """
        width, height = size_2d("size", size)
        if pixels is None:
            pixels = np.arange(width * height).reshape(height, width)
        forward, right, up = self._basis()
        y, x = np.divmod(pixels, width)
        # Evaluated from left to right in double and rounded once, so that another program
        # that follows the same formulas traces the same rays.
        sx = ((x + 0.5) / width * 2 - 1) * self.tan_half_fov * (width / height)
        sy = (1 - (y + 0.5) / height * 2) * self.tan_half_fov
        direction = forward + sx[..., None] * right + sy[..., None] * up
        return np.array(self.eye), direction.astype(np.float32)


def _tan_half_fov(tan_half_fov: float | None, fov: float | None) -> float:
    if fov is None:
        result = 0.28 if tan_half_fov is None else number("tan_half_fov", tan_half_fov)
        if not (0 < result < math.inf):
            raise InvalidArgument(
                f"tan_half_fov must be finite and above 0, got {result}",
                argument="tan_half_fov",
                value=result,
            )
        return result
    if tan_half_fov is not None:
        raise InvalidArgument("give tan_half_fov or fov, not both", argument="fov")
    degrees = number("fov", fov)
    if not (0 < degrees < 180):
        raise InvalidArgument(
            f"fov must be between 0 and 180 degrees, got {degrees}", argument="fov", value=degrees
        )
    return math.tan(math.radians(degrees) / 2)


def _cross(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.array(
        [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
    )


def _unit(a: NDArray[np.float64]) -> NDArray[np.float64] | None:
    """a / |a|, or None where it has no direction."""
    # math.sqrt of a plain sum: np.linalg.norm may sum in another order.
    length = math.sqrt(a[0] * a[0] + a[1] * a[1] + a[2] * a[2])
    return a / length if 0 < length < math.inf else None
