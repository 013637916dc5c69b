"""How stages are run: checked, resumed, timed and recorded."""

import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from megalopta.config.model import Configuration
from megalopta.core import files
from megalopta.core.errors import UserError
from megalopta.core.folders import locked
from megalopta.core.progress import say
from megalopta.dataset.store import (
    Dataset,
    existing,
    whole_of,
    write_configuration,
)
from megalopta.stages.beginning import begin_stages
from megalopta.stages.estimate import announce, refuse_absurd
from megalopta.stages.ledger import Ledger
from megalopta.stages.redo import begin_redo, complete_redo, discard, finish_move, publish
from megalopta.stages.registry import STAGES


def run_stage(
    root: str | Path, configuration: Configuration, name: str, redo: bool = False
) -> Dataset:
    """Bring one stage of a dataset to its end; what is there already is kept. Raises UserError."""
    return _run(Path(root), configuration, (name,), redo)


def run_all(root: str | Path, configuration: Configuration, redo: bool = False) -> Dataset:
    """Run every stage, after checking that the configuration serves all of them."""
    return _run(Path(root), configuration, tuple(STAGES), redo)


def _run(root: Path, configuration: Configuration, names: Sequence[str], redo: bool) -> Dataset:
    for name in names:
        check_stage(name, configuration, root)
    finish_move(root)
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
            publish(old, new, names, doomed)
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
        if not any(Ledger(dataset).has(name) for name in names):
            if before is None:
                files.remove(path)
                files.remove(dataset.root / "timings.json")
            else:
                files.write_text(path, before)
        raise


def _bring_to_end(dataset: Dataset, name: str) -> None:
    ledger = Ledger(dataset)
    if ledger.is_finished(name):
        say(f"{name}: {dataset.home} has it already")
        return
    _remove_damaged(ledger, name)
    announce(dataset.configuration, name)
    ledger.begin(name)
    start = time.perf_counter()
    try:
        STAGES[name].work(dataset)
    except Exception:
        ledger.withdraw(name)
        raise
    finally:
        ledger.add_time(name, time.perf_counter() - start)
    ledger.finish(name)


def _remove_damaged(ledger: Ledger, name: str) -> None:
    """Remove what a finished stage wrote and somebody changed, so that it is made again."""
    entry = ledger.entry(name)
    damaged = ledger.damaged(name, entry) if entry else []
    for path in sorted({whole_of(path, ledger.root) for path in damaged}):
        say(f"{name}: {path} is missing or damaged, and is made again")
        files.remove(path)


def check_stage(name: str, configuration: Configuration, root: Path) -> None:
    """Refuse, with UserError, a configuration that a stage or this machine cannot serve."""
    try:
        refuse_absurd(configuration, name, root)
        STAGES[name].check(configuration)
    except ValueError as problem:
        raise UserError(f"{name}: {problem}") from None
