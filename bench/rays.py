"""`python -m bench.rays` measures arrays of segments, traced without knowledge of lights.

The segments are those of a scene's pass: in order (tile, pixel, light, sample), shuffled, only
the blocked and only the visible ones, shuffled; and as many between random points in the mesh's
bounds. One file of them is read by both programs. Embree's rtcOccluded1 is measured on a robust
scene; its best is the fastest of its fast modes. With --python, the same files through
`scene.occluded` and through embreex and mitsuba, where these are installed.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
import time
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import asdict, dataclass
from itertools import product
from pathlib import Path
from statistics import median
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from . import measure, options, programs
from .inputs import Input, inputs
from .libraries import available
from .measure import ROBUST, Settings
from .options import say
from .programs import BenchError, Line, Program
from .report import table
from .workload import load_scene

FAST = ("fast-1", "fast-s16", "fast-stream")
EMBREE = (ROBUST, *FAST)

Results: TypeAlias = dict[str, Any]


@dataclass(frozen=True)
class Case:
    name: str
    kind: str  # all, blocked or visible
    order: str  # tile, shuffle or random


CASES = (
    Case("in order", "all", "tile"),
    Case("shuffled", "all", "shuffle"),
    Case("blocked", "blocked", "shuffle"),
    Case("visible", "visible", "shuffle"),
    Case("random", "all", "random"),
)


def make_rays(item: Input, settings: Settings, case: Case, tiles: int, path: Path) -> None:
    limit = ("--tile-limit", str(tiles)) if tiles else ()
    kind = ("--rays", case.kind, "--order", case.order)
    # Embree where it is, as the camera rays of reference images are its.
    program = "embree" if settings.embree else "vocc"
    programs.run(program, *settings.arguments(item), *limit, *kind, "--dump-rays", path)


def in_c(item: Input, settings: Settings, rays: Path, folder: Path) -> dict[str, Any]:
    """{"ours": {mode: [line, ...]}, "embree": ..., "differ": {mode: rays unlike Embree robust}}."""
    found: dict[str, Any] = {"ours": {}, "embree": {}, "differ": {}}
    reference: NDArray[np.uint8] | None = None
    with ExitStack() as stack:
        runs: list[tuple[str, Program, str]] = []
        # Embree first: its robust mode is the reference.
        sides = [("embree", "embree", settings.embree)] if settings.embree else []
        for side, program, modes in [*sides, ("ours", "vocc", settings.modes)]:
            load = ("--rays", "all", "--load-rays", rays, "--counts", folder / side)
            arguments = (*settings.arguments(item), *load)
            running = stack.enter_context(Program(program, *arguments, cpus=settings.pinned))
            runs += [(side, running, mode) for mode in modes]
        for number in range(settings.rounds):
            for side, running, mode in runs:
                line = running.time(mode)
                if "error" in line:
                    if number == 0:
                        say(f"{item.name}: {mode}: {line['error']}: left out")
                    continue
                found[side].setdefault(mode, []).append(line)
                if number == 0:
                    blocked = np.fromfile(folder / side, np.uint8)
                    if mode == ROBUST:
                        reference = blocked
                    if reference is not None:
                        found["differ"][mode] = int((blocked != reference).sum())
    return found


def in_python(item: Input, settings: Settings, rays: dict[str, Path]) -> Results:
    """{library: {case: {"seconds": [...], "blocked": n}}}, alternating."""
    placed = load_scene(item.path, settings.scene)
    found: Results = {}
    with programs.pinned(settings.pinned):
        loaded = [(x.name, x.load(*placed.mesh.with_ground())) for x in available(say)]
        for case, path in rays.items():
            rows = np.fromfile(path, "<f4").reshape(-1, 6)
            org, dir = np.ascontiguousarray(rows[:, :3]), np.ascontiguousarray(rows[:, 3:])
            calls = [(name, *prepare(org, dir)) for name, prepare in loaded]
            for number in range(settings.rounds + 1):
                for name, trace, result in calls:
                    start = time.process_time()
                    value = trace()
                    seconds = time.process_time() - start
                    told = found.setdefault(name, {}).setdefault(case, {"seconds": []})
                    if number:  # the first call compiles
                        told["seconds"].append(seconds)
                    else:
                        told["blocked"] = int(result(value).sum())
                        told["rays"] = len(org)
    return found


def measure_mesh(item: Input, settings: Settings, args: argparse.Namespace) -> Results:
    found: Results = {"cases": {}}
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        files = {case.name: folder / f"{case.kind}-{case.order}" for case in CASES}
        for case in CASES:
            make_rays(item, settings, case, args.tiles, files[case.name])
            found["cases"][case.name] = in_c(item, settings, files[case.name], folder)
            say(f"{item.name}: {case.name}")
        if args.python:
            found["python"] = in_python(item, settings, files)
            say(f"{item.name}: Python")
    return found


# ---- tables --------------------------------------------------------------------------


def speed(lines: Sequence[Line] | None) -> float | None:
    return median(line["mrays_s"] for line in lines) if lines else None


def cell(value: float | None, base: float | None = None) -> str:
    if value is None or base == 0:
        return "-"
    return f"{value:.2f}" if base is None else f"{value / base:.2f}x"


def c_table(meshes: dict[str, Results]) -> str:
    rows = []
    for name, mesh in meshes.items():
        for case, found in mesh["cases"].items():
            embree = found["embree"]
            robust = speed(embree.get(ROBUST))
            fast = [(value, mode) for mode in FAST if (value := speed(embree.get(mode)))]
            top, mode_of_top = max(fast) if fast else (None, "-")
            for mode, lines in found["ours"].items():
                line, ours = lines[0], speed(lines)
                rows.append(
                    [
                        name,
                        case,
                        mode,
                        f"{line['rays'] / 1e6:.2f}",
                        f"{100 * line['blocked'] / max(line['rays'], 1):.1f} %",
                        cell(ours),
                        cell(robust),
                        cell(ours, robust or 0),
                        mode_of_top,
                        cell(top),
                        cell(ours, top or 0),
                        str(found["differ"].get(mode, "-")),
                    ]
                )
    head = ["mesh", "segments", "mode", "Mrays", "blocked", "Mray/s", "Embree robust 1", "ratio"]
    return table([*head, "Embree's best", "Mray/s", "ratio", "rays differ"], rows, 3)


def python_table(meshes: dict[str, Results]) -> str:
    rows = []
    for name, mesh in meshes.items():
        libraries = mesh.get("python", {})
        ours = libraries.get("pyvocc", {})
        for case, of_ours in ours.items():
            base = of_ours["rays"] / median(of_ours["seconds"]) / 1e6
            for library, cases in libraries.items():
                told = cases[case]
                rate = told["rays"] / median(told["seconds"]) / 1e6
                more = told["blocked"] - of_ours["blocked"]
                rows.append([name, case, library, cell(rate), cell(base, rate), f"{more:+d}"])
    head = ["mesh", "segments", "library", "Mray/s", "pyvocc / library", "blocked more than pyvocc"]
    return table(head, rows, 3)


def text(results: Results) -> str:
    settings = results["settings"]
    size, cpus = settings["size"], settings["cpus"]
    parts = [
        f"{results['machine']['processor']}, {f'processor {cpus[0]}' if cpus else 'not pinned'}; "
        f"segments of the scene {settings['scene']}, {size} x {size} pixels, "
        f"{settings['samples']} samples a light; one thread, its CPU time, medians of "
        f"{settings['rounds']} alternating rounds. Rays differ from Embree's robust scene, which "
        "is not exact.",
        c_table(results["meshes"]),
    ]
    if any("python" in mesh for mesh in results["meshes"].values()):
        parts += ["From Python, arrays in and out:", python_table(results["meshes"])]
    return "\n\n".join(parts) + "\n"


def parser() -> argparse.ArgumentParser:
    main = argparse.ArgumentParser(
        prog="python -m bench.rays",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    options.add_common(main)
    main.add_argument("--tiles", type=int, default=0, metavar="N", help="only so many (all)")
    main.add_argument(
        "--modes", type=options.modes, default=("auto",), metavar="'A B'", help="(auto)"
    )
    main.add_argument("--python", action="store_true", help="also Python libraries")
    return main


def run(args: argparse.Namespace, embree: bool) -> int:
    results: Results = {"machine": measure.machine(), "runs": []}
    texts = []
    failed = 0
    for scene, samples in product(args.scene, args.samples):
        settings = Settings(
            scene=scene,
            size=args.size,
            samples=samples,
            rounds=max(args.rounds, 1),
            modes=args.modes,
            embree=EMBREE if embree else (),
            cpus=options.cpus_of(args),
        )
        meshes: dict[str, Results] = {}
        results["runs"].append({"settings": asdict(settings), "meshes": meshes})
        for item in inputs(args.meshes, args.only):
            try:
                meshes[item.name] = measure_mesh(item, settings, args)
            except BenchError as error:
                say(f"{item.name}: {error}: left out")
                failed = 1
        texts.append(text({"machine": results["machine"], **results["runs"][-1]}))
        print(texts[-1], flush=True)
    if args.output:
        args.output.parent.mkdir(parents=True, exist_ok=True)
        args.output.write_text(json.dumps(results, indent=1) + "\n", encoding="utf-8")
        args.output.with_suffix(".md").write_text("\n".join(texts), encoding="utf-8")
    return failed


def main(arguments: Sequence[str] | None = None) -> int:
    return options.guarded(parser().parse_args(arguments), run)


if __name__ == "__main__":
    sys.exit(main())
