"""The figures as tables (Markdown, legible as text), and beside what is aimed at."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from statistics import median
from typing import Any, TypeAlias

from .inputs import STAND_INS
from .measure import EMBREE_BEST
from .workload import SCENES

Results: TypeAlias = dict[str, Any]

SSE = "robust-4:isa=sse4.2"

# What the project aims at; a figure below it is reported, never an error.
BASELINE_FLOOR = {"bunny": 0.83, "armadillo": 0.60, "dragon": 0.64}  # of Embree with SSE
BASELINE_AIM = 1.0
QDBFS_AIM = {"bunny": 1.5, "armadillo": 1.8, "dragon": 2.0}  # of the baseline
AUTO_FLOOR = {"rose": 0.95, "tubes131": 0.95, "cowboy": 0.95}  # of the baseline
BUILD_SECONDS = {"dragon": 1.5}  # two threads, classification included
BYTES_PER_TRIANGLE = {"dragon": 150.0}
TWO_THREADS = 1.9
PYTHON_SHARE = 0.03


def table(head: Sequence[str], rows: Iterable[Sequence[str]], texts: int = 1) -> str:
    """Markdown, columns aligned: the first `texts` to the left, all others to the right."""
    lines = [list(head), *map(list, rows)]
    widths = [max(len(line[i]) for line in lines) for i in range(len(head))]

    def join(cells: Sequence[str]) -> str:
        padded = [
            cell.ljust(width) if i < texts else cell.rjust(width)
            for i, (cell, width) in enumerate(zip(cells, widths, strict=True))
        ]
        return f"| {' | '.join(padded)} |"

    rule = ["-" * width if i < texts else "-" * (width - 1) + ":" for i, width in enumerate(widths)]
    return "\n".join([join(lines[0]), join(rule), *map(join, lines[1:])])


def seconds(lines: Sequence[dict[str, Any]]) -> float:
    return float(median(line["cpu_s"] for line in lines))


def speed(lines: Sequence[dict[str, Any]] | None) -> float | None:
    """Median Mrays/s of thread CPU time."""
    return median(line["mrays_s"] for line in lines) if lines else None


def best(embree: dict[str, Any]) -> tuple[str, float] | None:
    """Embree's fastest mode, and its speed."""
    speeds = [(speed(embree[mode]) or 0.0, mode) for mode in EMBREE_BEST if embree.get(mode)]
    return (max(speeds)[1], max(speeds)[0]) if speeds else None


def _number(value: float | None, digits: int = 2) -> str:
    return "-" if value is None else f"{value:.{digits}f}"


def _ratio(value: float | None, base: float | None) -> float | None:
    return value / base if value and base else None


def _share(value: float | None, base: float | None) -> str:
    ratio = _ratio(value, base)
    return "-" if ratio is None else f"{ratio:.2f}x"


def spread(results: Results) -> float:
    """The largest (slowest - fastest) / median of any mode and mesh."""
    widest = 0.0
    for mesh in results["meshes"].values():
        for side in ("ours", "embree"):
            for mode, lines in mesh[side].items():
                if mode != "none":
                    times = [line["cpu_s"] for line in lines]
                    widest = max(widest, (max(times) - min(times)) / median(times))
    return widest


def speed_table(results: Results) -> str:
    rows = []
    for name, mesh in results["meshes"].items():
        ours, embree = mesh["ours"], mesh["embree"]
        base, sse, top = speed(ours.get("baseline")), speed(embree.get(SSE)), best(embree)
        for side, lines_by_mode in (("vocc", ours), ("Embree", embree)):
            for mode, lines in lines_by_mode.items():
                value = speed(lines)
                row = [name, f"{side} {mode}", _number(value, 2)]
                if mode == "none":
                    row += ["", "", ""]
                else:
                    row += [_share(value, x) for x in (base, sse, top[1] if top else None)]
                row.append(_number(seconds(lines), 3))
                rows.append(row)
    head = ["mesh", "mode", "Mray/s", "/ baseline", "/ Embree SSE", "/ Embree best", "CPU s"]
    return table(head, rows, 2)


def summary_table(results: Results) -> str:
    """One line a mesh."""
    rows = []
    for name, mesh in results["meshes"].items():
        ours, embree = mesh["ours"], mesh["embree"]
        base, top = speed(ours.get("baseline")), best(embree)
        line = next(iter(lines[0] for lines in ours.values()))
        traced = next((ls[0] for mode, ls in ours.items() if mode != "none"), line)
        rows.append(
            [
                name,
                f"{line['triangles']}",
                f"{line['rays'] / 1e6:.2f}",
                f"{100 * traced.get('visible', 0) / line['rays']:.0f} %",
                _number(base, 1),
                *(_share(speed(ours.get(mode)), base) for mode in ("qdbfs", "auto")),
                line["build"]["auto_order"],
                _number(line["build"]["area_ratio"], 1),
                _share(base, speed(embree.get(SSE))),
                _share(speed(ours.get("auto")), speed(embree.get(SSE))),
                _share(speed(ours.get("auto")), top[1] if top else None),
            ]
        )
    head = ["mesh", "triangles", "Mrays", "visible", "baseline", "qdbfs", "auto", "is", "area"]
    head += ["baseline / SSE", "auto / SSE", "auto / best"]
    return table(head, rows)


def versus_table(results: Results) -> str:
    """Our modes beside Embree's fastest, of the same rounds."""
    rows = []
    for name, mesh in results["meshes"].items():
        top, differ = best(mesh["embree"]), mesh["differ"]
        for mode, lines in mesh["ours"].items():
            if mode == "none":
                continue
            line = lines[0]
            rows.append(
                [
                    name,
                    mode,
                    f"{line['rays'] / 1e6:.2f}",
                    f"{100 * (1 - line['visible'] / line['rays']):.1f} %",
                    _number(speed(lines)),
                    top[0] if top else "-",
                    _number(top[1] if top else None),
                    _share(speed(lines), top[1] if top else None),
                    _number(seconds(lines), 3),
                    str(differ["ours"].get(mode, "-")),
                    str(differ["embree"].get(top[0], "-")) if top else "-",
                ]
            )
    head = ["mesh", "mode", "Mrays", "blocked", "Mray/s", "Embree's best", "Mray/s", "ratio"]
    return table([*head, "CPU s", "counts differ", "of Embree's best"], rows, 2)


def counter_table(results: Results) -> str:
    """Per packet: the paper's own measures."""
    rows = []
    for name, mesh in results["meshes"].items():
        for mode, lines in mesh["ours"].items():
            c = lines[0].get("counters")
            if not c or not c["packets"]:
                continue
            packets, rays = c["packets"], c["rays"]
            per = [c[key] / packets for key in ("node_visits", "leaf_visits", "triangle_tests")]
            lanes = c["active_lanes"] / c["node_visits"] if c["node_visits"] else 0.0
            rows.append(
                [
                    name,
                    mode,
                    *(_number(x) for x in per),
                    _number(lanes),
                    _number(c["cache_lookups"] / packets),
                    _number(c["deferred"] / packets),
                    _number(c["queue_pushes"] / packets),
                    *(
                        f"{100 * c[key] / rays:.2f} %"
                        for key in ("occluded", "occluder_hits_tree", "occluder_hits_cache")
                    ),
                    f"{c['fallbacks']}",
                    f"{1e6 * c['exact_tests'] / rays:.1f}",
                    f"{c['careful_rays']}",
                ]
            )
    head = ["mesh", "mode", "steps", "leaves", "tests", "lanes", "cached", "deferred", "queued"]
    head += ["blocked", "by tree", "by cache", "fallbacks", "exact / M", "careful"]
    return table(head, rows, 2)


def hash_table(results: Results) -> str:
    """Which images are equal: all of ours must be."""
    rows = []
    for name, mesh in results["meshes"].items():
        hashes = {
            line["hash"] for lines in mesh["ours"].values() for line in lines if "hash" in line
        }
        reference = mesh["reference"]
        same = "-" if reference is None else ("yes" if hashes == {reference} else "no: verify")
        alike = "yes" if len(hashes) == 1 else "NO"
        rows.append([name, alike, ", ".join(sorted(hashes)), reference or "-", same])
    return table(["mesh", "our modes agree", "hash", "reference", "equal"], rows)


def identical(results: Results) -> bool:
    """All modes of ours gave the same image, on every mesh."""
    return all(
        len({line["hash"] for lines in mesh["ours"].values() for line in lines if "hash" in line})
        <= 1
        for mesh in results["meshes"].values()
    )


def tree_table(results: Results) -> str:
    rows = []
    for name, mesh in results["meshes"].items():
        line = next(iter(mesh["ours"].values()))[0]
        b = line["build"]
        leaves = b["boundary"] + b["opaque"] + b["clear"] + b["unknown"]
        rows.append(
            [
                name,
                f"{line['triangles']}",
                f"{b['nodes']}",
                f"{b['depth']}",
                _number(b["references"] / line["triangles"]),
                _number(b["references"] / max(b["boundary"], 1)),
                *(f"{100 * b[key] / leaves:.1f} %" for key in ("boundary", "opaque", "clear")),
                f"{b['seed_rays']}",
                f"{100 * b['opaque_volume']:.2f} %",
                _number(b["bytes_per_triangle"], 1),
            ]
        )
    head = ["mesh", "triangles", "nodes", "depth", "refs / tri", "refs / leaf"]
    head += ["boundary", "opaque", "clear", "seed rays", "opaque volume", "bytes / tri"]
    return table(head, rows)


def build_table(results: Results) -> str:
    rows = []
    for name, mesh in results["meshes"].items():
        for threads, lines in mesh.get("builds", {}).get("ours", {}).items():
            stages = [min(b[key] for b in lines) for key in _STAGES]
            rows.append([name, "vocc", threads, *(_number(x, 3) for x in stages)])
        for threads, lines in mesh.get("builds", {}).get("embree", {}).items():
            for kind in ("robust", "fast"):
                found = [b[key]["wall_s"] for b in lines for key in b if key.startswith(kind)]
                row = [name, f"Embree {kind}", threads, _number(min(found), 3)]
                rows.append([*row, "", "", "", "", ""])
    stages = ["components", "tree", "classify", "occluders", "beams"]
    return table(["mesh", "", "threads", "wall s", *stages], rows, 2)


_STAGES = ("wall_s", "components_s", "tree_s", "classify_s", "occluders_s", "beams_s")


def scaling_of(lines: dict[str, Any]) -> tuple[int, float]:
    """Threads, and one thread's wall clock over theirs, the fastest runs of each: unlike CPU
    time, wall clock grows with whatever else the machine does."""
    counts = sorted(map(int, lines))
    one, many = (min(x["wall_s"] for x in lines[str(n)]) for n in (counts[0], counts[-1]))
    return counts[-1], one / many


def scaling_table(results: Results) -> str:
    rows = []
    for name, mesh in results["meshes"].items():
        for mode, lines in mesh.get("scaling", {}).items():
            threads, ratio = scaling_of(lines)
            rows.append([name, mode, f"{threads}", f"{ratio:.2f}x"])
    return table(["mesh", "mode", "threads", "speed of one"], rows, 2)


def outcome_table(results: Results) -> str:
    rows = []
    for name, mesh in results["meshes"].items():
        for side, modes in mesh.get("by_outcome", {}).items():
            for mode, kinds in modes.items():
                speeds = [speed(kinds.get(kind)) for kind in ("all", "blocked", "visible")]
                label = "vocc" if side == "ours" else "Embree"
                rows.append([name, f"{label} {mode}", *(_number(x) for x in speeds)])
    return table(["mesh", "Mray/s of arrays", "all", "blocked", "visible"], rows, 2)


def python_table(results: Results) -> str:
    rows = []
    for name, mesh in results["meshes"].items():
        if "python" in mesh:
            c, python = median(mesh["python"]["c"]), median(mesh["python"]["python"])
            same = "yes" if mesh["python"]["same"] else "NO"
            share = f"{100 * (python / c - 1):+.2f} %"
            rows.append([name, _number(c, 3), _number(python, 3), share, same])
    return table(["mesh", "C s", "Python s", "Python adds", "same result"], rows)


def target_rows(results: Results) -> list[tuple[str, str, str, bool]]:
    """What is aimed at, the aim, the figure reached, and whether that is enough."""
    rows: list[tuple[str, str, str, bool]] = []
    if results["settings"]["scene"] != "workload":
        return rows

    def at_least(what: str, aim: float, value: float | None) -> None:
        if value is not None:
            rows.append((what, f">= {aim:g}x", f"{value:.2f}x", value >= aim))

    def at_most(what: str, aim: float, value: float | None, unit: str) -> None:
        if value is not None:
            rows.append((what, f"<= {aim:g}{unit}", f"{value:.2f}{unit}", value <= aim))

    for name, mesh in results["meshes"].items():
        ours, embree = mesh["ours"], mesh["embree"]
        base = speed(ours.get("baseline"))
        if name in BASELINE_FLOOR:
            ratio = _ratio(base, speed(embree.get(SSE)))
            at_least(f"{name}: baseline / Embree SSE robust, aim", BASELINE_AIM, ratio)
            at_least(f"{name}: baseline / Embree SSE robust, floor", BASELINE_FLOOR[name], ratio)
        if name in QDBFS_AIM:
            found = [
                (ratio, mode)
                for mode, lines in ours.items()
                if mode.startswith("qdbfs") and (ratio := _ratio(speed(lines), base))
            ]
            if found:
                at_least(f"{name}: {max(found)[1]} / baseline", QDBFS_AIM[name], max(found)[0])
        if name in AUTO_FLOOR:
            ratio = _ratio(speed(ours.get("auto")), base)
            at_least(f"{name}: auto / baseline", AUTO_FLOOR[name], ratio)
        if name in BYTES_PER_TRIANGLE:
            held = next(iter(ours.values()))[0]["build"]["bytes_per_triangle"]
            at_most(f"{name}: bytes a triangle", BYTES_PER_TRIANGLE[name], held, "")
        two = mesh.get("builds", {}).get("ours", {}).get("2")
        if two and name in BUILD_SECONDS:
            took = min(b["wall_s"] for b in two)
            at_most(f"{name}: build, two threads", BUILD_SECONDS[name], took, " s")
        for mode, lines in mesh.get("scaling", {}).items():
            threads, ratio = scaling_of(lines)
            if threads == 2:
                at_least(f"{name}: {mode}, two threads / one", TWO_THREADS, ratio)
        if "python" in mesh:
            share = median(mesh["python"]["python"]) / median(mesh["python"]["c"]) - 1
            at_most(f"{name}: Python adds", 100 * PYTHON_SHARE, 100 * share, " %")
    return rows


def target_table(results: Results) -> str:
    rows = [
        (what, aim, value, "yes" if met else "no") for what, aim, value, met in target_rows(results)
    ]
    return table(["aim", "", "reached", "met"], rows)


def introduction(results: Results) -> str:
    """What was measured, and how."""
    settings, machine = results["settings"], results["machine"]
    stand_ins = [f"{name} ({STAND_INS[name]})" for name in results["meshes"] if name in STAND_INS]
    pinned = f"processor {settings['cpus'][0]}" if settings["cpus"] else "not pinned"
    scene, size = settings["scene"], settings["size"]
    intro = (
        f"{machine['processor']}, {pinned}; scene {scene}, {size} x {size} pixels, "
        f"{settings['samples']} samples a light, {len(SCENES[scene].lights)} lights; one thread, "
        "its CPU time, medians of "
        f"{settings['rounds']} alternating rounds; widest spread {100 * spread(results):.0f} %."
    )
    if stand_ins:
        intro += f" Not the paper's models: {', '.join(stand_ins)}."
    if not settings["embree"]:
        intro += " Embree was not measured: its column is empty."
    return intro


REFERENCE = (
    "Counts that differ are told from the stored image or else from Embree's robust mode, which is "
    "not exact either: `python -m bench verify` says who is right."
)


def versus(results: Results) -> str:
    """Only the comparison with Embree's best."""
    return f"{introduction(results)}\n{REFERENCE}\n\n{versus_table(results)}\n"


def markdown(results: Results) -> str:
    """Everything that was measured."""
    parts = [("Summary (baseline in Mray/s, then ratios)", summary_table), ("Speed", speed_table)]
    if results["settings"]["embree"]:
        parts.append(("Embree's best", versus_table))
    parts += [("Counters, per packet", counter_table), ("Images", hash_table)]
    parts += [("Trees", tree_table)]
    for key, title, make in (
        ("builds", "Builds (wall clock, fastest)", build_table),
        ("scaling", "Threads (wall clock, fastest)", scaling_table),
        ("by_outcome", "By outcome", outcome_table),
        ("python", "Python", python_table),
    ):
        if any(key in mesh for mesh in results["meshes"].values()):
            parts.append((title, make))
    if target_rows(results):
        parts.append(("Aims", target_table))
    texts = [f"## {title}\n\n{make(results)}" for title, make in parts]
    return "\n\n".join([introduction(results), *texts]) + "\n"
