"""`megalopta demo`."""

from argparse import Namespace

from megalopta.cli.command import Verbs
from megalopta.cli.stage_command import add_first_stage, configuration
from megalopta.core.errors import UserError

_RANKED = {
    "methods": "[BM, DIS, PM, PF]",
    "fluxes": "[1e4, 1e5, 1e6, 1e7]",
    "repeats": "1",
    "pixels_pooled": "[1]",
    "frames_pooled": "[1]",
    "camera_pairs": "1",
}
"""Of the ranking: little, for the time that a demo has"""
_QUICK = {
    "scene.trees": "30",
    "scene.undergrowth": "0.2",
    "camera.width": "48",
    "camera.height": "48",
    "trajectory.frames": "6",
    "render.samples_per_pixel": "16",
    "light_levels": "[10, starlight]",
    "correct": "false",
    "methods": "[BM, DIS, PF]",
    "benchmark.sizes": "[24]",
    "benchmark.fluxes_per_decade": "1",
    "benchmark.repeats": "2",
}
"""Settings of --quick: everything once, small and noisy"""
_QUICKLY_RANKED = {"methods": "[BM, DIS, PF]", "fluxes": "[1e5, 1e7]", "camera_pairs": "0"}


def declare(verbs: Verbs) -> None:
    """Add the verb."""
    purpose = "do everything: render, sense, flow, benchmark and a report to open in a browser"
    command = add_first_stage(verbs, "demo", purpose, _run)
    command.add_argument(
        "--quick", action="store_true", help="a small and noisy form of it, in about a minute"
    )


def _run(options: Namespace) -> None:
    if options.quick:
        if options.configuration not in (None, "demo"):
            raise UserError(f"--quick: {options.configuration} has none; leave one of them out")
        options.overrides = {**_QUICK, **options.overrides}
    asked = configuration(options)  # refused before the rest is loaded

    from megalopta.benchmark.ranking_run import FOLDER, run_ranking
    from megalopta.flow.detectors.registry import METHODS
    from megalopta.report.page import write_report
    from megalopta.stages.pipeline import run_all

    dataset = run_all(options.out, asked, options.redo)
    if any(METHODS[name].gives == "velocity" for name in dataset.configuration.methods):
        ranked = _RANKED | (_QUICKLY_RANKED if options.quick else {})
        run_ranking(dataset.root, dataset.root / FOLDER, ranked)
    print(write_report(dataset))
