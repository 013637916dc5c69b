"""Table 2.1: devices of the literature, what is printed of them and what their presets measure."""

from collections.abc import Mapping

import numpy as np
from matplotlib.figure import Figure as Canvas

from megalopta.plotting.picture import Cell, Figure, columns_of
from megalopta.plotting.style import draw_table
from megalopta.reproduction.figure_recipe import FigureRecipe, Run
from megalopta.sensor import changed, expose_rate, preset
from megalopta.sensor.spad.presets import TABLE_2_1

_PHOTONS_HZ, _EXPOSURE_S = 1e5, 4.0
_HEAD = ("Device", "V_ex, V", "Hz", "µm²", "Hz/µm²", "ours", "peak, %", "ours", "at, nm")
_WIDTHS = (2.4, 1.1, 1.2, 1.3, 1, 1, 1.1, 0.9, 1)


def _figure(_: Run) -> Figure:
    rows = [_row(name) for name in TABLE_2_1]

    def draw(canvas: Canvas) -> None:
        draw_table(canvas, _HEAD, [_texts(row) for row in rows], _WIDTHS)

    return Figure(
        title="Table 2.1: SPADs of the literature, as presets",
        caption=(
            'Columns named "ours" are what the preset of each device measures in 4 s in the dark '
            "and under 10⁵ photons per second on the active area; the others are printed. Limits "
            "(<, >) are taken as values, and the efficiency is that of the peak at every "
            "wavelength. Fill factor and dead time are not in the table and stay the user's."
        ),
        draw=draw,
        numbers=columns_of(rows),
        height_in=3.0,
    )


def _row(name: str) -> dict[str, Cell]:
    device, sensor = TABLE_2_1[name], changed(preset(name), exposure_s=_EXPOSURE_S)
    rates = np.zeros((2, 40, 40))
    rates[1] = _PHOTONS_HZ * sensor.efficiency.values[0]
    counts = expose_rate(rates, sensor, seed=0, sequence=f"table {name}").counts
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


RECIPES = (FigureRecipe("table-2.1", _figure),)
