"""The whole run: what is missing is measured, then the page is written."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from .._files import FileError, os_reason, replacing
from . import cells, claims, report
from .embree import Embree, Unavailable
from .measure import Measured, machine, pinned
from .page import Gallery, Picture, Section, html, markdown
from .settings import Settings
from .subjects import subjects

CELLS = "cells.jsonl"
PAGE = "results"
IMAGES = "images"


class Interrupted(KeyboardInterrupt):
    """Ctrl-C; the message says what is kept."""


def check(output: Path, settings: Settings) -> None:
    """Raises what can be told before any work is done.

    Raises:
        ImportError: an extra is not installed.
        FileError: the output is no folder that can be written; a mesh is not there.
        Error: there is no such scene.
    """
    for package, extra in (("matplotlib", "plot"), ("PIL", "plot"), ("tqdm", "progress")):
        try:
            __import__(package)
        except ImportError:
            raise ImportError(
                f"pyvocc reproduce needs {package}: pip install 'pyvocc[{extra}]'", name=package
            ) from None
    subjects(settings.meshes, settings.only)
    try:
        (output / IMAGES).mkdir(parents=True, exist_ok=True)
    except (FileExistsError, NotADirectoryError):
        raise FileError(output, "is not a folder") from None
    except OSError as error:
        raise FileError(output, os_reason(error)) from None
    if not os.access(output, os.W_OK | os.X_OK):
        raise FileError(output, "permission denied")


def reproduce(output: Path, settings: Settings, embree: bool = True) -> list[str]:
    """Measures what is missing and writes results.html and results.md.

    Args:
        output: a folder; what has been measured is kept in it.
        settings: what is asked for.
        embree: measure Embree too, where it is there.

    Returns:
        Where images differ; empty, if all is well.

    Raises:
        As `check`, and Interrupted.
    """
    check(output, settings)
    store = cells.Store(output / CELLS)
    program, absent = _embree(settings) if embree else (None, "it was not asked for")
    here = machine()
    library = cells.library()
    with pinned() as processor:
        scenes = [
            Measured(subject, settings, store, library, here, program)
            for subject in subjects(settings.meshes, settings.only)
        ]
        _measure(scenes, store)
    context = report.Context(
        settings=settings,
        machine=here,
        processor=processor,
        compiler=cells.compiler(),
        commit=_commit(),
        date=datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC"),
        embree=absent,
    )
    _write(output, report.sections(scenes, context))
    return claims.different(scenes)


def _embree(settings: Settings) -> tuple[Embree | None, str]:
    try:
        return Embree(settings.samples), ""
    except Unavailable as error:
        return None, str(error)


def _measure(scenes: Sequence[Measured], store: cells.Store) -> None:
    from tqdm import tqdm

    plans = [(scene, scene.plan()) for scene in scenes]
    total = sum(len(plan) for _, plan in plans)
    kept = sum(cell.key in store for _, plan in plans for cell in plan)
    if kept:
        print(f"{kept} of {total} measurements are kept from an earlier run; going on", flush=True)
    shown: bool = sys.stderr.isatty()
    done = kept
    bar: Any = tqdm(total=total, initial=kept, unit="", disable=not shown, file=sys.stderr)
    with bar:
        try:
            for scene, plan in plans:
                missing = [cell for cell in plan if cell.key not in store]
                for cell in missing:
                    bar.set_description(f"{scene.subject.name}: {cell.label}")
                    store.put(cell.key, cell.make())
                    done += 1
                    bar.update()
                scene.close()
                if not shown:
                    print(f"{scene.subject.name}: {done} of {total} measurements", flush=True)
        except KeyboardInterrupt:
            text = f"interrupted: {done} of {total} measurements are kept; the same command goes on"
            raise Interrupted(text) from None
        finally:
            for scene in scenes:
                scene.close()


def _write(output: Path, sections: Sequence[Section]) -> None:
    files = {}
    for section in sections:
        for block in section.blocks:
            for picture in block.pictures if isinstance(block, Gallery) else (block,):
                if isinstance(picture, Picture):
                    files[picture.name] = picture.data
    for name, data in files.items():
        with replacing(output / IMAGES / name) as path:
            path.write_bytes(data)
    texts = {
        f"{PAGE}.html": html(report.TITLE, sections),
        f"{PAGE}.md": markdown(report.TITLE, sections, IMAGES),
    }
    for name, text in texts.items():
        with replacing(output / name) as path:
            path.write_text(text, encoding="utf-8")


def _commit() -> str:
    """The commit of the checkout that this is run from."""
    root = Path(__file__).resolve().parents[2]
    if not (root / ".git").exists():
        return "not from a git checkout"
    try:
        lines = [
            subprocess.run(
                ["git", "--no-optional-locks", *command],
                cwd=root,
                capture_output=True,
                text=True,
                check=True,
            ).stdout.strip()
            for command in (["rev-parse", "--short=12", "HEAD"], ["status", "--porcelain", "-uno"])
        ]
    except (OSError, subprocess.CalledProcessError):
        return "commit unknown"
    return f"commit {lines[0]}" + (", with changes" if lines[1] else "")
