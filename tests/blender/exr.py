"""What a render wrote, pass by pass."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import OpenEXR
from numpy.typing import NDArray


def render(scene: Any, path: Path, **options: Any) -> dict[str, NDArray[np.float32]]:
    """F12 into a multilayer EXR file; see `passes`."""
    import bpy

    from blender_addon import compat

    compat.set_multilayer_exr(scene.render.image_settings)
    scene.render.filepath = str(path)
    assert bpy.ops.render.render(write_still=True, **options) == {"FINISHED"}
    return passes(path)


def passes(path: Path) -> dict[str, NDArray[np.float32]]:
    """The channels of a file, (height, width) float32 with the top row first.

    They are called "<pass>.<channel>" as in "Shadow Key.X"; those of other view layers than the
    first have the name of their layer before it.
    """
    found: dict[str, NDArray[np.float32]] = {}
    # Blender 5.0 writes a part for each pass; before there is one for all.
    for part in OpenEXR.File(str(path), separate_channels=True).parts:
        for name, channel in part.channels.items():
            found[name.removeprefix("ViewLayer.")] = channel.pixels
    return found
