"""Verbs that show or verify results, from `info` to `check`."""

import sys
from argparse import Namespace
from collections.abc import Iterator
from pathlib import Path

from megalopta.cli.command import (
    DATASET,
    FRAME_KINDS,
    THREADS,
    at_least,
    chosen,
    option,
    out,
    positive,
    switch,
    verb,
)
from megalopta.core.errors import UserError, refused_as
from megalopta.verification import GROUPS


@verb("info", "show versions, the rendering variant and what would make it faster")
def _info(options: Namespace) -> str:
    from megalopta.generation.versions import describe

    return describe()


@verb(
    "report",
    "write report.html of a dataset, one self-contained file; of many sequences, README.md "
    "and index.html",
    DATASET,
)
def _report(options: Namespace) -> Iterator[Path]:
    from megalopta.dataset.layout import is_of_many
    from megalopta.dataset.store import open_sequence
    from megalopta.report.dataset_card import SHOWN, write_card, write_contact_sheet
    from megalopta.report.page import write_report

    if is_of_many(options.dataset):
        yield write_card(options.dataset)
        yield write_contact_sheet(options.dataset, SHOWN)
    else:
        yield write_report(open_sequence(options.dataset))


@verb(
    "view",
    "write film.mp4, film.gif and view.html, a page with sliders: light, counts, flow and truth of "
    "a dataset, a recording or a file of frames or events; of many sequences index.html",
    option(
        "thing",
        "dataset folder, recording, or frames or events of any camera: .npy of packed bits or "
        "counts, .spc3, TIFF, .bin of SPAD512 or SwissSPAD2, events in .h5 or .npz",
        Path,
    ),
    option("--out", "folder (default: out/view/NAME)", Path),
    option("--sum K", "frames to sum", at_least(1), 1, dest="summed"),
    switch(
        "--invert",
        "show mean detections per frame, by inverting the sensor's response: −ln(1 − p) of binary "
        "frames, dead-time correction of counts; saturated pixels are orange",
        dest="is_inverted",
    ),
    option(
        "--bad-pixels MASK",
        "mask (.npy of bool) of bad pixels, which get the mean of their good neighbors",
        Path,
    ),
    option(
        "--fps HZ",
        "frames per second of the film (default: real time, if that can be followed)",
        positive,
    ),
    option(
        "--format KIND",
        f"format of the frames, one of {', '.join(FRAME_KINDS)} (default: by content, .bin: "
        "spad512)",
        choices=FRAME_KINDS,
        dest="kind",
    ),
    switch(
        "--rerun",
        "also write view.rrd for Rerun's viewer: camera, points, light, counts, flow",
        dest="with_rerun",
    ),
)
def _view(options: Namespace) -> list[Path]:
    from megalopta.report.view import ViewOptions, view

    folder = options.out or Path("out/view") / options.thing.resolve().stem
    return view(options.thing, folder, chosen(options, ViewOptions))


@verb(
    "reproduce",
    "reproduce figures and tables of the dissertation as PNG, SVG, CSV and JSON",
    option("figures FIGURE", "such as fig-2.9 or table-3.1, chapter-4, or all", nargs="+"),
    out("out/figures"),
    switch("--quick", "draw Chapter 4 coarsely, in seconds"),
    *THREADS,
)
def _reproduce(options: Namespace) -> list[Path]:
    from megalopta.reproduction.drawing import Means, reproduce

    means = Means(options.workers, options.cache, options.scheduler)
    return reproduce(options.figures, options.out, options.quick, means)


@verb(
    "gallery",
    "render every scene preset at every light level, with its photon counts",
    switch("--views", "instead render large views of the forests under natural skies: views.html"),
    switch("--statistics", "instead measure image statistics of the forests: image-statistics.png"),
    option(
        "--panorama FILE",
        "photographed panorama (HDR, EXR or PNG, 2:1); with --views a forest is shown in its "
        "light; with --statistics the forests are compared with it, at an angle that it resolves",
        Path,
    ),
    out("out/gallery"),
)
def _gallery(options: Namespace) -> Path | list[Path]:
    from megalopta.report.gallery import write_gallery, write_statistics, write_views

    if options.views and options.statistics:
        raise UserError("gallery: --views and --statistics exclude each other; give one")
    if options.panorama and not (options.views or options.statistics):
        raise UserError("gallery: --panorama needs --views or --statistics; add one")
    with refused_as():  # not a panorama
        if options.views:
            return write_views(options.out, options.panorama)
        if options.statistics:
            return write_statistics(options.out, [options.panorama] if options.panorama else [])
        return write_gallery(options.out)


@verb(
    "check",
    "verify sensor effects against theory or real arrays, a dataset's truth by a second method, "
    "or its files by their hashes",
    option("what", "what to verify", choices=["physics", "captures", "truth", "files"]),
    option(
        "subjects",
        "truth, files: dataset folder; captures: measurements in addition to those that ship; "
        f"physics: any of {', '.join(GROUPS)} (default: all)",
        nargs="*",
        metavar="FOLDER, FILE or GROUP",
    ),
    option("--page FILE", "captures: file of the page with pictures", Path),
)
def _check(options: Namespace) -> Path | None:
    if options.what == "captures":
        return _check_captures([Path(each) for each in options.subjects], options.page)
    if options.page:
        raise UserError(f"check {options.what}: --page is for captures; omit it")
    if not _passes(options.what, options.subjects):
        sys.exit(1)
    return None


def _check_captures(paths: list[Path], page: Path | None) -> Path | None:
    from megalopta.verification.captures import check_captures, print_captures, write_captures_page

    found = check_captures(paths)
    print_captures(found)
    return write_captures_page(page, found) if page else None


def _passes(what: str, subjects: list[str]) -> bool:
    from megalopta.dataset.store import open_sequence
    from megalopta.verification import files, physics, truth

    if what == "physics":
        return physics.run_check_physics(subjects)
    if len(subjects) > 1:
        raise UserError(f"check {what}: got {' '.join(subjects)}; give one folder")
    if not subjects:
        raise UserError(f"check {what}: no dataset; give its folder")
    folder = Path(subjects[0])
    if what == "files":
        return files.run_check_files(folder)
    return truth.run_check_truth(open_sequence(folder))
