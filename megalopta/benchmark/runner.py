"""Run trials in parallel, each stored as soon as it is finished.

A result is keyed by a hash of everything that it depends on: the trial, the pixels of its template
and the code. So a killed run continues where it stopped, figures share trials, and no stale result
is used. Any `concurrent.futures` executor works: threads (the kernels release the GIL), processes,
or that of a Dask cluster, `Client.get_executor()`.
"""

import json
import os
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Executor, Future, ThreadPoolExecutor, as_completed
from contextlib import contextmanager
from pathlib import Path

from megalopta.benchmark.methods import identity
from megalopta.benchmark.trial import Template, Trial, measure_trial, template_names
from megalopta.core import files
from megalopta.core.arrays import Floats
from megalopta.core.errors import UserError
from megalopta.core.folders import ensure_directory, locked
from megalopta.core.freshness import code_digest, digest
from megalopta.core.progress import progress
from megalopta.flow.metrics.photon_threshold import ErrorCurve
from megalopta.flow.stimuli.photons import BlackFrameError
from megalopta.stages.jobs import connected

Curves = tuple[ErrorCurve, ...]
Results = Mapping[Trial, Curves]


def run_trials(
    trials: Iterable[Trial],
    templates: Mapping[Template, Floats],
    store: Path,
    executor: Executor,
    on_progress: Callable[[int], object] = lambda work: None,
) -> dict[Trial, Curves]:
    """Return the error curves of all trials; duplicates are run once.

    Results are stored in a folder, created if needed; `on_progress` gets the work done since its
    last call, in units of `trial_work`. Raises UserError if a template cannot be measured, such as
    one with a black frame.
    """
    ensure_directory(store)
    results: dict[Trial, Curves] = {}
    running: dict[Future[Curves], tuple[Trial, Path]] = {}
    hashes = {template: digest(pixels.tobytes()) for template, pixels in templates.items()}
    # the longest first, so that no worker runs one alone at the end
    for each in sorted(set(trials), key=lambda trial: (-trial.size, trial.model_dump_json())):
        path = store / f"{_key(each, hashes[each.template])}.json"
        if (stored := _read(path)) is None:
            stimulus = digest(json.dumps(each.stimulus), hashes[each.template])
            pixels = templates[each.template]
            running[executor.submit(measure_trial, each, pixels, stimulus)] = each, path
        else:
            results[each] = stored
            on_progress(trial_work([each]))
    try:
        for future in as_completed(running):
            each, path = running[future]
            results[each] = future.result()
            curves = [curve.to_dict() for curve in results[each]]
            files.write_json(path, {"trial": each.model_dump(mode="json"), "curves": curves})
            on_progress(trial_work([each]))
    except BlackFrameError as problem:
        raise UserError(f"{template_names([each.template])[0]}: {problem}") from None
    finally:
        for future in running:
            future.cancel()
    return results


def run(
    trials: Sequence[Trial],
    templates: Mapping[Template, Floats],
    store: Path,
    workers: int | None = None,
    scheduler: str | None = None,
) -> dict[Trial, Curves]:
    """Run `run_trials` on threads, by default one per core, or a Dask cluster; shows progress."""
    if not trials:
        return {}
    with locked(store):
        files.sweep(store)
        with (
            _executor(workers, scheduler) as executor,
            progress("Searching photon thresholds", trial_work(trials), "kpixel") as advance,
        ):
            return run_trials(trials, templates, store, executor, advance)


@contextmanager
def _executor(workers: int | None, scheduler: str | None) -> Iterator[Executor]:
    if scheduler is not None:
        with connected(scheduler) as client:
            yield client.get_executor()
        return
    threads = ThreadPoolExecutor(workers or os.cpu_count())
    try:
        yield threads
    finally:
        # an interruption does not wait for unfinished trials
        threads.shutdown(wait=False, cancel_futures=True)


def trial_work(trials: Iterable[Trial]) -> int:
    """Return the work of trials: thousands of pixels in one frame of each."""
    return sum(max(1, each.size**2 // 1000) for each in set(trials))


def _key(asked: Trial, template: str) -> str:
    """Return the hash of a result's dependencies, with code, libraries and detectors."""
    code = code_digest("megalopta.flow", "megalopta.sensor.sampling", Trial.__module__)
    return digest(asked.model_dump_json(), template, code, *map(identity, asked.detectors))


def _read(path: Path) -> Curves | None:
    """Return the stored result; None if it is missing or damaged."""
    try:
        record = json.loads(path.read_text("utf-8"))
        return tuple(ErrorCurve.from_dict(fields) for fields in record["curves"])
    except (FileNotFoundError, ValueError, LookupError, TypeError, AttributeError):
        return None
