"""Page, figures and tables of a comparison of cameras."""

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from markupsafe import Markup
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter

from megalopta.benchmark import table
from megalopta.benchmark.cameras import AS_SOLD, IDEAL, OF_EVENTS, TRANSMISSION, Comparison
from megalopta.core.files import write_text
from megalopta.core.quantities import number, percent, short
from megalopta.report import style
from megalopta.report.sections import Section, folded, paragraph, write_sections
from megalopta.report.text import lux
from megalopta.scenes.levels import illuminance_of

METRICS = {
    "error": ("mean_um", "motion_um", "mean error, share of the motion"),
    "information": ("information_mm4", "ideal_mm4", "information, share of an ideal detector's"),
    "bound": ("bound_um", "motion_um", "bound of blocks, share of the motion"),
    "median": ("median_um", "motion_um", ""),
}
"""Columns, whose sums are divided, and label"""
_ABOUT = (
    "One lens (f/{}, transmission {}), one image {} mm wide, one frame rate; each camera exposes "
    "for as long as gives it most information. Mean motion on the die, µm per frame: {}. "
    "Intervals (95 %) are over {} pairs of frames, and hold for these flights alone: those of the "
    "ratio to the ideal detector on the same pairs; for that detector, of the error itself."
)
_CELLS = (
    "The mean error, its interval and method; the median error; the bound; the information (I) as "
    "a share of an ideal detector's; the data rate per mm². Bold: no camera is surely better."
)
_WHAT_IF = (
    "If all had one pitch, with the fill factor, efficiency and noise of a pixel as sold. Nobody "
    "sells these; they separate the effect of size from that of noise."
)
_CAVEATS = (
    "Sizes of dies are not compared: with the same view and f-number, photons grow with the area "
    "of the image, so that a larger die moves every value in lux. Lux are those on open ground. "
    "Each camera has one operating point; in bright light one would lower an EM gain. Each exposes "
    "once a frame, though many could expose more often and sum. Arrays of one bit deliver all "
    "binary frames. Fill factors and efficiencies are those of the presets; microlenses lose part "
    "of theirs at small f-numbers. Light has the bands of the rendering, 400 to 700 nm in the "
    "default flights; starlight is redder, which favors silicon with efficiency in the near "
    "infrared. EMCCD, sCMOS and qCMOS are cooled, others not; where a source states no dark "
    "current there is none. Arrays with color filters as sold count as bare. Telegraph noise is "
    "left out, rolling shutters count as global, fixed patterns as known. Noise of the rendering, "
    "in the default flights fixed on surfaces, counts as texture. Information and bound suppose "
    "known texture, which favors fine pixels in the dark; the bound is for blocks of 160 µm, and "
    "methods share evidence between them. Event cameras: 64 bits an event (x, y, time, polarity), "
    f"one setting of biases, pictures of net events ({' or '.join(OF_EVENTS)}). Prices and depth "
    "of focus are not compared."
)
_FACTS = ["method", "exposure_s", "frames", "bits_s_mm2"]


def summary(comparison: Comparison) -> pd.DataFrame:
    """Return value and interval of `METRICS` by camera, light and pixels, by the best method.

    Intervals are those of the ratio to the ideal detector on the same pairs of frames, times its
    value; for that detector, of the value itself. `is_best`: known, and no other camera, without
    the ideal one, is surely better.
    """
    rows = comparison.rows.assign(lux=comparison.rows["level"].map(illuminance_of))
    case, pair = ["pixels", "lux", "sensor"], ["pixels", "lux", "scene", "pair"]
    errors = rows.groupby([*case, "method"], as_index=False)["mean_um"].mean()
    rows = rows.merge(errors.loc[errors.groupby(case)["mean_um"].idxmin(), [*case, "method"]])
    ideal = rows[rows["sensor"] == IDEAL].set_index(pair)["information_mm4"].rename("ideal_mm4")
    rows, lines = rows.join(ideal, on=pair), []
    for (pixels, in_lux), cameras in rows.groupby(["pixels", "lux"], sort=False):
        facts = cameras.groupby("sensor", sort=False)[_FACTS].first()
        for metric, (total, area, _) in METRICS.items():
            columns = {"method": cameras["sensor"], "total": cameras[total]}
            sums = table.by_method(cameras.assign(**columns, blocks=cameras[area]))
            values = {name: table.mean(of_camera) for name, of_camera in sums.items()}
            real = [name for name, value in values.items() if name != IDEAL and np.isfinite(value)]
            order = -1 if metric == "information" else 1
            best = min(real, key=lambda name: order * values[name], default=IDEAL)
            for name, of_camera in sums.items():
                scale, to_ideal = values[IDEAL], table.ratio(of_camera, sums[IDEAL])
                if name == IDEAL:
                    scale, to_ideal = 1.0, table.interval(of_camera)
                _, low, high = to_ideal or table.Interval(np.nan)
                worse = table.ratio(*(of_camera, sums[best])[::order])
                is_best = name in real and not (worse and worse.low > 1)
                known = values[name], scale * low, scale * high, is_best
                lines.append((pixels, in_lux, name, metric, *known, *facts.loc[name]))
    heads = "metric", "value", "low", "high", "is_best"
    return pd.DataFrame(lines, columns=[*case, *heads, *_FACTS])


def write_cameras(folder: Path, comparison: Comparison) -> Path:
    """Write cameras.html, cameras.csv (`summary`) and pairs.csv to a folder; return the page."""
    means, rows, settings = summary(comparison), comparison.rows, comparison.settings
    for name, lines in (("cameras", means), ("pairs", rows)):
        write_text(folder / f"{name}.csv", lines.to_csv(index=False, float_format="%.6g"))
    motions = rows.groupby("scene")["motion_um"].mean().items()
    about = _ABOUT.format(
        *(short(settings.f_number), TRANSMISSION, short(settings.image_mm)),
        ", ".join(f"{scene} {number(um)}" for scene, um in motions),
        len(rows[["scene", "pair"]].drop_duplicates()),
    )
    sections = []
    for pixels, part in means.groupby("pixels", sort=False):
        heads = ("camera", *map(lux, sorted(part["lux"].unique())))
        cells = tuple((str(name), *_cells(of)) for name, of in part.groupby("sensor", sort=False))
        charts = tuple(_chart(part, metric) for metric in ("error", "information", "bound"))
        text = about if pixels == AS_SOLD else _WHAT_IF
        sections.append(Section(f"Pixels {pixels}", text, charts=charts))
        sections.append(Section(f"Errors of pixels {pixels}", _CELLS, heads, cells))
    sources = []
    for sensor in comparison.sensors:
        assumed = f" Assumed: {'; '.join(sensor.assumed)}." if sensor.assumed else ""
        pitch = f"{sensor.name} ({number(1e6 * sensor.pitch_m)} µm)"
        sources.append(paragraph(f"{pitch}: {sensor.source}.{assumed}"))
    sections.append(Section("Cameras", body=folded("Sources, and what is assumed", *sources)))
    sections.append(Section("Not compared", _CAVEATS))
    outcome = (
        f"Least mean error, as a share of the motion: {verdict(means, 'error')}. Most information "
        f"per area, as a share of an ideal detector's: {verdict(means, 'information')}."
    )
    title = "Which camera sees the motion"
    return write_sections(folder / "cameras.html", title, outcome, sections)


def verdict(means: pd.DataFrame, metric: str) -> str:
    """Return the best camera as sold at each light, and those not surely worse."""
    parts, best = [], means[(means["pixels"] == AS_SOLD) & means["is_best"]]
    for in_lux, cameras in best[best["metric"] == metric].groupby("lux"):
        ranked = cameras.sort_values("value", ascending=metric != "information")
        first, *tied = ranked["sensor"]
        also = f"; not surely better than {', '.join(tied)}" if tied else ""
        value = percent(ranked["value"].iloc[0])
        parts.append(f"at {lux(float(str(in_lux)))} {first} ({value}{also})")
    return ", ".join(parts)


def _cells(means: pd.DataFrame) -> list[Markup]:
    cells = []
    for _, at_light in means.groupby("lux"):
        error, information, bound, median = table.records(at_light)
        value = Markup("<b>{}</b>" if error.is_best else "{}").format(percent(error.value))
        ends = f"{100 * error.low:.0f}–{100 * error.high:.0f} %"
        spread = f"median {percent(median.value)}", f"bound {percent(bound.value)}"
        figures = f"I {percent(information.value)}", f"{number(1e-6 * error.bits_s_mm2)} Mbit/s"
        lines = value, ends, error.method, *spread, *figures
        cells.append(Markup("<br>").join(lines).replace(" ", "\u00a0"))
    return cells


@style.in_style
def _chart(means: pd.DataFrame, metric: str) -> Markup:
    figure = Figure(figsize=(5.28, 4.6), layout="constrained")
    draw_curves(figure, means, metric)
    return style.to_svg(figure, f"{metric}-{means['pixels'].iloc[0]}", METRICS[metric][2])


def draw_curves(figure: Figure, means: pd.DataFrame, metric: str) -> None:
    """Draw a metric over light, which falls to the right: a line a camera, with its interval."""
    axes, shown = figure.add_subplot(), means[means["metric"] == metric]
    low, high = (1e-3, 1.2) if metric == "information" else (0.01, 1.6)
    darkest, brightest = shown["lux"].min(), shown["lux"].max()
    style.logarithmic(axes, "x", style.NUMBERS)
    style.logarithmic(axes, "y", FuncFormatter(lambda share, _: percent(share)))
    axes.set(xlabel="light (lux)", ylabel=METRICS[metric][2], xlim=(brightest, darkest))
    axes.set_ylim(max(low, 0.8 * shown["value"].min()), high)
    lines: list[tuple[float, Line2D]] = []
    for place, (name, curve) in enumerate(shown.groupby("sensor", sort=False), -1):
        curve = curve.sort_values("lux")
        look: dict[str, Any] = {"color": style.GRAY, "linestyle": ":"}
        if name != IDEAL:
            look = {"color": style.PALETTE[place % 7], "linestyle": style.DASHES[place // 7]}
            ends = curve["lux"], curve["low"], curve["high"]
            axes.fill_between(*ends, color=look["color"], alpha=0.15, linewidth=0)
        if curve["value"].notna().any():
            (line,) = axes.plot(curve["lux"], curve["value"], label=name, **look)
            lines.append((-curve["value"].iloc[0], line))
    handles = [line for _, line in sorted(lines, key=lambda end: end[0])]
    shape = {"ncols": 3, "handlelength": 1.5, "columnspacing": 1.0}
    figure.legend(handles=handles, loc="outside lower left", **shape)
