"""Page, table and files of a design by bound."""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np
from markupsafe import Markup
from matplotlib.ticker import FuncFormatter

from megalopta.benchmark.design import Design, DesignPoint, DesignRow
from megalopta.config.model import level_text
from megalopta.core.files import write_csv, write_json
from megalopta.report.sections import Section, captioned, write_sections
from megalopta.report.style import (
    BLACK,
    CHART_PT,
    in_style,
    line_style,
    logarithmic,
    new_axes,
    with_legend,
)
from megalopta.report.text import UNDEFINED, level_name, number, short

_CHARTS = 4
_NUMBERS = FuncFormatter(lambda value, _: f"{value:g}")
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
    heads = (_head(name) for name in design.settings.varied)
    return ("light", *heads, _asked(design), "least error", "limited by")


def table_cells(design: Design, row: DesignRow) -> tuple[str, ...]:
    """Return a line of that table."""
    _, unit = _MEASURES[design.settings.measure]
    values = (_value(name, value) for name, value in row.case.items())
    exposure = _ms(row.exposure_s) if row.exposure_s else "not reachable"
    least = f"{number(row.best_error)} {unit} at {_ms(row.best_exposure_s)}"
    least = least if np.isfinite(row.best_error) else UNDEFINED
    return (level_name(row.level), *values, exposure, least, row.limit)


def write_design(folder: Path, design: Design) -> Path:
    """Write design.html, design.csv and design.json to a folder; return the page."""
    names = tuple(design.settings.varied)
    head = ("light_level", *names, *DesignPoint._fields[2:])
    rows = ((level_text(p.level), *p.case.values(), *p[2:]) for p in design.points)
    write_csv(folder / "design.csv", head, rows)
    record = {
        "sensor": design.sensor.model_dump(mode="json"),
        "settings": design.settings.model_dump(mode="json"),
        "scene": design.scene,
        "rows": [_record(row) for row in design.rows],
    }
    write_json(folder / "design.json", record)
    sections = [
        Section(
            _asked(design).capitalize(),
            _GUIDE,
            table_head(design),
            tuple(table_cells(design, row) for row in design.rows),
        ),
        Section("Error over exposure", charts=tuple(_curves(design))),
        Section("Exposure over the other quantities", charts=tuple(_trades(design))),
    ]
    kept = (each for each in sections if each.rows or each.charts)
    title = f"Design of {design.sensor.name}"
    return write_sections(folder / "design.html", title, _summary(design), kept)


def _summary(design: Design) -> str:
    settings = design.settings
    return (
        f"Scene: {design.scene}. The camera turns by {settings.yaw_deg_s:g} °/s, at "
        f"{settings.frame_rate_hz:g} frames per second; velocities are from {settings.frames} "
        f"frames, flow in blocks of {settings.block_px} px."
    )


def _record(row: DesignRow) -> dict[str, object]:
    """Return a row as JSON; an infinite error is null."""
    error = row.best_error if np.isfinite(row.best_error) else None
    return {**row._asdict(), "best_error": error}


def _curves(design: Design) -> Iterator[Markup]:
    """Yield a chart of errors over exposures for each of the first cases."""
    cases = list({tuple(each.case.items()): each.case for each in design.rows}.values())
    for place, case in enumerate(cases[:_CHARTS]):
        points = [each for each in design.points if each.case == case]
        yield captioned(
            _curve_chart(design, points, f"errors-{place}"), _described(case) or design.sensor.name
        )


@in_style
def _curve_chart(design: Design, points: Sequence[DesignPoint], name: str) -> Markup:
    """Draw errors over exposures, a line per light level."""
    figure, axes = new_axes(*CHART_PT)
    measured = _MEASURES[design.settings.measure]
    for place, level in enumerate(design.settings.light_levels):
        own = [each for each in points if each.level == level]
        errors = np.array([getattr(each, design.settings.measure) for each in own])
        times = [1e3 * each.exposure_s for each in own]
        shown = np.where(np.isfinite(errors), errors, np.nan)
        axes.plot(times, shown, **line_style(place % 7), label=level_name(level))
    axes.axhline(design.settings.target, color=BLACK, linewidth=1)
    logarithmic(axes, "x", _NUMBERS)
    logarithmic(axes, "y", _NUMBERS)
    axes.set(xlabel="exposure (ms)", ylabel="standard error of {} ({})".format(*measured))
    return with_legend(figure, name, "Error over exposure, a line per light level")


def _trades(design: Design) -> Iterator[Markup]:
    """Yield a chart of the exposure needed over each quantity of several values, others first."""
    for name, values in design.settings.varied.items():
        if len(values) > 1:
            others = {k: v[0] for k, v in design.settings.varied.items() if k != name}
            rows = [r for r in design.rows if r.exposure_s and {**r.case, **others} == r.case]
            if rows:
                chart = _trade_chart(design, rows, name)
                yield captioned(chart, _described(others) or design.sensor.name)


@in_style
def _trade_chart(design: Design, rows: Sequence[DesignRow], name: str) -> Markup:
    """Draw the exposure for the stated error over one quantity, a line per light level."""
    figure, axes = new_axes(*CHART_PT)
    for place, level in enumerate(design.settings.light_levels):
        own = sorted((r.case[name], r.exposure_s) for r in rows if r.level == level)
        if own:
            x, y = np.array(own).T * [[_QUANTITIES[name][2]], [1e3]]
            axes.plot(x, y, marker="o", **line_style(place % 7), label=level_name(level))
    logarithmic(axes, "y", _NUMBERS)
    values = [_QUANTITIES[name][2] * value for value in design.settings.varied[name]]
    if min(values) > 0:
        logarithmic(axes, "x", _NUMBERS)
    axes.set_xticks(values, [short(each) for each in values])
    axes.set(xlabel=_head(name), ylabel=f"{_asked(design)} (ms)")
    return with_legend(figure, f"trade-{name.replace('_', '-')}", f"Exposure over {_head(name)}")


def _described(case: Mapping[str, float]) -> str:
    """Return the values of quantities as text: "f-number 1.4, pitch 25 µm"."""
    each = ((_QUANTITIES[name], _value(name, value)) for name, value in case.items())
    return ", ".join(f"{title} {value} {unit}".strip() for (title, unit, _), value in each)


def _value(name: str, value: float) -> str:
    return short(value * _QUANTITIES[name][2])


def _asked(design: Design) -> str:
    return f"exposure for {short(design.settings.target)} {_MEASURES[design.settings.measure][1]}"


def _head(name: str) -> str:
    title, unit, _ = _QUANTITIES[name]
    return f"{title} ({unit})" if unit else title


def _ms(seconds: float) -> str:
    return f"{number(1e3 * seconds)} ms"
