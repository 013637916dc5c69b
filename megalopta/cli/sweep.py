"""`megalopta sweep`."""

from argparse import Namespace
from pathlib import Path
from typing import TYPE_CHECKING

from megalopta.cli.command import Verbs, add_out, add_verb, add_workers

if TYPE_CHECKING:
    from megalopta.config.settings import Settings


def declare(verbs: Verbs) -> None:
    """Add the verb."""
    purpose = "measure the photons that motion detectors need over any parameter of the benchmark"
    command = add_verb(verbs, "sweep", purpose, _run)
    command.settings = _settings
    text = "YAML file: trial, vary, values, sizes, templates"
    command.add_argument("sweep", type=Path, help=text)
    text = "run what the file names as module:function or ONNX file; otherwise it is refused"
    command.add_argument("--allow-code", action="store_true", help=text)
    add_out(command, "out/sweeps")
    add_workers(command)


def _settings() -> "Settings":
    from megalopta.benchmark.sweep import Sweep
    from megalopta.config.settings import Settings

    return Settings(Sweep())


def _run(options: Namespace) -> None:
    from megalopta.benchmark.sweep import load_sweep
    from megalopta.benchmark.sweep_cost import announce_sweep
    from megalopta.reproduction.drawing import Means, reproduce_sweep

    sweep = load_sweep(options.sweep, options.overrides, options.allow_code)
    announce_sweep(sweep)
    means = Means(options.workers, options.cache, options.scheduler)
    for path in reproduce_sweep(options.sweep.stem, sweep, options.out, means):
        print(path)
