"""`megalopta render`."""

from argparse import Namespace
from pathlib import Path

from megalopta.cli.command import Verbs
from megalopta.cli.stage_command import add_first_stage, configuration
from megalopta.core.errors import UserError


def declare(verbs: Verbs) -> None:
    """Add the verb."""
    purpose = "render a scene to spectral-radiance EXRs with exact ground truth"
    command = add_first_stage(verbs, "render", purpose, _run)
    text = "tell size, time, memory and integrator from a short measurement, and render nothing"
    command.add_argument("--dry-run", action="store_true", help=text)


def _run(options: Namespace) -> None:
    from megalopta.dataset.layout import is_of_many

    if options.configuration and is_of_many(Path(options.configuration)):
        _go_on(options)
        return
    if options.dry_run:
        from megalopta.generation.dry_run import dry_run_of_frames

        print(dry_run_of_frames(options.out, configuration(options)))
        return
    from megalopta.stages.pipeline import run_stage
    from megalopta.stages.redo import finish_move

    finish_move(options.out)  # which may be the configuration, too
    run_stage(options.out, configuration(options), "render", options.redo)


def _go_on(options: Namespace) -> None:
    """Make the sequences that a dataset of many still lacks."""
    from megalopta.config.recipe import load_plan
    from megalopta.generation.making import make

    if options.redo or options.dry_run:
        raise UserError(
            f"{options.configuration}: a dataset of many sequences; remove a sequence's record to "
            "make it again, and see megalopta dataset make --help for --dry-run"
        )
    make(options.out, load_plan(Path(options.configuration), options.overrides))
