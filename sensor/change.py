"""Changed parameters, validated as if written from scratch."""

from collections.abc import Mapping
from typing import Any, TypeVar

from pydantic import BaseModel

AnyModel = TypeVar("AnyModel", bound=BaseModel)


def changed(model: AnyModel, **fields: Any) -> AnyModel:
    """Return a sensor, or a part of one, with other parameters.

    A mapping changes the fields that it names and keeps the others, unless it changes `kind`:

        changed(preset("spadcam"), exposure_s=0.02, counter={"step_v": 0.03})

    Raises ValueError if a field is unknown or the result is invalid.
    """
    return type(model).model_validate(merged(model.model_dump(), fields))


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
