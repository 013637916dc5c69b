"""What a photon benchmark of a sequence found, with what is needed to make it again."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Self

from pydantic import PositiveInt, TypeAdapter

from megalopta.flow.benchmark.settings import BenchmarkSettings
from megalopta.flow.detectors.base import Detector
from megalopta.flow.detectors.registry import METHODS
from megalopta.flow.metrics.curve import ErrorCurve
from megalopta.flow.metrics.response_error import Metric


@dataclass(frozen=True)
class BenchmarkResult:
    """All curves of one sequence, with what is needed to make them again."""

    sequence: str
    seed: int
    settings: BenchmarkSettings
    methods: tuple[Detector, ...]
    frames: tuple[PositiveInt, PositiveInt, PositiveInt]
    """Shape (T, H, W) of the clean sequence before resizing"""

    warm_up: int
    """Frames that were not scored"""

    curves: tuple[ErrorCurve, ...]

    def curve(self, method: str, size: int, metric: Metric = "literal") -> ErrorCurve:
        """Return the curve of one detector at one frame size (rows).

        Raises
        ------
        ValueError
            When it was not measured.
        """
        for curve in self.curves:
            if (curve.method, curve.shape[0], curve.metric) == (method, size, metric):
                return curve
        raise ValueError(
            f"no {metric} curve of {method!r} at {size} px: choose from"
            f" {', '.join(each.name for each in self.methods)} at {self.settings.sizes} px,"
            f" {', '.join(self.settings.metrics)}"
        )

    def to_dict(self) -> dict[str, Any]:
        """Return everything ready for JSON."""
        return {
            "sequence": self.sequence,
            "seed": self.seed,
            "settings": self.settings.model_dump(mode="json"),
            "methods": {each.name: each.model_dump(mode="json") for each in self.methods},
            "frames": list(self.frames),
            "warm_up": self.warm_up,
            "curves": [curve.to_dict() for curve in self.curves],
        }

    @classmethod
    def from_dict(cls, fields: Mapping[str, Any]) -> Self:
        """Return the result that `to_dict` wrote; raises as `ErrorCurve.from_dict` does."""
        methods = (
            type(METHODS[name]).model_validate(own) for name, own in fields["methods"].items()
        )
        curves = tuple(ErrorCurve.from_dict(each) for each in fields["curves"])
        return TypeAdapter(cls).validate_python(
            {**fields, "methods": (*methods,), "curves": curves}
        )
