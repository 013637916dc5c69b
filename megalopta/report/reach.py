"""The light down to which a method reads the true motion, the report's first finding."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from megalopta.config.model import LightLevel
from megalopta.dataset.flow_record import FlowRecord
from megalopta.plotting.text import level_name, percent, relative_error
from megalopta.report.verdicts import ACCURATE, LIMIT
from megalopta.scenes.lighting.levels import illuminance_of


@dataclass(frozen=True)
class Answer:
    """Median error over blocks of one method at one light level, relative to the true velocity."""

    method: str
    level: LightLevel
    error: float

    @property
    def lux(self) -> float:
        """Illuminance of the level."""
        return illuminance_of(self.level)


def reach_findings(records: Sequence[FlowRecord]) -> list[str]:
    """Return a sentence for each sensor: which method stays accurate down to which light.

    The sensor on which motion is read in the least light comes first.
    """
    sensors = dict.fromkeys(record.sensor for record in records if record.truth)
    answers = {name: list(_answers(records, name)) for name in sensors}
    best = {name: _best(found) for name, found in answers.items()}
    order = sorted(sensors, key=lambda name: each.lux if (each := best[name]) else math.inf)
    return [_sentence(name, answers[name], best[name]) for name in order]


def _answers(records: Sequence[FlowRecord], sensor: str) -> Iterator[Answer]:
    """Yield what is known of a sensor; corrected readings count as a method of their own."""
    for each in records:
        if each.sensor == sensor and each.truth:
            corrected = f"{each.method} on corrected readings"
            for name, errors in (
                (each.method, each.truth.counts),
                (corrected, each.truth.corrected),
            ):
                if errors and errors.relative_error_median is not None:
                    yield Answer(name, each.level, errors.relative_error_median)


def _best(answers: Sequence[Answer]) -> Answer | None:
    """Return the answer of the method that stays accurate down to the least light, if any does."""
    last = [found for name in {each.method for each in answers} if (found := _last(answers, name))]
    return min(last, key=lambda each: (each.lux, each.error), default=None)


def _sentence(sensor: str, answers: Sequence[Answer], best: Answer | None) -> str:
    if not answers:
        return f"On {sensor}, nothing is known to move, so no flow can be judged."
    if best is None:
        nearest = min(answers, key=lambda each: (each.error, -each.lux))
        return (
            f"On {sensor}, no method comes within {LIMIT} of the true flow at any of these light "
            f"levels; the nearest is {_told(nearest)}."
        )
    return (
        f"On {sensor}, {best.method} stays within {LIMIT} of the true flow (median over blocks) "
        f"down to {level_name(best.level)}, where its median error is {percent(best.error)}."
    )


def _last(answers: Sequence[Answer], method: str) -> Answer | None:
    """Return the darkest level down to which a method is accurate, from the first one that it is.

    Brighter levels at which it is not, as where counters are full, are passed over.
    """
    own = sorted((each for each in answers if each.method == method), key=lambda each: -each.lux)
    last = None
    for each in own:
        if each.error < ACCURATE:
            last = each
        elif last:
            break
    return last


def _told(answer: Answer) -> str:
    return (
        f"{answer.method} at {level_name(answer.level)}, with a median error of "
        f"{relative_error(answer.error)}"
    )
