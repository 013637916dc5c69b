"""Descriptions distinguished by their `kind`, as fields of a configuration."""

from collections.abc import Mapping, Sequence
from typing import Annotated, Any, Union

from pydantic import BaseModel, BeforeValidator, Field


def any_of(models: Sequence[type[BaseModel]], default: str | None = None) -> Any:
    """Return the type of a field that holds any of some models, each with its own `kind`.

    The help of their `kind` lists them all, first the `default` of a mapping without one.
    """
    models = sorted(models, key=lambda model: kind_of(model) != default)
    kinds = ", ".join(map(kind_of, models))
    for model in models:
        model.model_fields["kind"].description = f"One of: {kinds}."
    union: Any = Union[tuple(models)]  # noqa: UP007
    told_apart: Any = Annotated[union, Field(discriminator="kind")]
    if not default:
        return told_apart

    def with_kind(values: Any) -> Any:
        has_kind = not isinstance(values, Mapping) or "kind" in values
        return values if has_kind else {"kind": default, **values}

    return Annotated[told_apart, BeforeValidator(with_kind)]


def kind_of(model: type[BaseModel]) -> str:
    """Kind that distinguishes a model from others."""
    return str(model.model_fields["kind"].default)
