"""Figures and the table of Chapter 3 on the CTIA pixel: its discharge and its dark current.

The dissertation prints no measured points, only some numbers in the text; a table under each figure
compares them with ours. No constant here is fitted to them, except the three currents that define
the presets of the photodiodes.

The model allows a rise of the SNR from 20 mV to 1 mV of 23.0 dB for an n = 1 diode and of 26.0 dB
for a shunt, whatever their size, and for both together something between. An error of the bias
would explain the rest: one DAC code is 0.81 mV, and the offset could not be measured.

On Table 3.1: a non-adaptive pixel has anything from 0 to twice the mean over its offset, so 10.4 fA
is a lucky code. The saturation current of the silicon preset comes from the poor state at 15 mV,
which is no test of it. Given 170 nA at 100 mV, no InGaAs diode with a shunt falls to 5.8 nA at 17.5
mV: its current must rise faster than linearly, by tunneling for instance. The leakage of the gate
sets both fine values, as the dissertation states for Si. The least current with a leaking gate is
proportional to the root of the conductance at zero bias.
"""

from collections.abc import Mapping, Sequence
from functools import cache, partial

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Canvas
from matplotlib.ticker import EngFormatter
from numpy.typing import NDArray
from scipy.optimize import brentq

from megalopta.core.arrays import Floats
from megalopta.plotting.picture import Cell, Figure
from megalopta.plotting.style import (
    BLACK,
    BLUE,
    GRAY,
    MARKERS,
    ORANGE,
    PALETTE,
    draw_table,
    line_style,
    write_at,
)
from megalopta.reproduction.drawing import FigureRecipe, Run
from megalopta.sensor.ctia.bias import (
    DacBias,
    FloatingGateBias,
    Measurement,
    calibrate_gate,
    leak_floor,
)
from megalopta.sensor.ctia.integration import (
    Pixel,
    discharge,
    discharge_time,
    estimate_current,
    gain_from_db,
)
from megalopta.sensor.ctia.model import PHOTODIODES, TYPICAL_OFFSET_V
from megalopta.sensor.ctia.photodiode import Photodiode, reverse_current

SWING_V = 3.3
BUILT_FARAD, BUILT_GAIN_DB = 10e-12, 130.0
STEP_V = DacBias().step_v
BUILT = ("si", "ingaas")
_LOWEST_A = {"ingaas": 700e-12, "si": 10.4e-15}
"""Measured values"""
_CAPTIONS = {
    "3.2": "As in the dissertation, the saturation current is 100 pA, the capacitance 100 fF, and "
    "there is no light. With less gain the input moves more over the swing, and the dark current "
    "grows more.",
    "3.6": "Points are 10–90 % estimates at DAC codes with the presets of the diodes, which lack "
    "the generation and tunneling that make real currents rise faster. The lowest measured current "
    "with Si needs a bias within 0.08 mV of zero, as one offset in ten gives; ours is that at "
    "half a code. At 100 mV InGaAs discharges in {:.2f} ms, which the bench could not sample.",
}
NAMES = {"si": "Si", "ingaas": "InGaAs", "ingaas_quiet": "InGaAs"}


def built_pixel(diode: str, bias_v: float | Floats, drift_v_s: float = 0.0) -> Pixel:
    """The fabricated pixel of §3.2.4 with a photodiode of the presets."""
    gain = gain_from_db(BUILT_GAIN_DB)
    return Pixel(PHOTODIODES[diode], BUILT_FARAD, SWING_V, gain, bias_v, drift_v_s)


def ampere(value: float) -> str:
    """Format three digits with a unit prefix, on one line: "10.4 fA"."""
    return str(EngFormatter(unit="A", sep="\u00a0")(float(f"{value:.3g}")))


def dac_sweep(largest_v: float) -> Floats:
    """Reverse biases at DAC codes, about evenly spaced in their logarithm, V.

    The bias closest to zero is half a code, the mean for an unknown offset.
    """
    codes = np.unique(np.rint(np.geomspace(1, largest_v / STEP_V, 40) - 0.5))
    return np.asarray((codes + 0.5) * STEP_V)


def decades(diode: str, from_v: float, to_v: float) -> float:
    """Decades by which the dark current of the built pixel falls between two reverse biases."""
    far, near = (float(estimate_current(built_pixel(diode, bias))) for bias in (from_v, to_v))
    return float(np.log10(far / near))


def over_bias(axes: Axes, label: str, is_current: bool) -> None:
    """Set up axes of a quantity over the reverse bias, logarithmic for a current."""
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

    labels = {f"{1e3 * bias:.1f} mV".replace("-", "−"): pixels[bias] for bias in biases}

    def draw(canvas: Canvas) -> None:
        axes = canvas.subplots()
        _draw_discharges(axes, labels, times, 1)
        axes.set(xlabel="Time (s)", ylabel="Output (V)", xlim=(0, 300), ylim=(0, 3.45))
        axes.legend(title="Reverse bias", loc="upper left", bbox_to_anchor=(1.0, 1.0))

    return Figure(
        title="Figure 3.5: CTIA pixel discharging in the dark, Si photodiode",
        caption=(
            "The fabricated pixel (10 pF, 130 dB) has the preset of the SFH229FA and DAC codes "
            "half a code off zero. Beyond zero the diode is in forward bias and the pixel does not "
            "discharge. The dissertation prints no numbers for this figure."
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


def _swing_time(pixel: Pixel) -> float:
    """Seconds in the dark from reset to the lower rail."""
    return float(discharge_time(pixel, 0.0, SWING_V))


def _output(pixel: Pixel, times: Floats) -> Floats:
    return np.asarray(SWING_V - discharge(pixel, 0.0, times))


def _draw_discharges(
    axes: Axes, pixels: Mapping[str, Pixel], times: Floats, per_second: float
) -> None:
    """Draw outputs over time, each until it reaches the lower rail."""
    for place, (label, pixel) in enumerate(pixels.items()):
        shown, output, end = times, _output(pixel, times), _swing_time(pixel)
        if end <= times[-1]:
            shown, output = np.append(times[times < end], end), np.append(output[times < end], 0)
        axes.plot(per_second * shown, output, label=label, **line_style(place))


LED_A: Mapping[str, tuple[float, float]] = {
    "si": (5e-12, 20e-12),
    "ingaas_quiet": (150e-12, 600e-12),
}
_PHOTOCURRENTS = (
    "Each photocurrent is the difference of two 10–90 % estimates; the model's quantum efficiency "
    "does not depend on bias. LED1 and LED2 are our choice, {}, as none is printed; the InGaAs "
    "diode, described only as less noisy, has the 100 pA of Figure 3.2. The current of a diode "
    "with a shunt cannot fall by more than 1.30 decades; see Figure {}."
)
_SNR = (
    "The SNR is 20·log10(photocurrent / dark current). The model allows a rise of 23.0 to 26.0 dB "
    "between the dotted lines, for a diode of any size. With a true bias {:.2f} mV below the read "
    "one (one DAC code is 0.81 mV) the rise would be {:.0f} dB (dashed): our inference, without a "
    "fit."
)
_TABLE = (
    "Non-adaptive: mean over an offset anywhere between two DAC codes; poor: the state at 15 mV "
    "(Si, which defines the preset) and 17.5 mV (InGaAs, {:.1f} times the measured value: given "
    "170 nA at 100 mV, no diode with a shunt falls so far); fine: the end of the programming loop, "
    "from {:.1f} mV in pulses of 500 µV with leakage of 1.5 µV/s, which takes {:.1f} h for Si. "
    "Last line: the least current with leakage, {:.1f} and {:.1f} times the measured values: the "
    "conductance of the real diodes at zero bias must be {:.0f} and {:.0f} times smaller than "
    "that of the presets."
)
_HEAD = ("", "Si, printed", "Si, ours", "InGaAs, printed", "InGaAs, ours")
_STATES = ("Non-adaptive (best)", "Adaptive (poor)", "Adaptive (fine)", "Limit set by the leak")


def _photocurrents(number: str, diode: str, decades_printed: str) -> Figure:
    """Draw dark current and photocurrents of two LED intensities over bias."""
    biases = dac_sweep(1.2)
    dark, *light = _bench(diode, biases)
    ppm = 1e6 * max(1e-6, *(np.ptp(one) / np.mean(one) for one in light))
    fall = decades(diode, 20e-3, 1e-3)
    figure = "3.10" if diode == "si" else "3.9"
    return Figure(
        title=f"Figure {number}: dark current and photocurrent, {NAMES[diode]} photodiode",
        caption=_PHOTOCURRENTS.format(" and ".join(map(ampere, LED_A[diode])), figure),
        printed={
            "Photocurrent over bias": (f"constant to {ppm:.0f} ppm", "fairly constant"),
            "Fall of the dark current, 20 to 1 mV": (f"{fall:.2f} decades", decades_printed),
        },
        draw=partial(_draw_photocurrents, biases=biases, dark=dark, light=light),
        numbers={
            "reverse_bias_v": biases,
            "dark_current_a": dark,
            "photocurrent_led1_a": light[0],
            "photocurrent_led2_a": light[1],
        },
    )


def _draw_photocurrents(
    canvas: Canvas, biases: Floats, dark: Floats, light: Sequence[Floats]
) -> None:
    axes = canvas.subplots()
    axes.plot(1e3 * biases, light[1], "o-", color=ORANGE, label="LED2 − dark")
    axes.plot(1e3 * biases, light[0], "s-", color=BLUE, label="LED1 − dark")
    axes.plot(1e3 * biases, dark, "^-", color=BLACK, label="dark")
    over_bias(axes, "Estimated current", is_current=True)
    axes.legend(loc="lower right")


def _snr(number: str, diode: str, printed_db: float, printed: str) -> Figure:
    """Draw the ratio of photocurrent to dark current over bias."""
    biases = dac_sweep(1.2)
    gained = 20 * decades(diode, 20e-3, 1e-3)
    error = bias_error(PHOTODIODES[diode], printed_db)
    exact, shifted = _snr_db(diode, biases), _snr_db(diode, biases - error, biases > error)
    return Figure(
        title=f"Figure {number}: SNR against reverse bias, {NAMES[diode]} photodiode",
        caption=_SNR.format(1e3 * error, printed_db),
        printed={"Rise from 20 to 1 mV": (f"{gained:.1f} dB", printed)},
        draw=partial(_draw_snr, diode=diode, biases=biases, error=error),
        numbers={
            "reverse_bias_v": biases,
            **{f"snr_led{led}_db": each for led, each in enumerate(exact, 1)},
            **{f"snr_led{led}_bias_error_db": each for led, each in enumerate(shifted, 1)},
        },
    )


def _draw_snr(canvas: Canvas, diode: str, biases: Floats, error: float) -> None:
    axes = canvas.subplots()
    fine = np.geomspace(1e-3, biases[-1], 200)
    exact, dashed = _snr_db(diode, biases), _snr_db(diode, fine - error)
    styles = zip(("LED1", "LED2"), (BLUE, ORANGE), MARKERS, strict=False)
    for (led, color, marker), true, off in zip(styles, exact, dashed, strict=True):
        axes.plot(1e3 * biases, true, marker + "-", color=color, label=led)
        label = f"{led}, bias reads {1e3 * error:.2f} mV high"
        axes.plot(1e3 * fine, off, "--", color=color, label=label)
    for edge in (1, 20):
        axes.axvline(edge, color=GRAY, linewidth=1, linestyle=":")
    over_bias(axes, "SNR (dB)", is_current=False)
    axes.legend()


def _table_3_1(_: Run) -> Figure:
    numbers: dict[str, list[Cell]] = {
        "state": [*_STATES],
        "si_printed_a": [10.4e-15, 1.6e-12, 33.8e-15, np.nan],
        "si_ours_a": [*_states("si", poor_v=15e-3)],
        "ingaas_printed_a": [700e-12, 5.8e-9, 2.25e-12, np.nan],
        "ingaas_ours_a": [*_states("ingaas", poor_v=17.5e-3)],
    }
    over = [
        float(numbers[f"{diode}_ours_a"][3]) / float(numbers[f"{diode}_printed_a"][2])
        for diode in BUILT
    ]
    poor = float(numbers["ingaas_ours_a"][1]) / float(numbers["ingaas_printed_a"][1])
    rows = [*zip(*([_text(cell) for cell in column] for column in numbers.values()), strict=True)]
    offset, hours = 1e3 * TYPICAL_OFFSET_V, _tuned("si").elapsed_s / 3600
    return Figure(
        title="Table 3.1: dark current suppression of the CTIA pixel",
        caption=_TABLE.format(poor, offset, hours, *over, *(each**2 for each in over)),
        draw=partial(draw_table, head=_HEAD, rows=rows, widths=(1.6, 1, 1, 1.25, 1.1)),
        numbers=numbers,
        height_in=1.9,
    )


def bias_error(diode: Photodiode, rise_db: float) -> float:
    """Return the error of the read bias that gives a rise of the SNR, V.

    The rise is that of the photocurrent over the dark current from 20 mV to 1 mV as read.
    """
    ratio = 10 ** (rise_db / 20)

    def miss(error_v: float) -> float:
        far, near = (float(reverse_current(diode, read - error_v)) for read in (20e-3, 1e-3))
        return far - ratio * near

    return float(brentq(miss, 0.0, 1e-3))


def _bench(diode: str, biases: Floats) -> list[Floats]:
    """Dark current and the two photocurrents as estimated in §3.4, A."""
    one = built_pixel(diode, biases)
    dark = estimate_current(one)
    return [dark, *(estimate_current(one, led) - dark for led in LED_A[diode])]


def _snr_db(diode: str, biases: Floats, valid: NDArray[np.bool_] | None = None) -> list[Floats]:
    valid = np.ones(biases.shape, bool) if valid is None else valid
    dark, *light = _bench(diode, np.where(valid, biases, 1.0))
    return [np.where(valid, 20 * np.log10(one / dark), np.nan) for one in light]


def _states(diode: str, poor_v: float) -> list[float]:
    """Dark current of each state of Table 3.1, A."""
    any_offset = built_pixel(diode, (np.arange(200) + 0.5) / 200 * STEP_V)
    poor, at_zero = (
        built_pixel(diode, bias, FloatingGateBias().leak_v_s) for bias in (poor_v, 0.0)
    )
    return [
        float(estimate_current(any_offset).mean()),
        float(estimate_current(poor)),
        _tuned(diode).current_a,
        leak_floor(at_zero),
    ]


@cache
def _tuned(diode: str) -> Measurement:
    log = calibrate_gate(FloatingGateBias(), built_pixel(diode, TYPICAL_OFFSET_V))
    return min(log, key=lambda turn: turn.current_a or np.inf)


def _text(cell: Cell) -> str:
    if isinstance(cell, str):
        return cell
    return "" if np.isnan(cell) else ampere(cell)


RECIPES = (
    FigureRecipe("fig-3.2", _figure_3_2),
    FigureRecipe("fig-3.5", _figure_3_5),
    FigureRecipe("fig-3.6", _figure_3_6),
    FigureRecipe("fig-3.7", lambda _: _photocurrents("3.7", "ingaas_quiet", "about two decades")),
    FigureRecipe("fig-3.8", lambda _: _photocurrents("3.8", "si", "about 1.5 decades")),
    FigureRecipe("fig-3.9", lambda _: _snr("3.9", "ingaas_quiet", 40.0, "about 40 dB, then 50 dB")),
    FigureRecipe("fig-3.10", lambda _: _snr("3.10", "si", 30.0, "about 30 dB")),
    FigureRecipe("table-3.1", _table_3_1),
)
