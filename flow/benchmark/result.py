"""What a photon benchmark of a sequence found, with what is needed to make it again."""

from dataclasses import dataclass
from typing import Any

from megalopta.flow.benchmark.settings import BenchmarkSettings
from megalopta.flow.detectors import Detector
from megalopta.flow.metrics import ErrorCurve, Metric


@dataclass(frozen=True)
class BenchmarkResult:
    """All curves of one sequence, with what is needed to make them again."""

    sequence: str
    seed: int
    settings: BenchmarkSettings
    methods: tuple[Detector, ...]
    frames: tuple[int, int, int]
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
