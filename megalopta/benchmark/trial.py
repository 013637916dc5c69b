"""One trial of the flow benchmark: what moves how, what is measured of it, and how closely.

A trial is plain data that travels to any worker and comes back from YAML; a template is the picture
that its stimulus is made of.
"""

from collections.abc import Mapping
from typing import Annotated, Any

from pydantic import (
    Field,
    InstanceOf,
    SerializeAsAny,
    ValidationInfo,
    field_validator,
    model_validator,
)

from megalopta.benchmark.panorama_recipes import ROWS
from megalopta.benchmark.templates import GratingTemplate, Template
from megalopta.core.arrays import Floats
from megalopta.core.record import Record
from megalopta.flow.benchmark.search import photon_search
from megalopta.flow.benchmark.settings import SearchSettings, each_once
from megalopta.flow.detectors.base import Detector
from megalopta.flow.detectors.intensity import IntensityMeasurement
from megalopta.flow.detectors.registry import METHODS, THESIS_METHODS, method
from megalopta.flow.metrics.photon_threshold import ErrorCurve
from megalopta.flow.stimuli.moving_template import MovingTemplate, blurred
from megalopta.flow.stimuli.resizing import ResizeKind


class Trial(Record, frozen=True):
    """One stimulus, and the photons that detectors need on it."""

    template: Template = GratingTemplate()
    """What moves"""

    velocity_px: Annotated[int, Field(ge=-(ROWS // 2), le=ROWS // 2)] = 5
    """Motion of the template (columns per frame, positive to the right)"""

    size: Annotated[int, Field(ge=3, le=ROWS)] = 60
    """Spatial pooling: rows and columns of the frames that detectors see (px)"""

    resize: ResizeKind = "nearest"
    """How frames are resized: nearest subsamples as the thesis does, area pools the light"""

    blurred: bool = False
    """Whether frames are smeared by the motion within a frame"""

    methods: Annotated[
        tuple[str | SerializeAsAny[InstanceOf[Detector]], ...],
        Field(min_length=1, description=f"Names of the detectors: {', '.join(METHODS)}"),
    ] = THESIS_METHODS

    search: SearchSettings = SearchSettings()
    """What is measured, and how closely"""

    seed: Annotated[int, Field(ge=0)] = 0
    """Of all random numbers"""

    @field_validator("methods", mode="before")
    @classmethod
    def _functions_too(cls, methods: Any) -> Any:
        """In Python a detector or a function may stand for a name."""
        is_list = isinstance(methods, list | tuple)
        return tuple(method(m) if callable(m) else m for m in methods) if is_list else methods

    @field_validator("methods")
    @classmethod
    def _known_once(
        cls, methods: tuple[str | Detector, ...], validation: ValidationInfo
    ) -> tuple[str | Detector, ...]:
        allows_code = (validation.context or {}).get("allows_code", True)
        found = tuple(method(each, allows_code) for each in methods)
        each_once(tuple(each.name for each in found))
        return tuple(each.name if METHODS.get(each.name) == each else each for each in found)

    @model_validator(mode="after")
    def _is_resolved(self) -> "Trial":
        if isinstance(self.template, GratingTemplate):
            cycles, most = self.template.moving_cycles, self.size / 2
            if cycles > most:
                at_most = self.template.cycles_per_frame * most / cycles
                raise ValueError(
                    f"template.cycles_per_frame {self.template.cycles_per_frame:g} makes"
                    f" {cycles:.3g} moving cycles on {self.size} px, beyond half a cycle per pixel:"
                    f" use at most {at_most:.4g}, or a larger size"
                )
        return self

    @model_validator(mode="after")
    def _moves(self) -> "Trial":
        intensity = IntensityMeasurement()
        motion = [each.name for each in self.detectors if each != intensity]
        if self.velocity_px == 0 and motion:
            raise ValueError(
                f"velocity_px 0: nothing moves, so the errors of {', '.join(motion)} are undefined;"
                " give a velocity, or the method IM alone"
            )
        return self

    @model_validator(mode="after")
    def _methods_fit(self) -> "Trial":
        for each in self.detectors:
            try:
                each.start((self.size, self.size))
            except ValueError as problem:
                raise ValueError(
                    f"size {self.size} is too small for {each.name}: {problem}"
                ) from None
        return self

    @property
    def detectors(self) -> tuple[Detector, ...]:
        """The methods."""
        return tuple(map(method, self.methods))

    @property
    def stimulus(self) -> Mapping[str, Any]:
        """What the light depends on beside the pixels of the template, as plain data."""
        return self.model_dump(mode="json", include={"velocity_px", "size", "resize", "blurred"})


def measure_trial(trial: Trial, pixels: Floats, name: str) -> tuple[ErrorCurve, ...]:
    """Return the error curves of a trial on its template (251, m); `name` seeds its noise."""
    smeared = blurred(pixels, abs(trial.velocity_px)) if trial.blurred else pixels
    stimulus = MovingTemplate(
        smeared, trial.velocity_px, trial.size, trial.resize, trial.search.normalization
    )
    return photon_search(stimulus, trial.detectors, trial.search, trial.seed, name)
