"""Figures 2.9 to 2.12: dark counts and efficiency of a row of SPADCAM over the bias.

The dissertation prints its curves without numbers; numbers of its text are in a table under each
figure, with ours. The row is a simulated device, measured like the real one: 500 frames at each
bias, in the dark and under 396 photons/µm²/s of 450 nm, with a counter that saturates. Over many
devices the preset has the printed statistics of Figure 2.9 (mean 1.77, median 0.93, σ 1.77 Hz/µm²)
and 11 quiet pixels of mean 0.76, median 0.73, σ 0.29; a single row differs.
"""

from collections.abc import Mapping
from functools import cache, partial
from typing import NamedTuple

import numpy as np
from matplotlib.figure import Figure as Canvas
from numpy.typing import NDArray

from megalopta.core.arrays import Floats
from megalopta.plotting.picture import Figure
from megalopta.plotting.style import BLUE, GRAY, line_style, write_at
from megalopta.reproduction.drawing import FigureRecipe, Run
from megalopta.sensor import changed, expose_rate, preset
from megalopta.sensor.effects.bias import best_excess_bias, breakdown_offset
from megalopta.sensor.spad.device import draw_fixed_pattern

SPADCAM = preset("spadcam")
ANODE_AT_BREAKDOWN_V = 12.40
"""13.40 V at the anode is an excess bias of about 1 V (§2.4.4)."""
ANODE_V = np.arange(13.40, 13.801, 0.02)
SHEET_V = 13.58
"""Anode voltage of the dark counts printed as numbers (§2.4.7)."""
FRAMES = 500
PIXELS = 16
PHOTONS_HZ_UM2 = 396.0
ACTIVE_UM2 = 360.0
WAVELENGTH_NM = 450.0
SNR_PHOTONS_HZ = 1e6
_DARK = "Dark count rate (Hz/µm²)"
FULL_HZ_UM2 = SPADCAM.counter_capacity / (SPADCAM.exposure_s * ACTIVE_UM2)


class RowMeasurement(NamedTuple):
    """Mean counts of a row at each bias, (biases, pixels), and mask of saturated counters."""

    dark: Floats
    bright: Floats
    is_saturated: NDArray[np.bool_]


@cache
def measure_row() -> RowMeasurement:
    """Measure a row of SPADCAM in the dark and in light."""
    dark, bright, full = zip(*(_measure_at(float(volts)) for volts in ANODE_V), strict=True)
    return RowMeasurement(np.array(dark), np.array(bright), np.array(full))


def _measure_at(anode_v: float) -> tuple[Floats, Floats, NDArray[np.bool_]]:
    sensor = changed(SPADCAM, bias={"excess_v": anode_v - ANODE_AT_BREAKDOWN_V})
    peak = float(sensor.efficiency(np.array(WAVELENGTH_NM)))
    factor = draw_fixed_pattern(sensor, (1, PIXELS)).efficiency_factor
    light_hz = np.broadcast_to(PHOTONS_HZ_UM2 * ACTIVE_UM2 * peak * factor, (FRAMES, 1, PIXELS))
    name = f"row at {anode_v:.2f} V"
    dark = expose_rate(0 * light_hz, sensor, seed=0, stream=f"{name}, dark")
    bright = expose_rate(light_hz, sensor, seed=0, stream=f"{name}, light")
    full = np.asarray((dark.saturated | bright.saturated).any((0, 1)))
    return dark.counts.mean((0, 1)), bright.counts.mean((0, 1)), full


def dark_density(row: RowMeasurement) -> Floats:
    """Measured dark count rate, Hz/µm², (biases, pixels); NaN without counts."""
    rate = row.dark / (SPADCAM.exposure_s * ACTIVE_UM2)
    return np.where(rate > 0, rate, np.nan)


def measured_efficiency(row: RowMeasurement) -> Floats:
    """Measured detection efficiency, (biases, pixels); NaN where a counter saturated."""
    photons = PHOTONS_HZ_UM2 * ACTIVE_UM2 * SPADCAM.exposure_s
    return np.where(row.is_saturated, np.nan, (row.bright - row.dark) / photons)


def _figure_2_9(_: Run) -> Figure:
    density = dark_density(measure_row())
    row = density[_index_of(SHEET_V)]
    quiet = row[row < 1.5]

    return Figure(
        title="Figure 2.9: dark count rate over bias, 16 pixels of one row",
        caption=(
            f"One row of the SPADCAM preset is simulated with {FRAMES} frames of 0.1 s at each "
            f"bias; the rate levels off at {FULL_HZ_UM2:.1f} Hz/µm², where the counter saturates. "
            "The table is for 13.58 V; other simulated rows differ, since the preset has the "
            "printed statistics over many devices."
        ),
        printed={
            "All pixels: mean, median, σ": (_statistics(row), "1.77, 0.93, 1.77 Hz/µm²"),
            "Pixels below 1.5 Hz/µm²": (f"{quiet.size} of {PIXELS}", "11 of 16"),
            "These: mean, median, σ": (_statistics(quiet), "0.71, 0.63, 0.32 Hz/µm²"),
        },
        draw=partial(_draw_row, values=density, label=_DARK, full=FULL_HZ_UM2),
        numbers=_over_bias(density, "hz_um2"),
    )


def _draw_row(canvas: Canvas, values: Floats, label: str, full: float | None = None) -> None:
    """Draw curves over the bias; on a logarithmic axis if counters can saturate."""
    axes = canvas.subplots()
    if full:
        axes.set_yscale("log")
    axes.plot(ANODE_V, values, "o-", color=BLUE, alpha=0.55, ms=3, lw=1.2)
    axes.set(xlabel="Anode voltage (V)", ylabel=label)
    if full:
        axes.axhline(full, color=GRAY, linestyle="--")
        write_at(axes, "counter full", (13.405, full), (0, 4), color=GRAY)
    else:
        axes.set_ylim(0, None)


def _figure_2_10(_: Run) -> Figure:
    density = np.nan_to_num(dark_density(measure_row()))
    ranked = {v: np.sort(density[_index_of(v)]) for v in (13.48, 13.54, 13.58, 13.64, 13.68)}
    share = np.arange(1, PIXELS + 1) / PIXELS
    full = int((ranked[13.68] > 0.99 * FULL_HZ_UM2).sum())

    def draw(canvas: Canvas) -> None:
        axes = canvas.subplots()
        for place, (v, rates) in enumerate(ranked.items()):
            from_left = [0.0, *rates, 2 * FULL_HZ_UM2], [0.0, *share, 1.0]
            axes.step(*from_left, where="post", label=f"{v:.2f} V", **line_style(place))
        axes.set(xlabel=_DARK, ylabel="Share of the pixels")
        axes.set(xlim=(0, 9.5), ylim=(0, 1.03))
        axes.legend(title="Anode voltage", loc="lower right")

    return Figure(
        title="Figure 2.10: cumulative distribution of the dark count rate over one row",
        caption=(
            "The row of Figure 2.9, exposed for 0.1 s at 10 mV per count. The dissertation does "
            "not state the step and exposure (above 50 ms) at which its counters saturated. In 200 "
            "simulated devices, 2.2 of 16 saturate on average (0 to 6), and 15.1 after 1 s."
        ),
        printed={"Counters full at 13.68 V": (f"{full} of {PIXELS}", "nearly all of 16")},
        draw=draw,
        numbers={"share": share, **{f"at_{v:.2f}_v_hz_um2": ranked[v] for v in ranked}},
    )


def _figure_2_11(_: Run) -> Figure:
    efficiency = measured_efficiency(measure_row())
    offsets = breakdown_offset(SPADCAM.bias, (1, PIXELS), SPADCAM.device_seed)[0]

    return Figure(
        title="Figure 2.11: photon detection efficiency over bias, 16 pixels of one row, 450 nm",
        caption=(
            "Efficiency is bright minus dark counts over the photons on the active area, at "
            f"{PHOTONS_HZ_UM2:g} photons/µm²/s in {FRAMES} frames; a curve ends where a counter "
            "saturated. Its height is the preset's, an upper limit."
        ),
        printed={
            "Bias for equal efficiency, peak to peak": (
                f"{1e3 * np.ptp(offsets):.0f} mV",
                "nearly 150 mV",
            ),
            "Bias for equal efficiency, σ": (f"{1e3 * offsets.std():.0f} mV", "42 mV"),
            "Largest efficiency": (
                f"{100 * np.nanmax(efficiency):.2f} %",
                "below 1 % at about 1 V",
            ),
        },
        draw=partial(_draw_row, values=100 * efficiency, label="Detection efficiency (%)"),
        numbers=_over_bias(efficiency),
    )


def _figure_2_12(_: Run) -> Figure:
    row = measure_row()
    efficiency, dark_hz = measured_efficiency(row), dark_density(row) * ACTIVE_UM2
    # no logarithm without detections
    ratio = 10 * np.log10(np.where(efficiency > 0, efficiency, np.nan) * SNR_PHOTONS_HZ / dark_hz)
    order = np.argsort(row.dark[_index_of(SHEET_V)])
    chosen = order[[0, 5, 10, 13]]
    best, most = (_biases_of_largest(each[:, chosen]) for each in (ratio, efficiency))
    curves = {pixel: ratio[:, pixel] for pixel in chosen}
    model = best_excess_bias(SPADCAM.bias) + ANODE_AT_BREAKDOWN_V

    return Figure(
        title="Figure 2.12: detections over dark counts, 10⁶ photons per pixel and second",
        caption=(
            "The curves are efficiency times photon rate over dark count rate, in power decibels, "
            "of four pixels of Figures 2.9 and 2.11. Without mismatch the ratio is best at "
            f"{model:.2f} V (dashed); a higher breakdown voltage of a pixel shifts its optimum by "
            "as much, at any photon rate."
        ),
        printed={
            "Bias of the best ratio": (best, "lower than for efficiency"),
            "Bias of the best efficiency": (most, "—"),
        },
        draw=partial(_draw_2_12, curves=curves, model=model),
        numbers={"anode_v": ANODE_V, **{f"pixel_{each}_db": curves[each] for each in curves}},
    )


def _draw_2_12(canvas: Canvas, curves: Mapping[int, Floats], model: float) -> None:
    axes = canvas.subplots()
    for pixel, ratio in curves.items():
        axes.plot(ANODE_V, ratio, "o-", ms=4, label=f"pixel {pixel}")
    axes.axvline(model, color=GRAY, linestyle="--")
    bottom = model, axes.get_ylim()[0]
    write_at(axes, "best bias without mismatch", bottom, (6, 6), color=GRAY)
    axes.set(xlabel="Anode voltage (V)", ylabel="SNR (dB)")
    axes.legend(loc="upper right")


def _over_bias(values: Floats, unit: str = "") -> dict[str, Floats]:
    ending = f"_{unit}" if unit else ""
    pixels = {f"pixel_{pixel}{ending}": column for pixel, column in enumerate(values.T)}
    return {"anode_v": ANODE_V, **pixels}


def _statistics(rates: Floats) -> str:
    return f"{rates.mean():.2f}, {np.median(rates):.2f}, {rates.std():.2f} Hz/µm²"


def _index_of(anode_v: float) -> int:
    return int(np.argmin(np.abs(ANODE_V - anode_v)))


def _biases_of_largest(values: Floats) -> str:
    biases = ANODE_V[np.nanargmax(values, axis=0)]
    ends = dict.fromkeys(f"{each:.2f}" for each in (biases.min(), biases.max()))
    return f"{' to '.join(ends)} V"


RECIPES = (
    FigureRecipe("fig-2.9", _figure_2_9),
    FigureRecipe("fig-2.10", _figure_2_10),
    FigureRecipe("fig-2.11", _figure_2_11),
    FigureRecipe("fig-2.12", _figure_2_12),
)
