"""Settings on the command line: `--scene.trees 200`, and the help that lists them all."""

import shutil
import textwrap
from collections.abc import Iterator, Sequence
from typing import Any

import yaml
from pydantic import BaseModel

from megalopta.errors import UserError


def split_overrides(
    arguments: Sequence[str], options: Sequence[str]
) -> tuple[list[str], dict[str, str]]:
    """Separate settings from the program's own options.

    Parameters
    ----------
    arguments : sequence of str
        As typed.
    options : sequence of str
        The program's own options, such as "--out"; any other "--path" starts a setting, which takes
        all words up to the next option.

    Returns
    -------
    own : list of str
        What is left for the program's own parser.
    overrides : dict
        Field path to a value in YAML; several words make a list.
    """
    own: list[str] = []
    found: dict[str, list[str]] = {}
    words = own
    for argument in arguments:
        name, equals, value = argument.partition("=")
        if argument.startswith("--") and name not in options:
            path = name.removeprefix("--").replace("-", "_")
            if path in found:
                raise UserError(f"{name}: given twice; several values follow one another")
            words = found[path] = []
            words += [value] if equals else []
        elif name in options:
            own.append(argument)
            words = own
        else:
            words.append(argument)
    for path, values in found.items():
        if not values:
            raise UserError(f"--{path}: needs a value")
    return own, {
        path: values[0] if len(values) == 1 else f"[{', '.join(values)}]"
        for path, values in found.items()
    }


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
            for index, part in enumerate(parts):
                yield from _settings(part, f"{path}.{index}.")
        else:
            yield path, field.description or "", dumped[name]
