"""Finished output moved to its place in a dataset, whole however often the move is broken off.

What is made lies in a folder of its own inside the dataset: output that is made again in `.redo`, a
new sequence, or more output of one, in `.making/SEQ`. `request.json` there says what was asked for,
and with what it is made: what was begun otherwise is begun again. When all of it is there,
`publish.json` lists what moves and what goes. From then on whoever works in the dataset completes
the move first. Every step can be broken off, also by a kill.
"""

import os
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from megalopta.config.model import Configuration, differences
from megalopta.core import bounded, files
from megalopta.core.errors import UserError
from megalopta.core.folders import LOCK_NAME, check_no_links
from megalopta.core.progress import say

PLAN, _REQUEST = "publish.json", "request.json"


@dataclass(frozen=True)
class Staging:
    """Output that is being made beside what is there."""

    root: Path
    """The dataset"""
    folder: Path
    """Where it is made, and lists of what is asked for and what moves lie"""
    data: Path
    """Its files, under the names that they have in the dataset"""
    last: tuple[Path, Path]
    """What moves last, and where to: as long as it is there, something is left to do"""

    def begin(
        self,
        made_with: Mapping[str, Any],
        settings: Configuration,
        prepare: Callable[[], object] = lambda: None,
    ) -> None:
        """Note what is asked for, once it is prepared; what was begun otherwise is removed."""
        wanted = {"made_with": made_with, "configuration": settings.model_dump(mode="json")}
        before = self._request()
        if before != wanted:
            if before and (changes := differences(before, wanted)):
                told = "; ".join(changes[:3])
                say(f"{self.folder.name}: begun with others ({told}), and begun again")
            self.clear()
            prepare()
            files.write_json(self.folder / _REQUEST, wanted)
        files.sweep(self.folder)

    def announce(self, moves: Iterable[str], goes: Iterable[str] = ()) -> None:
        """List what moves and what goes: all of it is there."""
        files.write_json(self.folder / PLAN, {"moves": sorted(moves), "goes": sorted(goes)})

    @property
    def is_announced(self) -> bool:
        """Whether all is there, and moves or has moved."""
        return os.path.lexists(self.folder / PLAN)

    def complete(self, is_output: Callable[[str], bool]) -> None:
        """Move what is announced, remove what goes; what was moved before is left.

        Raises UserError when something listed is no output of this dataset.
        """
        source, target = self.last
        if not source.exists():
            return
        moves, goes = self._read(is_output)
        for name in moves:
            _move(self.data / name, self.root / name)
        for name in goes:
            files.remove(self.root / name)
            with suppress(OSError):  # that holds something else; the dataset itself always does
                os.removedirs((self.root / name).parent)
        _move(source, target)

    def clear(self) -> None:
        """Remove everything but the lock, which its holder removes.

        What says how far it is goes first, so that nobody takes what a kill leaves for whole.
        """
        for name in (PLAN, self.last[0].name, _REQUEST):
            files.remove(self.folder / name)
        for path in sorted(self.folder.glob("*")):
            if path.name != LOCK_NAME:
                files.remove(path)

    def _request(self) -> dict[str, Any] | None:
        """What was asked for when it was begun; None where it cannot be read."""
        try:
            return dict(bounded.read_json(self.folder / _REQUEST))
        except (OSError, ValueError, TypeError):
            return None

    def _read(self, is_output: Callable[[str], bool]) -> tuple[list[str], list[str]]:
        path, remedy = self.folder / PLAN, f"remove the folder {self.folder}"
        try:
            record = bounded.read_json(path)
            moves, goes = ([str(name) for name in record[key]] for key in ("moves", "goes"))
            for name in moves:
                check_no_links(self.data / name)  # what a link leads to changes with its place
        except UserError as problem:
            raise UserError(f"{path} cannot be followed ({problem}); {remedy}") from None
        except (ValueError, KeyError, TypeError):
            raise UserError(f"{path} is damaged; {remedy}") from None
        for name in (*moves, *goes):
            bases = self.root, self.data
            if not is_output(name) or not all(_is_plain(self.root, b / name) for b in bases):
                raise UserError(f"{path}: {bounded.quoted(name)} is no output of a stage; {remedy}")
        return moves, goes


def link(root: Path, folder: Path, name: str) -> None:
    """Link output that is there to where more is made; relative, as either may be moved."""
    path, place = root / name, folder / name
    place.parent.mkdir(parents=True, exist_ok=True)
    target = os.path.relpath(path.resolve(), place.parent.resolve())
    place.symlink_to(target, target_is_directory=path.is_dir())


def _is_plain(root: Path, path: Path) -> bool:
    """Whether no folder between the root and something in it is a link."""
    real = Path(os.path.realpath(root), path.parent.relative_to(root))
    return Path(os.path.realpath(path.parent)) == real


def _move(source: Path, target: Path) -> None:
    if source.exists():
        if source.is_dir() or target.is_dir():
            files.remove(target)
        target.parent.mkdir(parents=True, exist_ok=True)
        source.rename(target)  # of a file at once: a record is never missing
