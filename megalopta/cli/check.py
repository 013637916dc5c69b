"""`megalopta check`."""

import sys
from argparse import Namespace
from pathlib import Path

from megalopta.cli.command import option, verb
from megalopta.core.errors import UserError
from megalopta.verification import GROUPS


@verb(
    "check",
    "prove every sensor effect against theory, a dataset's truth another way, or that its files "
    "are as they were written",
    option("what", "what to prove", choices=["physics", "truth", "files", "panoramas"]),
    option(
        "subjects",
        "dataset folder, for truth and files; folder for new panoramas, for panoramas; for "
        f"physics any of {', '.join(GROUPS)}, by default all",
        nargs="*",
        metavar="FOLDER or GROUP",
    ),
)
def _check(options: Namespace) -> None:
    if not _passes(options.what, options.subjects):
        sys.exit(1)


def _passes(what: str, subjects: list[str]) -> bool:
    from megalopta.dataset.store import open_sequence
    from megalopta.verification import files, panoramas, physics, truth

    if what == "physics":
        return physics.run_check_physics(subjects)
    if len(subjects) > 1:
        raise UserError(f"check {what}: got {' '.join(subjects)}; give one folder")
    folder = Path(subjects[0]) if subjects else None
    if what == "panoramas":
        return panoramas.run_check_panoramas(folder)
    if folder is None:
        raise UserError(f"check {what}: which dataset? give its folder")
    if what == "files":
        return files.run_check_files(folder)
    return truth.run_check_truth(open_sequence(folder))
