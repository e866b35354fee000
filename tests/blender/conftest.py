"""Tests inside Blender's Python module: the add-on registered, empty files, no engine left over.

Started by `run.py`. pyvocc is the one installed beside bpy: the checkout is not on the path.
"""

from __future__ import annotations

import atexit
import importlib
import os
import sys
import tempfile
from collections.abc import Iterator, Sequence
from importlib.machinery import ModuleSpec, PathFinder
from pathlib import Path
from types import ModuleType

import pytest

ROOT = Path(__file__).resolve().parents[2]
PACKAGE = "blender_addon"

# The user's own add-ons and settings stay out; bpy reads this once, when it is imported.
_resources = tempfile.TemporaryDirectory(prefix="vocc-blender-")
os.environ["BLENDER_USER_RESOURCES"] = _resources.name

import bpy  # noqa: E402 - after the folder is set


class _AddonFinder:
    """Finds the add-on in the checkout, and nothing else there."""

    @staticmethod
    def find_spec(
        name: str, path: Sequence[str] | None = None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        return PathFinder.find_spec(name, [str(ROOT)]) if name == PACKAGE else None


sys.path[:] = [entry for entry in sys.path if Path(entry or ".").resolve() != ROOT]
sys.meta_path.insert(0, _AddonFinder)


def _engines(cls: type = bpy.types.RenderEngine) -> set[type]:
    found = set(cls.__subclasses__())
    return found.union(*(_engines(each) for each in found))


_ENGINES_OF_BLENDER = _engines()


def _unregister_engines() -> None:
    """An engine that stays registered makes Blender 4.5 hang at exit, and 4.2 crash."""
    for engine in _engines() - _ENGINES_OF_BLENDER:
        if getattr(engine, "is_registered", False):
            bpy.utils.unregister_class(engine)


atexit.register(_unregister_engines)


def pytest_report_header() -> str:
    return f"Blender {bpy.app.version_string}"


def pytest_unconfigure() -> None:
    _unregister_engines()
    _resources.cleanup()


@pytest.fixture(scope="session")
def root() -> Path:
    """The project's folder."""
    return ROOT


@pytest.fixture(scope="session")
def extension() -> Path:
    """The built extension, as the runner names it."""
    path = Path(os.environ.get("VOCC_ADDON", ROOT / "missing"))
    if not path.exists():
        pytest.skip("there is no built extension: make addon")
    return path


@pytest.fixture(scope="session")
def addon() -> Iterator[ModuleType]:
    """The add-on, registered."""
    module = importlib.import_module(PACKAGE)
    module.register()
    try:
        yield module
    finally:
        module.unregister()


@pytest.fixture
def empty() -> bpy.types.Scene:
    """The one scene of a new file: no objects, factory settings; one thread, so repeatable."""
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    scene: bpy.types.Scene = bpy.context.scene
    scene.render.threads_mode = "FIXED"
    scene.render.threads = 1
    return scene
