"""Measurements on readings: motion detectors, their references, the photon benchmark."""

from typing import Annotated, Literal

from pydantic import Field, field_validator

from megalopta.config.scene import ONCE
from megalopta.config.sensing import SensingSettings
from megalopta.core.record import Record
from megalopta.flow.benchmark import BenchmarkSettings
from megalopta.flow.detectors.registry import METHODS, THESIS_METHODS

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


class MeasuringSettings(SensingSettings, frozen=True):
    """Measurements on the readings of a sequence."""

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
