"""intersect, occluded and region: shapes, types, memory, options, counters."""

from __future__ import annotations

import dataclasses
import platform
import tracemalloc
from typing import Any

import hypothesis.extra.numpy as npst
import numpy as np
import pytest
import shapes
from conftest import RandomRays
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

import pyvocc
from pyvocc import _arrays, _ffi
from pyvocc._query import query_of

# ---- results -----------------------------------------------------------------


def test_a_ray_has_shape_3_and_its_answer_shape_0(cube: pyvocc.Scene) -> None:
    hits = cube.intersect([0.25, 0.5, 5], [0, 0, -1])
    assert all(array.shape == () for array in hits)
    assert hits.t == 4
    assert hits.geom_id == 0
    corners = cube.corners(hits.geom_id, hits.prim_id)
    weights = [1 - hits.u - hits.v, hits.u, hits.v]
    assert np.allclose(weights @ corners, [0.25, 0.5, 1])
    assert cube.occluded([0.25, 0.5, 5], [0, 0, -1]).shape == ()
    assert cube.occluded([0.25, 0.5, 5], [0, 0, -1])
    assert cube.region([0.25, 0.5, 0.0]).shape == ()


def test_a_miss(cube: pyvocc.Scene) -> None:
    t, geom_id, prim_id, u, v = cube.intersect([3, 3, 5], [0, 0, -1])
    assert (t, geom_id, prim_id, u, v) == (np.inf, -1, -1, 0, 0)
    assert not cube.occluded([3, 3, 5], [0, 0, -1])


def test_the_interval_is_open(cube: pyvocc.Scene) -> None:
    org, dir = [0.25, 0.5, 5], [0, 0, -1]
    tmax = np.nextafter(np.float32(4), np.float32(9))
    assert cube.occluded(org, dir, 0, [3.5, 4, tmax, 5]).tolist() == [False, False, True, True]
    assert cube.occluded(org, dir, [3.5, 4, 6]).tolist() == [True, True, False]
    assert cube.occluded([0.25, 0.5, -5], dir, -np.inf)
    assert cube.intersect([0.25, 0.5, -5], dir, -np.inf).t == -6
    assert not cube.occluded(org, dir, 5, 5)
    assert not cube.occluded(org, dir, 5, 3)


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("axis", [0, 1, 2])
def test_rays_that_are_not_finite_meet_nothing(cube: pyvocc.Scene, bad: float, axis: int) -> None:
    for name in ("org", "dir"):
        ray = {"org": np.array([0.25, 0.5, 5.0]), "dir": np.array([0.0, 0.0, -1.0])}
        ray[name][axis] = bad
        assert not cube.occluded(**ray)
        assert cube.intersect(**ray).prim_id == -1


def test_a_direction_of_length_zero_meets_nothing(cube: pyvocc.Scene) -> None:
    assert not cube.occluded([0, 0, 0], [0, 0, 0], -np.inf, np.inf)
    assert not cube.occluded([1, 0.5, 0.5], [0.0, -0.0, 0], -1, 1)
    assert cube.intersect([1, 0.5, 0.5], [0, 0, 0]).t == np.inf


def test_a_nan_bound_meets_nothing(cube: pyvocc.Scene) -> None:
    assert not cube.occluded([0.25, 0.5, 5], [0, 0, -1], np.nan)
    assert not cube.occluded([0.25, 0.5, 5], [0, 0, -1], 0, np.nan)


def test_regions(cube: pyvocc.Scene) -> None:
    points = [[0, 0, 0], [2, 0, 0], [1, 0.3, 0.2], [1, 1, 1], [np.nan, 0, 0], [0, np.inf, 0]]
    assert cube.region(points).tolist() == [1, 0, -1, -1, -2, -2]


def test_occluded_agrees_with_intersect(torus: pyvocc.Scene, random_rays: RandomRays) -> None:
    org, dir = random_rays(50_000)
    occluded = torus.occluded(org, dir)
    assert 0.1 < occluded.mean() < 0.9
    assert (occluded == (torus.intersect(org, dir).prim_id >= 0)).all()


# ---- shapes ------------------------------------------------------------------


@given(
    shapes_=npst.mutually_broadcastable_shapes(num_shapes=4, max_dims=3, min_side=0, max_side=4),
    seed=st.integers(0, 2**32 - 1),
)
def test_leading_shapes_broadcast(
    cube: pyvocc.Scene, shapes_: npst.BroadcastableShapes, seed: int
) -> None:
    random = np.random.default_rng(seed)
    a, b, c, d = shapes_.input_shapes
    org = random.normal(0, 2, (*a, 3)).astype(np.float32)
    dir = random.normal(size=(*b, 3)).astype(np.float32)
    tmin, tmax = random.uniform(0, 1, c), random.uniform(0.5, 4, d)
    lead = shapes_.result_shape
    full = (
        np.broadcast_to(org, (*lead, 3)).reshape(-1, 3).copy(),
        np.broadcast_to(dir, (*lead, 3)).reshape(-1, 3).copy(),
        np.broadcast_to(tmin, lead).ravel().copy(),
        np.broadcast_to(tmax, lead).ravel().copy(),
    )
    occluded = cube.occluded(org, dir, tmin, tmax)
    assert occluded.shape == lead
    assert occluded.dtype == np.bool_
    assert (occluded.ravel() == cube.occluded(*full)).all()
    hits = cube.intersect(org, dir, tmin, tmax)
    for got, expected, dtype in zip(
        hits, cube.intersect(*full), ["f4", "i4", "i4", "f4", "f4"], strict=True
    ):
        assert got.shape == lead
        assert got.dtype == np.dtype(dtype)
        assert (got.ravel() == expected).all()
    region = cube.region(org)
    assert region.shape == a
    assert region.dtype == np.int32


@given(
    shape=npst.array_shapes(max_dims=3, max_side=5),
    data=st.data(),
    dtype=st.sampled_from([np.float32, np.float64]),
)
def test_any_view_gives_the_same_as_its_copy(
    cube: pyvocc.Scene, shape: tuple[int, ...], data: st.DataObject, dtype: Any
) -> None:
    base = np.random.default_rng(3).normal(0, 2, (*shape, 8)).astype(dtype)
    index = data.draw(npst.basic_indices(shape, allow_ellipsis=False, allow_newaxis=True))
    last = data.draw(st.sampled_from([slice(0, 3), slice(5, 8), slice(0, 6, 2), slice(7, 4, -1)]))
    view = base[..., last][index] if isinstance(index, tuple) else base[index][..., last]
    if view.shape[-1:] != (3,):
        return
    order = data.draw(st.permutations(range(view.ndim - 1)))
    view = view.transpose(*order, view.ndim - 1)
    dir = np.array([0.1, 0.2, -1], dtype)
    assert (cube.occluded(view, dir) == cube.occluded(view.copy(), dir)).all()


def test_float64_and_other_real_types_give_the_same(cube: pyvocc.Scene) -> None:
    org = np.array([[0, 0, 5], [3, 0, 5], [0, 2, 5]])
    for dtype in ("f2", "f4", "f8", "g", "i1", "i4", "u2", "i8", ">f4", ">f8", ">i4"):
        dir = np.array([0, 0, -1], "i1" if dtype == "u2" else dtype)
        assert cube.occluded(org.astype(dtype), dir).tolist() == [True, False, False]
    assert cube.occluded(org.tolist(), (0, 0, -1)).tolist() == [True, False, False]


def test_origin_and_direction_may_differ_in_type(cube: pyvocc.Scene) -> None:
    org, dir = np.array([[0.5, 0.25, 5]] * 2), np.array([[0, 0, -1], [0, 1, 0]])
    for a in ("f4", "f8"):
        for b in ("f4", "f8", "i8"):
            assert cube.occluded(org.astype(a), dir.astype(b)).tolist() == [True, False]


# ---- memory ------------------------------------------------------------------


def address(array: NDArray[Any]) -> int:
    return int(array.ctypes.data)


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_rows_are_borrowed_where_one_distance_fits(dtype: Any) -> None:
    size = np.dtype(dtype).itemsize
    whole = np.zeros((6, 4, 9), dtype)
    cases = [
        (whole[..., :3], 9 * size),
        (whole[::-1, :, 3:6][:, ::-1], -9 * size),
        (whole[:, 1, 6:9], 36 * size),
        (whole[2::2, 3, :3], 72 * size),
        (whole[:1, 2:3, :3], 0),
        (np.broadcast_to(whole[0, 0, :3], (7, 5, 3)), 0),
        (whole[1, 2, :3], 0),
        (np.ascontiguousarray(whole[..., :3]), 3 * size),
        (whole.reshape(24, 9)[::3, 2:5], 27 * size),
    ]
    for view, stride in cases:
        result = _arrays.rows(_arrays.floats("org", view), view.shape[:-1], (3,))
        assert result.address == address(view)
        assert result.stride == stride
        assert np.shares_memory(result.array, whole) or view.base is None


def test_what_one_distance_cannot_express_is_copied() -> None:
    whole = np.zeros((6, 4, 9), np.float32)
    odd = np.frombuffer(bytes(4 * 12 + 1), np.uint8)[1:].view(np.float32).reshape(4, 3)
    for view in (
        whole[:, :3, :3],  # a gap after each third row
        whole[..., ::3],  # components apart
        np.asfortranarray(np.zeros((5, 3), np.float32)),
        np.broadcast_to(whole[:, :1, :3], (6, 4, 3)),
        odd,  # not aligned
    ):
        result = _arrays.rows(_arrays.floats("org", view), view.shape[:-1], (3,))
        assert result.array.flags.c_contiguous
        assert result.array.flags.aligned
        assert result.stride == 12
        assert not np.shares_memory(result.array, view)


def peak(call: Any) -> int:
    """Bytes that Python and NumPy allocated at most during the call, with its result."""
    tracemalloc.start()
    try:
        keep = call()
        size = tracemalloc.get_traced_memory()[1]
        del keep
        return size
    finally:
        tracemalloc.stop()


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_queries_do_not_copy_their_arrays(cube: pyvocc.Scene, dtype: Any) -> None:
    count, slack = 300_000, 50_000
    packed = np.zeros((count, 8), dtype)
    packed[:, 2], packed[:, 5] = 5, -1
    org, dir = packed[:, :3], packed[:, 3:6]
    tmin, tmax = np.zeros(count, dtype), np.full(count, 9, dtype)
    lights = [pyvocc.RectLight((0, 0, 9), (1, 0, 0), (0, 1, 0))]
    ids = np.arange(count, dtype=np.uint32)
    out = np.empty(count, np.bool_)
    assert peak(lambda: cube.occluded(org, dir, tmin, tmax)) < count + slack
    assert peak(lambda: cube.occluded(org, dir, tmin, tmax, out=out)) < slack
    assert peak(lambda: cube.occluded(org, dir[0], 0, tmax)) < count + slack
    assert peak(lambda: cube.intersect(org, dir)) < 20 * count + slack
    assert peak(lambda: cube.region(org)) < 4 * count + slack
    assert peak(lambda: cube.light_visibility(org, dir[:1], lights, 1, ids)) < 2 * count + slack


def test_inputs_are_not_written(cube: pyvocc.Scene, random_rays: RandomRays) -> None:
    org, dir = random_rays(1000)
    for array in (org, dir):
        array.flags.writeable = False
    before = org.tobytes() + dir.tobytes()
    cube.occluded(org, dir)
    cube.intersect(org, dir)
    assert org.tobytes() + dir.tobytes() == before


@pytest.mark.parametrize("dtype", [np.bool_, np.uint8])
def test_out_is_filled_and_returned(
    torus: pyvocc.Scene, random_rays: RandomRays, dtype: Any
) -> None:
    org, dir = (array.reshape(10, 100, 3) for array in random_rays(1000))
    out = np.full((10, 100), 1, dtype)
    assert torus.occluded(org, dir, out=out) is out
    assert (out == torus.occluded(org, dir)).all()
    assert set(np.unique(out.view(np.uint8))) == {0, 1}


# ---- options -----------------------------------------------------------------


def test_no_option_changes_a_result(torus: pyvocc.Scene, random_rays: RandomRays) -> None:
    org, dir = random_rays(20_000)
    tmax = np.where(np.arange(len(org)) % 2, np.float32(0.7), np.float32(np.inf))
    expected = torus.occluded(
        org, dir, 0, tmax, order="standard", occluders=False, packets=False, isa="scalar", threads=1
    )
    assert 0.1 < expected.mean() < 0.9
    for order in ("auto", "standard", "qdbfs"):
        for options in (
            {},
            {"occluders": False},
            {"cache": 0},
            {"cache": 64},
            {"deferment": 0},
            {"deferment": 1},
            {"packets": False},
            *({"isa": isa} for isa in pyvocc.isas()),
            {"threads": 3},
        ):
            got = torus.occluded(org, dir, 0, tmax, order=order, **options)
            assert (got == expected).all(), (order, options)


def test_results_do_not_depend_on_threads(torus: pyvocc.Scene, random_rays: RandomRays) -> None:
    org, dir = random_rays(100_000)
    lights = [pyvocc.RectLight((-1, 3, -1), (2, 0, 0), (0, 0, 2))]
    for ask in (
        lambda threads: np.stack(torus.intersect(org, dir, threads=threads)),
        lambda threads: torus.occluded(org, dir, threads=threads),
        lambda threads: torus.region(org, threads=threads),
        lambda threads: torus.light_visibility(org, -org, lights, threads=threads),
    ):
        first = ask(1)
        for threads in (2, 3, 7):
            assert (ask(threads) == first).all()


def test_the_scene_gives_the_default_of_threads(monkeypatch: pytest.MonkeyPatch) -> None:
    scene = pyvocc.Scene(threads=3)
    scene.add_mesh(*shapes.cube())
    asked: list[int] = []

    def occluded(*args: Any) -> None:
        asked.append(next(arg.threads for arg in args if isinstance(arg, _ffi.Query)))

    monkeypatch.setattr(_ffi, "occluded", occluded)
    assert scene.build().threads == 3
    scene.occluded([0, 0, 0], [0, 0, 1])
    scene.occluded([0, 0, 0], [0, 0, 1], threads=2)
    pyvocc.Scene().occluded([0, 0, 0], [0, 0, 1])
    assert asked == [3, 2, 0]


def test_defaults_are_those_of_the_library() -> None:
    options = _ffi.ffi.new("vocc_query_options *")
    _ffi.lib.vocc_query_options_init(options)
    defaults = dataclasses.asdict(query_of(0, {}))
    assert {name: getattr(options, name) for name in defaults} == defaults
    assert set(defaults) == set(pyvocc.QueryOptions.__optional_keys__)


# ---- instruction sets --------------------------------------------------------


@pytest.fixture
def no_variable(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("VOCC_ISA", raising=False)


def test_isas_are_those_of_the_machine() -> None:
    isas = pyvocc.isas()
    if platform.machine() == "x86_64":
        assert isas[:2] == ("scalar", "sse2")
    elif platform.machine() == "aarch64":
        assert isas == ("scalar", "neon")
    assert set(isas) <= set(_ffi.ISAS) - {"auto"}
    assert [pyvocc.isa(name) for name in isas] == list(isas)
    for name, number in _ffi.ISAS.items():
        assert _ffi.isa_name(number) == name


def test_auto_is_the_best(no_variable: None) -> None:
    assert pyvocc.isa() == pyvocc.isa("auto") == pyvocc.isas()[-1]


def test_an_isa_that_is_not_there(torus: pyvocc.Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    missing = set(_ffi.ISAS) - {"auto", *pyvocc.isas()}
    assert missing
    for name in missing:
        monkeypatch.delenv("VOCC_ISA", raising=False)
        for ask, variable in (
            (lambda name=name: pyvocc.isa(name), "isa"),
            (lambda name=name: torus.occluded([0, 0, 0], [0, 0, 1], isa=name), "isa"),
            (lambda name=name: torus.intersect([0, 0, 0], [0, 0, 1], isa=name), "isa"),
            (pyvocc.isa, "VOCC_ISA"),
            (lambda: torus.occluded([0, 0, 0], [0, 0, 1]), "VOCC_ISA"),
            (lambda: torus.region([0, 0, 0], stats=pyvocc.Stats()), "VOCC_ISA"),
        ):
            if variable == "VOCC_ISA":
                monkeypatch.setenv("VOCC_ISA", name)
            with pytest.raises(pyvocc.UnsupportedError, match=f"{variable} is {name}") as caught:
                ask()
            assert caught.value.argument == variable
            assert ", ".join(pyvocc.isas()) in str(caught.value)


def test_the_environment_says_what_auto_is(
    torus: pyvocc.Scene, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in pyvocc.isas():
        monkeypatch.setenv("VOCC_ISA", name)
        assert pyvocc.isa() == name
        for isa in pyvocc.isas():
            assert pyvocc.isa(isa) == isa
        stats = pyvocc.Stats()
        torus.occluded([0, 0, 0], [0, 0, 1], stats=stats)
        assert stats.isa == name
    monkeypatch.setenv("VOCC_ISA", "sse5")
    assert pyvocc.isa("scalar") == "scalar"
    for ask in (pyvocc.isa, lambda: torus.occluded([0, 0, 0], [0, 0, 1])):
        with pytest.raises(pyvocc.InvalidArgument, match=r'VOCC_ISA is "sse5": .*avx512') as caught:
            ask()
        assert caught.value.argument == "VOCC_ISA"


def test_stats_say_which_isa_ran(torus: pyvocc.Scene, no_variable: None) -> None:
    stats = pyvocc.Stats()
    assert stats.isa == ""
    points, lights = np.full((5, 3), 3.0), [pyvocc.RectLight((-1, 3, -1), (2, 0, 0), (0, 0, 2))]
    for isa in ("auto", *pyvocc.isas()):
        for ask in (
            lambda isa: torus.occluded(points, -points, stats=stats, isa=isa),
            lambda isa: torus.intersect(points, -points, stats=stats, isa=isa),
            lambda isa: torus.light_visibility(points, points, lights, stats=stats, isa=isa),
        ):
            stats.isa = ""
            ask(isa)
            assert stats.isa == pyvocc.isa(isa)


# ---- counters ----------------------------------------------------------------


def test_stats_has_every_counter_of_the_library() -> None:
    names = [field.name for field in dataclasses.fields(pyvocc.Stats)]
    assert names == [*_ffi._COUNTERS, "isa"]
    assert list(pyvocc.Stats().counters) == list(_ffi._COUNTERS)


def test_a_cache_hit_takes_no_step(torus: pyvocc.Scene, random_rays: RandomRays) -> None:
    """What an occluder of the cache blocks is not traced: slides, "traversal steps drops to 0"."""
    org, dir = random_rays(2000)
    found = 0
    for k in range(len(org)):
        for order in ("standard", "extended", "bfs", "qdbfs", "opaque_first"):
            for policy in ("recent", "direction"):
                counts = []
                for number in (4, 400):
                    stats = pyvocc.Stats()
                    options = {"order": order, "cache_policy": policy, "threads": 1}
                    rays = (np.tile(org[k], (number, 1)), dir[k])
                    torus.occluded(*rays, stats=stats, **options)
                    counts.append(stats)
                first, many = counts
                if first.occluder_hits_tree != 4:
                    continue
                found += 1
                assert many.occluder_hits_tree == 4
                assert many.occluder_hits_cache == 396
                assert many.node_visits == first.node_visits > 0
                assert many.triangle_tests == first.triangle_tests
        if found > 100:
            break
    assert found > 100


def test_stats_are_added_to(torus: pyvocc.Scene, random_rays: RandomRays) -> None:
    org, dir = random_rays(4000)
    stats = pyvocc.Stats(rays=7)
    occluded = torus.occluded(org, dir, stats=stats, order="qdbfs")
    assert stats.rays == 4007
    assert stats.occluded == occluded.sum()
    assert stats.packets >= 1000
    assert stats.occluder_hits_tree + stats.occluder_hits_cache > 0
    assert 1 <= stats.lanes_per_visit <= 4
    once = dataclasses.replace(stats)
    torus.occluded(org, dir, stats=stats, order="qdbfs")
    assert stats.rays == 8007
    assert stats.occluded == 2 * once.occluded
    assert pyvocc.Stats().lanes_per_visit == 0


def test_stats_tell_the_options_apart(torus: pyvocc.Scene, random_rays: RandomRays) -> None:
    org, dir = random_rays(4000)

    def count(**options: Any) -> pyvocc.Stats:
        stats = pyvocc.Stats()
        torus.occluded(org, dir, stats=stats, threads=1, **options)
        return stats

    baseline = count(occluders=False, order="standard")
    assert baseline.occluder_hits_tree == baseline.occluder_hits_cache == 0
    assert count(order="qdbfs").triangle_tests < baseline.triangle_tests
    assert count(order="qdbfs", cache=0).cache_lookups == 0
    assert count(order="qdbfs", packets=False).packets == 4000
    assert count(order="qdbfs").deferred > 0
    assert count(isa="scalar") == count(isa="auto")
