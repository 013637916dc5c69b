"""`megalopta render`."""

from argparse import Namespace

from megalopta.cli.command import Verbs
from megalopta.cli.stage_command import add_first_stage, configuration


def declare(verbs: Verbs) -> None:
    """Add the verb."""
    purpose = "render a scene to spectral-radiance EXRs with exact ground truth"
    add_first_stage(verbs, "render", purpose, _run)


def _run(options: Namespace) -> None:
    from megalopta.stages import finish_move, run_stage

    finish_move(options.out)  # which may be the configuration, too
    run_stage(options.out, configuration(options), "render", options.redo)
