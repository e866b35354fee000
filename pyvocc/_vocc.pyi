"""The extension module that cffi makes; `_ffi.py` gives its contents types."""

from typing import Any

ffi: Any
lib: Any
