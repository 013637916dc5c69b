"""Tables of what the detectors say about the true motion: of the blocks, and of the camera."""

import math
from collections.abc import Callable, Iterable, Sequence
from typing import TypeVar

from megalopta.config.measuring import FlowSettings
from megalopta.dataset.flow_record import (
    BlockErrors,
    FlowRecord,
    RotationErrors,
    TruthErrors,
)
from megalopta.flow.metrics.endpoint_error import FAST_PX, OCCLUDED_SHARE, SLOW_PX
from megalopta.plotting.text import (
    FAILS,
    SENSELESS,
    UNDEFINED,
    level_name,
    number,
    percent,
)
from megalopta.report.components import Table, crossed

Value = TypeVar("Value")

_GROUPS = {
    "slow": f"below {SLOW_PX:g} px",
    "medium": f"{SLOW_PX:g} to {FAST_PX:g} px",
    "fast": f"{FAST_PX:g} px and more",
    "clear": f"hidden: below {OCCLUDED_SHARE:.0%}",
    "occlusion": f"hidden: {OCCLUDED_SHARE:.0%} or more",
}


def against_truth(records: Sequence[FlowRecord], settings: FlowSettings) -> tuple[Table, ...]:
    """Mean error and share of outliers, a row per exposure and a column per method.

    The error with mixed pixels, without them, and as the configuration has them counted.
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
    rows[outliers] = {key: _outliers(each) for key, each in truths.items()}
    return tuple(crossed(label, label, cells) for label, cells in rows.items() if cells)


def split_table(records: Sequence[FlowRecord]) -> Table | None:
    """Mean error by speed and by occlusion, on the exposure where a method errs least."""
    measured = [each for each in records if each.truth_splits]
    if not measured:
        return None
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


def rotation_table(records: Sequence[FlowRecord]) -> Table | None:
    """Error of the yaw rate, a row per exposure and a column per method."""
    rotations = {_key(each): each.rotation for each in records if each.rotation}
    if not rotations:
        return None
    true = number(next(iter(rotations.values())).true_deg_s)
    label = f"Error of the yaw rate (deg/s) of {true} deg/s"
    return crossed(label, label, {key: _yaw(each) for key, each in rotations.items()})


def _key(record: FlowRecord) -> tuple[str, str]:
    return f"{record.sensor}, {level_name(record.level)}", record.method


def _median_error(record: FlowRecord) -> float:
    error = record.truth.counts.relative_error_median if record.truth else None
    return math.inf if error is None else error


def _yaw(rotation: RotationErrors) -> str:
    largest = SENSELESS * rotation.true_deg_s or math.inf
    errors = (rotation.ideal_deg_s, rotation.counts_deg_s)
    return _in_turn(errors, lambda error: number(error) if error < largest else FAILS)


def _error(truth: TruthErrors) -> str:
    return _in_turn(
        _answers(truth),
        lambda each: _number_of(each.endpoint_error_px, each.relative_error_median),
    )


def _number_of(error_px: float | None, relative: float | None) -> str:
    if error_px is None:
        return UNDEFINED
    return FAILS if relative is not None and relative >= SENSELESS else number(error_px)


def _outliers(truth: TruthErrors) -> str:
    return _in_turn([each.outlier_fraction for each in _answers(truth)], percent)


def _answers(truth: TruthErrors) -> list[BlockErrors]:
    corrected = [truth.corrected] if truth.corrected else []
    return [truth.ideal, truth.counts, *corrected]


def _in_turn(values: Iterable[Value | None], text: Callable[[Value], str]) -> str:
    """Noise-free → counts → corrected counts."""
    return " → ".join(UNDEFINED if value is None else text(value) for value in values)
