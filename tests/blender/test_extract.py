"""What is read of a scene: every kind of object, instances, visibility, and what is left out."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

import bpy
import numpy as np
import pytest
from numpy.testing import assert_array_equal
from numpy.typing import NDArray

Scene = bpy.types.Scene
Read = Callable[..., Any]

CUBE_CORNERS = [(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]
CUBE_FACES = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]


@pytest.fixture
def view(addon: ModuleType) -> Read:
    """Reads the viewport's depsgraph."""
    from blender_addon.extract import read_world

    return lambda **options: read_world(bpy.context.evaluated_depsgraph_get(), **options)


@pytest.fixture
def render(addon: ModuleType) -> Iterator[Read]:
    """Reads the depsgraph of a render."""
    from blender_addon.extract import read_world

    worlds = []

    class Engine(bpy.types.RenderEngine):  # type: ignore[misc]
        bl_idname = "VOCC_TEST_READER"
        bl_label = "Reader"

        def render(self, depsgraph: Any) -> None:
            worlds.append(read_world(depsgraph))

    def read() -> Any:
        scene = bpy.context.scene
        scene.camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
        scene.collection.objects.link(scene.camera)
        scene.render.engine = Engine.bl_idname
        scene.render.resolution_x = scene.render.resolution_y = 4
        bpy.ops.render.render()
        return worlds.pop()

    bpy.utils.register_class(Engine)
    try:
        yield read
    finally:
        bpy.utils.unregister_class(Engine)


def mesh_object(
    name: str = "Cube",
    vertices: Any = CUBE_CORNERS,
    faces: Any = CUBE_FACES,
    edges: Any = (),
    parent: bpy.types.Collection | None = None,
) -> bpy.types.Object:
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata(vertices, edges, faces)
    return linked(bpy.data.objects.new(name, mesh), parent)


def linked(
    object: bpy.types.Object, parent: bpy.types.Collection | None = None
) -> bpy.types.Object:
    (parent or bpy.context.scene.collection).objects.link(object)
    return object


def copy_of(object: bpy.types.Object, x: float = 0) -> bpy.types.Object:
    copy = linked(object.copy())
    copy.location.x = x
    return copy


def instance_of(collection: bpy.types.Collection, name: str = "Instance") -> bpy.types.Object:
    instance = linked(bpy.data.objects.new(name, None))
    instance.instance_type = "COLLECTION"
    instance.instance_collection = collection
    return instance


def geometry_nodes(object: bpy.types.Object) -> tuple[Any, Any, Any]:
    """The tree of a modifier, the output of its group input, the input of its group output."""
    tree = bpy.data.node_groups.new("Nodes", "GeometryNodeTree")
    for in_out in ("INPUT", "OUTPUT"):
        tree.interface.new_socket("Geometry", in_out=in_out, socket_type="NodeSocketGeometry")
    object.modifiers.new("Nodes", "NODES").node_group = tree
    source, sink = tree.nodes.new("NodeGroupInput"), tree.nodes.new("NodeGroupOutput")
    return tree, source.outputs[0], sink.inputs[0]


def names(world: Any) -> list[str]:
    return sorted(part.name for part in world.parts)


def corners(part: Any) -> NDArray[np.float64]:
    """Of all triangles, in the world: (m, 3, 3)."""
    world = part.vertices @ part.matrix[:3, :3].T + part.matrix[:3, 3]
    return np.asarray(world[part.triangles], np.float64)


def volume(part: Any) -> float:
    a, b, c = corners(part).swapaxes(0, 1)
    return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6)


# ---- kinds of objects ---------------------------------------------------------


def test_a_mesh(empty: Scene, view: Read) -> None:
    cube = mesh_object()
    cube.location = (1, 2, 3)
    (part,) = view().parts
    assert (part.name, part.object_name, part.link_name) == ("Cube", "Cube", "Cube")
    assert (part.vertices.dtype, part.triangles.dtype) == (np.float32, np.int32)
    assert_array_equal(part.vertices, CUBE_CORNERS)
    assert part.triangles.shape == (12, 3)
    assert volume(part) == pytest.approx(8)
    assert_array_equal(part.matrix[:3, 3], (1, 2, 3))
    assert part.is_caster and part.is_receiver and part.casting is None


def test_objects_that_become_meshes_come_once(empty: Scene, view: Read) -> None:
    bpy.ops.curve.primitive_bezier_circle_add()
    bpy.context.object.name = "Wire"
    bpy.context.object.data.bevel_depth = 0.1
    bpy.ops.object.text_add()
    bpy.context.object.data.extrude = 0.1
    bpy.ops.object.metaball_add()
    bpy.ops.surface.primitive_nurbs_surface_sphere_add()
    world = view()
    assert names(world) == ["Mball", "SurfSphere", "Text", "Wire"]
    assert [part.object_name for part in world.parts] == [part.name for part in world.parts]
    assert world.left_out == ()


def test_what_has_no_surface_is_not_mentioned(empty: Scene, view: Read) -> None:
    bpy.ops.curve.primitive_bezier_circle_add()  # without thickness
    for add in ("empty_add", "armature_add", "speaker_add", "camera_add"):
        getattr(bpy.ops.object, add)()
    bpy.ops.object.add(type="LATTICE")
    mesh_object("Nothing", [], [])
    mesh_object("Edges", [(0, 0, 0), (1, 0, 0)], [], [(0, 1)])
    world = view()
    assert world.parts == () and world.lights == () and world.left_out == ()


def test_what_is_not_made_of_meshes_is_left_out(empty: Scene, view: Read) -> None:
    linked(bpy.data.objects.new("Fur", bpy.data.hair_curves.new("Fur")))
    linked(bpy.data.objects.new("Spray", bpy.data.pointclouds.new("Spray")))
    linked(bpy.data.objects.new("Smoke", bpy.data.volumes.new("Smoke")))
    mesh_object()
    world = view()
    assert names(world) == ["Cube"]
    assert dict(world.left_out) == {
        "Fur": "hair curves are not meshes",
        "Spray": "point clouds are not meshes",
        "Smoke": "volumes are not meshes",
    }


def test_grease_pencil_is_left_out(empty: Scene, view: Read) -> None:
    bpy.ops.object.grease_pencil_add(type="STROKE")
    world = view()
    assert world.parts == ()
    assert [reason for _, reason in world.left_out] == ["Grease Pencil is not a mesh"]


@pytest.mark.parametrize("shown", [True, False])
def test_hair_of_particles_is_left_out_and_what_it_grows_on_is_not(
    empty: Scene, view: Read, shown: bool
) -> None:
    head = mesh_object("Head")
    modifier = head.modifiers.new("Hair", "PARTICLE_SYSTEM")
    head.particle_systems[0].settings.type = "HAIR"
    modifier.show_render = shown
    world = view()
    assert names(world) == ["Head"]
    hair = ("Head", "its hair is made of particles, not meshes")
    assert world.left_out == ((hair,) if shown else ())


def test_loose_edges_and_custom_normals_do_no_harm(empty: Scene, view: Read) -> None:
    cube = mesh_object(vertices=[*CUBE_CORNERS, (5, 5, 5)], edges=[(7, 8)])
    cube.data.normals_split_custom_set([(0, 0, 1)] * len(cube.data.loops))
    (part,) = view().parts
    assert len(part.vertices) == 9 and len(part.triangles) == 12


# ---- modifiers and instances ---------------------------------------------------


def test_a_render_has_its_own_subdivision(empty: Scene, view: Read, render: Read) -> None:
    modifier = mesh_object().modifiers.new("Subdivision", "SUBSURF")
    modifier.levels, modifier.render_levels = 1, 3
    assert [len(part.triangles) for part in view().parts] == [12 * 4]
    assert [len(part.triangles) for part in render().parts] == [12 * 4**3]


def test_linked_duplicates_share_their_arrays(empty: Scene, view: Read) -> None:
    copy_of(mesh_object(), 5).scale = (1, -2, 1)
    a, b = view().parts
    assert a.vertices is b.vertices
    assert not a.vertices.flags.writeable and not a.triangles.flags.writeable
    assert volume(a) == pytest.approx(8) and volume(b) == pytest.approx(16)


def test_an_instanced_collection(empty: Scene, view: Read, render: Read) -> None:
    collection = bpy.data.collections.new("Furniture")
    mesh_object("Chair", parent=collection)
    for x, name in enumerate(("Kitchen", "Hall")):
        instance_of(collection, name).location.x = 10 * x
    for world in (view(), render()):
        a, b = world.parts
        assert (a.name, b.name) == ("Chair in Kitchen", "Chair in Hall")
        assert (a.object_name, b.object_name) == ("Chair", "Chair")
        assert a.vertices is b.vertices and a.triangles is b.triangles
        assert (a.matrix[0, 3], b.matrix[0, 3]) == (0, 10)


def test_instances_on_points_by_geometry_nodes(empty: Scene, view: Read, render: Read) -> None:
    points = [(3 * x, 0, 0) for x in range(5)]
    ground = mesh_object("Ground", points, [], [(0, 1)])
    tree, source, sink = geometry_nodes(ground)
    instances = tree.nodes.new("GeometryNodeInstanceOnPoints")
    tree.links.new(source, instances.inputs["Points"])
    cube = tree.nodes.new("GeometryNodeMeshCube")
    tree.links.new(cube.outputs["Mesh"], instances.inputs["Instance"])
    tree.links.new(instances.outputs[0], sink)
    for world in (view(), render()):
        assert names(world) == ["Ground"] * 5
        assert len({id(part.vertices) for part in world.parts}) == 1
        assert_array_equal([part.matrix[:3, 3] for part in world.parts], points)


def test_an_instancer_may_hide_itself(empty: Scene, render: Read) -> None:
    parent = mesh_object("Frame")
    child = mesh_object("Bulb", [(0, 0, 0), (1, 0, 0), (0, 1, 0)], [(0, 1, 2)])
    child.parent = parent
    parent.instance_type = "VERTS"
    parent.show_instancer_for_render = False
    assert names(render()) == ["Bulb in Frame"] * 8


def test_an_instance_of_what_is_hidden_is_shown(empty: Scene, render: Read) -> None:
    hidden = mesh_object("Stone")
    hidden.hide_render = True
    tree, _, sink = geometry_nodes(mesh_object("Ground"))
    info = tree.nodes.new("GeometryNodeObjectInfo")
    info.inputs["Object"].default_value = hidden
    info.inputs["As Instance"].default_value = True
    tree.links.new(info.outputs["Geometry"], sink)
    assert names(render()) == ["Stone in Ground"]


@pytest.mark.parametrize("scale", [(1, 1, 1), (-1, 1, 1), (-1, -1, 1), (-2, -2, -2)])
def test_triangles_face_outward_however_they_are_mirrored(
    empty: Scene, view: Read, scale: tuple[float, float, float]
) -> None:
    cube = mesh_object()
    cube.scale = scale
    (part,) = view().parts
    assert volume(part) == pytest.approx(8 * abs(np.prod(scale)))
    assert part.triangles.flags.c_contiguous


def test_the_arrays_are_copies(empty: Scene, view: Read) -> None:
    cube = mesh_object()
    (part,) = view().parts
    cube.data.vertices[0].co = (7, 7, 7)
    cube.data.update()
    bpy.context.view_layer.update()
    assert_array_equal(part.vertices, CUBE_CORNERS)


def test_a_mesh_that_is_being_edited(empty: Scene, view: Read, render: Read) -> None:
    cube = mesh_object()
    cube.data.materials.append(material("Leaves", not_solid=True))
    copy_of(cube, 5)
    bpy.context.view_layer.objects.active = cube
    bpy.ops.object.mode_set(mode="EDIT")
    bpy.ops.mesh.subdivide()
    for world in (view(), render()):
        assert [len(part.triangles) for part in world.parts] == [48, 48]
        assert not any(part.casting.any() for part in world.parts)


# ---- visibility ----------------------------------------------------------------


def test_what_casts_and_what_is_seen(empty: Scene, view: Read) -> None:
    for name in ("Plain", "Ghost", "Blocker", "Excluded", "Nothing"):
        mesh_object(name)
    objects = bpy.data.objects
    objects["Ghost"].visible_shadow = False
    objects["Blocker"].visible_camera = False
    objects["Excluded"].vocc.exclude = True
    objects["Nothing"].visible_shadow = objects["Nothing"].visible_camera = False
    found = {part.name: (part.is_caster, part.is_receiver) for part in view().parts}
    assert found == {
        "Plain": (True, True),
        "Ghost": (False, True),
        "Blocker": (True, False),
        "Excluded": (False, True),
    }


@pytest.mark.parametrize("who", ["instance", "object"])
def test_an_instance_casts_if_both_it_and_its_object_do(empty: Scene, view: Read, who: str) -> None:
    collection = bpy.data.collections.new("Furniture")
    both = {"object": mesh_object("Chair", parent=collection), "instance": instance_of(collection)}
    both[who].visible_shadow = False
    assert [(part.is_caster, part.is_receiver) for part in view().parts] == [(False, True)]
    both[who].visible_shadow = True
    both[who].visible_camera = False
    assert [(part.is_caster, part.is_receiver) for part in view().parts] == [(True, False)]
    both[who].visible_camera = True
    both[who].vocc.exclude = True
    assert [(part.is_caster, part.is_receiver) for part in view().parts] == [(False, True)]


def test_settings_hold_for_what_becomes_a_mesh(empty: Scene, view: Read) -> None:
    bpy.ops.object.text_add()
    bpy.context.object.data.extrude = 0.1
    bpy.context.object.vocc.exclude = True
    assert [part.is_caster for part in view().parts] == [False]


def test_a_collection_of_which_only_shadows_are_seen(empty: Scene, view: Read) -> None:
    collection = bpy.data.collections.new("Off-stage")
    empty.collection.children.link(collection)
    mesh_object("Tree", parent=collection)
    bpy.context.view_layer.layer_collection.children[0].indirect_only = True
    assert [(part.is_caster, part.is_receiver) for part in view().parts] == [(True, False)]


def test_hidden_objects(empty: Scene, view: Read, render: Read) -> None:
    mesh_object("Shown")
    mesh_object("Not in renders").hide_render = True
    mesh_object("Not in the viewport").hide_viewport = True
    excluded = bpy.data.collections.new("Excluded")
    empty.collection.children.link(excluded)
    mesh_object("Elsewhere", parent=excluded)
    bpy.context.view_layer.layer_collection.children[0].exclude = True
    assert names(render()) == ["Not in the viewport", "Shown"]
    assert names(view()) == ["Shown"]
    assert names(view(for_render=False)) == ["Not in renders", "Shown"]


# ---- materials -----------------------------------------------------------------


def material(name: str, *, not_solid: bool = False) -> bpy.types.Material:
    result = bpy.data.materials.new(name)
    result.vocc.not_solid = not_solid
    return result


def casting_faces(part: Any) -> list[int]:
    """Of a cube, faces whose two triangles cast."""
    halves = part.casting.reshape(6, 2)
    assert_array_equal(halves[:, 0], halves[:, 1])
    return [int(face) for face in np.flatnonzero(halves[:, 0])]


def test_a_material_that_is_not_solid(empty: Scene, view: Read) -> None:
    tree = mesh_object("Tree")
    tree.data.materials.append(material("Bark"))
    tree.data.materials.append(material("Leaves", not_solid=True))
    for face in (1, 4):
        tree.data.polygons[face].material_index = 1
    mesh_object("Stone").data.materials.append(bpy.data.materials["Bark"])
    parts = {part.name: part for part in view().parts}
    assert casting_faces(parts["Tree"]) == [0, 2, 3, 5]
    assert parts["Tree"].triangles.shape == (12, 3)
    assert parts["Stone"].casting is None


def test_a_face_beyond_the_last_material_has_the_last(empty: Scene, view: Read) -> None:
    tree = mesh_object("Tree")
    tree.data.materials.append(material("Leaves", not_solid=True))
    tree.data.polygons[2].material_index = 7
    (part,) = view().parts
    assert casting_faces(part) == []


def test_an_object_may_replace_the_material_of_its_mesh(empty: Scene, view: Read) -> None:
    tree = mesh_object("Tree")
    tree.data.materials.append(material("Bark"))
    copy = copy_of(tree, 5)
    copy.material_slots[0].link = "OBJECT"
    copy.material_slots[0].material = material("Leaves", not_solid=True)
    parts = {part.name: part for part in view().parts}
    assert parts["Tree"].casting is None
    assert casting_faces(parts["Tree.001"]) == []


def test_a_material_set_by_geometry_nodes(empty: Scene, view: Read) -> None:
    tree, source, sink = geometry_nodes(mesh_object("Tree"))
    setter = tree.nodes.new("GeometryNodeSetMaterial")
    setter.inputs["Material"].default_value = material("Leaves", not_solid=True)
    tree.links.new(source, setter.inputs[0])
    tree.links.new(setter.outputs[0], sink)
    (part,) = view().parts
    assert casting_faces(part) == []


# ---- bad geometry ---------------------------------------------------------------


@pytest.mark.parametrize(
    ("value", "reason"),
    [
        (np.nan, "its vertex 5 is not at a finite place"),
        (3e38, "its coordinates are too large"),
    ],
)
def test_a_vertex_that_is_nowhere(empty: Scene, view: Read, value: float, reason: str) -> None:
    bad = mesh_object("Broken")
    bad.data.vertices[5].co.y = value
    copy_of(bad, 1)
    mesh_object("Whole")
    world = view()
    assert names(world) == ["Whole"]
    assert world.left_out == (("Broken", reason), ("Broken.001", reason))


@pytest.mark.parametrize(
    ("scale", "x", "reason"),
    [
        ((0, 0, 0), 0, "it is scaled to nothing"),
        ((0, 2, 0), 0, "it is scaled to nothing"),
        ((1, 1, 1), np.nan, "its place is not finite"),
        ((1, 1, 1), 2e38, "its coordinates are too large"),
    ],
)
def test_transformations_that_cannot_be_used(
    empty: Scene, view: Read, scale: tuple[float, float, float], x: float, reason: str
) -> None:
    bad = mesh_object("Bad")
    bad.scale, bad.location.x = scale, x
    bad.rotation_euler = (0.3, 0.4, 0.5)
    mesh_object("Good")
    world = view()
    assert names(world) == ["Good"]
    assert world.left_out == (("Bad", reason),)


def test_what_is_flat_still_casts(empty: Scene, view: Read) -> None:
    mesh_object().scale = (1, 1, 0)
    (part,) = view().parts
    assert_array_equal(corners(part)[..., 2], 0)


def test_huge_coordinates(empty: Scene, view: Read) -> None:
    mesh_object().location.x = 2**24
    world = view()
    (part,) = world.parts
    assert world.origin[0] + corners(part)[..., 0].min() == 2**24 - 1
    assert np.abs(part.matrix[:3, 3]).max() < 64


# ---- how triangles are read -------------------------------------------------------


def monkey_with_corners_of_all_kinds() -> bpy.types.Object:
    bpy.ops.mesh.primitive_monkey_add()  # triangles and quads
    bpy.ops.mesh.primitive_cylinder_add(vertices=17)  # n-gons
    bpy.context.object.name = "Cylinder"
    subdivided = copy_of(bpy.data.objects["Suzanne"])
    subdivided.modifiers.new("Subdivision", "SUBSURF")
    triangulated = copy_of(bpy.data.objects["Cylinder"])
    triangulated.modifiers.new("Bevel", "BEVEL")
    return subdivided


def test_both_ways_to_read_triangles_agree(empty: Scene, addon: ModuleType) -> None:
    from blender_addon import compat

    monkey_with_corners_of_all_kinds()
    meshes = 0
    for instance in bpy.context.evaluated_depsgraph_get().object_instances:
        mesh = instance.object.data
        assert compat.has_packed_triangles(mesh)
        fast, slow = compat.corner_triangles(mesh), compat.corner_triangles_by_rna(mesh)
        assert_array_equal(fast, slow)
        assert fast.dtype == slow.dtype == np.int32
        vertices = np.empty_like(slow)
        mesh.loop_triangles.foreach_get("vertices", vertices.ravel())
        corner_vertices = np.array([loop.vertex_index for loop in mesh.loops])
        assert_array_equal(corner_vertices[fast], vertices)
        meshes += 1
    assert meshes == 4


def test_triangles_stay_in_the_order_of_blender(empty: Scene, view: Read) -> None:
    monkey_with_corners_of_all_kinds()
    evaluated = bpy.context.evaluated_depsgraph_get().object_instances
    expected = []
    for instance in evaluated:
        mesh = instance.object.data
        mesh.calc_loop_triangles()
        expected.append([tuple(triangle.vertices) for triangle in mesh.loop_triangles])
    assert [list(map(tuple, part.triangles.tolist())) for part in view().parts] == expected


# ---- linked files -------------------------------------------------------------------


def test_a_linked_object_is_told_from_a_local_one(empty: Scene, view: Read, tmp_path: Path) -> None:
    library = tmp_path / "props.blend"
    bpy.data.libraries.write(str(library), {mesh_object("Vase")})
    with bpy.data.libraries.load(str(library), link=True) as (_, wanted):
        wanted.objects = ["Vase"]
    linked(wanted.objects[0]).location.x = 5
    a, b = view().parts
    assert (a.name, b.name) == ("Vase", "Vase")
    assert {a.object_name, b.object_name} == {"Vase", "Vase [props.blend]"}
