"""Files: meshes, scenes and images.

Meshes in PLY, OBJ, STL and OFF and scene files need nothing more than NumPy; other mesh
formats need trimesh, EXR files OpenEXR and PNG files Pillow: ``pip install 'pyvocc[io]'``.
They are imported when they are needed, with an ImportError that says so.
"""

from __future__ import annotations

from ._files import FileError
from .images import look, read_image, write_exr, write_png
from .mesh_files import load_mesh, save_ply
from .scene_files import SceneFile, SceneMesh, load_scene

__all__ = [
    "FileError",
    "SceneFile",
    "SceneMesh",
    "load_mesh",
    "load_scene",
    "look",
    "read_image",
    "save_ply",
    "write_exr",
    "write_png",
]
