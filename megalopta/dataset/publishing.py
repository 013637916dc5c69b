"""Move finished output into a dataset, complete even if the move is interrupted.

New output is made in a folder of its own inside the dataset: redone output in `.redo`, a new
sequence, or more output of one, in `.making/SEQ`. `request.json` there records the request and the
software: output begun with others is begun again. When all is complete, `publish.json` lists what
moves and what is removed. From then on, whoever works in the dataset completes the move first.
Every step can be interrupted, even by a kill.
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
    """Output that is being made next to existing output."""

    root: Path
    """The dataset"""
    folder: Path
    """Folder of the new output, its request and its moves"""
    data: Path
    """New files, under the names that they have in the dataset"""
    last: tuple[Path, Path]
    """Source and target of the last move: while the source exists, the move is unfinished"""

    def begin(
        self,
        made_with: Mapping[str, Any],
        settings: Configuration,
        prepare: Callable[[], object] = lambda: None,
    ) -> None:
        """Record the request, once it is prepared; output of another request is removed."""
        wanted = {"made_with": made_with, "configuration": settings.model_dump(mode="json")}
        before = self._request()
        if before != wanted:
            if before and (changes := differences(before, wanted)):
                reasons = "; ".join(changes[:3])
                say(f"{self.folder.name}: begun with other settings ({reasons}); starting again")
            self.clear()
            prepare()
            files.write_json(self.folder / _REQUEST, wanted)
        files.sweep(self.folder)

    def announce(self, moves: Iterable[str], goes: Iterable[str] = ()) -> None:
        """List what moves and what is removed, when all is complete."""
        files.write_json(self.folder / PLAN, {"moves": sorted(moves), "goes": sorted(goes)})

    @property
    def is_announced(self) -> bool:
        """True if all is complete, and moves or has moved."""
        return os.path.lexists(self.folder / PLAN)

    def complete(self, is_output: Callable[[str], bool]) -> None:
        """Move and remove everything on the list; earlier moves are skipped.

        Raises UserError if a listed path is no output of this dataset.
        """
        source, target = self.last
        if not source.exists():
            return
        moves, goes = self._read(is_output)
        for name in moves:
            _move(self.data / name, self.root / name)
        for name in goes:
            files.remove(self.root / name)
            with suppress(OSError):  # with other content; the dataset itself always has some
                os.removedirs((self.root / name).parent)
        _move(source, target)

    def clear(self) -> None:
        """Remove everything but the lock, which its holder removes.

        The lists are removed first, so that the remains of a kill are not taken for complete.
        """
        for name in (PLAN, self.last[0].name, _REQUEST):
            files.remove(self.folder / name)
        for path in sorted(self.folder.glob("*")):
            if path.name != LOCK_NAME:
                files.remove(path)

    def _request(self) -> dict[str, Any] | None:
        """Request that the output was begun for; None if it cannot be read."""
        try:
            return dict(bounded.read_json(self.folder / _REQUEST))
        except (OSError, ValueError, TypeError):
            return None

    def _read(self, is_output: Callable[[str], bool]) -> tuple[list[str], list[str]]:
        path, remedy = self.folder / PLAN, f"remove the folder {self.folder}"
        with bounded.undamaged(path, remedy):
            record = bounded.read_json(path)
            moves, goes = ([str(name) for name in record[key]] for key in ("moves", "goes"))
        for name in moves:
            check_no_links(self.data / name)  # the target of a link depends on its place
        for name in (*moves, *goes):
            bases = self.root, self.data
            if not is_output(name) or not all(_is_plain(self.root, b / name) for b in bases):
                raise UserError(f"{path}: {bounded.quoted(name)} is no output of a stage; {remedy}")
        return moves, goes


def link(root: Path, folder: Path, name: str) -> None:
    """Link existing output to where more is made; relative, as either may be moved."""
    path, place = root / name, folder / name
    place.parent.mkdir(parents=True, exist_ok=True)
    target = os.path.relpath(path.resolve(), place.parent.resolve())
    place.symlink_to(target, target_is_directory=path.is_dir())


def _is_plain(root: Path, path: Path) -> bool:
    """True if no folder between the root and a path in it is a link."""
    real = Path(os.path.realpath(root), path.parent.relative_to(root))
    return Path(os.path.realpath(path.parent)) == real


def _move(source: Path, target: Path) -> None:
    if source.exists():
        if source.is_dir() or target.is_dir():
            files.remove(target)
        target.parent.mkdir(parents=True, exist_ok=True)
        source.rename(target)  # a file is replaced atomically: a record is never missing
