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
    from collections.abc import Mapping

    from pandas import DataFrame

    from megalopta.benchmark.clips import Files

_WIDTH = 1000  # of lines, more than any table needs: nothing is cut off

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
        "names, 'module:function', 'module:function counts' or ONNX files, by commas or blanks, as"
        " in all lists; 'DIS √' is on roots of counts, 'DIS tuned' has settings for the light"
        " (default: all two-frame methods, tuned if possible)",
    ),
    option("--against METHOD", "method that others are compared with (default: the best)", str, ""),
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
def _pairs(options: Namespace) -> Iterator[Path]:
    for name in ("reference", "unit"):
        if getattr(options, name) and not options.no_truth:
            raise UserError(f"benchmark pairs: --{name} needs --no-truth; add that, or omit it")
    from megalopta.benchmark import methods as benchmarked, whole_frames
    from megalopta.benchmark.clips import read_pair
    from megalopta.benchmark.disturbances import disturbance
    from megalopta.core.errors import refused_as
    from megalopta.core.progress import say
    from megalopta.report.images import evenly_spaced

    with ExitStack() as stack, refused_as():
        names = filter(None, ",".join(options.disturb or ()).split(","))
        disturbances = list(dict.fromkeys(map(disturbance, names)))
        names_of_methods = options.methods.split(",") if options.methods else ()
        methods, against = benchmarked.with_compared(
            names_of_methods or benchmarked.methods_and_baselines(), options.against
        )
        if options.no_truth:
            reference = benchmarked.block_detector(options.reference or "DIS")
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
            clips, [*methods.values()], options.photons, draws, disturbances, count, against
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
        print(f"Errors of all pixels{over}; 10–40 px: of those that move so far.")
    for (set_name, head), flux in product(board.parts().items(), board.by_draw["photons"].unique()):
        light = f"{head}, photons per px: {flux:g}"
        rows = board.means(set_name, flux)
        _print_table("\n".join(filter(None, (light, board.units(set_name)[1]))), rows, heads)
    if not options.no_truth:
        yield options.out.with_suffix(".html")
    yield Path(options.out)


def _files_of_pairs(options: Namespace) -> "Iterator[tuple[str, Files, str, str]]":
    """Yield name, files, set and sequence of the pairs to measure."""
    from megalopta.benchmark import clips
    from megalopta.core.progress import say
    from megalopta.report.images import evenly_spaced

    paths, scale = options.paths, options.png_scale
    if len(paths) == 3 and not any(path.is_dir() for path in paths):
        name = "/".join(paths[0].resolve().with_suffix("").parts[-2:])
        yield name, (*paths[:2], clips.TrueFlow(paths[2], scale)), "", ""
        return
    if any(path.is_file() for path in paths):
        raise UserError(
            f"benchmark pairs: {len(paths)} path{'s' * (len(paths) > 1)}, not all folders; give"
            " folders, or two pictures and their flow (without flow: --no-truth)"
        )
    names = [path.resolve().name for path in paths]
    homes = dict[Path, Path]()
    for path, name in zip(paths, names, strict=True):
        alone = name if names.count(name) == 1 else path.as_posix()
        (pass_name, pairs), *further = clips.sets_below(path, scale).items()
        for same, _ in further:
            say(f"{path}: {same} is omitted, as its pairs are the same; to measure it, name it")
        for pair, files in evenly_spaced([*pairs.items()], options.pairs):
            if (home := homes.setdefault(files[2].flow, path)) != path:
                raise UserError(f"{home} and {path} both have {files[2].flow}; give one of them")
            sequence = f"{alone} {clips.sequence_of(pair)}"
            yield pair, files, " ".join(dict.fromkeys((alone, pass_name))).strip(), sequence


def _print_table(head: str, means: "DataFrame", heads: "Mapping[str, str]") -> None:
    """Print `table.means` of a light: a row per method, a column per metric that tells something.

    Methods of the least mean error come first, the bound last. Disturbances have a column for the
    mean error.
    """
    from rich.box import SIMPLE
    from rich.console import Console
    from rich.table import Table

    from megalopta.benchmark.curves import BOUND
    from megalopta.benchmark.table import MEAN, MEDIAN, records
    from megalopta.core.quantities import UNDEFINED, number, with_error

    undisturbed, *groups = means["group"].unique()
    disturbed = {group: f"{group}\nmean px" for group in groups}
    columns = {name: dict[str, str]() for name in (MEDIAN, MEAN, "", *heads, *disturbed.values())}
    for row in records(means.sort_values("value", kind="stable")):
        scale = 100 if "share" in row.metric else 1
        value, low, high = (number(scale * end) for end in (row.value, row.low, row.high))
        if row.group != undisturbed:
            if row.metric == MEAN:
                columns[disturbed[row.group]][row.method] = value
        elif row.metric in heads:
            has_ends = row.metric in (MEDIAN, MEAN) and row.low == row.low
            columns[row.metric][row.method] = value + f"\n{low} to {high}" * has_ends
            if row.metric == MEAN:
                heads = {**heads, "": f"mean px minus that of\n{row.against} (± 95 % CI, paired)"}
                columns[""][row.method] = with_error(row.difference, row.difference_half, "")
    methods = sorted(columns[MEAN], key=lambda method: method == BOUND)
    table, shown = Table(box=SIMPLE, padding=(0, 1)), set[tuple[str, ...]]()
    table.add_column(head, no_wrap=True)
    cells = []
    for name, column in columns.items():
        values = tuple(column.get(method, UNDEFINED).partition("\n")[0] for method in methods)
        if values not in shown and not {*values} <= {"0", UNDEFINED}:  # zero, or a repetition
            shown.add(values)
            table.add_column(heads.get(name, name), justify="right", no_wrap=True)
            cells.append([column.get(method, UNDEFINED) for method in methods])
    for method, *texts in zip(methods, *cells, strict=True):
        if method == BOUND:
            table.add_section()
        table.add_row(method, *texts)
    Console(width=_WIDTH, markup=False, emoji=False).print(table)


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

    from megalopta.benchmark.ranking import Ranking, RankingFacts
    from megalopta.benchmark.ranking_page import below_bound, verdict
    from megalopta.benchmark.ranking_run import run_ranking
    from megalopta.benchmark.whole_frames import METRICS

    page = run_ranking(options.dataset, options.out, options.overrides)
    facts = RankingFacts.model_validate_json(page.with_suffix(".json").read_text("utf-8"))
    ranking = Ranking(facts, pd.read_csv(page.with_suffix(".csv")))
    heads = {metric: head for metric, (head, *_) in METRICS.items()}
    for flux, rows in ranking.rows.query("group == 'all'").groupby("photons"):
        _print_table(f"{facts.unit[0]}: {facts.light(float(str(flux)))}\n95 % CI", rows, heads)
    print("\n".join(filter(None, (verdict(ranking), below_bound(ranking)))))
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
    Console(width=_WIDTH, markup=False, emoji=False).print(score_table(scores))
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
    Console(width=_WIDTH, markup=False).print(table)
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
