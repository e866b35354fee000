# SPDX-License-Identifier: GPL-3.0-or-later
"""What the last render found out, as plain values and as lines of text."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

# Objects listed one by one before the text says how many more there are.
LISTED = 12


@dataclass(frozen=True)
class ObjectReport:
    """An object of the scene, its instances taken together.

    Attributes:
        name: of the original object.
        instances: how often it is in the scene.
        triangles: of one instance.
        closed: it can hold occluders.
        open_edges: edges of one instance with an odd number of triangles.
        why: why it holds no occluders; "" if it does.
    """

    name: str
    instances: int
    triangles: int
    closed: bool
    open_edges: int
    why: str


@dataclass(frozen=True)
class Report:
    """One render.

    Attributes:
        scene: its name.
        size: width and height of what was rendered, in pixels.
        masks: pass names of the lights.
        samples: of each light and sub-pixel.
        aa: sub-pixels along an edge of a pixel.
        triangles: of all that casts shadows.
        objects: what casts shadows, the open ones first.
        left_out: objects that were not used, each with the reason.
        notices: what the user should know of this render.
        rays: shadow and ambient occlusion rays that were asked for.
        settled: rays by what settled them; a ray counts for each of the trees, two where some
            objects move, that it is asked of.
        seconds: by stage, in order.
        builds: scenes that were built for this render.
        reused: scenes that had been built before.
    """

    scene: str
    size: tuple[int, int]
    masks: tuple[str, ...]
    samples: int
    aa: int
    triangles: int
    objects: tuple[ObjectReport, ...] = ()
    left_out: tuple[tuple[str, str], ...] = ()
    notices: tuple[str, ...] = ()
    rays: int = 0
    settled: Mapping[str, int] = field(default_factory=dict)
    seconds: Mapping[str, float] = field(default_factory=dict)
    builds: int = 0
    reused: int = 0

    @property
    def closed(self) -> tuple[ObjectReport, ...]:
        """The objects that can hold occluders."""
        return tuple(part for part in self.objects if part.closed)

    @property
    def open(self) -> tuple[ObjectReport, ...]:
        """The objects that are traced as triangles only."""
        return tuple(part for part in self.objects if not part.closed)

    @property
    def total_seconds(self) -> float:
        """Of all stages."""
        return sum(self.seconds.values())

    @property
    def mrays_per_second(self) -> float:
        """Million rays a second while tracing; 0 if nothing was traced."""
        seconds = self.seconds.get("trace", 0.0)
        return self.rays / seconds / 1e6 if seconds > 0 else 0.0

    def summary(self) -> str:
        """One line."""
        return (
            f"{plural(len(self.masks), 'mask')} of {self.size[0]} x {self.size[1]} in "
            f"{self.total_seconds:.2f} s: {count_text(self.rays)} rays, "
            f"{self.mrays_per_second:.1f} million a second; "
            f"{len(self.closed)} of {plural(len(self.objects), 'object')} closed"
        )

    def lines(self) -> list[str]:
        """All of it, a paragraph after the other."""
        text = [self.summary(), *self.notices]
        text += self.object_lines()
        text += self.ray_lines()
        text += self.time_lines()
        return text

    def object_lines(self) -> list[str]:
        """What gives occluders, what does not and why, and what is left out."""
        text = [
            f"{len(self.closed)} of {plural(len(self.objects), 'object')} closed, "
            f"{count_text(self.triangles)} triangles"
        ]
        text += _listed([f"{part.name}: {part.why}" for part in self.open])
        text += _listed([f"{name}: left out, {reason}" for name, reason in self.left_out])
        return text

    def ray_lines(self) -> list[str]:
        """How many rays each rule settled."""
        total = sum(self.settled.values())
        return [
            f"{label}: {count_text(count)} rays, {100 * count / total:.1f} %"
            for label, count in self.settled.items()
            if count
        ]

    def time_lines(self) -> list[str]:
        """Seconds by stage."""
        return [f"{stage}: {seconds:.3f} s" for stage, seconds in self.seconds.items()]


# The last report of each scene, by the scene's name.
LAST: dict[str, Report] = {}


def plural(count: int, one: str) -> str:
    """ "1 object", "2 objects"."""
    return f"{count} {one}" if count == 1 else f"{count} {one}s"


def count_text(count: int) -> str:
    """A count in at most six characters: 1234, 56.7 k, 8.9 M."""
    if count < 10**4:
        return f"{count}"
    for divisor, unit in ((10**3, "k"), (10**6, "M")):
        # Three digits round 999 500 to the next unit.
        if count < 999.5 * divisor:
            return f"{count / divisor:.3g} {unit}"
    return f"{count / 10**9:.3g} G"


def _listed(lines: Sequence[str]) -> list[str]:
    more = len(lines) - LISTED
    return [*lines[:LISTED], *([f"and {more} more"] if more > 0 else [])]
