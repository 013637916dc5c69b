"""The report of a dataset: one HTML file that needs nothing else, to be opened in a browser."""

from pathlib import Path

from megalopta import files
from megalopta.dataset import Dataset


def write_report(dataset: Dataset) -> Path:
    """Write DATASET/report.html from the stages that are finished; returns its path.

    Raises
    ------
    UserError
        When nothing was rendered yet, or a file cannot be read.
    """
    dataset.require("render")
    # Matplotlib takes a second to load: only who wants a report should wait for it.
    from megalopta.report.page import page

    path = dataset.root / "report.html"
    files.write_text(path, page(dataset))
    return path
