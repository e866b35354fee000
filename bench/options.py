"""The options that the commands share, and what they say before they measure."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from pathlib import Path

from . import programs
from .inputs import SHARED
from .programs import BenchError
from .workload import MAX_SAMPLES, SCENES

NO_EMBREE = (
    "Embree 3 is not installed (Debian: libembree-dev 3.13): its columns stay empty, all else runs"
)


def say(text: str) -> None:
    print(text, file=sys.stderr, flush=True)


def names(text: str) -> tuple[str, ...]:
    return tuple(part for part in text.split(",") if part)


def modes(text: str) -> tuple[str, ...]:
    """Modes are separated by spaces: their settings have commas."""
    return tuple(text.split())


def _scenes(text: str) -> tuple[str, ...]:
    found = names(text)
    for name in found:
        if name not in SCENES:
            raise argparse.ArgumentTypeError(f"{name!r} is none of {', '.join(SCENES)}")
    return found


def _samples(text: str) -> tuple[int, ...]:
    counts = tuple(int(part) for part in names(text))
    if not all(1 <= count <= MAX_SAMPLES for count in counts):
        raise argparse.ArgumentTypeError(f"1 to {MAX_SAMPLES} samples, not {text}")
    return counts


def add_common(parser: argparse.ArgumentParser) -> None:
    where = "with PLY meshes; default: the shared models, without them generated meshes"
    scenes = f"{', '.join(SCENES)} (workload); docs/benchmark.md"
    most = f"a light, up to {MAX_SAMPLES} (16)"
    add = parser.add_argument
    add("--meshes", type=Path, metavar="DIR", help=where)
    add("--only", type=names, default=(), metavar="A,B", help="these meshes")
    add("--scene", type=_scenes, default=("workload",), metavar="A,B", help=scenes)
    add("--size", type=int, default=256, metavar="N", help="pixels, squared (256)")
    add("--samples", type=_samples, default=(16,), metavar="M,N", help=most)
    add("--rounds", type=int, default=3, metavar="N", help="of all modes (3)")
    add("--no-embree", action="store_true", help="measure only ours")
    add("--cpu", type=int, metavar="N", help="to run on (the last)")
    add("-o", "--output", type=Path, metavar="FILE.json", help="and FILE.md")


def cpus_of(args: argparse.Namespace) -> tuple[int, ...]:
    """The processors to run on, the one for single threads first."""
    cpus = programs.processors()
    if args.cpu is not None:
        if cpus and args.cpu not in cpus:
            raise BenchError(f"--cpu: {args.cpu} is not one of {cpus}")
        cpus = [args.cpu, *(cpu for cpu in cpus if cpu != args.cpu)] if cpus else []
    else:
        cpus = cpus[::-1]  # the first one serves most interrupts
    return tuple(cpus)


def guarded(args: argparse.Namespace, command: Callable[[argparse.Namespace, bool], int]) -> int:
    """Builds the programs, then command(args, whether Embree is measured); the exit code."""
    try:
        embree = programs.build() and not args.no_embree
        if not embree and not args.no_embree:
            say(NO_EMBREE)
        if args.meshes is None and not (SHARED / "meshes").is_dir():
            say("The models are not here: generated meshes stand in for them")
        return command(args, embree)
    except BenchError as error:
        print(f"bench: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        return 130
