"""Camera rays against Cycles: the point that it sees at the centre of each pixel."""

from __future__ import annotations

import math
from pathlib import Path
from types import ModuleType
from typing import Any

import bpy
import numpy as np
import pytest
from numpy.typing import NDArray

# Positions are written as colours, which must not be negative.
SHIFT = 64.0

CASES: dict[str, dict[str, Any]] = {
    "perspective": {},
    "portrait": {"resolution": (40, 64)},
    "horizontal fit": {"sensor_fit": "HORIZONTAL", "resolution": (40, 64)},
    "vertical fit": {"sensor_fit": "VERTICAL", "sensor_height": 20.0},
    "shift": {"shift_x": 0.3, "shift_y": -0.2},
    "shift, portrait": {"shift_x": 0.3, "shift_y": -0.2, "resolution": (40, 64)},
    "shift, vertical fit": {"sensor_fit": "VERTICAL", "shift_x": -0.4, "shift_y": 0.1},
    "wide pixels": {"pixel_aspect_x": 2.0},
    "tall pixels": {"pixel_aspect_y": 1.5, "shift_x": 0.2, "shift_y": 0.1},
    "tall pixels, vertical fit": {"pixel_aspect_y": 1.5, "sensor_fit": "VERTICAL"},
    "field of view": {"angle": math.radians(100)},
    "scaled": {"scale": (3.0, 0.5, 0.2)},
    "mirrored": {"scale": (-1.0, 1.0, 1.0)},
    "percentage": {"percentage": 37, "resolution": (101, 77)},
    "orthographic": {"type": "ORTHO"},
    "orthographic, portrait": {"type": "ORTHO", "resolution": (40, 64), "shift_y": 0.2},
    "orthographic, scaled": {"type": "ORTHO", "scale": (2.0, 2.0, 0.5), "shift_x": 0.1},
    "orthographic, tall pixels": {"type": "ORTHO", "pixel_aspect_y": 1.5, "sensor_fit": "VERTICAL"},
    "cut by the near plane": {"clip_start": 3.0},
    "orthographic, cut by the near plane": {"type": "ORTHO", "clip_start": 3.0},
}


def shows_its_position() -> bpy.types.Material:
    material = bpy.data.materials.new("Position")
    if bpy.app.version < (5, 0):
        material.use_nodes = True
    nodes, link = material.node_tree.nodes, material.node_tree.links.new
    nodes.clear()
    add = nodes.new("ShaderNodeVectorMath")
    add.inputs[1].default_value = (SHIFT, SHIFT, SHIFT)
    emission, output = nodes.new("ShaderNodeEmission"), nodes.new("ShaderNodeOutputMaterial")
    link(nodes.new("ShaderNodeNewGeometry").outputs["Position"], add.inputs[0])
    link(add.outputs[0], emission.inputs["Color"])
    link(emission.outputs[0], output.inputs["Surface"])
    return material


def positions_by_cycles(scene: bpy.types.Scene, file: Path) -> NDArray[np.float64]:
    """(height, width, 3), the lowest row first."""
    scene.render.engine = "CYCLES"
    # The first sample of a pixel is at its centre.
    scene.cycles.samples = 1
    scene.cycles.use_denoising = False
    scene.render.image_settings.file_format = "OPEN_EXR"
    scene.render.image_settings.color_depth = "32"
    scene.render.filepath = str(file)
    bpy.ops.render.render(write_still=True)
    image = bpy.data.images.load(str(file))
    image.colorspace_settings.name = "Non-Color"
    width, height = image.size
    values = np.empty((height, width, image.channels), np.float32)
    image.pixels.foreach_get(values.ravel())
    return values[..., :3].astype(np.float64) - SHIFT


@pytest.mark.parametrize("case", CASES)
def test_rays_meet_what_cycles_sees(
    addon: ModuleType, empty: bpy.types.Scene, tmp_path: Path, case: str
) -> None:
    from blender_addon.camera import camera_rays, view_of

    values = dict(CASES[case])
    render = empty.render
    render.resolution_x, render.resolution_y = values.pop("resolution", (64, 40))
    render.resolution_percentage = values.pop("percentage", 100)
    for name in ("pixel_aspect_x", "pixel_aspect_y"):
        setattr(render, name, values.pop(name, 1.0))
    camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    camera.location = (1, -2, 3)
    camera.rotation_euler = (1.1, 0.2, 0.7)
    camera.scale = values.pop("scale", (1, 1, 1))
    camera.data.ortho_scale = 3.0
    for name, value in values.items():
        setattr(camera.data, name, value)
    empty.collection.objects.link(camera)
    empty.camera = camera

    # A far wall, not square to the camera, and a near one that the near plane cuts.
    material = shows_its_position()
    axes = camera.rotation_euler.to_matrix()
    for size, tilt, depth in ((60.0, 0.3, 12.0), (4.0, 1.2, 3.0)):
        bpy.ops.mesh.primitive_plane_add(size=size)
        wall = bpy.context.object
        wall.data.materials.append(material)
        wall.rotation_euler = camera.rotation_euler
        wall.rotation_euler.rotate_axis("X", tilt)
        wall.location = camera.location - depth * axes.col[2]

    seen = positions_by_cycles(empty, tmp_path / "position.exr")
    height, width = seen.shape[:2]
    evaluated = camera.evaluated_get(bpy.context.evaluated_depsgraph_get())
    view = view_of(empty, evaluated, width, height)
    y, x = np.mgrid[:height, :width] + 0.5
    org, dir = camera_rays(view, x.ravel(), y.ravel())

    to_point = seen.reshape(-1, 3) - org
    along = np.einsum("ij,ij->i", to_point, dir) / np.einsum("ij,ij->i", dir, dir)
    beside = np.linalg.norm(to_point - along[:, None] * dir, axis=1)
    depth = view.near + along
    pixel = min(view.right[0] / width, view.up[1] / height)
    if not view.is_orthographic:
        pixel = pixel * depth
    assert np.ptp(depth) > 1, "the scene is too simple for this test"
    assert depth.min() > view.near - 1e-4
    assert (beside / pixel).max() < 0.01
