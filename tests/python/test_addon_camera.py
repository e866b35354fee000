"""The add-on's camera rays, by hand; against Cycles in tests/blender/test_camera.py."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import addon  # noqa: F401 - first: it makes the next importable
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from blender_addon.camera import camera_rays, view_of

SCENE = SimpleNamespace(render=SimpleNamespace(pixel_aspect_x=1.0, pixel_aspect_y=1.0))


def camera(matrix: Any = None, **values: Any) -> Any:
    """A camera of 90 degrees at the origin that looks along -z."""
    lens = {
        "type": "PERSP",
        "sensor_fit": "AUTO",
        "sensor_width": 36.0,
        "sensor_height": 24.0,
        "lens": 18.0,
        "ortho_scale": 6.0,
        "shift_x": 0.0,
        "shift_y": 0.0,
        "clip_start": 0.5,
        "clip_end": 100.0,
    }
    return SimpleNamespace(
        name="Shot",
        type="CAMERA",
        data=SimpleNamespace(**lens | values),
        matrix_world=np.eye(4) if matrix is None else matrix,
    )


def test_perspective() -> None:
    view = view_of(SCENE, camera(), 200, 100)
    org, dir = camera_rays(view, [0, 100, 200], [0, 50, 100])
    assert_allclose(dir, [(-1, -0.5, -1), (0, 0, -1), (1, 0.5, -1)], atol=1e-15)
    assert_allclose(org, dir * 0.5)
    assert (view.near, view.far) == (0.5, 100)


def test_orthographic() -> None:
    view = view_of(SCENE, camera(type="ORTHO"), 100, 200)
    org, dir = camera_rays(view, [0, 100], [0, 200])
    assert_allclose(org, [(-1.5, -3, -0.5), (1.5, 3, -0.5)])
    assert_array_equal(dir, [(0, 0, -1)] * 2)


@pytest.mark.parametrize(
    ("fit", "size", "corner"),
    [
        ("AUTO", (200, 100), (1, 0.5)),
        ("AUTO", (100, 200), (0.5, 1)),
        ("HORIZONTAL", (100, 200), (1, 2)),
        ("VERTICAL", (200, 100), (4 / 3, 2 / 3)),
    ],
)
def test_sensor_fits(fit: str, size: tuple[int, int], corner: tuple[float, float]) -> None:
    view = view_of(SCENE, camera(sensor_fit=fit), *size)
    _, dir = camera_rays(view, [size[0]], [size[1]])
    assert_allclose(dir, [(*corner, -1)])


def test_shift_is_a_share_of_the_fitted_side() -> None:
    view = view_of(SCENE, camera(shift_x=0.5, shift_y=-0.25), 200, 100)
    _, dir = camera_rays(view, [100], [50])
    assert_allclose(dir, [(1, -0.5, -1)])


def test_pixels_that_are_not_square() -> None:
    scene = SimpleNamespace(render=SimpleNamespace(pixel_aspect_x=1.0, pixel_aspect_y=2.0))
    view = view_of(scene, camera(), 100, 100)
    _, dir = camera_rays(view, [100], [100])
    assert_allclose(dir, [(0.5, 1, -1)])


def test_only_the_directions_of_axes_count() -> None:
    turned = np.array([[0, 0, 3, 10], [0, -2, 0, 20], [0.5, 0, 0, 30], [0, 0, 0, 1.0]])
    org, dir = camera_rays(view_of(SCENE, camera(turned), 200, 200), [200], [150])
    # x is the world's z, y the world's -y, and the camera looks along the world's -x.
    assert_allclose(dir, [(-1, -0.5, 1)])
    assert_allclose(org, [(9.5, 19.75, 30.5)])


@pytest.mark.parametrize("type", ["PERSP", "ORTHO"])
def test_a_ray_does_not_depend_on_the_others(type: str) -> None:
    matrix = np.eye(4)
    matrix[:3, :3] = np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))[0]
    matrix[:3, 3] = (1e3, -20, 0.3)
    view = view_of(SCENE, camera(matrix, type=type, shift_x=0.1), 97, 61)
    y, x = np.mgrid[:61, :97] + 0.5
    full = np.stack(camera_rays(view, x.ravel(), y.ravel()))
    crop = np.stack(camera_rays(view, x[7:12, 5:].ravel(), y[7:12, 5:].ravel()))
    assert_array_equal(full.reshape(2, 61, 97, 3)[:, 7:12, 5:].reshape(2, -1, 3), crop)


@pytest.mark.parametrize(
    ("bad", "message"),
    [
        (camera(type="PANO"), "'Shot' is neither perspective nor orthographic"),
        (camera(np.diag([1.0, 0, 1, 1])), "'Shot' is scaled to nothing"),
        (camera(np.full((4, 4), np.nan)), "'Shot' is not at a finite place"),
        (SimpleNamespace(name="Lamp", type="LIGHT"), "'Lamp' is not a camera"),
    ],
)
def test_cameras_that_cannot_be_used(bad: Any, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        view_of(SCENE, bad, 10, 10)
