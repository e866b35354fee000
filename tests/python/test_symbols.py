"""What the compiled library shows and asks for, and that its header stands alone."""

from __future__ import annotations

import os
import shlex
import subprocess
from pathlib import Path

import pytest

import pyvocc._ffi

CC = shlex.split(os.environ.get("CC", "cc"))

WARNINGS = ["-Wall", "-Wextra", "-Wpedantic", "-Wshadow", "-Wconversion", "-Wdouble-promotion"]
C_WARNINGS = ["-Wstrict-prototypes", "-Wmissing-prototypes"]

# Nothing that prints, ends the process, or keeps state between calls; and the environment is
# asked for VOCC_ISA only.
FORBIDDEN = {
    *("printf", "fprintf", "vprintf", "vfprintf", "puts", "putchar", "fputs", "fputc", "perror"),
    *("fwrite", "write", "stdout", "stderr", "exit", "_exit", "abort", "__assert_fail"),
    *("signal", "sigaction", "setlocale", "rand", "srand", "strtok", "getenv"),
}


def run(*command: str | Path) -> str:
    result = subprocess.run(command, capture_output=True, text=True, check=False)
    assert result.returncode == 0, result.stderr
    return result.stdout


@pytest.fixture(scope="module")
def objects(root: Path, tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """Every source file compiled; by `make test` already, as the package is."""
    compiled = os.environ.get("VOCC_OBJECTS")
    if compiled:
        return [
            Path(compiled, f"{source.stem}.o") for source in sorted((root / "csrc").glob("*.c"))
        ]
    folder = tmp_path_factory.mktemp("objects")
    result = []
    for source in sorted((root / "csrc").glob("*.c")):
        result.append(folder / f"{source.stem}.o")
        run(*CC, "-std=c99", "-O0", "-fPIC", "-pthread", "-c", source, "-o", result[-1])
    return result


def symbols(path: Path, *options: str) -> list[tuple[str, str]]:
    """Type letter and name of each symbol."""
    lines = [line.split() for line in run("nm", *options, path).splitlines()]
    return [(line[-2], line[-1]) for line in lines if len(line) >= 2]


def test_every_global_symbol_begins_with_vocc(objects: list[Path]) -> None:
    names = [name for file in objects for _, name in symbols(file, "-g", "--defined-only")]
    assert len(names) > 20
    assert [name for name in names if not name.startswith("vocc_")] == []


def test_the_library_keeps_no_state(objects: list[Path]) -> None:
    variables = [
        (file.name, name) for file in objects for kind, name in symbols(file) if kind in "bBdDcC"
    ]
    # Tables of pointers are constants that the loader fills in.
    assert [v for v in variables if not in_constants(objects, *v)] == []


def in_constants(objects: list[Path], file: str, name: str) -> bool:
    path = next(path for path in objects if path.name == file)
    for line in run("objdump", "-t", path).splitlines():
        if line.split()[-1:] == [name]:
            return ".data.rel.ro" in line
    return False


ALLOWED = {("isa.o", "getenv")}


def test_the_library_does_not_print_exit_or_ask_the_environment(objects: list[Path]) -> None:
    wanted = {
        (file.name, name.partition("@")[0])
        for file in objects
        for kind, name in symbols(file, "-u")
        if kind == "U"
    }
    assert wanted
    assert {(file, name) for file, name in wanted if name in FORBIDDEN} == ALLOWED


def test_the_shared_library_shows_the_header_and_nothing_else(
    objects: list[Path], root: Path, tmp_path: Path
) -> None:
    library = tmp_path / "libvocc.so"
    run(*CC, "-shared", "-pthread", "-o", library, *objects, "-lm")
    shown = {name for _, name in symbols(library, "-D", "--defined-only")}
    functions = {name for name in dir(pyvocc._ffi.lib) if name.startswith("vocc_")}
    assert shown == functions


def test_the_extension_module_shows_no_more(root: Path) -> None:
    import pyvocc._vocc

    shown = {name for _, name in symbols(Path(pyvocc._vocc.__file__), "-D", "--defined-only")}
    others = {name for name in shown if not name.startswith("vocc_")}
    assert others <= {"PyInit__vocc", "_init", "_fini", "_cffi_pypyinit__vocc"}


@pytest.mark.parametrize(
    ("suffix", "options"),
    [
        ("c", ["-x", "c", "-std=c99", *C_WARNINGS]),
        ("c", ["-x", "c", "-std=c11", *C_WARNINGS]),
        ("cc", ["-x", "c++", "-std=c++11"]),
        ("cc", ["-x", "c++", "-std=c++17"]),
    ],
)
def test_the_header_compiles_alone(
    root: Path, tmp_path: Path, suffix: str, options: list[str]
) -> None:
    source = tmp_path / f"alone.{suffix}"
    source.write_text(
        '#include "vocc.h"\nint answer(void);\nint answer(void) { return VOCC_OK; }\n'
    )
    run(*CC, *options, *WARNINGS, "-Werror", "-fsyntax-only", "-I", root / "csrc", source)


def test_a_second_include_is_harmless(root: Path, tmp_path: Path) -> None:
    source = tmp_path / "twice.c"
    source.write_text('#include "vocc.h"\n#include "vocc.h"\nint unused;\n')
    run(*CC, "-std=c99", *WARNINGS, "-Werror", "-fsyntax-only", "-I", root / "csrc", source)
