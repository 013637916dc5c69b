"""`megalopta benchmark photons`: the photons that detectors need, on a dataset or in a sweep."""

from argparse import Namespace
from pathlib import Path
from typing import TYPE_CHECKING

from megalopta.cli.command import Verbs, add_verb, add_workers
from megalopta.cli.stage_command import add_redo, run_later_stage, settings_of_stage
from megalopta.core.errors import UserError

if TYPE_CHECKING:
    from megalopta.config.settings import Settings

_OF_SWEEPS = ("allow_code", "out", "cache")


def declare(verbs: Verbs) -> None:
    """Add the verb."""
    purpose = (
        "find how much light detectors need to agree with themselves, on a dataset or in a sweep"
    )
    command = add_verb(verbs, "photons", purpose, _run)
    command.settings = _settings
    command.set_defaults(stage="benchmark")
    text = "dataset folder; or a sweep's YAML file: trial, vary, values, sizes, templates"
    command.add_argument("dataset", type=Path, metavar="DATASET or SWEEP", help=text)
    add_redo(command)
    text = "run what a sweep names as module:function or ONNX file; otherwise it is refused"
    command.add_argument("--allow-code", action="store_true", help=text)
    text = "folder of a sweep's figure (default: out/sweeps)"
    command.add_argument("--out", type=Path, help=text)
    add_workers(command)


def _settings() -> "Settings":
    from megalopta.benchmark.sweep import Sweep

    return settings_of_stage("benchmark", Sweep())


def _run(options: Namespace) -> None:
    is_sweep = options.dataset.suffix in (".yaml", ".yml") and not options.dataset.is_dir()
    unused = ("redo",) if is_sweep else _OF_SWEEPS
    for name in unused:
        if getattr(options, name):
            kind = "a dataset" if is_sweep else "a sweep"
            raise UserError(
                f"benchmark photons: --{name.replace('_', '-')} is for {kind}; leave it out"
            )
    if is_sweep:
        _run_sweep(options)
    else:
        run_later_stage(options)


def _run_sweep(options: Namespace) -> None:
    from megalopta.benchmark.sweep import announce_sweep, load_sweep
    from megalopta.reproduction.drawing import Means, reproduce_sweep

    path, out = options.dataset, options.out or Path("out/sweeps")
    sweep = load_sweep(path, options.overrides, options.allow_code)
    announce_sweep(sweep)
    means = Means(options.workers, options.cache, options.scheduler)
    for written in reproduce_sweep(path.stem, sweep, out, means):
        print(written)
