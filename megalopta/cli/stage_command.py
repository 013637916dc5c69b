"""What the verbs share that run stages: settings, --redo, and a configuration or a dataset."""

from argparse import Namespace
from functools import partial
from typing import TYPE_CHECKING

from megalopta.cli.command import Command, Run, Verbs, add_cluster, add_dataset, add_out, add_verb
from megalopta.config.built_in import built_in_names
from megalopta.core.errors import UserError

if TYPE_CHECKING:
    from megalopta.config.model import Configuration
    from megalopta.config.settings import Settings


def add_first_stage(verbs: Verbs, name: str, purpose: str, run: Run) -> Command:
    """Add a verb that begins a dataset from a configuration, and return it."""
    command = _add_stage(verbs, name, purpose, run)
    names = ", ".join(built_in_names())
    command.add_argument(
        "configuration", nargs="?", help=f"YAML file, or one of {names} (default: demo)"
    )
    add_out(command, "out/demo", "dataset folder")
    return command


def add_later_stage(verbs: Verbs, name: str, purpose: str, stage: str | None = None) -> None:
    """Add a verb that runs a stage on a dataset, that of its name or another."""
    command = _add_stage(verbs, name, purpose, _run, stage)
    command.set_defaults(stage=stage or name)
    add_dataset(command)
    add_cluster(command)


def configuration(options: Namespace) -> "Configuration":
    """Read the configuration that is named, or the demo's.

    "airglow" is a light level and a configuration: at the end of a list it could be either.
    """
    from megalopta.config.model import load

    for path, value in options.overrides.items():
        last = value.rpartition(", ")[2].strip("]")
        if options.configuration is None and "," in value and last in built_in_names():
            raise UserError(
                f"{last}: a value of --{path}, or the configuration? give the configuration first"
            )
    return load(options.configuration or "demo", options.overrides)


def _add_stage(
    verbs: Verbs, name: str, purpose: str, run: Run, stage: str | None = None
) -> Command:
    command = add_verb(verbs, name, purpose, run)
    command.settings = partial(_settings, stage or name)
    command.add_argument(
        "--redo", action="store_true", help="replace output of another configuration"
    )
    return command


def _settings(stage: str) -> "Settings":
    """Those that a stage depends on; all for what is no stage."""
    from megalopta.config.model import load
    from megalopta.config.settings import Settings
    from megalopta.stages.registry import STAGES

    return Settings(load("demo"), STAGES[stage].fields if stage in STAGES else None)


def _run(options: Namespace) -> None:
    """Run a stage on a dataset of one sequence or of many."""
    from megalopta.dataset.layout import is_of_many

    if is_of_many(options.dataset):
        _run_on_many(options)
        return
    if options.workers or options.scheduler:
        raise UserError(f"{options.stage}: a dataset of one sequence; leave --workers out")
    _run_on_one(options)


def _run_on_many(options: Namespace) -> None:
    from megalopta.generation.exposing import expose, load_exposing
    from megalopta.generation.measuring import measure

    root, workers, scheduler = options.dataset, options.workers, options.scheduler
    if options.stage == "sense":
        expose(root, load_exposing(options.overrides), workers, scheduler)
    else:
        measure(
            root,
            options.stage,
            options.overrides,
            redo=options.redo,
            workers=workers,
            scheduler=scheduler,
        )


def _run_on_one(options: Namespace) -> None:
    from megalopta.config.model import parse
    from megalopta.config.yaml_model import to_yaml
    from megalopta.stages.pipeline import run_stage
    from megalopta.stages.redo import open_dataset_whole

    stored = to_yaml(open_dataset_whole(options.dataset).configuration)
    changed = parse(stored, str(options.dataset), options.overrides)
    run_stage(options.dataset, changed, options.stage, options.redo)
