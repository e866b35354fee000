# SPDX-License-Identifier: GPL-3.0-or-later
"""A camera's rays, as Cycles has them."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import transform
from .data import Vector, View


def view_of(scene: Any, camera: Any, width: int, height: int) -> View:
    """The view of an evaluated camera object.

    Args:
        scene: for its pixel aspect.
        camera: the object.
        width, height: of the full frame in pixels.

    Raises:
        ValueError: says why the camera cannot be used.
    """
    name = f"the camera '{camera.name}'"
    if camera.type != "CAMERA":
        raise ValueError(f"'{camera.name}' is not a camera")
    lens = camera.data
    if lens.type not in ("PERSP", "ORTHO"):
        raise ValueError(f"{name} is neither perspective nor orthographic")
    matrix = np.array(camera.matrix_world, np.float64)
    # Cycles takes the axes' directions and leaves their lengths.
    lengths = np.linalg.norm(matrix[:3, :3], axis=0)
    if not np.isfinite(matrix).all():
        raise ValueError(f"{name} is not at a finite place")
    if not lengths.all():
        raise ValueError(f"{name} is scaled to nothing")
    matrix[:3, :3] /= lengths

    is_orthographic = lens.type == "ORTHO"
    # Lengths on the image plane: at distance 1, or the world's for an orthographic camera.
    pixel_aspect = scene.render.pixel_aspect_y / scene.render.pixel_aspect_x
    frame_height = height * pixel_aspect  # in widths of a pixel
    fit = lens.sensor_fit
    if fit == "AUTO":
        is_wide = width >= frame_height
        sensor = lens.sensor_width
    else:
        is_wide = fit == "HORIZONTAL"
        sensor = lens.sensor_width if is_wide else lens.sensor_height
    fitted = width if is_wide else frame_height
    pixel = (lens.ortho_scale if is_orthographic else sensor / lens.lens) / fitted
    x = lens.shift_x * fitted - width / 2
    y = lens.shift_y * fitted - frame_height / 2
    return View(
        width=width,
        height=height,
        lower_left=np.array((x * pixel, y * pixel, -1.0)),
        right=np.array((width * pixel, 0.0, 0.0)),
        up=np.array((0.0, frame_height * pixel, 0.0)),
        matrix=matrix,
        is_orthographic=is_orthographic,
        near=lens.clip_start,
        far=lens.clip_end,
    )


def moved(view: View, origin: Vector) -> View:
    """The view in the world moved by -origin."""
    return replace(view, matrix=transform.moved(view.matrix, origin))


def camera_rays(
    view: View, x: ArrayLike, y: ArrayLike
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The rays through points of the frame, from the near clipping plane.

    Args:
        view: the camera.
        x, y: (n,), in pixels from the lower left corner of the full frame; the first pixel's
            centre is at (0.5, 0.5).

    Returns:
        org, dir: (n, 3). dir is as long as the ray is while it gets one unit further from the
        camera's plane: at the far clipping plane t is view.far - view.near.
    """
    # Element by element, so that a point's ray is the same whatever points it is asked for with:
    # a border render is a part of the full one, bit for bit.
    u = np.asarray(x, np.float64)[:, None] / view.width
    v = np.asarray(y, np.float64)[:, None] / view.height
    rotation, centre = view.matrix[:3, :3], view.matrix[:3, 3]
    plane = rotation @ view.lower_left + u * (rotation @ view.right) + v * (rotation @ view.up)
    if view.is_orthographic:
        forward = -rotation[:, 2]
        return plane + (centre + (view.near - 1) * forward), np.broadcast_to(forward, plane.shape)
    return centre + view.near * plane, plane
