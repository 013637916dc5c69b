"""The stages in their order, and how one is run: checked, resumed, timed and recorded."""

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from megalopta import files
from megalopta.config import Configuration, announce, refuse_absurd
from megalopta.dataset import (
    Dataset,
    begin_redo,
    begin_stages,
    complete_redo,
    discard,
    existing,
    publish,
    whole_of,
    write_configuration,
)
from megalopta.errors import UserError
from megalopta.flow import METHODS
from megalopta.flow.benchmark import checked_warm_up, default_warm_up
from megalopta.folders import locked
from megalopta.progress import say
from megalopta.render import choose_variant
from megalopta.stages.bench import bench
from megalopta.stages.flow import measure_flow
from megalopta.stages.render import render
from megalopta.stages.sense import sense
from megalopta.stages.sense_check import check_sense


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
    "sense": Stage(
        "expose every sensor at every light level: photon counts to Zarr", sense, check_sense
    ),
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
    return _run(root, configuration, (name,), redo)


def run_all(root: Path, configuration: Configuration, redo: bool = False) -> Dataset:
    """Run every stage, after checking that the configuration serves all of them."""
    return _run(root, configuration, tuple(STAGES), redo)


def _run(root: Path, configuration: Configuration, names: Sequence[str], redo: bool) -> Dataset:
    for name in names:
        _check(name, configuration, root)
    is_new = existing(root) is None  # and a folder of something else is refused
    try:
        with _opened(root, configuration, names, redo) as dataset:
            for name in names:
                _bring_to_end(dataset, name)
    except Exception:
        if is_new and root.is_dir() and not any(root.iterdir()):
            root.rmdir()
        raise
    return Dataset(root, configuration)


@contextmanager
def _opened(
    root: Path, configuration: Configuration, names: Sequence[str], redo: bool
) -> Iterator[Dataset]:
    """Lock a dataset and yield the one to work in: itself, or where its output is made again."""
    with locked(root):
        complete_redo(root)
        old, doomed = begin_stages(root, configuration, names, redo)
        files.sweep(root)
        if doomed:
            new = begin_redo(old, configuration, doomed)
            try:
                yield new
            except Exception:  # but not by Ctrl-C, after which the same command goes on
                discard(root)
                raise
            publish(old, new, doomed)
        else:
            discard(root)
            new = Dataset(root, configuration)
            with _recorded(new, names):
                yield new


@contextmanager
def _recorded(dataset: Dataset, names: Sequence[str]) -> Iterator[None]:
    """Record the configuration; where nothing comes of it, the former one, or none, comes back."""
    path = dataset.root / "dataset.yaml"
    before = path.read_text("utf-8") if path.exists() else None
    write_configuration(dataset)
    try:
        yield
    except Exception:
        if not any(dataset.has(name) for name in names):
            if before is None:
                files.remove(path)
                files.remove(dataset.root / "timings.json")
            else:
                files.write_text(path, before)
        raise


def _bring_to_end(dataset: Dataset, name: str) -> None:
    if dataset.is_finished(name):
        say(f"{name}: {dataset.home} has it already")
        return
    _remove_damaged(dataset, name)
    announce(dataset.configuration, name)
    start = time.perf_counter()
    try:
        STAGES[name].work(dataset)
    finally:
        dataset.add_time(name, time.perf_counter() - start)
    dataset.finish(name)


def _remove_damaged(dataset: Dataset, name: str) -> None:
    """Remove what a finished stage wrote and somebody changed, so that it is made again."""
    line = dataset.entry(name)
    damaged = sorted({whole_of(path) for path in dataset.damaged(line)}) if line else []
    for path in damaged:
        say(f"{name}: {path} is missing or damaged, and is made again")
        files.remove(path)


def _check(name: str, configuration: Configuration, root: Path) -> None:
    try:
        refuse_absurd(configuration, name, root)
        STAGES[name].check(configuration)
    except ValueError as problem:
        raise UserError(f"{name}: {problem}") from None
