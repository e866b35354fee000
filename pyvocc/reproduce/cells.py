"""What has been measured, kept on disk: an interrupted run goes on where it was.

A cell is one measurement, its key everything that determines it. All cells are lines of one
file, which only grows; a line that was cut short by the end of the process is passed over.
"""

from __future__ import annotations

import hashlib
import json
import os
import re
from collections.abc import Mapping
from importlib.util import find_spec
from pathlib import Path
from typing import Any, TypeAlias

from .. import __version__
from .._files import FileError, os_reason

Key: TypeAlias = Mapping[str, Any]
Value: TypeAlias = dict[str, Any]

# Raised when what a cell holds, or how it is measured, changes.
FORMAT = 1

# The modules that say which rays are traced, beside the library itself.
_RAYS = ("camera.py", "shadow.py", "reproduce/workload.py")


class Store:
    """Cells in a file.

    Raises:
        FileError: the file cannot be read or written.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._cells: dict[str, Value] = {}
        try:
            # Made at once: what cannot be written is told before anything is measured.
            with path.open("a+b") as file:
                file.seek(0)
                text = file.read()
                if text and not text.endswith(b"\n"):
                    file.write(b"\n")
        except OSError as error:
            raise FileError(path, os_reason(error)) from None
        for line in text.splitlines():
            try:
                cell = json.loads(line)
                self._cells[_name(cell["key"])] = cell["value"]
            except (ValueError, KeyError, TypeError):
                continue

    def __contains__(self, key: Key) -> bool:
        return _name(key) in self._cells

    def get(self, key: Key) -> Value | None:
        """The cell's value; None if it has not been measured."""
        return self._cells.get(_name(key))

    def put(self, key: Key, value: Value) -> None:
        """Keeps a cell, now and for later runs."""
        line = json.dumps({"key": dict(key), "value": value}) + "\n"
        try:
            with self._path.open("ab") as file:
                file.write(line.encode())
                file.flush()
                os.fsync(file.fileno())
        except OSError as error:
            raise FileError(self._path, os_reason(error)) from None
        # As it would be read back: lists for tuples.
        self._cells[_name(key)] = json.loads(line)["value"]


def _name(key: Key) -> str:
    return json.dumps(dict(key), sort_keys=True)


def library() -> dict[str, Any]:
    """What a result depends on in the package: its version and what it was built from."""
    digest = hashlib.sha256(_extension().read_bytes())
    folder = Path(__file__).resolve().parents[1]
    for name in _RAYS:
        digest.update((folder / name).read_bytes())
    return {"format": FORMAT, "version": __version__, "library": digest.hexdigest()[:16]}


def compiler() -> str:
    """The compiler that made the library, as it signs its work; empty if it did not."""
    found = re.search(
        rb"GCC: \([^)]*\) [\w.]+|\w* ?clang version [\w.]+", _extension().read_bytes()
    )
    return found.group().decode() if found else ""


def _extension() -> Path:
    spec = find_spec("pyvocc._vocc")
    assert spec is not None and spec.origin is not None
    return Path(spec.origin)
