"""What is refused, and how: the exception names argument, index and value."""

from __future__ import annotations

import dataclasses
import math
import pickle
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import shapes

import pyvocc
from pyvocc import errors

VERTICES, TRIANGLES = shapes.cube()
LIGHT = pyvocc.RectLight((0, 3, 0), (1, 0, 0), (0, 0, 1))
CAMERA = pyvocc.PerspectiveCamera((0, 0, 5), (0, 0, 0))


def refused(
    kind: type[pyvocc.Error],
    call: Callable[[], Any],
    argument: str,
    index: int | None = None,
    value: Any = None,
) -> pyvocc.Error:
    """The call's exception, whose attributes and message say what is wrong."""
    with pytest.raises(kind) as caught:
        call()
    error = caught.value
    assert error.argument == argument
    assert argument in str(error)
    if index is not None:
        assert error.index == index
        assert str(index) in str(error)
    if value is not None:
        assert error.value == value or (error.value != error.value and value != value)
    return error


def changed(array: np.ndarray, row: int, column: int, value: float, dtype: Any) -> np.ndarray:
    result = array.astype(dtype)
    result[row, column] = value
    return result


# ---- meshes ------------------------------------------------------------------


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_vertices_that_are_not_finite(dtype: Any, value: float) -> None:
    scene = pyvocc.Scene()
    vertices = changed(VERTICES, 5, 2, value, dtype)
    error = refused(
        pyvocc.InvalidArgument,
        lambda: scene.add_mesh(vertices, TRIANGLES),
        "vertices",
        5,
        value,
    )
    assert ("nan" if value != value else "inf") in str(error).lower()
    # Nothing is half-added.
    assert scene.add_mesh(VERTICES, TRIANGLES) == 0
    assert scene.build().triangle_count == 12


def test_vertices_beyond_float32() -> None:
    vertices = changed(VERTICES, 3, 0, 1e39, np.float64)
    refused(
        pyvocc.InvalidArgument,
        lambda: pyvocc.Scene().add_mesh(vertices, TRIANGLES),
        "vertices",
        3,
        1e39,
    )


@pytest.mark.parametrize(
    ("dtype", "value"),
    [
        (np.int32, 8),
        (np.int32, -1),
        (np.int64, 2**32),
        (np.int64, -(2**40)),
        (np.uint32, 2**32 - 1),
        (np.uint64, 2**53),
        (np.int8, -128),
    ],
)
def test_indices_out_of_range(dtype: Any, value: int) -> None:
    triangles = changed(TRIANGLES, 7, 1, value, dtype)
    error = refused(
        pyvocc.InvalidArgument,
        lambda: pyvocc.Scene().add_mesh(VERTICES, triangles),
        "triangles",
        7,
        value,
    )
    assert str(value) in str(error)


def test_triangles_without_vertices() -> None:
    empty = np.zeros((0, 3))
    refused(
        pyvocc.InvalidArgument, lambda: pyvocc.Scene().add_mesh(empty, TRIANGLES), "triangles", 0, 0
    )


@pytest.mark.parametrize("shape", [(), (3,), (8, 2), (8, 4), (2, 4, 3), (0, 2)])
def test_shapes_of_meshes(shape: tuple[int, ...]) -> None:
    scene = pyvocc.Scene()
    for name, arrays in (
        ("vertices", (np.zeros(shape), TRIANGLES)),
        ("triangles", (VERTICES, np.zeros(shape, int))),
    ):
        error = refused(pyvocc.InvalidArgument, lambda arrays=arrays: scene.add_mesh(*arrays), name)
        assert f"shape (n, 3), got {shape}" in str(error)


@pytest.mark.parametrize("dtype", [complex, object, "U5", "S5", bool, "M8[s]", "f4,f4"])
def test_types_of_meshes(dtype: Any) -> None:
    scene = pyvocc.Scene()
    bad = np.zeros((8, 3), dtype)
    error = refused(pyvocc.InvalidType, lambda: scene.add_mesh(bad, TRIANGLES), "vertices")
    assert isinstance(error, TypeError)
    assert str(bad.dtype) in str(error)
    refused(pyvocc.InvalidType, lambda: scene.add_mesh(VERTICES, bad), "triangles")


def test_indices_that_are_floats() -> None:
    scene = pyvocc.Scene()
    refused(
        pyvocc.InvalidType, lambda: scene.add_mesh(VERTICES, TRIANGLES.astype(float)), "triangles"
    )


def test_ragged_lists() -> None:
    scene = pyvocc.Scene()
    refused(
        pyvocc.InvalidArgument, lambda: scene.add_mesh([[0, 0, 0], [1, 2]], TRIANGLES), "vertices"
    )


@pytest.mark.parametrize("empty", [[], np.zeros((0, 3)), np.zeros((0, 3), np.int32)])
def test_empty_meshes_are_accepted(empty: Any) -> None:
    scene = pyvocc.Scene()
    assert scene.add_mesh(empty, empty, name="nothing") == 0
    assert scene.add_mesh(VERTICES, empty) == 1
    assert scene.add_mesh(VERTICES, TRIANGLES) == 2
    report = scene.build()
    assert [mesh.triangle_count for mesh in report.meshes] == [0, 0, 12]
    assert scene.intersect([0, 0, 5], [0, 0, -1]).geom_id == 2


def test_degenerate_and_repeated_triangles_are_accepted() -> None:
    extra = [[0, 0, 0], [1, 1, 2], [0, 1, 0]]
    scene = pyvocc.Scene()
    scene.add_mesh(VERTICES, np.concatenate([TRIANGLES, extra]))
    scene.add_mesh(VERTICES + 5, np.concatenate([TRIANGLES, TRIANGLES]))
    report = scene.build()
    assert report.meshes[0].degenerate_triangles == 3
    assert report.meshes[1].nonmanifold_edges > 0
    assert scene.occluded([0, 0, 9], [0, 0, -1])
    assert scene.occluded([5, 5, 9], [0, 0, -1])
    points = scene.intersect(VERTICES * 3, -VERTICES)
    assert (points.prim_id >= 0).all()
    assert (points.prim_id < 12).all()


def test_more_rows_than_can_be_held() -> None:
    scene = pyvocc.Scene()
    many = np.broadcast_to(np.int32([0, 1, 2]), (2**27 + 1, 3))
    with pytest.raises(pyvocc.LimitError):
        scene.add_mesh(VERTICES, many)
    vertices = np.broadcast_to(np.float32([0, 1, 2]), (2**31, 3))
    with pytest.raises(pyvocc.LimitError):
        scene.add_mesh(vertices, TRIANGLES)
    assert scene.build().triangle_count == 0


def test_names_and_flags_of_meshes() -> None:
    scene = pyvocc.Scene()
    refused(pyvocc.InvalidType, lambda: scene.add_mesh(VERTICES, TRIANGLES, name=3), "name")
    refused(pyvocc.InvalidType, lambda: scene.add_mesh(VERTICES, TRIANGLES, occluder=2), "occluder")
    scene.add_mesh(VERTICES, TRIANGLES, name="ä" * 100)
    scene.add_mesh(VERTICES + 5, TRIANGLES, name="a\0b")
    names = [mesh.name for mesh in scene.build().meshes]
    assert names[0].startswith("ä" * 31)
    assert len(names[0].rstrip("\N{REPLACEMENT CHARACTER}").encode()) <= 63
    assert names[1] == "a"


# ---- build -------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "values"),
    [
        ("threads", [0, -1, 257, 2**40]),
        ("traversal_cost", [0, -1, np.nan, np.inf]),
        ("intersection_cost", [-1, np.nan, np.inf]),
        ("empty_bonus", [-0.1, 1.1, np.nan]),
        ("max_leaf_size", [0, -1, 2**20 + 1, 2**40]),
        ("max_depth", [-1, 61, 2**40]),
        ("bad_refines", [-1, 17]),
    ],
)
def test_build_options_out_of_range(name: str, values: list[float]) -> None:
    scene = pyvocc.Scene()
    scene.add_mesh(VERTICES, TRIANGLES)
    for value in values:
        # The costs are floats: what is refused is the float32 next to what was given.
        exact = value if isinstance(value, int) else None
        refused(
            pyvocc.InvalidArgument,
            lambda value=value: scene.build(**{name: value}),
            name,
            value=exact,
        )
    assert scene.build().triangle_count == 12


@pytest.mark.parametrize("value", ["1", 1.5, [1], complex(1)])
def test_types_of_build_options(value: Any) -> None:
    scene = pyvocc.Scene()
    refused(pyvocc.InvalidType, lambda: scene.build(max_depth=value), "max_depth")
    refused(pyvocc.InvalidType, lambda: scene.build(threads=value), "threads")
    refused(pyvocc.InvalidType, lambda: scene.build(strict=value), "strict")
    refused(pyvocc.InvalidType, lambda: scene.build(progress=value), "progress")
    if value != 1.5:
        refused(pyvocc.InvalidType, lambda: scene.build(traversal_cost=value), "traversal_cost")


def test_unknown_options(cube: pyvocc.Scene) -> None:
    with pytest.raises(TypeError, match="leaf_size"):
        pyvocc.Scene().build(leaf_size=3)
    with pytest.raises(TypeError, match="orders"):
        cube.occluded([0, 0, 0], [0, 0, 1], orders="bfs")
    with pytest.raises(pyvocc.InvalidType, match="orders"):
        pyvocc.shadow_pass(cube, CAMERA, [LIGHT], (4, 4), orders="bfs")


# ---- rays --------------------------------------------------------------------


@pytest.mark.parametrize("method", ["intersect", "occluded"])
@pytest.mark.parametrize("shape", [(), (2,), (4, 1), (3, 4)])
def test_shapes_of_rays(cube: pyvocc.Scene, method: str, shape: tuple[int, ...]) -> None:
    ask = getattr(cube, method)
    bad, good = np.zeros(shape), np.zeros(3)
    for name, rays in (("org", (bad, good)), ("dir", (good, bad))):
        error = refused(pyvocc.InvalidArgument, lambda rays=rays: ask(*rays), name)
        assert f"shape (..., 3), got {shape}" in str(error)


@pytest.mark.parametrize("method", ["intersect", "occluded"])
def test_shapes_that_do_not_broadcast(cube: pyvocc.Scene, method: str) -> None:
    ask = getattr(cube, method)
    rays = {"org": np.zeros((4, 5, 3)), "dir": np.zeros((5, 3)), "tmin": 0, "tmax": np.ones((4, 1))}
    assert getattr(ask(**rays), "shape", (4, 5)) == (4, 5)
    for name, bad in (("dir", np.zeros((4, 3))), ("tmin", np.zeros(3)), ("tmax", np.ones((3, 1)))):
        error = refused(
            pyvocc.InvalidArgument, lambda name=name, bad=bad: ask(**{**rays, name: bad}), name
        )
        assert "(4, 5)" in str(error)


@pytest.mark.parametrize("dtype", [complex, object, "U5", bool])
def test_types_of_rays(cube: pyvocc.Scene, dtype: Any) -> None:
    bad, good = np.zeros(3, dtype), np.zeros(3)
    refused(pyvocc.InvalidType, lambda: cube.occluded(bad, good), "org")
    refused(pyvocc.InvalidType, lambda: cube.intersect(good, bad), "dir")
    refused(pyvocc.InvalidType, lambda: cube.occluded(good, good, bad[:1]), "tmin")
    refused(pyvocc.InvalidType, lambda: cube.intersect(good, good, 0, bad[:1]), "tmax")
    refused(pyvocc.InvalidType, lambda: cube.region(bad), "points")


@pytest.mark.parametrize(
    ("name", "values"),
    [
        ("cache", [-1, 65, 2**31]),
        ("deferment", [-1, 513, -(2**40)]),
        ("threads", [0, -3, 257]),
        ("order", ["", "fast", "QDBFS"]),
        ("isa", ["avx", "SSE2"]),
        ("cache_policy", ["", "oldest"]),
        ("entry_triangles", [-1, 65]),
        ("voxels", [-1, 1025]),
    ],
)
def test_query_options_out_of_range(cube: pyvocc.Scene, name: str, values: list[Any]) -> None:
    for value in values:
        options = {name: value}
        for ask in (
            lambda options=options: cube.occluded(np.zeros((9, 3)), [0, 0, 1], **options),
            lambda options=options: cube.light_visibility([0, 0, 2], [0, 0, 1], [LIGHT], **options),
            lambda options=options: pyvocc.shadow_pass(cube, CAMERA, [LIGHT], (4, 4), **options),
        ):
            error = refused(pyvocc.InvalidArgument, ask, name, value=value)
            assert str(value) in str(error)


def test_types_of_query_options(cube: pyvocc.Scene) -> None:
    for name, values in {
        "cache": ["8", 8.0, None],
        "deferment": ["8", 8.0, None],
        "threads": ["2", 2.0],
        "order": [1, None],
        "isa": [1, None],
        "occluders": ["yes", 2, None],
        "packets": ["yes", 2, None],
        "cache_policy": [0, None],
        "fusion": ["yes", 2, None],
        "triangle_cache": ["yes", 2, None],
        "entry_points": ["yes", 2],
        "entry_triangles": ["8", 8.0, None],
        "voxels": ["8", 8.0, None],
        "ordre": ["auto"],
        "progress": [3],
        "stats": [{}, 3],
        "out": [[True], "x", True],
    }.items():
        for value in values:
            options = {name: value}
            error = refused(
                pyvocc.InvalidType,
                lambda options=options: cube.occluded([0, 0, 0], [0, 0, 1], **options),
                name,
            )
            assert isinstance(error, TypeError)


def test_orders_that_the_library_does_not_have(cube: pyvocc.Scene) -> None:
    for order in ("extended", "bfs"):
        try:
            assert cube.occluded([0, 0, 5], [0, 0, -1], order=order)
        except pyvocc.UnsupportedError as error:
            assert "order" in str(error)


def test_out_arrays(cube: pyvocc.Scene) -> None:
    org, dir = np.zeros((4, 3)), [0, 0, 1]

    def ask(out: Any) -> Any:
        return lambda: cube.occluded(org, dir, out=out)

    error = refused(pyvocc.InvalidArgument, ask(np.zeros(5, bool)), "out")
    assert "(4,)" in str(error)
    assert "(5,)" in str(error)
    refused(pyvocc.InvalidType, ask(np.zeros(4, np.int8)), "out")
    refused(pyvocc.InvalidArgument, ask(np.zeros(8, bool)[::2]), "out")
    fixed = np.zeros(4, bool)
    fixed.flags.writeable = False
    refused(pyvocc.InvalidArgument, ask(fixed), "out")
    wrong = np.zeros((1, 4), np.int16)
    refused(
        pyvocc.InvalidType,
        lambda: cube.light_visibility(org, dir, [LIGHT], out=wrong),
        "out",
    )


# ---- lights, cameras, passes -------------------------------------------------


@pytest.mark.parametrize("samples", [0, -1, 65535, 2**40])
def test_samples_out_of_range(cube: pyvocc.Scene, samples: int) -> None:
    for ask in (
        lambda: cube.light_visibility([0, 0, 2], [0, 0, 1], [LIGHT], samples),
        lambda: pyvocc.shadow_pass(cube, CAMERA, [LIGHT], (4, 4), samples),
    ):
        error = refused(pyvocc.InvalidArgument, ask, "samples", value=samples)
        assert str(samples) in str(error)


def test_point_ids(cube: pyvocc.Scene) -> None:
    points, normals = np.zeros((2, 3, 3)), [0, 0, 1]

    def ask(ids: Any) -> Any:
        return lambda: cube.light_visibility(points, normals, [LIGHT], 4, ids)

    refused(pyvocc.InvalidArgument, ask([[0, 1, 2], [3, -4, 5]]), "point_ids", 4, -4)
    refused(pyvocc.InvalidArgument, ask([2**32, 1, 2]), "point_ids", 0, 2**32)
    refused(pyvocc.InvalidArgument, ask(np.arange(4)), "point_ids")
    refused(pyvocc.InvalidType, ask([0.0, 1, 2]), "point_ids")


def test_lights_that_are_none(cube: pyvocc.Scene) -> None:
    def ask(lights: Any) -> Any:
        return lambda: cube.light_visibility([0, 0, 2], [0, 0, 1], lights)

    refused(pyvocc.InvalidType, ask([LIGHT, "sun"]), "lights", 1)
    refused(pyvocc.InvalidType, ask(LIGHT), "lights")
    refused(pyvocc.InvalidType, ask(None), "lights")


@pytest.mark.parametrize("name", ["corner", "edge_u", "edge_v"])
def test_values_of_lights(name: str) -> None:
    good = {"corner": (0, 3, 0), "edge_u": (1, 0, 0), "edge_v": (0, 0, 1)}

    def make(value: Any) -> Any:
        return lambda: pyvocc.RectLight(**{**good, name: value})

    refused(pyvocc.InvalidArgument, make((0, np.nan, 0)), name, 1, np.nan)
    refused(pyvocc.InvalidArgument, make((0, 0, -np.inf)), name, 2, -np.inf)
    refused(pyvocc.InvalidArgument, make((0, 0)), name)
    refused(pyvocc.InvalidType, make(3), name)
    refused(pyvocc.InvalidType, make("abc"), name)
    refused(pyvocc.InvalidType, make((0, "1", 0)), name)


GOOD: dict[type, dict[str, Any]] = {
    pyvocc.RectLight: {"corner": (0, 3, 0), "edge_u": (1, 0, 0), "edge_v": (0, 0, 1)},
    pyvocc.DiskLight: {"center": (0, 3, 0), "axis_u": (1, 0, 0), "axis_v": (0, 0, 1)},
    pyvocc.SphereLight: {"center": (0, 3, 0), "radius": 1},
    pyvocc.PointLight: {"center": (0, 3, 0), "radius": 1},
    pyvocc.SpotLight: {"center": (0, 3, 0), "direction": (0, -1, 0), "angle": 1, "radius": 1},
    pyvocc.SunLight: {"direction": (0, 1, 0), "angle": 1},
}
ANGLES = {pyvocc.SpotLight: 2 * math.pi, pyvocc.SunLight: math.pi}


@pytest.mark.parametrize("kind", GOOD, ids=lambda kind: kind.__name__)
def test_values_of_all_lights(kind: type) -> None:
    def make(**values: Any) -> Any:
        return lambda: kind(**{**GOOD[kind], **values})

    make()()
    for name, good in GOOD[kind].items():
        if isinstance(good, tuple):
            refused(pyvocc.InvalidArgument, make(**{name: (0, np.nan, 0)}), name, 1, np.nan)
            refused(pyvocc.InvalidArgument, make(**{name: (0, 0, -np.inf)}), name, 2, -np.inf)
            refused(pyvocc.InvalidArgument, make(**{name: (0, 0)}), name)
            refused(pyvocc.InvalidType, make(**{name: 3}), name)
            refused(pyvocc.InvalidType, make(**{name: "abc"}), name)
            refused(pyvocc.InvalidType, make(**{name: (0, "1", 0)}), name)
        else:
            for value in (-1e-9, np.inf, np.nan):
                refused(pyvocc.InvalidArgument, make(**{name: value}), name, value=value)
            refused(pyvocc.InvalidType, make(**{name: "1"}), name)
            refused(pyvocc.InvalidType, make(**{name: (1, 1)}), name)
    if "direction" in GOOD[kind]:
        refused(pyvocc.InvalidArgument, make(direction=(0, 0, 0)), "direction")
    if kind in ANGLES:
        most = ANGLES[kind]
        refused(pyvocc.InvalidArgument, make(angle=most * 1.000001), "angle", value=most * 1.000001)
        make(angle=most)()
    if hasattr(kind, "two_sided"):
        refused(pyvocc.InvalidType, make(two_sided="yes"), "two_sided")
        refused(pyvocc.InvalidType, make(two_sided=None), "two_sided")
    with pytest.raises(dataclasses.FrozenInstanceError):
        make()().radius = 3


@pytest.mark.parametrize("kind", GOOD, ids=lambda kind: kind.__name__)
def test_values_of_lights_that_float32_does_not_hold(cube: pyvocc.Scene, kind: type) -> None:
    """Found by the library, told by the field's name in Python, for each way to ask."""
    good = pyvocc.PointLight((0, 3, 0))
    for name, value in GOOD[kind].items():
        if name in ("direction", "angle"):
            continue
        huge = (0, -1e39, 0) if isinstance(value, tuple) else 1e39
        bad = kind(**{**GOOD[kind], name: huge})
        for ask in (
            lambda bad=bad: cube.light_visibility([0, 0, 2], [0, 0, 1], [good, good, bad]),
            lambda bad=bad: cube.light_irradiance([0, 0, 2], [0, 0, 1], [good, good, bad]),
            lambda bad=bad: pyvocc.shadow_pass(cube, CAMERA, [good, good, bad], (4, 4)),
        ):
            sign = 1 if name == "radius" else -1
            error = refused(pyvocc.InvalidArgument, ask, "lights", 2, sign * 1e39)
            assert str(error).startswith(f"lights[2].{name} is {'-' * (sign < 0)}1e+39: it has to ")
    # Any direction is as good as any other of its way.
    if "direction" in GOOD[kind]:
        cube.light_visibility(
            [0, 0, 2], [0, 0, 1], [kind(**{**GOOD[kind], "direction": (1e308,) * 3})]
        )


def test_arguments_of_ambient_occlusion(cube: pyvocc.Scene) -> None:
    def ask(*args: Any, **options: Any) -> Any:
        return lambda: cube.ambient_occlusion([[0, 0, 2.0]] * 4, [0, 0, 1], *args, **options)

    for value in (0, -1, -np.inf, 1e-50):
        refused(pyvocc.InvalidArgument, ask(value), "distance", value=value)
    assert "nan" in str(refused(pyvocc.InvalidArgument, ask(np.nan), "distance"))
    refused(pyvocc.InvalidType, ask("far"), "distance")
    for value in (0, -1, 65535, 2**40):
        refused(pyvocc.InvalidArgument, ask(samples=value), "samples", value=value)
    refused(pyvocc.InvalidType, ask(samples=2.5), "samples")
    refused(pyvocc.InvalidArgument, ask(sampler="random"), "sampler", value="random")
    refused(pyvocc.InvalidArgument, ask(point_ids=[0, 1, 2, -3]), "point_ids", 3, -3)
    refused(pyvocc.InvalidArgument, ask(out=np.zeros(3, np.uint16)), "out")
    refused(pyvocc.InvalidType, ask(horizon="sample"), "horizon")


def test_arguments_of_shading_points(cube: pyvocc.Scene) -> None:
    def ask(scene: Any = cube, org: Any = (0, 0, 5), dir: Any = (0, 0, -1), **more: Any) -> Any:
        return lambda: pyvocc.shading_points(scene, org, dir, **more)

    refused(pyvocc.InvalidType, ask(scene=3), "scene")
    refused(pyvocc.InvalidType, ask(org="here"), "org")
    refused(pyvocc.InvalidArgument, ask(dir=(0, 0)), "dir")
    refused(pyvocc.InvalidArgument, ask(org=np.zeros((3, 3)), dir=np.zeros((4, 3))), "dir")
    for value in (-1, np.nan, np.inf):
        refused(pyvocc.InvalidArgument, ask(offset=value), "offset", value=value)
    with pytest.raises(pyvocc.StateError):
        ask(scene=pyvocc.Scene())()


@pytest.mark.parametrize("name", ["sampler", "horizon"])
def test_names_of_the_sampling(cube: pyvocc.Scene, name: str) -> None:
    for value, kind in (("random", pyvocc.InvalidArgument), (3, pyvocc.InvalidType)):
        how: Any = {name: value}
        for ask in (
            lambda how=how: cube.light_visibility([0, 0, 2], [0, 0, 1], [LIGHT], **how),
            lambda how=how: cube.light_irradiance([0, 0, 2], [0, 0, 1], [LIGHT], **how),
            lambda how=how: pyvocc.shadow_pass(cube, CAMERA, [LIGHT], (4, 4), **how),
        ):
            refused(kind, ask, name)


def test_bits_of_blocked_samples(cube: pyvocc.Scene) -> None:
    def ask(bits: Any, samples: int = 20) -> Any:
        return lambda: cube.light_visibility(
            [[0, 0, 2]] * 5, [0, 0, 1], [LIGHT], samples, blocked=bits
        )

    ask(np.zeros((1, 5, 3), np.uint8))()
    for shape in ((1, 5, 2), (1, 5, 4), (5, 3), (1, 15)):
        refused(pyvocc.InvalidArgument, ask(np.zeros(shape, np.uint8)), "blocked")
    refused(pyvocc.InvalidType, ask(np.zeros((1, 5, 3), np.int8)), "blocked")
    refused(pyvocc.InvalidArgument, ask(np.zeros((1, 5, 1), np.uint8), 0), "samples")


def test_values_of_cameras() -> None:
    def make(*args: Any, **options: Any) -> Any:
        return lambda: pyvocc.PerspectiveCamera(*args, **options)

    eye, target = (0, 0, 5), (0, 0, 0)
    refused(pyvocc.InvalidArgument, make((0, np.nan, 0), target), "eye", 1, np.nan)
    refused(pyvocc.InvalidArgument, make(eye, eye), "target")
    refused(pyvocc.InvalidArgument, make(eye, target, (0, 0, 1)), "up")
    refused(pyvocc.InvalidArgument, make(eye, target, (0, 0, 0)), "up")
    for value in (0, -1, np.inf, np.nan):
        refused(
            pyvocc.InvalidArgument,
            make(eye, target, tan_half_fov=value),
            "tan_half_fov",
            value=value,
        )
    for value in (0, 180, -5, np.nan):
        refused(pyvocc.InvalidArgument, make(eye, target, fov=value), "fov", value=value)
    refused(pyvocc.InvalidArgument, make(eye, target, fov=30, tan_half_fov=0.3), "fov")
    refused(pyvocc.InvalidType, make(eye, target, fov="wide"), "fov")


def test_arguments_of_the_pass(cube: pyvocc.Scene) -> None:
    def ask(scene: Any = cube, camera: Any = CAMERA, lights: Any = (LIGHT,), **more: Any) -> Any:
        return lambda: pyvocc.shadow_pass(scene, camera, lights, **{"size": (4, 4), **more})

    refused(pyvocc.InvalidType, ask(scene=3), "scene")
    refused(pyvocc.InvalidType, ask(camera=3), "camera")
    refused(pyvocc.InvalidType, ask(lights=[3]), "lights", 0)
    refused(pyvocc.InvalidArgument, ask(size=(0, 4)), "size[0]", value=0)
    refused(pyvocc.InvalidArgument, ask(size=(4, -1)), "size[1]", value=-1)
    refused(pyvocc.InvalidArgument, ask(size=(2**20, 2**20)), "size", value=2**40)
    refused(pyvocc.InvalidType, ask(size=4), "size")
    refused(pyvocc.InvalidType, ask(size=(4.5, 4)), "size[0]")
    refused(pyvocc.InvalidArgument, ask(offset=-1), "offset", value=-1)
    refused(pyvocc.InvalidArgument, ask(offset=np.nan), "offset", value=np.nan)
    refused(pyvocc.InvalidType, ask(offset="far"), "offset")
    refused(pyvocc.InvalidType, ask(progress=3), "progress")
    refused(pyvocc.InvalidType, ask(stats=3), "stats")


# ---- inspection --------------------------------------------------------------


def test_ids_that_do_not_exist(cube: pyvocc.Scene) -> None:
    for geom_id in (-1, 1, 2**31 - 1):
        refused(
            pyvocc.InvalidArgument,
            lambda geom_id=geom_id: cube.open_edges(geom_id),
            "geom_id",
            value=geom_id,
        )
        refused(
            pyvocc.InvalidArgument,
            lambda geom_id=geom_id: cube.corners([0, geom_id], 0),
            "geom_id",
            1,
            geom_id,
        )
    refused(pyvocc.InvalidArgument, lambda: cube.corners(0, [[3, 12]]), "prim_id", 1, 12)
    refused(pyvocc.InvalidType, lambda: cube.corners(0, 0.5), "prim_id")
    refused(pyvocc.InvalidType, lambda: cube.open_edges("0"), "geom_id")
    refused(pyvocc.InvalidArgument, lambda: cube.open_edges(2**31), "geom_id", value=2**31)
    for region in (-1, 2, 2**31 - 1):
        refused(
            pyvocc.InvalidArgument,
            lambda region=region: cube.region_solids(region),
            "region",
            value=region,
        )
    total = cube.report.tree.reference_count
    assert len(cube.leaf_triangles(total, 0)) == 0
    for first, count in ((total, 1), (0, total + 1), (2**62, 1)):
        with pytest.raises(pyvocc.InvalidArgument):
            cube.leaf_triangles(first, count)
    with pytest.raises(pyvocc.InvalidArgument):
        cube.leaf_triangles(-1, 1)


# ---- the exceptions ----------------------------------------------------------


def test_every_exception_is_an_error_and_what_python_has_for_it() -> None:
    for kind, base in (
        (pyvocc.InvalidArgument, ValueError),
        (pyvocc.InvalidType, TypeError),
        (pyvocc.OutOfMemory, MemoryError),
        (pyvocc.StateError, RuntimeError),
        (pyvocc.OpenMeshError, ValueError),
        (pyvocc.LimitError, ValueError),
        (pyvocc.UnsupportedError, RuntimeError),
        (pyvocc.ThreadError, RuntimeError),
        (pyvocc.Cancelled, Exception),
    ):
        assert issubclass(kind, pyvocc.Error)
        assert issubclass(kind, base)


def test_every_status_has_an_exception() -> None:
    from pyvocc import _ffi

    statuses = _ffi.ffi.typeof("vocc_status").relements
    assert {name for name in statuses if name != "VOCC_OK"} == {
        f"VOCC_ERROR_{name}" for name in errors.EXCEPTIONS
    }


def test_errors_can_be_pickled() -> None:
    error = pyvocc.InvalidArgument("no", argument="vertices", index=3, value=1e39)
    copy = pickle.loads(pickle.dumps(error))
    assert type(copy) is pyvocc.InvalidArgument
    assert (str(copy), copy.argument, copy.index, copy.value) == ("no", "vertices", 3, 1e39)


def test_none_stands_for_what_a_status_does_not_tell() -> None:
    error = errors.from_status("THREAD", "no thread", "", -1, float("nan"))
    assert (error.argument, error.index, error.value) == (None, None, None)
    error = errors.from_status("INVALID_ARGUMENT", "no", "vertices", 2, float("nan"))
    assert error.index == 2
    assert error.value != error.value
