"""Changed parameters, validated as if written from scratch."""

from typing import Any, TypeVar

from pydantic import BaseModel

from megalopta.core.validation import checked, merged

AnyModel = TypeVar("AnyModel", bound=BaseModel)


def changed(model: AnyModel, **fields: Any) -> AnyModel:
    """Return a sensor, or a part of one, with other parameters.

    A mapping changes the fields that it names and keeps the others, unless it changes `kind`:

        changed(preset("spadcam"), exposure_s=0.02, counter={"step_v": 0.03})

    Raises ValueError, in one sentence, if a field is unknown or the result is invalid.
    """
    return checked(type(model), merged(model.model_dump(), fields))
