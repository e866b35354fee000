# SPDX-License-Identifier: GPL-3.0-or-later
"""What the buttons do. Long ones go on in steps beside the user, or in one go from a script."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, ClassVar

import bmesh
import bpy
import numpy as np
from bpy.props import EnumProperty, IntProperty, StringProperty

import pyvocc

from . import compat, compositor, cycles_check, report
from .bake import AO, SHADOW
from .engine import VoccEngine

REPORT_TEXT = "Shadow Masks Report"

# Seconds between two steps of a long operator: time for Blender to draw and to hear ESC.
PAUSE = 0.02


class Setup(bpy.types.Operator):
    """Make a scene that renders a shadow mask for each light, and a node group for the compositor
    that uses them; or bring both up to date. Your own nodes and links are not touched"""

    bl_idname = "vocc.setup"
    bl_label = "Set Up Shadow Passes"
    bl_options: ClassVar[set[str]] = {"REGISTER", "UNDO"}

    def execute(self, context: bpy.types.Context) -> set[str]:
        source = compositor.pair_of(context.scene)[0]
        try:
            shadow = compositor.setup(source)
        except compositor.SetupError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        masks = len(list(compositor.masks_of(compositor.group_node(source))))
        text = f"{report.plural(masks, 'mask')} in the scene '{shadow.name}'"
        if not masks:
            self.report({"WARNING"}, f"{text}: there is no light in the render")
        elif compositor.is_applied(source):
            self.report({"INFO"}, f"{text}; their strengths are in the panel and in the compositor")
        else:
            node = compositor.group_node(source)
            self.report(
                {"INFO"}, f"{text}; link the node '{node.name}' in the compositor to use them"
            )
        return {"FINISHED"}


class RenderMasks(bpy.types.Operator):
    """Render the shadow masks alone, without the picture"""

    bl_idname = "vocc.render_masks"
    bl_label = "Render Masks"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        if _mask_scene(context) is None:
            cls.poll_message_set("Set up shadow passes first")
            return False
        return True

    def execute(self, context: bpy.types.Context) -> set[str]:
        return self._render(context, "EXEC_DEFAULT")

    def invoke(self, context: bpy.types.Context, _event: bpy.types.Event) -> set[str]:
        return self._render(context, "INVOKE_DEFAULT")

    def _render(self, context: bpy.types.Context, how: str) -> set[str]:
        try:
            bpy.ops.render.render(how, scene=_mask_scene(context).name)
        except RuntimeError as error:
            self.report({"ERROR"}, _plain(error))
            return {"CANCELLED"}
        return {"FINISHED"}


class Bake(bpy.types.Operator):
    """Bake into the active image texture, or colour attribute, of the selected meshes"""

    bl_idname = "vocc.bake"
    bl_label = "Bake Shadow Masks"
    bl_options: ClassVar[set[str]] = {"REGISTER", "UNDO"}

    type: EnumProperty(
        name="Type",
        items=(
            (SHADOW, "Shadow", "The mean mask of the selected lights; of all if none is selected"),
            (AO, "Ambient Occlusion", "The share of the sky that is not blocked"),
        ),
    )

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        if _mask_scene(context) is None:
            cls.poll_message_set("Set up shadow passes first")
            return False
        if context.mode != "OBJECT":
            cls.poll_message_set("Leave edit mode first")
            return False
        if not any(each.type == "MESH" for each in context.selected_objects):
            cls.poll_message_set("Select a mesh to bake")
            return False
        return True

    def execute(self, context: bpy.types.Context) -> set[str]:
        try:
            return self._bake(context, "EXEC_DEFAULT")
        except RuntimeError as error:
            self.report({"ERROR"}, _plain(error))
            return {"CANCELLED"}

    def invoke(self, context: bpy.types.Context, _event: bpy.types.Event) -> set[str]:
        if bpy.app.background:
            return self.execute(context)
        try:
            # Blender goes on by itself, with its own progress bar and ESC.
            self._bake(context, "INVOKE_DEFAULT")
        except RuntimeError as error:
            self.report({"ERROR"}, _plain(error))
            return {"CANCELLED"}
        return {"FINISHED"}

    def _bake(self, context: bpy.types.Context, how: str) -> set[str]:
        source, scene = context.scene, _mask_scene(context)
        layer = _same_layer(context.view_layer, scene)
        meshes = [each for each in context.selected_objects if each.type == "MESH"]
        active = context.active_object if context.active_object in meshes else meshes[0]
        settings = scene.render.bake
        if scene != source:
            # Selection is each scene's own: the engine looks which lights are selected.
            for each in layer.objects:
                if each.type in ("LIGHT", "MESH"):
                    each.select_set(
                        each.select_get(view_layer=context.view_layer), view_layer=layer
                    )
            layer.objects.active = active
        with context.temp_override(
            scene=scene,
            view_layer=layer,
            selected_objects=meshes,
            selected_editable_objects=meshes,
            active_object=active,
            object=active,
        ):
            return bpy.ops.object.bake(
                how,
                type=self.type,
                margin=settings.margin,
                margin_type=settings.margin_type,
                target=settings.target,
                use_clear=settings.use_clear,
            )


class SelectOpenEdges(bpy.types.Operator):
    """Select the edges where a mesh is open, in edit mode. A closed mesh has a face on both sides
    of each edge, and stops shadow rays inside it"""

    bl_idname = "vocc.select_open_edges"
    bl_label = "Select Open Edges"
    bl_options: ClassVar[set[str]] = {"REGISTER", "UNDO"}

    object: StringProperty(
        name="Object",
        description="Default: the active object",
        options={"SKIP_SAVE"},
    )

    @classmethod
    def description(cls, _context: bpy.types.Context, values: Any) -> str:
        name = f" of '{values.object}'" if values.object else ""
        return f"Select the edges{name} where the mesh is open, in edit mode"

    def execute(self, context: bpy.types.Context) -> set[str]:
        obj = context.view_layer.objects.get(self.object) if self.object else context.active_object
        problem = _cannot_edit(obj, self.object, context)
        if problem:
            self.report({"ERROR"}, problem)
            return {"CANCELLED"}
        if context.mode == "EDIT_MESH" and obj == context.active_object:
            obj.update_from_editmode()
        elif context.mode != "OBJECT":
            bpy.ops.object.mode_set(mode="OBJECT")
        mesh, is_changed = _mesh_to_check(obj, context)
        edges = open_edges(mesh)
        if not len(mesh.polygons):
            self.report({"INFO"}, f"'{obj.name}' has no faces")
            return {"FINISHED"}
        if not edges:
            why = " without its modifiers" if is_changed else ""
            self.report({"INFO"}, f"'{obj.name}' is closed{why}")
            return {"FINISHED"}
        _select_edges(obj, edges, context)
        note = " (of the mesh without its modifiers)" if is_changed else ""
        self.report({"INFO"}, f"{report.plural(len(edges), 'open edge')} of '{obj.name}'{note}")
        return {"FINISHED"}


class CheckAgainstCycles(bpy.types.Operator):
    """Compare the masks with the ratio of two Cycles renders, with and without shadows, in a small
    picture: of the selected lights, or of all. ESC stops"""

    bl_idname = "vocc.check_against_cycles"
    bl_label = "Check Against Cycles"

    size: IntProperty(
        name="Size",
        description="Longer edge of the picture in pixels, of the render border if there is one",
        default=160,
        min=16,
        soft_max=1024,
        subtype="PIXEL",
    )
    samples: IntProperty(
        name="Samples", description="Of each Cycles render", default=128, min=64, soft_max=4096
    )

    def execute(self, context: bpy.types.Context) -> set[str]:
        self._begin(context)
        try:
            for _ in self._steps:
                pass
        except _CHECK_ERRORS as error:
            self.report({"ERROR"}, _plain(error))
            return {"CANCELLED"}
        return self._finish()

    def invoke(self, context: bpy.types.Context, _event: bpy.types.Event) -> set[str]:
        if bpy.app.background:
            return self.execute(context)
        self._begin(context)
        manager = context.window_manager
        manager.progress_begin(0, 100)
        self._timer = manager.event_timer_add(PAUSE, window=context.window)
        context.workspace.status_text_set("Check against Cycles: ESC stops")
        manager.modal_handler_add(self)
        return {"RUNNING_MODAL"}

    def modal(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        if event.type == "ESC":
            self._end(context)
            self.report({"INFO"}, "Stopped")
            return {"CANCELLED"}
        if event.type != "TIMER":
            return {"RUNNING_MODAL"}
        try:
            done = next(self._steps)
        except StopIteration:
            self._end(context)
            return self._finish()
        except _CHECK_ERRORS as error:
            self._end(context)
            self.report({"ERROR"}, _plain(error))
            return {"CANCELLED"}
        context.window_manager.progress_update(round(100 * done))
        context.workspace.status_text_set(f"Check against Cycles: {100 * done:.0f} %, ESC stops")
        return {"RUNNING_MODAL"}

    def cancel(self, context: bpy.types.Context) -> None:
        self._end(context)

    def _begin(self, context: bpy.types.Context) -> None:
        scene = compositor.pair_of(context.scene)[0]
        chosen = [each for each in context.selected_objects if each.type == "LIGHT"]
        self._found: list[cycles_check.Comparison] = []
        self._steps: Iterator[float] = cycles_check.check(
            scene, chosen or None, size=self.size, samples=self.samples, found=self._found
        )

    def _end(self, context: bpy.types.Context) -> None:
        # Closed, it puts everything back.
        self._steps.close()
        context.window_manager.event_timer_remove(self._timer)
        context.window_manager.progress_end()
        context.workspace.status_text_set(None)

    def _finish(self) -> set[str]:
        for comparison in self._found:
            image = cycles_check.show(comparison)
            print(f"{comparison.line()}; image '{image.name}'")
        worst = max(self._found, key=lambda each: each.rms)
        self.report({"INFO"}, worst.line())
        return {"FINISHED"}


class PrintReport(bpy.types.Operator):
    """Write the last render's report to the console and to a text of this file"""

    bl_idname = "vocc.print_report"
    bl_label = "Full Report"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        if last_report(context.scene) is None:
            cls.poll_message_set("Render the masks first")
            return False
        return True

    def execute(self, context: bpy.types.Context) -> set[str]:
        lines = "\n".join(last_report(context.scene).lines())
        text = bpy.data.texts.get(REPORT_TEXT) or bpy.data.texts.new(REPORT_TEXT)
        text.from_string(lines + "\n")
        print(lines)
        self.report({"INFO"}, f"The report is in the text '{REPORT_TEXT}'")
        return {"FINISHED"}


_CHECK_ERRORS = (cycles_check.CheckError, ValueError, RuntimeError, MemoryError)


def last_report(scene: bpy.types.Scene) -> report.Report | None:
    """Of the last render of the scene's masks."""
    return report.LAST.get(compositor.settings_scene(scene).name)


def open_edges(mesh: bpy.types.Mesh) -> list[tuple[int, int]]:
    """The edges of a mesh where an odd number of faces meet, as pairs of its vertices.

    Vertices at one place count as one, as in the report: a seam in the mesh is not open.
    """
    corners = compat.corner_triangles(mesh)
    if not len(corners):
        return []
    positions = np.empty((len(mesh.vertices), 3), np.float32)
    mesh.vertices.foreach_get("co", positions.ravel())
    vertex_of_corner = np.empty(len(mesh.loops), np.int32)
    mesh.loops.foreach_get("vertex_index", vertex_of_corner)
    triangles = vertex_of_corner[corners]
    with pyvocc.Scene() as scene:
        scene.add_mesh(positions, triangles)
        scene.build()
        found = scene.open_edges(0)
    prim, edge = found.T
    pairs = np.stack([triangles[prim, edge], triangles[prim, (edge + 1) % 3]], axis=1)
    return [(int(a), int(b)) for a, b in pairs]


def _mesh_to_check(obj: bpy.types.Object, context: bpy.types.Context) -> tuple[Any, bool]:
    """The mesh as it renders if its vertices are those of edit mode, else without modifiers.

    Returns:
        The mesh, and whether modifiers make another one of it.
    """
    evaluated = obj.evaluated_get(context.evaluated_depsgraph_get()).data
    counts = [(len(each.vertices), len(each.loops)) for each in (evaluated, obj.data)]
    if counts[0] == counts[1]:
        return evaluated, False
    return obj.data, True


def _select_edges(
    obj: bpy.types.Object, edges: list[tuple[int, int]], context: bpy.types.Context
) -> None:
    if context.mode != "EDIT_MESH":
        for each in context.view_layer.objects.selected:
            each.select_set(False)
        obj.select_set(True)
        context.view_layer.objects.active = obj
        bpy.ops.object.mode_set(mode="EDIT")
    context.tool_settings.mesh_select_mode = (False, True, False)
    bpy.ops.mesh.reveal(select=False)
    bpy.ops.mesh.select_all(action="DESELECT")
    grid = bmesh.from_edit_mesh(obj.data)
    grid.verts.ensure_lookup_table()
    for pair in edges:
        edge = grid.edges.get([grid.verts[index] for index in pair])
        if edge is not None:
            edge.select_set(True)
    bmesh.update_edit_mesh(obj.data, loop_triangles=False, destructive=False)


def _cannot_edit(obj: Any, name: str, context: bpy.types.Context) -> str:
    """Why an object cannot be edited; "" if it can."""
    if obj is None:
        return (
            f"There is no object '{name}' in the view layer '{context.view_layer.name}'"
            if name
            else "There is no active object"
        )
    if obj.type != "MESH":
        return f"'{obj.name}' is not a mesh"
    if obj.library is not None or obj.data.library is not None:
        return f"'{obj.name}' is linked from another file"
    if not obj.visible_get(view_layer=context.view_layer):
        return f"'{obj.name}' is hidden"
    return ""


def _mask_scene(context: bpy.types.Context) -> bpy.types.Scene | None:
    """The scene that renders the masks of the current one."""
    scene = compositor.settings_scene(context.scene)
    return scene if scene.render.engine == VoccEngine.bl_idname else None


def _same_layer(layer: bpy.types.ViewLayer, scene: bpy.types.Scene) -> bpy.types.ViewLayer:
    return scene.view_layers.get(layer.name) or scene.view_layers[0]


def _plain(error: BaseException) -> str:
    """The text of an error as Blender raises them, which begins with "Error: "."""
    return str(error).removeprefix("Error: ").strip() or "There is not enough memory"


_CLASSES = (
    Setup,
    RenderMasks,
    Bake,
    SelectOpenEdges,
    CheckAgainstCycles,
    PrintReport,
)


def register() -> None:
    """Makes the operators known, and has shadow scenes follow their sources."""
    for each in _CLASSES:
        bpy.utils.register_class(each)
    compositor.register()


def unregister() -> None:
    """Takes them back."""
    compositor.unregister()
    for each in reversed(_CLASSES):
        bpy.utils.unregister_class(each)
