"""Errors as tables: against the noise-free answer, the true motion of blocks, the camera's yaw.

A method that gives velocities is compared with the true motion: one that is always wrong in the
same way repeats itself perfectly. The others give a number without a unit, so all that can be asked
is whether they answer counts as they answer the noise-free twin.
"""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import TypeVar

from markupsafe import Markup

from megalopta.config.measuring import FlowSettings
from megalopta.dataset.flow_record import (
    BlockErrors,
    FlowRecord,
    RotationErrors,
    TruthErrors,
)
from megalopta.flow.metrics.endpoint_error import FAST_PX, OCCLUDED_SHARE, SLOW_PX
from megalopta.plotting.sections import table
from megalopta.plotting.text import (
    FAILS,
    SENSELESS,
    UNDEFINED,
    level_name,
    number,
    percent,
    relative_error,
)

Value = TypeVar("Value")
Text = TypeVar("Text", bound=str)

ACCURATE = 0.25
"""The thesis's 2-bit accuracy: an error below 2⁻²."""

_GROUPS = {
    "slow": f"below {SLOW_PX:g} px",
    "medium": f"{SLOW_PX:g} to {FAST_PX:g} px",
    "fast": f"{FAST_PX:g} px and more",
    "clear": f"hidden: below {OCCLUDED_SHARE:.0%}",
    "occlusion": f"hidden: {OCCLUDED_SHARE:.0%} or more",
}


def crossed(label: str, corner: str, cells: Mapping[tuple[Text, str], str]) -> Markup:
    """Return a table of texts by row and column, with a dash where there is none."""
    rows = dict.fromkeys(row for row, _ in cells)
    columns = dict.fromkeys(column for _, column in cells)
    lines: list[list[str]] = [
        [row, *(cells.get((row, each), UNDEFINED) for each in columns)] for row in rows
    ]
    return table(label, [corner, *columns], lines)


def response_table(sensor: str, records: Sequence[FlowRecord]) -> Markup:
    """Return ratio and literal errors on one sensor, a row per method and a column per level."""
    cells = {
        (each.method, level_name(each.level)): UNDEFINED
        if each.error.ratio is None
        else f"{relative_error(each.error.ratio)} ({relative_error(each.error.literal)})"
        for each in records
        if each.sensor == sensor
    }
    return crossed(f"Errors of the responses on {sensor}", "Detector", cells)


def cost_table(sensor: str, records: Sequence[FlowRecord]) -> Markup:
    """Return ratio errors of a device: against itself, a perfect sensor, and that corrected."""
    cells = {}
    for each in records:
        if each.sensor == sensor and each.error_perfect:
            corrected = [each.error_corrected] if each.error_corrected else []
            ratios = (one.ratio for one in (each.error, each.error_perfect, *corrected))
            cells[each.method, level_name(each.level)] = " · ".join(map(relative_error, ratios))
    label = f"Noise, device and correction on {sensor}"
    return crossed(label, "Detector", cells) if cells else Markup("")


def against_truth(records: Sequence[FlowRecord], settings: FlowSettings) -> Markup:
    """Return errors and shares of outliers, a row per exposure and a column per method.

    The mean error with mixed pixels, without them, and as the configuration has them counted.
    """
    truths = {_key(each): each.truth for each in records if each.truth}
    mixtures = {_key(each): each.truth_by_mixture for each in records if each.truth_by_mixture}
    rows = {
        "Mean error (px), all pixels": {key: _error(each.all) for key, each in mixtures.items()},
        f"Mean error (px), without mixed pixels (purity below {settings.least_purity:.0%})": {
            key: _error(each.without_mixed) for key, each in mixtures.items()
        },
    }
    if settings.mixed == "weigh" or not mixtures:
        weighed = "Mean error (px)" + (", pixels by their purity" if mixtures else "")
        rows = {weighed: {key: _error(each) for key, each in truths.items()}} | rows
    outliers = "Outliers" + (", without mixed pixels" if settings.mixed == "leave_out" else "")
    rows[outliers] = {
        key: _in_turn([one.outlier_fraction for one in _answers(each)], percent)
        for key, each in truths.items()
    }
    rows["Median error, of the true velocity"] = {
        key: _in_turn([one.relative_error_median for one in _answers(each)], relative_error)
        for key, each in truths.items()
    }
    return Markup("\n").join(crossed(label, label, cells) for label, cells in rows.items() if cells)


def split_table(records: Sequence[FlowRecord]) -> Markup:
    """Return mean errors by speed and by occlusion, on the exposure where a method errs least."""
    measured = [each for each in records if each.truth_splits]
    if not measured:
        return Markup("")
    best, _ = _key(min(measured, key=_median_error))
    splits = {
        each.method: dict(each.truth_splits)
        for each in measured
        if each.truth_splits and _key(each)[0] == best
    }
    blocks = {name: split.ideal.blocks for name, split in next(iter(splits.values())).items()}
    cells = {
        (method, f"{_GROUPS[name]} ({blocks[name]:,})"): _error(split[name])
        for method, split in splits.items()
        for name in _GROUPS
        if blocks[name]
    }
    label = f"Mean error (px) by speed and occlusion where it is smallest: {best}"
    return crossed(label, "Detector", cells)


def rotation_table(records: Sequence[FlowRecord]) -> Markup:
    """Return errors of the yaw rate, a row per exposure and a column per method."""
    rotations = {_key(each): each.rotation for each in records if each.rotation}
    if not rotations:
        return Markup("")
    true = number(next(iter(rotations.values())).true_deg_s)
    label = f"Error of the yaw rate (deg/s) of {true} deg/s"
    return crossed(label, label, {key: _yaw(each) for key, each in rotations.items()})


def _key(record: FlowRecord) -> tuple[str, str]:
    return f"{record.sensor}, {level_name(record.level)}", record.method


def _median_error(record: FlowRecord) -> float:
    """Return the median error of blocks relative to the true velocity."""
    error = record.truth.counts.relative_error_median if record.truth else None
    return math.inf if error is None else error


def _yaw(rotation: RotationErrors) -> str:
    largest = SENSELESS * rotation.true_deg_s or math.inf
    errors = (rotation.ideal_deg_s, rotation.counts_deg_s)
    return _in_turn(errors, lambda error: number(error) if error < largest else FAILS)


def _error(truth: TruthErrors) -> str:
    def text(each: BlockErrors) -> str:
        relative, error_px = each.relative_error_median, each.endpoint_error_px
        if error_px is None:
            return UNDEFINED
        return FAILS if relative is not None and relative >= SENSELESS else number(error_px)

    return _in_turn(_answers(truth), text)


def _answers(truth: TruthErrors) -> list[BlockErrors]:
    corrected = [truth.corrected] if truth.corrected else []
    return [truth.ideal, truth.counts, *corrected]


def _in_turn(values: Iterable[Value | None], text: Callable[[Value], str]) -> str:
    """Noise-free → counts → corrected counts."""
    return " → ".join(UNDEFINED if value is None else text(value) for value in values)
