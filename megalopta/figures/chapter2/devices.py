"""Figures and table of Chapter 2: the single-photon pixel and SPADCAM.

The dissertation prints its curves without numbers; what its text gives stands beside ours in a
table under each figure. SPADCAM's row is a simulated device, made and measured as the real one was:
500 frames at each bias, in the dark and under 396 photons/µm²/s of 450 nm, through the counter that
saturates. Over many devices the preset gives what is printed of Figure 2.9 (mean 1.77, median 0.93,
σ 1.77 Hz/µm²) and 11 quiet pixels of mean 0.76, median 0.73, σ 0.29; one row differs.
"""

from functools import cache
from typing import NamedTuple

import numpy as np
from matplotlib.figure import Figure as Canvas
from matplotlib.ticker import EngFormatter
from numpy.typing import NDArray

from megalopta.figures import (
    BLACK,
    BLUE,
    DASHES,
    GRAY,
    PALETTE,
    Figure,
    FigureRecipe,
    Floats,
    Printed,
    Run,
    draw_table,
    rows_of,
)
from megalopta.sensor import DeadTime, Sensor, changed, expose_rate, preset
from megalopta.sensor.effects import best_excess_bias, breakdown_offset, expected_counts
from megalopta.sensor.spad import TABLE_2_1, draw_fixed_pattern

ANODE_AT_BREAKDOWN_V = 12.40
"""13.40 V at the anode is an excess bias of about 1 V (§2.4.4)."""
ANODE_V = np.arange(13.40, 13.801, 0.02)
SHEET_V = 13.58
"""Anode voltage of the dark counts that are printed as numbers (§2.4.7)."""
FRAMES = 500
PIXELS = 16
PHOTONS_HZ_UM2 = 396.0
ACTIVE_UM2 = 360.0
WAVELENGTH_NM = 450.0
SNR_PHOTONS_HZ = 1e6


class RowMeasurement(NamedTuple):
    """Mean counts of a row at each bias, (biases, pixels), and where a counter was ever full."""

    dark: Floats
    bright: Floats
    is_saturated: NDArray[np.bool_]


def spadcam_at(anode_v: float) -> Sensor:
    """SPADCAM at an anode voltage."""
    return changed(preset("spadcam"), bias={"excess_v": anode_v - ANODE_AT_BREAKDOWN_V})


@cache
def measure_row() -> RowMeasurement:
    """Measure a row of SPADCAM in the dark and in light."""
    dark, bright, full = zip(*(_measure_at(float(volts)) for volts in ANODE_V), strict=True)
    return RowMeasurement(np.array(dark), np.array(bright), np.array(full))


def _measure_at(anode_v: float) -> tuple[Floats, Floats, NDArray[np.bool_]]:
    sensor = spadcam_at(anode_v)
    peak = float(sensor.efficiency(np.array(WAVELENGTH_NM)))
    factor = draw_fixed_pattern(sensor, (1, PIXELS)).efficiency_factor
    light_hz = np.broadcast_to(PHOTONS_HZ_UM2 * ACTIVE_UM2 * peak * factor, (FRAMES, 1, PIXELS))
    name = f"row at {anode_v:.2f} V"
    dark = expose_rate(0 * light_hz, sensor, seed=0, sequence=f"{name}, dark")
    bright = expose_rate(light_hz, sensor, seed=0, sequence=f"{name}, light")
    full = np.asarray((dark.saturated | bright.saturated).any((0, 1)))
    return dark.counts.mean((0, 1)), bright.counts.mean((0, 1)), full


def dark_density(row: RowMeasurement) -> Floats:
    """Dark count rate as measured, Hz/µm², (biases, pixels); NaN where nothing was counted."""
    rate = row.dark / (preset("spadcam").exposure_s * ACTIVE_UM2)
    return np.where(rate > 0, rate, np.nan)


def measured_efficiency(row: RowMeasurement) -> Floats:
    """Detection efficiency as measured, (biases, pixels); NaN where a counter was full."""
    photons = PHOTONS_HZ_UM2 * ACTIVE_UM2 * preset("spadcam").exposure_s
    return np.where(row.is_saturated, np.nan, (row.bright - row.dark) / photons)


def figure_2_2(_: Run) -> Figure:
    """Count rate over photon rate for the three kinds of dead time."""
    photons = np.geomspace(1e3, 1e10, 281)
    dead_times = (1e-9, 1e-8, 1e-7, 1e-6)
    curves = {
        (kind, tau): expected_counts(
            photons, 1.0, DeadTime(kind=kind, dead_time_s=tau, start="stationary")
        )
        for kind in ("nonparalyzable", "paralyzable")
        for tau in dead_times
    }
    highest = curves["paralyzable", 1e-7].max()
    decibel = [20 * np.log10(rate / 100) for rate in (highest, 1e7)]

    def draw(canvas: Canvas) -> None:
        axes = canvas.subplots()
        axes.loglog(photons, photons, color=BLACK, label="ideal")
        for (kind, tau), counts in curves.items():
            color = PALETTE[dead_times.index(tau)]
            dash = "--" if kind == "paralyzable" else "-"
            label = f"τ = {EngFormatter(unit='s')(tau)}" if dash == "-" else None
            axes.loglog(photons, counts, dash, color=color, label=label)
        axes.plot([], [], "-", color=GRAY, label="non-paralyzable")
        axes.plot([], [], "--", color=GRAY, label="paralyzable")
        axes.set_xlabel("Photon rate (1/s)")
        axes.set_ylabel("Count rate (1/s)")
        axes.set_xlim(1e3, 1e10)
        axes.set_ylim(1e3, 3e9)
        axes.legend(loc="upper left", ncols=2)

    return Figure(
        name="fig-2.2",
        title="Figure 2.2: count rate over photon rate with dead time",
        caption=(
            "The curves are stationary means (Eq. 2.5 and 2.6) for four dead times τ. The count "
            "rate ends at 1/τ without and at 1/(e·τ) with paralysis, at one photon per dead time. "
            "The dynamic range reaches from 100 Hz of dark counts to that ceiling, for τ = 100 ns."
        ),
        printed=(
            Printed("Dynamic range, paralyzable", f"{decibel[0]:.0f} dB", "below 100 dB"),
            Printed("Dynamic range, non-paralyzable", f"{decibel[1]:.0f} dB", "below 100 dB"),
        ),
        draw=draw,
        columns=(
            "photon_rate_hz",
            *(f"{kind}_{1e9 * tau:g}_ns_hz" for kind, tau in curves),
        ),
        rows=rows_of(photons, *curves.values()),
    )


def figure_2_9(_: Run) -> Figure:
    """Dark count rate of the row over the bias."""
    density = dark_density(measure_row())
    row = density[_index_of(SHEET_V)]
    quiet = row[row < 1.5]
    ceiling = preset("spadcam").counter_capacity / (preset("spadcam").exposure_s * ACTIVE_UM2)

    def draw(canvas: Canvas) -> None:
        axes = canvas.subplots()
        for pixel in range(PIXELS):
            axes.semilogy(ANODE_V, density[:, pixel], "o-", color=BLUE, alpha=0.55, ms=3, lw=1.2)
        axes.axhline(ceiling, color=GRAY, linestyle="--")
        axes.annotate(
            "counter full", (13.405, ceiling), xytext=(0, 4), textcoords="offset points", color=GRAY
        )
        axes.set_xlabel("Anode voltage (V)")
        axes.set_ylabel("Dark count rate (Hz/µm²)")

    return Figure(
        name="fig-2.9",
        title="Figure 2.9: dark count rate over bias, 16 pixels of one row",
        caption=(
            f"One row of the SPADCAM preset is simulated with {FRAMES} frames of 0.1 s at each "
            f"bias; the rate levels off at {ceiling:.1f} Hz/µm², where the counter is full. "
            "The table is for 13.58 V; another simulated row differs, since the preset meets the "
            "printed statistics over many devices."
        ),
        printed=(
            _statistics("All pixels", row, "1.77, 0.93, 1.77 Hz/µm²"),
            Printed("Pixels below 1.5 Hz/µm²", f"{quiet.size} of {PIXELS}", "11 of 16"),
            _statistics("These", quiet, "0.71, 0.63, 0.32 Hz/µm²"),
        ),
        draw=draw,
        columns=("anode_v", *(f"pixel_{pixel}_hz_um2" for pixel in range(PIXELS))),
        rows=rows_of(ANODE_V, *density.T),
    )


def figure_2_10(_: Run) -> Figure:
    """Cumulative distribution of the dark count rate over the row."""
    density = dark_density(measure_row())
    volts = (13.48, 13.54, 13.58, 13.64, 13.68)
    at = [_index_of(v) for v in volts]
    ranked = [np.sort(np.nan_to_num(density[index])) for index in at]
    share = np.arange(1, PIXELS + 1) / PIXELS
    ceiling = preset("spadcam").counter_capacity / (preset("spadcam").exposure_s * ACTIVE_UM2)
    full = int((ranked[-1] > 0.99 * ceiling).sum())

    def draw(canvas: Canvas) -> None:
        axes = canvas.subplots()
        for index, (v, rates) in enumerate(zip(volts, ranked, strict=True)):
            axes.step(
                np.concatenate(([0.0], rates, [2 * ceiling])),
                np.concatenate(([0.0], share, [1.0])),
                where="post",
                label=f"{v:.2f} V",
                color=PALETTE[index],
                linestyle=DASHES[index],
            )
        axes.set_xlabel("Dark count rate (Hz/µm²)")
        axes.set_ylabel("Share of the pixels")
        axes.set_ylim(0, 1.03)
        axes.set_xlim(0, 9.5)
        axes.legend(title="Anode voltage", loc="lower right")

    return Figure(
        name="fig-2.10",
        title="Figure 2.10: cumulative distribution of the dark count rate over one row",
        caption=(
            "This is the row of Figure 2.9, exposed for 0.1 s at 10 mV a count. The dissertation "
            "does not say at which step and exposure (above 50 ms) its counters were full."
        ),
        printed=(Printed("Counters full at 13.68 V", f"{full} of {PIXELS}", "nearly all of 16"),),
        draw=draw,
        columns=("share", *(f"at_{v:.2f}_v_hz_um2" for v in volts)),
        rows=rows_of(share, *ranked),
    )


def figure_2_11(_: Run) -> Figure:
    """Detection efficiency of the row over the bias."""
    efficiency = measured_efficiency(measure_row())
    sensor = preset("spadcam")
    offsets = breakdown_offset(sensor.bias, (1, PIXELS), sensor.device_seed)[0]
    largest = 100 * np.nanmax(efficiency)

    def draw(canvas: Canvas) -> None:
        axes = canvas.subplots()
        for pixel in range(PIXELS):
            axes.plot(
                ANODE_V, 100 * efficiency[:, pixel], "o-", color=BLUE, alpha=0.55, ms=3, lw=1.2
            )
        axes.set_xlabel("Anode voltage (V)")
        axes.set_ylabel("Detection efficiency (%)")
        axes.set_ylim(0, None)

    return Figure(
        name="fig-2.11",
        title="Figure 2.11: photon detection efficiency over bias, 16 pixels of one row, 450 nm",
        caption=(
            "The efficiency is the bright less the dark counts over the photons on the active "
            f"area, at {PHOTONS_HZ_UM2:g} photons/µm²/s in {FRAMES} frames; a curve ends where a "
            "counter was full. Its height is the preset's, an upper limit."
        ),
        printed=(
            Printed(
                "Bias for equal efficiency, peak to peak",
                f"{1e3 * np.ptp(offsets):.0f} mV",
                "nearly 150 mV",
            ),
            Printed("Bias for equal efficiency, σ", f"{1e3 * offsets.std():.0f} mV", "42 mV"),
            Printed("Largest efficiency", f"{largest:.2f} %", "below 1 % at about 1 V"),
        ),
        draw=draw,
        columns=("anode_v", *(f"pixel_{pixel}" for pixel in range(PIXELS))),
        rows=rows_of(ANODE_V, *efficiency.T),
    )


def figure_2_12(_: Run) -> Figure:
    """Ratio of detections to dark counts over the bias."""
    row = measure_row()
    efficiency, dark_hz = measured_efficiency(row), dark_density(row) * ACTIVE_UM2
    counted = (efficiency > 0) & np.isfinite(dark_hz)
    ratio = np.full_like(dark_hz, np.nan)
    ratio[counted] = 10 * np.log10(efficiency[counted] * SNR_PHOTONS_HZ / dark_hz[counted])
    order = np.argsort(row.dark[_index_of(SHEET_V)])
    chosen = [int(order[rank]) for rank in (0, 5, 10, 13)]
    best = [float(ANODE_V[np.nanargmax(ratio[:, pixel])]) for pixel in chosen]
    most = [float(ANODE_V[np.nanargmax(efficiency[:, pixel])]) for pixel in chosen]
    model = best_excess_bias(preset("spadcam").bias) + ANODE_AT_BREAKDOWN_V

    def draw(canvas: Canvas) -> None:
        axes = canvas.subplots()
        for index, pixel in enumerate(chosen):
            axes.plot(
                ANODE_V, ratio[:, pixel], "o-", color=PALETTE[index], ms=4, label=f"pixel {pixel}"
            )
        axes.axvline(model, color=GRAY, linestyle="--")
        axes.annotate(
            "best bias without mismatch",
            (model, axes.get_ylim()[0]),
            xytext=(6, 6),
            textcoords="offset points",
            color=GRAY,
        )
        axes.set_xlabel("Anode voltage (V)")
        axes.set_ylabel("SNR (dB)")
        axes.legend(loc="upper right")

    return Figure(
        name="fig-2.12",
        title="Figure 2.12: detections over dark counts, 10⁶ photons per pixel and second",
        caption=(
            "The curves are efficiency times photon rate over dark count rate, in power decibels, "
            "of four pixels of Figures 2.9 and 2.11. Without mismatch the ratio is best at "
            f"{model:.2f} V (dashed); a pixel whose breakdown voltage is higher has its best as "
            "much higher, at any photon rate."
        ),
        printed=(
            Printed("Bias of the best ratio", f"{_volts(best)} V", "lower than for efficiency"),
            Printed("Bias of the best efficiency", f"{_volts(most)} V", "—"),
        ),
        draw=draw,
        columns=("anode_v", *(f"pixel_{pixel}_db" for pixel in chosen)),
        rows=rows_of(ANODE_V, *(ratio[:, pixel] for pixel in chosen)),
    )


def table_2_1(_: Run) -> Figure:
    """Devices of the literature: printed figures, and what the presets give when exposed."""
    rows = tuple(_table_row(name) for name in TABLE_2_1)
    columns = (
        "preset",
        "reference",
        "excess_v",
        "area_um2",
        "dcr_hz",
        "printed_hz_um2",
        "simulated_hz_um2",
        "printed_peak_efficiency",
        "simulated_efficiency",
        "peak_nm",
    )

    def draw(canvas: Canvas) -> None:
        head = ("Device", "V_ex, V", "Hz", "µm²", "Hz/µm²", "ours", "peak, %", "ours", "at, nm")
        text = [
            (
                str(row[1]),
                f"{row[2]:g}",
                f"{TABLE_2_1[str(row[0])].limit}{row[4]:g}",
                f"{row[3]:g}",
                f"{row[5]:g}",
                f"{row[6]:.3g}",
                f"{100 * float(row[7]):.0f}",
                f"{100 * float(row[8]):.1f}",
                f"{row[9]:g}",
            )
            for row in rows
        ]
        draw_table(canvas, head, text, (2.4, 1.1, 1.2, 1.3, 1, 1, 1.1, 0.9, 1))

    return Figure(
        name="table-2.1",
        title="Table 2.1: SPADs of the literature, as presets",
        caption=(
            'Columns named "ours" are what the preset of each device measures in 4 s in the dark '
            "and under 10⁵ photons per second on the active area; the others are printed. Limits "
            "(<, >) are taken as values, and the efficiency is that of the peak at every "
            "wavelength. Fill factor and dead time are not in the table and stay the user's."
        ),
        draw=draw,
        columns=columns,
        rows=rows,
        height_in=3.0,
    )


def _table_row(name: str) -> tuple[float | str, ...]:
    device, sensor = TABLE_2_1[name], preset(name)
    photons_hz = 1e5
    rates = np.zeros((2, 40, 40))
    rates[1] = photons_hz * sensor.efficiency.values[0]
    counts = expose_rate(
        rates, changed(sensor, exposure_s=4.0), seed=0, sequence=f"table {name}"
    ).counts.mean((1, 2), dtype=np.float64)
    dark_hz, bright_hz = float(counts[0]) / 4, float(counts[1]) / 4
    return (
        name,
        device.reference,
        device.excess_bias_v,
        device.active_area_um2,
        device.dark_counts_hz,
        device.density_hz_um2,
        dark_hz / device.active_area_um2,
        device.peak_efficiency,
        (bright_hz - dark_hz) / photons_hz,
        device.peak_nm,
    )


def _statistics(which: str, rates: Floats, printed: str) -> Printed:
    """Mean, median and σ of dark count rates (Hz/µm²)."""
    ours = f"{rates.mean():.2f}, {np.median(rates):.2f}, {rates.std():.2f} Hz/µm²"
    return Printed(f"{which}: mean, median, σ", ours, printed)


def _index_of(anode_v: float) -> int:
    return int(np.argmin(np.abs(ANODE_V - anode_v)))


def _volts(values: list[float]) -> str:
    low, high = min(values), max(values)
    return f"{low:.2f}" if low == high else f"{low:.2f} to {high:.2f}"


RECIPES = (
    FigureRecipe("fig-2.2", figure_2_2),
    FigureRecipe("fig-2.9", figure_2_9),
    FigureRecipe("fig-2.10", figure_2_10),
    FigureRecipe("fig-2.11", figure_2_11),
    FigureRecipe("fig-2.12", figure_2_12),
    FigureRecipe("table-2.1", table_2_1),
)
