"""The generated meshes: closed where they say so, of the shape they say, the same every time."""

from __future__ import annotations

import inspect
from dataclasses import dataclass

import numpy as np
import pytest

import pyvocc
from pyvocc import shapes
from pyvocc.shapes import GENERATORS, Mesh, topology


@dataclass(frozen=True)
class Expected:
    """Of a generator with its default parameters."""

    euler: int
    volume: tuple[float, float]
    components: int = 1
    boundary: int = 0
    nonmanifold: int = 0
    inconsistent: int = 0


# Euler numbers from the construction: 2 for each sphere, 0 for a torus.
EXPECTED = {
    "cube": Expected(2, (8, 8)),
    "inverted_cube": Expected(2, (-8, -8)),
    "cube_missing_face": Expected(1, (6, 8), boundary=4, inconsistent=4),
    "plane": Expected(1, (0, 0), boundary=4, inconsistent=4),
    "cube_and_plane": Expected(3, (8, 8), components=2, boundary=4, inconsistent=4),
    "overlapping_cubes": Expected(6, (8 + 8 + 3.375 - 1e-4, 8 + 8 + 3.375 + 1e-4), components=3),
    # Four edges of the common face and its diagonal have four triangles each.
    "touching_solids": Expected(12 - 31 + 24, (8, 8), nonmanifold=5),
    "hollow_room": Expected(4, (4.5**3 - 64, 4.5**3 - 64), components=2),
    "furnished_room": Expected(16, (27.2, 27.6), components=8),
    "thin_plates": Expected(18, (0.8e-3, 1e-3), components=9),
    "fine_cube": Expected(2, (8, 8)),
    "fine_inverted_cube": Expected(2, (-8, -8)),
    "fine_cube_missing_face": Expected(1, (6, 8), boundary=64, inconsistent=64),
    # 16 of the square's vertices lie on the cube's.
    "fine_cube_and_plane": Expected(3 - 16, (8, 8), components=2, boundary=64, inconsistent=64),
    "fine_overlapping_cubes": Expected(6, (19.375 - 1e-4, 19.375 + 1e-4), components=3),
    "fine_touching_solids": Expected(
        # Per box 1538 vertices, 4608 edges; the face has 289 and 800 of them.
        2 * 1538 - 289 - (2 * 4608 - 800) + 6144,
        (8, 8),
        nonmanifold=800,
    ),
    "fine_hollow_room": Expected(4, (4.5**3 - 64, 4.5**3 - 64), components=2),
    "geodesic_sphere": Expected(2, (4.17, 4.19)),
    "icosphere": Expected(2, (4.13, 4.19)),
    "nested_shells": Expected(8, (2.6, 2.7), components=4),
    "bumpy_solid": Expected(2, (3, 5)),
    "torus_knot": Expected(0, (2.2, 2.4)),
    "fat_knot": Expected(0, (10, 12)),
    # 64 nodes joined by 113 rods: the surface of a graph has 2 (nodes - rods).
    "tube_network": Expected(2 * (64 - 113), (0.05, 0.12)),
    "thirteen_shells": Expected(26, (0.15, 0.25), components=13),
    "figure": Expected(2, (0.1, 0.2)),
    "flower": Expected(2 * 31, (0.05, 0.1), components=31),
    "city": Expected(2 * 321, (40, 60), components=321),
}


@pytest.fixture(scope="module")
def made() -> dict[str, Mesh]:
    """Every generator's mesh with its default parameters."""
    return {name: generator() for name, generator in GENERATORS.items()}


def test_every_generator_is_expected_here() -> None:
    assert set(EXPECTED) == set(GENERATORS)


@pytest.mark.parametrize("name", GENERATORS)
def test_topology_of_a_generated_mesh(made: dict[str, Mesh], name: str) -> None:
    vertices, triangles = made[name]
    expected = EXPECTED[name]
    found = topology(vertices, triangles)
    assert found.boundary_edges == expected.boundary
    assert found.closed == (expected.boundary == 0)
    assert found.nonmanifold_edges == expected.nonmanifold
    assert found.inconsistent_edges == expected.inconsistent
    assert found.components == expected.components
    assert found.euler == expected.euler
    low, high = expected.volume
    assert low - 1e-5 <= found.volume <= high + 1e-5


@pytest.mark.parametrize("name", GENERATORS)
def test_arrays_are_as_the_library_takes_them(made: dict[str, Mesh], name: str) -> None:
    vertices, triangles = made[name]
    assert vertices.dtype == np.float32
    assert triangles.dtype == np.int32
    assert vertices.flags.c_contiguous
    assert triangles.flags.c_contiguous
    assert np.isfinite(vertices).all()
    assert triangles.min() == 0
    assert triangles.max() == len(vertices) - 1
    corners = vertices[triangles].astype(np.float64)
    area = np.linalg.norm(
        np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1
    )
    assert (area > 0).all()


@pytest.mark.parametrize("name", GENERATORS)
def test_the_library_counts_the_same(made: dict[str, Mesh], name: str) -> None:
    vertices, triangles = made[name]
    found = topology(vertices, triangles)
    with pyvocc.Scene() as scene:
        scene.add_mesh(vertices, triangles, name)
        report = scene.build().meshes[0]
    assert report.closed == found.closed
    assert report.welded_vertices == found.vertices
    assert report.boundary_edges == found.boundary_edges
    assert report.nonmanifold_edges == found.nonmanifold_edges
    assert len(report.components) == found.components
    assert report.degenerate_triangles == 0
    if found.closed:
        assert report.inconsistent_edges == found.inconsistent_edges
        assert report.volume == pytest.approx(found.volume, rel=1e-6, abs=1e-9)


@pytest.mark.parametrize("name", GENERATORS)
def test_the_same_arguments_give_the_same_mesh(made: dict[str, Mesh], name: str) -> None:
    again = GENERATORS[name]()
    assert np.array_equal(made[name][0], again[0])
    assert np.array_equal(made[name][1], again[1])


@pytest.mark.parametrize("name", GENERATORS)
def test_every_generator_says_what_it_is_for(name: str) -> None:
    assert inspect.getdoc(GENERATORS[name])


@pytest.mark.parametrize("name", ["bumpy_solid", "thin_plates", "tube_network", "flower", "city"])
def test_another_seed_gives_another_mesh(made: dict[str, Mesh], name: str) -> None:
    vertices, triangles = GENERATORS[name](seed=99)
    assert not np.array_equal(vertices, made[name][0])
    assert topology(vertices, triangles).closed


def test_icosphere_of_level_7_has_the_triangles_of_the_crack_test() -> None:
    vertices, triangles = shapes.icosphere(7)
    assert len(triangles) == 327_680
    assert len(vertices) == 163_842
    assert np.allclose(np.linalg.norm(vertices.astype(np.float64), axis=1), 1, atol=1e-6)


@pytest.mark.parametrize("windings", [(1, 1, 1), (-1, -1, -1), (1, -1, 1)])
def test_nested_shells_of_any_winding_are_closed(windings: tuple[int, ...]) -> None:
    found = topology(*shapes.nested_shells(2, (1.0, 0.7, 0.4), windings))
    sphere = topology(*shapes.icosphere(2)).volume
    assert found.closed
    assert found.inconsistent_edges == 0
    expected = sum(w * r**3 for w, r in zip(windings, (1.0, 0.7, 0.4), strict=True)) * sphere
    assert found.volume == pytest.approx(expected, rel=1e-5)


def test_touching_solids_may_cross_their_diagonals() -> None:
    found = topology(*shapes.touching_solids(same_diagonal=False))
    assert found.closed
    assert found.nonmanifold_edges == 4


def test_thin_plates_are_as_thin_as_asked() -> None:
    vertices, _ = shapes.thin_plates(1, 1e-3)
    assert np.ptp(vertices[:, 1]) == pytest.approx(1e-3, rel=1e-3)


def test_an_unknown_generator_is_refused_with_the_names_there_are() -> None:
    with pytest.raises(ValueError, match="no generator 'sphere'; there are cube, "):
        shapes.generate("sphere")


def test_a_solid_that_leaves_its_grid_is_refused() -> None:
    with pytest.raises(ValueError, match="touches the border"):
        shapes.isosurface(-np.ones((4, 4, 4)), (0, 0, 0), (1, 1, 1))


def test_isosurface_of_a_ball() -> None:
    axis = np.linspace(-1.3, 1.3, 24)
    x, y, z = np.meshgrid(axis, axis, axis, indexing="ij")
    vertices, triangles = shapes.isosurface(
        np.sqrt(x**2 + y**2 + z**2) - 1, (-1.3,) * 3, (1.3,) * 3
    )
    found = topology(vertices, triangles)
    assert found.closed
    assert (found.euler, found.nonmanifold_edges, found.inconsistent_edges) == (2, 0, 0)
    assert found.volume == pytest.approx(4 / 3 * np.pi, rel=0.02)


# ---- the ruler itself ----------------------------------------------------------------


def test_topology_sees_a_missing_triangle() -> None:
    vertices, triangles = shapes.cube()
    found = topology(vertices, triangles[1:])
    assert not found.closed
    assert found.boundary_edges == 3


def test_topology_sees_a_turned_triangle() -> None:
    vertices, triangles = shapes.cube()
    triangles = triangles.copy()
    triangles[4] = triangles[4, ::-1]
    found = topology(vertices, triangles)
    assert found.closed
    assert found.inconsistent_edges == 3


def test_topology_welds_by_position() -> None:
    vertices, triangles = shapes.icosphere(1)
    found = topology(vertices[triangles.reshape(-1)], np.arange(triangles.size).reshape(-1, 3))
    assert found == topology(vertices, triangles)


def test_topology_tells_components_apart() -> None:
    pair = shapes.combine(shapes.cube(), shapes.cube(1.0, (5, 0, 0)))
    assert topology(*pair).components == 2


def test_subdivided_keeps_the_surface() -> None:
    knot = shapes.torus_knot(segments=24, sides=6)
    once, twice = topology(*shapes.subdivided(knot, 1)), topology(*shapes.subdivided(knot, 2))
    assert (once.triangles, twice.triangles) == (4 * len(knot[1]), 16 * len(knot[1]))
    assert once.closed
    assert twice.euler == 0
    assert twice.volume == pytest.approx(topology(*knot).volume, rel=1e-5)
    # Doubled vertices: cut alike on both sides of every edge.
    loose = (knot[0][knot[1].reshape(-1)], np.arange(knot[1].size).reshape(-1, 3))
    assert topology(*shapes.subdivided(loose, 2)) == twice


@pytest.mark.parametrize("name", [name for name in GENERATORS if name.startswith("fine_")])
def test_fine_solids_have_occluders(made: dict[str, Mesh], name: str) -> None:
    with pyvocc.Scene() as scene:
        scene.add_mesh(*made[name])
        tree = scene.build().tree
    closed = topology(*made[name]).closed or name == "fine_cube_and_plane"
    assert (tree.opaque_leaves > 0) == closed


def test_inverted_and_transformed() -> None:
    cube = shapes.cube()
    assert topology(*shapes.inverted(cube)).volume == pytest.approx(-8)
    moved, _ = shapes.transformed(cube, 2.0, 90.0, (1.0, 0.0, 0.0))
    assert moved.min(axis=0) == pytest.approx((-1, -2, -2), abs=1e-6)
    assert moved.max(axis=0) == pytest.approx((3, 2, 2), abs=1e-6)
