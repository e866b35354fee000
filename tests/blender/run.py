"""Runs the tests of the add-on in each of the given Blenders; the last lines sum up.

`python -m tests.blender.run 4.5 5.2 -- -k camera`. Each environment gets pyvocc from the built
extension. A Blender that cannot be had here is skipped with its reason; nothing runs for ever.
"""

from __future__ import annotations

import argparse
import hashlib
import os
import signal
import subprocess
import sys
import tempfile
import zipfile
from pathlib import Path

from tools.blender_env import PYTHONS, ROOT, UnavailableError, environment
from tools.build_addon import BuildError, build

HERE = Path(__file__).resolve().parent


def install_pyvocc(python: Path, extension: Path) -> None:
    """The wheel in the extension, unless it is there already."""
    with zipfile.ZipFile(extension) as packed, tempfile.TemporaryDirectory() as folder:
        (name,) = [n for n in packed.namelist() if n.startswith("wheels/pyvocc-")]
        wheel = Path(packed.extract(name, folder))
        digest = hashlib.sha256(wheel.read_bytes()).hexdigest()
        installed = python.parents[1] / "pyvocc.sha256"
        if installed.exists() and installed.read_text() == digest:
            return
        pip = (python, "-m", "pip", "--disable-pip-version-check", "install", "--quiet")
        subprocess.run([*pip, "--no-deps", "--force-reinstall", wheel], check=True)
        installed.write_text(digest)


def run(
    blender: str, python: Path, extension: Path, timeout: float, arguments: list[str]
) -> tuple[int, str]:
    """The exit code of pytest, or of what ended it, and the lines that sum up."""
    with tempfile.TemporaryDirectory() as folder:
        summary = Path(folder) / "summary"
        options = ("-c", HERE / "pytest.ini", f"--rootdir={ROOT}", HERE)
        process = subprocess.Popen(
            [python, "-P", HERE / "inside.py", summary, *options, *arguments],
            cwd=ROOT,
            # The folder for temporary files goes with the tests, however they end.
            env={
                **os.environ,
                "PYTHONNOUSERSITE": "1",
                "TMPDIR": folder,
                "VOCC_ADDON": str(extension),
            },
            start_new_session=True,
        )
        problem = None
        try:
            code = process.wait(timeout)
            if code < 0:
                problem = f"ended by {signal.Signals(-code).name}"
        except subprocess.TimeoutExpired:
            code = 1
            problem = f"stopped after {timeout:.0f} s"
        finally:
            _end(process)
        text = summary.read_text(encoding="utf-8").rstrip() if summary.exists() else ""
    if problem is None and not text:
        problem = f"pytest ended with {code}"
    return code, "\n".join(filter(None, [text, problem and f"Blender {blender}: {problem}"]))


def _end(process: subprocess.Popen[bytes]) -> None:
    """Whatever the tests started ends with them."""
    try:
        os.killpg(process.pid, signal.SIGKILL)
    except ProcessLookupError:
        return
    process.wait()


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.blender.run", description=__doc__)
    parser.add_argument("versions", nargs="+", choices=PYTHONS, metavar="VERSION")
    parser.add_argument("--timeout", type=float, default=1800, metavar="S", help="for each (1800)")
    before, after = _split(sys.argv[1:])
    args = parser.parse_args(before)
    pythons = {}
    summary = []
    for blender in args.versions:
        try:
            pythons[blender] = environment(blender)
        except UnavailableError as error:
            summary.append(f"Blender {blender}: skipped: {error}")
    if not pythons:
        print("\n".join(summary))
        return 0
    try:
        extension = build()
    except BuildError as error:
        print(f"build_addon: {error}", file=sys.stderr)
        return 1
    failed = False
    for blender, python in pythons.items():
        print(f"== Blender {blender}", flush=True)
        install_pyvocc(python, extension)
        code, text = run(blender, python, extension, args.timeout, after)
        failed = failed or code != 0
        summary.append(text)
    print("\n".join(["", *summary]))
    return int(failed)


def _split(arguments: list[str]) -> tuple[list[str], list[str]]:
    """What stands before and after `--`; argparse would mix the two."""
    at = arguments.index("--") if "--" in arguments else len(arguments)
    return arguments[:at], arguments[at + 1 :]


if __name__ == "__main__":
    sys.exit(main())
