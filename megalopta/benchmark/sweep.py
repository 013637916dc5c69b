"""A sweep of the flow benchmark as data: fixed parameters, one that is varied, and its cost."""

import operator
from functools import cached_property
from itertools import product
from pathlib import Path
from typing import Annotated, Any, NamedTuple, Self

from pydantic import Field, ValidationError, ValidationInfo, field_validator, model_validator

from megalopta.benchmark.trial import Template, Trial, path_from_its_file, template_names
from megalopta.config.validation import one_sentence
from megalopta.config.yaml_model import mapping, put, read_text, validated
from megalopta.core.errors import UserError
from megalopta.core.record import Record
from megalopta.core.strict_yaml import booleans_for_others
from megalopta.flow.benchmark.settings import each_once

Value = int | float | bool | str
MOST_TRIALS = 10_000
"""In one sweep: more than anybody waits for, and checking them takes a minute."""

_SHARED = ("methods", "search.metrics", "search.bits")


class SweepPoint(NamedTuple):
    """One trial of a sweep, and where it stands."""

    size: int
    value: Value
    template: str
    """Short name"""

    trial: Trial


class Sweep(Record, frozen=True):
    """Trials that differ in one parameter; in several sizes, averaged over several templates."""

    title: str = "Photons that motion detectors need"
    """What is shown, in one line"""

    trial: Trial = Trial()
    """The fixed parameters"""

    vary: str = "velocity_px"
    """Path of the varied parameter in a trial, such as template.contrast or search.dark_counts"""

    values: Annotated[tuple[Value, ...], Field(min_length=1)] = (1, 2, 5, 10)
    """Its values"""

    sizes: tuple[int, ...] = ()
    """Spatial pooling (px), a panel of the figure each; by default that of the trial"""

    templates: tuple[Template, ...] = ()
    """Templates that thresholds are averaged over; by default that of the trial"""

    @field_validator("values")
    @classmethod
    def _paths_from_their_file(
        cls, values: tuple[Value, ...], validation: ValidationInfo
    ) -> tuple[Value, ...]:
        if validation.data.get("vary") != "template.name":
            return values
        return tuple(path_from_its_file(str(value), validation) for value in values)

    @field_validator("values", "sizes", "templates")
    @classmethod
    def _each_once(cls, values: tuple[Any, ...]) -> tuple[Any, ...]:
        return each_once(values)

    @model_validator(mode="after")
    def _every_trial_is_possible(self) -> Self:
        count = len(self.values) * len(self.sizes or "1") * len(self.templates or "1")
        if count > MOST_TRIALS:
            raise ValueError(f"values: {count} trials; give at most {MOST_TRIALS} in all")
        if self.vary.startswith(_SHARED):
            raise ValueError(
                f"vary: {self.vary} is the same for a whole figure; give all that are wanted in "
                "the trial"
            )
        if self.vary == "size" and self.sizes:
            raise ValueError("sizes: size is varied already; leave sizes out")
        try:
            trials = self.trials
        except ValidationError as error:
            raise ValueError(one_sentence(error, Trial)) from None
        except UserError as error:
            raise ValueError(str(error).replace("--", "vary: ", 1)) from None
        if len(set(trials)) < len(trials):
            raise ValueError(
                f"two trials are the same: {self.vary} is varied, so values and templates must"
                " differ in it; give each once"
            )
        return self

    def __copy__(self) -> Self:
        copied = super().__copy__()
        copied.__dict__.pop("points", None)  # a copy with other values has other points
        return copied

    @cached_property
    def points(self) -> tuple[SweepPoint, ...]:
        """The trials: sizes, in them values, in them templates."""
        fixed = {**self.trial.model_dump(mode="json"), "methods": self.trial.methods}
        found: list[tuple[Value, Trial]] = []
        for size, value, template in product(
            self.sizes or (self.trial.size,), self.values, self.templates or (self.trial.template,)
        ):
            fields = {**fixed, "size": size, "template": template.model_dump(mode="json")}
            put(fields, self.vary, value)
            trial = Trial.model_validate(fields)
            if any(booleans_for_others(fields, trial)):
                raise ValueError(f"values: {str(value).lower()} is no number; give numbers")
            # in quotes a number is text
            number = operator.attrgetter(self.vary)(trial) if isinstance(value, str) else value
            found.append((number, trial))
        templates = list(dict.fromkeys(trial.template for _, trial in found))
        names = dict(zip(templates, template_names(templates), strict=True))
        return tuple(
            SweepPoint(each.size, value, names[each.template], each) for value, each in found
        )

    @property
    def trials(self) -> list[Trial]:
        """All trials."""
        return [point.trial for point in self.points]


def load_sweep(
    path: Path, overrides: dict[str, str] | None = None, allows_code: bool = False
) -> Sweep:
    """Return the sweep of a YAML file with settings of the command line.

    Overrides go from the path of a field to a value in YAML, and may name code; methods of the file
    may be `module:function` or ONNX files, which are run, only where `allows_code`. Raises
    UserError when the file cannot be read, or says what is no sweep.
    """
    values = mapping(read_text(path, "sweep; give a YAML file"), str(path))
    return validated(Sweep, values, str(path), overrides, path.parent, allows_code)
