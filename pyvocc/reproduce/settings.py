"""What is asked for."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Self

# Sweeps have many passes, which differ by much more than a picture's size makes.
SWEEP_SIZE = 512


@dataclass(frozen=True)
class Settings:
    """A run.

    Attributes:
        meshes: the folder of the models; None for generated meshes.
        only: names of subjects; empty for all.
        size: pixels along a side of the image.
        sweep_size: the same in the sweeps.
        samples: of each light.
        rounds: of timed passes.
    """

    meshes: Path | None
    only: tuple[str, ...]
    size: int
    sweep_size: int
    samples: int
    rounds: int

    @classmethod
    def of(
        cls,
        meshes: Path | None = None,
        only: tuple[str, ...] = (),
        size: int | None = None,
        sweep_size: int | None = None,
        samples: int | None = None,
        rounds: int | None = None,
        quick: bool = False,
    ) -> Self:
        """With the defaults for what is None: the slides', or those of a quick run."""
        pixels = size or (128 if quick else 1024)
        return cls(
            meshes,
            only,
            pixels,
            sweep_size or min(pixels, SWEEP_SIZE),
            samples or (4 if quick else 20),
            rounds or (1 if quick else 3),
        )
