"""The comparison report."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from markupsafe import Markup

from megalopta.calibration import map_chart
from megalopta.comparison.charts import (
    dark_chart,
    difference_chart,
    distance_chart,
    response_chart,
    spectrum_chart,
    time_chart,
    transfer_chart,
)
from megalopta.comparison.motion import SpeedResponse
from megalopta.comparison.moving import SceneComparison
from megalopta.pages import Section, number, write_sections
from megalopta.sensor.compare import Comparison, CountedFrames, Difference

Levels = Sequence[CountedFrames]

_HEAD = ("", "captured", "simulated", "difference", "95 %", "p", "verdict")


def write_comparison_report(
    path: Path, name: str, captured: Levels, simulated: Levels, found: Comparison
) -> None:
    """Write how captured levels differ from simulated ones, with pictures."""
    order = found.arrangement
    rows = f" Rows, top to bottom: {', '.join(map(str, order.rows))}." if order.rows else ""
    sections = [
        Section(
            "The device",
            f"Alarms are raised in at most {100 * found.false_alarms:g} % of comparisons of a "
            f"device with itself; less than {100 * found.margin:g} % does not matter: “equivalent” "
            "is what is surely less (two one-sided tests at 95 %).",
            _HEAD,
            tuple(_row(each, found) for each in found.differences),
        ),
        Section(
            "Order of the pixels",
            f"The captured image is {order.name}: rank correlation of the two patterns "
            f"{order.correlation:.3f}.{rows}",
        ),
        *_of_pixels(captured, simulated, found),
    ]
    write_sections(path, f"{name}: captured and simulated", found.sentence, sections)


def write_scene_report(path: Path, name: str, compared: SceneComparison) -> None:
    """Write how a captured scene differs from a simulated one, with pictures."""
    found = compared.found
    sections = [
        Section(
            "The scene",
            f"Frames are aligned in time by their correlation, {compared.aligned.correlation:.2f}, "
            "and each is simulated as it was seen. Quantities are compared in blocks of frames; "
            f"less than {100 * found.margin:g} % does not matter.",
            _HEAD,
            tuple(_row(each, found) for each in found.differences),
        ),
        Section("In time", charts=(time_chart(compared.captured, compared.simulated),)),
        *_of_pixels([compared.captured], [compared.simulated], found),
    ]
    write_sections(path, f"{name}: captured and simulated", found.sentence, sections)


def _of_pixels(captured: Levels, simulated: Levels, found: Comparison) -> tuple[Section, ...]:
    apart = (
        difference_chart(one, other, f"apart-{at}")
        for at, (one, other) in enumerate(zip(captured, simulated, strict=True))
    )
    return (
        _tests(found),
        _histograms(found),
        Section("Alarms", "; ".join(found.alarms) or "None."),
        Section("Distributions", charts=_distributions(captured, simulated)),
        Section(
            "Maps",
            "Differences in standard errors of counting, without those of the calibration, which "
            "the tests above take into account.",
            charts=(*_maps(captured, simulated), *apart),
        ),
    )


def write_motion_report(path: Path, name: str, responses: Sequence[SpeedResponse]) -> str:
    """Write how responses to a moving plate differ; return the sentence on it."""
    limit = 0.01 / len(responses)
    real = [each.difference for each in responses if each.difference.p < limit]
    real.sort(key=lambda each: -each.size)
    sentence = (
        f"Captured: {'; '.join(map(str, real[:3]))}." if real else "Nothing differs beyond chance."
    )
    rows = tuple(_cells(each.difference, each.difference.p < limit) for each in responses)
    charts = tuple(response_chart(responses, method) for method in ("NDM", "NDS"))
    sections = [
        Section(
            "Transfer functions",
            "Mean and standard deviation of crossings. Of captured frames, 32 around each edge "
            "that passes are taken.",
            charts=charts,
        ),
        Section("Responses", "Peak responses to the edge.", _HEAD, rows),
    ]
    write_sections(path, f"{name}: responses to a moving plate", sentence, sections)
    return sentence


def _row(each: Difference, found: Comparison) -> tuple[str, ...]:
    limit = found.false_alarms / 5 / max(len(found.differences), 1)
    return _cells(each, each.p < limit)


def _cells(each: Difference, differs: bool) -> tuple[str, ...]:
    verdict = " and ".join(
        word for word, holds in (("differs", differs), ("equivalent", each.is_equivalent)) if holds
    )
    return (
        f"{each.name} ({each.unit})",
        number(each.captured),
        number(each.expected),
        f"{100 * each.relative:+.2g} %",
        f"{100 * each.low:+.2g} to {100 * each.high:+.2g} %",
        f"{each.p:.2g}",
        verdict or "not told apart",
    )


def _tests(found: Comparison) -> Section:
    tests = (("mean", found.means), ("variance", found.variances), ("histogram", found.histograms))
    rows = tuple(
        (name, str(int(np.isfinite(test.p).sum())), str(int(test.differs.sum())))
        for name, test in tests
    )
    return Section(
        "Pixels",
        "Tests of every pixel at every level; false discovery rate by Benjamini and Hochberg.",
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
        (distance_chart(found),),
    )


def _distributions(captured: Levels, simulated: Levels) -> tuple[Markup, ...]:
    charts = [transfer_chart(captured, simulated), spectrum_chart(captured[-1], simulated[-1])]
    dark = [at for at, level in enumerate(captured) if level.is_dark]
    if dark:
        at = max(dark, key=lambda place: captured[place].exposure_s)
        charts.append(dark_chart(captured[at], simulated[at]))
    return tuple(charts)


def _maps(captured: Levels, simulated: Levels) -> tuple[Markup, ...]:
    charts = []
    for name, levels in (("captured", captured), ("simulated", simulated)):
        counts = levels[0].counts
        charts.append(map_chart(counts.mean(axis=0), f"mean-{name}", f"mean, {name} (counts)"))
        variance = counts.var(axis=0, dtype=np.float64)
        charts.append(map_chart(variance, f"variance-{name}", f"variance, {name} (counts²)"))
    return tuple(charts)
