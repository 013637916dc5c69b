"""Settings of verbs, with types, meaning and defaults, from `settings.json`: no model is loaded.

`megalopta.cli.describing` writes that file from the models.
"""

import json
import shutil
import textwrap
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from difflib import get_close_matches
from functools import cache
from pathlib import Path
from typing import Any, Literal, NoReturn

from megalopta.config import built_in_names, built_in_text
from megalopta.core.errors import UserError

FILE = Path(__file__).with_name("settings.json")
Words = Literal["switch", "one", "all"]
"""Words that a setting takes on the command line; "all": up to the next option."""
_PLUG_INS = "megalopta.scenes", "megalopta.sensors", "megalopta.detectors"
_LONGEST = 60


@cache
def description() -> dict[str, Any]:
    """Return the content of `settings.json`, or, with plug-ins installed, that of their models."""
    from importlib.metadata import entry_points

    if any(entry_points(group=group) for group in _PLUG_INS):
        from megalopta.cli.describing import described

        return described()
    found: dict[str, Any] = json.loads(FILE.read_text("utf-8"))
    return found


@dataclass(frozen=True)
class VerbSettings:
    """Settings of a verb."""

    models: tuple[str, ...] = ("Configuration",)
    stage: str = ""
    """Lists the fields of the first model on which the output of this stage depends; all if empty
    """
    argument: str = ""
    """Argument that names a YAML file or a dataset, whose values are the defaults"""
    without: str = ""
    """Configuration whose values are the defaults if that is missing; else the models'"""

    def takes(self, path: str) -> Words:
        """Number of words that the field at a path takes. Raises UserError if there is none.

        A switch takes none, or "true" or "false".
        """
        steps, models = path.split("."), description()["models"]
        having = [name for name in self.models if steps[0] in models[name]]
        types: list[Any] = [{"model": name} for name in having[:1] or self.models]
        for depth, step in enumerate(steps):
            inner = [each for outer in types for each in _inside(outer, step)]
            if not inner:
                _refuse_unknown(steps[: depth + 1], types)
            types = inner
        if "any" in types or any("list" in each for each in types if isinstance(each, dict)):
            return "all"
        return "switch" if types == ["switch"] else "one"

    def help(self, often: Collection[str] = (), named: str | None = None) -> str:
        """List the settings with meaning, unit and default, which `named` may state.

        If some are changed `often`, list these alone, each in one sentence.
        """
        width = min(shutil.get_terminal_size().columns, 100)
        values, source = self._defaults(named)
        listed = list(self._listed(values))
        chosen = [each for each in listed if each[0] in often] or listed
        lines = [f"settings (also keys of the YAML file; values are YAML), with {source}:"]
        for path, field, value in chosen:
            meaning = " ".join(field["meaning"].split())
            if often:
                meaning = f"{meaning.split('. ')[0].rstrip('.')}."
            if missing := [each for each in field.get("choices", ()) if each not in meaning]:
                meaning += f" {'Also' if len(missing) < len(field['choices']) else 'One of'}: "
                meaning += f"{', '.join(missing)}."
            lines.append(f"  --{path.replace('_', '-')} {_shown(value)}")
            indent = " " * 6
            lines += textwrap.wrap(meaning, width, initial_indent=indent, subsequent_indent=indent)
        if len(chosen) < len(listed):
            lines.append(f"  … and {len(listed) - len(chosen)} more: --help-all")
        return "\n".join(lines)

    def _defaults(self, named: str | None) -> tuple[Mapping[str, Any] | None, str]:
        """Return the values that replace the models' defaults, and whose they are, in words.

        None stands for values that only a dataset states.
        """
        is_dataset = named is not None and Path(named, "dataset.yaml").exists()
        if self.stage == "sense" and not is_dataset:
            return description()["pictures"], "the defaults for pictures; a dataset has its own"
        name = named if self.argument and named else self.without
        if not name:
            other = f" where the {self.argument} states nothing else" if self.argument else ""
            return None if self.argument == "dataset" else {}, f"the defaults{other}"
        from megalopta.config.yaml_model import mapping, yaml_text

        if name in built_in_names():
            values = mapping(built_in_text(name), name)
        else:
            path = Path(name, "dataset.yaml") if Path(name).is_dir() else Path(name)
            values = mapping(yaml_text(path, "file; give a YAML file"), name)
        stated = values.get("plan" if "Plan" in self.models else "configuration", values)
        return stated, f"the values of {name}, and defaults"

    def _listed(self, values: Mapping[str, Any] | None) -> Iterator[tuple[str, Any, Any]]:
        """Path, description and value of every setting."""
        first, *others = self.models
        fields = description()["stages"].get(self.stage, description()["models"][first])
        given = {name: (values or {}).get(name, ...) for name in fields}
        for path, field, value in settings_of(first, given):
            yield path, field, "(the dataset's)" if values is None else value
        for other in others:
            only = {name: ... for name in description()["models"][other] if name not in fields}
            yield from settings_of(other, only)


def settings_of(model: str, values: Mapping[str, Any], prefix: str = "") -> Iterator[Any]:
    """Path, description and value of settings that `values` names; `...` stands for the default."""
    for name, field in description()["models"][model].items():
        if name not in values:
            continue
        path = f"{prefix}{name}"
        value = field["default"] if values[name] is ... else values[name]
        parts = [_preset(name, part) for part in (value if isinstance(value, list) else [value])]
        types = [inner for each in field["types"] for inner in (each, *_inside(each, "0"))]
        models = [_model_of(part, types) for part in parts]
        if isinstance(value, list):
            yield path, field, [_name(part) for part in parts]
        elif models == [None]:
            yield path, field, value
        for index, (part, inner) in enumerate(zip(parts, models, strict=True)):
            if inner:
                given = {key: part.get(key, ...) for key in description()["models"][inner]}
                place = f"{path}.{index}." if isinstance(value, list) else f"{path}."
                yield from settings_of(inner, given, place)


def _preset(field: str, value: Any) -> Any:
    """Return the values of a preset that a value of a field names, with the changes to it."""
    name = value.get("preset") if isinstance(value, Mapping) else value
    preset = description()["presets"].get(field, {}).get(name) if isinstance(name, str) else None
    if preset is None:
        return value
    from megalopta.core.validation import merged

    return merged(preset, value if isinstance(value, Mapping) else {})


def _name(part: Any) -> Any:
    """Return what stands for a value in a list of models: its name or kind."""
    return part.get("name", part.get("kind", part)) if isinstance(part, Mapping) else part


def _model_of(value: Any, types: Collection[Any]) -> str | None:
    """Return the model, among some types, of a mapping: by its kind, if there are several."""
    models = [str(each["model"]) for each in types if isinstance(each, dict) and "model" in each]
    if not isinstance(value, Mapping) or not models:
        return None
    by_kind: dict[Any, str] = {
        description()["models"][each].get("kind", {}).get("default"): each for each in models
    }
    return by_kind.get(value.get("kind"), models[0])


def _inside(outer: Any, step: str) -> list[Any]:
    """Types of the value at a key or an index inside a type; none if there is no such step."""
    if not isinstance(outer, dict):
        return ["any"] if outer == "any" else []
    ((kind, inner),) = outer.items()
    if kind == "model":
        field = description()["models"][inner].get(step)
        return field["types"] if field else ["any" for key in description()["keys"] if key == step]
    return list(inner) if kind == "map" or step.isdecimal() else []


def _refuse_unknown(steps: list[str], types: Collection[Any]) -> NoReturn:
    models = [each["model"] for each in types if isinstance(each, dict) and "model" in each]
    known = sorted({name for model in models for name in description()["models"][model]})
    if not known:
        above = ".".join(steps[:-1])
        raise UserError(f"--{'.'.join(steps)}: {above} has no such part; give it as a whole")
    near = get_close_matches(steps[-1], known, n=1, cutoff=0.5)
    remedy = f"did you mean {near[0]!r}?" if near else f"the keys are {', '.join(known)}"
    raise UserError(f"command line: {'.'.join(steps)}: unknown key; {remedy}")


def _shown(value: Any) -> str:
    from megalopta.core import strict_yaml

    text = strict_yaml.dump(value, default_flow_style=True, width=10_000).strip()
    return textwrap.shorten(text.removesuffix("...").strip(), _LONGEST)
