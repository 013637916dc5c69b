"""The page of a ranking: errors by method and light beside their charts, then by motion."""

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pandas as pd
from markupsafe import Markup

from megalopta.benchmark import ranking as ranked, table
from megalopta.benchmark.curves import BOUND, LEGEND, METRICS, error_chart
from megalopta.benchmark.ranking import Ranking, RankingFacts
from megalopta.core.files import write_text
from megalopta.core.quantities import UNDEFINED, number, percent, with_error
from megalopta.report import sections
from megalopta.report.text import level_name
from megalopta.stages.noise_warning import LIMIT

_GROUPS = (
    *("visible", "occluded", "smooth", "depth edge"),
    *("parallax low", "parallax high", "speed low", "speed high"),
)

_ERRORS = "Of blocks, with 95 % CI. Bold: significantly (95 %) lower than every other method's."
_SCOPE = (
    "Pixels are perfect. A block without a velocity counts as zero motion. Sequences: {}; frames: "
    "{}; confidence intervals are over {}. One lux for a second gives a frame {} photons."
)
_BY_MOTION = "Parallax is the motion that remains without the camera's rotation."
_BOUND = (
    "The Poisson bound is the least error of an unbiased method that sees one block of known "
    "texture at a time, or the motion itself if that is smaller. Methods that share evidence "
    "between blocks, or are biased, may be below it."
)


def write_ranking(folder: Path, ranking: Ranking) -> Path:
    """Write ranking.html, ranking.json, ranking.csv and ranking-sequences.csv; return the page."""
    facts, tables = ranking.facts, {"ranking.csv": ranking.rows}
    if ranking.samples is not None:
        values = ranking.samples.assign(value=ranking.samples["total"] / ranking.samples["blocks"])
        values[["sequence", "part"]] = values["unit"].str.rsplit(" ", n=1, expand=True)
        tables["ranking-sequences.csv"] = values.drop(columns=["unit", "total"]).dropna()
    for name, rows in tables.items():
        per_px = rows["photons"] / facts.frame_px
        noise = rows["photons"].map(facts.rendering_noise)
        long_table = rows.assign(photons_per_px=per_px, rendering_noise=noise)
        write_text(folder / name, long_table.to_csv(index=False, float_format="%.9g"))
    write_text(folder / "ranking.json", facts.model_dump_json(indent=1) + "\n")
    page = [_errors(ranking)]
    if charts := group_charts(ranking):
        page.append(
            sections.Section("Errors by motion", _BY_MOTION, body=sections.block("pair", *charts))
        )
    title = "Flow methods on rendered sequences"
    header = sections.paragraph(caution(facts), "warn")
    return sections.write_sections(
        folder / "ranking.html", title, verdict(ranking), page, header=header
    )


def verdict(ranking: Ranking) -> str:
    """Return who is first by mean error at which light, and where that may be chance."""
    best, facts = ranking.best(), ranking.facts
    leads = best.groupby("method", sort=False)["photons"]
    first = "; ".join(f"{name} at {', '.join(map(facts.light, at))}" for name, at in leads)
    unsure = [*map(facts.light, best.loc[~best["surely_lowest"], "photons"])]
    chance = f" The lead may be chance at {', '.join(unsure)}." if unsure else ""
    return f"Lowest mean error: {first} {facts.unit[0]}.{chance}"


def below_bound(ranking: Ranking) -> str:
    """Return which methods are below the Poisson bound, and why that may be; empty for none."""
    rows = ranking.rows_of(table.MEAN)
    bound = rows[rows["method"] == BOUND].set_index("photons")["value"]
    below = rows[rows["value"] < rows["photons"].map(bound)]["method"].unique()
    return f"Below the Poisson bound: {', '.join(below)}. {_BOUND}" if len(below) else ""


def caution(facts: RankingFacts) -> str:
    """Return a warning of lights at which rendering noise rivals shot noise; empty for none."""
    if not facts.noisy_fluxes or not facts.rendering_photons_per_px:
        return ""
    unit, flag, per_unit = facts.unit
    ends = dict.fromkeys((facts.noisy_fluxes[0], facts.noisy_fluxes[-1]))
    noise = [f"{number(facts.rendering_noise(flux))} times at {facts.light(flux)}" for flux in ends]
    free = number(LIMIT * facts.frame_px * facts.rendering_photons_per_px / per_unit)
    return (
        "Caution: errors are partly of rendering noise, which no camera has. Its variance is "
        f"{' to '.join(noise)} {unit} (marked *) that of shot noise. Give lower {flag}, up to "
        f"{free}, or raise --render.samples-per-pixel by ten times that factor (baked light: "
        "lower --render.bake-error)."
    )


def _errors(ranking: Ranking) -> sections.Section:
    """Return the errors by method and light beside their charts, and differences of means."""
    facts, settings = ranking.facts, ranking.facts.settings
    levels = {
        ranked.photons_at(facts.photons_per_lux_s, level, settings.exposure_s): level
        for level in settings.light_levels
    }
    heads = []
    for flux in settings.fluxes:
        light = facts.light(flux) + " *" * (flux in facts.noisy_fluxes)
        per_px = "" if settings.photons else f"{number(flux / facts.frame_px)} per px"
        level = level_name(levels[flux]) if flux in levels else ""
        heads.append(Markup("<br>").join(filter(None, (light, level, per_px))))

    def by_light(label: str, rows: pd.DataFrame, text: Callable[[Any], str]) -> Markup:
        cells = {(row.method, row.photons): text(row) for row in table.records(rows)}
        lines = (
            [name, *(cells.get((name, flux), UNDEFINED) for flux in settings.fluxes)]
            for name in dict.fromkeys(rows["method"])
        )
        numbers = sections.table(label, (facts.unit[0], *heads), lines)
        return sections.block("", sections.heading(label), numbers)

    def with_interval(row: Any) -> Markup:
        write = percent if row.metric == table.FAR else number
        value = Markup("<b>{}</b>" if row.surely_lowest else "{}").format(write(row.value))
        ends = [f"{write(row.low)} to {write(row.high)}"] if math.isfinite(row.low) else []
        return Markup("<br>").join([value, *ends])

    body = []
    for metric, label in METRICS.items():
        rows = ranking.rows_of(metric)
        chart = error_chart(rows, metric, facts.unit, "all blocks", rows)
        beside = "pair" if len(heads) < 3 else ""  # tables of more are too wide
        body.append(sections.block(beside, by_light(label, rows, with_interval), chart))
    means, none = ranking.rows_of(table.MEAN), ranking.rows_of(table.NONE).query("value > 0")
    label = f"difference of means from {settings.against or 'the best'} (px; ± 95 % CI, paired)"
    body.append(
        by_light(label, means, lambda row: with_error(row.difference, row.difference_half, ""))
    )
    if len(none):
        body.append(by_light("share without a velocity", none, lambda row: percent(row.value)))
    count = len(facts.sequences)
    units = "sequences" if count >= ranked.FEWEST_SEQUENCES else "parts of these sequences only"
    scope = _SCOPE.format(count, facts.frames, units, number(facts.photons_per_lux_s))
    body.append(sections.paragraph(f"Bars are 95 % CI. {LEGEND} {_BOUND} {scope}", "note"))
    return sections.Section("Errors", _ERRORS, body=Markup("\n").join(body))


def group_charts(ranking: Ranking) -> list[Markup]:
    """Draw mean errors over photons, a figure per group of blocks, on one scale."""
    blocks = ranking.facts.blocks
    rows = {
        f"{name}: {blocks[name]} blocks": ranking.rows_of(table.MEAN, name)
        for name in _GROUPS
        if 0 < blocks.get(name, 0) < blocks["all"]
    }
    like = pd.concat([ranking.rows_of(table.MEAN), *rows.values()])
    unit = ranking.facts.unit
    return [error_chart(group, table.MEAN, unit, name, like) for name, group in rows.items()]
