"""One sequence of a plan, made beside the tree and moved into it when it is whole.

It is an ordinary dataset in `.making/SEQ/data` until then, so that a run that was killed goes on
inside the sequence. `record.json` there says that all of it is finished; what is left is to move
it, and the record goes last.
"""

from pathlib import Path

from megalopta import __version__, files
from megalopta.dataset import file_hash, files_in
from megalopta.folders import locked
from megalopta.making.flow_files import write_flow_files
from megalopta.making.statistics import sequence_statistics
from megalopta.plan import Plan, configuration_of, sequence_name, split_of
from megalopta.progress import silent
from megalopta.stages import STAGES, Ledger, run_stage
from megalopta.tree import SequenceRecord, Tree, read_record

MADE = ("render", "sense")
"""Stages of a sequence."""


def make_sequence(root: Path, plan: Plan, index: int) -> None:
    """Make a sequence, or what is missing of it. Raises UserError and OSError."""
    tree, name = Tree(root), sequence_name(index)
    staged = tree.staging / name
    with locked(staged), silent():
        if not tree.record_path(name).exists():
            if not (staged / "record.json").exists():
                _make(staged, plan, index)
            _publish(tree, staged, name)
        files.remove(staged / "data")


def _make(staged: Path, plan: Plan, index: int) -> None:
    configuration = configuration_of(plan, index)
    data = staged / "data"
    for stage in MADE:
        dataset = run_stage(data, configuration, stage)
    extra = write_flow_files(dataset, plan.flow_files)
    ledger = Ledger(dataset)
    lines = [entry for stage in MADE if (entry := ledger.entry(stage))]
    hashes = {path: tuple(each) for line in lines for path, each in line["files"].items()}
    record = SequenceRecord(
        sequence=configuration.name,
        index=index,
        split=split_of(plan, index),
        version=__version__,
        models={stage: STAGES[stage].model() for stage in MADE},
        configuration=configuration.model_dump(mode="json"),
        statistics=sequence_statistics(dataset),
        poses=tuple(map(tuple, configuration.trajectory.poses().reshape(-1, 16).tolist())),
        files=dict(sorted({**hashes, **file_hashes(data, extra)}.items())),
    )
    files.write_text(staged / "record.json", record.model_dump_json(indent=1) + "\n")


def file_hashes(root: Path, paths: list[Path]) -> dict[str, tuple[int, str]]:
    """Bytes and hash of files, and of those in folders, by their paths in a dataset."""
    return {
        str(path.relative_to(root)): (path.stat().st_size, file_hash(path))
        for path in sorted(files_in(paths))
    }


def _publish(tree: Tree, staged: Path, name: str) -> None:
    """Move a finished sequence into the tree; a move that was broken off is completed."""
    record = read_record(staged / "record.json")
    for folder in folders_of(record):
        source, target = staged / "data" / folder, tree.root / folder
        if source.exists():
            files.remove(target)
            target.parent.mkdir(parents=True, exist_ok=True)
            source.rename(target)
    tree.records.mkdir(exist_ok=True)
    (staged / "record.json").rename(tree.record_path(name))


def folders_of(record: SequenceRecord) -> list[str]:
    """Folders that hold all files of a sequence and nothing else."""
    found = dict.fromkeys(_folder(path, record.sequence) for path in record.files)
    return list(found)


def _folder(path: str, sequence: str) -> str:
    parts = Path(path).parts
    return str(Path(*parts[: parts.index(sequence) + 1]))
