"""`python -m bench` measures, `python -m bench versus` only beside Embree's best, `python -m bench
verify` settles differences to Embree, `python -m bench.rays` measures single calls."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

from . import measure, options, report
from .compare import Verdict, verify
from .inputs import Input, inputs
from .options import say
from .overhead import overhead
from .programs import BenchError


def parser() -> argparse.ArgumentParser:
    main = argparse.ArgumentParser(prog="python -m bench", description=__doc__)
    commands = ["run", "versus", "verify"]
    main.add_argument("command", nargs="?", choices=commands, default="run")
    options.add_common(main)
    main.add_argument("--full", action="store_true", help="1024 x 1024 pixels, 20 samples")
    main.add_argument(
        "--modes",
        type=options.modes,
        metavar="'A B'",
        help=f"of ours ({' '.join(measure.OURS)}; versus: auto); settings as in "
        "'qdbfs:cache=4,deferment=16'",
    )
    main.add_argument("--threads", type=int, metavar="N", help="also one thread against N")
    main.add_argument("--build", action="store_true", help="also builds, one and two threads")
    main.add_argument("--python", action="store_true", help="also what Python adds to C's time")
    main.add_argument(
        "--outcomes",
        type=int,
        metavar="TILES",
        help="also arrays of all, blocked and visible rays, of so many tiles",
    )
    return main


def settings_of(args: argparse.Namespace, embree: bool) -> list[measure.Settings]:
    """One for each scene and number of samples."""
    versus = args.command == "versus"
    compared = measure.EMBREE_BEST if versus else measure.EMBREE
    return [
        measure.Settings(
            scene=scene,
            size=1024 if args.full else args.size,
            samples=samples,
            rounds=max(args.rounds, 1),
            modes=args.modes or (("auto",) if versus else measure.OURS),
            embree=compared if embree else (),
            cpus=options.cpus_of(args),
        )
        for scene in args.scene
        for samples in ((20,) if args.full else args.samples)
    ]


def run(args: argparse.Namespace, embree: bool) -> int:
    results: dict[str, Any] = {"machine": measure.machine(), "runs": []}
    items = inputs(args.meshes, args.only)
    write = report.versus if args.command == "versus" else report.markdown
    texts: list[str] = []
    wrong = 0
    for settings in settings_of(args, embree):
        meshes: dict[str, Any] = {}
        results["runs"].append({"settings": asdict(settings), "meshes": meshes})
        for item in items:
            try:
                meshes[item.name] = measure_mesh(item, settings, args)
            except BenchError as error:  # a mesh too large for a crowd must not end the run
                say(f"{item.name}: {error}: left out")
                wrong += 1
                continue
            if args.output:
                args.output.parent.mkdir(parents=True, exist_ok=True)
                args.output.write_text(json.dumps(results, indent=1) + "\n", encoding="utf-8")
        one = {"machine": results["machine"], **results["runs"][-1]}
        texts.append(write(one))
        print(texts[-1], flush=True)
        if not report.identical(one):
            say("Our modes do not give the same image: that is a bug.")
            wrong += 1
    if args.output:
        args.output.with_suffix(".md").write_text("\n".join(texts), encoding="utf-8")
    return 1 if wrong else 0


def measure_mesh(
    item: Input, settings: measure.Settings, args: argparse.Namespace
) -> dict[str, Any]:
    mesh = measure.passes(item, settings, say)
    if args.build:
        mesh["builds"] = measure.builds(item, settings, say)
    if args.threads:
        mesh["scaling"] = measure.scaling(item, settings, args.threads, say)
    if args.outcomes:
        mesh["by_outcome"] = measure.by_outcome(item, settings, args.outcomes, say)
    if args.python:
        mesh["python"] = overhead(item, settings, say)
    return mesh


def run_verify(args: argparse.Namespace, embree: bool) -> int:
    wrong = 0
    rows = []
    for settings in settings_of(args, embree):
        for item in inputs(args.meshes, args.only):
            found = verify(
                item, settings.scene, settings.size, settings.samples, embree, settings.modes
            )
            for mode, verdict in found:
                wrong += verdict.ours_wrong
                rows.append([settings.scene, f"{settings.samples}", item.name, mode])
                rows[-1] += told(item.name, mode, verdict, embree)
    head = ["scene", "samples", "mesh", "mode", "pixels x lights", "traced by one"]
    print(report.table([*head, "counts differ", "ours wrong", "Embree wrong"], rows, 4))
    return 1 if wrong else 0


def told(mesh: str, mode: str, verdict: Verdict, embree: bool) -> list[str]:
    """Prints the differences; the columns of the table."""
    for difference in verdict.differences:
        print(f"{mesh}: {mode}: {difference}")
        for ray, blocked in zip(difference.rays, difference.exact, strict=True):
            text = " ".join(float(x).hex() for x in ray)
            print(f"    exact: {'blocked' if blocked else 'visible'}: {text}")
    embrees = [d.embree_wrong or 0 for d in verdict.differences]
    return [
        f"{verdict.traced}",
        f"{verdict.mistraced}",
        f"{len(verdict.differences) + verdict.unsettled}",
        f"{verdict.ours_wrong}",
        f"{sum(embrees)}" if embree else "not asked",
    ]


def main(arguments: Sequence[str] | None = None) -> int:
    args = parser().parse_args(arguments)
    return options.guarded(args, run_verify if args.command == "verify" else run)


if __name__ == "__main__":
    sys.exit(main())
