"""What is measured: options of `Scene.light_visibility` by name."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Unpack

from .._query import QueryOptions

# Doublings to the largest size there is, and none at all.
DEFERMENTS = (0, 1, 2, 4, 8, 16, 32, 64, 128, 256, 512)
CACHES = (0, 1, 2, 4, 8, 16, 32, 64)
POLICIES = ("recent", "direction")
VOXELS = 64


@dataclass(frozen=True, eq=False)
class Mode:
    """One way to trace the rays.

    Attributes:
        name: short, unique; names the mode in what is kept.
        label: shown.
        options: of `Scene.light_visibility`.
    """

    name: str
    label: str
    options: QueryOptions


def _mode(name: str, label: str, base: QueryOptions, **options: Unpack[QueryOptions]) -> Mode:
    return Mode(name, label, {**base, **options})


# Front to back, triangles at once, no occluders: the slides' "Standard Ray Order".
_BASE: QueryOptions = {
    "method": "rays",
    "order": "standard",
    "occluders": False,
    "cache": 0,
    "deferment": 512,
    "cache_policy": "recent",
}
_STANDARD: QueryOptions = {**_BASE, "order": "standard", "occluders": True, "cache": 8}
_EXTENDED: QueryOptions = {**_BASE, "order": "extended", "occluders": True, "cache": 8}
_QDBFS: QueryOptions = {**_BASE, "order": "qdbfs", "occluders": True, "cache": 8}

BASELINE = _mode("baseline", "baseline", _BASE)
STANDARD = _mode("standard", "standard + cache", _STANDARD)
EXTENDED = _mode("extended", "extended", _EXTENDED)
BFS = _mode("bfs", "BFS", _QDBFS, order="bfs")
QDBFS = _mode("qdbfs", "QDBFS", _QDBFS)
OPAQUE_FIRST = _mode("opaque_first", "opaque first", _QDBFS, order="opaque_first")
AUTO = _mode("auto", "auto", _QDBFS, order="auto")

# The slides' own, in their order, and those that came later.
ORDERS = (BASELINE, STANDARD, EXTENDED, BFS, QDBFS, OPAQUE_FIRST, AUTO)

BASELINE_SINGLE = _mode("baseline-single", "baseline, single rays", _BASE, packets=False)
QDBFS_SINGLE = _mode("qdbfs-single", "QDBFS, single rays", _QDBFS, packets=False)
SINGLES = (BASELINE_SINGLE, QDBFS_SINGLE)

# "Traversal steps guaranteed to increase" is about the order, so without a cache.
EXTENDED_BARE = _mode("extended-bare", "extended, no cache", _EXTENDED, cache=0)

# Orders for any-hit rays that know nothing of an inside.
SATO = _mode("sato", "larger child first", _BASE, order="sato")
RTSAH = _mode("rtsah", "cheaper child first", _BASE, order="rtsah")
TRIANGLE_CACHE = _mode("triangle-cache", "last triangle first", _BASE, triangle_cache=True)
SCEPTICS = (SATO, RTSAH, TRIANGLE_CACHE)

# "Previous Work".
VOXELS_BASE = _mode("voxels", "baseline + voxels", _BASE, voxels=VOXELS)
VOXELS_QDBFS = _mode("voxels-qdbfs", "QDBFS + voxels", _QDBFS, voxels=VOXELS)
ENTRY_BASE = _mode("entry", "baseline + entry points", _BASE, entry_points=True)
ENTRY_QDBFS = _mode("entry-qdbfs", "QDBFS + entry points", _QDBFS, entry_points=True)
ENTRY_NOT_AUTO = _mode(
    "entry-not-auto", "auto, no entry points", _QDBFS, order="auto", entry_points=False
)
UNFUSED_QDBFS = _mode("unfused", "QDBFS, plain leaves", _QDBFS, fusion=False)
UNFUSED_STANDARD = _mode(
    "unfused-standard", "standard + cache, plain leaves", _STANDARD, fusion=False
)
RELATED = (
    VOXELS_BASE,
    VOXELS_QDBFS,
    UNFUSED_QDBFS,
    UNFUSED_STANDARD,
    ENTRY_BASE,
    ENTRY_QDBFS,
    ENTRY_NOT_AUTO,
)


def deferment(order: str, size: int) -> Mode:
    """Of the deferment-list sweep."""
    base = _EXTENDED if order == "extended" else _QDBFS
    return _mode(f"{order}-deferment-{size}", f"{order}, list {size}", base, deferment=size)


def cache(policy: str, size: int) -> Mode:
    """Of the occluder-cache sweep; size 0, no cache, is the same for every policy."""
    options: QueryOptions = {"cache": size, "cache_policy": policy if size else "recent"}
    return _mode(
        f"qdbfs-cache-{policy if size else 'none'}-{size}",
        f"QDBFS, {policy} cache {size}",
        _QDBFS,
        **options,
    )


MAIN = (*ORDERS, *SINGLES, EXTENDED_BARE, *SCEPTICS, *RELATED)
SWEEPS = tuple(
    {
        mode.name: mode
        for mode in (
            BASELINE,
            *(deferment(order, n) for order in ("extended", "qdbfs") for n in DEFERMENTS),
            *(cache(policy, n) for policy in POLICIES for n in CACHES),
            UNFUSED_QDBFS,
        )
    }.values()
)
# Blocked and visible rays alone.
SPLIT = (BASELINE, STANDARD, EXTENDED, QDBFS, OPAQUE_FIRST, AUTO)
