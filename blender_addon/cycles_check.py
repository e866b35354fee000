# SPDX-License-Identifier: GPL-3.0-or-later
"""Masks beside what Cycles says: the ratio of two renders, with and without a light's shadow.

Both sides look through the pixels' centres at plain white matter, shaded flat, under one light, so
that nothing but the shadow can differ. What remains is the noise of Cycles, which is measured as
well.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import bpy
import numpy as np
from numpy.typing import NDArray

from . import compat, compositor
from .engine import region_of
from .headless import shadow_masks
from .properties import settings_of

_NAME = "Check Against Cycles"

Floats = NDArray[np.float32]

# Samples of one Cycles render. A check takes several, so that it can be stopped between them.
STEP = 32

# Pixels that the light hardly lights say little: below this share of the brightest ones.
DIM = 0.05

# The difference in the picture is shown this many times as large.
GAIN = 4.0


class CheckError(Exception):
    """The scene cannot be checked; the text says why."""


@dataclass(frozen=True, eq=False)
class Comparison:
    """The mask of a light, and the ratio of two Cycles renders.

    Attributes:
        light: its name.
        rms, largest: of the differences.
        noise: RMS that Cycles differs from itself by, at the same number of samples.
        pixels: compared.
        mask, ratio: (height, width), the lowest row first; NaN where nothing is compared.
    """

    light: str
    rms: float
    largest: float
    noise: float
    pixels: int
    mask: Floats
    ratio: Floats

    def line(self) -> str:
        """A sentence."""
        if not self.pixels:
            return f"{self.light}: lights nothing that the camera sees"
        return (
            f"{self.light}: RMS difference {self.rms:.4f}, largest {self.largest:.3f}, "
            f"noise of Cycles {self.noise:.4f}, {self.pixels} pixels"
        )


# The last comparisons of each scene, by the scene's name.
LAST: dict[str, tuple[Comparison, ...]] = {}


def check(
    scene: Any,
    lights: Sequence[Any] | None = None,
    *,
    size: int = 160,
    samples: int = 256,
    found: list[Comparison] | None = None,
) -> Iterator[float]:
    """Compares in steps; a generator, so that its caller can stop it.

    Args:
        scene: whose masks are checked, not its shadow scene; left as it was, at the end and
            when the generator is closed.
        lights: light objects; None for all that cast a shadow in a render.
        size: the picture's longer edge in pixels, of the render border if there is one.
        samples: of Cycles, a multiple of 2 STEP is taken, and of the mask.
        found: gets the comparisons.

    Yields:
        The fraction done.

    Raises:
        CheckError: the scene cannot be checked.
    """
    lights = lights_of(scene) if lights is None else list(lights)
    if scene.camera is None:
        raise CheckError(f"The scene '{scene.name}' has no camera")
    if scene.camera.data.type not in ("PERSP", "ORTHO"):
        raise CheckError(
            f"The camera '{scene.camera.name}' is neither perspective nor orthographic"
        )
    if not lights:
        raise CheckError("There is no light that casts a shadow in the render")
    if not hasattr(scene, "cycles"):
        raise CheckError("Cycles is not switched on: see the add-ons in the preferences")
    pairs = max(1, samples // (2 * STEP))
    steps = len(lights) * (4 * pairs + 1)
    results: list[Comparison] = [] if found is None else found
    with _Twin(scene, size) as twin:
        for index, light in enumerate(lights):
            with twin.under(light):
                done = index * (4 * pairs + 1)
                # Two independent halves, for the noise.
                halves = np.zeros((2, 2, *twin.shape), np.float64)
                for step in range(4 * pairs):
                    half, shadow = step // (2 * pairs), step % 2
                    halves[half, shadow] += twin.render(bool(shadow), seed=step)
                    yield (done + step + 1) / steps
                mask = twin.mask(samples)
            results.append(compare(light.name, mask, *halves))
            yield (done + 4 * pairs + 1) / steps
    LAST[scene.name] = tuple(results)


def lights_of(scene: Any) -> list[Any]:
    """The lights that render and cast a shadow, no instances."""
    return sorted(
        (
            each
            for each in scene.objects
            if each.type == "LIGHT" and not each.hide_render and compat.casts_shadow(each.data)
        ),
        key=lambda light: light.name,
    )


def compare(light: str, mask: Floats, first: Floats, second: Floats) -> Comparison:
    """Compares.

    Args:
        light: its name.
        mask: (height, width).
        first, second: (2, height, width), without and with shadow, independent of each other.
    """
    lit, shadowed = first + second
    counts = (lit > DIM * np.percentile(lit, 99.0)) & (first[0] > 0) & (second[0] > 0)
    ratio = np.divide(shadowed, lit, out=np.full(lit.shape, np.nan), where=counts)
    difference = (ratio - mask)[counts]
    own = first[1][counts] / first[0][counts] - second[1][counts] / second[0][counts]
    return Comparison(
        light=light,
        rms=_rms(difference),
        largest=float(np.abs(difference).max(initial=0.0)),
        # The mean of two halves has half the noise of their difference.
        noise=_rms(own) / 2,
        pixels=int(counts.sum()),
        mask=np.where(counts, mask, np.nan).astype(np.float32),
        ratio=ratio.astype(np.float32),
    )


def show(comparison: Comparison) -> Any:
    """An image, made or replaced: Cycles, mask and difference, from left to right."""
    difference = np.abs(comparison.ratio - comparison.mask) * GAIN
    row = np.concatenate([comparison.ratio, comparison.mask, difference], axis=1)
    height, width = row.shape
    name = f"Check {comparison.light}"
    image = bpy.data.images.get(name)
    if image is not None and tuple(image.size) != (width, height):
        bpy.data.images.remove(image)
        image = None
    if image is None:
        image = bpy.data.images.new(name, width, height, float_buffer=True, is_data=True)
    # What is not compared is blue.
    pixels = np.empty((height, width, 4), np.float32)
    pixels[...] = (0.0, 0.0, 0.2, 1.0)
    valid = ~np.isnan(row)
    pixels[valid, :3] = row[valid, None]
    image.pixels.foreach_set(pixels.ravel())
    image.update()
    return image


def _rms(values: Floats) -> float:
    return float(np.sqrt(np.mean(np.square(values)))) if values.size else 0.0


class _Twin:
    """A scene of the same objects, all white and diffuse, rendered small by Cycles.

    Args:
        source: the scene.
        size: longer edge of the picture.

    Attributes:
        scene: the twin.
        shape: height and width of the picture.
    """

    def __init__(self, source: Any, size: int) -> None:
        self._source = source
        self._size = size
        self._undo = ExitStack()

    def __enter__(self) -> _Twin:
        with ExitStack() as undo:
            self._set_up(undo)
            self._undo = undo.pop_all()
        return self

    def __exit__(self, *_: object) -> None:
        self._undo.close()

    def _set_up(self, undo: ExitStack) -> None:
        self._file = Path(undo.enter_context(tempfile.TemporaryDirectory(prefix="vocc-check-")))
        self.scene = bpy.data.scenes.new(_NAME)
        undo.callback(compositor.remove, self.scene)
        white = bpy.data.materials.new(_NAME)
        undo.callback(bpy.data.materials.remove, white)
        compat.make_diffuse(white)
        compositor.follow(self._source, self.scene)
        self.scene.world = None
        for layer in self.scene.view_layers:
            layer.material_override = white
        self._only_layer()
        self._set_up_render()
        self._set_up_cycles()
        undo.enter_context(_changed(self.scene.camera.data.dof, use_dof=False))
        for each in self.scene.objects:
            if each.type == "LIGHT":
                # Cycles shows area lights to the camera.
                undo.enter_context(_changed(each, visible_camera=False))
                continue
            if each.vocc.exclude:
                undo.enter_context(_changed(each, visible_shadow=False))
            if each.shadow_terminator_geometry_offset:
                # Cycles starts shadow rays of what is shaded smooth away from the surface.
                undo.enter_context(_changed(each, shadow_terminator_geometry_offset=0.0))

    def _only_layer(self) -> None:
        first = next(
            (layer for layer in self.scene.view_layers if layer.use), self.scene.view_layers[0]
        )
        for layer in self.scene.view_layers:
            layer.use = layer == first

    def _set_up_render(self) -> None:
        render = self.scene.render
        width = render.resolution_x * render.resolution_percentage / 100
        height = render.resolution_y * render.resolution_percentage / 100
        if render.use_border:
            longer = max(
                (render.border_max_x - render.border_min_x) * width,
                (render.border_max_y - render.border_min_y) * height,
            )
        else:
            longer = max(width, height)
        scale = min(1.0, self._size / longer)
        render.resolution_x, render.resolution_y = (
            max(4, round(edge * scale)) for edge in (width, height)
        )
        render.resolution_percentage = 100
        render.use_crop_to_border = True
        self._region = region_of(render, render.resolution_x, render.resolution_y)
        self.shape = (self._region.height, self._region.width)
        render.engine = "CYCLES"
        # Cycles keeps its tree of the scene from one render to the next.
        render.use_persistent_data = True
        compat.set_exr(render.image_settings)
        render.filepath = str(self._file / "render.exr")

    def _set_up_cycles(self) -> None:
        cycles = self.scene.cycles
        cycles.device = "CPU"
        cycles.samples = STEP
        # Light that comes straight from the lamp, and all of it.
        cycles.max_bounces = 0
        cycles.use_adaptive_sampling = cycles.use_denoising = False
        cycles.sample_clamp_direct = cycles.light_sampling_threshold = 0.0
        # 0 is not allowed.
        cycles.pixel_filter_type, cycles.filter_width = "BLACKMAN_HARRIS", 0.01

    @contextmanager
    def under(self, light: Any) -> Iterator[None]:
        """Only this light shines."""
        with ExitStack() as undo:
            for each in bpy.data.objects:
                if each.type == "LIGHT" and each != light:
                    undo.enter_context(_changed(each, hide_render=True))
            self._light = light
            yield

    def render(self, with_shadow: bool, seed: int) -> Floats:
        """The light that arrives, the lowest row first."""
        self.scene.cycles.seed = seed
        with ExitStack() as undo:
            for owner, name in compat.shadow_switches(self._light.data):
                undo.enter_context(_changed(owner, **{name: with_shadow}))
            bpy.ops.render.render(write_still=True, scene=self.scene.name)
        image = bpy.data.images.load(self.scene.render.filepath)
        try:
            pixels = np.empty((*self.shape, 4), np.float32)
            image.pixels.foreach_get(pixels.ravel())
        finally:
            bpy.data.images.remove(image)
        return pixels[..., 0]

    def mask(self, samples: int) -> Floats:
        """The mask of the light in the same pixels."""
        settings = settings_of(compositor.settings_scene(self._source))
        (mask,) = shadow_masks(
            self.scene,
            lights=[self._light],
            samples=samples,
            aa=1,
            masks=True,
            irradiance=True,
            offset=settings.offset,
        ).values()
        x, y, width, height = self._region
        return np.flipud(mask)[y : y + height, x : x + width]


@contextmanager
def _changed(owner: Any, **values: Any) -> Iterator[None]:
    """The attributes with these values, and then with their old ones."""
    old = {name: getattr(owner, name) for name in values}
    try:
        for name, value in values.items():
            setattr(owner, name, value)
        yield
    finally:
        for name, value in old.items():
            setattr(owner, name, value)
