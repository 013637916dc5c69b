"""Templates of Chapter 4, the pictures that stimuli are made of: gratings, panoramas, files.

A template is plain data; its pixels are computed, come from the cache or from the user's picture.
"""

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import Field, ValidationInfo, field_validator

from megalopta.assets_gen.grating import GratingVariant, moving_cycles, sine_grating
from megalopta.benchmark.panorama_recipes import NATURAL_PANORAMAS, ROWS
from megalopta.benchmark.panoramas import natural_templates, template_from_file
from megalopta.core.arrays import Floats
from megalopta.core.errors import UserError
from megalopta.core.record import Record
from megalopta.scenes.spectra.color import encode_srgb


class GratingTemplate(Record, frozen=True):
    """The 2-D sine grating of the thesis (§4.2.1), 251 × 251."""

    kind: Literal["grating"] = "grating"
    """Which template this is: grating, or panorama, which has the keys name and coding"""

    cycles_per_frame: Annotated[float, Field(gt=0)] = 5.0
    """Spatial frequency f (cycles per frame)"""

    contrast: Annotated[float, Field(gt=0, le=1)] = 0.9
    """Michelson contrast C"""

    phases_rad: tuple[float, float] = (0.0, 0.0)
    """Phases of its two factors (rad)"""

    variant: GratingVariant = "rot"
    """rot: as the thesis writes, √2·f moving cycles and a seam; periodic: exactly f, no seam"""

    @property
    def moving_cycles(self) -> float:
        """Cycles per frame of the part that moves."""
        return moving_cycles(self.cycles_per_frame, self.variant)

    def pixels(self) -> Floats:
        """Return the template, (251, 251)."""
        x = np.arange(ROWS) / ROWS
        return sine_grating(
            x, x[:, np.newaxis], self.contrast, self.cycles_per_frame, self.phases_rad, self.variant
        )


class PanoramaTemplate(Record, frozen=True):
    """A full turn of natural surroundings, 251 × m."""

    kind: Literal["panorama"] = "panorama"
    """Which template this is"""

    name: Annotated[str, Field(min_length=1)]
    """One of the forests rendered by this project, open, dense, understorey and clearing, or the
    path of an equirectangular picture (EXR, HDR, PNG or JPEG). Paths are relative to the file that
    they stand in; on the command line, to the working folder"""

    coding: Literal["linear", "srgb"] = "linear"
    """linear: light. srgb: gray values of a photograph of it, with the brightest hundredth white"""

    @field_validator("name")
    @classmethod
    def _path_from_its_file(cls, name: str, validation: ValidationInfo) -> str:
        return path_from_its_file(name, validation)


def path_from_its_file(name: str, validation: ValidationInfo) -> str:
    """Return a path relative to the file that is being read; a forest's name as it is."""
    if not Path(name).suffix:
        return name
    return str((validation.context or {}).get("folder", Path()) / name)


Template = Annotated[GratingTemplate | PanoramaTemplate, Field(discriminator="kind")]


def template_names(templates: Sequence[Template]) -> list[str]:
    """Return short names of templates; those of gratings tell in what they differ."""
    gratings = [each for each in templates if isinstance(each, GratingTemplate)]
    differing = [
        field
        for field in GratingTemplate.model_fields
        if len({getattr(each, field) for each in gratings}) > 1
    ]
    return [
        " ".join(["grating", *(f"{field}={getattr(each, field)}" for field in differing)])
        if isinstance(each, GratingTemplate)
        else each.name
        if each.coding == "linear"
        else f"{each.name} {each.coding}"
        for each in templates
    ]


def pixels_of(templates: Iterable[Template], cache: Path | None = None) -> dict[Template, Floats]:
    """Return the pixels, (251, m), of each template. Raises UserError for what is no panorama.

    Panoramas rendered by this project are in the cache, by default the user's.
    """
    asked = set(templates)
    names = {each.name for each in asked if not isinstance(each, GratingTemplate)}
    rendered = {name: NATURAL_PANORAMAS[name] for name in sorted(names & set(NATURAL_PANORAMAS))}
    natural = natural_templates(cache, rendered) if rendered else {}
    return {template: _pixels(template, natural) for template in asked}


def _pixels(template: Template, natural: dict[str, Floats]) -> Floats:
    if isinstance(template, GratingTemplate):
        return template.pixels()
    light = natural.get(template.name)
    if light is None:
        path = Path(template.name)
        if not (path.suffix or path.exists()):
            raise UserError(
                f"template.name: no forest {template.name!r}; there are"
                f" {', '.join(NATURAL_PANORAMAS)}, or give the path of a panorama"
            )
        light = template_from_file(path)
    return light if template.coding == "linear" else _photographed(light)


def _photographed(light: Floats) -> Floats:
    gray = encode_srgb(light / np.percentile(light, 99)).astype(np.float64)
    return np.asarray(gray / gray.mean())
