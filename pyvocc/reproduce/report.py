"""The sections of the page, each from the cells that it shows."""

from __future__ import annotations

import base64
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

from .. import __version__
from . import charts, claims, modes
from .charts import Bars, Line, Marks, Panel
from .claims import NOT, OPEN, PARTLY, REPRODUCED, change, percent, plural, times
from .measure import DIRECTIONS, OUTCOMES, SPLIT_TILES, Machine, Measured
from .modes import CACHES, DEFERMENTS, Mode
from .page import Alarm, Block, Gallery, Items, Picture, Section, Table, Text
from .settings import Settings
from .subjects import FAILURES, Slides

TITLE = "Volumetric occluders: the slides and this library"

# Rays below which a pass takes too little time for its time to tell much.
FEW_RAYS = 3_000_000


@dataclass(frozen=True)
class Context:
    """What the page says of how it was made."""

    settings: Settings
    machine: Machine
    processor: int | None
    compiler: str
    commit: str
    date: str
    embree: str  # why it was not measured; empty if it was


def sections(scenes: Sequence[Measured], context: Context) -> list[Section]:
    """The page, its head first."""
    return [
        _head(scenes, context),
        _provenance(scenes, context),
        _run_time(scenes),
        _counter("tests", "2. Triangle intersections", "triangle_tests", "tests", scenes),
        _counter("steps", "3. Traversal steps", "node_visits", "steps", scenes),
        _rates(scenes),
        _areas(scenes),
        _deferment(scenes),
        _cache(scenes),
        _queues(scenes),
        _split(scenes),
        _failures(scenes),
        _pictures(scenes),
        _embree(scenes, context),
        _classes(scenes),
        _sceptics(scenes),
        _related(scenes),
    ]


# ---- words ---------------------------------------------------------------------------


def _number(value: float | None, digits: int = 2) -> str:
    return "–" if value is None else f"{value:,.{digits}f}"


def _times(value: float | None) -> str:
    return "–" if value is None else times(value)


def _change(value: float | None) -> str:
    return "–" if value is None else change(value)


def _percent(value: float | None) -> str:
    return "–" if value is None else percent(value)


def _ratio(value: float | None, base: float | None) -> float | None:
    return value / base if value is not None and base else None


def _name(scene: Measured) -> str:
    """The title, starred where it is not the slides' own mesh."""
    return scene.subject.title + ("*" if scene.subject.note else "")


def _tick(scene: Measured) -> str:
    slides = scene.subject.slides
    other = slides is not None and slides.name != scene.subject.title
    return _name(scene) + (f"\n({slides.name})" if slides and other else "")


def _ticks(scenes: Sequence[Measured]) -> list[str]:
    return [_tick(scene) for scene in scenes]


def _slides(scene: Measured, value: Callable[[Slides], float]) -> float | None:
    slides = scene.subject.slides
    return None if slides is None else value(slides)


def _millions(value: float | None) -> float | None:
    return None if value is None else value / 1e6


def _shown(scenes: Sequence[Measured], listed: Sequence[Mode]) -> list[Mode]:
    """Those that were measured."""
    return [mode for mode in listed if any(scene.count(mode) for scene in scenes)]


_MODE_COLOURS = {
    modes.BASELINE: charts.GREY,
    modes.STANDARD: charts.SKY,
    modes.EXTENDED: charts.GREEN,
    modes.BFS: charts.YELLOW,
    modes.QDBFS: charts.ORANGE,
    modes.OPAQUE_FIRST: charts.RED,
    modes.AUTO: charts.BLUE,
}


_WORDS = (
    "In short: a volumetric occluder is an empty leaf of the kd-tree inside a solid. Extended "
    "order walks on past leaves with triangles, which wait on the deferment list, to find one; "
    "BFS visits the tree breadth first for the same end; QDBFS (quick descent) is BFS that visits "
    "an only child at once; opaque first goes depth first, to the child where a block is cheaper "
    "to find; the cache keeps the occluders that blocked last. docs/method.md has all of it. "
    "A claim is “reproduced” if its figures are at least 85 % of the slides', or its counts have "
    "the stated sign on every scene; “in part” if that holds for some; times that differ by less "
    "than 3 % count as equal."
)


# ---- the head ------------------------------------------------------------------------


def _head(scenes: Sequence[Measured], context: Context) -> Section:
    judged = claims.claims(scenes)
    wrong = claims.different(scenes)
    blocks: list[Block] = [
        Alarm(f"THE IMAGES DIFFER, which must never be: {text}.") for text in wrong
    ]
    blocks.append(
        Text(
            "Djeu, Keely and Hunt, “Accelerating Shadow Rays Using Volumetric Occluders and "
            "Modified kd-Tree Traversal” (HPG 2009), repeated with pyvocc "
            f"{__version__} on {plural(len(scenes), 'scene')}: {context.settings.size} × "
            f"{context.settings.size} pixels, five area lights, {context.settings.samples} samples "
            "each. “The slides” are those of the paper's talk; their figures stand beside ours "
            "wherever their text has them."
        )
    )
    number = {v: sum(c.verdict == v for c in judged) for v in (REPRODUCED, PARTLY, NOT, OPEN)}
    text = (
        f"Of {len(judged)} claims, {number[REPRODUCED]} reproduced, {number[PARTLY]} in part, "
        f"{number[NOT]} not"
    )
    if number[OPEN]:
        text += f"; {number[OPEN]} {'was' if number[OPEN] == 1 else 'were'} not measured"
    text += "."
    if not wrong:
        text += " Every mode of every scene gave the same image, bit for bit."
    blocks.append(Text(text))
    if _rays(scenes) < FEW_RAYS:
        blocks.append(
            Text(
                f"This is a small run, of at most {_rays(scenes) / 1e6:.1f} million rays a pass: "
                "its counts are exact, its times tell little."
            )
        )
    stand_ins = [s.subject for s in scenes if s.subject.note]
    if stand_ins:
        names = "; ".join(f"{s.title} ({s.note})" for s in stand_ins)
        blocks.append(Text(f"Not the slides' meshes, and starred below: {names}."))
    blocks.append(Text(_WORDS))
    head = ("The slides say", "Measured here", "Verdict")
    rows = [(claim.slides, claim.here or "–", claim.verdict) for claim in judged]
    blocks.append(Table(head, rows, 3, verdicts=2))
    reasons = [f"{c.slides}: {c.why}." for c in judged if c.verdict in (PARTLY, NOT) and c.why]
    if reasons:
        blocks += [Text("What was not, or not fully, reproduced, and why:"), Items(reasons)]
    return Section("summary", "Summary", blocks)


def _rays(scenes: Sequence[Measured]) -> int:
    return max((c["rays"] for s in scenes if (c := s.count(modes.BASELINE))), default=0)


def _provenance(scenes: Sequence[Measured], context: Context) -> Section:
    settings, machine = context.settings, context.machine
    where = "not pinned" if context.processor is None else f"on processor {context.processor}"
    spread = max((s.spread(m) for s in scenes for m in modes.MAIN), default=0.0)
    rows = [
        ("machine", f"{machine.processor}, {machine.processors} processors; {machine.system}"),
        ("timing", f"one thread, {where}; its CPU time, {_rounds(settings, spread)}"),
        ("counters", "from passes of their own that are not timed"),
        ("compiler", context.compiler or "the library does not name it"),
        ("library", f"pyvocc {__version__}, {context.commit}; Python {machine.python}"),
        ("date", context.date),
        (
            "options",
            f"size {settings.size}, samples {settings.samples}, rounds {settings.rounds}; "
            f"sweeps (6 and 7) at size {settings.sweep_size}; "
            f"{'models from files' if settings.meshes else 'generated meshes'}",
        ),
        ("rays", "32 × 32-pixel tiles; light by light, the samples in a pixel's order"),
    ]
    blocks: list[Block] = [Table(("", ""), rows, 2)]
    head = ("Scene", "Stands for", "What it is", "Triangles", "Slides", "Closed", "Build s", "Rays")
    table = []
    for scene in scenes:
        slides, tree = scene.subject.slides, scene.tree
        count = scene.count(modes.BASELINE)
        table.append(
            (
                _name(scene),
                slides.name if slides else "–",
                scene.subject.note or "the slides' model",
                f"{tree['triangles']:,}",
                f"{slides.triangles} k" if slides else "–",
                "yes" if tree["closed"] else "no",
                _number(sum(tree["seconds"].values())),
                f"{count['rays'] / 1e6:.2f} M" if count else "–",
            )
        )
    blocks.append(Table(head, table, 3))
    blocks.append(
        Text(
            "Each mesh is scaled to extent 1 and stands on a ground of two triangles. “Baseline” "
            "is the same kd-tree and the same kernels in front-to-back order without occluders; "
            "all modes trace packets of four rays unless they say otherwise. QDBFS, BFS and "
            "extended order have a deferment list of 512 and a cache of 8 occluders; `auto` is "
            "what the library chooses by the area ratio of section 5, with the entry points of 15."
        )
    )
    return Section("provenance", "How this was measured", blocks)


def _rounds(settings: Settings, spread: float) -> str:
    if settings.rounds == 1:
        return "one round"
    return (
        f"medians of {settings.rounds} alternating rounds (widest spread {100 * spread:.0f} % of "
        "a median)"
    )


# ---- 1 to 3: the slides' charts -------------------------------------------------------


def _run_time(scenes: Sequence[Measured]) -> Section:
    shown = _shown(scenes, modes.ORDERS)
    series = [
        Bars(
            mode.label,
            [_ratio(s.seconds(mode), s.seconds(modes.BASELINE)) for s in scenes],
            _MODE_COLOURS[mode],
        )
        for mode in shown
    ]
    theirs = [_slides(s, lambda row: 1 / row.gain) for s in scenes]
    marks = [Marks("slides, vol occ", theirs, shown.index(modes.QDBFS))]
    unit = "run time, baseline = 1"
    chart = charts.bars(_ticks(scenes), series, unit, marks=marks, line=1.0, digits=2)
    head = ("Scene", "slides, vol occ", "baseline, s", *(mode.label for mode in shown[1:]))
    rows = [
        (
            _name(scene),
            _number(_slides(scene, lambda row: 1 / row.gain)),
            _number(scene.seconds(modes.BASELINE), 3),
            *(
                _number(_ratio(scene.seconds(mode), scene.seconds(modes.BASELINE)))
                for mode in shown[1:]
            ),
            scene.tree["auto_order"],
        )
        for scene in scenes
    ]
    return Section(
        "run-time",
        "1. Run time",
        [
            Text(
                "CPU seconds of one pass, shadow rays only, over those of the baseline: lower is "
                "better. The slides' chart has no numbers in their text; the diamonds are what "
                "their table of rates (section 4) comes to."
            ),
            Picture("run-time.svg", chart, "Run time by scene and mode, normalised to baseline."),
            Table((*head, "auto is"), rows),
        ],
    )


def _counter(anchor: str, title: str, name: str, short: str, scenes: Sequence[Measured]) -> Section:
    shown = _shown(scenes, modes.ORDERS)
    series = [
        Bars(mode.label, [_millions(s.counter(mode, name)) for s in scenes], _MODE_COLOURS[mode])
        for mode in shown
    ]
    what = "packet × triangle" if short == "tests" else "packet × interior node"
    chart = charts.bars(_ticks(scenes), series, f"millions ({what})")
    head = ("Scene", "baseline", "a ray", *(mode.label for mode in shown[1:]))
    rows = []
    for scene in scenes:
        base, count = scene.counter(modes.BASELINE, name), scene.count(modes.BASELINE)
        rows.append(
            (
                _name(scene),
                "–" if base is None else f"{base:,}",
                _number(_ratio(base, count["rays"] if count else None), 1),
                *(_change(_ratio(scene.counter(m, name), base)) for m in shown[1:]),
            )
        )
    return Section(
        anchor,
        title,
        [
            Text(
                f"Of one pass; a packet counts once. These counts are exact: every run on every "
                f"machine gives the same. The slides' chart has no numbers in their text. The "
                f"table has the baseline's {short} and the other modes' change."
            ),
            Picture(f"{anchor}.svg", chart, f"{title[3:]} by scene and mode, in millions."),
            Table(head, rows),
        ],
    )


# ---- 4: rates -------------------------------------------------------------------------


def _rates(scenes: Sequence[Measured]) -> Section:
    series = [
        Bars("slides, base", [_slides(s, lambda r: r.base) for s in scenes], charts.BLACK, True),
        Bars(
            "slides, vol occ",
            [_slides(s, lambda r: r.occluders) for s in scenes],
            charts.RED,
            True,
        ),
        Bars("baseline", [s.rate(modes.BASELINE) for s in scenes], charts.GREY),
        Bars("QDBFS", [s.rate(modes.QDBFS) for s in scenes], charts.ORANGE),
        Bars("auto", [s.rate(modes.AUTO) for s in scenes], charts.BLUE),
    ]
    chart = charts.bars(_ticks(scenes), series, "Mrays/s", digits=1)
    rows = []
    for scene in scenes:
        slides = scene.subject.slides
        theirs = ("–", "–", "–")
        if slides:
            theirs = (f"{slides.base:.1f}", f"{slides.occluders:.1f}", times(slides.gain))
        rows.append(
            (
                _name(scene),
                *theirs,
                *(_number(scene.rate(mode)) for mode in (modes.BASELINE, modes.QDBFS)),
                _times(scene.gain(modes.QDBFS)),
                _number(scene.rate(modes.AUTO)),
                _times(scene.gain(modes.AUTO)),
                scene.tree["auto_order"],
            )
        )
    head = ("Scene", "slides base", "slides vol occ", "ratio", "base", "QDBFS", "ratio")
    single = []
    for scene in scenes:
        gain = scene.gain(modes.QDBFS_SINGLE, modes.BASELINE_SINGLE)
        single.append(
            (
                _name(scene),
                *(_number(scene.rate(mode)) for mode in (modes.BASELINE, modes.BASELINE_SINGLE)),
                *(_number(scene.rate(mode)) for mode in (modes.QDBFS, modes.QDBFS_SINGLE)),
                _times(scene.gain(modes.QDBFS)),
                _times(gain),
                _change(_ratio(gain, scene.gain(modes.QDBFS))),
            )
        )
    return Section(
        "rates",
        "4. Shadow-ray rate",
        [
            Text(
                "Million shadow rays a second. The slides' machine of 2009 and their meshes are "
                "not ours: the ratios are what can be compared."
            ),
            Picture("rates.svg", chart, "Shadow-ray rate: the slides (hatched) and here."),
            Table((*head, "auto", "ratio", "auto is"), rows),
            Text(
                "Single rays beside packets. The slides' “single-ray within 2 %” is read as: the "
                "gain by occluders is the same to 2 % without packets (last column)."
            ),
            Table(
                (
                    "Scene",
                    "base, packets",
                    "base, single",
                    "QDBFS, packets",
                    "QDBFS, single",
                    "gain, packets",
                    "gain, single",
                    "single / packets",
                ),
                single,
            ),
        ],
    )


# ---- 5: areas -------------------------------------------------------------------------


def _areas(scenes: Sequence[Measured]) -> Section:
    series = [
        Bars("slides", [_slides(s, lambda r: r.area) for s in scenes], charts.BLACK, True),
        Bars("here", [s.tree.get("area_ratio") for s in scenes], charts.ORANGE),
    ]
    unit = "occluder area / mesh area"
    chart = charts.bars(_ticks(scenes), series, unit, digits=1)
    rows = []
    for scene in scenes:
        tree = scene.tree
        rows.append(
            (
                _name(scene),
                _number(_slides(scene, lambda r: r.area), 1),
                _number(tree["area_ratio"], 1),
                f"{tree['opaque_leaves']:,}",
                _percent(tree["opaque_leaves"] / tree["leaves"]),
                f"{tree['node_count']:,}",
                f"{tree['depth']}",
                _number(tree["reference_count"] / tree["triangles"]),
            )
        )
    head = ("Scene", "slides v.o. SA / geom SA", "here", "opaque leaves", "of all leaves")
    return Section(
        "areas",
        "5. Occluder area over geometry area",
        [
            Text(
                "The surface of all opaque leaves over that of the mesh: how well the inside is "
                "filled, for how finely it is tessellated. The slides explain their failures by "
                "it, and the library chooses its order by it."
            ),
            Picture("areas.svg", chart, "Occluder area over mesh area: the slides and here."),
            Table((*head, "nodes", "depth", "references a triangle"), rows),
        ],
    )


# ---- 6 and 7: sweeps --------------------------------------------------------------------


def _lines(
    scenes: Sequence[Measured], sizes: Sequence[int], value: Callable[[Measured, int], float | None]
) -> list[Line]:
    """A line for each scene."""
    return [
        Line(
            _name(scene),
            [value(scene, size) for size in sizes],
            charts.LINE_COLOURS[k % len(charts.LINE_COLOURS)],
            charts.MARKERS[k % len(charts.MARKERS)],
        )
        for k, scene in enumerate(scenes)
    ]


def _deferment(scenes: Sequence[Measured]) -> Section:
    pixels = scenes[0].settings.sweep_size

    def seconds(order: str) -> Callable[[Measured, int], float | None]:
        last = modes.deferment(order, DEFERMENTS[-1])
        return lambda scene, n: _ratio(
            scene.seconds(modes.deferment(order, n), pixels), scene.seconds(last, pixels)
        )

    def tests(order: str) -> Callable[[Measured, int], float | None]:
        none = modes.deferment(order, 0)
        return lambda scene, n: _ratio(
            scene.counter(modes.deferment(order, n), "triangle_tests", pixels),
            scene.counter(none, "triangle_tests", pixels),
        )

    plots = []
    for order, label in (("extended", "Extended order"), ("qdbfs", "QDBFS")):
        for unit, value in (
            ("time, size 512 = 1", seconds(order)),
            ("triangle tests, size 0 = 1", tests(order)),
        ):
            lines = _lines(scenes, DEFERMENTS, value)
            plots.append(Panel(label, "leaves on the deferment list", unit, lines))
    chart = charts.panels(DEFERMENTS, plots)
    rows = []
    for scene in scenes:
        for order, label in (("extended", "extended"), ("qdbfs", "QDBFS")):
            found = claims.figures_by_size(
                scene, partial(modes.deferment, order), DEFERMENTS, pixels
            )
            best = min(found, key=lambda n: found[n])
            least, most = (
                scene.counter(modes.deferment(order, n), "triangle_tests", pixels)
                for n in (0, DEFERMENTS[-1])
            )
            rows.append(
                (
                    _name(scene),
                    label,
                    f"{best}",
                    _times(_ratio(found[512], found[best])),
                    _times(_ratio(found[0], found[best])),
                    f"{claims.settled_size(scene, order)}",
                    _change(_ratio(most, least)),
                )
            )
    head = ("Scene", "Order", "fastest size", "512 / fastest", "0 / fastest")
    return Section(
        "deferment",
        "6. Size of the deferment list",
        [
            Text(
                "The slides: “increase in size usually led to increased performance, best "
                f"performance at size 512 (!)”. Passes at {pixels} × {pixels} pixels, cache 8."
            ),
            Picture("deferment.svg", chart, "Time and triangle tests by size of the list."),
            Table((*head, "tests settle at", "tests, 512 against 0"), rows, 2),
        ],
    )


def _cache(scenes: Sequence[Measured]) -> Section:
    pixels = scenes[0].settings.sweep_size

    def seconds(policy: str) -> Callable[[Measured, int], float | None]:
        none = modes.cache(policy, 0)
        return lambda scene, n: _ratio(
            scene.seconds(modes.cache(policy, n), pixels), scene.seconds(none, pixels)
        )

    def hits(policy: str) -> Callable[[Measured, int], float | None]:
        return lambda scene, n: _hit_rate(scene, modes.cache(policy, n), pixels)

    plots = []
    for policy in modes.POLICIES:
        title, x_label = {
            "recent": ("Most recent", "entries"),
            "direction": ("By direction", "cells along an edge of a cube's face"),
        }[policy]
        for unit, value in (
            ("time, no cache = 1", seconds(policy)),
            ("% of blocked rays hit", hits(policy)),
        ):
            plots.append(Panel(title, x_label, unit, _lines(scenes, CACHES, value)))
    chart = charts.panels(CACHES, plots)
    rows = []
    for scene in scenes:
        for policy in modes.POLICIES:
            found = claims.figures_by_size(scene, partial(modes.cache, policy), CACHES, pixels)
            best = min(found, key=lambda n: found[n])
            eight = modes.cache(policy, 8)
            packets = scene.counter(eight, "packets", pixels)
            rows.append(
                (
                    _name(scene),
                    "most recent" if policy == "recent" else "by direction",
                    f"{best}",
                    _times(_ratio(found[0], found[best])),
                    _times(_ratio(found[0], found[8])),
                    _number(_hit_rate(scene, eight, pixels), 1),
                    _number(_ratio(scene.counter(eight, "cache_lookups", pixels), packets), 1),
                    _change(
                        _ratio(
                            scene.counter(eight, "triangle_tests", pixels),
                            scene.counter(modes.cache(policy, 0), "triangle_tests", pixels),
                        )
                    ),
                )
            )
    head = ("Scene", "Policy", "fastest size", "gain there", "gain at 8", "hit rate at 8, %")
    return Section(
        "cache",
        "7. Occluder cache",
        [
            Text(
                "The slides: “in our experience, the VC always improved run-times”; a miss costs "
                "as many box tests as there are entries. QDBFS with list 512, "
                f"{pixels} × {pixels} pixels. The hit rate is of the rays that are blocked at all."
            ),
            Picture("cache.svg", chart, "Time and hit rate by size of the occluder cache."),
            Table((*head, "lookups a packet at 8", "tests, 8 against none"), rows, 2),
        ],
    )


def _hit_rate(scene: Measured, mode: Mode, pixels: int) -> float | None:
    hits = scene.counter(mode, "occluder_hits_cache", pixels)
    rate = _ratio(hits, scene.counter(mode, "occluded", pixels))
    return None if rate is None else 100 * rate


# ---- 8: queues ---------------------------------------------------------------------------


def _queues(scenes: Sequence[Measured]) -> Section:
    names = ("node_visits", "queue_pushes", "queue_pops")
    rows = []
    for scene in scenes:
        packets = scene.counter(modes.BFS, "packets")
        row = [_name(scene)]
        for name in names:
            pair = [scene.counter(mode, name) for mode in (modes.BFS, modes.QDBFS)]
            row += [_number(_ratio(value, packets), 2) for value in pair]
            row.append(_change(_ratio(pair[1], pair[0])))
        row.append(_times(scene.gain(modes.QDBFS, modes.BFS)))
        rows.append(row)
    head = ["Scene"]
    for word in ("nodes visited", "pushes", "pops"):
        head += [f"BFS {word}", f"QDBFS {word}", "change"]
    examples = [
        ("first tree of the slides", "9", "9", "10", "8", "8", "4"),
        ("second tree of the slides", "8", "7", "10", "6", "7", "3"),
    ]
    head_examples = ["Slides"]
    for word in ("nodes visited", "pushes", "pops"):
        head_examples += [f"BFS {word}", f"QDBFS {word}"]
    labels = ("nodes visited", "pushes", "pops")
    series = [
        Bars(
            label,
            [_ratio(s.counter(modes.QDBFS, name), s.counter(modes.BFS, name)) for s in scenes],
            colour,
        )
        for label, name, colour in zip(
            labels, names, (charts.SKY, charts.GREEN, charts.YELLOW), strict=True
        )
    ]
    series.append(
        Bars(
            "time",
            [_ratio(s.seconds(modes.QDBFS), s.seconds(modes.BFS)) for s in scenes],
            charts.ORANGE,
        )
    )
    chart = charts.bars(_ticks(scenes), series, "QDBFS / BFS", line=1.0, digits=2)
    return Section(
        "queues",
        "8. BFS and QDBFS",
        [
            Text(
                "Quick descent follows an only child at once and spares the queue. The slides: "
                "“less queue traffic, 15 % – 20 % faster than BFS” (a time of 0.83 to 0.87), and "
                "two small trees as examples. Per packet; nodes are interior nodes here, where the "
                "slides count leaves as well."
            ),
            Picture("queues.svg", chart, "QDBFS over BFS: nodes, queue traffic and time."),
            Table((*head, "speed, QDBFS / BFS"), rows),
            Table(head_examples, examples),
        ],
    )


# ---- 9: blocked and visible rays ------------------------------------------------------------


def _split(scenes: Sequence[Measured]) -> Section:
    shown = [m for m in modes.SPLIT if any(s.split_count(m, OUTCOMES[0]) for s in scenes)]
    compared = [m for m in (modes.BASELINE, modes.QDBFS) if m in shown]
    # Pale for the baseline.
    colours = {"blocked": ("#9CC9E3", charts.BLUE), "visible": ("#F6D896", charts.ORANGE)}
    series = []
    for k, mode in enumerate(compared):
        for kind in OUTCOMES:
            values = []
            for scene in scenes:
                total = sum(scene.split_seconds(modes.BASELINE, o) or 0 for o in OUTCOMES)
                values.append(_ratio(scene.split_seconds(mode, kind), total))
            series.append(Bars(f"{mode.label}: {kind} rays", values, colours[kind][k]))
    chart = charts.bars(_ticks(scenes), series, "time, baseline = 1", stacked=2)
    rows = []
    for scene in scenes:
        for mode in shown:
            row = [_name(scene), mode.label]
            for kind in OUTCOMES:
                count = scene.split_count(mode, kind)
                rays = count["rays"] if count else None
                seconds = scene.split_seconds(mode, kind)
                row.append(_number(_ratio(None if seconds is None else 1e9 * seconds, rays), 0))
                for name in ("node_visits", "triangle_tests"):
                    value = count["counters"][name] if count else None
                    row.append(_number(_ratio(value, rays)))
            row.append(_percent(claims.visible_share(scene, mode)))
            rows.append(row)
    head = ["Scene", "Mode"]
    for kind in OUTCOMES:
        head += [f"{kind}: ns a ray", "steps a ray", "tests a ray"]
    return Section(
        "split",
        "9. Blocked and visible rays: the new bottleneck",
        [
            Text(
                f"The rays of {SPLIT_TILES} tiles (or of all, where there are fewer) as two "
                "arrays, those that are blocked and those that are not, each traced alone in the "
                "order of the pass. What occluders save is on the blocked rays; what is left is "
                "spent on the visible ones."
            ),
            Picture("split.svg", chart, "Time on blocked and on visible rays, baseline and QDBFS."),
            Table((*head, "time on visible"), rows, 2),
        ],
    )


# ---- 10 and 11: pictures --------------------------------------------------------------------


def _picture(scene: Measured, name: str, caption: str) -> Picture | None:
    found: dict[str, Any] | None = scene.pictures.get("pictures", {}).get(name)
    if found is None:
        return None
    suffix = {"image/jpeg": "jpg", "image/png": "png"}[found["mime"]]
    data = base64.b64decode(found["data"])
    return Picture(f"{scene.subject.name}-{name}.{suffix}", data, f"{_name(scene)}: {caption}")


def _gallery(pictures: Sequence[Picture | None], columns: int) -> Gallery:
    return Gallery([picture for picture in pictures if picture is not None], columns)


def _failures(scenes: Sequence[Measured]) -> Section:
    failed = [scene for scene in scenes if scene.subject.failure]
    solid = next((scene for scene in scenes if scene.subject.solid), None)
    blocks: list[Block] = [
        Text(
            "The slides' failures: Yeah Right, whose shadow “has little coherency” and is “plagued "
            "by silhouette”, and Cowboy, whose “internal volume is too small compared to "
            "tessellation rate”. "
            + (
                f"Here {', '.join(_name(s) for s in failed)} stand for them"
                + (f"; {_name(solid)} is there to compare with." if solid else ".")
                if failed
                else f"No scene of this run stands for {' or '.join(s.name for s in FAILURES)}."
            )
        )
    ]
    shown = failed + ([solid] if failed and solid else [])
    head = ("Scene", "coherent blocks", "penumbra", "area ratio", "QDBFS / baseline", "auto")
    rows = [
        (
            _name(scene),
            _percent(scene.pictures.get("coherent")),
            _percent(scene.pictures.get("penumbra")),
            _number(scene.tree["area_ratio"], 1),
            _times(scene.gain(modes.QDBFS)),
            _times(scene.gain(modes.AUTO)),
            _change(claims.counters(modes.QDBFS, modes.BASELINE, "node_visits")(scene)),
            _change(claims.counters(modes.QDBFS, modes.BASELINE, "triangle_tests")(scene)),
        )
        for scene in sorted(scenes, key=lambda s: -(s.pictures.get("coherent") or 0.0))
    ]
    blocks.append(Table((*head, "QDBFS steps", "QDBFS tests"), rows))
    blocks.append(
        Text(
            "Coherent blocks: of blocks of 8 × 8 pixels and a light, those of which all rays "
            "agree. "
            "Penumbra: of pixels and lights, those that see part of the light."
        )
    )
    for scene in shown:
        heat = [
            _picture(
                scene,
                f"steps-{mode.name}",
                f"steps a ray, {mode.label}: mean {_steps(scene, mode, 'mean')}, "
                f"white {_steps(scene, mode, 'top')}",
            )
            for mode in (modes.BASELINE, modes.QDBFS)
        ]
        pictures = [
            _picture(scene, "baseline", "baseline"),
            _picture(scene, "occluders", "with occluders"),
            _picture(scene, "coherence", "coherence, yellow: all rays agree"),
            *heat,
        ]
        blocks.append(_gallery(pictures, 5 if any(heat) else 3))
    return Section("failures", "10. Failure cases", blocks)


def _steps(scene: Measured, mode: Mode, what: str) -> str:
    found = scene.pictures.get("pictures", {}).get(f"steps-{mode.name}")
    return f"{found[what]:.1f}" if found else "–"


def _pictures(scenes: Sequence[Measured]) -> Section:
    blocks: list[Block] = [
        Text(
            "A slice through each tree at its largest occluder (orange: opaque leaves; blue: "
            "boundary leaves; white: clear leaves), the largest occluders seen through the mesh, "
            "and the shadows with and without occluders with their difference: red where a count "
            "differs, which is nowhere."
            if not claims.different(scenes)
            else "Red where a count differs."
        )
    ]
    for scene in scenes:
        number = scene.pictures.get("different")
        pictures = [
            _picture(scene, "slice", "slice"),
            _picture(scene, "boxes", "largest occluders"),
            _picture(scene, "baseline", "baseline"),
            _picture(scene, "occluders", "with occluders"),
            _picture(scene, "difference", f"{number} counts differ"),
        ]
        blocks.append(_gallery(pictures, 5))
    return Section("pictures", "11. The tree, the occluders and the images", blocks)


# ---- 12: Embree --------------------------------------------------------------------------------


def _embree(scenes: Sequence[Measured], context: Context) -> Section:
    names = scenes[0].embree_modes()
    if not names:
        why = context.embree or "it was not asked for"
        return Section("embree", "12. Embree", [Text(f"Embree was not measured: {why}.")])
    ours = _shown(scenes, (modes.BASELINE, modes.QDBFS, modes.OPAQUE_FIRST, modes.AUTO))
    rates = {name: [_embree_rate(scene, name) for scene in scenes] for name in names}
    best = [
        max((r for r in column if r), default=None) for column in zip(*rates.values(), strict=True)
    ]
    rows = [[mode.label, *(_number(scene.rate(mode)) for scene in scenes)] for mode in ours]
    rows += [[f"Embree {name}", *map(_number, rates[name])] for name in names]
    for mode in (modes.BASELINE, modes.OPAQUE_FIRST, modes.AUTO):
        for name in (n for n in names if "sse4.2" in n):
            pairs = zip(scenes, rates[name], strict=True)
            rows.append(
                [f"{mode.label} / {name}", *(_times(_ratio(s.rate(mode), r)) for s, r in pairs)]
            )
    rows.append(
        [
            "auto / fastest of Embree",
            *(_times(_ratio(s.rate(modes.AUTO), r)) for s, r in zip(scenes, best, strict=True)),
        ]
    )
    rows.append(["Embree's robust image is ours", *map(_same_image, scenes)])
    return Section(
        "embree",
        "12. Embree",
        [
            Text(
                "Million rays a second of Embree on the same rays, in the same rounds. "
                "`isa=sse4.2` has four lanes as ours; the others use all lanes of the machine. "
                "Embree's robust mode is not exact: where its image is not ours, a few counts of "
                "rays through edges differ."
            ),
            Table(("Mrays/s", *(_name(scene) for scene in scenes)), rows),
        ],
    )


def _embree_rate(scene: Measured, name: str) -> float | None:
    found = scene.embree(name)
    return found["rays"] / found["seconds"] / 1e6 if found else None


def _same_image(scene: Measured) -> str:
    robust, ours = scene.embree("robust-1"), scene.pictures.get("fnv1a")
    if robust is None or ours is None:
        return "–"
    return "yes" if robust["hash"] == ours else "no"


# ---- 13: classification ------------------------------------------------------------------------


def _classes(scenes: Sequence[Measured]) -> Section:
    head = ("Scene", "Leaves", "empty", "flood fill, s", "seed rays")
    rows = []
    for scene in scenes:
        tree = scene.tree
        empty = tree["leaves"] - tree["boundary_leaves"]
        row = [
            _name(scene),
            f"{tree['leaves']:,}",
            f"{empty:,}",
            _number(tree["seconds"]["classify"], 3),
            f"{tree['seed_rays']:,}",
        ]
        for direction in DIRECTIONS:
            cell = scene.classes(direction)
            row.append(_number(cell["seconds"] if cell else None, 3))
            row.append(f"{cell['disagreements']:,}" if cell else "–")
        rows.append(row)
    directions = []
    for direction in DIRECTIONS:
        label = ", ".join(f"{x:g}" for x in direction)
        directions += [f"rays along ({label}), s", "disagree"]
    blocks: list[Block] = [
        Text(
            "The slides cast one ray from the centre of each empty leaf and look at the side of "
            "the triangle that it meets. The library joins empty leaves across their faces and "
            "casts two exact rays for each connected group."
        )
    ]
    blocks.append(Table((*head, *directions), rows))
    return Section("classes", "13. Classification", blocks)


# ---- 14 and 15: others -------------------------------------------------------------------------


def _sceptics(scenes: Sequence[Measured]) -> Section:
    plain = _shown(scenes, (modes.BASELINE, *modes.SCEPTICS))
    filled = _shown(scenes, (modes.STANDARD, modes.QDBFS, modes.OPAQUE_FIRST, modes.AUTO))
    colours = dict(zip(modes.SCEPTICS, (charts.PINK, charts.YELLOW, charts.BLACK), strict=True))
    series = [
        Bars(
            _plain_label(mode),
            _gains(scenes, mode),
            {**_MODE_COLOURS, **colours}[mode],
        )
        for mode in plain
    ]
    series += [
        Bars(f"occluders: {mode.label}", _gains(scenes, mode), _MODE_COLOURS[mode])
        for mode in filled
    ]
    chart = charts.bars(_ticks(scenes), series, "speed, nearest first = 1", line=1.0)
    best = [_fastest(scene, plain) for scene in scenes]
    rows = [[mode.label, *map(_times, _gains(scenes, mode))] for mode in plain[1:]]
    rows.append(["the best without occluders", *map(_plain_label, best)])
    for mode in filled:
        gains = [scene.gain(mode, other) for scene, other in zip(scenes, best, strict=True)]
        rows.append([f"occluders: {mode.label}, against that", *map(_times, gains)])
    sources = (
        "Larger child first: Nah and Manocha 2014 (SATO). Cheaper child first: Ize and Hansen "
        "2011 (RTSAH). Last triangle first: the shadow cache of Haines and Greenberg 1986."
    )
    return Section(
        "sceptics",
        "14. Any-hit orders without occluders",
        [
            Text(
                "A shadow ray may stop at any triangle; orders that use this need no inside. Do "
                f"occluders still gain against the best of them? {sources}"
            ),
            Picture("sceptics.svg", chart, "Speed of orders without and with occluders."),
            Table(("Speed", *(_name(scene) for scene in scenes)), rows),
        ],
    )


def _fastest(scene: Measured, listed: Sequence[Mode]) -> Mode:
    return max(listed, key=lambda mode: scene.gain(mode) or 0.0)


def _plain_label(mode: Mode) -> str:
    return "nearest first" if mode is modes.BASELINE else mode.label


def _gains(scenes: Sequence[Measured], mode: Mode) -> list[float | None]:
    return [scene.gain(mode) for scene in scenes]


# What each is compared with.
_RELATED = (
    ("Voxel occlusion (Woo and Amanatides 1990)", modes.VOXELS_BASE, modes.BASELINE),
    ("Voxel occlusion, with occluders", modes.VOXELS_QDBFS, modes.QDBFS),
    ("Occluder fusion (Schaufler et al. 2000)", modes.QDBFS, modes.UNFUSED_QDBFS),
    ("Occluder fusion, standard order", modes.STANDARD, modes.UNFUSED_STANDARD),
    ("Deep entry points (Reshetov et al. 2005)", modes.ENTRY_BASE, modes.BASELINE),
    ("Deep entry points, with occluders", modes.ENTRY_QDBFS, modes.QDBFS),
    ("Deep entry points, as auto has them", modes.AUTO, modes.ENTRY_NOT_AUTO),
)


def _related(scenes: Sequence[Measured]) -> Section:
    head = ("System", "against", *(_name(scene) for scene in scenes))
    Rows = list[tuple[str, ...]]
    speed: Rows = []
    steps: Rows = []
    tests: Rows = []
    for title, mode, base in _RELATED:
        if not any(scene.count(mode) and scene.count(base) for scene in scenes):
            continue
        against = base.label
        speed.append((title, against, *(_times(s.gain(mode, base)) for s in scenes)))
        for rows, name in ((steps, "node_visits"), (tests, "triangle_tests")):
            ratio = claims.counters(mode, base, name)
            rows.append((title, against, *(_change(ratio(s)) for s in scenes)))
    blocks: list[Block] = [
        Text(
            "What the slides name as previous work, each added to this library's kernels and "
            "compared with the same mode without it. Speed, then the change of traversal steps "
            "and of triangle tests."
        ),
    ]
    for what, rows in (("Speed", speed), ("Traversal steps", steps), ("Triangle tests", tests)):
        if rows:
            blocks += [Text(f"{what}:"), Table(head, rows, 2)]
    decided = _decided(scenes)
    if decided:
        blocks += [
            Text("Rays that were decided before the tree (with QDBFS and occluders):"),
            decided,
        ]
    return Section("related", "15. The systems the slides build on", blocks)


def _decided(scenes: Sequence[Measured]) -> Table | None:
    rows = []
    for label, mode, names in (
        ("voxels, lit", modes.VOXELS_QDBFS, ("voxel_lit_rays",)),
        ("voxels, dark", modes.VOXELS_QDBFS, ("voxel_dark_rays",)),
        ("entry points, lit", modes.ENTRY_QDBFS, ("entry_lit_rays",)),
        ("entry points, dark", modes.ENTRY_QDBFS, ("entry_dark_rays",)),
        ("entry points, a short list of triangles", modes.ENTRY_QDBFS, ("entry_few_rays",)),
    ):
        row = [label]
        for scene in scenes:
            count = scene.count(mode)
            known = count is not None and names[0] in count["counters"]
            value = sum(count["counters"][n] for n in names) if count and known else None
            row.append(_percent(_ratio(value, count["rays"] if count else None)))
        if any(text != "–" for text in row[1:]):
            rows.append(row)
    return Table(("Share of rays", *(_name(s) for s in scenes)), rows) if rows else None
