"""The benchmark's programs: the scenes and rays of docs/benchmark.md, bit for bit, and what they
tell of them.  Nothing here is timed."""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapes
from numpy.typing import NDArray

import pyvocc
from pyvocc import shadow

sys.path.append(str(Path(__file__).resolve().parents[2]))
from bench import __main__ as bench
from bench import measure, programs, rays, workload

SIZE, SAMPLES = 24, 6

Floats = NDArray[np.float32]


@pytest.fixture(scope="module")
def embree() -> Iterator[bool]:
    """Builds the programs; whether Embree's is one of them."""
    with pytest.MonkeyPatch.context() as patch:
        if "VOCC_OBJECTS" in os.environ:
            # Of the library that `make test` has compiled, and not in place of those that measure.
            patch.setattr(programs, "BUILD", programs.ROOT / "build" / "test" / "bench")
            patch.setenv("MAKEFLAGS", "BUILD=build/test/bench LIBRARY=build/release/libvocc.a")
        yield programs.build()


@pytest.fixture(scope="module")
def mesh(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An upright torus."""
    path = tmp_path_factory.mktemp("bench") / "torus.ply"
    vertices, triangles = shapes.torus(40, 20)
    workload.save_mesh(path, vertices[:, [0, 2, 1]].astype(np.float32), triangles[:, ::-1])
    return path


@dataclass(frozen=True)
class Run:
    """What a program says of a scene and writes."""

    line: programs.Line
    gbuffer: workload.GBuffer
    org: Floats
    dir: Floats
    written: bytes


def run(
    mesh: Path, scene: str, *options: str, program: str = "vocc", mode: str = "auto", **more: Any
) -> Run:
    folder = mesh.parent
    size, samples = more.get("size", SIZE), more.get("samples", SAMPLES)
    gbuffer = folder / f"{scene}_{size}.gbuf"
    line = programs.run(
        program,
        mesh,
        *("--scene", scene, "--size", str(size), "--samples", str(samples), *options),
        *("--gbuf", gbuffer, "--counts", folder / "counts", "--dump-rays", folder / "rays", mode),
    )[0]
    rows = np.fromfile(folder / "rays", np.float32).reshape(-1, 6)
    written = (folder / "counts").read_bytes()
    return Run(line, workload.load_gbuffer(gbuffer), rows[:, :3], rows[:, 3:], written)


def built(placed: workload.Placed) -> pyvocc.Scene:
    scene = pyvocc.Scene(threads=1)
    scene.add_mesh(placed.mesh.vertices, placed.mesh.triangles, name="mesh")
    scene.add_mesh(workload.GROUND_VERTICES, workload.GROUND_TRIANGLES, name="ground")
    scene.build()
    return scene


def traced_lights(placed: workload.Placed, gbuffer: workload.GBuffer, pixel: int) -> list[int]:
    corner, u, v = placed.lights.astype(float).transpose(1, 0, 2)
    to_light = corner + u / 2 + v / 2 - gbuffer.points[pixel].astype(float)
    return [k for k, d in enumerate(to_light) if gbuffer.normals[pixel].astype(float) @ d > 0]


def all_rays(
    placed: workload.Placed, gbuffer: workload.GBuffer, samples: int = SAMPLES
) -> tuple[Floats, Floats]:
    """Tile by tile, pixel by pixel, light by light."""
    org, dir = [], []
    for pixel in gbuffer.tile_order().tolist():
        point = gbuffer.points[pixel]
        for k in traced_lights(placed, gbuffer, pixel):
            dir.append(workload.directions(k, pixel, point, samples, placed.lights))
            org.append(np.broadcast_to(point, dir[-1].shape))
    return np.concatenate(org), np.concatenate(dir)


@pytest.mark.parametrize("name", workload.SCENES)
def test_scene_and_rays_are_those_of_numpy(embree: bool, mesh: Path, name: str) -> None:
    found = run(mesh, name)
    placed = workload.load_scene(mesh, name)
    scene = built(placed)

    pixels = np.arange(SIZE * SIZE)
    eye, dir = placed.camera.rays((SIZE, SIZE), pixels)
    assert (eye.astype(np.float32) == eye).all()
    hits = scene.intersect(eye, dir)
    shown = np.flatnonzero(hits.prim_id >= 0)
    expected = hits.prim_id + np.where(hits.geom_id == 1, len(placed.mesh.triangles), 0)
    assert np.array_equal(found.gbuffer.prim, expected)
    corners = scene.corners(hits.geom_id[shown], hits.prim_id[shown])
    points, normals = shadow.shading_point(
        corners, eye, dir[shown], hits.t[shown], float(np.float32(1e-4))
    )
    assert found.gbuffer.points[shown].tobytes() == points.tobytes()
    assert found.gbuffer.normals[shown].tobytes() == normals.tobytes()
    # In the street of another mesh than the city there may be nothing.
    assert ({1} if name == "street" else {0, 1}) <= set(hits.geom_id[shown].tolist())

    org, dir = all_rays(placed, found.gbuffer)
    assert found.org.tobytes() == org.tobytes()
    assert found.dir.tobytes() == dir.tobytes()

    blocked = scene.occluded(org, dir, 0.0, 1.0)
    assert found.line["rays"] == len(org)
    assert found.line["visible"] == (~blocked).sum()
    assert 0.05 < blocked.mean() < 0.95


def test_a_crowd_is_25_closed_meshes(mesh: Path) -> None:
    alone = workload.load_mesh(mesh)
    crowd = workload.SCENES["crowd"].around(alone).mesh
    assert len(crowd.triangles) == 25 * len(alone.triangles)
    report = built(workload.load_scene(mesh, "crowd")).report
    assert report.meshes[0].closed
    assert len(report.meshes[0].components) == 25


@pytest.mark.parametrize(("samples", "width"), [(254, 1), (255, 2), (256, 2)])
def test_counts_that_do_not_fit_a_byte_are_told_in_two(
    embree: bool, mesh: Path, samples: int, width: int
) -> None:
    size = 12
    found = run(mesh, "crowd", samples=samples, size=size)
    path = mesh.parent / "counts"
    assert len(found.written) == 5 * size * size * width
    counts = workload.load_counts(path, size, samples)
    assert workload.count_bytes(counts, samples) == found.written
    assert measure.fnv1a(found.written) == found.line["hash"]

    placed = workload.load_scene(mesh, "crowd")
    pixels = found.gbuffer.tile_order()
    expected = built(placed).light_visibility(
        found.gbuffer.points[pixels],
        found.gbuffer.normals[pixels],
        [pyvocc.RectLight(*light) for light in placed.lights.astype(float).tolist()],
        samples,
        pixels,
        sampler="jitter",
        horizon="centre",
    )
    image = np.full((5, size * size), workload.NOT_TRACED, np.uint16)
    image[:, pixels] = expected
    assert np.array_equal(counts.reshape(5, -1), image)
    assert {samples, workload.NOT_TRACED} <= set(image.ravel().tolist())
    org, dir = all_rays(placed, found.gbuffer, samples)
    assert found.dir.tobytes() == dir.tobytes()
    assert len(found.org) == len(org)


def test_the_last_sample_does_not_share_its_hash(embree: bool) -> None:
    """256 samples fill what the key has for a light: none is another light's or pixel's."""
    org = np.zeros((2, 3), np.float32)
    square = np.zeros((8, 3, 3), np.float32)
    square[:, 1, 0] = square[:, 2, 1] = 16  # a jitter of 16 bits for each of 16 x 16 strata
    targets = [workload.directions(k, [7, 8], org, 256, square) for k in range(8)]
    jitter = np.unique(np.concatenate(targets).reshape(-1, 3) % 1, axis=0)
    assert len(jitter) == 8 * 2 * 256


def test_orders_of_ray_arrays(embree: bool, mesh: Path) -> None:
    plain = run(mesh, "crowd", "--rays", "all")
    placed = workload.load_scene(mesh, "crowd")
    scene = built(placed)
    expected = scene.occluded(plain.org, plain.dir, 0.0, 1.0)
    assert plain.written == expected.astype(np.uint8).tobytes()
    assert plain.line["blocked"] == expected.sum()

    order = workload.shuffled(len(plain.org))
    shuffle = run(mesh, "crowd", "--rays", "all", "--order", "shuffle")
    assert shuffle.dir.tobytes() == plain.dir[order].tobytes()
    assert shuffle.org.tobytes() == plain.org[order].tobytes()
    assert sorted(order.tolist()) == list(range(len(order)))

    org, dir = workload.random_segments(placed.mesh, len(plain.org))
    random = run(mesh, "crowd", "--rays", "all", "--order", "random")
    assert random.org.tobytes() == org.tobytes()
    assert random.dir.tobytes() == dir.tobytes()

    for kind, wanted in (("blocked", True), ("visible", False)):
        some = run(mesh, "crowd", "--rays", kind, "--order", "shuffle")
        kept = np.flatnonzero(expected == wanted)
        kept = kept[workload.shuffled(len(kept))]
        assert some.dir.tobytes() == plain.dir[kept].tobytes()
        assert some.line["blocked"] == wanted * len(kept)


def test_rays_can_be_loaded(embree: bool, mesh: Path) -> None:
    path = mesh.parent / "loaded"
    org, dir = workload.random_segments(workload.load_mesh(mesh), 1000)
    np.concatenate([org, dir], axis=1).tofile(path)
    found = run(mesh, "workload", "--rays", "all", "--load-rays", str(path))
    blocked = built(workload.load_scene(mesh, "workload")).occluded(org, dir, 0.0, 1.0)
    assert found.written == blocked.astype(np.uint8).tobytes()


@pytest.mark.parametrize("samples", [1, 20, 256])
def test_embree_counts_all_rays_however_it_packs_them(
    embree: bool, mesh: Path, samples: int
) -> None:
    if not embree:
        pytest.skip("Embree is not installed")
    for name in workload.SCENES:
        options = ("--scene", name, "--size", str(SIZE), "--samples", str(samples))
        gbuffer = mesh.parent / f"{name}_{SIZE}.gbuf"
        modes = [f"robust-{kind}" for kind in ("1", "4", "s16", "x16", "p16", "stream")]
        counts = mesh.parent / "counts"
        images = []
        for mode in modes:
            arguments = (*options, "--gbuf", gbuffer, "--counts", counts)
            programs.run("embree", mesh, *arguments, mode)
            images.append(workload.load_counts(counts, SIZE, samples).astype(int))
        programs.run("vocc", mesh, *options, "--gbuf", gbuffer, "--counts", counts, "auto")
        ours = workload.load_counts(counts, SIZE, samples).astype(int)
        for image in images:
            # Packets round otherwise than single rays: a few rays through edges.
            assert np.abs(image - ours).sum() <= 1e-4 * samples * ours.size


def test_commands(
    embree: bool, mesh: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    output = tmp_path / "results.json"
    common = ["--meshes", str(mesh.parent), "--size", "12", "--rounds", "1", "-o", str(output)]
    assert bench.main(["versus", "--scene", "crowd,street", "--samples", "4,255", *common]) == 0
    results = json.loads(output.read_text())
    assert [(one["settings"]["scene"], one["settings"]["samples"]) for one in results["runs"]] == [
        ("crowd", 4),
        ("crowd", 255),
        ("street", 4),
        ("street", 255),
    ]
    assert capsys.readouterr().out.count("| torus ") == 4
    assert rays.main(["--samples", "4", "--python", *common]) == 0
    found = json.loads(output.read_text())["runs"][0]["meshes"]["torus"]
    assert set(found["cases"]) == {"in order", "shuffled", "blocked", "visible", "random"}
    blocked = found["cases"]["random"]["ours"]["auto"][0]["blocked"]
    assert found["python"]["pyvocc"]["random"]["blocked"] == blocked
    with pytest.raises(SystemExit):
        bench.main(["--samples", "257"])
    with pytest.raises(SystemExit):
        bench.main(["--scene", "moon"])
