"""Page of `megalopta check captures`: each measurement with its misfits and a picture."""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np
from markupsafe import Markup

from megalopta.core.arrays import Floats
from megalopta.plotting.sections import Section, captioned, write_sections
from megalopta.plotting.style import BLACK, BLUE, VERMILION
from megalopta.plotting.svg import CHART_PT, in_style, map_chart, new_axes, with_legend
from megalopta.sensor.calibrate.autocorrelation import (
    Autocorrelation,
    afterpulses_between,
    fit_exponential,
    fit_table,
)
from megalopta.sensor.calibrate.dark_distribution import cumulative, fit_dark_counts
from megalopta.sensor.calibrate.hot_neighbors import FEWEST_PIXELS, crosstalk_of_hot_pixels
from megalopta.sensor.calibrate.pair_crosstalk import PairCrosstalk, fit_crosstalk, modelled
from megalopta.verification.capture_files import read_measurement
from megalopta.verification.captures import HEAD, UP_TO_S, Row, halves, sorted_rows

_TEXT = (
    "Quantities of the half that was not fitted; differences in standard errors, the largest first."
)
_MISFITS = 12


def write_captures_page(path: Path, found: Mapping[Path, Sequence[Row]]) -> None:
    """Write the page of compared measurements."""
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
    write_sections(path, "Real arrays and the model", summary, sections)


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
