"""Mesh files: PLY, OBJ, STL and OFF read here, glTF and the rest through trimesh.

The four plain formats are read without a further package, so that triangles keep the order
of the file (polygon by polygon, each a fan from its first vertex), vertices keep their exact
values and are not merged, and a file that ends early is an error rather than a smaller mesh.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ._files import FileError, PathLike, missing, read_bytes, replacing

Vertices = NDArray[np.float32] | NDArray[np.float64]
Triangles = NDArray[np.int32]
Mesh = tuple[Vertices, Triangles]


class _ContentError(Exception):
    """What is wrong with the content; `load_mesh` adds the file's name."""


def load_mesh(path: PathLike) -> Mesh:
    """Reads a triangle mesh from a file.

    The suffix tells the format: .ply (text or binary), .obj, .stl (text or binary), .off; .glb,
    .gltf and whatever else trimesh reads need trimesh.  A glTF scene's nodes become one mesh,
    moved to their places.

    Returns:
        vertices: (V, 3) float32 if the file's numbers are float32 numbers, else float64.
        triangles: (T, 3) int32, in the order of the file; a polygon of n corners is the n - 2
            triangles (v0, v[j-1], v[j]).

    Raises:
        FileError: the file is not there, ends early, is of another type, or holds no triangles.
        ImportError: the format needs trimesh, which is not installed.
    """
    suffix = Path(path).suffix.lower()
    if suffix not in _READERS:
        vertices, triangles = _through_trimesh(path)
    else:
        data = read_bytes(path)
        if not data.strip():
            raise FileError(path, "the file is empty")
        try:
            vertices, triangles = _READERS[suffix](data)
        except _ContentError as error:
            raise FileError(path, str(error)) from None
    if len(triangles) == 0:
        raise FileError(path, "holds no triangles")
    _check_indices(path, vertices, triangles)
    with np.errstate(over="ignore", invalid="ignore"):
        narrow = vertices.astype(np.float32)
    if np.array_equal(narrow, vertices, equal_nan=True):
        return np.ascontiguousarray(narrow), triangles.astype(np.int32)
    return np.ascontiguousarray(vertices, np.float64), triangles.astype(np.int32)


def save_ply(path: PathLike, vertices: ArrayLike, triangles: ArrayLike) -> None:
    """Writes a mesh as a binary PLY file, the coordinates as float32 or, if given so, float64.

    Raises:
        FileError: the file cannot be written.
    """
    v = np.asarray(vertices)
    kind = "double" if v.dtype == np.float64 else "float"
    faces = np.asarray(triangles)
    rows = np.empty(len(faces), np.dtype([("count", "u1"), ("corners", "<i4", 3)]))
    rows["count"], rows["corners"] = 3, faces
    header = (
        f"ply\nformat binary_little_endian 1.0\nelement vertex {len(v)}\n"
        f"property {kind} x\nproperty {kind} y\nproperty {kind} z\n"
        f"element face {len(faces)}\nproperty list uchar int vertex_indices\nend_header\n"
    )
    body = np.ascontiguousarray(v, "<f8" if kind == "double" else "<f4").tobytes()
    with replacing(path) as temporary:
        temporary.write_bytes(header.encode() + body + rows.tobytes())


def _check_indices(path: PathLike, vertices: NDArray[Any], triangles: NDArray[Any]) -> None:
    wrong = ((triangles < 0) | (triangles >= len(vertices))).any(axis=1)
    if wrong.any():
        row = int(wrong.argmax())
        corners = ", ".join(str(int(k)) for k in triangles[row])
        raise FileError(
            path,
            f"triangle {row} names vertices {corners}, but there are {len(vertices)} vertices",
        )


def _fans(counts: NDArray[np.int64], corners: NDArray[np.int64]) -> NDArray[np.int64]:
    """Triangles (v0, v[j-1], v[j]) of polygons whose corners stand one after another."""
    if len(counts) and (counts == 3).all():
        return corners.reshape(-1, 3)
    starts = np.cumsum(counts) - counts
    pieces = np.maximum(counts - 2, 0)
    first = np.repeat(starts, pieces)
    step = np.arange(pieces.sum()) - np.repeat(np.cumsum(pieces) - pieces, pieces)
    return np.stack([corners[first], corners[first + step + 1], corners[first + step + 2]], -1)


def _floats(words: list[bytes], what: str) -> NDArray[np.float64]:
    try:
        return np.array(words, np.bytes_).astype(np.float64) if words else np.empty(0)
    except ValueError as error:
        raise _ContentError(f"{what}: expected numbers ({error})") from None


def _ends_early(what: str, found: int, announced: int) -> _ContentError:
    return _ContentError(f"the file ends early: {announced} {what} announced, {found} found")


# ---- PLY -----------------------------------------------------------------------------

_PLY_TYPES = {
    "char": "i1",
    "uchar": "u1",
    "short": "i2",
    "ushort": "u2",
    "int": "i4",
    "uint": "u4",
    "float": "f4",
    "double": "f8",
    "int8": "i1",
    "uint8": "u1",
    "int16": "i2",
    "uint16": "u2",
    "int32": "i4",
    "uint32": "u4",
    "float32": "f4",
    "float64": "f8",
}


@dataclass
class _Property:
    name: str
    kind: str
    """NumPy type without byte order."""
    count_kind: str = ""
    """Of a list's length; empty for a single value."""


@dataclass
class _Element:
    name: str
    count: int
    properties: list[_Property] = field(default_factory=list)


def _read_ply(data: bytes) -> tuple[NDArray[Any], NDArray[Any]]:
    style, elements, body = _ply_header(data)
    reader = _PlyText(body) if style == "ascii" else _PlyBinary(body, style)
    vertices: NDArray[Any] | None = None
    triangles: NDArray[Any] | None = None
    for element in elements:
        names = [p.name for p in element.properties]
        if element.name == "vertex":
            if not {"x", "y", "z"} <= set(names):
                raise _ContentError("the vertices have no x, y, z")
            table = reader.table(element)
            vertices = np.stack([table[k] for k in "xyz"], axis=-1).reshape(-1, 3)
        elif element.name == "face":
            lists = [n for n in names if n in ("vertex_indices", "vertex_index")]
            if not lists:
                raise _ContentError("the faces have no vertex_indices")
            triangles = _fans(*reader.lists(element, lists[0]))
        elif vertices is None or triangles is None:
            reader.lists(element, "")
    if vertices is None:
        raise _ContentError("holds no vertices")
    return vertices, np.empty((0, 3), np.int64) if triangles is None else triangles


def _ply_header(data: bytes) -> tuple[str, list[_Element], bytes]:
    if not data.startswith(b"ply"):
        raise _ContentError("is not a PLY file: it does not begin with 'ply'")
    end = re.search(rb"(?m)^end_header[ \t]*(\r\n|\n|\r)", data)
    if end is None:
        raise _ContentError("the header has no end: end_header is missing")
    style, elements = "", list[_Element]()
    for line in data[: end.start()].decode("latin-1").splitlines()[1:]:
        words = line.split()
        try:
            match words:
                case ["format", name, _]:
                    style = name
                case ["element", name, count]:
                    elements.append(_Element(name, int(count)))
                case ["property", "list", count_kind, kind, name]:
                    row = _Property(name, _PLY_TYPES[kind], _PLY_TYPES[count_kind])
                    elements[-1].properties.append(row)
                case ["property", kind, name]:
                    elements[-1].properties.append(_Property(name, _PLY_TYPES[kind]))
                case [] | ["comment", *_] | ["obj_info", *_]:
                    pass
                case _:
                    raise ValueError
        except (ValueError, KeyError, IndexError):
            raise _ContentError(f"a header line that is not understood: {line.strip()!r}") from None
    if style not in ("ascii", "binary_little_endian", "binary_big_endian"):
        raise _ContentError(f"a format that is not understood: {style!r}")
    if any(element.count < 0 for element in elements):
        raise _ContentError("a negative count in the header")
    return style, elements, data[end.end() :]


class _PlyBinary:
    def __init__(self, body: bytes, style: str) -> None:
        self.body, self.at = body, 0
        self.order = "<" if style == "binary_little_endian" else ">"

    def table(self, element: _Element) -> dict[str, NDArray[Any]]:
        if any(p.count_kind for p in element.properties):
            raise _ContentError(f"lists in the element {element.name!r} are not understood")
        if not element.properties:
            return {}
        dtype = np.dtype([(f"{k}", self.order + p.kind) for k, p in enumerate(element.properties)])
        rows = self._take(dtype, element)
        return {p.name: rows[f"{k}"] for k, p in enumerate(element.properties)}

    def lists(self, element: _Element, wanted: str) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        if not any(p.count_kind for p in element.properties):
            self.table(element)
            return np.empty(0, np.int64), np.empty(0, np.int64)
        quick = self._uniform(element, wanted)
        if quick is not None:
            return quick
        counts, corners = [], list[NDArray[Any]]()
        for row in range(element.count):
            for p in element.properties:
                count = int(self._one(p.count_kind, 1, element, row)[0]) if p.count_kind else 1
                if count < 0:
                    raise _ContentError(f"{element.name} {row} has a list of {count} entries")
                values = self._one(p.kind, count, element, row)
                if p.name == wanted:
                    counts.append(count)
                    corners.append(values.astype(np.int64))
        flat = np.concatenate(corners) if corners else np.empty(0, np.int64)
        return np.array(counts, np.int64), flat

    def _uniform(
        self, element: _Element, wanted: str
    ) -> tuple[NDArray[np.int64], NDArray[np.int64]] | None:
        """All rows at once if their lists are as long as those of the first row."""
        start, counts = self.at, list[tuple[str, int]]()
        fields: list[tuple[Any, ...]] = []
        if element.count == 0:
            return np.empty(0, np.int64), np.empty(0, np.int64)
        for k, p in enumerate(element.properties):
            length = 1
            if p.count_kind:
                length = int(self._one(p.count_kind, 1, element, 0)[0])
                if length < 0:
                    raise _ContentError(f"{element.name} 0 has a list of {length} entries")
                fields.append((f"n{k}", self.order + p.count_kind))
                counts.append((f"n{k}", length))
            self._one(p.kind, length, element, 0)
            fields.append((f"v{k}", self.order + p.kind, (length,)))
        self.at = start
        dtype = np.dtype(fields)
        if len(self.body) - start < dtype.itemsize * element.count:
            return None
        rows = np.frombuffer(self.body, dtype, element.count, start)
        if any((rows[name] != length).any() for name, length in counts):
            return None
        self.at += rows.nbytes
        for k, p in enumerate(element.properties):
            if p.name == wanted:
                values = rows[f"v{k}"].astype(np.int64)
                return np.full(len(rows), values.shape[1], np.int64), values.reshape(-1)
        return np.empty(0, np.int64), np.empty(0, np.int64)

    def _take(self, dtype: np.dtype[Any], element: _Element) -> NDArray[Any]:
        whole = (len(self.body) - self.at) // dtype.itemsize
        if whole < element.count:
            raise _ends_early(f"{element.name} rows", whole, element.count)
        rows = np.frombuffer(self.body, dtype, element.count, self.at)
        self.at += rows.nbytes
        return rows

    def _one(self, kind: str, count: int, element: _Element, row: int) -> NDArray[Any]:
        dtype = np.dtype(self.order + kind)
        if len(self.body) - self.at < dtype.itemsize * count:
            raise _ends_early(f"{element.name} rows", row, element.count)
        values = np.frombuffer(self.body, dtype, count, self.at)
        self.at += values.nbytes
        return values


class _PlyText:
    def __init__(self, body: bytes) -> None:
        self.words, self.at = body.split(), 0

    def table(self, element: _Element) -> dict[str, NDArray[Any]]:
        if any(p.count_kind for p in element.properties):
            raise _ContentError(f"lists in the element {element.name!r} are not understood")
        width = len(element.properties)
        words = self.words[self.at : self.at + width * element.count]
        if len(words) < width * element.count:
            raise _ends_early(f"{element.name} rows", len(words) // max(width, 1), element.count)
        self.at += len(words)
        values = _floats(words, element.name).reshape(element.count, width)
        with np.errstate(over="ignore"):
            return {p.name: values[:, k].astype(p.kind) for k, p in enumerate(element.properties)}

    def lists(self, element: _Element, wanted: str) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        counts, corners, at, words = list[int](), list[int](), self.at, self.words
        for row in range(element.count):
            try:
                for p in element.properties:
                    length = 1
                    if p.count_kind:
                        length, at = int(words[at]), at + 1
                    if length < 0 or at + length > len(words):
                        raise IndexError
                    if p.name == wanted:
                        counts.append(length)
                        corners.extend(map(int, words[at : at + length]))
                    at += length
            except IndexError:
                raise _ends_early(f"{element.name} rows", row, element.count) from None
            except ValueError as error:
                raise _ContentError(f"{element.name} {row}: expected integers ({error})") from None
        self.at = at
        return np.array(counts, np.int64), np.array(corners, np.int64)


# ---- OBJ -----------------------------------------------------------------------------


def _read_obj(data: bytes) -> tuple[NDArray[Any], NDArray[Any]]:
    words: list[bytes] = []
    counts: list[int] = []
    corners: list[int] = []
    lines = data.replace(b"\\\r\n", b" ").replace(b"\\\n", b" ").splitlines()
    for number, line in enumerate(lines, 1):
        row = line.split()
        if not row or row[0] not in (b"v", b"f"):
            continue
        if row[0] == b"v":
            if len(row) < 4:
                raise _ContentError(f"line {number}: a vertex needs 3 numbers, got {len(row) - 1}")
            words += row[1:4]
            continue
        try:
            polygon = [int(word.split(b"/", 1)[0]) for word in row[1:]]
        except ValueError:
            raise _ContentError(
                f"line {number}: a face needs integers: {line.decode(errors='replace')!r}"
            ) from None
        if len(polygon) < 3:
            raise _ContentError(f"line {number}: a face needs 3 vertices, got {len(polygon)}")
        if 0 in polygon:
            raise _ContentError(f"line {number}: vertices are counted from 1, not 0")
        counts.append(len(polygon))
        # Negative numbers count back from the last vertex so far.
        corners += [k - 1 if k > 0 else len(words) // 3 + k for k in polygon]
    vertices = _floats(words, "vertices").reshape(-1, 3)
    return vertices, _fans(np.array(counts, np.int64), np.array(corners, np.int64))


# ---- OFF -----------------------------------------------------------------------------


def _read_off(data: bytes) -> tuple[NDArray[Any], NDArray[Any]]:
    lines = [row for line in data.splitlines() if (row := line.split(b"#", 1)[0].split())]
    # Colours, normals and texture coordinates stand behind the three coordinates.
    if not lines or not re.fullmatch(rb"(ST)?C?N?OFF", lines[0][0]):
        raise _ContentError(
            "is not an OFF file of 3 coordinates in text: it does not begin with 'OFF'"
        )
    if lines[0][1:2] == [b"BINARY"]:
        raise _ContentError("binary OFF files are not read")
    head = lines[0][1:] or (lines[1] if len(lines) > 1 else [])
    body = lines[1 if lines[0][1:] else 2 :]
    try:
        vertex_count, face_count = int(head[0]), int(head[1])
    except (ValueError, IndexError):
        raise _ContentError("the counts of vertices and faces are missing") from None
    if vertex_count < 0 or face_count < 0:
        raise _ContentError("a negative count of vertices or faces")
    rows = body[:vertex_count]
    if len(rows) < vertex_count:
        raise _ends_early("vertices", len(rows), vertex_count)
    for k, row in enumerate(rows):
        if len(row) < 3:
            raise _ContentError(f"vertex {k} has {len(row)} coordinates")
    vertices = _floats([word for row in rows for word in row[:3]], "vertices").reshape(-1, 3)
    faces = body[vertex_count : vertex_count + face_count]
    if len(faces) < face_count:
        raise _ends_early("faces", len(faces), face_count)
    counts, corners = list[int](), list[int]()
    for k, row in enumerate(faces):
        try:
            count = int(row[0])
            polygon = [int(word) for word in row[1 : 1 + count]]
        except ValueError:
            raise _ContentError(f"face {k}: expected integers") from None
        if count < 0 or len(polygon) < count:
            raise _ContentError(f"face {k}: {count} corners announced, {len(polygon)} found")
        counts.append(count)
        corners += polygon
    return vertices, _fans(np.array(counts, np.int64), np.array(corners, np.int64))


# ---- STL -----------------------------------------------------------------------------


def _read_stl(data: bytes) -> tuple[NDArray[Any], NDArray[Any]]:
    announced = int.from_bytes(data[80:84], "little") if len(data) >= 84 else -1
    # Some binary files begin with "solid", too: the size decides.
    if len(data) != 84 + 50 * announced and re.match(rb"\s*solid\b", data):
        vertices = _stl_text(data)
    else:
        if len(data) < 84:
            raise _ContentError("is not an STL file: too short for a header")
        whole = (len(data) - 84) // 50
        if whole < announced:
            raise _ends_early("triangles", whole, announced)
        rows = np.frombuffer(
            data, [("n", "<f4", 3), ("v", "<f4", (3, 3)), ("a", "<u2")], announced, 84
        )
        vertices = rows["v"].reshape(-1, 3)
    return vertices, np.arange(len(vertices)).reshape(-1, 3)


def _stl_text(data: bytes) -> NDArray[np.float32]:
    words = re.findall(rb"(?m)^\s*vertex\s+(\S+)\s+(\S+)\s+(\S+)", data)
    if not re.search(rb"(?m)^\s*endsolid", data):
        raise _ContentError(
            f"the file ends early: endsolid is missing after {len(words) // 3} triangles"
        )
    if len(words) % 3 or len(words) // 3 != len(re.findall(rb"(?m)^\s*endfacet", data)):
        raise _ContentError("a facet without 3 vertices")
    return _floats([w for row in words for w in row], "vertices").reshape(-1, 3).astype(np.float32)


# ---- all else ------------------------------------------------------------------------


# What it reads that is not read here.
_TRIMESH = (".glb", ".gltf", ".dae", ".zae", ".3mf", ".3dxml", ".xaml", ".ctm")


def _through_trimesh(path: PathLike) -> tuple[NDArray[Any], NDArray[Any]]:
    if not Path(path).is_file():
        read_bytes(path)  # raises with the reason
    suffix = Path(path).suffix.lower()
    try:
        import trimesh
    except ImportError:
        if suffix not in _TRIMESH:
            known = ", ".join((*_READERS, *_TRIMESH))
            text = f"no reader for {suffix!r} files" if suffix else "has no suffix"
            raise FileError(path, f"{text}; there are {known}") from None
        raise missing("trimesh", f"reading {suffix or 'this kind of'} files") from None
    if suffix.lstrip(".") not in trimesh.available_formats():
        raise FileError(path, f"no reader for {suffix!r} files" if suffix else "has no suffix")
    try:
        # process=False: vertices stay as they are; the library welds by exact position.
        scene: Any = trimesh.load(str(path), process=False, force="scene")
        parts = []
        for node in scene.graph.nodes_geometry:
            matrix, name = scene.graph[node]
            mesh = scene.geometry[name]
            if hasattr(mesh, "faces"):
                parts.append((np.asarray(mesh.vertices), np.asarray(mesh.faces), matrix))
    except ImportError as error:
        raise missing(str(error.name), f"reading {suffix} files") from None
    except Exception as error:  # whatever a foreign parser raises on a bad file
        reason = str(error).strip().splitlines()
        detail = reason[0] if reason else type(error).__name__
        raise FileError(path, f"is not a readable {suffix[1:]} file ({detail})") from None
    vertices, triangles, start = [], [], 0
    for points, faces, matrix in parts:
        vertices.append(transform(points, matrix[:3, :3], matrix[:3, 3]))
        triangles.append(faces + start)
        start += len(points)
    if not parts:
        return np.empty((0, 3)), np.empty((0, 3), np.int64)
    return np.concatenate(vertices), np.concatenate(triangles)


def transform(vertices: NDArray[Any], matrix: NDArray[Any], move: NDArray[Any]) -> NDArray[Any]:
    """matrix · v + move for each vertex; the vertices as they are if that changes nothing.

    Term by term rather than as a matrix product, whose roundings may depend on the row: equal
    positions must stay equal, or a mesh with doubled vertices comes apart.
    """
    if np.array_equal(matrix, np.eye(3)) and not np.any(move):
        return vertices
    v = vertices.astype(np.float64)
    columns = [
        v[:, 0] * matrix[k, 0] + v[:, 1] * matrix[k, 1] + v[:, 2] * matrix[k, 2] + move[k]
        for k in range(3)
    ]
    return np.stack(columns, axis=-1)


_READERS: dict[str, Callable[[bytes], tuple[NDArray[Any], NDArray[Any]]]] = {
    ".ply": _read_ply,
    ".obj": _read_obj,
    ".off": _read_off,
    ".stl": _read_stl,
}
