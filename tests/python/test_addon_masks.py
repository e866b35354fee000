"""Masks from plain arrays: the same numbers as pyvocc's, and what they mean."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import addon  # noqa: F401 - first: it makes the next importable
import numpy as np
import pytest
import shapes
from numpy.testing import assert_allclose, assert_array_equal

import pyvocc
from blender_addon import masks
from blender_addon.camera import camera_rays
from blender_addon.data import Light, Part, Settings, View, World
from blender_addon.lights import shape_of
from blender_addon.masks import MaskJob, PointJob
from blender_addon.scenes import SceneCache
from pyvocc.shapes import geodesic_sphere

WIDTH, HEIGHT = 24, 18
ONE = Settings(samples=8, aa=1, threads=1)


def part(name: str, vertices: Any, triangles: Any, **values: Any) -> Part:
    return Part(
        name=name,
        object_name=name,
        vertices=np.array(vertices, np.float32),
        triangles=np.array(triangles, np.int32),
        matrix=values.pop("matrix", np.eye(4)),
        **values,
    )


def floor(**values: Any) -> Part:
    """A square of 8 in the middle of the view, which sees the background around it."""
    corners = [(-4, -4, 0), (4, -4, 0), (4, 4, 0), (-4, 4, 0)]
    return part("Floor", corners, [(0, 1, 2), (0, 2, 3)], **values)


def box(**values: Any) -> Part:
    """A cube of 2 that hangs a unit above the floor."""
    matrix = np.eye(4)
    matrix[2, 3] = 2.0
    return part("Box", *shapes.cube(), matrix=matrix, **values)


def light(name: str = "Key", x: float = 2.0, **values: Any) -> Light:
    """A square of 1 at a height of 6 that shines down."""
    matrix = np.eye(4)
    matrix[:3, 3] = (x, 0.0, 6.0)
    rows = tuple(tuple(row) for row in matrix.tolist())
    return Light(**{"name": name, "object_name": name, "kind": "AREA", "matrix": rows, **values})


def world(*lights: Light, parts: tuple[Part, ...] | None = None) -> World:
    return World((floor(), box()) if parts is None else parts, lights)


def view(**values: Any) -> View:
    """From (0, -9, 12) down to the origin; orthographic, 16 wide."""
    matrix = np.eye(4)
    matrix[:3, :3] = np.array([(1, 0, 0), (0, 0.8, 0.6), (0, -0.6, 0.8)]).T
    matrix[:3, 3] = (0.0, -9.0, 12.0)
    return View(
        width=WIDTH,
        height=HEIGHT,
        lower_left=np.array((-8.0, -6.0, -1.0)),
        right=np.array((16.0, 0.0, 0.0)),
        up=np.array((0.0, 12.0, 0.0)),
        matrix=matrix,
        is_orthographic=True,
        **values,
    )


def job(of: World, settings: Settings = ONE, **values: Any) -> MaskJob:
    made = MaskJob(of, view(**values), settings, SceneCache())
    made.prepare()
    return made


def frame(of: World, settings: Settings = ONE) -> dict[str, Any]:
    return job(of, settings).tile(0, 0, WIDTH, HEIGHT)


def seen(scene: pyvocc.Scene, aa: int = 1) -> tuple[Any, Any]:
    """Shading points of the whole frame, pixel by pixel, and their ids."""
    y, x = np.divmod(np.arange(WIDTH * HEIGHT), WIDTH)
    sub_y, sub_x = np.divmod(np.arange(aa * aa), aa)
    org, dir = camera_rays(
        view(),
        (x[:, None] + (sub_x + 0.5) / aa).ravel(),
        (y[:, None] + (sub_y + 0.5) / aa).ravel(),
    )
    ids = np.arange(WIDTH * HEIGHT * aa * aa)
    return pyvocc.shading_points(scene, org, dir), ids


def built(*parts: Part) -> pyvocc.Scene:
    scene = pyvocc.Scene()
    for each in parts:
        scene.add_mesh(each.vertices + each.matrix[:3, 3], each.triangles)
    scene.build()
    return scene


@pytest.mark.parametrize("aa", [1, 2, 3])
def test_masks_are_those_of_pyvocc(aa: int) -> None:
    lights = (light("Key", 2.0), light("Rim", -3.0))
    made = frame(world(*lights), replace(ONE, aa=aa))
    scene = built(floor(), box())
    at, ids = seen(scene, aa)
    counts = scene.light_visibility(
        at.position, at.normal, [shape_of(each) for each in lights], 8, ids
    )
    share = np.where(counts == pyvocc.NOT_TRACED, 0, counts) / np.float32(8)
    share[:, at.geom_id < 0] = 1
    expected = share.reshape(2, HEIGHT, WIDTH, aa * aa).mean(axis=-1, dtype=np.float64)
    for values, name in zip(expected.astype(np.float32), ("Shadow Key", "Shadow Rim"), strict=True):
        assert 0 < values.min() + 0.5 < values.max() + 0.5
        assert made[name].tobytes() == values.tobytes()


def test_irradiance_is_that_of_pyvocc() -> None:
    made = frame(world(light()), replace(ONE, irradiance=True))["Shadow Key"]
    scene = built(floor(), box())
    at, ids = seen(scene)
    expected = scene.light_irradiance(at.position, at.normal, [shape_of(light())], 8, ids)[0]
    expected = np.where(at.geom_id < 0, np.float32(1), np.nan_to_num(expected))
    assert made.tobytes() == expected.tobytes()


def test_occlusion_is_that_of_pyvocc() -> None:
    settings = replace(ONE, masks=False, ao=True, ao_distance=3.0, ao_samples=16)
    made = frame(world(light()), settings)
    assert set(made) == {"VOcc AO", "Combined"}
    scene = built(floor(), box())
    at, ids = seen(scene)
    counts = scene.ambient_occlusion(at.position, at.normal, 3.0, 16, ids)
    expected = np.where(at.geom_id < 0, np.float32(1), counts / np.float32(16))
    assert made["VOcc AO"].tobytes() == expected.astype(np.float32).tobytes()
    assert expected.min() < 0.5


def test_tiles_make_up_the_frame() -> None:
    made = job(world(light()), replace(ONE, aa=2, ao=True))
    whole = made.tile(0, 0, WIDTH, HEIGHT)
    for x, y, width, height in ((0, 0, 5, 18), (5, 0, 19, 7), (5, 7, 19, 11), (23, 17, 1, 1)):
        for name, values in made.tile(x, y, width, height).items():
            expected = whole[name][y : y + height, x : x + width]
            assert values.tobytes() == expected.tobytes(), name


def test_threads_change_nothing() -> None:
    made = [frame(world(light()), replace(ONE, aa=2, threads=n)) for n in (1, 2)]
    assert_array_equal(made[0]["Shadow Key"], made[1]["Shadow Key"])


def test_background_is_lit() -> None:
    made = frame(world(light()))
    assert made["Combined"][0, 0, 3] == 0 and made["Combined"][0, 0, 0] == 0
    assert made["Shadow Key"][0, 0] == 1
    assert made["Combined"][HEIGHT // 2, WIDTH // 2, 3] == 1


def test_beyond_the_clipping_plane_is_background() -> None:
    made = job(world(light()), near=0.1, far=0.2).tile(0, 0, WIDTH, HEIGHT)
    assert not made["Combined"].any() and (made["Shadow Key"] == 1).all()


def test_a_surface_turned_away_is_dark() -> None:
    matrix = np.diag((1.0, -1.0, -1.0, 1.0))  # shines up
    matrix[:3, 3] = (0, 0, -6)
    below = light(matrix=tuple(tuple(row) for row in matrix.tolist()))
    made = frame(world(below, parts=(floor(),)))
    covered = made["Combined"][..., 3] == 1
    assert covered.any() and not made["Shadow Key"][covered].any()


def test_behind_a_one_sided_light_is_dark() -> None:
    matrix = np.diag((1.0, -1.0, -1.0, 1.0))  # above the floor, but shines up
    matrix[:3, 3] = (0, 0, 6)
    above = light(matrix=tuple(tuple(row) for row in matrix.tolist()))
    made = frame(world(above, parts=(floor(),)))
    covered = made["Combined"][..., 3] == 1
    assert covered.any() and not made["Shadow Key"][covered].any()


def test_a_light_without_shadows_lights_what_faces_it() -> None:
    off, on = light("Off", casts_shadow=False), light("On")
    made = frame(world(off, on))
    assert set(np.unique(made["Shadow Off"])) == {0, 1}
    assert (made["Shadow Off"] >= np.ceil(made["Shadow On"])).all()
    assert (made["Shadow Off"] > made["Shadow On"]).any()
    made = frame(world(off, on), replace(ONE, all_lights=True))
    # The same light, but for its samples.
    assert np.abs(made["Shadow Off"] - made["Shadow On"]).max() < 0.5
    assert_array_equal(made["Shadow Off"] == 0, made["Shadow On"] == 0)


def test_a_light_halfway_below_the_surface() -> None:
    """A part of a light that the surface hides is dark, unless the light casts no shadow."""
    matrix = np.eye(4)
    matrix[:3, :3] = np.array([(0, 1, 0), (0, 0, 1), (1, 0, 0)]).T  # shines along -x
    matrix[:3, 3] = (9, 0, 0)
    rows = tuple(tuple(row) for row in matrix.tolist())
    off = light("Off", matrix=rows, casts_shadow=False)
    linked = light("Linked", matrix=rows, blockers=frozenset())
    made = frame(world(off, linked, parts=(floor(),)))
    covered = made["Combined"][..., 3] == 1
    assert (made["Shadow Off"][covered] == 1).all()
    assert (made["Shadow Linked"][covered] == 0.5).all()


def test_blockers_are_those_linked() -> None:
    free, held = light("Free", blockers=frozenset()), light("Held", blockers=frozenset({"Box"}))
    made = frame(world(free, held, light("All")))
    assert_array_equal(made["Shadow Held"] < 1, made["Shadow All"] < 1)
    assert (made["Shadow Free"] > made["Shadow Held"]).any()


def test_receivers_are_those_linked() -> None:
    made = frame(
        world(light("Floor", receivers=frozenset({"Floor"})), light("None", receivers=frozenset()))
    )
    covered = made["Combined"][..., 3] == 1
    assert not made["Shadow None"][covered].any()
    assert (made["Shadow None"][~covered] == 1).all()
    # The top of the box is lit by every light but this one.
    at, _ = seen(built(floor(), box()))
    assert not made["Shadow Floor"].ravel()[at.geom_id == 1].any()
    assert made["Shadow Floor"].ravel()[at.geom_id == 0].any()


def test_casters_and_receivers_differ() -> None:
    hidden = frame(world(light(), parts=(floor(), box(is_receiver=False))))
    assert (hidden["Shadow Key"] < 1).any()
    at, _ = seen(built(floor()))
    assert_array_equal(hidden["Combined"][..., 3].ravel() == 1, at.geom_id == 0)
    ghost = frame(world(light(), parts=(floor(), box(is_caster=False))))
    at, _ = seen(built(floor(), box()))
    assert (ghost["Shadow Key"].ravel()[at.geom_id == 0] == 1).all()


def test_a_light_without_size_is_told() -> None:
    made = job(world(light("Flat", size=(0.0, 1.0)), light("Key")))
    image = made.tile(0, 0, WIDTH, HEIGHT)
    covered = image["Combined"][..., 3] == 1
    assert not image["Shadow Flat"][covered].any() and image["Shadow Key"][covered].any()
    (notice,) = made.report("Scene", (WIDTH, HEIGHT)).notices
    assert "Flat" in notice and "no area" in notice


@pytest.mark.parametrize("lights", [(), (light(),)])
def test_nothing_to_see(lights: tuple[Light, ...]) -> None:
    made = job(world(*lights, parts=()))
    image = made.tile(0, 0, WIDTH, HEIGHT)
    assert not image["Combined"].any()
    assert all((image[name] == 1).all() for name in made.pass_names)
    notices = made.report("Scene", (WIDTH, HEIGHT)).notices
    assert any("no mesh" in notice for notice in notices)
    assert any("no light" in notice for notice in notices) == (not lights)


def test_passes_are_in_order_of_name() -> None:
    made = job(world(light("b.1"), light("a"), light("💡")), replace(ONE, ao=True))
    assert made.pass_names == ("Shadow a", "Shadow b_1", "Shadow 💡", "VOcc AO")
    assert made.light_passes["b.1"] == "Shadow b_1"


def test_the_offset_is_the_smallest_or_the_users() -> None:
    made = PointJob(world(light()), ONE, SceneCache())
    made.prepare()
    assert made.offset == built(floor(), box()).safe_offset > 0
    made = PointJob(world(light()), replace(ONE, offset=0.25), SceneCache())
    assert made.offset == 0.25


def test_points_of_any_source() -> None:
    made = PointJob(world(light()), ONE, SceneCache())
    made.prepare()
    points = np.array([(3, 0, 1e-4), (0, 0, 1e-4), (np.nan, 0, 0)])
    values = made.masks(points, np.tile((0.0, 0.0, 1.0), (3, 1)), np.arange(3, dtype=np.uint32))
    assert values.shape == (1, 3)
    assert values[0, 0] == 1 and values[0, 1] < 1 and values[0, 2] == 0


def test_stops_when_asked() -> None:
    made = job(world(light()), replace(ONE, samples=4096))
    told: list[float] = []

    def progress(fraction: float) -> bool:
        told.append(fraction)
        return len(told) > 2

    with pytest.raises(pyvocc.Cancelled):
        made.tile(0, 0, WIDTH, HEIGHT, progress)
    assert told == sorted(told) and told[0] >= 0 and told[-1] < 1


def test_report() -> None:
    cache = SceneCache()
    parts = (floor(), box(), replace(box(), name="Box in Empty"))
    made = MaskJob(world(light(), parts=parts), view(), ONE, cache)
    made.prepare()
    made.tile(0, 0, WIDTH, HEIGHT)
    report = made.report("Set", (WIDTH, HEIGHT))
    assert (report.scene, report.masks) == ("Set", ("Shadow Key",))
    assert [(each.name, each.instances, each.closed) for each in report.objects] == [
        ("Floor", 1, False),
        ("Box", 2, True),
    ]
    assert report.open[0].open_edges == 4 and "4 open edges" in report.open[0].why
    assert report.triangles == 2 + 2 * 12
    assert report.rays == made.points.stats.rays > 0
    assert sum(report.settled.values()) == report.rays
    assert (report.builds, report.reused) == (1, 0)
    assert set(report.seconds) == {"build", "camera", "trace"}
    again = MaskJob(world(light(x=-2.0), parts=parts), view(), ONE, cache)
    again.prepare()
    report = again.report("Set", (WIDTH, HEIGHT))
    assert (report.builds, report.reused) == (0, 1)


def test_pictures_do_not_depend_on_what_was_built_before() -> None:
    """What moves has a scene of its own from the second frame on; no bit tells."""
    vertices, triangles = geodesic_sphere(40)
    rest = replace(
        box(), name="Ball", object_name="Ball", vertices=vertices * 1.5, triangles=triangles
    )
    settings = replace(ONE, ao=True, ao_distance=4.0)
    cache = SceneCache()
    for frame_number in range(4):
        matrix = np.eye(4)
        # Into the ball, and with a face in the floor's plane: equally far from the camera.
        matrix[:3, 3] = (2.0 - 0.5 * frame_number, 0.0, 1.0)
        parts = (replace(box(), name="Moving", matrix=matrix), rest, floor())
        of = world(light("Key", 2.0), light("Rim", -3.0), parts=parts)
        for each in (settings, replace(settings, irradiance=True)):
            made = MaskJob(of, view(), each, cache)
            made.prepare()
            pieces = made.points.built["receivers"].pieces
            assert len(pieces) == (2 if frame_number else 1)
            passes = made.tile(0, 0, WIDTH, HEIGHT)
            for name, values in frame(of, each).items():
                assert passes[name].tobytes() == values.tobytes()
            if frame_number:
                assert made.report("", (1, 1)).rays < made.points.stats.rays


def test_pixel_order_holds_each_pixel_once() -> None:
    for width, height in ((1, 1), (5, 3), (64, 64)):
        assert_array_equal(np.sort(masks.pixel_order(width, height)), np.arange(width * height))
    # The first quarter of a square is a square.
    y, x = np.divmod(masks.pixel_order(64, 64)[:1024], 64)
    assert x.max() == y.max() == 31


def test_clay_is_darker_in_shadow() -> None:
    made = frame(world(light()))
    grey, mask = made["Combined"], made["Shadow Key"]
    assert_array_equal(grey[..., 0], grey[..., 1])
    on_floor = seen(built(floor(), box()))[0].geom_id.reshape(HEIGHT, WIDTH) == 0
    lit, dark = grey[on_floor & (mask == 1), 0], grey[on_floor & (mask == 0), 0]
    assert lit.min() == lit.max()
    if len(dark):
        assert_allclose(dark / lit[0], masks.AMBIENT, rtol=1e-6)
    assert (grey[on_floor & (mask < 1), 0] < lit[0]).all()
