# SPDX-License-Identifier: GPL-3.0-or-later
"""From a world, a view and settings to masks: the computation, without Blender.

A mask is 1 where the light is seen and 0 where it is not. It is 1 on the background, and 0 where
the surface is turned away from the light, behind a one-sided light, or not linked to it.
"""

from __future__ import annotations

import functools
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

import pyvocc

from .camera import camera_rays, moved
from .data import Part, Settings, View, World
from .lights import shape_of
from .names import AO_PASS, pass_names
from .report import ObjectReport, Report
from .scenes import CACHE, Built, Piece, SceneCache

# The pass with a grey picture of it all.
COMBINED = "Combined"

# The clay of that picture: how much of the light it throws back, what is left of that where no
# light arrives, and where the surface is seen edge-on.
ALBEDO = 0.8
AMBIENT = 0.15
EDGE_ON = 0.5

# Returns True to stop; its argument is the fraction done.
Progress = Callable[[float], object]
Floats = NDArray[np.float32]


@dataclass(eq=False)
class _Group:
    """Lights that the same parts block and that light the same objects.

    Attributes:
        blockers, receivers: as in Light; no blockers at all for lights without shadows.
        casts_shadow: False: a point that faces the light is lit.
        indices: of the lights.
        shapes: of the lights, for pyvocc.
    """

    blockers: frozenset[str] | None
    receivers: frozenset[str] | None
    casts_shadow: bool
    indices: list[int] = field(default_factory=list)
    shapes: list[Any] = field(default_factory=list)


class PointJob:
    """Masks of a world's lights at any points.

    Args:
        world: what casts shadows, and the lights.
        settings: how masks are made.
        cache: of built scenes.

    Attributes:
        lights: by name; their order is that of all results.
        pass_names: of the lights.
        notices: what the user should know.
        seconds: by stage.
        rays: shadow and ambient occlusion rays that were asked for.
        stats: their counters; those of a ray that is asked of two scenes count twice.
    """

    def __init__(self, world: World, settings: Settings, cache: SceneCache = CACHE) -> None:
        self.world = world
        self.settings = settings
        self.cache = cache
        self.lights = tuple(sorted(world.lights, key=lambda light: light.name))
        self.pass_names = pass_names([light.name for light in self.lights])
        self.notices: list[str] = []
        self.seconds = {"build": 0.0, "camera": 0.0, "trace": 0.0}
        self.rays = 0
        self.stats = pyvocc.Stats()
        self.built: dict[str, Built] = {}
        self.threads = settings.threads or None
        self._groups = self._group_lights() if settings.masks else []
        self._casters: dict[frozenset[str] | None, Built] = {}

    @property
    def offset(self) -> float:
        """How far from the surface shading points are, in world units."""
        if self.settings.offset is not None:
            return self.settings.offset
        return max((built.safe_offset for built in self.built.values()), default=0.0)

    def prepare(self, progress: Progress | None = None) -> None:
        """Builds the scenes that are not built yet."""
        wanted = {group.blockers for group in self._groups}
        if self.settings.ao:
            wanted.add(None)
        for index, blockers in enumerate(sorted(wanted, key=_blocker_key)):
            parts = [part for part in self.world.parts if _casts(part, blockers)]
            self._casters[blockers] = self.build(
                f"casters {index}",
                parts,
                "casters",
                part_of(progress, index / len(wanted), (index + 1) / len(wanted)),
            )

    def build(
        self, name: str, parts: Sequence[Part], which: str, progress: Progress | None
    ) -> Built:
        """A built scene of these parts, kept for the report."""
        with self.timed("build"):
            built = self.cache.scene_for(
                parts, which=which, role=name, threads=self.threads, progress=progress
            )
        self.built[name] = built
        return built

    def masks(
        self,
        points: NDArray[Any],
        normals: NDArray[Any],
        ids: NDArray[np.uint32],
        owners: Sequence[str] = (),
        owner: NDArray[np.int32] | int = 0,
        progress: Progress | None = None,
    ) -> Floats:
        """The mask of each light at each point.

        Args:
            points: (n, 3), moved off the surface; NaN for none.
            normals: (n, 3), towards the side that is looked at.
            ids: (n,), what tells the sample patterns of points apart.
            owners: link_name of the parts that points may lie on.
            owner: index in owners, of each point or of all; for light linking only.

        Returns:
            (lights, n); 0 for a point that is NaN.
        """
        result = np.zeros((len(self.lights), len(points)), np.float32)
        with self.timed("trace"):
            for index, group in enumerate(self._groups):
                chosen = points
                if group.receivers is not None:
                    # The last one is for -1, the background.
                    linked = np.array([*(name in group.receivers for name in owners), False])
                    chosen = np.where(linked[owner][..., None], points, np.nan)
                result[group.indices] = self._trace(
                    group,
                    chosen,
                    normals,
                    ids,
                    part_of(progress, index / len(self._groups), (index + 1) / len(self._groups)),
                )
        return result

    def occlusion(
        self,
        points: NDArray[Any],
        normals: NDArray[Any],
        ids: NDArray[np.uint32],
        progress: Progress | None = None,
    ) -> Floats:
        """The share of the hemisphere that is not blocked, (n,); 0 for a point that is NaN."""
        samples = self.settings.ao_samples
        pieces = self._casters[None].pieces
        blocked = _bits(pieces, (len(points),), samples)
        with self.timed("trace"):
            for index, piece in enumerate(pieces):
                stats = pyvocc.Stats()
                counts = piece.scene.ambient_occlusion(
                    points,
                    normals,
                    self.settings.ao_distance,
                    samples,
                    ids,
                    threads=self.threads,
                    progress=part_of(progress, index / len(pieces), (index + 1) / len(pieces)),
                    stats=stats,
                    blocked=blocked,
                )
                self._count(stats, index)
        return _shares(counts, samples)

    @contextmanager
    def timed(self, stage: str) -> Iterator[None]:
        """Adds the time spent to that of a stage."""
        start = time.perf_counter()
        try:
            yield
        finally:
            self.seconds[stage] = self.seconds.get(stage, 0.0) + time.perf_counter() - start

    def _group_lights(self) -> list[_Group]:
        groups: dict[tuple[Any, ...], _Group] = {}
        for index, light in enumerate(self.lights):
            try:
                shape = shape_of(light)
            except ValueError as error:
                self.notices.append(f"{light.name}: {error}; its mask is 0")
                continue
            casts_shadow = light.casts_shadow or self.settings.all_lights
            blockers = light.blockers if casts_shadow else frozenset()
            key = (casts_shadow, blockers, light.receivers)
            group = groups.setdefault(key, _Group(blockers, light.receivers, casts_shadow))
            group.indices.append(index)
            group.shapes.append(shape)
        return list(groups.values())

    def _trace(
        self,
        group: _Group,
        points: NDArray[Any],
        normals: NDArray[Any],
        ids: NDArray[np.uint32],
        progress: Progress | None,
    ) -> Floats:
        pieces = self._casters[group.blockers].pieces
        samples = self.settings.samples
        if not group.casts_shadow:
            counts = pieces[0].scene.light_visibility(
                points, normals, group.shapes, samples, ids, threads=self.threads, progress=progress
            )
            return (counts != pyvocc.NOT_TRACED).astype(np.float32)
        blocked = _bits(pieces, (len(group.shapes), len(points)), samples)
        for index, piece in enumerate(pieces):
            weighted = self.settings.irradiance and index == len(pieces) - 1
            trace = piece.scene.light_irradiance if weighted else piece.scene.light_visibility
            stats = pyvocc.Stats()
            values = trace(
                points,
                normals,
                group.shapes,
                samples,
                ids,
                threads=self.threads,
                progress=part_of(progress, index / len(pieces), (index + 1) / len(pieces)),
                stats=stats,
                blocked=blocked,
            )
            self._count(stats, index)
        return np.nan_to_num(values) if self.settings.irradiance else _shares(values, samples)

    def _count(self, stats: pyvocc.Stats, piece: int) -> None:
        """Adds the counters of a piece; the first is asked for all rays."""
        if piece == 0:
            self.rays += stats.rays
        self.stats.add(stats.counters)
        self.stats.isa = stats.isa


class MaskJob:
    """Masks as a camera sees them.

    Args:
        world: what is there.
        view: the camera's.
        settings: how masks are made.
        cache: of built scenes.

    Attributes:
        points: the computation at points.
    """

    def __init__(
        self, world: World, view: View, settings: Settings, cache: SceneCache = CACHE
    ) -> None:
        self.view = moved(view, world.origin)
        self.settings = settings
        self.points = PointJob(world, settings, cache)
        self._receivers: Built | None = None
        if not any(part.is_receiver for part in world.parts):
            self.points.notices.append("There is no mesh that the camera can see")
        if settings.masks and not world.lights and not settings.ao:
            self.points.notices.append("There is no light in the render, so there is no mask")

    @property
    def light_passes(self) -> dict[str, str]:
        """Pass names by the names of the lights."""
        if not self.settings.masks:
            return {}
        names = (light.name for light in self.points.lights)
        return dict(zip(names, self.points.pass_names, strict=True))

    @property
    def pass_names(self) -> tuple[str, ...]:
        """The passes of one channel, in order."""
        return (*self.light_passes.values(), *((AO_PASS,) if self.settings.ao else ()))

    def prepare(self, progress: Progress | None = None) -> None:
        """Builds the scenes that are not built yet."""
        parts = [part for part in self.points.world.parts if part.is_receiver]
        self._receivers = self.points.build(
            "receivers", parts, "receivers", part_of(progress, 0.0, 0.5)
        )
        self.points.prepare(part_of(progress, 0.5, 1.0))

    def tile(
        self, x0: int, y0: int, width: int, height: int, progress: Progress | None = None
    ) -> dict[str, Floats]:
        """The passes of a rectangle of the full frame.

        Args:
            x0, y0: its lower left pixel.
            width, height: of it.
            progress: returns True to stop, which raises pyvocc.Cancelled.

        Returns:
            (height, width) for each of `pass_names`, the lowest row first, and
            (height, width, 4) for "Combined".
        """
        receivers = self._receivers
        assert receivers is not None, "prepare() comes first"
        aa = self.settings.aa
        subs = aa * aa
        order = pixel_order(width, height)
        with self.points.timed("camera"):
            x, y, ids = sub_pixels(self.view, order % width + x0, order // width + y0, aa)
            org, dir = camera_rays(self.view, x, y)
            seen = seen_first(
                receivers,
                org,
                dir,
                self.points.offset,
                self.points.threads,
                part_of(progress, 0.0, 0.1),
            )
        # A surface beyond the far clipping plane is background.
        background = (seen.part < 0) | (seen.t > self.view.far - self.view.near)
        passes: dict[str, Floats] = {}
        light_share = 0.6 if self.settings.ao and self.settings.masks else 0.9
        if self.settings.masks:
            masks = self.points.masks(
                seen.position,
                seen.normal,
                ids,
                [part.link_name for part in receivers.parts],
                seen.part,
                part_of(progress, 0.1, 0.1 + light_share),
            )
            passes.update(zip(self.light_passes.values(), masks, strict=True))
        if self.settings.ao:
            passes[AO_PASS] = self.points.occlusion(
                seen.position, seen.normal, ids, part_of(progress, 1.0 - light_share, 1.0)
            )
        for values in passes.values():
            values[background] = 1.0
        grey = self._clay(passes, seen.normal, dir)
        result = {
            name: _image(values, subs, order, (height, width)) for name, values in passes.items()
        }
        coverage = np.where(background, np.float32(0.0), np.float32(1.0))
        shade = _image(grey * coverage, subs, order, (height, width))
        alpha = _image(coverage, subs, order, (height, width))
        result[COMBINED] = np.stack([shade, shade, shade, alpha], axis=-1)
        return result

    def _clay(self, passes: dict[str, Floats], normal: Floats, dir: NDArray[Any]) -> Floats:
        """Grey matter under the mean of the masks."""
        length = np.sqrt(np.einsum("ij,ij->i", dir, dir))
        slope = np.abs(np.einsum("ij,ij->i", normal, dir)) / length
        grey = ALBEDO * (EDGE_ON + (1.0 - EDGE_ON) * slope)
        masks = [values for name, values in passes.items() if name != AO_PASS]
        if masks:
            grey = grey * (AMBIENT + (1.0 - AMBIENT) * np.mean(masks, axis=0))
        if AO_PASS in passes:
            grey = grey * passes[AO_PASS]
        return grey.astype(np.float32)

    def report(self, scene: str, size: tuple[int, int]) -> Report:
        """What the job found out so far."""
        points = self.points
        casters = [built for name, built in points.built.items() if name != "receivers"]
        largest = max(casters, key=lambda built: built.triangle_count, default=None)
        pieces = [piece for built in points.built.values() for piece in built.pieces]
        used = {id(piece.scene) for piece in pieces}
        builds = {id(piece.scene) for piece in pieces if not piece.reused}
        return Report(
            scene=scene,
            size=size,
            masks=tuple(self.light_passes.values()),
            samples=self.settings.samples,
            aa=self.settings.aa,
            triangles=largest.triangle_count if largest else 0,
            objects=object_reports(largest) if largest else (),
            left_out=points.world.left_out,
            notices=tuple(points.notices),
            rays=points.rays,
            settled=settled(points.stats),
            seconds=dict(points.seconds),
            builds=len(builds),
            reused=len(used - builds),
        )


class Seen(NamedTuple):
    """What camera rays meet first.

    Attributes:
        position: (n, 3) float32, moved off the surface; NaN for a miss.
        normal: (n, 3) float32, towards the ray's origin.
        part: (n,) int32, number of the part; -1 for a miss.
        t: (n,) float32, along the ray.
    """

    position: Floats
    normal: Floats
    part: NDArray[np.int32]
    t: Floats


def seen_first(
    built: Built,
    org: NDArray[Any],
    dir: NDArray[Any],
    offset: float,
    threads: int | None,
    progress: Progress | None,
) -> Seen:
    """What rays meet first in all pieces; of what is equally far, the part that comes first."""
    result: Seen | None = None
    count = len(built.pieces)
    for index, piece in enumerate(built.pieces):
        found = pyvocc.shading_points(
            piece.scene,
            org,
            dir,
            offset=offset,
            threads=threads,
            progress=part_of(progress, index / count, (index + 1) / count),
        )
        # The last one is for geom_id -1, a miss.
        part = np.append(piece.numbers, np.int32(-1))[found.geom_id]
        if result is None:
            result = Seen(found.position, found.normal, part, found.t)
            continue
        nearer = (found.t < result.t) | ((found.t == result.t) & (part < result.part))
        for old, new in zip(result, (found.position, found.normal, part, found.t), strict=True):
            old[nearer] = new[nearer]
    assert result is not None, "there is a piece even for no parts"
    return result


def pixel_order(width: int, height: int) -> NDArray[np.intp]:
    """The pixels of a rectangle, row by row from 0, so that neighbours come together."""
    return _pixel_order(width, height)


@functools.lru_cache(maxsize=8)
def _pixel_order(width: int, height: int) -> NDArray[np.intp]:
    y, x = np.divmod(np.arange(width * height), width)
    order = np.argsort(_spread(x) | _spread(y) << 1, kind="stable")
    order.flags.writeable = False
    return order


def _spread(x: NDArray[np.intp]) -> NDArray[np.int64]:
    """The low 16 bits of each number, two places apart: half of a Morton code."""
    bits = x.astype(np.int64)
    for shift, mask in ((8, 0x00FF00FF), (4, 0x0F0F0F0F), (2, 0x33333333), (1, 0x55555555)):
        bits = (bits | bits << shift) & mask
    return bits


def sub_pixels(
    view: View, x: NDArray[np.intp], y: NDArray[np.intp], aa: int
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.uint32]]:
    """Where rays go through pixels of the full frame, and the ids of their points.

    Args:
        x, y: (n,) pixels, y up.
        aa: sub-pixels along an edge.

    Returns:
        x, y and ids, (n aa aa,): those of a pixel are together, and do not depend on which
        other pixels are asked for.
    """
    sub_y, sub_x = np.divmod(np.arange(aa * aa), aa)
    pixel = y.astype(np.uint64) * view.width + x.astype(np.uint64)
    ids = pixel[:, None] * np.uint64(aa * aa) + np.arange(aa * aa, dtype=np.uint64)
    return (
        (x[:, None] + (sub_x + 0.5) / aa).ravel(),
        (y[:, None] + (sub_y + 0.5) / aa).ravel(),
        # Patterns repeat after 2^32 sub-pixels.
        ids.ravel().astype(np.uint32),
    )


def part_of(progress: Progress | None, lower: float, upper: float) -> Progress | None:
    """The progress of a part of the whole."""
    if progress is None:
        return None
    return lambda fraction: progress(lower + fraction * (upper - lower))


def object_reports(built: Built) -> tuple[ObjectReport, ...]:
    """The objects of a built scene, the open ones first."""
    counts: dict[str, int] = {}
    first: dict[str, ObjectReport] = {}
    meshes = {
        int(number): mesh
        for piece in built.pieces
        for number, mesh in zip(piece.numbers, piece.scene.report.meshes, strict=True)
    }
    for index, part in enumerate(built.parts):
        mesh = meshes[index]
        name = part.object_name
        counts[name] = counts.get(name, 0) + 1
        if name in first:
            continue
        bad = sum(not component.closed for component in mesh.components)
        why = ""
        if bad:
            where = f"{bad} of {len(mesh.components)} pieces " if len(mesh.components) > 1 else ""
            edges = f"{mesh.boundary_edges} open edge" + "s" * (mesh.boundary_edges != 1)
            why = f"{where}open, {edges}"
        first[name] = ObjectReport(
            name=name,
            instances=1,
            triangles=mesh.triangle_count,
            closed=mesh.closed,
            open_edges=mesh.boundary_edges,
            why=why,
        )
    reports = [
        ObjectReport(
            name=part.name,
            instances=counts[part.name],
            triangles=part.triangles,
            closed=part.closed,
            open_edges=part.open_edges,
            why=part.why,
        )
        for part in first.values()
    ]
    return tuple(sorted(reports, key=lambda part: (part.closed, part.name)))


def settled(stats: pyvocc.Stats) -> dict[str, int]:
    """Rays by the rule that settled them, from the cheapest to the dearest."""
    rules = {
        "All lit with their neighbours": stats.entry_lit_rays + stats.voxel_lit_rays,
        "All dark with their neighbours": stats.entry_dark_rays + stats.voxel_dark_rays,
        "Inside a solid met before": stats.occluder_hits_cache,
        "Inside a solid": stats.occluder_hits_tree,
        "Few triangles in the way": stats.entry_few_rays,
    }
    rules["Traced through the tree"] = max(0, stats.rays - sum(rules.values()))
    return rules


def _casts(part: Part, blockers: frozenset[str] | None) -> bool:
    return part.is_caster and (blockers is None or part.link_name in blockers)


def _blocker_key(blockers: frozenset[str] | None) -> tuple[bool, list[str]]:
    """Sets in the same order in every run, all blockers first."""
    return (blockers is not None, sorted(blockers or ()))


def _bits(
    pieces: tuple[Piece, ...], shape: tuple[int, ...], samples: int
) -> NDArray[np.uint8] | None:
    """What makes the triangles of several pieces block together."""
    return None if len(pieces) == 1 else np.zeros((*shape, (samples + 7) // 8), np.uint8)


def _shares(counts: NDArray[np.uint16], samples: int) -> Floats:
    shares = counts / np.float32(samples)
    shares[counts == pyvocc.NOT_TRACED] = 0.0
    return shares


def _image(values: Floats, subs: int, order: NDArray[np.intp], shape: tuple[int, int]) -> Floats:
    """The mean of each pixel's sub-pixels, in the place of the pixel."""
    image = np.empty(shape, np.float32)
    image.reshape(-1)[order] = values.reshape(-1, subs).mean(axis=1, dtype=np.float64)
    return image
