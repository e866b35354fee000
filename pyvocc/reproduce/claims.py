"""What the slides claim, what was measured here, and whether the one bears out the other."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from statistics import median
from typing import TypeAlias

from . import modes
from .measure import DIRECTIONS, OUTCOMES, Measured
from .modes import CACHES, DEFERMENTS, Mode

REPRODUCED, PARTLY, NOT, OPEN = "reproduced", "in part", "not reproduced", "not measured"

# How far a figure may fall short of the slides' and still count as the same.
SAME = 0.85
# What timing on a machine that does other things cannot tell apart.
NOISE = 0.03

Scenes: TypeAlias = Sequence[Measured]
Figures: TypeAlias = list[tuple[Measured, float]]


@dataclass(frozen=True)
class Claim:
    """A claim of the slides, judged.

    Attributes:
        slides: the claim.
        here: the figures that stand against it.
        verdict: REPRODUCED, PARTLY, NOT or OPEN.
        why: where it was not reproduced, the figures that tell the reason.
    """

    slides: str
    here: str
    verdict: str
    why: str = ""


def claims(scenes: Scenes) -> list[Claim]:
    """All claims, each judged by the figures of these scenes."""
    shown = [scene for scene in scenes if scene.subject.slides is not None]
    judged = [
        _identical(scenes),
        _rate(shown),
        _solids(shown),
        _worst(shown),
        _tests(shown, modes.EXTENDED),
        _tests(shown, modes.QDBFS),
        _extended_steps(shown),
        _queue(shown),
        _queue_time(shown),
        _deferment(shown),
        _cache(shown),
        _cache_tests(shown),
        _single(shown),
        _areas(shown),
        _prediction(scenes),
        _bottleneck(shown),
        _classes(scenes),
    ]
    return [claim for claim in judged if claim is not None]


# ---- figures -------------------------------------------------------------------------


def figures(scenes: Scenes, value: Callable[[Measured], float | None]) -> Figures:
    """Of the scenes that have one."""
    return [(scene, v) for scene in scenes if (v := value(scene)) is not None]


def counters(one: Mode, other: Mode, name: str) -> Callable[[Measured], float | None]:
    """A counter of a mode, of the same counter of another."""

    def value(scene: Measured) -> float | None:
        a, b = scene.counter(one, name), scene.counter(other, name)
        return a / b if a is not None and b else None

    return value


def listed(found: Figures, text: Callable[[float], str]) -> str:
    """'Bunny 1.52×, Rose 0.98×'."""
    return ", ".join(f"{scene.subject.title} {text(value)}" for scene, value in found)


def plural(count: int, thing: str) -> str:
    return f"{count} {thing}" + ("" if count == 1 else "s")


def times(value: float) -> str:
    return f"{value:.2f}×"


def change(value: float) -> str:
    """A ratio as a change: 0.8 is -20 %."""
    percents = round(100 * (value - 1))
    return f"{percents:+d} %" if percents else "0 %"


def percent(value: float) -> str:
    return f"{100 * value:.0f} %"


def ended_by_occluders(scene: Measured, mode: Mode) -> float | None:
    """Of the blocked rays, those that an occluder ended, in the tree or in the cache."""
    count = scene.count(mode)
    if count is None or not count["counters"]["occluded"]:
        return None
    c = count["counters"]
    return float((c["occluder_hits_tree"] + c["occluder_hits_cache"]) / c["occluded"])


def live_lanes(scene: Measured, mode: Mode) -> float | None:
    """Of a packet at a traversal step, on average."""
    count = scene.count(mode)
    counters = count["counters"] if count else {}
    return counters["active_lanes"] / counters["node_visits"] if counters else None


def _visible_rays(scene: Measured) -> float | None:
    count = scene.count(modes.BASELINE)
    return count["visible"] / count["rays"] if count and count["rays"] else None


def _open(slides: str) -> Claim:
    return Claim(slides, "", OPEN)


def _verdict(good: bool, middling: bool) -> str:
    return REPRODUCED if good else PARTLY if middling else NOT


# ---- the claims ----------------------------------------------------------------------


def different(scenes: Scenes) -> list[str]:
    """Where modes of one scene gave unlike images; must be empty."""
    wrong = []
    for scene in scenes:
        title = scene.subject.title
        for size, hashes in scene.hashes().items():
            if len(hashes) > 1:
                sets = "; ".join(f"{digest}: {', '.join(m)}" for digest, m in hashes.items())
                wrong.append(f"{title}, {size} × {size} pixels: {sets}")
        if not scene.split_agrees():
            wrong.append(f"{title}: blocked or visible rays traced apart gave another answer")
        if scene.pictures.get("different"):
            wrong.append(f"{title}: {scene.pictures['different']} counts differ in the pictures")
    return wrong


def _identical(scenes: Scenes) -> Claim:
    slides = "Produces identical images"
    images = sum(len(m) for s in scenes for h in s.hashes().values() for m in h.values())
    wrong = different(scenes)
    if wrong:
        return Claim(slides, "images differ", NOT, "; ".join(wrong))
    return Claim(
        slides, f"{images} images of {plural(len(scenes), 'scene')}, bit for bit", REPRODUCED
    )


def _rate(scenes: Scenes) -> Claim:
    slides = "Up to 2 times the shadow-ray rate, half the time (Dragon 2.03×)"
    found = figures(scenes, lambda s: s.gain(modes.QDBFS))
    if not found:
        return _open(slides)
    best, value = max(found, key=lambda pair: pair[1])
    others = [(v, m, s) for m in modes.ORDERS[1:] for s, v in figures(scenes, _gain(m))]
    top, mode, where = max(others, key=lambda triple: triple[0])
    here = f"QDBFS up to {times(value)} ({best.subject.title})"
    if mode is not modes.QDBFS:
        here += f", {mode.label} up to {times(top)} ({where.subject.title})"
    why = f"where the gain is largest, on {best.subject.title}, occluders have {_area(best)}"
    return Claim(slides, here, _verdict(value >= 2 * SAME, value >= 1.3), why)


def _gain(mode: Mode) -> Callable[[Measured], float | None]:
    return lambda scene: scene.gain(mode)


def _area(scene: Measured) -> str:
    slides = scene.subject.slides
    theirs = f" (the slides' {slides.name}: {slides.area:g})" if slides else ""
    return f"{scene.tree['area_ratio']:.1f} times the surface of the mesh{theirs}"


def _solids(scenes: Scenes) -> Claim:
    slides = "Gains on large, finely tessellated solids: " + ", ".join(
        f"{s.subject.slides.name} {times(s.subject.slides.gain)}"
        for s in scenes
        if s.subject.solid and s.subject.slides
    )
    found = figures([s for s in scenes if s.subject.solid], _gain(modes.QDBFS))
    if not found:
        return _open("Gains on large, finely tessellated solids")
    shares = [v / s.subject.slides.gain for s, v in found if s.subject.slides]
    why = "; ".join(f"{s.subject.title}: {_area(s)}" for s, _ in found)
    verdict = _verdict(min(shares) >= SAME, max(shares) >= SAME or min(v for _, v in found) > 1.15)
    return Claim(slides, listed(found, times), verdict, why)


def _worst(scenes: Scenes) -> Claim:
    slides = "Worst case still OK: never slower than the baseline (Yeah Right 1.00×)"
    found = figures(scenes, _gain(modes.QDBFS))
    auto = figures(scenes, _gain(modes.AUTO))
    if not found or not auto:
        return _open(slides)
    worst, value = min(found, key=lambda pair: pair[1])
    safe, least = min(auto, key=lambda pair: pair[1])
    here = (
        f"QDBFS at worst {times(value)} ({worst.subject.title}), "
        f"auto, with entry points, at worst {times(least)} ({safe.subject.title})"
    )
    steps = counters(modes.QDBFS, modes.BASELINE, "node_visits")(worst)
    why = f"{worst.subject.title} takes {times(steps or 1)} the traversal steps of the baseline"
    if value < 0.95 <= least:
        why += ": the order has to be chosen by the area ratio, as auto does"
    return Claim(slides, here, _verdict(value >= 0.95, least >= 0.95), why)


def _tests(scenes: Scenes, mode: Mode) -> Claim:
    slides = (
        f"{mode.label[0].upper()}{mode.label[1:]}: high chance that triangle intersections decrease"
    )
    found = figures(scenes, counters(mode, modes.BASELINE, "triangle_tests"))
    if not found:
        return _open(slides)
    fewer = sum(v < 1 for _, v in found)
    ended = figures([s for s, v in found if v >= 1], lambda s: ended_by_occluders(s, mode))
    why = f"of the blocked rays, occluders end there only: {listed(ended, percent)}"
    verdict = _verdict(fewer == len(found), fewer > len(found) / 2)
    return Claim(slides, listed(found, change), verdict, why)


def _extended_steps(scenes: Scenes) -> Claim:
    slides = "Extended order: traversal steps guaranteed to increase"
    found = figures(scenes, counters(modes.EXTENDED_BARE, modes.BASELINE, "node_visits"))
    if not found:
        return _open(slides)
    more = sum(v > 1 for _, v in found)
    ended = figures(scenes, lambda s: ended_by_occluders(s, modes.EXTENDED_BARE))
    why = (
        f"an occluder ends {listed(ended, percent)} of the blocked rays; such a packet takes "
        "no further step, where the baseline goes on until each lane has met a triangle"
    )
    verdict = _verdict(more == len(found), more > len(found) / 2)
    return Claim(slides, f"without a cache {listed(found, change)}", verdict, why)


def _queue(scenes: Scenes) -> Claim:
    slides = "QDBFS: less queue traffic than BFS"
    pushes = figures(scenes, counters(modes.QDBFS, modes.BFS, "queue_pushes"))
    pops = figures(scenes, counters(modes.QDBFS, modes.BFS, "queue_pops"))
    if not pushes or not pops:
        return _open(slides)
    here = f"pushes {_range(pushes)}, pops {_range(pops)}"
    less = all(v < 1 for _, v in pushes + pops)
    visits = figures(scenes, counters(modes.QDBFS, modes.BFS, "node_visits"))
    why = f"a quick descent can meet occluders later: nodes visited {_range(visits)}"
    return Claim(slides, here, _verdict(less, all(v <= 1 for _, v in pops)), why)


def _range(found: Figures) -> str:
    values = [v for _, v in found]
    return f"{change(min(values))} to {change(max(values))}"


def _queue_time(scenes: Scenes) -> Claim:
    slides = "QDBFS: 15 to 20 % faster than BFS"
    found = figures(scenes, lambda s: s.gain(modes.QDBFS, modes.BFS))
    if not found:
        return _open(slides)
    typical = median(v for _, v in found)
    pushes = figures(scenes, counters(modes.QDBFS, modes.BFS, "queue_pushes"))
    visits = figures(scenes, counters(modes.QDBFS, modes.BFS, "node_visits"))
    each = median(
        (scene.counter(modes.BFS, "queue_pushes") or 0) / (visited or 1)
        for scene in scenes
        if (visited := scene.counter(modes.BFS, "node_visits")) is not None
    )
    why = (
        f"nodes visited {_range(visits)}, pushes {_range(pushes)}; BFS pushes {each:.2f} times a "
        "node here (in the slides' example 10 times for 9 nodes), so that there is less to save"
    )
    here = f"{listed(found, change)}; median {change(typical)}"
    return Claim(slides, here, _verdict(typical >= 1.13, typical >= 1 + NOISE), why)


def _deferment(scenes: Scenes) -> Claim:
    slides = "Deferment list: best performance at size 512"
    ratios: Figures = []
    settled = []
    for scene in scenes:
        size = scene.settings.sweep_size
        series = {
            n: t for n in DEFERMENTS if (t := scene.seconds(modes.deferment("qdbfs", n), size))
        }
        if len(series) == len(DEFERMENTS):
            ratios.append((scene, series[512] / min(series.values())))
            settled.append(settled_size(scene, "qdbfs"))
    if not ratios:
        return _open(slides)
    near = sum(v <= 1 + NOISE for _, v in ratios)
    number = plural(len(ratios), "scene")
    best = f"QDBFS: on {near} of {number} within {100 * NOISE:.0f} % of the best size"
    here = f"{best}; the count of tests no longer changes from size {max(settled)} on"
    why = f"time at 512 over the best: {listed(ratios, times)}"
    return Claim(slides, here, _verdict(near == len(ratios), near * 2 >= len(ratios)), why)


def settled_size(scene: Measured, order: str) -> int:
    """The smallest list whose triangle tests are those of the largest."""
    size = scene.settings.sweep_size
    tests = [scene.counter(modes.deferment(order, n), "triangle_tests", size) for n in DEFERMENTS]
    return next(n for n, count in zip(DEFERMENTS, tests, strict=True) if count == tests[-1])


def _cache(scenes: Scenes) -> Claim:
    slides = "The occluder cache always improved run-times"
    none, eight = modes.cache("recent", 0), modes.cache("recent", 8)
    found = figures(scenes, lambda s: s.gain(eight, none, s.settings.sweep_size))
    if not found:
        return _open(slides)
    better = sum(v >= 1 for _, v in found)
    best = []
    for scene, _ in found:
        size = scene.settings.sweep_size
        sizes = figures_by_size(scene, lambda n: modes.cache("recent", n), CACHES, size)
        best.append(f"{scene.subject.title} {min(sizes, key=lambda n: sizes[n])}")
    here = f"8 entries against none: {listed(found, change)}"
    why = f"best size: {', '.join(best)}; a miss costs a box test for each entry"
    return Claim(slides, here, _verdict(better == len(found), better * 2 >= len(found)), why)


def figures_by_size(
    scene: Measured, mode: Callable[[int], Mode], sizes: Sequence[int], pixels: int
) -> dict[int, float]:
    """Seconds of a sweep's passes."""
    return {n: t for n in sizes if (t := scene.seconds(mode(n), pixels)) is not None}


def _cache_tests(scenes: Scenes) -> Claim:
    slides = "At deferment 512 the cache no longer affects the number of triangle intersections"
    none, eight = modes.cache("recent", 0), modes.cache("recent", 8)

    def value(scene: Measured, mode: Mode = eight) -> float | None:
        size = scene.settings.sweep_size
        a = scene.counter(mode, "triangle_tests", size)
        b = scene.counter(none, "triangle_tests", size)
        return a / b if a is not None and b else None

    found = figures(scenes, value)
    if not found:
        return _open(slides)
    largest = max(abs(v - 1) for _, v in found)
    plain = figures(scenes, lambda s: value(s, modes.UNFUSED_QDBFS))
    why = "a cached occluder also ends rays that meet none in the tree before their triangles"
    if plain:
        why = f"cached boxes are grown beyond their leaf; with plain leaves {listed(plain, change)}"
    return Claim(slides, listed(found, change), _verdict(largest <= 0.02, largest <= 0.1), why)


def _single(scenes: Scenes) -> Claim:
    slides = "Single rays within 2 %: the same gain without packets"

    def value(scene: Measured) -> float | None:
        one = scene.gain(modes.QDBFS_SINGLE, modes.BASELINE_SINGLE)
        packets = scene.gain(modes.QDBFS)
        return one / packets if one and packets else None

    found = figures(scenes, value)
    if not found:
        return _open(slides)
    largest = max(abs(v - 1) for _, v in found)
    lanes = figures(scenes, lambda s: live_lanes(s, modes.QDBFS))
    why = f"packets of 4 have on average {listed(lanes, lambda v: f'{v:.1f}')} live lanes a step"
    here = f"the gain of single rays over that of packets: {listed(found, change)}"
    return Claim(slides, here, _verdict(largest <= NOISE, largest <= 0.1), why)


def _areas(scenes: Scenes) -> Claim:
    slides = "Surface of occluders over surface of mesh: " + ", ".join(
        f"{s.subject.slides.name} {s.subject.slides.area:g}" for s in scenes if s.subject.slides
    )
    found = figures(scenes, lambda s: s.tree.get("area_ratio"))
    if not found:
        return _open("Surface of occluders over surface of mesh")
    shares = [v / s.subject.slides.area for s, v in found if s.subject.slides]
    order = rank_correlation([(v, s.subject.slides.area) for s, v in found if s.subject.slides])
    here = listed(found, lambda v: f"{v:.1f}")
    if order is not None:
        here += f"; rank correlation {order:.2f}"
    leaves = ", ".join(f"{s.subject.title} {s.tree['opaque_leaves']:,}" for s, _ in found)
    why = (
        f"the ratio depends on how the tree cuts up the inside (here into {leaves} opaque leaves); "
        "the slides do not say how theirs does, nor are all these their meshes"
    )
    same = all(0.75 <= share <= 1.33 for share in shares)
    return Claim(slides, here, _verdict(same, order is not None and order >= 0.6), why)


def _prediction(scenes: Scenes) -> Claim:
    slides = "A high area ratio means a high gain"
    pairs = [
        (s.tree["area_ratio"], gain) for s in scenes if (gain := s.gain(modes.QDBFS)) and s.tree
    ]
    order = rank_correlation(pairs)
    if order is None:
        return _open(slides)
    here = f"rank correlation of ratio and QDBFS's gain {order:.2f}"
    why = ", ".join(
        f"{s.subject.title} {s.tree['area_ratio']:.1f}: {times(gain)}"
        for s in scenes
        if (gain := s.gain(modes.QDBFS)) and s.tree
    )
    return Claim(slides, here, _verdict(order >= 0.7, order >= 0.4), why)


def rank_correlation(pairs: Sequence[tuple[float, float]]) -> float | None:
    """Spearman's, ties sharing their ranks; None for fewer than three pairs."""
    if len(pairs) < 3:
        return None

    def ranks(values: Sequence[float]) -> list[float]:
        ordered = sorted(values)
        return [ordered.index(v) + (ordered.count(v) - 1) / 2 for v in values]

    a, b = (ranks(column) for column in zip(*pairs, strict=True))
    mean = (len(pairs) - 1) / 2
    product = sum((x - mean) * (y - mean) for x, y in zip(a, b, strict=True))
    square = sum((x - mean) ** 2 for x in a) * sum((y - mean) ** 2 for y in b)
    return product / square**0.5 if square else None


def visible_share(scene: Measured, mode: Mode) -> float | None:
    """Of the time on rays traced apart, that on the visible ones."""
    blocked, visible = (scene.split_seconds(mode, kind) for kind in OUTCOMES)
    return visible / (visible + blocked) if visible is not None and blocked is not None else None


def _bottleneck(scenes: Scenes) -> Claim:
    slides = "New bottleneck: unoccluded shadow rays"
    solids = [s for s in scenes if s.subject.solid] or list(scenes)
    before = figures(solids, lambda s: visible_share(s, modes.BASELINE))
    after = figures(solids, lambda s: visible_share(s, modes.QDBFS))
    if not before or not after:
        return _open(slides)
    text = [
        f"{s.subject.title} {100 * a:.0f} % → {100 * b:.0f} %"
        for (s, a), (_, b) in zip(before, after, strict=True)
    ]
    grows = [b > a for (_, a), (_, b) in zip(before, after, strict=True)]
    here = f"share of the time spent on visible rays, baseline → QDBFS: {', '.join(text)}"
    share = figures(solids, _visible_rays)
    why = f"visible are, of the rays: {listed(share, percent)}"
    verdict = _verdict(all(grows) and all(b > 0.5 for _, b in after), any(grows))
    return Claim(slides, here, verdict, why)


def _classes(scenes: Scenes) -> Claim | None:
    slides = "One test ray a leaf classifies a manifold mesh"
    found = [
        (scene, cell["disagreements"], scene.tree["leaves"] - scene.tree["boundary_leaves"])
        for scene in scenes
        for direction in DIRECTIONS
        if (cell := scene.classes(direction))
    ]
    if not found:
        return _open(slides)
    wrong, leaves = sum(d for _, d, _ in found), sum(n for _, _, n in found)
    names = sorted({s.subject.title for s, d, _ in found if d})
    here = f"{wrong:,} of {leaves:,} labels (empty leaves × directions) are not the flood fill's"
    why = f"on {', '.join(names)}; section 13 has them by direction"
    return Claim(slides, here, _verdict(wrong == 0, wrong < leaves / 100), why)
