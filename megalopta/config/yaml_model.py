"""Models from YAML and from settings of the command line, and back to YAML.

An error is one sentence that names field, value and remedy.
"""

from collections.abc import Mapping
from copy import deepcopy
from operator import eq
from pathlib import Path
from types import NoneType
from typing import Any, get_origin

from pydantic import BaseModel
from pydantic_core import PydanticUndefined, to_jsonable_python

from megalopta.core import bounded, strict_yaml
from megalopta.core.errors import UserError, near_path, refused_as
from megalopta.core.validation import MisfitError, Model, checked, inner_types


def yaml_text(path: Path, what: str) -> str:
    """Return the text of a file; `what`, its kind and a remedy, ends the message "no such …".

    Raises UserError if it does not exist or is not text.
    """
    try:
        return bounded.read_text(path)
    except UnicodeDecodeError:
        raise UserError(f"{path}: not a UTF-8 text file; give a YAML file") from None
    except OSError:
        kind, remedy = what.split("; ", 1)
        raise UserError(f"{path}: no such {kind}; {near_path(path, remedy)}") from None


def mapping(text: str, source: str) -> dict[str, Any]:
    """Return the mapping in a YAML text.

    Raises UserError if it is anything else or empty: a truncated file must not mean defaults.
    """
    with refused_as(source):
        values = strict_yaml.load(text)
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
    changed = overridden(model, values, overrides) if overrides else values
    try:
        return checked(model, changed, {"folder": folder, "allows_code": allows_code})
    except MisfitError as problem:
        paths = [path.removesuffix(".kind").removesuffix(".preset") for path in overrides or {}]
        places = [path.split(".") for path in paths]
        is_typed = any(all(map(eq, place, problem.place)) for place in places)
        raise UserError(f"{'command line' if is_typed else source}: {problem}") from problem


def overridden(
    model: type[BaseModel], values: dict[str, Any], overrides: Mapping[str, str]
) -> dict[str, Any]:
    """Return the values of a model with overrides of the command line."""
    changed = deepcopy(values)
    # `kind` and `preset`, which reset a mapping, come before its fields
    place = {"kind": 0, "preset": 1}
    for path in sorted(overrides, key=lambda path: place.get(path.rpartition(".")[2], 2)):
        with refused_as(f"--{path}"):
            value = bounded.typed(strict_yaml.load(overrides[path]))
        with refused_as("command line"):
            put(changed, path, value, model)
    return changed


def put(values: Any, path: str, value: Any, model: type[BaseModel]) -> None:
    """Set a value inside nested mappings and lists.

    A missing part on the way is filled in with the model's default. A new `kind` or `preset` resets
    its mapping. A single value for a list makes a list of one. Raises UserError if the path leads
    into a plain value.
    """
    *parents, last = path.split(".")
    types: list[Any] = [model]
    for step in parents:
        values, types = _child(values, step, types, path), _inner(types, step)
    if isinstance(values, list):
        _child(values, last, types, path)
        values[int(last)] = value
        return
    default = next((_kind(model) for model in types if _has(model, "kind")), None)
    if last == "kind" and values.get("kind", default) != value:
        values.clear()
    if last == "preset":
        for name in values.keys() - {"kind"}:
            del values[name]
    inner = [kind for kind in _inner(types, last) if kind is not NoneType]
    is_list = inner and all(get_origin(kind) is tuple for kind in inner)
    values[last] = [value] if is_list and not isinstance(value, list) else value


def _child(values: Any, step: str, types: list[Any], path: str) -> Any:
    """Return the mapping or list at a step, made where it is missing."""
    if isinstance(values, list) and step.isdecimal() and int(step) < len(values):
        if isinstance(values[int(step)], str):
            values[int(step)] = {"preset": values[int(step)]}
        return values[int(step)]
    inner = _inner(types, step) or [Any]  # of an unknown field, which validation refuses
    has_parts = any(
        kind is Any or _is_model(kind) or get_origin(kind) in (tuple, dict) for kind in inner
    )
    if isinstance(values, dict) and values.get(step) is None and has_parts:
        values[step] = _default(values, step, types)
    if isinstance(values, dict) and isinstance(values.get(step), dict | list):
        return values[step]
    known = [str(index) for index in range(len(values))] if isinstance(values, list) else []
    there_is = f"; the fields are {', '.join(known)}" if known else "; give it as a whole"
    raise UserError(f"--{path}: no field {step!r}{there_is}")


def _default(values: dict[str, Any], step: str, types: list[Any]) -> Any:
    """Return what a model has at a step where a file states nothing."""
    models = [kind for kind in types if _has(kind, step)]
    kind = values.get("kind", ...)
    model = next(
        (candidate for candidate in models if _kind(candidate) == kind),
        models[0] if models else None,
    )
    if model is None:
        return {}
    if values.get("preset") and _has(model, "preset"):
        default = getattr(checked(model, values), step)
    else:
        default = model.model_fields[step].get_default(call_default_factory=True, validated_data={})
    if isinstance(default, BaseModel):
        kinds = {"kind": default.kind} if _has(type(default), "kind") else {}  # type: ignore[attr-defined]
        return kinds | default.model_dump(mode="json", exclude_unset=True)
    return {} if default in (None, PydanticUndefined) else to_jsonable_python(default)


def _inner(types: list[Any], step: str) -> list[Any]:
    return [Any] if Any in types else [kind for outer in types for kind in inner_types(outer, step)]


def _is_model(kind: Any) -> bool:
    return isinstance(kind, type) and issubclass(kind, BaseModel)


def _has(model: Any, field: str) -> bool:
    return _is_model(model) and field in model.model_fields


def _kind(model: type[BaseModel]) -> Any:
    return model.model_fields["kind"].default if _has(model, "kind") else None
