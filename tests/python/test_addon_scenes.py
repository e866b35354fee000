"""Built scenes are kept, known by their content, and made of what casts or receives."""

from __future__ import annotations

import gc
from dataclasses import replace
from typing import Any

import addon  # noqa: F401 - first: it makes the next importable
import numpy as np
import pytest
import shapes
from numpy.testing import assert_array_equal
from numpy.typing import NDArray

import pyvocc
from blender_addon.data import Part
from blender_addon.scenes import Built, SceneCache
from blender_addon.transform import moved, origin_for, to_world
from pyvocc.shapes import geodesic_sphere


def read_only(array: Any, dtype: Any) -> NDArray[Any]:
    result = np.array(array, dtype)
    result.flags.writeable = False
    return result


def at(x: float) -> NDArray[np.float64]:
    matrix = np.eye(4)
    matrix[0, 3] = x
    return matrix


def cube(x: float = 0, **values: Any) -> Part:
    vertices, triangles = shapes.cube()
    return Part(
        name="Cube",
        object_name="Cube",
        vertices=read_only(vertices, np.float32),
        triangles=read_only(triangles, np.int32),
        matrix=at(x),
        **values,
    )


@pytest.fixture
def cache() -> SceneCache:
    return SceneCache()


def only(built: Built) -> pyvocc.Scene:
    """The scene of what is built in one piece."""
    (piece,) = built.pieces
    return piece.scene


def reused(built: Built) -> bool:
    return all(piece.reused for piece in built.pieces)


def blocked(built: Built, x: float) -> bool:
    """The point is under something."""
    return any(piece.scene.occluded([[x, 0.1, -9]], [[0, 0, 1]])[0] for piece in built.pieces)


def test_parts_are_where_their_matrices_put_them(cache: SceneCache) -> None:
    built = cache.scene_for([cube(0), cube(10)])
    assert [blocked(built, x) for x in (0, 5, 10)] == [True, False, True]
    assert [mesh.name for mesh in only(built).report.meshes] == ["Cube", "Cube"]
    assert only(built).report.closed


def test_what_has_not_changed_is_not_built_again(cache: SceneCache) -> None:
    first = cache.scene_for([cube(0), cube(10)])
    again = cache.scene_for([cube(0), cube(10)])
    assert (reused(first), reused(again)) == (False, True)
    assert only(again) is only(first)
    # One scene serves casters and receivers if they are the same.
    assert only(cache.scene_for([cube(0), cube(10)], which="receivers")) is only(first)
    renamed = cache.scene_for([replace(cube(0), name="Box"), cube(10)])
    assert only(renamed) is only(first) and renamed.parts[0].name == "Box"


def test_any_change_builds(cache: SceneCache) -> None:
    part = cube(0)
    vertices = part.vertices.copy()
    vertices[3, 1] = np.nextafter(vertices[3, 1], np.float32(9))
    other = [
        replace(part, matrix=at(np.nextafter(0, 1, dtype=np.float32))),
        replace(part, vertices=vertices),
        replace(part, triangles=part.triangles[::-1].copy()),
        replace(part, triangles=part.triangles[:11]),
        replace(part, casting=np.arange(12) != 5),
    ]
    scenes = [only(cache.scene_for(parts)) for parts in ([part], *([each] for each in other))]
    assert len({id(scene) for scene in scenes}) == len(scenes)


def test_an_array_that_is_written_to_is_seen(cache: SceneCache) -> None:
    part = replace(cube(), vertices=cube().vertices.copy())
    cache.scene_for([part])
    part.vertices[:] *= 2
    assert not reused(cache.scene_for([part]))


def test_an_array_in_the_place_of_another_is_seen(cache: SceneCache) -> None:
    """A frame's arrays may lie where those of the frame before lay."""
    for size in (1, 2, 3, 4):
        part = replace(cube(), vertices=read_only(cube().vertices * size, np.float32))
        assert not reused(cache.scene_for([part]))
        del part
        gc.collect()


def test_only_what_casts(cache: SceneCache) -> None:
    parts = [cube(0), cube(10, is_caster=False), cube(20, casting=np.zeros(12, np.bool_))]
    built = cache.scene_for(parts)
    assert [blocked(built, x) for x in (0, 10, 20)] == [True, False, False]
    assert built.parts == (parts[0],)


def test_only_the_triangles_that_cast(cache: SceneCache) -> None:
    part = cube()
    top = part.vertices[part.triangles][..., 2].min(axis=1) > 0
    built = cache.scene_for([replace(part, casting=~top)])
    assert only(built).report.triangle_count == 10 and not only(built).report.closed
    # prim_id is that of the whole mesh for what receives.
    seen = only(cache.scene_for([replace(part, casting=~top)], which="receivers"))
    assert_array_equal(
        seen.intersect([[0.1, 0.2, 9]], [[0, 0, -1]]).prim_id, [np.flatnonzero(top)[1]]
    )


def test_only_what_receives(cache: SceneCache) -> None:
    parts = [cube(0, is_receiver=False), cube(10)]
    built = cache.scene_for(parts, which="receivers")
    assert [blocked(built, x) for x in (0, 10)] == [False, True]
    assert [part.matrix[0, 3] for part in built.parts] == [10]


def test_nothing_is_a_scene_too(cache: SceneCache) -> None:
    built = cache.scene_for([])
    assert built.parts == () and not blocked(built, 0)


def test_instances_share_their_arrays_and_hashes(
    cache: SceneCache, monkeypatch: pytest.MonkeyPatch
) -> None:
    hashed = []
    contiguous = np.ascontiguousarray
    monkeypatch.setattr(
        np, "ascontiguousarray", lambda a, *rest: hashed.append(a.nbytes) or contiguous(a, *rest)
    )
    part = cube()
    parts = [replace(part, matrix=at(3.0 * i)) for i in range(50)]
    for each in (*parts, *parts):
        cache._digest(each)
    assert sorted(hashed) == sorted([part.vertices.nbytes, part.triangles.nbytes])


def test_the_oldest_scene_goes() -> None:
    cache = SceneCache(max_scenes=2)
    cache.scene_for([cube(0)])
    cache.scene_for([cube(1)])
    cache.scene_for([cube(0)])
    cache.scene_for([cube(2)])
    assert len(cache) == 2
    assert [reused(cache.scene_for([cube(x)])) for x in (0, 2, 1)] == [True, True, False]


def test_memory_is_bounded_but_the_last_scene_stays() -> None:
    cache = SceneCache(max_bytes=1)
    cache.scene_for([cube(0)])
    cache.scene_for([cube(1)])
    assert len(cache) == 1 and reused(cache.scene_for([cube(1)]))
    cache.clear()
    assert len(cache) == 0 and not reused(cache.scene_for([cube(1)]))


def test_a_scene_outlives_its_place_in_the_cache() -> None:
    cache = SceneCache(max_scenes=1)
    built = cache.scene_for([cube(0)])
    cache.scene_for([cube(1)])
    assert blocked(built, 0)


def test_progress(cache: SceneCache) -> None:
    seen: list[float] = []
    cache.scene_for([cube(2.0 * i) for i in range(50)], progress=seen.append)
    assert seen == sorted(seen) and seen[0] == 0 and seen[-1] <= 1


@pytest.mark.parametrize("stop", [0.0, 0.05, 0.1])
def test_a_build_that_is_stopped_leaves_nothing(cache: SceneCache, stop: float) -> None:
    parts = [cube(2.0 * i) for i in range(50)]
    with pytest.raises(pyvocc.Cancelled):
        cache.scene_for(parts, progress=lambda done: done >= stop)
    assert len(cache) == 0 and not reused(cache.scene_for(parts))


# ---- what moves --------------------------------------------------------------


def ball(x: float, name: str, frequency: int = 40) -> Part:
    vertices, triangles = geodesic_sphere(frequency)
    return Part(
        name=name,
        object_name=name,
        vertices=read_only(vertices, np.float32),
        triangles=read_only(triangles, np.int32),
        matrix=at(x),
    )


def test_only_what_moves_is_built_again(cache: SceneCache) -> None:
    """The first frame is one scene; the second tells what moves; from then on the rest stays."""
    rest = [ball(3.0 * i, f"Ball {i}") for i in range(3)]
    frames = [cache.scene_for([*rest, ball(-3.0 - x, "Moving", 9)]) for x in range(5)]
    assert [[piece.reused for piece in each.pieces] for each in frames] == [
        [False],
        [False, False],
        [True, False],
        [True, False],
        [True, False],
    ]
    assert [piece.numbers.tolist() for piece in frames[2].pieces] == [[0, 1, 2], [3]]
    assert len({id(each.pieces[0].scene) for each in frames[1:]}) == 1
    assert frames[4].triangle_count == frames[0].triangle_count
    # What stops for a frame is expected to go on; what was there before is found.
    again = cache.scene_for([*rest, ball(-7.0, "Moving", 9)])
    assert [piece.reused for piece in again.pieces] == [True, True]
    assert reused(cache.scene_for([*rest, ball(-3.0, "Moving", 9)]))


def test_what_comes_and_goes_leaves_the_rest_alone(cache: SceneCache) -> None:
    rest = [ball(3.0 * i, f"Ball {i}") for i in range(3)]
    cache.scene_for(rest)
    more = cache.scene_for([*rest, ball(-3.0, "New", 9)])
    assert [piece.reused for piece in more.pieces] == [True, False]
    assert reused(cache.scene_for(rest))


def test_small_scenes_and_those_that_move_as_a_whole_stay_one(cache: SceneCache) -> None:
    for x in range(3):
        assert len(cache.scene_for([cube(0), cube(5.0 + x)], role="small").pieces) == 1
        parts = [ball(x + 3.0 * i, f"Ball {i}") for i in range(2)]
        assert len(cache.scene_for([*parts, ball(-9, "Still", 9)], role="all").pieces) == 1


def test_roles_are_compared_with_themselves(cache: SceneCache) -> None:
    rest = [ball(3.0 * i, f"Ball {i}") for i in range(3)]
    cache.scene_for(rest, role="a")
    assert len(cache.scene_for([*rest, cube(-9)], role="b").pieces) == 1
    # What the other role has built serves this one.
    assert len(cache.scene_for([*rest, cube(-9)], role="a").pieces) == 1
    assert len(cache.scene_for([*rest, cube(-8)], role="a").pieces) == 2


# ---- places ------------------------------------------------------------------


def test_a_place_in_the_world_is_that_of_its_vertex_alone() -> None:
    """Equal vertices of a closed mesh stay equal, whatever their number and neighbours."""
    random = np.random.default_rng(3)
    vertices = random.normal(size=(101, 3)).astype(np.float32)
    matrix = np.vstack([random.normal(size=(3, 4)) * 1e3, (0, 0, 0, 1)])
    world = to_world(np.repeat(vertices, 3, axis=0), matrix)
    for i in range(len(vertices)):
        alone = to_world(vertices[i : i + 1], matrix)
        assert_array_equal(world[3 * i : 3 * i + 3], np.repeat(alone, 3, axis=0))
    exact = vertices.astype(np.longdouble) @ matrix[:3, :3].T.astype(np.longdouble) + matrix[:3, 3]
    assert_array_equal(to_world(vertices, matrix), exact.astype(np.float64).astype(np.float32))


def test_the_origin_is_near_to_what_is_far_away(cache: SceneCache) -> None:
    places = [np.array((1e7 + x, -5e6, 3.0)) for x in (0, 0.3, 20)]
    origin = origin_for(places)
    assert all(np.abs(place - origin).max() < 20 * 64 for place in places)
    # It stays where it is while things move a little, and rounds nothing.
    assert origin_for(place + 1.5 for place in places) == origin
    assert [np.float32(x) for x in origin] == [*origin]
    for near in ([], [(0, 0, 0)], [(30, 0, 0)], [(1e4, 0, 0), (9.9e3, 500, 0)]):
        assert origin_for(map(np.array, near)) == (0, 0, 0)
    part = cube(1e7)
    moved_part = replace(part, matrix=moved(part.matrix, origin_for([part.matrix[:3, 3]])))
    report = only(cache.scene_for([moved_part])).report
    assert report.closed and report.meshes[0].volume == pytest.approx(8)
