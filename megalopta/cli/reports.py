"""Verbs that show or verify results, from `info` to `check`."""

import sys
from argparse import Namespace
from collections.abc import Iterator
from pathlib import Path
from typing import Any

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


@verb(
    "info",
    "show versions, the rendering variant and what would make it faster",
    switch("--schema", "write JSON schemas of all YAML files here, for editors"),
)
def _info(options: Namespace) -> str | list[Path]:
    if options.schema:
        from megalopta.cli.schema import write_schemas

        return write_schemas(Path())
    from megalopta.stages.versions import describe

    return describe()


@verb(
    "report",
    "write report.html of a dataset, one self-contained file; of many sequences, README.md "
    "and index.html",
    DATASET,
)
def _report(options: Namespace) -> Iterator[Path]:
    from megalopta.dataset.opened import open_dataset
    from megalopta.dataset.store import open_sequence
    from megalopta.report.dataset_card import SHOWN, write_card, write_contact_sheet
    from megalopta.report.page import write_report

    if len(open_dataset(options.dataset)) > 1:
        yield write_card(options.dataset)
        yield write_contact_sheet(options.dataset, SHOWN)
    else:
        yield write_report(open_sequence(options.dataset))


@verb(
    "sensor",
    "print the data sheet of a sensor: efficiency, noise, saturation, dynamic range, dark counts",
    option("sensor", "preset or YAML file"),
    option("--wavelength-nm", "wavelength of the photons (default: of the peak)", positive),
    option("--out", "also draw it, as a page (.html)", Path),
    switch("--json", "print all figures and curves as JSON"),
    example="megalopta sensor spadcam --out spadcam.html",
)
def _sensor(options: Namespace) -> list[str | Path]:
    from megalopta.benchmark.data_sheet import contrast_sheet, data_sheet, sections, write_page
    from megalopta.core.errors import refused_as
    from megalopta.report.sections import as_text
    from megalopta.sensor import ContrastSensor
    from megalopta.sensor.image_sensors import sensor_named

    with refused_as("sensor"):
        sensor = sensor_named(options.sensor)
    if isinstance(sensor, ContrastSensor) and not options.wavelength_nm:
        sheet: Any = contrast_sheet(sensor)
    else:
        sheet = data_sheet(options.sensor, options.wavelength_nm)
    written = [write_page(options.out, sheet)] if options.out else []
    title = f"{sensor.name}: {sensor.source or 'source not stated'}"
    return [sheet.to_json()] if options.json else [as_text(title, sections(sheet)), *written]


@verb(
    "view",
    "write film.mp4, film.gif and view.html, a page with sliders: light, counts, flow and truth of "
    "a dataset, a recording or a file of frames or events; of many sequences index.html",
    option(
        "thing THING[@LIGHT[:SECONDS]]",
        "dataset, DATASET/SEQUENCE, recording, or frames or events of a camera: .npy of bits or "
        "counts, .spc3, .mat, TIFF, .bin of SPAD512 or SwissSPAD2, a folder of PNG or TIFF of "
        "bits (of counts: --format png), events in .h5",
        Path,
    ),
    option("--out", "folder (default: out/view/NAME)", Path),
    option("--sum K", "frames to sum; of bursts binary frames", at_least(1), 1, dest="summed"),
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

    folder = options.out or Path("out/view") / Path(str(options.thing).split("@")[0]).resolve().stem
    return view(options.thing, folder, chosen(options, ViewOptions))


@verb(
    "reproduce",
    "reproduce Chapter 4 of the dissertation as PNG, SVG and CSV",
    option("figures FIGURE", "chapter-4, or of it fig-4.5 to fig-4.13 or table-4.1", nargs="+"),
    out("out/figures"),
    switch("--quick", "draw coarsely, in seconds"),
    THREADS,
)
def _reproduce(options: Namespace) -> list[Path]:
    from megalopta.reproduction.chapter4 import reproduce

    return reproduce(options.figures, options.out, options.quick, options.workers)


@verb(
    "check",
    "verify a dataset's truth by a second method, or its files by their hashes",
    option("what", "what to verify", choices=["truth", "files"]),
    DATASET,
    option("--truth N", "files of many: sequences whose truth is verified, too", at_least(0), 3),
)
def _check(options: Namespace) -> None:
    from megalopta.dataset.store import open_sequence
    from megalopta.verification import files

    if options.what == "files":
        passes = files.run_check_files(options.dataset, options.truth)
    else:
        from megalopta.verification.truth import run_check_truth

        passes = run_check_truth(open_sequence(options.dataset))
    if not passes:
        sys.exit(1)
