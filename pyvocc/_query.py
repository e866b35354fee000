"""The arguments of queries, checked, and turned into what the C interface takes."""

from __future__ import annotations

import math
from typing import TypedDict

import numpy as np
from numpy.typing import ArrayLike

from . import _ffi
from ._arrays import AnyArray, Rows, Shape, broadcast, floats, integers, rows, split_rows
from ._ffi import Progress
from ._values import choice, flag, integer
from .errors import InvalidArgument, InvalidType
from .stats import Stats

MAX_THREADS = 256


class QueryOptions(TypedDict, total=False):
    """The options of `Scene.occluded` and `Scene.light_visibility`; none changes a result."""

    order: str
    occluders: bool
    cache: int
    deferment: int
    packets: bool
    isa: str
    threads: int | None


def threads_or(threads: int | None, default: int) -> int:
    """The number of threads; None stands for the default."""
    return default if threads is None else integer("threads", threads, 1, MAX_THREADS)


def check_options(progress: Progress | None, stats: Stats | None, options: QueryOptions) -> None:
    """Raises what a query would raise for its options, before the work that leads to it."""
    unknown = set(options) - QueryOptions.__optional_keys__
    if unknown:
        raise InvalidType(f"there is no option {min(unknown)!r}")
    checked_progress(progress)
    checked_stats(stats)
    query_of(0, **options)


def query_of(
    default_threads: int,
    order: str = "auto",
    occluders: bool = True,
    cache: int = 8,
    deferment: int = 512,
    packets: bool = True,
    isa: str = "auto",
    threads: int | None = None,
) -> _ffi.Query:
    """The options of `Scene.occluded`, of those that a query has."""
    return _ffi.Query(
        order=choice("order", order, _ffi.ORDERS),
        occluders=flag("occluders", occluders),
        deferment=integer("deferment", deferment),
        cache=integer("cache", cache),
        packets=flag("packets", packets),
        isa=choice("isa", isa, _ffi.ISAS),
        threads=threads_or(threads, default_threads),
    )


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
