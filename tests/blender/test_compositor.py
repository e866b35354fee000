"""The shadow scene and its node group: what they hold, what they leave alone, what they compute."""

from __future__ import annotations

from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import Any

import bpy
import numpy as np
import pytest
from numpy.typing import NDArray

SIZE = (32, 24)


@pytest.fixture
def compositor(addon: ModuleType) -> ModuleType:
    return import_module(f"{addon.__name__}.compositor")


@pytest.fixture
def compat(addon: ModuleType) -> ModuleType:
    return import_module(f"{addon.__name__}.compat")


@pytest.fixture
def scene(addon: ModuleType, empty: bpy.types.Scene) -> bpy.types.Scene:
    """A ball over a floor under two area lights, seen from above."""
    empty.render.engine = "CYCLES"
    empty.cycles.samples = 4
    empty.render.resolution_x, empty.render.resolution_y = SIZE
    inner = bpy.data.collections.new("Inner")
    empty.collection.children.link(inner)
    bpy.ops.mesh.primitive_plane_add(size=8)
    bpy.ops.mesh.primitive_uv_sphere_add(radius=1, location=(0, 0, 1.5))
    for name, x in (("Key", -2.0), ("Fill", 2.0)):
        add_light(inner, name, (x, 0, 5))
    camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    camera.location = (0, 0, 12)
    empty.collection.objects.link(camera)
    empty.camera = camera
    empty.vocc.aa = 1
    return empty


def add_light(collection: Any, name: str, place: tuple[float, float, float]) -> Any:
    data = bpy.data.lights.new(name, "AREA")
    data.energy = 300.0
    light = bpy.data.objects.new(name, data)
    light.location = place
    collection.objects.link(light)
    return light


def render(scene: Any, folder: Path) -> NDArray[np.float32]:
    """What F12 gives, (height, width, 4), through a file: Render Result has no pixels here."""
    settings = scene.render.image_settings
    settings.file_format, settings.color_depth = "OPEN_EXR", "32"
    scene.render.filepath = str(folder / f"{len(list(folder.iterdir()))}.exr")
    bpy.ops.render.render(write_still=True)
    image = bpy.data.images.load(scene.render.filepath)
    pixels = np.empty(image.size[0] * image.size[1] * 4, np.float32)
    image.pixels.foreach_get(pixels)
    return pixels.reshape(image.size[1], image.size[0], 4)


def tree_of(compat: ModuleType, scene: Any) -> Any:
    return compat.existing_compositor(scene)


def state(tree: Any) -> tuple[set[Any], set[Any]]:
    """Nodes and links, to be compared."""
    nodes = {(node.bl_idname, node.name, tuple(node.location), node.label) for node in tree.nodes}
    links = {
        (a.from_node.name, a.from_socket.identifier, a.to_node.name, a.to_socket.identifier)
        for a in tree.links
    }
    return nodes, links


def panel_names(node: Any) -> list[str]:
    return [each.name for each in node.node_tree.interface.items_tree if each.item_type == "PANEL"]


def masks(compositor: ModuleType, scene: Any) -> dict[str, Any]:
    return {mask.name: mask for mask in compositor.masks_of(compositor.group_node(scene))}


def layers_node(tree: Any, scene: Any) -> Any:
    (found,) = (
        node
        for node in tree.nodes
        if node.bl_idname == "CompositorNodeRLayers" and node.scene == scene
    )
    return found


def test_makes_a_scene_of_the_same_objects(compositor: ModuleType, scene: Any) -> None:
    scene.frame_start, scene.frame_end, scene.render.resolution_percentage = 5, 9, 50
    shadow = compositor.setup(scene)
    assert shadow != scene and shadow.render.engine == "VOCC"
    assert set(shadow.objects) == set(scene.objects)
    assert shadow.camera == scene.camera and shadow.world == scene.world
    assert (shadow.frame_start, shadow.frame_end) == (5, 9)
    assert shadow.render.resolution_x == SIZE[0] and shadow.render.resolution_percentage == 50
    assert compositor.pair_of(scene) == compositor.pair_of(shadow) == (scene, shadow)
    assert compositor.is_current(scene)


def test_makes_a_group_with_the_masks(
    compositor: ModuleType, compat: ModuleType, scene: Any
) -> None:
    shadow = compositor.setup(scene)
    node = compositor.group_node(scene)
    assert node.node_tree.name == "Shadow Masks"
    assert set(panel_names(node)) == {"Shadow Fill", "Shadow Key"}
    layers = layers_node(tree_of(compat, scene), shadow)
    for name in panel_names(node):
        (link,) = next(socket for socket in node.inputs if socket.name == name).links
        assert link.from_socket == layers.outputs[name]
    assert compositor.is_applied(scene)


def test_again_changes_nothing(compositor: ModuleType, compat: ModuleType, scene: Any) -> None:
    shadow = compositor.setup(scene)
    tree = tree_of(compat, scene)
    before = state(tree), state(compositor.group_node(scene).node_tree)
    counts = len(bpy.data.scenes), len(bpy.data.node_groups), len(bpy.data.collections)
    assert compositor.setup(scene) == compositor.setup(shadow) == shadow
    assert (state(tree), state(compositor.group_node(scene).node_tree)) == before
    assert (len(bpy.data.scenes), len(bpy.data.node_groups), len(bpy.data.collections)) == counts


def test_follows_lights(compositor: ModuleType, compat: ModuleType, scene: Any) -> None:
    shadow = compositor.setup(scene)
    before = masks(compositor, scene)
    before["Shadow Key"].strength.default_value = 0.25
    before["Shadow Fill"].strength.default_value = 0.75

    add_light(scene.collection, "Rim.001", (0, 3, 3))
    assert not compositor.is_current(scene)
    compositor.setup(scene)
    after = masks(compositor, scene)
    assert set(after) == {"Shadow Key", "Shadow Fill", "Shadow Rim_001"}
    assert after["Shadow Key"].strength.default_value == 0.25
    assert after["Shadow Rim_001"].strength.default_value == 0.0

    bpy.data.objects["Key"].name = "Main"
    assert not compositor.is_current(scene)
    compositor.setup(scene)
    after = masks(compositor, scene)
    assert set(after) == {"Shadow Main", "Shadow Fill", "Shadow Rim_001"}
    assert after["Shadow Main"].strength.default_value == 0.25

    bpy.data.objects.remove(bpy.data.objects["Fill"])
    compositor.setup(scene)
    after = masks(compositor, scene)
    assert set(after) == {"Shadow Main", "Shadow Rim_001"}
    assert after["Shadow Main"].strength.default_value == 0.25
    node, layers = compositor.group_node(scene), layers_node(tree_of(compat, scene), shadow)
    for name in after:
        (link,) = next(socket for socket in node.inputs if socket.name == name).links
        assert link.from_socket == layers.outputs[name]


def test_follows_collections(compositor: ModuleType, scene: Any) -> None:
    shadow = compositor.setup(scene)
    other = bpy.data.collections.new("Other")
    scene.collection.children.link(other)
    bpy.context.view_layer.layer_collection.children["Other"].exclude = True
    ball = bpy.data.objects["Sphere"]
    scene.collection.objects.unlink(ball)
    own = bpy.data.objects.new("Of the shadow scene", None)
    shadow.collection.objects.link(own)
    assert not compositor.is_current(scene)
    compositor.setup(scene)
    assert compositor.is_current(scene)
    assert "Sphere" not in shadow.objects and own.name in shadow.objects
    (mirror,) = shadow.view_layers[0].layer_collection.children
    assert mirror.children["Other"].exclude and not mirror.children["Inner"].exclude
    bpy.context.view_layer.layer_collection.children["Other"].exclude = False
    compositor.setup(scene)
    assert not mirror.children["Other"].exclude


def test_follows_view_layers(compositor: ModuleType, scene: Any) -> None:
    scene.view_layers.new("Second").use = False
    scene.view_layers["Second"].layer_collection.children["Inner"].exclude = True
    shadow = compositor.setup(scene)
    assert [layer.name for layer in shadow.view_layers] == ["ViewLayer", "Second"]
    second = shadow.view_layers["Second"]
    assert not second.use
    assert second.layer_collection.children[0].children["Inner"].exclude
    scene.view_layers.remove(scene.view_layers["ViewLayer"])
    compositor.setup(scene)
    assert [layer.name for layer in shadow.view_layers] == ["Second"]


def users_tree(compat: ModuleType, scene: Any) -> Any:
    """A compositor as a user may have it: an image, blurred, tied to the output."""
    tree, output = compat.compositor_tree(scene)
    tree.nodes.clear()
    tree, output = compat.compositor_tree(scene)
    image, blur = (tree.nodes.new(f"CompositorNode{kind}") for kind in ("RLayers", "Blur"))
    image.scene = scene
    blur.location = (200, 0)
    tree.links.new(image.outputs["Image"], blur.inputs["Image"])
    tree.links.new(blur.outputs[0], output)
    return tree


def test_leaves_the_users_nodes_alone(
    compositor: ModuleType, compat: ModuleType, scene: Any
) -> None:
    tree = users_tree(compat, scene)
    nodes, links = state(tree)
    compositor.setup(scene)
    after = state(tree)
    assert nodes < after[0] and links < after[1]
    assert len(after[0]) == len(nodes) + 2
    assert not compositor.is_applied(scene)
    # The user puts the group in, takes a mask's link away and moves a node: all that stays.
    node = compositor.group_node(scene)
    tree.links.new(tree.nodes["Blur"].outputs[0], node.inputs["Image"])
    tree.links.new(node.outputs["Image"], compat.compositor_tree(scene)[1])
    tree.links.remove(
        next(each for each in node.inputs if each.name == "Shadow Key").links[0],
    )
    node.location = (777, 5)
    before = state(tree)
    compositor.setup(scene)
    assert state(tree) == before
    assert compositor.is_applied(scene)


def test_a_compositor_that_is_off_stays_off(
    compositor: ModuleType, compat: ModuleType, scene: Any
) -> None:
    tree = users_tree(compat, scene)
    if bpy.app.version < (5, 0):
        scene.use_nodes = False
    scene.render.use_compositing = False
    compositor.setup(scene)
    assert not scene.render.use_compositing and not compat.composites(scene)
    if bpy.app.version < (5, 0):
        assert not scene.use_nodes
    assert compositor.group_node(scene).name in tree.nodes
    assert not compositor.is_applied(scene)


def test_deleted_parts_come_back(compositor: ModuleType, compat: ModuleType, scene: Any) -> None:
    shadow = compositor.setup(scene)
    tree = tree_of(compat, scene)
    tree.nodes.remove(compositor.group_node(scene))
    compositor.setup(scene)
    node = compositor.group_node(scene)
    assert all(each.is_linked for each in node.inputs if each.name.startswith("Shadow "))
    bpy.data.node_groups.remove(node.node_tree)
    assert not compositor.is_current(scene)
    compositor.setup(scene)
    assert set(masks(compositor, scene)) == {"Shadow Key", "Shadow Fill"}
    bpy.data.scenes.remove(shadow)
    assert compositor.shadow_scene(scene) is None
    compositor.setup(scene)
    assert compositor.is_current(scene)


def test_names_are_the_users(compositor: ModuleType, scene: Any) -> None:
    shadow = compositor.setup(scene)
    shadow.name, scene.name = "Schatten", "Szene"
    compositor.group_node(scene).node_tree.name = "Masken"
    compositor.setup(scene)
    assert len(bpy.data.scenes) == 2 and compositor.shadow_scene(scene).name == "Schatten"
    assert set(masks(compositor, scene)) == {"Shadow Key", "Shadow Fill"}


def test_ambient_occlusion_is_a_mask_too(compositor: ModuleType, scene: Any) -> None:
    compositor.setup(scene).vocc.use_ao = True
    compositor.setup(scene)
    assert "VOcc AO" in masks(compositor, scene)
    compositor.settings_scene(scene).vocc.use_ao = False
    compositor.setup(scene)
    assert "VOcc AO" not in masks(compositor, scene)


def test_scenes_that_cannot_have_one(compositor: ModuleType, scene: Any) -> None:
    scene.render.engine = "VOCC"
    with pytest.raises(compositor.SetupError, match="is rendered by Volumetric Occluders itself"):
        compositor.setup(scene)
    assert len(bpy.data.scenes) == 1


def test_scenes_of_other_files(compositor: ModuleType, scene: Any, tmp_path: Path) -> None:
    path = str(tmp_path / "library.blend")
    scene.name = "Away"
    bpy.ops.wm.save_as_mainfile(filepath=path)
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    with bpy.data.libraries.load(path, link=True) as (_, wanted):
        wanted.scenes = ["Away"]
    with pytest.raises(compositor.SetupError, match="'Away' is linked from another file"):
        compositor.setup(wanted.scenes[0])
    assert len(bpy.data.scenes) == 2


def test_markers_change_the_camera(compositor: ModuleType, scene: Any, tmp_path: Path) -> None:
    other = bpy.data.objects.new("Other", scene.camera.data)
    scene.collection.objects.link(other)
    for frame, camera in ((1, scene.camera), (2, other)):
        scene.timeline_markers.new("Cut", frame=frame).camera = camera
    shadow = compositor.setup(scene)
    assert [each.camera for each in shadow.timeline_markers] == [scene.camera, other]
    scene.frame_start, scene.frame_end = 1, 2
    scene.render.image_settings.file_format = "PNG"
    scene.render.filepath = str(tmp_path / "frame")
    seen = []

    def look(*_: Any) -> None:
        seen.append((shadow.frame_current, shadow.camera.name))

    bpy.app.handlers.render_post.append(look)
    bpy.ops.render.render(animation=True)
    bpy.app.handlers.render_post.remove(look)
    assert seen == [(1, "Camera"), (2, "Other")]


def test_picture_times_masks(
    compositor: ModuleType, compat: ModuleType, scene: Any, tmp_path: Path
) -> None:
    image = render(scene, tmp_path)
    shadow = compositor.setup(scene)
    tree, output = compat.compositor_tree(scene)
    node = compositor.group_node(scene)
    start, end = node.inputs["Image"].links[0].from_socket, node.outputs["Image"]
    # Nothing changes until a strength is raised.
    np.testing.assert_array_equal(render(scene, tmp_path), image)

    found = {}
    for name in ("Shadow Key", "Shadow Fill"):
        tree.links.new(layers_node(tree, shadow).outputs[name], output)
        found[name] = render(scene, tmp_path)[..., :1]
        assert found[name].min() < 0.3 and found[name].max() > 0.9
    assert not np.array_equal(found["Shadow Key"], found["Shadow Fill"])
    tree.links.new(start, node.inputs["Image"])
    tree.links.new(end, output)

    settings = masks(compositor, scene)
    settings["Shadow Key"].strength.default_value = 1.0
    got = render(scene, tmp_path)
    expected = image[..., :3] * found["Shadow Key"]
    np.testing.assert_allclose(got[..., :3], expected, rtol=1e-5, atol=1e-6)
    np.testing.assert_array_equal(got[..., 3], image[..., 3])

    tint = np.array([0.5, 0.25, 0.0], np.float32)
    settings["Shadow Fill"].strength.default_value = 0.5
    settings["Shadow Fill"].tint.default_value = (*tint.tolist(), 1.0)
    shade = tint + (1 - tint) * found["Shadow Fill"]
    expected = expected * (0.5 + 0.5 * shade)
    np.testing.assert_allclose(render(scene, tmp_path)[..., :3], expected, rtol=1e-5, atol=1e-6)

    settings["Shadow Fill"].strength.default_value = 0.0
    settings["Shadow Key"].soften.default_value = 4.0
    with np.errstate(invalid="ignore"):
        blurred = render(scene, tmp_path)[..., 0] / image[..., 0]
    steps = [
        np.nanmax(np.abs(np.diff(each[4:-4, 4:-4], axis=1)))
        for each in (blurred, found["Shadow Key"][..., 0])
    ]
    assert steps[0] < 0.7 * steps[1]


def test_border_and_camera_follow_at_the_render(
    compositor: ModuleType, compat: ModuleType, scene: Any, tmp_path: Path
) -> None:
    shadow = compositor.setup(scene)
    tree, output = compat.compositor_tree(scene)
    tree.links.new(layers_node(tree, shadow).outputs["Shadow Key"], output)
    full = render(scene, tmp_path)[..., 0]
    r = scene.render
    r.use_border, r.use_crop_to_border = True, True
    r.border_min_x, r.border_max_x, r.border_min_y, r.border_max_y = 0.25, 0.75, 0.5, 1.0
    crop = render(scene, tmp_path)[..., 0]
    np.testing.assert_array_equal(crop, full[SIZE[1] // 2 :, SIZE[0] // 4 : 3 * SIZE[0] // 4])
    other = bpy.data.objects.new("Other", scene.camera.data)
    scene.collection.objects.link(other)
    scene.camera = other
    r.resolution_x = 2 * SIZE[0]
    render(scene, tmp_path)
    assert shadow.camera == other and shadow.render.resolution_x == 2 * SIZE[0]


def test_undo(compositor: ModuleType, compat: ModuleType, scene: Any) -> None:
    bpy.ops.ed.undo_push(message="before")
    compositor.setup(scene)
    bpy.ops.ed.undo_push(message="set up")
    bpy.ops.ed.undo()
    scene = bpy.context.scene
    assert len(bpy.data.scenes) == 1 and compositor.shadow_scene(scene) is None
    assert compat.existing_compositor(scene) is None
    bpy.ops.ed.redo()
    scene = bpy.context.scene
    assert compositor.is_current(scene)
    compositor.setup(scene)
    assert len(bpy.data.scenes) == 2 and len(masks(compositor, scene)) == 2
    bpy.ops.ed.undo()
    compositor.setup(bpy.context.scene)
    assert compositor.is_current(bpy.context.scene)


def test_survives_a_file(compositor: ModuleType, scene: Any, tmp_path: Path) -> None:
    compositor.setup(scene)
    masks(compositor, scene)["Shadow Key"].strength.default_value = 0.5
    path = str(tmp_path / "saved.blend")
    bpy.ops.wm.save_as_mainfile(filepath=path)
    bpy.ops.wm.open_mainfile(filepath=path)
    scene = compositor.pair_of(bpy.context.scene)[0]
    assert compositor.is_current(scene)
    assert masks(compositor, scene)["Shadow Key"].strength.default_value == 0.5
    bpy.data.scenes["Scene"].name = "Later"
    compositor.setup(scene)
    assert len(bpy.data.scenes) == 2
