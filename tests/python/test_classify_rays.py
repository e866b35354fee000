"""The paper's classification, one test ray a leaf, beside the flood fill of the build."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest
import shapes

import pyvocc


def labels_of(scene: pyvocc.Scene) -> Any:
    return scene.leaves()["label"]


def built(vertices: Any, triangles: Any, **options: Any) -> pyvocc.Scene:
    scene = pyvocc.Scene()
    scene.add_mesh(vertices, triangles, **options)
    scene.build()
    return scene


@pytest.mark.parametrize(
    "direction", [None, (0.3, -0.8, 0.5), [1e-200, 3e-200, -2e-200], np.float32([-7, 1, 2])]
)
def test_it_is_what_the_flood_fill_says(torus: pyvocc.Scene, direction: Any) -> None:
    result = torus.classify_by_rays(direction)
    assert result.labels.dtype == np.int32
    np.testing.assert_array_equal(result.labels, labels_of(torus))
    assert result.disagreements.shape == (0,)
    assert result.rays == np.count_nonzero(result.labels)
    assert result.seconds > 0
    assert result.threads >= 1
    with pytest.raises(dataclasses.FrozenInstanceError):
        result.rays = 0  # type: ignore[misc]


def test_threads_change_nothing(torus: pyvocc.Scene) -> None:
    alone = torus.classify_by_rays((1, 0, 0), threads=1)
    both = torus.classify_by_rays((1, 0, 0), threads=2)
    np.testing.assert_array_equal(alone.labels, both.labels)
    assert (alone.threads, both.threads) == (1, 2)


def test_inside_out_the_labels_are_wrong_and_the_scene_is_not() -> None:
    vertices, triangles = shapes.torus(64, 24)
    scene = built(vertices, triangles[:, ::-1])
    flood = labels_of(scene)
    result = scene.classify_by_rays()
    assert (result.labels[flood == pyvocc.OPAQUE] == pyvocc.CLEAR).all()
    assert set(result.disagreements) >= set(np.flatnonzero(flood == pyvocc.OPAQUE))
    outside = result.disagreements[flood[result.disagreements] == pyvocc.CLEAR]
    assert len(outside)
    assert (result.labels[outside] == pyvocc.OPAQUE).all()
    np.testing.assert_array_equal(labels_of(scene), flood)


def test_an_open_mesh_has_no_inside_but_rays_find_one() -> None:
    vertices, triangles = shapes.torus(64, 24)
    scene = built(vertices, triangles[:-1])
    result = scene.classify_by_rays()
    assert not (labels_of(scene) == pyvocc.OPAQUE).any()
    np.testing.assert_array_equal(
        result.disagreements, np.flatnonzero(result.labels == pyvocc.OPAQUE)
    )
    assert len(result.disagreements) > 100


def test_far_away_and_empty() -> None:
    vertices, triangles = shapes.torus(64, 24)
    far = built(vertices.astype(np.float64) + 5e5, triangles)
    assert far.origin.all()
    result = far.classify_by_rays()
    np.testing.assert_array_equal(result.labels, labels_of(far))
    assert (result.labels == pyvocc.OPAQUE).any()
    empty = pyvocc.Scene()
    empty.build()
    assert empty.classify_by_rays().rays == 0


@pytest.mark.parametrize(
    ("direction", "error", "words"),
    [
        ((0, 0, 0), pyvocc.InvalidArgument, "direction is 0"),
        ((1, np.nan, 0), pyvocc.InvalidArgument, r"direction\[1\] must be finite"),
        ((1, 0, np.inf), pyvocc.InvalidArgument, r"direction\[2\] must be finite"),
        ((1, 0), pyvocc.InvalidArgument, "direction must be 3 numbers"),
        (1.0, pyvocc.InvalidType, "direction must be 3 numbers"),
        ("xyz", pyvocc.InvalidType, "direction must be 3 numbers"),
    ],
)
def test_a_bad_direction_is_named(
    cube: pyvocc.Scene, direction: Any, error: type[Exception], words: str
) -> None:
    with pytest.raises(error, match=words):
        cube.classify_by_rays(direction)
