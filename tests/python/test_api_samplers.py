"""Where samples lie, and what their counts come to: nets, statistics, exact penumbrae."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from typing import Any

import light_model
import numpy as np
import pytest
from light_model import centre, dot, hash32, scramble, sobol, unit, unit_square
from numpy.typing import NDArray

import pyvocc

F = np.float32
Floats = NDArray[np.float64]

SQUARE = np.array([(0, 1, 2), (0, 2, 3)])
UP = (0.0, 1.0, 0.0)


def built(*meshes: tuple[Any, Any]) -> pyvocc.Scene:
    scene = pyvocc.Scene()
    for vertices, triangles in meshes:
        scene.add_mesh(np.asarray(vertices, F), triangles)
    scene.build()
    return scene


def sheet(x0: float, y0: float, x1: float, y1: float, z: float) -> tuple[Any, Any]:
    """A rectangle across the z axis."""
    return [(x0, y0, z), (x1, y0, z), (x1, y1, z), (x0, y1, z)], SQUARE


@pytest.fixture(scope="module")
def half_plane() -> pyvocc.Scene:
    """All of y = 1 where x <= 0, as far as anything here can see."""
    far = 2.0**20
    return built(([(-far, 1, -far), (0, 1, -far), (0, 1, far), (-far, 1, far)], SQUARE))


# ---- nets --------------------------------------------------------------------


def test_the_first_points_are_those_of_the_tables() -> None:
    x, y = (values.astype(float) / 2**32 for values in sobol(8))
    assert x.tolist() == [0, 1 / 2, 1 / 4, 3 / 4, 1 / 8, 5 / 8, 3 / 8, 7 / 8]
    assert y.tolist() == [0, 1 / 2, 3 / 4, 1 / 4, 5 / 8, 1 / 8, 3 / 8, 7 / 8]


def shares(a: Any, b: Any, m: int) -> set[int]:
    """How many of the 2^m points (last axis) are in each interval of 2^-i x 2^(i - m), any i."""
    found: set[int] = set()
    rows = np.arange(len(a))[:, None] << m
    for i in range(m + 1):
        column = (a * 2.0**i).astype(np.int64)
        row = (b * 2.0 ** (m - i)).astype(np.int64)
        cell = rows + (column << (m - i)) + row
        found |= set(np.bincount(cell.ravel(), minlength=len(a) << m).tolist())
    return found


@pytest.mark.parametrize("m", [0, 1, 2, 4, 7, 10])
def test_every_elementary_interval_has_one_of_a_power_of_two(m: int) -> None:
    ids = np.random.default_rng(3).integers(0, 2**32, 300).astype(np.uint32)
    for number in (0, 1, 77):
        assert shares(*unit_square("sobol", 2**m, ids, number), m) == {1}
    if m > 2:
        # What the test would say of other patterns.
        assert shares(*unit_square("jitter", 2**m, ids, 0), m) != {1}


def test_scrambling_permutes_halves_of_halves() -> None:
    """Two numbers that share their upper k bits share as many of them afterwards."""
    random = np.random.default_rng(4)
    x, y = random.integers(0, 2**32, (2, 20_000), dtype=np.uint64)
    y = x ^ y >> random.integers(0, 33, 20_000, dtype=np.uint64)
    seed = hash32(random.integers(0, 2**32, 20_000))
    before, after = x ^ y, scramble(x, seed) ^ scramble(y, seed)
    assert np.array_equal(np.frexp(before.astype(float))[1], np.frexp(after.astype(float))[1])
    # About half of the seeds swap the halves at any depth.
    swapped = x ^ scramble(x, seed)
    for bit in range(32):
        assert abs((swapped >> np.uint64(bit) & np.uint64(1)).mean() - 0.5) < 0.02


def test_samples_lie_where_they_have_to_in_the_library() -> None:
    """A screen with a hole of one elementary interval before the light lets one sample through."""
    m = 4
    light = pyvocc.RectLight((0, 0, 2), (1, 0, 0), (0, 1, 0))
    ids = np.arange(200) * 7919
    for i in range(m + 1):
        columns, rows = 2**i, 2 ** (m - i)
        seen = np.zeros((200, columns, rows), int)
        for column, row in itertools.product(range(columns), range(rows)):
            # At half the way from the point (0, 0, 0).
            x0, x1, y0, y1 = (
                part / 2
                for part in (column / columns, (column + 1) / columns, row / rows, (row + 1) / rows)
            )
            around = [(-1, -1, x0, 1), (x1, -1, 1, 1), (-1, -1, 1, y0), (-1, y1, 1, 1)]
            scene = built(*(sheet(*edges, 1.0) for edges in around))
            counts = scene.light_visibility(np.zeros((200, 3)), (0, 0, 1.0), [light], 16, ids)
            seen[:, column, row] = counts[0]
        assert (seen == 1).all(), i


def test_jittered_samples_lie_one_in_each_stratum() -> None:
    ids = np.random.default_rng(5).integers(0, 2**32, 500).astype(np.uint32)
    for samples in (1, 7, 20, 36):
        nu, nv = light_model.strata(samples)
        assert nu * nv == samples
        a, b = unit_square("jitter", samples, ids, 3)
        # Up to rounding: a stratum may end a hair beyond its edge.
        column, row = (a.astype(float) * nu - 1e-6), (b.astype(float) * nv - 1e-6)
        s = np.arange(samples)
        assert (np.floor(column + 2e-6) - s % nu).max() <= 1
        assert np.array_equal(np.maximum(column, 0).astype(int), np.broadcast_to(s % nu, a.shape))
        assert np.array_equal(np.maximum(row, 0).astype(int), np.broadcast_to(s // nu, a.shape))


@pytest.mark.parametrize("sampler", ["sobol", "jitter"])
def test_each_sample_is_uniform_over_point_ids(sampler: str) -> None:
    """Means, squares and the product, each within five deviations."""
    count, samples = 40_000, 16
    a, b = (
        values.astype(float)
        for values in unit_square(sampler, samples, np.arange(count, dtype=np.uint32), 2)
    )
    if sampler == "jitter":
        s = np.arange(samples)
        a, b = a * 4 - s % 4, b * 4 - s // 4
    for values, mean, square in ((a, 1 / 2, 1 / 3), (b, 1 / 2, 1 / 3), (a * b, 1 / 4, 1 / 9)):
        deviation = math.sqrt((square - mean**2) / count)
        assert np.abs(values.mean(axis=0) - mean).max() < 5 * deviation
    counts = np.stack([np.histogram(a[:, s], 16, (0, 1))[0] for s in range(samples)])
    expected = count / 16
    assert np.abs(counts - expected).max() < 5 * math.sqrt(expected)


@pytest.mark.parametrize("sampler", ["sobol", "jitter"])
def test_points_and_lights_get_different_samples(half_plane: pyvocc.Scene, sampler: str) -> None:
    """Same place, same light: ids and numbers alone tell them apart; nothing else does."""
    ids = np.arange(64, dtype=np.uint32)
    squares = [unit_square(sampler, 16, ids, number) for number in range(4)]
    a = np.array([square[0] for square in squares]).reshape(-1, 16)
    assert len(np.unique(a, axis=0)) == len(a)
    light = pyvocc.DiskLight((0, 3, 0), (1, 0, 0), (0, 0, 1))
    points = np.full((64, 3), (0, 0, 0), F)

    def ask(ids: Any, lights: Any = (light,)) -> NDArray[np.uint16]:
        return half_plane.light_visibility(points[: len(ids)], UP, lights, 15, ids, sampler=sampler)

    counts = ask(ids, [light] * 8)
    assert len(np.unique(counts)) > 1
    assert all(len(np.unique(row)) > 1 for row in counts)
    assert len(np.unique(counts, axis=0)) == 8
    assert np.array_equal(ask(ids), counts[:1])
    assert np.array_equal(ask(ids[::-1]), counts[:1, ::-1])
    assert (ask(np.zeros(64, int)) == counts[0, 0]).all()
    # Jitter's key has 32 bits, of which the id has 21.
    assert np.array_equal(ask(ids + 2**21), counts[:1]) == (sampler == "jitter")


# ---- exact penumbrae ---------------------------------------------------------

# The half plane hides from (x, 0, z) what has s_x - x + x s_y < 0.


def side(points: Floats, s: Any) -> Floats:
    """Of places s, seen from points: positive where the half plane leaves it open."""
    s = np.asarray(s, float)
    return np.asarray(s[..., 0] - points[..., 0] + points[..., 0] * s[..., 1])


def rect_share(points: Floats, light: pyvocc.RectLight) -> Floats:
    """The square cut by a line, its area by the shoelace formula."""
    corners = [
        np.add(light.corner, a * np.array(light.edge_u) + b * np.array(light.edge_v))
        for a, b in ((0, 0), (1, 0), (1, 1), (0, 1))
    ]
    result = []
    for point in points:
        values = [float(side(point, corner)) for corner in corners]
        polygon = []
        for k, (a, b) in enumerate(((0, 0), (1, 0), (1, 1), (0, 1))):
            here, there = values[k], values[(k + 1) % 4]
            c, d = ((1, 0), (1, 1), (0, 1), (0, 0))[k]
            if here >= 0:
                polygon.append((a, b))
            if (here >= 0) != (there >= 0):
                t = here / (here - there)
                polygon.append((a + t * (c - a), b + t * (d - b)))
        turns = zip(polygon, polygon[1:] + polygon[:1], strict=True)
        result.append(sum(p[0] * q[1] - p[1] * q[0] for p, q in turns) / 2)
    return np.array(result)


def segment(d: Floats) -> Floats:
    """The unit disk's share where x >= -d."""
    d = np.clip(d, -1, 1)
    return np.asarray(1 - (np.arccos(d) - d * np.sqrt(1 - d * d)) / math.pi)


def disk_share(points: Floats, light: pyvocc.DiskLight) -> Floats:
    middle = side(points, light.center)
    u, v = (side(points, np.add(light.center, w)) - middle for w in (light.axis_u, light.axis_v))
    return segment(middle / np.hypot(u, v))


def facing_disk_share(points: Floats, light: Any) -> Floats:
    """A disk that is perpendicular to what leads to it."""
    normal = np.stack([np.ones(len(points)), points[:, 0], np.zeros(len(points))], axis=-1)
    w = unit(np.array(light.center) - points)
    flat = normal - dot(normal, w)[:, None] * w
    return segment(side(points, light.center) / (light.radius * np.sqrt(dot(flat, flat))))


def cap_share(points: Floats, towards: Floats, theta: Floats) -> Floats:
    """A cap of the unit sphere, cut by a plane through the middle; by integration."""
    normal = np.stack([np.ones(len(points)), points[:, 0], np.zeros(len(points))], axis=-1)
    result = []
    for n, w, t in zip(unit(normal), unit(towards), theta, strict=True):
        g = math.asin(float(dot(n, w)))
        if abs(g) >= t:
            result.append(float(g > 0))
            continue
        # Rings about the axis, of which the part beyond the plane is an arc.
        r = abs(g) + (t - abs(g)) * (np.arange(20_000) + 0.5) / 20_000
        arcs = np.arccos(np.tan(abs(g)) / np.tan(r)) / math.pi * np.sin(r)
        small = float(arcs.mean()) * (t - abs(g)) / (1 - math.cos(t))
        result.append(1 - small if g > 0 else small)
    return np.array(result)


def sphere_share(points: Floats, light: pyvocc.SphereLight) -> Floats:
    towards = np.array(light.center) - points
    return cap_share(points, towards, np.arcsin(light.radius / np.sqrt(dot(towards, towards))))


def sun_share(points: Floats, light: pyvocc.SunLight) -> Floats:
    theta = np.full(len(points), light.angle / 2)
    return cap_share(points, np.broadcast_to(light.direction, points.shape), theta)


PENUMBRAE: dict[str, tuple[Any, Callable[..., Floats]]] = {
    "rectangle": (pyvocc.RectLight((-1, 3, -1), (2, 0, 0), (0, 0, 2)), rect_share),
    "parallelogram": (pyvocc.RectLight((-1, 2, -1), (1.5, 1, 0.4), (0.7, 0.5, 2)), rect_share),
    "disk": (pyvocc.DiskLight((0, 3, 0), (1, 0, 0), (0, 0, 1)), disk_share),
    "ellipse": (pyvocc.DiskLight((0.3, 3, 0), (1.2, 0.5, 0.3), (-0.2, 0.1, 0.6)), disk_share),
    "sphere": (pyvocc.SphereLight((0.2, 3.5, 1), 0.9), sphere_share),
    "point with a disk": (pyvocc.PointLight((0.2, 3, 1), 0.8), facing_disk_share),
    "spot": (pyvocc.SpotLight((0.2, 3, 1), (0, -1, 0), 3.0, 0.8), facing_disk_share),
    "sun": (pyvocc.SunLight((0.5, 3, 1), 0.3), sun_share),
    "wide sun": (pyvocc.SunLight((-0.3, 3, 0.2), 1.5), sun_share),
}


def receivers(share: Callable[..., Floats], light: Any, count: int = 400) -> tuple[Any, Floats]:
    """Points of the plane y = 0 in the penumbra, and what each sees of the light."""
    line = np.zeros((600, 3))
    line[:, 0] = np.linspace(-3, 3, 600)
    seen = share(line, light)
    inside = line[(seen > 0) & (seen < 1), 0]
    random = np.random.default_rng(6)
    points = np.zeros((count, 3), F)
    points[:, 0] = random.uniform(inside.min(), inside.max(), count)
    points[:, 2] = random.uniform(-0.2, 0.2, count)
    exact = share(points.astype(float), light)
    partly = (exact > 0) & (exact < 1)
    assert partly.mean() > 0.8
    return points[partly], exact[partly]


def measured(scene: pyvocc.Scene, points: Any, light: Any, samples: int, sampler: str) -> Floats:
    counts = scene.light_visibility(points, UP, [light], samples, sampler=sampler)[0]
    assert (counts != pyvocc.NOT_TRACED).all()
    return counts / samples


@pytest.mark.parametrize("name", PENUMBRAE)
def test_penumbrae_are_those_of_geometry(half_plane: pyvocc.Scene, name: str) -> None:
    light, share = PENUMBRAE[name]
    points, exact = receivers(share, light)
    assert np.ptp(exact) > 0.9
    for sampler in ("sobol", "jitter"):
        error = measured(half_plane, points, light, 1024, sampler) - exact
        assert np.abs(error).mean() < 0.005, sampler
        assert np.abs(error).max() < 0.04, sampler
        # No side is favoured: the mean of independent errors.
        assert abs(error.mean()) < 5 * error.std() / math.sqrt(len(error)), sampler


def test_counts_are_right_on_average(half_plane: pyvocc.Scene) -> None:
    """One place, many ids, few samples: what is seen of the light, without bias."""
    for light, share in PENUMBRAE.values():
        point = receivers(share, light, 40)[0][:1]
        exact = share(point.astype(float), light)[0]
        points = np.repeat(point, 20_000, axis=0)
        for sampler, samples in itertools.product(("sobol", "jitter"), (1, 3, 16)):
            seen = measured(half_plane, points, light, samples, sampler)
            deviation = max(seen.std(), 1e-3) / math.sqrt(len(seen))
            assert abs(seen.mean() - exact) < 5 * deviation, (light, sampler, samples)


def at_random(scene: pyvocc.Scene, points: Any, light: Any, samples: int) -> Floats:
    """As `measured`, by samples that know nothing of each other."""
    random = np.random.default_rng(samples)
    a, b = random.random((2, len(points), samples)).astype(F)
    square = light_model.unit_square
    light_model.unit_square = lambda *_: (a, b)
    try:
        ids = np.arange(len(points), dtype=np.uint32)
        dirs = light_model.directions(light, 0, points, ids, samples, "random")
    finally:
        light_model.unit_square = square
    end = np.inf if isinstance(light, pyvocc.SunLight) else 1
    return np.asarray(1 - scene.occluded(points[:, None], dirs, 0, end).mean(axis=1))


@pytest.mark.parametrize("name", PENUMBRAE)
def test_sobol_errs_less_than_jitter_and_jitter_less_than_chance(
    half_plane: pyvocc.Scene, name: str
) -> None:
    light, share = PENUMBRAE[name]
    points, exact = receivers(share, light)
    for samples in (16, 64, 256):
        sobol, jitter, chance = (
            math.sqrt(float(np.square(seen - exact).mean()))
            for seen in (
                measured(half_plane, points, light, samples, "sobol"),
                measured(half_plane, points, light, samples, "jitter"),
                at_random(half_plane, points, light, samples),
            )
        )
        assert sobol < 0.95 * jitter < 0.6 * chance, (samples, sobol, jitter, chance)


# ---- irradiance --------------------------------------------------------------


def grid_irradiance(light: Any, point: Floats, normal: Floats) -> float:
    """The open share of cos cos' / r^2 over the light's own surface, in small pieces."""
    n = 400
    a, b = np.meshgrid((np.arange(n) + 0.5) / n, (np.arange(n) + 0.5) / n)
    if isinstance(light, pyvocc.RectLight):
        u, v = np.array(light.edge_u), np.array(light.edge_v)
        s = np.array(light.corner) + a[..., None] * u + b[..., None] * v
        plane, area = unit(np.cross(u, v)), np.ones_like(a)
    elif isinstance(light, pyvocc.DiskLight):
        u, v = np.array(light.axis_u), np.array(light.axis_v)
        x, y = a * np.cos(2 * np.pi * b), a * np.sin(2 * np.pi * b)
        s = np.array(light.center) + x[..., None] * u + y[..., None] * v
        plane, area = unit(np.cross(u, v)), a
    else:
        z, angle = 2 * a - 1, 2 * np.pi * b
        flat = np.sqrt(1 - z * z)
        plane = np.stack([flat * np.cos(angle), flat * np.sin(angle), z], axis=-1)
        s, area = np.array(light.center) + light.radius * plane, np.ones_like(a)
    d = s - point
    there = dot(plane, -d)
    there = np.maximum(there, 0) if isinstance(light, pyvocc.SphereLight) else np.abs(there)
    weight = np.maximum(dot(normal, d), 0) * there / dot(d, d) ** 2 * area
    return float((weight * (side(point, s) > 0)).sum() / weight.sum())


@pytest.mark.parametrize("name", ["rectangle", "parallelogram", "disk", "ellipse", "sphere"])
def test_irradiance_is_that_of_physics(half_plane: pyvocc.Scene, name: str) -> None:
    light, share = PENUMBRAE[name]
    points, visible = receivers(share, light, 30)
    random = np.random.default_rng(8)
    normals = unit(random.uniform(-0.6, 0.6, (len(points), 3)) + UP)
    for horizon in ("sample", "centre"):
        got = half_plane.light_irradiance(points, normals, [light], 4096, horizon=horizon)[0]
        traced = ~np.isnan(got)
        assert traced.mean() > 0.8
        exact = np.array(
            [
                grid_irradiance(light, p.astype(float), n)
                for p, n in zip(points[traced], normals[traced], strict=True)
            ]
        )
        assert np.abs(got[traced] - exact).max() < 0.02
        assert np.abs(got[traced] - exact).mean() < 0.002
        # Far from the share of samples.
        assert np.abs(visible[traced] - exact).max() > 0.03


# ---- ambient occlusion -------------------------------------------------------


@pytest.mark.parametrize("sampler", ["sobol", "jitter"])
def test_half_a_sky_is_that_of_geometry(half_plane: pyvocc.Scene, sampler: str) -> None:
    """Of a sky, weighed by cosine, a half plane leaves (1 + the edge's cosine) / 2."""
    x = np.linspace(-3, 3, 200)
    points = np.stack([x, np.zeros(200), np.zeros(200)], axis=-1)
    opened = half_plane.ambient_occlusion(points, UP, samples=1024, sampler=sampler) / 1024
    exact = (1 + x / np.sqrt(x * x + 1)) / 2
    assert np.abs(opened - exact).mean() < 0.005


@pytest.mark.parametrize("distance", [0.99, 1.25, 2.0, 8.0])
def test_a_ceiling_counts_as_far_as_rays_go(distance: float) -> None:
    """A ceiling at height 1 is out of reach where the cosine is below 1 / distance."""
    far = 100.0
    scene = built(([(-far, 1, -far), (far, 1, -far), (far, 1, far), (-far, 1, far)], SQUARE))
    points = np.random.default_rng(9).uniform(-1, 1, (50, 3)) * (1, 0, 1)
    opened = scene.ambient_occlusion(points, (0, 5, 0), distance, 4096) / 4096
    assert np.abs(opened - min(1, distance**-2)).max() < 0.01


def test_the_hemisphere_is_that_of_the_normal(half_plane: pyvocc.Scene) -> None:
    normals = unit(np.random.default_rng(10).normal(size=(300, 3)))
    normals[:6] = np.concatenate([np.eye(3), -np.eye(3)])
    ids = np.arange(300, dtype=np.uint32)
    dirs = light_model.hemisphere(normals, ids, 256).astype(float)
    assert np.allclose(np.sqrt(dot(dirs, dirs)), 1, atol=1e-6)
    cosine = dot(normals[:, None], dirs)
    assert cosine.min() > -1e-6
    # The mean of the cosine is 2/3, of its square 1/2.
    assert np.abs(cosine.mean(axis=1) - 2 / 3).max() < 0.01
    assert np.abs(np.square(cosine).mean(axis=1) - 1 / 2).max() < 0.01
    points = np.full((300, 3), (1.0, 0, 0))
    opened = half_plane.ambient_occlusion(points, normals, 5, 256, ids)
    blocked = half_plane.occluded(points[:, None], dirs, 0, 5)
    assert np.array_equal(opened, 256 - blocked.sum(axis=1))
    scaled = half_plane.ambient_occlusion(points, normals * 2.0**-600, 5, 256, ids)
    assert np.array_equal(scaled, opened)


def test_ambient_occlusion_has_no_answer_without_a_direction(half_plane: pyvocc.Scene) -> None:
    points = [(0, 0, 0), (0, 0, 0), (0, np.nan, 0), (np.inf, 0, 0), (0, 0, 0), (5, 2, 0)]
    normals = [(0, 0, 0), (0, np.nan, 1), UP, UP, (0, np.inf, 0), UP]
    opened = half_plane.ambient_occlusion(points, normals, 1.0)
    assert opened.tolist() == [65535, 65535, 65535, 65535, 65535, 16]
    assert half_plane.ambient_occlusion(points[0], UP).shape == ()
    assert half_plane.ambient_occlusion(np.zeros((3, 1, 3)), np.ones((4, 3))).shape == (3, 4)


# ---- centres: the model's own ------------------------------------------------


def test_the_centre_of_a_light_is_half_way() -> None:
    light = pyvocc.RectLight((1, 2, 3), (2, 0, 0), (0, 0, 4))
    assert centre(light).tolist() == list(light.center) == [2, 2, 5]
