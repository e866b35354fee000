"""`pyvocc reproduce`: the page, what is kept of an interrupted run, and the slides' counts."""

from __future__ import annotations

import json
import re
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import SHARED

import pyvocc
from pyvocc import cli, io, shapes

pytest.importorskip("matplotlib")
pytest.importorskip("tqdm")

from pyvocc.reproduce import cells, claims, measure, modes, run, subjects, workload
from pyvocc.reproduce.settings import Settings

Run = Callable[..., tuple[int, str, str]]

ANCHORS = (
    "provenance",
    *("run-time", "tests", "steps", "rates", "areas", "deferment", "cache", "queues", "split"),
    *("failures", "pictures", "embree", "classes", "sceptics", "related"),
)
SMALL = ("--size", "24", "--samples", "4", "--rounds", "1", "--no-embree")
ONLY = ("--only", "bunny,tubes131")


@pytest.fixture(scope="module")
def models(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with small meshes under the names of two models: a solid and thin tubes."""
    folder = tmp_path_factory.mktemp("models")
    io.save_ply(folder / "bunny.ply", *shapes.geodesic_sphere(24))
    io.save_ply(folder / "tubes131.ply", *shapes.tube_network(2, 0.15))
    return folder


@pytest.fixture(scope="module")
def output(models: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What a small run leaves."""
    folder = tmp_path_factory.mktemp("output")
    arguments = ["reproduce", "-o", str(folder), "--meshes", str(models), *ONLY, *SMALL]
    assert cli.main(arguments) == 0
    return folder


@pytest.fixture
def call(capfd: pytest.CaptureFixture[str]) -> Run:
    """Runs the command in this process: its exit code, output and errors."""

    def run(*arguments: str | Path) -> tuple[int, str, str]:
        capfd.readouterr()
        try:
            code = cli.main(["reproduce", *map(str, arguments)])
        except SystemExit as stop:  # argparse
            code = int(stop.code or 0)
        out, err = capfd.readouterr()
        assert "Traceback" not in err
        return code, out, err

    return run


def kept(folder: Path) -> list[dict[str, Any]]:
    return [json.loads(line) for line in (folder / run.CELLS).read_text().splitlines()]


def counts(folder: Path) -> dict[str, Any]:
    """All that must be alike in every run: cells by key, without times and what times need."""
    found = {}
    for cell in kept(folder):
        if cell["key"]["cell"] in ("count", "split count", "pictures"):
            found[json.dumps(cell["key"], sort_keys=True)] = cell["value"]
    return found


# ---- the page ------------------------------------------------------------------------


def test_the_page_is_one_file(output: Path) -> None:
    text = (output / "results.html").read_text(encoding="utf-8")
    sources = re.findall(r'\bsrc="([^"]{0,40})', text)
    assert len(sources) > 15
    assert [s for s in sources if not s.startswith("data:image/")] == []
    assert [s for s in re.findall(r'\bhref="([^"]*)"', text) if not s.startswith("#")] == []
    for word in ("<script", "<link", "<iframe", "@import", "url(", "http://", "https://"):
        assert word not in text, word
    assert "@media print" in text


def test_the_page_has_every_section(output: Path) -> None:
    text = (output / "results.html").read_text(encoding="utf-8")
    assert tuple(re.findall(r'<section id="([^"]+)"', text)) == ANCHORS
    assert re.findall(r'<a href="#([^"]+)"', text) == list(ANCHORS)
    assert text.count("<tr>") > 60
    assert not re.search(r"\b(nan|inf|None)\b", re.sub(r'src="[^"]*"', "", text))
    document = (output / "results.md").read_text(encoding="utf-8")
    assert len(re.findall("^## ", document, re.MULTILINE)) == len(ANCHORS)


def test_the_markdown_has_its_images_beside_it(output: Path) -> None:
    text = (output / "results.md").read_text(encoding="utf-8")
    names = set(re.findall(r"\]\(([^)]+)\)", text))
    assert len(names) > 15
    assert {str(path.relative_to(output)) for path in (output / "images").iterdir()} == names


def test_the_page_says_what_it_shows(output: Path) -> None:
    text = (output / "results.md").read_text(encoding="utf-8")
    for word in ("Not the slides' meshes", "Tubes (a stand-in", "| compiler |", "samples 4"):
        assert word in text, word
    assert "Every mode of every scene gave the same image" in text
    assert "Embree was not measured: it was not asked for." in text
    assert "This is a small run" in text
    # The slides' own figures.
    for figure in ("6.4", "10.7", "1.67×", "18.0", "9.6"):
        assert figure in text, figure
    assert str(output) not in text


def test_all_images_are_the_same(output: Path) -> None:
    hashes: dict[tuple[str, int], set[str]] = {}
    for cell in kept(output):
        if "hash" in cell["value"]:
            key = cell["key"]
            hashes.setdefault((key["mesh"], key["size"]), set()).add(cell["value"]["hash"])
    assert len(hashes) == 2
    assert all(len(found) == 1 for found in hashes.values())


# ---- what is kept ----------------------------------------------------------------------


@pytest.fixture
def traced(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """The passes that are traced from now on."""
    seen: list[str] = []
    for name in ("_trace", "_trace_split"):
        real = getattr(measure.Measured, name)

        def spy(
            self: Any, mode: Any, *rest: Any, real: Any = real, name: str = name, **more: Any
        ) -> Any:
            seen.append(f"{name} {mode.name}")
            return real(self, mode, *rest, **more)

        monkeypatch.setattr(measure.Measured, name, spy)
    return seen


def test_a_finished_run_is_not_traced_again(
    output: Path, models: Path, call: Run, traced: list[str]
) -> None:
    before = (output / run.CELLS).read_bytes()
    code, out, _ = call("-o", output, "--meshes", models, *ONLY, *SMALL)
    assert code == 0
    number = len(kept(output))
    assert f"{number} of {number} measurements are kept from an earlier run; going on" in out
    assert traced == []
    assert (output / run.CELLS).read_bytes() == before


def test_an_interrupted_run_goes_on_and_counts_the_same(
    output: Path,
    models: Path,
    call: Run,
    traced: list[str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    put = cells.Store.put

    def stop(self: cells.Store, key: Any, value: Any) -> None:
        if len((tmp_path / run.CELLS).read_text().splitlines()) == 30:
            raise KeyboardInterrupt
        put(self, key, value)

    arguments = ("-o", tmp_path, "--meshes", models, *ONLY, *SMALL)
    total = len(kept(output))
    with monkeypatch.context() as patch:
        patch.setattr(cells.Store, "put", stop)
        code, out, err = call(*arguments)
    assert (code, out) == (130, "")
    assert err == (
        f"pyvocc: interrupted: 30 of {total} measurements are kept; the same command goes on\n"
    )
    assert not (tmp_path / "results.html").exists()
    first = len(traced)
    code, out, _ = call(*arguments)
    assert code == 0
    assert f"30 of {total} measurements are kept from an earlier run; going on" in out
    # Only the pass that was under way is traced a second time.
    keys = [json.dumps(cell["key"], sort_keys=True) for cell in kept(tmp_path)]
    assert len(keys) == len(set(keys)) == total
    assert first < 35
    # Counters, hashes and pictures are those of a run that was not interrupted.
    assert counts(tmp_path) == counts(output)


def test_a_line_that_was_cut_short_is_measured_again(
    output: Path, models: Path, call: Run, traced: list[str], tmp_path: Path
) -> None:
    text = (output / run.CELLS).read_bytes()
    (tmp_path / run.CELLS).write_bytes(text[:-20])
    code, _, _ = call("-o", tmp_path, "--meshes", models, *ONLY, *SMALL)
    assert code == 0
    assert len(traced) == 1
    lines = (tmp_path / run.CELLS).read_text().splitlines()
    assert len(lines) == len(text.splitlines()) + 1
    json.loads(lines[-1])


def test_what_determines_a_cell_is_in_its_key(
    models: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def keys(library: dict[str, Any], size: int, samples: int) -> set[str]:
        settings = Settings.of(models, ("bunny",), size=size, samples=samples, quick=True)
        return {json.dumps(cell.key, sort_keys=True) for cell in plan(settings, tmp_path, library)}

    library = cells.library()
    first = keys(library, 24, 4)
    assert keys(library, 24, 4) == first
    assert not first & keys({**library, "library": "another"}, 24, 4)
    # The scene itself does not depend on them.
    for other in (keys(library, 32, 4), keys(library, 24, 5)):
        assert all('"cell": "scene"' in key or '"classes"' in key for key in first & other)


def plan(settings: Settings, folder: Path, library: dict[str, Any]) -> list[measure.Cell]:
    return [cell for scene in scenes(settings, folder, library) for cell in scene.plan()]


def scenes(
    settings: Settings, folder: Path, library: dict[str, Any] | None = None
) -> list[measure.Measured]:
    store = cells.Store(folder / run.CELLS)
    return [
        measure.Measured(
            subject,
            settings,
            store,
            cells.library() if library is None else library,
            measure.machine(),
            None,
        )
        for subject in subjects.subjects(settings.meshes, settings.only)
    ]


def test_an_image_that_differs_is_told_loudly(
    output: Path, models: Path, call: Run, tmp_path: Path
) -> None:
    lines = (output / run.CELLS).read_text().splitlines()
    changed = [json.loads(line) for line in lines]
    cell = next(c for c in changed if c["key"]["cell"] == "time")
    cell["value"]["hash"] = "0123456789abcdef"
    (tmp_path / run.CELLS).write_text("".join(json.dumps(c) + "\n" for c in changed))
    code, _, err = call("-o", tmp_path, "--meshes", models, *ONLY, *SMALL)
    assert code == 1
    assert "pyvocc: the images differ: Bunny, 24 × 24 pixels: " in err
    assert "0123456789abcdef: baseline" in err
    page = (tmp_path / "results.html").read_text()
    assert "THE IMAGES DIFFER, which must never be: Bunny" in page
    assert '<td class="t bad">not reproduced</td>' in page
    assert "Every mode of every scene gave the same image" not in page


# ---- bad input ------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("arguments", "reason"),
    [
        (["--only", "ball,rabbit"], "there is no scene 'rabbit'; there are rock, ball, "),
        (["--only", "ball,"], "--only: expected names, like bunny,dragon, got 'ball,'"),
        (["--size", "7"], "--size: expected 8 to 8192, got 7"),
        (["--size", "big"], "--size: expected an integer, got 'big'"),
        (["--samples", "0"], "--samples: expected 1 to 65534, got 0"),
        (["--rounds", "0"], "--rounds: expected 1 to 99, got 0"),
        (["--sweep-size", "0"], "--sweep-size: expected 8 to 8192, got 0"),
        (["--meshes", "nowhere"], "nowhere: no such folder"),
        (["--meshes", "file"], "file: is not a folder"),
        (["--meshes", "empty"], "armadillo.ply: no such file (--only takes those that are there)"),
        (["--meshes", "empty", "--only", "dragon"], "dragon.ply: no such file\n"),
        (["-o", "file"], "file: is not a folder"),
        (["-o", "file/below"], "is not a folder"),
    ],
)
def test_bad_input_is_told_before_any_work(
    call: Run,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    arguments: list[str],
    reason: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(run, "_measure", lambda *_: pytest.fail("something was measured"))
    monkeypatch.setattr(run, "Measured", lambda *_: pytest.fail("a mesh was read"))
    Path("file").write_text("")
    Path("empty").mkdir()
    first = [] if "-o" in arguments else ["-o", "out"]
    code, out, err = call(*first, *arguments, "--quick", "--no-embree")
    assert (code, out) == (2, "")
    assert reason in err


def test_an_output_that_cannot_be_written_is_told(call: Run, tmp_path: Path) -> None:
    (tmp_path / run.CELLS).mkdir()
    code, _, err = call("-o", tmp_path, "--quick", "--no-embree", "--only", "ball")
    assert (code, err) == (2, f"pyvocc: {tmp_path / run.CELLS}: is a directory\n")


def test_a_mesh_that_is_none_is_told(call: Run, tmp_path: Path) -> None:
    (tmp_path / "bunny.ply").write_text("hello")
    code, _, err = call("-o", tmp_path / "out", "--meshes", tmp_path, "--only", "bunny", *SMALL)
    assert code == 2
    assert err.startswith(f"pyvocc: {tmp_path / 'bunny.ply'}: is not a PLY file")


@pytest.mark.parametrize(("package", "extra"), [("matplotlib", "plot"), ("tqdm", "progress")])
def test_a_missing_extra_is_named(
    call: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, package: str, extra: str
) -> None:
    monkeypatch.setitem(sys.modules, package, None)
    code, out, err = call("-o", tmp_path / "out", "--quick")
    assert (code, out) == (2, "")
    assert err == f"pyvocc: pyvocc reproduce needs {package}: pip install 'pyvocc[{extra}]'\n"
    assert not (tmp_path / "out").exists()


# ---- the slides' counts on the generated stand-ins ---------------------------------------


@pytest.fixture(scope="module")
def stand_ins(tmp_path_factory: pytest.TempPathFactory) -> Iterator[list[measure.Measured]]:
    """Counted passes of the generated meshes, nothing timed."""
    settings = Settings.of(size=64, samples=4, rounds=1)
    folder = tmp_path_factory.mktemp("stand-ins")
    store = cells.Store(folder / run.CELLS)
    found = scenes(settings, folder)
    for scene in found:
        scene._store = store
        for mode in (*modes.ORDERS, modes.UNFUSED_STANDARD):
            cell = scene._cell(mode.label, scene._make_counts, mode, settings.size)
            store.put(cell.key, cell.make())
        store.put(scene._scene_key(), scene._make_scene())
        scene.close()
    yield found


def test_the_stand_ins_have_every_character(stand_ins: list[measure.Measured]) -> None:
    assert [scene.subject.name for scene in stand_ins] == [s.name for s in subjects.SHAPES]
    assert all(scene.tree["closed"] and scene.tree["opaque_leaves"] for scene in stand_ins)
    ratio = {scene.subject.name: scene.tree["area_ratio"] for scene in stand_ins}
    assert min(ratio["rock"], ratio["ball"]) > 12
    assert max(value for name, value in ratio.items() if name not in ("rock", "ball")) < 12


def test_images_of_all_modes_are_equal(stand_ins: list[measure.Measured]) -> None:
    assert all(len(hashes) == 1 for s in stand_ins for hashes in s.hashes().values())
    assert claims.different(stand_ins) == []


def test_qdbfs_has_less_queue_traffic_than_bfs(stand_ins: list[measure.Measured]) -> None:
    for scene in stand_ins:
        for name in ("queue_pushes", "queue_pops"):
            ratio = claims.counters(modes.QDBFS, modes.BFS, name)(scene)
            assert ratio is not None
            assert ratio <= 1, (scene.subject.name, name)


def test_occluders_spare_triangle_tests_on_solids(stand_ins: list[measure.Measured]) -> None:
    solids = [scene for scene in stand_ins if scene.subject.solid]
    assert len(solids) == 2
    for scene in solids:
        for mode in (modes.EXTENDED, modes.QDBFS):
            ratio = claims.counters(mode, modes.BASELINE, "triangle_tests")(scene)
            assert ratio is not None
            assert ratio <= 0.7, (scene.subject.name, mode.name, ratio)


def test_opaque_first_takes_fewer_steps_than_qdbfs(stand_ins: list[measure.Measured]) -> None:
    """The node's bit leads to a block sooner than breadth first does."""
    for scene in stand_ins:
        ratio = claims.counters(modes.OPAQUE_FIRST, modes.QDBFS, "node_visits")(scene)
        assert ratio is not None
        assert ratio < 1, (scene.subject.name, ratio)


def test_fusion_spares_steps_on_solids(stand_ins: list[measure.Measured]) -> None:
    for scene in (scene for scene in stand_ins if scene.subject.solid):
        ratio = claims.counters(modes.STANDARD, modes.UNFUSED_STANDARD, "node_visits")(scene)
        assert ratio is not None
        assert ratio < 1, (scene.subject.name, ratio)


# ---- parts ----------------------------------------------------------------------------------


def test_rank_correlation() -> None:
    assert claims.rank_correlation([(1, 10), (2, 20), (3, 30)]) == pytest.approx(1)
    assert claims.rank_correlation([(1, 30), (2, 20), (3, 10)]) == pytest.approx(-1)
    assert claims.rank_correlation([(1, 1), (1, 2), (1, 3)]) is None
    assert claims.rank_correlation([(1, 1), (2, 2)]) is None
    # Ranks 0.5, 0.5, 2 and 0, 1, 2.
    assert claims.rank_correlation([(1, 1), (1, 2), (2, 3)]) == pytest.approx(0.75**0.5)


def test_blocked_and_visible_rays_are_those_of_the_pass() -> None:
    vertices, triangles = shapes.geodesic_sphere(8)
    scene = workload.build(workload.normalised(vertices, triangles), triangles, "ball")
    points = workload.shading_points(scene, 40)
    rays = measure.split_rays(scene, points, 6)
    visible = scene.light_visibility(
        points.position,
        points.normal,
        workload.RECT_LIGHTS,
        6,
        points.pixels,
        sampler="jitter",
        horizon="centre",
    )
    traced = visible[visible != pyvocc.NOT_TRACED]
    assert len(rays["visible"][0]) == traced.sum()
    assert len(rays["blocked"][0]) == 6 * traced.size - traced.sum()
    assert scene.occluded(*rays["blocked"], 0, 1).all()
    some = measure.split_rays(scene, points, 6, tiles=1)
    assert 0 < len(some["visible"][0]) < len(rays["visible"][0])


@pytest.mark.skipif(not (SHARED / "workload").is_dir(), reason="the reference data is not here")
def test_shading_points_are_those_of_the_workload() -> None:
    mesh = subjects.load(subjects.MODELS[5], SHARED / "meshes")
    scene = workload.build(mesh.vertices, mesh.triangles, "cowboy")
    points = workload.shading_points(scene, 256)
    data = (SHARED / "workload" / "cowboy_256.gbuf").read_bytes()
    rows = np.frombuffer(data, "<f4", 256 * 256 * 6, 16).reshape(-1, 6)
    assert len(points.pixels) == 256 * 256
    assert np.array_equal(rows[points.pixels, :3], points.position)
    assert np.array_equal(rows[points.pixels, 3:], points.normal)


def test_embree_is_shown_where_it_is(
    output: Path, models: Path, call: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    class Traced:
        def __enter__(self) -> Traced:
            return self

        def __exit__(self, *_: object) -> None:
            pass

        def time(self, mode: str) -> dict[str, Any]:
            if mode == "odd":
                return {"error": "no such mode"}
            return {"seconds": 0.5, "rays": 4_000_000, "hash": "feed"}

    class Embree:
        modes = ("robust-1", "odd")
        digest = "beef"

        def __init__(self, samples: int) -> None:
            assert samples == 4

        def trace(self, mesh: Any, points: Any, samples: int) -> Traced:
            assert points.size == 24
            return Traced()

    (tmp_path / run.CELLS).write_bytes((output / run.CELLS).read_bytes())
    monkeypatch.setattr(run, "Embree", Embree)
    small = [word for word in SMALL if word != "--no-embree"]
    assert call("-o", tmp_path, "--meshes", models, *ONLY, *small)[0] == 0
    text = (tmp_path / "results.md").read_text()
    section = text[text.index("## 12. Embree") : text.index("## 13.")]
    assert "| Embree robust-1 | 8.00 | 8.00 |" in section
    assert "| Embree odd | – | – |" in section
    assert "| Embree's robust image is ours | no | no |" in section


def test_the_charts_are_the_same_every_time() -> None:
    from pyvocc.reproduce import charts

    series = [charts.Bars("one", [1.0, None], charts.BLUE), charts.Bars("two", [2.0, 3.0], "red")]
    first = charts.bars(["a", "b"], series, "unit", line=1.0, digits=1)
    assert first.startswith(b"<?xml")
    assert charts.bars(["a", "b"], series, "unit", line=1.0, digits=1) == first


def test_the_page_escapes_what_it_is_given() -> None:
    from pyvocc.reproduce.page import Section, Table, Text, html, markdown

    blocks = [Text("a < b & `c`"), Table(("x|y",), (("<td>",),))]
    page = [Section("head", "Head", blocks), Section("s", "S & T", blocks)]
    text = html("<Title>", page)
    assert "<p>a &lt; b &amp; <code>c</code></p>" in text
    assert "&lt;td&gt;" in text
    assert "<h2>S &amp; T</h2>" in text
    assert "x\\|y" in markdown("T", page, "images")
