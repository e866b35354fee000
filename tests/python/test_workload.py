"""The soft-shadow workload on real meshes: our counts against an independent program's.

The reference comes from Embree's robust mode, which is not exact.  Where a count differs,
exact arithmetic decides every ray of that pixel and light, and all of ours must be right.
The data is not part of the project; without it these tests are skipped.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import pyvocc

sys.path.append(str(Path(__file__).resolve().parents[2]))
from bench import compare, workload
from bench.rational import Oracle

SIZE, SAMPLES = 256, 16
SHARED = Path(__file__).resolve().parents[3] / "shared"

pytestmark = pytest.mark.skipif(
    not (SHARED / "workload").is_dir(), reason="the shared meshes and reference data are not here"
)


def built(mesh: workload.Mesh) -> pyvocc.Scene:
    scene = pyvocc.Scene()
    scene.add_mesh(mesh.vertices, mesh.triangles, name="mesh")
    scene.add_mesh(workload.GROUND_VERTICES, workload.GROUND_TRIANGLES, name="ground")
    scene.build()
    return scene


def image(scene: pyvocc.Scene, gbuffer: workload.GBuffer, **options: Any) -> NDArray[np.uint16]:
    """(lights, height, width) counts, in the reference's form."""
    pixels = gbuffer.tile_order()
    visible = scene.light_visibility(
        gbuffer.points[pixels],
        gbuffer.normals[pixels],
        [pyvocc.RectLight(*light) for light in workload.LIGHTS.astype(float).tolist()],
        samples=SAMPLES,
        point_ids=pixels,
        sampler="jitter",
        horizon="centre",
        **options,
    )
    counts = np.full((len(workload.LIGHTS), SIZE * SIZE), workload.NOT_TRACED, np.uint16)
    counts[:, pixels] = np.where(visible == pyvocc.NOT_TRACED, workload.NOT_TRACED, visible)
    return counts.reshape(-1, SIZE, SIZE)


@pytest.mark.parametrize("name", workload.MESHES)
def test_counts_equal_the_reference_or_are_right(name: str) -> None:
    mesh = workload.load_mesh(SHARED / "meshes" / f"{name}.ply")
    gbuffer = workload.load_gbuffer(SHARED / "workload" / f"{name}_{SIZE}.gbuf")
    counts = SHARED / "workload" / f"{name}_{SIZE}x{SAMPLES}.counts"
    scene = built(mesh)

    def trace(rays: compare.Rays) -> NDArray[np.bool_]:
        return scene.occluded(rays[:, :3], rays[:, 3:], tmax=1.0).astype(bool)

    verdict = compare.settle(
        name,
        lambda: Oracle(*mesh.with_ground()),
        gbuffer.points,
        SAMPLES,
        image(scene, gbuffer),
        workload.load_counts(counts, SIZE, SAMPLES),
        trace,
    )
    assert verdict.mistraced == 0
    assert verdict.ours_wrong == 0, "\n".join(map(str, verdict.differences))
    # A handful: more would mean that the two do not trace the same rays.
    assert len(verdict.differences) <= 10


WAYS: tuple[dict[str, Any], ...] = (
    {"order": "standard", "occluders": False},
    {"order": "standard", "occluders": False, "triangle_cache": True, "entry_points": True},
    {"order": "opaque_first", "cache_policy": "direction", "cache": 16},
    {"order": "opaque_first", "entry_points": True, "entry_triangles": 64, "packets": False},
    {"order": "rtsah", "voxels": 100, "fusion": False},
    {"order": "sato", "voxels": 20, "entry_points": True, "isa": "scalar"},
    {"order": "qdbfs", "deferment": 3, "entry_points": True, "entry_triangles": 0},
)


@pytest.mark.parametrize("name", workload.MESHES)
def test_no_way_of_tracing_changes_a_count(name: str) -> None:
    mesh = workload.load_mesh(SHARED / "meshes" / f"{name}.ply")
    gbuffer = workload.load_gbuffer(SHARED / "workload" / f"{name}_{SIZE}.gbuf")
    scene = built(mesh)
    expected = image(scene, gbuffer)
    for way in WAYS:
        assert np.array_equal(image(scene, gbuffer, **way), expected), way


def test_the_rays_are_the_same_in_python_and_in_the_library() -> None:
    """Single rays made here, one light of some pixels, give the counts of the pass."""
    mesh = workload.load_mesh(SHARED / "meshes" / "cowboy.ply")
    gbuffer = workload.load_gbuffer(SHARED / "workload" / f"cowboy_{SIZE}.gbuf")
    scene = built(mesh)
    counts = image(scene, gbuffer).reshape(len(workload.LIGHTS), -1)
    partly = np.argwhere((counts > 0) & (counts < SAMPLES))
    assert len(partly) > 1000
    for light, pixel in partly[:: len(partly) // 300].tolist():
        org = gbuffer.points[pixel]
        dir = workload.directions(light, pixel, org, SAMPLES)
        assert (~scene.occluded(org, dir, tmax=1.0)).sum() == counts[light, pixel]


def test_a_wrong_count_of_ours_is_noticed() -> None:
    """The judge must not side with us: a count that is off by one is ours to answer for."""
    mesh = workload.load_mesh(SHARED / "meshes" / "cowboy.ply")
    gbuffer = workload.load_gbuffer(SHARED / "workload" / f"cowboy_{SIZE}.gbuf")
    path = SHARED / "workload" / f"cowboy_{SIZE}x{SAMPLES}.counts"
    reference = workload.load_counts(path, SIZE, SAMPLES)
    ours = reference.copy()
    light, y, x = np.argwhere((reference > 0) & (reference < SAMPLES))[0]
    ours[light, y, x] -= 1
    oracle = Oracle(*mesh.with_ground())

    def trace(rays: compare.Rays) -> NDArray[np.bool_]:
        return np.array([oracle.occluded(ray[:3], ray[3:], tmax=1.0) for ray in rays])

    verdict = compare.settle(
        "cowboy", lambda: oracle, gbuffer.points, SAMPLES, ours, reference, trace
    )
    assert len(verdict.differences) == 1
    assert verdict.ours_wrong == 1
