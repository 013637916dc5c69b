"""The verbs that show or prove what is there, from `info` to `check`."""

import sys
from argparse import Namespace
from pathlib import Path

from megalopta.cli.command import (
    DATASET,
    FRAME_KINDS,
    THREADS,
    at_least,
    option,
    out,
    positive,
    switch,
    verb,
)
from megalopta.core.errors import UserError
from megalopta.verification import GROUPS


@verb("info", "show versions, the rendering variant and what would make it faster")
def _info(options: Namespace) -> None:
    from megalopta.generation.versions import describe

    print(describe())


@verb(
    "report",
    "write report.html from what a dataset holds, one file without outside links; of many "
    "sequences README.md and index.html",
    DATASET,
)
def _report(options: Namespace) -> None:
    from megalopta.dataset.layout import is_of_many
    from megalopta.dataset.store import open_sequence
    from megalopta.report.dataset_card import SHOWN, write_card, write_contact_sheet
    from megalopta.report.page import write_report

    if is_of_many(options.dataset):
        print(write_card(options.dataset))
        print(write_contact_sheet(options.dataset, SHOWN))
    else:
        print(write_report(open_sequence(options.dataset)))


@verb(
    "view",
    "write film.mp4, film.gif and view.html, a page with sliders: light, counts, flow and truth of "
    "a dataset, a recording or a file of frames or events; of many sequences index.html",
    option(
        "thing",
        "dataset folder, recording, or frames or events of any camera: .npy of packed bits or "
        "counts, .spc3, TIFF, .bin of SPAD512 or SwissSPAD2, events in .h5 or .npz",
        type=Path,
    ),
    out("out/view"),
    option(
        "--sum", "frames that are added up (default: 1)", type=at_least(1), default=1, metavar="K"
    ),
    switch(
        "--invert",
        "invert the sensor's response: mean detections of a frame, of sums of binary frames by "
        "−ln(1 − p), of counts without what dead time lost; full pixels are orange",
    ),
    option(
        "--bad-pixels",
        "mask (.npy of bool), true where a pixel is bad; it takes the mean of its good neighbors",
        type=Path,
        metavar="MASK",
    ),
    option(
        "--fps",
        "frames a second of the film (default: as in life, where that can be followed)",
        type=positive,
        metavar="HZ",
    ),
    option(
        "--format",
        f"of frames that do not say it, of {', '.join(FRAME_KINDS)} (default: as their content "
        "says, .bin: spad512)",
        choices=FRAME_KINDS,
        metavar="KIND",
    ),
    switch(
        "--rerun", "write view.rrd for Rerun's viewer, too: camera, points, light, counts, flow"
    ),
)
def _view(options: Namespace) -> None:
    from megalopta.report.view import Asked, view

    asked = Asked(
        summed=options.sum,
        is_inverted=options.invert,
        bad_pixels=options.bad_pixels,
        fps=options.fps,
        kind=options.format,
        with_rerun=options.rerun,
    )
    for path in view(options.thing, options.out, asked):
        print(path)


@verb(
    "reproduce",
    "draw figures and tables of the dissertation again, as PNG, SVG, CSV and JSON",
    option(
        "figures", "such as fig-2.9 or table-3.1, chapter-4, or all", nargs="+", metavar="FIGURE"
    ),
    out("out/figures"),
    switch("--quick", "draw Chapter 4 coarsely, in seconds"),
    *THREADS,
)
def _reproduce(options: Namespace) -> None:
    from megalopta.reproduction.drawing import Means, reproduce

    means = Means(options.workers, options.cache, options.scheduler)
    for path in reproduce(options.figures, options.out, options.quick, means):
        print(path)


@verb(
    "gallery",
    "render every scene preset at every light level, beside photon counts of it",
    switch("--views", "render larger views of the forests under natural skies instead, views.html"),
    switch(
        "--statistics", "measure statistics of views of the forests instead, image-statistics.png"
    ),
    option(
        "--panorama",
        "a photographed panorama (HDR, EXR or PNG, 2:1); with --views shown beside a forest "
        "in its light, with --statistics measured beside them, all at two of its pixels or more",
        type=Path,
        metavar="FILE",
    ),
    out("out/gallery"),
)
def _gallery(options: Namespace) -> None:
    from megalopta.report.gallery import write_gallery, write_statistics, write_views

    if options.views and options.statistics:
        raise UserError("gallery: --views and --statistics are two things; give one")
    if options.panorama and not (options.views or options.statistics):
        raise UserError("gallery: --panorama goes with --views or --statistics; give one")
    try:
        if options.views:
            print(write_views(options.out, options.panorama))
        elif options.statistics:
            photographs = [options.panorama] if options.panorama else []
            print(*write_statistics(options.out, photographs), sep="\n")
        else:
            print(write_gallery(options.out))
    except ValueError as problem:  # a panorama that is none
        raise UserError(str(problem)) from None


@verb(
    "check",
    "prove every sensor effect against theory, a dataset's truth another way, or that its files "
    "are as they were written",
    option("what", "what to prove", choices=["physics", "truth", "files", "panoramas"]),
    option(
        "subjects",
        "dataset folder, for truth and files; folder for new panoramas, for panoramas; for "
        f"physics any of {', '.join(GROUPS)}, by default all",
        nargs="*",
        metavar="FOLDER or GROUP",
    ),
)
def _check(options: Namespace) -> None:
    if not _passes(options.what, options.subjects):
        sys.exit(1)


def _passes(what: str, subjects: list[str]) -> bool:
    from megalopta.dataset.store import open_sequence
    from megalopta.verification import files, panoramas, physics, truth

    if what == "physics":
        return physics.run_check_physics(subjects)
    if len(subjects) > 1:
        raise UserError(f"check {what}: got {' '.join(subjects)}; give one folder")
    folder = Path(subjects[0]) if subjects else None
    if what == "panoramas":
        return panoramas.run_check_panoramas(folder)
    if folder is None:
        raise UserError(f"check {what}: which dataset? give its folder")
    if what == "files":
        return files.run_check_files(folder)
    return truth.run_check_truth(open_sequence(folder))
