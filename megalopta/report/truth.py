"""Tables of what the detectors say about the true motion: of the blocks, and of the camera."""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, TypeVar

from megalopta.flow.metrics import FAST_PX, OCCLUDED_SHARE, SLOW_PX
from megalopta.report.parts import Table
from megalopta.report.text import FAILS, SENSELESS, UNDEFINED, level_name, number, percent

Record = Mapping[str, Any]
Value = TypeVar("Value")

_BOTH = ("ideal", "counts")
_GROUPS = {
    "slow": f"below {SLOW_PX:g} px",
    "medium": f"{SLOW_PX:g} to {FAST_PX:g} px",
    "fast": f"{FAST_PX:g} px and more",
    "clear": f"hidden: below {OCCLUDED_SHARE:.0%}",
    "occlusion": f"hidden: {OCCLUDED_SHARE:.0%} or more",
}


def against_truth(records: Sequence[Record]) -> tuple[Table, ...]:
    """Mean error and share of outliers, a row per exposure and a column per method."""
    measured = [each for each in records if "truth" in each]
    if not measured:
        return ()
    return (
        _by_exposure(measured, "Mean error (px)", lambda each: _error(each["truth"])),
        _by_exposure(measured, "Outliers", lambda each: _outliers(each["truth"])),
    )


def split_table(records: Sequence[Record]) -> Table | None:
    """Mean error by speed and by occlusion, on the exposure where a method errs least."""
    measured = [each for each in records if "truth_splits" in each]
    if not measured:
        return None
    best = min(measured, key=_median_error)
    rows = [each for each in measured if _exposure(each) == _exposure(best)]
    blocks = {name: split["ideal"]["blocks"] for name, split in rows[0]["truth_splits"].items()}
    filled = [name for name in _GROUPS if blocks[name]]
    return Table(
        f"Mean error (px) by speed and occlusion where it is smallest: {_exposure(best)}",
        ("Detector", *(f"{_GROUPS[name]} ({blocks[name]:,})" for name in filled)),
        tuple(
            (each["method"], *(_error(each["truth_splits"][name]) for name in filled))
            for each in rows
        ),
    )


def rotation_table(records: Sequence[Record]) -> Table | None:
    """Error of the yaw rate, a row per exposure and a column per method."""
    measured = [each for each in records if "rotation" in each]
    if not measured:
        return None
    true = number(measured[0]["rotation"]["true_deg_s"])
    return _by_exposure(
        measured,
        f"Error of the yaw rate (deg/s) of {true} deg/s",
        lambda each: _yaw(each["rotation"]),
    )


def _by_exposure(records: Sequence[Record], label: str, cell: Callable[[Record], str]) -> Table:
    methods = dict.fromkeys(each["method"] for each in records)
    cells = {(_exposure(each), each["method"]): cell(each) for each in records}
    exposures = dict.fromkeys(map(_exposure, records))
    return Table(
        label,
        (label, *methods),
        tuple(
            (exposure, *(cells.get((exposure, method), UNDEFINED) for method in methods))
            for exposure in exposures
        ),
    )


def _median_error(record: Record) -> float:
    error = record["truth"]["counts"]["relative_error_median"]
    return math.inf if error is None else float(error)


def _exposure(record: Record) -> str:
    return f"{record['sensor']}, {level_name(record['level'])}"


def _yaw(rotation: Record) -> str:
    largest = SENSELESS * rotation["true_deg_s"] or math.inf
    errors = (rotation[f"{kind}_deg_s"] for kind in _BOTH)
    return _both(errors, lambda error: number(error) if error < largest else FAILS)


def _error(truth: Mapping[str, Record]) -> str:
    return _both(
        (truth[kind] for kind in _BOTH),
        lambda each: _number_of(each["endpoint_error_px"], each["relative_error_median"]),
    )


def _number_of(error_px: float | None, relative: float | None) -> str:
    if error_px is None:
        return UNDEFINED
    return FAILS if relative is not None and relative >= SENSELESS else number(error_px)


def _outliers(truth: Mapping[str, Record]) -> str:
    return _both((truth[kind]["outlier_fraction"] for kind in _BOTH), percent)


def _both(values: Iterable[Value | None], text: Callable[[Value], str]) -> str:
    """Noise-free → counts."""
    return " → ".join(UNDEFINED if value is None else text(value) for value in values)
