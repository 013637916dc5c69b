"""Methods that benchmarks measure: those that give velocities of blocks, and their baselines.

Baselines: gray methods with settings for each light (`tuned.yaml`, found by `benchmarks/tune.py`),
or on variance-stabilized counts with one blur for all.
"""

import inspect
from collections.abc import Callable, Iterable, Mapping
from functools import cache
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from pydantic import SerializeAsAny

from megalopta.core import strict_yaml
from megalopta.core.arrays import Floats
from megalopta.core.freshness import digest
from megalopta.flow.detectors import registry
from megalopta.flow.detectors.base import Detector, Frames
from megalopta.flow.detectors.blocks import BlockDetector, BlockGrid
from megalopta.flow.detectors.gray_detector import GrayDetector

Methods = Mapping[str, BlockDetector]

_STRETCHES: Mapping[str, tuple[Mapping[str, object], str]] = {
    "√": ({"stretch": "anscombe", "blur_px": 0.7}, "square roots of counts"),
    "NLM": ({"stretch": "denoised"}, "counts denoised by non-local means"),
}
TUNED: Mapping[str, Mapping[float, Mapping[str, Any]]] = strict_yaml.load(
    Path(__file__).with_name("tuned.yaml").read_text("utf-8")
)
"""Settings by method and photons per pixel, with their error on the tuning scenes"""
STRONGEST = tuple(f"{name} tuned" if name in TUNED else name for name in registry.VELOCITY_METHODS)
"""Names of the methods that give velocities, tuned to the light where there are settings"""


class TunedMethod(BlockDetector, frozen=True):
    """A gray method with the settings chosen for the light nearest to that of its frames."""

    takes_counts: ClassVar[bool] = True

    method: SerializeAsAny[GrayDetector]

    def dense(self, *frames: Frames) -> Floats:
        """Return the flow as the method does, with the settings for the light."""
        return self._at(float(self.as_counts(self.checked(frames)).mean())).dense(*frames)

    def velocities(self, grid: BlockGrid, window: list[Frames]) -> Floats:
        """Return the velocities of the method, with the settings for the light."""
        return self._at(float(np.mean(window))).velocities(grid, window)

    def _at(self, photons: float) -> GrayDetector:
        rows = TUNED[self.method.name]
        nearest = min(rows, key=lambda tried: abs(np.log(max(photons, 1e-9) / tried)))
        settings = {name: value for name, value in rows[nearest].items() if name != "error_px"}
        same = {name: getattr(self, name) for name in ("block_px", "fewest_blocks", "noise")}
        return self.method.model_copy(update=settings | same)


def tuned(name: str) -> TunedMethod:
    """Return a gray method as `NAME tuned`. Raises ValueError if there are no settings for it."""
    gray = gray_method(name)
    if gray.name not in TUNED:
        known = ", ".join(TUNED)
        raise ValueError(f"{gray.name} tuned: settings exist for {known}; or give {gray.name} √")
    label = f"{gray.label}, tuned to the light"
    return TunedMethod(name=f"{gray.name} tuned", label=label, method=gray)


def gray_method(name: str) -> GrayDetector:
    """Return a method that takes gray levels. Raises ValueError for any other."""
    detector = registry.method(name)
    if not isinstance(detector, GrayDetector):
        raise ValueError(
            f"{detector.name} takes no gray levels: give DIS, an ONNX file or the like"
        )
    return detector


def velocity_methods(chosen: Iterable[registry.Method]) -> Methods:
    """Return methods and baselines by name.

    Raises ValueError if one is unknown, gives no velocities, or has a duplicate name.
    """
    detectors: dict[str, BlockDetector] = {}
    for detector in map(method_or_baseline, chosen):
        if detector.name in detectors:
            raise ValueError(f"methods: duplicate {detector.name!r}; give each once")
        detectors[detector.name] = detector
    return detectors


def with_compared(chosen: Iterable[registry.Method], against: str) -> tuple[Methods, str]:
    """Return methods with the one that others are compared with, "" for none, and its name."""
    methods = velocity_methods(chosen)
    added = {} if against in methods or not against else velocity_methods([against])
    return {**methods, **added}, next(iter(added), against)


def method_or_baseline(chosen: registry.Method) -> BlockDetector:
    """Return a method that gives velocities of blocks, or a baseline: `DIS tuned`, `√` or `NLM`.

    Raises ValueError for any other.
    """
    name, _, kind = chosen.rpartition(" ") if isinstance(chosen, str) else ("", "", "")
    if kind == "tuned":
        return tuned(name)
    if kind not in _STRETCHES:
        return registry.velocity_method(chosen)
    detector, (settings, light) = gray_method(name), _STRETCHES[kind]
    names = {"name": f"{detector.name} {kind}", "label": f"{detector.label}, {light}"}
    return detector.model_copy(update={**names, **settings})


def block_detector(chosen: registry.Method) -> BlockDetector:
    """Return a method or baseline with the blocks of boards of whole frames, 24 × 24 px."""
    return method_or_baseline(chosen).model_copy(update={"block_px": 24})


def methods_and_baselines() -> list[BlockDetector]:
    """Return all methods that run on two frames, tuned to the light where there are settings."""
    chosen = (*STRONGEST, "DIS √", "DeepFlow √")
    return [detector for detector in map(block_detector, chosen) if detector.memory_frames == 1]


def check_gives_flow(detector: BlockDetector, flow: Floats) -> None:
    """Raise ValueError, naming the method, if flow (..., 2) in bright light is nowhere known."""
    if not np.isfinite(flow).all(axis=-1).any():
        raise ValueError(
            f"{detector.name} gives no flow at any pixel, or on any whole block; omit it, or let it"
            " return some"
        )


def identity(detector: Detector) -> str:
    """Identify a method: its parameters, its class, the file of a function, tuned settings."""
    function = getattr(detector, "function", None)
    places = type(detector), inspect.unwrap(function) if inspect.isfunction(function) else None
    settings = str(TUNED.get(detector.method.name)) if isinstance(detector, TunedMethod) else ""
    parts = detector.model_dump_json(), settings
    return digest(*parts, *(_source(place) for place in places if place))


@cache
def _source(place: type[Detector] | Callable[..., object]) -> bytes:
    file = Path(inspect.getsourcefile(place) or "")
    return file.read_bytes() if file.is_file() else b""
