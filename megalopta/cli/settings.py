"""Settings of verbs, with types, meaning and defaults, from `settings.json`: no model is loaded.

`megalopta.cli.describing` writes that file from the models.
"""

import json
import shutil
import textwrap
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, Literal

from megalopta.config import built_in_text
from megalopta.core.errors import UserError, nearest

FILE = Path(__file__).with_name("settings.json")
Words = Literal["switch", "one", "all"]
"""Words that a setting takes on the command line; "all": up to the next option."""
_PLUG_INS = "megalopta.scenes", "megalopta.sensors", "megalopta.detectors"


@cache
def description() -> dict[str, Any]:
    """Return the content of `settings.json`, or, with plug-ins installed, that of their models."""
    from importlib.metadata import entry_points

    if any(entry_points(group=group) for group in _PLUG_INS):
        from megalopta.cli.describing import described

        return described()
    models: dict[str, Any] = json.loads(FILE.read_text("utf-8"))
    return models


@dataclass(frozen=True)
class VerbSettings:
    """Settings of a verb."""

    models: tuple[str, ...] = ("Configuration",)
    stage: str = ""
    """Lists the fields of the first model on which the output of this stage depends; all if empty
    """
    values: str = ""
    """Built-in configuration whose values are the defaults; if empty, the models' own are"""

    def takes(self, path: str) -> Words:
        """Number of words that the field at a path takes. Raises UserError if there is none.

        A switch takes none, or "true" or "false".
        """
        steps, models = path.split("."), description()["models"]
        having = [name for name in self.models if steps[0] in models[name]]
        types: list[Any] = [{"model": name} for name in having[:1] or self.models]
        for depth, step in enumerate(steps):
            inner = [kind for outer in types for kind in _inside(outer, step)]
            if not inner:
                known = {name for kind in _models(types) for name in models[kind]}
                remedy = f"give {'.'.join(steps[:depth])} as a whole"
                remedy = nearest(step, sorted(known), "the keys are") if known else remedy
                place = ".".join(steps[: depth + 1])
                raise UserError(f"command line: {place}: unknown key; {remedy}")
            types = inner
        if "any" in types or any("list" in kind for kind in types if isinstance(kind, dict)):
            return "all"
        return "switch" if types == ["switch"] else "one"

    def help(self, often: Collection[str] = ()) -> str:
        """List the settings with meaning, unit and default.

        If some are changed `often`, list these alone, each in one sentence.
        """
        from megalopta.config.yaml_model import mapping
        from megalopta.core import strict_yaml

        width = min(shutil.get_terminal_size().columns, 100)
        source = f"the values of {self.values}" if self.values else "their defaults"
        values = mapping(built_in_text(self.values), self.values) if self.values else {}
        if self.stage == "sense":
            values, source = description()["pictures"], "the defaults for pictures"
        first, *further = self.models
        fields = description()["stages"].get(self.stage, description()["models"][first])
        listed = list(settings_of(first, {name: values.get(name, ...) for name in fields}))
        for model in further:
            more = {name: ... for name in description()["models"][model] if name not in fields}
            listed += settings_of(model, more)
        shown = [setting for setting in listed if setting[0] in often] or listed
        lines = [
            "settings (also keys of the YAML file; values are YAML), with "
            f"{source}; a file or a dataset may state others:"
        ]
        for path, field, value in shown:
            meaning = " ".join(field["meaning"].split())
            meaning = f"{(meaning.split('. ')[0] if often else meaning).rstrip('.')}."
            if missing := [choice for choice in field.get("choices", ()) if choice not in meaning]:
                meaning += f" {'Also' if len(missing) < len(field['choices']) else 'One of'}: "
                meaning += f"{', '.join(missing)}."
            text = strict_yaml.dump(value, default_flow_style=True, width=10_000).strip()
            text = textwrap.shorten(text.removesuffix("...").strip(), width=60)
            lines.append(f"  --{path.replace('_', '-')} {text}")
            indent = " " * 6
            lines += textwrap.wrap(meaning, width, initial_indent=indent, subsequent_indent=indent)
        if len(shown) < len(listed):
            lines.append(f"  … and {len(listed) - len(shown)} more: --help-all")
        return "\n".join(lines)


def settings_of(model: str, values: Mapping[str, Any], prefix: str = "") -> Iterator[Any]:
    """Path, description and value of settings that `values` names; `...` stands for the default.

    Of a list of models, their names stand for its value, and their settings follow.
    """
    from megalopta.core.validation import merged

    models, presets = description()["models"], description()["presets"]
    for name, field in models[model].items():
        if name not in values:
            continue
        path = f"{prefix}{name}"
        value = field["default"] if values[name] is ... else values[name]
        types = [inner for kind in field["types"] for inner in (kind, *_inside(kind, "0"))]
        kinds = _models(types)
        by_kind = {models[kind].get("kind", {}).get("default"): kind for kind in kinds}
        is_list, parts = isinstance(value, list), list[Any]()
        for part in value if is_list else [value]:
            preset = part.get("preset") if isinstance(part, Mapping) else part
            known = presets.get(name, {}).get(preset) if isinstance(preset, str) else None
            changes = part if isinstance(part, Mapping) else {}
            parts.append(merged(known, changes) if known else part)
        inner = [part for part in parts if kinds and isinstance(part, Mapping)]
        if is_list:
            names = (
                p.get("name", p.get("kind", p)) if isinstance(p, Mapping) else p for p in parts
            )
            yield path, field, list(names)
        elif not inner:
            yield path, field, value
        for index, part in enumerate(inner):
            kind = by_kind.get(part.get("kind"), kinds[0])
            place = f"{path}.{index}." if is_list else f"{path}."
            yield from settings_of(kind, {key: part.get(key, ...) for key in models[kind]}, place)


def _models(types: Collection[Any]) -> list[str]:
    return [str(kind["model"]) for kind in types if isinstance(kind, dict) and "model" in kind]


def _inside(outer: Any, step: str) -> list[Any]:
    """Types of the value at a key or an index inside a type; none if there is no such step."""
    if not isinstance(outer, dict):
        return ["any"] if outer == "any" else []
    ((kind, inner),) = outer.items()
    if kind == "model":
        field = description()["models"][inner].get(step)
        return field["types"] if field else ["any" for key in description()["keys"] if key == step]
    return list(inner) if kind == "map" or step.isdecimal() else []
