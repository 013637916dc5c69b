"""`megalopta render`."""

from argparse import Namespace

from megalopta.cli.command import Verbs
from megalopta.cli.stage_command import add_first_stage, configuration


def declare(verbs: Verbs) -> None:
    """Add the verb."""
    purpose = "render a scene to spectral-radiance EXRs with exact ground truth"
    command = add_first_stage(verbs, "render", purpose, _run)
    text = "tell size, time, memory and integrator from a short measurement, and render nothing"
    command.add_argument("--dry-run", action="store_true", help=text)


def _run(options: Namespace) -> None:
    if options.dry_run:
        from megalopta.generation.dry_run import dry_run_of_frames

        print(dry_run_of_frames(options.out, configuration(options)))
        return
    from megalopta.stages.pipeline import run_stage
    from megalopta.stages.redo import finish_move

    finish_move(options.out)  # which may be the configuration, too
    run_stage(options.out, configuration(options), "render", options.redo)
