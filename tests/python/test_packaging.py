"""The sdist builds by itself an abi3 wheel that works."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import tarfile
import tomllib
import zipfile
from pathlib import Path

import pytest

BUILD = """
import sys
from setuptools import build_meta
print(getattr(build_meta, sys.argv[1])(sys.argv[2]))
"""

SMOKE = """
import sys
sys.path.insert(0, sys.argv[1])
import pyvocc, numpy as np
assert pyvocc.__file__.startswith(sys.argv[1]), pyvocc.__file__
scene = pyvocc.Scene()
scene.add_mesh(np.eye(4, 3) , [[0, 1, 2], [0, 3, 1], [1, 3, 2], [2, 3, 0]])
assert scene.build(strict=True).closed
print(scene.occluded([[1, 1, 1], [9, 9, 9]], [-1, -1, -1.0], 0, 1).tolist())
"""


def run(*command: str | Path, cwd: Path, **settings: str) -> str:
    environment = {name: value for name, value in os.environ.items() if name != "VOCC_OBJECTS"}
    result = subprocess.run(
        command,
        cwd=cwd,
        env={**environment, **settings},
        capture_output=True,
        text=True,
        check=False,
    )
    assert result.returncode == 0, result.stdout + result.stderr
    return result.stdout


def sources(root: Path, pattern: str) -> list[Path]:
    return [path for path in root.glob(pattern) if "__pycache__" not in path.parts]


@pytest.fixture(scope="module")
def sdist(root: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The sdist, unpacked; made from a copy without anything that was built before."""
    folder = tmp_path_factory.mktemp("sdist")
    ignore = shutil.ignore_patterns("*.so", "*.o", "__pycache__", "*.egg-info", "build")
    for name in ("csrc", "pyvocc"):
        shutil.copytree(root / name, folder / "copy" / name, ignore=ignore)
    for name in ("pyproject.toml", "setup.py", "MANIFEST.in", "LICENSE", "README.md"):
        shutil.copy(root / name, folder / "copy" / name)
    (folder / "copy" / "CHANGELOG.md").touch()
    run(sys.executable, "-c", BUILD, "build_sdist", folder, cwd=folder / "copy")
    (archive,) = folder.glob("*.tar.gz")
    with tarfile.open(archive) as tar:
        tar.extractall(folder, filter="data")
    (unpacked,) = folder.glob("pyvocc-*/")
    return unpacked


@pytest.fixture(scope="module")
def wheel(sdist: Path) -> Path:
    settings = {}
    if os.name == "posix":
        # What is in the wheel does not depend on the last options, which count; the time does.
        compiler = sdist.parent / "cc"
        compiler.write_text(
            f'#!/bin/sh\nexec {os.environ.get("CC", "cc")} "$@" -O0 -Dalways_inline=unused\n'
        )
        compiler.chmod(0o755)
        settings["CC"] = str(compiler)
    run(sys.executable, "-c", BUILD, "build_wheel", sdist.parent, cwd=sdist, **settings)
    (file,) = sdist.parent.glob("*.whl")
    return file


def test_the_sdist_holds_every_source(sdist: Path, root: Path) -> None:
    for pattern in ("csrc/*.c", "csrc/*.h", "csrc/*.inc", "csrc/*.py", "pyvocc/**/*.py*"):
        expected = {path.relative_to(root) for path in sources(root, pattern)}
        assert {path.relative_to(sdist) for path in sdist.glob(pattern)} == expected, pattern
    assert (sdist / "pyvocc" / "py.typed").exists()
    assert (sdist / "LICENSE").exists()


def test_one_wheel_serves_every_python(wheel: Path) -> None:
    assert re.fullmatch(r"pyvocc-[\d.]+-cp311-abi3-\w+\.whl", wheel.name)


def test_the_wheel_holds_the_package_and_nothing_else(wheel: Path, root: Path) -> None:
    names = set(zipfile.ZipFile(wheel).namelist())
    package = {name for name in names if name.startswith("pyvocc/")}
    python = {path.relative_to(root).as_posix() for path in sources(root, "pyvocc/**/*.py*")}
    (extension,) = package - python - {"pyvocc/py.typed"}
    assert extension.startswith("pyvocc/_vocc.abi3.") or extension == "pyvocc/_vocc.pyd"
    assert python | {"pyvocc/py.typed"} <= package
    assert all(".dist-info/" in name for name in names - package)


def test_the_wheel_works(wheel: Path, tmp_path: Path) -> None:
    zipfile.ZipFile(wheel).extractall(tmp_path)
    output = run(sys.executable, "-c", SMOKE, tmp_path, cwd=tmp_path)
    assert output.strip() == "[True, False]"


def test_installing_needs_only_numpy_and_cffi(wheel: Path) -> None:
    archive = zipfile.ZipFile(wheel)
    (path,) = (name for name in archive.namelist() if name.endswith("/METADATA"))
    lines = archive.read(path).decode().splitlines()
    needs = [line.partition(": ")[2] for line in lines if line.startswith("Requires-Dist:")]
    always = {re.split(r"[<>=!; ]", need)[0] for need in needs if "extra ==" not in need}
    assert always == {"numpy", "cffi"}
    extras = {line.partition(": ")[2] for line in lines if line.startswith("Provides-Extra:")}
    assert extras == {"io", "plot", "progress", "all"}


def test_the_version_is_written_once_for_python_and_once_for_c(root: Path) -> None:
    project = tomllib.loads((root / "pyproject.toml").read_text())["project"]
    header = (root / "csrc" / "vocc.h").read_text()
    parts = [
        re.search(rf"VOCC_VERSION_{part} (\d+)", header) for part in ("MAJOR", "MINOR", "PATCH")
    ]
    assert project["version"] == ".".join(part.group(1) for part in parts if part)


def test_development_versions_are_pinned(root: Path) -> None:
    lines = (root / "requirements-dev.txt").read_text().splitlines()
    packages = [line for line in lines if line and not line.startswith("#")]
    assert packages
    assert [line for line in packages if not re.fullmatch(r"[\w-]+==[\w.]+", line)] == []
