"""The command line: one verb per stage, every setting overridable by its path.

Exit codes: 0 done, 2 the user's mistake told in one sentence, 130 interrupted. A traceback means
that the mistake is ours.
"""

import argparse
import os
import sys
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import NoReturn

from pydantic import BaseModel

from megalopta import __version__
from megalopta.cli.overrides import settings_help, split_overrides
from megalopta.config import Configuration, built_in_names, load, parse, to_yaml
from megalopta.errors import UserError, machine_problem
from megalopta.experiments import Sweep, load_sweep
from megalopta.info import describe
from megalopta.progress import say, working
from megalopta.report import write_report
from megalopta.stages import STAGES, announce_sweep, open_dataset_whole, run_all, run_stage

_DEMO = "do everything: render, sense, flow, bench and a report to open in a browser"
_OWN_OPTIONS = (
    "--out",
    "--redo",
    "--plots",
    "--quick",
    "--workers",
    "--cache",
    "--help",
    "-h",
    "--version",
)
_WITHOUT_SETTINGS = ("report", "info", "check", "reproduce", "gallery")


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command line and exit."""
    words = sys.argv[1:] if arguments is None else arguments
    try:
        _run(words)
    except UserError as error:
        _refuse(str(error))
    except MemoryError as error:
        _refuse(f"the memory is too small ({error}); ask for less, or free some".replace(" ()", ""))
    except BrokenPipeError:
        os._exit(141)  # as if killed by the pipe that nobody reads any more
    except OSError as error:
        if (problem := machine_problem(error)) is None:
            raise
        _refuse(problem)
    except KeyboardInterrupt:
        say("megalopta: interrupted; every file is whole, and the same command goes on from there")
        sys.stdout.flush()
        os._exit(130)  # threads that still compute are not waited for


def _refuse(sentence: str) -> NoReturn:
    print(f"megalopta: {' '.join(sentence.split())}", file=sys.stderr)
    sys.exit(2)


class _Parser(argparse.ArgumentParser):
    """Tells a mistake as one sentence, without the usage, which fills a screen."""

    settings: Callable[[], BaseModel] | None = None
    """What the help lists, read when it is asked for."""

    def format_help(self) -> str:
        if self.settings:
            self.epilog = settings_help(self.settings())
        return super().format_help()

    def error(self, message: str) -> NoReturn:
        verb = self.prog.removeprefix("megalopta").strip()
        raise UserError(f"{verb}: {message}; see {self.prog} --help".removeprefix(": "))


def _run(arguments: Sequence[str]) -> None:
    model = Sweep if "sweep" in arguments[:1] else Configuration
    own, overrides = split_overrides(arguments, _OWN_OPTIONS, model)
    options = _parser().parse_args(own)
    if options.verb in _WITHOUT_SETTINGS and overrides:
        raise UserError(f"{options.verb} has no setting --{next(iter(overrides))}")
    with working(options.verb):
        _do(options, overrides)


def _do(options: argparse.Namespace, overrides: dict[str, str]) -> None:
    if options.verb == "info":
        print(describe())
    elif options.verb == "report":
        print(write_report(open_dataset_whole(options.dataset)))
    elif options.verb == "check":
        _check(options.what, options.dataset, options.plots)
    elif options.verb == "reproduce":
        _reproduce(options)
    elif options.verb == "sweep":
        _sweep(options, overrides)
    elif options.verb == "gallery":
        _gallery(options.out)
    elif options.verb == "demo":
        dataset = run_all(options.out, _configuration(options, overrides), options.redo)
        print(write_report(dataset))
    elif options.verb == "render":
        run_stage(options.out, _configuration(options, overrides), "render", options.redo)
    else:
        stored = to_yaml(open_dataset_whole(options.dataset).configuration)
        configuration = parse(stored, str(options.dataset), overrides)
        run_stage(options.dataset, configuration, options.verb, options.redo)


def _configuration(options: argparse.Namespace, overrides: dict[str, str]) -> Configuration:
    """Read the configuration that is named, or the demo's.

    "airglow" is a light level and a configuration: at the end of a list it could be either.
    """
    for path, value in overrides.items():
        last = value.rpartition(", ")[2].strip("]")
        if options.configuration is None and "," in value and last in built_in_names():
            raise UserError(
                f"{last}: a value of --{path}, or the configuration? give the configuration first"
            )
    return load(options.configuration or "demo", overrides)


def _check(what: str, folder: Path | None, plots: Path | None) -> None:
    from megalopta.checks import run_check_files, run_check_physics, run_check_truth

    if what == "panoramas":
        from megalopta.checks import run_check_panoramas

        sys.exit(not run_check_panoramas(folder))
    if what == "physics" and folder is not None:
        raise UserError(f"check physics: takes no dataset, got {folder}")
    if what != "physics" and plots is not None:
        raise UserError(f"check {what}: draws no pictures; leave --plots out")
    if what != "physics" and folder is None:
        raise UserError(f"check {what}: which dataset? give its folder")
    if folder is None:
        passed = run_check_physics(plots)
    else:
        check = {"truth": run_check_truth, "files": run_check_files}[what]
        passed = check(open_dataset_whole(folder))
    if not passed:
        sys.exit(1)


def _reproduce(options: argparse.Namespace) -> None:
    from megalopta.figures import reproduce

    for path in reproduce(
        options.figures, options.out, options.quick, options.workers, options.cache
    ):
        print(path)


def _sweep(options: argparse.Namespace, overrides: dict[str, str]) -> None:
    from megalopta.figures import reproduce_sweep

    sweep = load_sweep(options.sweep, overrides)
    announce_sweep(sweep)
    name = options.sweep.stem
    for path in reproduce_sweep(name, sweep, options.out, options.workers, options.cache):
        print(path)


def _gallery(out: Path) -> None:
    from megalopta.gallery import write_gallery

    print(write_gallery(out))


def _parser() -> argparse.ArgumentParser:
    parser = _Parser(
        prog="megalopta",
        description="Scenes with exactly known motion, photon counts, and how well motion can be "
        "read from them.",
    )
    parser.add_argument("--version", action="version", version=f"megalopta {__version__}")
    verbs = parser.add_subparsers(dest="verb", required=True, metavar="VERB")
    for verb, purpose in (("demo", _DEMO), ("render", STAGES["render"].purpose)):
        command = _add_stage(verbs, verb, purpose)
        names = ", ".join(built_in_names())
        command.add_argument(
            "configuration",
            nargs="?",
            help=f"YAML file, or one of {names} (default: demo)",
        )
        command.add_argument(
            "--out", type=Path, default=Path("out/demo"), help="dataset folder (default: out/demo)"
        )
    for verb in ("sense", "flow", "bench"):
        _add_dataset(_add_stage(verbs, verb, STAGES[verb].purpose))
    report = "write report.html, one file without outside links, from what a dataset holds"
    _add_dataset(_add_verb(verbs, "report", report))
    proving = (
        "prove every sensor effect against theory, a dataset's truth another way, or that its "
        "files are as they were written"
    )
    check = _add_verb(verbs, "check", proving)
    subjects = ["physics", "truth", "files", "panoramas"]
    check.add_argument("what", choices=subjects, help="what to prove")
    check.add_argument(
        "dataset",
        nargs="?",
        type=Path,
        help="dataset folder, for truth and files; folder for new panoramas, for panoramas",
    )
    check.add_argument("--plots", type=Path, help="folder for pictures of the counting laws")
    drawing = "draw figures and tables of the dissertation again, as PNG, SVG, CSV and JSON"
    reproduction = _add_verb(verbs, "reproduce", drawing)
    reproduction.add_argument(
        "figures",
        nargs="+",
        metavar="FIGURE",
        help="such as fig-2.9 or table-3.1, chapter-4, or all",
    )
    reproduction.add_argument(
        "--out", type=Path, default=Path("out/figures"), help="folder (default: out/figures)"
    )
    reproduction.add_argument(
        "--quick", action="store_true", help="draw Chapter 4 coarsely, in seconds"
    )
    _add_workers(reproduction)
    searching = "measure the photons that motion detectors need over any parameter of the benchmark"
    sweep = _add_verb(verbs, "sweep", searching, Sweep)
    sweep.add_argument("sweep", type=Path, help="YAML file: trial, vary, values, sizes, templates")
    sweep.add_argument(
        "--out", type=Path, default=Path("out/sweeps"), help="folder (default: out/sweeps)"
    )
    _add_workers(sweep)
    showing = "render every scene preset at every light level, beside photon counts of it"
    gallery = _add_verb(verbs, "gallery", showing)
    gallery.add_argument(
        "--out", type=Path, default=Path("out/gallery"), help="folder (default: out/gallery)"
    )
    _add_verb(verbs, "info", "show versions, the rendering variant and what would make it faster")
    return parser


def _add_verb(
    verbs: "argparse._SubParsersAction[_Parser]",
    verb: str,
    purpose: str,
    settings: Callable[[], BaseModel] | None = None,
) -> argparse.ArgumentParser:
    command = verbs.add_parser(
        verb,
        help=purpose,
        description=purpose[0].upper() + purpose[1:] + ".",
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )
    command.settings = settings
    return command


def _add_stage(
    verbs: "argparse._SubParsersAction[_Parser]", verb: str, purpose: str
) -> argparse.ArgumentParser:
    command = _add_verb(verbs, verb, purpose, partial(load, "demo"))
    command.add_argument(
        "--redo", action="store_true", help="replace output of another configuration"
    )
    return command


def _add_workers(command: argparse.ArgumentParser) -> None:
    command.add_argument(
        "--workers", type=_positive, metavar="N", help="threads (default: one for each core)"
    )
    command.add_argument(
        "--cache", type=Path, help="folder of rendered panoramas (default: the user's)"
    )


def _positive(text: str) -> int:
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"{text!r}; give a whole number, 1 or more")
    return int(text)


def _add_dataset(command: argparse.ArgumentParser) -> None:
    command.add_argument("dataset", type=Path, help="dataset folder")
