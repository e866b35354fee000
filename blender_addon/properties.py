# SPDX-License-Identifier: GPL-3.0-or-later
"""The settings that a user sees, kept on scenes, objects and materials."""

from __future__ import annotations

import bpy
from bpy.props import (
    BoolProperty,
    EnumProperty,
    FloatProperty,
    IntProperty,
    PointerProperty,
)

from .data import Settings

# Most samples of a light, and of ambient occlusion, that the counts of pyvocc hold.
MOST_SAMPLES = 65534


class SceneProperties(bpy.types.PropertyGroup):
    """How a scene's masks are made."""

    samples: IntProperty(
        name="Samples",
        description="Shadow rays to each light for each sub-pixel",
        default=16,
        min=1,
        max=MOST_SAMPLES,
        soft_max=1024,
    )
    aa: IntProperty(
        name="Sub-Pixels",
        description=(
            "Points along an edge of a pixel: 2 makes 2 x 2 points for smooth edges, "
            "1 takes the centre of the pixel alone"
        ),
        default=2,
        min=1,
        max=16,
        soft_max=4,
    )
    use_shadow_masks: BoolProperty(
        name="Shadow Masks",
        description="A pass for each light: 1 is lit, 0 is dark",
        default=True,
    )
    weighting: EnumProperty(
        name="Weighting",
        description="What a mask between dark and lit means",
        items=(
            ("VISIBILITY", "Visibility", "Share of the light that the surface sees"),
            (
                "IRRADIANCE",
                "Irradiance",
                "Share of the light's energy that arrives: what a ratio of two renders gives",
            ),
        ),
        default="VISIBILITY",
    )
    use_all_lights: BoolProperty(
        name="All Lights",
        description=(
            "Make masks also for lights whose own Shadow is switched off, as if it were on. "
            "Cycles then renders without shadows and their noise, and the masks bring them back"
        ),
        default=False,
    )
    use_ao: BoolProperty(
        name="Ambient Occlusion",
        description="A pass with the unblocked share of the sky above each point",
        default=False,
    )
    ao_distance: FloatProperty(
        name="Distance",
        description="Surfaces farther away than this do not block",
        subtype="DISTANCE",
        default=1.0,
        min=1e-6,
        soft_max=100.0,
    )
    ao_samples: IntProperty(
        name="Samples",
        description="Ambient occlusion rays for each sub-pixel",
        default=16,
        min=1,
        max=MOST_SAMPLES,
        soft_max=1024,
    )
    bake_samples: IntProperty(
        name="Bake Samples",
        description="Rays to each light, or of ambient occlusion, for each texel",
        default=64,
        min=1,
        max=MOST_SAMPLES,
        soft_max=1024,
    )
    use_auto_offset: BoolProperty(
        name="Automatic Offset",
        description="Start shadow rays as near to the surface as the precision of the scene allows",
        default=True,
    )
    offset: FloatProperty(
        name="Offset",
        description="How far from the surface shadow rays start",
        subtype="DISTANCE",
        default=1e-4,
        min=0.0,
        soft_max=0.1,
        precision=5,
    )


class ObjectProperties(bpy.types.PropertyGroup):
    """What an object is to the masks."""

    exclude: BoolProperty(
        name="Exclude from Shadow Masks",
        description="The object casts no shadow into the masks; it still receives shadows",
        default=False,
    )


class MaterialProperties(bpy.types.PropertyGroup):
    """What a material is to the masks."""

    not_solid: BoolProperty(
        name="Not a Solid",
        description=(
            "Faces of this material cast no shadow into the masks, as leaves cut out by alpha "
            "should not; they still receive shadows"
        ),
        default=False,
    )


_GROUPS = (
    (SceneProperties, bpy.types.Scene),
    (ObjectProperties, bpy.types.Object),
    (MaterialProperties, bpy.types.Material),
)


def settings_of(scene: bpy.types.Scene) -> Settings:
    """The settings of a scene; the defaults where the add-on is not registered."""
    render = scene.render
    threads = render.threads if render.threads_mode == "FIXED" else 0
    values = getattr(scene, "vocc", None)
    if values is None:
        return Settings(threads=threads)
    return Settings(
        samples=values.samples,
        aa=values.aa,
        masks=values.use_shadow_masks,
        ao=values.use_ao,
        ao_distance=values.ao_distance,
        ao_samples=values.ao_samples,
        irradiance=values.weighting == "IRRADIANCE",
        all_lights=values.use_all_lights,
        offset=None if values.use_auto_offset else values.offset,
        threads=threads,
    )


def register() -> None:
    """Adds the settings to scenes, objects and materials, as `vocc`."""
    for group, owner in _GROUPS:
        bpy.utils.register_class(group)
        owner.vocc = PointerProperty(type=group)


def unregister() -> None:
    """Takes them away again; values stay in the file."""
    for group, owner in reversed(_GROUPS):
        del owner.vocc
        bpy.utils.unregister_class(group)
