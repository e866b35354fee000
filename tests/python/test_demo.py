"""The demo: run small from a copy of its folder, and what it says when an image differs."""

from __future__ import annotations

import dataclasses
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import pyvocc
from pyvocc.io import load_scene, read_image
from scenes import demo

pytest.importorskip("OpenEXR")
pytest.importorskip("PIL")

SIZE = (60, 40)


@pytest.fixture(scope="module")
def run(root: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str]:
    """The folder that a small demo has filled, and what it printed."""
    folder = tmp_path_factory.mktemp("demo")
    shutil.copytree(root / "scenes", folder / "scenes", ignore=shutil.ignore_patterns("__*"))
    command = [sys.executable, "scenes/demo.py", "--width", str(SIZE[0]), "--samples", "4"]
    done = subprocess.run(
        [*command, "--threads", "2"], cwd=folder, capture_output=True, text=True, timeout=120
    )
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
    return folder, done.stdout


def test_demo_leaves_its_pictures(run: tuple[Path, str]) -> None:
    folder, _ = run
    for name in demo.SCENES:
        for kind in ("", "_baseline"):
            image = read_image(folder / "out" / f"{name}{kind}.exr")
            assert len(image) == 5 + 3 + 3 + 1
            assert all(channel.shape == SIZE[::-1] for channel in image.values())
            assert (folder / "out" / f"{name}{kind}.png").is_file()
    sheet = read_image(folder / "out" / "contact_sheet.png")
    height, width = sheet["R"].shape
    assert width > 1500
    assert height > 1500


def test_demo_images_have_light_and_shadow(run: tuple[Path, str]) -> None:
    folder, _ = run
    for name in demo.SCENES:
        image = read_image(folder / "out" / f"{name}.exr")
        lights = [k for k in image if k.startswith("shadow.")]
        assert len(lights) == 5
        for light in lights:
            traced = image[light][image[light] >= 0]
            assert (traced == 0).mean() > 0.01, f"{name} {light} casts no shadow"
            assert (traced == 1).mean() > 0.05, f"{name} {light} lights nothing"
        shown = read_image(folder / "out" / f"{name}.png")
        assert np.ptp(shown["G"]) > 100


def test_demo_tells_what_both_ways_cost(run: tuple[Path, str]) -> None:
    _, printed = run
    assert printed.count("identical: 5 x 40 x 60 visible counts") == 3
    for word in ("M rays", "Mrays/s", "triangle tests", "traversal steps"):
        assert word in printed
    rows = [line for line in printed.splitlines() if line.startswith("  ratio")]
    assert len(rows) == 3
    # Occluders spare triangle tests in the scene of large solids.
    assert float(rows[0].split()[3]) > 1
    assert "out/contact_sheet.png" in printed


def test_demo_scenes_are_closed(run: tuple[Path, str]) -> None:
    folder, _ = run
    for name in demo.SCENES:
        file = load_scene(folder / "scenes" / f"{name}.toml")
        assert len(file.lights) == 5
        with file.build(strict=True) as scene:
            assert scene.report.closed
            assert scene.report.tree.opaque_leaves > 100


def test_demo_can_be_repeated_for_one_scene(run: tuple[Path, str]) -> None:
    folder, _ = run
    command = [sys.executable, "scenes/demo.py", "--width", "9", "--samples", "1"]
    done = subprocess.run(
        [*command, "--scene", "stone"], cwd=folder, capture_output=True, text=True, timeout=60
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.count("identical:") == 1


def _pass(seed: int = 1) -> pyvocc.ShadowPass:
    random = np.random.default_rng(seed)
    counts = random.integers(0, 5, (2, 3, 4)).astype(np.uint16)
    return pyvocc.ShadowPass(
        visibility=(counts / 4).astype(np.float32),
        counts=counts,
        position=np.full((3, 4, 3), np.nan, np.float32),
        normal=np.zeros((3, 4, 3), np.float32),
        geom_id=np.zeros((3, 4), np.int32),
        prim_id=np.zeros((3, 4), np.int32),
        samples=4,
        primary_seconds=0.0,
        shadow_seconds=1.0,
    )


def test_difference_is_empty_for_equal_passes() -> None:
    assert demo.difference(_pass(), _pass()) == ""


def test_difference_names_the_first_count_that_differs() -> None:
    one, other = _pass(), _pass()
    other.counts[1, 2, 3] += 1
    other.counts[1, 2, 1] += 2
    assert demo.difference(one, other) == (
        "2 visible counts; the first is light 1 at pixel (1, 2): "
        f"{one.counts[1, 2, 1]} and {other.counts[1, 2, 1]}"
    )


def test_difference_sees_the_other_arrays_and_the_shape() -> None:
    one = _pass()
    other = dataclasses.replace(one, prim_id=one.prim_id + 1)
    assert demo.difference(one, other) == "the arrays 'prim_id'"
    other = dataclasses.replace(one, counts=one.counts[:1])
    assert demo.difference(one, other) == "shapes (2, 3, 4) and (1, 3, 4)"


def test_demo_fails_where_images_differ(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    def render(name: str, *_: object) -> demo.Rendered:
        wrong = _pass()
        wrong.counts[0, 0, 0] ^= 1
        passes = [demo.Pass(image, pyvocc.Stats()) for image in (_pass(), wrong)]
        return demo.Rendered(name, name, None, None, *passes)  # type: ignore[arg-type]

    monkeypatch.setattr(demo, "OUT", tmp_path)
    monkeypatch.setattr(demo, "write_meshes", lambda: None)
    monkeypatch.setattr(demo, "render", render)
    assert demo.main(["--scene", "stone"]) == 1
    assert "stone: the images differ: 1 visible counts; the first is light 0 at pixel (0, 0)" in (
        capsys.readouterr().err
    )
    assert not (tmp_path / "contact_sheet.png").exists()


def test_demo_says_what_it_cannot_write(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    (tmp_path / "out").write_text("a file where the folder should be")
    monkeypatch.setattr(demo, "OUT", tmp_path / "out")
    assert demo.main([]) == 2
    assert capsys.readouterr().err.startswith("demo: ")
