"""Builds the extension for Blender: `python -m tools.build_addon` writes dist/*.zip.

It holds `blender_addon/`, a wheel of this pyvocc for this platform and the wheels of what that
needs, for the Python of every Blender. Blender's own command line validates and packs it. The same
sources, compiler and SOURCE_DATE_EPOCH give the same bytes.
"""

from __future__ import annotations

import hashlib
import os
import platform
import shutil
import subprocess
import sys
import time
import tomllib
import zipfile
from pathlib import Path

from .blender_env import PYTHONS, REQUIREMENTS, ROOT, UnavailableError, environment

NAME = "volumetric_occluders"
SOURCE = ROOT / "blender_addon"
BUILD = ROOT / "build" / "addon"

SYSTEMS = {"Linux": "linux", "Darwin": "macos", "Windows": "windows"}
MACHINES = {"x86_64": "x64", "AMD64": "x64", "aarch64": "arm64", "arm64": "arm64"}

# The newest first: its command line knows all that the older ones do.
WITH_CLI = ("5.2", "4.5")

# Of every file in the archives; a ZIP file cannot say anything before 1980.
EPOCH = int(os.environ.get("SOURCE_DATE_EPOCH", "315619200"))


class BuildError(Exception):
    """The extension cannot be built; the text says why."""


def version() -> str:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    return str(project["version"])


def blender_platform() -> str:
    """This machine as Blender names it: linux-x64."""
    return f"{SYSTEMS[platform.system()]}-{MACHINES[platform.machine()]}"


def archive() -> Path:
    """Where the extension is written."""
    return ROOT / "dist" / f"{NAME}-{version()}-{blender_platform()}.zip"


def build() -> Path:
    cli, tags = _blender_cli()
    stage = BUILD / NAME
    shutil.rmtree(stage, ignore_errors=True)
    (stage / "wheels").mkdir(parents=True)
    for wheel in [_own_wheel(), *_other_wheels()]:
        shutil.copy(wheel, stage / "wheels")
    files = [path for path in SOURCE.rglob("*.py") if "__pycache__" not in path.parts]
    for path in [*files, SOURCE / "LICENSE"]:
        target = stage / path.relative_to(SOURCE)
        target.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(path, target)
    _write_manifest(stage)
    output = archive()
    output.parent.mkdir(exist_ok=True)
    _run(sys.executable, cli, "validate", "--valid-tags", tags, stage)
    options = ("--source-dir", stage, "--output-filepath", output, "--valid-tags", tags)
    _run(sys.executable, cli, "build", *options)
    _settle(output)
    _run(sys.executable, cli, "validate", "--valid-tags", tags, output)
    return output


def _write_manifest(stage: Path) -> None:
    text = (SOURCE / "blender_manifest.toml.in").read_text(encoding="utf-8")
    _, _, text = text.partition("\n")  # the comment about this template
    wheels = sorted(path.name for path in stage.glob("wheels/*.whl"))
    for key, value in {
        "VERSION": version(),
        "PLATFORM": blender_platform(),
        "WHEELS": "[\n" + "".join(f'    "./wheels/{name}",\n' for name in wheels) + "]",
    }.items():
        text = text.replace(f"@{key}@", value)
    (stage / "blender_manifest.toml").write_text(text, encoding="utf-8")


def _settle(path: Path) -> None:
    """Packs again what Blender has packed in the order and with the dates of the disk."""
    with zipfile.ZipFile(path) as packed:
        files = {name: packed.read(name) for name in sorted(packed.namelist())}
    with zipfile.ZipFile(path, "w") as packed:
        for name, data in files.items():
            entry = zipfile.ZipInfo(name, time.gmtime(EPOCH)[:6])
            entry.external_attr = 0o644 << 16
            is_packed = name.endswith(".whl")
            entry.compress_type = zipfile.ZIP_STORED if is_packed else zipfile.ZIP_DEFLATED
            packed.writestr(entry, data)


def _blender_cli() -> tuple[Path, Path]:
    """Blender's `extension` command, which is plain Python, and its list of tags."""
    reasons = []
    for blender in WITH_CLI:
        try:
            folder = environment(blender).parents[1]
        except UnavailableError as error:
            reasons.append(f"Blender {blender}: {error}")
            continue
        scripts = f"lib/python{PYTHONS[blender]}/site-packages/bpy/{blender}/scripts"
        return (
            folder / scripts / "addons_core/bl_pkg/cli/blender_ext.py",
            folder / scripts / "modules/_bpy_internal/extensions/tags.py",
        )
    raise BuildError("; ".join(reasons))


def _own_wheel() -> Path:
    """pyvocc for every Python from 3.11 on, compiled again only if C or the compiler changed."""
    source = BUILD / "source"
    digest = hashlib.sha256(os.environ.get("CC", "").encode())
    for path in (*sorted((ROOT / "csrc").iterdir()), ROOT / "setup.py", ROOT / "pyproject.toml"):
        if path.is_file():
            digest.update(path.name.encode() + b"\0" + path.read_bytes())
    compiled_from = source / "digest"
    if not compiled_from.exists() or compiled_from.read_text() != digest.hexdigest():
        shutil.rmtree(source, ignore_errors=True)
        shutil.copytree(ROOT / "csrc", source / "csrc", ignore=_NOT_SOURCE)
    for folder in (source / "pyvocc", *source.glob("build/bdist*")):
        shutil.rmtree(folder, ignore_errors=True)
    # A module that is gone from the sources must not come from an earlier build.
    for path in source.glob("build/lib*/**/*.py*"):
        path.unlink()
    shutil.copytree(ROOT / "pyvocc", source / "pyvocc", ignore=_NOT_SOURCE)
    for name in ("pyproject.toml", "setup.py", "MANIFEST.in", "LICENSE", "README.md"):
        shutil.copy2(ROOT / name, source)
    wheels = BUILD / "own"
    shutil.rmtree(wheels, ignore_errors=True)
    pip = (sys.executable, "-m", "pip", "--disable-pip-version-check", "wheel", "--quiet")
    _run(*pip, "--no-build-isolation", "--no-deps", "--wheel-dir", wheels, source)
    compiled_from.write_text(digest.hexdigest())
    (wheel,) = wheels.glob("*.whl")
    return _tagged(wheel) if sys.platform == "linux" else wheel


_NOT_SOURCE = shutil.ignore_patterns("*.so", "*.o", "*.pyd", "__pycache__")


def _tagged(wheel: Path) -> Path:
    """The wheel, stripped and named after the oldest glibc that it runs with."""
    tagged = wheel.parent / "tagged"
    repair = (sys.executable, "-m", "auditwheel", "repair", "--strip")
    _run(*repair, "--wheel-dir", tagged, wheel)
    (found,) = tagged.glob("*.whl")
    return found


def _other_wheels() -> list[Path]:
    requirements = REQUIREMENTS / "addon.txt"
    wanted = requirements.read_text(encoding="utf-8") + " ".join(sorted(set(PYTHONS.values())))
    folder = BUILD / "others"
    complete = folder / "requirements.txt"
    if not complete.exists() or complete.read_text(encoding="utf-8") != wanted:
        shutil.rmtree(folder, ignore_errors=True)
        for python in sorted(set(PYTHONS.values())):
            pip = (sys.executable, "-m", "pip", "--disable-pip-version-check", "download")
            target = ("--python-version", python, "--only-binary=:all:", "--no-deps")
            _run(*pip, "--quiet", *target, "--dest", folder, "-r", requirements)
        complete.write_text(wanted, encoding="utf-8")
    return sorted(folder.glob("*.whl"))


def _run(*command: Path | str) -> None:
    path = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
    settings = {"SOURCE_DATE_EPOCH": str(EPOCH), "PATH": path}
    result = subprocess.run(
        command, env={**os.environ, **settings}, capture_output=True, text=True, check=False
    )
    if result.returncode:
        words = " ".join(str(word) for word in command)
        raise BuildError(f"{words}\n{result.stdout}{result.stderr}".rstrip())


def main() -> int:
    try:
        output = build()
    except BuildError as error:
        print(f"build_addon: {error}", file=sys.stderr)
        return 1
    print(f"{output.relative_to(ROOT)}: {output.stat().st_size / 1e6:.1f} MB")
    return 0


if __name__ == "__main__":
    sys.exit(main())
