"""What Python adds to the C time of `light_visibility`, on the same scene and arrays.

The C time is that of the library's function called with ready pointers, in the same process,
in alternation with the method.
"""

from __future__ import annotations

import time
from typing import Any

import numpy as np

from .inputs import Input
from .measure import Say, Settings
from .programs import BenchError, pinned, run
from .workload import GROUND_TRIANGLES, GROUND_VERTICES, load_gbuffer, load_scene


def overhead(item: Input, settings: Settings, say: Say) -> dict[str, Any]:
    """{"python": [seconds, ...], "c": [...], "rays": n}; one thread, CPU time."""
    try:
        import pyvocc
        from pyvocc._vocc import ffi, lib
    except ImportError as error:
        raise BenchError(f"--python: {error}") from None
    path = item.gbuffer(settings.size, settings.scene)
    if not path.exists():
        run("vocc", *settings.arguments(item), "none")
    gbuffer = load_gbuffer(path)
    pixels = gbuffer.tile_order()
    points, normals = gbuffer.points[pixels], gbuffer.normals[pixels]
    placed = load_scene(item.path, settings.scene)
    scene = pyvocc.Scene(threads=1)
    scene.add_mesh(placed.mesh.vertices, placed.mesh.triangles, name=item.name)
    scene.add_mesh(GROUND_VERTICES, GROUND_TRIANGLES, name="ground")
    scene.build()
    corners = placed.lights.astype(float).tolist()
    lights = [pyvocc.RectLight(*light) for light in corners]

    options = ffi.new("vocc_query_options *")
    lib.vocc_query_options_init(options)
    options.threads = 1
    rows = [
        (ffi.cast("void *", array.ctypes.data), array.strides[0], kind)
        for array, kind in (
            (points, lib.VOCC_FLOAT32),
            (normals, lib.VOCC_FLOAT32),
            (pixels, lib.VOCC_UINT32),
        )
    ]
    sampling = ffi.new("vocc_sampling *")
    lib.vocc_sampling_init(sampling)
    sampling.samples = settings.samples
    sampling.sampler, sampling.horizon = lib.VOCC_SAMPLER_JITTER, lib.VOCC_HORIZON_CENTRE
    fields = ("position", "edge_u", "edge_v")
    c_lights = ffi.new(
        "vocc_light[]",
        [dict(zip(fields, light, strict=True)) for light in corners],
    )

    def in_c() -> np.ndarray[Any, np.dtype[np.uint16]]:
        visible = np.empty((len(lights), len(pixels)), np.uint16)
        status = lib.vocc_light_visibility(
            scene._scene,
            len(pixels),
            *rows,
            len(lights),
            c_lights,
            sampling,
            ffi.cast("uint16_t *", visible.ctypes.data),
            ffi.NULL,
            ffi.NULL,
            options,
            ffi.NULL,
        )
        if status != lib.VOCC_OK:
            raise BenchError(f"vocc_light_visibility: status {status}")
        return visible

    def in_python() -> np.ndarray[Any, np.dtype[np.uint16]]:
        return scene.light_visibility(
            points,
            normals,
            lights,
            settings.samples,
            pixels,
            sampler="jitter",
            horizon="centre",
        )

    result: dict[str, Any] = {"c": [], "python": []}
    with pinned(settings.pinned):
        for _ in range(settings.rounds):
            for name, function in (("c", in_c), ("python", in_python)):
                begin = time.process_time()
                visible = function()
                result[name].append(time.process_time() - begin)
    traced = visible != pyvocc.NOT_TRACED
    result["rays"] = int(traced.sum()) * settings.samples
    result["same"] = bool((in_c() == visible).all())
    say(f"{item.name}: Python")
    return result
