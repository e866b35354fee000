"""Pictures of one subject: its shadows, its tree, its occluders, where steps are spent."""

from __future__ import annotations

import base64
from collections.abc import Mapping
from io import BytesIO
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from .. import BOUNDARY, CLEAR, NOT_TRACED, OPAQUE, UNKNOWN
from ..images import look
from ..scene import Scene
from ..shadow import ShadowPass, shading_point
from .workload import CAMERA, GROUND_ID, RECT_LIGHTS, Floats, Points

Pixels: TypeAlias = NDArray[np.uint8]
Counts: TypeAlias = NDArray[np.uint16]

# Pixels along a side of a picture.
WIDTH = 384

# Pixels along a side of the blocks in which shadows are coherent or not.
BLOCK = 8

# Boxes that are drawn: the largest, up to this share of the occluders' volume.
BOX_SHARE, MOST_BOXES = 0.97, 1500

# Inside and edge of the leaves by label: distinct in grey as well, and to colour-blind eyes.
_LEAVES = {
    OPAQUE: ((230, 159, 0), (140, 90, 0)),
    BOUNDARY: ((160, 186, 214), (40, 62, 92)),
    UNKNOWN: ((204, 121, 167), (204, 121, 167)),
    CLEAR: ((255, 255, 255), (206, 214, 222)),
}


def draw(
    scene: Scene,
    vertices: Floats,
    points: Points,
    baseline: Counts,
    occluders: Counts,
    samples: int,
    steps: Mapping[str, NDArray[np.uint32]],
) -> dict[str, dict[str, Any]]:
    """Every picture: {name: {"mime": ..., "data": base64, ...}}; steps by name of the mode."""
    before, after = (_look(points, counts, samples) for counts in (baseline, occluders))
    drawn = {
        "baseline": _jpeg(before),
        "occluders": _jpeg(after),
        "difference": _png(_difference(points, baseline, occluders, after)),
        "slice": _png(_slice(scene, vertices)),
        "boxes": _jpeg(_boxes(scene)),
        "coherence": _png(_coherence_map(points, baseline, samples)),
    }
    if steps:
        # One scale for all, or they could not be compared.
        rays = np.maximum((baseline != NOT_TRACED).sum(axis=0) * samples, 1)
        share = {name: array / rays for name, array in steps.items()}
        top = max(float(np.percentile(array, 99.5)) for array in share.values())
        for name, array in share.items():
            picture = _png(_heat(_image(points, array), top))
            drawn[f"steps-{name}"] = {**picture, "top": top, "mean": float(array.mean())}
    return drawn


# ---- shadows -------------------------------------------------------------------------


def _image(points: Points, values: NDArray[Any], background: float = 0) -> NDArray[Any]:
    """From the points' order to (size, size, ...)."""
    image = np.full((points.size * points.size, *values.shape[1:]), background, values.dtype)
    image[points.pixels] = values
    return image.reshape(points.size, points.size, *values.shape[1:])


def _look(points: Points, counts: Counts, samples: int) -> Pixels:
    share = np.where(counts == NOT_TRACED, np.float32(-1), counts / np.float32(samples))
    result = ShadowPass(
        visibility=np.stack([_image(points, light, -1) for light in share.astype(np.float32)]),
        counts=np.stack([_image(points, light, NOT_TRACED) for light in counts]),
        position=_image(points, points.position, np.nan),
        normal=_image(points, points.normal),
        geom_id=_image(points, points.geom_id, -1),
        prim_id=_image(points, points.prim_id, -1),
        samples=samples,
        primary_seconds=0.0,
        shadow_seconds=0.0,
    )
    return look(result, RECT_LIGHTS, GROUND_ID)


def _difference(points: Points, one: Counts, other: Counts, shown: Pixels) -> Pixels:
    """The picture faint, and red where a count differs."""
    differs = _image(points, (one != other).any(axis=0))
    grey = 200 + 0.2 * shown.mean(axis=-1, keepdims=True)
    return np.where(differs[..., None], (213, 0, 0), grey).astype(np.uint8)


def coherence(points: Points, counts: Counts, samples: int) -> dict[str, float]:
    """How simple the shadows are.

    Returns:
        penumbra: share of pixels and lights of which some samples are blocked and some not.
        coherent: share of blocks and lights of which all rays agree.
    """
    traced = counts != NOT_TRACED
    partly = traced & (counts > 0) & (counts < samples)
    share = _block_shares(points, counts, samples)
    there = ~np.isnan(share)
    return {
        "penumbra": float(partly.sum() / max(traced.sum(), 1)),
        "coherent": float(np.isin(share[there], (0.0, 1.0)).sum() / max(there.sum(), 1)),
    }


def _block_shares(points: Points, counts: Counts, samples: int) -> NDArray[np.float64]:
    """(lights, blocks down, blocks across) visible share of a block's rays; NaN: none traced."""
    side = -(-points.size // BLOCK)
    y, x = np.divmod(points.pixels, points.size)
    block = (y // BLOCK * side + x // BLOCK).astype(np.int64)
    shares = []
    for light in counts:
        traced = light != NOT_TRACED
        rays = np.bincount(block[traced], minlength=side * side) * samples
        visible = np.bincount(block[traced], light[traced], side * side)
        with np.errstate(invalid="ignore"):
            shares.append(visible / rays)
    return np.stack(shares).reshape(len(counts), side, side)


def _coherence_map(points: Points, counts: Counts, samples: int) -> Pixels:
    """Of each block: 1 (light) where all rays to a light agree, 0 (dark) where half of them do."""
    share = _block_shares(points, counts, samples)
    there = ~np.isnan(share)
    agree = np.where(there, np.abs(2 * np.nan_to_num(share) - 1), 0.0).sum(axis=0)
    agree = agree / np.maximum(there.sum(axis=0), 1)
    image = np.kron(agree, np.ones((BLOCK, BLOCK)))[: points.size, : points.size]
    return _coloured(image, "cividis")


def _heat(image: NDArray[np.float64], top: float) -> Pixels:
    return _coloured(image / max(top, 1e-9), "inferno")


def _coloured(image: NDArray[np.float64], name: str) -> Pixels:
    """0 to 1 in a colour map, and the map itself as a strip below."""
    from matplotlib import colormaps

    strip = np.tile(np.linspace(0, 1, image.shape[1]), (max(image.shape[0] // 32, 2), 1))
    gap = np.full((max(image.shape[0] // 96, 1), image.shape[1], 3), 255, np.uint8)
    colours = colormaps[name]
    parts = [
        (colours(np.clip(part, 0, 1))[..., :3] * 255).astype(np.uint8) for part in (image, strip)
    ]
    return np.concatenate([parts[0], gap, parts[1]])


# ---- the tree ------------------------------------------------------------------------


def _slice(scene: Scene, vertices: Floats) -> Pixels:
    """The leaves that a plane of constant z cuts, through the largest occluder."""
    from PIL import Image, ImageDraw

    leaves = scene.leaves()
    lower, upper = leaves["lower"].astype(float), leaves["upper"].astype(float)
    opaque = np.flatnonzero(leaves["label"] == OPAQUE)
    least, most = vertices.min(axis=0).astype(float), vertices.max(axis=0).astype(float)
    z = (least[2] + most[2]) / 2
    if len(opaque):
        largest = opaque[np.prod(upper[opaque] - lower[opaque], axis=1).argmax()]
        z = (lower[largest, 2] + upper[largest, 2]) / 2
    middle = (least[:2] + most[:2]) / 2
    half = 0.53 * (most[:2] - least[:2]).max()
    scale = WIDTH / half  # drawn at twice the size: fine lines fade instead of vanishing
    cut = (lower[:, 2] <= z) & (z < upper[:, 2])
    cut &= (upper[:, :2] > middle - half).all(axis=1) & (lower[:, :2] < middle + half).all(axis=1)
    image = Image.new("RGB", (2 * WIDTH, 2 * WIDTH), "white")
    pencil = ImageDraw.Draw(image)
    for k in np.flatnonzero(cut):
        # As far as it is seen: some leaves of the ground are large.
        a = (np.clip(lower[k, :2] - middle, -half, half)) * scale + WIDTH
        b = (np.clip(upper[k, :2] - middle, -half, half)) * scale + WIDTH
        box = (a[0], 2 * WIDTH - b[1], b[0], 2 * WIDTH - a[1])
        pencil.rectangle(box, *_LEAVES[int(leaves["label"][k])])
    return np.array(image)


def _boxes(scene: Scene) -> Pixels:
    """The largest occluders, seen through the mesh from the workload's camera."""
    size = (2 * WIDTH, 2 * WIDTH)
    body = _shade(scene, size)
    grey = np.where(body.geom_id == 0, 0.42 + 0.55 * body.light, 1.0)[:, None] * (0.86, 0.91, 1.0)
    leaves = scene.leaves()
    opaque = leaves[leaves["label"] == OPAQUE]
    image = np.where((body.geom_id == 0)[:, None], grey, 1.0)
    if len(opaque):
        volume = np.prod(opaque["upper"].astype(float) - opaque["lower"], axis=1)
        order = np.argsort(-volume, kind="stable")
        most = int(np.searchsorted(np.cumsum(volume[order]), BOX_SHARE * volume.sum())) + 1
        chosen = opaque[order[: min(most, MOST_BOXES)]]
        with _box_scene(chosen["lower"], chosen["upper"]) as boxes:
            inside = _shade(boxes, size)
        hue = np.array([(230, 159, 0), (240, 228, 66), (213, 94, 0)]) / 255
        box = inside.prim_id // 12
        colour = hue[box % 3] * (0.45 + 0.55 * inside.light)[:, None]
        hit = (inside.prim_id >= 0)[:, None]
        image = np.where(hit, 0.8 * colour + 0.2 * grey, image)
    return (np.clip(image, 0, 1) * 255).astype(np.uint8).reshape(size[1], size[0], 3)


class _Shaded:
    """What the camera sees of a scene, pixel by pixel."""

    def __init__(self, geom_id: NDArray[np.int32], prim_id: NDArray[np.int32], light: Floats):
        self.geom_id, self.prim_id, self.light = geom_id, prim_id, light


def _shade(scene: Scene, size: tuple[int, int]) -> _Shaded:
    org, dir = CAMERA.rays(size)
    dir = dir.reshape(-1, 3)
    hits = scene.intersect(org, dir)
    hit = np.flatnonzero(hits.prim_id >= 0)
    corners = scene.corners(hits.geom_id[hit], hits.prim_id[hit])
    _, normal = shading_point(corners, org - scene.origin, dir[hit], hits.t[hit], 0.0)
    light = np.ones(len(dir), np.float32)
    towards = np.array([-0.45, 0.75, 0.5], np.float32)
    light[hit] = np.clip(normal @ (towards / np.linalg.norm(towards)), 0, 1)
    return _Shaded(hits.geom_id, hits.prim_id, light)


def _box_scene(lower: Floats, upper: Floats) -> Scene:
    corner = np.array([[k & 1, k >> 1 & 1, k >> 2 & 1] for k in range(8)], bool)
    quads = [(0, 4, 6, 2), (1, 3, 7, 5), (0, 1, 5, 4), (2, 6, 7, 3), (0, 2, 3, 1), (4, 5, 7, 6)]
    faces = np.array([t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))], np.int32)
    vertices = np.where(corner, upper[:, None], lower[:, None]).reshape(-1, 3)
    triangles = faces + 8 * np.arange(len(lower), dtype=np.int32)[:, None, None]
    scene = Scene(threads=1)
    scene.add_mesh(vertices, triangles.reshape(-1, 3))
    scene.build()
    return scene


# ---- files ---------------------------------------------------------------------------


def _sized(pixels: Pixels) -> Any:
    """A picture of WIDTH; small ones keep hard pixels."""
    from PIL import Image

    image = Image.fromarray(np.ascontiguousarray(pixels))
    height = round(pixels.shape[0] * WIDTH / pixels.shape[1])
    small = pixels.shape[1] < WIDTH
    how = Image.Resampling.NEAREST if small else Image.Resampling.LANCZOS
    return image.resize((WIDTH, height), how)


def _jpeg(pixels: Pixels) -> dict[str, Any]:
    buffer = BytesIO()
    _sized(pixels).save(buffer, "JPEG", quality=88)
    return {"mime": "image/jpeg", "data": base64.b64encode(buffer.getvalue()).decode()}


def _png(pixels: Pixels) -> dict[str, Any]:
    buffer = BytesIO()
    # A palette: a third of the size, and these pictures have few colours.
    _sized(pixels).quantize(128).save(buffer, "PNG", optimize=True)
    return {"mime": "image/png", "data": base64.b64encode(buffer.getvalue()).decode()}
