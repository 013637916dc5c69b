"""`megalopta check panoramas`: the shipped forests rendered again and compared, as a table.

Two renderings of a scene differ by their noise alone. So the RMS of their difference is compared
with that of the noise, of pixels and of the means of blocks, where noise averages out and a change
of the scene does not. Rendering with the same seed on a machine of the same kind gives less.
"""

import math
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
"""Largest difference over what noise makes. The mean square over some 300 blocks, were twenty of
them alone to count, exceeds four times its expectation by chance once in 3e8."""


@dataclass(frozen=True)
class Comparison:
    """A rendering beside the shipped file, RMS over the mean radiance."""

    pixels: float
    blocks: float
    """Difference of pixels, and of the means of blocks."""
    noise: float
    """What noise makes of the difference of pixels; that of blocks is 1/25 of it."""

    @property
    def agrees(self) -> bool:
        """Whether noise explains the difference."""
        return self.pixels < LIMIT * self.noise and self.blocks < LIMIT * self.noise / BLOCK


def compare(shipped: Path, radiance: NDArray[np.float32], noise: RenderNoise) -> Comparison:
    """Compare a rendering (251, m, 1) and its noise with a shipped file."""
    before = read_template(shipped)
    its_noise = RenderNoise.from_json(read_attributes(shipped)[ATTRIBUTE])
    difference = radiance[..., 0] / radiance.mean(dtype=np.float64) - before
    rows, columns = (BLOCK * (side // BLOCK) for side in difference.shape)
    shape = rows // BLOCK, BLOCK, columns // BLOCK, BLOCK
    return Comparison(
        pixels=_rms(difference),
        blocks=_rms(difference[:rows, :columns].reshape(shape).mean(axis=(1, 3))),
        noise=math.hypot(noise.rms_over_mean, its_noise.rms_over_mean),
    )


def run_check_panoramas(out: Path | None = None, console: Console | None = None) -> bool:
    """Render all shipped panoramas again, print how they differ; return whether noise explains it.

    What was rendered goes to the folder `out`, as it would be shipped.
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
    (console or Console()).print(table)
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
    verdict = "agrees" if found.agrees else "differs: raise RENDER_MODEL and ship it anew"
    shares = found.pixels, found.noise, found.blocks, found.noise / BLOCK
    table.add_row(
        name,
        *(f"{share:.2%}" for share in shares),
        verdict if is_current else "shows another recipe: ship it anew",
    )
    return found.agrees and is_current


def _rms(values: NDArray[np.float64]) -> float:
    return math.sqrt(np.mean(np.square(values)))
