"""The report of a render as text."""

from __future__ import annotations

import addon  # noqa: F401 - first: it makes the next importable
import pytest

from blender_addon.report import LISTED, ObjectReport, Report, count_text, plural


def mesh(name: str, open_edges: int = 0) -> ObjectReport:
    why = f"open, {open_edges} open edges" if open_edges else ""
    return ObjectReport(name, 1, 12, not open_edges, open_edges, why)


REPORT = Report(
    scene="Set",
    size=(640, 360),
    masks=("Shadow Key", "Shadow Rim"),
    samples=16,
    aa=2,
    triangles=1_234_567,
    objects=(mesh("Leaf", 4), mesh("Box")),
    left_out=(("Fur", "hair curves are not meshes"),),
    notices=("There is no light",),
    rays=2_000_000,
    settled={"Inside a solid": 500_000, "Few triangles": 0, "Traced": 1_500_000},
    seconds={"build": 1.0, "trace": 4.0},
)


def test_figures() -> None:
    assert REPORT.total_seconds == 5.0
    assert REPORT.mrays_per_second == 0.5
    assert [each.name for each in REPORT.closed] == ["Box"]
    assert [each.name for each in REPORT.open] == ["Leaf"]


def test_summary() -> None:
    assert REPORT.summary() == (
        "2 masks of 640 x 360 in 5.00 s: 2 M rays, 0.5 million a second; 1 of 2 objects closed"
    )


def test_lines() -> None:
    assert REPORT.lines() == [
        REPORT.summary(),
        "There is no light",
        "1 of 2 objects closed, 1.23 M triangles",
        "Leaf: open, 4 open edges",
        "Fur: left out, hair curves are not meshes",
        "Inside a solid: 500 k rays, 25.0 %",
        "Traced: 1.5 M rays, 75.0 %",
        "build: 1.000 s",
        "trace: 4.000 s",
    ]


def test_nothing_was_traced() -> None:
    empty = Report("Set", (1, 1), (), 1, 1, 0)
    assert empty.mrays_per_second == 0 and empty.total_seconds == 0
    assert empty.ray_lines() == []
    assert "0 masks" in empty.summary()


def test_long_lists_are_cut() -> None:
    many = tuple(mesh(f"Leaf {n}", 4) for n in range(LISTED + 3))
    lines = Report("Set", (1, 1), (), 1, 1, 0, objects=many).object_lines()
    assert len(lines) == 1 + LISTED + 1 and lines[-1] == "and 3 more"


@pytest.mark.parametrize(
    ("count", "text"),
    [
        (0, "0"),
        (9999, "9999"),
        (10_000, "10 k"),
        (999_400, "999 k"),
        (999_999, "1 M"),
        (1_234_567, "1.23 M"),
        (56_700_000_000, "56.7 G"),
    ],
)
def test_counts(count: int, text: str) -> None:
    assert count_text(count) == text


def test_plurals() -> None:
    assert (plural(1, "light"), plural(0, "light")) == ("1 light", "0 lights")
