"""The frozen configuration of a sequence: scene, rendering, sensing and measuring."""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field, field_validator

from megalopta.config import built_in_names, built_in_text
from megalopta.config.scene import ONCE
from megalopta.config.sensing import (
    LightLevel as LightLevel,
    LightLevels as LightLevels,
    SensingSettings,
    level_text as level_text,
)
from megalopta.config.yaml_model import mapping, overridden, validated, yaml_text
from megalopta.core.arrays import Floats
from megalopta.core.errors import UserError, refused_as, shell_command
from megalopta.core.record import Record
from megalopta.flow.benchmark import BenchmarkSettings
from megalopta.flow.detectors.registry import METHODS, THESIS_METHODS
from megalopta.scenes.build import build_scene
from megalopta.scenes.levels import LEVELS, illuminance_of
from megalopta.scenes.spectra.spectrum import Spectrum
from megalopta.scenes.trajectories.orbit import Fit, Orbit, bounds_of

# Longer values, such as a recorded path, are cut in comparisons of two configurations.
_LONGEST_VALUE = 60
_SCENE = ("scene", "scene.kind")


Reference = Literal["self", "perfect"]


class FlowSettings(Record, frozen=True):
    """References and masks of the responses to readings."""

    references: Annotated[tuple[Reference, ...], Field(min_length=1)] = ("self", "perfect")
    """self: the mean reading of the same device; the error is its noise. perfect: the photons on
    the pixels; the error also includes the losses of the device. self is always included."""
    saturated: Literal["score", "leave_out"] = "score"
    """Count saturated pixels, and blocks of which a tenth or more is saturated, in the errors
    (score), or not (leave_out). Record and report give the share of saturated readings."""
    least_purity: Annotated[float, Field(gt=0, le=1)] = 0.75
    """Purity, the share that the object at a pixel's center fills, below which a pixel is mixed.
    The record gives the errors with and without mixed pixels."""


class Configuration(SensingSettings, frozen=True):
    """A sequence: its scene, rendering, sensors and measurements."""

    methods: Annotated[
        tuple[str, ...],
        ONCE,
        Field(min_length=1, description=f"Motion detectors to run, of {', '.join(METHODS)}."),
    ] = THESIS_METHODS
    flow: FlowSettings = FlowSettings()
    """References of the detectors' responses."""
    benchmark: BenchmarkSettings = BenchmarkSettings(sizes=(60,))
    """Search for the photons that each detector needs."""

    @field_validator("methods")
    @classmethod
    def _methods_are_known(cls, methods: tuple[str, ...]) -> tuple[str, ...]:
        for method in methods:
            if method not in METHODS:
                raise ValueError(f"{method!r} is unknown: use some of {', '.join(METHODS)}")
        return methods

    def light_scale(self, level: LightLevel) -> Floats:
        """Factor (B,) per band from the rendered light to a level.

        A named level has its own spectrum, constant within a band. A level in lux, and a
        self-luminous scene, keep the rendered color.
        """
        light, scene, bands = self.light, self.scene, self.render.bands_nm
        is_rendered = level == light.level and scene.has_truth
        if scene.is_self_luminous or is_rendered or not isinstance(level, str):
            return np.full(len(bands), illuminance_of(level) / light.resolved().illuminance_lux)
        before, after = scene.white(light), LEVELS[level].spectrum()
        return np.array([_band_mean(after, band) / _band_mean(before, band) for band in bands])


def _band_mean(spectrum: Spectrum, band: tuple[float, float]) -> float:
    grid = np.linspace(*band, 1025)  # airglow is piecewise linear, with a node every 20 nm
    return float(np.trapezoid(spectrum(grid), grid) / (band[1] - band[0]))


def load(source: str, overrides: Mapping[str, str] | None = None) -> Configuration:
    """Read a configuration and apply overrides. Raises UserError.

    The source is the name of a built-in configuration, a YAML file or a dataset's folder. Overrides
    map the path of a field, such as "scene.trees", to a value in YAML.
    """
    if source in built_in_names():
        return parse(built_in_text(source), source, overrides)
    path = Path(source)
    path = path / "dataset.yaml" if path.is_dir() else path
    known = f"configuration; give a YAML file or one of {', '.join(built_in_names())}"
    return parse(yaml_text(path, known), source, overrides, path.parent)


def parse(
    text: str, source: str, overrides: Mapping[str, str] | None = None, folder: Path | None = None
) -> Configuration:
    """Configuration from YAML text; `source` names it in errors. Raises UserError.

    `folder` is that of the file with the text, in which what it names must lie (`named_path`).
    """
    values = mapping(text, source)
    if "configuration" in values:  # a dataset.yaml
        values = values["configuration"]
    if "plan" in values:
        raise UserError(f"{source}: a dataset of many sequences; give the configuration of one")
    if "scenes" in values:
        raise UserError(
            f"{source}: a plan of many sequences; make them with: "
            f"{shell_command('dataset', 'make', source)}"
        )
    of_scene = {path: value for path, value in (overrides or {}).items() if path in _SCENE}
    changed = overridden(Configuration, values, of_scene) if of_scene else values
    kind = _kind_of_scene(changed)
    if kind != _kind_of_scene(values) and source in built_in_names():
        values = {**values, "objects": []}  # they suit its scene
    values = with_suited_depth(values, kind)
    return fitted(validated(Configuration, values, source, overrides, folder))


def with_suited_depth(values: dict[str, Any], kind: str) -> dict[str, Any]:
    """Return values for a kind of scene: without a depth of light that suits another kind."""
    if kind == _kind_of_scene(values) or not values.get("render"):
        return values
    render = {name: value for name, value in values["render"].items() if name != "max_depth"}
    return {**values, "render": render}


def _kind_of_scene(values: Mapping[str, Any]) -> str:
    scene = values.get("scene")
    return str(scene.get("kind", "forest")) if isinstance(scene, Mapping) else "forest"


def fitted(settings: Configuration) -> Configuration:
    """Replace a path of kind `fit` by the circle around the scene that it stands for.

    Raises UserError if the scene cannot be built, or is made for its camera.
    """
    path = settings.trajectory
    if not isinstance(path, Fit):
        return settings
    if settings.scene.is_made_for_camera:
        raise UserError(
            f"trajectory.kind 'fit': a scene of kind {settings.scene.kind!r} is made for its "
            "camera; use another path"
        )
    with refused_as("scene"):
        anywhere = Orbit(frames=path.frames, frame_rate_hz=path.frame_rate_hz)
        camera, objects = settings.scene_camera or settings.camera, settings.objects
        scene = build_scene(settings.scene, settings.light, camera, anywhere, objects)
    orbit = path.around(bounds_of(scene), camera)
    return settings.model_copy(update={"trajectory": orbit})


def by_content(values: Any) -> Any:
    """Return dumped settings without the paths of files with a hash, which stands for them."""
    if isinstance(values, Mapping):
        left_out = {"path"} if values.get("sha256") else set[str]()
        return {key: by_content(values[key]) for key in values if key not in left_out}
    return [by_content(value) for value in values] if isinstance(values, list) else values


def differences(old: Mapping[str, Any], new: Mapping[str, Any]) -> list[str]:
    """Lines "path: old → new" for every value that differs between two dumped configurations.

    The same file at another path is the same value.
    """
    before, after = dict(_leaves(by_content(old))), dict(_leaves(by_content(new)))
    return [
        f"{path}: {_brief(before.get(path, 'absent'))} → {_brief(after.get(path, 'absent'))}"
        for path in {**before, **after}
        if before.get(path, ...) != after.get(path, ...)
    ]


def _brief(value: Any) -> str:
    text = str(value)
    return text if len(text) <= _LONGEST_VALUE else f"{text[:_LONGEST_VALUE]!r}…"


def _leaves(values: Any, path: str = "") -> Iterator[tuple[str, Any]]:
    if isinstance(values, Mapping):
        for key, value in values.items():
            yield from _leaves(value, f"{path}.{key}" if path else str(key))
    elif isinstance(values, list) and any(isinstance(value, Mapping) for value in values):
        for index, value in enumerate(values):
            yield from _leaves(value, f"{path}.{index}")
    else:
        yield path, values
