"""Builds run_vocc and run_embree, and keeps them running to be asked for one run at a time.

A program holds its scene, so that runs of all modes and of both programs can alternate
(A B C A B C): what slows the machine for a while then slows all of them.
"""

from __future__ import annotations

import json
import os
import subprocess
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from types import TracebackType
from typing import Any, Self, TypeAlias

ROOT = Path(__file__).resolve().parent.parent
BUILD = ROOT / "build" / "bench"

Line: TypeAlias = dict[str, Any]


class BenchError(Exception):
    """Something is missing or went wrong; the text says what."""


def build() -> bool:
    """Compiles the programs; says whether run_embree is one of them."""
    try:
        made = subprocess.run(
            ["make", "-s", f"-j{len(processors()) or 1}", "-f", "bench/build.mk"],
            cwd=ROOT,
            capture_output=True,
            text=True,
        )
    except FileNotFoundError:
        raise BenchError("make is not installed") from None
    if made.returncode != 0:
        raise BenchError(f"the programs cannot be built:\n{made.stdout}{made.stderr}")
    return has_embree()


def has_embree() -> bool:
    """Whether run_embree is among what can be compiled here."""
    try:
        listed = subprocess.run(
            ["make", "-s", "-f", "bench/build.mk", "list"], cwd=ROOT, capture_output=True, text=True
        )
    except FileNotFoundError:
        raise BenchError("make is not installed") from None
    return "run_embree" in listed.stdout


def processors() -> list[int]:
    """Those this process may use; empty where the system cannot tell."""
    return sorted(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else []


@contextmanager
def pinned(cpus: Sequence[int]) -> Iterator[None]:
    """This process, and what it starts meanwhile, runs on these processors only."""
    if not cpus or not hasattr(os, "sched_setaffinity"):
        yield
        return
    before = os.sched_getaffinity(0)
    os.sched_setaffinity(0, cpus)
    try:
        yield
    finally:
        os.sched_setaffinity(0, before)


def run(program: str, *arguments: str | Path, cpus: Sequence[int] = ()) -> list[Line]:
    """Runs a program to its end; its lines."""
    command = [str(BUILD / f"run_{program}"), *map(str, arguments)]
    with pinned(cpus):
        done = subprocess.run(command, capture_output=True, text=True)
    if done.returncode != 0:
        raise BenchError(f"run_{program}: {done.stderr.strip() or done.returncode}")
    return [json.loads(line) for line in done.stdout.splitlines()]


class Program:
    """A running program: `with Program("vocc", mesh, ...) as vocc: vocc.time("qdbfs")`."""

    def __init__(self, name: str, *arguments: str | Path, cpus: Sequence[int] = ()) -> None:
        self.name = name
        with pinned(cpus):
            self._process = subprocess.Popen(
                [str(BUILD / f"run_{name}"), *map(str, arguments), "-"],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.PIPE,
                text=True,
            )

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        if error is not None:
            self._process.kill()
        self._process.communicate()

    def time(self, mode: str, counters: bool = False) -> Line:
        """One run; a line with "error" for a mode that the program does not have."""
        process = self._process
        assert process.stdin is not None and process.stdout is not None
        try:
            process.stdin.write(f"{'+' if counters else ''}{mode}\n")
            process.stdin.flush()
            answer = process.stdout.readline()
        except BrokenPipeError:
            answer = ""
        if not answer:
            message = process.communicate()[1].strip()
            raise BenchError(f"run_{self.name}: {mode}: {message or process.returncode}")
        line: Line = json.loads(answer)
        return line
