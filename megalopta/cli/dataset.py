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
from megalopta.core.errors import UserError
from megalopta.settings.verb_settings import VerbSettings

VERBS["dataset"] = Verb("make a dataset of many sequences")


@verb(
    "dataset make",
    "make a dataset of any size from a plan; finished sequences are kept",
    option("plan", "YAML file of the plan, or folder of a dataset to continue", Path),
    out("out/dataset", "dataset folder"),
    option("--only N", "only these sequences, such as 731 or 0-9,20"),
    switch("--retry", "only sequences that failed before"),
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
def _make(options: Namespace) -> Path | None:
    from megalopta.config.recipe import load_plan
    from megalopta.generation.dry_run import dry_run
    from megalopta.generation.making import make, parse_indices

    plan = load_plan(options.plan, options.overrides)
    if options.only and options.retry:
        raise UserError("dataset make: --only or --retry, not both")
    only = parse_indices(options.only, plan.sequences) if options.only else None
    if options.dry_run:
        dry_run(options.out, plan, options.workers or 1, only)
        return None
    where = {"workers": options.workers, "scheduler": options.scheduler}
    make(options.out, plan, only=only, retry=options.retry, **where)
    return Path(options.out)
