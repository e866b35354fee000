"""Charts, each an SVG file in memory: bars by scene, lines by size."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from io import BytesIO
from typing import Any

# Okabe and Ito's colours, which colour-blind eyes tell apart; a hatch or a marker beside the
# colour tells the rest.
BLACK, ORANGE, SKY, GREEN = "#333333", "#E69F00", "#56B4E9", "#009E73"
YELLOW, BLUE, RED, PINK = "#F0E442", "#0072B2", "#D55E00", "#CC79A7"
GREY = "#9AA5B1"
# Dark enough for lines on white.
LINE_COLOURS = (BLUE, ORANGE, GREEN, RED, PINK, SKY, BLACK, "#8C6D1F")
MARKERS = ("o", "s", "^", "D", "v", "P", "X", "*")

# Figures over bars, beyond which they would run into each other.
MOST_FIGURES = 32

STYLE: Any = {
    "font.family": "sans-serif",
    "font.size": 10,
    "axes.titlesize": 11,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.edgecolor": "#7B8794",
    "axes.labelcolor": "#323F4B",
    "axes.axisbelow": True,
    "axes.grid": True,
    "axes.grid.axis": "y",
    "grid.color": "#E4E7EB",
    "xtick.color": "#323F4B",
    "ytick.color": "#323F4B",
    "legend.frameon": False,
    "legend.fontsize": 9,
    "figure.facecolor": "white",
    "savefig.facecolor": "white",
    "svg.fonttype": "path",
    # Without it every run would name the same shapes otherwise.
    "svg.hashsalt": "vocc",
}


@dataclass(frozen=True)
class Bars:
    """One series: a bar for each scene.

    Attributes:
        label: in the legend.
        values: one a scene; None leaves its place empty.
        colour: of the bars.
        paper: drawn hollow and hatched, as the slides' figures are.
    """

    label: str
    values: Sequence[float | None]
    colour: str
    paper: bool = False


@dataclass(frozen=True)
class Marks:
    """The slides' figures over the bars of one series.

    Attributes:
        label: in the legend.
        values: one a scene; None where the slides have none.
        over: index of the series.
    """

    label: str
    values: Sequence[float | None]
    over: int


@dataclass(frozen=True)
class Line:
    """One line of a panel: y at the panel's xs; None where there is none."""

    label: str
    values: Sequence[float | None]
    colour: str
    marker: str


@dataclass(frozen=True)
class Panel:
    """One plot among several side by side."""

    title: str
    x_label: str
    unit: str
    lines: Sequence[Line]


def bars(
    scenes: Sequence[str],
    series: Sequence[Bars],
    unit: str,
    *,
    marks: Sequence[Marks] = (),
    line: float | None = None,
    digits: int | None = None,
    stacked: int = 0,
) -> bytes:
    """Bars in groups, a group a scene.

    Args:
        scenes: names of the groups.
        series: a bar each in every group.
        unit: label of the vertical axis.
        marks: the slides' figures.
        line: a height to be marked, such as that of the baseline.
        digits: decimals of the figures over the bars; None for no figures. They are left out
            where bars are many.
        stacked: so many series at a time are one bar; 0 for none.
    """
    from matplotlib import rc_context
    from matplotlib.figure import Figure

    places = len(series) // stacked if stacked else len(series)
    with rc_context(STYLE):
        figure: Any = Figure(figsize=(9.6, 3.7), layout="constrained")
        axes: Any = figure.add_subplot()
        width = 0.84 / places
        bottom = [0.0] * len(scenes)
        for index, one in enumerate(series):
            place, level = divmod(index, stacked) if stacked else (index, 0)
            if level == 0:
                bottom = [0.0] * len(scenes)
            shift = (place - (places - 1) / 2) * width
            at = [k + shift for k, v in enumerate(one.values) if v is not None]
            floor = [b for b, v in zip(bottom, one.values, strict=True) if v is not None]
            values = [v for v in one.values if v is not None]
            look: dict[str, Any] = {"color": one.colour, "edgecolor": "white", "linewidth": 0.6}
            if one.paper:
                look = {"color": "white", "edgecolor": one.colour, "hatch": "////", "linewidth": 1}
            drawn = axes.bar(at, values, width * 0.94, floor, label=one.label, **look)
            if digits is not None and len(series) * len(scenes) <= MOST_FIGURES:
                texts = [f"{v:.{digits}f}" for v in values]
                axes.bar_label(drawn, texts, fontsize=7, padding=1.5, color="#323F4B")
            bottom = [b + (v or 0.0) for b, v in zip(bottom, one.values, strict=True)]
        for mark in marks:
            shift = (mark.over - (places - 1) / 2) * width
            at = [k + shift for k, v in enumerate(mark.values) if v is not None]
            heights = [v for v in mark.values if v is not None]
            axes.plot(
                at, heights, linestyle="none", marker="D", markersize=7, markerfacecolor="white",
                markeredgecolor="black", markeredgewidth=1.4, label=mark.label, zorder=5,
            )  # fmt: skip
        if line is not None:
            axes.axhline(line, color="black", linewidth=0.9, linestyle="--", zorder=1)
        axes.set_xticks(range(len(scenes)), scenes)
        axes.tick_params(axis="x", length=0)
        axes.set_ylabel(unit)
        axes.margins(x=0.01)
        axes.set_ylim(bottom=0)
        labels = [one.label for one in series] + [mark.label for mark in marks]
        # As many side by side as have room.
        columns = min(len(labels), 130 // (max(map(len, labels)) + 6))
        figure.legend(loc="outside upper left", ncols=columns)
        return _svg(figure)


def panels(xs: Sequence[int], plots: Sequence[Panel]) -> bytes:
    """Plots side by side over sizes that double, 0 standing apart on the left."""
    from matplotlib import rc_context
    from matplotlib.figure import Figure

    with rc_context(STYLE):
        columns = min(len(plots), 2)
        down = -(-len(plots) // columns)
        figure: Any = Figure(figsize=(9.6, 0.6 + 3.0 * down), layout="constrained")
        grid: Any = figure.subplots(down, columns, squeeze=False)
        for axes, plot in zip(grid.flat, plots, strict=False):
            for line in plot.lines:
                there = [(k, v) for k, v in enumerate(line.values) if v is not None]
                axes.plot(
                    [k for k, _ in there], [v for _, v in there], color=line.colour,
                    marker=line.marker, markersize=5, linewidth=1.5, label=line.label,
                )  # fmt: skip
            axes.set_title(plot.title)
            axes.set_ylabel(plot.unit)
            axes.set_xlabel(plot.x_label)
            axes.set_xticks(range(len(xs)), [str(x) for x in xs])
        for axes in list(grid.flat)[len(plots) :]:
            axes.set_visible(False)
        handles, labels = grid.flat[0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside upper left", ncols=min(len(labels), 8))
        return _svg(figure)


def _svg(figure: Any) -> bytes:
    buffer = BytesIO()
    figure.savefig(buffer, format="svg", metadata={"Date": None, "Creator": None})
    return buffer.getvalue()
