"""Figures 2.2, 2.7 and 2.8 on dead time and the analog counter, and Table 2.1 of the literature.

The model of the counter is linear except for its leakage. The bend of a real one toward the bottom
of its swing is not printed and not modeled. Table 2.1 lists printed values of devices, and
measurements of their presets.
"""

from collections.abc import Mapping
from functools import partial
from typing import NamedTuple

import numpy as np
from matplotlib.figure import Figure as Canvas
from matplotlib.ticker import EngFormatter
from numpy.typing import NDArray
from scipy.stats import linregress

from megalopta.core.arrays import Floats
from megalopta.plotting.picture import Cell, Figure, columns_of
from megalopta.plotting.style import BLACK, GRAY, PALETTE, draw_table
from megalopta.reproduction.drawing import FigureRecipe, Run
from megalopta.sensor import DeadTime, Sensor, changed, expose_events, expose_rate, preset
from megalopta.sensor.effects.dead_time import expected_counts
from megalopta.sensor.spad.counters import AnalogCounter, analog_pixels
from megalopta.sensor.spad.presets import TABLE_2_1

ROW = (1, 16)
LIGHT_HZ = 300.0
_SHOWN = 4
_SAMPLES = 4001
_ZOOM = 0.06
"""Share of the exposure in the right panel, which shows single steps."""
_CAPTION = (
    f"{_SHOWN} of {ROW[1]} pixels of a simulated row detect {LIGHT_HZ:g} photons per second "
    "plus dark counts; the first 20 steps are on the right. The straight line of R² ends at the "
    "bottom of the swing. Over events the model bends by leakage alone, over time also by random "
    "arrivals."
)


class Transient(NamedTuple):
    """Output of a row after its reset: times, s, and events and volts, (pixels, times)."""

    time_s: Floats
    events: NDArray[np.int64]
    output_v: Floats


def spadcam_with_step(step_v: float) -> Sensor:
    """SPADCAM with another step, exposed until all counters of a row are saturated."""
    return changed(preset("spadcam"), counter={"step_v": step_v}, exposure_s=10e-3 / step_v)


def transient(sensor: Sensor) -> Transient:
    """Output of a row of pixels in low light, without readout noise."""
    counter = _counter(sensor)
    stream = expose_events(np.full((1, *ROW), LIGHT_HZ), sensor, seed=0, stream="transient")
    time_s = np.linspace(0, sensor.exposure_s, _SAMPLES)
    events = np.array(
        [
            np.searchsorted(stream.time_s[stream.column == pixel], time_s, side="right")
            for pixel in range(ROW[1])
        ]
    )
    pixels = analog_pixels(counter, ROW, sensor.exposure_s, sensor.device_seed)
    leaked = pixels.leaked_v[0, :, None] * (time_s / sensor.exposure_s)
    fallen = np.minimum(events * pixels.step_v[0, :, None] + leaked, counter.swing_v)
    return Transient(time_s, events, counter.supply_v - fallen)


def straightness(row: Transient, bottom_v: float) -> tuple[Floats, Floats]:
    """R² of the output of each pixel above the bottom, over its events and over time."""
    over_events, over_time = [], []
    for events, output in zip(row.events, row.output_v, strict=True):
        is_up = output > bottom_v
        over_events.append(linregress(events[is_up], output[is_up]).rvalue ** 2)
        over_time.append(linregress(row.time_s[is_up], output[is_up]).rvalue ** 2)
    return np.array(over_events), np.array(over_time)


def volts_per_event(row: Transient, bottom_v: float) -> float:
    """Mean voltage drop per event, over the row and the swing, V."""
    is_up = row.output_v > bottom_v
    last = is_up.sum(1) - 1
    pixels = np.arange(len(last))
    fallen = row.output_v[:, 0] - row.output_v[pixels, last]
    return float(fallen.sum() / row.events[pixels, last].sum())


def _figure(number: str, step_v: float) -> Figure:
    sensor = spadcam_with_step(step_v)
    counter, row = _counter(sensor), transient(sensor)
    bottom = counter.supply_v - counter.swing_v
    over_events, over_time = straightness(row, bottom)
    least = np.floor(1e5 * over_events.min()) / 1e5  # never rounded up to 1
    step, fall = f"{1e3 * step_v:g} mV", 1e3 * volts_per_event(row, bottom)
    return Figure(
        title=f"Figure {number}: analog counter in low light, steps of {step}",
        caption=_CAPTION,
        printed={
            "Fall per event over the swing": (f"{fall:.2f} mV", f"about {step}"),
            "Least R² over events": (f"{least:.5f}", "above 0.99"),
            "R² over time": (f"{over_time.min():.3f} to {over_time.max():.3f}", "above 0.99"),
        },
        draw=partial(_draw, row=row, counter=counter, step_v=step_v),
        numbers={
            "time_s": row.time_s,
            **{f"pixel_{pixel}_v": output for pixel, output in enumerate(row.output_v)},
        },
        height_in=3.4,
    )


def _draw(canvas: Canvas, row: Transient, counter: AnalogCounter, step_v: float) -> None:
    whole, start = canvas.subplots(1, 2, width_ratios=(3, 2))
    for axes in (whole, start):
        for pixel, output in enumerate(row.output_v[:_SHOWN]):
            axes.step(1e3 * row.time_s, output, where="post", lw=1.4, label=f"pixel {pixel}")
        axes.set_xlabel("Time since reset (ms)")
    whole.set(ylabel="Output (V)", xlim=(0, 1e3 * row.time_s[-1]), ylim=(0, 3.4))
    whole.legend(loc="upper right")
    start.set_xlim(0, _ZOOM * whole.get_xlim()[1])
    start.set_ylim(counter.supply_v - 20.5 * step_v, counter.supply_v + step_v)


def _counter(sensor: Sensor) -> AnalogCounter:
    assert isinstance(sensor.counter, AnalogCounter)
    return sensor.counter


_DEAD_TIMES_S = (1e-9, 1e-8, 1e-7, 1e-6)
_DASHES = {"nonparalyzable": "-", "paralyzable": "--"}
_CAPTION_2_2 = (
    "Curves are stationary means (Eq. 2.5 and 2.6) for four dead times τ. The count rate saturates "
    "at 1/τ if non-paralyzable; if paralyzable it peaks at 1/(e·τ), at one photon per dead time. "
    "The dynamic range is from 100 Hz of dark counts to that limit, for τ = 100 ns."
)


def _figure_2_2(_: Run) -> Figure:
    photons = np.geomspace(1e3, 1e10, 281)
    laws = {
        (kind, tau): DeadTime(kind=kind, dead_time_s=tau, start="stationary")
        for kind in _DASHES
        for tau in _DEAD_TIMES_S
    }
    curves = {key: expected_counts(photons, 1.0, law) for key, law in laws.items()}
    highest = curves["paralyzable", 1e-7].max()
    lasting, brief = (f"{20 * np.log10(rate / 100):.0f} dB" for rate in (highest, 1e7))
    return Figure(
        title="Figure 2.2: count rate over photon rate with dead time",
        caption=_CAPTION_2_2,
        printed={
            "Dynamic range, paralyzable": (lasting, "below 100 dB"),
            "Dynamic range, non-paralyzable": (brief, "below 100 dB"),
        },
        draw=partial(_draw_2_2, photons=photons, curves=curves),
        numbers={
            "photon_rate_hz": photons,
            **{f"{kind}_{1e9 * tau:g}_ns_hz": counts for (kind, tau), counts in curves.items()},
        },
    )


def _draw_2_2(canvas: Canvas, photons: Floats, curves: Mapping[tuple[str, float], Floats]) -> None:
    axes = canvas.subplots()
    axes.loglog(photons, photons, color=BLACK, label="ideal")
    for (kind, tau), counts in curves.items():
        color = PALETTE[_DEAD_TIMES_S.index(tau)]
        label = None if kind == "paralyzable" else f"τ = {EngFormatter(unit='s')(tau)}"
        axes.loglog(photons, counts, _DASHES[kind], color=color, label=label)
    for kind, label in (("nonparalyzable", "non-paralyzable"), ("paralyzable", "paralyzable")):
        axes.plot([], [], _DASHES[kind], color=GRAY, label=label)
    axes.set(xlabel="Photon rate (1/s)", ylabel="Count rate (1/s)")
    axes.set(xlim=(1e3, 1e10), ylim=(1e3, 3e9))
    axes.legend(loc="upper left", ncols=2)


_PHOTONS_HZ, _EXPOSURE_S = 1e5, 4.0
_HEAD = ("Device", "V_ex, V", "Hz", "µm²", "Hz/µm²", "ours", "peak, %", "ours", "at, nm")
_WIDTHS = (2.4, 1.1, 1.2, 1.3, 1, 1, 1.1, 0.9, 1)


def _table(_: Run) -> Figure:
    rows = [_row(name) for name in TABLE_2_1]
    return Figure(
        title="Table 2.1: SPADs of the literature, as presets",
        caption=(
            'Columns named "ours" are measurements of each device\'s preset in 4 s in the dark '
            "and under 10⁵ photons per second on the active area; the others are printed. Limits "
            "(<, >) are used as values, and efficiency is the peak value at every wavelength. "
            "Fill factor and dead time are not in the table and remain those of the user."
        ),
        draw=partial(draw_table, head=_HEAD, rows=[_texts(row) for row in rows], widths=_WIDTHS),
        numbers=columns_of(rows),
        height_in=3.0,
    )


def _row(name: str) -> dict[str, Cell]:
    device, sensor = TABLE_2_1[name], changed(preset(name), exposure_s=_EXPOSURE_S)
    rates = np.zeros((2, 40, 40))
    rates[1] = _PHOTONS_HZ * sensor.efficiency.values[0]
    counts = expose_rate(rates, sensor, seed=0, stream=f"table {name}").counts
    dark_hz, bright_hz = (counts.mean((1, 2), dtype=np.float64) / _EXPOSURE_S).tolist()
    return {
        "preset": name,
        "reference": device.reference,
        "excess_v": device.excess_bias_v,
        "area_um2": device.active_area_um2,
        "dcr_hz": device.dark_counts_hz,
        "printed_hz_um2": device.density_hz_um2,
        "simulated_hz_um2": dark_hz / device.active_area_um2,
        "printed_peak_efficiency": device.peak_efficiency,
        "simulated_efficiency": (bright_hz - dark_hz) / _PHOTONS_HZ,
        "peak_nm": device.peak_nm,
    }


def _texts(row: Mapping[str, Cell]) -> list[str]:
    return [
        str(row["reference"]),
        f"{row['excess_v']:g}",
        f"{TABLE_2_1[str(row['preset'])].limit}{row['dcr_hz']:g}",
        f"{row['area_um2']:g}",
        f"{row['printed_hz_um2']:g}",
        f"{row['simulated_hz_um2']:.3g}",
        f"{100 * float(row['printed_peak_efficiency']):.0f}",
        f"{100 * float(row['simulated_efficiency']):.1f}",
        f"{row['peak_nm']:g}",
    ]


RECIPES = (
    FigureRecipe("fig-2.2", _figure_2_2),
    FigureRecipe("fig-2.7", lambda _: _figure("2.7", 10e-3)),
    FigureRecipe("fig-2.8", lambda _: _figure("2.8", 30e-3)),
    FigureRecipe("table-2.1", _table),
)
