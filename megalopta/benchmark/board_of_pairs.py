"""The board of whole frames on pairs of the user's own: files in, a table out."""

import csv
import io
from collections.abc import Mapping, Sequence
from pathlib import Path

from megalopta.benchmark.methods import methods_and_baselines, on_the_board
from megalopta.benchmark.pairs_on_disk import Files, read_pair
from megalopta.benchmark.whole_frame_board import FrameErrors, frame_errors
from megalopta.core.errors import UserError
from megalopta.core.files import write_text
from megalopta.core.progress import progress
from megalopta.flow.detectors.registry import Method

_PAIR_FRAMES = 2


def errors_of_pairs(
    pairs: Mapping[str, Files],
    fluxes: Sequence[float],
    methods: Sequence[Method] | None = None,
    draws: int = 1,
) -> list[FrameErrors]:
    """Return the errors of methods, by default of all that do with two frames, on pairs of files.

    A baseline of the board is named as it is there: `DIS √`.

    Raises UserError when a file cannot be used, or a method not with two frames.
    """
    clips = [read_pair(name, files) for name, files in pairs.items()]
    with progress("Drawing photons", len(clips), "pair") as advance:
        try:
            chosen = list(map(on_the_board, methods or methods_and_baselines(_PAIR_FRAMES)))
            return frame_errors(clips, chosen, fluxes, draws, lambda: advance(1))
        except ValueError as problem:
            raise UserError(str(problem)) from None


def write_board(path: Path, errors: Sequence[FrameErrors]) -> None:
    """Write a line for each pair, method and flux, as CSV: means over the draws of the pair."""
    text = io.StringIO()
    lines = csv.writer(text, lineterminator="\n")
    lines.writerow(
        (
            "pair",
            "method",
            "frames",
            "photons_per_px",
            "median_epe_px",
            "mean_epe_px",
            "share_beyond_3_px",
        )
    )
    for place, pair in enumerate(errors[0].scenes):
        for each in errors:
            measured = (each.median_px, each.mean_px, each.far)
            of_pair = (measure.of_scenes[place] for measure in measured)
            for numbers in zip(each.fluxes, *of_pair, strict=True):
                words = (f"{value:.6g}" for value in numbers)
                lines.writerow((pair, each.detector.name, each.frames, *words))
    write_text(path, text.getvalue())
