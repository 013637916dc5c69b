"""Ranking of the sequences in a folder: from their frames to the long table, its page and files."""

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from itertools import product
from pathlib import Path

import numpy as np

from megalopta.benchmark.methods import Methods, directional_methods, velocity_methods
from megalopta.benchmark.ranking import (
    Change,
    Ranking,
    RankingRow,
    blocks_of,
    changes,
    ranking_rows,
)
from megalopta.benchmark.ranking_charts import (
    atlas,
    error_curves,
    error_ratios,
    flow_fields,
    pooling_grid,
)
from megalopta.benchmark.ranking_settings import NO_POOLING, Pooling, RankingSettings, photons_at
from megalopta.benchmark.sequence_errors import (
    DISTANCES_M,
    HEADING,
    METRICS,
    PARALLAX_PX,
    ROTATION,
    SPEEDS_PX,
    STILL,
    TRUE_YAW,
    YAW,
    YAW_OF_LIGHT,
    Example,
    RankedSequence,
    example_of,
    opposed,
)
from megalopta.benchmark.table import FEWEST_SEQUENCES
from megalopta.benchmark.velocities import LIKELIHOODS, Velocities, photons_per_lux_s
from megalopta.config.model import LightLevel, level_text
from megalopta.config.yaml_model import validated
from megalopta.core import bounded, files
from megalopta.core.errors import UserError
from megalopta.core.folders import check_enclosed, locked
from megalopta.core.format_numbers import check_format
from megalopta.core.progress import progress
from megalopta.dataset.layout import Tree
from megalopta.dataset.store import Dataset, open_sequence
from megalopta.flow.detectors.registry import Method
from megalopta.plotting.picture import write_csv
from megalopta.plotting.sections import Section, write_sections
from megalopta.plotting.text import UNDEFINED, number
from megalopta.scenes.lighting.levels import LEVELS, illuminance_of
from megalopta.stages.ledger import Ledger

NAME = "ranking.json"
EXPOSURES_S = (0.001, 0.01, 0.1)
_NEAR = 3.0
"""Measurements at up to so many times more or fewer photons stand for a level."""
_GROUPS = ("all", "visible", "occluded", "smooth", "depth edge", "parallax low", "parallax high")

_MEASURED = (
    "On perfect pixels. Errors are those of blocks against the true motion, in px of the full "
    "image per frame; a block without velocity counts as one that reports zero motion; means "
    "are over all blocks. Bands hold the mean in 95 % of cases. Speed is low below "
    f"{SPEEDS_PX[0]:g} px, high above {SPEEDS_PX[1]:g} px; parallax, the motion that remains "
    f"without the camera's rotation, below {PARALLAX_PX[0]:g} and above {PARALLAX_PX[1]:g} px; "
    f"distance below {DISTANCES_M[0]:g} and above {DISTANCES_M[1]:g} m."
)
_CHANGES = (
    "Ratios of two methods' mean errors, and what holds them in 95 % of cases: methods change "
    "places where the ratio is above 1 in one group and below 1 in the other. The table holds the "
    "pairs that the rule of Benjamini and Hochberg leaves of all: a twentieth is expected to be "
    "chance. Blocks under rotation alone and of low or high parallax are visible ones; hidden ones "
    "are hidden in the next frame, of sequences in which more than the camera's rotation moves."
)
_ERRORS = (
    "The Poisson bound is the least error of an unbiased method that sees one block at a time, "
    "of known texture, or the motion itself where that is less: methods that share evidence "
    "between blocks may lie below it."
)
_POOLING = (
    "Photons added over squares of pixels and over frames. Pale cells: within the noise of the "
    "measurement another method may be the best."
)
_ATLAS = (
    "The best method without pooling. Gray: none beats zero motion. Pale: not sure. White: not "
    "measured."
)
_LEVELS = (
    "The best method without pooling on perfect pixels, and the photons per frame, of frames "
    "exposed for so long. Light keeps the color that was rendered. Measurements at up to "
    f"{_NEAR:g} times more or fewer photons stand for a level."
)
_FIELDS = (
    "One pair of frames in the middle of the first sequence: hue is direction, saturation speed; "
    "mid gray is no answer."
)
_CAMERA = (
    "Angles between the estimated and the true rotation, and direction of translation, from the "
    "velocities of all blocks of a pair of frames, or as the motion under which the counts of two "
    "frames, or of eight around the pair, are most likely: medians over pairs and sequences."
)
_YAW_RATE = (
    "Root mean square error (deg/s) of the camera's yaw rate from a weighted sum of all answers, "
    "in parentheses that without noise, of the true rate; weights are learned from clean answers "
    "to the first half of a sequence and tried on the second. Methods that are blind to direction "
    "(NDM, NDS, IM) are not ranked."
)


def write_ranking(folder: Path, ranking: Ranking, example: Example) -> Path:
    """Write ranking.html, ranking.csv and ranking.json to a folder; return the page."""
    rows = (row.model_dump().values() for row in ranking.rows)
    write_csv(folder / "ranking.csv", RankingRow.model_fields, rows)
    files.write_text(folder / NAME, ranking.model_dump_json(indent=1) + "\n")
    page = folder / "ranking.html"
    sections = [section(ranking, example) for section in SECTIONS]
    write_sections(page, "Flow methods on rendered sequences", best_methods(ranking), sections)
    return page


def best_methods(ranking: Ranking) -> str:
    """Return a sentence with the method of the lowest error at each number of photons."""
    found = []
    for flux in sorted(ranking.settings.fluxes):
        if best := ranking.best_of(ranking.settings.finest, flux, "all"):
            found.append(f"{number(flux)}: {_named(best)}")
    return f"Lowest mean error by photons per frame: {', '.join(found)}."


def order_changes(ranking: Ranking) -> list[str]:
    """Return how often the order of methods changes beyond chance, and of what this holds."""
    counts = Counter(each.groups.what for each in changes(ranking))
    has_blocks: dict[str, bool] = {}
    for each in opposed(ranking.blocks):
        there = all(ranking.blocks.get(group) for group in each[:2])
        has_blocks[each.what] = has_blocks.get(each.what, False) or there
    cases = ", ".join(
        f"{what} {counts[what] if there else '(no such blocks)'}"
        for what, there in has_blocks.items()
    )
    count = len(ranking.sequences)
    units = "sequences" if count >= FEWEST_SEQUENCES else "stretches of frames of these alone"
    return [
        f"Changes of the order of two methods beyond chance: {cases}.",
        f"Sequences: {count}; intervals are over {units} ({FEWEST_SEQUENCES} or more sequences "
        "stand for others like them).",
    ]


def _measured(ranking: Ranking, _: Example) -> Section:
    rows = (
        ("sequences", str(len(ranking.sequences))),
        ("frames", str(ranking.frames)),
        *((f"blocks: {name}", str(n)) for name, n in ranking.blocks.items() if "," not in name),
    )
    return Section("What was measured", _MEASURED, ("", "number"), rows)


def _changes(ranking: Ranking, _: Example) -> Section:
    head = ("changes with", "photons", "errors of", "in one group", "in the other")
    rows = tuple(map(_change, changes(ranking)))
    text = f"{' '.join(order_changes(ranking))} {_CHANGES}"
    return Section("Where the ranking changes", text, head, rows, (error_ratios(ranking),))


def _change(change: Change) -> tuple[str, ...]:
    first, second = change.first, change.second
    low, high = first.low or 0.0, first.high or 0.0
    back = [1 / each if each else 0.0 for each in (second.value, second.high, second.low)]
    return (
        change.groups.what,
        number(first.photons_per_frame),
        f"{first.method} / {first.against}",
        f"{change.groups.one}: {first.value:.2f} ({low:.2f} to {high:.2f})",
        f"{change.groups.other}: {back[0]:.2f} ({back[1]:.2f} to {back[2]:.2f})",
    )


def _errors(ranking: Ranking, _: Example) -> Section:
    finest = ranking.settings.finest
    groups = (name for name in _GROUPS if ranking.blocks.get(name))
    charts = tuple(error_curves(ranking, finest, group) for group in groups)
    return Section("Errors over photons", _ERRORS, charts=charts)


def _levels(ranking: Ranking, _: Example) -> Section:
    """Return the best method at every named level, and at those that were asked for."""
    settings = ranking.settings
    levels: dict[str, LightLevel] = {
        level_text(each): each for each in (*LEVELS, *settings.light_levels)
    }
    exposures = sorted({*EXPOSURES_S, settings.exposure_s})
    rows = tuple(
        (name, f"{illuminance_of(level):.3g}", *(_lit(ranking, level, t) for t in exposures))
        for name, level in sorted(levels.items(), key=lambda each: -illuminance_of(each[1]))
    )
    head = ("level", "lux", *(f"{exposure:g} s" for exposure in exposures))
    return Section("Light levels", _LEVELS, head, rows)


def _lit(ranking: Ranking, level: LightLevel, exposure_s: float) -> str:
    photons = photons_at(ranking.photons_per_lux_s, level, exposure_s)
    nearest = min(ranking.settings.fluxes, key=lambda each: abs(np.log(each / photons)))
    best = ranking.best_of(ranking.settings.finest, nearest, "all")
    if best is None or abs(np.log(nearest / photons)) > np.log(_NEAR):
        return f"{UNDEFINED} ({number(photons)})"
    return f"{_named(best)} ({number(photons)})"


def _fields(ranking: Ranking, example: Example) -> Section:
    fluxes = sorted(ranking.settings.fluxes)
    found = {name: [each[flux] for flux in fluxes] for name, each in example.found.items()}
    fastest = float(np.nanquantile(np.linalg.norm(example.truth, axis=-1), 0.98))
    chart = flow_fields({"truth": [example.truth], **found}, fluxes, fastest or 1.0)
    return Section("Flow fields", _FIELDS, charts=(chart,))


def _camera(ranking: Ranking, _: Example) -> Section:
    def cell(rotation: float, heading: float | None) -> str:
        return f"{rotation:.2g}°, {UNDEFINED if heading is None else f'{heading:.2g}°'}"

    return _by_photons(ranking, "The camera's motion", _CAMERA, cell, (ROTATION, HEADING))


def _yaw_rate(ranking: Ranking, _: Example) -> Section:
    def cell(counts: float, ideal: float | None, true: float | None) -> str:
        return f"{counts:.2g} ({ideal:.2g}) of {true:.3g}"

    title = "The yaw rate, also of methods without velocities"
    return _by_photons(ranking, title, _YAW_RATE, cell, (YAW, YAW_OF_LIGHT, TRUE_YAW))


SECTIONS: tuple[Callable[[Ranking, Example], Section], ...] = (
    _measured,
    _changes,
    _errors,
    lambda ranking, _: Section("Pooling", _POOLING, charts=(pooling_grid(ranking),)),
    lambda ranking, _: Section("Atlas", _ATLAS, charts=(atlas(ranking),)),
    _levels,
    _fields,
    _camera,
    _yaw_rate,
)
"""The page, from top to bottom"""


def _by_photons(
    ranking: Ranking,
    title: str,
    text: str,
    cell: Callable[..., str],
    metrics: tuple[str, ...],
) -> Section:
    """Return a table of methods by photons; a cell is made of the values of metrics."""
    fluxes = sorted(ranking.settings.fluxes)
    methods = dict.fromkeys(row.method for row in ranking.rows if row.metric == metrics[0])

    def text_of(name: str, flux: float) -> str:
        found = [ranking.found(metric, name, flux) for metric in metrics]
        return cell(*(row and row.value for row in found)) if found[0] else UNDEFINED

    rows = tuple((name, *(text_of(name, flux) for flux in fluxes)) for name in methods)
    head = ("method", *(f"{number(flux)} photons" for flux in fluxes))
    return Section(title, text, head, rows)


def _named(best: RankingRow) -> str:
    method = "no method beats zero motion" if best.method == STILL else best.method
    return method if best.value else f"{method} (not sure)"


FOLDER = "ranking"
"""Where the demo puts it, in the folder of its dataset"""


def read_ranking(folder: Path) -> Ranking | None:
    """Read what `run_ranking` has written to a folder; None where nothing is. Raises UserError."""
    path = folder / NAME
    if not path.exists():
        return None
    try:
        values = bounded.read_json(path)
        check_format("ranking", values, path)
        return Ranking.model_validate(values)
    except (OSError, ValueError, AttributeError):
        raise UserError(f"{path} is damaged; remove it, or rank the methods again") from None


def run_ranking(
    root: str | Path,
    out: str | Path,
    settings: Mapping[str, str] | None = None,
    methods: Sequence[Method] = (),
) -> Path:
    """Rank flow methods on a rendered dataset, of one sequence or many; return the page.

    Settings are values of `RankingSettings` by name, as YAML. In place of their methods others may
    be given: names, detectors, or functions of two frames (`megalopta.flow.detector_from` says of
    what kind). Velocities are kept in OUT/velocities as they are found, so that a broken run, or
    one with another method more, goes on from there. Raises UserError when frames are missing, too
    few or too small, or a setting is wrong.
    """
    out, chosen = Path(out), validated(RankingSettings, {}, "settings", dict(settings or {}))
    datasets = sequences_of(Path(root))
    with locked(out):
        try:
            ranked = velocity_methods(methods or chosen.methods)
            chosen = _with_levels(chosen.model_copy(update={"methods": tuple(ranked)}), datasets)
            ranking, example = _ranked(datasets, chosen, ranked, out / "velocities")
        except ValueError as problem:
            raise UserError(str(problem)) from None
        return write_ranking(out, ranking, example)


def sequences_of(root: Path) -> list[Dataset]:
    """Open the rendered sequences of a folder. Raises UserError."""
    tree = Tree(root)
    check_enclosed(root)
    if not tree.lone:
        datasets = [tree.opened(name)[1] for name in tree.names()]
        if not datasets:
            raise UserError(f"{root}: no finished sequence; run megalopta dataset make")
        return list(datasets)
    dataset = open_sequence(root)
    Ledger(dataset).require("render")
    return [dataset]


def _with_levels(settings: RankingSettings, datasets: Sequence[Dataset]) -> RankingSettings:
    """Add the photons per frame of the light levels to those that are measured."""
    if not settings.light_levels:
        return settings
    per_lux = float(np.mean([photons_per_lux_s(each) for each in datasets]))
    found = [photons_at(per_lux, each, settings.exposure_s) for each in settings.light_levels]
    return settings.model_copy(update={"fluxes": tuple(sorted({*settings.fluxes, *found}))})


def _ranked(
    datasets: Sequence[Dataset], settings: RankingSettings, methods: Methods, folder: Path
) -> tuple[Ranking, Example]:
    """Measure every metric on every sequence; velocities are kept in a folder as they are found."""
    work = sum(_work(dataset, settings, methods) for dataset in datasets)
    parts, lights = [], []
    examples: list[Example] = []
    with progress("Ranking methods", work, "clip") as advance:
        for dataset in datasets:
            velocities = Velocities(dataset, settings, folder / dataset.sequence, advance)
            sequence = RankedSequence(dataset, settings, methods, velocities)
            parts.append(dict(each for metric in METRICS for each in metric(sequence)))
            lights.append(velocities.photons_per_lux_s)
            examples = examples or [example_of(sequence)]
    blocks = blocks_of(parts, settings)
    ranking = Ranking(
        settings=settings,
        sequences=tuple(each.sequence for each in datasets),
        frames=sum(each.configuration.trajectory.frames for each in datasets),
        photons_per_lux_s=float(np.mean(lights)),
        blocks=blocks,
        rows=tuple(ranking_rows(parts, settings, blocks)),
    )
    return ranking, examples[0]


def _work(dataset: Dataset, settings: RankingSettings, methods: Methods) -> int:
    """Return how many clips are measured, after a check that they can be."""
    frames, fewest = dataset.configuration.trajectory.frames, max(settings.frames_pooled)
    if frames < 3 * fewest:
        raise ValueError(
            f"{dataset.sequence} has {frames} frames: frames_pooled {fewest} needs {3 * fewest}"
        )
    camera = dataset.configuration.camera
    for name, method in methods.items():
        for pixels in settings.pixels_pooled:
            try:
                method.grid(Pooling(pixels, 1).shape((camera.height, camera.width)))
            except ValueError as problem:
                raise ValueError(f"pixels_pooled {pixels} for {name}: {problem}") from None
    repeats = range(settings.repeats)
    clips: set[tuple[object, ...]] = set(
        product(methods, settings.poolings, settings.fluxes, repeats)
    )
    wide = directional_methods(methods, settings.wide_field)
    clips |= set(product(wide, (NO_POOLING,), settings.fluxes, (None, 0)))
    return len(clips) + len(settings.fluxes) * len(LIKELIHOODS) * (settings.camera_pairs > 0)
