"""The C library, function by function: the only file that touches ffi and lib.

Arguments come checked in type, shape and integer range; everything else is the library's to
check, and its refusals are raised as exceptions.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields
from types import TracebackType
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ._arrays import AnyArray, Rows
from ._values import Vector, is_true
from ._vocc import ffi, lib
from .errors import EXCEPTIONS, InvalidArgument, from_status
from .lights import (
    DiskLight,
    Light,
    PointLight,
    RectLight,
    SphereLight,
    SpotLight,
    SunLight,
    named_in_python,
)
from .report import (
    BuildSeconds,
    ComponentReport,
    MeshReport,
    RayClassification,
    Report,
    TreeReport,
)
from .stats import Stats

Progress: TypeAlias = Callable[[float], object]

# A vocc_scene *, freed when the last reference to it goes: a call that is under way holds one.
Handle: TypeAlias = Any

ORDERS: Mapping[str, int] = {
    "auto": lib.VOCC_ORDER_AUTO,
    "standard": lib.VOCC_ORDER_STANDARD,
    "extended": lib.VOCC_ORDER_EXTENDED,
    "bfs": lib.VOCC_ORDER_BFS,
    "qdbfs": lib.VOCC_ORDER_QDBFS,
    "opaque_first": lib.VOCC_ORDER_OPAQUE_FIRST,
    "sato": lib.VOCC_ORDER_SATO,
    "rtsah": lib.VOCC_ORDER_RTSAH,
}
CACHE_POLICIES: Mapping[str, int] = {
    "recent": lib.VOCC_CACHE_RECENT,
    "direction": lib.VOCC_CACHE_DIRECTION,
}
METHODS: Mapping[str, int] = {
    "auto": lib.VOCC_METHOD_AUTO,
    "rays": lib.VOCC_METHOD_RAYS,
    "beams": lib.VOCC_METHOD_BEAMS,
}
ISAS: Mapping[str, int] = {
    "auto": lib.VOCC_ISA_AUTO,
    "scalar": lib.VOCC_ISA_SCALAR,
    "sse2": lib.VOCC_ISA_SSE2,
    "avx2": lib.VOCC_ISA_AVX2,
    "avx512": lib.VOCC_ISA_AVX512,
    "neon": lib.VOCC_ISA_NEON,
}
SAMPLERS: Mapping[str, int] = {
    "sobol": lib.VOCC_SAMPLER_SOBOL,
    "jitter": lib.VOCC_SAMPLER_JITTER,
}
HORIZONS: Mapping[str, int] = {
    "sample": lib.VOCC_HORIZON_SAMPLE,
    "centre": lib.VOCC_HORIZON_CENTRE,
}
BOUNDARY: int = lib.VOCC_BOUNDARY
CLEAR: int = lib.VOCC_CLEAR
OPAQUE: int = lib.VOCC_OPAQUE
UNKNOWN: int = lib.VOCC_UNKNOWN
NOT_TRACED: int = lib.VOCC_NOT_TRACED

LEAF = np.dtype(
    [
        ("lower", np.float32, 3),
        ("upper", np.float32, 3),
        ("label", np.int32),
        ("region", np.int32),
        ("first", np.uint32),
        ("count", np.uint32),
    ]
)
assert ffi.sizeof("vocc_leaf") == LEAF.itemsize

_TYPES = {
    np.dtype(np.float32): lib.VOCC_FLOAT32,
    np.dtype(np.float64): lib.VOCC_FLOAT64,
    np.dtype(np.int32): lib.VOCC_INT32,
    np.dtype(np.uint32): lib.VOCC_UINT32,
    np.dtype(np.int64): lib.VOCC_INT64,
    np.dtype(np.uint64): lib.VOCC_UINT64,
}
_LIGHT_TYPES: Mapping[type, int] = {
    RectLight: lib.VOCC_LIGHT_RECT,
    DiskLight: lib.VOCC_LIGHT_DISK,
    SphereLight: lib.VOCC_LIGHT_SPHERE,
    PointLight: lib.VOCC_LIGHT_POINT,
    SpotLight: lib.VOCC_LIGHT_SPOT,
    SunLight: lib.VOCC_LIGHT_SUN,
}
_STATUS = {getattr(lib, f"VOCC_ERROR_{name}"): name for name in EXCEPTIONS}
_COUNTERS = tuple(name for name, _ in ffi.typeof("vocc_counters").fields)


@dataclass(frozen=True)
class Query:
    """The fields of vocc_query_options by their names there."""

    order: int
    occluders: int
    deferment: int
    cache: int
    cache_policy: int
    fusion: int
    triangle_cache: int
    entry_points: int
    entry_triangles: int
    voxels: int
    method: int
    verify: int
    packets: int
    isa: int
    threads: int


@dataclass(frozen=True)
class Sampling:
    """The fields of vocc_sampling by their names there."""

    samples: int
    sampler: int
    horizon: int


def version() -> str:
    """ "major.minor.patch" of the library."""
    return _text(lib.vocc_version())


# ---- calls that may take long ------------------------------------------------


class _Call:
    """What a running call's progress callback needs, and what it raised."""

    __slots__ = ("error", "progress")

    def __init__(self, progress: Progress | None) -> None:
        self.progress = progress
        self.error: BaseException | None = None


def _keep_error(
    kind: type[BaseException], error: BaseException, traceback: TracebackType | None
) -> None:
    """Stores what left `pyvocc_progress`; KeyboardInterrupt may do so before its first line."""
    if traceback is not None:
        ffi.from_handle(traceback.tb_frame.f_locals["user"]).error = error


# Installed even where there is no `progress`: running Python at all is what lets Ctrl-C through.
@ffi.def_extern(name="pyvocc_progress", error=1, onerror=_keep_error)  # type: ignore[untyped-decorator]
def _pyvocc_progress(user: Any, fraction: float) -> int:
    call = ffi.from_handle(user)
    return call.progress is not None and is_true(call.progress(fraction))


def _run(
    function: Callable[..., int], args: Sequence[Any], options: Any, progress: Progress | None
) -> None:
    """Calls function(*args, options, error), and raises what it or its callback has to say."""
    call = _Call(progress)
    user = ffi.new_handle(call)
    options.progress = lib.pyvocc_progress
    options.progress_user = user
    error = ffi.new("vocc_error *")
    status = function(*args, options, error)
    raised, call.error = call.error, None
    if raised is not None:
        raise raised
    _check(status, error)


def _check(status: int, error: Any) -> None:
    if status != lib.VOCC_OK:
        raise from_status(
            _STATUS[status],
            _text(error.message) or _text(lib.vocc_status_string(status)),
            _text(error.argument),
            error.index,
            error.value,
        )


def _text(characters: Any) -> str:
    # A name that was cut may end inside a character.
    return str(ffi.string(characters).decode("utf-8", "replace"))


def _array(rows: Rows | None) -> tuple[Any, int, int]:
    """A vocc_array; None is NULL."""
    if rows is None:
        return (ffi.NULL, 0, lib.VOCC_FLOAT32)
    return (ffi.cast("void *", rows.address), rows.stride, _TYPES[rows.dtype])


def _pointer(kind: str, array: AnyArray | None) -> Any:
    if array is None:
        return ffi.NULL
    return ffi.cast(f"{kind} *", array.__array_interface__["data"][0])


# ---- scene -------------------------------------------------------------------


def create() -> Handle:
    """An empty scene."""
    scene, error = ffi.new("vocc_scene **"), ffi.new("vocc_error *")
    _check(lib.vocc_scene_create(ffi.NULL, scene, error), error)
    return ffi.gc(scene[0], lib.vocc_scene_free)


def add_mesh(
    scene: Handle,
    vertex_count: int,
    vertices: Rows,
    triangle_count: int,
    triangles: Rows,
    name: str,
    occluder: int,
) -> int:
    """The mesh's geom_id."""
    options = ffi.new("vocc_mesh_options *")
    lib.vocc_mesh_options_init(options)
    text = ffi.new("char[]", name.encode("utf-8"))
    options.name = text
    options.occluder = occluder
    geom_id, error = ffi.new("int32_t *"), ffi.new("vocc_error *")
    status = lib.vocc_scene_add_mesh(
        scene,
        vertex_count,
        _array(vertices),
        triangle_count,
        _array(triangles),
        options,
        geom_id,
        error,
    )
    _check(status, error)
    return int(geom_id[0])


def build(scene: Handle, values: Mapping[str, float], progress: Progress | None) -> None:
    """`values`: fields of vocc_build_options that differ from its defaults."""
    options = ffi.new("vocc_build_options *")
    lib.vocc_build_options_init(options)
    for name, value in values.items():
        setattr(options, name, value)
    _run(lib.vocc_scene_build, (scene,), options, progress)


def origin(scene: Handle) -> Vector:
    """What is subtracted from float64 coordinates."""
    result = ffi.new("double[3]")
    _check(lib.vocc_scene_origin(scene, result), ffi.new("vocc_error *"))
    return _vector(result)


def open_edges(scene: Handle, geom_id: int) -> NDArray[np.int32]:
    """(E, 2): prim_id and edge."""
    count, error = ffi.new("size_t *"), ffi.new("vocc_error *")
    _check(lib.vocc_scene_open_edges(scene, geom_id, 0, ffi.NULL, count, error), error)
    edges = np.empty((count[0], 2), np.int32)
    status = lib.vocc_scene_open_edges(
        scene, geom_id, len(edges), _pointer("int32_t", edges), count, error
    )
    _check(status, error)
    return edges


def region_info(scene: Handle, region: int) -> list[tuple[int, int]]:
    """Component and winding of each solid that the region lies in."""
    count, error = ffi.new("size_t *"), ffi.new("vocc_error *")
    call = lib.vocc_scene_region_info
    _check(call(scene, region, 0, ffi.NULL, ffi.NULL, count, error), error)
    size = count[0]
    components, windings = ffi.new("int32_t[]", size), ffi.new("int32_t[]", size)
    _check(call(scene, region, size, components, windings, count, error), error)
    return list(zip(components, windings, strict=True))


def leaves(scene: Handle) -> NDArray[np.void]:
    """One LEAF a leaf, in the tree's order."""
    count, error = ffi.new("size_t *"), ffi.new("vocc_error *")
    _check(lib.vocc_scene_leaves(scene, 0, ffi.NULL, count, error), error)
    result = np.empty(count[0], LEAF)
    status = lib.vocc_scene_leaves(scene, len(result), _pointer("vocc_leaf", result), count, error)
    _check(status, error)
    return result


def references(scene: Handle, first: int, count: int) -> NDArray[np.int32]:
    """(count, 2): geom_id and prim_id."""
    ids, error = np.empty((count, 2), np.int32), ffi.new("vocc_error *")
    _check(lib.vocc_scene_references(scene, first, count, _pointer("int32_t", ids), error), error)
    return ids


# ---- report ------------------------------------------------------------------


def report(scene: Handle) -> Report:
    """The built scene in figures."""
    c = _report(lib.vocc_scene_report, "vocc_report", scene)
    components = [_component_report(scene, index) for index in range(c.component_count)]
    return Report(
        meshes=tuple(_mesh_report(scene, index, components) for index in range(c.mesh_count)),
        tree=TreeReport(
            node_count=c.node_count,
            boundary_leaves=c.boundary_leaves,
            opaque_leaves=c.opaque_leaves,
            clear_leaves=c.clear_leaves,
            unknown_leaves=c.unknown_leaves,
            reference_count=c.reference_count,
            seed_rays=c.seed_rays,
            depth=c.depth,
            region_count=c.region_count,
            opaque_volume_fraction=c.opaque_volume_fraction,
            occluder_area=c.occluder_area,
            mesh_area=c.mesh_area,
            bytes=c.tree_bytes,
            auto_order=next(name for name, order in ORDERS.items() if order == c.auto_order),
        ),
        seconds=BuildSeconds(
            components=c.seconds_components,
            build=c.seconds_build,
            classify=c.seconds_classify,
            occluders=c.seconds_occluders,
            beams=c.seconds_beams,
            total=c.seconds_total,
        ),
        triangle_count=c.triangle_count,
        vertex_count=c.vertex_count,
        component_count=c.component_count,
        closed_count=c.closed_count,
        lower=_vector(c.lower),
        upper=_vector(c.upper),
        origin=origin(scene),
        beam_bytes=c.beam_bytes,
        threads=c.threads,
    )


def _mesh_report(scene: Handle, geom_id: int, components: Sequence[ComponentReport]) -> MeshReport:
    c = _report(lib.vocc_scene_mesh_report, "vocc_mesh_report", scene, geom_id)
    first = c.first_component
    return MeshReport(
        geom_id=geom_id,
        name=_text(c.name),
        occluder=bool(c.occluder),
        triangle_count=c.triangle_count,
        vertex_count=c.vertex_count,
        welded_vertices=c.welded_vertices,
        degenerate_triangles=c.degenerate_triangles,
        closed=bool(c.closed),
        boundary_edges=c.boundary_edges,
        nonmanifold_edges=c.nonmanifold_edges,
        inconsistent_edges=c.inconsistent_edges,
        volume=c.volume,
        components=tuple(components[first : first + c.component_count]),
    )


def _component_report(scene: Handle, index: int) -> ComponentReport:
    c = _report(lib.vocc_scene_component_report, "vocc_component_report", scene, index)
    return ComponentReport(
        index=index,
        geom_id=c.geom_id,
        triangle_count=c.triangle_count,
        first_triangle=c.first_triangle,
        closed=bool(c.closed),
        consistent=bool(c.consistent),
        boundary_edges=c.boundary_edges,
        nonmanifold_edges=c.nonmanifold_edges,
        inconsistent_edges=c.inconsistent_edges,
        volume=c.volume,
    )


def _report(function: Callable[..., int], kind: str, *args: Any) -> Any:
    result, error = ffi.new(f"{kind} *"), ffi.new("vocc_error *")
    result.size = ffi.sizeof(kind)
    _check(function(*args, result, error), error)
    return result


def _vector(doubles: Any) -> Vector:
    return (doubles[0], doubles[1], doubles[2])


# ---- queries -----------------------------------------------------------------


def query_isa(isa: int) -> int:
    """The instruction set of a query that asks for this one."""
    options = ffi.new("vocc_query_options *")
    lib.vocc_query_options_init(options)
    options.isa = isa
    return _isa_of(options)


def isa_name(isa: int) -> str:
    """The library's name of it."""
    return _text(lib.vocc_isa_name(isa))


def _isa_of(options: Any) -> int:
    result, error = ffi.new("int32_t *"), ffi.new("vocc_error *")
    _check(lib.vocc_query_isa(options, result, error), error)
    return int(result[0])


def _query(
    function: Callable[..., int],
    args: Sequence[Any],
    query: Query,
    progress: Progress | None,
    stats: Stats | None,
    steps: AnyArray | None = None,
) -> None:
    options = ffi.new("vocc_query_options *")
    lib.vocc_query_options_init(options)
    for field in fields(query):
        setattr(options, field.name, getattr(query, field.name))
    if steps is not None:
        options.point_steps = _pointer("uint32_t", steps)
    if stats is None:
        _run(function, args, options, progress)
        return
    counters = ffi.new("vocc_counters *")
    options.counters = counters
    options.isa = _isa_of(options)
    _run(function, args, options, progress)
    stats.add({name: getattr(counters, name) for name in _COUNTERS})
    stats.isa = isa_name(options.isa)


def _rays(count: int, org: Rows, dir: Rows, tmin: Rows | None, tmax: Rows | None) -> Any:
    return ffi.new("vocc_rays *", (count, _array(org), _array(dir), _array(tmin), _array(tmax)))


def shading_points(
    scene: Handle,
    count: int,
    org: Rows,
    dir: Rows,
    offset: float,
    hits: Sequence[AnyArray],
    position: AnyArray,
    normal: AnyArray,
    query: Query,
    progress: Progress | None,
) -> None:
    """Fills hits: t, geom_id, prim_id; and position, normal: (count, 3) float32."""
    t, geom_id, prim_id = hits
    outputs = ffi.new(
        "vocc_hits *",
        (
            _pointer("float", t),
            _pointer("int32_t", geom_id),
            _pointer("int32_t", prim_id),
            ffi.NULL,
            ffi.NULL,
        ),
    )
    args = (
        scene,
        _rays(count, org, dir, None, None),
        offset,
        outputs,
        _pointer("float", position),
        _pointer("float", normal),
    )
    _query(lib.vocc_shading_points, args, query, progress, None)


def intersect(
    scene: Handle,
    count: int,
    org: Rows,
    dir: Rows,
    tmin: Rows | None,
    tmax: Rows | None,
    hits: Sequence[AnyArray],
    query: Query,
    progress: Progress | None,
    stats: Stats | None,
) -> None:
    """Fills hits: t, geom_id, prim_id, u, v."""
    t, geom_id, prim_id, u, v = hits
    outputs = ffi.new(
        "vocc_hits *",
        (
            _pointer("float", t),
            _pointer("int32_t", geom_id),
            _pointer("int32_t", prim_id),
            _pointer("float", u),
            _pointer("float", v),
        ),
    )
    rays = _rays(count, org, dir, tmin, tmax)
    _query(lib.vocc_intersect, (scene, rays, outputs), query, progress, stats)


def occluded(
    scene: Handle,
    count: int,
    org: Rows,
    dir: Rows,
    tmin: Rows | None,
    tmax: Rows | None,
    result: AnyArray,
    query: Query,
    progress: Progress | None,
    stats: Stats | None,
) -> None:
    """Fills result: 1 or 0 in one byte each."""
    args = (scene, _rays(count, org, dir, tmin, tmax), _pointer("uint8_t", result))
    _query(lib.vocc_occluded, args, query, progress, stats)


def region(
    scene: Handle,
    count: int,
    points: Rows,
    result: AnyArray,
    query: Query,
    progress: Progress | None,
    stats: Stats | None,
) -> None:
    """Fills result: int32 each."""
    args = (scene, count, _array(points), _pointer("int32_t", result))
    _query(lib.vocc_region, args, query, progress, stats)


def classify_by_rays(
    scene: Handle, direction: Vector | None, query: Query, progress: Progress | None
) -> RayClassification:
    """One test ray a leaf; None is the library's direction."""
    flood = leaves(scene)["label"]
    labels = np.empty(len(flood), np.int32)
    result = ffi.new("vocc_ray_classification *")
    result.size = ffi.sizeof("vocc_ray_classification")
    vector = ffi.NULL if direction is None else ffi.new("double[3]", direction)
    args = (scene, vector, len(labels), _pointer("int32_t", labels), result)
    _query(lib.vocc_scene_classify_by_rays, args, query, progress, None)
    both = (flood != UNKNOWN) & (labels != UNKNOWN)
    return RayClassification(
        labels=labels,
        disagreements=np.flatnonzero(both & (flood != labels)),
        rays=result.rays,
        seconds=result.seconds,
        threads=result.threads,
    )


def light_visibility(
    scene: Handle,
    count: int,
    points: Rows,
    normals: Rows,
    point_ids: Rows | None,
    lights: Sequence[Light],
    sampling: Sampling,
    visible: AnyArray | None,
    irradiance: AnyArray | None,
    blocked: AnyArray | None,
    query: Query,
    progress: Progress | None,
    stats: Stats | None,
    steps: AnyArray | None,
) -> None:
    """Fills visible: (lights, count) uint16; irradiance, float32; and steps: (count) uint32."""
    args = (
        scene,
        count,
        _array(points),
        _array(normals),
        _array(point_ids),
        len(lights),
        ffi.new(
            "vocc_light[]",
            [{"type": _LIGHT_TYPES[type(light)], **light._fields()} for light in lights],
        ),
        _sampling(sampling),
        _pointer("uint16_t", visible),
        _pointer("float", irradiance),
        _pointer("uint8_t", blocked),
    )
    try:
        _query(lib.vocc_light_visibility, args, query, progress, stats, steps)
    except InvalidArgument as error:
        raise named_in_python(error, lights) from None


def ambient_occlusion(
    scene: Handle,
    count: int,
    points: Rows,
    normals: Rows,
    point_ids: Rows | None,
    distance: float,
    sampling: Sampling,
    open: AnyArray,
    blocked: AnyArray | None,
    query: Query,
    progress: Progress | None,
    stats: Stats | None,
    steps: AnyArray | None,
) -> None:
    """Fills open: (count) uint16, and steps: (count) uint32."""
    args = (
        scene,
        count,
        _array(points),
        _array(normals),
        _array(point_ids),
        distance,
        _sampling(sampling),
        _pointer("uint16_t", open),
        _pointer("uint8_t", blocked),
    )
    _query(lib.vocc_ambient_occlusion, args, query, progress, stats, steps)


def _sampling(sampling: Sampling) -> Any:
    result = ffi.new("vocc_sampling *")
    result.size = ffi.sizeof("vocc_sampling")
    for field in fields(sampling):
        setattr(result, field.name, getattr(sampling, field.name))
    return result
