# SPDX-License-Identifier: GPL-3.0-or-later
"""What differs between Blender 4.2 and 5.2; nothing else in the add-on asks for the version."""

from __future__ import annotations

import ctypes
from collections.abc import Mapping
from typing import Any

import bpy
import numpy as np
from numpy.typing import NDArray

EEVEE = "BLENDER_EEVEE" if bpy.app.version >= (5, 0) else "BLENDER_EEVEE_NEXT"


def corner_triangles(mesh: Any) -> NDArray[np.int32]:
    """The corners of a mesh's loop triangles, (m, 3), a copy."""
    if not has_packed_triangles(mesh):
        return corner_triangles_by_rna(mesh)
    return _corners_in_memory(mesh).copy()


def has_packed_triangles(mesh: Any) -> bool:
    """Whether the loop triangles are three int32 each, side by side, as in 4.2 to 5.2."""
    if not (4, 2) <= bpy.app.version[:2] <= (5, 2):
        return False
    mesh.calc_loop_triangles()
    if not mesh.loop_triangles:
        return False
    corners = _corners_in_memory(mesh)
    return all(tuple(corners[i]) == tuple(mesh.loop_triangles[i].loops) for i in (0, -1))


def _corners_in_memory(mesh: Any) -> NDArray[np.int32]:
    count = len(mesh.loop_triangles)
    address = mesh.loop_triangles[0].as_pointer()
    return np.ctypeslib.as_array((ctypes.c_int32 * 3 * count).from_address(address))


def corner_triangles_by_rna(mesh: Any) -> NDArray[np.int32]:
    """As `corner_triangles`, a hundred times slower, without a look at Blender's memory."""
    mesh.calc_loop_triangles()
    corners = np.empty((len(mesh.loop_triangles), 3), np.int32)
    mesh.loop_triangles.foreach_get("loops", corners.ravel())
    return corners


def triangle_materials(mesh: Any) -> NDArray[np.int32]:
    """The material index of each loop triangle of a mesh, (m,)."""
    mesh.calc_loop_triangles()
    count = len(mesh.loop_triangles)
    attribute = mesh.attributes.get("material_index")
    if attribute is None:  # all are 0
        return np.zeros(count, np.int32)
    face_material = np.empty(len(mesh.polygons), np.int32)
    attribute.data.foreach_get("value", face_material)
    face = np.empty(count, np.int32)
    mesh.loop_triangle_polygons.foreach_get("value", face)
    return face_material[face]


def is_portal(light: Any) -> bool:
    """An area light that only tells Cycles where the sky is seen."""
    return bool(getattr(getattr(light, "cycles", None), "is_portal", False))


def casts_shadow(light: Any) -> bool:
    """Whether anything blocks a light."""
    return bool(light.use_shadow)


def compositor_tree(scene: Any) -> tuple[Any, Any]:
    """The scene's compositor tree, made if there is none, and the input of its output node."""
    if bpy.app.version >= (5, 0):
        tree = scene.compositing_node_group
        if tree is None:
            tree = bpy.data.node_groups.new(f"{scene.name} Compositing", "CompositorNodeTree")
            scene.compositing_node_group = tree
        if not any(getattr(item, "in_out", "") == "OUTPUT" for item in tree.interface.items_tree):
            tree.interface.new_socket("Image", in_out="OUTPUT", socket_type="NodeSocketColor")
        kind = "NodeGroupOutput"
    else:
        scene.use_nodes = True
        tree = scene.node_tree
        kind = "CompositorNodeComposite"
    found = [node for node in tree.nodes if node.bl_idname == kind]
    # Where there are several Blender uses the active one.
    node = next((node for node in found if getattr(node, "is_active_output", True)), None)
    return tree, (node or next(iter(found), None) or tree.nodes.new(kind)).inputs[0]


def set_multilayer_exr(image_settings: Any) -> None:
    """Has a scene's or an output node's pictures written as multilayer EXR."""
    if hasattr(image_settings, "media_type"):  # since 5.0
        image_settings.media_type = "MULTI_LAYER_IMAGE"
    image_settings.file_format = "OPEN_EXR_MULTILAYER"


def bake_texels(
    passes: Mapping[str, Any], width: int, height: int
) -> tuple[NDArray[np.int32], NDArray[np.float32], NDArray[np.float32]]:
    """What each texel of a bake shows: loop triangle (-1: nothing), weights of its corners 0, 1.

    Args:
        passes: of the render result that `RenderEngine.bake` begins, by name.
        width, height: as given to `RenderEngine.bake`.
    """
    texels = passes["BakePrimitive"]
    values = np.empty(width * height * texels.channels, np.float32)
    texels.rect.foreach_get(values)
    values = values.reshape(height, width, texels.channels)
    whole = values.view(np.int32)
    if texels.channels == 3:  # u, v, primitive: since 4.5
        return whole[..., 2], values[..., 0], values[..., 1]
    return whole[..., 1], values[..., 2], values[..., 3]  # object, primitive, u, v


def existing_compositor(scene: Any) -> Any | None:
    """The scene's compositor tree, used or not; None if it has never had one."""
    if bpy.app.version >= (5, 0):
        return scene.compositing_node_group
    return scene.node_tree


def composites(scene: Any) -> bool:
    """A render of the scene goes through its compositor tree."""
    used = existing_compositor(scene) is not None
    if bpy.app.version < (5, 0):
        used = used and scene.use_nodes
    return bool(used and scene.render.use_compositing)


def new_mix(tree: Any, blend_type: str) -> tuple[Any, Any, Any, Any, Any]:
    """A node that mixes colours in the compositor, its sockets factor, a and b, and its output."""
    if bpy.app.version < (5, 0):
        node = tree.nodes.new("CompositorNodeMixRGB")
        node.blend_type = blend_type
        return node, node.inputs[0], node.inputs[1], node.inputs[2], node.outputs[0]
    node = tree.nodes.new("ShaderNodeMix")
    node.data_type = "RGBA"
    node.blend_type = blend_type
    factor, a, b = (socket for socket in node.inputs if socket.enabled)
    return node, factor, a, b, next(socket for socket in node.outputs if socket.enabled)


def new_blur(tree: Any) -> tuple[Any, Any, Any]:
    """A Gaussian blur, its input, and the input for its size in pixels."""
    node = tree.nodes.new("CompositorNodeBlur")
    if bpy.app.version < (4, 5):
        # The input is a factor of these.
        node.size_x = node.size_y = 1
    return node, node.inputs["Image"], node.inputs["Size"]


def set_pass(render_pass: Any, values: NDArray[np.float32]) -> None:
    """Fills a pass of a render result: (h, w) or (h, w, channels), the lowest row first."""
    render_pass.rect.foreach_set(np.ascontiguousarray(values).ravel())


def set_exr(image_settings: Any) -> None:
    """Has a scene's pictures written as EXR in full precision."""
    if hasattr(image_settings, "media_type"):  # since 5.0
        image_settings.media_type = "IMAGE"
    image_settings.file_format = "OPEN_EXR"
    image_settings.color_mode, image_settings.color_depth = "RGBA", "32"


def make_diffuse(material: Any) -> None:
    """Makes a new material a white diffuse one; what is shaded smooth looks flat in it."""
    if bpy.app.version < (5, 0):
        material.use_nodes = True
    tree = material.node_tree
    tree.nodes.clear()
    white = tree.nodes.new("ShaderNodeBsdfDiffuse")
    output = tree.nodes.new("ShaderNodeOutputMaterial")
    white.inputs["Color"].default_value = (1.0, 1.0, 1.0, 1.0)
    tree.links.new(white.outputs[0], output.inputs["Surface"])
    geometry = tree.nodes.new("ShaderNodeNewGeometry")
    tree.links.new(geometry.outputs["True Normal"], white.inputs["Normal"])


def shadow_switches(light: Any) -> list[tuple[Any, str]]:
    """The properties that all have to be set for a light to cast a shadow."""
    switches = [(light, "use_shadow")]
    cycles = getattr(light, "cycles", None)
    if hasattr(cycles, "cast_shadow"):  # up to 4.2
        switches.append((cycles, "cast_shadow"))
    return switches


def bring_up_to_date(layer: Any) -> None:
    """In 5.2 a view layer knows its collections only after it was asked for the active one."""
    layer.active_layer_collection  # noqa: B018
