"""Models from YAML and from settings of the command line, and back to YAML.

An error is one sentence that names field, value and remedy.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pydantic import BaseModel

from megalopta.core import bounded, strict_yaml
from megalopta.core.errors import UserError, refused_as
from megalopta.core.validation import Model, checked


def yaml_text(path: Path, what: str) -> str:
    """Return the text of a file; `what`, its kind and a remedy, ends the message "no such …".

    Raises UserError if it does not exist or is not text.
    """
    try:
        return bounded.read_text(path)
    except UnicodeDecodeError:
        raise UserError(f"{path}: not a UTF-8 text file; give a YAML file") from None
    except OSError:
        raise UserError(f"{path}: no such {what}") from None


def mapping(text: str, source: str) -> dict[str, Any]:
    """Return the mapping in a YAML text.

    Raises UserError if it is anything else or empty: a truncated file must not mean defaults.
    """
    values = _plain_data(text, source)
    if values is None:
        raise UserError(f"{source}: empty; give at least one key, or {{}} for all defaults")
    if not isinstance(values, dict):
        raise UserError(f"{source}: not a mapping; give keys and values")
    return values


def validated(
    model: type[Model],
    values: Any,
    source: str,
    overrides: Mapping[str, str] | None = None,
    folder: Path | None = None,
    allows_code: bool = False,
) -> Model:
    """Return the model of YAML values; `source` names them in errors.

    Overrides map the path of a field, such as "scene.trees", to a value in YAML. Values from a file
    may name files in its `folder` only (`named_path`), and code only if `allows_code`; overrides,
    which the user typed, may name any.
    """
    with refused_as(source):
        record = checked(model, values, {"folder": folder, "allows_code": allows_code})
    if not overrides:
        return record
    changed = record.model_dump(mode="json")
    # `kind` and `preset`, which reset a mapping, come before its fields
    place = {"kind": 0, "preset": 1}
    for path in sorted(overrides, key=lambda path: place.get(path.rpartition(".")[2], 2)):
        value = overrides[path]
        put(changed, path, _plain_data(value, f"--{path}"))
    with refused_as("command line"):
        return checked(model, changed, {"folder": None, "allows_code": True})


def to_yaml(record: BaseModel) -> str:
    """Complete YAML of a model; reading it back gives an equal model."""
    return strict_yaml.dump(record.model_dump(mode="json"))


def put(values: Any, path: str, value: Any) -> None:
    """Set a value inside nested mappings and lists.

    A null on the way becomes a mapping, and so does a missing part of a mapping with a `kind` or
    `preset`. A new `kind` or `preset` resets its mapping. A single value for a list makes a list of
    one. Raises UserError if the path leads into a plain value.
    """
    *parents, last = path.split(".")
    for step in parents:
        values = _child(values, step, path)
    if isinstance(values, list):
        _child(values, last, path)
        values[int(last)] = value
    elif isinstance(values, dict):
        if last == "kind" and values.get("kind") != value:
            values.clear()
        if last == "preset":
            for other in values.keys() - {"kind"}:
                del values[other]
        makes_list = isinstance(values.get(last), list) and not isinstance(value, list)
        values[last] = [value] if makes_list else value
    else:
        raise UserError(f"--{path}: {'.'.join(parents)} has no fields; give it as a whole")


def _plain_data(text: str, source: str) -> Any:
    with refused_as(source):
        return strict_yaml.load(text)


def _child(values: Any, step: str, path: str) -> Any:
    if isinstance(values, list) and step.isdecimal() and int(step) < len(values):
        return values[int(step)]
    if isinstance(values, dict) and (step in values or values.keys() & {"kind", "preset"}):
        if values.get(step) is None:
            values[step] = {}
        return values[step]
    entries = range(len(values)) if isinstance(values, list) else values
    known = list(map(str, entries)) if isinstance(values, dict | list) else []
    there_is = f"the fields are {', '.join(known)}" if known else "there are none"
    raise UserError(f"--{path}: no field {step!r}; {there_is}")
