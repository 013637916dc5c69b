"""Writing the report of a dataset."""

from pathlib import Path

from megalopta import files
from megalopta.dataset import Dataset
from megalopta.report.page import page
from megalopta.stages import Ledger


def write_report(dataset: Dataset) -> Path:
    """Write DATASET/report.html from the stages that are finished; returns its path.

    Raises
    ------
    UserError
        When nothing was rendered yet, or a file cannot be read.
    """
    Ledger(dataset).require("render")
    path = dataset.root / "report.html"
    files.write_text(path, page(dataset))
    return path
