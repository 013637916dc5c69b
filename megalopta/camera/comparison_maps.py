"""Maps of the comparison report: mean and variance of the pixels, level by level."""

from collections.abc import Iterator, Sequence

import numpy as np
from markupsafe import Markup
from scipy.stats import norm

from megalopta.camera.calibration_charts import color_limits, map_chart
from megalopta.core.arrays import Floats
from megalopta.plotting.sections import Section
from megalopta.sensor.compare.counted import CountedFrames
from megalopta.sensor.compare.recordings import Comparison

_LARGEST_Z = 6.0
_GUIDE = (
    "Captured and simulated share a scale. Beside them is how far apart they are, in standard "
    "errors of counting and calibration, as the tests above take it: pale grain is chance; strong "
    "colors, rows, columns or patches are a device that differs. Gray pixels are full, or have too "
    "few counts to tell."
)


def map_sections(
    captured: Sequence[CountedFrames], simulated: Sequence[CountedFrames], found: Comparison
) -> Iterator[Section]:
    """How to read maps, and those of each level."""
    yield Section("Maps", _GUIDE)
    for at, (one, other) in enumerate(zip(captured, simulated, strict=True)):
        means = one.counts.mean(axis=0), other.counts.mean(axis=0)
        variances = one.counts.var(axis=0), other.counts.var(axis=0)
        light = "dark" if one.is_dark else f"light {one.light_hz:g}"
        differing = [int(test.differs[at].sum()) for test in (found.means, found.variances)]
        yield Section(
            f"{light.capitalize()}, {one.exposure_s:g} s",
            f"Of {np.isfinite(found.means.p[at]).sum()} pixels {differing[0]} differ in the mean, "
            f"{differing[1]} in the variance.",
            charts=(
                *_row(f"mean-{at}", "counts", means, found.means.p[at]),
                *_row(f"variance-{at}", "counts²", variances, found.variances.p[at]),
            ),
        )


def _row(name: str, unit: str, maps: tuple[Floats, Floats], p: Floats) -> tuple[Markup, ...]:
    """Captured, simulated, and how far apart."""
    quantity = name.partition("-")[0]
    limits = color_limits(*maps)
    apart = np.sign(maps[0] - maps[1]) * norm.isf(p / 2)
    return (
        *(
            map_chart(values, f"{name}-{label}", f"{quantity}, {label} ({unit})", limits)
            for values, label in zip(maps, ("captured", "simulated"), strict=True)
        ),
        map_chart(
            apart,
            f"{name}-apart",
            f"{quantity}, captured less simulated (standard errors)",
            (-_LARGEST_Z, _LARGEST_Z),
            "PuOr",
        ),
    )
