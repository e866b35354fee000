"""Runs the programs and collects their lines; nothing is judged here."""

from __future__ import annotations

import os
import platform
import tempfile
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from . import programs
from .inputs import Input
from .programs import Line, Program
from .workload import count_bytes, load_counts

OURS = ("baseline", "standard", "qdbfs", "opaque_first", "auto")
EMBREE_BEST = ("fast-s16", "fast-x16", "fast-p16", "fast-stream")  # whichever is fastest
EMBREE = ("robust-1", "robust-4:isa=sse4.2", "fast-1", *EMBREE_BEST)
ROBUST = "robust-1"  # nearly exact: who differs is compared with it
EMBREE_ARRAYS = ("robust-1", "robust-4:isa=sse4.2", "fast-s16", "fast-stream")
SCALED = ("baseline", "auto")

Say = Callable[[str], None]


@dataclass(frozen=True)
class Settings:
    scene: str
    size: int
    samples: int
    rounds: int
    modes: tuple[str, ...]  # ours
    embree: tuple[str, ...]  # empty: not installed, or not asked for
    cpus: tuple[int, ...]  # the pinned one first; empty: cannot be pinned

    @property
    def pinned(self) -> tuple[int, ...]:
        return self.cpus[:1]

    def arguments(self, item: Input) -> list[str | Path]:
        return [
            item.path,
            *("--scene", self.scene, "--size", str(self.size), "--samples", str(self.samples)),
            *("--gbuf", item.gbuffer(self.size, self.scene)),
        ]


def machine() -> dict[str, Any]:
    model = platform.processor()
    info = Path("/proc/cpuinfo")
    if info.exists():
        names = [line for line in info.read_text().splitlines() if line.startswith("model name")]
        model = names[0].partition(":")[2].strip() if names else model
    return {"processor": model, "processors": os.cpu_count(), "system": platform.platform()}


def passes(item: Input, settings: Settings, say: Say) -> dict[str, Any]:
    """All modes, alternating.

    {"ours": {mode: [line, ...]}, "embree": ..., "reference": hash or None, "differ": {"ours":
    {mode: counts that are not the reference's}, "embree": ...}}. The reference is the stored
    image, or where there is none, that of Embree's robust mode.
    """
    lines: dict[str, dict[str, list[Line]]] = {"ours": {}, "embree": {}}
    differ: dict[str, dict[str, int]] = {"ours": {}, "embree": {}}
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        runs: list[tuple[str, Program, str]] = []

        def start(side: str, program: str) -> Program:
            arguments = [*settings.arguments(item), "--counts", folder / side]
            return stack.enter_context(Program(program, *arguments, cpus=settings.pinned))

        def image(path: Path) -> NDArray[np.uint16]:
            return load_counts(path, settings.size, settings.samples)

        stored = item.counts(settings.size, settings.samples, settings.scene)
        reference = image(stored) if stored else None
        digest = fnv1a(count_bytes(reference, settings.samples)) if reference is not None else None
        # Embree first: where there is no G-buffer yet, its camera rays make the one that the
        # reference images were made with.
        if settings.embree:
            embree = start("embree", "embree")
            embree.time("none")
            if reference is None:
                digest = embree.time(ROBUST)["hash"]
                reference = image(folder / "embree")
            runs += [("embree", embree, mode) for mode in settings.embree]
        vocc = start("ours", "vocc")
        runs = [("ours", vocc, mode) for mode in ("none", *settings.modes)] + runs
        for number in range(settings.rounds):
            for side, program, mode in runs:
                counters = number == 0 and side == "ours"
                line = program.time(mode, counters)
                if "error" in line:
                    if number == 0:
                        say(f"{item.name}: {mode}: {line['error']}: left out")
                    continue
                if number == 0 and mode != "none" and reference is not None:
                    differ[side][mode] = int((image(folder / side) != reference).sum())
                lines[side].setdefault(mode, []).append(line)
            say(f"{item.name}: round {number + 1} of {settings.rounds}")
    return {**lines, "reference": digest, "differ": differ}


def fnv1a(data: bytes) -> str:
    value = 0xCBF29CE484222325
    for byte in data:
        value = (value ^ byte) * 0x100000001B3 & 0xFFFFFFFFFFFFFFFF
    return f"{value:016x}"


def with_threads(mode: str, threads: int) -> str:
    return f"{mode}{',' if ':' in mode else ':'}threads={threads}"


def scaling(item: Input, settings: Settings, threads: int, say: Say) -> dict[str, Any]:
    """Wall clock of one thread and of several: {mode: {threads: [line, ...]}}."""
    found: dict[str, Any] = {}
    arguments = settings.arguments(item)
    with Program("vocc", *arguments, cpus=settings.cpus[:threads]) as vocc:
        for _ in range(settings.rounds):
            for mode in SCALED:
                for count in (1, threads):
                    line = vocc.time(with_threads(mode, count))
                    if "error" not in line:
                        found.setdefault(mode, {}).setdefault(str(count), []).append(line)
    say(f"{item.name}: threads")
    return found


def builds(item: Input, settings: Settings, say: Say) -> dict[str, Any]:
    """Build only, with one and two threads: {"ours": {threads: [line, ...]}, "embree": ...}."""
    found: dict[str, Any] = {"ours": {}, "embree": {}}
    sides = [("ours", "vocc")] + ([("embree", "embree")] if settings.embree else [])
    for _ in range(settings.rounds):
        for side, program in sides:
            for threads in (1, 2):
                arguments = ("--build-only", "--build-threads", str(threads))
                cpus = settings.cpus[:threads]
                line = programs.run(program, item.path, *arguments, cpus=cpus)[0]
                found[side].setdefault(str(threads), []).append(line["build"])
    say(f"{item.name}: builds")
    return found


def by_outcome(
    item: Input, settings: Settings, tiles: int, say: Say
) -> dict[str, dict[str, dict[str, list[Line]]]]:
    """Arrays of all, of blocked and of visible rays: {side: {mode: {kind: [line, ...]}}}."""
    found: dict[str, dict[str, dict[str, list[Line]]]] = {"ours": {}, "embree": {}}
    for kind in ("all", "blocked", "visible"):
        arguments = [*settings.arguments(item), "--rays", kind, "--tile-limit", str(tiles)]
        with ExitStack() as stack:
            runs: list[tuple[str, Program, Sequence[str]]] = []
            vocc = stack.enter_context(Program("vocc", *arguments, cpus=settings.pinned))
            runs.append(("ours", vocc, settings.modes))
            if settings.embree:
                embree = stack.enter_context(Program("embree", *arguments, cpus=settings.pinned))
                runs.append(("embree", embree, EMBREE_ARRAYS))
            for _ in range(settings.rounds):
                for side, program, modes in runs:
                    for mode in modes:
                        line = program.time(mode)
                        if "error" not in line:
                            kinds = found[side].setdefault(mode, {})
                            kinds.setdefault(kind, []).append(line)
        say(f"{item.name}: {kind} rays")
    return found
