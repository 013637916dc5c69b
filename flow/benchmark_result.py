"""What a photon benchmark found: error curves and the fluxes at which they cross."""

import math
from dataclasses import asdict, dataclass
from typing import Any

from megalopta.flow.benchmark_settings import BenchmarkSettings
from megalopta.flow.detector import Detector
from megalopta.flow.error import Metric
from megalopta.flow.threshold import Threshold


@dataclass(frozen=True)
class ErrorCurve:
    """Error of one detector over the flux, at one frame size and in one metric."""

    method: str
    label: str
    shape: tuple[int, int]
    """Rows and columns of the resized frames"""

    metric: Metric
    fluxes: tuple[float, ...]
    """Photons per frame"""

    errors: tuple[float, ...]
    """Of the whole sequence; NaN when the ideal response is zero everywhere"""

    standard_errors: tuple[float, ...]
    degrees_of_freedom: int
    """Of the standard errors"""

    thresholds: dict[int, Threshold]
    """Bits n to the flux N_nb at which the error falls below 2⁻ⁿ"""

    def to_dict(self) -> dict[str, Any]:
        """Return the curve ready for JSON; undefined errors are None."""
        fields = asdict(self)
        for name in ("errors", "standard_errors"):
            fields[name] = [None if math.isnan(value) else value for value in fields[name]]
        fields["thresholds"] = {f"N_{bits}b": each for bits, each in fields["thresholds"].items()}
        return fields


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
