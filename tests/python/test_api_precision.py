"""Coordinates far from the origin keep their detail."""

from __future__ import annotations

import numpy as np
import pytest
import shapes
from numpy.typing import NDArray

import pyvocc

# Metres: national grids put a town here, where float32 numbers are 0.25 m apart.
FAR = np.array([500_000.0, 4_649_776.0, 12.0])


def slit(shift: NDArray[np.float64]) -> pyvocc.Scene:
    """Two blocks of 10 m, 2 mm apart in x."""
    scene = pyvocc.Scene()
    for lower, upper in (([-5.001, -5, -5], [-0.001, 5, 5]), ([0.001, -5, -5], [5.001, 5, 5])):
        vertices, triangles = shapes.box(lower, upper)
        scene.add_mesh(vertices + shift, triangles)
    scene.build()
    return scene


@pytest.mark.parametrize("shift", [np.zeros(3), FAR])
def test_a_slit_of_2_mm_is_seen_at_500_km(shift: NDArray[np.float64]) -> None:
    scene = slit(shift)
    x = np.linspace(-0.003, 0.003, 601)
    org = np.stack([x, np.full_like(x, 0.3), np.full_like(x, 20.0)], axis=-1) + shift
    blocked = scene.occluded(org, [0, 0, -1.0])
    sure = np.abs(np.abs(x) - 0.001) > 2e-6
    assert (blocked == (np.abs(x) > 0.001))[sure].all()
    region = scene.region(org - (0, 0, 20.0))
    assert ((region > 0) == (np.abs(x) > 0.001))[sure].all()
    hits = scene.intersect(org, [0, 0, -1.0])
    assert np.allclose(hits.t[blocked], 15, atol=1e-5)
    assert all(mesh.closed for mesh in scene.report.meshes)
    assert [mesh.volume for mesh in scene.report.meshes] == pytest.approx([500, 500], rel=1e-6)


@pytest.mark.parametrize(
    ("center", "dtype"), [((1.5, -0.25, 3), np.float64), ((1024.5, -7.25, 3e6), np.float32)]
)
def test_the_origin_is_zero_where_float32_holds_everything(
    center: tuple[float, float, float], dtype: type
) -> None:
    scene = pyvocc.Scene()
    vertices, triangles = shapes.cube(center)
    scene.add_mesh(vertices.astype(dtype), triangles)
    scene.build()
    assert scene.origin.tolist() == [0, 0, 0]
    assert scene.origin.dtype == np.float64


def test_points_between_far_float32_numbers_are_told_apart() -> None:
    scene = pyvocc.Scene()
    vertices, triangles = shapes.cube((500_000, 0, 0))
    scene.add_mesh(vertices, triangles)
    scene.build()
    org = [[499_999.001, 0.1, 9], [499_998.999, 0.1, 9]]
    assert scene.occluded(org, [0, 0, -1.0]).tolist() == [True, False]


def test_the_origin_is_the_centre_where_it_does_not() -> None:
    scene = slit(FAR)
    assert np.abs(scene.origin - FAR).max() < 1
    leaves = scene.leaves()
    assert np.abs(leaves["lower"]).max() < 10
    assert np.abs(np.subtract(scene.report.lower, FAR - (5.001, 5, 5))).max() < 1e-5
    assert np.abs(scene.corners(0, 0)).max() < 10


def test_lights_and_points_at_500_km() -> None:
    def counts(shift: NDArray[np.float64]) -> NDArray[np.uint16]:
        scene = slit(shift)
        light = pyvocc.RectLight(tuple(shift + (-1, -5, -20)), (2, 0, 0), (0, 10, 0))
        grid = np.stack(np.meshgrid([-0.0005, 0, 0.0005], [-1, 0, 1.0], [7.0]), axis=-1)
        return scene.light_visibility(grid + shift, [0, 0, -1.0], [light], 900)

    near, far = counts(np.zeros(3)), counts(FAR)
    assert near.max() > 0
    assert np.abs(near.astype(int) - far).max() <= 3


def test_float32_meshes_may_stand_beside_moved_ones() -> None:
    scene = pyvocc.Scene()
    vertices, triangles = shapes.cube((500_000, 0, 0))
    scene.add_mesh(vertices.astype(np.float32), triangles)
    scene.add_mesh(vertices + (4.0001, 0, 0), triangles)
    scene.build()
    org = np.array([[500_000, 0.1, 9], [500_004.0001, 0.1, 9], [500_002, 0.1, 9]])
    assert scene.intersect(org, [0, 0, -1.0]).geom_id.tolist() == [0, 1, -1]
