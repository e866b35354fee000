# SPDX-License-Identifier: GPL-3.0-or-later
"""Names of render passes."""

from __future__ import annotations

from collections.abc import Sequence

AO_PASS = "VOcc AO"
PREFIX = "Shadow "

# Before 5.0 Blender keeps 64 bytes of a channel's name in an EXR file, "<view layer>.<pass>.X",
# and mixes up passes that differ behind them. This leaves 13 bytes for the view layer.
MAX_BYTES = 48


def pass_names(names: Sequence[str]) -> tuple[str, ...]:
    """A pass name for each light's name: unique, and without what a pass name cannot hold.

    The name of a light does not depend on the order of the others. Of lights whose passes would
    be named alike, the one whose name can be kept as it is keeps it; the others are numbered.
    """
    plain = [_pass_name(name) for name in names]
    result = list(plain)
    taken: set[str] = set()
    changed = [PREFIX + name != kept for name, kept in zip(names, plain, strict=True)]
    for index in sorted(range(len(names)), key=lambda index: (changed[index], names[index])):
        number = 1
        while result[index] in taken:
            number += 1
            ending = f" {number}"
            result[index] = _cut(plain[index], MAX_BYTES - len(ending)) + ending
        taken.add(result[index])
    return tuple(result)


def _pass_name(name: str) -> str:
    # A dot separates layer, pass and channel in an EXR file.
    kept = "".join("_" if c == "." or not c.isprintable() else c for c in name)
    return _cut(PREFIX + kept, MAX_BYTES)


def _cut(text: str, length: int) -> str:
    """As many whole characters as go into `length` bytes."""
    return text.encode()[:length].decode(errors="ignore")
