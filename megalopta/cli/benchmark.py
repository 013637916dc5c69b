"""`megalopta benchmark`: how well methods estimate motion, and how much light they need."""

from argparse import Namespace
from collections.abc import Mapping
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING

from megalopta.cli.command import (
    DATASET,
    SCHEDULER,
    THREADS,
    VERBS,
    Verb,
    at_least,
    numbers,
    option,
    out,
    out_file,
    positive,
    switch,
    verb,
)
from megalopta.cli.settings import VerbSettings
from megalopta.cli.stages import REDO, run_later_stage
from megalopta.core.errors import UserError

if TYPE_CHECKING:
    from megalopta.benchmark.whole_frames import Board

_WIDTH = 150  # width of tables, on any terminal
_UNKNOWN = "–"
_FLUXES = "1,3,10,30,100,1000"
_DRAWS_OF_ONE = 5
_REFERENCE = "DIS"
_OF_SWEEPS = ("allow_code", "out")

VERBS["benchmark"] = Verb("measure how well methods estimate motion, and how much light they need")


_PNG_SCALE = option(
    "--png-scale CODES",
    "codes of a pixel in flow as PNG, which cannot state it: 64 in KITTI, 128 in DSEC",
    positive,
    64.0,
)
_PHOTONS = option("--photons N,N", "mean photons per pixel and frame", numbers, _FLUXES)


@verb(
    "benchmark pairs",
    "rank flow methods over photon levels on photographs, with or without true flow",
    option(
        "paths PATH",
        "two pictures and their flow (.flo or another format); or a folder in the layout of"
        " Middlebury, Sintel, KITTI, Spring, FlyingChairs or a dataset; with --no-truth: two"
        " pictures, a folder of pictures, or a video",
        Path,
        nargs="+",
    ),
    option(
        "--methods A,B",
        "names, module:function or ONNX files; 'DIS tuned' uses settings tuned to the light"
        " (default: all two-frame methods)",
    ),
    _PHOTONS,
    _PNG_SCALE,
    option(
        "--pairs N",
        "largest number of pairs from a folder or video, evenly spaced",
        at_least(1),
        20,
    ),
    option(
        "--draws N",
        f"photon draws per pair (default: 1; {_DRAWS_OF_ONE} for a single pair)",
        at_least(1),
    ),
    switch(
        "--no-truth",
        "true flow is unknown: compare methods with the flow of the noise-free pictures and"
        " with each other",
    ),
    option(
        "--reference METHOD",
        f"with --no-truth: method whose flow of the noise-free pictures replaces true flow"
        f" (default: {_REFERENCE})",
    ),
    option(
        "--unit",
        "with --no-truth: meaning of the values of arrays and 16-bit pictures",
        choices=("srgb", "linear", "cd/m2"),
    ),
    out_file("pairs.csv", "file of the errors"),
)
def _pairs(options: Namespace) -> Path:
    if options.no_truth:
        _pairs_without_truth(options)
        return Path(options.out)
    for name in ("reference", "unit"):
        if getattr(options, name):
            raise UserError(f"benchmark pairs: --{name} needs --no-truth; add that, or omit it")
    from megalopta.benchmark import clips
    from megalopta.benchmark.methods import BLOCK_PX, methods_and_baselines
    from megalopta.benchmark.whole_frames import METRICS, frame_errors, write_board
    from megalopta.core.errors import refused_as
    from megalopta.report.images import evenly_spaced

    if len(options.paths) == 1:
        pairs_below = clips.pairs_below(options.paths[0], options.png_scale)
        pairs = dict(evenly_spaced([*pairs_below.items()], options.pairs))
    elif len(options.paths) == 3:
        *pictures, truth = options.paths
        pairs = {pictures[0].stem: (*pictures, clips.TrueFlow(truth, options.png_scale))}
    else:
        raise UserError(
            f"benchmark pairs: {len(options.paths)} paths; give a folder, or two pictures and"
            " their flow (without flow: --no-truth)"
        )
    methods, draws = _methods_and_draws(options, len(pairs))
    scenes = [clips.read_pair(name, files) for name, files in pairs.items()]
    with refused_as():
        errors = frame_errors(scenes, methods or methods_and_baselines(), options.photons, draws)
    write_board(options.out, errors)
    print(
        f"Errors of blocks of {BLOCK_PX} px{_over(errors)}; with means (px) of those that move"
        " 0–10, 10–40, 40+ px, and of visible and occluded ones, if there are any:"
    )
    _print_tables(errors, METRICS)
    return Path(options.out)


def _pairs_without_truth(options: Namespace) -> None:
    from megalopta.benchmark import whole_frames
    from megalopta.benchmark.methods import BLOCK_PX, block_detector
    from megalopta.benchmark.table import MEAN
    from megalopta.benchmark.whole_frames import FROM_OTHERS, FROM_STAND_IN, METRICS
    from megalopta.report.images import evenly_spaced

    reference = options.reference or _REFERENCE
    with ExitStack() as stack:
        all_pairs = whole_frames.pairs_without_truth(stack, options.paths, options.unit)
        pairs = dict(evenly_spaced([*all_pairs.items()], options.pairs))
        choices = _methods_and_draws(options, len(pairs))
        distances = whole_frames.distances_of_pairs(pairs, options.photons, reference, *choices)
    name = block_detector(reference).name
    stand_in = f"not the truth but {name} on the pictures without noise, which favors {name}"
    whole_frames.write_board(options.out, distances, stand_in)
    print(
        f"NO TRUE FLOW: these are distances, not errors. Blocks of {BLOCK_PX} px{_over(distances)}."
        f"\n\nDistance from the flow of the noise-free pictures by {name}, "
        f"which favors {name} and similar methods:"
    )
    _print_tables(distances, {name: METRICS[of] for of, name in FROM_STAND_IN.items()})
    if len(distances.detectors) > 2:
        print(
            "\nDistance from the median of the other methods on the same photons; methods that "
            "agree may share an error:"
        )
        _print_tables(distances, {FROM_OTHERS[MEAN]: METRICS[MEAN]})


def _methods_and_draws(options: Namespace, pairs: int) -> tuple[list[str] | None, int]:
    draws = options.draws or (_DRAWS_OF_ONE if pairs == 1 else 1)
    return options.methods.split(",") if options.methods else None, draws


def _over(board: "Board") -> str:
    pairs = len(board.scenes)
    return f", mean over {pairs} pairs, 95 % CI over pairs" if pairs > 1 else ""


def _print_tables(board: "Board", metrics: Mapping[str, str]) -> None:
    """Print a table per flux: a row per method, a column per metric that is known of any."""
    from rich.box import SIMPLE
    from rich.console import Console
    from rich.table import Table

    from megalopta.benchmark.table import records

    console = Console(width=_WIDTH)
    means = board.means()
    means = means[means["metric"].isin(metrics)]
    for flux, rows in means.groupby("photons", sort=False):
        known = [name for name in metrics if name in set(rows["metric"])]
        table = Table(f"{flux:g} photons", box=SIMPLE, padding=(0, 1))
        for name in known:
            table.add_column(metrics[name], justify="right")
        cells = dict[tuple[str, str], str]()
        for row in records(rows):
            factor, digits = (100, 1) if "share" in row.metric else (1, 2)
            ends = row.value, row.low, row.high
            value, low, high = (f"{factor * end:.{digits}f}" for end in ends)
            has_ends = row.metric.startswith(("median", "mean_epe_px", "mean_px"))
            is_known = has_ends and row.low == row.low
            cells[row.method, row.metric] = f"{value}\n{low}…{high}" if is_known else value
        for detector in board.detectors:
            table.add_row(
                detector.name, *(cells.get((detector.name, name), _UNKNOWN) for name in known)
            )
        console.print(table)


@verb(
    "benchmark photons",
    "find the photons that detectors need to respond as to noise-free light, on a dataset or in "
    "a sweep",
    option(
        "dataset",
        "dataset folder; or a sweep's YAML file: trial, vary, values, sizes, templates",
        Path,
        metavar="DATASET or SWEEP",
    ),
    REDO,
    switch("--allow-code", "allow a sweep to run the module:function or ONNX file that it names"),
    option("--out", "folder of a sweep's figure (default: out/sweeps)", Path),
    THREADS,
    SCHEDULER,
    settings=VerbSettings(("Configuration", "Sweep"), "benchmark"),
    often=(
        *("methods", "benchmark.sizes", "benchmark.flux_min", "benchmark.flux_max"),
        *("benchmark.fluxes_per_decade", "benchmark.repeats", "vary", "values", "templates"),
    ),
    example="megalopta benchmark photons out/night --methods BM DIS PF",
)
def _photons(options: Namespace) -> object:
    is_sweep = options.dataset.suffix in (".yaml", ".yml") and not options.dataset.is_dir()
    unused = ("redo", "scheduler") if is_sweep else _OF_SWEEPS
    for name in unused:
        if getattr(options, name):
            kind = "a dataset" if is_sweep else "a sweep"
            raise UserError(f"benchmark photons: --{name.replace('_', '-')} is for {kind}; omit it")
    if not is_sweep:
        run_later_stage("benchmark", options)
        return None
    from megalopta.benchmark.trial import load_sweep
    from megalopta.reproduction.sweep_figure import reproduce_sweep

    path, out = options.dataset, options.out or Path("out/sweeps")
    sweep = load_sweep(path, options.overrides, options.allow_code)
    return reproduce_sweep(path.stem, sweep, out, options.workers)


@verb(
    "benchmark sequence",
    "rank flow methods on rendered sequences against the true motion, over photon levels",
    DATASET,
    out("out/ranking"),
    settings=VerbSettings(("RankingSettings",)),
    example="megalopta benchmark sequence out/night --methods BM DIS PF --fluxes 1e4 1e6",
)
def _sequence(options: Namespace) -> Path:
    from megalopta.benchmark.ranking_run import run_ranking

    return run_ranking(options.dataset, options.out, options.overrides)


@verb(
    "benchmark submit",
    "score methods, or flow files of any program, on pictures as they are, without photons",
    option(
        "flows FLOW",
        "folder of flow files (.flo, .flo5, .pfm, .npy or KITTI's PNG, px per frame), laid "
        "out as the truth is, with the expected error (px) of NAME.flo in NAME.uncertainty.npy, "
        "if it is stated; or a method to run on the truth's pictures: a name such as DIS, "
        "module:function or an ONNX file; several are compared",
        nargs="+",
    ),
    option(
        "--truth",
        "folder of the true flow: a dataset, a sealed truth, or one of Sintel, KITTI, "
        "Middlebury, Spring or FlyingChairs",
        Path,
        required=True,
    ),
    option("--inputs", "published inputs of a sealed truth (default: 'inputs' next to it)", Path),
    _PNG_SCALE,
    option("--program", "name of the program that wrote it (default: its folder's name)"),
    out_file("scores.json", "file of the scores"),
)
def _submit(options: Namespace) -> Path:
    from rich.console import Console

    from megalopta.benchmark.scores import score_submissions, score_table
    from megalopta.core import files

    if options.program and len(options.flows) > 1:
        raise UserError("benchmark submit: --program names one flow; give one, or omit it")
    scores = score_submissions(
        options.flows, options.truth, options.program, options.png_scale, options.inputs
    )
    files.write_text(options.out, scores.model_dump_json(indent=1) + "\n")
    Console(width=_WIDTH + 40, markup=False, emoji=False).print(score_table(scores))
    return Path(options.out)


@verb(
    "benchmark seal",
    "split a rendered dataset for a challenge: inputs to publish, and truth to keep, with hashes",
    DATASET,
    out("out/challenge", "new folder for inputs/ and truth/"),
)
def _seal(options: Namespace) -> Path:
    from megalopta.benchmark.seal import seal_dataset

    return seal_dataset(options.dataset, options.out)


@verb(
    "design",
    "find the exposure at which a sensor can measure flow or yaw rate to a stated error, over "
    "pitch, aperture, efficiency and dark counts, without drawing photons",
    option("sensor", "preset of a counting sensor, or its YAML file"),
    option(
        "--dataset",
        "rendered dataset of one sequence, whose first frame is the scene (default: dead leaves)",
        Path,
    ),
    out("out/design"),
    settings=VerbSettings(("DesignSettings",)),
    often=(
        *("error", "light_levels", "exposure_s", "pitch_m", "f_number", "pde", "dark_counts_hz"),
        *("yaw_deg_s", "frame_rate_hz"),
    ),
    example="megalopta design array-12x4 --error 0.1px --light-levels full_moon starlight "
    "--f-number 1 1.4 2",
)
def _design(options: Namespace) -> Path:
    from rich.console import Console
    from rich.table import Table

    from megalopta.benchmark.design import DesignSettings, design
    from megalopta.benchmark.design_page import table_cells, table_head, write_design
    from megalopta.config.yaml_model import validated

    settings = validated(DesignSettings, {}, "settings", options.overrides)
    found = design(options.sensor, options.dataset, **dict(settings))
    table = Table(*table_head(found))
    for row in found.rows:
        table.add_row(*table_cells(found, row))
    Console(width=120, markup=False).print(table)
    return write_design(options.out, found)
