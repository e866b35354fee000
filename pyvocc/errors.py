"""Exceptions, and the one place where the library's status codes become them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any


class Error(Exception):
    """Base of all that pyvocc raises.

    Attributes:
        argument: the name of the offending argument, or None.
        index: the row (from 0) of the first offender in it, or None.
        value: the offending value, or None.
    """

    def __init__(
        self,
        message: str,
        *,
        argument: str | None = None,
        index: int | None = None,
        value: Any = None,
    ) -> None:
        super().__init__(message)
        self.argument = argument
        self.index = index
        self.value = value

    def __reduce__(self) -> tuple[Any, ...]:
        return _rebuild, (type(self), str(self), self.argument, self.index, self.value)


def _rebuild(
    kind: type[Error], message: str, argument: str | None, index: int | None, value: Any
) -> Error:
    return kind(message, argument=argument, index=index, value=value)


class InvalidArgument(Error, ValueError):
    """A value, shape or range that is not accepted."""


class InvalidType(Error, TypeError):
    """An argument of a type that is not accepted."""


class OutOfMemory(Error, MemoryError):
    """The library could not get memory; nothing was changed."""


class Cancelled(Error):
    """The progress callback asked to stop."""


class StateError(Error, RuntimeError):
    """The scene is closed, not built yet, built already, or being built."""


class LimitError(Error, ValueError):
    """More triangles, vertices or regions than the format can hold."""


class UnsupportedError(Error, RuntimeError):
    """This build of the library, or this machine, does not have it."""


class OpenMeshError(Error, ValueError):
    """`strict`, and a mesh is not closed; `index` is its geom_id."""


class ThreadError(Error, RuntimeError):
    """The system gave no thread or lock."""


class MismatchError(Error, RuntimeError):
    """`verify` found a difference: a fault of the library or of the machine."""


# By the name of the vocc_status after VOCC_ERROR_.
EXCEPTIONS: Mapping[str, type[Error]] = {
    "INVALID_ARGUMENT": InvalidArgument,
    "OUT_OF_MEMORY": OutOfMemory,
    "CANCELLED": Cancelled,
    "NOT_BUILT": StateError,
    "FROZEN": StateError,
    "LIMIT": LimitError,
    "UNSUPPORTED": UnsupportedError,
    "OPEN_MESH": OpenMeshError,
    "THREAD": ThreadError,
    "MISMATCH": MismatchError,
}


def from_status(name: str, message: str, argument: str, index: int, value: float) -> Error:
    """The exception for a failed call; empty, -1 and NaN stand for 'none'."""
    return EXCEPTIONS[name](
        message,
        argument=argument or None,
        index=index if index >= 0 else None,
        # NaN may be the offender itself: it counts as one where a row is named.
        value=value if value == value or index >= 0 else None,
    )
