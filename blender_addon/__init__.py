# SPDX-License-Identifier: GPL-3.0-or-later
"""Volumetric Occluders: exact shadow masks, a pass for each light, in Blender.

From Python: `shadow_masks(scene)`; see its help.
"""

from __future__ import annotations

try:
    import pyvocc  # noqa: F401
except ImportError as error:
    # With a name: Blender shows the text of such an error instead of a traceback.
    raise ImportError(
        "Volumetric Occluders needs the Python package pyvocc, which is part of the add-on's zip "
        f"file for your system: install the add-on from that file ({error})",
        name=__name__,
    ) from error

from . import engine, operators, panels, properties
from .headless import shadow_masks

__all__ = ["register", "shadow_masks", "unregister"]

# In the order in which they need each other.
_MODULES = (properties, engine, operators, panels)


def register() -> None:
    """Called by Blender when the add-on is switched on."""
    for module in _MODULES:
        module.register()


def unregister() -> None:
    """Called by Blender when the add-on is switched off."""
    for module in reversed(_MODULES):
        module.unregister()
