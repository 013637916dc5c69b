"""`raw.bin` read back into a recording, after a capture that was killed or had no room.

The bytes are gone through twice: first for when the camera was set how, and then for its frames,
which go the same way through the same writer as those of a capture. What a capture knows beside
them, kind and clocks, is taken from recording.yaml as far as it was written.
"""

import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import NamedTuple
from uuid import uuid4

from megalopta.camera.recording import (
    COUNTS,
    RAW,
    SETTINGS,
    RecordingSettings,
    check_folder,
    check_kind,
    open_recording,
    read_settings,
)
from megalopta.camera.replay import RawSource, Replay, Told
from megalopta.core.bounded import check_file
from megalopta.core.errors import UserError
from megalopta.core.files import atomic_write, remove, sweep
from megalopta.core.folders import locked
from megalopta.core.progress import progress, silent
from megalopta.sensor import Sensor, open_counts

_LARGEST_BYTES = 2**62
_LONG_BYTES = 50_000_000
"""What takes more than some two seconds."""


class Recovered(NamedTuple):
    """A recording that was read back: where, what it says, and what nobody knows of it."""

    path: Path
    record: RecordingSettings
    unknown: tuple[str, ...]


def recover(raw: Path, out: Path | None = None, told: Told = Told()) -> Recovered:  # noqa: B008
    """Read `raw.bin` back into a recording.

    Parameters
    ----------
    raw : Path
        The file, or the folder of a recording.
    out : Path, optional
        New folder; by default the recording's own, whose counts are replaced once the new ones
        are whole, and for a file alone one of its name beside it.
    told : Told

    Raises
    ------
    UserError
        When there is nothing to read back, its settings are not known, it is being recorded, or
        a recording is whole; nothing is changed then.
    """
    if told.kind is not None:
        check_kind(told.kind)
    raw, folder = _parts(raw)
    if out is None and folder is not None:
        with locked(folder):
            return _in_place(folder, told)
    source = _source(raw, folder)
    out = out or raw.with_suffix("")
    if out.exists() or out.is_symlink():
        raise UserError(f"{out}: exists already; choose another --out, or remove it")
    with atomic_write(out) as temporary:
        temporary.mkdir()
        recovered = _written(source, told, temporary)
        shutil.copyfile(raw, temporary / RAW)
    return recovered._replace(path=out)


def _parts(raw: Path) -> tuple[Path, Path | None]:
    """The file of bytes, and the folder of the recording that it lies in."""
    if raw.is_dir():
        raw, folder = raw / RAW, raw
    else:
        folder = raw.parent
        if raw.name != RAW or not any((folder / each).exists() for each in (COUNTS, SETTINGS)):
            check_file(raw, _LARGEST_BYTES)
            return raw, None
    check_folder(folder)
    check_file(raw, _LARGEST_BYTES)
    return raw, folder


def _source(raw: Path, folder: Path | None) -> RawSource:
    """Return the parts of a recording on the disk, damaged or not."""
    before, sensor = None, None
    if folder is not None:
        with suppress(ValueError, OSError):
            before = read_settings(folder)
        with suppress(ValueError, OSError):
            opened = open_counts(folder / COUNTS)
            sensor = opened.sensor if isinstance(opened.sensor, Sensor) else None
    return RawSource(raw, before, sensor)


def _in_place(folder: Path, told: Told) -> Recovered:
    sweep(folder)
    source, held = _source(folder / RAW, folder), _frames_held(folder)
    if source.before is not None and source.before.finished and held == source.before.frames:
        raise UserError(
            f"{folder}: is whole, with {held} frames; give --out to read raw.bin back elsewhere"
        )
    with _beside(folder) as temporary:
        recovered = _written(source, told, temporary)
        if recovered.record.frames < held:
            raise UserError(
                f"{folder}: holds {held} frames, raw.bin only {recovered.record.frames}; give "
                "--out to read it back elsewhere"
            )
        remove(folder / COUNTS)
        (temporary / COUNTS).rename(folder / COUNTS)
        (temporary / SETTINGS).replace(folder / SETTINGS)
    return recovered._replace(path=folder)


def _frames_held(folder: Path) -> int:
    try:
        with silent():
            return len(open_recording(folder))
    except (ValueError, OSError):
        return 0


@contextmanager
def _beside(folder: Path) -> Iterator[Path]:
    """Yield a folder that does not stay."""
    temporary = folder / f".part-{uuid4().hex[:12]}-recovered"
    temporary.mkdir()
    try:
        yield temporary
    finally:
        remove(temporary)


def _written(source: RawSource, told: Told, folder: Path) -> Recovered:
    with _reading(2 * source.raw.stat().st_size) as read:
        replay = Replay(source, told, read)
        record = replay.write(folder)
    return Recovered(folder, record, tuple(replay.unknown))


@contextmanager
def _reading(size: int) -> Iterator[Callable[[int], None]]:
    """Show how far a file is read, where that takes long."""
    if size < _LONG_BYTES:
        yield lambda read: None
        return
    with progress("recover", size, "byte") as advance:
        yield advance
