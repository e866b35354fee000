"""The add-on in a window: panels, a progressive render and ESC, in Debian's Blender under Xvfb.

    python -m tests.blender.gui_smoke [ZIP]

Needs blender, Xvfb, xdotool and import (ImageMagick). ZIP is the extension, for the wheels in it;
without it, it is built. Screenshots go to out/blender, to be looked at. That Blender is older than
the oldest one that the add-on is made for: it is there for what no other can show. Debian's package
works without NumPy; where its Python has none, the index gives it, beside the wheels.

Exit codes: 0 as it should be, 1 something is wrong, 77 a program is missing.
"""

from __future__ import annotations

import argparse
import os
import queue
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from tools.build_addon import BuildError, build

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]
OUT = ROOT / "out" / "blender"

PROGRAMS = ("blender", "Xvfb", "xdotool", "import")
WIDTH, HEIGHT = 1280, 900

# In that window: the tab "Shadows" of the sidebar, the render, the render properties.
TAB = (1044, 252)
MIDDLE = (480, 400)
PROPERTIES = (1150, 600)

# For a Blender that has none, and of its time.
NUMPY = "numpy==1.26.4"

# Of the render's 12, when its picture is taken.
TILES = 5


class SmokeError(Exception):
    """What is wrong."""


class Session:
    """A Blender that runs gui_session.py and says what it does, line by line."""

    def __init__(self, display: str, folder: Path) -> None:
        self._environment = {
            **os.environ,
            "DISPLAY": display,
            "LIBGL_ALWAYS_SOFTWARE": "1",
            "BLENDER_USER_RESOURCES": str(folder / "resources"),
            "VOCC_SITE": str(folder / "site"),
            "VOCC_GO": str(folder / "go"),
        }
        self._go = folder / "go"
        self._lines: queue.Queue[str] = queue.Queue()
        # With a file to open Blender shows no splash screen.
        start = folder / "start.blend"
        save = f"import bpy; bpy.ops.wm.save_as_mainfile(filepath={str(start)!r})"
        subprocess.run(
            ["blender", "-b", "--factory-startup", "--python-expr", save],
            stdout=subprocess.DEVNULL,
            check=True,
            timeout=60,
        )
        self._process = subprocess.Popen(
            [
                *("blender", "--factory-startup", "--window-geometry", "0", "0"),
                *(str(WIDTH), str(HEIGHT), "--python-exit-code", "1", str(start)),
                *("--python", str(HERE / "gui_session.py")),
            ],
            env=self._environment,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )
        # One that is there already: to start one takes longer than Blender takes for the key.
        self._pointer = subprocess.Popen(
            ["xdotool", "-"], env=self._environment, stdin=subprocess.PIPE, text=True
        )
        threading.Thread(target=self._read, daemon=True).start()

    def _read(self) -> None:
        assert self._process.stdout is not None
        for line in self._process.stdout:
            self._lines.put(line.rstrip())
        self._lines.put("END")

    def wait_for(self, word: str, timeout: float = 60) -> str:
        """The rest of the line that begins with the word."""
        end = time.monotonic() + timeout
        while True:
            try:
                line = self._lines.get(timeout=max(0.0, end - time.monotonic()))
            except queue.Empty:
                raise SmokeError(f"Blender did not say {word} in {timeout:.0f} s") from None
            if line.startswith(word):
                return line.removeprefix(word).strip()
            if line and line != "TILE":
                print(f"  blender: {line}")
            if line == "END":
                raise SmokeError(f"Blender ended before it said {word}")
            if line.startswith("Traceback"):
                # What follows is the error.
                end, word = min(end, time.monotonic() + 1), "the end of the traceback"

    def go_on(self) -> None:
        """To the next step."""
        self._go.touch()

    def screenshot(self, name: str) -> None:
        """Of the whole display, to OUT."""
        command = ("import", "-window", "root", str(OUT / f"{name}.png"))
        subprocess.run(command, env=self._environment, check=True, timeout=30)

    def click(self, x: int, y: int) -> None:
        """There, with the left button."""
        # Blender must see the pointer come before it takes the button for one there.
        for step in (3, 0):
            self._do(f"mousemove {x - step} {y}")
            time.sleep(0.3)
        for press in ("mousedown", "mouseup"):
            self._do(f"{press} 1")
            time.sleep(0.3)
        time.sleep(0.5)

    def scroll(self, x: int, y: int) -> None:
        """There, to the end."""
        self._do(f"mousemove {x} {y}")
        time.sleep(0.3)
        for _ in range(40):
            self._do("click 5")
        time.sleep(2.0)

    def key(self, name: str) -> float:
        """Presses a key; when that was."""
        now = time.time()
        self._do(f"key {name}")
        return now

    def _do(self, command: str) -> None:
        assert self._pointer.stdin is not None
        self._pointer.stdin.write(f"{command}\n")
        self._pointer.stdin.flush()

    def end(self) -> None:
        """Whatever happened."""
        for process in (self._pointer, self._process):
            process.kill()
            process.wait()


@contextmanager
def display() -> Iterator[str]:
    """The name of a display of its own."""
    read, write = os.pipe()
    command = ["Xvfb", "-displayfd", str(write), "-screen", "0", f"{WIDTH}x{HEIGHT}x24"]
    server = subprocess.Popen(
        [*command, "+extension", "GLX"], pass_fds=[write], stderr=subprocess.DEVNULL
    )
    os.close(write)
    try:
        with os.fdopen(read) as number:
            yield f":{number.readline().strip()}"
    finally:
        server.terminate()
        server.wait()


def unpack_wheels(extension: Path, site: Path) -> None:
    """Those of an extension that CPython 3.11 can use."""
    with zipfile.ZipFile(extension) as packed:
        for name in packed.namelist():
            if name.endswith(".whl") and ("cp311" in name or "py3" in name):
                with packed.open(name) as file, zipfile.ZipFile(file) as wheel:
                    wheel.extractall(site)


def install_numpy(site: Path) -> None:
    """There, unless Blender's own Python has it."""
    asks = "import importlib.util as u; print('NUMPY', u.find_spec('numpy') is not None)"
    command = ("blender", "-b", "--factory-startup", "--python-expr", asks)
    answer = subprocess.run(command, stdout=subprocess.PIPE, text=True, check=True, timeout=60)
    if "NUMPY True" in answer.stdout:
        return
    pip = (sys.executable, "-m", "pip", "--disable-pip-version-check", "install", "--quiet")
    for_blender = ("--python-version", "3.11", "--only-binary", ":all:", "--no-deps")
    command = (*pip, *for_blender, "--target", str(site), NUMPY)
    if subprocess.run(command, check=False).returncode:
        raise SmokeError(f"Blender's Python has no NumPy, and pip could not install {NUMPY}")


def smoke(extension: Path) -> None:
    """All of it; raises SmokeError."""
    OUT.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix="vocc-gui-") as name, display() as screen:
        folder = Path(name)
        unpack_wheels(extension, folder / "site")
        install_numpy(folder / "site")
        session = Session(screen, folder)
        try:
            panels(session)
            progressive(session)
            escape(session)
        finally:
            session.end()


def panels(session: Session) -> None:
    """In the render properties and in the sidebar."""
    session.wait_for("READY", 120)
    time.sleep(3)
    session.click(*TAB)
    session.screenshot("panels")


def progressive(session: Session) -> None:
    """A render that is seen while it goes on, and then the report of it."""
    session.go_on()
    session.wait_for("RENDERING")
    for _ in range(TILES):
        session.wait_for("TILE")
    session.screenshot("rendering")
    seconds = session.wait_for("COMPLETE", 180)
    print(f"a render took {seconds} s")
    time.sleep(2)
    session.scroll(*PROPERTIES)
    session.screenshot("rendered")


def escape(session: Session) -> None:
    """ESC in the midst of a tile. How long it takes is told, not judged: machines are busy."""
    for attempt in range(3):
        session.go_on()
        session.wait_for("RENDERING")
        session.click(*MIDDLE)
        time.sleep(2.0 + 0.4 * attempt)
        pressed = session.key("Escape")
        delay = float(session.wait_for("CANCELLED")) - pressed
        print(f"ESC took {delay:.3f} s")
        time.sleep(1)
        session.screenshot(f"escaped_{attempt + 1}")
    session.go_on()
    session.wait_for("DONE")


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("extension", type=Path, nargs="?", metavar="ZIP")
    args = parser.parse_args()
    # Ended by a signal, it ends what it started as well.
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(1))
    missing = [each for each in PROGRAMS if shutil.which(each) is None]
    if missing:
        print(f"Blender in a window: skipped: there is no {', '.join(missing)}")
        return 77
    try:
        smoke(args.extension or build())
    except (BuildError, SmokeError) as error:
        print(f"wrong: {error}")
        return 1
    print(f"Blender in a window: passed, screenshots are in {OUT.relative_to(ROOT)}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
