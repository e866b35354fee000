# SPDX-License-Identifier: GPL-3.0-or-later
"""What an evaluated scene holds: meshes and lights in the world."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from itertools import chain
from typing import Any

import numpy as np
from numpy.typing import NDArray

from . import compat, lights
from .data import Light, Part, World
from .transform import moved, origin_for

# Curves, surfaces, text and metaballs are not among them: the depsgraph gives their meshes, too.
_WITHOUT_MESH = {
    "CURVES": "hair curves are not meshes",
    "GPENCIL": "Grease Pencil is not a mesh",
    "GREASEPENCIL": "Grease Pencil is not a mesh",
    "POINTCLOUD": "point clouds are not meshes",
    "VOLUME": "volumes are not meshes",
}

# A coordinate of the world is the sum of four products, and float32 ends at 3.4e38.
_MAX_PRODUCT = 5e37

_MIRROR = (0, 2, 1)


def read_world(depsgraph: Any, *, for_render: bool = True) -> World:
    """The meshes and lights of a depsgraph; they are copies.

    Args:
        depsgraph: a render engine's, or the viewport's.
        for_render: leave out objects that are hidden in renders, which the viewport's has.
    """
    return _Reader(depsgraph, for_render).read()


class _Mesh:
    """An evaluated mesh, shared by its instances.

    Attributes:
        vertices: (n, 3), of the mesh; none if it has no triangles.
        triangle_count: of the mesh.
        flaw: why it cannot be used, "" if it can.
    """

    def __init__(self, object: Any) -> None:
        self.triangle_count = 0
        self.flaw = ""
        self._triangles: dict[bool, NDArray[np.int32]] = {}
        self._casting: dict[frozenset[int], NDArray[np.bool_]] = {}
        with _mesh_of(object) as mesh:
            self._read(mesh)

    def _read(self, mesh: Any) -> None:
        corners = compat.corner_triangles(mesh)
        self.triangle_count = len(corners)
        if not self.triangle_count:
            return
        self.vertices = np.empty((len(mesh.vertices), 3), np.float32)
        mesh.attributes["position"].data.foreach_get("vector", self.vertices.ravel())
        vertex_of_corner = np.empty(len(mesh.loops), np.int32)
        mesh.attributes[".corner_vert"].data.foreach_get("value", vertex_of_corner)
        self._triangles[False] = _read_only(vertex_of_corner[corners])
        _read_only(self.vertices)
        self.reach = float(np.abs(self.vertices).max())
        if not np.isfinite(self.reach):
            bad = int(np.flatnonzero(~np.isfinite(self.vertices).all(axis=1))[0])
            self.flaw = f"its vertex {bad} is not at a finite place"

    def triangles(self, mirrored: bool) -> NDArray[np.int32]:
        """The triangles (m, 3), wound the other way if `mirrored`."""
        if mirrored not in self._triangles:
            self._triangles[mirrored] = _read_only(self._triangles[False].take(_MIRROR, axis=1))
        return self._triangles[mirrored]

    def casting(self, object: Any, not_solid: frozenset[int]) -> NDArray[np.bool_]:
        """(m,), triangles whose material is not among those of that index."""
        if not_solid not in self._casting:
            with _mesh_of(object) as mesh:
                material = compat.triangle_materials(mesh)
            # As Blender does with an index that has no material.
            np.clip(material, 0, len(object.data.materials) - 1, out=material)
            self._casting[not_solid] = _read_only(~np.isin(material, tuple(not_solid)))
        return self._casting[not_solid]


@dataclass(frozen=True)
class _Object:
    """What is asked of an object that has instances only once."""

    name: str
    full_name: str
    casts: bool
    is_seen: bool


class _Reader:
    def __init__(self, depsgraph: Any, for_render: bool) -> None:
        self._depsgraph = depsgraph
        self._view_layer = depsgraph.view_layer_eval
        # The viewport's graph has no other way to say it. An object that is hidden may have
        # instances that are not.
        self._drop_hidden = for_render and depsgraph.mode == "VIEWPORT"
        self._objects: dict[int, _Object] = {}
        self._meshes: dict[int, _Mesh] = {}
        self._not_solid = any(
            _is_set(data, "not_solid") for data in depsgraph.ids if data.id_type == "MATERIAL"
        )
        self._links = _Links(depsgraph)
        self._parts: list[Part] = []
        self._lights: list[Light] = []
        # How often the name of a light was given, with numbers.
        self._used: dict[str, int] = {}
        self._left_out: dict[tuple[str, str], None] = {}

    def read(self) -> World:
        for instance in self._depsgraph.object_instances:
            object = instance.object
            kind = object.type
            if not instance.show_self or (
                self._drop_hidden and object.hide_render and not instance.is_instance
            ):
                continue
            if kind == "MESH":
                self._add_mesh(instance, object)
            elif kind == "LIGHT":
                self._add_light(instance, object)
            elif kind in _WITHOUT_MESH:
                self._leave_out(self._name(instance, object), _WITHOUT_MESH[kind])
        known = frozenset(part.link_name for part in self._parts)
        origin = origin_for(part.matrix[:3, 3] for part in self._parts)
        return World(
            parts=tuple(replace(part, matrix=moved(part.matrix, origin)) for part in self._parts)
            if any(origin)
            else tuple(self._parts),
            lights=tuple(
                lights.moved(self._links.applied(light, known), origin) for light in self._lights
            ),
            left_out=tuple(self._left_out),
            origin=origin,
        )

    def _add_mesh(self, instance: Any, object: Any) -> None:
        own = self._object(object)
        owner = self._object(instance.parent) if instance.is_instance else own
        is_caster, is_receiver = own.casts and owner.casts, own.is_seen and owner.is_seen
        name = self._name(instance, object)
        if not instance.is_instance and any(map(_is_hair, object.modifiers)):
            self._leave_out(name, "its hair is made of particles, not meshes")
        if not (is_caster or is_receiver):
            return
        # A mesh lives as long as the graph is not evaluated again: its address is its own.
        key = object.data.as_pointer()
        mesh = self._meshes.get(key)
        if mesh is None:
            mesh = self._meshes[key] = _Mesh(object)
        if not mesh.triangle_count:
            return
        matrix = _rows(instance.matrix_world)
        determinant = instance.matrix_world.determinant()
        flaw = mesh.flaw or _flaw_of(matrix, determinant, mesh.reach)
        if flaw:
            self._leave_out(name, flaw)
            return
        casting = None
        if is_caster and self._not_solid:
            not_solid = frozenset(_not_solid_slots(object))
            if not_solid:
                casting = mesh.casting(object, not_solid)
        self._parts.append(
            Part(
                name=name,
                object_name=own.full_name,
                link_name=self._links.name_of(own.full_name, owner.full_name),
                vertices=mesh.vertices,
                triangles=mesh.triangles(mirrored=determinant < 0),
                matrix=matrix,
                is_caster=is_caster,
                is_receiver=is_receiver,
                casting=casting,
            )
        )

    def _add_light(self, instance: Any, object: Any) -> None:
        name = self._name(instance, object)
        if object.data.type == "AREA" and compat.is_portal(object.data):
            self._leave_out(name, "it is a portal, which does not shine")
            return
        unique = name
        while unique in self._used:
            self._used[name] += 1
            unique = f"{name} {self._used[name]}"
        self._used[unique] = 1
        self._lights.append(lights.read_light(object, _rows(instance.matrix_world), unique))

    def _object(self, object: Any) -> _Object:
        original = object.original
        key = original.as_pointer()
        if key not in self._objects:
            self._objects[key] = _Object(
                name=object.name,
                full_name=original.name_full,
                casts=object.visible_shadow and not _is_set(object, "exclude"),
                is_seen=object.visible_camera
                and not object.indirect_only_get(view_layer=self._view_layer),
            )
        return self._objects[key]

    def _name(self, instance: Any, object: Any) -> str:
        if instance.is_instance and instance.parent.original != object.original:
            return f"{object.name} in {instance.parent.name}"
        return object.name

    def _leave_out(self, name: str, reason: str) -> None:
        self._left_out[name, reason] = None


class _Links:
    """Light linking, as Cycles understands it.

    The collection of a light says of objects that they are included or excluded; an empty one
    says nothing. Without an included object all others are included. An instance is asked for
    by the object that makes it, if any light names that one, else by its own.
    """

    def __init__(self, depsgraph: Any) -> None:
        self._of_light: dict[str, tuple[dict[str, bool], dict[str, bool]]] = {}
        self._named: set[str] = set()
        # Not depsgraph.objects, which lacks those of instanced collections.
        for object in depsgraph.ids:
            if object.id_type != "OBJECT" or object.type != "LIGHT":
                continue
            linking = object.original.light_linking
            blockers = dict(_links_in(linking.blocker_collection))
            receivers = dict(_links_in(linking.receiver_collection))
            if blockers or receivers:
                self._of_light[object.original.name_full] = blockers, receivers
                self._named.update(blockers, receivers)

    def name_of(self, full_name: str, owner: str) -> str:
        """What an object's instance, made by `owner`, is named by."""
        return owner if owner in self._named else full_name

    def applied(self, light: Light, known: frozenset[str]) -> Light:
        """The light with its links, of those known names."""
        if light.object_name not in self._of_light:
            return light
        blockers, receivers = self._of_light[light.object_name]
        return replace(
            light, blockers=_included(blockers, known), receivers=_included(receivers, known)
        )


def _links_in(collection: Any) -> Iterator[tuple[str, bool]]:
    """Names of the objects, and whether they are included; the last one of a name counts."""
    if collection is None:
        return
    for child, entry in zip(collection.children, collection.collection_children, strict=True):
        included = entry.light_linking.link_state == "INCLUDE"
        yield from ((object.name_full, included) for object in child.all_objects)
    for object, entry in zip(collection.objects, collection.collection_objects, strict=True):
        yield object.name_full, entry.light_linking.link_state == "INCLUDE"


def _included(links: dict[str, bool], known: frozenset[str]) -> frozenset[str] | None:
    if not links:
        return None
    names = known
    if any(links.values()):
        names = frozenset(name for name, included in links.items() if included)
    return names - {name for name, included in links.items() if not included}


def _rows(matrix: Any) -> NDArray[np.float64]:
    # Before 5.1 five times as fast as np.array.
    return np.fromiter(chain.from_iterable(matrix), np.float64, 16).reshape(4, 4)


def _flaw_of(matrix: NDArray[np.float64], determinant: float, reach: float) -> str:
    """Why a mesh cannot be used there, "" if it can; `reach` is its largest coordinate."""
    largest = np.abs(matrix).max() * max(reach, 1.0)
    if not largest < _MAX_PRODUCT:  # or it is NaN
        return "its coordinates are too large" if largest < np.inf else "its place is not finite"
    # What is flat still has a shadow.
    if determinant == 0 and np.count_nonzero(matrix[:3, :3].any(axis=0)) < 2:
        return "it is scaled to nothing"
    return ""


@contextmanager
def _mesh_of(object: Any) -> Iterator[Any]:
    """The evaluated mesh. While it is edited, its own arrays may be empty."""
    if not object.data.is_editmode:
        yield object.data
        return
    try:
        yield object.to_mesh()
    finally:
        object.to_mesh_clear()


def _not_solid_slots(object: Any) -> Iterator[int]:
    slots = object.material_slots
    for index, material in enumerate(object.data.materials):
        # A slot may take its material from the object instead of the mesh.
        if index < len(slots) and slots[index].link == "OBJECT":
            material = slots[index].material
        if _is_set(material, "not_solid"):
            yield index


def _is_hair(modifier: Any) -> bool:
    if modifier.type != "PARTICLE_SYSTEM" or not modifier.show_render:
        return False
    settings = modifier.particle_system.settings
    return settings.type == "HAIR" and settings.render_type == "PATH"


def _is_set(owner: Any, name: str) -> bool:
    """A setting of the add-on's, which its owner has not while the add-on is not registered."""
    return bool(getattr(getattr(owner, "vocc", None), name, False))


def _read_only(array: Any) -> Any:
    array.flags.writeable = False
    return array
