"""The scene: meshes, the kd-tree over them, and what can be asked of it."""

from __future__ import annotations

import math
import threading
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from types import TracebackType
from typing import NamedTuple, NoReturn, Self, Unpack

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _ffi
from ._arrays import AnyArray, floats, integers, output, rows, split_rows
from ._ffi import Progress
from ._query import (
    QueryOptions,
    blocked_bits,
    check_ids,
    checked_progress,
    checked_stats,
    query_of,
    rays_of,
    sampling_of,
    shading_rows,
    threads_or,
)
from ._values import flag, integer, number, vector
from .errors import InvalidType, StateError
from .lights import Light, checked_lights
from .mesh import Geometry, checked_triangles, checked_vertices
from .report import RayClassification, Report
from .stats import Stats


class Hits(NamedTuple):
    """Closest hits, each array of the rays' leading shape.

    Attributes:
        t: float32, in units of dir; infinity for a miss.
        geom_id: int32, the mesh; -1 for a miss.
        prim_id: int32, the triangle in the mesh; -1 for a miss.
        u, v: float32; the hit point is (1 - u - v) v0 + u v1 + v v2. 0 for a miss.
    """

    t: NDArray[np.float32]
    geom_id: NDArray[np.int32]
    prim_id: NDArray[np.int32]
    u: NDArray[np.float32]
    v: NDArray[np.float32]


class Solid(NamedTuple):
    """A closed component that a region lies in.

    Attributes:
        geom_id: its mesh.
        component: its index in the scene.
        winding: how often it winds about the region; 1 where it is not wound consistently.
    """

    geom_id: int
    component: int
    winding: int


class Scene:
    """Meshes, and after `build` queries against them.

    Args:
        threads: threads of every call on this scene unless the call says otherwise, 1 to
            256; None for one a processor. Results do not depend on it.

    A scene may be used by one thread at a time until it is built, after that by any number at
    once. All calls release the GIL while they compute. A scene is freed by `close`, by the end
    of a `with` block, or with its last reference; a call under way in another thread ends
    first. It cannot be pickled or copied.

    `progress`, where a call takes it, is a function of one float, the fraction done from 0 to
    1. It runs on the calling thread. If it returns True the call stops with `Cancelled`; what
    it raises leaves the call. Ctrl-C stops every call, with or without it.

    Arrays: any leading shape is kept, so that one ray has shape (3,) and an image of them
    (height, width, 3); leading shapes of the arguments broadcast. float32 and float64 are
    taken as they are, without a copy where the last axis is contiguous and the leading axes
    have one common distance between rows; other real types are converted.

    Raises, in all methods:
        InvalidArgument (a ValueError): a value, shape or range that is not accepted.
        InvalidType (a TypeError): an argument of a wrong type.
        StateError (a RuntimeError): the scene is closed; not built before a query; built
            already before `add_mesh` or `build`; used by another thread before it is built.
        OutOfMemory (a MemoryError), ThreadError, UnsupportedError, Cancelled: as they say.
    """

    def __init__(self, threads: int | None = None) -> None:
        self._threads = threads_or(threads, 0)
        self._scene: _ffi.Handle | None = _ffi.create()
        self._report: Report | None = None
        # Held by the calls on a scene that is not built: the library allows one at a time.
        self._busy = threading.Lock()
        self._meshes: list[tuple[AnyArray, AnyArray]] = []
        self._geometry = Geometry([], (0.0, 0.0, 0.0))

    # ---- life ----------------------------------------------------------------

    def close(self) -> None:
        """Frees the scene; closing twice is allowed. `report` stays."""
        self._scene = None
        self._meshes = []
        self._geometry = Geometry([], (0.0, 0.0, 0.0))

    def __enter__(self) -> Self:
        self._open()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self.close()

    def __reduce__(self) -> NoReturn:
        raise InvalidType("a Scene cannot be pickled or copied: add its meshes to a new one")

    def __repr__(self) -> str:
        state = "closed" if self._scene is None else "built" if self._report else "not built"
        return f"<pyvocc.Scene: {state}>"

    @property
    def closed(self) -> bool:
        """`close` was called."""
        return self._scene is None

    @property
    def built(self) -> bool:
        """`build` has succeeded."""
        return self._report is not None

    def _open(self) -> _ffi.Handle:
        if self._scene is None:
            raise StateError("the scene is closed")
        return self._scene

    @contextmanager
    def _borrow(self) -> Iterator[_ffi.Handle]:
        """The library's scene, for the time of a call."""
        if self.built:
            yield self._open()
            return
        if not self._busy.acquire(blocking=False):
            raise StateError(
                "another call is under way: until a scene is built it takes one at a time"
            )
        try:
            yield self._open()
        finally:
            self._busy.release()

    # ---- meshes and build ----------------------------------------------------

    def add_mesh(
        self,
        vertices: ArrayLike,
        triangles: ArrayLike,
        name: str = "",
        occluder: bool = True,
    ) -> int:
        """Adds a mesh; the arrays are copied.

        Args:
            vertices: (V, 3) float32 or float64, finite. float64 coordinates are moved by a
                common origin before they are rounded to float32 (see `origin`), unless all
                of them are float32 numbers and near to zero already.
            triangles: (T, 3) integers, each from 0 to V - 1. Degenerate and repeated
                triangles are accepted; one without area is never hit.
            name: for the report; cut after 63 bytes.
            occluder: its closed components may hold volumetric occluders. False: it is
                traced as triangles only.

        Returns:
            The mesh's geom_id: 0, 1, 2, ...

        Raises:
            InvalidArgument: names the first vertex that is not finite, or the first index
                out of range.
            LimitError: more than 2^27 triangles or 2^31 - 1 vertices in the scene.
        """
        points, corners = checked_vertices(vertices), checked_triangles(triangles)
        if not isinstance(name, str):
            raise InvalidType(f"name must be a string, not {type(name).__name__}", argument="name")
        with self._borrow() as scene:
            geom_id = _ffi.add_mesh(
                scene,
                len(points),
                rows(points, points.shape[:1], (3,)),
                len(corners),
                rows(corners, corners.shape[:1], (3,)),
                name,
                flag("occluder", occluder),
            )
            try:
                # For `corners`, which the library does not tell.
                self._meshes.append((points.copy(), corners.astype(np.int32)))
            except BaseException:
                # The library cannot take a mesh back; a scene that knows half of it is no use.
                self.close()
                raise
        return geom_id

    def build(
        self,
        progress: Progress | None = None,
        *,
        threads: int | None = None,
        traversal_cost: float | None = None,
        intersection_cost: float | None = None,
        empty_bonus: float | None = None,
        max_leaf_size: int | None = None,
        max_depth: int | None = None,
        bad_refines: int | None = None,
        strict: bool = False,
    ) -> Report:
        """Builds the kd-tree and classifies its leaves; no mesh can be added afterwards.

        Args:
            progress: see the class.
            threads: as in the constructor, for this call. The tree does not depend on it.
            traversal_cost: SAH cost of a traversal step, > 0; default 1.
            intersection_cost: SAH cost of a triangle test, > 0; default 0, for 0.65, and for
                more than 100 000 triangles 0.4.
            empty_bonus: share of the cost that an empty child saves, 0 to 1; default 0.2.
            max_leaf_size: leaves with more triangles are split even where the SAH would
                not, 1 to 2^20; default 64.
            max_depth: 1 to 60; default 0, for 8 + 1.6 log2(triangles).
            bad_refines: splits in a row that the SAH finds too dear but are tried, 0 to 16;
                default 0.
            strict: a mesh that is not closed is an error, unless it was added with
                occluder=False.

        Returns:
            The report, which is also kept as `report`.

        Raises:
            OpenMeshError: `strict`, and a mesh is not closed; `index` is its geom_id.
        """
        options: dict[str, float] = {
            "threads": threads_or(threads, self._threads),
            "strict": flag("strict", strict),
        }
        for key, real in (
            ("traversal_cost", traversal_cost),
            ("intersection_cost", intersection_cost),
            ("empty_bonus", empty_bonus),
        ):
            if real is not None:
                options[key] = number(key, real)
        for key, count in (
            ("max_leaf_size", max_leaf_size),
            ("max_depth", max_depth),
            ("bad_refines", bad_refines),
        ):
            if count is not None:
                options[key] = integer(key, count)
        with self._borrow() as scene:
            _ffi.build(scene, options, checked_progress(progress))
            report = _ffi.report(scene)
            self._geometry = Geometry(self._meshes, report.origin)
            self._meshes = []
            self._report = report
        return report

    @property
    def report(self) -> Report:
        """What `build` found out."""
        if self._report is None:
            raise StateError("the scene has no report before it is built")
        return self._report

    @property
    def origin(self) -> NDArray[np.float64]:
        """(3,): the point that is subtracted from float64 coordinates before they are rounded
        to float32; zero where all were float32 numbers and near to zero already."""
        return np.array(self.report.origin)

    # ---- queries -------------------------------------------------------------

    def intersect(
        self,
        org: ArrayLike,
        dir: ArrayLike,
        tmin: ArrayLike = 0.0,
        tmax: ArrayLike = np.inf,
        *,
        packets: bool = True,
        isa: str = "auto",
        threads: int | None = None,
        progress: Progress | None = None,
        stats: Stats | None = None,
    ) -> Hits:
        """The closest hit of each ray org + t dir with t strictly between tmin and tmax.

        Args:
            org, dir: (..., 3) float32 or float64. dir need not have unit length. A ray with
                a NaN or infinite component, or a dir of length zero, meets nothing.
            tmin, tmax: (...), in units of dir; tmin may be negative. A ray with a NaN, or
                tmin >= tmax, meets nothing.
            packets: rays are traced four at a time.
            isa: "auto", or one of `pyvocc.isas()`.
            threads, progress: see the class.
            stats: counters that are added to.

        Returns:
            Hits with the broadcast leading shape. The closest hit has the smallest t as
            rounded to float32; among equals the smallest (geom_id, prim_id).
        """
        count, lead, rays = rays_of(org, dir, tmin, tmax)
        query = query_of(self._threads, {"packets": packets, "isa": isa, "threads": threads})
        hits = Hits(
            np.empty(lead, np.float32),
            np.empty(lead, np.int32),
            np.empty(lead, np.int32),
            np.empty(lead, np.float32),
            np.empty(lead, np.float32),
        )
        with self._borrow() as scene:
            _ffi.intersect(
                scene, count, *rays, hits, query, checked_progress(progress), checked_stats(stats)
            )
        return hits

    def occluded(
        self,
        org: ArrayLike,
        dir: ArrayLike,
        tmin: ArrayLike = 0.0,
        tmax: ArrayLike = np.inf,
        *,
        progress: Progress | None = None,
        stats: Stats | None = None,
        out: NDArray[np.bool_] | NDArray[np.uint8] | None = None,
        **options: Unpack[QueryOptions],
    ) -> NDArray[np.bool_] | NDArray[np.uint8]:
        """Whether each ray org + t dir crosses a triangle, t strictly between tmin and tmax.

        The answer is exact, and no option can change it; see docs/method.md.

        Args:
            org, dir, tmin, tmax: as in `intersect`.
            progress, stats: as in `intersect`.
            out: a C-contiguous array of bool or uint8 with the result's shape, which is
                filled and returned.
            **options: how it is done: order, occluders, cache, threads, ...; see
                `QueryOptions`.

        Returns:
            bool with the broadcast leading shape, or `out`.

        Raises:
            UnsupportedError: the library has no such order or isa.
        """
        count, lead, rays = rays_of(org, dir, tmin, tmax)
        query = query_of(self._threads, options)
        result = output("out", out, lead, (np.bool_, np.uint8))
        with self._borrow() as scene:
            _ffi.occluded(
                scene, count, *rays, result, query, checked_progress(progress), checked_stats(stats)
            )
        return result

    def region(
        self,
        points: ArrayLike,
        *,
        threads: int | None = None,
        progress: Progress | None = None,
        stats: Stats | None = None,
    ) -> NDArray[np.int32]:
        """The region of each point.

        Args:
            points: (..., 3) float32 or float64.
            threads, progress, stats: as in `intersect`.

        Returns:
            int32 with the leading shape: 0 outside every closed solid; > 0 inside, see
            `region_solids`; -1 exactly on the surface of a closed solid; -2 for a point that
            is NaN or infinite.

        Raises:
            LimitError: more than 2^31 - 1 distinct regions.
        """
        array = floats("points", points)
        lead = split_rows("points", array, 3)
        query = query_of(self._threads, {"threads": threads})
        result = np.empty(lead, np.int32)
        with self._borrow() as scene:
            _ffi.region(
                scene,
                result.size,
                rows(array, lead, (3,)),
                result,
                query,
                checked_progress(progress),
                checked_stats(stats),
            )
        return result

    def light_visibility(
        self,
        points: ArrayLike,
        normals: ArrayLike,
        lights: Iterable[Light],
        samples: int = 16,
        point_ids: ArrayLike | None = None,
        *,
        sampler: str = "sobol",
        horizon: str = "sample",
        progress: Progress | None = None,
        stats: Stats | None = None,
        blocked: NDArray[np.uint8] | None = None,
        steps: NDArray[np.uint32] | None = None,
        out: NDArray[np.uint16] | None = None,
        **options: Unpack[QueryOptions],
    ) -> NDArray[np.uint16]:
        """How many samples of each light each point sees.

        Args:
            points: (..., 3) float32 or float64, the rays' origins: moved off the surface
                by the caller. One that is NaN or infinite is not traced.
            normals: (..., 3) float32 or float64, of any length.
            lights: any number of lights of any types.
            samples: of each light, 1 to 65534.
            point_ids: (...) integers from 0 to 2^32 - 1, what the samples of a point depend
                on besides the light's place in `lights`; default 0, 1, 2, ...
            sampler: "sobol" (Owen-scrambled, the lower error; best with a power of two) or
                "jitter" (strata and a hash). Both give the same rays on every machine;
                docs/method.md has the formulas.
            horizon: "sample": a sample that is not above the surface is dark, and a point
                with none above is NOT_TRACED. "centre": all samples are traced where the
                light's centre is above the surface, else none.
            progress, stats: as in `intersect`.
            blocked: a C-contiguous uint8 array of shape (lights, ..., (samples + 7) // 8),
                read and written: bit k % 8 of byte k // 8 is sample k. A sample whose bit is
                set is blocked and not traced; the bits of those found blocked are set. So
                meshes in several scenes block together: a call for each with the same bits,
                zeros at first; the last one's result holds for all. (Their `origin` has to be
                the same for the same rays.)
            steps: a C-contiguous uint32 array of shape (...) that is filled with the
                traversal steps spent on each point; packets then hold rays of one point.
            out: a C-contiguous uint16 array with the result's shape, which is filled and
                returned.
            **options: as in `occluded`.

        Returns:
            uint16 of shape (lights, ...): 0 to samples; NOT_TRACED (65535) where the point is
            turned away from the light, behind a one-sided one or outside a spot's cone.
        """
        count, lead, shaded = shading_rows(points, normals, point_ids)
        checked = checked_lights(lights)
        result = output("out", out, (len(checked), *lead), (np.uint16,))
        if steps is not None:
            output("steps", steps, lead, (np.uint32,))
        sampling = sampling_of(samples, sampler, horizon)
        bits = blocked_bits(blocked, (len(checked), *lead), sampling.samples)
        query = query_of(self._threads, options)
        with self._borrow() as scene:
            _ffi.light_visibility(
                scene,
                count,
                *shaded,
                checked,
                sampling,
                result,
                None,
                bits,
                query,
                checked_progress(progress),
                checked_stats(stats),
                steps,
            )
        return result

    def light_irradiance(
        self,
        points: ArrayLike,
        normals: ArrayLike,
        lights: Iterable[Light],
        samples: int = 16,
        point_ids: ArrayLike | None = None,
        *,
        sampler: str = "sobol",
        horizon: str = "sample",
        progress: Progress | None = None,
        stats: Stats | None = None,
        blocked: NDArray[np.uint8] | None = None,
        out: NDArray[np.float32] | None = None,
        **options: Unpack[QueryOptions],
    ) -> NDArray[np.float32]:
        """Which share of each light's irradiance reaches each point.

        As `light_visibility`, but each sample counts by what it would add to the light on a
        diffuse surface: the cosine there, the cosine at the light (not for spheres and suns),
        the inverse square of its distance. This is what the ratio of two renderings, with and
        without shadows, gives.

        Returns:
            float32 of shape (lights, ...): 0 (dark) to 1 (lit); NaN where `light_visibility`
            has NOT_TRACED.
        """
        count, lead, shaded = shading_rows(points, normals, point_ids)
        checked = checked_lights(lights)
        result = output("out", out, (len(checked), *lead), (np.float32,))
        sampling = sampling_of(samples, sampler, horizon)
        bits = blocked_bits(blocked, (len(checked), *lead), sampling.samples)
        query = query_of(self._threads, options)
        with self._borrow() as scene:
            _ffi.light_visibility(
                scene,
                count,
                *shaded,
                checked,
                sampling,
                None,
                result,
                bits,
                query,
                checked_progress(progress),
                checked_stats(stats),
                None,
            )
        return result

    def ambient_occlusion(
        self,
        points: ArrayLike,
        normals: ArrayLike,
        distance: float = math.inf,
        samples: int = 16,
        point_ids: ArrayLike | None = None,
        *,
        sampler: str = "sobol",
        progress: Progress | None = None,
        stats: Stats | None = None,
        blocked: NDArray[np.uint8] | None = None,
        steps: NDArray[np.uint32] | None = None,
        out: NDArray[np.uint16] | None = None,
        **options: Unpack[QueryOptions],
    ) -> NDArray[np.uint16]:
        """How many rays of the hemisphere above each point meet nothing nearby.

        Rays are spread by cosine: the share that is open is the share of a uniform sky's
        irradiance that arrives.

        Args:
            distance: how far a ray goes, above 0, in the scene's unit; default infinity.
            samples: rays from each point, 1 to 65534.
            points, normals, point_ids, sampler, progress, stats, blocked, steps, out, **options:
                as in `light_visibility`; without the axis of lights.

        Returns:
            uint16 of shape (...): 0 (closed in) to samples (open); NOT_TRACED (65535) where
            the point is not finite or the normal has no direction.
        """
        count, lead, shaded = shading_rows(points, normals, point_ids)
        result = output("out", out, lead, (np.uint16,))
        if steps is not None:
            output("steps", steps, lead, (np.uint32,))
        reach = number("distance", distance)
        sampling = sampling_of(samples, sampler)
        bits = blocked_bits(blocked, lead, sampling.samples)
        query = query_of(self._threads, options)
        with self._borrow() as scene:
            _ffi.ambient_occlusion(
                scene,
                count,
                *shaded,
                reach,
                sampling,
                result,
                bits,
                query,
                checked_progress(progress),
                checked_stats(stats),
                steps,
            )
        return result

    # ---- inspection ----------------------------------------------------------

    def open_edges(self, geom_id: int) -> NDArray[np.int32]:
        """Where a mesh is open: its edges with an odd number of triangles.

        Returns:
            (E, 2): prim_id of a triangle at the edge, and the edge in it (0 for v0 v1, 1 for
            v1 v2, 2 for v2 v0), in order of prim_id.
        """
        index = integer("geom_id", geom_id)
        with self._borrow() as scene:
            return _ffi.open_edges(scene, index)

    def leaves(self) -> NDArray[np.void]:
        """The leaves of the kd-tree, in its order.

        Returns:
            A structured array: lower and upper (3 float32 each, relative to `origin`), label
            (BOUNDARY, CLEAR, OPAQUE or UNKNOWN), region (of an empty leaf; -1 for others),
            first and count (of its references, see `leaf_triangles`).
        """
        with self._borrow() as scene:
            return _ffi.leaves(scene)

    def classify_by_rays(
        self,
        direction: ArrayLike | None = None,
        *,
        threads: int | None = None,
        progress: Progress | None = None,
    ) -> RayClassification:
        """The leaves as the paper labels them: by one test ray from the centre of each.

        A leaf is OPAQUE if the first triangle that its ray meets is met from behind. To compare
        with what `build` found; nothing else uses these labels, which are wrong where a mesh is
        open, overlaps another or is inside out, and may be where a ray passes through an edge.

        Args:
            direction: of all rays; any three finite numbers, not all 0. Default one in no
                relation to any mesh.
            threads, progress: see the class.
        """
        axis = None if direction is None else vector("direction", direction)
        query = query_of(self._threads, {"threads": threads})
        with self._borrow() as scene:
            return _ffi.classify_by_rays(scene, axis, query, checked_progress(progress))

    def leaf_triangles(self, first: int, count: int) -> NDArray[np.int32]:
        """The triangles of a leaf, given its `first` and `count` from `leaves`.

        Returns:
            (count, 2): geom_id and prim_id.
        """
        start = integer("first", first, 0, 2**63 - 1)
        size = integer("count", count, 0)
        with self._borrow() as scene:
            return _ffi.references(scene, start, size)

    def region_solids(self, region: int) -> tuple[Solid, ...]:
        """The solids that a region > 0, as `region` and `leaves` give it, lies in."""
        index = integer("region", region)
        with self._borrow() as scene:
            info = _ffi.region_info(scene, index)
        owner = {
            part.index: part.geom_id for mesh in self.report.meshes for part in mesh.components
        }
        return tuple(Solid(owner[component], component, winding) for component, winding in info)

    def corners(self, geom_id: ArrayLike, prim_id: ArrayLike) -> NDArray[np.float32]:
        """The corners of triangles as they are traced: rounded, relative to `origin`.

        Args:
            geom_id, prim_id: (...) integers, as in Hits; they broadcast.

        Returns:
            (..., 3, 3): v0, v1, v2.
        """
        self._open()
        meshes, triangles = integers("geom_id", geom_id), integers("prim_id", prim_id)
        meshes, triangles = np.broadcast_arrays(meshes, triangles)
        counts = np.array([mesh.triangle_count for mesh in self.report.meshes], np.int64)
        check_ids("geom_id", meshes, len(counts))
        check_ids("prim_id", triangles, counts[meshes])
        return self._geometry.corners(meshes, triangles)

    @property
    def closed_extent(self) -> float:
        """Largest extent of the closed meshes' bounds, of all meshes if none is closed."""
        self._open()
        meshes = self.report.meshes
        closed = [mesh.geom_id for mesh in meshes if mesh.closed and mesh.triangle_count]
        return self._geometry.largest_extent(closed or range(len(meshes)))

    @property
    def safe_offset(self) -> float:
        """How far a point of a surface has to be moved along its normal, at least, so that it
        is surely above it when it has been rounded to float32: twice what rounding can take,
        2^-21 of the largest |coordinate - origin|."""
        self._open()
        return 2.0**-21 * self._geometry.largest_coordinate
