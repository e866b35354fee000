"""Seeded generators of meshes: those that the demo draws, the tests trace, and ``pyvocc
reproduce`` takes where it is given none.

Every generator returns ``(vertices, triangles)``: float32 ``(V, 3)`` and int32
``(T, 3)``, y up.  Unless its docstring says otherwise the mesh is closed (every edge
of the mesh, vertices at equal positions being one, has an even number of triangles)
and wound counter-clockwise seen from outside.  Nothing is read from a file or a
network, and the same arguments give the same mesh.

    >>> vertices, triangles = GENERATORS["icosphere"](level=2)
    >>> topology(vertices, triangles).closed
    True
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

Vertices = NDArray[np.float32]
Triangles = NDArray[np.int32]
Mesh = tuple[Vertices, Triangles]
Floats = NDArray[np.float64]


# ---- tools ---------------------------------------------------------------------------


def _mesh(vertices: ArrayLike, triangles: ArrayLike) -> Mesh:
    return (
        np.ascontiguousarray(vertices, np.float32).reshape(-1, 3),
        np.ascontiguousarray(triangles, np.int32).reshape(-1, 3),
    )


def combine(*meshes: Mesh) -> Mesh:
    """The meshes in one, their vertices and triangles in the order given."""
    vertices = np.concatenate([m[0] for m in meshes])
    starts = np.cumsum([0] + [len(m[0]) for m in meshes[:-1]])
    triangles = np.concatenate([m[1] + s for m, s in zip(meshes, starts, strict=True)])
    return _mesh(vertices, triangles)


def inverted(mesh: Mesh) -> Mesh:
    """The mesh with every triangle wound the other way."""
    return _mesh(mesh[0], mesh[1][:, ::-1])


def transformed(
    mesh: Mesh,
    scale: ArrayLike = 1.0,
    rotate_y: float = 0.0,
    translate: ArrayLike = (0.0, 0.0, 0.0),
) -> Mesh:
    """The mesh scaled, turned about y (degrees), then moved."""
    turn = np.radians(rotate_y)
    c, s = np.cos(turn), np.sin(turn)
    matrix = np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])
    moved = (mesh[0].astype(np.float64) * np.asarray(scale)) @ matrix.T + np.asarray(translate)
    return _mesh(moved, mesh[1])


def subdivided(mesh: Mesh, levels: int = 4) -> Mesh:
    """The same surface with every triangle cut into 4^levels: coarse solids get an inside.

    A kd-tree cannot cut empty space out of a box of twelve triangles; out of this it can.
    """
    vertices, triangles = mesh
    for _ in range(levels):
        t = triangles.astype(np.int64)
        pairs = np.stack([t, np.roll(t, -1, axis=1)], axis=-1).reshape(-1, 2)
        edges, index = np.unique(np.sort(pairs, axis=1), axis=0, return_inverse=True)
        # The middle of an edge comes out alike from both its ends: no crack opens, also not
        # where an edge's vertices are there twice.
        middle = (vertices[edges[:, 0]] + vertices[edges[:, 1]]) * np.float32(0.5)
        a, b, c = t.T
        ab, bc, ca = (index.reshape(-1, 3) + len(vertices)).T
        corners = [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
        parts = np.stack([np.stack(part, axis=-1) for part in corners], axis=1)
        vertices, triangles = _mesh(np.concatenate([vertices, middle]), parts)
    return vertices, triangles


@dataclass(frozen=True)
class Topology:
    """What `topology` counts, vertices at equal positions being one."""

    vertices: int
    """Distinct positions that triangles use."""
    edges: int
    triangles: int
    boundary_edges: int
    """Edges with an odd number of triangles."""
    nonmanifold_edges: int
    """Edges with more than two triangles."""
    inconsistent_edges: int
    """Edges that are not passed as often one way as the other."""
    components: int
    """Sets of triangles that hang together by edges."""
    volume: float
    """Signed; positive: normals point outward."""

    @property
    def closed(self) -> bool:
        return self.boundary_edges == 0

    @property
    def euler(self) -> int:
        """V - E + T; 2 for each sphere, 2 - 2 g for a surface of genus g."""
        return self.vertices - self.edges + self.triangles


def topology(vertices: ArrayLike, triangles: ArrayLike) -> Topology:
    """Counts a mesh's edges by brute force: independent of the library under test."""
    v = np.asarray(vertices, np.float64) + 0.0  # -0 and 0 are one position
    t = np.asarray(triangles, np.int64).reshape(-1, 3)
    _, weld = np.unique(v, axis=0, return_inverse=True)
    t = weld.reshape(-1)[t]
    start = t.reshape(-1)
    end = np.roll(t, -1, axis=1).reshape(-1)
    real = start != end
    low, high = np.minimum(start, end)[real], np.maximum(start, end)[real]
    _, edge_of, count = np.unique(
        low * (len(v) + 1) + high, return_inverse=True, return_counts=True
    )
    balance = np.bincount(edge_of, np.where(start[real] < end[real], 1.0, -1.0))
    # Components: every triangle takes the smallest label among its edges until none changes.
    owner = np.repeat(np.arange(len(t)), 3)[real]
    label = np.arange(len(t))
    while len(t):
        best = np.full(len(count), len(t))
        np.minimum.at(best, edge_of, label[owner])
        new = label.copy()
        np.minimum.at(new, owner, best[edge_of])
        new = new[new]  # jump to the label's own label: logarithmic, not linear
        if np.array_equal(new, label):
            break
        label = new
    a, b, c = (v[np.asarray(triangles).reshape(-1, 3)[:, k]] for k in range(3))
    return Topology(
        vertices=len(np.unique(t)),
        edges=len(count),
        triangles=len(t),
        boundary_edges=int(np.count_nonzero(count % 2)),
        nonmanifold_edges=int(np.count_nonzero(count > 2)),
        inconsistent_edges=int(np.count_nonzero(balance)),
        components=len(np.unique(label)),
        volume=float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6.0),
    )


def _hash(x: NDArray[np.uint32]) -> NDArray[np.uint32]:
    x = (x ^ (x >> np.uint32(16))) * np.uint32(0x7FEB352D)
    x = (x ^ (x >> np.uint32(15))) * np.uint32(0x846CA68B)
    return x ^ (x >> np.uint32(16))


def noise(points: ArrayLike, seed: int) -> Floats:
    """Smooth value noise, -1 to 1, one feature a unit of length; ``points`` is (N, 3)."""
    p = np.asarray(points, np.float64)
    cell = np.floor(p)
    f = p - cell
    f = f * f * f * (f * (f * 6 - 15) + 10)
    base = cell.astype(np.int64)
    total = np.zeros(len(p))
    for corner in np.ndindex(2, 2, 2):
        x, y, z = ((base[:, k] + corner[k]).astype(np.uint32) for k in range(3))
        bits = _hash(x + _hash(y + _hash(z + np.uint32(seed & 0xFFFFFFFF))))
        weight = np.prod([f[:, k] if corner[k] else 1 - f[:, k] for k in range(3)], axis=0)
        total += weight * (bits.astype(np.float64) / 2**31 - 1)
    return total


def fractal(points: ArrayLike, seed: int, octaves: int = 5, gain: float = 0.5) -> Floats:
    """Octaves of `noise`, each twice as fine and ``gain`` times as high."""
    p = np.asarray(points, np.float64)
    total, height = np.zeros(len(p)), 1.0
    for octave in range(octaves):
        # The shift keeps the lattices of the octaves from lining up at the origin.
        total += height * noise(p * 2.0**octave + 17.31 * octave, seed + octave)
        height *= gain
    return total


def _loft(rings: Floats) -> Mesh:
    """A closed tube from R rings of S points each, ``(R, S, 3)``, with a fan at each end.

    Rings turn counter-clockwise seen from where the tube is heading.
    """
    count, sides = rings.shape[:2]
    i, j = np.meshgrid(np.arange(count - 1), np.arange(sides), indexing="ij")
    a, b = i * sides + j, i * sides + (j + 1) % sides
    c, d = a + sides, b + sides
    body = np.stack([a, b, d, a, d, c], axis=-1).reshape(-1, 3)
    first, last = count * sides, count * sides + 1
    k = np.arange(sides)
    n = (k + 1) % sides
    top = (count - 1) * sides
    start = np.stack([np.full(sides, first), n, k], axis=-1)
    end = np.stack([np.full(sides, last), top + k, top + n], axis=-1)
    vertices = np.concatenate([rings.reshape(-1, 3), [rings[0].mean(0), rings[-1].mean(0)]])
    return _mesh(vertices, np.concatenate([body, start, end]))


def _frames(path: Floats, up: ArrayLike) -> tuple[Floats, Floats]:
    """Two unit vectors across each point of a path; (u, v, heading) is right-handed."""
    heading = np.gradient(path, axis=0)
    heading /= np.linalg.norm(heading, axis=1, keepdims=True)
    u = np.cross(np.broadcast_to(np.asarray(up, np.float64), path.shape), heading)
    u /= np.linalg.norm(u, axis=1, keepdims=True)
    return u, np.cross(heading, u)


def _tube(path: Floats, radius: ArrayLike, sides: int, up: ArrayLike) -> Mesh:
    """A capped tube of the given radius, or radii, about an open path."""
    u, v = _frames(path, up)
    turn = np.arange(sides) * (2 * np.pi / sides)
    r = np.broadcast_to(np.asarray(radius, np.float64), len(path))[:, None, None]
    ring = np.cos(turn)[:, None] * u[:, None] + np.sin(turn)[:, None] * v[:, None]
    return _loft(path[:, None] + r * ring)


# The six tetrahedra of a cube about its main diagonal (Kuhn); corner number = x + 2 y + 4 z.
# All are positively oriented, and cubes side by side agree on their common faces.
_TETRAHEDRA = ((0, 1, 3, 7), (0, 3, 2, 7), (0, 2, 6, 7), (0, 6, 4, 7), (0, 4, 5, 7), (0, 5, 1, 7))


def _marching_cases() -> list[tuple[int, list[tuple[tuple[int, int], ...]]]]:
    """(mask of inside corners, triangles as three cut edges each) of a tetrahedron."""
    even = {0: (0, 1, 2, 3), 1: (1, 0, 3, 2), 2: (2, 0, 1, 3), 3: (3, 0, 2, 1)}
    cases: list[tuple[int, list[tuple[tuple[int, int], ...]]]] = []
    for i, j, k, m in even.values():
        cases.append((1 << i, [((i, j), (i, k), (i, m))]))
        cases.append((15 - (1 << i), [((i, j), (i, m), (i, k))]))
    for i, j, k, m in (
        (0, 1, 2, 3),
        (0, 2, 3, 1),
        (0, 3, 1, 2),
        (1, 2, 0, 3),
        (1, 3, 2, 0),
        (2, 3, 0, 1),
    ):
        quad = ((i, k), (i, m), (j, m), (j, k))
        cases.append(((1 << i) | (1 << j), [quad[:3], (quad[0], quad[2], quad[3])]))
    return cases


def isosurface(values: ArrayLike, lower: ArrayLike, upper: ArrayLike) -> Mesh:
    """The surface between negative (inside) and positive samples of a grid.

    ``values`` is (X, Y, Z), its corners at ``lower`` and ``upper``.  Marching
    tetrahedra: whatever the topology, every edge has exactly two triangles.  Raises
    ValueError if the solid touches the grid's border.
    """
    f = np.asarray(values, np.float64)
    nx, ny, nz = f.shape
    inside = f < 0
    if any(np.take(inside, k, axis=axis).any() for axis in range(3) for k in (0, -1)):
        raise ValueError("the solid touches the border of the grid")
    flat = inside.reshape(-1)
    offsets = np.array([x * ny * nz + y * nz + z for z in (0, 1) for y in (0, 1) for x in (0, 1)])
    count = np.zeros((nx - 1, ny - 1, nz - 1), np.int8)
    for x, y, z in np.ndindex(2, 2, 2):
        count += inside[x : x + nx - 1, y : y + ny - 1, z : z + nz - 1]
    cx, cy, cz = np.nonzero((count > 0) & (count < 8))
    corner = cx * (ny * nz) + cy * nz + cz
    keys = []
    for tetrahedron in _TETRAHEDRA:
        ids = corner[:, None] + offsets[list(tetrahedron)]
        mask = (flat[ids] * np.array([1, 2, 4, 8])).sum(axis=1)
        for case, triangles in _marching_cases():
            rows = ids[mask == case]
            for edges in triangles:
                key = []
                for a, b in edges:
                    # Corners of a Kuhn tetrahedron rise along the diagonal, so the
                    # edge runs from the lower number by one of seven steps.
                    if tetrahedron[a] > tetrahedron[b]:
                        a, b = b, a
                    key.append(rows[:, a] * 8 + (tetrahedron[b] ^ tetrahedron[a]))
                keys.append(np.stack(key, axis=-1))
    edge, index = np.unique(np.concatenate(keys), return_inverse=True)
    start, step = edge // 8, edge % 8
    end = start + offsets[step]
    fs, fe = f.reshape(-1)[start], f.reshape(-1)[end]
    # Kept from the ends, so that no two cuts fall on one grid point.
    t = np.clip(fs / (fs - fe), 0.04, 0.96)[:, None]
    size = np.array([nx, ny, nz])
    lo, hi = np.asarray(lower, np.float64), np.asarray(upper, np.float64)

    def place(ids: NDArray[np.int64]) -> Floats:
        grid = np.stack([ids // (ny * nz), ids // nz % ny, ids % nz], axis=-1)
        return np.asarray(lo + grid * ((hi - lo) / (size - 1)))

    return _mesh(place(start) * (1 - t) + place(end) * t, index.reshape(-1, 3))


class _Blend:
    """A solid of capsules and ellipsoids that flow into one another, sampled on a grid."""

    def __init__(self, lower: ArrayLike, upper: ArrayLike, cell: float, blend: float) -> None:
        self.lower = np.asarray(lower, np.float64)
        cells = np.maximum(np.ceil((np.asarray(upper) - self.lower) / cell).astype(int), 2)
        self.upper = self.lower + cells * cell
        self.axes = [self.lower[k] + cell * np.arange(cells[k] + 1) for k in range(3)]
        self.values = np.full(cells + 1, 4.0 * cell + blend)
        self.blend = blend

    def _add(self, lower: Floats, upper: Floats, distance: Callable[[Floats], Floats]) -> None:
        margin = self.blend + 4.0 * (self.axes[0][1] - self.axes[0][0])
        box = tuple(
            slice(*np.searchsorted(self.axes[k], [lower[k] - margin, upper[k] + margin]))
            for k in range(3)
        )
        grid = np.stack(np.meshgrid(*(self.axes[k][box[k]] for k in range(3)), indexing="ij"), -1)
        old, new = self.values[box], distance(grid)
        # Polynomial smooth minimum: equals the minimum where the two differ by `blend`.
        h = np.maximum(self.blend - np.abs(old - new), 0.0) / max(self.blend, 1e-12)
        self.values[box] = np.minimum(old, new) - h * h * self.blend / 4

    def capsule(self, a: ArrayLike, b: ArrayLike, ra: float, rb: float | None = None) -> None:
        """A rod from a to b whose radius goes from ra to rb."""
        p, q = np.asarray(a, np.float64), np.asarray(b, np.float64)
        end = ra if rb is None else rb
        axis = q - p
        length2 = max(float(axis @ axis), 1e-12)

        def distance(x: Floats) -> Floats:
            t = np.clip((x - p) @ axis / length2, 0.0, 1.0)
            away = np.linalg.norm(x - p - t[..., None] * axis, axis=-1)
            return np.asarray(away - (ra + (end - ra) * t))

        r = max(ra, end)
        self._add(np.minimum(p, q) - r, np.maximum(p, q) + r, distance)

    def ellipsoid(self, centre: ArrayLike, radii: ArrayLike) -> None:
        c, r = np.asarray(centre, np.float64), np.asarray(radii, np.float64)

        def distance(x: Floats) -> Floats:
            return np.asarray((np.linalg.norm((x - c) / r, axis=-1) - 1.0) * r.min())

        self._add(c - r, c + r, distance)

    def surface(self) -> Mesh:
        return isosurface(self.values, self.lower, self.upper)


# ---- simple solids -------------------------------------------------------------------


def cuboid(lower: ArrayLike, upper: ArrayLike) -> Mesh:
    """An axis-parallel box: 8 vertices, 12 triangles, every face in a plane."""
    corner = np.array([[k & 1, k >> 1 & 1, k >> 2 & 1] for k in range(8)])
    quads = [(0, 4, 6, 2), (1, 3, 7, 5), (0, 1, 5, 4), (2, 6, 7, 3), (0, 2, 3, 1), (4, 5, 7, 6)]
    triangles = [t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))]
    return _mesh(np.where(corner, np.asarray(upper), np.asarray(lower)), triangles)


def cube(size: float = 2.0, centre: ArrayLike = (0.0, 0.0, 0.0)) -> Mesh:
    """A cube about ``centre``: the smallest solid whose faces lie in split planes."""
    c = np.asarray(centre, np.float64)
    return cuboid(c - size / 2, c + size / 2)


def inverted_cube(size: float = 2.0, centre: ArrayLike = (0.0, 0.0, 0.0)) -> Mesh:
    """A cube wound inward (negative volume): its inside must still be an occluder."""
    return inverted(cube(size, centre))


def cube_missing_face(size: float = 2.0) -> Mesh:
    """A cube without its +y face (open: 4 boundary edges): has no inside at all."""
    vertices, triangles = cube(size)
    return _mesh(vertices, np.delete(triangles, (6, 7), axis=0))


def plane(size: float = 8.0, height: float = 0.0) -> Mesh:
    """A square that faces +y (open: 4 boundary edges), as a ground."""
    s = size / 2
    vertices = [(-s, height, -s), (s, height, -s), (s, height, s), (-s, height, s)]
    return _mesh(vertices, [(0, 2, 1), (0, 3, 2)])


def cube_and_plane(size: float = 2.0, ground: float = 8.0) -> Mesh:
    """A cube whose lower half is under an open square: a closed and an open component.

    The square cuts the cube's inside, which stays one region: an open sheet separates
    nothing.
    """
    return combine(cube(size), plane(ground))


def overlapping_cubes() -> Mesh:
    """Three cubes that share volume (winding numbers 0 to 3), faces in general position."""
    return combine(
        cube(2.0),
        cube(2.0, (0.731, 0.487, 0.269)),
        transformed(cube(1.5), 1.0, 30, (0.5, 0.9, -0.3)),
    )


def touching_solids(same_diagonal: bool = True) -> Mesh:
    """Two boxes with one whole face in common: its edges have four triangles.

    The face's triangles are there twice, wound against each other; with
    ``same_diagonal=False`` they also cross.  A ray in that face meets no space between.
    """
    left, right = cuboid((-1, -1, -1), (0, 1, 1)), cuboid((0, -1, -1), (1, 1, 1))
    vertices, triangles = right
    # The -x face of `cuboid` is its first quad (0, 4, 6, 2), cut along 0-6; the +x face
    # (1, 3, 7, 5) along 1-7, which is the same diagonal in space.
    if not same_diagonal:
        triangles = triangles.copy()
        triangles[0:2] = [(4, 6, 2), (4, 2, 0)]
    return combine(left, (vertices, triangles))


def hollow_room(size: float = 4.0, wall: float = 0.25) -> Mesh:
    """A cube-shaped room with thick walls: an outer and an inner surface, wound inward.

    A light inside sees its walls only; nothing outside sees it.
    """
    return combine(cube(size + 2 * wall), inverted(cube(size)))


def furnished_room(size: float = 4.0, wall: float = 0.25) -> Mesh:
    """`hollow_room` with a table of overlapping boxes and a ball, for a light inside."""
    h = size / 2
    table = [cuboid((-0.8, -0.55, -0.5), (0.8, -0.45, 0.5))]
    for x in (-0.7, 0.7):
        for z in (-0.4, 0.4):
            # Legs end inside the table's top and inside the floor's wall.
            table.append(cuboid((x - 0.05, -h - wall / 2, z - 0.05), (x + 0.05, -0.5, z + 0.05)))
    ball = transformed(icosphere(3), 0.3, 0.0, (0.1, -0.15, 0.0))
    return combine(hollow_room(size, wall), *table, ball)


def thin_plates(count: int = 9, thickness: float = 1e-4, seed: int = 5) -> Mesh:
    """Tilted plates ``thickness`` thick: occluders thinner than a ray's offset."""
    random = np.random.default_rng(seed)
    plates = []
    for k in range(count):
        plate = np.array(cuboid((-0.5, -thickness / 2, -0.5), (0.5, thickness / 2, 0.5))[0], float)
        # Every third plate stays level, its faces parallel to split planes.
        axis = random.normal(size=3) if k % 3 else np.array([0.0, 1.0, 0.0])
        plate = plate @ _rotation(axis, random.uniform(0, 2 * np.pi)).T
        plates.append(_mesh(plate + random.uniform(-1, 1, 3) * (1, 0.8, 1), cube()[1]))
    return combine(*plates)


def _rotation(axis: ArrayLike, angle: float) -> Floats:
    x, y, z = np.asarray(axis, np.float64) / np.linalg.norm(axis)
    skew = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.asarray(np.eye(3) + np.sin(angle) * skew + (1 - np.cos(angle)) * (skew @ skew))


# ---- spheres -------------------------------------------------------------------------


def _icosahedron() -> tuple[Floats, NDArray[np.int64]]:
    g = (1 + 5**0.5) / 2
    v = [(s * 1.0, t * g, 0.0) for s in (-1, 1) for t in (-1, 1)]
    vertices = np.array([(p[k % 3], p[(k + 1) % 3], p[(k + 2) % 3]) for k in range(3) for p in v])
    # The twenty triples of mutual neighbours, turned so that they face outward.
    near = np.linalg.norm(vertices[:, None] - vertices, axis=-1) < 2.1
    faces = []
    for a in range(12):
        for b in range(a + 1, 12):
            for c in range(b + 1, 12):
                if near[a, b] and near[b, c] and near[c, a]:
                    normal = np.cross(vertices[b] - vertices[a], vertices[c] - vertices[a])
                    faces.append((a, b, c) if normal @ vertices[a] > 0 else (a, c, b))
    return vertices / np.linalg.norm(vertices[0]), np.array(faces)


def geodesic_sphere(frequency: int = 16, radius: float = 1.0) -> Mesh:
    """A sphere of 20 frequency² nearly equal triangles about the origin."""
    n = frequency
    if n < 1:
        raise ValueError(f"frequency: expected at least 1, got {n}")
    corners, faces = _icosahedron()
    i, j = np.nonzero(np.add.outer(np.arange(n + 1), np.arange(n + 1)) <= n)
    weights = np.stack([n - i - j, i, j], axis=-1)
    number = np.full((n + 2, n + 2), -1)
    number[i, j] = np.arange(len(i))
    # A point on an edge belongs to two faces: its key names corners and weights, not faces.
    owner = np.where(weights[None] > 0, faces[:, None, :], 12)
    order = np.argsort(owner, axis=-1)
    pairs = np.take_along_axis(owner * (n + 1) + weights[None], order, axis=-1).astype(np.int64)
    base = 13 * (n + 1)
    key = (pairs[..., 0] * base + pairs[..., 1]) * base + pairs[..., 2]
    points = np.einsum("mk,fkc->fmc", weights / n, corners[faces])
    _, first, index = np.unique(key, return_index=True, return_inverse=True)
    vertices = points.reshape(-1, 3)[first]
    vertices *= radius / np.linalg.norm(vertices, axis=1, keepdims=True)
    a, b, c, d = number[i, j], number[i + 1, j], number[i, j + 1], number[i + 1, j + 1]
    up, down = i + j < n, i + j < n - 1
    local = np.concatenate(
        [np.stack([a[up], b[up], c[up]], -1), np.stack([b[down], d[down], c[down]], -1)]
    )
    return _mesh(vertices, index.reshape(len(faces), -1)[:, local])


def icosphere(level: int = 3, radius: float = 1.0) -> Mesh:
    """A sphere of 20 · 4^level triangles; level 7 has the 327 680 of the crack test."""
    if not 0 <= level <= 9:
        raise ValueError(f"level: expected 0 to 9, got {level}")
    return geodesic_sphere(2**level, radius)


def nested_shells(
    level: int = 3,
    radii: Sequence[float] = (1.0, 0.8, 0.6, 0.4),
    windings: Sequence[int] = (1, -1, 1, -1),
) -> Mesh:
    """Spheres inside one another; a winding of -1 turns that shell inside out.

    With alternating windings every second layer is hollow by winding number; with all 1
    the numbers rise to the middle.  Both block alike.
    """
    shells = []
    for radius, winding in zip(radii, windings, strict=True):
        shell = icosphere(level, radius)
        shells.append(shell if winding > 0 else inverted(shell))
    return combine(*shells)


def bumpy_solid(
    frequency: int = 64, seed: int = 7, height: float = 0.22, scale: float = 1.6
) -> Mesh:
    """A lump of rock, like a scan: a sphere moved in and out by fractal noise.

    20 frequency² triangles of every size, genus 0; 128 gives 327 680.
    """
    vertices, triangles = geodesic_sphere(frequency)
    p = vertices.astype(np.float64)
    # The noise is looked up at a place that noise has moved: folds instead of round bumps.
    warp = np.stack([fractal(p * scale, seed + 100 * k, 3) for k in (1, 2, 3)], axis=-1)
    lumps = fractal(p * scale + 0.4 * warp, seed, 7, 0.46)
    ridges = 1 - 2 * np.abs(fractal(p * scale * 0.9 + 0.2 * warp, seed + 51, 3, 0.45))
    return _mesh(p * (1 + height * (0.8 * lumps + 0.35 * ridges))[:, None], triangles)


# ---- tubes ---------------------------------------------------------------------------


def torus_knot(
    p: int = 2,
    q: int = 3,
    segments: int = 256,
    sides: int = 24,
    tube: float = 0.22,
    radius: float = 1.0,
    minor: float = 0.45,
) -> Mesh:
    """A tube about the (p, q) torus knot, upright in the xy plane: genus 1, no faces flat.

    2 · segments · sides triangles.  p and q without a common divisor.
    """
    t = np.arange(segments) * (2 * np.pi / segments)
    swing = np.stack([np.cos(p * t), np.sin(p * t), np.zeros_like(t)], axis=-1)
    around = np.stack([-np.sin(p * t), np.cos(p * t), np.zeros_like(t)], axis=-1)
    out = np.cos(q * t)[:, None] * swing + np.sin(q * t)[:, None] * np.array([0.0, 0.0, 1.0])
    along = -np.sin(q * t)[:, None] * swing + np.cos(q * t)[:, None] * np.array([0.0, 0.0, 1.0])
    path = radius * swing + minor * out
    # The curve's own derivative; `out` is never parallel to it, and both are periodic.
    heading = p * (radius + minor * np.cos(q * t))[:, None] * around + minor * q * along
    heading /= np.linalg.norm(heading, axis=1, keepdims=True)
    u = out - np.einsum("ij,ij->i", out, heading)[:, None] * heading
    u /= np.linalg.norm(u, axis=1, keepdims=True)
    v = np.cross(heading, u)
    turn = np.arange(sides) * (2 * np.pi / sides)
    ring = np.cos(turn)[:, None] * u[:, None] + np.sin(turn)[:, None] * v[:, None]
    i, j = np.meshgrid(np.arange(segments), np.arange(sides), indexing="ij")
    a, b = i * sides + j, i * sides + (j + 1) % sides
    c, d = (i + 1) % segments * sides + j, (i + 1) % segments * sides + (j + 1) % sides
    return _mesh(path[:, None] + tube * ring, np.stack([a, b, d, a, d, c], axis=-1))


def fat_knot(segments: int = 128, sides: int = 24, tube: float = 0.48) -> Mesh:
    """A torus knot so fat that it runs into itself: one component, winding number 2 inside."""
    return torus_knot(2, 3, segments, sides, tube)


def tube_network(
    cells: int = 4, cell: float = 0.06, radius: float = 0.13, share: float = 0.55, seed: int = 3
) -> Mesh:
    """Rods along a random half of a cubic lattice's edges, bent: one surface of high genus.

    ``cells``³ nodes a unit apart, ``share`` of the edges beyond those that join them all.
    Thin occluders everywhere and none large: the case where they help least.
    """
    random = np.random.default_rng(seed)
    nodes = np.array(list(np.ndindex(cells, cells, cells)))
    number = {tuple(node): k for k, node in enumerate(nodes.tolist())}
    edges = [
        (k, number[far])
        for k, node in enumerate(nodes.tolist())
        for axis in range(3)
        if (far := tuple(c + (a == axis) for a, c in enumerate(node))) in number
    ]
    parent = list(range(len(nodes)))

    def root(k: int) -> int:
        while parent[k] != k:
            k = parent[k]
        return k

    solid = _Blend((-0.4,) * 3, (cells - 0.6,) * 3, cell, 0.06)
    for index in random.permutation(len(edges)):
        a, b = edges[index]
        joins = root(a) != root(b)
        if joins or random.random() < share:
            parent[root(a)] = root(b)
            solid.capsule(nodes[a], nodes[b], radius)
    vertices, triangles = solid.surface()
    p = vertices.astype(np.float64)
    # One smooth displacement of space: bends the rods and cannot tear the surface.
    bend = np.stack([noise(p * 0.45, seed + k) for k in (11, 12, 13)], axis=-1)
    p = (p + 0.5 * bend) / cells
    return _mesh(p - (p.min(0) + p.max(0)) / 2, triangles)


# ---- figures and plants --------------------------------------------------------------


def _ball(centre: ArrayLike, radii: ArrayLike, frequency: int = 6) -> Mesh:
    vertices, triangles = geodesic_sphere(frequency)
    return _mesh(vertices * np.asarray(radii) + np.asarray(centre), triangles)


def _rod(a: ArrayLike, b: ArrayLike, ra: float, rb: float, sides: int = 14) -> Mesh:
    t = np.linspace(0, 1, 5)[:, None]
    path = np.asarray(a, np.float64) * (1 - t) + np.asarray(b, np.float64) * t
    return _tube(path, ra + (rb - ra) * t[:, 0], sides, (0.31, 0.2, 1.0))


def _limb(a: ArrayLike, b: ArrayLike, ra: float, rb: float, sides: int = 18) -> Mesh:
    """A rod with round ends, whose radius goes from ra at a to rb at b."""
    p, q = np.asarray(a, np.float64), np.asarray(b, np.float64)
    axis = (q - p) / np.linalg.norm(q - p)
    turn = np.linspace(0.12, np.pi / 2, 6)
    start = [(p - axis * ra * np.cos(t), ra * np.sin(t)) for t in turn]
    end = [(q + axis * rb * np.cos(t), rb * np.sin(t)) for t in turn[::-1]]
    path, radius = zip(*start, *end, strict=True)
    return _tube(np.array(path), radius, sides, (0.31, 0.2, 1.0))


def thirteen_shells() -> Mesh:
    """A standing figure of 13 closed parts that overlap at the joints, feet at y = 0.

    As game figures are made; the overlaps have winding number 2 and are never welded.
    """
    parts = [
        _ball((0.0, 1.60, 0.0), (0.15, 0.20, 0.16), 10),  # head
        _rod((0.0, 1.68, 0.0), (0.0, 1.715, 0.0), 0.31, 0.30, 24),  # brim of the hat
        _rod((0.0, 1.69, 0.0), (0.0, 1.90, 0.0), 0.165, 0.13, 20),  # crown
        _ball((0.0, 1.18, 0.0), (0.25, 0.32, 0.16), 12),  # chest
        _ball((0.0, 0.88, 0.0), (0.22, 0.17, 0.155), 10),  # hips
    ]
    for side in (-1.0, 1.0):
        shoulder, elbow = (side * 0.23, 1.38, 0.0), (side * 0.43, 1.13, 0.0)
        hand = (side * 0.30, 0.93, 0.22)
        parts += [
            _limb(shoulder, elbow, 0.085, 0.068),
            _limb((side * 0.42, 1.12, 0.01), hand, 0.066, 0.058),
            _limb((side * 0.115, 0.84, 0.0), (side * 0.18, 0.14, 0.0), 0.125, 0.08, 24),
            _ball((side * 0.19, 0.08, 0.07), (0.09, 0.08, 0.19), 8),  # boot
        ]
    return combine(*parts)


def figure(cell: float = 0.03, noise_height: float = 0.0, seed: int = 1) -> Mesh:
    """A low-poly figure with one arm raised: one surface, genus 0, feet at y = 0.

    About 5 000 triangles; ``cell`` is the grid it is cut from, and sets their number.
    """
    solid = _Blend((-0.75, -0.1, -0.4), (0.75, 2.3, 0.5), cell, 0.05)
    solid.ellipsoid((0.0, 1.70, 0.03), (0.115, 0.155, 0.135))
    solid.capsule((0.0, 1.58, 0.0), (0.0, 1.42, 0.0), 0.055, 0.07)
    solid.capsule((-0.13, 1.36, 0.0), (0.13, 1.36, 0.0), 0.10)
    solid.ellipsoid((0.0, 1.24, 0.0), (0.19, 0.20, 0.125))
    solid.ellipsoid((0.0, 1.05, 0.0), (0.145, 0.17, 0.105))
    solid.ellipsoid((0.0, 0.90, 0.0), (0.18, 0.15, 0.13))
    solid.capsule((-0.20, 1.38, 0.0), (-0.40, 1.60, 0.05), 0.072, 0.055)
    solid.capsule((-0.40, 1.60, 0.05), (-0.37, 1.90, 0.08), 0.052, 0.040)
    solid.ellipsoid((-0.365, 1.98, 0.085), (0.05, 0.085, 0.035))
    solid.capsule((0.20, 1.37, 0.0), (0.36, 1.10, -0.02), 0.072, 0.055)
    solid.capsule((0.36, 1.10, -0.02), (0.40, 0.86, 0.12), 0.052, 0.040)
    solid.ellipsoid((0.405, 0.79, 0.16), (0.04, 0.08, 0.05))
    solid.capsule((-0.10, 0.86, 0.0), (-0.15, 0.48, 0.05), 0.105, 0.075)
    solid.capsule((-0.15, 0.48, 0.05), (-0.18, 0.09, -0.02), 0.072, 0.05)
    solid.capsule((0.10, 0.86, 0.0), (0.15, 0.48, 0.0), 0.105, 0.075)
    solid.capsule((0.15, 0.48, 0.0), (0.19, 0.09, -0.08), 0.072, 0.05)
    solid.capsule((-0.18, 0.07, -0.03), (-0.21, 0.055, 0.16), 0.065, 0.045)
    solid.capsule((0.19, 0.07, -0.09), (0.24, 0.055, 0.09), 0.065, 0.045)
    vertices, triangles = solid.surface()
    p = vertices.astype(np.float64)
    if noise_height:
        p += noise_height * np.stack([fractal(p * 9, seed + k, 3) for k in range(3)], axis=-1)
    p[:, 1] -= p[:, 1].min()
    return _mesh(p, triangles)


def _sheet(top: Floats, bottom: Floats) -> Mesh:
    """Two (M, N, 3) grids closed to a thin solid along their common border.

    ``top`` faces the side from which rows go right and columns away.
    """
    m, n = top.shape[:2]
    number_top = np.arange(m * n).reshape(m, n)
    number_bottom = number_top.copy()
    number_bottom[1:-1, 1:-1] = m * n + np.arange((m - 2) * (n - 2)).reshape(m - 2, n - 2)
    i, j = np.meshgrid(np.arange(m - 1), np.arange(n - 1), indexing="ij")
    # Diagonals run from each of the four corners inward; otherwise a corner's triangle
    # would have all its vertices on the border and lie on its own underside.
    main = ((i < (m - 1) / 2) == (j < (n - 1) / 2))[..., None]
    halves = []
    for number in (number_top, number_bottom):
        a, b, c, d = number[i, j], number[i + 1, j], number[i + 1, j + 1], number[i, j + 1]
        one = np.stack([a, b, c, a, c, d], axis=-1)
        two = np.stack([a, b, d, b, c, d], axis=-1)
        halves.append(np.where(main, one, two).reshape(-1, 3))
    vertices = np.concatenate([top.reshape(-1, 3), bottom[1:-1, 1:-1].reshape(-1, 3)])
    return _mesh(vertices, np.concatenate([halves[0], halves[1][:, ::-1]]))


def flower(petals: int = 26, detail: int = 24, thickness: float = 0.014, seed: int = 2) -> Mesh:
    """A rose of thin closed petals on a stem, its foot at y = 0: many small occluders.

    petals · 4 · detail² triangles and a few more; each petal is its own component.
    """
    random = np.random.default_rng(seed)
    parts = []
    across = np.linspace(-1.0, 1.0, detail + 1)[:, None]
    along = np.linspace(0.0, 1.0, detail + 1)[None, :]
    step = 1e-4
    for k in range(petals):
        age = k / max(petals - 1, 1)  # 0 the innermost
        azimuth = k * 2.39996 + random.normal() * 0.12
        length = 0.42 + 0.42 * age + random.normal() * 0.02
        lean = 0.05 + 1.05 * age**1.3 + random.normal() * 0.04
        curl = 0.25 + 0.95 * age
        width = (2.3 - 1.35 * age) * (1 + 0.08 * random.normal())
        root = 0.035 + 0.09 * age
        phase, ripple = random.uniform(0, 6.28), 0.03 + 0.05 * age

        def petal(
            a: Floats,
            b: Floats,
            azimuth: float = azimuth,
            length: float = length,
            lean: float = lean,
            curl: float = curl,
            width: float = width,
            root: float = root,
            phase: float = phase,
            ripple: float = ripple,
        ) -> Floats:
            # Narrow at the root, round at the tip, a dent of the rim between.
            shape = 0.35 + 0.65 * np.sin(np.pi * np.clip(b * 0.86, 0, 1)) ** 0.6
            rim = b * (1 - 0.16 * a * a * b)
            tilt = lean * rim + curl * np.maximum(rim - 0.55, 0) ** 1.5
            out = root + length * rim * np.sin(tilt) + 0.05 * np.sin(np.pi * rim)
            up = length * rim * np.cos(tilt)
            up = up + ripple * b * b * np.sin(3.1 * a + phase) * 0.5
            out = out + ripple * b * b * np.cos(4.3 * a + phase)
            turn = azimuth + a * width * shape / 1.6
            return np.stack([out * np.cos(turn), up, out * np.sin(turn)], axis=-1)

        middle = petal(across, along)
        du = petal(across + step, along) - petal(across - step, along)
        dv = petal(across, along + step) - petal(across, along - step)
        normal = np.cross(du, dv)
        normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
        half = thickness / 2 * normal
        parts.append(_sheet(middle + half, middle - half))
    head = np.array([0.06, 1.55, 0.0])
    t = np.linspace(0.0, 1.0, 25)
    stem = np.stack([0.16 * np.sin(2.4 * t) * (1 - t), t * 1.56, 0.05 * np.sin(5 * t)], axis=-1)
    stem += (head * (1, 0, 1) - stem[-1] * (1, 0, 1)) * t[:, None] ** 2
    # The bloom nods towards +z, where the scenes' cameras are.
    nod = _rotation((1.0, 0.0, 0.0), np.radians(32.0))
    cup = _mesh(np.array([0.12, 0.11, 0.12]) * geodesic_sphere(8)[0], geodesic_sphere(8)[1])
    vertices, triangles = combine(*parts, transformed(cup, 1.0, 0.0, (0, 0.03, 0)))
    bloom = _mesh(0.9 * vertices @ nod.T + head, triangles)
    stalk = _tube(stem, 0.035 + 0.015 * t**3, 16, (0.2, 0.1, 1.0))
    leaves = []
    for at, turn, size in ((0.36, 40.0, 0.46), (0.55, 200.0, 0.42), (0.24, 285.0, 0.36)):
        s = size * np.sin(np.pi * np.clip(along, 0.0, 1.0)) ** 0.8 * 0.36 + 0.006
        # Only the ribs (`across`) and the droop (`along`) bend it.
        x = size * along + 0 * across
        y = 0.45 * size * along * (1 - 0.9 * along) + 0.10 * across**2 * s
        leaf = np.stack([x, y, -across * s], axis=-1)
        lift = np.array([0.0, thickness / 2, 0.0])
        sheet = _sheet(leaf + lift, leaf - lift)
        place = np.array([np.interp(at, t, stem[:, k]) for k in range(3)])
        leaves.append(transformed(sheet, 1.0, turn, place))
    vertices, triangles = combine(bloom, stalk, *leaves)
    return _mesh(vertices - np.array([0, vertices[:, 1].min(), 0]), triangles)


# ---- a city --------------------------------------------------------------------------


def _gable(lower: Floats, upper: Floats, rise: float, along_x: bool) -> Mesh:
    """A house with a pitched roof: a five-cornered prism."""
    (x0, y0, z0), (x1, y1, z1) = lower, upper
    if along_x:
        profile = [(y0, z0), (y0, z1), (y1, z1), (y1 + rise, (z0 + z1) / 2), (y1, z0)]
        rings = [[(x, y, z) for y, z in profile] for x in (x1, x0)]
    else:
        profile = [(x0, y0), (x0, y1), ((x0 + x1) / 2, y1 + rise), (x1, y1), (x1, y0)]
        rings = [[(x, y, z) for x, y in profile] for z in (z1, z0)]
    return _loft(np.array(rings, np.float64))


def city(blocks: int = 9, spacing: float = 1.0, seed: int = 4) -> Mesh:
    """Blocks of buildings on a slab: some hundred closed components that run into it.

    Boxes, set-back towers, pitched roofs and round towers, high in the middle; the slab's
    top is y = 0 and every foundation reaches below it.
    """
    random = np.random.default_rng(seed)

    def at(point: ArrayLike, x: float, y: float, z: float) -> Floats:
        moved: Floats = np.asarray(point, np.float64) + np.array([x, y, z])
        return moved

    half = blocks * spacing / 2
    parts = [cuboid((-half - 0.4, -0.3, -half - 0.4), (half + 0.4, 0.0, half + 0.4))]
    for row, column in np.ndindex(blocks, blocks):
        centre = np.array([(row + 0.5) * spacing - half, 0.0, (column + 0.5) * spacing - half])
        distance = np.linalg.norm(centre) / half
        if random.random() < 0.06:
            continue  # a square
        tall = 0.25 + 1.9 * np.exp(-2.6 * distance**2) * random.uniform(0.35, 1.0)
        lots = 1 if tall > 0.9 else int(random.integers(1, 3))
        for x, z in np.ndindex(lots, lots):
            size = 0.76 * spacing / lots
            middle = (
                centre + np.array([x, 0, z]) * size + (-size * (lots - 1) / 2) * np.array([1, 0, 1])
            )
            width = np.array([size, 0, size]) * random.uniform(0.36, 0.48, 3) * (1, 0, 1)
            height = tall * random.uniform(0.55, 1.1)
            low = middle - width + (0, -0.1, 0)
            top = middle + width + (0, height, 0)
            kind = random.random()
            if tall < 0.75 and kind < 0.5:
                along_x = bool(width[0] > width[2])
                parts.append(_gable(low, top, float(min(width[0], width[2])) * 0.9, along_x))
            elif tall < 0.75 or kind < 0.3:
                parts.append(cuboid(low, top))
                roof = middle + width * random.uniform(-0.5, 0.5, 3)
                hut = width.min(initial=1.0, where=width > 0) * 0.35
                parts.append(
                    cuboid(at(roof, -hut, height - 0.02, -hut), at(roof, hut, height + 0.07, hut))
                )
            elif kind < 0.78:
                base = height * 0.45
                for shrink, level in ((1.0, base), (0.78, height * 0.75), (0.5, height)):
                    parts.append(
                        cuboid(
                            middle - width * shrink + (0, -0.1, 0),
                            middle + width * shrink + (0, level, 0),
                        )
                    )
                mast = at(middle, 0.0, height - 0.05, 0.0)
                parts.append(_rod(mast, at(mast, 0.0, 0.4, 0.0), 0.014, 0.006, 6))
            else:
                r = float(width[0])
                foot = at(middle, 0.0, -0.1, 0.0)
                parts.append(_rod(foot, at(middle, 0.0, height, 0.0), r, r * 0.86, 28))
    return combine(*parts)


def _fine(coarse: Callable[..., Mesh]) -> Callable[..., Mesh]:
    def fine(levels: int = 4, **parameters: Any) -> Mesh:
        return subdivided(coarse(**parameters), levels)

    fine.__doc__ = f"`{coarse.__name__}`, each triangle cut into 4^levels: it has occluders."
    return fine


GENERATORS: dict[str, Callable[..., Mesh]] = {
    "cube": cube,
    "inverted_cube": inverted_cube,
    "cube_missing_face": cube_missing_face,
    "plane": plane,
    "cube_and_plane": cube_and_plane,
    "overlapping_cubes": overlapping_cubes,
    "touching_solids": touching_solids,
    "hollow_room": hollow_room,
    "furnished_room": furnished_room,
    "thin_plates": thin_plates,
    "fine_cube": _fine(cube),
    "fine_inverted_cube": _fine(inverted_cube),
    "fine_cube_missing_face": _fine(cube_missing_face),
    "fine_cube_and_plane": _fine(cube_and_plane),
    "fine_overlapping_cubes": _fine(overlapping_cubes),
    "fine_touching_solids": _fine(touching_solids),
    "fine_hollow_room": _fine(hollow_room),
    "geodesic_sphere": geodesic_sphere,
    "icosphere": icosphere,
    "nested_shells": nested_shells,
    "bumpy_solid": bumpy_solid,
    "torus_knot": torus_knot,
    "fat_knot": fat_knot,
    "tube_network": tube_network,
    "thirteen_shells": thirteen_shells,
    "figure": figure,
    "flower": flower,
    "city": city,
}
"""Every generator by name; all have defaults for all parameters."""


def generate(name: str, **parameters: Any) -> Mesh:
    """The mesh of a registered generator; ValueError for a name that is not one."""
    if name not in GENERATORS:
        raise ValueError(f"no generator {name!r}; there are {', '.join(GENERATORS)}")
    return GENERATORS[name](**parameters)
