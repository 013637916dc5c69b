"""`megalopta demo`."""

from argparse import Namespace

from megalopta.cli.command import Verbs
from megalopta.cli.stage_command import add_first_stage, configuration


def declare(verbs: Verbs) -> None:
    """Add the verb."""
    purpose = "do everything: render, sense, flow, benchmark and a report to open in a browser"
    add_first_stage(verbs, "demo", purpose, _run)


def _run(options: Namespace) -> None:
    from megalopta.report import write_report
    from megalopta.stages import run_all

    print(write_report(run_all(options.out, configuration(options), options.redo)))
