"""What pydantic finds wrong with a model, told in one sentence."""

import reprlib
from collections.abc import Iterator
from difflib import get_close_matches
from types import UnionType
from typing import Annotated, Any, Union, get_args, get_origin

from pydantic import BaseModel, ValidationError

from megalopta.core.bounded import cut, quoted

Location = tuple[int | str, ...]
_PLAIN_TYPES = ("bool", "int", "float", "str")
"""What pydantic adds to the place of an error where one of these would do."""
_TOLD = {
    "missing": "missing; give a value",
    "union_tag_not_found": "say which kind it is, with the key 'kind'",
    "too_short": "empty; give at least one",
}
_EXPECTED = {
    "tuple_type": "give a list",
    "model_type": "give a mapping of keys to values",
    "model_attributes_type": "give a mapping of keys to values",
    "dict_type": "give a mapping of keys to values",
}

_short = reprlib.Repr()
_short.maxstring = _short.maxother = 80
_short.maxlong = 40


def one_sentence(error: ValidationError, model: type[BaseModel]) -> str:
    """The first problem of a failed validation of `model`: field, value and remedy."""
    place, told = _first_problem(error, model)
    return f"{place}: {told}" if place else told


def _first_problem(error: ValidationError, model: type[BaseModel]) -> tuple[str, str]:
    """Place and problem."""
    problem = error.errors(include_url=False)[0]
    steps = _typed_path(model, problem["loc"])
    if steps and steps[-1] in _PLAIN_TYPES:
        steps.pop()
    place = quoted(".".join(map(str, steps)))
    message = cut(problem["msg"].removeprefix("Value error, "), problem["input"])
    if problem["type"] == "extra_forbidden":
        known = _fields_at(model, problem["loc"][:-1])
        near = get_close_matches(str(problem["loc"][-1]), known, n=1, cutoff=0.5)
        hint = f"did you mean {near[0]!r}?" if near else f"the keys are {', '.join(known)}"
        return place, f"unknown key; {hint}"
    if problem["type"] == "union_tag_invalid":
        tag, known = problem["ctx"]["tag"], problem["ctx"]["expected_tags"]
        return place, f"kind {quoted(repr(tag))} is unknown; use {known}"
    if problem["type"] in (*_TOLD, "value_error"):
        return place, _TOLD.get(problem["type"], message)
    told = _EXPECTED.get(problem["type"], f"{message[0].lower()}{message[1:]}")
    return place, f"{told}, got {_short.repr(problem['input'])}"


def _fields_at(model: type[BaseModel], location: Location) -> list[str]:
    """Names of the fields a model has at a location inside it."""
    *_, (_, candidates) = _walk(model, location)
    return sorted({name for candidate in candidates for name in candidate.model_fields})


def _typed_path(model: type[BaseModel], location: Location) -> list[int | str]:
    """A location as a user writes it: without the tags of unions, which pydantic inserts."""
    steps = list(_walk(model, location))[1:]
    return [step for step, (is_tag, _) in zip(location, steps, strict=True) if not is_tag]


def _walk(
    model: type[BaseModel], location: Location
) -> Iterator[tuple[bool, list[type[BaseModel]]]]:
    """Follow a location: whether each step is a union's tag, and the models it leads to."""
    candidates: list[type[BaseModel]] = [model]
    yield False, candidates
    for step in location:
        inner = [
            found
            for candidate in candidates
            if step in candidate.model_fields
            for found in _models_in(candidate.model_fields[str(step)].annotation)
        ]
        is_field = any(step in candidate.model_fields for candidate in candidates)
        tagged = [candidate for candidate in candidates if _tag(candidate) == step]
        # Steps that are neither field nor tag are list indices, or unknown keys.
        candidates = inner or tagged or candidates
        yield bool(tagged) and not is_field, candidates


def _tag(model: type[BaseModel]) -> Any:
    kind = model.model_fields.get("kind")
    return kind.default if kind else None


def _models_in(annotation: Any) -> list[type[BaseModel]]:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return [annotation]
    if get_origin(annotation) in (Annotated, Union, UnionType, tuple):
        return [model for part in get_args(annotation) for model in _models_in(part)]
    return []
