"""Does a ray cross a triangle mesh?  By integers alone, for settling disputes.

The definition is that of ``csrc/vocc.h``: with A, B, C the corners seen from the origin, a
ray crosses a triangle iff dir.(BxC), dir.(CxA), dir.(AxB) are all >= 0 or all <= 0, their
sum is not 0, and tmin < A.(BxC) / sum < tmax.  Every float32 is an integer multiple of
2^-149, so Python's integers evaluate that without rounding.

Nothing here is shared with the C library, on purpose.

    >>> oracle = Oracle([[0, 0, 1], [4, 0, 1], [0, 4, 1]], [[0, 1, 2]])
    >>> [oracle.occluded((1, 1, 0), (0, 0, 1), tmax=tmax) for tmax in (2, 1)]
    [True, False]
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from fractions import Fraction
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

Floats: TypeAlias = NDArray[np.float64]
Point: TypeAlias = tuple[int, int, int]

_UNIT = 149  # float32 numbers are multiples of 2^-149


@dataclass(frozen=True, order=True)
class Crossing:
    t: Fraction
    triangle: int


class Oracle:
    """A mesh, or several in one: `triangles` index `vertices`, float32."""

    def __init__(self, vertices: ArrayLike, triangles: ArrayLike) -> None:
        self._vertices = np.asarray(vertices, np.float32).reshape(-1, 3)
        self._triangles = np.asarray(triangles).astype(np.int64).reshape(-1, 3)
        corners = self._vertices.astype(np.float64)[self._triangles]
        # By axis, so that the box test reads contiguous memory.
        self._lower = np.ascontiguousarray(corners.min(axis=1).T)
        self._upper = np.ascontiguousarray(corners.max(axis=1).T)

    def occluded(
        self, org: ArrayLike, dir: ArrayLike, tmin: float = 0.0, tmax: float = math.inf
    ) -> bool:
        return any(True for _ in self._crossings(org, dir, tmin, tmax))

    def crossings(
        self, org: ArrayLike, dir: ArrayLike, tmin: float = 0.0, tmax: float = math.inf
    ) -> list[Crossing]:
        """All of them, by t, then by triangle."""
        return sorted(self._crossings(org, dir, tmin, tmax))

    def _crossings(
        self, org: ArrayLike, dir: ArrayLike, tmin: float, tmax: float
    ) -> Iterable[Crossing]:
        o, d = np.asarray(org, np.float32), np.asarray(dir, np.float32)
        lo, hi = np.float32(tmin), np.float32(tmax)
        if not (np.isfinite(o).all() and np.isfinite(d).all() and d.any() and lo < hi):
            return
        org_int, dir_int = _integers(o), _integers(d)
        for triangle in self._candidates(o, d, lo, hi):
            corners = [_integers(self._vertices[v]) for v in self._triangles[triangle]]
            t = _crossing(org_int, dir_int, corners)
            if t is not None and _below(lo, t) and _above(hi, t):
                yield Crossing(t, int(triangle))

    def _candidates(
        self, org: NDArray[np.float32], dir: NDArray[np.float32], tmin: np.float32, tmax: np.float32
    ) -> NDArray[np.int64]:
        """All triangles that the ray may cross: what it drops, float64 proves missed."""
        o, d = org.astype(np.float64), dir.astype(np.float64)
        near = np.arange(len(self._triangles))
        for axis in range(3):
            if d[axis] == 0:
                ends = [o[axis]]
            else:  # the product of two float32 is exact; the sum is off by half an ulp
                ends = [o[axis] + float(t) * d[axis] for t in (tmin, tmax)]
            highest, lowest = np.nextafter(max(ends), math.inf), np.nextafter(min(ends), -math.inf)
            lower, upper = self._lower[axis], self._upper[axis]
            if axis > 0:
                lower, upper = lower[near], upper[near]
            near = near[(lower <= highest) & (upper >= lowest)]
        a, b, c = (
            self._vertices[self._triangles[near, corner]].astype(np.float64) - o
            for corner in range(3)
        )
        signs = np.stack([_sign(d, b, c), _sign(d, c, a), _sign(d, a, b)])
        missed = (signs > 0).any(axis=0) & (signs < 0).any(axis=0)
        return near[~missed]


def _sign(d: Floats, b: Floats, c: Floats) -> NDArray[np.int8]:
    """The sign of d.(b x c) where float64 is sure of it, else 0.

    Each of the six products goes through at most 7 roundings (two differences, two products,
    one subtraction, two additions), hence less than 8 * 2^-53 of their absolute sum; 16 also
    covers the rounding of that sum.  No product of three float32 differences leaves float64's
    normal range.
    """
    forward = b[:, [1, 2, 0]] * c[:, [2, 0, 1]]
    backward = b[:, [2, 0, 1]] * c[:, [1, 2, 0]]
    value = ((forward - backward) * d).sum(axis=1)
    bound = ((np.abs(forward) + np.abs(backward)) * np.abs(d)).sum(axis=1) * (16 * 2.0**-53)
    return np.where(value > bound, 1, np.where(value < -bound, -1, 0)).astype(np.int8)


def _integers(values: NDArray[np.float32]) -> Point:
    """In units of 2^-149."""
    x, y, z = (_integer(float(value)) for value in values)
    return x, y, z


def _integer(value: float) -> int:
    numerator, denominator = value.as_integer_ratio()
    return (numerator << _UNIT) // denominator


def _crossing(org: Point, dir: Point, corners: list[Point]) -> Fraction | None:
    """The t at which the line meets the closed triangle, if it does."""
    a, b, c = (_minus(corner, org) for corner in corners)
    bc = _cross(b, c)
    edges = (_dot(dir, bc), _dot(dir, _cross(c, a)), _dot(dir, _cross(a, b)))
    determinant = sum(edges)
    if determinant == 0 or (min(edges) < 0 < max(edges)):
        return None
    return Fraction(_dot(a, bc), determinant)


def _below(bound: np.float32, t: Fraction) -> bool:
    return bool(bound == -math.inf) or Fraction(float(bound)) < t


def _above(bound: np.float32, t: Fraction) -> bool:
    return bool(bound == math.inf) or t < Fraction(float(bound))


def _minus(a: Point, b: Point) -> Point:
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


def _dot(a: Point, b: Point) -> int:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def _cross(a: Point, b: Point) -> Point:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


def to_float32(value: Fraction) -> np.float32:
    """Rounded to the nearest float32, ties to even."""
    guess = np.float32(float(value))  # rounded twice: a neighbour may be nearer
    if not np.isfinite(guess):
        return guess
    near = [
        np.nextafter(guess, np.float32(-np.inf)),
        guess,
        np.nextafter(guess, np.float32(np.inf)),
    ]
    return min(
        (x for x in near if np.isfinite(x)),
        key=lambda x: (abs(Fraction(float(x)) - value), int(x.view(np.uint32)) & 1),
    )
