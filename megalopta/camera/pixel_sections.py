"""Parts of the comparison report that look at single pixels."""

from collections.abc import Iterator, Sequence

import numpy as np
from markupsafe import Markup

from megalopta.camera.comparison_charts import (
    dark_chart,
    distance_chart,
    spectrum_chart,
    transfer_chart,
)
from megalopta.camera.comparison_maps import map_sections
from megalopta.plotting.sections import Section, captioned
from megalopta.plotting.text import number
from megalopta.sensor.compare.counted import CountedFrames
from megalopta.sensor.compare.recordings import Comparison

Levels = Sequence[CountedFrames]


def pixel_sections(captured: Levels, simulated: Levels, found: Comparison) -> list[Section]:
    """All that says how pixels differ, level by level."""
    return [
        _tests(found),
        _histograms(found),
        Section("Alarms", _alarms(found)),
        Section("Distributions", charts=tuple(_curves(captured, simulated, found))),
        *map_sections(captured, simulated, found),
    ]


def _alarms(found: Comparison) -> str:
    if not found.alarms:
        return "None."
    first, *others = found.alarms
    return f"{'; '.join([first[0].upper() + first[1:], *others])}."


def _tests(found: Comparison) -> Section:
    tests = (("mean", found.means), ("variance", found.variances), ("histogram", found.histograms))
    rows = tuple(
        (name, str(int(np.isfinite(test.p).sum())), str(int(test.differs.sum())))
        for name, test in tests
    )
    return Section(
        "Pixels",
        "Tests of every pixel at every level; false discovery rate by Benjamini and Hochberg. "
        "Where some differ, the maps show which.",
        ("of", "tested", "differ"),
        rows,
    )


def _histograms(found: Comparison) -> Section:
    """Distances, beside those that samples of one law have."""
    rows = tuple(
        (
            f"{name.replace('_', ' ').capitalize()} ({unit})",
            number(float(np.median(distances))),
            number(float(np.median(getattr(found.by_chance, name)))),
        )
        for (name, distances), unit in zip(
            found.distances._asdict().items(), ("share", "counts", "counts^½"), strict=True
        )
    )
    return Section(
        "Histograms",
        "How far apart the histograms of a pixel are, median over pixels and levels, and how far "
        "by chance, with the frames of both dealt out anew.",
        ("distance", "captured and simulated", "by chance"),
        rows,
    )


def _curves(captured: Levels, simulated: Levels, found: Comparison) -> Iterator[Markup]:
    yield captioned(
        transfer_chart(captured, simulated),
        "Photon transfer, points are pixels at each level: clouds that lie on each other have the "
        "same step and noise; one that is higher has a larger step or more crosstalk.",
    )
    yield captioned(
        spectrum_chart(captured[-1], simulated[-1]),
        "Temporal spectrum of the last recording: level lines are frames that know nothing of each "
        "other; captured power at low frequencies is drift, a peak is hum or flicker.",
    )
    dark = [at for at, level in enumerate(captured) if level.is_dark]
    if dark:
        at = max(dark, key=lambda place: captured[place].exposure_s)
        yield captioned(
            dark_chart(captured[at], simulated[at]),
            "Dark counts of the pixels in order: a curve that is moved sideways is another "
            "temperature or excess bias; only its end differs where hot pixels do.",
        )
    yield captioned(
        distance_chart(found),
        "Distances of the histograms, above: where the curves part, pixels are further apart than "
        "chance makes them; bright levels may be so by the errors of the calibration alone.",
    )
