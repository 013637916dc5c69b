"""`megalopta benchmark`: how well methods estimate motion, and how much light they need."""

from argparse import Namespace
from collections.abc import Iterator
from contextlib import ExitStack
from itertools import product
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
    from megalopta.benchmark.clips import Files
    from megalopta.benchmark.whole_frames import Board

_WIDTH = 170  # width of tables, on any terminal

VERBS["benchmark"] = Verb("measure how well methods estimate motion, and how much light they need")


_PNG_SCALE = option(
    "--png-scale CODES",
    "codes of a pixel in flow as PNG, which cannot state it: 64 in KITTI, 128 in DSEC",
    positive,
    64.0,
)


@verb(
    "benchmark pairs",
    "rank flow methods over photon levels on photographs, with or without true flow",
    option(
        "paths PATH",
        "folders, in the layout of Middlebury, Sintel, KITTI, Spring, FlyingChairs or a dataset;"
        " or two pictures and their flow (.flo or another format); with --no-truth: two"
        " pictures, a folder of pictures, or a video",
        Path,
        nargs="+",
    ),
    option(
        "--methods A,B",
        "names, module:function or ONNX files; 'DIS tuned' uses settings tuned to the light"
        " (default: all two-frame methods, tuned if possible)",
    ),
    option("--photons N,N", "mean photons per pixel and frame", numbers, "1,3,10,30,100,1000"),
    _PNG_SCALE,
    option("--pairs N", "most pairs of a set or of a video, evenly spaced", at_least(1), 20),
    option("--draws N", "photon draws per pair (default: 1; 5 of a single pair)", at_least(1)),
    option(
        "--disturb A,B",
        "also measure with disturbances, such as ramp20,vignette,shadow,dispersion5,mismatch,warm,"
        "rendering; may be repeated",
        action="append",
    ),
    switch("--no-truth", "true flow is unknown: compare with noise-free flow, and with each other"),
    option("--reference METHOD", "with --no-truth: method of the noise-free flow (default: DIS)"),
    option(
        "--unit",
        "with --no-truth: meaning of the values of arrays and 16-bit pictures",
        choices=("srgb", "linear", "cd/m2"),
    ),
    out_file("pairs.csv", "file of the errors"),
)
def _pairs(options: Namespace) -> Path:
    for name in ("reference", "unit"):
        if getattr(options, name) and not options.no_truth:
            raise UserError(f"benchmark pairs: --{name} needs --no-truth; add that, or omit it")
    from megalopta.benchmark import whole_frames
    from megalopta.benchmark.clips import read_pair
    from megalopta.benchmark.disturbances import disturbance
    from megalopta.benchmark.methods import block_detector, methods_and_baselines, velocity_methods
    from megalopta.core.errors import refused_as
    from megalopta.core.progress import say
    from megalopta.report.images import evenly_spaced

    with ExitStack() as stack, refused_as():
        names = filter(None, ",".join(options.disturb or ()).split(","))
        disturbances = list(dict.fromkeys(map(disturbance, names)))
        names_of_methods = options.methods.split(",") if options.methods else ()
        methods = velocity_methods(names_of_methods or methods_and_baselines()).values()
        if options.no_truth:
            reference = block_detector(options.reference or "DIS")
            pictures = whole_frames.pairs_without_truth(stack, options.paths, options.unit)
            pictures = dict(evenly_spaced([*pictures.items()], options.pairs))
            clips, count = whole_frames.clips_without_truth(pictures, reference), len(pictures)
        else:
            files = list(_files_of_pairs(options))
            for pair in files:  # a fault is reported before the work
                for note in read_pair(*pair).notes:
                    say(note)
            clips, count = (read_pair(*pair) for pair in files), len(files)
        draws = options.draws or (5 if count == 1 else 1)
        board = whole_frames.frame_errors(
            clips, [*methods], options.photons, draws, disturbances, count
        )
    over = ", mean over pairs" if count > 1 else ""
    heads = {metric: head for metric, (head, *_) in whole_frames.METRICS.items()}
    if options.no_truth:
        stand_in = f"{reference.name} on the pictures without noise, which favors {reference.name}"
        whole_frames.write_board(options.out, board, f"not the truth but {stand_in}")
        print(
            f"NO TRUE FLOW: these are distances, not errors, of all pixels{over}.\n\nFrom the flow "
            f"by {stand_in}; last, from the median of the other methods, which may share an error:"
        )
        heads |= {whole_frames.FROM_OTHERS: "others px"}
    else:
        whole_frames.write_board(options.out, board)
        print(f"Errors of all pixels{over}; means by motion (px) and by occlusion:")
    _print_tables(board, heads)
    return Path(options.out)


def _files_of_pairs(options: Namespace) -> "Iterator[tuple[str, Files, str, str]]":
    """Yield name, files, set and sequence of the pairs to measure."""
    from megalopta.benchmark import clips
    from megalopta.report.images import evenly_spaced

    paths, scale = options.paths, options.png_scale
    if len(paths) == 3 and not any(path.is_dir() for path in paths):
        name = "/".join(paths[0].resolve().with_suffix("").parts[-2:])
        yield name, (*paths[:2], clips.TrueFlow(paths[2], scale)), "", ""
        return
    if len(paths) > 1 and not all(path.is_dir() for path in paths):
        raise UserError(
            f"benchmark pairs: {len(paths)} paths; give folders, or two pictures and their flow"
            " (without flow: --no-truth)"
        )
    names = [path.resolve().name for path in paths]
    homes = dict[Path, Path]()
    for path, name in zip(paths, names, strict=True):
        alone = name if names.count(name) == 1 else path.as_posix()
        for pass_name, pairs in clips.sets_below(path, scale).items():
            for pair, files in evenly_spaced([*pairs.items()], options.pairs):
                if (home := homes.setdefault(files[0], path)) != path:
                    raise UserError(f"{home} and {path} both hold {files[0]}; give one of them")
                sequence = f"{alone} {clips.sequence_of(pair)}"
                yield pair, files, f"{alone} {pass_name}".strip(), sequence


def _print_tables(board: "Board", heads: dict[str, str]) -> None:
    """Print a table per set and flux: a row per method, a column per metric that is known of any.

    Methods of the least mean error come first. Disturbances have a column for the mean error.
    """
    from rich.box import SIMPLE
    from rich.console import Console
    from rich.table import Table

    from megalopta.benchmark.table import MEAN, MEDIAN, records

    (undisturbed, *groups), fluxes = (
        board.by_scene[name].unique() for name in ("group", "photons")
    )
    console = Console(width=_WIDTH + 14 * len(groups))
    median, mean, *others = heads.values()
    above = "above least\nmean px"
    columns = [median, mean, above, *others, *(f"{group}\nmean px" for group in groups)]
    for (set_name, heading), flux in product(board.parts().items(), fluxes):
        cells, means, spread = {}, board.means(set_name, flux), board.units(set_name)[1]
        means = means.sort_values("above_px", kind="stable", na_position="last")
        for row in records(means):
            factor, digits = (100, 1) if "share" in row.metric else (1, 2)
            ends = (factor * end for end in (row.value, row.low, row.high))
            value, low, high = (f"{end:.{digits}f}" if end < 1e4 else f"{end:.0e}" for end in ends)
            if row.group == undisturbed:
                has_ends = row.metric in (MEDIAN, MEAN) and row.low == row.low
                cell = f"{value}\n{low}…{high}" if has_ends else value
                cells[row.method, heads.get(row.metric, "")] = cell
                if row.metric == MEAN:
                    half = f" ± {row.above_half_px:.2f}" * (row.above_half_px > 0)
                    cells[row.method, above] = f"{row.above_px:.2f}{half}"
            elif row.metric == MEAN:
                cells[row.method, f"{row.group}\nmean px"] = value
        table = Table(box=SIMPLE, padding=(0, 1))
        photons = f"{flux:g} photon{'' if flux == 1 else 's'} per px"
        table.add_column("\n".join(filter(None, (f"{heading}, {photons}", spread))), no_wrap=True)
        known = [column for column in columns if column in {place for _, place in cells}]
        for column in known:
            table.add_column(column, justify="right")
        for method in means["method"].unique():
            table.add_row(method, *(cells.get((method, column), "–") for column in known))
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
    kind = "a dataset" if is_sweep else "a sweep"
    for name in ("redo", "scheduler") if is_sweep else ("allow_code", "out"):
        if getattr(options, name):
            raise UserError(f"benchmark photons: --{name.replace('_', '-')} is for {kind}; omit it")
    if not is_sweep:
        run_later_stage("benchmark", options)
        return None
    from megalopta.benchmark.trial import load_sweep
    from megalopta.reproduction.sweep_figure import reproduce_sweep

    sweep = load_sweep(options.dataset, options.overrides, options.allow_code)
    out = options.out or Path("out/sweeps")
    return reproduce_sweep(options.dataset.stem, sweep, out, options.workers)


@verb(
    "benchmark sequence",
    "rank flow methods on rendered sequences against the true motion, over photon levels",
    DATASET,
    out("out/ranking"),
    settings=VerbSettings(("RankingSettings",)),
    example="megalopta benchmark sequence out/night --methods BM DIS PF --fluxes 1e4 1e6",
)
def _sequence(options: Namespace) -> Path:
    import pandas as pd

    from megalopta.benchmark.ranking_run import run_ranking
    from megalopta.benchmark.table import MEAN, NONE

    page = run_ranking(options.dataset, options.out, options.overrides)
    rows = pd.read_csv(page.with_suffix(".csv")).query("group == 'all'")
    for metric, head in ((MEAN, "mean endpoint error, px"), (NONE, "share without a velocity")):
        of_metric = rows[rows["metric"] == metric]
        if metric == MEAN or of_metric["value"].any():
            values = of_metric.pivot(index="method", columns="photons_per_px", values="value")
            print(f"{head}\n{values.to_string(float_format='%.3g'.__mod__)}\n")
    return page


@verb(
    "benchmark submit",
    "score methods, or flow files of any program, on pictures as they are, without photons",
    option(
        "flows FLOW",
        "folders of flow files (.flo, .flo5, .pfm, .npy or KITTI's PNG, px per frame), laid out as "
        "the truth, with NAME.uncertainty.npy (px) beside NAME.flo if known; or methods to run on "
        "the truth's pictures: names such as DIS, module:function or ONNX files",
        nargs="+",
    ),
    option("--truth", "dataset, sealed truth or another folder of true flow", Path, required=True),
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
    option("sensor", "preset of a SPAD array or frame camera, or its YAML file"),
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
    designed = design(options.sensor, options.dataset, **dict(settings))
    table = Table(*table_head(designed))
    for row in designed.rows:
        table.add_row(*table_cells(designed, row))
    Console(width=120, markup=False).print(table)
    return write_design(options.out, designed)


@verb(
    "benchmark cameras",
    "compare cameras behind one lens on the same flights, from daylight to starlight: flow error, "
    "bound, information and data rate",
    option(
        "scenes SCENE",
        "rendered datasets, or configurations to render (default: three flights in forests)",
        nargs="*",
    ),
    out("out/cameras"),
    settings=VerbSettings(("CamerasSettings",)),
    often=("sensors", "light_levels", "pitch_um", "f_number", "methods"),
    example="megalopta benchmark cameras flight-yaw --sensors spadcam.yaml orca-quest-2 "
    "--light-levels 0.001 0.1",
)
def _cameras(options: Namespace) -> Path:
    from megalopta.benchmark.cameras import CamerasSettings, compare_cameras
    from megalopta.benchmark.cameras_page import write_cameras
    from megalopta.config.yaml_model import validated

    settings = validated(CamerasSettings, {}, "settings", options.overrides)
    compared = compare_cameras(options.scenes, options.out, **dict(settings))
    return write_cameras(options.out, compared)
