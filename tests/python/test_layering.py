"""Who may know whom: the table in CONTRIBUTING.md, and the rules about Python's modules."""

from __future__ import annotations

import ast
import re
import subprocess
import sys
from fnmatch import fnmatchcase
from pathlib import Path

import pytest

# vocc.h holds the types and status codes that every layer uses.
PUBLIC = "vocc.h"

# Build and traverse meet in kdtree.h; only what drives them all includes both.
APART = ("build", "classify", "traverse")

# The packages that `import pyvocc` may load.
NEEDED = {"numpy", "cffi", "pycparser", "_cffi_backend"}


def layers(root: Path) -> list[tuple[str, list[str]]]:
    """Name and file patterns of each layer, from the first to the last."""
    text = (root / "CONTRIBUTING.md").read_text(encoding="utf-8")
    table = text[text.index("| layer |") :].split("\n\n")[0]
    rows = [[cell.strip() for cell in line.split("|")[1:-1]] for line in table.splitlines()[2:]]
    return [(row[0], braces(re.findall(r"`([^`]+)`", row[1]))) for row in rows]


def braces(patterns: list[str]) -> list[str]:
    """a.{x,y} as a.x and a.y."""
    result = []
    for pattern in patterns:
        found = re.search(r"\{([^}]*)\}", pattern)
        for part in found.group(1).split(",") if found else [""]:
            result.append(pattern.replace(found.group(0), part) if found else pattern)
    return result


def sources(root: Path) -> list[Path]:
    return sorted(p for p in (root / "csrc").iterdir() if p.suffix in (".c", ".h", ".inc"))


def layer_of(file: str, table: list[tuple[str, list[str]]]) -> int | None:
    """The layer of the longest pattern that fits."""
    fits = [
        (len(pattern), index)
        for index, (_, patterns) in enumerate(table)
        for pattern in patterns
        if fnmatchcase(file, pattern)
    ]
    return max(fits)[1] if fits else None


def includes(file: Path) -> list[str]:
    return re.findall(
        r'^\s*#\s*include\s+"([^"]+)"', file.read_text(encoding="utf-8"), re.MULTILINE
    )


def test_every_file_has_a_layer(root: Path) -> None:
    table = layers(root)
    assert len(table) > 5
    assert [p.name for p in sources(root) if layer_of(p.name, table) is None] == []


def test_every_pattern_of_the_table_names_a_file(root: Path) -> None:
    names = [p.name for p in sources(root)]
    patterns = [pattern for _, group in layers(root) for pattern in group]
    assert [p for p in patterns if not any(fnmatchcase(name, p) for name in names)] == []


def test_files_include_only_what_stands_before_them(root: Path) -> None:
    table = layers(root)
    wrong = []
    for file in sources(root):
        own = layer_of(file.name, table)
        for name in includes(file):
            other = layer_of(name, table)
            if name != PUBLIC and own is not None and (other is None or other > own):
                wrong.append(f"{file.name} ({table[own][0]}) includes {name}")
    assert wrong == []


def test_build_classify_and_traverse_meet_only_in_the_tree(root: Path) -> None:
    table = layers(root)
    names = [name for name, _ in table]
    apart = {names.index(name) for name in APART}
    wrong = []
    for file in sources(root):
        own = layer_of(file.name, table)
        for name in includes(file):
            other = layer_of(name, table)
            # Regions are what an empty leaf's label says: those who read labels read them.
            if own in apart and other in apart and own != other and name != "regions.h":
                wrong.append(f"{file.name} includes {name}")
    assert wrong == []


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("mesh.c", '#include "kdtree.h"'),
        ("triangle.h", '  #  include "scene.h"'),
        ("build.c", '#include "traverse.h"'),
    ],
)
def test_the_check_sees_a_wrong_include(tmp_path: Path, root: Path, name: str, text: str) -> None:
    (tmp_path / "csrc").mkdir()
    (tmp_path / "CONTRIBUTING.md").write_text(
        (root / "CONTRIBUTING.md").read_text("utf-8"), "utf-8"
    )
    (tmp_path / "csrc" / name).write_text(text)
    with pytest.raises(AssertionError, match="includes"):
        test_files_include_only_what_stands_before_them(tmp_path)


# ---- Python ------------------------------------------------------------------


def imported(file: Path) -> set[str]:
    """The modules and names that a file imports, anywhere in it."""
    result = set()
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            result |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            result |= {f"{node.module or ''}.{alias.name}" for alias in node.names}
    return result


def test_only_ffi_knows_the_extension_module(root: Path) -> None:
    users = {
        file.name
        for file in (root / "pyvocc").rglob("*.py")
        if any("_vocc" in name or name.endswith((".ffi", ".lib")) for name in imported(file))
    }
    assert users == {"_ffi.py"}


def test_only_errors_makes_exceptions_of_codes(root: Path) -> None:
    users = {
        file.name
        for file in (root / "pyvocc").rglob("*.py")
        if "VOCC_ERROR" in (text := file.read_text(encoding="utf-8")) or "from_status" in text
    }
    assert users == {"errors.py", "_ffi.py"}


def test_importing_needs_only_numpy_and_cffi() -> None:
    code = (
        "import sys; before = set(sys.modules); import pyvocc; "
        "print(*{m.partition('.')[0] for m in set(sys.modules) - before})"
    )
    output = subprocess.run(
        [sys.executable, "-c", code], check=True, capture_output=True, text=True
    ).stdout
    loaded = set(output.split()) - set(sys.stdlib_module_names)
    third_party = {name for name in loaded if not name.startswith(("_", "pyvocc"))}
    assert third_party <= NEEDED
    assert "numpy" in third_party


def test_only_the_command_knows_what_reproduces(root: Path) -> None:
    users = {
        str(file.relative_to(root / "pyvocc"))
        for file in (root / "pyvocc").rglob("*.py")
        if any(name.startswith("reproduce") for name in imported(file))
    }
    assert users == {"cli.py"}


def test_a_missing_extra_is_named() -> None:
    code = (
        "import sys; sys.modules['pyvocc.io'] = None; import pyvocc\n"
        "try: pyvocc.load_mesh\n"
        "except ImportError as error: print(error)"
    )
    output = subprocess.run(
        [sys.executable, "-c", code], check=True, capture_output=True, text=True
    ).stdout
    assert "pip install 'pyvocc[io]'" in output
    assert "load_mesh" in output


def test_the_public_names_are_those_that_are_there() -> None:
    import pyvocc

    assert set(pyvocc.__all__) <= set(dir(pyvocc))
    with pytest.raises(AttributeError, match="no_such_name"):
        pyvocc.no_such_name  # noqa: B018
    assert pyvocc.__version__.count(".") == 2
