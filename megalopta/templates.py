"""The pixels of templates: gratings computed, panoramas from the cache or from a file."""

from collections.abc import Iterable
from pathlib import Path

from megalopta.natural_panorama import NATURAL_PANORAMAS
from megalopta.panoramas import natural_templates, template_from_file
from megalopta.trial import Array, GratingTemplate, Template


def pixels_of(templates: Iterable[Template], cache: Path | None = None) -> dict[Template, Array]:
    """Return the pixels, (251, m), of each template.

    Parameters
    ----------
    templates
    cache : Path, optional
        Folder of the panoramas rendered by this project; by default the user's.

    Raises
    ------
    UserError
        When a file is no panorama.
    """
    asked = set(templates)
    names = {each.name for each in asked if not isinstance(each, GratingTemplate)}
    rendered = {name: NATURAL_PANORAMAS[name] for name in sorted(names & set(NATURAL_PANORAMAS))}
    natural = natural_templates(cache, rendered) if rendered else {}
    return {template: _pixels(template, natural) for template in asked}


def _pixels(template: Template, natural: dict[str, Array]) -> Array:
    if isinstance(template, GratingTemplate):
        return template.pixels()
    if template.name in natural:
        return natural[template.name]
    return template_from_file(Path(template.name))
