"""The pixels of templates: gratings computed, panoramas from the cache or from a file."""

from collections.abc import Iterable
from pathlib import Path

import numpy as np

from megalopta.benchmark.panorama_recipes import NATURAL_PANORAMAS
from megalopta.benchmark.panoramas import natural_templates, template_from_file
from megalopta.benchmark.trial import GratingTemplate, Template
from megalopta.core.arrays import Floats
from megalopta.core.errors import UserError
from megalopta.scenes.spectra.color import encode_srgb


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
