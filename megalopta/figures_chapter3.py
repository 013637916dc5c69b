"""Figures and table of Chapter 3: the CTIA pixel.

The dissertation's measured points are not printed, only some numbers in the text; the captions set
ours beside these. No constant here was chosen to meet them, but for the three currents that the
presets of the photodiodes were made from.
"""

from collections.abc import Mapping
from functools import partial

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Canvas
from matplotlib.ticker import EngFormatter
from numpy.typing import NDArray
from scipy.optimize import brentq

from megalopta.figure import Figure, Registry
from megalopta.plot_style import BLACK, BLUE, DASHES, GRAY, MARKERS, ORANGE, PALETTE, draw_table
from megalopta.sensor.ctia_bias import DacBias, FloatingGateBias
from megalopta.sensor.ctia_calibration import Measurement, calibrate, leak_floor
from megalopta.sensor.ctia_integration import (
    Pixel,
    discharge,
    discharge_time,
    estimate_current,
    gain_from_db,
)
from megalopta.sensor.ctia_photodiode import Photodiode, reverse_current
from megalopta.sensor.ctia_presets import PHOTODIODES, TYPICAL_OFFSET_V

Floats = NDArray[np.float64]

SWING_V = 3.3
BUILT_FARAD, BUILT_GAIN_DB = 10e-12, 130.0
STEP_V = DacBias().step_v
LED_A: Mapping[str, tuple[float, float]] = {
    "si": (5e-12, 20e-12),
    "ingaas_quiet": (150e-12, 600e-12),
}
NAMES = {"si": "Si", "ingaas": "InGaAs", "ingaas_quiet": "InGaAs"}


def built_pixel(diode: str, bias_v: float | Floats, drift_v_s: float = 0.0) -> Pixel:
    """The fabricated pixel of §3.2.4 with a photodiode of the presets."""
    gain = gain_from_db(BUILT_GAIN_DB)
    return Pixel(PHOTODIODES[diode], BUILT_FARAD, SWING_V, gain, bias_v, drift_v_s)


def ampere(value: float) -> str:
    """Three digits with a prefix of the unit: "10.4 fA"."""
    return str(EngFormatter(unit="A")(float(f"{value:.3g}")))


def dac_sweep(largest_v: float) -> Floats:
    """Reverse biases at DAC codes, about evenly spaced in their logarithm, V.

    The bias closest to zero is half a code, the mean of what an unknown offset leaves.
    """
    codes = np.unique(np.rint(np.geomspace(1, largest_v / STEP_V, 40) - 0.5))
    return np.asarray((codes + 0.5) * STEP_V)


def figure_3_2() -> Figure:
    """Discharge for open-loop gains of 40 to 90 dB."""
    gains_db = np.arange(40, 91, 10)
    diode = Photodiode(saturation_current_a=100e-12)
    pixels = [Pixel(diode, 100e-15, SWING_V, gain_from_db(float(g)), 1e-3) for g in gains_db]
    times = np.linspace(0, 0.09, 181)
    outputs = np.array([SWING_V - discharge(one, 0.0, times) for one in pixels])
    ends = [float(discharge_time(one, 0.0, SWING_V)) for one in pixels]
    moved = [1e3 * SWING_V / float(gain_from_db(g)) for g in (40.0, 100.0)]
    growth = float(reverse_current(diode, 1e-3 + SWING_V / 100) / reverse_current(diode, 1e-3))

    def draw(canvas: Canvas) -> None:
        axes = canvas.subplots()
        for index, (gain_db, output) in enumerate(zip(gains_db, outputs, strict=True)):
            (line,) = axes.plot(
                1e3 * times, _to_rail(output), label=f"{gain_db} dB", color=PALETTE[index]
            )
            line.set_linestyle(DASHES[index % len(DASHES)])
        axes.set_xlabel("Time (ms)")
        axes.set_ylabel("Output (V)")
        axes.set_xlim(0, 90)
        axes.set_ylim(0, 3.4)
        axes.legend(title="Open-loop gain")

    return Figure(
        name="fig-3.2",
        title="CTIA pixel discharging from an input offset of 1 mV",
        caption=(
            "Saturation current 100 pA, 100 fF, no light, as in the dissertation. "
            f"The input moves over the swing by {moved[0]:.0f} mV at 40 dB and "
            f"{1e3 * moved[1]:.0f} µV at 100 dB (printed: 33 mV and 33 µV). At 40 dB the dark "
            f"current grows by a factor {growth:.0f} and the swing takes {1e3 * ends[0]:.1f} ms; "
            f"at 90 dB it takes {1e3 * ends[-1]:.1f} ms and the line is straight."
        ),
        draw=draw,
        columns=("time_s", *(f"output_at_{gain}_db_v" for gain in gains_db)),
        rows=_rows(times, *outputs),
    )


def figure_3_5() -> Figure:
    """Discharge with the silicon diode at several reverse biases."""
    biases = np.array([24.5, 12.5, 6.5, 3.5, 1.5, 0.5, -0.5]) * STEP_V
    times = np.linspace(0, 300, 301)
    outputs = np.array(
        [SWING_V - discharge(built_pixel("si", float(bias)), 0.0, times) for bias in biases]
    )

    def draw(canvas: Canvas) -> None:
        axes = canvas.subplots()
        for index, (bias, output) in enumerate(zip(biases, outputs, strict=True)):
            (line,) = axes.plot(
                times, _to_rail(output), label=_millivolt(bias), color=PALETTE[index]
            )
            line.set_linestyle(DASHES[index % len(DASHES)])
        axes.set_xlabel("Time (s)")
        axes.set_ylabel("Output (V)")
        axes.set_xlim(0, 300)
        axes.set_ylim(0, 3.45)
        axes.legend(title="Reverse bias", loc="upper left", bbox_to_anchor=(1.0, 1.0))

    return Figure(
        name="fig-3.5",
        title="CTIA pixel discharging in the dark, Si photodiode",
        caption=(
            "Fabricated pixel (10 pF, 130 dB) at DAC codes half a code off zero; SFH229FA as in "
            "the preset. As printed, the slope falls as the anode is raised, and past zero the "
            "diode is in forward bias and the pixel does not discharge. The dissertation prints no "
            "number for this figure."
        ),
        draw=draw,
        columns=("time_s", *(f"output_at_{1e3 * bias:.2f}_mv_v" for bias in biases)),
        rows=_rows(times, *outputs),
    )


def figure_3_6() -> Figure:
    """Dark current against reverse bias for both diodes."""
    biases = dac_sweep(1.0)
    currents = {name: estimate_current(built_pixel(name, biases)) for name in ("ingaas", "si")}
    drop = {name: _decades(name, 20e-3, STEP_V / 2) for name in currents}
    printed = {"ingaas": 700e-12, "si": 10.4e-15}

    def draw(canvas: Canvas) -> None:
        axes = canvas.subplots()
        for index, (name, values) in enumerate(currents.items()):
            color = PALETTE[index]
            axes.plot(1e3 * biases, values, MARKERS[index] + "-", color=color, label=NAMES[name])
            axes.axhline(printed[name], color=color, linestyle=":", linewidth=1.5)
            text = f"lowest measured, {NAMES[name]}: {ampere(printed[name])}"
            axes.annotate(
                text,
                (900, printed[name]),
                xytext=(0, 5),
                textcoords="offset points",
                ha="right",
                color=color,
                fontsize=10,
            )
        _log_bias(axes)
        _log_current(axes, "Dark current")
        axes.legend()

    instantaneous = float(discharge_time(built_pixel("ingaas", 0.1), 0.0, SWING_V))
    return Figure(
        name="fig-3.6",
        title="Dark current against reverse bias, non-adaptive pixel",
        caption=(
            "10–90 % estimates at DAC codes, presets of the diodes. From 20 mV to half a code "
            f"(0.40 mV) the current falls by {drop['si']:.1f} decades for Si and "
            f"{drop['ingaas']:.1f} for InGaAs (printed: 1–2). At half a code InGaAs has "
            f"{ampere(currents['ingaas'][0])} (printed, lowest: 700 pA) and Si "
            f"{ampere(currents['si'][0])} (10.4 fA, which needs a bias within 0.08 mV of zero: one "
            "offset in ten leaves that). At 100 mV InGaAs discharges in "
            f"{1e3 * instantaneous:.2f} ms; the bench could not sample that. The model has neither "
            "generation nor tunneling, by which real diodes rise faster."
        ),
        draw=draw,
        columns=("reverse_bias_v", "dark_current_ingaas_a", "dark_current_si_a"),
        rows=_rows(biases, *currents.values()),
    )


def photocurrent_figure(name: str, diode: str, decades_printed: str) -> Figure:
    """Dark current and photocurrents of two LED intensities against bias."""
    biases = dac_sweep(1.2)
    dark, *light = _bench(diode, biases)
    flat = max(float(np.ptp(one) / np.mean(one)) for one in light)
    fall = _decades(diode, 20e-3, 1e-3)

    def draw(canvas: Canvas) -> None:
        axes = canvas.subplots()
        curves = (("LED2 − dark", light[1]), ("LED1 − dark", light[0]), ("dark", dark))
        for (label, values), color, marker in zip(
            curves, (ORANGE, BLUE, BLACK), MARKERS, strict=False
        ):
            axes.plot(1e3 * biases, values, marker + "-", color=color, label=label)
        _log_bias(axes)
        _log_current(axes, "Estimated current")
        axes.legend(loc="lower right")

    return Figure(
        name=name,
        title=f"Dark current and photocurrent, {NAMES[diode]} photodiode",
        caption=(
            "Each photocurrent is the difference of two 10–90 % estimates. It is constant over "
            f"bias to {1e6 * max(flat, 1e-6):.0f} ppm (printed: fairly constant), for the model's "
            "quantum efficiency does not depend on bias. LED1 and LED2 are our choice, "
            f"{ampere(LED_A[diode][0])} and {ampere(LED_A[diode][1])}: none is printed. From 20 mV "
            f"to 1 mV the dark current falls by {fall:.2f} decades; printed: {decades_printed}. A "
            "diode with a shunt cannot do more than 1.30: see "
            f"{'fig-3.10' if diode == 'si' else 'fig-3.9'}." + _diode_note(diode)
        ),
        draw=draw,
        columns=("reverse_bias_v", "dark_current_a", "photocurrent_led1_a", "photocurrent_led2_a"),
        rows=_rows(biases, dark, *light),
    )


def snr_figure(name: str, diode: str, printed_db: float, note: str) -> Figure:
    """Ratio of photocurrent to dark current against bias."""
    biases = dac_sweep(1.2)
    gained = 20 * _decades(diode, 20e-3, 1e-3)
    error = bias_error(PHOTODIODES[diode], printed_db)
    exact, shifted = _snr_db(diode, biases), _snr_db(diode, biases - error, biases > error)

    def draw(canvas: Canvas) -> None:
        axes = canvas.subplots()
        for index, (true, off) in enumerate(zip(exact, shifted, strict=True)):
            color, marker = (BLUE, ORANGE)[index], MARKERS[index]
            axes.plot(1e3 * biases, true, marker + "-", color=color, label=f"LED{index + 1}")
            label = f"LED{index + 1}, bias reads {1e3 * error:.2f} mV high"
            axes.plot(1e3 * biases, off, "--", color=color, label=label)
        for edge in (1, 20):
            axes.axvline(edge, color=GRAY, linewidth=1, linestyle=":")
        _log_bias(axes)
        axes.set_ylabel("SNR (dB)")
        axes.legend()

    return Figure(
        name=name,
        title=f"SNR against reverse bias, {NAMES[diode]} photodiode",
        caption=(
            "SNR = 20·log10(photocurrent / dark current). From 20 mV to 1 mV (dotted) ours rises "
            f"by {gained:.1f} dB; printed: about {printed_db:.0f} dB{note}. The model allows "
            "23.0 dB to an n = 1 diode and 26.0 dB to a shunt, whatever their size, and to both "
            "together something between. An error of the bias would explain the rest: were the "
            f"true bias {1e3 * error:.2f} mV below the one read, the rise would be "
            f"{printed_db:.0f} dB (dashed). One DAC code is 0.81 mV, and the offset could not be "
            "measured. This is our inference; no constant was chosen to meet the printed number."
        ),
        draw=draw,
        columns=(
            "reverse_bias_v",
            "snr_led1_db",
            "snr_led2_db",
            "snr_led1_bias_error_db",
            "snr_led2_bias_error_db",
        ),
        rows=_rows(biases, *exact, *shifted),
    )


def table_3_1() -> Figure:
    """Dark currents of both pixels, ours beside those printed."""
    best = {name: _best_codes(name) for name in ("si", "ingaas")}
    poor = {"si": _poor("si", 15e-3), "ingaas": _poor("ingaas", 17.5e-3)}
    fine = {name: _tuned(name) for name in ("si", "ingaas")}
    floor = {name: leak_floor(built_pixel(name, 0.0, FloatingGateBias().leak_v_s)) for name in fine}
    rows = (
        ("Non-adaptive (best)", 10.4e-15, best["si"], 700e-12, best["ingaas"]),
        ("Adaptive (poor)", 1.6e-12, poor["si"], 5.8e-9, poor["ingaas"]),
        ("Adaptive (fine)", 33.8e-15, fine["si"].current_a, 2.25e-12, fine["ingaas"].current_a),
        ("Limit set by the leak", np.nan, floor["si"], np.nan, floor["ingaas"]),
    )

    def draw(canvas: Canvas) -> None:
        head = ("", "Si, printed", "Si, ours", "InGaAs, printed", "InGaAs, ours")
        text = [(row[0], *("" if np.isnan(v) else ampere(v) for v in row[1:])) for row in rows]
        draw_table(canvas, head, text, widths=(1.6, 1, 1, 1.25, 1.1))

    hours = fine["si"].elapsed_s / 3600
    over = floor["si"] / 33.8e-15, floor["ingaas"] / 2.25e-12
    return Figure(
        name="table-3.1",
        title="Dark current suppression of the CTIA pixel",
        caption=(
            "Non-adaptive: mean of the 10–90 % estimate over an offset that falls anywhere between "
            "two DAC codes; one pixel has anything from 0 to twice that, so 10.4 fA is a lucky "
            "code. Adaptive, poor: at 15 mV for Si, which is where the saturation current of the "
            "preset comes from and no test of it, and at 17.5 mV for InGaAs: made from 170 nA at "
            "100 mV, no diode with a shunt falls to 5.8 nA there (its current must rise faster "
            "than in proportion, by tunneling for instance). Fine: end of the programming loop, "
            f"from {1e3 * TYPICAL_OFFSET_V:.1f} mV in pulses of 500 µV with a leak of 1.5 µV/s; "
            f"for Si it takes {hours:.1f} h. The leak of the gate sets both fine values, as the "
            "dissertation says for Si; the last line is the least that a leaking gate allows, "
            f"{over[0]:.1f} and {over[1]:.1f} times what was measured. It goes as the root of the "
            f"conductance at zero bias, so that of the real diodes must be {over[0] ** 2:.0f} and "
            f"{over[1] ** 2:.0f} times smaller than that of the presets."
        ),
        draw=draw,
        columns=(
            "state",
            "si_printed_a",
            "si_ours_a",
            "ingaas_printed_a",
            "ingaas_ours_a",
        ),
        rows=rows,
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


def _decades(diode: str, from_v: float, to_v: float) -> float:
    far, near = (float(estimate_current(built_pixel(diode, bias))) for bias in (from_v, to_v))
    return float(np.log10(far / near))


def _best_codes(diode: str) -> float:
    left = (np.arange(200) + 0.5) / 200 * STEP_V
    return float(estimate_current(built_pixel(diode, left)).mean())


def _poor(diode: str, bias_v: float) -> float:
    return float(estimate_current(built_pixel(diode, bias_v, FloatingGateBias().leak_v_s)))


def _tuned(diode: str) -> Measurement:
    log = calibrate(FloatingGateBias(), built_pixel(diode, TYPICAL_OFFSET_V))
    return min(log, key=lambda turn: turn.current_a or np.inf)


def _diode_note(diode: str) -> str:
    if diode == "si":
        return ""
    return (
        " The dissertation describes its diode only as less noisy; ours has the 100 pA of fig-3.2."
    )


def _millivolt(volts: float) -> str:
    return f"{1e3 * volts:.1f} mV".replace("-", "−")


def _to_rail(output: Floats) -> Floats:
    """The output up to the first sample at the lower rail, without the flat rest."""
    at_rail = output <= 0
    return np.where(at_rail & np.roll(at_rail, 1), np.nan, output)


def _log_bias(axes: Axes) -> None:
    axes.set_xscale("log")
    axes.set_xlabel("Reverse bias (mV)")
    axes.xaxis.set_major_formatter("{x:g}")


def _log_current(axes: Axes, label: str) -> None:
    axes.set_yscale("log")
    axes.yaxis.set_major_formatter(EngFormatter(unit="A"))
    axes.set_ylabel(label)


def _rows(*columns: Floats) -> tuple[tuple[float, ...], ...]:
    return tuple(tuple(map(float, row)) for row in zip(*columns, strict=True))


CHAPTER_3: Registry = {
    "fig-3.2": figure_3_2,
    "fig-3.5": figure_3_5,
    "fig-3.6": figure_3_6,
    "fig-3.7": partial(photocurrent_figure, "fig-3.7", "ingaas_quiet", "about two"),
    "fig-3.8": partial(photocurrent_figure, "fig-3.8", "si", "about 1.5"),
    "fig-3.9": partial(
        snr_figure, "fig-3.9", "ingaas_quiet", 40.0, " (and, in the next sentence, 50 dB)"
    ),
    "fig-3.10": partial(snr_figure, "fig-3.10", "si", 30.0, ""),
    "table-3.1": table_3_1,
}
