"""Settings on the command line: `--scene.trees 200`, and the help that lists them all."""

import shutil
import textwrap
from collections.abc import Iterator, Sequence
from types import UnionType
from typing import Annotated, Any, Union, get_args, get_origin

import yaml
from pydantic import BaseModel

from megalopta.errors import UserError


def split_overrides(
    arguments: Sequence[str], options: Sequence[str], model: type[BaseModel]
) -> tuple[list[str], dict[str, str]]:
    """Separate settings from the program's own options.

    A setting that holds one value takes one word, a list takes all words up to the next option, so
    that `render --scene.trees 200 my.yaml` renders my.yaml.

    Parameters
    ----------
    arguments : sequence of str
        As typed.
    options : sequence of str
        The program's own options, such as "--out"; any other "--path" starts a setting.
    model : type
        Of the settings; tells which are lists.

    Returns
    -------
    own : list of str
        What is left for the program's own parser.
    overrides : dict
        Field path to a value in YAML; several words make a list.
    """
    own: list[str] = []
    found: dict[str, list[str]] = {}
    words, is_full = own, False
    for argument in arguments:
        name, equals, value = argument.partition("=")
        words = own if is_full else words
        is_full = False
        if argument.startswith("--") and name not in options:
            path = name.removeprefix("--").replace("-", "_")
            if not path:
                raise UserError("--: no setting; give its path, such as --camera.width")
            if path in found:
                raise UserError(f"{name}: given twice; several values follow one another")
            words = found[path] = []
            words += [value] if equals else []
            is_full = bool(equals) and not _takes_list(model, path)
        elif name in options:
            own.append(argument)
            words = own
        else:
            words.append(argument)
            is_full = words is not own and not _takes_list(model, path)
    for path, values in found.items():
        if not values:
            raise UserError(f"--{path}: needs a value")
    return own, {
        path: values[0] if len(values) == 1 else f"[{', '.join(values)}]"
        for path, values in found.items()
    }


def _takes_list(model: type[BaseModel], path: str) -> bool:
    """Whether the field at a path may hold a list; also where there is none, which is refused."""
    types: list[Any] = [model]
    for step in path.split("."):
        types = [inner for each in types for inner in _inner_types(each, step)]
    return not types or any(get_origin(each) is tuple for each in types)


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


def settings_help(configuration: BaseModel) -> str:
    """List every setting of a configuration with its meaning, unit and value."""
    width = min(shutil.get_terminal_size().columns, 100)
    lines = ["settings (also keys of the YAML file; a value is read as YAML):"]
    for path, meaning, value in _settings(configuration):
        shown = yaml.safe_dump(value, default_flow_style=True, width=10_000).strip()
        shown = textwrap.shorten(shown.removesuffix("...").strip(), 60)
        lines.append(f"  --{path.replace('_', '-')} {shown}")
        lines += textwrap.wrap(
            " ".join(meaning.split()), width, initial_indent=" " * 6, subsequent_indent=" " * 6
        )
    return "\n".join(lines)


def _settings(model: BaseModel, prefix: str = "") -> Iterator[tuple[str, str, Any]]:
    dumped = model.model_dump(mode="json")
    for name, field in type(model).model_fields.items():
        path, value = f"{prefix}{name}", getattr(model, name)
        parts = value if isinstance(value, tuple) else ()
        if isinstance(value, BaseModel):
            yield from _settings(value, f"{path}.")
        elif parts and isinstance(parts[0], BaseModel):
            names = [getattr(part, "name", type(part).__name__) for part in parts]
            yield path, field.description or "", names
            for index, part in enumerate(parts):
                yield from _settings(part, f"{path}.{index}.")
        else:
            yield path, field.description or "", dumped[name]
