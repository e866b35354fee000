"""Runs pytest in the Python of Blender and ends the process, whatever Blender would do at exit."""

from __future__ import annotations

import os
import platform
import sys
from pathlib import Path
from typing import Any

import pytest

# As pytest's own last line has them.
OUTCOMES = ("failed", "error", "passed", "skipped", "xfailed")


class Summary:
    """Writes the outcome, and why tests were skipped, for the runner to print at its end."""

    def __init__(self, file: Path) -> None:
        self.file = file

    def pytest_terminal_summary(self, terminalreporter: Any) -> None:
        import bpy

        stats = terminalreporter.stats
        counts = [f"{len(stats[outcome])} {outcome}" for outcome in OUTCOMES if stats.get(outcome)]
        title = f"Blender {bpy.app.version_string}, Python {platform.python_version()}"
        lines = [f"{title}: {', '.join(counts) or 'no tests'}"]
        reasons = [report.longrepr[2] for report in stats.get("skipped", [])]
        for reason in sorted(set(reasons)):
            lines.append(f"    {reasons.count(reason)} skipped: {reason.removeprefix('Skipped: ')}")
        self.file.write_text("\n".join(lines) + "\n", encoding="utf-8")


if __name__ == "__main__":
    code = pytest.main(sys.argv[2:], plugins=[Summary(Path(sys.argv[1]))])
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(int(code))
