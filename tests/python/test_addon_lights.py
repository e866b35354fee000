"""The shapes that stand for Blender's lights; against Cycles in tests/blender/test_lights.py."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import addon  # noqa: F401 - first: it makes the next importable
import numpy as np
import pytest
from numpy.testing import assert_allclose
from numpy.typing import NDArray

import pyvocc
from blender_addon.data import Light
from blender_addon.lights import read_light, shape_of


def light(kind: str, matrix: Any = None, **values: Any) -> Light:
    rows = np.eye(4) if matrix is None else np.asarray(matrix, np.float64)
    return Light(
        name="Key",
        object_name="Key",
        kind=kind,
        matrix=tuple(tuple(row) for row in rows.tolist()),
        **values,
    )


def turned(scale: tuple[float, float, float] = (1, 1, 1)) -> NDArray[np.float64]:
    """Somewhere, turned in a way that keeps numbers simple: x to y, y to z, z to x."""
    matrix = np.eye(4)
    matrix[:3, :3] = np.array([[0, 0, 1], [1, 0, 0], [0, 1, 0]]) * scale
    matrix[:3, 3] = (10, 20, 30)
    return matrix


def test_rectangle() -> None:
    shape = shape_of(light("AREA", turned((2, 1, 5)), shape="RECTANGLE", size=(3.0, 4.0)))
    assert isinstance(shape, pyvocc.RectLight) and not shape.two_sided
    assert_allclose(shape.corner, (10, 20 - 3, 30 - 2))
    assert_allclose(np.abs(shape.edge_u) + np.abs(shape.edge_v), (0, 6, 4))
    assert_allclose(np.cross(shape.edge_u, shape.edge_v), (-24, 0, 0))


def test_disk_and_ellipse() -> None:
    shape = shape_of(light("AREA", turned((2, 1, 1)), shape="ELLIPSE", size=(3.0, 4.0)))
    assert isinstance(shape, pyvocc.DiskLight) and not shape.two_sided
    assert_allclose(shape.center, (10, 20, 30))
    assert_allclose(np.abs(shape.axis_u) + np.abs(shape.axis_v), (0, 3, 2))
    assert_allclose(np.cross(shape.axis_u, shape.axis_v), (-6, 0, 0))
    disk = shape_of(light("AREA", shape="DISK", size=(3.0, 3.0)))
    assert_allclose(np.linalg.norm([disk.axis_u, disk.axis_v], axis=1), 1.5)


@pytest.mark.parametrize("scale", [(-1, 1, 1), (1, -1, 1), (-1, -1, 1), (1, 1, 0)])
def test_a_mirrored_or_flat_area_light_still_shines_along_its_axis(
    scale: tuple[float, float, float],
) -> None:
    shape = shape_of(light("AREA", turned(scale)))
    assert_allclose(np.cross(shape.edge_u, shape.edge_v), (-1, 0, 0))


def test_mirrored_along_its_axis_it_shines_the_other_way() -> None:
    shape = shape_of(light("AREA", turned((1, 1, -1))))
    assert_allclose(np.cross(shape.edge_u, shape.edge_v), (1, 0, 0))


def test_sun() -> None:
    shape = shape_of(light("SUN", turned((1, 1, 2)), angle=0.1))
    assert isinstance(shape, pyvocc.SunLight)
    assert_allclose(np.cross(shape.direction, (1, 0, 0)), 0)
    assert shape.direction[0] > 0 and shape.angle == 0.1


@pytest.mark.parametrize("kind", ["POINT", "SPOT"])
def test_point_and_spot(kind: str) -> None:
    disk = shape_of(light(kind, turned((5, 5, 5)), radius=0.25))
    assert type(disk) is pyvocc.PointLight
    assert (disk.center, disk.radius) == ((10, 20, 30), 0.25)
    ball = shape_of(light(kind, turned((0, 0, 0)), radius=0.25, is_sphere=True))
    assert type(ball) is pyvocc.SphereLight
    assert (ball.center, ball.radius) == ((10, 20, 30), 0.25)
    point = shape_of(light(kind, is_sphere=True))
    assert type(point) is pyvocc.PointLight and point.radius == 0


@pytest.mark.parametrize(
    ("bad", "message"),
    [
        (light("AREA", size=(0.0, 1.0)), "area light 'Key' has no area"),
        (light("AREA", np.diag([1, 0, 1, 1])), "area light 'Key' has no area"),
        (light("SUN", np.diag([1, 1, 0, 1])), "sun 'Key' .* no direction"),
        (light("POINT", np.full((4, 4), np.nan)), "light 'Key' is not at a finite place"),
    ],
)
def test_lights_that_cannot_be_used(bad: Light, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        shape_of(bad)


def blender_light(**values: Any) -> Any:
    original = SimpleNamespace(name_full="Key [lamps.blend]")
    data = SimpleNamespace(**{"use_shadow": True} | values)
    return SimpleNamespace(name="Key", original=original, data=data)


def test_reading() -> None:
    area = {"type": "AREA", "size": 2.0, "size_y": 3.0}
    for shape, size in {
        "SQUARE": (2, 2),
        "DISK": (2, 2),
        "RECTANGLE": (2, 3),
        "ELLIPSE": (2, 3),
    }.items():
        read = read_light(blender_light(shape=shape, **area), np.eye(4), "Key in Room")
        assert (read.kind, read.shape, read.size) == ("AREA", shape, size)
    assert (read.name, read.object_name) == ("Key in Room", "Key [lamps.blend]")
    assert (read.casts_shadow, read.blockers, read.receivers) == (True, None, None)

    round = {"shadow_soft_size": 0.5, "use_soft_falloff": False, "use_shadow": False}
    read = read_light(blender_light(type="SPOT", **round), turned(), "Key")
    assert (read.kind, read.radius, read.is_sphere) == ("SPOT", 0.5, True)
    assert not read.casts_shadow
    assert read.matrix[0] == (0, 0, 1, 10)

    sun = read_light(blender_light(type="SUN", angle=0.01), np.eye(4), "Key")
    assert (sun.kind, sun.angle) == ("SUN", 0.01)
    assert hash(sun) == hash(read_light(blender_light(type="SUN", angle=0.01), np.eye(4), "Key"))
