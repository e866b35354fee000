"""Makes docs/images/blender_composite.jpg: a picture without shadows, its masks, and both together.

.venv-blender-5.2/bin/python -m tools.blender_pictures
"""

from __future__ import annotations

import os
import sys
import tempfile
from pathlib import Path
from typing import Any

import bpy
import numpy as np

import blender_addon
from blender_addon import compositor

OUTPUT = Path(__file__).resolve().parents[1] / "docs" / "images" / "blender_composite.jpg"
WIDTH, HEIGHT = 480, 400


def make_scene() -> Any:
    """Solids on a floor under a warm and a cool light, both without shadows of their own."""
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    scene = bpy.context.scene
    bpy.ops.mesh.primitive_plane_add(size=40)
    bpy.ops.mesh.primitive_torus_add(
        location=(0, 0, 1.2),
        rotation=(1.1, 0.2, 0.4),
        major_radius=1.1,
        minor_radius=0.35,
        major_segments=128,
        minor_segments=64,
    )
    bpy.ops.mesh.primitive_monkey_add(size=1.6, location=(-2.2, 0.4, 0.85), rotation=(-0.5, 0, 0.5))
    bpy.context.object.modifiers.new("Subdivision", "SUBSURF").render_levels = 3
    bpy.ops.mesh.primitive_cylinder_add(vertices=128, location=(2.1, -0.6, 0.8), depth=1.6)
    for each in bpy.context.scene.objects:
        bpy.context.view_layer.objects.active = each
        if each.name != "Plane":
            for face in each.data.polygons:
                face.use_smooth = each.name != "Cylinder"
    for name, place, size, energy, colour in (
        ("Key", (3.5, -3.0, 5.0), 1.2, 500.0, (1.0, 0.85, 0.65)),
        ("Fill", (-5.0, -2.0, 3.5), 2.5, 260.0, (0.6, 0.75, 1.0)),
    ):
        light = bpy.data.lights.new(name, "AREA")
        light.size, light.energy, light.color, light.use_shadow = size, energy, colour, False
        lamp = bpy.data.objects.new(name, light)
        lamp.location = place
        look_at(lamp, (0, 0, 0.6))
        scene.collection.objects.link(lamp)
    camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    camera.location = (0.5, -9.5, 4.2)
    look_at(camera, (0, 0, 0.8))
    scene.collection.objects.link(camera)
    scene.camera = camera
    scene.render.engine = "CYCLES"
    scene.cycles.samples = 32
    scene.render.resolution_x, scene.render.resolution_y = WIDTH, HEIGHT
    return scene


def look_at(obj: Any, target: tuple[float, float, float]) -> None:
    """Turns the -z axis of an object to a place."""
    away = obj.location.copy()
    away -= type(away)(target)
    obj.rotation_euler = away.to_track_quat("Z", "Y").to_euler()


def picture(scene: Any, *, compositing: bool) -> Any:
    """The render as it is shown, (HEIGHT, WIDTH, 3), the lowest row first."""
    scene.render.use_compositing = compositing
    with tempfile.TemporaryDirectory() as folder:
        scene.render.image_settings.file_format = "PNG"
        scene.render.filepath = str(Path(folder) / "picture.png")
        bpy.ops.render.render(write_still=True, scene=scene.name)
        image = bpy.data.images.load(scene.render.filepath)
        pixels = np.empty(WIDTH * HEIGHT * 4, np.float32)
        image.pixels.foreach_get(pixels)
        bpy.data.images.remove(image)
    return pixels.reshape(HEIGHT, WIDTH, 4)[..., :3]


def write(pixels: Any) -> None:
    """Writes a picture (height, width, 3), the lowest row first."""
    height, width, _ = pixels.shape
    image = bpy.data.images.new("Sheet", width, height)
    image.pixels.foreach_set(np.dstack([pixels, np.ones((height, width))]).astype("f4").ravel())
    image.filepath_raw, image.file_format = str(OUTPUT), "JPEG"
    image.save()


def main() -> None:
    blender_addon.register()
    try:
        scene = make_scene()
        plain = picture(scene, compositing=False)
        shadow = compositor.setup(scene)
        shadow.vocc.use_all_lights = True
        shadow.vocc.samples = 32
        for mask in compositor.masks_of(compositor.group_node(scene)):
            mask.strength.default_value = 0.85
        together = picture(scene, compositing=True)
        masks = blender_addon.shadow_masks(scene, samples=32, all_lights=True)
        # Both at half size, one above the other.
        small = [
            each[::-1].reshape(HEIGHT // 2, 2, WIDTH // 2, 2).mean(axis=(1, 3))
            for each in (masks["Fill"], masks["Key"])
        ]
        column = np.repeat(np.vstack(small)[..., None], 3, axis=2)
        write(np.hstack([plain, column, together]))
        print(OUTPUT)
    finally:
        blender_addon.unregister()


if __name__ == "__main__":
    main()
    sys.stdout.flush()
    # Blender may hang when it exits as Python does.
    os._exit(0)
