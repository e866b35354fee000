"""The command ``pyvocc``: check meshes, render shadows, compare images."""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import sys
import time
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from io import StringIO
from pathlib import Path
from types import TracebackType
from typing import Any, NoReturn, Self

import numpy as np
from numpy.typing import NDArray

from . import OPAQUE, __version__, images, scene_files
from ._ffi import CACHE_POLICIES, ORDERS, SAMPLERS
from ._files import FileError, check_writable
from ._query import QueryOptions
from .errors import Error
from .mesh_files import load_mesh
from .report import MeshReport
from .scene import Scene
from .shadow import shadow_pass
from .stats import Stats

# Exit codes beside 0.
DIFFERENT = 1  # diff: the images differ; check: a mesh is open
UNUSABLE = 2  # a file, argument or package that the command cannot work with
INTERRUPTED = 130  # as shells have it: 128 + SIGINT
BROKEN_PIPE = 141  # 128 + SIGPIPE

MAX_SIDE = 65536
LISTED_LEAVES = 10


def main(argv: Sequence[str] | None = None) -> int:
    """Runs the command.

    Args:
        argv: the arguments; default those of the process.

    Returns:
        The exit code.
    """
    try:
        options = _parser().parse_args(argv)
        code: int = options.run(options)
        sys.stdout.flush()
        return code
    except BrokenPipeError:
        # The reader has enough; the interpreter's own flush at exit must not fail again.
        with contextlib.suppress(OSError, ValueError):
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return BROKEN_PIPE
    except KeyboardInterrupt:
        return _fail("interrupted", INTERRUPTED)
    except MemoryError:
        return _fail("out of memory", UNUSABLE)
    except (Error, ImportError, OSError) as error:
        return _fail(str(error), UNUSABLE)


def _fail(message: str, code: int) -> int:
    with contextlib.suppress(OSError):
        print(f"pyvocc: {message}", file=sys.stderr)
    return code


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="pyvocc",
        description="Exact shadows and visibility on closed meshes.",
        allow_abbrev=False,
    )
    parser.add_argument("--version", action="version", version=f"pyvocc {__version__}")
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")

    check = commands.add_parser(
        "check",
        help="say whether meshes are closed, and where they are not",
        description="Says whether meshes are closed, and where they are not. "
        "Exit code: 0 all closed, 1 one is open, 2 one is not readable.",
        allow_abbrev=False,
    )
    check.add_argument("meshes", nargs="+", type=Path, metavar="MESH", help="PLY, OBJ, STL, ...")
    check.add_argument(
        "--edges",
        type=_integer(0, 10**9),
        default=10,
        metavar="N",
        help="list so many open edges of each mesh (default 10)",
    )
    check.add_argument(
        "--rays",
        action="store_true",
        help="label the empty leaves by one test ray each, too, and say where that is different",
    )
    check.set_defaults(run=_check)

    shadow = commands.add_parser(
        "shadow",
        help="render the soft shadows of a scene file",
        description="Renders the soft shadows of a scene file.\n"
        "No option but --size, --samples and --sampler changes the picture.\n"
        "Exit code: 0 done, 2 not possible.",
        epilog=f"A scene file:\n{scene_files.FORMAT}",
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )
    add = shadow.add_argument
    add("scene", type=Path, metavar="SCENE.toml", help="see below")
    add(
        "-o",
        "--output",
        type=Path,
        required=True,
        metavar="OUT.exr|.png",
        help=".exr: a channel for each light, position and normal, and a .png beside it for "
        "looking; .png: that alone",
    )
    add("--size", type=_size, default=(512, 512), metavar="WxH", help="pixels (default 512x512)")
    add(
        "--samples",
        type=_integer(1, 65534),
        default=16,
        metavar="N",
        help="shadow rays to each light and pixel (default 16)",
    )
    add(
        "--sampler",
        choices=tuple(SAMPLERS),
        default="sobol",
        help="how they are spread: sobol (default; the lower error, best with a power of two) or "
        "jitter (strata and a hash)",
    )
    add("--order", choices=tuple(ORDERS), default="auto", help="traversal order (default auto)")
    add("--no-occluders", action="store_true", help="do not use volumetric occluders")
    add(
        "--cache",
        type=_integer(0, 64),
        default=8,
        metavar="N",
        help="occluders in the cache, 0 to 64 (default 8)",
    )
    add(
        "--deferment",
        type=_integer(0, 512),
        default=512,
        metavar="N",
        help="leaves on the deferment list, 0 to 512 (default 512)",
    )
    add(
        "--cache-policy",
        choices=sorted(CACHE_POLICIES),
        default="recent",
        help="what the cache holds: the occluders that blocked last, or the last one for each "
        "direction (default recent)",
    )
    add("--no-fusion", action="store_true", help="the cache holds leaves, not grown boxes")
    add("--triangle-cache", action="store_true", help="test the triangle that blocked last first")
    add(
        "--entry-points",
        choices=("auto", "yes", "no"),
        default="auto",
        help="settle neighbouring pixels at once where that is possible (default auto: yes in "
        "order auto)",
    )
    add(
        "--entry-triangles",
        type=_integer(0, 64),
        default=8,
        metavar="N",
        help="triangles at which a search of entry points gives up, 0 to 64 (default 8)",
    )
    add(
        "--voxels",
        type=_integer(0, 1024),
        default=0,
        metavar="N",
        help="settle pixels by voxels, so many along the longest side (default 0: not)",
    )
    add(
        "--method",
        choices=("auto", "rays", "beams"),
        default="auto",
        help="rays, or beams: groups of pixels and parts of a light at once (default: auto)",
    )
    add(
        "--verify",
        type=_integer(0, 2**31 - 1),
        default=0,
        metavar="N",
        help="trace one in N pixels again, ray by ray, and fail if it differs (default 0: not)",
    )
    add("--single-rays", action="store_true", help="trace ray by ray, not four at a time")
    add(
        "--threads",
        type=_integer(1, 256),
        metavar="N",
        help="threads (default one a processor)",
    )
    add("--stats", type=Path, metavar="OUT.json", help="write times, counters and the report")
    shadow.set_defaults(run=_shadow)

    diff = commands.add_parser(
        "diff",
        help="compare two images",
        description="Compares two images, EXR or PNG, value by value. "
        "Exit code: 0 identical, 1 different, 2 not comparable.",
        allow_abbrev=False,
    )
    diff.add_argument("a", type=Path, metavar="A")
    diff.add_argument("b", type=Path, metavar="B")
    diff.set_defaults(run=_diff)

    reproduce = commands.add_parser(
        "reproduce",
        help="repeat the measurements of the paper",
        description="Repeats the measurements of the paper that this package implements, and "
        "writes results.html and results.md with the paper's figures beside its own. What has "
        "been measured is kept in the folder: after Ctrl-C the same command goes on. "
        "Exit code: 0 done, 1 images differ, which must not be, 2 not possible.",
        allow_abbrev=False,
    )
    add = reproduce.add_argument
    add("-o", "--output", type=Path, required=True, metavar="DIR", help="made if it is not there")
    add(
        "--meshes",
        type=Path,
        metavar="DIR",
        help="with armadillo, bunny, dragon, rose, tubes131 and cowboy .ply (default: meshes that "
        "are generated to stand for them)",
    )
    add(
        "--only",
        type=_names,
        default=(),
        metavar="A,B",
        help="only these scenes: of --meshes the names above, "
        "city and spot; of the generated ones ball, rock, tubes, petals, figure and blocks",
    )
    add("--size", type=_integer(8, 8192), metavar="N", help="pixels, squared (default 1024)")
    add("--samples", type=_integer(1, 65534), metavar="N", help="of each light (default 20)")
    add("--rounds", type=_integer(1, 99), metavar="N", help="of timed passes (default 3)")
    add(
        "--sweep-size",
        type=_integer(8, 8192),
        metavar="N",
        help="pixels, squared, where the sizes of list and cache are varied (default: --size, "
        "at most 512)",
    )
    add("--quick", action="store_true", help="defaults of 128 pixels, 4 samples, 1 round")
    add("--no-embree", action="store_true", help="do not measure Embree where it is installed")
    reproduce.set_defaults(run=_reproduce)
    return parser


def _integer(lower: int, upper: int) -> Any:
    def parse(text: str) -> int:
        try:
            value = int(text)
        except ValueError:
            raise argparse.ArgumentTypeError(f"expected an integer, got {text!r}") from None
        if not lower <= value <= upper:
            raise argparse.ArgumentTypeError(f"expected {lower} to {upper}, got {value}")
        return value

    return parse


def _names(text: str) -> tuple[str, ...]:
    names = tuple(part.strip() for part in text.split(","))
    if not all(names):
        raise argparse.ArgumentTypeError(f"expected names, like bunny,dragon, got {text!r}")
    return names


def _size(text: str) -> tuple[int, int]:
    parts = text.lower().split("x")
    if len(parts) != 2 or not all(part.isascii() and part.isdigit() for part in parts):
        raise argparse.ArgumentTypeError(f"expected WIDTHxHEIGHT, like 640x480, got {text!r}")
    width, height = int(parts[0]), int(parts[1])
    if not (1 <= width <= MAX_SIDE and 1 <= height <= MAX_SIDE):
        raise argparse.ArgumentTypeError(f"expected sides of 1 to {MAX_SIDE} pixels, got {text!r}")
    return width, height


# ---- progress ------------------------------------------------------------------------


class Progress:
    """Shows a fraction on stderr if that is a terminal: a bar with tqdm, a line without."""

    def __init__(self, label: str) -> None:
        self._label = label
        self._shown = 0.0
        self._bar: Any = None
        self._last = 0.0
        self._active = sys.stderr.isatty()

    def __enter__(self) -> Self:
        if self._active:
            with contextlib.suppress(ImportError):
                from tqdm import tqdm

                self._bar = tqdm(
                    total=1.0,
                    desc=self._label,
                    file=sys.stderr,
                    leave=False,
                    bar_format="{desc}: {percentage:3.0f}% |{bar}| {elapsed} < {remaining}",
                )
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        if self._bar is not None:
            self._bar.close()
        elif self._active:
            sys.stderr.write("\r" + " " * (len(self._label) + 8) + "\r")
            sys.stderr.flush()

    def __call__(self, fraction: float) -> None:
        if not self._active:
            return
        if self._bar is not None:
            self._bar.update(max(min(fraction, 1.0) - self._shown, 0.0))
            self._shown = max(self._shown, min(fraction, 1.0))
        elif time.monotonic() - self._last > 0.1:
            self._last = time.monotonic()
            sys.stderr.write(f"\r{self._label}: {100 * fraction:3.0f} %")
            sys.stderr.flush()


# ---- check ---------------------------------------------------------------------------


def _check(options: argparse.Namespace) -> int:
    code = 0
    for path in options.meshes:
        try:
            closed = _check_mesh(path, options.edges, options.rays)
        except (FileError, ImportError) as error:
            sys.stdout.flush()  # keep the order where both go to one place
            _fail(str(error), UNUSABLE)
            code = UNUSABLE
        else:
            code = max(code, 0 if closed else DIFFERENT)
    return code


def _check_mesh(path: Path, edge_limit: int, rays: bool) -> bool:
    vertices, triangles = load_mesh(path)
    with Scene() as scene, Progress(f"{path.name}") as progress:
        try:
            scene.add_mesh(vertices, triangles, path.stem)
            mesh = scene.build(progress).meshes[0]
        except ValueError as error:  # a vertex that is not finite, too many triangles
            raise FileError(path, str(error)) from None
        edges = scene.open_edges(0)
        comparison = list(_ray_lines(scene, progress)) if rays else []
    print(f"{path}: {'closed' if mesh.closed else 'open'}")
    for line in _mesh_lines(mesh):
        print(f"  {line}")
    if len(edges):
        shown = edges[:edge_limit]
        if len(shown):
            some = "" if len(shown) == len(edges) else f", the first {len(shown)}"
            print(f"  open at {_count(len(edges), 'edge')}{some}:")
        for prim_id, side in shown.tolist():
            a, b = triangles[prim_id, side], triangles[prim_id, (side + 1) % 3]
            print(f"    triangle {prim_id}: {_point(vertices[a])} to {_point(vertices[b])}")
    for line in comparison:
        print(f"  {line}")
    return mesh.closed


def _ray_lines(scene: Scene, progress: Progress) -> Iterator[str]:
    """The flood fill of the build beside the paper's classification."""
    by_rays, tree = scene.classify_by_rays(progress=progress), scene.report.tree
    empty = tree.opaque_leaves + tree.clear_leaves + tree.unknown_leaves
    yield f"{_count(empty, 'empty leaf', 'empty leaves')}, {tree.opaque_leaves} of them opaque"
    yield (f"by flood fill: {_count(tree.seed_rays, 'ray')}, {scene.report.seconds.classify:.3f} s")
    yield f"by one ray each: {_count(by_rays.rays, 'ray')}, {by_rays.seconds:.3f} s"
    wrong = by_rays.disagreements
    if not len(wrong):
        yield "no leaf where they disagree"
        return
    some = "" if len(wrong) <= LISTED_LEAVES else f", the first {LISTED_LEAVES}"
    yield f"they disagree on {_count(len(wrong), 'leaf', 'leaves')}{some}:"
    leaves = scene.leaves()
    for index in wrong[:LISTED_LEAVES].tolist():
        leaf = leaves[index]
        lower, upper = _point(leaf["lower"] + scene.origin), _point(leaf["upper"] + scene.origin)
        flood, ray = ("opaque", "clear") if leaf["label"] == OPAQUE else ("clear", "opaque")
        yield f"  leaf {index}: {flood}, by its ray {ray}; {lower} to {upper}"


def _mesh_lines(mesh: MeshReport) -> Iterator[str]:
    parts = mesh.components
    closed = sum(part.closed for part in parts)
    yield (
        f"{_count(mesh.triangle_count, 'triangle')}, "
        f"{_count(mesh.welded_vertices, 'distinct vertex', 'distinct vertices')} "
        f"of {mesh.vertex_count}, volume {mesh.volume:.6g}"
    )
    yield (
        f"edges: {mesh.boundary_edges} boundary, {mesh.nonmanifold_edges} non-manifold, "
        f"{mesh.inconsistent_edges} inconsistently wound"
    )
    if mesh.degenerate_triangles:
        yield f"{_count(mesh.degenerate_triangles, 'triangle')} without area"
    yield f"{_count(len(parts), 'component')}, {closed} closed"
    if len(parts) > 1:
        listed = sorted(parts, key=lambda part: part.closed)[:16]
        for part in listed:
            yield (
                f"  component {part.index}: {'closed' if part.closed else 'open'}, "
                f"{_count(part.triangle_count, 'triangle')} from {part.first_triangle}, "
                f"edges {part.boundary_edges} boundary, {part.nonmanifold_edges} non-manifold, "
                f"{part.inconsistent_edges} inconsistent, volume {part.volume:.6g}"
            )
        if len(listed) < len(parts):
            yield f"  and {len(parts) - len(listed)} more"
    if mesh.closed and mesh.inconsistent_edges == 0 and mesh.volume < 0:
        yield "inside out: normals point inward"


def _point(vertex: NDArray[Any]) -> str:
    return "(" + ", ".join(f"{float(value):.7g}" for value in vertex) + ")"


def _count(count: int, one: str, many: str | None = None) -> str:
    return f"{count} {one if count == 1 else many or one + 's'}"


# ---- shadow --------------------------------------------------------------------------


def _shadow(options: argparse.Namespace) -> int:
    exr, png = _outputs(options)
    start = time.perf_counter()
    file = scene_files.load_scene(options.scene)
    loaded = time.perf_counter()
    with Progress("building") as progress:
        scene = file.build(threads=options.threads, progress=progress)
    built = time.perf_counter()
    stats = Stats() if options.stats else None
    query: QueryOptions = {
        "order": options.order,
        "occluders": not options.no_occluders,
        "cache": options.cache,
        "deferment": options.deferment,
        "cache_policy": options.cache_policy,
        "fusion": not options.no_fusion,
        "triangle_cache": options.triangle_cache,
        "entry_points": {"auto": None, "yes": True, "no": False}[options.entry_points],
        "entry_triangles": options.entry_triangles,
        "voxels": options.voxels,
        "method": options.method,
        "verify": options.verify,
        "packets": not options.single_rays,
    }
    with scene, Progress("shadows") as progress:
        result = shadow_pass(
            scene,
            file.camera,
            file.lights,
            options.size,
            options.samples,
            sampler=options.sampler,
            progress=progress,
            stats=stats,
            **query,
        )
    if exr is not None:
        images.write_exr(exr, result, file.light_names)
    ground = next((k for k, mesh in enumerate(file.meshes) if mesh.path is None), None)
    images.write_png(png, images.look(result, file.lights, ground))
    # Those of pixels that face a light only in part are not all traced: fewer rays.
    count = int(np.count_nonzero(result.visibility >= 0)) * result.samples / 1e6
    seconds = max(result.shadow_seconds, 1e-9)
    print(
        f"{exr or png}: {options.size[0]} x {options.size[1]} pixels, "
        f"{_count(len(file.lights), 'light')}, {_count(options.samples, 'sample')}: "
        f"{count:.2f} M samples in {seconds:.2f} s, {count / seconds:.2f} M/s"
    )
    if stats is not None:
        _write_json(
            options.stats,
            {
                "version": __version__,
                "scene": str(options.scene),
                "lights": list(file.light_names),
                "size": list(options.size),
                "samples": options.samples,
                "sampler": options.sampler,
                "options": {**query, "threads": options.threads},
                "rays": stats.rays,
                "mrays_per_second": stats.rays / 1e6 / seconds,
                "seconds": {
                    "load": loaded - start,
                    "build": built - loaded,
                    "primary": result.primary_seconds,
                    "shadow": result.shadow_seconds,
                },
                "isa": stats.isa,
                "counters": stats.counters,
                "report": asdict(scene.report),
            },
        )
    return 0


def _outputs(options: argparse.Namespace) -> tuple[Path | None, Path]:
    """The EXR file, if one is wanted, and the PNG file; FileError for what cannot be written."""
    output: Path = options.output
    suffix = output.suffix.lower()
    if suffix not in (".exr", ".png"):
        raise FileError(output, "the output must end in .exr or .png")
    exr = output if suffix == ".exr" else None
    png = output.with_suffix(".png") if exr else output
    for path in (exr, png, options.stats):
        if path is not None:
            check_writable(path)
    images.check_packages(exr is not None)
    return exr, png


def _write_json(path: Path, content: dict[str, Any]) -> None:
    try:
        path.write_text(json.dumps(content, indent=2) + "\n", encoding="utf-8")
    except OSError as error:
        raise FileError(path, str(error.strerror)) from None


# ---- diff ----------------------------------------------------------------------------


def _diff(options: argparse.Namespace) -> int:
    with _quiet_output():
        a, b = images.read_image(options.a), images.read_image(options.b)
    if a.keys() != b.keys():
        only = [
            f"{path} has {', '.join(sorted(x.keys() - y.keys()))}"
            for path, x, y in ((options.a, a, b), (options.b, b, a))
            if x.keys() - y.keys()
        ]
        _incomparable("the images have different channels: " + "; ".join(only))
    shapes = [next(iter(image.values())).shape for image in (a, b)]
    if shapes[0] != shapes[1]:
        sizes = [f"{shape[1]} x {shape[0]}" for shape in shapes]
        _incomparable(f"the images differ in size: {sizes[0]} and {sizes[1]}")
    height, width = shapes[0]
    differs = {name: ~_same(a[name], b[name]) for name in sorted(a)}
    anywhere = np.logical_or.reduce(list(differs.values()))
    if not anywhere.any():
        print(f"identical: {width} x {height} pixels, {_count(len(a), 'channel')}")
        return 0
    rows, columns = np.nonzero(anywhere)
    print(
        f"different: {len(rows)} of {width * height} pixels, x {columns.min()} to "
        f"{columns.max()}, y {rows.min()} to {rows.max()}"
    )
    print(f"  {'channel':20} {'pixels':>9} {'largest':>12}  {'at x, y':>14}  A, B")
    for name, where in differs.items():
        if where.any():
            print("  " + _channel_line(name, where, a[name], b[name]))
    return DIFFERENT


def _same(a: NDArray[Any], b: NDArray[Any]) -> NDArray[np.bool_]:
    """Equal values, NaN being equal to NaN."""
    return np.asarray((a == b) | ((a != a) & (b != b)))


def _channel_line(name: str, where: NDArray[np.bool_], a: NDArray[Any], b: NDArray[Any]) -> str:
    with np.errstate(invalid="ignore"):
        size = np.abs(a.astype(np.float64) - b.astype(np.float64))
    # A value against NaN differs more than any two numbers; infinite keeps it first.
    size = np.where(where, np.where(np.isnan(size), np.inf, size), -1.0)
    y, x = (int(k) for k in np.unravel_index(int(size.argmax()), size.shape))
    return (
        f"{name:20} {np.count_nonzero(where):9d} {size[y, x]:12.6g}  {f'({x}, {y})':>14}  "
        f"{a[y, x]:.7g}, {b[y, x]:.7g}"
    )


def _incomparable(message: str) -> NoReturn:
    raise Error(message)


# ---- reproduce -------------------------------------------------------------------------


def _reproduce(options: argparse.Namespace) -> int:
    from .reproduce.run import Interrupted, check, reproduce
    from .reproduce.settings import Settings

    settings = Settings.of(
        options.meshes,
        options.only,
        options.size,
        options.sweep_size,
        options.samples,
        options.rounds,
        options.quick,
    )
    try:
        check(options.output, settings)
        differences = reproduce(options.output, settings, embree=not options.no_embree)
    except Interrupted as stop:
        return _fail(str(stop), INTERRUPTED)
    print(f"wrote {options.output / 'results.html'} and results.md")
    for text in differences:
        _fail(f"the images differ: {text}", DIFFERENT)
    return DIFFERENT if differences else 0


@contextlib.contextmanager
def _quiet_output() -> Iterator[None]:
    """Keeps what foreign code writes to the process's own output, past Python, from the user.

    OpenEXR tells of a broken file there, line upon line, before it raises.
    """
    sys.stdout.flush()
    sys.stderr.flush()
    nowhere = os.open(os.devnull, os.O_WRONLY)
    saved: list[tuple[int, int]] = []
    try:
        for number in (1, 2):
            with contextlib.suppress(OSError):  # closed by whoever started us
                saved.append((number, os.dup(number)))
                os.dup2(nowhere, number)
        with contextlib.redirect_stdout(StringIO()):
            yield
    finally:
        for number, copy in saved:
            os.dup2(copy, number)
            os.close(copy)
        os.close(nowhere)
