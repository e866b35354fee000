"""The soft-shadow pass: from a camera's pixels to the visible share of every light."""

from __future__ import annotations

import math
import time
from collections.abc import Iterable
from dataclasses import dataclass, fields, replace
from typing import Unpack

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _ffi
from ._arrays import AnyArray
from ._ffi import NOT_TRACED, Progress
from ._query import (
    QueryOptions,
    check_options,
    checked_progress,
    query_of,
    rays_of,
    sampling_of,
)
from ._values import integer, number, size_2d
from .camera import PerspectiveCamera
from .errors import InvalidArgument, InvalidType
from .lights import Light, checked_lights
from .scene import Scene
from .stats import Stats

# Pixels are computed tile by tile: neighbouring rays meet the same nodes and occluders.
TILE = 32

# Shading points computed at once; bounds the memory of the double temporaries.
CHUNK = 1 << 17

# Share of the whole that the primary rays and shading points take, for the progress only.
PRIMARY_SHARE = 0.1

# The offset of a scene of extent 1: the float32 number next to 1e-4.
OFFSET = float(np.float32(1e-4))


@dataclass(frozen=True, eq=False)
class ShadowPass:
    """An image of shadows; L lights, H rows from the top, W pixels each.

    Attributes:
        visibility: (L, H, W) float32, the visible share of each light's samples; -1 where
            nothing is traced: the surface is turned away from the light or out of its reach,
            or it is background.
        counts: (L, H, W) uint16, visible samples; NOT_TRACED where visibility is -1.
        position: (H, W, 3), the shading points, moved off the surface by the offset; NaN on
            the background. float32, or float64 where the scene has an origin.
        normal: (H, W, 3) float32, the unit geometric normal that faces the eye; 0 on the
            background.
        geom_id, prim_id: (H, W) int32, what the pixel shows; -1 for the background.
        samples: of each light.
        primary_seconds: wall clock for primary rays and shading points.
        shadow_seconds: wall clock for the shadow rays.
    """

    visibility: NDArray[np.float32]
    counts: NDArray[np.uint16]
    position: AnyArray
    normal: NDArray[np.float32]
    geom_id: NDArray[np.int32]
    prim_id: NDArray[np.int32]
    samples: int
    primary_seconds: float
    shadow_seconds: float


def shadow_pass(
    scene: Scene,
    camera: PerspectiveCamera,
    lights: Iterable[Light],
    size: tuple[int, int] = (1024, 1024),
    samples: int = 16,
    *,
    sampler: str = "sobol",
    horizon: str = "sample",
    progress: Progress | None = None,
    offset: float | None = None,
    stats: Stats | None = None,
    **options: Unpack[QueryOptions],
) -> ShadowPass:
    """Renders the soft shadows of lights as the camera sees them.

    Args:
        scene: a built scene.
        camera: where the picture is taken from.
        lights: any number of lights of any types.
        size: width and height in pixels.
        samples: shadow rays to each light and pixel, 1 to 65534.
        sampler, horizon: as in `Scene.light_visibility`.
        progress: called with the fraction done; returns True to stop.
        offset: how far shading points are moved off the surface, >= 0, in the scene's unit;
            default 1e-4 of `scene.closed_extent`.
        stats: counters of the shadow rays (not the primary rays), which are added to.
        **options: how it is done, see `QueryOptions`. They do not change the picture.

    Raises:
        As the methods of Scene.
    """
    if not isinstance(scene, Scene):
        raise InvalidType(f"scene must be a Scene, not {type(scene).__name__}", argument="scene")
    if not isinstance(camera, PerspectiveCamera):
        raise InvalidType(
            f"camera must be a PerspectiveCamera, not {type(camera).__name__}", argument="camera"
        )
    checked = checked_lights(lights)
    width, height = size_2d("size", size)
    sample_count = integer("samples", samples, 1, NOT_TRACED - 1)
    sampling_of(sample_count, sampler, horizon)
    distance = _offset(scene, offset)
    check_options(progress, stats, options)

    start = time.perf_counter()
    pixels = tile_order(width, height)
    points = _pixel_points(scene, camera, (width, height), pixels, distance, progress, options)
    middle = time.perf_counter()
    tiled = scene.light_visibility(
        points.position,
        points.normal,
        checked,
        sample_count,
        pixels,
        sampler=sampler,
        horizon=horizon,
        progress=_part(progress, PRIMARY_SHARE, 1.0),
        stats=stats,
        **options,
    )
    end = time.perf_counter()

    counts = np.empty(tiled.shape, np.uint16)
    counts[:, pixels] = tiled
    visibility = np.where(counts == NOT_TRACED, np.float32(-1), counts / np.float32(sample_count))
    shape = (height, width)
    return ShadowPass(
        visibility=visibility.reshape(len(checked), *shape),
        counts=counts.reshape(len(checked), *shape),
        position=_scatter(points.position, pixels).reshape(*shape, 3),
        normal=_scatter(points.normal, pixels).reshape(*shape, 3),
        geom_id=_scatter(points.geom_id, pixels).reshape(shape),
        prim_id=_scatter(points.prim_id, pixels).reshape(shape),
        samples=sample_count,
        primary_seconds=middle - start,
        shadow_seconds=end - middle,
    )


def tile_order(width: int, height: int, tile: int = TILE) -> NDArray[np.uint32]:
    """All pixel indices y * width + x: tile by tile, in a tile row by row."""
    columns, lines = -(-width // tile), -(-height // tile)
    y = np.arange(lines * tile).reshape(lines, 1, tile, 1)
    x = np.arange(columns * tile).reshape(1, columns, 1, tile)
    inside = (y < height) & (x < width)
    return (y * width + x)[inside].astype(np.uint32)


@dataclass(frozen=True, eq=False)
class ShadingPoints:
    """What rays see first, as shadow rays start from it; (...) is the rays' leading shape.

    Attributes:
        position: (..., 3), moved off the surface by the offset; NaN for a miss. float32, or
            float64 where the scene has an origin.
        normal: (..., 3) float32, the unit geometric normal on the side of the ray's origin; 0
            for a miss.
        geom_id, prim_id: (...) int32, the mesh and its triangle; -1 for a miss.
        t: (...) float32, in units of dir; infinity for a miss.
    """

    position: AnyArray
    normal: NDArray[np.float32]
    geom_id: NDArray[np.int32]
    prim_id: NDArray[np.int32]
    t: NDArray[np.float32]


def shading_points(
    scene: Scene,
    org: ArrayLike,
    dir: ArrayLike,
    *,
    offset: float | None = None,
    packets: bool = True,
    isa: str = "auto",
    threads: int | None = None,
    progress: Progress | None = None,
) -> ShadingPoints:
    """What rays see first, ready for `Scene.light_visibility` and `Scene.ambient_occlusion`.

    Args:
        org, dir, packets, isa, threads, progress: as in `Scene.intersect`.
        offset: how far points are moved off the surface, >= 0, in the scene's unit; default
            `scene.safe_offset`, the smallest that keeps them on their side of it.

    Raises:
        As the methods of Scene.
    """
    if not isinstance(scene, Scene):
        raise InvalidType(f"scene must be a Scene, not {type(scene).__name__}", argument="scene")
    distance = scene.safe_offset if offset is None else _distance(offset)
    count, lead, (orgs, dirs, _, _) = rays_of(org, dir, 0.0, np.inf)
    query = query_of(scene._threads, {"packets": packets, "isa": isa, "threads": threads})
    points = ShadingPoints(
        np.empty((*lead, 3), np.float32),
        np.empty((*lead, 3), np.float32),
        np.empty(lead, np.int32),
        np.empty(lead, np.int32),
        np.empty(lead, np.float32),
    )
    with scene._borrow() as handle:
        _ffi.shading_points(
            handle,
            count,
            orgs,
            dirs,
            distance,
            (points.t, points.geom_id, points.prim_id),
            points.position,
            points.normal,
            query,
            checked_progress(progress),
        )
    if scene.origin.any():
        return replace(points, position=points.position + scene.origin)
    return points


def _pixel_points(
    scene: Scene,
    camera: PerspectiveCamera,
    size: tuple[int, int],
    pixels: NDArray[np.uint32],
    offset: float,
    progress: Progress | None,
    options: QueryOptions,
) -> ShadingPoints:
    """What these pixels show, chunk by chunk."""
    count = len(pixels)
    chunks = []
    for first in range(0, count, CHUNK):
        org, dir = camera.rays(size, pixels[first : first + CHUNK])
        chunks.append(
            shading_points(
                scene,
                org,
                dir,
                offset=offset,
                packets=options.get("packets", True),
                isa=options.get("isa", "auto"),
                threads=options.get("threads"),
                progress=_part(
                    progress,
                    PRIMARY_SHARE * first / count,
                    PRIMARY_SHARE * min(first + CHUNK, count) / count,
                ),
            )
        )
    return ShadingPoints(
        *(
            np.concatenate([getattr(chunk, field.name) for chunk in chunks])
            for field in fields(ShadingPoints)
        )
    )


def shading_point(
    corners: NDArray[np.float32],
    org: NDArray[np.float64],
    dir: NDArray[np.float32],
    t: NDArray[np.float32],
    offset: float,
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Where rays meet the planes of triangles, and the normals there.

    Computed in double from the triangle rather than from t, so that another program that
    finds the same triangle gets the same point; t is used where the plane is no help, for a
    triangle that is edge-on in double.

    Args:
        corners: (n, 3, 3) of the triangles hit.
        org: (3,) or (n, 3), relative to the scene's origin as the corners are.
        dir: (n, 3).
        t: (n,), of the hits.
        offset: along the normal that faces org.

    Returns:
        (n, 3) positions and (n, 3) unit normals.
    """
    a, b, c = (corners[:, index].astype(np.float64) for index in range(3))
    d = dir.astype(np.float64)
    normal = _cross(b - a, c - a)
    with np.errstate(divide="ignore", invalid="ignore"):
        normal /= np.sqrt(_dot(normal, normal))[:, None]
        slope = _dot(d, normal)
        distance = _dot(a - org, normal) / slope
    # Not above 0 is the front, as it is for a slope that is not a number.
    side = np.where(slope > 0, -1.0, 1.0)[:, None]
    distance = np.where(np.isfinite(distance), distance, t)[:, None]
    facing = side * np.nan_to_num(normal)
    position = org + distance * d + offset * side * np.nan_to_num(normal)
    return position.astype(np.float32), facing.astype(np.float32)


def _cross(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
    # np.cross does not say in which order it rounds.
    (ax, ay, az), (bx, by, bz) = a.T, b.T
    return np.stack([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx], axis=-1)


def _dot(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
    product = a * b
    total: NDArray[np.float64] = product[..., 0] + product[..., 1] + product[..., 2]
    return total


def _offset(scene: Scene, offset: float | None) -> float:
    if offset is None:
        return OFFSET * scene.closed_extent
    return _distance(offset)


def _distance(offset: float) -> float:
    value = number("offset", offset)
    if not 0 <= value < math.inf:
        raise InvalidArgument(
            f"offset must be finite and at least 0, got {value}", argument="offset", value=value
        )
    return value


def _scatter(tiled: AnyArray, pixels: NDArray[np.uint32]) -> AnyArray:
    """From the order of the pixels given to that of the image."""
    image = np.empty_like(tiled)
    image[pixels] = tiled
    return image


def _part(progress: Progress | None, lower: float, upper: float) -> Progress | None:
    """The progress of a part of the whole."""
    if progress is None:
        return None
    return lambda fraction: progress(lower + fraction * (upper - lower))
