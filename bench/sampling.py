"""`python -m bench.sampling`: the error of penumbrae against the number of samples, by sampler.

A knot, a ball and a rock on a ground, seen by a camera, under a rectangle, a disk and a sun.  Of
the points that see a light in part, the visible share is estimated by each sampler, and compared
with that of many samples.  The error is the root of the mean square over points and some runs,
which differ in the points' ids.
"""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

import pyvocc
from pyvocc import shapes
from pyvocc.shadow import tile_order

from .programs import ROOT
from .report import table

Floats: TypeAlias = NDArray[np.float64]

OUTPUT = ROOT / "docs" / "images" / "sampling.png"
COUNTS = tuple(2**k for k in range(11))
SAMPLERS = ("random", "jitter", "sobol")
REFERENCE = 16384
SIZE = (192, 144)

CAMERA = pyvocc.PerspectiveCamera((0.4, 4.2, 6.5), (0.0, 0.4, 0.2), fov=38)
LIGHTS: dict[str, pyvocc.RectLight | pyvocc.DiskLight | pyvocc.SunLight] = {
    "rectangle": pyvocc.RectLight((1.6, 4.0, 0.2), (1.6, 0.0, 0.6), (-0.3, 1.0, 0.9)),
    "disk": pyvocc.DiskLight((-3.0, 4.0, 1.5), (0.6, 0.7, 0.0), (0.0, 0.0, 0.9)),
    "sun": pyvocc.SunLight((-1.0, 2.0, -1.2), math.radians(12)),
}


class Penumbra(NamedTuple):
    """The points that see a part of a light, and the share that they see."""

    points: NDArray[np.float32]
    normals: NDArray[np.float32]
    share: Floats


def build() -> pyvocc.Scene:
    scene = pyvocc.Scene()
    for mesh, scale, place in (
        (shapes.generate("torus_knot"), 0.5, (0.0, 0.85, 0.0)),
        (shapes.generate("icosphere"), 0.4, (1.5, 0.4, 1.2)),
        (shapes.generate("bumpy_solid"), 0.45, (-1.6, 0.4, 1.0)),
    ):
        scene.add_mesh(*shapes.transformed(mesh, scale, 0.0, place))
    s = 20.0
    ground = [(-s, 0, -s), (s, 0, -s), (s, 0, s), (-s, 0, s)]
    scene.add_mesh(ground, [(0, 2, 1), (0, 3, 2)], "ground")
    scene.build()
    return scene


def penumbrae(scene: pyvocc.Scene, most: int) -> dict[str, Penumbra]:
    """By light; up to so many points of each, drawn from the image."""
    pixels = tile_order(*SIZE)
    org, dir = CAMERA.rays(SIZE, pixels)
    seen = pyvocc.shading_points(scene, org, dir, offset=1e-4)
    hit = seen.geom_id >= 0
    points, normals = seen.position[hit], seen.normal[hit]
    random = np.random.default_rng(1)
    result = {}
    for name, light in LIGHTS.items():
        counts = scene.light_visibility(points, normals, [light], 256)[0]
        partly = np.flatnonzero((counts > 0) & (counts < 256))
        partly = np.sort(random.permutation(partly)[:most])
        some, up = points[partly], normals[partly]
        # Ids of its own: the samples must not be those that are measured.
        ids = np.arange(len(partly)) + 2**20
        share = scene.light_visibility(some, up, [light], REFERENCE, ids)[0] / REFERENCE
        result[name] = Penumbra(some, up, share)
    return result


def at_random(light: Any, points: Floats, count: int, random: np.random.Generator) -> Floats:
    """Directions to independent samples: (points, count, 3)."""
    a, b = random.random((2, len(points), count, 1))
    if isinstance(light, pyvocc.RectLight):
        p, u, v = (np.array(x) for x in (light.corner, light.edge_u, light.edge_v))
        return np.asarray(p + a * u + b * v - points[:, None])
    turn = 2 * np.pi * b
    if isinstance(light, pyvocc.DiskLight):
        p, u, v = (np.array(x) for x in (light.center, light.axis_u, light.axis_v))
        side = np.cos(turn) * u + np.sin(turn) * v
        return np.asarray(p + np.sqrt(a) * side - points[:, None])
    w = np.array(light.direction) / np.linalg.norm(light.direction)
    u = np.cross(w, (1.0, 0.0, 0.0))
    u /= np.linalg.norm(u)
    cosine = 1 - a * (1 - math.cos(light.angle / 2))
    side = np.cos(turn) * u + np.sin(turn) * np.cross(w, u)
    return np.asarray(cosine * w + np.sqrt(1 - cosine**2) * side)


def estimate(
    scene: pyvocc.Scene, light: Any, at: Penumbra, sampler: str, count: int, run: int
) -> Floats:
    """The visible share at each point by so many samples."""
    if sampler != "random":
        ids = np.arange(len(at.points)) + run * len(at.points)
        counts = scene.light_visibility(
            at.points, at.normals, [light], count, ids, sampler=sampler
        )[0]
        return np.where(counts == pyvocc.NOT_TRACED, 0, counts / count)
    dir = at_random(light, at.points.astype(float), count, np.random.default_rng([run, count]))
    above = np.einsum("nk,nsk->ns", at.normals, dir) > 0
    tmax = np.inf if isinstance(light, pyvocc.SunLight) else 1.0
    blocked = scene.occluded(at.points[:, None], dir.astype(np.float32), 0.0, tmax)
    return np.asarray((above & ~blocked).mean(axis=1))


def measure(points: int, runs: int) -> dict[str, dict[str, list[float]]]:
    """Errors by light and sampler, one for each of COUNTS."""
    result: dict[str, dict[str, list[float]]] = {}
    with build() as scene:
        for name, at in penumbrae(scene, points).items():
            print(f"{name}: {len(at.points)} points", file=sys.stderr, flush=True)
            result[name] = {
                sampler: [
                    math.sqrt(
                        np.mean(
                            [
                                np.square(
                                    estimate(scene, LIGHTS[name], at, sampler, count, run)
                                    - at.share
                                )
                                for run in range(runs)
                            ]
                        )
                    )
                    for count in COUNTS
                ]
                for sampler in SAMPLERS
            }
    return result


def lines(errors: dict[str, dict[str, list[float]]]) -> list[list[str]]:
    """Of the table: samples, then for each light the samplers' errors in percent."""
    return [
        [str(count), *(f"{100 * errors[n][s][k]:.2f}" for n in errors for s in SAMPLERS)]
        for k, count in enumerate(COUNTS)
    ]


def draw(errors: dict[str, dict[str, list[float]]], path: Path) -> None:
    """A panel for each light."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    from pyvocc.reproduce import charts

    looks = {
        "random": (charts.GREY, "o"),
        "jitter": (charts.ORANGE, "s"),
        "sobol": (charts.BLUE, "D"),
    }
    style = {**charts.STYLE, "axes.grid.axis": "both"}
    with pyplot.rc_context(style):
        figure, panels = pyplot.subplots(1, len(errors), figsize=(10.5, 3.7), sharey=True)
        for axes, (name, by_sampler) in zip(panels, errors.items(), strict=True):
            for sampler, values in by_sampler.items():
                colour, marker = looks[sampler]
                axes.loglog(COUNTS, values, color=colour, marker=marker, ms=4.5, label=sampler)
            axes.set_title(name)
            axes.set_xlabel("samples of the light at a point")
            axes.set_xticks(COUNTS[::2], [str(count) for count in COUNTS[::2]])
            axes.set_xticks([], minor=True)
            axes.set_ylim(0.0013, 0.6)
            ticks = (0.003, 0.01, 0.03, 0.1, 0.3)
            axes.set_yticks(ticks, [f"{100 * tick:g} %" for tick in ticks])
            axes.set_yticks([], minor=True)
        panels[0].set_ylabel("error of the visible share (RMS)")
        panels[0].legend(loc="lower left")
        figure.tight_layout()
        figure.savefig(path, dpi=110, metadata={"Software": None})
        pyplot.close(figure)


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="python -m bench.sampling", description=__doc__)
    parser.add_argument("--points", type=int, default=2000, metavar="N", help="a light (2000)")
    parser.add_argument("--runs", type=int, default=4, metavar="N", help="with other ids (4)")
    parser.add_argument(
        "-o", "--output", type=Path, default=OUTPUT, metavar="FILE.png", help=f"({OUTPUT})"
    )
    args = parser.parse_args(arguments)
    errors = measure(args.points, args.runs)
    head = ["samples", *(f"{name}, {sampler}" for name in errors for sampler in SAMPLERS)]
    print("Root mean square error of the visible share, in percent of the light:\n")
    print(table(head, lines(errors), 0))
    try:
        draw(errors, args.output)
    except ImportError:
        print("bench: the plot needs matplotlib", file=sys.stderr)
        return 2
    print(f"\n{args.output}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
