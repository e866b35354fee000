"""Measures the add-on against the two renders for each light that take its place in Cycles.

    .venv-blender-5.2/bin/python -m bench.blender -o results.json

The scene is that of `blender_scene.py`. What is compared is the time at equal error:

- A mask of the add-on is the share of a light that each pixel sees. In Cycles it is the ratio of
  two renders with that light alone, its shadow switched on and off, of the pass Diffuse Direct;
  no bounces, box filter, no denoiser, no adaptive sampling, a fixed seed (so that both renders
  take the same paths, which is to Cycles' advantage), persistent data.
- Each is compared to a reference of its own kind, with many more samples and another seed or
  sub-pixel grid. The error is the root mean square of the difference over the penumbra: pixels
  that the same reference has between 5 % and 95 %, all lights taken together.
- Errors are measured at a small size, where that of a pixel is the same: it depends on the samples
  in the pixel. The add-on is timed at the full size. Cycles is timed at the small size with
  several sample counts: a fixed part, counted as it is, and a part for each sample, which is
  multiplied by the ratio of the pixels. Its samples at the add-on's error are interpolated in
  logarithms; beyond the measured counts the table says so.
- The wall clock is that of bpy.ops.render.render, without files. "Blender" in the table is what
  of it is outside the add-on: the depsgraph, and buffers; "modifiers" is what Blender evaluates
  when the add-on asks for the meshes.

The answer to ESC is what a press takes until the render is over: at random times, the hook that
asks Blender finds it pressed; parts of the render that do not ask count in full.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import random
import statistics
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TextIO

import bpy
import numpy as np
import OpenEXR
from numpy.typing import NDArray

import blender_addon
from blender_addon import engine, report, scenes
from blender_addon.compat import set_multilayer_exr

from .blender_scene import LIGHTS, make_scene
from .measure import machine

Image = NDArray[np.float32]
Size = tuple[int, int]

PENUMBRA = (0.05, 0.95)

# Sub-pixels along an edge and samples of the add-on's reference: 4608 rays a pixel and light.
REFERENCE_AA, REFERENCE_SAMPLES = 6, 128


def say(text: str) -> None:
    print(text, file=sys.stderr, flush=True)


# ---- the add-on ----------------------------------------------------------------------


def use_addon(scene: bpy.types.Scene, size: Size, samples: int, aa: int) -> None:
    scene.render.engine = "VOCC"
    set_size(scene, size)
    scene.vocc.samples, scene.vocc.aa = samples, aa


def time_addon(scene: bpy.types.Scene) -> dict[str, float]:
    """Seconds of one render by stage."""
    with modifiers_first() as modifiers:
        start = time.perf_counter()
        bpy.ops.render.render(scene=scene.name)
        total = time.perf_counter() - start
    stages = dict(report.LAST[scene.name].seconds)
    stages["extract"] -= modifiers[0]
    blender = total - modifiers[0] - sum(stages.values())
    return {"Blender": blender, "modifiers": modifiers[0], **stages, "total": total}


@contextmanager
def modifiers_first() -> Iterator[list[float]]:
    """Seconds that Blender takes to evaluate meshes, since 4.5 at the first look at each."""
    read_world = engine.read_world
    seconds = [0.0]

    def read(depsgraph: bpy.types.Depsgraph) -> Any:
        start = time.perf_counter()
        for instance in depsgraph.object_instances:
            if instance.object.type == "MESH":
                _ = instance.object.data
        seconds[0] = time.perf_counter() - start
        return read_world(depsgraph)

    engine.read_world = read
    try:
        yield seconds
    finally:
        engine.read_world = read_world


class Pressed:
    """Blender as the add-on polls it, with ESC pressed from a time on."""

    def __init__(self, real: bpy.types.RenderEngine, at: float) -> None:
        self._real = real
        self._at = at

    def update_progress(self, fraction: float) -> None:
        self._real.update_progress(fraction)

    def test_break(self) -> bool:
        return time.perf_counter() >= self._at


def esc_seconds(scene: bpy.types.Scene, after: float) -> float | None:
    """From a press so many seconds after the start to the end; None if it came too late."""
    poll = engine.Poll
    start = time.perf_counter()
    engine.Poll = lambda real: poll(Pressed(real, start + after))
    try:
        bpy.ops.render.render(scene=scene.name)
    finally:
        engine.Poll = poll
    end = time.perf_counter()
    return end - start - after if end - start > after else None


def addon_masks(scene: bpy.types.Scene, size: Size, samples: int, aa: int) -> dict[str, Image]:
    return blender_addon.shadow_masks(scene, samples=samples, aa=aa, size=size)


# ---- Cycles --------------------------------------------------------------------------


def use_cycles(scene: bpy.types.Scene, size: Size, seed: int) -> None:
    scene.render.engine = "CYCLES"
    set_size(scene, size)
    scene.render.use_persistent_data = True
    scene.view_layers[0].use_pass_diffuse_direct = True
    cycles = scene.cycles
    cycles.device = "CPU"
    cycles.seed = seed
    cycles.max_bounces = cycles.diffuse_bounces = cycles.glossy_bounces = 0
    cycles.use_denoising = cycles.use_adaptive_sampling = False
    cycles.pixel_filter_type = "BOX"
    cycles.filter_width = 1.0


def cycles_masks(scene: bpy.types.Scene, samples: int) -> tuple[dict[str, Image], float]:
    """The ratio for each light, and the seconds of all renders."""
    scene.cycles.samples = samples
    lights = [scene.objects[name] for name, *_ in LIGHTS]
    masks = {}
    seconds = 0.0
    for light in lights:
        for other in lights:
            other.hide_render = other is not light
        passes = []
        for use_shadow in (True, False):
            light.data.use_shadow = use_shadow
            image, elapsed = diffuse_direct(scene)
            passes.append(image)
            seconds += elapsed
        light.data.use_shadow = True
        with np.errstate(divide="ignore", invalid="ignore"):
            masks[light.name] = np.clip(passes[0] / passes[1], 0.0, 1.0)
    for light in lights:
        light.hide_render = False
    return masks, seconds


def diffuse_direct(scene: bpy.types.Scene) -> tuple[Image, float]:
    """The pass's first channel, the top row first, and the seconds of the render alone."""
    start = time.perf_counter()
    bpy.ops.render.render(scene=scene.name)
    seconds = time.perf_counter() - start
    set_multilayer_exr(scene.render.image_settings)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "render.exr"
        bpy.data.images["Render Result"].save_render(str(path), scene=scene)
        return channel(path, ("DiffDir.R", "Diffuse Direct.R")), seconds


def channel(path: Path, endings: tuple[str, ...]) -> Image:
    with OpenEXR.File(str(path), separate_channels=True) as file:
        for part in file.parts:
            for name, values in part.channels.items():
                full = name if "." in name else f"{part.name()}.{name}"
                if full.endswith(endings):
                    return np.array(values.pixels, np.float32)
    raise ValueError(f"{path} has no channel {' or '.join(endings)}")


# ---- error ---------------------------------------------------------------------------


def penumbra_error(masks: dict[str, Image], reference: dict[str, Image]) -> float:
    """Root mean square difference over the penumbra pixels of the reference."""
    differences = []
    for name, exact in reference.items():
        partly = (exact > PENUMBRA[0]) & (exact < PENUMBRA[1]) & np.isfinite(masks[name])
        differences.append(masks[name][partly] - exact[partly])
    return float(np.sqrt(np.mean(np.square(np.concatenate(differences), dtype=np.float64))))


def samples_at(error: float, counts: Sequence[int], errors: Sequence[float]) -> tuple[float, bool]:
    """The count that has this error, by straight lines in logarithms, and whether it is
    between the measured ones."""
    x, y = np.log(np.asarray(errors, float)), np.log(np.asarray(counts, float))
    wanted = math.log(error)
    order = np.argsort(x)
    x, y = x[order], y[order]
    i = int(np.clip(np.searchsorted(x, wanted), 1, len(x) - 1))
    slope = (y[i] - y[i - 1]) / (x[i] - x[i - 1])
    return math.exp(y[i - 1] + slope * (wanted - x[i - 1])), bool(x[0] <= wanted <= x[-1])


# ---- all of it -----------------------------------------------------------------------


def set_size(scene: bpy.types.Scene, size: Size) -> None:
    scene.render.resolution_x, scene.render.resolution_y = size
    scene.render.resolution_percentage = 100


def measure_addon(scene: bpy.types.Scene, args: argparse.Namespace) -> dict[str, Any]:
    use_addon(scene, args.size, args.samples, args.aa)
    first, again = [], []
    for number in range(args.rounds):
        scenes.CACHE.clear()
        first.append(time_addon(scene))
        again.append(time_addon(scene))  # nothing changed: no build
        say(f"add-on: round {number + 1} of {args.rounds}, {first[-1]['total']:.2f} s")
    last = report.LAST[scene.name]
    found = {
        "triangles": last.triangles,
        "rays": last.rays,
        "first": middle(first),
        "again": middle(again),
    }
    answers = []
    random_numbers = random.Random(args.seed)
    whole = found["first"]["total"]
    for _ in range(args.presses):
        scenes.CACHE.clear()
        answers.append(esc_seconds(scene, random_numbers.uniform(0.0, whole)))
    found["esc"] = [answer for answer in answers if answer is not None]
    reference = addon_masks(scene, args.small, REFERENCE_SAMPLES, REFERENCE_AA)
    masks = addon_masks(scene, args.small, args.samples, args.aa)
    found["error"] = penumbra_error(masks, reference)
    say(f"add-on: error {found['error']:.4f}")
    return found


def measure_cycles(scene: bpy.types.Scene, args: argparse.Namespace) -> dict[str, Any]:
    use_cycles(scene, args.small, seed=args.seed + 1)
    start = time.perf_counter()
    reference, _ = cycles_masks(scene, args.reference)
    say(f"Cycles: reference, {time.perf_counter() - start:.0f} s")
    scene.cycles.seed = args.seed
    errors, seconds = [], []
    for count in args.counts:
        masks, elapsed = cycles_masks(scene, count)
        errors.append(penumbra_error(masks, reference))
        seconds.append(elapsed)
        say(f"Cycles: {count} samples, error {errors[-1]:.4f}, {elapsed:.1f} s")
    slope, fixed = np.polyfit(args.counts, seconds, 1)
    return {
        "counts": args.counts,
        "errors": errors,
        "seconds": seconds,
        "fixed": max(float(fixed), 0.0),
        "each": float(slope),
    }


def compared(ours: dict[str, Any], cycles: dict[str, Any], size: Size, small: Size) -> None:
    """Adds to Cycles' figures what it takes at our error and at the full size."""
    count, inside = samples_at(ours["error"], cycles["counts"], cycles["errors"])
    pixels = size[0] * size[1] / (small[0] * small[1])
    cycles["samples"], cycles["inside"] = count, inside
    cycles["total"] = cycles["fixed"] + cycles["each"] * count * pixels
    cycles["factor"] = cycles["total"] / ours["first"]["total"]
    cycles["factor_again"] = cycles["total"] / ours["again"]["total"]


def middle(rounds: Sequence[dict[str, float]]) -> dict[str, float]:
    return {key: statistics.median(stages[key] for stages in rounds) for key in rounds[0]}


def markdown(results: dict[str, Any]) -> str:
    ours, settings = results["addon"], results["settings"]
    first, again = ours["first"], ours["again"]
    size = "{} x {}".format(*settings["size"])
    per_million = first["extract"] / ours["triangles"] * 1e6
    lines = [
        f"Blender {results['blender']}, {size}, {len(LIGHTS)} area lights, "
        f"{ours['triangles']} triangles, {ours['rays'] / 1e6:.0f} million shadow rays "
        f"({settings['samples']} samples, {settings['aa']} x {settings['aa']} sub-pixels), "
        f"{results['machine']['processors']} processors ({results['machine']['processor']})",
        "",
        "| stage | seconds | nothing changed |",
        "|---|---:|---:|",
        *(f"| {stage} | {first[stage]:.3f} | {again[stage]:.3f} |" for stage in first),
        "",
        f"Extract: {per_million:.3f} s for a million triangles.",
    ]
    if ours["esc"]:
        worst, usual = max(ours["esc"]), statistics.median(ours["esc"])
        presses = len(ours["esc"])
        lines.append(f"ESC: {usual:.3f} s, at most {worst:.3f} s of {presses} presses.")
    if "cycles" in results:
        cycles = results["cycles"]
        lines += ["", "| Cycles, samples | error | seconds |", "|---:|---:|---:|"]
        rows = zip(cycles["counts"], cycles["errors"], cycles["seconds"], strict=True)
        lines += [f"| {count} | {error:.4f} | {seconds:.1f} |" for count, error, seconds in rows]
        beyond = "" if cycles["inside"] else " (beyond what was measured)"
        lines += [
            "",
            f"Error of the add-on {ours['error']:.4f}, of Cycles with {cycles['samples']:.0f} "
            f"samples{beyond}: {cycles['total']:.0f} s at {size}, "
            f"{cycles['factor']:.0f} times as long "
            f"({cycles['factor_again']:.0f} times where nothing changed).",
        ]
    return "\n".join(lines) + "\n"


def parser() -> argparse.ArgumentParser:
    def size(text: str) -> Size:
        width, height = text.split("x")
        return int(width), int(height)

    def counts(text: str) -> list[int]:
        return [int(part) for part in text.split(",")]

    main = argparse.ArgumentParser(prog="python -m bench.blender")
    main.add_argument("--size", type=size, default=(1920, 1080), metavar="WxH")
    main.add_argument("--samples", type=int, default=16, metavar="N", help="of the add-on (16)")
    main.add_argument("--aa", type=int, default=2, metavar="N", help="sub-pixels, squared (2)")
    main.add_argument("--rounds", type=int, default=3, metavar="N", help="of the add-on (3)")
    main.add_argument("--presses", type=int, default=12, metavar="N", help="of ESC (12)")
    main.add_argument("--seed", type=int, default=1, metavar="N", help="of all that is random")
    main.add_argument("--small", type=size, default=(240, 135), metavar="WxH", help="for errors")
    which = "sample counts of Cycles (16,64,256)"
    main.add_argument("--counts", type=counts, default=[16, 64, 256], metavar="A,B", help=which)
    what = "samples of its reference (2048)"
    main.add_argument("--reference", type=int, default=2048, metavar="N", help=what)
    main.add_argument("--no-cycles", action="store_true", help="measure only the add-on")
    main.add_argument("-o", "--output", type=Path, metavar="FILE.json", help="and FILE.md")
    return main


@contextmanager
def blender_muted() -> Iterator[TextIO]:
    """The output, which Blender's lines about each render do not reach."""
    sys.stdout.flush()
    with os.fdopen(os.dup(1), "w", encoding="utf-8") as out, Path(os.devnull).open("w") as nothing:
        os.dup2(nothing.fileno(), 1)
        try:
            yield out
        finally:
            sys.stdout.flush()
            os.dup2(out.fileno(), 1)


def run(args: argparse.Namespace, out: TextIO) -> None:
    scene = make_scene(args.seed)
    results: dict[str, Any] = {
        "machine": machine(),
        "blender": bpy.app.version_string,
        "settings": {key: value for key, value in vars(args).items() if key != "output"},
        "addon": measure_addon(scene, args),
    }
    if not args.no_cycles:
        results["cycles"] = measure_cycles(scene, args)
        compared(results["addon"], results["cycles"], args.size, args.small)
    text = markdown(results)
    print(text, file=out, flush=True)
    if args.output:
        args.output.parent.mkdir(parents=True, exist_ok=True)
        args.output.write_text(json.dumps(results, indent=1) + "\n", encoding="utf-8")
        args.output.with_suffix(".md").write_text(text, encoding="utf-8")


def main() -> int:
    args = parser().parse_args()
    blender_addon.register()
    try:
        with blender_muted() as out:
            run(args, out)
    except KeyboardInterrupt:
        return 130
    finally:
        blender_addon.unregister()
    return 0


if __name__ == "__main__":
    sys.exit(main())
