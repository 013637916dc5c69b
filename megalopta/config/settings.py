"""What a verb of the command line can be set to do: every field of a model, by its path."""

import shutil
import textwrap
from collections.abc import Collection, Iterator
from dataclasses import dataclass
from itertools import chain
from types import UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin

from pydantic import BaseModel

from megalopta.core import strict_yaml

Words = Literal["switch", "one", "all"]
"""How many words a setting takes on the command line; all are those up to the next option."""


@dataclass(frozen=True)
class Settings:
    """Settings of a verb."""

    record: BaseModel
    """With the values that stand where nothing else is asked for."""
    fields: Collection[str] | None = None
    """Those that its help lists; all by default."""
    others: tuple[BaseModel, ...] = ()
    """More records, whose fields have other names."""

    def takes(self, path: str) -> Words:
        """How many words the field at a path takes; "all" also where there is none: it is refused.

        A switch takes none, or "true" or "false".
        """
        types: list[Any] = [type(each) for each in (self.record, *self.others)]
        for step in path.split("."):
            types = [inner for each in types for inner in _inner_types(each, step)]
        if not types or any(get_origin(each) is tuple for each in types):
            return "all"
        return "switch" if types == [bool] else "one"

    def help(self) -> str:
        """List the settings, each with its meaning, unit and value."""
        width = min(shutil.get_terminal_size().columns, 100)
        lines = ["settings (also keys of the YAML file; a value is read as YAML):"]
        listed = [
            each
            for each in settings_of(self.record)
            if self.fields is None or each[0].partition(".")[0] in self.fields
        ]
        for path, meaning, value in [*listed, *chain.from_iterable(map(settings_of, self.others))]:
            shown = strict_yaml.dump(value, default_flow_style=True, width=10_000).strip()
            shown = textwrap.shorten(shown.removesuffix("...").strip(), 60)
            lines.append(f"  --{path.replace('_', '-')} {shown}")
            indent = " " * 6
            lines += textwrap.wrap(
                " ".join(meaning.split()), width, initial_indent=indent, subsequent_indent=indent
            )
        return "\n".join(lines)


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
            yield path, field.description or "", dumped[name]


def _inner_types(outer: Any, step: str) -> Iterator[Any]:
    if get_origin(outer) is tuple and step.isdecimal():
        yield from _plain_types(get_args(outer)[0])
    elif get_origin(outer) is dict:
        yield from _plain_types(get_args(outer)[1])
    elif isinstance(outer, type) and issubclass(outer, BaseModel) and step in outer.model_fields:
        yield from _plain_types(outer.model_fields[step].annotation)


def _plain_types(annotation: Any) -> Iterator[Any]:
    """Types that an annotation allows, without unions and metadata."""
    if get_origin(annotation) is Annotated:
        yield from _plain_types(get_args(annotation)[0])
    elif get_origin(annotation) in (Union, UnionType):
        for part in get_args(annotation):
            yield from _plain_types(part)
    else:
        yield annotation
