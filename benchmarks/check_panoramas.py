"""The shipped forests rendered again and compared, as a table: check_panoramas.py [FOLDER].

Two renderings of a scene differ by their noise alone. So the RMS of their difference is compared
with that of the noise, for pixels and for means of blocks, where noise averages out and a change of
the scene does not. The same seed on the same kind of machine gives a smaller difference.
"""

import math
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

from megalopta.benchmark.panoramas import (
    NATURAL_PANORAMAS,
    RECIPE,
    SHIPPED,
    read_template,
    render_panorama,
    write_template,
)
from megalopta.core.folders import ensure_directory
from megalopta.core.progress import progress
from megalopta.dataset.rendering_noise import ATTRIBUTE
from megalopta.render import RenderNoise, read_attributes

BLOCK = 25
"""Side of a block (px)."""
LIMIT = 2.0
"""Largest ratio of the difference to noise. The mean square over some 300 blocks, if only twenty of
them counted, exceeds four times its expectation by chance once in 3e8."""


@dataclass(frozen=True)
class PanoramaComparison:
    """A rendering and the shipped file, RMS over the mean radiance."""

    pixels: float
    blocks: float
    """Difference of pixels, and of the means of blocks."""
    noise: float
    """Expected difference of pixels by noise; that of blocks is 1/25 of it."""

    @property
    def agrees(self) -> bool:
        """True if noise explains the difference."""
        return self.pixels < LIMIT * self.noise and self.blocks < LIMIT * self.noise / BLOCK


def compare(shipped: Path, radiance: NDArray[np.float32], noise: RenderNoise) -> PanoramaComparison:
    """Compare a rendering (251, m, 1) and its noise with a shipped file."""
    before = read_template(shipped)
    its_noise = RenderNoise.from_json(read_attributes(shipped)[ATTRIBUTE])
    difference = radiance[..., 0] / radiance.mean(dtype=np.float64) - before
    rows, columns = (BLOCK * (side // BLOCK) for side in difference.shape)
    shape = rows // BLOCK, BLOCK, columns // BLOCK, BLOCK
    return PanoramaComparison(
        pixels=_rms(difference),
        blocks=_rms(difference[:rows, :columns].reshape(shape).mean(axis=(1, 3))),
        noise=math.hypot(noise.rms_over_mean, its_noise.rms_over_mean),
    )


def run_check_panoramas(out: Path | None = None) -> bool:
    """Render the shipped panoramas, print differences; return True if noise explains them.

    Renderings go to the folder `out`, in the form of shipped files.
    """
    if out:
        ensure_directory(out)
    table = Table("forest", "difference", "noise", "of blocks", "noise", "")
    passed = True
    passes = sum(recipe.passes for recipe in NATURAL_PANORAMAS.values())
    with progress("Rendering forest panoramas", passes, "exposure") as advance:
        for name, recipe in NATURAL_PANORAMAS.items():
            radiance, noise = render_panorama(recipe, advance)
            if out:
                write_template(out / f"{name}.exr", recipe, radiance, noise)
            passed &= _add_row(table, name, recipe.sha256, radiance, noise)
    Console().print(table)
    return passed


def _add_row(
    table: Table, name: str, recipe: str, radiance: NDArray[np.float32], noise: RenderNoise
) -> bool:
    shipped = SHIPPED / f"{name}.exr"
    if not shipped.exists():
        table.add_row(name, *["–"] * 4, "is not shipped yet")
        return False
    found = compare(shipped, radiance, noise)
    is_current = read_attributes(shipped).get(RECIPE) == recipe
    verdict = "agrees" if found.agrees else "differs: raise RENDER_MODEL and ship it again"
    shares = found.pixels, found.noise, found.blocks, found.noise / BLOCK
    table.add_row(
        name,
        *(f"{share:.2%}" for share in shares),
        verdict if is_current else "is of another recipe: ship it again",
    )
    return found.agrees and is_current


def _rms(values: NDArray[np.float64]) -> float:
    return math.sqrt(np.mean(np.square(values)))


if __name__ == "__main__":
    sys.exit(not run_check_panoramas(Path(sys.argv[1]) if len(sys.argv) > 1 else None))
