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

from collections.abc import Mapping
from functools import cache

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
from megalopta.reproduction.recipe import FigureRecipe, Run
from megalopta.sensor.ctia.bias import FloatingGateBias
from megalopta.sensor.ctia.calibration import Measurement, calibrate, leak_floor
from megalopta.sensor.ctia.integration import estimate_current
from megalopta.sensor.ctia.photodiode import Photodiode, reverse_current
from megalopta.sensor.ctia.presets import PHOTODIODES, TYPICAL_OFFSET_V

LED_A: Mapping[str, tuple[float, float]] = {
    "si": (5e-12, 20e-12),
    "ingaas_quiet": (150e-12, 600e-12),
}
_STATES = ("Non-adaptive (best)", "Adaptive (poor)", "Adaptive (fine)", "Limit set by the leak")


def _photocurrents(name: str, diode: str, decades_printed: str) -> Figure:
    """Dark current and photocurrents of two LED intensities against bias."""
    biases = dac_sweep(1.2)
    dark, *light = _bench(diode, biases)
    ppm = 1e6 * max(1e-6, *(np.ptp(one) / np.mean(one) for one in light))
    fall = decades(diode, 20e-3, 1e-3)
    note, figure = "; the diode, printed only as less noisy, has the 100 pA of Figure 3.2", "3.9"
    if diode == "si":
        note, figure = "", "3.10"

    def draw(canvas: Canvas) -> None:
        axes = canvas.subplots()
        axes.plot(1e3 * biases, light[1], "o-", color=ORANGE, label="LED2 − dark")
        axes.plot(1e3 * biases, light[0], "s-", color=BLUE, label="LED1 − dark")
        axes.plot(1e3 * biases, dark, "^-", color=BLACK, label="dark")
        over_bias(axes, "Estimated current", is_current=True)
        axes.legend(loc="lower right")

    return Figure(
        title=f"{_number(name)}: dark current and photocurrent, {NAMES[diode]} photodiode",
        caption=(
            "Each photocurrent is the difference of two 10–90 % estimates; the model's quantum "
            "efficiency does not depend on bias. LED1 and LED2 are our choice, "
            f"{' and '.join(map(ampere, LED_A[diode]))}, for none is printed{note}. A diode with a "
            f"shunt cannot fall by more than 1.30 decades, of which Figure {figure} tells more."
        ),
        printed={
            "Photocurrent over bias": (f"constant to {ppm:.0f} ppm", "fairly constant"),
            "Fall of the dark current, 20 to 1 mV": (f"{fall:.2f} decades", decades_printed),
        },
        draw=draw,
        numbers={
            "reverse_bias_v": biases,
            "dark_current_a": dark,
            "photocurrent_led1_a": light[0],
            "photocurrent_led2_a": light[1],
        },
    )


def _snr(name: str, diode: str, printed_db: float, printed: str) -> Figure:
    """Ratio of photocurrent to dark current against bias."""
    biases = dac_sweep(1.2)
    gained = 20 * decades(diode, 20e-3, 1e-3)
    error = bias_error(PHOTODIODES[diode], printed_db)
    exact, shifted = _snr_db(diode, biases), _snr_db(diode, biases - error, biases > error)
    fine = np.geomspace(1e-3, biases[-1], 200)
    dashed = _snr_db(diode, fine - error)

    def draw(canvas: Canvas) -> None:
        axes = canvas.subplots()
        styles = zip(("LED1", "LED2"), (BLUE, ORANGE), MARKERS, strict=False)
        for (led, color, marker), true, off in zip(styles, exact, dashed, strict=True):
            axes.plot(1e3 * biases, true, marker + "-", color=color, label=led)
            label = f"{led}, bias reads {1e3 * error:.2f} mV high"
            axes.plot(1e3 * fine, off, "--", color=color, label=label)
        for edge in (1, 20):
            axes.axvline(edge, color=GRAY, linewidth=1, linestyle=":")
        over_bias(axes, "SNR (dB)", is_current=False)
        axes.legend()

    return Figure(
        title=f"{_number(name)}: SNR against reverse bias, {NAMES[diode]} photodiode",
        caption=(
            "The SNR is 20·log10(photocurrent / dark current). The model allows a rise of 23.0 to "
            "26.0 dB between the dotted lines, whatever the size of the diode. Were the true bias "
            f"{1e3 * error:.2f} mV below the one read, where one DAC code is 0.81 mV, the rise "
            f"would be {printed_db:.0f} dB (dashed): our inference, to which nothing is fitted."
        ),
        printed={"Rise from 20 to 1 mV": (f"{gained:.1f} dB", printed)},
        draw=draw,
        numbers={
            "reverse_bias_v": biases,
            **{f"snr_led{led}_db": each for led, each in enumerate(exact, 1)},
            **{f"snr_led{led}_bias_error_db": each for led, each in enumerate(shifted, 1)},
        },
    )


def _table_3_1(_: Run) -> Figure:
    numbers: dict[str, list[Cell]] = {
        "state": [*_STATES],
        "si_printed_a": [10.4e-15, 1.6e-12, 33.8e-15, np.nan],
        "si_ours_a": [*_states("si", poor_v=15e-3)],
        "ingaas_printed_a": [700e-12, 5.8e-9, 2.25e-12, np.nan],
        "ingaas_ours_a": [*_states("ingaas", poor_v=17.5e-3)],
    }

    def draw(canvas: Canvas) -> None:
        head = ("", "Si, printed", "Si, ours", "InGaAs, printed", "InGaAs, ours")
        texts = [[_text(cell) for cell in column] for column in numbers.values()]
        draw_table(canvas, head, [*zip(*texts, strict=True)], widths=(1.6, 1, 1, 1.25, 1.1))

    over = [
        float(numbers[f"{diode}_ours_a"][3]) / float(numbers[f"{diode}_printed_a"][2])
        for diode in BUILT
    ]
    poor = float(numbers["ingaas_ours_a"][1]) / float(numbers["ingaas_printed_a"][1])
    return Figure(
        title="Table 3.1: dark current suppression of the CTIA pixel",
        caption=(
            "Non-adaptive is the mean over an offset that falls anywhere between two DAC codes, "
            "and poor the state at 15 mV (Si, from which the preset was made) and 17.5 mV (InGaAs, "
            f"{poor:.1f} times what was measured: made from 170 nA at 100 mV, no diode with a "
            "shunt falls so far). Fine is the end of the programming loop, from "
            f"{1e3 * TYPICAL_OFFSET_V:.1f} mV in pulses of 500 µV with a leak of 1.5 µV/s, which "
            f"takes {_tuned('si').elapsed_s / 3600:.1f} h for Si. The last line is the least that "
            f"the leak allows, {over[0]:.1f} and {over[1]:.1f} times what was measured: the "
            f"conductance of the real diodes at zero bias must be {over[0] ** 2:.0f} and "
            f"{over[1] ** 2:.0f} times smaller than that of the presets."
        ),
        draw=draw,
        numbers=numbers,
        height_in=1.9,
    )


def bias_error(diode: Photodiode, rise_db: float) -> float:
    """How much lower the true bias must be than the one read for a given rise of the SNR, V.

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


def _number(name: str) -> str:
    return f"Figure {name.removeprefix('fig-')}"


RECIPES = (
    FigureRecipe(
        "fig-3.7", lambda _: _photocurrents("fig-3.7", "ingaas_quiet", "about two decades")
    ),
    FigureRecipe("fig-3.8", lambda _: _photocurrents("fig-3.8", "si", "about 1.5 decades")),
    FigureRecipe(
        "fig-3.9", lambda _: _snr("fig-3.9", "ingaas_quiet", 40.0, "about 40 dB, then 50 dB")
    ),
    FigureRecipe("fig-3.10", lambda _: _snr("fig-3.10", "si", 30.0, "about 30 dB")),
    FigureRecipe("table-3.1", _table_3_1),
)
