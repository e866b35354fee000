"""The arguments of queries, checked, and turned into what the C interface takes."""

from __future__ import annotations

import math
from contextlib import suppress
from typing import TypedDict

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _ffi
from ._arrays import (
    AnyArray,
    Rows,
    Shape,
    broadcast,
    floats,
    integers,
    output,
    rows,
    split_rows,
)
from ._ffi import Progress
from ._values import choice, flag, integer
from .errors import InvalidArgument, InvalidType, UnsupportedError
from .stats import Stats

MAX_THREADS = 256


class QueryOptions(TypedDict, total=False):
    """How `Scene.occluded`, `Scene.light_visibility` and `shadow_pass` go about it.

    None of these changes a result; docs/method.md says what each does.

    Attributes:
        order: "auto" (default: chosen by `build`), "standard", "extended", "bfs", "qdbfs",
            "opaque_first", "sato" or "rtsah".
        occluders: use volumetric occluders (default True).
        deferment: boundary leaves on the deferment list, 0 to 512 (default).
        cache: occluders in the cache, 0 to 64 (default 8); by direction, cells along an edge
            of a cube map.
        cache_policy: "recent" (default: those that blocked last) or "direction" (the last one
            for each direction).
        fusion: the cache holds boxes grown beyond their leaf (default True).
        triangle_cache: test the triangle that blocked last before the tree (default False).
        entry_points: look for what the rays of neighbouring points to a light can meet, all at
            once, and trace from there what that does not settle. Default None: in order
            "auto" only. For light_visibility.
        entry_triangles: such a search gives up when it has found more triangles, 0 to 64
            (default 8).
        voxels: settle points by the voxel that they are in, so many along the longest side of
            the points' bounds, up to 1024; default 0: not. For light_visibility.
        method: how `occluded`, `light_visibility` and `ambient_occlusion` find their answer,
            which is the same by each. "rays": through the kd-tree. "beams": through a hierarchy
            of 16 children a node, for lights groups of points and parts of a light at once, for
            ambient occlusion from what is above some points. "auto" (default): "rays" if an order
            is given or packets are off, for points also if entry points, voxels or their steps
            are asked for, or there are less than 12 rays for each triangle
            (`ambient_occlusion`: less than 1024 rays); else "beams".
        verify: n: `light_visibility` and `ambient_occlusion` by beams trace one in n of the points
            (of each light) again, ray by ray without occluders, and raise MismatchError if a
            count differs; not with `blocked`. Default 0: not.
        packets: rays are traced four at a time (default True).
        isa: "auto" (default: what the environment variable VOCC_ISA says, else the best that
            machine and library have), "scalar", "sse2", "avx2", "avx512" or "neon". See
            `pyvocc.isas`.
        threads: default None: as the scene was made.
    """

    order: str
    occluders: bool
    deferment: int
    cache: int
    cache_policy: str
    fusion: bool
    triangle_cache: bool
    entry_points: bool | None
    entry_triangles: int
    voxels: int
    method: str
    verify: int
    packets: bool
    isa: str
    threads: int | None


def isa(isa: str = "auto") -> str:
    """The name of the instruction set that queries with this option `isa` use.

    Raises:
        UnsupportedError: it is not on this machine or not in this library; its message says
            what there is.
        InvalidArgument: there is none of this name, or, for "auto", of that in VOCC_ISA.
    """
    return _ffi.isa_name(_ffi.query_isa(choice("isa", isa, _ffi.ISAS)))


def isas() -> tuple[str, ...]:
    """The instruction sets that machine and library have, from "scalar" to the best."""
    found = []
    for name in _ffi.ISAS:
        if name != "auto":
            with suppress(UnsupportedError):
                found.append(isa(name))
    return tuple(found)


def threads_or(threads: int | None, default: int) -> int:
    """The number of threads; None stands for the default."""
    return default if threads is None else integer("threads", threads, 1, MAX_THREADS)


def check_options(progress: Progress | None, stats: Stats | None, options: QueryOptions) -> None:
    """Raises what a query would raise for its options, before the work that leads to it."""
    checked_progress(progress)
    checked_stats(stats)
    query_of(0, options)


def query_of(default_threads: int, options: QueryOptions) -> _ffi.Query:
    """The options, checked, with the defaults for the others."""
    unknown = set(options) - QueryOptions.__optional_keys__
    if unknown:
        name = min(unknown)
        known = ", ".join(sorted(QueryOptions.__optional_keys__))
        raise InvalidType(f"there is no option {name!r}; there are {known}", argument=name)
    entry = options.get("entry_points")
    return _ffi.Query(
        order=choice("order", options.get("order", "auto"), _ffi.ORDERS),
        occluders=flag("occluders", options.get("occluders", True)),
        deferment=integer("deferment", options.get("deferment", 512)),
        cache=integer("cache", options.get("cache", 8)),
        cache_policy=choice(
            "cache_policy", options.get("cache_policy", "recent"), _ffi.CACHE_POLICIES
        ),
        fusion=flag("fusion", options.get("fusion", True)),
        triangle_cache=flag("triangle_cache", options.get("triangle_cache", False)),
        entry_points=-1 if entry is None else flag("entry_points", entry),
        entry_triangles=integer("entry_triangles", options.get("entry_triangles", 8)),
        voxels=integer("voxels", options.get("voxels", 0)),
        method=choice("method", options.get("method", "auto"), _ffi.METHODS),
        verify=integer("verify", options.get("verify", 0)),
        packets=flag("packets", options.get("packets", True)),
        isa=choice("isa", options.get("isa", "auto"), _ffi.ISAS),
        threads=threads_or(options.get("threads"), default_threads),
    )


def sampling_of(samples: int, sampler: str, horizon: str = "sample") -> _ffi.Sampling:
    """The sampling, checked."""
    return _ffi.Sampling(
        samples=integer("samples", samples),
        sampler=choice("sampler", sampler, _ffi.SAMPLERS),
        horizon=choice("horizon", horizon, _ffi.HORIZONS),
    )


def blocked_bits(
    blocked: NDArray[np.uint8] | None, shape: Shape, samples: int
) -> NDArray[np.uint8] | None:
    """The caller's bits, checked; a number of samples that is none is told elsewhere."""
    if blocked is not None:
        output("blocked", blocked, (*shape, (max(samples, 1) + 7) // 8), (np.uint8,))
    return blocked


def shading_rows(
    points: ArrayLike, normals: ArrayLike, point_ids: ArrayLike | None
) -> tuple[int, Shape, tuple[Rows, Rows, Rows | None]]:
    """Number of points, their leading shape, and the arguments as rows."""
    positions, directions = floats("points", points), floats("normals", normals)
    shapes = {
        "points": split_rows("points", positions, 3),
        "normals": split_rows("normals", directions, 3),
    }
    ids = None
    if point_ids is not None:
        ids = checked_point_ids(point_ids)
        shapes["point_ids"] = ids.shape
    lead = broadcast(shapes)
    shaded = (
        rows(positions, lead, (3,)),
        rows(directions, lead, (3,)),
        None if ids is None else rows(ids, lead),
    )
    return math.prod(lead), lead, shaded


def checked_progress(progress: Progress | None) -> Progress | None:
    """The function or None, or a TypeError."""
    if progress is not None and not callable(progress):
        raise InvalidType(
            f"progress must be callable, not {type(progress).__name__}", argument="progress"
        )
    return progress


def checked_stats(stats: Stats | None) -> Stats | None:
    """The Stats or None, or a TypeError."""
    if stats is not None and not isinstance(stats, Stats):
        raise InvalidType(
            f"stats must be a pyvocc.Stats, not {type(stats).__name__}", argument="stats"
        )
    return stats


def rays_of(
    org: ArrayLike, dir: ArrayLike, tmin: ArrayLike, tmax: ArrayLike
) -> tuple[int, Shape, tuple[Rows, Rows, Rows | None, Rows | None]]:
    """Number of rays, their leading shape, and the arguments as rows."""
    orgs, dirs = floats("org", org), floats("dir", dir)
    near, far = floats("tmin", tmin), floats("tmax", tmax)
    lead = broadcast(
        {
            "org": split_rows("org", orgs, 3),
            "dir": split_rows("dir", dirs, 3),
            "tmin": near.shape,
            "tmax": far.shape,
        }
    )
    rays = (rows(orgs, lead, (3,)), rows(dirs, lead, (3,)), rows(near, lead), rows(far, lead))
    return math.prod(lead), lead, rays


def checked_point_ids(point_ids: ArrayLike) -> AnyArray:
    """The ids as uint32; wider types are accepted where the values fit."""
    ids = integers("point_ids", point_ids)
    if ids.dtype == np.uint32 or ids.size == 0:
        return ids.astype(np.uint32, copy=False)
    check_ids("point_ids", ids, 2**32)
    return ids.astype(np.uint32)


def check_ids(name: str, ids: AnyArray, count: AnyArray | int) -> None:
    """All ids from 0 to count - 1, or an error that names the first that is not."""
    wrong = np.flatnonzero((ids < 0) | (ids >= count))
    if len(wrong):
        index = int(wrong[0])
        value = int(ids.ravel()[index])
        limit = int(np.broadcast_to(count, ids.shape).ravel()[index]) - 1
        raise InvalidArgument(
            f"{name}[{index}] must be from 0 to {limit}, got {value}",
            argument=name,
            index=index,
            value=value,
        )
