"""Gate: identical.  Whatever the order, occluders, cache, deferment list, packets, instruction
set and threads, the answers are those of the two-sided baseline, to the last bit.

On the generated scenes and on real meshes; `tests/c/test_identical.c` has every combination of
options and every kind of adversarial ray on smaller shapes.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import product
from typing import Any

import numpy as np
import pytest
from conftest import SHARED
from numpy.typing import NDArray

import pyvocc
from pyvocc.shapes import GENERATORS

Floats = NDArray[np.float32]
Rays = tuple[Floats, Floats, Floats, Floats]

BASELINE: dict[str, Any] = {
    "order": "standard",
    "occluders": False,
    "packets": False,
    "isa": "scalar",
    "threads": 1,
}
ORDERS = ("auto", "standard", "extended", "bfs", "qdbfs", "opaque_first", "sato", "rtsah")
EXTRAS: tuple[dict[str, Any], ...] = (
    {},
    {"cache_policy": "direction"},
    {"fusion": False},
    {"triangle_cache": True},
    {"entry_points": True},
    {"voxels": 9, "entry_points": False},
    {"entry_points": True, "entry_triangles": 64, "triangle_cache": True},
)
FILES = ("bunny.ply", "cowboy.ply", "cowboy_shells.ply", "blobby_shuffled.off", "bunny_open.obj")


def modes() -> list[dict[str, Any]]:
    """Every value with every order; threads and list lengths in turns."""
    turns = list(product((0, 1, 8, 64), (0, 1, 16, 512)))
    fast = pyvocc.isas()[1:] or ("auto",)
    return [
        {
            "order": order,
            "occluders": occluders,
            "packets": packets,
            "isa": "scalar" if plain else fast[number % len(fast)],
            "cache": turns[number % len(turns)][0],
            "deferment": turns[number * 7 % len(turns)][1],
            "threads": 1 + number % 3,
            **EXTRAS[number % len(EXTRAS)],
        }
        for number, (order, occluders, packets, plain) in enumerate(
            product(ORDERS, (True, False), (True, False), (False, True))
        )
    ]


def rays_for(vertices: Floats, triangles: NDArray[np.int32], count: int, seed: int) -> Rays:
    """Random, coherent, axis-parallel, through vertices, from vertices, with and without ends."""
    random = np.random.default_rng(seed)
    used = vertices[np.unique(triangles)]
    lower, upper = used.min(axis=0), used.max(axis=0)
    size = float((upper - lower).max())

    def anywhere(n: int) -> Floats:
        return random.uniform(lower - size / 2, upper + size / 2, (n, 3)).astype(np.float32)

    def on_vertices(n: int) -> Floats:
        return used[random.integers(len(used), size=n)]

    org, to = anywhere(count), anywhere(count)
    part = np.array_split(np.arange(count), 6)
    to[part[1]] = on_vertices(len(part[1]))
    org[part[2]] = on_vertices(len(part[2]))
    # Fans of neighbours.
    org[part[3]] = org[part[3][0]]
    to[part[3]] = to[part[3][0]] + np.linspace(0, size, len(part[3]), dtype=np.float32)[:, None]
    org[part[4]], to[part[4]] = on_vertices(len(part[4])), on_vertices(len(part[4]))
    dir = to - org
    axis = np.zeros((len(part[5]), 3), np.float32)
    axis[np.arange(len(axis)), random.integers(3, size=len(axis))] = random.choice(
        [-1, 1], size=len(axis)
    )
    axis[axis == 0] = random.choice(np.array([0.0, -0.0], np.float32), size=(axis == 0).sum())
    org[part[5]], dir[part[5]] = on_vertices(len(axis)) - axis * np.float32(2 * size), axis
    tmin = random.choice(np.array([0, 0, 0, -np.inf, 0.25], np.float32), size=count)
    tmax = random.choice(np.array([1, np.inf, np.inf, 0.5, 1e-30], np.float32), size=count)
    return org, dir, tmin, tmax


def check_rays(scene: pyvocc.Scene, rays: Rays, what: str) -> None:
    expected = scene.occluded(*rays, **BASELINE)
    assert 0 < expected.sum() < len(expected), what
    hits = scene.intersect(*rays, packets=False, isa="scalar", threads=1)
    assert np.array_equal(hits.prim_id >= 0, expected), what
    for mode in modes():
        differ = np.flatnonzero(scene.occluded(*rays, **mode) != expected)
        assert len(differ) == 0, (
            f"{what}, {mode}: {len(differ)} rays differ, the first is "
            f"{[array[differ[0]].tolist() for array in rays]}"
        )
    for packets, isa, threads in product((True, False), pyvocc.isas(), (1, 2, 3)):
        other = scene.intersect(*rays, packets=packets, isa=isa, threads=threads)
        for ours, theirs, field in zip(hits, other, hits._fields, strict=True):
            assert np.array_equal(ours, theirs), (what, field, packets, isa, threads)


def check_lights(
    scene: pyvocc.Scene, vertices: Floats, triangles: NDArray[np.int32], what: str
) -> None:
    """From triangles' middles, a little off: lights above, inside and across the mesh."""
    random = np.random.default_rng(11)
    corners = vertices[triangles[random.integers(len(triangles), size=1500)]].astype(np.float64)
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300)
    lower, upper = corners.min(axis=(0, 1)), corners.max(axis=(0, 1))
    size = (upper - lower).max()
    points = (corners.mean(axis=1) + 1e-4 * size * normals).astype(np.float32)
    middle = (lower + upper) / 2
    rects = [
        pyvocc.RectLight(upper + size * 0.5, (size / 2, 0, 0), (0, 0, size / 2)),
        pyvocc.RectLight(middle, (size / 50, 0, 0), (0, size / 50, 0)),
        pyvocc.RectLight(middle - size, (2 * size, 0, 0), (0, 2 * size, 2 * size)),
    ]
    normals32 = normals.astype(np.float32)
    expected = scene.light_visibility(points, normals32, rects, samples=8, **BASELINE)
    for mode in modes():
        visible = scene.light_visibility(points, normals32, rects, samples=8, **mode)
        assert np.array_equal(visible, expected), (what, mode)


# Few triangles, on round coordinates: rays through edges, along faces, from corners.
HOSTILE = (
    "cube_missing_face",
    "cube_and_plane",
    "overlapping_cubes",
    "touching_solids",
    "furnished_room",
    "thin_plates",
    "fine_inverted_cube",
    "fine_hollow_room",
    "nested_shells",
)
# About solids that reach from -1 to 1 or a little farther: across, inside, on and in line with
# faces.
LIGHTS: dict[str, tuple[pyvocc.Light, ...]] = {
    "rect": (
        pyvocc.RectLight((-1, 1, -1), (2, 0, 0), (0, 0, 2)),
        pyvocc.RectLight((-3, -1, -1), (6, 2, 0), (0, 1, 2), two_sided=False),
    ),
    "disk": (
        pyvocc.DiskLight((0, 0, 0), (3, 0, 0), (0, 0, 3)),
        pyvocc.DiskLight((0.5, 2, 0), (1, 0, 0), (0, 0.25, 0.5), two_sided=False),
    ),
    "sphere": (
        pyvocc.SphereLight((0, 0, 0), 0.25),
        pyvocc.SphereLight((0, 2, 0), 1),
        pyvocc.SphereLight((0, 0, 0), 8),
    ),
    "point": (
        pyvocc.PointLight((0, 3, 0)),
        pyvocc.PointLight((1, 1, 1)),
        pyvocc.PointLight((0.25, 0, 0.5), 0.5),
    ),
    "spot": (
        pyvocc.SpotLight((0, 3, 0), (0, -1, 0), 0.75),
        pyvocc.SpotLight((-2, 2, 0), (2, -2, 1), 1.5, 0.25),
    ),
    "sun": (
        pyvocc.SunLight((0, 1, 0)),
        pyvocc.SunLight((1, 1, 0)),
        pyvocc.SunLight((-1, 2, 3), 0.25),
        pyvocc.SunLight((0, 0, -1), 3.0),
    ),
}


def receivers(vertices: Floats, triangles: NDArray[np.int32], count: int) -> tuple[Floats, Floats]:
    """Points off triangles, on them, on vertices, on a lattice; normals of faces or whatever."""
    random = np.random.default_rng(len(triangles))
    chosen = triangles[random.integers(len(triangles), size=count)]
    corners = vertices[chosen].astype(np.float64)
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300)
    points = np.einsum("nk,nkc->nc", random.dirichlet((1, 1, 1), count), corners)
    kind = np.arange(count) % 6
    points[kind < 3] += 1e-4 * normals[kind < 3]
    points[kind == 4] = corners[kind == 4, 0]
    points[kind == 5] = random.integers(-8, 9, (int((kind == 5).sum()), 3)) / 4
    odd = random.random(count) < 0.2
    normals[odd] = random.integers(-2, 3, (int(odd.sum()), 3))
    return points.astype(np.float32), normals.astype(np.float32)


def told(
    scene: pyvocc.Scene,
    points: Floats,
    normals: Floats,
    lights: tuple[pyvocc.Light, ...],
    how: dict[str, Any],
    mode: dict[str, Any],
) -> tuple[bytes, ...]:
    """Counts, bits and irradiance."""
    bits = np.zeros((len(lights), len(points), 2), np.uint8)
    counts = scene.light_visibility(points, normals, lights, 9, blocked=bits, **how, **mode)
    shares = scene.light_irradiance(points, normals, lights, 9, **how, **mode)
    return counts.tobytes(), bits.tobytes(), shares.tobytes()


@pytest.mark.parametrize("kind", LIGHTS)
@pytest.mark.parametrize("name", HOSTILE)
def test_lights_of_every_type(name: str, kind: str) -> None:
    vertices, triangles = GENERATORS[name]()
    points, normals = receivers(vertices, triangles, 480)
    ways: list[dict[str, Any]] = [
        {"sampler": sampler, "horizon": horizon}
        for sampler, horizon in product(("sobol", "jitter"), ("sample", "centre"))
    ]
    with pyvocc.Scene() as scene:
        scene.add_mesh(vertices, triangles)
        scene.build()
        asked = (scene, points, normals, LIGHTS[kind])
        expected = [told(*asked, how, BASELINE) for how in ways]
        counts = np.frombuffer(expected[0][0], np.uint16)
        assert {0, pyvocc.NOT_TRACED} <= set(counts.tolist())
        # No sun shines into a closed room.
        assert len(np.unique(counts)) > 2 or (name, kind) == ("furnished_room", "sun")
        assert len(set(expected)) > 2
        for number, mode in enumerate(modes()):
            way = (number + number // 4) % 4
            got = told(*asked, ways[way], mode)
            assert got == expected[way], (name, kind, ways[way], mode)


@pytest.mark.parametrize("name", HOSTILE)
def test_ambient_occlusion(name: str) -> None:
    vertices, triangles = GENERATORS[name]()
    points, normals = receivers(vertices, triangles, 600)
    with pyvocc.Scene() as scene:
        scene.add_mesh(vertices, triangles)
        scene.build()
        for distance in (0.25, 3.0, np.inf):
            expected = scene.ambient_occlusion(points, normals, distance, 9, **BASELINE)
            assert len(np.unique(expected)) > 2
            beams = [{"method": "beams", "isa": isa, "verify": 1} for isa in pyvocc.isas()]
            for mode in [*modes(), *beams]:
                opened = scene.ambient_occlusion(points, normals, distance, 9, **mode)
                assert np.array_equal(opened, expected), (name, distance, mode)


def check_mesh(vertices: Floats, triangles: NDArray[np.int32], count: int, what: str) -> None:
    with pyvocc.Scene() as scene:
        scene.add_mesh(vertices, triangles, name=what)
        scene.build()
        check_rays(scene, rays_for(vertices, triangles, count, seed=len(triangles)), what)
        check_lights(scene, vertices, triangles, what)


@pytest.mark.parametrize("name", sorted(GENERATORS))
def test_generated(name: str) -> None:
    check_mesh(*GENERATORS[name](), count=6000, what=name)


@pytest.mark.parametrize("name", FILES)
def test_real(name: str) -> None:
    path = SHARED / "meshes" / name
    if not path.is_file():
        pytest.skip("the shared meshes are not here")
    vertices, triangles = pyvocc.load_mesh(path)
    check_mesh(np.ascontiguousarray(vertices, np.float32), triangles, count=20_000, what=name)


def test_several_meshes_of_which_some_hold_no_occluders() -> None:
    names = ("nested_shells", "overlapping_cubes", "torus_knot", "plane", "hollow_room")
    parts = [GENERATORS[name]() for name in names]
    vertices = np.concatenate([p[0] for p in parts])
    starts = np.cumsum([0] + [len(p[0]) for p in parts[:-1]])
    triangles = np.concatenate([p[1] + s for p, s in zip(parts, starts, strict=True)])
    rays = rays_for(vertices, triangles.astype(np.int32), 20_000, seed=5)
    with pyvocc.Scene() as scene:
        for number, part in enumerate(parts):
            scene.add_mesh(*part, name=names[number], occluder=number % 2 == 0)
        scene.build()
        check_rays(scene, rays, "several meshes")


@pytest.mark.parametrize("change", [lambda a: a.astype(np.float64), np.asfortranarray])
def test_other_arrays_of_the_same_values(change: Callable[[Floats], Any]) -> None:
    vertices, triangles = GENERATORS["nested_shells"]()
    rays = rays_for(vertices, triangles, 5000, seed=9)
    with pyvocc.Scene() as scene:
        scene.add_mesh(change(vertices), triangles.astype(np.uint64))
        scene.build()
        expected = scene.occluded(*rays, **BASELINE)
        assert np.array_equal(scene.occluded(*(change(a) for a in rays)), expected)
        backward = scene.occluded(*(a[::-1] for a in rays))
        assert np.array_equal(backward[::-1], expected)
