"""What the verbs share that run stages: settings, --redo, and a configuration or a dataset."""

from argparse import Namespace
from functools import partial
from typing import TYPE_CHECKING

from megalopta.cli.command import Command, Run, Verbs, add_cluster, add_dataset, add_out, add_verb
from megalopta.config.built_in import built_in_names
from megalopta.core.errors import UserError

if TYPE_CHECKING:
    from pydantic import BaseModel

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


def add_later_stage(verbs: Verbs, name: str, purpose: str) -> None:
    """Add a verb that runs the stage of its name on a dataset."""
    command = _add_stage(verbs, name, purpose, run_later_stage)
    command.set_defaults(stage=name)
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


def add_redo(command: Command) -> None:
    """Add whether to replace what is there."""
    command.add_argument(
        "--redo", action="store_true", help="replace output of another configuration"
    )


def settings_of_stage(stage: str, *others: "BaseModel") -> "Settings":
    """Return those that a stage depends on, all for what is no stage, and those of others."""
    from megalopta.config.model import load
    from megalopta.config.settings import Settings
    from megalopta.stages.registry import STAGES

    fields = STAGES[stage].fields if stage in STAGES else None
    return Settings(load("demo"), fields, others)


def run_later_stage(options: Namespace) -> None:
    """Run the stage that the options name on their dataset, of one sequence or of many."""
    from megalopta.dataset.layout import is_of_many

    if is_of_many(options.dataset):
        _run_on_many(options)
        return
    if options.workers or options.scheduler:
        given = "--workers" if options.workers else "--scheduler"
        raise UserError(f"{options.dataset}: a dataset of one sequence; leave {given} out")
    _run_on_one(options)


def _run_on_many(options: Namespace) -> None:
    from megalopta.generation.exposing import expose, load_exposing
    from megalopta.generation.measuring import measure

    root, stage, where = options.dataset, options.stage, (options.workers, options.scheduler)
    if stage != "sense":
        measure(root, stage, options.overrides, options.redo, *where)
    elif options.redo:
        raise UserError(
            f"{root}: a dataset of many sequences, to which sense adds exposures; leave --redo out"
        )
    else:
        expose(root, load_exposing(options.overrides), *where)


def _run_on_one(options: Namespace) -> None:
    from megalopta.config.model import parse
    from megalopta.config.yaml_model import to_yaml
    from megalopta.stages.pipeline import run_stage
    from megalopta.stages.redo import open_dataset_whole

    stored = to_yaml(open_dataset_whole(options.dataset).configuration)
    changed = parse(stored, str(options.dataset), options.overrides)
    run_stage(options.dataset, changed, options.stage, options.redo)


def _add_stage(verbs: Verbs, name: str, purpose: str, run: Run) -> Command:
    command = add_verb(verbs, name, purpose, run)
    command.settings = partial(settings_of_stage, name)
    add_redo(command)
    return command
