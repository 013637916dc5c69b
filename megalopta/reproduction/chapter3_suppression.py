"""Figures and table of Chapter 3 on suppressing dark current: photocurrents, SNR, Table 3.1.

As in `pixel`, tables under the figures set our numbers beside the printed ones.

The model allows a rise of the SNR from 20 mV to 1 mV of 23.0 dB to an n = 1 diode and of 26.0 dB to
a shunt, whatever their size, and to both together something between. An error of the bias would
explain the rest: one DAC code is 0.81 mV, and the offset could not be measured. This is our
inference; no constant was chosen to meet the printed number.

Of Table 3.1: a non-adaptive pixel has anything from 0 to twice the mean over its offset, so 10.4 fA
is a lucky code. The saturation current of the silicon preset comes from the poor state at 15 mV,
which is no test of it. Made from 170 nA at 100 mV, no InGaAs diode with a shunt falls to 5.8 nA at
17.5 mV: its current must rise faster than in proportion, by tunneling for instance. The leak of the
gate sets both fine values, as the dissertation says for Si. The least that a leaking gate allows
goes as the root of the conductance at zero bias.
"""

from collections.abc import Mapping, Sequence
from functools import cache, partial

import numpy as np
from matplotlib.figure import Figure as Canvas
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
    draw_table,
)
from megalopta.reproduction.chapter3_pixel import (
    BUILT,
    NAMES,
    STEP_V,
    ampere,
    built_pixel,
    dac_sweep,
    decades,
    over_bias,
)
from megalopta.reproduction.figure_recipe import FigureRecipe, Run
from megalopta.sensor.ctia.bias import FloatingGateBias, Measurement, calibrate, leak_floor
from megalopta.sensor.ctia.integration import estimate_current
from megalopta.sensor.ctia.model import PHOTODIODES, TYPICAL_OFFSET_V
from megalopta.sensor.ctia.photodiode import Photodiode, reverse_current

LED_A: Mapping[str, tuple[float, float]] = {
    "si": (5e-12, 20e-12),
    "ingaas_quiet": (150e-12, 600e-12),
}
_PHOTOCURRENTS = (
    "Each photocurrent is the difference of two 10–90 % estimates; the model's quantum efficiency "
    "does not depend on bias. LED1 and LED2 are our choice, {}, for none is printed; the InGaAs "
    "diode, printed only as less noisy, has the 100 pA of Figure 3.2. A diode with a shunt cannot "
    "fall by more than 1.30 decades, of which Figure {} tells more."
)
_SNR = (
    "The SNR is 20·log10(photocurrent / dark current). The model allows a rise of 23.0 to 26.0 dB "
    "between the dotted lines, whatever the size of the diode. Were the true bias {:.2f} mV below "
    "the one read, where one DAC code is 0.81 mV, the rise would be {:.0f} dB (dashed): our "
    "inference, to which nothing is fitted."
)
_TABLE = (
    "Non-adaptive is the mean over an offset that falls anywhere between two DAC codes, and poor "
    "the state at 15 mV (Si, from which the preset was made) and 17.5 mV (InGaAs, {:.1f} times "
    "what was measured: made from 170 nA at 100 mV, no diode with a shunt falls so far). Fine is "
    "the end of the programming loop, from {:.1f} mV in pulses of 500 µV with a leak of 1.5 µV/s, "
    "which takes {:.1f} h for Si. The last line is the least that the leak allows, {:.1f} and "
    "{:.1f} times what was measured: the conductance of the real diodes at zero bias must be "
    "{:.0f} and {:.0f} times smaller than that of the presets."
)
_STATES = ("Non-adaptive (best)", "Adaptive (poor)", "Adaptive (fine)", "Limit set by the leak")


def _photocurrents(number: str, diode: str, decades_printed: str) -> Figure:
    """Return dark current and photocurrents of two LED intensities against bias."""
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
    """Return the ratio of photocurrent to dark current against bias."""
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
    offset, hours = 1e3 * TYPICAL_OFFSET_V, _tuned("si").elapsed_s / 3600
    return Figure(
        title="Table 3.1: dark current suppression of the CTIA pixel",
        caption=_TABLE.format(poor, offset, hours, *over, *(each**2 for each in over)),
        draw=partial(_draw_table, numbers=numbers),
        numbers=numbers,
        height_in=1.9,
    )


def _draw_table(canvas: Canvas, numbers: Mapping[str, Sequence[Cell]]) -> None:
    head = ("", "Si, printed", "Si, ours", "InGaAs, printed", "InGaAs, ours")
    texts = [[_text(cell) for cell in column] for column in numbers.values()]
    draw_table(canvas, head, [*zip(*texts, strict=True)], widths=(1.6, 1, 1, 1.25, 1.1))


def bias_error(diode: Photodiode, rise_db: float) -> float:
    """Return by how much the true bias must be below the one read for a given rise of the SNR, V.

    The rise is that of the photocurrent over the dark current from 20 mV to 1 mV as read.
    """
    ratio = 10 ** (rise_db / 20)

    def miss(error_v: float) -> float:
        far, near = (float(reverse_current(diode, read - error_v)) for read in (20e-3, 1e-3))
        return far - ratio * near

    return float(brentq(miss, 0.0, 1e-3))


def _bench(diode: str, biases: Floats) -> list[Floats]:
    """Dark current and the two photocurrents as §3.4 estimates them, A."""
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
    log = calibrate(FloatingGateBias(), built_pixel(diode, TYPICAL_OFFSET_V))
    return min(log, key=lambda turn: turn.current_a or np.inf)


def _text(cell: Cell) -> str:
    if isinstance(cell, str):
        return cell
    return "" if np.isnan(cell) else ampere(cell)


RECIPES = (
    FigureRecipe("fig-3.7", lambda _: _photocurrents("3.7", "ingaas_quiet", "about two decades")),
    FigureRecipe("fig-3.8", lambda _: _photocurrents("3.8", "si", "about 1.5 decades")),
    FigureRecipe("fig-3.9", lambda _: _snr("3.9", "ingaas_quiet", 40.0, "about 40 dB, then 50 dB")),
    FigureRecipe("fig-3.10", lambda _: _snr("3.10", "si", 30.0, "about 30 dB")),
    FigureRecipe("table-3.1", _table_3_1),
)
