# SPDX-License-Identifier: GPL-3.0-or-later
"""Built scenes, kept between renders.

A scene is known by what it is made of: a camera, a light or a name that changes costs no build.
Where some parts move and others do not, each kind has a scene of its own, and only what moved is
built again. Masks do not depend on that, not in a single bit: vertices are rounded to float32 in
the same place, and the triangles of all scenes block together.
"""

from __future__ import annotations

import hashlib
import threading
import weakref
from collections import OrderedDict
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

import pyvocc

from .data import Part
from .transform import to_world

Progress = Callable[[float], object]

# Of the time that a scene takes, what goes before the build.
_ADDING = 0.1

# Fewer triangles that do not move are built faster than looked up in two scenes.
_FEW = 20_000


@dataclass(frozen=True, eq=False)
class Piece:
    """A scene that is built, and what its meshes are.

    Attributes:
        scene: of the triangles in the world.
        numbers: (meshes,) index in `Built.parts`, by geom_id.
        reused: it had been built before.
    """

    scene: pyvocc.Scene
    numbers: NDArray[np.int32]
    reused: bool


@dataclass(frozen=True, eq=False)
class Built:
    """Parts that are built.

    Attributes:
        pieces: together they hold all parts, each once.
        parts: those that were asked for and have something to trace.
    """

    pieces: tuple[Piece, ...]
    parts: tuple[Part, ...]

    @property
    def triangle_count(self) -> int:
        """Triangles of all pieces."""
        return sum(piece.scene.report.triangle_count for piece in self.pieces)

    @property
    def safe_offset(self) -> float:
        """See `pyvocc.Scene.safe_offset`."""
        return max(piece.scene.safe_offset for piece in self.pieces)


class SceneCache:
    """The scenes asked for last; any number of threads may ask.

    Args:
        max_scenes, max_bytes: what is kept at most, but always the last one.
    """

    def __init__(self, max_scenes: int = 12, max_bytes: int = 4 << 30) -> None:
        self.max_scenes = max_scenes
        self.max_bytes = max_bytes
        self._scenes: OrderedDict[bytes, pyvocc.Scene] = OrderedDict()
        self._digests = _Digests()
        self._moving: dict[str, _Moving] = {}
        self._lock = threading.Lock()

    def __len__(self) -> int:
        return len(self._scenes)

    def clear(self) -> None:
        """Lets go of all scenes."""
        with self._lock:
            self._scenes.clear()
            self._moving.clear()

    def scene_for(
        self,
        parts: Sequence[Part],
        *,
        which: Literal["casters", "receivers"] = "casters",
        role: str = "",
        threads: int | None = None,
        progress: Progress | None = None,
    ) -> Built:
        """Those parts that cast shadows or, all of them, that the camera sees.

        Args:
            parts: any.
            which: "casters": parts that cast, and of them the triangles that do. "receivers":
                parts that the camera sees.
            role: what they are asked for; parts are compared with those asked for before in
                the same role, to see which of them move.
            threads: of the build; None for one a processor.
            progress: as for `pyvocc.Scene.build`.

        Raises:
            pyvocc.Cancelled: progress returned True.
            pyvocc.Error: a scene cannot be built.
        """
        if which == "casters":
            chosen = tuple(part for part in parts if _casts(part))
        else:
            chosen = tuple(_whole(part) for part in parts if part.is_receiver)
        digests = [self._digest(part) for part in chosen]
        groups = self._groups(f"{which} {role}", chosen, digests)
        pieces = []
        for index, numbers in enumerate(groups):
            key = hashlib.blake2b(b"".join(digests[number] for number in numbers)).digest()
            known = self._known(key)
            scene = known or _build(
                [chosen[number] for number in numbers],
                threads,
                _part(progress, index, len(groups)),
            )
            if known is None:
                self._keep(key, scene)
            pieces.append(Piece(scene, np.array(numbers, np.int32), known is not None))
        return Built(tuple(pieces), chosen)

    def _groups(self, role: str, parts: tuple[Part, ...], digests: list[bytes]) -> list[list[int]]:
        """Numbers of the parts that are built together."""
        everything = list(range(len(parts)))
        whole = hashlib.blake2b(b"".join(digests)).digest()
        with self._lock:
            moves = self._moving.setdefault(role, _Moving()).update(parts, digests)
            if whole in self._scenes:
                return [everything]
        still = [number for number in everything if not moves[number]]
        moving = [number for number in everything if moves[number]]
        still_triangles = sum(len(parts[number].triangles) for number in still)
        moving_triangles = sum(len(parts[number].triangles) for number in moving)
        if not moving or still_triangles < max(_FEW, moving_triangles):
            return [everything]
        return [still, moving]

    def _known(self, key: bytes) -> pyvocc.Scene | None:
        with self._lock:
            scene = self._scenes.get(key)
            if scene is not None:
                self._scenes.move_to_end(key)
            return scene

    def _keep(self, key: bytes, scene: pyvocc.Scene) -> None:
        with self._lock:
            self._scenes[key] = scene
            size = sum(map(_bytes_of, self._scenes.values()))
            while len(self._scenes) > 1 and (
                len(self._scenes) > self.max_scenes or size > self.max_bytes
            ):
                _, oldest = self._scenes.popitem(last=False)
                size -= _bytes_of(oldest)

    def _digest(self, part: Part) -> bytes:
        key = hashlib.blake2b()
        for array in (part.vertices, part.triangles, part.casting):
            key.update(bytes(64) if array is None else self._digests.of(array))
        key.update(part.matrix.tobytes())
        return key.digest()


class _Moving:
    """Which parts of a role have ever changed; those are expected to change again."""

    def __init__(self) -> None:
        self._last: dict[tuple[str, int], bytes] = {}
        self._moving: set[tuple[str, int]] = set()

    def update(self, parts: tuple[Part, ...], digests: list[bytes]) -> list[bool]:
        """Compares with the last time; whether each part moves."""
        counts: dict[str, int] = {}
        now: dict[tuple[str, int], bytes] = {}
        for part, digest in zip(parts, digests, strict=True):
            number = counts[part.name] = counts.get(part.name, 0) + 1
            now[part.name, number] = digest
        if self._last:
            self._moving.update(
                name for name, digest in now.items() if self._last.get(name) != digest
            )
        self._moving &= now.keys()
        self._last = now
        return [name in self._moving for name in now]


class _Digests:
    """Hashes of arrays. That of one that nobody can write to is computed once: instances share
    their arrays, and several scenes are asked for with the same parts."""

    def __init__(self) -> None:
        self._known: dict[int, tuple[weakref.ref[Any], bytes]] = {}

    def of(self, array: NDArray[Any]) -> bytes:
        key = id(array)
        if key in self._known:
            return self._known[key][1]
        digest = hashlib.blake2b(f"{array.dtype.str}{array.shape}".encode())
        digest.update(np.ascontiguousarray(array))
        result = digest.digest()
        if array.base is None and not array.flags.writeable:
            # It is forgotten before another array can take its place.
            gone = weakref.ref(array, lambda _: self._known.pop(key))
            self._known[key] = gone, result
        return result


def _casts(part: Part) -> bool:
    return part.is_caster and (part.casting is None or bool(part.casting.any()))


def _whole(part: Part) -> Part:
    return part if part.casting is None else replace(part, casting=None)


def _part(progress: Progress | None, index: int, count: int) -> Progress | None:
    if progress is None:
        return None
    return lambda done: progress((index + done) / count)


def _build(parts: Sequence[Part], threads: int | None, progress: Progress | None) -> pyvocc.Scene:
    scene = pyvocc.Scene(threads)
    for index, part in enumerate(parts):
        if progress is not None and progress(_ADDING * index / len(parts)):
            raise pyvocc.Cancelled("stopped while meshes were added")
        triangles = part.triangles if part.casting is None else part.triangles[part.casting]
        scene.add_mesh(to_world(part.vertices, part.matrix), triangles, part.name)
    if progress is None:
        scene.build()
    else:
        scene.build(lambda done: progress(_ADDING + (1 - _ADDING) * done))
    return scene


def _bytes_of(scene: pyvocc.Scene) -> int:
    """Memory of the tree, and of the float32 vertices and int32 triangles beside it."""
    report = scene.report
    return report.tree.bytes + 12 * (report.vertex_count + report.triangle_count)


CACHE = SceneCache()
