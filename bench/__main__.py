"""`python -m bench` measures, `python -m bench verify` settles differences to Embree."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from . import measure, programs, report
from .compare import verify
from .inputs import SHARED, inputs
from .overhead import overhead
from .programs import BenchError

NO_EMBREE = (
    "Embree 3 is not installed (Debian: libembree-dev 3.13): its columns stay empty, all else runs"
)


def _list(text: str) -> tuple[str, ...]:
    return tuple(part for part in text.split(",") if part)


def _modes(text: str) -> tuple[str, ...]:
    """Modes are separated by spaces: their settings have commas."""
    return tuple(text.split())


def parser() -> argparse.ArgumentParser:
    main = argparse.ArgumentParser(prog="python -m bench", description=__doc__)
    main.add_argument("command", nargs="?", choices=["run", "verify"], default="run")
    where = "with PLY meshes; default: the shared models, without them generated meshes"
    main.add_argument("--meshes", type=Path, metavar="DIR", help=where)
    main.add_argument("--only", type=_list, default=(), metavar="A,B", help="these meshes")
    main.add_argument("--size", type=int, default=256, metavar="N", help="pixels, squared (256)")
    main.add_argument("--samples", type=int, default=16, metavar="N", help="a light (16)")
    main.add_argument("--full", action="store_true", help="1024 x 1024 pixels, 20 samples")
    main.add_argument("--rounds", type=int, default=3, metavar="N", help="of all modes (3)")
    main.add_argument(
        "--modes",
        type=_modes,
        default=measure.OURS,
        metavar="'A B'",
        help=f"of ours ({' '.join(measure.OURS)}); settings as in 'qdbfs:cache=4,deferment=16'",
    )
    main.add_argument("--no-embree", action="store_true", help="measure only ours")
    main.add_argument("--cpu", type=int, metavar="N", help="to run on (the last)")
    main.add_argument("--threads", type=int, metavar="N", help="also one thread against N")
    main.add_argument("--build", action="store_true", help="also builds, one and two threads")
    main.add_argument("--python", action="store_true", help="also what Python adds to C's time")
    main.add_argument(
        "--outcomes",
        type=int,
        metavar="TILES",
        help="also arrays of all, blocked and visible rays, of so many tiles",
    )
    main.add_argument("-o", "--output", type=Path, metavar="FILE.json", help="and FILE.md")
    return main


def settings_of(args: argparse.Namespace, embree: bool) -> measure.Settings:
    cpus = programs.processors()
    if args.cpu is not None:
        if cpus and args.cpu not in cpus:
            raise BenchError(f"--cpu: {args.cpu} is not one of {cpus}")
        cpus = [args.cpu, *(cpu for cpu in cpus if cpu != args.cpu)] if cpus else []
    else:
        cpus = cpus[::-1]  # the first one serves most interrupts
    return measure.Settings(
        size=1024 if args.full else args.size,
        samples=20 if args.full else args.samples,
        rounds=max(args.rounds, 1),
        modes=args.modes,
        embree=measure.EMBREE if embree else (),
        cpus=tuple(cpus),
    )


def say(text: str) -> None:
    print(text, file=sys.stderr, flush=True)


def run(args: argparse.Namespace, embree: bool) -> int:
    settings = settings_of(args, embree)
    results: dict[str, Any] = {
        "machine": measure.machine(),
        "settings": asdict(settings),
        "meshes": {},
    }
    for item in inputs(args.meshes, args.only):
        mesh = measure.passes(item, settings, say)
        if args.build:
            mesh["builds"] = measure.builds(item, settings, say)
        if args.threads:
            mesh["scaling"] = measure.scaling(item, settings, args.threads, say)
        if args.outcomes:
            mesh["by_outcome"] = measure.by_outcome(item, settings, args.outcomes, say)
        if args.python:
            mesh["python"] = overhead(item, settings, say)
        results["meshes"][item.name] = mesh
        if args.output:
            args.output.parent.mkdir(parents=True, exist_ok=True)
            args.output.write_text(json.dumps(results, indent=1) + "\n", encoding="utf-8")
    text = report.markdown(results)
    print(text)
    if args.output:
        args.output.with_suffix(".md").write_text(text, encoding="utf-8")
    if not report.identical(results):
        say("Our modes do not give the same image: that is a bug.")
        return 1
    return 0


def run_verify(args: argparse.Namespace, embree: bool) -> int:
    settings = settings_of(args, embree)
    wrong = 0
    rows = []
    for item in inputs(args.meshes, args.only):
        for mode, verdict in verify(item, settings.size, settings.samples, embree, args.modes):
            wrong += verdict.ours_wrong
            for difference in verdict.differences:
                print(f"{item.name}: {mode}: {difference}")
                for ray, blocked in zip(difference.rays, difference.exact, strict=True):
                    text = " ".join(float(x).hex() for x in ray)
                    print(f"    exact: {'blocked' if blocked else 'visible'}: {text}")
            embrees = [d.embree_wrong or 0 for d in verdict.differences]
            rows.append(
                [
                    item.name,
                    mode,
                    f"{verdict.traced}",
                    f"{verdict.mistraced}",
                    f"{len(verdict.differences) + verdict.unsettled}",
                    f"{verdict.ours_wrong}",
                    f"{sum(embrees)}" if embree else "not asked",
                ]
            )
    head = ["mesh", "mode", "pixels x lights", "traced by one", "counts differ"]
    print(report.table([*head, "ours wrong", "Embree wrong"], rows, 2))
    return 1 if wrong else 0


def main(arguments: Sequence[str] | None = None) -> int:
    args = parser().parse_args(arguments)
    try:
        embree = programs.build() and not args.no_embree
        if not embree and not args.no_embree:
            say(NO_EMBREE)
        if args.meshes is None and not (SHARED / "meshes").is_dir():
            say("The models are not here: generated meshes stand in for them")
        return run_verify(args, embree) if args.command == "verify" else run(args, embree)
    except BenchError as error:
        print(f"bench: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        return 130


if __name__ == "__main__":
    sys.exit(main())
