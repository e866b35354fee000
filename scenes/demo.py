"""Renders the soft shadows of three scenes twice, with and without volumetric occluders.

``make demo`` runs this.  It writes its closed meshes (seeded, nothing is downloaded) to
out/meshes, renders each scene of this folder under five lights by the baseline and with
occluders, compares the two, tells what each cost, and leaves the images under out/, all on
one sheet in out/contact_sheet.png.  Exit code 1: an image differs, which must not be.
"""

from __future__ import annotations

import argparse
import os
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import pyvocc
from pyvocc import images
from pyvocc.cli import Progress
from pyvocc.io import FileError, SceneFile, load_scene, look, save_ply, write_exr, write_png
from pyvocc.shapes import generate

HERE = Path(__file__).resolve().parent
OUT = HERE.parent / "out"

# File name in out/meshes, generator, its parameters.
MESHES: tuple[tuple[str, str, dict[str, Any]], ...] = (
    ("bumpy_solid", "bumpy_solid", {"frequency": 128}),
    ("torus_knot", "torus_knot", {"segments": 512, "sides": 48}),
    ("icosphere", "icosphere", {"level": 5}),
    ("city", "city", {"blocks": 10}),
    ("flower", "flower", {}),
    ("figure", "figure", {"cell": 0.015}),
    ("thirteen_shells", "thirteen_shells", {}),
    ("tube_network", "tube_network", {}),
)
SCENES = {
    "stone": "A rock and a knot",
    "city": "A city in the evening",
    "garden": "A garden of thin things",
}
BASELINE: dict[str, Any] = {"order": "standard", "occluders": False, "cache": 0}
OCCLUDERS: dict[str, Any] = {"order": "auto", "method": "rays", "occluders": True, "cache": 8}


@dataclass(frozen=True, eq=False)
class Pass:
    """One rendering and what it cost."""

    image: pyvocc.ShadowPass
    stats: pyvocc.Stats

    @property
    def seconds(self) -> float:
        return max(self.image.shadow_seconds, 1e-9)

    @property
    def speed(self) -> float:
        """Million rays a second."""
        return self.stats.rays / 1e6 / self.seconds


@dataclass(frozen=True, eq=False)
class Rendered:
    """A scene, rendered both ways."""

    name: str
    title: str
    file: SceneFile
    report: pyvocc.Report
    baseline: Pass
    occluders: Pass

    @property
    def ground(self) -> int | None:
        return next((k for k, mesh in enumerate(self.file.meshes) if mesh.path is None), None)


def main(argv: Sequence[str] | None = None) -> int:
    """Runs the demo; returns the exit code."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0], allow_abbrev=False)
    parser.add_argument("--width", type=int, default=1080, help="of the images (default 1080)")
    parser.add_argument("--samples", type=int, default=25, help="rays to each light (default 25)")
    parser.add_argument("--threads", type=int, help="threads (default one a processor)")
    parser.add_argument("--scene", choices=SCENES, action="append", help="only this scene")
    options = parser.parse_args(argv)
    size = (options.width, max(options.width * 2 // 3, 1))
    start = time.perf_counter()
    try:
        write_meshes()
        rendered = []
        for name in options.scene or SCENES:
            scene = render(name, size, options.samples, options.threads)
            where = difference(scene.baseline.image, scene.occluders.image)
            if where:
                print(f"{name}: the images differ: {where}", file=sys.stderr)
                return 1
            shape = " x ".join(map(str, scene.baseline.image.counts.shape))
            print(f"  identical: {shape} visible counts, array for array\n")
            rendered.append(scene)
        print("\n".join(table(rendered)))
        sheet = OUT / "contact_sheet.png"
        write_png(sheet, contact_sheet(rendered))
    except KeyboardInterrupt:
        print("demo: interrupted", file=sys.stderr)
        return 130
    except (FileError, pyvocc.Error, ImportError) as error:
        print(f"demo: {error}", file=sys.stderr)
        return 2
    print(f"\nDone in {time.perf_counter() - start:.0f} s. Look at {shown(sheet)}")
    return 0


def shown(path: Path) -> str:
    """The path as seen from where the command was given, if it lies below."""
    return str(path.relative_to(Path.cwd()) if path.is_relative_to(Path.cwd()) else path)


# ---- work ----------------------------------------------------------------------------


def write_meshes() -> None:
    """Generates all meshes into out/meshes."""
    folder = OUT / "meshes"
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise FileError(folder, error.strerror or str(error)) from None
    print(f"Meshes, into {shown(folder)}{os.sep}")
    for name, generator, parameters in MESHES:
        vertices, triangles = generate(generator, **parameters)
        save_ply(folder / f"{name}.ply", vertices, triangles)
        print(f"  {name:16} {len(triangles):8,} triangles")
    print()


def render(name: str, size: tuple[int, int], samples: int, threads: int | None) -> Rendered:
    """Renders a scene of this folder both ways and writes its images."""
    print(f"{SCENES[name]} ({size[0]} x {size[1]} pixels, {samples} samples of 5 lights)")
    file = load_scene(HERE / f"{name}.toml")
    with Progress("  kd-tree") as progress:
        scene = file.build(threads=threads, progress=progress)
    with scene:
        report = scene.report
        print(
            f"  {report.triangle_count:,} triangles, {report.component_count} components, "
            f"{report.closed_count} of them closed; built in {report.seconds.total:.2f} s\n"
            f"  {report.tree.opaque_leaves:,} occluders fill "
            f"{100 * filled(report):.0f} % of the solids; order {report.tree.auto_order}"
        )
        passes = []
        for label, options in (("baseline", BASELINE), ("occluders", OCCLUDERS)):
            stats = pyvocc.Stats()
            with Progress(f"  {label}") as progress:
                image = pyvocc.shadow_pass(
                    scene, file.camera, file.lights, size, samples,
                    progress=progress, stats=stats, threads=threads, **options,
                )  # fmt: skip
            done = Pass(image, stats)
            print(f"  {label:10} {stats.rays / 1e6:7.1f} M rays {done.seconds:7.2f} s")
            passes.append(done)
    result = Rendered(name, SCENES[name], file, report, *passes)
    for label, done in zip(("_baseline", ""), passes, strict=True):
        write_exr(OUT / f"{name}{label}.exr", done.image, file.light_names)
        write_png(OUT / f"{name}{label}.png", look(done.image, file.lights, result.ground))
    return result


def filled(report: pyvocc.Report) -> float:
    """Share of the closed meshes' volume that lies in occluders.

    More than 1 cannot be, less where solids overlap: their common volume counts twice.
    """
    extent = np.subtract(report.upper, report.lower)
    volume = sum(abs(mesh.volume) for mesh in report.meshes if mesh.closed)
    return report.tree.opaque_volume_fraction * float(np.prod(extent)) / volume if volume else 0.0


def difference(a: pyvocc.ShadowPass, b: pyvocc.ShadowPass) -> str:
    """Where two passes differ, in words; empty if nowhere."""
    if a.counts.shape != b.counts.shape:
        return f"shapes {a.counts.shape} and {b.counts.shape}"
    where = np.argwhere(a.counts != b.counts)
    if len(where):
        light, y, x = (int(k) for k in where[0])
        return (
            f"{len(where)} visible counts; the first is light {light} at pixel ({x}, {y}): "
            f"{a.counts[light, y, x]} and {b.counts[light, y, x]}"
        )
    for name in ("visibility", "position", "normal", "geom_id", "prim_id"):
        one, two = getattr(a, name), getattr(b, name)
        if not np.array_equal(one, two, equal_nan=True):
            return f"the arrays {name!r}"
    return ""


def table(rendered: Sequence[Rendered]) -> list[str]:
    """What both ways cost, as lines of text."""
    lines = [
        f"{'':22}{'M rays':>8}{'seconds':>9}{'Mrays/s':>9}{'triangle tests':>17}"
        f"{'traversal steps':>17}"
    ]
    for scene in rendered:
        a, b = scene.baseline, scene.occluders
        lines.append(scene.title)
        for label, one in (("  baseline", a), ("  with occluders", b)):
            lines.append(
                f"{label:22}{one.stats.rays / 1e6:8.1f}{one.seconds:9.2f}{one.speed:9.2f}"
                f"{one.stats.triangle_tests:17,}{one.stats.node_visits:17,}"
            )
        lines.append(
            f"{'  ratio':22}{'':8}{'':9}{_ratio(b.speed, a.speed):>9}"
            f"{_ratio(a.stats.triangle_tests, b.stats.triangle_tests):>17}"
            f"{_ratio(a.stats.node_visits, b.stats.node_visits):>17}"
        )
    lines.append("ratio: how many times as fast, with how many times fewer tests and steps")
    lines.append("(counting tests and steps costs both ways some speed)")
    return lines


def _share(a: int, b: int) -> str:
    return f"{100 * a / b:.0f} %" if b else "-"


def _ratio(a: float, b: float) -> str:
    return f"{a / b:.2f} x" if b else "-"


# ---- the sheet -----------------------------------------------------------------------

PAPER, INK, DIM, GOOD = (16, 18, 23), (232, 232, 228), (142, 148, 160), (126, 205, 150)
MARGIN, GAP = 48, 16
LARGE = (960, 640)
THUMB = (258, 172)
HEAD = 132


def contact_sheet(rendered: Sequence[Rendered]) -> NDArray[np.uint8]:
    """The scenes large, and small every light's mask, both ways, and their difference."""
    from PIL import Image, ImageDraw, ImageFont

    def font(points: int) -> Any:
        return ImageFont.load_default(size=points)

    left = MARGIN + LARGE[0] + 2 * GAP
    width = left + 4 * THUMB[0] + 3 * GAP + MARGIN
    row = LARGE[1] + MARGIN
    sheet = Image.new("RGB", (width, HEAD + len(rendered) * row), PAPER)
    draw = ImageDraw.Draw(sheet)
    draw.text((MARGIN, 34), "Exact soft shadows of closed meshes", INK, font(40))
    rays = sum(s.baseline.stats.rays for s in rendered) / 1e6
    text = (
        f"{rays:.0f} million shadow rays, traced without and with volumetric occluders: "
        "not one differs"
    )
    draw.text((MARGIN, 86), text, DIM, font(21))

    def place(pixels: NDArray[np.uint8], at: tuple[int, int], size: tuple[int, int]) -> None:
        image = Image.fromarray(pixels).resize(size, Image.Resampling.LANCZOS)
        sheet.paste(image, at)

    for k, scene in enumerate(rendered):
        top = HEAD + k * row
        final = look(scene.occluders.image, scene.file.lights, scene.ground)
        place(final, (MARGIN, top), LARGE)
        draw.text((left, top - 6), scene.title, INK, font(32))
        for line, (words, colour) in enumerate(_caption(scene)):
            draw.text((left, top + 44 + 28 * line), words, colour, font(19))
        thumbs = [
            (images.mask(scene.occluders.image, n), name)
            for n, name in enumerate(scene.file.light_names)
        ]
        thumbs += [
            (look(scene.baseline.image, scene.file.lights, scene.ground), "baseline"),
            (final, "with occluders"),
            (_difference_image(scene, final), "difference: none"),
        ]
        down = LARGE[1] - 2 * (THUMB[1] + 34) + 8
        for n, (pixels, label) in enumerate(thumbs):
            x = left + (n % 4) * (THUMB[0] + GAP)
            y = top + down + (n // 4) * (THUMB[1] + 34)
            place(pixels, (x, y), THUMB)
            draw.rectangle((x - 1, y - 1, x + THUMB[0], y + THUMB[1]), outline=(52, 57, 68))
            draw.text((x, y + THUMB[1] + 5), label, DIM, font(16))
    return np.array(sheet)


def _caption(scene: Rendered) -> list[tuple[str, tuple[int, int, int]]]:
    a, b = scene.baseline, scene.occluders
    blocked = b.stats.occluder_hits_tree + b.stats.occluder_hits_cache
    return [
        (
            f"{scene.report.triangle_count:,} triangles, "
            f"{scene.report.closed_count} closed solids, "
            f"{scene.report.tree.opaque_leaves:,} occluders",
            DIM,
        ),
        (
            f"{a.stats.rays / 1e6:.1f} M rays, {100 * a.stats.occluded / a.stats.rays:.0f} % "
            f"blocked, of these {100 * blocked / max(b.stats.occluded, 1):.0f} % by an occluder",
            DIM,
        ),
        (f"baseline {a.seconds:.1f} s, {a.speed:.1f} Mrays/s", DIM),
        (
            f"with occluders {b.seconds:.1f} s, {b.speed:.1f} Mrays/s "
            f"(order {scene.report.tree.auto_order})",
            DIM,
        ),
        (
            f"{b.speed / a.speed:.2f} times the speed, "
            f"{_share(b.stats.triangle_tests, a.stats.triangle_tests)} of the triangle tests, "
            "the same picture",
            GOOD if b.speed > a.speed else INK,
        ),
    ]


def _difference_image(scene: Rendered, final: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """The picture dimmed, and red where a count differs; only drawn when none does."""
    a, b = scene.baseline.image.counts, scene.occluders.image.counts
    differs = (a != b).any(axis=0)
    grey = 20 + 0.16 * final.mean(axis=-1, keepdims=True)
    return np.where(differs[..., None], (255, 60, 40), grey).astype(np.uint8)


if __name__ == "__main__":
    sys.exit(main())
