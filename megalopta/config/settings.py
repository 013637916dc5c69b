"""Settings of a verb: every field of a model, by its path."""

import shutil
import textwrap
from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass
from typing import Any, Literal, get_origin

from pydantic import BaseModel

from megalopta.core import strict_yaml
from megalopta.core.validation import inner_types

Words = Literal["switch", "one", "all"]
"""Words that a setting takes on the command line; "all": up to the next option."""


@dataclass(frozen=True)
class VerbSettings:
    """Settings of a verb."""

    model: type[BaseModel]
    default: Callable[[], BaseModel] | None = None
    """Makes the default values; without it, the model's own"""
    fields: Collection[str] | None = None
    """Fields listed in the help; all by default."""
    others: tuple[type[BaseModel], ...] = ()
    """More models, with other field names."""

    def takes(self, path: str) -> Words:
        """Number of words that the field at a path takes; "all" for an unknown path, refused later.

        A switch takes none, or "true" or "false".
        """
        types: list[Any] = [self.model, *self.others]
        for step in path.split("."):
            types = [inner for each in types for inner in inner_types(each, step)]
        if not types or any(get_origin(each) is tuple for each in types):
            return "all"
        return "switch" if types == [bool] else "one"

    def help(self, often: Collection[str] = ()) -> str:
        """List the settings with meaning, unit and default.

        If some are changed `often`, list these alone, each in one sentence.
        """
        width = min(shutil.get_terminal_size().columns, 100)
        listed = self._listed()
        chosen = [each for each in listed if each[0] in often] or listed
        lines = ["settings (also keys of the YAML file; values are YAML):"]
        for path, meaning, value in chosen:
            if often:
                meaning = f"{meaning.split('. ')[0].rstrip('.')}."
            shown = strict_yaml.dump(value, default_flow_style=True, width=10_000).strip()
            shown = textwrap.shorten(shown.removesuffix("...").strip(), 60)
            lines.append(f"  --{path.replace('_', '-')} {shown}")
            indent = " " * 6
            lines += textwrap.wrap(
                " ".join(meaning.split()), width, initial_indent=indent, subsequent_indent=indent
            )
        if len(chosen) < len(listed):
            lines.append(f"  … and {len(listed) - len(chosen)} more: --help-all")
        return "\n".join(lines)

    def _listed(self) -> list[tuple[str, str, Any]]:
        """Path, meaning and value of every setting of the verb."""
        own = [
            each
            for each in settings_of((self.default or self.model)())
            if self.fields is None or each[0].partition(".")[0] in self.fields
        ]
        return own + [each for other in self.others for each in settings_of(other())]


def settings_of(model: BaseModel, prefix: str = "") -> Iterator[tuple[str, str, Any]]:
    """Path, meaning and value of every setting of a model."""
    dumped = model.model_dump(mode="json")
    for name, field in type(model).model_fields.items():
        path, value = f"{prefix}{name}", getattr(model, name)
        parts = value if isinstance(value, tuple) else ()
        if isinstance(value, BaseModel):
            yield from settings_of(value, f"{path}.")
        elif parts and isinstance(parts[0], BaseModel):
            names = [getattr(part, "name", type(part).__name__) for part in parts]
            yield path, field.description or "", names
            for index, part in enumerate(parts):
                yield from settings_of(part, f"{path}.{index}.")
        else:
            yield path, field.description or "", dumped.get(name, value)  # omitted at default
