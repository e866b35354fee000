"""Samples and lights as docs/method.md defines them, in NumPy and in plain order.

Nothing here comes from the library: sines are NumPy's, so that a direction may differ in the
last bit of float32 once in many millions.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

import pyvocc

F = np.float32
MASK = np.uint64(0xFFFFFFFF)

Points = NDArray[np.float32]
Floats = NDArray[np.float64]


class Answer(NamedTuple):
    """Of `Scene.light_visibility` and `Scene.light_irradiance`: (lights, points)."""

    counts: NDArray[np.uint16]
    irradiance: Floats


# ---- the unit square ---------------------------------------------------------


def product(a: NDArray[np.uint64], b: Any) -> NDArray[np.uint64]:
    """Of 32-bit numbers, modulo 2^32."""
    return a * np.asarray(b, np.uint64) & MASK


def hash32(x: Any) -> NDArray[np.uint64]:
    """Wellons's lowbias32."""
    h = np.asarray(x, np.uint64) & MASK
    h = product(h ^ h >> np.uint64(16), 0x7FEB352D)
    h = product(h ^ h >> np.uint64(15), 0x846CA68B)
    return h ^ h >> np.uint64(16)


def reverse(x: Any) -> NDArray[np.uint64]:
    """The 32 bits in opposite order."""
    x = np.asarray(x, np.uint64)
    result = np.zeros_like(x)
    for bit in range(32):
        result |= (x >> np.uint64(bit) & np.uint64(1)) << np.uint64(31 - bit)
    return result


def sobol(count: int) -> tuple[NDArray[np.uint64], NDArray[np.uint64]]:
    """The first points in 2^-32: bit k of the index flips, counted from the top, bit k of x,
    and those bits j of y for which (k over j) is odd."""
    index = np.arange(count, dtype=np.uint64)
    x, y = np.zeros_like(index), np.zeros_like(index)
    for k in range(16):
        chosen = index >> np.uint64(k) & np.uint64(1)
        x ^= chosen << np.uint64(31 - k)
        for j in range(k + 1):
            if math.comb(k, j) % 2:
                y ^= chosen << np.uint64(31 - j)
    return x, y


def scramble(x: NDArray[np.uint64], seed: NDArray[np.uint64]) -> NDArray[np.uint64]:
    """Each bit flips, or not, by a hash of the seed and the bits above it."""
    x = reverse(x)
    x = x ^ product(x, 0x3D20ADEA)
    x = x + seed & MASK
    x = product(x, seed >> np.uint64(16) | np.uint64(1))
    x = x ^ product(x, 0x05526C56)
    x = x ^ product(x, 0x53A22864)
    return reverse(x)


def strata(samples: int) -> tuple[int, int]:
    """nu and nv: nv is the largest divisor up to the root."""
    nv = math.isqrt(samples)
    while samples % nv:
        nv -= 1
    return samples // nv, nv


def unit_square(
    sampler: str, samples: int, ids: NDArray[np.uint32], number: int
) -> tuple[Points, Points]:
    """a and b, each (len(ids), samples)."""
    points = ids.astype(np.uint64)[:, None]
    if sampler == "jitter":
        nu, nv = strata(samples)
        s = np.arange(samples)
        h = hash32(points * np.uint64(2048) + np.uint64(number * 256) + s.astype(np.uint64))
        j1 = (h & np.uint64(0xFFFF)).astype(F) * F(1 / 65536)
        j2 = (h >> np.uint64(16)).astype(F) * F(1 / 65536)
        return (
            ((s % nu).astype(F) + j1) * (F(1) / F(nu)),
            ((s // nu).astype(F) + j2) * (F(1) / F(nv)),
        )
    seed = hash32(points ^ hash32(number ^ 0x9E3779B9))
    x, y = sobol(samples)
    a = scramble(np.broadcast_to(x, (len(ids), samples)), seed)
    b = scramble(np.broadcast_to(y, (len(ids), samples)), hash32(seed))
    step = F(2.0**-24)
    return (a >> np.uint64(8)).astype(F) * step, (b >> np.uint64(8)).astype(F) * step


def disk(a: Points, b: Points) -> tuple[Floats, Floats]:
    """Shirley and Chiu's map of the unit square to the unit disk."""
    p, q = 2 * a.astype(float) - 1, 2 * b.astype(float) - 1
    wide = p * p > q * q
    r = np.where(wide, p, q)
    with np.errstate(divide="ignore", invalid="ignore"):
        angle = np.where(r == 0, 0, math.pi / 4 * np.where(wide, q / p, p / q))
    c, s = np.cos(angle), np.sin(angle)
    return r * np.where(wide, c, s), r * np.where(wide, s, c)


# ---- lights ------------------------------------------------------------------


def dot(a: Any, b: Any) -> Floats:
    """Over the last axis, from left to right."""
    a, b = np.asarray(a, float), np.asarray(b, float)
    return np.asarray(a[..., 0] * b[..., 0] + a[..., 1] * b[..., 1] + a[..., 2] * b[..., 2])


def unit(v: Any) -> Floats:
    """Of length 1, or NaN."""
    v = np.asarray(v, float)
    with np.errstate(invalid="ignore", divide="ignore"):
        v = v / np.abs(v).max(axis=-1, keepdims=True)
        return np.asarray(v / np.sqrt(dot(v, v))[..., None])


def frame(w: Floats) -> tuple[Floats, Floats]:
    """Duff et al.: two unit vectors at right angles to w and to each other."""
    x, y, z = w[..., 0], w[..., 1], w[..., 2]
    sign = np.where(z < 0, -1.0, 1.0)
    a = -1 / (sign + z)
    b = x * y * a
    return (
        np.stack([1 + sign * x * x * a, sign * b, -sign * x], axis=-1),
        np.stack([b, sign + y * y * a, -y], axis=-1),
    )


def cap_point(cap: Any, x: Floats, y: Floats, w: Floats) -> tuple[Floats, Floats]:
    """A unit vector of the cap about w that is `cap` high, and its cosine."""
    u, v = frame(w)
    lowered = cap * (x * x + y * y)
    wide = np.sqrt(np.maximum(cap * (2 - lowered), 0))
    side = x[..., None] * u + y[..., None] * v
    return (1 - lowered)[..., None] * w + wide[..., None] * side, 1 - lowered


def single(v: Any) -> Floats:
    """Rounded to float32."""
    return np.asarray(v, F).astype(float)


def edges(light: Any) -> tuple[Any, Any, Any]:
    """Position and edges, as floats."""
    if isinstance(light, pyvocc.RectLight):
        return single(light.corner), single(light.edge_u), single(light.edge_v)
    return single(light.center), single(light.axis_u), single(light.axis_v)


def centre(light: Any) -> Floats:
    """In double, of what has been rounded to float32."""
    if isinstance(light, pyvocc.RectLight):
        p, u, v = edges(light)
        return np.asarray(p + (u / 2 + v / 2))
    return single(light.center)


def towards(light: Any, points: Points) -> tuple[Floats, Floats]:
    """Distance and direction of the centre; up where there is none."""
    to = centre(light) - points.astype(float)
    w = unit(to)
    w[np.isnan(w).any(axis=-1)] = (0, 0, 1)
    return np.sqrt(dot(to, to)), w


def directions(
    light: Any, number: int, points: Points, ids: NDArray[np.uint32], samples: int, sampler: str
) -> Points:
    """(points, samples, 3); the rays end at t = 1, those to a sun do not."""
    a, b = unit_square(sampler, samples, ids, number)
    if isinstance(light, pyvocc.RectLight):
        p, u, v = (x.astype(F) for x in edges(light))
        return np.asarray((p + a[..., None] * u) + b[..., None] * v - points[:, None])
    x, y = disk(a, b)
    if isinstance(light, pyvocc.DiskLight):
        p, u, v = edges(light)
        to = p + x[..., None] * u + y[..., None] * v - points[:, None].astype(float)
        return to.astype(F)
    if isinstance(light, pyvocc.SunLight):
        cap = 2 * math.sin(light.angle / 4) ** 2
        return cap_point(cap, x, y, unit(light.direction))[0].astype(F)
    distance, w = towards(light, points)
    radius = float(F(light.radius))
    if isinstance(light, pyvocc.SphereLight):
        outside = distance > radius
        with np.errstate(divide="ignore", invalid="ignore"):
            square = np.where(outside, radius / distance, 0) ** 2
        cap = np.where(outside, square / (1 + np.sqrt(1 - square)), 2)[:, None]
        to, cosine = cap_point(cap, x, y, w[:, None])
        distance = distance[:, None]
        along = distance * cosine
        square = radius * radius - (distance - along) * (distance + along)
        half = np.sqrt(np.maximum(square, 0))
        t = np.where(outside[:, None], along - half, along + half)
        return np.asarray((t[..., None] * to).astype(F))
    u, v = frame(w)
    side = (radius * x)[..., None] * u[:, None] + (radius * y)[..., None] * v[:, None]
    return np.asarray((centre(light) + side - points[:, None].astype(float)).astype(F))


def hemisphere(
    normals: Floats, ids: NDArray[np.uint32], samples: int, sampler: str = "sobol"
) -> Points:
    """Rays of ambient occlusion, (points, samples, 3)."""
    x, y = disk(*unit_square(sampler, samples, ids, 0))
    w = unit(normals)
    u, v = frame(w)
    z = np.sqrt(np.maximum(1 - x * x - y * y, 0))
    to = z[..., None] * w[:, None] + x[..., None] * u[:, None] + y[..., None] * v[:, None]
    return np.asarray(to.astype(F))


def is_reached(light: Any, points: Points) -> NDArray[np.bool_]:
    """Not behind a one-sided light, not outside the cone of a spot."""
    if isinstance(light, pyvocc.SpotLight):
        to = points.astype(float) - centre(light)
        along = dot(unit(light.direction), to)
        return np.asarray(along >= math.cos(light.angle / 2) * np.sqrt(dot(to, to)))
    if isinstance(light, pyvocc.RectLight | pyvocc.DiskLight) and not light.two_sided:
        _, u, v = edges(light)
        plane = np.cross(u, v)
        if plane.any():
            return np.asarray(dot(plane, points.astype(float) - centre(light)) > 0)
    return np.ones(len(points), bool)


def weights(light: Any, points: Points, normals: Floats, dirs: Points) -> Floats:
    """What the samples would add to the irradiance."""
    d = dirs.astype(float)
    square = dot(d, d)
    cosine = np.maximum(dot(normals[:, None], d), 0)
    if isinstance(light, pyvocc.SphereLight | pyvocc.SunLight):
        return np.asarray(cosine / np.sqrt(square))
    if isinstance(light, pyvocc.RectLight | pyvocc.DiskLight):
        _, u, v = edges(light)
        at_light = np.abs(dot(np.cross(u, v), d))
        at_light = np.where(at_light == 0, np.sqrt(square), at_light)
    else:
        at_light = np.abs(dot(towards(light, points)[1][:, None], d))
    return np.asarray(cosine * at_light / square**2)


def answer(
    scene: pyvocc.Scene,
    points: Points,
    normals: NDArray[Any],
    lights: Any,
    samples: int,
    ids: NDArray[np.uint32],
    sampler: str = "sobol",
    horizon: str = "sample",
) -> Answer:
    """What the library has to say, ray by ray, by `Scene.occluded`."""
    n = normals.astype(float)
    counts = np.empty((len(lights), len(points)), np.uint16)
    shares = np.empty(counts.shape)
    for number, light in enumerate(lights):
        sun = isinstance(light, pyvocc.SunLight)
        dirs = directions(light, number, points, ids, samples, sampler)
        lit = ~scene.occluded(points[:, None], dirs, 0, np.inf if sun else 1)
        if horizon == "sample":
            above = dot(n[:, None], dirs) > 0
        else:
            middle = unit(light.direction) if sun else centre(light) - points.astype(float)
            above = np.broadcast_to(dot(n, middle)[:, None] > 0, lit.shape)
        above = above & is_reached(light, points)[:, None]
        traced = above.any(axis=1)
        lit &= above
        counts[number] = np.where(traced, lit.sum(axis=1), pyvocc.NOT_TRACED)
        with np.errstate(invalid="ignore", divide="ignore"):
            weight = np.where(above, weights(light, points, n, dirs), 0)
            share = (weight * lit).sum(axis=1) / weight.sum(axis=1)
        share = np.where((lit == above).all(axis=1), 1, np.where(lit.any(axis=1), share, 0))
        shares[number] = np.where(traced, share, np.nan)
    return Answer(counts, shares)
