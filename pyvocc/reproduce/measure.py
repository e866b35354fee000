"""Runs what is missing of the cells: passes counted and timed, outcomes apart, pictures.

Counters come from a pass of their own, which is not timed. Times are CPU times of the one
thread that traces, in rounds of all modes, so that what slows the machine for a while slows
all of them; the figure is the median of the rounds.
"""

from __future__ import annotations

import contextlib
import hashlib
import os
import platform
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import asdict, dataclass
from functools import cached_property
from pathlib import Path
from statistics import median
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .. import NOT_TRACED
from ..scene import Scene
from ..shadow import TILE
from ..stats import Stats
from . import modes, pictures, workload
from .cells import Key, Store, Value
from .embree import MAX_SAMPLES, Embree, Traced, fnv1a
from .modes import Mode
from .settings import Settings
from .subjects import Mesh, Subject, load
from .workload import RECT_LIGHTS, Floats, Points

# Tiles whose rays are traced apart, blocked and visible: as arrays they take memory.
SPLIT_TILES = 32
OUTCOMES = ("blocked", "visible")

# One ray a leaf must tell the same in any direction; the last meets no edge head-on.
DIRECTIONS = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.3713, 0.5571, 0.7427))

# Counters of entry points that are steps and tests like others.
_SEARCHED = {"node_visits": "entry_steps", "triangle_tests": "entry_tests"}

Counts = NDArray[np.uint16]


@dataclass(frozen=True)
class Machine:
    """Where it runs; what times depend on beside the library."""

    processor: str
    processors: int
    system: str
    python: str


def machine() -> Machine:
    model = platform.processor() or platform.machine()
    info = Path("/proc/cpuinfo")
    if info.exists():
        names = [line for line in info.read_text().splitlines() if line.startswith("model name")]
        model = names[0].partition(":")[2].strip() if names else model
    return Machine(model, os.cpu_count() or 1, platform.platform(), platform.python_version())


@contextlib.contextmanager
def pinned() -> Iterator[int | None]:
    """This process runs on one processor, which is told; None where the system cannot."""
    if not hasattr(os, "sched_setaffinity"):
        yield None
        return
    before = os.sched_getaffinity(0)
    last = max(before)  # the first one serves most interrupts
    os.sched_setaffinity(0, {last})
    try:
        yield last
    finally:
        os.sched_setaffinity(0, before)


class Cell(NamedTuple):
    """One measurement that is planned."""

    key: Key
    label: str
    make: Callable[[], Value]


class Measured:
    """One subject: its cells, how each is made, and what they hold."""

    def __init__(
        self,
        subject: Subject,
        settings: Settings,
        store: Store,
        library: dict[str, Any],
        machine: Machine,
        embree: Embree | None,
    ) -> None:
        self.subject = subject
        self.settings = settings
        self._store = store
        self._library = library
        self._machine = {"processor": machine.processor, "system": machine.system}
        self._embree = embree
        self._open = ExitStack()
        self._points: dict[int, Points] = {}
        # Read again where cells are to be made: not all meshes are held at once.
        self._digest = load(subject, settings.meshes).digest

    def close(self) -> None:
        """Frees what the measurements needed; the cells stay."""
        self._open.close()
        self._points.clear()
        for name in ("_mesh", "_scene", "_split", "_traced"):
            self.__dict__.pop(name, None)

    # ---- what there is -------------------------------------------------------

    def plan(self) -> list[Cell]:
        """All cells, in the order in which they are made."""
        size, sweep = self.settings.size, self.settings.sweep_size
        cells = [Cell(self._scene_key(), "scene", self._make_scene)]
        for direction in DIRECTIONS:
            cells.append(self._cell("one ray a leaf", self._make_classes, direction))
        cells.append(Cell(self._pictures_key(), "pictures", self._make_pictures))
        for mode in modes.MAIN:
            cells.append(self._cell(mode.label, self._make_counts, mode, size))
        for round_ in range(self.settings.rounds):
            for mode in modes.MAIN:
                cells.append(self._cell(mode.label, self._make_time, mode, size, round_))
            for name in self._embree.modes if self._embree else ():
                cells.append(self._cell(f"Embree {name}", self._make_embree, name, round_))
        for mode in modes.SWEEPS:
            cells.append(self._cell(mode.label, self._make_counts, mode, sweep))
        for round_ in range(self.settings.rounds):
            for mode in modes.SWEEPS:
                cells.append(self._cell(mode.label, self._make_time, mode, sweep, round_))
        split = [(mode, kind) for kind in OUTCOMES for mode in modes.SPLIT]
        for mode, kind in split:
            cells.append(
                self._cell(f"{kind} rays, {mode.label}", self._make_split_counts, mode, kind)
            )
        for round_ in range(self.settings.rounds):
            for mode, kind in split:
                label = f"{kind} rays, {mode.label}"
                cells.append(self._cell(label, self._make_split_time, mode, kind, round_))
        # The sweeps of a small run are passes that there are already.
        return list({_text(cell.key): cell for cell in cells}.values())

    def _cell(self, label: str, make: Callable[..., Value], *arguments: Any) -> Cell:
        keys: dict[Callable[..., Value], Callable[..., Key]] = {
            self._make_counts: self._count_key,
            self._make_time: self._time_key,
            self._make_embree: self._embree_key,
            self._make_classes: self._classes_key,
            self._make_split_counts: self._split_count_key,
            self._make_split_time: self._split_time_key,
        }
        return Cell(keys[make](*arguments), label, lambda: make(*arguments))

    # ---- keys: everything that determines a cell ------------------------------

    def _key(self, kind: str, **more: Any) -> Key:
        return {"cell": kind, "mesh": self._digest, **self._library, **more}

    def _pass_key(self, kind: str, mode: Mode, size: int, **more: Any) -> Key:
        # What the mode does and not what it is called.
        samples = self.settings.samples
        return self._key(kind, size=size, samples=samples, options=dict(mode.options), **more)

    def _scene_key(self) -> Key:
        return self._key("scene", **self._machine)

    def _count_key(self, mode: Mode, size: int) -> Key:
        return self._pass_key("count", mode, size)

    def _time_key(self, mode: Mode, size: int, round_: int) -> Key:
        return self._pass_key("time", mode, size, round=round_, **self._machine)

    def _split_count_key(self, mode: Mode, kind: str) -> Key:
        return self._pass_key("split count", mode, self.settings.size, outcome=kind)

    def _split_time_key(self, mode: Mode, kind: str, round_: int) -> Key:
        more = {"outcome": kind, "round": round_, **self._machine}
        return self._pass_key("split time", mode, self.settings.size, **more)

    def _embree_key(self, name: str, round_: int) -> Key:
        settings, program = self.settings, self._embree.digest if self._embree else ""
        more = {"size": settings.size, "samples": settings.samples, "program": program}
        return self._key("embree", mode=name, round=round_, **more, **self._machine)

    def _classes_key(self, direction: Sequence[float]) -> Key:
        return self._key("classes", direction=list(direction), **self._machine)

    def _pictures_key(self) -> Key:
        size, samples = self.settings.size, self.settings.samples
        return self._key("pictures", size=size, samples=samples)

    # ---- what it holds --------------------------------------------------------

    @property
    def tree(self) -> Value:
        """Of the scene: its report in figures."""
        return self._store.get(self._scene_key()) or {}

    def count(self, mode: Mode, size: int | None = None) -> Value | None:
        """A pass's rays, visible samples, hash and counters."""
        return self._store.get(self._count_key(mode, size or self.settings.size))

    def counter(self, mode: Mode, name: str, size: int | None = None) -> int | None:
        """One counter of a pass; what the search for entry points does counts as well."""
        count = self.count(mode, size)
        if count is None:
            return None
        return int(count["counters"][name] + count["counters"].get(_SEARCHED.get(name), 0))

    def seconds(self, mode: Mode, size: int | None = None) -> float | None:
        """The median time of a pass."""
        return _median(
            self._store.get(self._time_key(mode, size or self.settings.size, k))
            for k in range(self.settings.rounds)
        )

    def spread(self, mode: Mode) -> float:
        """(slowest - fastest) / median of a mode's rounds."""
        found = [
            cell["seconds"]
            for k in range(self.settings.rounds)
            if (cell := self._store.get(self._time_key(mode, self.settings.size, k)))
        ]
        return (max(found) - min(found)) / median(found) if found else 0.0

    def rate(self, mode: Mode) -> float | None:
        """Million rays a second."""
        count, seconds = self.count(mode), self.seconds(mode)
        return count["rays"] / seconds / 1e6 if count and seconds else None

    def gain(
        self, mode: Mode, base: Mode = modes.BASELINE, size: int | None = None
    ) -> float | None:
        """How many times as fast as another mode."""
        one, other = self.seconds(mode, size), self.seconds(base, size)
        return other / one if one and other else None

    def split_count(self, mode: Mode, kind: str) -> Value | None:
        """Of the blocked or the visible rays alone: rays, agreement and counters."""
        return self._store.get(self._split_count_key(mode, kind))

    def split_seconds(self, mode: Mode, kind: str) -> float | None:
        return _median(
            self._store.get(self._split_time_key(mode, kind, k))
            for k in range(self.settings.rounds)
        )

    def embree_modes(self) -> tuple[str, ...]:
        """Those of Embree that are measured; none where it is not there."""
        return self._embree.modes if self._embree else ()

    def embree(self, name: str) -> Value | None:
        """Median seconds, rays and hash of one of Embree's modes."""
        lines = [
            line
            for k in range(self.settings.rounds)
            if (line := self._store.get(self._embree_key(name, k))) and "error" not in line
        ]
        if not lines:
            return None
        return {**lines[0], "seconds": median(line["seconds"] for line in lines)}

    def classes(self, direction: Sequence[float]) -> Value | None:
        """One ray a leaf against the flood fill."""
        return self._store.get(self._classes_key(direction))

    @property
    def pictures(self) -> Value:
        """Pictures by name, and what they show in figures."""
        return self._store.get(self._pictures_key()) or {}

    def hashes(self) -> dict[int, dict[str, list[str]]]:
        """By size of the image and its hash: the modes that gave it, counted and timed."""
        found: dict[int, dict[str, list[str]]] = {}
        main, sweep = self.settings.size, self.settings.sweep_size
        for size, listed in ((main, modes.MAIN), (sweep, modes.SWEEPS)):
            for mode in listed:
                keys = [self._count_key(mode, size)]
                keys += [self._time_key(mode, size, k) for k in range(self.settings.rounds)]
                for digest in {cell["hash"] for key in keys if (cell := self._store.get(key))}:
                    found.setdefault(size, {}).setdefault(digest, []).append(mode.label)
        return found

    def split_agrees(self) -> bool:
        """Every mode found the blocked rays blocked and the visible ones visible."""
        return all(
            cell["wrong"] == 0
            for mode in modes.SPLIT
            for kind in OUTCOMES
            if (cell := self.split_count(mode, kind))
        )

    # ---- how it is made -------------------------------------------------------

    @cached_property
    def _mesh(self) -> Mesh:
        return load(self.subject, self.settings.meshes)

    @cached_property
    def _scene(self) -> Scene:
        return self._open.enter_context(
            workload.build(self._mesh.vertices, self._mesh.triangles, self.subject.name)
        )

    def _shading_points(self, size: int) -> Points:
        if size not in self._points:
            self._points[size] = workload.shading_points(self._scene, size)
        return self._points[size]

    def _make_scene(self) -> Value:
        report = self._scene.report
        return {
            **asdict(report.tree),
            "triangles": report.meshes[0].triangle_count,
            "closed": report.meshes[0].closed,
            "components": len(report.meshes[0].components),
            "leaves": report.tree.leaf_count,
            "area_ratio": report.tree.occluder_area_ratio,
            "seconds": asdict(report.seconds),
        }

    def _trace(
        self,
        mode: Mode,
        size: int,
        stats: Stats | None = None,
        steps: NDArray[np.uint32] | None = None,
    ) -> tuple[float, Counts]:
        points = self._shading_points(size)
        begin = time.thread_time()
        visible = self._scene.light_visibility(
            points.position,
            points.normal,
            RECT_LIGHTS,
            self.settings.samples,
            points.pixels,
            sampler="jitter",
            horizon="centre",
            stats=stats,
            steps=steps,
            **mode.options,
        )
        return time.thread_time() - begin, visible

    def _make_counts(self, mode: Mode, size: int) -> Value:
        stats = Stats()
        _, visible = self._trace(mode, size, stats)
        traced = visible[visible != NOT_TRACED]
        return {
            "rays": traced.size * self.settings.samples,
            "visible": int(traced.sum(dtype=np.int64)),
            "hash": _digest(visible),
            "counters": stats.counters,
        }

    def _make_time(self, mode: Mode, size: int, round_: int) -> Value:
        seconds, visible = self._trace(mode, size)
        return {"seconds": seconds, "hash": _digest(visible)}

    @cached_property
    def _split(self) -> dict[str, tuple[Floats, Floats]]:
        """org and dir of the blocked and the visible rays of some tiles, in order."""
        return split_rays(
            self._scene, self._shading_points(self.settings.size), self.settings.samples
        )

    def _make_split_counts(self, mode: Mode, kind: str) -> Value:
        stats = Stats()
        _, blocked = self._trace_split(mode, kind, stats)
        wrong = int(np.count_nonzero(blocked != (kind == "blocked")))
        return {"rays": len(blocked), "wrong": wrong, "counters": stats.counters}

    def _make_split_time(self, mode: Mode, kind: str, round_: int) -> Value:
        return {"seconds": self._trace_split(mode, kind)[0]}

    def _trace_split(
        self, mode: Mode, kind: str, stats: Stats | None = None
    ) -> tuple[float, NDArray[Any]]:
        org, dir = self._split[kind]
        begin = time.thread_time()
        blocked = self._scene.occluded(org, dir, 0.0, 1.0, stats=stats, **mode.options)
        return time.thread_time() - begin, blocked

    @cached_property
    def _traced(self) -> Traced:
        assert self._embree is not None
        points = self._shading_points(self.settings.size)
        traced = self._embree.trace(self._mesh, points, self.settings.samples)
        return self._open.enter_context(traced)

    def _make_embree(self, name: str, round_: int) -> Value:
        return self._traced.time(name)

    def _make_classes(self, direction: Sequence[float]) -> Value:
        found = self._scene.classify_by_rays(direction, threads=1)
        return {
            "seconds": found.seconds,
            "rays": found.rays,
            "disagreements": len(found.disagreements),
        }

    def _make_pictures(self) -> Value:
        size, samples = self.settings.size, self.settings.samples
        points = self._shading_points(size)
        steps: dict[str, NDArray[np.uint32]] = {}
        counts: dict[str, Counts] = {}
        for mode in (modes.BASELINE, modes.QDBFS):
            steps[mode.name] = np.empty(len(points.pixels), np.uint32)
            _, counts[mode.name] = self._trace(mode, size, steps=steps[mode.name])
        one, other = counts[modes.BASELINE.name], counts[modes.QDBFS.name]
        value: Value = {
            **pictures.coherence(points, one, samples),
            "different": int(np.count_nonzero(one != other)),
            "pictures": pictures.draw(
                self._scene, self._mesh.vertices, points, one, other, samples, steps
            ),
        }
        if samples <= MAX_SAMPLES:
            image = np.full((len(one), size * size), 255, np.uint8)
            image[:, points.pixels] = np.where(one == NOT_TRACED, 255, one)
            value["fnv1a"] = fnv1a(image.tobytes())
        return value


def split_rays(
    scene: Scene, points: Points, samples: int, tiles: int = SPLIT_TILES
) -> dict[str, tuple[Floats, Floats]]:
    """org and dir of the blocked and of the visible rays of some tiles, in the pass's order."""
    y, x = np.divmod(points.pixels, points.size)
    tile = y // TILE * -(-points.size // TILE) + x // TILE
    there = np.unique(tile)
    # Drawn, not every so many: those would be one column of the image.
    chosen = np.random.default_rng(1).permutation(there)[:tiles]
    rows = np.flatnonzero(np.isin(tile, chosen))
    position, pixels = points.position[rows], points.pixels[rows]
    counts = scene.light_visibility(
        position, points.normal[rows], RECT_LIGHTS, 1, pixels, horizon="centre", threads=1
    )
    traced = (counts != NOT_TRACED).T
    dir = np.stack(
        [workload.directions(k, pixels, position, samples) for k in range(len(RECT_LIGHTS))], axis=1
    )[traced].reshape(-1, 3)
    org = np.broadcast_to(position[:, None, None], (*traced.shape, samples, 3))[traced]
    org = np.ascontiguousarray(org).reshape(-1, 3)
    blocked = scene.occluded(org, dir, 0.0, 1.0, threads=1).astype(bool)
    return {"blocked": (org[blocked], dir[blocked]), "visible": (org[~blocked], dir[~blocked])}


def _digest(visible: Counts) -> str:
    return hashlib.sha256(visible.tobytes()).hexdigest()[:16]


def _median(cells: Iterator[Value | None]) -> float | None:
    found = [cell["seconds"] for cell in cells if cell is not None]
    return median(found) if found else None


def _text(key: Key) -> str:
    return repr(sorted(key.items()))
