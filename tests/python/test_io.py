"""Mesh, scene and image files: what is read, what is refused, and in which words."""

from __future__ import annotations

import builtins
import contextlib
import dataclasses
import math
import pickle
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import pyvocc
from pyvocc import images, io, scene_files, shapes
from pyvocc.io import FileError, load_mesh, load_scene, save_ply

# A quadrilateral, a triangle and a pentagon, not in the order of their sizes.
POINTS = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0.5, 2, 0), (2, 2, 0)]
POLYGONS = [(0, 1, 2, 3), (3, 2, 4), (0, 1, 5, 4, 3)]
FANS = [(0, 1, 2), (0, 2, 3), (3, 2, 4), (0, 1, 5), (0, 5, 4), (0, 4, 3)]


def rows(values: list[tuple[float, ...]]) -> str:
    return "".join(" ".join(str(v) for v in row) + "\n" for row in values)


def counted() -> str:
    return rows([(len(p), *p) for p in POLYGONS])


def ply_header(style: str, kind: str = "float", extra: str = "") -> str:
    return (
        f"ply\nformat {style} 1.0\ncomment made here\nelement vertex {len(POINTS)}\n"
        f"property {kind} x\nproperty {kind} y\nproperty {kind} z\n{extra}"
        f"element face {len(POLYGONS)}\nproperty list uchar int vertex_indices\nend_header\n"
    )


def ply_binary(order: str, kind: str) -> bytes:
    style = "binary_little_endian" if order == "<" else "binary_big_endian"
    code = "f" if kind == "float" else "d"
    body = b"".join(struct.pack(f"{order}3{code}", *p) for p in POINTS)
    body += b"".join(struct.pack(f"{order}B{len(p)}i", len(p), *p) for p in POLYGONS)
    return ply_header(style, kind).encode() + body


PLAIN: dict[str, bytes] = {
    "text.ply": (ply_header("ascii") + rows(POINTS) + counted()).encode(),
    "little.ply": ply_binary("<", "float"),
    "big.ply": ply_binary(">", "double"),
    "plain.off": ("OFF\n# counts\n6 3 0\n" + rows(POINTS) + counted()).encode(),
    "one line.off": ("OFF 6 3 0\n" + rows(POINTS) + counted()).encode(),
    "colours.off": (
        "COFF\n6 3 0\n" + rows([(*p, 255, 0, 0, 255) for p in POINTS]) + counted()
    ).encode(),
    "plain.obj": (
        "# a comment\no thing\n"
        + "".join(f"v {x} {y} {z}\n" for x, y, z in POINTS)
        + "".join("f " + " ".join(str(k + 1) for k in p) + "\n" for p in POLYGONS)
    ).encode(),
    "rich.obj": (
        "mtllib none.mtl\n"
        + "".join(f"v {x} {y} {z} 1 0 0\n" for x, y, z in POINTS)
        + "vt 0 0\nvn 0 0 1\nusemtl red\ng first\nf 1/1 2/1/1 3//1 4\n"
        + "s off\nf -3 -4 -2\r\nf 1 2 \\\n 6 5 4\n"
    ).encode(),
}


@pytest.fixture
def write(tmp_path: Path) -> Callable[[str, bytes | str], Path]:
    def make(name: str, content: bytes | str) -> Path:
        path = tmp_path / name
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
        return path

    return make


Write = Callable[[str, bytes | str], Path]


# ---- meshes that are read ------------------------------------------------------------


@pytest.mark.parametrize("name", PLAIN)
def test_polygons_become_fans_in_the_order_of_the_file(write: Write, name: str) -> None:
    vertices, triangles = load_mesh(write(name, PLAIN[name]))
    assert vertices.tolist() == [list(p) for p in POINTS]
    assert triangles.tolist() == [list(t) for t in FANS]
    assert vertices.dtype == np.float32  # all are float32 numbers, also in text and as double
    assert triangles.dtype == np.int32


def test_vertices_keep_their_double_values(write: Write) -> None:
    text = PLAIN["plain.obj"].decode().replace("v 0.5 2 0", "v 500000.001 0.1 0")
    vertices, _ = load_mesh(write("far.obj", text))
    assert vertices.dtype == np.float64
    assert vertices[4].tolist() == [500000.001, 0.1, 0.0]


def test_other_elements_and_properties_of_ply_are_skipped(write: Write) -> None:
    header = ply_header("ascii", extra="property uchar red\nproperty double quality\n")
    header = header.replace("element face", "element camera 2\nproperty float f\nelement face")
    header = header.replace("end_header", "property float weight\nend_header")
    body = rows([(*p, 255, 0.25) for p in POINTS]) + "1.5\n2.5\n"
    body += rows([(len(p), *p, 0.5) for p in POLYGONS])
    _, triangles = load_mesh(write("more.ply", header + body))
    assert triangles.tolist() == [list(t) for t in FANS]


def test_equal_polygons_and_mixed_ones_are_read_alike(write: Write) -> None:
    # All faces of one size are read at once; one other face takes the way row by row.
    vertices, triangles = shapes.icosphere(1)
    path = write("ball.ply", b"")
    save_ply(path, vertices, triangles)
    whole = path.read_bytes()
    body = whole.replace(b"element face 80", b"element face 81") + struct.pack(
        "<B4i", 4, 0, 1, 2, 3
    )
    again = load_mesh(write("mixed.ply", body))
    assert np.array_equal(again[0], vertices)
    assert np.array_equal(again[1], [*triangles.tolist(), [0, 1, 2], [0, 2, 3]])


def test_save_ply_and_load_mesh_are_inverse(tmp_path: Path) -> None:
    vertices, triangles = shapes.torus_knot()
    save_ply(tmp_path / "knot.ply", vertices, triangles)
    again = load_mesh(tmp_path / "knot.ply")
    assert np.array_equal(again[0], vertices)
    assert np.array_equal(again[1], triangles)
    double = vertices.astype(np.float64) + 1 / 3
    save_ply(tmp_path / "double.ply", double, triangles)
    assert np.array_equal(load_mesh(str(tmp_path / "double.ply"))[0], double)


@pytest.mark.parametrize("kind", ["text", "binary", "binary that says solid"])
def test_stl_keeps_every_corner(write: Write, kind: str) -> None:
    vertices, triangles = shapes.cube()
    corners = vertices[triangles]
    if kind == "text":
        facets = "".join(
            "facet normal 0 0 0\nouter loop\n"
            + "".join(f"vertex {x} {y} {z}\n" for x, y, z in facet)
            + "endloop\nendfacet\n"
            for facet in corners
        )
        content = f"solid cube\n{facets}endsolid cube\n".encode()
    else:
        head = b"solid" if "solid" in kind else b"binary"
        content = head.ljust(80) + struct.pack("<I", 12)
        content += b"".join(struct.pack("<12fH", 0, 0, 0, *f.reshape(-1), 0) for f in corners)
    points, faces = load_mesh(write("cube.stl", content))
    assert np.array_equal(points[faces], corners)
    assert shapes.topology(points, faces).closed


def test_glb_nodes_come_to_their_places(tmp_path: Path) -> None:
    trimesh = pytest.importorskip("trimesh")
    scene = trimesh.Scene()
    cube = trimesh.Trimesh(*shapes.cube(), process=False)
    scene.add_geometry(cube, geom_name="a")
    scene.add_geometry(
        cube, geom_name="b", transform=trimesh.transformations.translation_matrix((5, 0, 0))
    )
    scene.export(tmp_path / "two.glb")
    vertices, triangles = load_mesh(tmp_path / "two.glb")
    assert vertices.min(axis=0).tolist() == [-1, -1, -1]
    assert vertices.max(axis=0).tolist() == [6, 1, 1]
    found = shapes.topology(vertices, triangles)
    assert (found.closed, found.components, found.volume) == (True, 2, pytest.approx(16))


# ---- mesh files that are refused -----------------------------------------------------

BAD_MESHES: list[tuple[str, bytes | str, str]] = [
    ("empty.ply", "", "the file is empty"),
    ("blank.obj", " \n\n", "the file is empty"),
    ("other.ply", "hello", "is not a PLY file: it does not begin with 'ply'"),
    ("head.ply", "ply\nformat ascii 1.0\nelement vertex 3\n", "end_header is missing"),
    ("format.ply", "ply\nformat utf 1.0\nend_header\n", "a format that is not understood: 'utf'"),
    ("line.ply", "ply\nformat ascii 1.0\nproperty quad x\nend_header\n", "'property quad x'"),
    ("minus.ply", "ply\nformat ascii 1.0\nelement vertex -3\nend_header\n", "a negative count"),
    (
        "noxyz.ply",
        "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nend_header\n1\n",
        "the vertices have no x, y, z",
    ),
    (
        "cloud.ply",
        ply_header("ascii").replace("face 3", "face 0") + rows(POINTS),
        "holds no triangles",
    ),
    (
        "huge.ply",
        PLAIN["little.ply"].replace(b"vertex 6", b"vertex 6000000000000"),
        "the file ends early: 6000000000000 vertex rows announced",
    ),
    (
        "word.ply",
        PLAIN["text.ply"].replace(b"0.5 2 0", b"0.5 two 0"),
        "vertex: expected numbers",
    ),
    (
        "range.ply",
        PLAIN["text.ply"].replace(b"3 3 2 4", b"3 3 2 6"),
        "triangle 2 names vertices 3, 2, 6, but there are 6 vertices",
    ),
    ("minus.off", PLAIN["plain.off"].replace(b"3 3 2 4", b"3 3 -2 4"), "names vertices 3, -2, 4"),
    ("other.off", "hello", "does not begin with 'OFF'"),
    ("four.off", "4OFF\n1 0 0\n0 0 0 1\n", "is not an OFF file of 3 coordinates"),
    ("counts.off", "OFF\nsix three\n", "the counts of vertices and faces are missing"),
    ("short.off", "OFF\n1 1 0\n0 0\n3 0 0 0\n", "vertex 0 has 2 coordinates"),
    ("corner.off", "OFF\n1 1 0\n0 0 0\n4 0 0 0\n", "face 0: 4 corners announced, 3 found"),
    ("none.obj", "hello\nworld\n", "holds no triangles"),
    ("zero.obj", "v 0 0 0\nf 0 1 1\n", "line 2: vertices are counted from 1, not 0"),
    ("word.obj", "v 0 0 0\nf a b c\n", "line 2: a face needs integers: 'f a b c'"),
    ("edge.obj", "v 0 0 0\nf 1 1\n", "line 2: a face needs 3 vertices, got 2"),
    ("flat.obj", "v 0 0\nf 1 1 1\n", "line 1: a vertex needs 3 numbers, got 2"),
    ("back.obj", "v 0 0 0\nf -1 -2 1\n", "triangle 0 names vertices 0, -1, 0"),
    ("short.stl", "hello", "is not an STL file: too short"),
    ("cut.stl", "solid a\nfacet normal 0 0 0\nouter loop\nvertex 0 0 0\n", "endsolid is missing"),
    ("two.stl", "solid a\nvertex 0 0 0\nvertex 0 0 0\nendsolid\n", "a facet without 3 vertices"),
    ("binary.stl", bytes(80) + struct.pack("<I", 7) + bytes(150), "7 triangles announced, 3 found"),
    ("picture.jpg", "hello", "no reader for '.jpg' files"),
    ("suffixless", "hello", "has no suffix"),
    ("other.glb", "hello", "is not a readable glb file"),
]


@pytest.mark.parametrize(("name", "content", "reason"), BAD_MESHES, ids=[b[0] for b in BAD_MESHES])
def test_a_bad_mesh_file_is_named_with_the_reason(
    write: Write, name: str, content: bytes | str, reason: str
) -> None:
    if name in ("picture.jpg", "suffixless", "other.glb"):
        pytest.importorskip("trimesh")
    path = write(name, content)
    with pytest.raises(FileError) as caught:
        load_mesh(path)
    assert str(caught.value).startswith(f"{path}: ")
    assert reason in str(caught.value)
    assert caught.value.path == str(path)
    assert caught.value.reason in str(caught.value)


# All but OBJ files, which do not say how long they are.
@pytest.mark.parametrize(
    "name", [name for name in (*PLAIN, "text.stl", "binary.stl") if not name.endswith(".obj")]
)
def test_no_truncation_is_taken_for_a_whole_mesh(write: Write, name: str) -> None:
    if name.endswith(".stl"):
        facet = "facet normal 0 0 1\nouter loop\n" + 3 * "vertex 0 1 2\n" + "endloop\nendfacet\n"
        text = ("solid a\n" + 3 * facet + "endsolid").encode()
        whole = text if name == "text.stl" else bytes(80) + struct.pack("<I", 3) + bytes(150)
    else:
        # A digit cut off the last number leaves a number, hence one more to lose.
        whole = PLAIN[name].rstrip(b"\n")
    load_mesh(write(name, whole))
    for length in {*range(0, len(whole), 7), len(whole) - 2}:
        with pytest.raises(FileError):
            load_mesh(write(name, whole[:length]))


def test_random_bytes_never_end_in_another_error(write: Write) -> None:
    random = np.random.default_rng(3)
    for name, content in PLAIN.items():
        for _ in range(40):
            noisy = bytearray(content)
            for at in random.integers(0, len(noisy), 4):
                noisy[at] = random.integers(0, 256)
            with contextlib.suppress(FileError):
                load_mesh(write(name, bytes(noisy)))


def test_a_missing_file_a_folder_and_a_locked_file(write: Write, tmp_path: Path) -> None:
    with pytest.raises(FileError, match=r"nowhere\.ply: no such file"):
        load_mesh(tmp_path / "nowhere.ply")
    folder = tmp_path / "folder.ply"
    folder.mkdir()
    with pytest.raises(FileError, match=r"folder\.ply: is a directory"):
        load_mesh(folder)
    with pytest.raises(FileError, match="there is no folder"):
        save_ply(tmp_path / "no" / "mesh.ply", *shapes.cube())
    with pytest.raises(FileError, match="is a directory"):
        save_ply(folder, *shapes.cube())


def test_file_error_is_what_handlers_expect() -> None:
    error = FileError("a.ply", "no such file")
    assert isinstance(error, pyvocc.Error)
    assert isinstance(error, ValueError)
    assert isinstance(error, OSError)
    again = pickle.loads(pickle.dumps(error))
    assert (str(again), again.path, again.reason) == (
        "a.ply: no such file",
        "a.ply",
        "no such file",
    )
    assert pyvocc.FileError is FileError


def test_a_failed_write_leaves_the_old_file_and_no_other(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "mesh.ply"
    path.write_text("old")

    def full(self: Path, data: bytes) -> int:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "write_bytes", full)
    with pytest.raises(FileError, match=r"mesh\.ply: no space left on device"):
        save_ply(path, *shapes.cube())
    assert [p.name for p in tmp_path.iterdir()] == ["mesh.ply"]
    assert path.read_text() == "old"


@pytest.mark.parametrize(
    ("package", "call"),
    [
        ("trimesh", lambda folder: load_mesh(folder / "a.glb")),
        ("OpenEXR", lambda folder: io.read_image(folder / "a.exr")),
        ("PIL", lambda folder: io.write_png(folder / "b.png", np.zeros((2, 2, 3), np.uint8))),
    ],
)
def test_a_missing_package_is_named_with_the_extra(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, package: str, call: Callable[[Path], Any]
) -> None:
    for name in ("a.glb", "a.exr"):
        (tmp_path / name).write_text("something")
    real = builtins.__import__

    def without(name: str, *rest: Any, **more: Any) -> Any:
        if name.split(".")[0] == package:
            raise ImportError(name)
        return real(name, *rest, **more)

    monkeypatch.setattr(builtins, "__import__", without)
    with pytest.raises(ImportError, match=r"pip install 'pyvocc\[io\]'"):
        call(tmp_path)


# ---- scene files ---------------------------------------------------------------------

SCENE = """
[[mesh]]
path = "cube.ply"
{mesh}

[ground]
size = 20
{ground}

[camera]
eye = [0, 2, 5]
target = [0, 0.5, 0]
fov = 40
{camera}

[[light]]
corner = [1, 4, 1]
edge_u = [1, 0, 0]
edge_v = [0, 0, 1]
{light}
{end}
"""


@pytest.fixture
def scene_file(tmp_path: Path) -> Callable[..., Path]:
    """Writes a cube and a scene file with lines added to its tables."""
    save_ply(tmp_path / "cube.ply", *shapes.cube())

    def make(text: str = SCENE, **lines: str) -> Path:
        keys = dict.fromkeys(("mesh", "ground", "camera", "light", "end"), "")
        (tmp_path / "teapot.toml").write_text(text.format(**{**keys, **lines}))
        return tmp_path / "teapot.toml"

    return make


SceneMaker = Callable[..., Path]


def test_a_scene_file_is_read(scene_file: SceneMaker) -> None:
    file = load_scene(scene_file(mesh='name = "box"', light='name = "key"'))
    assert [mesh.name for mesh in file.meshes] == ["box", "ground"]
    assert [mesh.occluder for mesh in file.meshes] == [True, False]
    assert file.meshes[0].vertices.dtype == np.float32
    assert file.camera == pyvocc.PerspectiveCamera((0, 2, 5), (0, 0.5, 0), fov=40)
    assert file.lights == (pyvocc.RectLight((1, 4, 1), (1, 0, 0), (0, 0, 1)),)
    assert file.light_names == ("key",)
    ground = file.meshes[1]
    assert shapes.topology(ground.vertices, ground.triangles).boundary_edges == 4
    a, b, c = ground.vertices[ground.triangles[0]]
    assert np.cross(b - a, c - a)[1] > 0  # faces up


def test_the_format_that_users_are_shown_is_accepted(tmp_path: Path) -> None:
    save_ply(tmp_path / "teapot.ply", *shapes.cube())
    (tmp_path / "scene.toml").write_text(scene_files.FORMAT)
    file = load_scene(tmp_path / "scene.toml")
    assert [mesh.name for mesh in file.meshes] == ["teapot", "ground"]
    assert file.light_names == ("key",)


LIGHT_TABLES: dict[str, tuple[str, pyvocc.Light]] = {
    "rect": (
        'type = "rect"\ncorner = [0, 1, 2]\nedge_u = [1, 0, 0]\nedge_v = [0, 1, 0]\n'
        "two_sided = false",
        pyvocc.RectLight((0, 1, 2), (1, 0, 0), (0, 1, 0), two_sided=False),
    ),
    "disk": (
        'type = "disk"\ncenter = [0, 1, 2]\naxis_u = [1, 0, 0]\naxis_v = [0, 0.5, 0]',
        pyvocc.DiskLight((0, 1, 2), (1, 0, 0), (0, 0.5, 0)),
    ),
    "disk, one side": (
        'type = "disk"\ncenter = [0, 1, 2]\naxis_u = [1, 0, 0]\naxis_v = [0, 0.5, 0]\n'
        "two_sided = false",
        pyvocc.DiskLight((0, 1, 2), (1, 0, 0), (0, 0.5, 0), two_sided=False),
    ),
    "sphere": (
        'type = "sphere"\ncenter = [0, 1, 2]\nradius = 0.5',
        pyvocc.SphereLight((0, 1, 2), 0.5),
    ),
    "point": ('type = "point"\ncenter = [0, 1, 2]', pyvocc.PointLight((0, 1, 2))),
    "point with a disk": (
        'type = "point"\ncenter = [0, 1, 2]\nradius = 1',
        pyvocc.PointLight((0, 1, 2), 1),
    ),
    "spot": (
        'type = "spot"\ncenter = [0, 1, 2]\ndirection = [0, -3, 0]\nangle = 60\nradius = 0.25',
        pyvocc.SpotLight((0, 1, 2), (0, -3, 0), math.radians(60), 0.25),
    ),
    "spot of all around": (
        'type = "spot"\ncenter = [0, 1, 2]\ndirection = [0, -3, 0]\nangle = 360',
        pyvocc.SpotLight((0, 1, 2), (0, -3, 0), 2 * math.pi),
    ),
    "sun": ('type = "sun"\ndirection = [1, 2, 3]', pyvocc.SunLight((1, 2, 3))),
    "wide sun": (
        'type = "sun"\ndirection = [1, 2, 3]\nangle = 180.0',
        pyvocc.SunLight((1, 2, 3), math.pi),
    ),
}


@pytest.mark.parametrize("name", LIGHT_TABLES)
def test_a_light_of_any_type_is_read(scene_file: SceneMaker, name: str) -> None:
    table, light = LIGHT_TABLES[name]
    file = load_scene(scene_file(end=f"[[light]]\nname = 'other'\n{table}"))
    assert file.lights[1] == light
    assert file.light_names == ("light0", "other")
    with file.build() as scene:
        result = pyvocc.shadow_pass(scene, file.camera, file.lights, (24, 16))
    assert (result.counts[1] != pyvocc.NOT_TRACED).any()
    pixels = io.look(result, file.lights)
    assert (io.look(result, (file.lights[0], SUN_BELOW)) <= pixels).all()
    assert images.mask(result, 1).shape == (16, 24, 3)


SUN_BELOW = pyvocc.SunLight((0, -1, 0))


def test_every_type_of_light_is_in_the_format(tmp_path: Path) -> None:
    told = {
        line.split('"')[1]: line for line in scene_files.FORMAT.splitlines() if "type =" in line
    }
    assert list(told) == list(scene_files.LIGHTS)
    for name, kind in scene_files.LIGHTS.items():
        text = told[name] if name != "rect" else scene_files.FORMAT
        assert all(field.name in text for field in dataclasses.fields(kind))


def test_a_sun_lights_what_faces_it(scene_file: SceneMaker) -> None:
    made = image(8, 8)
    made.geom_id[:] = 0
    made.visibility[:] = 1
    made.normal[:, :4] = (0, 0.6, 0.8)
    made.normal[:, 4:] = (0, 0.6, -0.8)
    for length in (1e-3, 1, 1e3):
        pixels = io.look(made, [pyvocc.SunLight((0, 0, length)), SUN_BELOW]).astype(int)
        assert pixels[:, 4:].max() + 60 < pixels[:, :4].min()


def test_defaults_of_a_scene_file(scene_file: SceneMaker) -> None:
    text = SCENE.replace("fov = 40", "tan_half_fov = 0.28").replace("[ground]\nsize = 20", "")
    file = load_scene(str(scene_file(text)))
    assert file.light_names == ("light0",)
    assert [mesh.name for mesh in file.meshes] == ["cube"]
    assert file.camera.up == (0, 1, 0)
    assert file.camera.tan_half_fov == 0.28


def test_a_built_scene_answers(scene_file: SceneMaker) -> None:
    seen: list[float] = []
    file = load_scene(scene_file(ground="height = -1.5"))
    with file.build(threads=1, progress=seen.append) as scene:
        assert scene.report.threads == 1
        assert [mesh.closed for mesh in scene.report.meshes] == [True, False]
        assert scene.occluded((0, -1.25, 0), (0, -1, 0))  # the ground below
        assert not scene.occluded((0, 1.25, 0), (0, 1, 0))
        assert scene.region((0, 0, 0)) > 0
    assert seen[-1] == 1.0
    with pytest.raises(pyvocc.OpenMeshError):
        file_with_open = load_scene(scene_file())
        broken = file_with_open.meshes[0]
        object.__setattr__(broken, "triangles", broken.triangles[1:])
        file_with_open.build(strict=True)


def test_scale_rotate_translate_in_this_order(scene_file: SceneMaker) -> None:
    lines = "scale = [2, 1, 1]\nrotate = [0, 90, 0]\ntranslate = [10, 0, 0]"
    (mesh, _) = load_scene(scene_file(mesh=lines)).meshes
    # The long axis x is turned to -z; a right angle is exact.
    assert mesh.vertices.min(axis=0).tolist() == [9, -1, -2]
    assert mesh.vertices.max(axis=0).tolist() == [11, 1, 2]
    assert shapes.topology(mesh.vertices, mesh.triangles).volume == pytest.approx(16)


def test_rotations_turn_the_right_way(scene_file: SceneMaker) -> None:
    corner = np.array([1.0, 0.5, 0.25])
    points = np.array([corner, (0, 0, 0), (0, 1, 0), (0, 0, 1)])
    save_ply(scene_file().parent / "cube.ply", points, [(0, 1, 2), (1, 2, 3)])

    def turned(rotate: str) -> list[float]:
        vertices = load_scene(scene_file(mesh=f"rotate = {rotate}")).meshes[0].vertices
        return vertices[0].tolist()

    assert turned("[0, 0, 90]") == [-0.5, 1.0, 0.25]
    assert turned("[90, 0, 0]") == [1.0, -0.25, 0.5]
    # About x first: (1, -0.25, 0.5), then about y: (z, y, -x).
    assert turned("[90, 90, 0]") == [0.5, -0.25, -1.0]
    assert turned("{ axis = [0, 0, 3], angle = 90 }") == [-0.5, 1.0, 0.25]
    assert turned("{ axis = [1, 1, 1], angle = 120 }") == pytest.approx([0.25, 1.0, 0.5])
    assert turned("[0, 0, 720]") == corner.tolist()


def test_a_mirrored_mesh_is_not_inside_out(scene_file: SceneMaker) -> None:
    (mesh, _) = load_scene(scene_file(mesh="scale = [-1, 1, 1]")).meshes
    assert shapes.topology(mesh.vertices, mesh.triangles).volume == pytest.approx(8)


def test_doubled_vertices_stay_together_when_turned(scene_file: SceneMaker) -> None:
    vertices, triangles = shapes.icosphere(3)
    path = scene_file(mesh="scale = 1.7\nrotate = [12.3, 45.6, 78.9]\ntranslate = [3, 1, 4]")
    loose = vertices[triangles.reshape(-1)]
    save_ply(path.parent / "cube.ply", loose, np.arange(len(loose)).reshape(-1, 3))
    (mesh, _) = load_scene(path).meshes
    assert shapes.topology(mesh.vertices, mesh.triangles).closed


BAD_SCENES: list[tuple[dict[str, str], str]] = [
    ({"light": "cornre = 1"}, "light[0].cornre: unknown key; did you mean 'corner'?"),
    (
        {"light": "radius = 1"},
        "light[0].radius: unknown key; there are name, type, corner, edge_u, edge_v, two_sided",
    ),
    ({"light": "two_sided = 1"}, "light[0].two_sided: expected true or false, got the number 1"),
    (
        {"light": 'type = "spere"'},
        "light[0].type: no light is of type 'spere'; did you mean 'sphere'",
    ),
    (
        {"light": 'type = "area"'},
        "light[0].type: no light is of type 'area'; there are rect, disk, sphere, point, spot, sun",
    ),
    ({"light": "type = 3"}, "light[0].type: expected a string, got the number 3"),
    ({"end": '[[light]]\ntype = "disk"\nedge_u = 1'}, "light[1].edge_u: unknown key"),
    (
        {"end": '[[light]]\ntype = "disk"\ncenter = [0, 0, 0]\naxis_u = [1, 0, 0]'},
        "light[1].axis_v: missing",
    ),
    ({"end": '[[light]]\ntype = "sphere"\ncenter = [0, 0, 0]'}, "light[1].radius: missing"),
    (
        {"end": '[[light]]\ntype = "sphere"\ncenter = [0, 0, 0]\nradius = -1'},
        "light[1].radius: radius must be finite and at least 0, got -1",
    ),
    (
        {"end": '[[light]]\ntype = "point"\ncenter = [0, 0, 0]\nradius = "big"'},
        "light[1].radius: expected a number, got the string 'big'",
    ),
    (
        {"end": '[[light]]\ntype = "spot"\ncenter = [0, 0, 0]\ndirection = [0, 1, 0]'},
        "light[1].angle: missing",
    ),
    (
        {"end": '[[light]]\ntype = "spot"\ncenter = [0, 0, 0]\ndirection = [0, 1, 0]\nangle = 361'},
        "light[1].angle: expected 0 to 360 degrees, got 361",
    ),
    (
        {"end": '[[light]]\ntype = "spot"\ncenter = [0, 0, 0]\ndirection = [0, 0, 0]\nangle = 9'},
        "light[1].direction: direction must point somewhere, got (0, 0, 0)",
    ),
    ({"end": '[[light]]\ntype = "sun"'}, "light[1].direction: missing"),
    (
        {"end": '[[light]]\ntype = "sun"\ndirection = [0, 1, 0]\nangle = -0.5'},
        "light[1].angle: expected 0 to 180 degrees, got -0.5",
    ),
    (
        {"end": '[[light]]\ntype = "sun"\ndirection = [0, inf, 0]'},
        "light[1].direction[1]: expected a finite number, got inf",
    ),
    ({"mesh": "roate = [0, 1, 0]"}, "mesh[0].roate: unknown key; did you mean 'rotate'?"),
    ({"camera": "zzz = 1"}, "camera.zzz: unknown key; there are eye, target, up, fov"),
    ({"end": "[cammera]"}, "cammera: unknown key; did you mean 'camera'?"),
    ({"mesh": "scale = [1, 2]"}, "mesh[0].scale: expected 3 numbers, got 2"),
    ({"mesh": "scale = 'big'"}, "mesh[0].scale: expected a number, got the string 'big'"),
    ({"mesh": "scale = 0"}, "mesh[0].scale: a scale of 0 leaves no solid"),
    ({"mesh": "translate = 3"}, "mesh[0].translate: expected 3 numbers, got the number 3"),
    (
        {"mesh": "translate = [0, nan, 0]"},
        "mesh[0].translate[1]: expected a finite number, got nan",
    ),
    ({"mesh": "rotate = [0, true, 0]"}, "mesh[0].rotate[1]: expected a number, got true"),
    (
        {"mesh": "rotate = { axis = [0, 0, 0], angle = 1 }"},
        "mesh[0].rotate.axis: expected a direct",
    ),
    ({"mesh": "rotate = { axis = [0, 1, 0] }"}, "mesh[0].rotate.angle: missing"),
    ({"mesh": "occluder = 1"}, "mesh[0].occluder: expected true or false, got the number 1"),
    ({"mesh": "name = ''"}, "mesh[0].name: is empty"),
    ({"mesh": "name = 3"}, "mesh[0].name: expected a string, got the number 3"),
    ({"end": "[[mesh]]\npath = 'none.ply'"}, "mesh[1].path: "),
    ({"end": "[[mesh]]\nname = 'a'"}, "mesh[1].path: missing"),
    ({"ground": "height = [1]"}, "ground.height: expected a number, got a list of 1"),
    ({"camera": "up = [0, -1.5, -5]"}, "camera.up: "),
    ({"camera": "tan_half_fov = 0.2"}, "camera.fov: give fov or tan_half_fov, not both"),
    (
        {"end": "[[light]]\ncorner = [0, 0, 0]\nedge_u = [1, 0]\nedge_v = [0, 0, 1]"},
        "light[1].edge_u: expected 3 numbers, got 2",
    ),
    ({"end": "[[light]]\ncorner = [0, 0, 0]\nedge_u = [1, 0, 0]"}, "light[1].edge_v: missing"),
    (
        {
            "light": "name = 'a'",
            "end": "[[light]]\nname = 'a'\ncorner = [0, 0, 0]\nedge_u = [1, 0, 0]\n"
            "edge_v = [0, 1, 0]",
        },
        "light[1].name: two lights are called 'a'",
    ),
    ({"end": "x = "}, "is not valid TOML: "),
]


@pytest.mark.parametrize(("lines", "reason"), BAD_SCENES, ids=[b[1][:40] for b in BAD_SCENES])
def test_a_bad_scene_file_is_named_with_its_key(
    scene_file: SceneMaker, lines: dict[str, str], reason: str
) -> None:
    path = scene_file(**lines)
    with pytest.raises(FileError) as caught:
        load_scene(path)
    assert str(caught.value).startswith(f"{path}: {reason}")


@pytest.mark.parametrize(
    ("old", "new", "reason"),
    [
        ("[camera]", "[other]", "other: unknown key"),
        ("[[mesh]]", "[mesh]", "mesh: expected an array of tables: write [[mesh]], not [mesh]"),
        ("[ground]", "[[ground]]", "ground: expected a table, got a list of 1"),
        ("size = 20", "size = -1", "ground.size: expected more than 0, got -1"),
        ("size = 20", "", "ground.size: missing"),
        ("fov = 40", "", "camera.fov: missing: give fov (degrees) or tan_half_fov"),
        ("fov = 40", "fov = 180", "camera.fov: "),
        ("eye = [0, 2, 5]", "eye = [0, 0.5, 0]", "camera.target: "),
        ("eye = [0, 2, 5]", "", "camera.eye: missing"),
    ],
)
def test_a_changed_scene_file_is_refused(
    scene_file: SceneMaker, old: str, new: str, reason: str
) -> None:
    path = scene_file(SCENE.replace(old, new))
    with pytest.raises(FileError) as caught:
        load_scene(path)
    assert str(caught.value).startswith(f"{path}: {reason}")


@pytest.mark.parametrize("table", ["[[mesh]]", "[camera]", "[[light]]"])
def test_tables_that_are_needed(scene_file: SceneMaker, table: str) -> None:
    path = scene_file()
    parts = path.read_text().split("\n\n")
    path.write_text("\n\n".join(part for part in parts if table not in part))
    with pytest.raises(FileError, match=table.strip("[]") + ": missing: .* is needed"):
        load_scene(path)


def test_a_broken_mesh_of_a_scene_is_named_itself(scene_file: SceneMaker) -> None:
    path = scene_file()
    (path.parent / "cube.ply").write_text("ply")
    with pytest.raises(FileError, match=r"cube\.ply: the header has no end"):
        load_scene(path)
    save_ply(path.parent / "cube.ply", np.full((3, 3), np.nan, np.float32), [(0, 1, 2)])
    with pytest.raises(FileError, match=r"cube\.ply: .*vertices"):
        load_scene(path).build()


def test_scene_files_that_are_no_text(tmp_path: Path) -> None:
    with pytest.raises(FileError, match=r"none\.toml: no such file"):
        load_scene(tmp_path / "none.toml")
    (tmp_path / "bytes.toml").write_bytes(b"a = '\xff'")
    with pytest.raises(FileError, match=r"bytes\.toml: is not UTF-8 text \(byte 5\)"):
        load_scene(tmp_path / "bytes.toml")


# ---- images --------------------------------------------------------------------------


def image(height: int = 3, width: int = 4) -> pyvocc.ShadowPass:
    random = np.random.default_rng(5)
    counts = random.integers(0, 5, (2, height, width)).astype(np.uint16)
    visibility = (counts / 4).astype(np.float32)
    visibility[0, 0, 0] = -1
    geom_id = random.integers(0, 2, (height, width)).astype(np.int32)
    geom_id[-1, -1] = -1
    position = random.normal(size=(height, width, 3)).astype(np.float32)
    position[-1, -1] = np.nan
    return pyvocc.ShadowPass(
        visibility=visibility,
        counts=counts,
        position=position,
        normal=random.normal(size=(height, width, 3)).astype(np.float32),
        geom_id=geom_id,
        prim_id=geom_id,
        samples=4,
        primary_seconds=0.0,
        shadow_seconds=1.0,
    )


LIGHTS = (
    pyvocc.RectLight((0, 4, 0), (1, 0, 0), (0, 0, 1)),
    pyvocc.RectLight((4, 1, 0), (0, 1, 0), (0, 0, 1)),
)


def test_exr_holds_every_figure(tmp_path: Path) -> None:
    pytest.importorskip("OpenEXR")
    made = image()
    io.write_exr(tmp_path / "a.exr", made, ["key", "low sun"])
    read = io.read_image(tmp_path / "a.exr")
    assert sorted(read) == sorted(
        ["shadow.key", "shadow.low sun", "P.X", "P.Y", "P.Z", "N.X", "N.Y", "N.Z", "geom_id"]
    )
    assert all(channel.dtype == np.float32 for channel in read.values())
    assert np.array_equal(read["shadow.key"], made.visibility[0])
    assert np.array_equal(read["shadow.low sun"], made.visibility[1])
    for k, axis in enumerate("XYZ"):
        assert np.array_equal(read[f"P.{axis}"], made.position[..., k], equal_nan=True)
        assert np.array_equal(read[f"N.{axis}"], made.normal[..., k])
    assert np.array_equal(read["geom_id"], made.geom_id)


def test_exr_needs_a_name_for_each_light(tmp_path: Path) -> None:
    for names in (["a"], ["a", "a"], ["a", "b", "c"]):
        with pytest.raises(ValueError, match="expected 2 different light names"):
            io.write_exr(tmp_path / "a.exr", image(), names)


def test_png_holds_the_look(tmp_path: Path) -> None:
    pytest.importorskip("PIL")
    pixels = io.look(image(6, 5), LIGHTS)
    assert (pixels.shape, pixels.dtype) == ((6, 5, 3), np.uint8)
    io.write_png(tmp_path / "a.png", pixels)
    read = io.read_image(tmp_path / "a.png")
    assert list(read) == ["R", "G", "B"]
    assert np.array_equal(np.stack(list(read.values()), axis=-1), pixels)


def test_look_shows_shadow_darker_than_light() -> None:
    made = image(8, 8)
    made.normal[:] = (0, 1, 0)
    made.position[:] = 0
    made.geom_id[:] = 0
    made.visibility[:] = 1
    made.visibility[:, :4] = 0
    made.visibility[1, 4:] = -1  # not traced adds no light, and takes none away
    pixels = io.look(made, LIGHTS).astype(int)
    assert pixels[:4].max() + 60 < pixels[4:].min()
    made.visibility[1, 4:] = 0
    assert np.array_equal(pixels, io.look(made, LIGHTS))


def test_look_of_the_ground_is_grey_and_of_the_background_neither() -> None:
    made = image(4, 4)
    made.normal[:] = (0, 1, 0)
    made.position[:] = 0
    made.geom_id[:] = 1
    made.geom_id[0] = -1
    with_ground = io.look(made, LIGHTS, ground=1)
    assert not np.array_equal(with_ground, io.look(made, LIGHTS))
    made.visibility[:] = 1 - made.visibility
    assert np.array_equal(with_ground[0], io.look(made, LIGHTS, ground=1)[0])


def test_mask_tells_not_traced_from_dark() -> None:
    made = image()
    made.visibility[0, :, 1] = 0
    made.visibility[0, :, 2] = 1
    pixels = images.mask(made, 0).astype(int)
    assert pixels[0, 2].sum() > pixels[0, 1].sum()
    assert not np.array_equal(pixels[0, 0], pixels[0, 1])


def test_there_is_a_colour_for_any_light() -> None:
    colours = [images.light_colour(k) for k in range(12)]
    assert all(((c >= 0) & (c <= 1)).all() for c in colours)
    assert len({tuple(c) for c in colours}) == 12


def test_images_that_cannot_be_read(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("OpenEXR")
    pytest.importorskip("PIL")
    io.write_exr(tmp_path / "whole.exr", image(40, 40), ["a", "b"])
    io.write_png(tmp_path / "whole.png", io.look(image(40, 40), LIGHTS))
    for suffix, kind in ((".exr", "EXR"), (".png", "PNG")):
        whole = (tmp_path / f"whole{suffix}").read_bytes()
        path = tmp_path / f"bad{suffix}"
        for content in (b"junk", whole[:60], whole[: len(whole) // 2], whole[:-20]):
            path.write_bytes(content)
            with pytest.raises(FileError, match=f"bad{suffix}: is not a complete {kind} file"):
                io.read_image(path)
        path.write_bytes(b"")
        with pytest.raises(FileError, match="the file is empty"):
            io.read_image(path)
        with pytest.raises(FileError, match="no such file"):
            io.read_image(tmp_path / f"none{suffix}")
    with pytest.raises(FileError, match=r"a\.jpg: is neither an \.exr nor a \.png file"):
        io.read_image(tmp_path / "a.jpg")
    capfd.readouterr()  # OpenEXR's own words


def test_images_that_cannot_be_written(tmp_path: Path) -> None:
    pytest.importorskip("OpenEXR")
    pytest.importorskip("PIL")
    with pytest.raises(FileError, match="there is no folder"):
        io.write_exr(tmp_path / "no" / "a.exr", image(), ["a", "b"])
    with pytest.raises(FileError, match="there is no folder"):
        io.write_png(tmp_path / "no" / "a.png", io.look(image(), LIGHTS))
