"""Counters of what queries did."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields


@dataclass
class Stats:
    """What queries did; give one as `stats=` and its counters are added to.

    A packet counts once however many lanes it has. Counting costs a little time; without
    `stats` it costs nothing. One Stats must not be given to two calls at once.

    Attributes:
        rays: traced, with those that meet nothing by definition.
        occluded: blocked rays; for `intersect`, hits.
        packets: groups of rays traced together.
        node_visits: traversal steps, at interior nodes.
        leaf_visits: at boundary leaves.
        triangle_tests: packet x triangle.
        active_lanes: sum of live lanes over node_visits.
        exact_tests: ray x triangle settled beyond float32.
        occluder_hits_tree: rays blocked by an opaque leaf.
        occluder_hits_cache: rays blocked by a cached occluder.
        cache_lookups: packet x cached box.
        triangle_cache_hits: rays blocked by the last triangle.
        fallbacks: rays whose end could not be certified when an occluder was about to decide.
        deferred: leaves put on the deferment list.
        queue_pushes, queue_pops: of the breadth-first orders.
        careful_rays: traced in double, with values outside the range of the float kernels.
        entry_searches: searches of entry points, one for a group of points and a light.
        entry_steps, entry_tests: nodes and triangles looked at there and for voxels.
        entry_lit_rays, entry_dark_rays: rays that need no tracing.
        entry_few_rays: rays tested against a short list of triangles instead.
        voxel_lit_rays, voxel_dark_rays: rays that need no tracing.
        beam_lit_rays, beam_dark_rays: rays that beams settled together; the latter by occluders.
        beam_hidden_rays: likewise, of points from which one triangle hides the light.
        beam_tested_rays: those that they tested one by one.
        beam_box_rays: those of the latter that an occluder blocked.
        beams: groups of points, and parts of them, looked at.
        beam_nodes, beam_clusters: nodes (16 children) and clusters (16 triangles) looked at.
        beam_tests: ray x cluster, or 16 rays x triangle.
        isa: the instruction set that ran last ("" before); it is no counter, and not compared.
    """

    rays: int = 0
    occluded: int = 0
    packets: int = 0
    node_visits: int = 0
    leaf_visits: int = 0
    triangle_tests: int = 0
    active_lanes: int = 0
    exact_tests: int = 0
    occluder_hits_tree: int = 0
    occluder_hits_cache: int = 0
    cache_lookups: int = 0
    triangle_cache_hits: int = 0
    fallbacks: int = 0
    deferred: int = 0
    queue_pushes: int = 0
    queue_pops: int = 0
    careful_rays: int = 0
    entry_searches: int = 0
    entry_steps: int = 0
    entry_tests: int = 0
    entry_lit_rays: int = 0
    entry_dark_rays: int = 0
    entry_few_rays: int = 0
    voxel_lit_rays: int = 0
    voxel_dark_rays: int = 0
    beam_lit_rays: int = 0
    beam_dark_rays: int = 0
    beam_hidden_rays: int = 0
    beam_tested_rays: int = 0
    beam_box_rays: int = 0
    beams: int = 0
    beam_nodes: int = 0
    beam_clusters: int = 0
    beam_tests: int = 0
    isa: str = field(default="", compare=False)

    @property
    def counters(self) -> dict[str, int]:
        """The counters by name."""
        return {each.name: getattr(self, each.name) for each in fields(self) if each.compare}

    @property
    def lanes_per_visit(self) -> float:
        """Live lanes at a traversal step on average; 0 without one."""
        return self.active_lanes / self.node_visits if self.node_visits else 0.0

    def add(self, counters: Mapping[str, int]) -> None:
        """Adds counters by their names here."""
        for name, count in counters.items():
            setattr(self, name, getattr(self, name) + count)
