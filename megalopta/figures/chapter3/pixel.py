"""Figures of Chapter 3 on the CTIA pixel: how it discharges and what dark current it shows.

The dissertation's measured points are not printed, only some numbers in the text; a table under
each figure sets ours beside these. No constant here was chosen to meet them, but for the three
currents that the presets of the photodiodes were made from.
"""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Canvas
from matplotlib.ticker import EngFormatter

from megalopta.figures import (
    DASHES,
    MARKERS,
    PALETTE,
    Figure,
    FigureRecipe,
    Floats,
    Printed,
    Run,
    rows_of,
)
from megalopta.sensor.ctia import (
    PHOTODIODES,
    DacBias,
    Photodiode,
    Pixel,
    discharge,
    discharge_time,
    estimate_current,
    gain_from_db,
    reverse_current,
)

SWING_V = 3.3
BUILT_FARAD, BUILT_GAIN_DB = 10e-12, 130.0
STEP_V = DacBias().step_v
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


def log_bias_axis(axes: Axes) -> None:
    """Make the horizontal axis the reverse bias in mV."""
    axes.set_xscale("log")
    axes.set_xlabel("Reverse bias (mV)")
    axes.xaxis.set_major_formatter("{x:g}")


def log_current_axis(axes: Axes, label: str) -> None:
    """Make the vertical axis a current."""
    axes.set_yscale("log")
    axes.yaxis.set_major_formatter(EngFormatter(unit="A"))
    axes.set_ylabel(label)


def figure_3_2(_: Run) -> Figure:
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
            shown = _to_rail(times, output, ends[index])
            (line,) = axes.plot(
                1e3 * shown[0], shown[1], label=f"{gain_db} dB", color=PALETTE[index]
            )
            line.set_linestyle(DASHES[index % len(DASHES)])
        axes.set_xlabel("Time (ms)")
        axes.set_ylabel("Output (V)")
        axes.set_xlim(0, 90)
        axes.set_ylim(0, 3.4)
        axes.legend(title="Open-loop gain")

    return Figure(
        name="fig-3.2",
        title="Figure 3.2: CTIA pixel discharging from an input offset of 1 mV",
        caption=(
            "As in the dissertation, the saturation current is 100 pA, the capacitance 100 fF, and "
            "there is no light. The less gain, the more the input moves over the swing, and the "
            "more the dark current grows with it."
        ),
        printed=(
            Printed("Motion of the input at 40 dB", f"{moved[0]:.0f} mV", "33 mV"),
            Printed("Motion of the input at 100 dB", f"{1e3 * moved[1]:.0f} µV", "33 µV"),
            Printed("Growth of the dark current at 40 dB", f"{growth:.0f} times", "—"),
            Printed(
                "Time of the swing at 40 and 90 dB",
                f"{1e3 * ends[0]:.1f} and {1e3 * ends[-1]:.1f} ms",
                "—",
            ),
        ),
        draw=draw,
        columns=("time_s", *(f"output_at_{gain}_db_v" for gain in gains_db)),
        rows=rows_of(times, *outputs),
    )


def figure_3_5(_: Run) -> Figure:
    """Discharge with the silicon diode at several reverse biases."""
    biases = np.array([24.5, 12.5, 6.5, 3.5, 1.5, 0.5, -0.5]) * STEP_V
    times = np.linspace(0, 300, 301)
    pixels = [built_pixel("si", float(bias)) for bias in biases]
    outputs = np.array([SWING_V - discharge(one, 0.0, times) for one in pixels])
    ends = [float(discharge_time(one, 0.0, SWING_V)) for one in pixels]

    def draw(canvas: Canvas) -> None:
        axes = canvas.subplots()
        for index, (bias, output) in enumerate(zip(biases, outputs, strict=True)):
            shown = _to_rail(times, output, ends[index])
            (line,) = axes.plot(*shown, label=_millivolt(bias), color=PALETTE[index])
            line.set_linestyle(DASHES[index % len(DASHES)])
        axes.set_xlabel("Time (s)")
        axes.set_ylabel("Output (V)")
        axes.set_xlim(0, 300)
        axes.set_ylim(0, 3.45)
        axes.legend(title="Reverse bias", loc="upper left", bbox_to_anchor=(1.0, 1.0))

    return Figure(
        name="fig-3.5",
        title="Figure 3.5: CTIA pixel discharging in the dark, Si photodiode",
        caption=(
            "The fabricated pixel (10 pF, 130 dB) has the preset of the SFH229FA and DAC codes "
            "half a code off zero. Past zero the diode is in forward bias and the pixel does not "
            "discharge. The dissertation prints no number for this figure."
        ),
        draw=draw,
        columns=("time_s", *(f"output_at_{1e3 * bias:.2f}_mv_v" for bias in biases)),
        rows=rows_of(times, *outputs),
    )


def figure_3_6(_: Run) -> Figure:
    """Dark current against reverse bias for both diodes."""
    biases = dac_sweep(1.0)
    currents = {name: estimate_current(built_pixel(name, biases)) for name in ("ingaas", "si")}
    drop = {name: decades(name, 20e-3, STEP_V / 2) for name in currents}
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
        log_bias_axis(axes)
        log_current_axis(axes, "Dark current")
        axes.legend()

    instantaneous = float(discharge_time(built_pixel("ingaas", 0.1), 0.0, SWING_V))
    return Figure(
        name="fig-3.6",
        title="Figure 3.6: dark current against reverse bias, non-adaptive pixel",
        caption=(
            "Points are 10–90 % estimates at DAC codes with the presets of the diodes, which have "
            "neither generation nor tunneling, by which real ones rise faster. The lowest current "
            "measured with Si needs a bias within 0.08 mV of zero, which one offset in ten leaves; "
            "ours is that at half a code. At 100 mV InGaAs discharges in "
            f"{1e3 * instantaneous:.2f} ms, which the bench could not sample."
        ),
        printed=(
            *(
                Printed(
                    f"Fall from 20 to 0.40 mV, {NAMES[name]}", f"{drop[name]:.1f} decades", "1–2"
                )
                for name in ("si", "ingaas")
            ),
            *(
                Printed(
                    f"Lowest current, {NAMES[name]}",
                    ampere(currents[name][0]),
                    ampere(printed[name]),
                )
                for name in ("si", "ingaas")
            ),
        ),
        draw=draw,
        columns=("reverse_bias_v", "dark_current_ingaas_a", "dark_current_si_a"),
        rows=rows_of(biases, *currents.values()),
    )


def _millivolt(volts: float) -> str:
    return f"{1e3 * volts:.1f} mV".replace("-", "−")


def _to_rail(times: Floats, output: Floats, end: float) -> tuple[Floats, Floats]:
    """Times and output up to the moment at which the lower rail is reached."""
    before = times < end
    if before.all():
        return times, output
    return np.append(times[before], end), np.append(output[before], 0.0)


RECIPES = (
    FigureRecipe("fig-3.2", figure_3_2),
    FigureRecipe("fig-3.5", figure_3_5),
    FigureRecipe("fig-3.6", figure_3_6),
)
