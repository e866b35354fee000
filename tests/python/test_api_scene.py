"""The life of a scene: adding, building, its report, closing."""

from __future__ import annotations

import copy
import gc
import inspect
import pickle
import re
import threading
import weakref
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import shapes
from conftest import RandomRays

import pyvocc
from pyvocc import _ffi

Ask = Callable[[pyvocc.Scene], Any]


def test_geom_ids_count_up() -> None:
    scene = pyvocc.Scene()
    assert [scene.add_mesh(*shapes.cube((3 * i, 0, 0))) for i in range(3)] == [0, 1, 2]


def test_the_report_is_returned_and_kept(cube: pyvocc.Scene) -> None:
    scene = pyvocc.Scene(threads=1)
    scene.add_mesh(*shapes.cube(), name="cube")
    report = scene.build()
    assert report is scene.report
    assert report.triangle_count == 12
    assert report.vertex_count == 8
    assert report.component_count == report.closed_count == 1
    assert report.lower == (-1, -1, -1)
    assert report.upper == (1, 1, 1)
    assert report.origin == (0, 0, 0)
    assert report.threads == 1
    assert report.closed
    (mesh,) = report.meshes
    assert (mesh.geom_id, mesh.name, mesh.occluder, mesh.closed) == (0, "cube", True, True)
    assert (mesh.triangle_count, mesh.vertex_count, mesh.welded_vertices) == (12, 8, 8)
    assert (mesh.boundary_edges, mesh.nonmanifold_edges, mesh.inconsistent_edges) == (0, 0, 0)
    assert mesh.volume == pytest.approx(8)
    (component,) = mesh.components
    assert component == pyvocc.ComponentReport(0, 0, 12, 0, True, True, 0, 0, 0, mesh.volume)


def test_the_tree_in_the_report_agrees_with_its_leaves(torus: pyvocc.Scene) -> None:
    tree, leaves = torus.report.tree, torus.leaves()
    for label, count in (
        (pyvocc.BOUNDARY, tree.boundary_leaves),
        (pyvocc.CLEAR, tree.clear_leaves),
        (pyvocc.OPAQUE, tree.opaque_leaves),
        (pyvocc.UNKNOWN, tree.unknown_leaves),
    ):
        assert (leaves["label"] == label).sum() == count
    assert len(leaves) == tree.leaf_count
    assert tree.node_count == 2 * tree.leaf_count - 1
    assert leaves["count"].sum() == tree.reference_count
    opaque = leaves[leaves["label"] == pyvocc.OPAQUE]
    size = (opaque["upper"] - opaque["lower"]).astype(float)
    volume = np.prod(np.subtract(torus.report.upper, torus.report.lower))
    assert size.prod(axis=1).sum() / volume == pytest.approx(tree.opaque_volume_fraction)
    x, y, z = size.T
    assert (2 * (x * y + y * z + z * x)).sum() == pytest.approx(tree.occluder_area)
    assert 0.3 < tree.opaque_volume_fraction < 1
    assert tree.auto_order == "opaque_first"
    assert tree.region_count == 2


def test_leaf_triangles_overlap_their_leaf(torus: pyvocc.Scene) -> None:
    leaves = torus.leaves()
    for leaf in leaves[leaves["label"] == pyvocc.BOUNDARY][:50]:
        ids = torus.leaf_triangles(leaf["first"], leaf["count"])
        assert ids.shape == (leaf["count"], 2)
        corners = torus.corners(ids[:, 0], ids[:, 1])
        assert (corners.min(axis=1) <= leaf["upper"]).all()
        assert (corners.max(axis=1) >= leaf["lower"]).all()


def test_the_report_prints_as_a_table() -> None:
    scene = pyvocc.Scene()
    vertices, triangles = shapes.cube()
    scene.add_mesh(vertices, triangles, name="whole")
    scene.add_mesh(vertices + 5, triangles[:-1], name="holed")
    scene.add_mesh(vertices - 5, triangles, name="plain", occluder=False)
    text = str(scene.build())
    lines = {
        line.split()[1]: line for line in text.splitlines() if line[:1] in "012" and "  " in line
    }
    assert lines["whole"].split()[2:] == ["12", "closed", "0", "0", "0", "8"]
    assert lines["holed"].split()[2:7] == ["11", "open", "3", "0", "0"]
    assert "closed, no occluder" in lines["plain"]
    for words in ("nodes", "boundary", "opaque", "regions", "bytes a triangle", "auto order"):
        assert words in text


def test_the_table_names_open_components_first_and_counts_the_rest() -> None:
    vertices, triangles = shapes.cube()
    parts = [triangles + 8 * i for i in range(20)]
    parts[17] = parts[17][:-1]
    scene = pyvocc.Scene()
    scene.add_mesh(
        np.concatenate([vertices + (4 * i, 0, 0) for i in range(20)]), np.concatenate(parts)
    )
    report = scene.build()
    assert [part.closed for part in report.meshes[0].components].count(False) == 1
    assert not report.meshes[0].closed
    assert not report.closed
    lines = report.mesh_table().splitlines()
    assert "component 17" in lines[2]
    assert "open" in lines[2]
    assert lines[-1] == "  and 12 more, 0 of them open"


def test_an_empty_scene_can_be_built_and_asked() -> None:
    with pyvocc.Scene() as scene:
        report = scene.build()
        assert report.triangle_count == 0
        assert report.bytes_per_triangle == 0
        assert str(report)
        assert not scene.occluded([0, 0, 0], [0, 0, 1])
        assert scene.intersect([0, 0, 0], [0, 0, 1]).prim_id == -1
        assert scene.region([0, 0, 0]) == 0
        assert scene.closed_extent == 0


def test_open_edges_say_where() -> None:
    vertices, triangles = shapes.cube()
    scene = pyvocc.Scene()
    scene.add_mesh(vertices, triangles[1:])
    scene.build()
    edges = scene.open_edges(0)
    assert edges.shape == (3, 2)
    assert (np.diff(edges[:, 0]) >= 0).all()
    missing = {
        frozenset(pair) for pair in zip(triangles[0], np.roll(triangles[0], -1), strict=True)
    }
    found = {
        frozenset((triangles[1:][prim][edge], triangles[1:][prim][(edge + 1) % 3]))
        for prim, edge in edges
    }
    assert found == missing


def test_region_solids_name_mesh_component_and_winding() -> None:
    scene = pyvocc.Scene()
    scene.add_mesh(*shapes.cube(half=2))
    scene.add_mesh(*shapes.cube(half=1))
    scene.build()
    outer, both = scene.region([[1.5, 0, 0], [0.5, 0, 0]])
    assert scene.region_solids(int(outer)) == (pyvocc.Solid(0, 0, 1),)
    assert sorted(scene.region_solids(int(both))) == [pyvocc.Solid(0, 0, 1), pyvocc.Solid(1, 1, 1)]


def test_strict_refuses_an_open_mesh_and_leaves_the_scene_as_it_was() -> None:
    vertices, triangles = shapes.cube()
    scene = pyvocc.Scene()
    scene.add_mesh(vertices, triangles)
    scene.add_mesh(vertices + 5, triangles[1:])
    with pytest.raises(pyvocc.OpenMeshError) as caught:
        scene.build(strict=True)
    assert caught.value.index == 1
    assert not scene.built
    assert scene.add_mesh(vertices - 5, triangles) == 2
    assert len(scene.build().meshes) == 3


def test_strict_exempts_meshes_without_occluders() -> None:
    vertices, triangles = shapes.cube()
    scene = pyvocc.Scene()
    scene.add_mesh(vertices, triangles[1:], occluder=False)
    assert not scene.build(strict=True).meshes[0].closed


def test_build_options_reach_the_library() -> None:
    def leaves(**options: float) -> int:
        scene = pyvocc.Scene(threads=1)
        scene.add_mesh(*shapes.torus(64, 32))
        return scene.build(**options).tree.boundary_leaves

    default = leaves()
    assert leaves(traversal_cost=50.0) < default
    assert leaves(intersection_cost=5.0) > default
    assert leaves(max_depth=3) <= 8
    assert leaves(max_depth=3) < leaves(max_depth=6) < default


def test_the_docstring_tells_the_defaults_of_the_library() -> None:
    options = _ffi.ffi.new("vocc_build_options *")
    _ffi.lib.vocc_build_options_init(options)
    text = inspect.getdoc(pyvocc.Scene.build) or ""
    for name in (
        *("traversal_cost", "intersection_cost", "empty_bonus"),
        *("max_leaf_size", "max_depth", "bad_refines"),
    ):
        described = re.search(rf"\b{name}:[^:]*?default ([\d.]*\d)", text)
        assert described, name
        assert float(described.group(1)) == pytest.approx(getattr(options, name)), name


def test_the_tree_does_not_depend_on_threads() -> None:
    def leaves(threads: int) -> bytes:
        scene = pyvocc.Scene()
        scene.add_mesh(*shapes.torus(200, 100))
        report = scene.build(threads=threads)
        assert report.threads == threads
        return scene.leaves().tobytes()

    assert leaves(1) == leaves(2) == leaves(3)


def test_added_arrays_are_copied() -> None:
    vertices, triangles = shapes.cube()
    scene = pyvocc.Scene()
    scene.add_mesh(vertices, triangles)
    vertices += 100
    triangles[:] = 0
    scene.build()
    assert scene.occluded([0, 0, 5], [0, 0, -1])
    assert np.abs(scene.corners(0, np.arange(12))).max() == 1


@pytest.mark.parametrize(
    "dtype", [np.int8, np.uint16, np.int32, np.uint32, np.int64, np.uint64, ">i4"]
)
def test_any_integer_type_makes_triangles(dtype: str) -> None:
    vertices, triangles = shapes.cube()
    scene = pyvocc.Scene()
    scene.add_mesh(vertices.tolist(), triangles.astype(dtype))
    assert scene.build().meshes[0].closed


def test_strided_meshes_are_read_where_they_are() -> None:
    vertices, triangles = shapes.cube()
    wide = np.full((8, 5), np.nan, np.float32)
    wide[:, 1:4] = vertices
    scene = pyvocc.Scene()
    scene.add_mesh(wide[:, 1:4], triangles[::-1])
    scene.add_mesh(np.asfortranarray(vertices + 5), np.asfortranarray(triangles))
    assert all(mesh.volume == pytest.approx(8) for mesh in scene.build().meshes)


def test_corners_are_what_is_traced(torus: pyvocc.Scene) -> None:
    vertices, triangles = shapes.torus(128, 50)
    prim_id = np.arange(len(triangles)).reshape(2, -1)
    corners = torus.corners(0, prim_id)
    assert corners.shape == (2, len(triangles) // 2, 3, 3)
    assert corners.dtype == np.float32
    local = (vertices - torus.origin).astype(np.float32)
    assert (corners.reshape(-1, 3, 3) == local[triangles]).all()


def test_corners_of_many_meshes() -> None:
    scene = pyvocc.Scene()
    for index in range(4):
        scene.add_mesh(*shapes.cube((10 * index, 0, 0)))
    scene.build()
    assert scene.corners([0, 3, 1], [5, 5, 5])[:, :, 0].round(-1)[:, 0].tolist() == [0, 30, 10]


def test_closed_extent_leaves_open_meshes_out() -> None:
    ground = np.array([[-16, 0, -16], [16, 0, -16], [16, 0, 16], [-16, 0, 16]], float)
    quad = [[0, 2, 1], [0, 3, 2]]
    scene = pyvocc.Scene()
    scene.add_mesh(*shapes.box([0, 0, 0], [1, 3, 2]))
    scene.add_mesh(ground, quad)
    scene.build()
    assert scene.closed_extent == 3
    scene = pyvocc.Scene()
    scene.add_mesh(ground, quad)
    scene.build()
    assert scene.closed_extent == 32


def test_closing() -> None:
    with pyvocc.Scene() as scene:
        scene.add_mesh(*shapes.cube())
        assert repr(scene) == "<pyvocc.Scene: not built>"
        scene.build()
        assert repr(scene) == "<pyvocc.Scene: built>"
        assert not scene.closed
    assert scene.closed
    assert repr(scene) == "<pyvocc.Scene: closed>"
    assert scene.report.triangle_count == 12
    scene.close()


@pytest.mark.parametrize(
    "call",
    [
        lambda scene: scene.add_mesh(*shapes.cube()),
        lambda scene: scene.build(),
        lambda scene: scene.intersect([0, 0, 0], [0, 0, 1]),
        lambda scene: scene.occluded([0, 0, 0], [0, 0, 1]),
        lambda scene: scene.region([0, 0, 0]),
        lambda scene: scene.light_visibility([0, 0, 0], [0, 0, 1], []),
        lambda scene: scene.open_edges(0),
        lambda scene: scene.leaves(),
        lambda scene: scene.classify_by_rays(),
        lambda scene: scene.leaf_triangles(0, 1),
        lambda scene: scene.region_solids(1),
        lambda scene: scene.corners(0, 0),
        lambda scene: scene.closed_extent,
        lambda scene: scene.__enter__(),
        lambda scene: pyvocc.shadow_pass(scene, pyvocc.PerspectiveCamera((0, 0, 5), (0, 0, 0)), []),
    ],
)
@pytest.mark.parametrize("built", [False, True])
def test_use_after_close_says_so(call: Ask, built: bool) -> None:
    scene = pyvocc.Scene()
    scene.add_mesh(*shapes.cube())
    if built:
        scene.build()
    scene.close()
    with pytest.raises(pyvocc.StateError, match="closed"):
        call(scene)


@pytest.mark.parametrize(
    "call",
    [
        lambda scene: scene.intersect([0, 0, 0], [0, 0, 1]),
        lambda scene: scene.occluded([0, 0, 0], [0, 0, 1]),
        lambda scene: scene.region([0, 0, 0]),
        lambda scene: scene.light_visibility([0, 0, 0], [0, 0, 1], []),
        lambda scene: scene.leaves(),
        lambda scene: scene.classify_by_rays(),
        lambda scene: scene.region_solids(1),
        lambda scene: scene.corners(0, 0),
        lambda scene: scene.report,
        lambda scene: scene.origin,
    ],
)
def test_a_query_before_the_build_says_so(call: Ask) -> None:
    scene = pyvocc.Scene()
    scene.add_mesh(*shapes.cube())
    with pytest.raises(pyvocc.StateError, match="buil"):
        call(scene)


def test_a_built_scene_is_frozen(cube: pyvocc.Scene) -> None:
    with pytest.raises(pyvocc.StateError, match="buil"):
        cube.add_mesh(*shapes.cube())
    with pytest.raises(pyvocc.StateError, match="buil"):
        cube.build()
    assert len(cube.report.meshes) == 1


def test_a_scene_that_is_being_built_takes_no_other_call() -> None:
    scene = pyvocc.Scene(threads=1)
    scene.add_mesh(*shapes.torus(400, 200))
    seen: list[str] = []

    def meddle(fraction: float) -> None:
        if not seen:
            with pytest.raises(pyvocc.StateError, match="one at a time") as caught:
                scene.add_mesh(*shapes.cube())
            seen.append(str(caught.value))

    scene.build(meddle)
    assert seen
    assert len(scene.report.meshes) == 1


def test_close_during_a_call_waits_for_its_end() -> None:
    scene = pyvocc.Scene(threads=2)
    scene.add_mesh(*shapes.torus(64, 32))
    scene.build()
    org = np.broadcast_to(np.float32([0, 0, 0]), (3_000_000, 3))
    dir = np.broadcast_to(np.float32([1, 0, 0.1]), (3_000_000, 3))
    occluded: list[bool] = []

    def ask() -> None:
        occluded.append(bool(scene.occluded(org, dir, progress=lambda _: scene.close()).all()))

    thread = threading.Thread(target=ask)
    thread.start()
    thread.join()
    assert scene.closed
    assert occluded == [True]


def test_many_threads_may_ask_one_scene(torus: pyvocc.Scene, random_rays: RandomRays) -> None:
    org, dir = random_rays(20_000)
    expected = torus.occluded(org, dir)
    results: list[bool] = []

    def ask() -> None:
        results.extend((torus.occluded(org, dir, threads=2) == expected).all() for _ in range(5))

    threads = [threading.Thread(target=ask) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert results == [True] * 20


def test_a_dropped_scene_is_freed() -> None:
    scene = pyvocc.Scene()
    scene.add_mesh(*shapes.cube())
    scene.build()
    handle = weakref.ref(scene._scene)
    del scene
    gc.collect()
    assert handle() is None


@pytest.mark.parametrize("copier", [pickle.dumps, copy.copy, copy.deepcopy])
def test_a_scene_refuses_to_be_pickled_or_copied(
    copier: Callable[[Any], Any], cube: pyvocc.Scene
) -> None:
    with pytest.raises(TypeError, match="a Scene cannot be pickled or copied"):
        copier(cube)


def test_values_can_be_pickled(cube: pyvocc.Scene) -> None:
    light = pyvocc.RectLight((0, 3, 0), (1, 0, 0), (0, 0, 1))
    camera = pyvocc.PerspectiveCamera((0, 0, 5), (0, 0, 0), fov=30)
    for value in (cube.report, light, camera, pyvocc.Stats(rays=3)):
        assert pickle.loads(pickle.dumps(value)) == value


@pytest.mark.parametrize("threads", [0, -1, 257])
def test_threads_out_of_range(threads: int) -> None:
    with pytest.raises(pyvocc.InvalidArgument, match="threads must be from 1 to 256"):
        pyvocc.Scene(threads=threads)
