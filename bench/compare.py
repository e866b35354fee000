"""Settles by exact arithmetic where our image and Embree's differ: who is right?

Embree's robust mode is not exact, so an image that equals its image is not the aim; every
ray that differs must come out in our favour.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from . import programs
from .inputs import Input
from .rational import Oracle
from .workload import (
    LIGHTS,
    NOT_TRACED,
    SCENES,
    Floats,
    directions,
    load_counts,
    load_gbuffer,
    load_scene,
)

Rays: TypeAlias = NDArray[np.float32]  # (rays, 6): org, dir
# Counts that are settled: if more differ, the images are of different rays.
MOST = 200

Trace: TypeAlias = Callable[[Rays], NDArray[np.bool_]]


@dataclass(frozen=True)
class Difference:
    """A pixel and light whose counts differ, ray by ray."""

    light: int
    pixel: int
    ours: int
    reference: int
    rays: Rays  # those on which somebody disagrees
    exact: tuple[bool, ...]  # occluded, by exact arithmetic
    ours_wrong: int
    embree_wrong: int | None  # None: Embree is not there to be asked

    def __str__(self) -> str:
        embree = "not asked" if self.embree_wrong is None else f"{self.embree_wrong} wrong"
        verdict = f"ours {self.ours_wrong} wrong, Embree {embree}"
        return (
            f"light {self.light}, pixel {self.pixel}: ours {self.ours}, "
            f"reference {self.reference} visible: {verdict}"
        )


@dataclass(frozen=True)
class Verdict:
    mesh: str
    traced: int  # pixels x lights
    mistraced: int  # traced by one and not by the other
    unsettled: int  # beyond MOST
    differences: list[Difference]

    @property
    def ours_wrong(self) -> int:
        return self.mistraced + self.unsettled + sum(d.ours_wrong for d in self.differences)


def differing(
    ours: NDArray[np.uint16], reference: NDArray[np.uint16]
) -> tuple[int, list[tuple[int, int]]]:
    """How many (light, pixel) only one has traced, and which of the others differ."""
    mistraced = (ours == NOT_TRACED) != (reference == NOT_TRACED)
    lights = len(ours)
    rows, pixels = np.nonzero(
        ((ours != reference) & ~mistraced).reshape(lights, -1),
    )
    pairs = [(int(k), int(p)) for k, p in zip(rows, pixels, strict=True)]
    return int(mistraced.sum()), pairs


def settle(
    mesh: str,
    make_oracle: Callable[[], Oracle],
    points: NDArray[np.float32],
    samples: int,
    ours: NDArray[np.uint16],
    reference: NDArray[np.uint16],
    trace: Trace,
    trace_embree: Trace | None = None,
    light_list: Floats = LIGHTS,
) -> Verdict:
    """Traces the rays of each differing pixel and light by all that can be asked.

    The oracle is made only if there is something to settle.
    """
    mistraced, pairs = differing(ours, reference)
    traced = int((reference != NOT_TRACED).sum())
    if not pairs:
        return Verdict(mesh, traced, mistraced, 0, [])
    unsettled = max(len(pairs) - MOST, 0)
    pairs = pairs[:MOST]
    rays = np.empty((len(pairs), samples, 6), np.float32)
    for row, (light, pixel) in zip(rays, pairs, strict=True):
        row[:, :3] = points[pixel]
        row[:, 3:] = directions(light, pixel, points[pixel], samples, light_list)
    oracle = make_oracle()
    flat = rays.reshape(-1, 6)
    exact = np.array([oracle.occluded(ray[:3], ray[3:], tmax=1.0) for ray in flat])
    wrong = (trace(flat) != exact).reshape(-1, samples)
    wrong_embree = np.zeros_like(wrong)
    if trace_embree is not None:
        wrong_embree = (trace_embree(flat) != exact).reshape(-1, samples)
    visible = samples - exact.reshape(-1, samples).sum(axis=1)
    lights = len(ours)
    found = []
    for n, (light, pixel) in enumerate(pairs):
        counted = int(ours.reshape(lights, -1)[light, pixel])
        disputed = wrong[n] | wrong_embree[n]
        found.append(
            Difference(
                light,
                pixel,
                counted,
                int(reference.reshape(lights, -1)[light, pixel]),
                rays[n][disputed],
                tuple(bool(x) for x in exact.reshape(-1, samples)[n][disputed]),
                # The image can be wrong where the same rays traced again are right.
                max(int(wrong[n].sum()), abs(counted - int(visible[n]))),
                int(wrong_embree[n].sum()) if trace_embree is not None else None,
            )
        )
    return Verdict(mesh, traced, mistraced, unsettled, found)


def tracer(program: str, mesh: Path, scene: str, mode: str, folder: Path) -> Trace:
    """Traces arrays of rays by starting a program on them."""

    def trace(rays: Rays) -> NDArray[np.bool_]:
        source, target = folder / "rays", folder / "results"
        rays.astype("<f4").tofile(source)
        programs.run(program, mesh, "--scene", scene, "--trace", source, target, mode)
        return np.fromfile(target, np.uint8).astype(bool)

    return trace


def verify(
    item: Input, scene: str, size: int, samples: int, embree: bool, modes: Sequence[str]
) -> list[tuple[str, Verdict]]:
    """Our image in each mode against the reference, or where there is none, Embree's image."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        image = folder / "counts"
        common = (
            item.path,
            *("--scene", scene, "--size", str(size), "--samples", str(samples)),
            *("--counts", image),
        )
        gbuffer = item.gbuffer(size, scene)
        stored = item.counts(size, samples, scene)
        if stored is None:
            if not embree:
                raise programs.BenchError(
                    f"{item.name}: neither reference counts nor Embree to compare with"
                )
            programs.run("embree", *common, "--gbuf", gbuffer, "robust-1")
        reference = load_counts(stored or image, size, samples)
        points = load_gbuffer(gbuffer).points

        def make_oracle() -> Oracle:
            return Oracle(*load_scene(item.path, scene).mesh.with_ground())

        theirs = tracer("embree", item.path, scene, "robust-1", folder) if embree else None
        lights = SCENES[scene].lights
        verdicts = []
        for mode in modes:
            line = programs.run("vocc", *common, "--gbuf", gbuffer, mode)[0]
            if "error" in line:
                continue
            ours = load_counts(image, size, samples)
            trace = tracer("vocc", item.path, scene, mode, folder)
            verdict = settle(
                item.name, make_oracle, points, samples, ours, reference, trace, theirs, lights
            )
            verdicts.append((mode, verdict))
        return verdicts
