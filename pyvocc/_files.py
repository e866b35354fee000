"""What reading and writing of every kind of file have in common."""

from __future__ import annotations

import contextlib
import os
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from .errors import Error

PathLike = str | os.PathLike[str]


class FileError(Error, OSError, ValueError):
    """A file that cannot be read, written or made sense of; the message names it and why.

    Attributes:
        path: the file, as it was given.
        reason: what is wrong with it.
    """

    def __init__(self, path: PathLike, reason: str) -> None:
        super().__init__(f"{os.fspath(path)}: {reason}")
        self.path = os.fspath(path)
        self.reason = reason

    def __reduce__(self) -> tuple[Any, ...]:
        return FileError, (self.path, self.reason)

    def __str__(self) -> str:
        return f"{self.path}: {self.reason}"


def read_bytes(path: PathLike) -> bytes:
    """The file's content; FileError if there is none to be had."""
    try:
        return Path(path).read_bytes()
    except OSError as error:
        raise FileError(path, os_reason(error)) from None


def os_reason(error: OSError) -> str:
    """'no such file', 'permission denied': the system's reason, without number and path."""
    if isinstance(error, FileNotFoundError):
        return "no such file"
    return (error.strerror or str(error)).lower()


def check_writable(path: PathLike) -> None:
    """FileError if a file of that name could not be made, as far as can be told before."""
    file = Path(path)
    if file.is_dir():
        raise FileError(path, "is a directory")
    folder = file.parent
    if not folder.is_dir():
        raise FileError(path, f"there is no folder {folder}")
    if not os.access(folder, os.W_OK | os.X_OK) or (file.exists() and not os.access(file, os.W_OK)):
        raise FileError(path, "permission denied")


@contextlib.contextmanager
def replacing(path: PathLike) -> Iterator[Path]:
    """A temporary file to write, of the same suffix, that takes the name only when complete."""
    final = Path(path)
    check_writable(final)
    temporary: Path | None = None
    try:
        try:
            handle, name = tempfile.mkstemp(suffix=final.suffix, prefix=".", dir=final.parent)
            os.close(handle)
            temporary = Path(name)
            yield temporary
            mask = os.umask(0)
            os.umask(mask)
            temporary.chmod(0o666 & ~mask)  # mkstemp's files are their owner's only
            temporary.replace(final)
        except FileError:
            raise
        except OSError as error:
            raise FileError(path, os_reason(error)) from None
    except BaseException:
        if temporary is not None:
            temporary.unlink(missing_ok=True)
        raise


def missing(package: str, purpose: str) -> ImportError:
    """The error to raise where an optional package is not installed."""
    return ImportError(f"{purpose} needs {package}: pip install 'pyvocc[io]'", name=package)
