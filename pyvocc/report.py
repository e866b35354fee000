"""What a build found out: figures of the meshes, their components and the kd-tree."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ._values import Vector

# Components listed for each mesh before the table says how many more there are.
LISTED_COMPONENTS = 8


@dataclass(frozen=True)
class ComponentReport:
    """An edge-connected component of a mesh; vertices at equal positions are one vertex.

    Attributes:
        index: of the component in the scene, as `Scene.region_solids` gives it.
        geom_id: of its mesh.
        triangle_count: of the component.
        first_triangle: smallest prim_id in it.
        closed: every edge has an even number of triangles.
        consistent: closed, and wound consistently.
        boundary_edges: edges with an odd number of triangles.
        nonmanifold_edges: edges with more than two triangles.
        inconsistent_edges: edges wound alike from both sides.
        volume: signed, in cubed units; positive where normals point outward.
    """

    index: int
    geom_id: int
    triangle_count: int
    first_triangle: int
    closed: bool
    consistent: bool
    boundary_edges: int
    nonmanifold_edges: int
    inconsistent_edges: int
    volume: float


@dataclass(frozen=True)
class MeshReport:
    """A mesh; its edge counts and volume are the sums over its components.

    Attributes:
        geom_id: 0, 1, ... in order of adding.
        name: as given to `Scene.add_mesh`; may be empty.
        occluder: its closed components may hold occluders.
        triangle_count, vertex_count: as given.
        welded_vertices: distinct positions that triangles use.
        degenerate_triangles: triangles without area.
        closed: every component is closed.
        boundary_edges, nonmanifold_edges, inconsistent_edges, volume: see ComponentReport.
        components: in order of their first triangle.
    """

    geom_id: int
    name: str
    occluder: bool
    triangle_count: int
    vertex_count: int
    welded_vertices: int
    degenerate_triangles: int
    closed: bool
    boundary_edges: int
    nonmanifold_edges: int
    inconsistent_edges: int
    volume: float
    components: tuple[ComponentReport, ...]


@dataclass(frozen=True)
class TreeReport:
    """The kd-tree.

    Attributes:
        node_count: interior nodes and leaves.
        boundary_leaves: leaves that hold triangles.
        opaque_leaves: empty leaves inside a solid, the volumetric occluders.
        clear_leaves: empty leaves outside every solid.
        unknown_leaves: empty leaves too thin to tell their region; not used as occluders.
        reference_count: triangle references in leaves.
        seed_rays: rays that told the regions of the empty leaves.
        depth: of the deepest leaf.
        region_count: with the outside.
        opaque_volume_fraction: volume of the opaque leaves, of the scene's bounds.
        occluder_area: surface of all opaque leaves, in squared units.
        mesh_area: surface of the meshes that hold occluders, in squared units.
        bytes: memory of nodes, references, triangles and bounds.
        auto_order: the order that "auto" stands for in this scene.
    """

    node_count: int
    boundary_leaves: int
    opaque_leaves: int
    clear_leaves: int
    unknown_leaves: int
    reference_count: int
    seed_rays: int
    depth: int
    region_count: int
    opaque_volume_fraction: float
    occluder_area: float
    mesh_area: float
    bytes: int
    auto_order: str

    @property
    def leaf_count(self) -> int:
        """Leaves of every label."""
        return self.boundary_leaves + self.opaque_leaves + self.clear_leaves + self.unknown_leaves

    @property
    def occluder_area_ratio(self) -> float:
        """occluder_area / mesh_area, 0 without such meshes: how well the solids are filled."""
        return self.occluder_area / self.mesh_area if self.mesh_area > 0 else 0.0


@dataclass(frozen=True)
class BuildSeconds:
    """Seconds by stage; `occluders` are what the traversal wants beyond the labels: child order,
    planes, grown boxes; `beams` is the hierarchy that beams go through. With more than one thread
    `components` runs beside `build`, and `beams` beside what follows: `total` is the time from
    begin to end."""

    components: float
    build: float
    classify: float
    occluders: float
    beams: float
    total: float


@dataclass(frozen=True)
class Report:
    """A built scene in figures; `str(report)` is a table.

    Attributes:
        meshes: one MeshReport each, by geom_id.
        tree: the kd-tree.
        seconds: by stage of the build.
        triangle_count, vertex_count, component_count: of all meshes.
        closed_count: components that are closed and may hold occluders.
        lower, upper: bounds of all triangles, in the scene's coordinates.
        origin: what is subtracted from float64 coordinates before they become float32.
        beam_bytes: memory of the hierarchy that beams and single rays go through.
        threads: used by the build.
    """

    meshes: tuple[MeshReport, ...]
    tree: TreeReport
    seconds: BuildSeconds
    triangle_count: int
    vertex_count: int
    component_count: int
    closed_count: int
    lower: Vector
    upper: Vector
    origin: Vector
    beam_bytes: int
    threads: int

    @property
    def closed(self) -> bool:
        """Every mesh that may hold occluders is closed."""
        return all(mesh.closed for mesh in self.meshes if mesh.occluder)

    @property
    def bytes_per_triangle(self) -> float:
        """Memory of tree and hierarchy by triangle, 0 for an empty scene."""
        every = self.tree.bytes + self.beam_bytes
        return every / self.triangle_count if self.triangle_count else 0.0

    def __str__(self) -> str:
        head = (
            f"{self.triangle_count} triangles, {self.vertex_count} vertices in "
            f"{_plural(len(self.meshes), 'mesh', 'meshes')}, "
            f"{_plural(self.component_count, 'component')}, {self.closed_count} closed"
        )
        return "\n\n".join([head, self.mesh_table(), self.tree_table()])

    def mesh_table(self) -> str:
        """The meshes and their components as lines of text."""
        header = ("mesh", "triangles", "state", "boundary", "non-manifold", "inconsistent")
        rows: list[Sequence[str]] = [(*header, "volume")]
        for mesh in self.meshes:
            rows.extend(_mesh_rows(mesh))
        return _table(rows)

    def tree_table(self) -> str:
        """The kd-tree's figures as lines of text."""
        tree, seconds = self.tree, self.seconds
        return _table(
            [
                ("nodes", f"{tree.node_count}"),
                ("depth", f"{tree.depth}"),
                ("leaves", f"{tree.leaf_count}"),
                ("  boundary", f"{tree.boundary_leaves}"),
                ("  opaque", f"{tree.opaque_leaves}"),
                ("  clear", f"{tree.clear_leaves}"),
                ("  unknown", f"{tree.unknown_leaves}"),
                ("regions", f"{tree.region_count}"),
                ("opaque volume", f"{100 * tree.opaque_volume_fraction:.1f} %"),
                ("occluder area / mesh area", f"{tree.occluder_area_ratio:.2f}"),
                ("references", f"{tree.reference_count}"),
                ("bytes", f"{tree.bytes}"),
                ("bytes for beams", f"{self.beam_bytes}"),
                ("bytes a triangle", f"{self.bytes_per_triangle:.1f}"),
                ("seconds", f"{seconds.total:.3f}"),
                ("  components", f"{seconds.components:.3f}"),
                ("  build", f"{seconds.build:.3f}"),
                ("  classify", f"{seconds.classify:.3f}"),
                ("  occluders", f"{seconds.occluders:.3f}"),
                ("  beams", f"{seconds.beams:.3f}"),
                ("threads", f"{self.threads}"),
                ("auto order", tree.auto_order),
            ]
        )


@dataclass(frozen=True, eq=False)
class RayClassification:
    """The leaves as the paper labels them, by one test ray each (`Scene.classify_by_rays`).

    Attributes:
        labels: int32, of each leaf in the order of `Scene.leaves`: BOUNDARY; CLEAR or OPAQUE, as
            its ray says; UNKNOWN, empty but too thin for a ray.
        disagreements: indices of the leaves that the ray calls CLEAR and the build OPAQUE, or
            the other way round.
        rays: one for each leaf that is CLEAR or OPAQUE in `labels`.
        seconds: of the whole call.
        threads: used by it.
    """

    labels: NDArray[np.int32]
    disagreements: NDArray[np.intp]
    rays: int
    seconds: float
    threads: int


def _mesh_rows(mesh: MeshReport) -> Iterable[Sequence[str]]:
    name = f"{mesh.geom_id} {mesh.name}".rstrip()
    state = "closed" if mesh.closed else "open"
    if not mesh.occluder:
        state += ", no occluder"
    yield (name, f"{mesh.triangle_count}", state, *_edges(mesh), f"{mesh.volume:.6g}")
    if len(mesh.components) < 2:
        return
    # The open ones are what a reader looks for.
    listed = sorted(mesh.components, key=lambda component: component.closed)[:LISTED_COMPONENTS]
    for component in listed:
        yield (
            f"  component {component.index}",
            f"{component.triangle_count}",
            "closed" if component.closed else "open",
            *_edges(component),
            f"{component.volume:.6g}",
        )
    more = len(mesh.components) - len(listed)
    if more:
        open_count = sum(not component.closed for component in mesh.components)
        unlisted = max(0, open_count - len(listed))
        yield (f"  and {more} more, {unlisted} of them open",)


def _edges(part: MeshReport | ComponentReport) -> tuple[str, str, str]:
    return (f"{part.boundary_edges}", f"{part.nonmanifold_edges}", f"{part.inconsistent_edges}")


def _plural(count: int, one: str, many: str | None = None) -> str:
    return f"{count} {one if count == 1 else many or one + 's'}"


def _table(rows: Sequence[Sequence[str]]) -> str:
    """Columns two spaces apart: the first to the left, the others to the right."""
    full = [row for row in rows if len(row) > 1]
    widths = [max(len(cell) for cell in column) for column in zip(*full, strict=True)]
    lines = []
    for row in rows:
        cells = [row[0].ljust(widths[0])]
        cells += [cell.rjust(width) for cell, width in zip(row[1:], widths[1:], strict=False)]
        lines.append("  ".join(cells).rstrip())
    return "\n".join(lines)
