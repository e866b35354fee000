"""Exact shadows and visibility on closed meshes.

    scene = pyvocc.Scene()
    scene.add_mesh(vertices, triangles, name="bunny")
    scene.build()
    shadowed = scene.occluded(points, towards_the_sun)

NumPy and cffi are all that this needs; glTF, EXR and PNG files need the extra "io".
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

from ._ffi import BOUNDARY, CLEAR, NOT_TRACED, OPAQUE, UNKNOWN
from ._ffi import version as _version
from ._query import QueryOptions, isa, isas
from .camera import PerspectiveCamera
from .errors import (
    Cancelled,
    Error,
    InvalidArgument,
    InvalidType,
    LimitError,
    MismatchError,
    OpenMeshError,
    OutOfMemory,
    StateError,
    ThreadError,
    UnsupportedError,
)
from .lights import DiskLight, Light, PointLight, RectLight, SphereLight, SpotLight, SunLight
from .report import (
    BuildSeconds,
    ComponentReport,
    MeshReport,
    RayClassification,
    Report,
    TreeReport,
)
from .scene import Hits, Scene, Solid
from .shadow import ShadingPoints, ShadowPass, shading_points, shadow_pass
from .stats import Stats

if TYPE_CHECKING:
    from .io import FileError, SceneFile, load_mesh, load_scene

__version__ = _version()

__all__ = [
    "BOUNDARY",
    "CLEAR",
    "NOT_TRACED",
    "OPAQUE",
    "UNKNOWN",
    "BuildSeconds",
    "Cancelled",
    "ComponentReport",
    "DiskLight",
    "Error",
    "FileError",
    "Hits",
    "InvalidArgument",
    "InvalidType",
    "Light",
    "LimitError",
    "MeshReport",
    "MismatchError",
    "OpenMeshError",
    "OutOfMemory",
    "PerspectiveCamera",
    "PointLight",
    "QueryOptions",
    "RayClassification",
    "RectLight",
    "Report",
    "Scene",
    "SceneFile",
    "ShadingPoints",
    "ShadowPass",
    "Solid",
    "SphereLight",
    "SpotLight",
    "StateError",
    "Stats",
    "SunLight",
    "ThreadError",
    "TreeReport",
    "UnsupportedError",
    "isa",
    "isas",
    "load_mesh",
    "load_scene",
    "shading_points",
    "shadow_pass",
]

# Loaded when first asked for: they need packages that the rest does not.
_LAZY = {"FileError": "io", "SceneFile": "io", "load_mesh": "io", "load_scene": "io"}


def __getattr__(name: str) -> Any:
    if name not in _LAZY:
        raise AttributeError(f"module 'pyvocc' has no attribute {name!r}")
    extra = _LAZY[name]
    try:
        module = importlib.import_module(f".{extra}", __name__)
    except ImportError as error:
        raise ImportError(
            f"pyvocc.{name} needs {error.name or error}: pip install 'pyvocc[{extra}]'",
            name=error.name,
        ) from error
    return getattr(module, name)


def __dir__() -> list[str]:
    return sorted(set(globals()) | set(__all__))
