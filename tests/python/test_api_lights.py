"""Lights and cameras, light_visibility, and the soft-shadow pass."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import light_model
import numpy as np
import pytest
import shapes
from conftest import SHARED, RandomRays

import pyvocc
from pyvocc.shadow import OFFSET, shading_point, tile_order
from pyvocc.shapes import geodesic_sphere

F = np.float32

Small = tuple[pyvocc.Scene, pyvocc.PerspectiveCamera]

# The lights of the benchmark workload.
LIGHTS = [
    pyvocc.RectLight((-0.5, 3, -0.5), (1, 0, 0), (0, 0, 1)),
    pyvocc.RectLight((1.75, 1.25, 2.25), (0.5, 0, -0.5), (0, 0.5, 0)),
    pyvocc.RectLight((-2.25, 1.75, 1.75), (0.5, 0, 0.5), (0, 0.5, 0)),
    pyvocc.RectLight((-1.75, 2.25, -2.25), (-0.5, 0, 0.5), (0, 0.5, 0)),
    pyvocc.RectLight((2.25, 1.5, -1.75), (-0.5, 0, -0.5), (0, 0.5, 0)),
]
CAMERA = pyvocc.PerspectiveCamera((0, 1.75, 2.25), (0, 0.375, 0), tan_half_fov=0.28)


# One of each type, as that type is most often; then what is less common.
TYPES: dict[str, pyvocc.Light] = {
    "rect": pyvocc.RectLight((-0.5, 0.7, -0.5), (1, 0, 0.2), (0.1, 0, 1)),
    "disk": pyvocc.DiskLight((1, 1, 0), (0.5, 0, 0), (0, 0.2, 0.9)),
    "sphere": pyvocc.SphereLight((0, 1.5, 0), 0.5),
    "point": pyvocc.PointLight((0, 1, 2)),
    "spot": pyvocc.SpotLight((0, 1, 2), (0, -1, -2), 1.0, radius=0.3),
    "sun": pyvocc.SunLight((1, 2, 3), 0.5),
}
MORE: dict[str, pyvocc.Light] = {
    "rect, one side": pyvocc.RectLight((-0.5, 0.7, -0.5), (1, 0, 0.2), (0, 0, 1), two_sided=False),
    "disk, one side": pyvocc.DiskLight((1, 0.2, 0), (0.5, 0, 0), (0, 0.2, 0.9), two_sided=False),
    "sphere around points": pyvocc.SphereLight((0.3, 0.5, 0), 1.7),
    "sphere of radius 0": pyvocc.SphereLight((3, 2, 0), 0),
    "point with a disk": pyvocc.PointLight((0, 1, 2), radius=0.7),
    "wide spot": pyvocc.SpotLight((0, 1, 2), (0, -1, -2), 5.0),
    "spot of all around": pyvocc.SpotLight((0, 1, 2), (0, 0, -1), 2 * math.pi, radius=0.2),
    "sharp sun": pyvocc.SunLight((1e-200, 2e-200, 3e-200)),
    "sun of half the sky": pyvocc.SunLight((-1, 2, -3), math.pi),
}
ALL = list({**TYPES, **MORE}.values())


@pytest.mark.parametrize("horizon", ["sample", "centre"])
@pytest.mark.parametrize("sampler", ["sobol", "jitter"])
@pytest.mark.parametrize("samples", [1, 7, 16, 20, 36])
def test_light_visibility_traces_the_rays_of_its_definition(
    torus: pyvocc.Scene, random_rays: RandomRays, samples: int, sampler: str, horizon: str
) -> None:
    points, normals = (array[:2000] for array in random_rays(3000))
    ids = np.random.default_rng(1).integers(0, 2**32, len(points)).astype(np.uint32)
    lights = LIGHTS + ALL
    ask: Any = (points, normals, lights, samples, ids)
    expected = light_model.answer(torus, *ask, sampler, horizon)
    share = (expected.counts == pyvocc.NOT_TRACED).mean()
    assert 0.2 < share < 0.8
    how: Any = {"sampler": sampler, "horizon": horizon}
    got = torus.light_visibility(*ask, **how)
    assert got.dtype == np.uint16
    assert np.array_equal(got, expected.counts)
    irradiance = torus.light_irradiance(*ask, **how)
    assert irradiance.dtype == np.float32
    assert np.array_equal(np.isnan(irradiance), got == pyvocc.NOT_TRACED)
    assert np.nanmax(np.abs(irradiance - expected.irradiance)) < 1e-7
    if samples > 1:
        partly = (irradiance > 0) & (irradiance < 1)
        assert partly.mean() > 0.05
        # It is not the share of samples, except where all of them weigh the same.
        assert (irradiance != got / F(samples))[partly].mean() > 0.8


@pytest.mark.parametrize("sampler", ["sobol", "jitter"])
def test_ambient_occlusion_traces_the_rays_of_its_definition(
    torus: pyvocc.Scene, random_rays: RandomRays, sampler: str
) -> None:
    points, normals = random_rays(2000)
    ids = np.random.default_rng(2).integers(0, 2**32, len(points)).astype(np.uint32)
    dirs = light_model.hemisphere(normals.astype(float), ids, 20, sampler)
    seen = []
    for distance in (0.3, 2.0, np.inf):
        blocked = torus.occluded(points[:, None], dirs, 0, F(distance))
        got = torus.ambient_occlusion(points, normals, distance, 20, ids, sampler=sampler)
        assert got.dtype == np.uint16
        assert np.array_equal(got, 20 - blocked.sum(axis=1))
        seen.append(got.mean())
    assert seen[0] > seen[1] > seen[2] > 1
    default = torus.ambient_occlusion(points, normals, samples=20, point_ids=ids, sampler=sampler)
    assert np.array_equal(default, got)


def test_each_sample_is_told_apart_by_its_bit(torus: pyvocc.Scene, random_rays: RandomRays) -> None:
    points, normals = random_rays(500)
    ids = np.arange(500, dtype=np.uint32)
    bits = np.zeros((len(ALL), 500, 3), np.uint8)
    torus.light_visibility(points, normals, ALL, 20, blocked=bits)
    told = np.unpackbits(bits, axis=-1, bitorder="little")
    assert not told[..., 20:].any()
    for number, light in enumerate(ALL):
        dirs = light_model.directions(light, number, points, ids, 20, "sobol")
        end = np.inf if isinstance(light, pyvocc.SunLight) else 1
        above = light_model.dot(normals[:, None], dirs) > 0
        above &= light_model.is_reached(light, points)[:, None]
        expected = torus.occluded(points[:, None], dirs, 0, end) & above
        assert np.array_equal(told[number, :, :20], expected), light


def test_a_scene_in_parts_blocks_as_the_whole(random_rays: RandomRays) -> None:
    points, normals = random_rays(2000)
    meshes = [shapes.torus(40, 20), shapes.cube((0, 1.2, 0), 0.4), shapes.cube((0.6, 1, 0.2), 0.3)]
    parts = [pyvocc.Scene() for _ in meshes]
    whole = pyvocc.Scene()
    for part, mesh in zip(parts, meshes, strict=True):
        vertices = mesh[0].astype(F)
        part.add_mesh(vertices, mesh[1])
        whole.add_mesh(vertices, mesh[1])
        part.build()
    whole.build()
    bits = np.zeros((len(ALL), 2000, 2), np.uint8)
    weighed, sky = bits.copy(), bits[0].copy()
    for number, part in enumerate(parts):
        counts = part.light_visibility(points, normals, ALL, blocked=bits)
        shares = part.light_irradiance(points, normals, ALL, blocked=weighed)
        opened = part.ambient_occlusion(points, normals, 1.5, blocked=sky)
        done = whole.light_visibility(points, normals, ALL)
        assert (number == 2) == np.array_equal(counts, done)
    assert np.array_equal(bits, weighed)
    assert np.allclose(shares, whole.light_irradiance(points, normals, ALL), 0, 1e-7, True)
    assert np.array_equal(opened, whole.ambient_occlusion(points, normals, 1.5))


def test_point_ids_count_from_zero_by_default(torus: pyvocc.Scene, random_rays: RandomRays) -> None:
    points, normals = random_rays(600)
    ids = np.arange(600)
    implied = torus.light_visibility(points, normals, LIGHTS)
    assert (implied == torus.light_visibility(points, normals, LIGHTS, 16, ids)).all()
    shaped = torus.light_visibility(points.reshape(20, 30, 3), normals.reshape(20, 30, 3), LIGHTS)
    assert shaped.shape == (5, 20, 30)
    assert (shaped.reshape(5, -1) == implied).all()
    assert (implied != torus.light_visibility(points, normals, LIGHTS, 16, ids + 1)).any()


def test_leading_shapes_of_points_normals_and_ids_broadcast(torus: pyvocc.Scene) -> None:
    points = np.random.default_rng(0).normal(0, 2, (4, 1, 3))
    normals = np.random.default_rng(1).normal(0, 2, (5, 3))
    ids = np.arange(20).reshape(4, 5)
    got = torus.light_visibility(points, normals, LIGHTS, 16, ids)
    full = torus.light_visibility(
        np.broadcast_to(points, (4, 5, 3)).copy(),
        np.broadcast_to(normals, (4, 5, 3)).copy(),
        LIGHTS,
    )
    assert got.shape == (5, 4, 5)
    assert (got == full).all()
    assert torus.light_visibility(points[0, 0], normals[0], LIGHTS).shape == (5,)


def test_zero_lights_and_zero_points(cube: pyvocc.Scene) -> None:
    assert cube.light_visibility(np.zeros((4, 3)), np.ones((4, 3)), []).shape == (0, 4)
    assert cube.light_visibility(np.zeros((0, 3)), np.ones((0, 3)), LIGHTS).shape == (5, 0)


def test_points_that_are_not_finite_are_not_traced(cube: pyvocc.Scene) -> None:
    points = [[0, 1.5, 0], [np.nan, 1.5, 0], [0, np.inf, 0], [0, 1.5, 0]]
    normals = [[0, 1, 0], [0, 1, 0], [0, 1, 0], [0, np.nan, 0]]
    counts = cube.light_visibility(points, normals, LIGHTS[:1])
    assert counts.tolist() == [[16, 65535, 65535, 65535]]


def test_out_of_light_visibility(cube: pyvocc.Scene) -> None:
    points, normals = np.full((6, 3), 2.0), np.ones((6, 3))
    out = np.zeros((5, 6), np.uint16)
    assert cube.light_visibility(points, normals, LIGHTS, out=out) is out
    assert (out == cube.light_visibility(points, normals, LIGHTS)).all()


def test_light_visibility_counts_its_rays(cube: pyvocc.Scene) -> None:
    stats = pyvocc.Stats()
    points, normals = np.random.default_rng(5).normal(0, 3, (2, 500, 3))
    counts = cube.light_visibility(points, normals, LIGHTS, 16, horizon="centre", stats=stats)
    traced = counts[counts != pyvocc.NOT_TRACED].astype(int)
    assert stats.rays == 16 * len(traced)
    assert stats.occluded == stats.rays - traced.sum()
    # A sample that is not above the surface is dark, and no ray.
    stats = pyvocc.Stats()
    counts = cube.light_visibility(points, normals, LIGHTS, 16, stats=stats)
    traced = counts[counts != pyvocc.NOT_TRACED].astype(int)
    assert stats.rays < 16 * len(traced)
    start, ids = points.astype(F), np.arange(500, dtype=np.uint32)
    dirs = [
        light_model.directions(light, k, start, ids, 16, "sobol") for k, light in enumerate(LIGHTS)
    ]
    assert stats.rays == (light_model.dot(normals[:, None], np.array(dirs)) > 0).sum()
    assert stats.occluded == stats.rays - traced.sum()


# ---- horizons, sides, cones --------------------------------------------------


def test_a_light_across_the_horizon_counts_what_is_above(cube: pyvocc.Scene) -> None:
    """A point on a wall whose light is half below: half its samples, or by its centre alone."""
    point, normal = (0, 1.5, 0), (0, 1, 0)
    for middle, centre_says in ((1.51, 16), (1.5, pyvocc.NOT_TRACED), (1.49, pyvocc.NOT_TRACED)):
        light = pyvocc.RectLight((5, middle - 1, -1), (0, 2, 0), (0, 0, 2))
        counts = cube.light_visibility(point, normal, [light], 16)
        assert 7 <= counts[0] <= 9
        assert cube.light_visibility(point, normal, [light], 16, horizon="centre") == centre_says
    for height, expected in ((0.2, pyvocc.NOT_TRACED), (3.2, 16)):
        light = pyvocc.RectLight((5, height - 1, -1), (0, 2, 0), (0, 0, 2))
        assert cube.light_visibility(point, normal, [light], 16) == expected
    turned = cube.light_visibility(point, (0, -1, 0), [light], 16)
    assert turned == pyvocc.NOT_TRACED


@pytest.mark.parametrize(
    ("light", "front"),
    [
        (pyvocc.RectLight((-1, 0, -1), (0, 0, 2), (2, 0, 0), two_sided=False), 1),
        (pyvocc.RectLight((-1, 0, -1), (2, 0, 0), (0, 0, 2), two_sided=False), -1),
        (pyvocc.DiskLight((0, 0, 0), (0, 0, 1), (1, 0, 0), two_sided=False), 1),
        (pyvocc.DiskLight((0, 0, 0), (1, 0, 0), (0, 0, 1), two_sided=False), -1),
    ],
)
def test_a_one_sided_light_emits_where_u_x_v_points_to(light: Any, front: int) -> None:
    scene = pyvocc.Scene()
    scene.add_mesh(*shapes.cube((100, 0, 0)))
    scene.build()
    heights = np.array([2, 1e-30, 0, -1e-30, -2])
    points = np.stack([np.full(5, 3.0), heights, np.zeros(5)], axis=-1)
    for horizon in ("sample", "centre"):
        counts = scene.light_visibility(points, (-1, 0, 0), [light], 16, horizon=horizon)
        assert (counts[0] == np.where(heights * front > 0, 16, pyvocc.NOT_TRACED)).all()
        both = scene.light_visibility(
            points, (-1, 0, 0), [dataclasses.replace(light, two_sided=True)], 16, horizon=horizon
        )
        assert (both == 16).all()


def test_a_spot_lights_its_cone(cube: pyvocc.Scene) -> None:
    random = np.random.default_rng(12)
    points = random.normal(0, 4, (4000, 3)).astype(F)
    centre, axis = np.array((0.0, 5, 0)), np.array((0.6, -0.8, 0))
    cosine = ((points - centre) @ axis) / np.linalg.norm(points - centre, axis=1)
    normals = centre - points
    point = pyvocc.PointLight(tuple(centre), 0.1)
    expected = cube.light_visibility(points, normals, [point])[0]
    for degrees in (0, 20, 90, 180, 270, 360):
        spot = pyvocc.SpotLight(tuple(centre), tuple(axis * 7), math.radians(degrees), 0.1)
        inside = cosine >= math.cos(math.radians(degrees / 2))
        assert inside.any() == (degrees > 0)
        counts = cube.light_visibility(points, normals, [spot])[0]
        assert (counts == np.where(inside, expected, pyvocc.NOT_TRACED)).all()
        # Its edge, to some millionths of a radian.
        turn = np.arange(100) * 0.7
        around = np.cos(turn)[:, None] * (0.8, 0.6, 0) + np.sin(turn)[:, None] * (0, 0, 1)
        for off in (-3e-6, 3e-6):
            half = math.radians(degrees / 2) + off
            edge = centre + 3 * (math.cos(half) * axis + math.sin(half) * around)
            reached = cube.light_visibility(edge, centre - edge, [spot])[0] != pyvocc.NOT_TRACED
            assert (reached == (off < 0 or degrees == 360)).all() or degrees == 0


# ---- lights at their limits --------------------------------------------------


def test_lights_without_extent_are_points(torus: pyvocc.Scene, random_rays: RandomRays) -> None:
    points, normals = random_rays(1500)
    at = (0.25, 2, 0.5)
    none = (0, 0, 0)
    lights = [
        pyvocc.PointLight(at),
        pyvocc.SphereLight(at, 0),
        pyvocc.SphereLight(at, 1e-45),
        pyvocc.RectLight(at, none, none),
        pyvocc.RectLight(at, none, none, two_sided=False),
        pyvocc.DiskLight(at, none, none),
        pyvocc.DiskLight(at, none, none, two_sided=False),
        pyvocc.SpotLight(at, (0, -1, 0), 2 * math.pi),
    ]
    counts = torus.light_visibility(points, normals, lights, 4)
    blocked = torus.occluded(points, np.array(at, F) - points, 0, 1)
    facing = light_model.dot(normals, np.array(at) - points) > 0
    expected = np.where(facing, np.where(blocked, 0, 4), pyvocc.NOT_TRACED)
    assert (expected == 0).mean() > 0.1
    # A sphere's direction is that of the centre, rounded once more.
    for light, row in zip(lights, counts, strict=True):
        wrong = row != expected
        assert wrong.sum() <= (2 if isinstance(light, pyvocc.SphereLight) else 0), light
    shares = torus.light_irradiance(points, normals, lights[:1], 4)[0]
    assert np.array_equal(shares, np.where(facing, ~blocked, np.nan), equal_nan=True)


def test_a_line_is_lit_as_a_line(torus: pyvocc.Scene, random_rays: RandomRays) -> None:
    points, normals = random_rays(1500)
    ids = np.arange(1500, dtype=np.uint32)
    lights = [
        pyvocc.RectLight((-1, 2, 0), (2, 0, 0), (0, 0, 0)),
        pyvocc.RectLight((-1, 2, 0), (2, 0, 0), (1, 0, 0), two_sided=False),
        pyvocc.DiskLight((0, 2, 0), (2, 0, 1), (0, 0, 0)),
    ]
    expected = light_model.answer(torus, points, normals, lights, 16, ids)
    assert np.array_equal(torus.light_visibility(points, normals, lights), expected.counts)
    shares = torus.light_irradiance(points, normals, lights)
    assert np.allclose(shares, expected.irradiance, 0, 1e-7, equal_nan=True)


def test_a_point_at_the_centre_of_a_light(cube: pyvocc.Scene) -> None:
    at = (0, 3, 0)
    lights: dict[str, pyvocc.Light] = {
        "point": pyvocc.PointLight(at),
        "no edges": pyvocc.RectLight(at, (0, 0, 0), (0, 0, 0)),
        "sphere without radius": pyvocc.SphereLight(at, 0),
        "spot": pyvocc.SpotLight(at, (0, 1, 0), 1),
        "sphere": pyvocc.SphereLight(at, 0.5),
        "point with a disk": pyvocc.PointLight(at, 0.5),
        "disk": pyvocc.DiskLight(at, (0, 1, 0), (0, 0, 1)),
        "disk across": pyvocc.DiskLight(at, (1, 0, 0), (0, 0, 1)),
        "one side": pyvocc.DiskLight(at, (0, 1, 0), (0, 0, 1), two_sided=False),
    }
    counts = cube.light_visibility(at, (0, 1, 0), lights.values(), 64)
    found = dict(zip(lights, counts.tolist(), strict=True))
    nothing = ("point", "no edges", "sphere without radius", "spot", "one side", "disk across")
    for name in nothing:
        assert found[name] == pyvocc.NOT_TRACED, name
    # Half of the sphere, and of the upright disk, is above; the facing disk is upright or flat.
    assert 30 <= found["sphere"] <= 34
    assert 30 <= found["disk"] <= 34
    assert found["point with a disk"] in (*range(28, 37), pyvocc.NOT_TRACED)
    by_centre = cube.light_visibility(at, (0, 1, 0), lights.values(), horizon="centre")
    assert (by_centre == pyvocc.NOT_TRACED).all()


def test_points_inside_a_sphere_see_it_all_around(cube: pyvocc.Scene) -> None:
    random = np.random.default_rng(13)
    points = (random.uniform(-1, 1, (200, 3)) + (0, 5, 0)).astype(F)
    normals = random.normal(size=(200, 3))
    light = pyvocc.SphereLight((0, 5, 0), 2.5)
    counts = cube.light_visibility(points, normals, [light], 1024) / 1024
    assert np.abs(counts - 0.5).max() < 0.01
    assert (cube.light_irradiance(points, normals, [light]) == 1).all()
    # Its surface ends the ray: the cube lies beyond that of a small one, not of a large one.
    large = pyvocc.SphereLight((0, 5, 0), 20)
    down = cube.light_visibility((0, 2, 0), (0, -1, 0), [large], 1024) / 1024
    assert 0.2 < down[0] < 0.4


HUGE = 3e38


def test_lights_and_points_at_the_ends_of_float32(torus: pyvocc.Scene) -> None:
    points = np.array(
        [(0, 0, 0), (0, 2, 0), (1, 0, 0), (1e-40, 1e-30, 0), (1e30, 0, 0), (HUGE,) * 3],
        F,
    )
    normals = np.tile(np.array((0.3, 1, 0.1), F), (len(points), 1))
    lights = [
        pyvocc.RectLight((HUGE,) * 3, (HUGE, 0, 0), (0, HUGE, 0)),
        pyvocc.RectLight((1e30, 0, 0), (1e20, 0, 0), (0, 1e31, 0)),
        pyvocc.DiskLight((HUGE, 0, 0), (HUGE, 0, 0), (0, HUGE, 0)),
        pyvocc.DiskLight((0, 1e-40, 0), (0, 1e-45, 0), (1e-44, 0, 0), two_sided=False),
        pyvocc.SphereLight((0, 0, 0), HUGE),
        pyvocc.SphereLight((HUGE, 0, 0), 1),
        pyvocc.SphereLight((0, 2, 0), 1e-45),
        pyvocc.PointLight((HUGE, HUGE, -HUGE)),
        pyvocc.PointLight((0, 2, 0), HUGE),
        pyvocc.SpotLight((0, HUGE, 0), (0, -1, 0), 1, 1e-44),
        pyvocc.SunLight((1e308, 1e308, 0), 3),
        pyvocc.SunLight((1e-310, 0, 0)),
    ]
    ids = np.arange(len(points), dtype=np.uint32)
    for horizon in ("sample", "centre"):
        with np.errstate(all="ignore"):
            expected = light_model.answer(torus, points, normals, lights, 9, ids, horizon=horizon)
        for options in ({}, {"order": "standard", "occluders": False, "entry_points": True}):
            how: Any = {"horizon": horizon, **options}
            counts = torus.light_visibility(points, normals, lights, 9, **how)
            assert np.array_equal(counts, expected.counts)
            shares = torus.light_irradiance(points, normals, lights, 9, **how)
            assert np.array_equal(np.isnan(shares), counts == pyvocc.NOT_TRACED)
            assert not ((shares < 0) | (shares > 1)).any()


def test_far_lights_keep_the_precision_of_their_scene() -> None:
    far = np.array([500_000.0, 4_000_000.0, 100.0])
    points, normals = np.random.default_rng(14).normal(0, 2, (2, 2000, 3))
    results = []
    for shift in (np.zeros(3), far):
        scene = pyvocc.Scene()
        vertices, triangles = shapes.torus(40, 20)
        # Lattice points, so that both scenes are the same after their moves.
        scene.add_mesh(np.round(vertices * 2**20) / 2**20 + shift, triangles)
        scene.build()
        moved = []
        for light in ALL:
            name = "corner" if isinstance(light, pyvocc.RectLight) else "center"
            place = () if isinstance(light, pyvocc.SunLight) else (name,)
            moved.append(
                dataclasses.replace(
                    light, **{n: tuple(np.add(getattr(light, n), shift)) for n in place}
                )
            )
        results.append(scene.light_visibility(points + shift, normals, moved))
    assert (results[0] != results[1]).mean() < 0.002


def test_the_default_sampling(cube: pyvocc.Scene) -> None:
    ask: Any = ((0, 2, 0), (0, 1, 0), LIGHTS)
    default = cube.light_visibility(*ask)
    assert np.array_equal(
        default, cube.light_visibility(*ask, samples=16, sampler="sobol", horizon="sample")
    )


# ---- what a camera sees ------------------------------------------------------


def test_safe_offset_is_twice_what_rounding_can_take(torus: pyvocc.Scene) -> None:
    vertices = shapes.torus(128, 50)[0].astype(F)
    assert torus.safe_offset == 2.0**-21 * np.abs(vertices).max()
    far = pyvocc.Scene()
    far.add_mesh(shapes.cube()[0] * (1, 1, 4) + 1e6 + 0.1, shapes.cube()[1])
    far.build()
    assert far.origin.any()
    assert 2.0**-21 * 4 <= far.safe_offset < 2.0**-21 * 4.02
    empty = pyvocc.Scene()
    empty.build()
    assert empty.safe_offset == 0


def test_points_at_the_safe_offset_do_not_shade_themselves() -> None:
    """Every point of a convex solid sees a light that is above its face."""
    random = np.random.default_rng(15)
    for shift in (0.0, 3000.25, 1e7 + 0.1):
        scene = pyvocc.Scene()
        vertices, triangles = geodesic_sphere(8)
        scene.add_mesh(vertices.astype(float) + shift, triangles)
        scene.build()
        org = light_model.unit(random.normal(size=(3000, 3))) * 3 + shift
        seen = pyvocc.shading_points(scene, org, shift + random.uniform(-0.5, 0.5, (3000, 3)) - org)
        hit = seen.geom_id == 0
        assert hit.mean() > 0.6
        normal = seen.normal[hit]
        assert (light_model.dot(normal, org[hit] - seen.position[hit]) > 0).all()
        opened = scene.ambient_occlusion(seen.position[hit], normal, samples=8)
        assert (opened == 8).all()
        # Without it, half of the points are below their face, or in it.
        sunk = pyvocc.shading_points(scene, org[hit], seen.position[hit] - org[hit], offset=0)
        assert (scene.ambient_occlusion(sunk.position, sunk.normal, samples=8) < 8).mean() > 0.1


def test_shading_points_are_those_of_the_pass(small: Small) -> None:
    scene, camera = small
    image = pyvocc.shadow_pass(scene, camera, [], (40, 30), offset=0.001)
    org, dir = camera.rays((40, 30))
    seen = pyvocc.shading_points(scene, org, dir, offset=0.001)
    assert seen.position.shape == (30, 40, 3)
    for name in ("position", "normal", "geom_id", "prim_id"):
        assert np.array_equal(getattr(seen, name), getattr(image, name), equal_nan=True), name
    hits = scene.intersect(org, dir)
    assert np.array_equal(seen.t, hits.t)
    many = pyvocc.shading_points(scene, np.broadcast_to(org, dir.shape), dir, offset=0.001)
    assert np.array_equal(many.position, seen.position, equal_nan=True)
    one = pyvocc.shading_points(scene, org, dir[15, 20], offset=0.001, packets=False, threads=1)
    assert np.array_equal(one.position, seen.position[15, 20])
    assert one.geom_id.shape == ()
    closer = pyvocc.shading_points(scene, org, dir)
    gap = light_model.dot(seen.position - closer.position, seen.normal)[hits.prim_id >= 0]
    assert np.allclose(gap, 0.001 - scene.safe_offset, atol=1e-6)


# ---- lights and cameras ------------------------------------------------------


def test_lights_keep_tuples_and_floats() -> None:
    disk = pyvocc.DiskLight([0, 1, 2], np.array([2, 0, 0], F), (0.0, 0, 4))
    assert disk == pyvocc.DiskLight((0, 1, 2), (2, 0, 0), (0, 0, 4), two_sided=True)
    assert disk.center == (0.0, 1.0, 2.0) and isinstance(disk.axis_u, tuple)
    sphere = pyvocc.SphereLight([0, 1, 2], 3)
    assert isinstance(sphere.radius, float) and sphere == pyvocc.SphereLight((0, 1, 2), 3.0)
    spot = pyvocc.SpotLight([0, 1, 2], [0, 0, -5], 1)
    assert (spot.direction, spot.angle, spot.radius) == ((0, 0, -5), 1.0, 0.0)
    sun = pyvocc.SunLight(np.array([0, 2, 0]))
    assert (sun.direction, sun.angle) == ((0, 2, 0), 0)
    assert len({disk, sphere, spot, sun, *ALL}) == 4 + len(ALL)
    assert pyvocc.PointLight((0, 0, 0)).radius == 0


def test_a_light_keeps_tuples_and_has_a_center() -> None:
    light = pyvocc.RectLight([0, 1, 2], np.array([2, 0, 0], np.float32), (0.0, 0, 4))
    assert light == pyvocc.RectLight((0, 1, 2), (2, 0, 0), (0, 0, 4))
    assert light.corner == (0.0, 1.0, 2.0)
    assert light.center == (1, 1, 4)
    assert hash(light)


def test_the_camera_looks_where_it_says() -> None:
    camera = pyvocc.PerspectiveCamera((0, 0, 5), (0, 0, 0), fov=90)
    assert camera.tan_half_fov == pytest.approx(1)
    assert camera.fov == pytest.approx(90)
    org, dir = camera.rays((4, 2))
    assert org.tolist() == [0, 0, 5]
    assert dir.shape == (2, 4, 3)
    assert dir.dtype == np.float32
    assert np.allclose(dir[0, 0], [-1.5, 0.5, -1])
    assert np.allclose(dir[1, 3], [1.5, -0.5, -1])


def test_up_need_not_be_y() -> None:
    camera = pyvocc.PerspectiveCamera((5, 0, 0), (0, 0, 0), up=(0, 0, 2))
    _, dir = camera.rays((2, 2))
    assert (dir[0, :, 2] > 0).all()
    assert (dir[:, 1, 1] > 0).all()


def test_rays_follow_their_formula_bit_for_bit() -> None:
    width, height, th = 37, 23, 0.28
    eye, target = (0.3, 1.75, 2.25), (0.1, 0.375, -0.2)
    camera = pyvocc.PerspectiveCamera(eye, target, tan_half_fov=th)
    _, dir = camera.rays((width, height))
    f = [t - e for t, e in zip(target, eye, strict=True)]
    length = math.sqrt(f[0] * f[0] + f[1] * f[1] + f[2] * f[2])
    f = [c / length for c in f]
    length = math.sqrt(f[2] * f[2] + f[0] * f[0])
    r = [-f[2] / length, 0.0, f[0] / length]
    u = [
        r[1] * f[2] - r[2] * f[1],
        r[2] * f[0] - r[0] * f[2],
        r[0] * f[1] - r[1] * f[0],
    ]
    for y in range(height):
        for x in range(width):
            sx = ((x + 0.5) / width * 2 - 1) * th * (width / height)
            sy = (1 - (y + 0.5) / height * 2) * th
            expected = [F(f[k] + sx * r[k] + sy * u[k]) for k in range(3)]
            assert dir[y, x].tolist() == expected


def test_shading_points_lie_on_the_side_of_the_eye() -> None:
    triangle = np.array([[[0, 0, 0], [1, 0, 0], [0, 1, 0]]], F)
    dir = np.array([[0, 0, -1]], F)
    t = np.array([2], F)
    for corners in (triangle, triangle[:, ::-1]):
        position, normal = shading_point(corners, np.array([0.2, 0.2, 2]), dir, t, 0.5)
        assert position.tolist() == [[F(0.2), F(0.2), 0.5]]
        assert normal.tolist() == [[0, 0, 1]]


def test_a_plane_that_is_no_help_gives_way_to_t() -> None:
    line = np.array([[[0, 0, 0], [1, 0, 0], [2, 0, 0]], [[0, 0, 0], [0, 0, 1], [0, 1, 0]]], F)
    dir = np.array([[0, 0, -1]] * 2, F)
    position, normal = shading_point(line, np.array([0.5, 0, 2]), dir, np.array([2, 3], F), 0.0)
    assert position.tolist() == [[0.5, 0, 0], [0.5, 0, -1]]
    assert np.isfinite(normal).all()


@pytest.mark.parametrize("name", ["bunny", "cowboy"])
def test_camera_and_shading_points_follow_the_workload_bit_for_bit(name: str) -> None:
    vertices, triangles, (_, points, normals, prim) = workload(name)
    _, dir = CAMERA.rays((256, 256))
    corners = vertices[triangles[prim]]
    position, normal = shading_point(
        corners, np.array(CAMERA.eye), dir.reshape(-1, 3), np.zeros(len(prim), F), OFFSET
    )
    assert position.tobytes() == points.tobytes()
    assert normal.tobytes() == normals.tobytes()


# ---- the pass ----------------------------------------------------------------


def workload(name: str) -> Any:
    """Mesh with ground, and the reference G-buffer, of the benchmark workload."""
    path = SHARED / "workload" / f"{name}_256.gbuf"
    if not path.exists():
        pytest.skip("the reference data is not here")
    trimesh = pytest.importorskip("trimesh")
    mesh = trimesh.load(SHARED / "meshes" / f"{name}.ply", process=False)
    faces = np.asarray(mesh.faces)
    vertices = mesh.vertices.astype(F).astype(float)
    used = vertices[np.unique(faces)]
    low, high = used.min(axis=0), used.max(axis=0)
    center = np.array([(low[0] + high[0]) * 0.5, low[1], (low[2] + high[2]) * 0.5])
    unit = ((vertices - center) * (1 / (high - low).max())).astype(F)
    ground = np.array([(-16, 0, -16), (16, 0, -16), (16, 0, 16), (-16, 0, 16)], F)
    b = len(unit)
    triangles = np.concatenate([faces, [(b, b + 2, b + 1), (b, b + 3, b + 2)]])
    data = path.read_bytes()
    count = 256 * 256
    values = np.frombuffer(data, F, 6 * count, 16).reshape(-1, 6)
    prim = np.frombuffer(data, np.int32, count, 16 + 24 * count)
    buffer = (faces, values[:, :3].copy(), values[:, 3:].copy(), prim)
    return np.concatenate([unit, ground]), triangles, buffer


@pytest.mark.parametrize("name", ["bunny", "cowboy"])
def test_the_pass_gives_the_reference_image(name: str) -> None:
    vertices, triangles, (faces, points, normals, prim) = workload(name)
    scene = pyvocc.Scene()
    scene.add_mesh(vertices[:-4], faces)
    scene.add_mesh(vertices[-4:], triangles[-2:] - (len(vertices) - 4))
    scene.build()
    result = pyvocc.shadow_pass(
        scene, CAMERA, LIGHTS, (256, 256), 16, sampler="jitter", horizon="centre"
    )
    shown = result.prim_id.ravel() + np.where(result.geom_id.ravel() == 1, len(faces), 0)
    # Only on a shared edge may another triangle be chosen.
    same = shown == prim
    assert same.mean() > 0.999
    assert (result.position.reshape(-1, 3)[same] == points[same]).all()
    assert (result.normal.reshape(-1, 3)[same] == normals[same]).all()
    path = SHARED / "workload" / f"{name}_256x16.counts"
    reference = np.frombuffer(path.read_bytes(), np.uint8).reshape(5, -1)
    counts = result.counts.reshape(5, -1)
    traced = counts != pyvocc.NOT_TRACED
    assert ((reference != 255) == traced)[:, same].all()
    # The reference is not exact on grazing rays; bench settles those by rational arithmetic.
    wrong = (traced & (counts != reference))[:, same]
    assert wrong.sum() <= 4


@pytest.fixture(scope="module")
def small() -> tuple[pyvocc.Scene, pyvocc.PerspectiveCamera]:
    scene = pyvocc.Scene()
    vertices, triangles = shapes.torus(40, 20)
    scene.add_mesh(vertices.astype(F), triangles, name="torus")
    scene.add_mesh(*shapes.box([-2, -1, -2], [2, -0.5, 2]), name="slab")
    scene.build()
    return scene, pyvocc.PerspectiveCamera((0, 3, 5), (0, 0, 0), fov=50)


def test_the_pass_has_an_image_for_everything(small: Small) -> None:
    scene, camera = small
    result = pyvocc.shadow_pass(scene, camera, LIGHTS, size=(70, 45), samples=9)
    assert result.counts.shape == result.visibility.shape == (5, 45, 70)
    assert result.counts.dtype == np.uint16
    assert result.visibility.dtype == np.float32
    assert result.position.shape == result.normal.shape == (45, 70, 3)
    assert result.position.dtype == result.normal.dtype == np.float32
    assert result.geom_id.shape == result.prim_id.shape == (45, 70)
    assert result.samples == 9
    assert result.primary_seconds > 0
    assert result.shadow_seconds > 0
    background = result.geom_id == -1
    assert 0.1 < background.mean() < 0.9
    assert (result.prim_id[background] == -1).all()
    assert np.isnan(result.position[background]).all()
    assert (result.normal[background] == 0).all()
    assert (result.visibility[:, background] == -1).all()
    assert set(np.unique(result.geom_id)) == {-1, 0, 1}
    lit = result.counts != pyvocc.NOT_TRACED
    assert (result.visibility[~lit] == -1).all()
    assert (result.visibility[lit] == result.counts[lit] / F(9)).all()
    assert np.allclose(np.linalg.norm(result.normal[~background], axis=1), 1)


def test_the_pass_is_that_of_its_points_one_by_one(small: Small) -> None:
    scene, camera = small
    result = pyvocc.shadow_pass(scene, camera, LIGHTS, size=(70, 45), samples=9)
    counts = scene.light_visibility(result.position, result.normal, LIGHTS, 9)
    assert (counts == result.counts).all()
    org, dir = camera.rays((70, 45))
    hits = scene.intersect(org, dir)
    assert (hits.prim_id == result.prim_id).all()
    hit = hits.prim_id >= 0
    surface = org + hits.t[hit][:, None] * dir[hit]
    gap = ((result.position[hit] - surface) * result.normal[hit]).sum(axis=1)
    assert np.allclose(gap, 1e-4 * scene.closed_extent, atol=3e-6)


def test_options_do_not_change_the_picture(small: Small) -> None:
    scene, camera = small
    first = pyvocc.shadow_pass(scene, camera, LIGHTS, (64, 64), 4)
    for options in (
        {"order": "standard", "occluders": False},
        {"order": "qdbfs", "cache": 0},
        {"packets": False, "isa": "scalar", "threads": 1},
        {"order": "opaque_first", "cache_policy": "direction", "fusion": False},
        {"order": "rtsah", "occluders": False, "triangle_cache": True, "entry_points": True},
        {"order": "sato", "voxels": 40, "entry_triangles": 0},
    ):
        other = pyvocc.shadow_pass(scene, camera, LIGHTS, (64, 64), 4, **options)
        assert (other.counts == first.counts).all()
        assert other.position.tobytes() == first.position.tobytes()


def test_steps_of_each_point_add_up(small: Small) -> None:
    scene, camera = small
    image = pyvocc.shadow_pass(scene, camera, LIGHTS, (24, 20), 4)
    arguments = (image.position, image.normal, LIGHTS, 4)
    for options in ({}, {"order": "qdbfs"}, {"voxels": 8}):
        stats, steps = pyvocc.Stats(), np.full((20, 24), 7, np.uint32)
        counts = scene.light_visibility(*arguments, steps=steps, stats=stats, **options)
        assert (counts == image.counts).all()
        assert steps.sum() == stats.node_visits
        assert (steps[np.isnan(image.position).any(axis=-1)] == 0).all()
    for wrong in (np.zeros((20, 24), np.int32), np.zeros(480, np.uint32), [0]):
        with pytest.raises((pyvocc.InvalidType, pyvocc.InvalidArgument), match="steps"):
            scene.light_visibility(*arguments, steps=wrong)  # type: ignore[arg-type]


def test_searches_settle_most_of_a_simple_picture(small: Small) -> None:
    scene, camera = small
    stats = pyvocc.Stats()
    pyvocc.shadow_pass(scene, camera, LIGHTS, (256, 256), 4, stats=stats, method="rays")
    assert stats.entry_lit_rays > 0.2 * stats.rays
    assert stats.entry_lit_rays + stats.entry_dark_rays < stats.rays
    off = pyvocc.Stats()
    pyvocc.shadow_pass(scene, camera, LIGHTS, (256, 256), 4, stats=off, entry_points=False)
    assert off.entry_searches == 0 and off.rays == stats.rays
    assert off.node_visits > stats.node_visits


@pytest.mark.parametrize("isa", pyvocc.isas())
@pytest.mark.parametrize("sampler", ["sobol", "jitter"])
def test_beams_give_what_rays_give(small: Small, isa: str, sampler: str) -> None:
    scene, camera = small
    for samples in (1, 20, 300):
        ways: list[tuple[pyvocc.Stats, dict[str, Any]]] = [
            (pyvocc.Stats(), {"method": "rays", "order": "standard"}),
            (pyvocc.Stats(), {"method": "beams", "verify": 7}),
            (pyvocc.Stats(), {"method": "beams", "occluders": False}),
        ]
        passes = [
            pyvocc.shadow_pass(
                scene, camera, LIGHTS, (40, 30), samples, sampler=sampler, isa=isa, stats=stats,
                **options,
            )
            for stats, options in ways
        ]  # fmt: skip
        assert all((each.counts == passes[0].counts).all() for each in passes)
        rays, bare = ways[0][0], ways[2][0]
        for stats, _ in ways[1:]:
            assert (stats.rays, stats.occluded, stats.isa) == (rays.rays, rays.occluded, isa)
            settled = stats.beam_lit_rays + stats.beam_dark_rays + stats.beam_hidden_rays
            assert settled + stats.beam_tested_rays == stats.rays
        assert bare.beam_box_rays == bare.beam_dark_rays == 0


@pytest.mark.parametrize("distance", [0.05, 0.5, np.inf])
def test_ambient_occlusion_by_beams(small: Small, distance: float) -> None:
    scene, camera = small
    image = pyvocc.shadow_pass(scene, camera, LIGHTS, (40, 30), 1)
    at = (image.position, image.normal, distance, 16)
    rays, beams, auto = pyvocc.Stats(), pyvocc.Stats(), pyvocc.Stats()
    expected = scene.ambient_occlusion(*at, method="rays", stats=rays)
    actual = scene.ambient_occlusion(*at, method="beams", verify=3, threads=3, stats=beams)
    assert actual.tobytes() == expected.tobytes()
    assert (beams.rays, beams.occluded) == (rays.rays, rays.occluded)
    assert beams.beam_lit_rays + beams.beam_tested_rays == beams.rays
    assert beams.node_visits == 0
    assert (rays.occluded > 0) == (distance > 0.1)
    assert scene.ambient_occlusion(*at, stats=auto).tobytes() == expected.tobytes()
    assert auto.beams > 0


def test_what_beams_cannot_do_is_said(small: Small) -> None:
    scene, camera = small
    image = pyvocc.shadow_pass(scene, camera, LIGHTS, (8, 6), 4)
    points, normals = image.position.reshape(-1, 3), image.normal.reshape(-1, 3)
    with pytest.raises(pyvocc.UnsupportedError, match="point_steps"):
        steps = np.zeros(len(points), np.uint32)
        scene.light_visibility(points, normals, LIGHTS, 4, steps=steps, method="beams")
        scene.ambient_occlusion(points, normals, steps=steps, method="beams")
    with pytest.raises(pyvocc.UnsupportedError, match="verify is 2: not with blocked"):
        blocked = np.zeros((len(LIGHTS), len(points), 1), np.uint8)
        scene.light_visibility(
            points, normals, LIGHTS, 4, blocked=blocked, method="beams", verify=2
        )
    with pytest.raises(pyvocc.InvalidArgument, match="method"):
        scene.light_visibility(points, normals, LIGHTS, 4, method="cones")
    with pytest.raises(pyvocc.InvalidArgument, match="verify"):
        scene.light_visibility(points, normals, LIGHTS, 4, verify=-1)


def test_the_offset_is_what_is_asked_for(small: Small) -> None:
    scene, camera = small
    images = [
        pyvocc.shadow_pass(scene, camera, LIGHTS, (16, 16), 1, offset=offset)
        for offset in (0, 0.25)
    ]
    hit = images[0].prim_id >= 0
    moved = images[1].position[hit] - images[0].position[hit]
    assert np.allclose(moved, 0.25 * images[0].normal[hit], atol=1e-6)


def test_the_pass_counts_only_shadow_rays(small: Small) -> None:
    scene, camera = small
    stats = pyvocc.Stats()
    result = pyvocc.shadow_pass(scene, camera, LIGHTS, (32, 32), 4, horizon="centre", stats=stats)
    assert stats.rays == 4 * (result.counts != pyvocc.NOT_TRACED).sum()


def test_the_progress_of_the_pass_runs_from_0_to_1(small: Small) -> None:
    scene, camera = small
    fractions: list[float] = []
    pyvocc.shadow_pass(scene, camera, LIGHTS, (256, 256), 64, progress=fractions.append)
    assert fractions == sorted(fractions)
    assert 0 <= fractions[0] <= 0.1
    assert 0.9 < fractions[-1] <= 1
    for stop in (0.0, 0.5):
        with pytest.raises(pyvocc.Cancelled):
            pyvocc.shadow_pass(
                scene, camera, LIGHTS, (256, 256), 64, progress=lambda done, at=stop: done >= at
            )


@pytest.mark.parametrize("size", [(1, 1), (32, 32), (33, 1), (70, 45), (3, 100)])
def test_tile_order_names_every_pixel_once(size: tuple[int, int]) -> None:
    order = tile_order(*size)
    assert order.dtype == np.uint32
    assert sorted(order) == list(range(size[0] * size[1]))
    tiles = order // size[0] // 32 * 1000 + order % size[0] // 32
    assert (np.diff(tiles.astype(int)) >= 0).all()


def test_a_moved_scene_gives_the_same_picture(small: Small) -> None:
    far = np.array([500_000.0, 4_000_000.0, 100.0])
    scenes = []
    for shift in (np.zeros(3), far):
        scene = pyvocc.Scene()
        vertices, triangles = shapes.box([-1, 0, -1], [1, 1, 1])
        scene.add_mesh(vertices + shift + 1 / 1024 / 1024, triangles)
        scene.build()
        scenes.append(scene)
    near, moved = (
        pyvocc.shadow_pass(
            scene,
            pyvocc.PerspectiveCamera(tuple(shift + (0, 3, 5)), tuple(shift)),
            [pyvocc.RectLight(tuple(shift + (-1, 4, 0)), (1, 0, 0), (0, 0, 1))],
            (48, 48),
            16,
        )
        for scene, shift in zip(scenes, (np.zeros(3), far), strict=True)
    )
    assert moved.position.dtype == np.float64
    assert (moved.prim_id != near.prim_id).mean() < 0.01
    same = (moved.prim_id == near.prim_id) & (near.prim_id >= 0)
    assert np.allclose(moved.position[same] - far, near.position[same], atol=1e-6)
    assert (moved.counts[:, same] != near.counts[:, same]).mean() < 0.01


def test_shading_points_are_the_formula_bit_for_bit() -> None:
    random = np.random.default_rng(8)
    vertices, triangles = geodesic_sphere(30)
    for shift in (0.0, 1e6 + 0.123):
        with pyvocc.Scene() as scene:
            scene.add_mesh(vertices + shift, triangles)
            scene.build()
            org = np.array([3.0, 2, 5]) + shift
            dir = random.normal(0, 0.5, (20_000, 3)) + shift - org
            seen = pyvocc.shading_points(scene, org, dir, offset=1e-3)
            hits = scene.intersect(org, dir)
            assert (seen.t == hits.t).all() and (seen.prim_id == hits.prim_id).all()
            hit = hits.prim_id >= 0
            assert 0.5 < hit.mean() < 1
            corners = scene.corners(hits.geom_id[hit], hits.prim_id[hit])
            position, normal = shading_point(
                corners, org - scene.origin, dir[hit].astype(F), hits.t[hit], 1e-3
            )
            expected = position + scene.origin if scene.origin.any() else position
            assert seen.position[hit].tobytes() == expected.tobytes()
            assert seen.normal[hit].tobytes() == normal.tobytes()
            assert np.isnan(seen.position[~hit]).all() and not seen.normal[~hit].any()
