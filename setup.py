"""Builds the extension module; everything else is in pyproject.toml."""

from setuptools import setup

setup(
    cffi_modules=["csrc/cffi_build.py:ffibuilder"],
    # One binary serves every Python from 3.11 on; cffi compiles for the limited API.
    options={"bdist_wheel": {"py_limited_api": "cp311"}},
)
