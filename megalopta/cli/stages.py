"""The verbs that run stages: on a new dataset from a configuration, or on one that is there."""

from argparse import Namespace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from megalopta.cli.command import (
    CLUSTER,
    DATASET,
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
from megalopta.config import built_in_names
from megalopta.core.errors import UserError, check_path, shell_command
from megalopta.core.progress import say, step

if TYPE_CHECKING:
    from megalopta.config.model import Configuration

_RANKED = {"methods": "[BM, DIS, PM, PF]", "fluxes": "[1e5, 1e6, 1e7]", "repeats": "1"}
"""Settings of the demo's ranking: few, for a short demo"""


REDO = switch("--redo", "replace output of another configuration")
_FROM_CONFIGURATION = (
    REDO,
    option(
        "configuration",
        f"YAML file, or one of {', '.join(built_in_names())} (default: demo)",
        nargs="?",
    ),
    out("out/demo", "dataset folder"),
)


@verb(
    "render",
    "render a scene to spectral-radiance EXRs with exact ground truth",
    *_FROM_CONFIGURATION,
    settings=VerbSettings(stage="render", values="demo"),
    often=(
        *("scene.kind", "scene.preset", "scene.trees", "light.level", "light.illuminance_lux"),
        *("camera.width", "camera.height", "camera.fov_deg", "trajectory.frames"),
        *("trajectory.rotation_deg_s", "trajectory.velocity_m_s", "render.samples_per_pixel"),
    ),
    example="megalopta render demo --out out/night --light.level full_moon --scene.trees 300",
)
def _render(options: Namespace) -> None:
    from megalopta.dataset.store import Tree

    folder = Path(options.configuration or "demo")
    if (folder / "dataset.yaml").exists() and Tree(folder).plan:
        from megalopta.config.recipe import load_plan
        from megalopta.stages.make import make

        if options.redo:
            raise UserError(
                f"{options.configuration}: a dataset of many sequences; remove a sequence's record "
                "to make it again"
            )
        make(options.out, load_plan(folder, options.overrides))
        return
    from megalopta.stages.run import run_stage

    run_stage(options.out, _configuration(options), "render", options.redo)


@verb(
    "demo",
    "do everything: render, sense, flow, benchmark and a report to open in a browser",
    *_FROM_CONFIGURATION,
    switch("--quick", "in half a minute: a photographed forest, without the search for thresholds"),
    settings=VerbSettings(values="demo"),
    often=(
        *("scene.trees", "camera.width", "camera.height", "trajectory.frames"),
        *("render.samples_per_pixel", "light_levels", "sensors", "methods"),
    ),
    example="megalopta demo --quick --out out/quick",
)
def _demo(options: Namespace) -> Path:
    if options.quick and options.configuration not in (None, "demo"):
        raise UserError(f"--quick: {options.configuration} has no quick form; omit one of them")
    options.configuration = "quick" if options.quick else options.configuration
    settings = _configuration(options)  # refused before the rest is loaded

    from megalopta.flow.detectors.registry import METHODS
    from megalopta.report.page import write_report
    from megalopta.stages.registry import STAGES
    from megalopta.stages.run import run_all

    stages = [name for name in STAGES if not (options.quick and name == "benchmark")]
    dataset = run_all(options.out, settings, options.redo, stages)
    is_ranked = any(METHODS[name].gives == "velocity" for name in settings.methods)
    if is_ranked and not options.quick:
        from megalopta.benchmark.ranking_run import FOLDER, run_ranking

        run_ranking(dataset.root, dataset.root / FOLDER, _RANKED)
    return write_report(dataset)


def run_later_stage(stage: str, options: Namespace) -> None:
    """Run a stage on every sequence of the dataset that the options name."""
    check_path(options.dataset)
    from megalopta.dataset.store import Tree
    from megalopta.stages.make import add_exposures, measure

    root, where = options.dataset, (options.workers, options.scheduler)
    if stage != "sense" or Tree(root).plan is None:
        measure(root, stage, options.overrides, options.redo, *where)
    elif options.redo:
        raise UserError(f"{root}: sequences of a plan, to which sense adds exposures; omit --redo")
    else:
        add_exposures(root, options.overrides, *where)


verb(
    "flow",
    "run the motion detectors on the counts and compare with the truth",
    REDO,
    DATASET,
    *CLUSTER,
    settings=VerbSettings(stage="flow"),
    often=("methods", "flow.saturated"),
    example="megalopta flow out/night --methods BM DIS PF",
)(partial(run_later_stage, "flow"))

_OF_PICTURES = (
    option("--photons N,N", "mean photons on a pixel in a frame, such as 2 or 0.5,10", numbers),
    option(
        "--lux E,E",
        "or illuminance of the scene, lux: 0.25 is full moon, 10 a street, 500 indoors",
        numbers,
    ),
    option("--luminance L,L", "or mean luminance of the pictures, cd/m²", numbers),
    option("--unit", "unit of arrays, which do not state it", choices=["srgb", "linear", "cd/m2"]),
    option(
        "--reflectance R", "mean reflectance of the pictures, for --lux (default: 0.18)", positive
    ),
    option("--spectrum NAME", "spectrum of white: D65 (default), equal_energy, or a light level"),
    option(
        "--frame-rate HZ", "frames per second (default: the file's)", positive, dest="frame_rate_hz"
    ),
    option(
        "--picture-rate HZ",
        "pictures per second of files without times (default: the frame rate, or 25)",
        positive,
        dest="picture_rate_hz",
    ),
    option("--frames N", "number of frames (default: all)", at_least(2)),
    option("--width PX", "width of the frames (default: the file's)", at_least(1)),
    option(
        "--between",
        "light between two pictures: hold the earlier one (default), blend both, or move it along "
        "their estimated flow",
        choices=["hold", "blend", "flow"],
    ),
)


@verb(
    "sense",
    "turn a video, pictures, an array or a rendered dataset into photon counts, binary frames or "
    "events",
    REDO,
    option("input", "video, picture, folder of pictures, array, or dataset folder", Path),
    option("--out", "dataset folder for pictures (default: out/NAME)", Path),
    *_OF_PICTURES,
    *CLUSTER,
    settings=VerbSettings(("Configuration", "Exposing"), stage="sense"),
    often=(
        *("light_levels", "sensors", "products", "sub_frames", "burst_hz", "free_running"),
        *("expectation", "correct"),
    ),
    example="megalopta sense clip.mp4 --photons 2    # then: megalopta view out/clip",
)
def _sense(options: Namespace) -> Path | None:
    check_path(options.input)
    from megalopta.render import is_footage, open_footage

    fields = (how.get("dest", name[2:]) for name, how in _OF_PICTURES)
    values = {field: getattr(options, field) for field in fields}
    stated = {field: value for field, value in values.items() if value is not None}
    is_dataset, of_pictures = (options.input / "dataset.yaml").exists(), stated or options.out
    if is_dataset or not (of_pictures or is_footage(options.input)):
        if of_pictures:
            name = next(iter([*stated, "out"])).replace("_", "-").removesuffix("-hz")
            raise UserError(f"--{name}: for pictures, and {options.input} is a dataset; omit it")
        options.dataset = options.input
        run_later_stage("sense", options)
        return None
    if options.workers or options.scheduler:
        raise UserError(f"{options.input}: pictures are one sequence; omit --workers")
    from megalopta.stages.importing import PictureOptions, pictures_configuration
    from megalopta.stages.limits import refuse_absurd
    from megalopta.stages.run import run_stages

    chosen = PictureOptions(**stated)
    with open_footage(options.input, chosen.unit) as footage:
        settings, light = pictures_configuration(footage, chosen, options.overrides)
        root = Path(options.out or Path("out") / settings.name)
        refuse_absurd(settings, "sense", root)
        stages = "sense", "render"  # the open pictures are exposed, and then copied
        run_stages(root, settings, stages, options.redo, light=light, is_checked=True)
    say(f"see them with: {shell_command('view', root)}")
    return root


def _configuration(options: Namespace) -> "Configuration":
    """Read the configuration that is named, or the demo's."""
    from megalopta.config.model import load

    return load(options.configuration or "demo", options.overrides)


VERBS["dataset"] = Verb("make a dataset of many sequences")


@verb(
    "dataset make",
    "make a dataset of any size from a plan; finished sequences are kept",
    option("plan", "YAML file of the plan, folder of a dataset to continue, or 'challenge'", Path),
    out("out/dataset", "dataset folder"),
    option("--only N", "only these sequences, such as 731 or 0-9,20"),
    switch(
        "--dry-run",
        "estimate sequences, frames, gigabytes and time from a short measurement; make nothing",
    ),
    *CLUSTER,
    settings=VerbSettings(("Plan",)),
    often=(
        *("sequences", "seed", "scenes", "lights", "cameras", "trajectories", "every"),
        *("sensors", "light_levels", "repeats", "products", "splits"),
    ),
    example="megalopta dataset make plan.yaml --out data --workers 2",
)
def _make(options: Namespace) -> Path | str:
    if options.plan != Path("challenge"):
        check_path(options.plan)
    from megalopta.config.recipe import load_plan

    plan = load_plan(options.plan, options.overrides)  # refused before the rest is loaded

    from megalopta.stages.estimate import estimate_plan
    from megalopta.stages.make import make, parse_indices

    only = parse_indices(options.only, plan.sequences) if options.only else None
    if options.dry_run:
        return estimate_plan(options.out, plan, options.workers or 1, only)
    make(options.out, plan, only=only, workers=options.workers, scheduler=options.scheduler)
    return Path(options.out)


VERBS["scene"] = Verb("export a scene")


@verb(
    "scene export",
    "write the objects of a scene at a frame as GLB, for Blender or a viewer",
    option("configuration", "YAML file, name of a configuration, or dataset folder"),
    out_file("out/scene.glb", "GLB file"),
    option("--frame", "frame, counted from 0", at_least(0), 0),
    settings=VerbSettings(stage="render"),
    often=("scene.kind", "light.level", "camera.width", "camera.height", "render.bands_nm"),
    example="megalopta scene export demo --out out/scene.glb --frame 3",
)
@step("building the scene")
def _export(options: Namespace) -> Path:
    from megalopta.config.model import load
    from megalopta.core import files
    from megalopta.scenes.glb import glb_of
    from megalopta.stages.render import build

    if options.out.suffix.lower() != ".glb":
        raise UserError(f"--out {options.out} is no .glb file; name one, such as out/scene.glb")
    settings = load(options.configuration, options.overrides)
    path = settings.trajectory
    if options.frame >= path.frames:
        raise UserError(
            f"--frame {options.frame}: frames are 0 to {path.frames - 1}; give one of these"
        )
    content = glb_of(build(settings), float(path.times_s[options.frame]))
    with files.atomic_write(options.out) as temporary:
        temporary.write_bytes(content)
    return Path(options.out)
