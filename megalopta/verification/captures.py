"""`megalopta check captures`: measurements of real arrays next to the sensor's model.

The model is fitted to one half of a measurement and compared with the other half: pairs and maps by
the left and right half of the array, autocorrelations by even and odd pixels. A row is a quantity
of the second half, with the model's value and their difference in standard errors, the largest
first. Nothing passes or fails: a row of many errors is what the model does not describe.

Standard errors contain the scatter between pixels or pairs. Those of quantiles are binomial.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import numpy as np
from markupsafe import Markup
from rich.console import Console
from rich.table import Table
from scipy.stats import spearmanr

from megalopta.core.arrays import Floats
from megalopta.core.errors import refused_as
from megalopta.plotting.sections import Section, captioned, write_sections
from megalopta.plotting.style import BLACK, BLUE, VERMILION
from megalopta.plotting.svg import CHART_PT, in_style, map_chart, new_axes, with_legend
from megalopta.plotting.text import number
from megalopta.sensor import DarkCounts
from megalopta.sensor.calibrate.autocorrelation import (
    Autocorrelation,
    afterpulses_between,
    fit_exponential,
    fit_table,
)
from megalopta.sensor.calibrate.dark_distribution import cumulative, fit_dark_counts
from megalopta.sensor.calibrate.hot_neighbors import (
    FEWEST_PIXELS,
    crosstalk_of_hot_pixels,
    kernel_of,
)
from megalopta.sensor.calibrate.pair_crosstalk import PairCrosstalk, fit_crosstalk, modelled
from megalopta.sensor.effects import crosstalk
from megalopta.sensor.effects.crosstalk import REACH
from megalopta.verification.capture_files import Measurement, read_measurement, shipped

UP_TO_S = 8e-6
"""Longest lag of an autocorrelation that is used, s."""
_WIDTH = 120
_LAGS_NS = (100, 200, 400, 800, 1600)
_STRIPS = 4
"""Strips of a map, whose scatter gives the errors of crosstalk."""
_QUANTILES = (0.1, 0.5, 0.9, 0.99)
_PLACES = {
    "edge neighbor in the row": (0, 1),
    "edge neighbor in the column": (1, 0),
    "corner neighbor": (1, 1),
    "two away in the row": (0, 2),
    "two away in the column": (2, 0),
    "three away in the row": (0, 3),
    "knight's move": (1, 2),
}
_EDGES: dict[str, Callable[[Floats], Floats]] = {
    "in the row": lambda each: each[..., REACH, [REACH - 1, REACH + 1]],
    "above, even rows": lambda each: each[0, :, REACH - 1, REACH],
    "below, even rows": lambda each: each[0, :, REACH + 1, REACH],
    "above, odd rows": lambda each: each[1, :, REACH - 1, REACH],
    "below, odd rows": lambda each: each[1, :, REACH + 1, REACH],
}
"""Pixels across an edge, in shares by parity of the receiver's row and column."""
_NEXT = {"right": (0, 1), "lower": (1, 0)}


class CaptureRow(NamedTuple):
    """One quantity of the half that was not fitted."""

    capture: str
    quantity: str
    measured: float
    modelled: float
    error: float
    """Standard error of the difference"""

    @property
    def z(self) -> float:
        """Difference in standard errors."""
        return (self.measured - self.modelled) / self.error

    @property
    def texts(self) -> tuple[str, ...]:
        """Cells of a table."""
        values = number(self.measured), number(self.modelled)
        return self.capture, self.quantity, *values, f"{self.z:+.1f}"


HEAD = ("capture", "quantity", "measured", "model", "difference, errors")


def check_captures(paths: Sequence[Path] = ()) -> dict[Path, list[CaptureRow]]:
    """Compare measurements, those that ship and others, with the model fitted to half of each.

    Raises UserError if a file is not a measurement, or does not suffice for a fit.
    """
    found = {}
    for path in [*shipped(), *paths]:
        measurement = read_measurement(path)
        with refused_as(str(path)):
            found[path] = list(compare_halves(path.stem, measurement))
    return found


def compare_halves(name: str, measurement: Measurement) -> Iterator[CaptureRow]:
    """Yield the quantities of one measurement. Raises ValueError if it does not suffice."""
    if isinstance(measurement, PairCrosstalk):
        return _of_pairs(name, measurement)
    if isinstance(measurement, Autocorrelation):
        return _of_afterpulses(name, measurement.of(slice(None), UP_TO_S))
    return _of_dark_counts(name, measurement)


def print_captures(found: Mapping[Path, Sequence[CaptureRow]]) -> None:
    """Print a table of all quantities, the largest misfits first."""
    table = Table(*HEAD)
    for row in sorted_rows(found):
        table.add_row(*row.texts)
    Console(width=_WIDTH).print(table)


def sorted_rows(found: Mapping[Path, Sequence[CaptureRow]]) -> list[CaptureRow]:
    """Return all rows, the largest misfits first."""
    rows = [row for each in found.values() for row in each]
    return sorted(rows, key=lambda row: -abs(row.z))


def halves(pairs: PairCrosstalk) -> tuple[PairCrosstalk, PairCrosstalk]:
    """Return pairs of the left and of the right half of the array."""
    middle = (pairs.column.min() + pairs.column.max()) / 2
    return pairs.some(pairs.column < middle), pairs.some(pairs.column > middle)


def _of_pairs(name: str, pairs: PairCrosstalk) -> Iterator[CaptureRow]:
    fitted, tested = halves(pairs)
    model = fit_crosstalk(fitted)
    for title, place in _PLACES.items():
        values, before = (each.at(*place).probability for each in (tested, fitted))
        if min(values.size, before.size) > 2:
            expected = float(modelled(model, tested.at(*place))[0])
            yield _means(name, f"{title}, 1e-6", 1e6 * values, 1e6 * before, 1e6 * expected)
    beyond = tested.some((tested.down > 1) & (tested.right > 0) | (tested.right > REACH))
    if beyond.probability.size > 2:
        yield _means(name, "beyond the model's reach, mean of a pair, 1e-6",
                     1e6 * beyond.probability, None, 0.0)  # fmt: skip
    edges = tested.some(tested.down + tested.right == 1)
    ratio = edges.probability / edges.probability.mean() - 1
    counting = edges.error / edges.probability
    own = float(np.mean(ratio**2 - counting**2))
    error = float(np.sqrt(2 * np.mean(counting**4) / ratio.size))
    yield CaptureRow(name, "variance between edge neighbors beyond counting, %²", 1e4 * own, 0.0,
              1e4 * error)  # fmt: skip


def _means(
    name: str, title: str, values: Floats, fitted: Floats | None, expected: float
) -> CaptureRow:
    error = np.hypot(_error(values), 0.0 if fitted is None else _error(fitted))
    return CaptureRow(name, title, float(values.mean()), expected, float(error))


def _error(values: Floats) -> float:
    return float(values.std(ddof=1) / np.sqrt(values.size))


def _of_afterpulses(name: str, found: Autocorrelation) -> Iterator[CaptureRow]:
    fitted, tested = found.of(slice(0, None, 2)), found.of(slice(1, None, 2))
    inside = [lag for lag in _LAGS_NS if found.edges_s[0] <= 1e-9 * lag <= found.edges_s[-1]]
    edges = 1e-9 * np.array(inside)
    for kind, fit in (("exponential", fit_exponential), ("table", fit_table)):
        model = fit(fitted)
        expected = afterpulses_between(model, edges)
        for at, (low, high) in enumerate(pairwise(inside)):
            values, before = (1e3 * _between(each, edges)[:, at] for each in (tested, fitted))
            title = f"afterpulses at {low} to {high} ns, 1e-3, {kind}"
            yield _means(name, title, values, before, 1e3 * float(expected[at]))


def _between(found: Autocorrelation, edges_s: Floats) -> Floats:
    """Afterpulses per event of each pixel between lags, (P, K)."""
    sums = np.cumsum(found.afterpulses * np.diff(found.edges_s), axis=1)
    sums = np.pad(sums, ((0, 0), (1, 0)))
    at = [np.interp(edges_s, found.edges_s, each) for each in sums]
    return np.diff(at, axis=1)


def _of_dark_counts(name: str, rates: Floats) -> Iterator[CaptureRow]:
    middle = rates.shape[1] // 2
    fitted, tested = rates[:, :middle], rates[:, middle:]
    model = fit_dark_counts(fitted)
    known = np.sort(tested[np.isfinite(tested)])
    for share in _QUANTILES:
        quantile = np.array([_quantile(model, share, float(known[-1]))])
        below = float(np.searchsorted(known, quantile[0]) / known.size)
        error = float(np.sqrt(2 * share * (1 - share) / known.size))  # of both halves
        title = f"% of pixels below the model's {100 * share:g} % quantile of dark counts"
        yield CaptureRow(name, title, 100 * below, 100 * share, 100 * error)
    if rates.size >= FEWEST_PIXELS:
        yield from _of_hot_pixels(name, rates)
        return
    for title, place in _NEXT.items():
        yield CaptureRow(name, f"rank correlation of dark counts with the {title} neighbor",
                  rank_correlation(tested, place), 0.0, 1 / np.sqrt(known.size))  # fmt: skip


def _quantile(model: DarkCounts, share: float, largest: float) -> float:
    grid = np.concatenate(([0.0], np.geomspace(1e-6 * largest, 10 * largest, 20000)))
    return float(np.interp(share, cumulative(model, grid), grid))


def _of_hot_pixels(name: str, rates: Floats) -> Iterator[CaptureRow]:
    strip = np.broadcast_to(_STRIPS * np.arange(rates.shape[1]) // rates.shape[1], rates.shape)
    found = [crosstalk_of_hot_pixels(rates, strip == each) for each in range(_STRIPS)]
    fitted, tested = np.hstack(found[: _STRIPS // 2]), np.hstack(found[_STRIPS // 2 :])
    alike = np.mean([part(fitted).mean() for part in list(_EDGES.values())[:3]])
    for title, part in _EDGES.items():
        ours, theirs = (1e6 * part(each).ravel() for each in (tested, fitted))
        text = f"light of a hot pixel {title}, 1e-6"
        yield _means(name, f"{text}, shares by distance", ours, theirs, 1e6 * float(alike))
        yield _means(name, f"{text}, kernel", ours, theirs, float(theirs.mean()))
    talk = kernel_of(np.mean(found[: _STRIPS // 2], axis=0))
    known = np.nan_to_num(rates)
    right_half = strip >= _STRIPS // 2
    own = known - crosstalk.fired_mean(known, talk)
    # dark counts of the left half, each at a place of chance
    dark = np.random.default_rng(0).choice(np.maximum(own[~right_half], 0.0), rates.shape)
    drawn = crosstalk.mean(dark, talk)
    error = float(np.sqrt(2 / right_half.sum()))
    for title, place in _NEXT.items():
        text = f"rank correlation of dark counts with the {title} neighbor"
        values = (known, drawn, own)
        seen, modelled, left = (
            rank_correlation(np.where(right_half, each, np.nan), place) for each in values
        )
        yield CaptureRow(name, f"{text}, kernel", seen, modelled, error)
        yield CaptureRow(name, f"{text}, kernel subtracted", left, 0.0, error)


def rank_correlation(rates: Floats, place: tuple[int, int]) -> float:
    """Return the rank correlation of pixels with those so many rows and columns away."""
    down, right = place
    rows, columns = rates.shape
    ours, theirs = rates[: rows - down, : columns - right], rates[down:, right:]
    known = np.isfinite(ours) & np.isfinite(theirs)
    return float(spearmanr(ours[known], theirs[known])[0])


_TEXT = (
    "Quantities of the half that was not fitted; differences in standard errors, the largest first."
)
_MISFITS = 12


def write_captures_page(path: Path, found: Mapping[Path, Sequence[CaptureRow]]) -> Path:
    """Write the page of compared measurements; return its path."""
    worst = tuple(row.texts for row in sorted_rows(found)[:_MISFITS])
    sections = [Section("The largest misfits", _TEXT, HEAD, worst)]
    for at, (file, rows) in enumerate(found.items()):
        ordered = tuple(row.texts[1:] for row in sorted(rows, key=lambda row: -abs(row.z)))
        charts = tuple(_charts(file, f"capture-{at}"))
        sections.append(Section(file.stem, "", HEAD[1:], ordered, charts))
    summary = (
        f"{len(found)} measurements of real arrays, next to the sensor's model fitted to one half "
        "of each and compared with the other half."
    )
    return write_sections(path, "Real arrays and the model", summary, sections)


def _charts(path: Path, name: str) -> Iterator[Markup]:
    measurement = read_measurement(path)
    if isinstance(measurement, PairCrosstalk):
        yield captioned(pairs_chart(measurement, name), "A point per pair of the right half.")
    elif isinstance(measurement, Autocorrelation):
        text = "Mean of odd pixels; the models are fitted to even ones."
        yield captioned(afterpulses_chart(measurement.of(slice(None), UP_TO_S), name), text)
    else:
        text = "Pixels of the right half; the model is fitted to the left half."
        yield captioned(dark_counts_chart(measurement, name), text)
        if measurement.size >= FEWEST_PIXELS:
            shares = crosstalk_of_hot_pixels(measurement).mean(axis=1)
            for each, rows in zip(shares, ("even", "odd"), strict=True):
                with np.errstate(invalid="ignore", divide="ignore"):
                    light = np.log10(each)
                title = f"log₁₀ of the light from around, {rows} rows"
                yield map_chart(light, f"{name}-{rows}", title, (-4.0, -1.8))


@in_style
def pairs_chart(pairs: PairCrosstalk, name: str) -> Markup:
    """Draw crosstalk over distance, with the model."""
    fitted, tested = halves(pairs)
    distance = np.hypot(tested.down, tested.right)
    figure, axes = new_axes(*CHART_PT)
    axes.plot(distance, tested.probability, ".", color=BLACK, markersize=3, label="measured")
    model = modelled(fit_crosstalk(fitted), tested)
    axes.plot(distance[model > 0], model[model > 0], "_", color=VERMILION, markersize=14,
              markeredgewidth=2, label="model")  # fmt: skip
    axes.set(yscale="log", xlabel="distance (pixels)", ylabel="probability of crosstalk")
    return with_legend(figure, name, "Crosstalk of pairs of pixels over their distance")


@in_style
def dark_counts_chart(rates: Floats, name: str) -> Markup:
    """Draw the distribution of dark counts over the pixels, with the model."""
    middle = rates.shape[1] // 2
    model = fit_dark_counts(rates[:, :middle])
    tested = np.sort(rates[:, middle:][np.isfinite(rates[:, middle:])])
    share = (np.arange(tested.size) + 0.5) / tested.size
    chosen = np.unique(np.linspace(0, tested.size - 1, 500).astype(int))
    chosen = chosen[tested[chosen] > 0]
    grid = np.geomspace(tested[chosen[0]], tested[-1], 300)
    figure, axes = new_axes(*CHART_PT)
    axes.plot(tested[chosen], share[chosen], ".", color=BLACK, markersize=4, label="measured")
    axes.plot(grid, cumulative(model, grid), color=VERMILION, label="model")
    axes.set(xscale="log", xlabel="dark counts (unit of the file)", ylabel="share of pixels")
    return with_legend(figure, name, "Distribution of dark counts over the pixels")


@in_style
def afterpulses_chart(found: Autocorrelation, name: str) -> Markup:
    """Draw afterpulses over the lag, with an exponential and a tabulated delay."""
    fitted, tested = found.of(slice(0, None, 2)), found.of(slice(1, None, 2))
    widths = np.diff(found.edges_s)
    lag_ns = 1e9 * np.sqrt(found.edges_s[1:] * found.edges_s[:-1])
    figure, axes = new_axes(*CHART_PT)
    seen = tested.afterpulses.mean(axis=0)
    axes.plot(lag_ns[seen > 0], seen[seen > 0], "o", color=BLACK, markersize=4, label="measured")
    for model, color, dash in ((fit_exponential(fitted), VERMILION, "-"),
                               (fit_table(fitted), BLUE, "--")):  # fmt: skip
        kind = "table" if model.table_delays_s else "exponential"
        density = afterpulses_between(model, found.edges_s) / widths
        axes.plot(lag_ns, np.where(density > 0, density, np.nan), dash, color=color, label=kind)
    least = seen[seen > 0].min()
    axes.set(xscale="log", yscale="log", ylim=(least / 2, 2 * seen.max()))
    axes.set(xlabel="time since the event (ns)", ylabel="afterpulses (1/s)")
    return with_legend(figure, name, "Rate of afterpulses over the time since an event")
