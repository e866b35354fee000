"""Scene files: meshes, ground, camera and lights in TOML.

`FORMAT` shows all that a scene file can hold.
"""

from __future__ import annotations

import difflib
import math
import tomllib
from collections.abc import Collection, Mapping, Sequence
from dataclasses import MISSING, dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

import numpy as np
from numpy.typing import NDArray

from ._files import FileError, PathLike, read_bytes
from .camera import PerspectiveCamera
from .errors import Error
from .lights import DiskLight, Light, PointLight, RectLight, SphereLight, SpotLight, SunLight
from .mesh_files import Triangles, Vertices, load_mesh, transform

if TYPE_CHECKING:
    from ._ffi import Progress
    from .scene import Scene

FORMAT = """\
[[mesh]]                      # one or more
path = "teapot.ply"           # relative to this file
name = "teapot"               # default: the file's name without suffix
occluder = true               # its closed parts may hold occluders
scale = 2.0                   # or three numbers; then
rotate = [0, 90, 0]           # degrees about x, then y, then z;
                              # or { axis = [1, 1, 0], angle = 30 }; then
translate = [0, 1, 0]

[ground]                      # optional: an open square that faces +y, about x = z = 0
size = 20.0
height = 0.0                  # default 0

[camera]
eye = [0, 2, 5]
target = [0, 1, 0]
up = [0, 1, 0]                # default
fov = 40.0                    # vertical, in degrees; or tan_half_fov = 0.36

[[light]]                     # one or more
name = "key"                  # default: light0, light1, ...
type = "rect"                 # default; a parallelogram
corner = [1, 4, 1]
edge_u = [1, 0, 0]
edge_v = [0, 0, 1]
two_sided = true              # default; false: it emits where edge_u x edge_v points to only

# Lights of other types have these keys instead:
# type = "disk"               center, axis_u, axis_v (half axes), two_sided = true
# type = "sphere"             center, radius
# type = "point"              center, radius = 0 (of a disk that faces what it lights)
# type = "spot"               center, direction, angle (of its whole cone, in degrees), radius = 0
# type = "sun"                direction (towards it), angle = 0 (its diameter, in degrees)
"""

# The types of lights by their names in scene files.
LIGHTS: Mapping[str, type[Light]] = {
    "rect": RectLight,
    "disk": DiskLight,
    "sphere": SphereLight,
    "point": PointLight,
    "spot": SpotLight,
    "sun": SunLight,
}
MOST_DEGREES = {"spot": 360.0, "sun": 180.0}

Vector = tuple[float, float, float]


@dataclass(frozen=True, eq=False)
class SceneMesh:
    """A mesh of a scene file, moved to its place.

    Attributes:
        name: for reports.
        vertices: (V, 3) float32 or float64.
        triangles: (T, 3) int32.
        occluder: its closed parts may hold occluders.
        path: the file it came from; None for the ground.
    """

    name: str
    vertices: Vertices
    triangles: Triangles
    occluder: bool
    path: Path | None


@dataclass(frozen=True, eq=False)
class SceneFile:
    """A scene file as read.

    Attributes:
        path: the file.
        meshes: in order of the file, the ground last; a mesh's place is its geom_id.
        camera: the camera.
        lights: the lights.
        light_names: their names, all different.
    """

    path: Path
    meshes: tuple[SceneMesh, ...]
    camera: PerspectiveCamera
    lights: tuple[Light, ...]
    light_names: tuple[str, ...]

    def build(
        self, threads: int | None = None, progress: Progress | None = None, **options: Any
    ) -> Scene:
        """A built scene of the meshes.

        Args:
            threads: as in `Scene`.
            progress, options: as in `Scene.build`.

        Raises:
            as `Scene.add_mesh` and `Scene.build`; FileError where a mesh is not accepted.
        """
        from .scene import Scene

        scene = Scene(threads=threads)
        try:
            for mesh in self.meshes:
                try:
                    scene.add_mesh(mesh.vertices, mesh.triangles, mesh.name, mesh.occluder)
                except ValueError as error:
                    raise FileError(mesh.path or self.path, str(error)) from error
            scene.build(progress, **options)
        except BaseException:
            scene.close()
            raise
        return scene


def load_scene(path: PathLike) -> SceneFile:
    """Reads a scene file and the meshes that it names.

    `FORMAT` shows all that a scene file can hold.  Lengths are in the meshes' unit; rotations are
    right-handed.

    Raises:
        FileError: the file or one of its meshes cannot be read, a key is unknown or missing,
            or a value is not accepted; the message names file and key.
        ImportError: a mesh's format needs trimesh, which is not installed.
    """
    file = Path(path)
    try:
        document = tomllib.loads(read_bytes(path).decode("utf-8"))
    except UnicodeDecodeError as error:
        raise FileError(path, f"is not UTF-8 text (byte {error.start})") from None
    except tomllib.TOMLDecodeError as error:
        raise FileError(path, f"is not valid TOML: {error}") from None
    top = _Table(file, "", document, ("mesh", "ground", "camera", "light"))
    # Small things first: a wrong number is told before large meshes are read.
    camera = _camera(top.table("camera", ("eye", "target", "up", "fov", "tan_half_fov")))
    lights: list[Light] = []
    names: list[str] = []
    for k, table in enumerate(top.tables("light", None)):
        lights.append(_light(table))
        name = table.text("name", f"light{k}")
        if name in names:
            table.fail("name", f"two lights are called {name!r}")
        names.append(name)
    ground = None
    if "ground" in document:
        ground = _ground(top.table("ground", ("size", "height")))
    keys = ("path", "name", "occluder", "scale", "rotate", "translate")
    placed = [_Placed(table) for table in top.tables("mesh", keys)]
    meshes = [place.load() for place in placed]
    if ground is not None:
        meshes.append(ground)
    return SceneFile(file, tuple(meshes), camera, tuple(lights), tuple(names))


class _Table:
    """A TOML table that says where in the file a fault is, in the form mesh[0].scale."""

    def __init__(
        self, file: Path, where: str, values: Mapping[str, Any], keys: Collection[str] | None
    ):
        self.file, self.where, self.values = file, where, values
        if keys is not None:
            self.check(keys)

    def check(self, keys: Collection[str]) -> None:
        """Fails at the first key that is none of these."""
        for key in self.values:
            if key not in keys:
                near = difflib.get_close_matches(key, keys, 1, 0.6)
                hint = f"did you mean {near[0]!r}?" if near else f"there are {', '.join(keys)}"
                self.fail(key, f"unknown key; {hint}")

    def fail(self, key: str, reason: str) -> NoReturn:
        raise FileError(self.file, f"{self._key(key)}: {reason}")

    def _key(self, key: str) -> str:
        return f"{self.where}.{key}" if self.where and key else self.where or key

    def table(self, key: str, keys: Collection[str]) -> _Table:
        if key not in self.values:
            self.fail(key, f"missing: a table [{key}] is needed")
        value = self.values[key]
        if not isinstance(value, dict):
            self.fail(key, f"expected a table, got {_kind(value)}")
        return _Table(self.file, self._key(key), value, keys)

    def tables(self, key: str, keys: Collection[str] | None) -> list[_Table]:
        """Keys: those there are; None where the caller checks them."""
        value = self.values.get(key, [])
        if isinstance(value, dict):
            self.fail(key, f"expected an array of tables: write [[{key}]], not [{key}]")
        if not isinstance(value, list):
            self.fail(key, f"expected an array of tables, got {_kind(value)}")
        if not value:
            self.fail(key, f"missing: at least one [[{key}]] is needed")
        result = []
        for k, item in enumerate(value):
            if not isinstance(item, dict):
                self.fail(f"{key}[{k}]", f"expected a table, got {_kind(item)}")
            result.append(_Table(self.file, f"{self._key(key)}[{k}]", item, keys))
        return result

    def text(self, key: str, default: str | None = None) -> str:
        value = self.values.get(key, default)
        if value is None:
            self.fail(key, "missing")
        if not isinstance(value, str):
            self.fail(key, f"expected a string, got {_kind(value)}")
        if not value.strip():
            self.fail(key, "is empty")
        return value

    def boolean(self, key: str, default: bool) -> bool:
        value = self.values.get(key, default)
        if not isinstance(value, bool):
            self.fail(key, f"expected true or false, got {_kind(value)}")
        return value

    def number(self, key: str, default: float | None = None) -> float:
        value = self.values.get(key, default)
        if value is None:
            self.fail(key, "missing")
        return self._number(key, value)

    def vector(self, key: str, default: Vector | None = None) -> Vector:
        value = self.values.get(key, default)
        if value is None:
            self.fail(key, "missing")
        if not isinstance(value, Sequence) or isinstance(value, str):
            self.fail(key, f"expected 3 numbers, got {_kind(value)}")
        if len(value) != 3:
            self.fail(key, f"expected 3 numbers, got {len(value)}")
        x, y, z = (self._number(f"{key}[{k}]", item) for k, item in enumerate(value))
        return x, y, z

    def _number(self, key: str, value: Any) -> float:
        if isinstance(value, bool) or not isinstance(value, int | float):
            self.fail(key, f"expected a number, got {_kind(value)}")
        try:
            result = float(value)
        except OverflowError:
            result = math.inf
        if not math.isfinite(result):
            self.fail(key, f"expected a finite number, got {value}")
        return result


def _kind(value: object) -> str:
    match value:
        case bool():
            return str(value).lower()
        case str():
            return f"the string {value!r}"
        case int() | float():
            return f"the number {value}"
        case list():
            return f"a list of {len(value)}"
        case dict():
            return "a table"
    return f"a {type(value).__name__}"


def _camera(table: _Table) -> PerspectiveCamera:
    eye, target = table.vector("eye"), table.vector("target")
    up = table.vector("up", (0.0, 1.0, 0.0))
    lens = {key: table.number(key) for key in ("fov", "tan_half_fov") if key in table.values}
    if not lens:
        table.fail("fov", "missing: give fov (degrees) or tan_half_fov")
    if len(lens) == 2:
        table.fail("fov", "give fov or tan_half_fov, not both")
    try:
        return PerspectiveCamera(eye, target, up, **lens)
    except Error as error:
        table.fail(error.argument or "", str(error))


def _light(table: _Table) -> Light:
    kind = table.text("type", "rect")
    if kind not in LIGHTS:
        near = difflib.get_close_matches(kind, LIGHTS, 1, 0.6)
        hint = f"did you mean {near[0]!r}?" if near else f"there are {', '.join(LIGHTS)}"
        table.fail("type", f"no light is of type {kind!r}; {hint}")
    parameters = fields(LIGHTS[kind])
    table.check(("name", "type", *(field.name for field in parameters)))
    values: dict[str, Any] = {}
    for field in parameters:
        default = None if field.default is MISSING else field.default
        match field.name:
            case "two_sided":
                values[field.name] = table.boolean(field.name, True)
            case "radius":
                values[field.name] = table.number(field.name, default)
            case "angle":
                values[field.name] = _radians(table, field.name, default, MOST_DEGREES[kind])
            case _:
                values[field.name] = table.vector(field.name)
    try:
        return LIGHTS[kind](**values)
    except Error as error:
        table.fail(error.argument or "", str(error))


def _radians(table: _Table, key: str, default: float | None, most: float) -> float:
    degrees = table.number(key, default)
    if not 0 <= degrees <= most:
        table.fail(key, f"expected 0 to {most:g} degrees, got {degrees:g}")
    return math.radians(degrees)


def _ground(table: _Table) -> SceneMesh:
    size, y = table.number("size"), table.number("height", 0.0)
    if size <= 0:
        table.fail("size", f"expected more than 0, got {size:g}")
    s = size / 2
    corners = np.array([(-s, y, -s), (s, y, -s), (s, y, s), (-s, y, s)])
    narrow = corners.astype(np.float32)
    vertices = narrow if np.array_equal(narrow, corners) else corners
    return SceneMesh("ground", vertices, np.array([(0, 2, 1), (0, 3, 2)], np.int32), False, None)


class _Placed:
    """A [[mesh]] table, checked before its file is read."""

    def __init__(self, table: _Table) -> None:
        self.table = table
        self.file = Path(table.text("path"))
        self.name = table.text("name", self.file.stem)
        self.occluder = table.boolean("occluder", True)
        scale = table.values.get("scale", 1.0)
        if isinstance(scale, list):
            self.scale = np.array(table.vector("scale"))
        else:
            self.scale = np.full(3, table.number("scale", 1.0))
        if not self.scale.all():
            table.fail("scale", "a scale of 0 leaves no solid")
        self.turn = _rotation(table)
        self.move = np.array(table.vector("translate", (0.0, 0.0, 0.0)))

    def load(self) -> SceneMesh:
        path = self.table.file.parent / self.file
        try:
            vertices, triangles = load_mesh(path)
        except FileError as error:
            if not path.is_file():
                self.table.fail("path", f"{path}: {error.reason}")
            raise
        vertices = transform(vertices, self.turn * self.scale, self.move)
        if np.prod(np.sign(self.scale)) < 0:
            # A mirror image would be inside out.
            triangles = np.ascontiguousarray(triangles[:, ::-1])
        return SceneMesh(self.name, vertices, triangles, self.occluder, path)


def _rotation(table: _Table) -> NDArray[np.float64]:
    value = table.values.get("rotate", [0.0, 0.0, 0.0])
    if isinstance(value, dict):
        inner = table.table("rotate", ("axis", "angle"))
        axis, angle = np.array(inner.vector("axis")), inner.number("angle")
        length = math.sqrt(axis @ axis)
        if length == 0:
            inner.fail("axis", "expected a direction, got (0, 0, 0)")
        return _about(axis / length, angle)
    x, y, z = table.vector("rotate", (0.0, 0.0, 0.0))
    turns = [_about(axis, angle) for axis, angle in zip(np.eye(3), (x, y, z), strict=True)]
    return np.asarray(turns[2] @ turns[1] @ turns[0])


def _about(axis: NDArray[np.float64], degrees: float) -> NDArray[np.float64]:
    """Rodrigues' rotation; exact at multiples of a right angle about an axis."""
    quarter, rest = divmod(degrees, 90)
    if rest == 0:
        c, s = ((1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0))[int(quarter) % 4]
    else:
        c, s = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    x, y, z = axis
    skew = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.asarray(np.eye(3) * c + s * skew + (1 - c) * np.outer(axis, axis))
