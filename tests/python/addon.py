"""Import this first, then the add-on's modules that need no Blender.

The add-on's own `__init__` needs it, so a package without one stands in its place.
"""

from __future__ import annotations

import sys
from pathlib import Path
from types import ModuleType

PACKAGE = "blender_addon"

_package = ModuleType(PACKAGE)
_package.__path__ = [str(Path(__file__).resolve().parents[2] / PACKAGE)]
sys.modules.setdefault(PACKAGE, _package)
