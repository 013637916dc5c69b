"""`megalopta dataset`: make, check and preview a dataset of many sequences."""

import sys
from argparse import Namespace
from pathlib import Path

from megalopta.cli.command import (
    CLUSTER,
    DATASET,
    VERBS,
    Verb,
    at_least,
    option,
    out,
    switch,
    verb,
)
from megalopta.core.errors import UserError
from megalopta.settings.verb_settings import VerbSettings

VERBS["dataset"] = Verb("make, check and show a dataset of many sequences")


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


@verb(
    "dataset expose",
    "add sensors, exposures and light levels to a finished dataset",
    DATASET,
    *CLUSTER,
    settings=VerbSettings(("Exposing",)),
    example="megalopta dataset expose data --sensors ideal --light-levels 0.01",
)
def _expose(options: Namespace) -> Path:
    from megalopta.generation.adding import add_exposures

    where = options.workers, options.scheduler
    return add_exposures(options.dataset, options.overrides, *where).root


@verb(
    "dataset check",
    "verify a dataset: hashes, shapes, completeness, and flow derived independently",
    DATASET,
    option("--truth N", "sequences whose flow is rederived from depth and poses", at_least(0), 3),
)
def _check(options: Namespace) -> None:
    from megalopta.verification.files import run_check_files

    if not run_check_files(options.dataset, options.truth):
        sys.exit(1)


@verb(
    "dataset card", "write README.md: contents of a dataset, with statistics and pictures", DATASET
)
def _card(options: Namespace) -> Path:
    from megalopta.report.dataset_card import write_card

    return write_card(options.dataset)


@verb(
    "dataset view",
    "write index.html, a contact sheet with clips of light, counts, flow and depth",
    DATASET,
    option("--sequences N", "sequences to show, evenly spaced", at_least(1), 24),
)
def _view(options: Namespace) -> Path:
    from megalopta.report.dataset_card import write_contact_sheet

    return write_contact_sheet(options.dataset, options.sequences)
