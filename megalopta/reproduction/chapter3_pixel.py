"""Figures of Chapter 3 on the CTIA pixel: how it discharges and what dark current it shows.

The dissertation's measured points are not printed, only some numbers in the text; a table under
each figure sets ours beside these. No constant here was chosen to meet them, but for the three
currents that the presets of the photodiodes were made from.
"""

from collections.abc import Mapping
from functools import partial

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Canvas
from matplotlib.ticker import EngFormatter

from megalopta.core.arrays import Floats
from megalopta.plotting.picture import Figure
from megalopta.plotting.style import (
    MARKERS,
    PALETTE,
    line_style,
    write_at,
)
from megalopta.reproduction.figure_recipe import FigureRecipe, Run
from megalopta.sensor.ctia.bias import DacBias
from megalopta.sensor.ctia.integration import (
    Pixel,
    discharge,
    discharge_time,
    estimate_current,
    gain_from_db,
)
from megalopta.sensor.ctia.model import PHOTODIODES
from megalopta.sensor.ctia.photodiode import Photodiode, reverse_current

SWING_V = 3.3
BUILT_FARAD, BUILT_GAIN_DB = 10e-12, 130.0
STEP_V = DacBias().step_v
BUILT = ("si", "ingaas")
_LOWEST_A = {"ingaas": 700e-12, "si": 10.4e-15}
"""As measured"""
_CAPTIONS = {
    "3.2": "As in the dissertation, the saturation current is 100 pA, the capacitance 100 fF, and "
    "there is no light. The less gain, the more the input moves over the swing, and the more the "
    "dark current grows with it.",
    "3.6": "Points are 10–90 % estimates at DAC codes with the presets of the diodes, which have "
    "neither generation nor tunneling, by which real ones rise faster. The lowest current measured "
    "with Si needs a bias within 0.08 mV of zero, which one offset in ten leaves; ours is that at "
    "half a code. At 100 mV InGaAs discharges in {:.2f} ms, which the bench could not sample.",
}
NAMES = {"si": "Si", "ingaas": "InGaAs", "ingaas_quiet": "InGaAs"}


def built_pixel(diode: str, bias_v: float | Floats, drift_v_s: float = 0.0) -> Pixel:
    """The fabricated pixel of §3.2.4 with a photodiode of the presets."""
    gain = gain_from_db(BUILT_GAIN_DB)
    return Pixel(PHOTODIODES[diode], BUILT_FARAD, SWING_V, gain, bias_v, drift_v_s)


def ampere(value: float) -> str:
    """Three digits with a prefix of the unit, on one line: "10.4 fA"."""
    return str(EngFormatter(unit="A", sep="\u00a0")(float(f"{value:.3g}")))


def dac_sweep(largest_v: float) -> Floats:
    """Reverse biases at DAC codes, about evenly spaced in their logarithm, V.

    The bias closest to zero is half a code, the mean of what an unknown offset leaves.
    """
    codes = np.unique(np.rint(np.geomspace(1, largest_v / STEP_V, 40) - 0.5))
    return np.asarray((codes + 0.5) * STEP_V)


def decades(diode: str, from_v: float, to_v: float) -> float:
    """Decades by which the dark current of the built pixel falls between two reverse biases."""
    far, near = (float(estimate_current(built_pixel(diode, bias))) for bias in (from_v, to_v))
    return float(np.log10(far / near))


def over_bias(axes: Axes, label: str, is_current: bool) -> None:
    """Make the axes those of a quantity, in decades if it is a current, over the reverse bias."""
    axes.set(xscale="log", xlabel="Reverse bias (mV)", ylabel=label)
    axes.xaxis.set_major_formatter("{x:g}")
    if is_current:
        axes.set_yscale("log")
        axes.yaxis.set_major_formatter(EngFormatter(unit="A"))


def _figure_3_2(_: Run) -> Figure:
    diode = Photodiode(saturation_current_a=100e-12)
    pixels = {
        gain_db: Pixel(diode, 100e-15, SWING_V, gain_from_db(float(gain_db)), 1e-3)
        for gain_db in range(40, 91, 10)
    }
    times = np.linspace(0, 0.09, 181)
    moved = [SWING_V / float(gain_from_db(gain_db)) for gain_db in (40.0, 100.0)]
    growth = float(reverse_current(diode, 1e-3 + SWING_V / 100) / reverse_current(diode, 1e-3))
    first, last = (1e3 * _swing_time(pixels[gain_db]) for gain_db in (40, 90))
    return Figure(
        title="Figure 3.2: CTIA pixel discharging from an input offset of 1 mV",
        caption=_CAPTIONS["3.2"],
        printed={
            "Motion of the input at 40 dB": (f"{1e3 * moved[0]:.0f} mV", "33 mV"),
            "Motion of the input at 100 dB": (f"{1e6 * moved[1]:.0f} µV", "33 µV"),
            "Growth of the dark current at 40 dB": (f"{growth:.0f} times", "—"),
            "Time of the swing at 40 and 90 dB": (f"{first:.1f} and {last:.1f} ms", "—"),
        },
        draw=partial(_draw_3_2, pixels=pixels, times=times),
        numbers={"time_s": times}
        | {f"output_at_{each}_db_v": _output(pixels[each], times) for each in pixels},
    )


def _draw_3_2(canvas: Canvas, pixels: Mapping[int, Pixel], times: Floats) -> None:
    axes = canvas.subplots()
    _draw_discharges(axes, {f"{each} dB": pixels[each] for each in pixels}, times, 1e3)
    axes.set(xlabel="Time (ms)", ylabel="Output (V)", xlim=(0, 90), ylim=(0, 3.4))
    axes.legend(title="Open-loop gain")


def _figure_3_5(_: Run) -> Figure:
    biases = [code * STEP_V for code in (24.5, 12.5, 6.5, 3.5, 1.5, 0.5, -0.5)]
    pixels = {bias: built_pixel("si", bias) for bias in biases}
    times = np.linspace(0, 300, 301)

    def draw(canvas: Canvas) -> None:
        axes = canvas.subplots()
        _draw_discharges(axes, {_millivolt(bias): pixels[bias] for bias in biases}, times, 1)
        axes.set(xlabel="Time (s)", ylabel="Output (V)", xlim=(0, 300), ylim=(0, 3.45))
        axes.legend(title="Reverse bias", loc="upper left", bbox_to_anchor=(1.0, 1.0))

    return Figure(
        title="Figure 3.5: CTIA pixel discharging in the dark, Si photodiode",
        caption=(
            "The fabricated pixel (10 pF, 130 dB) has the preset of the SFH229FA and DAC codes "
            "half a code off zero. Past zero the diode is in forward bias and the pixel does not "
            "discharge. The dissertation prints no number for this figure."
        ),
        draw=draw,
        numbers={
            "time_s": times,
            **{f"output_at_{1e3 * each:.2f}_mv_v": _output(pixels[each], times) for each in biases},
        },
    )


def _figure_3_6(_: Run) -> Figure:
    biases = dac_sweep(1.0)
    currents = {name: estimate_current(built_pixel(name, biases)) for name in _LOWEST_A}
    falls = {name: f"{decades(name, 20e-3, STEP_V / 2):.1f} decades" for name in BUILT}
    instantaneous_ms = 1e3 * _swing_time(built_pixel("ingaas", 0.1))
    lowest = {each: (ampere(currents[each][0]), ampere(_LOWEST_A[each])) for each in BUILT}
    return Figure(
        title="Figure 3.6: dark current against reverse bias, non-adaptive pixel",
        caption=_CAPTIONS["3.6"].format(instantaneous_ms),
        printed={
            **{f"Fall from 20 to 0.40 mV, {NAMES[each]}": (falls[each], "1–2") for each in BUILT},
            **{f"Lowest current, {NAMES[each]}": lowest[each] for each in BUILT},
        },
        draw=partial(_draw_3_6, biases=biases, currents=currents),
        numbers={
            "reverse_bias_v": biases,
            **{f"dark_current_{name}_a": values for name, values in currents.items()},
        },
    )


def _draw_3_6(canvas: Canvas, biases: Floats, currents: Mapping[str, Floats]) -> None:
    axes = canvas.subplots()
    for color, marker, name in zip(PALETTE, MARKERS, currents, strict=False):
        axes.plot(1e3 * biases, currents[name], marker + "-", color=color, label=NAMES[name])
        lowest = _LOWEST_A[name]
        axes.axhline(lowest, color=color, linestyle=":", linewidth=1.5)
        text = f"lowest measured, {NAMES[name]}: {ampere(lowest)}"
        write_at(axes, text, (900, lowest), (0, 5), ha="right", color=color, fontsize=10)
    over_bias(axes, "Dark current", is_current=True)
    axes.legend()


def _millivolt(volts: float) -> str:
    return f"{1e3 * volts:.1f} mV".replace("-", "−")


def _swing_time(pixel: Pixel) -> float:
    """Seconds in the dark from reset to the lower rail."""
    return float(discharge_time(pixel, 0.0, SWING_V))


def _output(pixel: Pixel, times: Floats) -> Floats:
    return np.asarray(SWING_V - discharge(pixel, 0.0, times))


def _draw_discharges(
    axes: Axes, pixels: Mapping[str, Pixel], times: Floats, per_second: float
) -> None:
    """Draw outputs over time, each up to the moment at which the lower rail is reached."""
    for place, (label, pixel) in enumerate(pixels.items()):
        shown, output, end = times, _output(pixel, times), _swing_time(pixel)
        if end <= times[-1]:
            shown, output = np.append(times[times < end], end), np.append(output[times < end], 0)
        axes.plot(per_second * shown, output, label=label, **line_style(place))


RECIPES = (
    FigureRecipe("fig-3.2", _figure_3_2),
    FigureRecipe("fig-3.5", _figure_3_5),
    FigureRecipe("fig-3.6", _figure_3_6),
)
