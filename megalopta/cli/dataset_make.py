"""`megalopta dataset make`."""

from argparse import Namespace
from pathlib import Path
from typing import TYPE_CHECKING

from megalopta.cli.command import Verbs, add_cluster, add_out, add_verb
from megalopta.core.errors import UserError

if TYPE_CHECKING:
    from megalopta.config.settings import Settings


def declare(verbs: Verbs) -> None:
    """Add the verb."""
    purpose = "make a dataset of any size from a plan; what is there already is kept"
    command = add_verb(verbs, "make", purpose, _run)
    command.settings = _settings
    text = "YAML file with the plan, or a dataset's folder to go on with"
    command.add_argument("plan", type=Path, help=text)
    add_out(command, "out/dataset", "dataset folder")
    command.add_argument("--only", metavar="N", help="sequences, such as 731 or 0-9,20")
    command.add_argument("--retry", action="store_true", help="only those that failed before")
    text = "tell sequences, frames, gigabytes and time from a short measurement, and make nothing"
    command.add_argument("--dry-run", action="store_true", help=text)
    add_cluster(command)


def _settings() -> "Settings":
    from megalopta.config.recipe import Plan
    from megalopta.config.settings import Settings

    return Settings(Plan())


def _run(options: Namespace) -> None:
    from megalopta.config.recipe import load_plan
    from megalopta.generation.dry_run import dry_run
    from megalopta.generation.making import make, parse_indices

    plan = load_plan(options.plan, options.overrides)
    if options.only and options.retry:
        raise UserError("dataset make: --only or --retry, not both")
    only = parse_indices(options.only, plan.sequences) if options.only else None
    if options.dry_run:
        dry_run(options.out, plan, options.workers or 1, only)
        return
    make(
        options.out,
        plan,
        only=only,
        workers=options.workers,
        scheduler=options.scheduler,
        retry=options.retry,
    )
    print(options.out)
