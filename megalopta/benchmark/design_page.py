"""Page, table and files of a design by bound."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from markupsafe import Markup

from megalopta.benchmark.design import Design, DesignPoint, DesignRow
from megalopta.config.model import level_text
from megalopta.core.files import write_csv
from megalopta.core.quantities import UNDEFINED, number, short, with_error
from megalopta.report import style
from megalopta.report.sections import Section, captioned, write_sections
from megalopta.report.text import level_name

_MEASURES = {"error_px": ("flow", "px"), "error_deg_s": ("yaw rate", "°/s")}
"""What is measured, and its unit"""
_QUANTITIES = {
    "pitch_m": ("pitch", "µm", 1e6),
    "f_number": ("f-number", "", 1.0),
    "pde": ("peak PDE", "%", 100.0),
    "dark_counts_hz": ("dark counts", "Hz", 1.0),
}
"""Name, unit on the page, and its value per unit of the setting"""
_GUIDE = (
    "Least standard error of any unbiased method that knows the texture, at every exposure: flow "
    "of blocks, a component, median over the blocks; yaw rate from the whole view of a camera "
    "that only turns. Methods that have to learn the texture from the same counts need about "
    "twice the photons. Below some hundred photons per block, no method reaches the bound."
)


def table_head(design: Design) -> tuple[str, ...]:
    """Return the heads of the table."""
    titles = (_QUANTITIES[name][:2] for name in design.settings.varied)
    heads = (f"{title} ({unit})" if unit else title for title, unit in titles)
    return ("light", *heads, _aim(design), "least error", "limited by")


def table_cells(design: Design, row: DesignRow) -> tuple[str, ...]:
    """Return a line of that table."""
    _, unit = _MEASURES[design.settings.measure]
    values = (short(value * _QUANTITIES[name][2]) for name, value in row.case.items())
    least = f"{number(row.best_error)} {unit} at {with_error(row.best_exposure_s, 0, 's')}"
    least = least if np.isfinite(row.best_error) else UNDEFINED
    return (level_name(row.level), *values, _exposure(row), least, row.limit or UNDEFINED)


def _exposure(row: DesignRow) -> str:
    return with_error(row.exposure_s, 0, "s") if row.exposure_s else "not reachable"


def write_design(folder: Path, design: Design) -> Path:
    """Write design.html and design.csv, all points, to a folder; return the page."""
    settings = design.settings
    head = ("light_level", *settings.varied, *DesignPoint._fields[2:])
    points = ((level_text(p.level), *p.case.values(), *p[2:]) for p in design.points)
    write_csv(folder / "design.csv", head, points)
    rows = tuple(table_cells(design, row) for row in design.rows)
    charts, cases = [], {tuple(row.case.items()): row.case for row in design.rows}
    for place, case in enumerate(list(cases.values())[:4]):
        of_case = [point for point in design.points if point.case == case]
        chart = _curve_chart(design, of_case, f"errors-{place}")
        charts.append(captioned(chart, _described(case) or design.sensor.name))
    first = [row for row in design.rows if row.case == design.rows[0].case]
    needed = [f"{_exposure(row)} at {level_name(row.level)}" for row in first if row.exposure_s]
    if never := [level_name(row.level) for row in first if not row.exposure_s]:
        needed.append(f"not reachable at {', '.join(never)}")
    aim = ", ".join(filter(None, (_aim(design).capitalize(), _described(first[0].case))))
    summary = f"{aim}: {'; '.join(needed)}."
    about = (
        f"Scene: {design.scene}. The camera turns by {settings.yaw_deg_s:g} °/s, at "
        f"{settings.frame_rate_hz:g} frames per second; velocities are from {settings.frames} "
        f"frames, flow in blocks of {settings.block_px} px."
    )
    sections = [
        Section("Error over exposure", about, charts=tuple(charts)),
        Section(_aim(design).capitalize(), _GUIDE, table_head(design), rows),
    ]
    title = f"Design of {design.sensor.name}"
    return write_sections(folder / "design.html", title, summary, sections)


@style.in_style
def _curve_chart(design: Design, points: Sequence[DesignPoint], name: str) -> Markup:
    """Draw errors over exposures, a line per light level."""
    figure, axes = style.new_axes(style.CHART_PT[0], 320)
    quantity, unit = _MEASURES[design.settings.measure]
    for place, level in enumerate(design.settings.light_levels):
        line = [point for point in points if point.level == level]
        errors = np.array([getattr(point, design.settings.measure) for point in line])
        times_ms = [1e3 * point.exposure_s for point in line]
        shown = np.where(np.isfinite(errors), errors, np.nan)
        axes.plot(times_ms, shown, **style.line_style(place % 7), label=level_name(level))
    axes.axhline(design.settings.target, color=style.BLACK, linewidth=1)
    style.logarithmic(axes, "x", style.NUMBERS)
    style.logarithmic(axes, "y", style.NUMBERS)
    axes.set(xlabel="exposure (ms)", ylabel=f"standard error of {quantity} ({unit})")
    below: dict[str, Any] = {"loc": "upper center", "bbox_to_anchor": (0.5, -0.2), "ncols": 3}
    return style.with_legend(figure, name, "Error over exposure, a line per light level", **below)


def _described(case: Mapping[str, float]) -> str:
    """Return the values of quantities as text: "f-number 1.4, pitch 25 µm"."""
    parts = ((_QUANTITIES[name], value) for name, value in case.items())
    return ", ".join(
        f"{title} {short(value * scale)} {unit}".strip() for (title, unit, scale), value in parts
    )


def _aim(design: Design) -> str:
    return f"exposure for {short(design.settings.target)} {_MEASURES[design.settings.measure][1]}"
