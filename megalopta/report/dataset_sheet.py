"""`megalopta dataset view`: a contact sheet, one page without outside links."""

from pathlib import Path

from megalopta.core import files
from megalopta.core.errors import UserError
from megalopta.core.progress import progress
from megalopta.dataset.opened import open_dataset
from megalopta.dataset.sequence import Sequence
from megalopta.plotting.templates import render_page
from megalopta.plotting.text import level_name
from megalopta.report.dataset_clips import clips_of


def write_view(root: Path, most: int) -> Path:
    """Write index.html into a dataset, with clips of so many sequences; return its path.

    Raises UserError where no sequence is finished.
    """
    dataset = open_dataset(root)
    if not len(dataset):
        raise UserError(f"{root}: no finished sequence to show; run megalopta dataset make")
    names = dataset.names[:: max(1, -(-len(dataset) // most))]
    shown = []
    with progress("Drawing clips", len(names), "sequence") as advance:
        for sequence in map(dataset.__getitem__, names):
            shown.append((sequence, _told(sequence), list(clips_of(sequence))))
            advance()
    page = render_page(
        "megalopta.report",
        "dataset_sheet.html",
        title=root.resolve().name,
        shown=shown,
        all=len(dataset),
    )
    path = root / "index.html"
    files.write_text(path, page)
    return path


def _told(sequence: Sequence) -> str:
    settings = sequence.configuration
    light = level_name(settings.light.level)
    return (
        f"{settings.scene.kind.replace('_', ' ')} in {light}; the camera {settings.trajectory}; "
        f"{len(sequence)} frames of {settings.camera.width} × {settings.camera.height}"
    )
