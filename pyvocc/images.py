"""Images of a shadow pass: EXR files with every figure, PNG files to look at."""

from __future__ import annotations

import colorsys
from collections.abc import Mapping, Sequence
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ._files import FileError, PathLike, missing, read_bytes, replacing
from .lights import Light, SunLight

if TYPE_CHECKING:
    from .shadow import ShadowPass

Floats = NDArray[np.float64]
Pixels = NDArray[np.uint8]

# Linear colours of the lights, in order, and of the meshes by geom_id: soft, so that the
# shadows are what one sees.
_LIGHT_COLOURS = (
    (1.00, 0.88, 0.70),
    (1.00, 0.60, 0.30),
    (0.38, 0.62, 1.00),
    (0.78, 0.48, 1.00),
    (0.50, 0.92, 0.86),
)
_MESH_COLOURS = (
    (0.64, 0.55, 0.46),
    (0.74, 0.27, 0.20),
    (0.22, 0.42, 0.62),
    (0.80, 0.58, 0.20),
    (0.34, 0.55, 0.30),
    (0.50, 0.34, 0.58),
)
_GROUND_COLOUR = (0.43, 0.44, 0.47)


def write_exr(path: PathLike, result: ShadowPass, light_names: Sequence[str]) -> None:
    """Writes a shadow pass as an OpenEXR file of float32 channels, losslessly compressed.

    Channels: shadow.NAME for each light (its visible share; -1 where it is not traced), P.X
    P.Y P.Z (position, NaN on the background), N.X N.Y N.Z (normal) and geom_id (-1 on the
    background).

    Raises:
        ValueError: not as many different names as lights.
        FileError: the file cannot be written.
        ImportError: OpenEXR is not installed.
    """
    count = len(result.visibility)
    if len(light_names) != count or len(set(light_names)) != count:
        raise ValueError(f"expected {count} different light names, got {list(light_names)}")
    channels = {f"shadow.{name}": result.visibility[k] for k, name in enumerate(light_names)}
    for k, axis in enumerate("XYZ"):
        channels[f"P.{axis}"] = result.position[..., k]
        channels[f"N.{axis}"] = result.normal[..., k]
    write_exr_channels(path, {**channels, "geom_id": result.geom_id})


def write_exr_channels(path: PathLike, channels: Mapping[str, NDArray[Any]]) -> None:
    """Writes (H, W) arrays by name as float32 channels of an OpenEXR file.

    Raises:
        FileError: the file cannot be written.
        ImportError: OpenEXR is not installed.
    """
    openexr = _openexr("writing EXR files")
    header = {"compression": openexr.ZIP_COMPRESSION, "type": openexr.scanlineimage}
    arrays = {name: np.ascontiguousarray(a, np.float32) for name, a in channels.items()}
    with replacing(path) as temporary:
        try:
            with openexr.File(header, arrays) as image:
                image.write(str(temporary))
        except (RuntimeError, ValueError) as error:
            raise FileError(path, f"could not be written ({error})") from None


def write_png(path: PathLike, pixels: Pixels) -> None:
    """Writes (H, W, 3) or (H, W) uint8 as a PNG file.

    Raises:
        FileError: the file cannot be written.
        ImportError: Pillow is not installed.
    """
    image = _pillow("writing PNG files").fromarray(np.ascontiguousarray(pixels, np.uint8))
    with replacing(path) as temporary:
        image.save(temporary, format="PNG")


def read_image(path: PathLike) -> dict[str, NDArray[Any]]:
    """Reads an EXR or PNG file.

    Returns:
        (H, W) arrays by channel name: of an EXR file float32 (or float16, uint32, as the file
        has them), of a PNG file uint8 R, G, B and, if there is one, A.

    Raises:
        FileError: the file is not there, ends early, or is of another type.
        ImportError: OpenEXR or Pillow is not installed.
    """
    suffix = Path(path).suffix.lower()
    if suffix not in (".exr", ".png"):
        raise FileError(path, "is neither an .exr nor a .png file")
    data = read_bytes(path)
    if not data:
        raise FileError(path, "the file is empty")
    return _read_exr(path) if suffix == ".exr" else _read_png(path, data)


def _read_exr(path: PathLike) -> dict[str, NDArray[Any]]:
    openexr = _openexr("reading EXR files")
    try:
        with openexr.File(str(path), separate_channels=True) as image:
            channels = {name: channel.pixels for name, channel in image.channels().items()}
    except (RuntimeError, ValueError, TypeError):
        # The package tells the details on the process's own output only.
        raise FileError(path, "is not a complete EXR file") from None
    if not channels or any(pixels is None for pixels in channels.values()):
        raise FileError(path, "is not a complete EXR file")
    return {name: np.array(pixels) for name, pixels in channels.items()}


def _read_png(path: PathLike, data: bytes) -> dict[str, NDArray[Any]]:
    pillow = _pillow("reading PNG files")
    try:
        if b"IEND" not in data:  # Pillow forgives a short last chunk
            raise ValueError
        with pillow.open(BytesIO(data), formats=["PNG"]) as image:
            alpha = "A" in image.getbands() or "transparency" in image.info
            pixels = np.array(image.convert("RGBA" if alpha else "RGB"))
    except (OSError, ValueError, SyntaxError):
        raise FileError(path, "is not a complete PNG file") from None
    return {name: pixels[..., k] for k, name in enumerate("RGBA"[: pixels.shape[-1]])}


def light_colour(index: int) -> Floats:
    """The linear RGB tint in which `look` shows a light."""
    if index < len(_LIGHT_COLOURS):
        return np.array(_LIGHT_COLOURS[index])
    return np.array(colorsys.hsv_to_rgb(index * 0.618 % 1.0, 0.4, 1.0))


def look(result: ShadowPass, lights: Sequence[Light], ground: int | None = None) -> Pixels:
    """The pass as a picture for people: every light softly tinted, shaded and tone-mapped.

    Args:
        result: of `shadow_pass`.
        lights: those it was made with.
        ground: geom_id to be shown in a neutral grey.

    Returns:
        (H, W, 3) uint8, sRGB.
    """
    normal = result.normal.astype(np.float64)
    shown = result.geom_id >= 0
    position = np.where(shown[..., None], result.position.astype(np.float64), 0.0)
    # A little sky from above, less from below, keeps what no light sees from going black.
    total = np.multiply.outer(0.05 + 0.035 * normal[..., 1], np.array([0.80, 0.92, 1.15]))
    for index, light in enumerate(lights):
        if isinstance(light, SunLight):
            towards = np.broadcast_to(np.asarray(light.direction), position.shape)
        else:
            towards = np.asarray(light.center) - position
        length = np.maximum(np.linalg.norm(towards, axis=-1), 1e-300)
        slope = np.maximum(np.einsum("hwk,hwk->hw", normal, towards) / length, 0.0)
        visible = np.maximum(result.visibility[index], 0.0)
        # The first light is the key: brighter than the others together.
        strength = 1.7 if index == 0 else 1.3 / max(len(lights) - 1, 1)
        total += np.multiply.outer(strength * visible * slope, light_colour(index))
    colours = np.array(_MESH_COLOURS)[np.maximum(result.geom_id, 0) % len(_MESH_COLOURS)]
    if ground is not None:
        colours[result.geom_id == ground] = _GROUND_COLOUR
    height = np.linspace(0.0, 1.0, shown.shape[0])[:, None, None]
    sky = np.array([0.10, 0.115, 0.15]) * (1 - height) + np.array([0.23, 0.235, 0.25]) * height
    return tone_map(np.where(shown[..., None], total * colours, sky))


def mask(result: ShadowPass, index: int) -> Pixels:
    """One light's visible share in its tint, (H, W, 3) uint8; slate where it is not traced."""
    share = result.visibility[index].astype(np.float64)
    lit = np.maximum(share, 0.0)[..., None] ** 2.2 * light_colour(index)
    lit = np.where(share[..., None] < 0, np.array([0.012, 0.014, 0.022]), 0.004 + 0.996 * lit)
    return _srgb(lit)


def tone_map(linear: Floats) -> Pixels:
    """Linear light, 0 to infinity, as sRGB with soft highlights."""
    return _srgb(1.0 - np.exp(-1.2 * linear))


def _srgb(linear: Floats) -> Pixels:
    x = np.clip(linear, 0.0, 1.0)
    curve = np.where(x <= 0.0031308, 12.92 * x, 1.055 * x ** (1 / 2.4) - 0.055)
    return np.round(curve * 255).astype(np.uint8)


def _openexr(purpose: str) -> Any:
    try:
        import OpenEXR
    except ImportError:
        raise missing("OpenEXR", purpose) from None
    return OpenEXR


def _pillow(purpose: str) -> Any:
    try:
        from PIL import Image
    except ImportError:
        raise missing("Pillow", purpose) from None
    return Image


def check_packages(exr: bool) -> None:
    """ImportError if what writes PNG files, or EXR files too, is not installed."""
    _pillow("writing PNG files")
    if exr:
        _openexr("writing EXR files")
