"""The command line: exit codes, what is printed, and that nobody ever sees a traceback."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import pyvocc
from pyvocc import cli, images, io, shapes

Run = Callable[..., tuple[int, str, str]]

SCENE = """
[[mesh]]
path = "knot.ply"
[ground]
size = 20
height = -1.7
[camera]
eye = [0, 2, 6]
target = [0, 0, 0]
fov = 40
[[light]]
name = "key"
corner = [1, 4, 1]
edge_u = [1, 0, 0]
edge_v = [0, 0, 1]
[[light]]
corner = [-4, 3, 1]
edge_u = [1, 0, 0]
edge_v = [0, 1, 0]
"""


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The working folder, with closed.ply, open.ply, bad.ply, knot.ply and scene.toml."""
    monkeypatch.chdir(tmp_path)
    io.save_ply("closed.ply", *shapes.cube())
    io.save_ply("open.ply", *shapes.cube_missing_face())
    io.save_ply("knot.ply", *shapes.torus_knot(segments=64, sides=12))
    Path("bad.ply").write_text("hello")
    Path("scene.toml").write_text(SCENE)
    return tmp_path


@pytest.fixture
def run(capfd: pytest.CaptureFixture[str]) -> Run:
    """Runs the command in this process: its exit code, output and errors."""

    def call(*arguments: str) -> tuple[int, str, str]:
        capfd.readouterr()
        try:
            code = cli.main(list(arguments))
        except SystemExit as stop:  # argparse
            code = int(stop.code or 0)
        out, err = capfd.readouterr()
        assert "Traceback" not in err
        return code, out, err

    return call


# ---- in general ----------------------------------------------------------------------


@pytest.mark.parametrize(
    "arguments", [[], ["-h"], ["check", "-h"], ["shadow", "-h"], ["diff", "-h"]]
)
def test_help(run: Run, arguments: list[str]) -> None:
    code, out, err = run(*arguments)
    assert code == (0 if arguments else 2)
    assert "usage: pyvocc" in (out if arguments else err)


def test_version(run: Run) -> None:
    assert run("--version") == (0, f"pyvocc {pyvocc.__version__}\n", "")


def test_an_unknown_command_is_refused(run: Run) -> None:
    code, _, err = run("frob")
    assert code == 2
    assert "'frob'" in err


def test_python_m_pyvocc(folder: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-m", "pyvocc", "check", "open.ply"], capture_output=True, text=True
    )
    assert (done.returncode, done.stderr) == (1, "")
    assert "open.ply: open" in done.stdout


# ---- check ---------------------------------------------------------------------------


def test_check_of_a_closed_mesh(folder: Path, run: Run) -> None:
    code, out, err = run("check", "closed.ply")
    assert (code, err) == (0, "")
    assert out.splitlines() == [
        "closed.ply: closed",
        "  12 triangles, 8 distinct vertices of 8, volume 8",
        "  edges: 0 boundary, 0 non-manifold, 0 inconsistently wound",
        "  1 component, 1 closed",
    ]


def test_check_says_where_a_mesh_is_open(folder: Path, run: Run) -> None:
    code, out, err = run("check", "open.ply")
    assert (code, err) == (1, "")
    assert "open.ply: open" in out
    assert "  edges: 4 boundary" in out
    assert "  open at 4 edges:\n" in out
    edges = [line for line in out.splitlines() if line.startswith("    triangle ")]
    # The top face is gone: its four edges, each with both ends at y = 1.
    ends = {frozenset(line.split(": ")[1].split(" to ")) for line in edges}
    corners = ["(-1, 1, -1)", "(1, 1, -1)", "(1, 1, 1)", "(-1, 1, 1)"]
    assert ends == {frozenset((corners[k], corners[(k + 1) % 4])) for k in range(4)}


def test_check_names_triangles_that_have_the_edges(folder: Path, run: Run) -> None:
    vertices, triangles = shapes.cube_missing_face()
    _, out, _ = run("check", "open.ply")
    for line in out.splitlines():
        if line.startswith("    triangle "):
            number = int(line.split()[1].rstrip(":"))
            points = {cli._point(vertices[k]) for k in triangles[number]}
            assert set(line.split(": ")[1].split(" to ")) <= points


def test_check_lists_as_many_edges_as_asked(folder: Path, run: Run) -> None:
    _, out, _ = run("check", "--edges", "1", "open.ply")
    assert "  open at 4 edges, the first 1:" in out
    assert out.count("    triangle ") == 1
    _, out, _ = run("check", "--edges", "0", "open.ply")
    assert "    triangle " not in out


def test_check_of_several_meshes_tells_the_worst(folder: Path, run: Run) -> None:
    assert run("check", "closed.ply", "closed.ply")[0] == 0
    assert run("check", "open.ply", "closed.ply")[0] == 1
    code, out, err = run("check", "bad.ply", "open.ply", "none.ply", "closed.ply")
    assert code == 2
    assert "open.ply: open" in out
    assert "closed.ply: closed" in out
    assert err.splitlines() == [
        "pyvocc: bad.ply: is not a PLY file: it does not begin with 'ply'",
        "pyvocc: none.ply: no such file",
    ]


def test_check_of_a_mesh_with_a_nan(folder: Path, run: Run) -> None:
    vertices, triangles = shapes.cube()
    vertices[5, 1] = np.nan
    io.save_ply("nan.ply", vertices, triangles)
    code, out, err = run("check", "nan.ply")
    assert (code, out) == (2, "")
    assert err.startswith("pyvocc: nan.ply: ")
    assert "5" in err


def test_check_tells_components_winding_and_faults(folder: Path, run: Run) -> None:
    vertices, triangles = shapes.combine(shapes.inverted_cube(), shapes.cube(1.0, (9, 0, 0)))
    io.save_ply("inverted.ply", *shapes.inverted_cube())
    code, out, _ = run("check", "inverted.ply")
    assert code == 0
    assert "volume -8" in out
    assert "inside out: normals point inward" in out
    triangles = np.concatenate([triangles, [(0, 0, 1)]])[:-2]
    triangles[0] = triangles[0, ::-1]
    io.save_ply("faults.ply", vertices, np.concatenate([triangles, [(8, 8, 9)]]))
    code, out, _ = run("check", "faults.ply")
    assert code == 1
    assert "2 components, 1 closed" in out or "3 components" in out
    assert "3 inconsistent" in out
    assert "1 triangle without area" in out


def test_check_of_inconsistent_winding_is_closed(folder: Path, run: Run) -> None:
    vertices, triangles = shapes.icosphere(2)
    triangles[::7] = triangles[::7, ::-1]
    io.save_ply("shuffled.ply", vertices, triangles)
    code, out, _ = run("check", "shuffled.ply")
    assert code == 0
    assert " 0 inconsistently wound" not in out
    assert "inside out" not in out


def test_check_compares_flood_fill_and_rays(folder: Path, run: Run) -> None:
    code, out, err = run("check", "--rays", "knot.ply")
    assert (code, err) == (0, "")
    flood, rays, last = out.splitlines()[-3:]
    assert re.fullmatch(r"  by flood fill: \d+ rays, \d+\.\d{3} s", flood)
    assert re.fullmatch(r"  by one ray each: \d+ rays, \d+\.\d{3} s", rays)
    assert last == "  no leaf where they disagree"


def test_check_lists_leaves_where_rays_are_wrong(folder: Path, run: Run) -> None:
    vertices, triangles = shapes.torus_knot(segments=64, sides=12)
    io.save_ply("holed.ply", vertices, triangles[:-1])
    code, out, _ = run("check", "--rays", "--edges", "0", "holed.ply")
    assert code == 1
    assert re.search(r"^  they disagree on \d+ leaves, the first 10:$", out, re.MULTILINE)
    listed = [line for line in out.splitlines() if line.startswith("    leaf ")]
    assert len(listed) == 10
    assert all(": clear, by its ray opaque; (" in line for line in listed)


# ---- shadow --------------------------------------------------------------------------


@pytest.fixture
def exr() -> None:
    pytest.importorskip("OpenEXR")
    pytest.importorskip("PIL")


def test_shadow_writes_exr_png_and_stats(folder: Path, run: Run, exr: None) -> None:
    code, out, err = run(
        *("shadow", "scene.toml", "-o", "a.exr", "--size", "24x16", "--samples", "4"),
        *("--threads", "2", "--stats", "a.json"),
    )
    assert (code, err) == (0, "")
    assert out.startswith("a.exr: 24 x 16 pixels, 2 lights, 4 samples: ")
    image = io.read_image("a.exr")
    assert image["shadow.key"].shape == (16, 24)
    assert {"shadow.light1", "P.X", "N.Z", "geom_id"} <= set(image)
    assert set(np.unique(image["shadow.key"])) <= {-1, 0, 0.25, 0.5, 0.75, 1}
    assert len(np.unique(image["shadow.key"])) > 2
    assert io.read_image("a.png")["R"].shape == (16, 24)
    stats = json.loads(Path("a.json").read_text())
    assert stats["lights"] == ["key", "light1"]
    assert stats["size"] == [24, 16]
    assert stats["options"]["threads"] == 2
    assert stats["counters"]["rays"] == stats["rays"]
    assert stats["isa"] == pyvocc.isa()
    traced = sum(np.count_nonzero(image[f"shadow.{k}"] >= 0) for k in stats["lights"])
    assert f" {4 * traced / 1e6:.2f} M samples in " in out
    # Pixels at a horizon: what is below the surface is dark without a ray.
    assert 0.98 * 4 * traced < stats["rays"] < 4 * traced
    assert stats["sampler"] == "sobol"
    assert stats["report"]["meshes"][0]["closed"]
    assert set(stats["seconds"]) == {"load", "build", "primary", "shadow"}


def test_shadow_is_the_same_whatever_the_options(folder: Path, run: Run, exr: None) -> None:
    common = ("shadow", "scene.toml", "--size", "40x30", "--samples", "5", "-o")
    assert run(*common, "a.exr", "--order", "standard", "--no-occluders", "--cache", "0")[0] == 0
    more = ("--order", "qdbfs", "--cache", "3", "--deferment", "7", "--threads", "2")
    assert run(*common, "b.exr", *more)[0] == 0
    assert run("diff", "a.exr", "b.exr") == (
        0,
        "identical: 40 x 30 pixels, 9 channels\n",
        "",
    )
    assert run("diff", "a.png", "b.png")[0] == 0


def test_shadow_options_reach_the_library(
    folder: Path, run: Run, exr: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    seen: dict[str, object] = {}
    real = cli.shadow_pass

    def spy(*arguments: object, **options: object) -> object:
        seen.update(options, size=arguments[3], samples=arguments[4])
        return real(*arguments, **options)  # type: ignore[arg-type]

    monkeypatch.setattr(cli, "shadow_pass", spy)
    arguments = ("--size", "8x4", "--samples", "3", "--order", "standard", "--no-occluders")
    run("shadow", "scene.toml", "-o", "a.png", *arguments, "--cache", "2", "--deferment", "5")
    del seen["progress"]
    assert seen == {
        "size": (8, 4),
        "samples": 3,
        "sampler": "sobol",
        "order": "standard",
        "occluders": False,
        "cache": 2,
        "deferment": 5,
        "cache_policy": "recent",
        "fusion": True,
        "triangle_cache": False,
        "entry_points": None,
        "entry_triangles": 8,
        "voxels": 0,
        "method": "auto",
        "verify": 0,
        "packets": True,
        "stats": None,
    }
    jitter = (*arguments, "--sampler", "jitter")
    assert run("shadow", "scene.toml", "-o", "c.png", *jitter)[0] == 0
    assert seen["sampler"] == "jitter"
    more = ("--cache-policy", "direction", "--no-fusion", "--triangle-cache", "--single-rays")
    searches = ("--entry-points", "no", "--entry-triangles", "3", "--voxels", "12")
    assert run("shadow", "scene.toml", "-o", "b.png", *arguments, *more, *searches)[0] == 0
    assert seen["cache_policy"] == "direction"
    assert not (seen["fusion"] or seen["packets"] or seen["entry_points"])
    assert (seen["triangle_cache"], seen["entry_triangles"], seen["voxels"]) == (True, 3, 12)
    assert run("diff", "a.png", "b.png")[0] == 0
    beams = ("--size", "8x4", "--samples", "3", "--method", "beams", "--verify", "1")
    assert run("shadow", "scene.toml", "-o", "d.png", *beams)[0] == 0
    assert (seen["method"], seen["verify"]) == ("beams", 1)
    assert run("diff", "a.png", "d.png")[0] == 0


def test_shadow_of_lights_of_every_type(folder: Path, run: Run, exr: None) -> None:
    text = Path("scene.toml").read_text()
    Path("all.toml").write_text(
        text
        + """
[[light]]
type = "disk"
center = [2, 4, 0]
axis_u = [1, 0, 0]
axis_v = [0, 0, 1]
[[light]]
type = "sphere"
center = [-2, 4, 0]
radius = 0.5
[[light]]
type = "point"
center = [0, 4, 2]
[[light]]
type = "spot"
center = [0, 4, 1]
direction = [0, -4, -1]
angle = 90
[[light]]
type = "sun"
name = "noon"
direction = [1, 5, 1]
angle = 0.53
"""
    )
    more = ("--size", "32x24", "--samples", "16", "--stats", "all.json")
    code, out, err = run("shadow", "all.toml", "-o", "sobol.exr", *more)
    assert (code, err) == (0, "")
    assert "7 lights, 16 samples: " in out
    first = io.read_image("sobol.exr")
    for name in ("light2", "light3", "light4", "light5", "noon"):
        assert (first[f"shadow.{name}"] > 0).mean() > 0.1, name
    assert run("shadow", "all.toml", "-o", "jitter.exr", *more, "--sampler", "jitter")[0] == 0
    assert json.loads(Path("all.json").read_text())["sampler"] == "jitter"
    second = io.read_image("jitter.exr")
    # What a point, or a sharp shadow, sees is no matter of samples.
    assert np.array_equal(first["shadow.light4"], second["shadow.light4"])
    assert not np.array_equal(first["shadow.light2"], second["shadow.light2"])


def test_shadow_names_what_is_wrong_with_a_light(folder: Path, run: Run, exr: None) -> None:
    text = Path("scene.toml").read_text()
    Path("bad.toml").write_text(
        text + '[[light]]\ntype = "sun"\ndirection = [1, 1, 1]\nangle = 200\n'
    )
    code, _, err = run("shadow", "bad.toml", "-o", "a.png")
    assert code == 2
    assert err == "pyvocc: bad.toml: light[2].angle: expected 0 to 180 degrees, got 200\n"


def test_shadow_to_png_alone(folder: Path, run: Run, exr: None) -> None:
    code, out, _ = run("shadow", "scene.toml", "-o", "only.png", "--size", "8x8")
    assert code == 0
    assert out.startswith("only.png: 8 x 8 pixels, 2 lights, 16 samples: ")
    assert sorted(p.name for p in folder.glob("only*")) == ["only.png"]


@pytest.mark.parametrize(
    ("arguments", "reason"),
    [
        (["--size", "10"], "--size: expected WIDTHxHEIGHT, like 640x480, got '10'"),
        (["--size", "0x5"], "--size: expected sides of 1 to 65536 pixels, got '0x5'"),
        (["--size", "-3x5"], "--size"),
        (["--samples", "0"], "--samples: expected 1 to 65534, got 0"),
        (["--samples", "two"], "--samples: expected an integer, got 'two'"),
        (["--order", "random"], "--order: invalid choice: 'random'"),
        (["--sampler", "random"], "--sampler: invalid choice: 'random'"),
        (["--cache", "65"], "--cache: expected 0 to 64, got 65"),
        (["--deferment", "513"], "--deferment: expected 0 to 512, got 513"),
        (["--threads", "0"], "--threads: expected 1 to 256, got 0"),
        (["-o", "a.jpg"], "a.jpg: the output must end in .exr or .png"),
        (["-o", "nowhere/a.exr"], "nowhere/a.exr: there is no folder nowhere"),
        (["-o", "folder.png"], "folder.png: is a directory"),
        (["--stats", "nowhere/a.json"], "nowhere/a.json: there is no folder nowhere"),
    ],
)
def test_shadow_checks_its_arguments_before_any_work(
    folder: Path,
    run: Run,
    exr: None,
    monkeypatch: pytest.MonkeyPatch,
    arguments: list[str],
    reason: str,
) -> None:
    def work(*_: object) -> None:
        raise AssertionError("the scene was read")

    monkeypatch.setattr(cli.scene_files, "load_scene", work)
    (folder / "folder.png").mkdir()
    first = [] if "-o" in arguments else ["-o", "a.exr"]
    code, out, err = run("shadow", "scene.toml", *first, *arguments)
    assert (code, out) == (2, "")
    assert reason in err
    assert not (folder / "a.exr").exists()


def test_shadow_tells_a_fault_in_the_scene_file(folder: Path, run: Run, exr: None) -> None:
    text = SCENE.replace("edge_u = [1, 0, 0]", "edge_u = [1, 0]", 1)
    Path("scene.toml").write_text(text)
    code, out, err = run("shadow", "scene.toml", "-o", "a.png")
    assert (code, out) == (2, "")
    assert err == "pyvocc: scene.toml: light[0].edge_u: expected 3 numbers, got 2\n"
    code, _, err = run("shadow", "none.toml", "-o", "a.png")
    assert (code, err) == (2, "pyvocc: none.toml: no such file\n")
    Path("knot.ply").unlink()
    Path("scene.toml").write_text(SCENE)
    code, _, err = run("shadow", "scene.toml", "-o", "a.png")
    assert (code, err) == (2, "pyvocc: scene.toml: mesh[0].path: knot.ply: no such file\n")


def test_a_package_that_is_missing_is_told_in_a_line(
    folder: Path, run: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "OpenEXR", None)
    code, _, err = run("shadow", "scene.toml", "-o", "a.exr")
    assert code == 2
    assert err == "pyvocc: writing EXR files needs OpenEXR: pip install 'pyvocc[io]'\n"


def test_memory_that_runs_out_is_told_in_a_line(
    folder: Path, run: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: object, **__: object) -> None:
        raise pyvocc.OutOfMemory("no memory for 7 nodes")

    monkeypatch.setattr(cli.Scene, "build", fail)
    code, _, err = run("check", "closed.ply")
    assert (code, err) == (2, "pyvocc: out of memory\n")


def test_an_interrupt_is_told_in_a_line(
    folder: Path, run: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    def stop(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(cli.Scene, "build", stop)
    assert run("check", "closed.ply") == (130, "", "pyvocc: interrupted\n")


def test_ctrl_c_ends_with_130_and_one_line(folder: Path, exr: None) -> None:
    # Where the tests run in the background of a shell, SIGINT is ignored and inherited so.
    code = (
        "import signal, sys; signal.signal(signal.SIGINT, signal.default_int_handler); "
        "from pyvocc.cli import main; print('ready', flush=True); sys.exit(main())"
    )
    with subprocess.Popen(
        [
            *(sys.executable, "-c", code, "shadow", "scene.toml", "-o", "a.exr"),
            *("--size", "2000x2000", "--samples", "60000"),
        ],
        stderr=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    ) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "ready\n"
        time.sleep(1.0)
        assert process.poll() is None
        process.send_signal(signal.SIGINT)
        out, err = process.communicate(timeout=20)
    assert (process.returncode, out, err) == (130, "", "pyvocc: interrupted\n")
    assert not list(folder.glob("*a.*"))


def test_a_reader_that_goes_away_is_no_fault(folder: Path) -> None:
    read, write = os.pipe()
    os.close(read)
    done = subprocess.run(
        [sys.executable, "-m", "pyvocc", "check", "closed.ply"],
        stdout=write,
        stderr=subprocess.PIPE,
        text=True,
    )
    os.close(write)
    assert (done.returncode, done.stderr) == (141, "")


# ---- progress ------------------------------------------------------------------------


@pytest.mark.parametrize("bar", [True, False])
def test_progress_is_shown_on_a_terminal_only(
    bar: bool, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    if bar:
        pytest.importorskip("tqdm")
    else:
        monkeypatch.setitem(sys.modules, "tqdm", None)
    with cli.Progress("shadows") as progress:
        progress(0.5)
    assert capsys.readouterr().err == ""
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True, raising=False)
    with cli.Progress("shadows") as progress:
        progress(0.25)
        time.sleep(0.12)
        progress(0.5)
        progress(1.0000001)
    shown = capsys.readouterr().err
    assert "shadows" in shown
    assert "50" in shown
    assert "\n" not in shown.strip()


# ---- diff ----------------------------------------------------------------------------


@pytest.fixture
def pair(folder: Path, exr: None) -> dict[str, np.ndarray]:
    """a.exr and b.exr with these equal channels."""
    random = np.random.default_rng(1)
    channels = {
        name: random.random((20, 30)).astype(np.float32) for name in ("shadow.a", "shadow.b", "P.X")
    }
    channels["P.X"][0] = np.nan
    images.write_exr_channels("a.exr", channels)
    images.write_exr_channels("b.exr", channels)
    return channels


def test_diff_of_identical_images(pair: dict[str, np.ndarray], run: Run) -> None:
    assert run("diff", "a.exr", "b.exr") == (0, "identical: 30 x 20 pixels, 3 channels\n", "")


def test_diff_tells_how_many_where_and_the_largest(pair: dict[str, np.ndarray], run: Run) -> None:
    other = {name: channel.copy() for name, channel in pair.items()}
    other["shadow.b"][5, 3] += 0.25
    other["shadow.b"][7, 11] -= 0.5
    other["P.X"][7, 11] += 1
    images.write_exr_channels("b.exr", other)
    code, out, err = run("diff", "a.exr", "b.exr")
    assert (code, err) == (1, "")
    lines = out.splitlines()
    assert lines[0] == "different: 2 of 600 pixels, x 3 to 11, y 5 to 7"
    assert lines[2].split()[:3] == ["P.X", "1", "1"]
    assert lines[3].split()[:5] == ["shadow.b", "2", "0.5", "(11,", "7)"]
    assert len(lines) == 4


def test_diff_sees_one_last_bit_and_a_nan(pair: dict[str, np.ndarray], run: Run) -> None:
    other = {name: channel.copy() for name, channel in pair.items()}
    other["shadow.a"][19, 29] = np.nextafter(other["shadow.a"][19, 29], np.float32(2))
    images.write_exr_channels("b.exr", other)
    assert run("diff", "a.exr", "b.exr")[0] == 1
    other = {**pair, "shadow.a": pair["shadow.a"].copy()}
    other["shadow.a"][2, 2] = np.nan
    other["shadow.a"][3, 3] += 1e6
    images.write_exr_channels("b.exr", other)
    code, out, _ = run("diff", "a.exr", "b.exr")
    assert code == 1
    assert "inf" in out
    assert "(2, 2)" in out
    assert out.rstrip().endswith("nan")


def test_diff_of_pngs(folder: Path, run: Run, exr: None) -> None:
    pixels = np.zeros((4, 5, 3), np.uint8)
    images.write_png("a.png", pixels)
    assert run("diff", "a.png", "a.png")[0] == 0
    pixels[1, 2, 0] = 200
    images.write_png("b.png", pixels)
    code, out, _ = run("diff", "a.png", "b.png")
    assert code == 1
    assert "different: 1 of 20 pixels, x 2 to 2, y 1 to 1" in out
    assert out.splitlines()[2].split()[:3] == ["R", "1", "200"]


def test_diff_of_what_cannot_be_compared(pair: dict[str, np.ndarray], run: Run) -> None:
    Path("bad.exr").write_bytes(Path("a.exr").read_bytes()[:400])
    code, out, err = run("diff", "a.exr", "bad.exr")
    # One line, whatever the EXR package itself writes.
    assert (code, out, err) == (2, "", "pyvocc: bad.exr: is not a complete EXR file\n")
    code, _, err = run("diff", "a.exr", "none.exr")
    assert (code, err) == (2, "pyvocc: none.exr: no such file\n")
    code, _, err = run("diff", "a.exr", "scene.toml")
    assert (code, err) == (2, "pyvocc: scene.toml: is neither an .exr nor a .png file\n")
    images.write_exr_channels("c.exr", {**pair, "more": pair["P.X"]})
    code, _, err = run("diff", "a.exr", "c.exr")
    assert (code, err) == (
        2,
        "pyvocc: the images have different channels: c.exr has more\n",
    )
    images.write_exr_channels("d.exr", {name: c[:10] for name, c in pair.items()})
    code, _, err = run("diff", "a.exr", "d.exr")
    assert (code, err) == (2, "pyvocc: the images differ in size: 30 x 20 and 30 x 10\n")
