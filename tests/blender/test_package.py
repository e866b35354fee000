"""The extension as a user gets it: installed, enabled, rendered, disabled and removed.

Each session is a Blender of its own with empty settings, which finds neither the checkout nor what
pip has installed beside bpy: pyvocc and cffi can come from the extension's own wheels alone.
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import sysconfig
import tomllib
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import exr
import numpy as np
import pytest

Session = Callable[[str], dict[str, Any]]

CARRIED = ("pyvocc", "cffi", "_cffi_backend", "pycparser", "__editable__")

# An exit that hangs is what this would end.
TIMEOUT = 120.0


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Links to all that stands beside bpy, but for what the extension carries."""
    folder = tmp_path_factory.mktemp("site")
    for path in Path(sysconfig.get_path("purelib")).iterdir():
        if not path.name.startswith(CARRIED) and path.suffix != ".pth":
            (folder / path.name).symlink_to(path)
    return folder


@pytest.fixture
def resources(tmp_path: Path) -> Path:
    folder = tmp_path / "resources"
    folder.mkdir()
    return folder


@pytest.fixture
def session(extension: Path, site: Path, resources: Path, tmp_path: Path) -> Session:
    """Runs steps in a new Blender that has the test's user folder."""

    def run(steps: str) -> dict[str, Any]:
        script = Path(__file__).with_name("package_session.py")
        findings = tmp_path / "findings.json"
        findings.unlink(missing_ok=True)
        outputs = (tmp_path / "masks.exr", findings)
        result = subprocess.run(
            # -I and -S: no PYTHON* variables, no site-packages.
            [sys.executable, "-I", "-S", script, site, steps, extension, *outputs],
            cwd=tmp_path,
            env={**os.environ, "BLENDER_USER_RESOURCES": str(resources)},
            capture_output=True,
            text=True,
            timeout=TIMEOUT,
            check=False,
        )
        assert result.returncode == 0, result.stdout + result.stderr
        found = json.loads(findings.read_text(encoding="utf-8"))
        return {"console": result.stdout + result.stderr, **found}

    return run


def test_the_manifest_says_what_the_project_says(extension: Path, root: Path) -> None:
    project = tomllib.loads((root / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    with zipfile.ZipFile(extension) as packed:
        manifest = tomllib.loads(packed.read("blender_manifest.toml").decode())
        names = packed.namelist()
    assert manifest["version"] == project["version"]
    assert extension.name == (
        f"{manifest['id']}-{manifest['version']}-{manifest['platforms'][0]}.zip"
    )
    # The platform's rules for names.
    assert "blender" not in manifest["name"].lower()
    sources = (path.name for path in (root / "blender_addon").glob("*.py"))
    wheels = (wheel.removeprefix("./") for wheel in manifest["wheels"])
    assert sorted(names) == sorted([*sources, *wheels, "LICENSE", "blender_manifest.toml"])


def test_installed_rendered_and_removed(session: Session, resources: Path, tmp_path: Path) -> None:
    found = session("install,enable,look,render")
    assert "Traceback" not in found["console"], found["console"]
    assert found["engine"]
    wheels = resources / "extensions" / ".local"
    folder = resources / "extensions" / "user_default" / "volumetric_occluders"
    for name, file in found["files"].items():
        if file is None:
            assert name == "cffi", f"{name} is not loaded"  # its C part does without it
        else:
            assert Path(file).is_relative_to(folder if name.startswith("bl_ext") else wheels), name
    mask = exr.passes(tmp_path / "masks.exr")["Shadow Key.X"]
    assert mask.shape == (16, 16)
    # The sun stands in the east: the box's shadow falls to the west of the middle.
    assert mask.min() == 0.0 and mask.max() == 1.0
    dark = np.argwhere(mask < 0.5)
    assert dark[:, 1].mean() < 7.5

    # A new Blender has it disabled, as preferences were not saved.
    found = session("enable,disable,remove")
    assert "Traceback" not in found["console"], found["console"]
    assert not found["engine"]
    assert not folder.exists()
    assert not list(wheels.rglob("pyvocc"))


def test_without_its_wheels_the_error_is_plain(session: Session, resources: Path) -> None:
    session("install,enable")
    (wheel,) = (resources / "extensions" / ".local").rglob("site-packages/pyvocc")
    shutil.rmtree(wheel)
    found = session("enable_in_vain,look")
    assert not found["engine"]
    # As Blender shows it: one sentence, no traceback.
    assert 'volumetric_occluders", cause: Volumetric Occluders needs' in found["error"]
    assert len(found["error"].strip().splitlines()) == 1, found["error"]
