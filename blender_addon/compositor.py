# SPDX-License-Identifier: GPL-3.0-or-later
"""The shadow scene beside a scene, and the node group that puts its masks to use.

The shadow scene shares the objects of its source scene and is rendered by this add-on's engine.
It points at its source, and at its node group: names are the user's to change.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import Any, NamedTuple

import bpy

from . import compat
from .engine import VoccEngine, light_names
from .names import AO_PASS, PREFIX, pass_names

GROUP_NAME = "Shadow Masks"

_SOURCE = "vocc_source"
_MIRROR = "vocc_mirror"
_GROUP = "vocc_group"

# Sockets of the node group for each mask. Strength 0 leaves a picture as it is.
STRENGTH, TINT, SOFTEN = "Strength", "Tint", "Soften"
_SETTINGS = ((STRENGTH, "Float"), (TINT, "Color"), (SOFTEN, "Float"))

# The group inside it that applies one mask, and the input of that group for the mask.
MASK_GROUP_NAME = "Shadow Mask"
MASK = "Mask"

_SCENE_SETTINGS = ("camera", "world", "frame_start", "frame_end", "frame_step", "frame_current")
_RENDER_SETTINGS = (
    "resolution_x",
    "resolution_y",
    "resolution_percentage",
    "pixel_aspect_x",
    "pixel_aspect_y",
    "use_border",
    "border_min_x",
    "border_max_x",
    "border_min_y",
    "border_max_y",
    "use_crop_to_border",
    "fps",
    "fps_base",
    "threads_mode",
    "threads",
    "use_simplify",
    "simplify_subdivision_render",
    "simplify_child_particles_render",
)
_COLLECTION_SETTINGS = ("exclude", "hide_viewport", "holdout", "indirect_only")

# Pass names that lights had when a node group was last brought up to date, by the lights'
# session_uid: a light that is renamed keeps its settings.
_passes_of_lights: dict[int, str] = {}


class SetupError(Exception):
    """The scene cannot have a shadow scene; the text says why."""


class Mask(NamedTuple):
    """A mask in the node group, and its sockets on a node that uses the group."""

    name: str
    strength: Any
    tint: Any
    soften: Any


# ---- finding what is there ---------------------------------------------------


def shadow_scene(scene: Any) -> Any | None:
    """The shadow scene of a scene; None if there is none."""
    return next((each for each in bpy.data.scenes if each.get(_SOURCE) == scene), None)


def source_scene(scene: Any) -> Any | None:
    """The scene that `scene` is the shadow scene of; None if it is none."""
    return scene.get(_SOURCE)


def pair_of(scene: Any) -> tuple[Any, Any | None]:
    """The source scene and the shadow scene, from either of them."""
    source = source_scene(scene)
    return (scene, shadow_scene(scene)) if source is None else (source, scene)


def settings_scene(scene: Any) -> Any:
    """The scene whose settings the masks of `scene` are made with."""
    return pair_of(scene)[1] or scene


def group_node(scene: Any) -> Any | None:
    """The node in the scene's compositor that applies the masks."""
    shadow, tree = shadow_scene(scene), compat.existing_compositor(scene)
    group = shadow and shadow.get(_GROUP)
    if group is None or tree is None:
        return None
    return next((node for node in tree.nodes if _group_of(node) == group), None)


def is_applied(scene: Any) -> bool:
    """The masks reach the scene's picture."""
    node = group_node(scene)
    return node is not None and compat.composites(scene) and node.outputs[0].is_linked


def masks_of(node: Any) -> Iterator[Mask]:
    """The masks of a node that uses the group."""
    inputs = {socket.identifier: socket for socket in node.inputs}
    for panel in _panels(node.node_tree):
        found = {item.name: inputs[item.identifier] for item in panel.interface_items}
        yield Mask(panel.name, found[STRENGTH], found[TINT], found[SOFTEN])


def title_of(name: str) -> str:
    """What a mask is called among masks."""
    return "Ambient Occlusion" if name == AO_PASS else name.removeprefix(PREFIX)


def is_current(scene: Any) -> bool:
    """The shadow scene holds what the scene holds, and its node group a mask for each light."""
    shadow = shadow_scene(scene)
    if shadow is None:
        return False
    mirror, group = shadow.get(_MIRROR), shadow.get(_GROUP)
    if mirror is None or group is None:
        return False
    return (
        set(mirror.children) == set(scene.collection.children)
        and set(mirror.objects) == set(scene.collection.objects)
        and [layer.name for layer in shadow.view_layers]
        == [layer.name for layer in scene.view_layers]
        and {*_expected(shadow).values(), *((AO_PASS,) if shadow.vocc.use_ao else ())}
        == {panel.name for panel in _panels(group)}
    )


# ---- the shadow scene --------------------------------------------------------


def setup(scene: Any) -> Any:
    """Makes the shadow scene and the nodes of a scene, or brings them up to date.

    What the user made is left alone: nodes and links of the compositor, what else is in the
    shadow scene. A compositor that did not exist is made, with the masks in it.

    Returns:
        The shadow scene.

    Raises:
        SetupError: the scene cannot have one.
    """
    source, shadow = pair_of(scene)
    if source.library is not None:
        raise SetupError(f"The scene '{source.name}' is linked from another file")
    if source.render.engine == VoccEngine.bl_idname:
        raise SetupError(
            f"The scene '{source.name}' is rendered by Volumetric Occluders itself: its passes are "
            "shadow masks already"
        )
    if shadow is None:
        shadow = _new_shadow_scene(source)
    shadow.render.engine = VoccEngine.bl_idname
    follow(source, shadow)
    for layer in shadow.view_layers:
        layer.update_render_passes()
    _sync_nodes(source, shadow)
    return shadow


def follow(source: Any, target: Any) -> None:
    """Has a scene show what the source shows, as the source shows it."""
    _mirror_collections(source, target)
    _mirror_view_layers(source, target)
    _mirror_markers(source, target)
    copy_settings(source, target)


def remove(scene: Any) -> None:
    """Removes a scene that `follow` was used on; what it shares with its source stays."""
    collection = scene.get(_MIRROR)
    bpy.data.scenes.remove(scene)
    if collection is not None:
        bpy.data.collections.remove(collection)


def copy_settings(source: Any, shadow: Any) -> None:
    """Camera, size and the like; what is equal is not written, so nothing is updated for it."""
    for target, origin, names in (
        (shadow, source, _SCENE_SETTINGS),
        (shadow.render, source.render, _RENDER_SETTINGS),
    ):
        for name in names:
            value = getattr(origin, name)
            if getattr(target, name) != value:
                setattr(target, name, value)


def _new_shadow_scene(source: Any) -> Any:
    shadow = bpy.data.scenes.new(f"{source.name} Shadows")
    shadow[_SOURCE] = source
    # A picture of its own must not overwrite the source's.
    shadow.render.filepath = source.render.filepath + "shadow_"
    compat.set_multilayer_exr(shadow.render.image_settings)
    return shadow


def _mirror_collections(source: Any, shadow: Any) -> None:
    """Links what the source links, in a collection that holds nothing else.

    So that what was taken out of the source goes, and what the user puts beside it stays.
    """
    mirror = shadow.get(_MIRROR)
    if mirror is None:
        mirror = shadow[_MIRROR] = bpy.data.collections.new(shadow.name)
    _match(shadow.collection.children, [*shadow.collection.children, mirror])
    _match(mirror.children, source.collection.children)
    _match(mirror.objects, source.collection.objects)


def _match(links: Any, wanted: Iterable[Any]) -> None:
    have, want = list(links), list(wanted)
    for each in set(have) - set(want):
        links.unlink(each)
    for each in want:
        if each not in have:
            links.link(each)
            have.append(each)


def _mirror_view_layers(source: Any, shadow: Any) -> None:
    layers = shadow.view_layers
    names = [layer.name for layer in source.view_layers]
    if [layer.name for layer in layers] != names:
        # One always remains; its name may be that of another one to come.
        for layer in list(layers)[1:]:
            layers.remove(layer)
        layers[0].name = names[0]
        for name in names[1:]:
            layers.new(name)
    mirror = shadow[_MIRROR]
    for layer, origin in zip(layers, source.view_layers, strict=True):
        layer.use = origin.use
        compat.bring_up_to_date(layer)
        _copy_exclusion(origin.layer_collection, layer.layer_collection.children[mirror.name])


def _copy_exclusion(origin: Any, target: Any) -> None:
    for child in origin.children:
        twin = target.children.get(child.name)
        if twin is None:
            continue
        for name in _COLLECTION_SETTINGS:
            if getattr(twin, name) != getattr(child, name):
                setattr(twin, name, getattr(child, name))
        _copy_exclusion(child, twin)


def _mirror_markers(source: Any, shadow: Any) -> None:
    """Markers change the camera at their frame."""
    wanted = [(each.name, each.frame, each.camera) for each in source.timeline_markers]
    if [(each.name, each.frame, each.camera) for each in shadow.timeline_markers] != wanted:
        shadow.timeline_markers.clear()
        for name, frame, camera in wanted:
            shadow.timeline_markers.new(name, frame=frame).camera = camera


# ---- nodes -------------------------------------------------------------------


def _sync_nodes(source: Any, shadow: Any) -> None:
    is_new_tree = compat.existing_compositor(source) is None
    tree, output = _tree_of(source)
    group = shadow.get(_GROUP)
    is_new_group = group is None
    if group is None:
        group = shadow[_GROUP] = _new_group()
    layers = next((node for node in tree.nodes if _renders(node, shadow)), None)
    is_new_layers = layers is None
    if layers is None:
        layers = _new_layers_node(tree, shadow)
    # The node looks for its scene's passes when this is set.
    layers.layer = layers.layer
    passes = [socket.name for socket in layers.outputs if socket.enabled and _is_mask(socket.name)]
    added = set(_sync_group(group, passes, _pass_by_light(shadow)))
    node = next((node for node in tree.nodes if _group_of(node) == group), None)
    is_new_node = node is None
    if node is None:
        node = _new_group_node(tree, group, layers)
    inputs = {socket.name: socket for socket in node.inputs}
    for name in passes:
        target = inputs[name]
        if target.is_linked:
            # The pass of a light that was renamed: its socket stays as long as it is linked.
            start = target.links[0].from_socket
            is_wanted = start.node == layers and start.name != name and _is_mask(start.name)
        else:
            # Where the user took a link away, it stays away.
            is_wanted = name in added or is_new_node or is_new_layers
        if is_wanted:
            tree.links.new(layers.outputs[name], target)
    if is_new_tree and is_new_group and output is not None:
        _insert_before(tree, output, node)


def _tree_of(source: Any) -> tuple[Any, Any | None]:
    """The tree, and the input of its output node if the tree is new."""
    existing = compat.existing_compositor(source)
    if existing is not None:
        return existing, None
    tree, output = compat.compositor_tree(source)
    if not output.is_linked:
        image = tree.nodes.new("CompositorNodeRLayers")
        image.scene = source
        image.location = (-600, 0)
        tree.links.new(image.outputs["Image"], output)
    return tree, output


def _insert_before(tree: Any, output: Any, node: Any) -> None:
    """Puts the group between the output node and what leads to it."""
    link = output.links[0]
    start = link.from_socket
    tree.links.remove(link)
    tree.links.new(start, node.inputs["Image"])
    tree.links.new(node.outputs["Image"], output)
    output.node.location = (node.location.x + 300, node.location.y + 100)


def _new_layers_node(tree: Any, shadow: Any) -> Any:
    left, bottom = _free_corner(tree)
    node = tree.nodes.new("CompositorNodeRLayers")
    node.scene = shadow
    node.layer = _rendered_layer(shadow).name
    node.label = node.name = shadow.name
    node.location = (left, bottom - 100)
    return node


def _new_group_node(tree: Any, group: Any, layers: Any) -> Any:
    node = tree.nodes.new("CompositorNodeGroup")
    node.node_tree = group
    node.label = node.name = GROUP_NAME
    node.width = 200
    node.location = (layers.location.x + 350, layers.location.y)
    return node


def _free_corner(tree: Any) -> tuple[float, float]:
    """Left of and below all nodes, in node editor units."""
    nodes = list(tree.nodes)
    return (
        min((node.location.x for node in nodes), default=-600.0),
        min((node.location.y - max(node.height, 200.0) for node in nodes), default=0.0),
    )


def _new_group() -> Any:
    group = bpy.data.node_groups.new(GROUP_NAME, "CompositorNodeTree")
    interface = group.interface
    interface.new_socket("Image", in_out="OUTPUT", socket_type="NodeSocketColor")
    interface.new_socket("Image", in_out="INPUT", socket_type="NodeSocketColor")
    return group


def _sync_group(group: Any, passes: Sequence[str], lights: dict[int, str]) -> list[str]:
    """Has the group a panel for each mask, and nodes to it; the names of new ones."""
    interface = group.interface
    panels = {panel.name: panel for panel in _panels(group)}
    for uid, name in lights.items():
        old = _passes_of_lights.get(uid)
        if old in panels and old not in passes and name in passes and name not in panels:
            panel = panels[name] = panels.pop(old)
            next(item for item in panel.interface_items if item.name == old).name = name
            panel.name = name
            for node in group.nodes:
                if node.label == old:
                    node.label = name
    _passes_of_lights.update(lights)
    gone = [panel for name, panel in panels.items() if name not in passes]
    new = [name for name in passes if name not in panels]
    for panel in gone:
        for item in list(panel.interface_items):
            interface.remove(item)
        interface.remove(panel)
    for name in new:
        _new_panel(interface, name)
    if gone or new or not group.nodes:
        _build_group(group)
    return new


def _new_panel(interface: Any, name: str) -> None:
    panel = interface.new_panel(name, default_closed=True)

    def socket(label: str, kind: str, text: str, **values: Any) -> None:
        made = interface.new_socket(
            label, description=text, in_out="INPUT", socket_type=kind, parent=panel
        )
        for key, value in values.items():
            setattr(made, key, value)

    limits = {"min_value": 0.0, "max_value": 1.0, "subtype": "FACTOR"}
    socket(name, "NodeSocketFloat", "1 is lit", default_value=1.0, hide_value=True)
    socket(STRENGTH, "NodeSocketFloat", "0: the picture as it is; 1: picture x mask", **limits)
    socket(TINT, "NodeSocketColor", "Colour of the shadow", default_value=(0.0, 0.0, 0.0, 1.0))
    socket(SOFTEN, "NodeSocketFloat", "Blur of the mask in pixels", min_value=0.0, max_value=1000.0)


def _build_group(group: Any) -> None:
    """A node for each mask, through which the image goes one after the other.

    Blender goes through all nodes at each change, so what is there already is left as it is.
    """
    nodes, links = group.nodes, group.links
    start, end = (
        next((node for node in nodes if node.bl_idname == kind), None) or nodes.new(kind)
        for kind in ("NodeGroupInput", "NodeGroupOutput")
    )
    panels = _panels(group)
    found = {node.label: node for node in nodes if _group_of(node) is not None}
    unused = set(found) - {panel.name for panel in panels}
    inner = next((_group_of(node) for node in found.values()), None) or _new_mask_group()
    for name in unused:
        nodes.remove(found.pop(name))
    values = {socket.identifier: socket for socket in start.outputs}
    image = start.outputs["Image"]
    for row, panel in enumerate(panels):
        node = found.get(panel.name)
        if node is None:
            node = nodes.new("CompositorNodeGroup")
            node.node_tree, node.label = inner, panel.name
            for item in panel.interface_items:
                target = MASK if item.name == panel.name else item.name
                links.new(values[item.identifier], node.inputs[target])
        _link_once(links, image, node.inputs["Image"])
        image = node.outputs[0]
        node.location = (300 + 250 * row, 0)
    _link_once(links, image, end.inputs[0])
    end.location = (300 + 250 * len(panels), 0)


def _link_once(links: Any, start: Any, end: Any) -> None:
    if not end.is_linked or end.links[0].from_socket != start:
        links.new(start, end)


def _new_mask_group() -> Any:
    """mix(image, image x mix(tint, white, blur(mask)), strength)."""
    group = bpy.data.node_groups.new(MASK_GROUP_NAME, "CompositorNodeTree")
    interface, nodes, links = group.interface, group.nodes, group.links
    interface.new_socket("Image", in_out="OUTPUT", socket_type="NodeSocketColor")
    for name, kind in (("Image", "Color"), (MASK, "Float"), *_SETTINGS):
        interface.new_socket(name, in_out="INPUT", socket_type=f"NodeSocket{kind}")
    start, end = nodes.new("NodeGroupInput"), nodes.new("NodeGroupOutput")
    blur, mask, size = compat.new_blur(group)
    links.new(start.outputs[MASK], mask)
    links.new(start.outputs[SOFTEN], size)
    colour, factor, tint, white, shade = compat.new_mix(group, "MIX")
    links.new(blur.outputs[0], factor)
    links.new(start.outputs[TINT], tint)
    white.default_value = (1.0, 1.0, 1.0, 1.0)
    multiply, strength, before, by, after = compat.new_mix(group, "MULTIPLY")
    links.new(start.outputs[STRENGTH], strength)
    links.new(start.outputs["Image"], before)
    links.new(shade, by)
    links.new(after, end.inputs[0])
    for column, node in enumerate((start, blur, colour, multiply, end)):
        node.location = (200 * column, 0)
    return group


def _panels(group: Any) -> list[Any]:
    return [item for item in group.interface.items_tree if item.item_type == "PANEL"]


def _group_of(node: Any) -> Any | None:
    return node.node_tree if node.bl_idname == "CompositorNodeGroup" else None


def _renders(node: Any, scene: Any) -> bool:
    return node.bl_idname == "CompositorNodeRLayers" and node.scene == scene


def _is_mask(name: str) -> bool:
    return name == AO_PASS or name.startswith(PREFIX)


def _pass_by_light(shadow: Any) -> dict[int, str]:
    """Names of the passes of the lights that are no instances, by session_uid."""
    names = _expected(shadow)
    lights = (each for each in shadow.objects if each.type == "LIGHT" and each.name in names)
    return {light.session_uid: names[light.name] for light in lights}


def _expected(shadow: Any) -> dict[str, str]:
    """Names of the passes by the names of the lights, of the first view layer that renders."""
    if not shadow.vocc.use_shadow_masks:
        return {}
    names = light_names(_rendered_layer(shadow))
    return dict(zip(names, pass_names(names), strict=True))


def _rendered_layer(shadow: Any) -> Any:
    layer = next((each for each in shadow.view_layers if each.use), shadow.view_layers[0])
    compat.bring_up_to_date(layer)
    return layer


# ---- before a render ---------------------------------------------------------


@bpy.app.handlers.persistent
def _before_render(scene: Any, _depsgraph: Any = None) -> None:
    # The compositor renders the shadow scene at the source's size and border: an engine that
    # reads another border from its scene would fill the wrong pixels. Markers and animation
    # may have changed the camera.
    source, shadow = pair_of(scene)
    if shadow is not None:
        copy_settings(source, shadow)


_HANDLERS = (bpy.app.handlers.render_init, bpy.app.handlers.render_pre)


def register() -> None:
    """Has the shadow scenes follow their source scenes at every render."""
    for handlers in _HANDLERS:
        handlers.append(_before_render)


def unregister() -> None:
    """Takes it back."""
    for handlers in _HANDLERS:
        handlers.remove(_before_render)
