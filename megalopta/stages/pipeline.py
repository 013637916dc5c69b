"""Run stages: check, resume, time and record.

Everything that a dataset holds must come from one configuration. A stage refuses differences and
lists them, unless the user asks to redo it.
"""

import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from megalopta.config.model import Configuration, differences
from megalopta.core import files
from megalopta.core.errors import UserError, refused_as
from megalopta.core.folders import locked
from megalopta.core.progress import numbered_stage, say, step
from megalopta.dataset.store import (
    Dataset,
    existing,
    whole_of,
    write_configuration,
)
from megalopta.stages.ledger import Ledger
from megalopta.stages.limits import refuse_absurd
from megalopta.stages.redo import begin_redo, complete_redo, discard, finish_move, publish
from megalopta.stages.registry import STAGES, stage_configuration, with_dependents


def run_stage(
    root: str | Path, configuration: Configuration, name: str, redo: bool = False
) -> Dataset:
    """Complete one stage of a dataset and keep finished output. Raises UserError."""
    return _run(Path(root), configuration, (name,), redo)


def run_all(
    root: str | Path, configuration: Configuration, redo: bool = False, later: int = 0
) -> Dataset:
    """Run every stage, after checking that the configuration suits all of them.

    Lines of progress count as many stages more as follow `later`.
    """
    return _run(Path(root), configuration, tuple(STAGES), redo, later)


def _run(
    root: Path, configuration: Configuration, names: Sequence[str], redo: bool, later: int = 0
) -> Dataset:
    for name in names:
        check_stage(name, configuration, root)
    finish_move(root)
    is_new = existing(root) is None  # and refuses a folder of other files
    try:
        with _opened(root, configuration, names, redo) as dataset:
            for number, name in enumerate(names, 1):
                with numbered_stage(number, len(names) + later):
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
    """Lock a dataset and yield the one to work in: itself, or the place of its new output."""
    with locked(root):
        complete_redo(root)
        old, doomed = _begin(root, configuration, names, redo)
        files.sweep(root)
        if doomed:
            new = begin_redo(old, configuration, doomed)
            try:
                yield new
            except Exception:  # but not by Ctrl-C, after which the same command continues
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
    """Record the configuration; restore the former one, or none, if there is no output."""
    path = dataset.root / "dataset.yaml"
    before = path.read_text("utf-8") if path.exists() else None
    write_configuration(dataset)
    try:
        yield
    except Exception:
        outputs = (path for name in names for path in STAGES[name].outputs(dataset))
        if not any(map(files.holds_files, outputs)):
            if before is None:
                files.remove(path)
                files.remove(dataset.root / "timings.json")
            else:
                files.write_text(path, before)
        raise


def _bring_to_end(dataset: Dataset, name: str) -> None:
    ledger = Ledger(dataset)
    if ledger.is_finished(name):
        say(f"{name}: {dataset.home} already has it")
        return
    _remove_damaged(ledger, name)
    ledger.begin(name)
    start = time.perf_counter()
    try:
        with step(name):
            STAGES[name].work(dataset)
    except Exception:
        ledger.withdraw(name)
        raise
    finally:
        ledger.add_time(name, time.perf_counter() - start)
    ledger.finish(name)


def _remove_damaged(ledger: Ledger, name: str) -> None:
    """Remove modified output of a finished stage, so that it is computed again."""
    for path in sorted({whole_of(path, ledger.root) for path in ledger.damaged(name)}):
        say(f"{name}: {path} is missing or damaged; recomputing")
        files.remove(path)


def check_stage(name: str, configuration: Configuration, root: Path) -> None:
    """Refuse, with UserError, a configuration that a stage or this machine cannot serve."""
    refuse_absurd(configuration, name, root)
    with refused_as(name):
        STAGES[name].check(configuration)


def _begin(
    root: Path, configuration: Configuration, stages: Sequence[str], redo: bool = False
) -> tuple[Dataset, list[str]]:
    """Return the dataset and the stages to redo, or refuse. Nothing is changed here.

    All output must come from the same configuration, and stages that these need must be finished.
    With `redo`, these stages and whatever disagrees are recomputed, and their dependents removed.
    So are, without request, quickly derived results of other code.
    """
    new = Dataset(root, configuration)
    old = existing(root) or new
    there, wanted = Ledger(old), Ledger(new)
    stale = [
        stage
        for stage in STAGES
        if stage_configuration(old.configuration, stage)
        != stage_configuration(configuration, stage)
        and there.has(stage)
    ]
    before, now = (stage_configuration(each, *stale) for each in (old.configuration, configuration))
    differing = differences(before, now)
    changes = "; ".join(differing[:3])
    changes += f" and {len(differing) - 3} more" if len(differing) > 3 else ""
    if stale and not redo:
        raise UserError(
            f"{root} holds {' and '.join(stale)} output of another configuration "
            f"({changes}); choose another folder, or add --redo to replace it"
        )
    again = [stage for stage in stages if _is_to_be_made_again(there, stage, redo)]
    doomed = with_dependents([*stale, *again])
    for stage in [stage for stage in stages if stage not in doomed]:
        _refuse_mixture(wanted, stage)
    needs = {need for stage in stages for need in STAGES[stage].needs}
    for needed in [stage for stage in STAGES if stage in needs.difference(stages)]:
        if needed in doomed:
            raise UserError(
                f"{root}: --redo of {stages[0]!r} alone would remove the {needed!r} output, which "
                f"differs ({changes}); run with --redo first: "
                f"megalopta {STAGES[needed].command}"
            )
        wanted.require(needed)
    return old, doomed


def _is_to_be_made_again(ledger: Ledger, stage: str, redo: bool) -> bool:
    if redo or not ledger.is_outdated(stage):
        return redo and ledger.has(stage)
    if not STAGES[stage].is_derived:
        raise UserError(
            f"{ledger.root}: its {stage!r} output was made by another version of the program, "
            "which gives other numbers; add --redo to recompute it"
        )
    say(f"{stage}: made by another version of the program; recomputing")
    return True


def _refuse_mixture(ledger: Ledger, stage: str) -> None:
    """Refuse to complete output with another renderer or library than it was begun with."""
    if STAGES[stage].is_derived or not (changes := ledger.mixture(stage)):
        return
    if ledger.has(stage) and not ledger.is_finished(stage):
        raise UserError(
            f"{ledger.root}: its {stage!r} output is incomplete and was made with other software "
            f"({changes}); continue with that (render.backend chooses the variant), or add --redo "
            "to recompute all of it"
        )
