"""Python libraries that say of segments whether something is in the way, each on one thread.

for library in available(print):
    blocked = library.load(vertices, triangles)(org, dir)
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

import pyvocc

Floats: TypeAlias = NDArray[np.float32]
Triangles: TypeAlias = NDArray[np.int32]

# org, dir -> a call that traces; what it returns is turned into bool by the second function.
Trace: TypeAlias = Callable[[], Any]
Prepare: TypeAlias = Callable[[Floats, Floats], tuple[Trace, Callable[[Any], NDArray[np.bool_]]]]


@dataclass(frozen=True)
class Library:
    name: str
    load: Callable[[Floats, Triangles], Prepare]


def _pyvocc(vertices: Floats, triangles: Triangles) -> Prepare:
    scene = pyvocc.Scene(threads=1)
    # The ground is open: a mesh of its own, so that the other one keeps its inside.
    scene.add_mesh(vertices[:-4], triangles[:-2], name="mesh")
    scene.add_mesh(vertices[-4:], triangles[-2:] - np.int32(len(vertices) - 4), name="ground")
    scene.build()
    return lambda org, dir: (lambda: scene.occluded(org, dir, 0.0, 1.0), np.asarray)


def _embreex(vertices: Floats, triangles: Triangles) -> Prepare:
    construction: Any = import_module("embreex.mesh_construction")
    scene: Any = import_module("embreex.rtcore_scene").EmbreeScene()
    mesh = construction.TriangleMesh(scene, vertices[triangles])

    def prepare(org: Floats, dir: Floats) -> Any:
        far = np.ones(len(org), np.float32)

        def trace(_: Any = mesh) -> Any:  # which must live as long as the scene
            return scene.run(org, dir, far, query="OCCLUDED")

        return trace, lambda hit: hit != -1

    return prepare


def _mitsuba(vertices: Floats, triangles: Triangles) -> Prepare:
    drjit: Any = import_module("drjit")
    mitsuba: Any = import_module("mitsuba")
    mitsuba.set_variant("llvm_ad_rgb")
    drjit.set_thread_count(1)
    mesh = mitsuba.Mesh("mesh", len(vertices), len(triangles))
    values = mitsuba.traverse(mesh)
    values["vertex_positions"] = mitsuba.Float(vertices.ravel())
    values["faces"] = mitsuba.UInt32(triangles.astype(np.uint32).ravel())
    values.update()
    scene = mitsuba.load_dict({"type": "scene", "mesh": mesh})

    def prepare(org: Floats, dir: Floats) -> Any:
        ray = mitsuba.Ray3f(
            mitsuba.Point3f(np.ascontiguousarray(org.T)),
            mitsuba.Vector3f(np.ascontiguousarray(dir.T)),
        )
        ray.maxt = mitsuba.Float(1.0)
        drjit.eval(ray)

        def trace() -> Any:
            blocked = scene.ray_test(ray, coherent=False)
            drjit.eval(blocked)
            drjit.sync_thread()
            return blocked

        return trace, np.array

    return prepare


def available(say: Callable[[str], None]) -> list[Library]:
    """Those that are installed and work; of the others it says what is missing."""
    found = [Library("pyvocc", _pyvocc)]
    vertices = np.array([(0, 0, 1), (4, 0, 1), (0, 4, 1), (0, 0, 2)], np.float32)
    triangles = np.array([(0, 1, 2), (1, 2, 3)], np.int32)
    org, dir = np.array([[1, 1, 0]], np.float32), np.array([[0, 0, 2]], np.float32)
    for library in (Library("embreex", _embreex), Library("mitsuba", _mitsuba)):
        try:
            trace, result = library.load(vertices, triangles)(org, dir)
            if not result(trace())[0]:
                raise RuntimeError("it misses a triangle")
            found.append(library)
        except ImportError:
            say(f"{library.name} is not installed (pip install {library.name}): left out")
        except Exception as error:  # whatever a missing libLLVM becomes
            say(f"{library.name}: {error}: left out")
    return found
