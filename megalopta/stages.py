"""The stages in their order, and how one is run: checked, resumed, timed and recorded."""

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

from megalopta.configuration import Configuration
from megalopta.dataset import Dataset, begin_stage
from megalopta.errors import UserError
from megalopta.estimate import announce, refuse_absurd
from megalopta.flow import METHODS
from megalopta.flow.benchmark_settings import checked_warm_up, default_warm_up
from megalopta.progress import say
from megalopta.render import choose_variant
from megalopta.stage_bench import bench
from megalopta.stage_flow import measure_flow
from megalopta.stage_render import render
from megalopta.stage_sense import sense


@dataclass(frozen=True)
class Stage:
    """One step from scene to measurement.

    Attributes
    ----------
    purpose : str
        One clause for a person.
    work : callable
        Adds to a dataset what of the stage is not there yet.
    check : callable
        Refuses, with ValueError, a configuration that the stage cannot serve.
    """

    purpose: str
    work: Callable[[Dataset], None]
    check: Callable[[Configuration], None] = lambda _: None


def _check_flow(settings: Configuration) -> None:
    frames = settings.trajectory.frames
    for name in settings.methods:
        METHODS[name].start((settings.camera.height, settings.camera.width))
        warm_up = default_warm_up(frames, [METHODS[name]])
        if frames - warm_up < 2:
            raise ValueError(
                f"trajectory.frames {frames} leaves fewer than two to score after the {warm_up} "
                f"in which {name} settles: use at least {warm_up + 2}, or leave it out of methods"
            )


def _check_render(settings: Configuration) -> None:
    choose_variant(settings.render.backend)


def _check_bench(settings: Configuration) -> None:
    shape = settings.trajectory.frames, settings.camera.height, settings.camera.width
    checked_warm_up(shape, [METHODS[name] for name in settings.methods], settings.benchmark)


STAGES: Mapping[str, Stage] = {
    "render": Stage(
        "render a scene to spectral-radiance EXRs with exact ground truth", render, _check_render
    ),
    "sense": Stage("expose every sensor at every light level: photon counts to Zarr", sense),
    "flow": Stage(
        "run the motion detectors on the counts and compare with the truth",
        measure_flow,
        _check_flow,
    ),
    "bench": Stage(
        "find the photons per frame that each detector needs (N_2b)",
        bench,
        _check_bench,
    ),
}


def run_stage(root: Path, configuration: Configuration, name: str, redo: bool = False) -> Dataset:
    """Bring one stage of a dataset to its end; what is there already is kept. Raises UserError."""
    stage = STAGES[name]
    _check(name, configuration, root)
    dataset = begin_stage(root, configuration, name, redo)
    if dataset.is_finished(name):
        say(f"{name}: {root} has it already")
        return dataset
    announce(configuration, name)
    start = time.perf_counter()
    try:
        stage.work(dataset)
    finally:
        dataset.add_time(name, time.perf_counter() - start)
    dataset.finish(name)
    return dataset


def run_all(root: Path, configuration: Configuration, redo: bool = False) -> Dataset:
    """Run every stage, after checking that the configuration serves all of them."""
    for name in STAGES:
        _check(name, configuration, root)
    for name in STAGES:
        dataset = run_stage(root, configuration, name, redo)
    return dataset


def _check(name: str, configuration: Configuration, root: Path) -> None:
    try:
        refuse_absurd(configuration, name, root)
        STAGES[name].check(configuration)
    except ValueError as problem:
        raise UserError(f"{name}: {problem}") from None
