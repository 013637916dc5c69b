"""What is being made beside the tree: begun again or gone on with, and cleared when it is over.

.making/SEQ/            a sequence until it is whole; .making/SEQ-added/ more output of it
    request.json        what was asked for, and with what it is made: another is begun again
    data/               the files
    record.json         the record, which moves last
    publish.json        all is there, and moves (`dataset.publishing`)

Every step of this can be broken off, also by a kill, and is done again or gone on with by whoever
comes next.
"""

import re
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path

from megalopta.config.model import Configuration, differences
from megalopta.core import files
from megalopta.core.errors import UserError
from megalopta.core.folders import LOCK_NAME, locked
from megalopta.core.progress import say
from megalopta.dataset.layout import Tree, changed_record
from megalopta.dataset.manifest import is_record_as_written, is_record_known, read_manifest
from megalopta.dataset.publishing import PLAN, REQUEST, Move, read_request
from megalopta.dataset.record import KINDS, MADE, SequenceRecord, is_output, read_record
from megalopta.dataset.store import file_hash
from megalopta.stages.origins import provenance

ADDED = "-added"
_STAGED = re.compile(rf"(\d{{6,}})({ADDED})?")
_RECORD = "record.json"


def begin(staged: Path, configuration: Configuration, stages: Sequence[str] = MADE) -> Path:
    """Return the folder to work in, emptied where it was begun for other stages or otherwise."""
    wanted = {
        "made_with": made_with(configuration, stages),
        "configuration": configuration.model_dump(mode="json"),
    }
    before = read_request(staged)
    if before != wanted:
        if before and (changes := differences(before, wanted)):
            say(f"{staged.name}: begun with others ({'; '.join(changes[:3])}), and begun again")
        clear(staged)
        files.write_json(staged / REQUEST, wanted)
    files.sweep(staged)
    return staged / "data"


def made_with(
    configuration: Configuration, stages: Sequence[str] = MADE
) -> dict[str, dict[str, str]]:
    """Return what the output of stages depends on beside the settings, here and now."""
    return {stage: provenance(stage, configuration) for stage in stages}


def finish(tree: Tree, staged: Path, record: SequenceRecord) -> None:
    """Note that all files of a record are there."""
    files.write_text(staged / _RECORD, record.to_json())
    is_added = staged.name.endswith(ADDED)
    _move(tree, staged, record.sequence).announce(_moved(staged / "data", record, is_added))


def is_finished(staged: Path) -> bool:
    """Whether all files are there, and move or have moved."""
    return (staged / PLAN).exists()


def publish(tree: Tree, staged: Path, name: str) -> None:
    """Move what is finished into the tree; a move that was broken off is completed."""
    _move(tree, staged, name).complete(partial(is_output, sequence=name))


def clear(staged: Path) -> None:
    """Remove everything but the lock, which its holder removes.

    What says how far it is goes first, so that nobody takes what a kill leaves for whole.
    """
    for name in (PLAN, _RECORD, REQUEST):
        files.remove(staged / name)
    for path in sorted(staged.iterdir()):
        if path.name != LOCK_NAME:
            files.remove(path)


def settle(tree: Tree, write_index: Callable[[], None]) -> None:
    """Bring a tree to where its manifest knows all of its records, after whatever was broken off.

    Raises
    ------
    UserError
        When somebody changed a record.
    """
    tree.sweep()
    manifest, names = read_manifest(tree.root), tree.names()
    unknown = [name for name in names if not is_record_known(tree.record_path(name), manifest)]
    for name in unknown:
        if not is_record_as_written(tree.record_path(name), manifest):
            raise UserError(changed_record(tree, name))
    if manifest and (unknown or manifest.keys() - set(names)):
        write_index()


def tidy(tree: Tree, keep_added: bool = False) -> None:
    """Complete what is finished, and remove what is over, of all that is beside the tree."""
    for staged, name in staged_sequences(tree):
        with locked(staged):
            if _is_over(tree, staged, name, keep_added):
                clear(staged)
            elif is_finished(staged):
                publish(tree, staged, name)
                clear(staged)
        if not any(staged.iterdir()):
            staged.rmdir()
    if tree.staging.is_dir() and not any(tree.staging.iterdir()):
        tree.staging.rmdir()


def staged_sequences(tree: Tree) -> Iterator[tuple[Path, str]]:
    """Yield the folders of what is being made, with the name of the sequence."""
    for path in sorted(tree.staging.glob("*")):
        if (found := _STAGED.fullmatch(path.name)) and path.is_dir() and not path.is_symlink():
            yield path, found[1]


def _is_over(tree: Tree, staged: Path, name: str, keep_added: bool) -> bool:
    if not staged.name.endswith(ADDED):
        return tree.record_path(name).exists()
    return not _is_wanted(tree, staged, name) if is_finished(staged) else not keep_added


def _is_wanted(tree: Tree, staged: Path, name: str) -> bool:
    """Whether what is added is still of the sequence as it is: it may have been made again."""
    try:
        replaced = read_record(staged / _RECORD, name).replaced
        return replaced == file_hash(tree.record_path(name))
    except (OSError, UserError):
        return False


def _move(tree: Tree, staged: Path, name: str) -> Move:
    return Move(tree.root, staged, staged / "data", (staged / _RECORD, tree.record_path(name)))


def _moved(data: Path, record: SequenceRecord, is_added: bool) -> list[str]:
    """Folders that hold all files of a sequence and nothing else; of what is added, all of it."""
    if is_added:
        made = (data / kind / record.sequence for kind in KINDS)
        parts = [path for folder in made if not folder.is_symlink() for path in folder.glob("*")]
        return sorted(path.relative_to(data).as_posix() for path in parts)
    return list(dict.fromkeys(_folder(path, record.sequence) for path in record.files))


def _folder(path: str, sequence: str) -> str:
    parts = Path(path).parts
    return str(Path(*parts[: parts.index(sequence) + 1]))
