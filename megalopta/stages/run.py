"""Run the stages of a sequence: keep what is fresh, refuse or redo what is stale, make the rest.

A kill at any moment leaves files that no record lists; SEQ.begun says with what they can go on.
"""

import json
import os
import time
from collections.abc import Callable, Collection, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from megalopta import __version__
from megalopta.config.model import Configuration
from megalopta.core import bounded, files
from megalopta.core.errors import UserError, refused_as, shell_command
from megalopta.core.folders import locked
from megalopta.core.freshness import digest
from megalopta.core.progress import say, step
from megalopta.dataset.picture_light import PictureLight
from megalopta.dataset.record import SequenceRecord, StageRecord, read_record, stored_settings
from megalopta.dataset.store import Dataset, Tree, file_difference, hashes_of, whole_of
from megalopta.stages import registry
from megalopta.stages.limits import refuse_absurd
from megalopta.stages.registry import STAGES


def run_stage(
    root: str | Path, configuration: Configuration, name: str, redo: bool = False
) -> Dataset:
    """Bring one stage of a dataset of one sequence to its end. Raises UserError."""
    return run_stages(Path(root), configuration, (name,), redo)


def run_all(
    root: str | Path,
    configuration: Configuration,
    redo: bool = False,
    stages: Sequence[str] = tuple(STAGES),
) -> Dataset:
    """Run stages, by default all, after checking that the configuration suits them."""
    for name in stages:
        check_stage(name, configuration, Path(root))
    for name in stages:
        dataset = run_stages(Path(root), configuration, (name,), redo, is_checked=True)
    return dataset


def run_stages(
    root: Path,
    configuration: Configuration,
    stages: Sequence[str],
    redo: bool = False,
    *,
    light: PictureLight | None = None,
    is_checked: bool = False,
) -> Dataset:
    """Bring stages of a dataset of one sequence to their end, in one run. Raises UserError.

    `light` is that of its pictures, if they are open. Without any output the folder and its
    dataset.yaml are as before.
    """
    for name in () if is_checked else stages:
        check_stage(name, configuration, root)
    tree, header = Tree(root), root / "dataset.yaml"
    created = [folder for folder in (root, *root.absolute().parents) if not folder.exists()]
    if tree.exists() and (tree.plan or set(tree.names()) - {configuration.name}):
        raise UserError(f"{root}: holds other sequences; choose another folder")
    try:
        with locked(root):
            tree.sweep()
            dataset = replace(tree.at(configuration), light=light)
            work = foresee(dataset, stages, redo)
            before = header.read_text("utf-8") if header.exists() else None
            tree.write_header(configuration=configuration.model_dump(mode="json"))
            try:
                return run(dataset, work)
            except Exception:
                with suppress(OSError):  # it has records
                    dataset.record_path.parent.rmdir()
                if before and not dataset.begun_path.exists():
                    files.write_text(header, before)
                elif not dataset.record_path.parent.exists():
                    files.remove(header)
                raise
    finally:
        for folder in created:
            with suppress(OSError):  # it has output, or was not made
                folder.rmdir()


def check_stage(name: str, configuration: Configuration, root: Path) -> None:
    """Refuse, with UserError, a configuration that a stage or this machine cannot serve."""
    refuse_absurd(configuration, name, root)
    with refused_as(name):
        STAGES[name].check(configuration)


@dataclass(frozen=True)
class Work:
    """Stages of a sequence to make or to complete, and those whose output is removed before."""

    todo: Mapping[str, StageRecord]
    """Records of them as they begin"""
    removed: tuple[str, ...]


def foresee(dataset: Dataset, stages: Sequence[str], redo: bool = False) -> Work:
    """Return the work that stages of a sequence need. Nothing is changed here.

    Output is fresh if it was finished with these settings by this model of the program, and every
    file is whole. Of other settings or software it is stale. Missing output that was begun with the
    same settings and software is continued. Raises UserError for stale output without `redo`, and
    for needed stages that are not finished.
    """
    root, settings, former = dataset.root, dataset.configuration, dataset.former
    known = former.stages
    stale = [name for name in known if known[name].settings != stage_hash(settings, name)]
    changes = _differences(former, dataset.record_path, settings, stale) if stale else ""
    if stale and not redo:
        raise UserError(
            f"{root} holds {' and '.join(stale)} output of another configuration ({changes}); "
            "choose another folder, or add --redo to replace it"
        )
    begun = former.model_copy(update={"stages": {}})  # what is in progress: nothing, or as recorded
    if os.path.lexists(dataset.begun_path):
        begun = read_record(dataset.begun_path, dataset.sequence)
    todo, gone = dict[str, StageRecord](), set(stale)
    for name in stages:
        now = StageRecord(
            settings=stage_hash(settings, name),
            made_with=STAGES[name].made_with(settings),
            version=__version__,
        )
        if name not in known:
            if (before := begun.stages.get(name)) != now:
                if before and not (redo or STAGES[name].is_derived) and has_output(dataset, name):
                    change = _differences(begun, dataset.begun_path, settings, [name])
                    change = change or registry.provenance_changes(before.made_with, now.made_with)
                    raise UserError(
                        f"{root}: its {name!r} output is incomplete and of other settings or "
                        f"software ({change}); continue with those, or add --redo to replace it"
                    )
                gone.add(name)
        elif redo:
            gone.add(name)
        else:
            change = registry.provenance_changes(known[name].made_with, now.made_with)
            if not damaged(dataset, name) and not change.startswith("model: "):
                say(f"{name}: {root} already has it")
                continue
            if change and not STAGES[name].is_derived:
                raise UserError(
                    f"{root}: its {name!r} output was made with other software ({change}), which "
                    "gives other numbers; add --redo to recompute all of it"
                )
            if change:
                say(f"{name}: made by another version of the program; recomputing")
                gone.add(name)
        todo[name] = now
    removed = registry.with_dependents(gone)
    needs = {need for name in stages for need in STAGES[name].needs}.difference(stages)
    for need in (name for name in STAGES if name in needs):
        if need in removed:
            raise UserError(
                f"{root}: --redo of {stages[0]!r} alone would remove the {need!r} output, which "
                f"differs ({changes}); run with --redo first: megalopta {STAGES[need].command}"
            )
        require(dataset, need)
    return Work(todo, tuple(removed))


def _differences(
    record: SequenceRecord, path: Path, settings: Configuration, stages: Collection[str]
) -> str:
    """Return what stages depend on and differs from a record."""
    old = stored_settings(record, path)
    return registry.differences_text(
        registry.stage_configuration(old, *stages), registry.stage_configuration(settings, *stages)
    )


More = Callable[[Dataset], Mapping[str, Any]]
"""Makes more output of a dataset, and returns more fields of its record"""


def run(dataset: Dataset, work: Work, more: More | None = None) -> Dataset:
    """Do the work on a sequence, and return it with its record."""
    root, settings, former = dataset.root, dataset.configuration, dataset.former
    described = {"configuration": settings.model_dump(mode="json")}
    with locked(dataset.record_path.parent, f".{dataset.sequence}.lock"):
        if not work.todo:  # stages to come may have other settings
            return _entered(dataset, former.model_copy(update=described))
        for name in set(work.todo).intersection(work.removed, former.stages):
            with refused_as(name):
                STAGES[name].rehearse(settings)
        kept = former.without(work.removed)
        forget(dataset, work.removed)
        outputs = {name: STAGES[name].outputs(dataset) for name in work.todo}
        if dataset.begun_path.exists():  # a writer was killed
            for path in (path for paths in outputs.values() for path in paths):
                for part in path.parent.glob(f".part-*-{path.name}"):
                    files.remove(part)
                files.sweep(path)
        spent = timings(dataset) if former.stages else {}
        growing = replace(dataset, record=kept.without(work.todo))
        marked = former.model_copy(update={**described, "stages": dict(work.todo)})
        files.write_text(dataset.begun_path, marked.to_json())
        try:
            for place, name in enumerate(work.todo, 1):
                broken = damaged(replace(dataset, record=kept), name) if name in kept.stages else []
                for path in sorted({whole_of(path, root) for path in broken}):
                    say(f"{name}: {path} is missing or damaged; recomputing")
                    files.remove(path)
                start = time.perf_counter()
                with step(f"stage {place} of {len(work.todo)}: {name}"):
                    STAGES[name].work(growing)
                spent[name] = round(time.perf_counter() - start, 3)
            files.write_json(dataset.result("timings.json"), spent)
            fields = more(growing) if more else {}
        except Exception:
            if not any(has_output(dataset, name) for name in work.todo):
                files.remove(dataset.begun_path)
            raise
        made = {
            name: begun.model_copy(update={"files": hashes_of(root, outputs[name])})
            for name, begun in work.todo.items()
        }
        stages = {**kept.stages, **made}
        ordered = {name: stages[name] for name in STAGES if name in stages}
        update = {**described, **fields, "stages": ordered}
        return _entered(dataset, former.model_copy(update=update))


def _entered(dataset: Dataset, record: SequenceRecord) -> Dataset:
    """Write the record of a sequence, of which nothing is in progress any more."""
    files.write_text(dataset.record_path, record.to_json())
    files.remove(dataset.begun_path)
    return replace(dataset, record=record)


def forget(dataset: Dataset, stages: Collection[str]) -> None:
    """Remove stages from the record, then their output."""
    former = dataset.former
    if set(stages) & former.stages.keys():
        left = former.without(stages)
        if left.stages:
            files.write_text(dataset.record_path, left.to_json())
        else:
            files.remove(dataset.record_path)
        files.remove(dataset.root / "report.html")
    for path in [path for name in stages for path in STAGES[name].outputs(dataset)]:
        files.remove(path)


def has_output(dataset: Dataset, stage: str) -> bool:
    """True if any output of a stage exists, finished or not."""
    paths = STAGES[stage].outputs(dataset)
    return any(any(path.iterdir()) if path.is_dir() else path.exists() for path in paths)


def entry(dataset: Dataset, stage: str) -> StageRecord | None:
    """Record of a stage finished with this configuration.

    Raises UserError if it names a file that the stage does not write.
    """
    known = dataset.former.stages.get(stage)
    if not known or known.settings != stage_hash(dataset.configuration, stage):
        return None
    names = [str(path.relative_to(dataset.root)) for path in STAGES[stage].outputs(dataset)]
    inside = tuple(f"{name}/" for name in names)
    for name in known.files or {}:
        if name not in names and not name.startswith(inside):
            raise UserError(
                f"{dataset.record_path} is damaged ({bounded.quoted(name, 60)!r} is no output of "
                f"stage {stage!r}); restore it, or render into a new folder"
            )
    return known


def damaged(dataset: Dataset, stage: str) -> list[Path]:
    """Files of a finished stage that are missing or have another size or hash."""
    known = entry(dataset, stage)
    recorded = (known.files or {}).items() if known else ()
    with step(f"comparing files of {stage}"):
        paths = [(dataset.root / name, size, digest) for name, (size, digest) in recorded]
        return [path for path, size, digest in paths if file_difference(path, size, digest)]


def finished(dataset: Dataset) -> list[str]:
    """Return the finished stages. Raises UserError if one of them is damaged."""
    stages = [stage for stage in STAGES if entry(dataset, stage)]
    for stage in stages:
        require(dataset, stage)
    return stages


def require(dataset: Dataset, stage: str) -> None:
    """Refuse, with UserError, a stage that is damaged or not finished with this configuration."""
    root, broken = dataset.root, damaged(dataset, stage)
    if broken:
        problem = f"{broken[0]} is missing or damaged"
    elif not entry(dataset, stage):
        problem = f"{root}: stage {stage!r} is not finished with this configuration"
    else:
        return
    target = (root, "--out", root) if stage == "render" else (root,)
    raise UserError(
        f"{problem}; run first: {shell_command(*STAGES[stage].command.split(), *target)}"
    )


def timings(dataset: Dataset) -> dict[str, float]:
    """Seconds of the last run of each stage."""
    path = dataset.result("timings.json")
    with bounded.undamaged(path, "remove it (it holds only times)"):
        spent = dict(bounded.read_json(path)) if path.exists() else {}
        return {str(stage): float(seconds) for stage, seconds in spent.items()}


def stage_hash(configuration: Configuration, stage: str) -> str:
    """Hash of every setting that a stage's output depends on."""
    return digest(json.dumps(registry.stage_configuration(configuration, stage), sort_keys=True))
