"""`megalopta check`."""

import sys
from argparse import Namespace
from pathlib import Path

from megalopta.cli.command import Verbs, add_verb
from megalopta.errors import UserError


def declare(verbs: Verbs) -> None:
    """Add the verb."""
    purpose = (
        "prove every sensor effect against theory, a dataset's truth another way, or that its "
        "files are as they were written"
    )
    command = add_verb(verbs, "check", purpose, _run)
    subjects = ["physics", "truth", "files", "panoramas"]
    command.add_argument("what", choices=subjects, help="what to prove")
    command.add_argument(
        "dataset",
        nargs="?",
        type=Path,
        help="dataset folder, for truth and files; folder for new panoramas, for panoramas",
    )
    command.add_argument("--plots", type=Path, help="folder for pictures of the counting laws")


def _run(options: Namespace) -> None:
    if not _passes(options.what, options.dataset, options.plots):
        sys.exit(1)


def _passes(what: str, folder: Path | None, plots: Path | None) -> bool:
    from megalopta import checks
    from megalopta.stages import open_dataset_whole

    if what == "panoramas":
        return checks.run_check_panoramas(folder)
    if what == "physics" and folder is not None:
        raise UserError(f"check physics: takes no dataset, got {folder}")
    if what != "physics" and plots is not None:
        raise UserError(f"check {what}: draws no pictures; leave --plots out")
    if what != "physics" and folder is None:
        raise UserError(f"check {what}: which dataset? give its folder")
    if folder is None:
        return checks.run_check_physics(plots)
    check = checks.run_check_truth if what == "truth" else checks.run_check_files
    return check(open_dataset_whole(folder))
