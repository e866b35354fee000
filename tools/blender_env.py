"""Python environments with Blender as a module: `.venv-blender-4.5` and so on.

`python -m tools.blender_env 4.5 5.2` makes them. What is in them is pinned by
`tools/requirements/blender-*.txt`; a copy of that file in the environment says that it is complete.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
REQUIREMENTS = Path(__file__).resolve().parent / "requirements"

# The one Python that each Blender is built for.
PYTHONS = {"4.2": "3.11", "4.5": "3.11", "5.0": "3.11", "5.2": "3.13"}

LIBRARIES = (
    "libx11-6 libxrender1 libxfixes3 libxi6 libxxf86vm1 libxkbcommon0 libsm6 libice6 libgl1 "
    "libgomp1 libstdc++6"
)


class UnavailableError(Exception):
    """This Blender cannot be had on this machine; the text says why."""


def environment(blender: str) -> Path:
    """The Python of the environment, which is made or brought up to date if need be."""
    folder = ROOT / f".venv-blender-{blender}"
    python = folder / "bin" / "python"
    wanted = (REQUIREMENTS / f"blender-{blender}.txt").read_text(encoding="utf-8")
    complete = folder / "requirements.txt"
    if python.exists() and complete.exists() and complete.read_text(encoding="utf-8") == wanted:
        return python
    if not python.exists():
        _run(_interpreter(PYTHONS[blender]), "-m", "venv", folder)
    complete.unlink(missing_ok=True)
    requirements = REQUIREMENTS / f"blender-{blender}.txt"
    pip = (python, "-m", "pip", "--disable-pip-version-check")
    _run(*pip, "install", "--quiet", "--only-binary=:all:", "-r", requirements)
    try:
        _run(python, "-c", "import bpy")
    except UnavailableError as error:
        raise UnavailableError(f"{error} (Debian: apt install {LIBRARIES})") from None
    complete.write_text(wanted, encoding="utf-8")
    return python


def _interpreter(version: str) -> Path | str:
    for candidate in _candidates(version):
        question = "import sys, venv, ensurepip; print('%d.%d' % sys.version_info[:2])"
        try:
            answer = subprocess.run(
                [candidate, "-c", question], capture_output=True, text=True, check=False
            )
        except OSError:
            continue
        if answer.stdout.strip() == version:
            return candidate
    raise UnavailableError(f"there is no Python {version} with venv")


def _candidates(version: str) -> Iterator[Path | str]:
    yield f"python{version}"
    # A shim of pyenv answers only for the versions that are switched on.
    pyenv = Path(os.environ.get("PYENV_ROOT", Path.home() / ".pyenv"))
    yield from sorted(pyenv.glob(f"versions/{version}.*/bin/python"), reverse=True)


def _run(*command: Path | str) -> None:
    result = subprocess.run(command, capture_output=True, text=True, check=False)
    if result.returncode:
        lines = (result.stderr + result.stdout).strip().splitlines()
        errors = [line for line in lines if line.startswith("ERROR")] or lines[-1:]
        reason = errors[-1].removeprefix("ERROR: ") if errors else f"exit {result.returncode}"
        raise UnavailableError(f"{Path(command[0]).name}: {reason}")


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m tools.blender_env", description=__doc__)
    parser.add_argument("versions", nargs="+", choices=PYTHONS, metavar="VERSION")
    failed = False
    for blender in parser.parse_args().versions:
        try:
            print(f"Blender {blender}: {environment(blender)}")
        except UnavailableError as error:
            failed = True
            print(f"Blender {blender}: {error}", file=sys.stderr)
    return int(failed)


if __name__ == "__main__":
    sys.exit(main())
