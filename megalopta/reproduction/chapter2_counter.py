"""Figures of Chapter 2 on the analog counter: its output as photons arrive, and how straight it is.

The model of the counter is linear but for its leak. How a real one bends toward the bottom of its
swing is not printed and not modeled.
"""

from functools import partial
from typing import NamedTuple

import numpy as np
from matplotlib.figure import Figure as Canvas
from numpy.typing import NDArray
from scipy.stats import linregress

from megalopta.core.arrays import Floats
from megalopta.plotting.picture import Figure
from megalopta.reproduction.recipe import FigureRecipe
from megalopta.sensor import Sensor, changed, expose_events, preset
from megalopta.sensor.counters import AnalogCounter, analog_pixels

ROW = (1, 16)
LIGHT_HZ = 300.0
_SHOWN = 4
_SAMPLES = 4001
_ZOOM = 0.06
"""Part of the exposure in the panel on the right, where single steps can be seen."""
_CAPTION = (
    f"{_SHOWN} of {ROW[1]} pixels of a simulated row detect {LIGHT_HZ:g} photons per second "
    "besides dark counts; the first 20 steps are shown on the right. The straight line of R² ends "
    "at the bottom of the swing; over events the model bends by its leak alone, over time also by "
    "the chance of arrivals."
)


class Transient(NamedTuple):
    """Output of a row from its reset on: times, s, and events and volts, (pixels, times)."""

    time_s: Floats
    events: NDArray[np.int64]
    output_v: Floats


def spadcam_with_step(step_v: float) -> Sensor:
    """SPADCAM with another step, exposed until the counters of all pixels of a row are full."""
    return changed(preset("spadcam"), counter={"step_v": step_v}, exposure_s=10e-3 / step_v)


def transient(sensor: Sensor) -> Transient:
    """Output of a row of pixels in low light, without the noise of readout."""
    counter = _counter(sensor)
    stream = expose_events(np.full((1, *ROW), LIGHT_HZ), sensor, seed=0, sequence="transient")
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
    """Mean fall of the output per event, over the row and the swing, V."""
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
    step, fall = f"{1e3 * step_v:g} mV", 1e3 * volts_per_event(row, bottom)
    return Figure(
        title=f"Figure {number}: analog counter in low light, steps of {step}",
        caption=_CAPTION,
        printed={
            "Fall per event over the swing": (f"{fall:.2f} mV", f"about {step}"),
            "Least R² over events": (_floor(over_events.min()), "above 0.99"),
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


def _floor(share: float) -> str:
    """Five digits, never rounded up to 1."""
    return f"{np.floor(1e5 * share) / 1e5:.5f}"


RECIPES = (
    FigureRecipe("fig-2.7", lambda _: _figure("2.7", 10e-3)),
    FigureRecipe("fig-2.8", lambda _: _figure("2.8", 30e-3)),
)
