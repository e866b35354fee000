"""Builds `pyvocc._vocc`, the extension module: cffi's glue and all of csrc/*.c.

The declarations are the text of vocc.h between its `<cffi>` markers, so that
they are written once.
"""

from __future__ import annotations

import os
import re
from pathlib import Path

from cffi import FFI

ROOT = Path(__file__).resolve().parent.parent
HEADER = ROOT / "csrc" / "vocc.h"

# The one C function that runs Python: every long call's progress callback.
CALLBACK = 'extern "Python" int pyvocc_progress(void *user, double fraction);'


def declarations(header: str) -> str:
    """The part of vocc.h that cffi reads, without comments and VOCC_API."""
    text = re.sub(r"/\*.*?\*/", _marker_or_nothing, header, flags=re.DOTALL)
    _, _, text = text.partition("<cffi>")
    text, end, _ = text.partition("</cffi>")
    if not end:
        raise ValueError("vocc.h lacks its <cffi> markers")
    return text.replace("VOCC_API ", "")


def _marker_or_nothing(comment: re.Match[str]) -> str:
    marker = re.search(r"</?cffi>", comment.group())
    return marker.group() if marker else " "


def compiler_settings() -> dict[str, list[str]]:
    """Flags, alike for every file: no float contraction, no fast math."""
    if os.name == "nt":
        return {"extra_compile_args": ["/O2", "/fp:precise"]}
    flags = ["-O3", "-std=c99", "-ffp-contract=off", "-fvisibility=hidden"]
    return {
        "extra_compile_args": flags,
        "extra_link_args": ["-pthread"],
        "libraries": ["m"],
    }


def relative(pattern: str) -> list[str]:
    """Files of csrc, sorted, as paths relative to the project (setuptools needs that)."""
    files = (ROOT / "csrc").glob(pattern)
    return sorted(file.relative_to(ROOT).as_posix() for file in files)


ffibuilder = FFI()
ffibuilder.cdef(declarations(HEADER.read_text(encoding="utf-8")) + CALLBACK)
ffibuilder.set_source(
    "pyvocc._vocc",
    '#include "vocc.h"',
    sources=relative("*.c"),
    depends=relative("*.h") + relative("*.inc"),
    include_dirs=["csrc"],
    **compiler_settings(),
)
