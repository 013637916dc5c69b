"""Trials of the flow benchmark: stimulus, metrics and precision; sweeps of them; and their run.

Trials run on threads (the kernels release the GIL), each stored as soon as it is finished under a
hash of everything that it depends on: the trial, the pixels of its template and the code.
"""

import json
import operator
import os
from collections.abc import Iterable, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor, as_completed
from functools import cached_property
from itertools import product
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple, Self

import numpy as np
import pydantic

from megalopta.assets_gen.grating import GratingVariant, moving_cycles, sine_grating
from megalopta.benchmark import panoramas
from megalopta.benchmark.methods import identity
from megalopta.config.scene import ONCE
from megalopta.config.yaml_model import mapping, put, validated, yaml_text
from megalopta.core import files
from megalopta.core.arrays import Floats
from megalopta.core.bounded import Typed, folder_of, named_path
from megalopta.core.errors import UserError
from megalopta.core.folders import ensure_directory, locked
from megalopta.core.freshness import code_digest, digest
from megalopta.core.progress import progress
from megalopta.core.record import Record
from megalopta.core.validation import checked
from megalopta.flow.benchmark import SearchSettings, each_once
from megalopta.flow.benchmark_search import photon_search
from megalopta.flow.detectors.base import Detector
from megalopta.flow.detectors.registry import METHODS, THESIS_METHODS, method
from megalopta.flow.metrics.photon_threshold import ErrorCurve
from megalopta.flow.stimuli.moving_template import MovingTemplate, motion_blurred
from megalopta.flow.stimuli.photons import BlackFrameError, ResizeKind
from megalopta.scenes.spectra.color import encode_srgb

Curves = tuple[ErrorCurve, ...]


class GratingTemplate(Record, frozen=True):
    """The 2-D sine grating of the dissertation (§4.2.1), 251 × 251."""

    kind: Literal["grating"] = "grating"
    """Kind of the template: grating, or panorama, which has the keys name and coding"""
    cycles_per_frame: Annotated[float, pydantic.Field(gt=0)] = 5.0
    """Spatial frequency f (cycles per frame)"""
    contrast: Annotated[float, pydantic.Field(gt=0, le=1)] = 0.9
    """Michelson contrast C"""
    variant: GratingVariant = "rot"
    """rot: as in the dissertation, √2·f moving cycles and a seam; periodic: exactly f, no seam"""

    @property
    def moving_cycles(self) -> float:
        """Cycles per frame of the moving part."""
        return moving_cycles(self.cycles_per_frame, self.variant)

    def pixels(self) -> Floats:
        """Return the template, (251, 251)."""
        x = np.arange(panoramas.ROWS) / panoramas.ROWS
        waves = self.contrast, self.cycles_per_frame, (0.0, 0.0), self.variant
        return sine_grating(x, x[:, np.newaxis], *waves)


def path_from_its_file(name: Any, validation: pydantic.ValidationInfo) -> Any:
    """Return a path relative to the file being read; a forest's name unchanged."""
    if not isinstance(name, str) or not Path(name).suffix:
        return name
    return str(named_path(name, folder_of(validation)))


class PanoramaTemplate(Record, frozen=True):
    """A panorama of natural surroundings, 251 × m."""

    kind: Literal["panorama"] = "panorama"
    """Kind of the template"""
    name: Annotated[str, pydantic.BeforeValidator(path_from_its_file), pydantic.Field(min_length=1)]
    """A forest rendered by this project, open, dense, understorey or clearing, or the path of an
    equirectangular picture (EXR, HDR, PNG or JPEG). Paths are relative to the file that contains
    them; on the command line, to the working folder"""
    coding: Literal["linear", "srgb"] = "linear"
    """linear: light. srgb: gray values of a photograph of it, with the brightest 1 % white"""


Template = Annotated[GratingTemplate | PanoramaTemplate, pydantic.Field(discriminator="kind")]


def template_names(templates: Sequence[Template]) -> list[str]:
    """Return short names of templates; those of gratings show their differences."""
    gratings = [template for template in templates if isinstance(template, GratingTemplate)]
    differing = [
        field
        for field in GratingTemplate.model_fields
        if len({getattr(grating, field) for grating in gratings}) > 1
    ]
    names = []
    for template in templates:
        if isinstance(template, GratingTemplate):
            values = (f"{field}={getattr(template, field)}" for field in differing)
            names.append(" ".join(["grating", *values]))
        else:
            names.append(f"{template.name} {template.coding}".removesuffix(" linear"))
    return names


def template_pixels(templates: Iterable[Template]) -> dict[Template, Floats]:
    """Return the pixels, (251, m), of each template. Raises UserError if one is not a panorama."""
    pixels: dict[Template, Floats] = {}
    for template in set(templates):
        if isinstance(template, GratingTemplate):
            pixels[template] = template.pixels()
            continue
        if template.name in panoramas.NATURAL_PANORAMAS:
            light = panoramas.natural_template(template.name)
        elif Path(template.name).suffix or Path(template.name).exists():
            light = panoramas.template_from_file(Path(template.name))
        else:
            raise UserError(
                f"template.name: no forest {template.name!r}; there are"
                f" {', '.join(panoramas.NATURAL_PANORAMAS)}, or give the path of a panorama"
            )
        if template.coding == "srgb":
            gray = encode_srgb(light / np.percentile(light, 99)).astype(np.float64)
            light = np.asarray(gray / gray.mean())
        pixels[template] = light
    return pixels


class Trial(Record, frozen=True):
    """One stimulus, and the photons that detectors need on it."""

    template: Template = GratingTemplate()
    """Moving template"""
    velocity_px: Annotated[
        int, pydantic.Field(ge=-(panoramas.ROWS // 2), le=panoramas.ROWS // 2)
    ] = 5
    """Motion of the template (columns per frame, positive to the right)"""
    size: Annotated[int, pydantic.Field(ge=3, le=panoramas.ROWS)] = 60
    """Spatial pooling: rows and columns of the frames that detectors see (px)"""
    resize: ResizeKind = "nearest"
    """Resizing of frames: nearest subsamples as in the dissertation, area pools the light"""
    blurred: bool = False
    """True if the motion within a frame blurs it"""
    methods: Annotated[
        tuple[str | pydantic.SerializeAsAny[pydantic.InstanceOf[Detector]], ...],
        pydantic.Field(min_length=1, description="Names of the detectors: " + ", ".join(METHODS)),
    ] = THESIS_METHODS
    search: SearchSettings = SearchSettings()
    """Metrics and precision of the search"""
    seed: Annotated[int, pydantic.Field(ge=0)] = 0
    """Seed of all random numbers"""

    @pydantic.field_validator("methods", mode="before")
    @classmethod
    def _known_once(cls, methods: Any, validation: pydantic.ValidationInfo) -> Any:
        """Find each method; a name in a file runs no code unless that is allowed."""
        if not isinstance(methods, list | tuple) or not all(
            isinstance(name, str | Detector) or callable(name) for name in methods
        ):
            return methods
        allows_code = (validation.context or {}).get("allows_code", True)
        detectors = [method(name, allows_code or isinstance(name, Typed)) for name in methods]
        each_once(tuple(detector.name for detector in detectors))
        return [
            detector.name if METHODS.get(detector.name) == detector else detector
            for detector in detectors
        ]

    @pydantic.model_validator(mode="after")
    def _can_be_measured(self) -> "Trial":
        if isinstance(self.template, GratingTemplate):
            cycles, most = self.template.moving_cycles, self.size / 2
            if cycles > most:
                at_most = self.template.cycles_per_frame * most / cycles
                raise ValueError(
                    f"template.cycles_per_frame {self.template.cycles_per_frame:g} makes"
                    f" {cycles:.3g} moving cycles on {self.size} px, beyond half a cycle per pixel:"
                    f" use at most {at_most:.4g}, or a larger size"
                )
        motion = [detector.name for detector in self.detectors if detector != METHODS["IM"]]
        if self.velocity_px == 0 and motion:
            raise ValueError(
                f"velocity_px 0: no motion, so the errors of {', '.join(motion)} are undefined;"
                " give a velocity, or the method IM alone"
            )
        for detector in self.detectors:
            detector.start((self.size, self.size))  # refuses frames that are too small
        return self

    @property
    def detectors(self) -> tuple[Detector, ...]:
        """Methods of the trial."""
        return tuple(map(method, self.methods))


def measure_trial(trial: Trial, pixels: Floats, name: str) -> Curves:
    """Return the error curves of a trial on its template (251, m); `name` seeds its noise."""
    smeared = motion_blurred(pixels, abs(trial.velocity_px)) if trial.blurred else pixels
    stimulus = MovingTemplate(smeared, trial.velocity_px, trial.size, trial.resize)
    return photon_search(stimulus, trial.detectors, trial.search, trial.seed, name)


Value = int | float | bool | str
MOST_TRIALS = 10_000
"""Most trials of a sweep; checking this many takes a minute."""


class SweepPoint(NamedTuple):
    """One trial of a sweep, and its place."""

    size: int
    value: Value
    template: str
    """Short name"""
    trial: Trial


class Sweep(Record, frozen=True):
    """Trials that differ in one parameter, in several sizes, averaged over several templates."""

    title: str = "Photons that motion detectors need"
    """Title, in one line"""
    trial: Trial = Trial()
    """The fixed parameters"""
    vary: str = "velocity_px"
    """Path of the varied parameter in a trial, such as template.contrast or search.dark_counts"""
    values: Annotated[tuple[Value, ...], ONCE, pydantic.Field(min_length=1)] = (1, 2, 5, 10)
    """Values of that parameter"""
    sizes: Annotated[tuple[int, ...], ONCE] = ()
    """Spatial pooling (px), a panel of the figure each; default: that of the trial"""
    templates: Annotated[tuple[Template, ...], ONCE] = ()
    """Templates that thresholds are averaged over; default: that of the trial"""

    @pydantic.field_validator("values", mode="before")
    @classmethod
    def _paths_from_their_file(cls, values: Any, validation: pydantic.ValidationInfo) -> Any:
        if validation.data.get("vary") != "template.name" or not isinstance(values, list | tuple):
            return values
        return [path_from_its_file(value, validation) for value in values]

    @pydantic.model_validator(mode="after")
    def _every_trial_is_possible(self) -> Self:
        count = len(self.values) * len(self.sizes or "1") * len(self.templates or "1")
        if count > MOST_TRIALS:
            raise ValueError(f"values: {count} trials; give at most {MOST_TRIALS} in all")
        if self.vary.startswith(("methods", "search.metrics", "search.bits")):
            raise ValueError(f"vary: {self.vary} cannot vary within a figure; set it in the trial")
        if self.vary == "size" and self.sizes:
            raise ValueError("sizes: size is varied already; omit sizes")
        try:
            trials = self.trials
        except UserError as error:
            raise ValueError(str(error).replace("--", "vary: ", 1)) from None
        if len(set(trials)) < len(trials):
            raise ValueError(
                f"duplicate trial: {self.vary} is varied, so values and templates must"
                " differ in it; give each once"
            )
        return self

    @cached_property
    def points(self) -> tuple[SweepPoint, ...]:
        """Trials by size, value and template, in this order."""
        fixed = {**self.trial.model_dump(mode="json"), "methods": self.trial.methods}
        sizes = self.sizes or (self.trial.size,)
        templates = self.templates or (self.trial.template,)
        trials: list[tuple[Value, Trial]] = []
        for size, value, template in product(sizes, self.values, templates):
            fields = {**fixed, "size": size, "template": template.model_dump(mode="json")}
            put(fields, self.vary, value, Trial)
            trial = checked(Trial, fields)
            # a quoted number is text
            number = operator.attrgetter(self.vary)(trial) if isinstance(value, str) else value
            trials.append((number, trial))
        pictures = list(dict.fromkeys(trial.template for _, trial in trials))
        names = dict(zip(pictures, template_names(pictures), strict=True))
        return tuple(
            SweepPoint(trial.size, value, names[trial.template], trial) for value, trial in trials
        )

    @property
    def trials(self) -> list[Trial]:
        """All trials."""
        return [point.trial for point in self.points]


def load_sweep(
    path: Path, overrides: dict[str, str] | None = None, allows_code: bool = False
) -> Sweep:
    """Return the sweep of a YAML file with settings of the command line.

    Overrides map the path of a field to a value in YAML, and may name code. Methods of the file may
    be `module:function` or ONNX files, which are run, only if `allows_code`. Raises UserError if
    the file cannot be read, or is no sweep.
    """
    values = mapping(yaml_text(path, "sweep; give a YAML file"), str(path))
    return validated(Sweep, values, str(path), overrides, path.parent, allows_code)


Results = Mapping[Trial, Curves]

_OF_LIGHT = {"velocity_px", "size", "resize", "blurred"}
"""Properties of the light other than the pixels of the template"""


def run(
    trials: Iterable[Trial],
    templates: Mapping[Template, Floats],
    store: Path,
    workers: int | None = None,
) -> dict[Trial, Curves]:
    """Return the error curves of all trials, which are kept in a folder; shows progress.

    They run on threads, by default one per core; duplicates are run once. Raises UserError if a
    template cannot be measured, such as one with a black frame.
    """
    # the longest first, so that no worker runs one alone at the end
    ordered = sorted(set(trials), key=lambda trial: (-trial.size, trial.model_dump_json()))
    kpixels = {trial: max(1, trial.size**2 // 1000) for trial in ordered}
    hashes = {template: digest(pixels.tobytes()) for template, pixels in templates.items()}
    code = code_digest("megalopta.flow", "megalopta.sensor.sampling", __name__)
    results: dict[Trial, Curves] = {}
    running: dict[Future[Curves], tuple[Trial, Path]] = {}
    ensure_directory(store)
    executor = ThreadPoolExecutor(workers or os.cpu_count())
    title = "Searching photon thresholds"
    with locked(store), progress(title, sum(kpixels.values()), "kpixel") as advance:
        files.sweep(store)
        for trial in ordered:
            pixels, picture = templates[trial.template], hashes[trial.template]
            parts = picture, code, *map(identity, trial.detectors)
            path = store / f"{digest(trial.model_dump_json(), *parts)}.json"
            if (stored := _read(path)) is None:
                light = json.dumps(trial.model_dump(mode="json", include=_OF_LIGHT))
                future = executor.submit(measure_trial, trial, pixels, digest(light, picture))
                running[future] = trial, path
            else:
                results[trial] = stored
                advance(kpixels[trial])
        try:
            for future in as_completed(running):
                trial, path = running[future]
                results[trial] = future.result()
                curves = [curve.to_dict() for curve in results[trial]]
                files.write_json(path, {"trial": trial.model_dump(mode="json"), "curves": curves})
                advance(kpixels[trial])
        except BlackFrameError as problem:
            raise UserError(f"{template_names([trial.template])[0]}: {problem}") from None
        finally:
            # an interruption does not wait for unfinished trials
            executor.shutdown(wait=False, cancel_futures=True)
    return results


def _read(path: Path) -> Curves | None:
    """Return the stored result; None if it is missing or damaged."""
    try:
        record = json.loads(path.read_text("utf-8"))
        return tuple(ErrorCurve.from_dict(fields) for fields in record["curves"])
    except (FileNotFoundError, ValueError, LookupError, TypeError, AttributeError):
        return None
