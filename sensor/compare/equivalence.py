"""One quantity in two recordings: whether it differs, by how much, and whether it is equivalent.

Values are those of blocks of frames, so that whatever links pixels or frames within a block is in
their scatter. Welch's t test says whether the means differ; two one-sided tests (Schuirmann 1987)
whether they surely differ by less than a margin, which is so where the 90 % interval lies inside.
"""

from typing import NamedTuple

import numpy as np
from scipy.stats import t

from megalopta.core.arrays import Floats


class Difference(NamedTuple):
    """Relative difference of captured and expected values of one quantity."""

    name: str
    captured: float
    expected: float
    unit: str
    relative: float
    """Captured over expected, less 1."""
    low: float
    high: float
    """Its 95 % interval."""
    p: float
    is_equivalent: bool
    """Whether it is surely less than the margin."""
    scale: float = 0.0
    """What the difference is relative to, where that is not the expected value."""

    @property
    def size(self) -> float:
        """How large it is, either way: the logarithm of the ratio."""
        return abs(float(np.log(max(1 + self.relative, 1e-6))))

    @property
    def base(self) -> str:
        """What the difference is a share of, where that is not the expected value; else empty."""
        return f" of {self.scale:.2g}" if self.scale > abs(self.expected) else ""

    def __str__(self) -> str:
        """Say it in words."""
        way = "higher" if self.relative > 0 else "lower"
        return (
            f"{self.name} {100 * abs(self.relative):.2g} %{self.base} {way} "
            f"(95 %: {100 * self.low:+.2g} to {100 * self.high:+.2g} %)"
        )


def difference(
    name: str,
    captured: Floats,
    expected: Floats,
    unit: str,
    margin: float,
    least: float = 0.0,
    unsure: float = 0.0,
) -> Difference:
    """Compare the values of blocks.

    Parameters
    ----------
    name : str
    captured, expected : (blocks,)
    unit : str
    margin : float
        Relative difference that does not matter.
    least : float
        Differences are relative to the expected value, or to this where that is smaller.
    unsure : float
        Standard error of what the expected values should have been, as of a calibration, which
        no further block makes smaller.
    """
    means = captured.mean(), expected.mean()
    parts = [each.var(ddof=1) / each.size for each in (captured, expected)]
    error = float(np.sqrt(sum(parts) + unsure**2))
    freedom = sum(parts) ** 2 / max(
        sum(
            part**2 / (each.size - 1)
            for part, each in zip(parts, (captured, expected), strict=True)
        ),
        1e-300,
    )
    scale = max(abs(float(means[1])), least, 1e-300)
    apart = float(means[0] - means[1])
    p = float(2 * t.sf(abs(apart) / error, freedom)) if error > 0 else float(apart == 0)
    wide, narrow = (float(t.ppf(level, max(freedom, 1))) * error / scale for level in (0.975, 0.95))
    relative = apart / scale
    return Difference(
        name,
        float(means[0]),
        float(means[1]),
        unit,
        relative,
        relative - wide,
        relative + wide,
        p,
        abs(relative) + narrow < margin,
        scale,
    )
