"""What a user does with the extension, in a Blender of its own.

    package_session.py SITE STEPS ZIP EXR JSON

SITE is a folder with bpy and what it needs, but neither pyvocc nor cffi; STEPS are names of the
functions below, separated by commas, done in that order. EXR and JSON are written: the masks, and
what was found out.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

site, steps, archive, masks, findings = sys.argv[1:]
sys.path.append(site)

import bpy  # noqa: E402 - from the folder that was just added

REPOSITORY = "user_default"
ID = "volumetric_occluders"
MODULE = f"bl_ext.{REPOSITORY}.{ID}"

found: dict[str, Any] = {}


def install() -> None:
    bpy.ops.extensions.package_install_files(
        filepath=archive, repo=REPOSITORY, enable_on_install=False
    )


def enable() -> None:
    bpy.ops.preferences.addon_enable(module=MODULE)


def enable_in_vain() -> None:
    try:
        enable()
    except RuntimeError as error:
        found["error"] = str(error)


def look() -> None:
    """Where the modules come from, and whether the engine is there."""
    names = (MODULE, "pyvocc", "pyvocc._vocc", "cffi", "_cffi_backend")
    found["files"] = {name: getattr(sys.modules.get(name), "__file__", None) for name in names}
    found["engine"] = has_engine()


def render() -> None:
    """A box over a floor, lit by a sun from straight above; 16 x 16 pixels from above as well."""
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    scene = bpy.context.scene
    bpy.ops.mesh.primitive_plane_add(size=8)
    bpy.ops.mesh.primitive_cube_add(size=1, location=(0, 0, 2))
    bpy.ops.object.light_add(type="SUN", location=(0, 0, 9), rotation=(0, 0.5, 0))
    bpy.context.object.name = "Key"
    bpy.context.object.data.angle = 0
    bpy.ops.object.camera_add(location=(0, 0, 6))
    scene.camera = bpy.context.object
    scene.render.engine = "VOCC"
    scene.render.resolution_x = scene.render.resolution_y = 16
    scene.render.resolution_percentage = 100
    settings = scene.render.image_settings
    if hasattr(settings, "media_type"):
        settings.media_type = "MULTI_LAYER_IMAGE"
    settings.file_format = "OPEN_EXR_MULTILAYER"
    scene.render.filepath = masks
    bpy.ops.render.render(write_still=True)


def disable() -> None:
    bpy.ops.preferences.addon_disable(module=MODULE)
    found["engine"] = has_engine()


def remove() -> None:
    index = bpy.context.preferences.extensions.repos.find("User Default")
    bpy.ops.extensions.package_uninstall(repo_index=index, pkg_id=ID)


def has_engine() -> bool:
    engines = bpy.types.RenderEngine.__subclasses__()
    ours = (engine for engine in engines if engine.__module__.startswith(MODULE))
    return any(engine.is_registered for engine in ours)


for step in steps.split(","):
    globals()[step]()
Path(findings).write_text(json.dumps(found), encoding="utf-8")
