# SPDX-License-Identifier: GPL-3.0-or-later
"""The panels: in the render properties, in the 3D view's sidebar, of objects and of materials."""

from __future__ import annotations

import textwrap
from typing import Any, ClassVar

import bpy

from . import compat, compositor, cycles_check, report
from .bake import AO, SHADOW
from .engine import VoccEngine
from .operators import last_report

# Rows of a list before the panel says how many more there are.
LISTED = 12

# Pixels of a character of text, and of what is beside a line of it, at a resolution scale of 1.
CHARACTER, BESIDE = 6.3, 44

# Triangles of an open object from which on it is worth closing.
MANY = 1000


class _Properties:
    bl_space_type = "PROPERTIES"
    bl_region_type = "WINDOW"
    bl_context = "render"


class _Sidebar:
    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "Shadows"


class _Main:
    bl_label = "Shadow Masks"

    def draw(self, context: bpy.types.Context) -> None:
        layout, line = self.layout, _line(context)
        scene, shadow = compositor.pair_of(context.scene)
        if shadow is None and scene.render.engine != VoccEngine.bl_idname:
            _big(layout).operator("vocc.setup", icon="LIGHT")
            return
        if shadow is not None and not compositor.is_current(scene):
            _big(layout).operator("vocc.setup", text="Update Shadow Passes", icon="FILE_REFRESH")
            layout.operator("vocc.render_masks", icon="RENDER_STILL")
        else:
            _big(layout).operator("vocc.render_masks", icon="RENDER_STILL")
        _draw_warnings(layout, line, scene, shadow, last_report(context.scene))


class _Sub:
    bl_options: ClassVar[set[str]] = {"DEFAULT_CLOSED"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return _renders_masks(context.scene)


class _Passes(_Sub):
    bl_label = "Passes"
    bl_options: ClassVar[set[str]] = set()

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        values = compositor.settings_scene(context.scene).vocc
        layout.prop(values, "use_shadow_masks")
        fields = _fields(layout)
        fields.active = values.use_shadow_masks
        fields.prop(values, "samples")
        fields.prop(values, "weighting")
        fields.prop(values, "use_all_lights")
        layout.prop(values, "use_ao")
        fields = _fields(layout)
        fields.active = values.use_ao
        fields.prop(values, "ao_distance")
        fields.prop(values, "ao_samples")
        layout.separator()
        _fields(layout).prop(values, "aa")
        layout.prop(values, "use_auto_offset")
        if not values.use_auto_offset:
            _fields(layout).prop(values, "offset")


class _Compositing(_Sub):
    bl_label = "Compositing"
    bl_options: ClassVar[set[str]] = set()

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return compositor.group_node(compositor.pair_of(context.scene)[0]) is not None

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        scene = compositor.pair_of(context.scene)[0]
        masks = list(compositor.masks_of(compositor.group_node(scene)))
        layout.active = compositor.is_applied(scene)
        for mask in masks[:LISTED]:
            split = layout.split(factor=0.4, align=True)
            split.label(text=compositor.title_of(mask.name))
            row = split.row(align=True)
            row.prop(mask.strength, "default_value", text="", slider=True)
            tint = row.row(align=True)
            tint.ui_units_x = 1.5
            tint.prop(mask.tint, "default_value", text="")
            row.prop(mask.soften, "default_value", text="px")
        _draw_more(layout, len(masks), "in the compositor")


class _Bake(_Sub):
    bl_label = "Bake"

    def draw(self, context: bpy.types.Context) -> None:
        scene = compositor.settings_scene(context.scene)
        column = self.layout.column(align=True)
        column.operator("vocc.bake", text="Bake Shadow", icon="RENDER_STILL").type = SHADOW
        column.operator("vocc.bake", text="Bake Occlusion", icon="RENDER_STILL").type = AO
        _draw_texts(self.layout, _line(context), _bake_target(context))
        layout = _fields(self.layout)
        layout.prop(scene.vocc, "bake_samples", text="Samples")
        settings = scene.render.bake
        layout.prop(settings, "target")
        if settings.target == "IMAGE_TEXTURES":
            layout.prop(settings, "use_clear", text="Clear Image")
            layout.prop(settings, "margin_type")
            layout.prop(settings, "margin")


class _Report(_Sub):
    bl_label = "Last Render"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return last_report(context.scene) is not None

    def draw(self, context: bpy.types.Context) -> None:
        layout, line = self.layout, _line(context)
        found = last_report(context.scene)
        _draw_texts(
            layout,
            line,
            f"{found.total_seconds:.2f} s for {report.plural(len(found.masks), 'mask')}, "
            f"{found.size[0]} x {found.size[1]}",
            f"{report.count_text(found.triangles)} triangles",
            f"{len(found.closed)} of {report.plural(len(found.objects), 'object')} closed",
        )
        for part in found.open[:LISTED]:
            row = layout.row()
            _draw_wrapped(row, line - 5, f"{part.name}: {part.why}", "MESH_DATA")
            if part.open_edges:
                row.operator(
                    "vocc.select_open_edges", text="", icon="RESTRICT_SELECT_OFF"
                ).object = part.name
        _draw_more(layout, len(found.open))
        for name, reason in found.left_out[:LISTED]:
            _draw_wrapped(layout, line, f"{name}: {reason}", "GHOST_DISABLED")
        _draw_more(layout, len(found.left_out))
        if found.rays:
            _draw_texts(
                layout,
                line,
                f"{report.count_text(found.rays)} rays, "
                f"{found.mrays_per_second:.1f} million a second",
            )
            total = sum(found.settled.values())
            _draw_table(
                layout,
                {
                    rule: f"{100 * count / total:.1f} %"
                    for rule, count in found.settled.items()
                    if count
                },
            )
        _draw_table(
            layout, {stage.title(): f"{time:.2f} s" for stage, time in found.seconds.items()}
        )
        layout.operator("vocc.print_report", icon="TEXT")


class _Check(_Sub):
    bl_label = "Check"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return _renders_masks(context.scene) and hasattr(context.scene, "cycles")

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        layout.operator("vocc.check_against_cycles", icon="VIEWZOOM")
        found = cycles_check.LAST.get(compositor.pair_of(context.scene)[0].name, ())
        for comparison in found[:LISTED]:
            column = layout.column(align=True)
            column.label(text=comparison.light, icon="LIGHT")
            if comparison.pixels:
                column.label(text=f"differs by {comparison.rms:.4f} (RMS)")
                column.label(text=f"noise of Cycles {comparison.noise:.4f}")
            else:
                column.label(text="lights nothing that is seen")
        _draw_more(layout, len(found))


class RenderPanel(_Properties, _Main, bpy.types.Panel):
    bl_idname = "VOCC_PT_render"


class RenderPassesPanel(_Properties, _Passes, bpy.types.Panel):
    bl_idname = "VOCC_PT_render_passes"
    bl_parent_id = "VOCC_PT_render"


class RenderCompositingPanel(_Properties, _Compositing, bpy.types.Panel):
    bl_idname = "VOCC_PT_render_compositing"
    bl_parent_id = "VOCC_PT_render"


class RenderBakePanel(_Properties, _Bake, bpy.types.Panel):
    bl_idname = "VOCC_PT_render_bake"
    bl_parent_id = "VOCC_PT_render"


class RenderReportPanel(_Properties, _Report, bpy.types.Panel):
    bl_idname = "VOCC_PT_render_report"
    bl_parent_id = "VOCC_PT_render"


class RenderCheckPanel(_Properties, _Check, bpy.types.Panel):
    bl_idname = "VOCC_PT_render_check"
    bl_parent_id = "VOCC_PT_render"


class ViewPanel(_Sidebar, _Main, bpy.types.Panel):
    bl_idname = "VOCC_PT_view"


class ViewPassesPanel(_Sidebar, _Passes, bpy.types.Panel):
    bl_idname = "VOCC_PT_view_passes"
    bl_parent_id = "VOCC_PT_view"


class ViewCompositingPanel(_Sidebar, _Compositing, bpy.types.Panel):
    bl_idname = "VOCC_PT_view_compositing"
    bl_parent_id = "VOCC_PT_view"


class ViewBakePanel(_Sidebar, _Bake, bpy.types.Panel):
    bl_idname = "VOCC_PT_view_bake"
    bl_parent_id = "VOCC_PT_view"


class ViewReportPanel(_Sidebar, _Report, bpy.types.Panel):
    bl_idname = "VOCC_PT_view_report"
    bl_parent_id = "VOCC_PT_view"


class ViewCheckPanel(_Sidebar, _Check, bpy.types.Panel):
    bl_idname = "VOCC_PT_view_check"
    bl_parent_id = "VOCC_PT_view"


class ObjectPanel(bpy.types.Panel):
    bl_idname = "VOCC_PT_object"
    bl_label = "Shadow Masks"
    bl_space_type = "PROPERTIES"
    bl_region_type = "WINDOW"
    bl_context = "object"
    bl_options: ClassVar[set[str]] = {"DEFAULT_CLOSED"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        # What has a surface.
        return context.object is not None and context.object.type in _SURFACES

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        layout.prop(context.object.vocc, "exclude")
        found = last_report(context.scene)
        parts = found.objects if found is not None else ()
        part = next((each for each in parts if each.name == context.object.name), None)
        if part is None:
            return
        if part.closed:
            layout.label(text="Closed: stops shadow rays inside", icon="CHECKMARK")
        else:
            _draw_wrapped(layout, _line(context), part.why, "INFO")
        if part.open_edges:
            layout.operator("vocc.select_open_edges", icon="EDGESEL").object = part.name


class MaterialPanel(bpy.types.Panel):
    bl_idname = "VOCC_PT_material"
    bl_label = "Shadow Masks"
    bl_space_type = "PROPERTIES"
    bl_region_type = "WINDOW"
    bl_context = "material"
    bl_options: ClassVar[set[str]] = {"DEFAULT_CLOSED"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return context.material is not None

    def draw(self, context: bpy.types.Context) -> None:
        self.layout.prop(context.material.vocc, "not_solid")


_SURFACES = ("MESH", "CURVE", "SURFACE", "META", "FONT")

_CLASSES = (
    RenderPanel,
    RenderPassesPanel,
    RenderCompositingPanel,
    RenderBakePanel,
    RenderReportPanel,
    RenderCheckPanel,
    ViewPanel,
    ViewPassesPanel,
    ViewCompositingPanel,
    ViewBakePanel,
    ViewReportPanel,
    ViewCheckPanel,
    ObjectPanel,
    MaterialPanel,
)


@bpy.app.handlers.persistent
def _redraw(*_: Any) -> None:
    """Shows the report of a render, for which Blender does not draw panels anew."""
    for window in bpy.context.window_manager.windows:
        for area in window.screen.areas:
            if area.type in ("PROPERTIES", "VIEW_3D"):
                area.tag_redraw()


_HANDLERS = (bpy.app.handlers.render_complete, bpy.app.handlers.render_cancel)


def register() -> None:
    """Makes the panels known to Blender."""
    for each in _CLASSES:
        bpy.utils.register_class(each)
    for handlers in _HANDLERS:
        handlers.append(_redraw)


def unregister() -> None:
    """Takes them back."""
    for handlers in _HANDLERS:
        handlers.remove(_redraw)
    for each in reversed(_CLASSES):
        bpy.utils.unregister_class(each)


def _renders_masks(scene: Any) -> bool:
    return compositor.settings_scene(scene).render.engine == VoccEngine.bl_idname


def _big(layout: Any) -> Any:
    row = layout.row()
    row.scale_y = 1.5
    return row


def _fields(layout: Any) -> Any:
    """Labels to the left, values to the right."""
    column = layout.column()
    column.use_property_split = True
    column.use_property_decorate = False
    return column


def _draw_warnings(
    layout: Any, line: int, scene: Any, shadow: Any | None, found: Any | None
) -> None:
    """What keeps the masks from being what the user expects."""
    if scene.camera is None:
        layout.label(text="The scene has no camera", icon="ERROR")
    if shadow is not None and not compositor.is_applied(scene):
        _draw_wrapped(layout, line, _why_not_applied(scene), "INFO")
    if found is None:
        return
    for notice in found.notices[:LISTED]:
        _draw_wrapped(layout, line, notice, "ERROR")
    _draw_more(layout, len(found.notices))
    if found.left_out:
        names = ", ".join(dict(found.left_out))
        _draw_wrapped(layout, line, f"Left out: {names}", "ERROR")
    slow = [part.name for part in found.open if part.triangles >= MANY]
    if slow:
        _draw_wrapped(layout, line, f"Open, so slower: {', '.join(slow)}", "INFO")


def _why_not_applied(scene: Any) -> str:
    node = compositor.group_node(scene)
    if node is None:
        return "The masks' node is gone: update brings it back"
    if not compat.composites(scene):
        return "The compositor is off: the picture stays as it is"
    return f"Link the node '{node.name}' in the compositor"


def _bake_target(context: Any) -> str:
    lights = [each for each in context.selected_objects if each.type == "LIGHT"]
    meshes = [each for each in context.selected_objects if each.type == "MESH"]
    of = report.plural(len(lights), "selected light") if lights else "all lights"
    objects = f"{len(meshes)} selected mesh" + ("" if len(meshes) == 1 else "es")
    return f"{objects}, {of}"


def _line(context: Any) -> int:
    """How many characters fit a line of text in the panel; Blender cuts what is longer."""
    if context.region is None:
        return 40
    scale = context.preferences.system.ui_scale
    return max(16, int((context.region.width / scale - BESIDE) / CHARACTER))


def _draw_texts(layout: Any, line: int, *texts: str) -> None:
    column = layout.column(align=True)
    for text in texts:
        for part in textwrap.wrap(text, line):
            column.label(text=part)


def _draw_table(layout: Any, rows: dict[str, str]) -> None:
    column = layout.column(align=True)
    for name, value in rows.items():
        split = column.split(factor=0.7)
        split.label(text=name)
        right = split.row()
        right.alignment = "RIGHT"
        right.label(text=value)


def _draw_wrapped(layout: Any, line: int, text: str, icon: str) -> None:
    column = layout.column(align=True)
    for index, part in enumerate(textwrap.wrap(text, line)[:LISTED]):
        column.label(text=part, icon="BLANK1" if index else icon)


def _draw_more(layout: Any, count: int, where: str = "in the full report") -> None:
    if count > LISTED:
        layout.label(text=f"and {count - LISTED} more {where}")
