"""Validate models of plain data, such as YAML; report an error in one sentence.

Every folder may import this module.
"""

import reprlib
from collections.abc import Iterator, Mapping, Sequence
from types import UnionType
from typing import Annotated, Any, TypeVar, Union, get_args, get_origin

from pydantic import BaseModel, ValidationError

from megalopta.core.bounded import QUOTED, quoted, sentence
from megalopta.core.errors import nearest

Model = TypeVar("Model", bound=BaseModel)
_TOLD = {"missing": "missing; give a value", "too_short": "empty; give at least one"}
_EXPECTED = {
    "tuple_type": "give a list",
    **dict.fromkeys(
        ("model_type", "model_attributes_type", "dict_type"), "give a mapping of keys to values"
    ),
}

_short = reprlib.Repr()
_short.maxstring = _short.maxother = 80
_short.maxlong = 40


class MisfitError(ValueError):
    """Values that are no model; `place` is the path of the field."""

    def __init__(self, place: Sequence[str], reason: str) -> None:
        self.place = list(place)
        super().__init__(f"{quoted('.'.join(place))}: {reason}" if place else reason)


def checked(model: type[Model], values: Any, context: Mapping[str, object] | None = None) -> Model:
    """Return the model of plain values. Raises MisfitError, one sentence: field, value, remedy."""
    try:
        record = model.model_validate(values, context=context)
    except ValidationError as error:
        problem = error.errors(include_url=False)[0]
        steps, _ = _place(model, problem["loc"])
        raise MisfitError(steps, _told(problem, model)) from None
    for place in _booleans_for_others(values, record):
        raise MisfitError(place.split("."), "true and false are not numbers; give a number")
    return record


def inner_types(outer: Any, step: str) -> Iterator[Any]:
    """Types of the value at a key or an index inside a type; none if there is no such step."""
    if get_origin(outer) is tuple and step.isdecimal():
        yield from plain_types(get_args(outer)[0])
    elif get_origin(outer) is dict:
        yield from plain_types(get_args(outer)[1])
    elif isinstance(outer, type) and issubclass(outer, BaseModel) and step in outer.model_fields:
        yield from plain_types(outer.model_fields[step].annotation)


def plain_types(annotation: Any) -> Iterator[Any]:
    """Types that an annotation allows, without unions and metadata."""
    if get_origin(annotation) is Annotated:
        yield from plain_types(get_args(annotation)[0])
    elif get_origin(annotation) in (Union, UnionType):
        for part in get_args(annotation):
            yield from plain_types(part)
    else:
        yield annotation


def _told(problem: Any, model: type[BaseModel]) -> str:
    kind, value = problem["type"], problem["input"]
    message = sentence(problem["msg"].removeprefix("Value error, "), 2 * QUOTED)
    if kind == "extra_forbidden":
        *above, name = problem["loc"]
        types = _place(model, above)[1]
        known = sorted({field for kind in types for field in getattr(kind, "model_fields", ())})
        return f"unknown key; {nearest(str(name), known, 'the keys are')}"
    if kind == "union_tag_not_found":
        _, types = _place(model, problem["loc"])
        return f"missing key 'kind'; add it, one of {', '.join(map(str, map(_tag, types)))}"
    if kind == "union_tag_invalid":
        tag, tags = problem["ctx"]["tag"], problem["ctx"]["expected_tags"]
        return f"kind {quoted(repr(tag))} is unknown; use {tags}"
    if kind in (*_TOLD, "value_error"):
        return _TOLD.get(kind, message)
    reason = _EXPECTED.get(kind, f"{message[0].lower()}{message[1:]}")
    return f"{reason}, got {_short.repr(value)}"


def _place(model: type[BaseModel], location: Any) -> tuple[list[str], list[Any]]:
    """Return a location as a user writes it, without the tags of unions, and the types there."""
    types, steps = [model], list[str]()
    for step in map(str, location):
        inner = [inside for outer in types for inside in inner_types(outer, step)]
        tagged = [] if inner else [outer for outer in types if step == _tag(outer)]
        steps += [] if tagged else [step]
        types = inner or tagged or types
    return steps, types


def _tag(found: Any) -> Any:
    if isinstance(found, type) and issubclass(found, BaseModel):
        kind = found.model_fields.get("kind")
        return kind.default if kind else found.__name__
    return getattr(found, "__name__", None)


def _booleans_for_others(values: Any, record: Any, place: str = "") -> Iterator[str]:
    """Places where a boolean was converted to another type, such as true to 1."""
    if isinstance(values, bool) and not isinstance(record, bool):
        yield place
    elif isinstance(values, Mapping) and isinstance(record, BaseModel | Mapping):
        parts = record if isinstance(record, Mapping) else vars(record)
        for key in values.keys() & parts.keys():
            yield from _booleans_for_others(values[key], parts[key], f"{place}.{key}".strip("."))
    elif isinstance(values, list | tuple) and isinstance(record, list | tuple):
        for index, pair in enumerate(zip(values, record, strict=False)):
            yield from _booleans_for_others(*pair, f"{place}.{index}".strip("."))


def merged(base: Mapping[str, Any], changes: Mapping[str, Any]) -> dict[str, Any]:
    """Merge changes into a nested mapping.

    A mapping keeps its other fields, unless its `kind` changes; with a new `preset`, only `kind`.
    """
    result = dict(base)
    for name, value in changes.items():
        old = base.get(name)
        if isinstance(value, Mapping) and isinstance(old, Mapping):
            kept = {"kind": old["kind"]} if "preset" in value and "kind" in old else old
            is_same_kind = value.get("kind", old.get("kind")) == old.get("kind")
            value = merged(kept, value) if is_same_kind else value
        result[name] = value
    return result
