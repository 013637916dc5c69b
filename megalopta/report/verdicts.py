"""What is said of a detector: whether it finds the true motion, or at least repeats itself.

A method that gives velocities is compared with the true motion: a method that is always wrong in
the same way repeats itself perfectly. The others give a number without a unit, so all that can be
asked is whether they answer counts as they answer the noise-free twin.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

from megalopta.config.model import LightLevel
from megalopta.dataset.flow_record import FlowRecord, TruthErrors
from megalopta.plotting.text import level_name, percent, relative_error

ACCURATE = 0.25
"""The thesis's 2-bit accuracy: an error below 2⁻²."""

LIMIT = percent(ACCURATE)

Kind = Literal["right", "wrong", "unknown", "silent", "repeats", "half", "differs"]

MEANINGS: Mapping[Kind, str] = {
    "right": f"true motion: half of the blocks or more within {LIMIT} of the true velocity",
    "wrong": f"wrong: more than half of the blocks off by more than {LIMIT}",
    "unknown": "nothing known to move",
    "repeats": f"repeats itself: both errors against the noise-free answer below {LIMIT}",
    "half": f"only one of these errors below {LIMIT}",
    "differs": "neither of them",
    "silent": "no motion found in any scored frame, even without noise",
}


@dataclass(frozen=True)
class Verdict:
    """One method on one sensor at one light level.

    Of velocities: "right" when half of the blocks or more are within 25 % of the true velocity,
    else "wrong"; "unknown" where nothing is known to move. Of other responses: "repeats" when both
    errors against the noise-free answer are below 25 %, "half" when one is, else "differs". Of
    both: "silent" when even the noise-free answer holds no motion.
    """

    kind: Kind
    title: str


@dataclass(frozen=True)
class VerdictGroup:
    """A sensor's verdicts: its light levels, and one row of verdicts per method."""

    sensor: str
    levels: tuple[str, ...]
    rows: Mapping[str, tuple[Verdict, ...]]


def verdict_group(
    sensor: str, levels: Sequence[LightLevel], records: Sequence[FlowRecord]
) -> VerdictGroup:
    """Verdicts on all methods on one sensor."""
    rows: dict[str, tuple[Verdict, ...]] = {}
    for each in records:
        if each.sensor == sensor:
            rows[each.method] = (*rows.get(each.method, ()), verdict(each))
    return VerdictGroup(sensor, tuple(map(level_name, levels)), rows)


def verdict(record: FlowRecord) -> Verdict:
    """Verdict of a record of flow.json."""
    truth, errors = record.truth, record.error
    if truth and truth.counts.relative_error_median is None:
        return Verdict("unknown", "nothing is known to move here")
    if errors.ratio is None or errors.literal is None:
        return Verdict("silent", "no motion found, even without noise")
    return _of_velocities(truth) if truth else _of_responses(errors.ratio, errors.literal)


def _of_velocities(truth: TruthErrors) -> Verdict:
    error = truth.counts.relative_error_median or 0.0
    text = (
        f"median error {relative_error(error)} of the true velocity "
        f"(noise-free {relative_error(truth.ideal.relative_error_median)}), "
        f"{percent(truth.counts.outlier_fraction)} of the blocks off by more than {LIMIT}"
    )
    return Verdict("right" if error < ACCURATE else "wrong", text)


def _of_responses(ratio: float, literal: float) -> Verdict:
    kinds: tuple[Kind, ...] = ("differs", "half", "repeats")
    text = f"ratio {relative_error(ratio)}, literal {relative_error(literal)}"
    return Verdict(kinds[(ratio < ACCURATE) + (literal < ACCURATE)], text)
