"""HTML pages from templates."""

from collections.abc import Callable
from functools import cache
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined


def render_page(
    package: str, name: str, filters: dict[str, Callable[..., str]] | None = None, **values: Any
) -> str:
    """Return the template of this name, which lies in a package, filled with values.

    What is not marked as safe is escaped; a value that is missing is an error.
    """
    environment = _environment(package)
    environment.filters |= filters or {}
    return environment.get_template(name).render(**values)


@cache  # with the templates it has compiled
def _environment(package: str) -> Environment:
    return Environment(
        loader=PackageLoader(package, "."),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
