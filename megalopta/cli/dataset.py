"""`megalopta dataset`: make a dataset of many sequences."""

from argparse import Namespace
from pathlib import Path

from megalopta.cli.command import (
    CLUSTER,
    VERBS,
    Verb,
    option,
    out,
    switch,
    verb,
)
from megalopta.settings.verb_settings import VerbSettings

VERBS["dataset"] = Verb("make a dataset of many sequences")


@verb(
    "dataset make",
    "make a dataset of any size from a plan; finished sequences are kept",
    option("plan", "YAML file of the plan, or folder of a dataset to continue", Path),
    out("out/dataset", "dataset folder"),
    option("--only N", "only these sequences, such as 731 or 0-9,20"),
    switch(
        "--dry-run",
        "estimate sequences, frames, gigabytes and time from a short measurement; make nothing",
    ),
    *CLUSTER,
    settings=VerbSettings(("Plan",), argument="plan"),
    often=(
        *("sequences", "seed", "scenes", "lights", "cameras", "trajectories", "every"),
        *("sensors", "light_levels", "repeats", "products", "splits"),
    ),
    example="megalopta dataset make plan.yaml --out data --workers 2",
)
def _make(options: Namespace) -> Path | str:
    from megalopta.config.recipe import load_plan
    from megalopta.stages.estimate import estimate_plan
    from megalopta.stages.make import make, parse_indices

    plan = load_plan(options.plan, options.overrides)
    only = parse_indices(options.only, plan.sequences) if options.only else None
    if options.dry_run:
        return estimate_plan(options.out, plan, options.workers or 1, only)
    make(options.out, plan, only=only, workers=options.workers, scheduler=options.scheduler)
    return Path(options.out)
