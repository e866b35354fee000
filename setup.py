"""Builds the extension module; everything else is in pyproject.toml."""

import os
from pathlib import Path

from setuptools import Extension, setup
from setuptools.command.build_ext import build_ext


class BuildExt(build_ext):
    """Links the objects in the folder VOCC_OBJECTS, if it is set, in place of compiling csrc.

    The Makefile names those that the C tests are made of: compiled once, several at a time.
    """

    def build_extension(self, ext: Extension) -> None:
        folder = os.environ.get("VOCC_OBJECTS")
        if folder:
            compiled = [source for source in ext.sources if Path(source).parent.name == "csrc"]
            ext.sources = [source for source in ext.sources if source not in compiled]
            objects = [str(Path(folder, Path(each).stem + ".o")) for each in compiled]
            ext.extra_objects += objects
            ext.depends += objects
        super().build_extension(ext)


setup(
    cffi_modules=["csrc/cffi_build.py:ffibuilder"],
    cmdclass={"build_ext": BuildExt},
    # One binary serves every Python from 3.11 on; cffi compiles for the limited API.
    options={"bdist_wheel": {"py_limited_api": "cp311"}},
)
