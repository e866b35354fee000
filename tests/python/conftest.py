"""Fixtures: scenes that many tests ask, and random rays."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import shapes
from hypothesis import settings
from numpy.typing import NDArray

import pyvocc

# The same examples in every run, so that a failure is one for everybody.
settings.register_profile("same", derandomize=True, deadline=None, print_blob=True)
settings.load_profile("same")

ROOT = Path(__file__).resolve().parents[2]

Rays = tuple[NDArray[np.float32], NDArray[np.float32]]
RandomRays = Callable[[int], Rays]

# Reference data that lies beside the checkout where it is developed; tests skip without it.
SHARED = ROOT.parent / "shared"


@pytest.fixture(scope="session")
def root() -> Path:
    """The project's folder."""
    return ROOT


@pytest.fixture(scope="session")
def cube() -> pyvocc.Scene:
    """A cube from -1 to 1."""
    scene = pyvocc.Scene(threads=1)
    scene.add_mesh(*shapes.cube(), name="cube")
    scene.build()
    return scene


@pytest.fixture(scope="session")
def torus() -> pyvocc.Scene:
    """12 800 triangles: a tree with leaves of every label, and occluders that are used."""
    scene = pyvocc.Scene()
    scene.add_mesh(*shapes.torus(128, 50), name="torus")
    scene.build()
    return scene


@pytest.fixture
def random_rays() -> RandomRays:
    """A function of a count: origins about the unit ball, directions towards its inside."""

    def rays(count: int) -> Rays:
        random = np.random.default_rng(7)
        org = random.normal(size=(count, 3))
        dir = random.uniform(-1, 1, size=(count, 3)) - org
        return org.astype(np.float32), dir.astype(np.float32)

    return rays
