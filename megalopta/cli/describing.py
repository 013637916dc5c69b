"""Describe all settings of the command line from their models, in `settings.json`.

`python -m megalopta.cli.describing` writes that file anew.
"""

import json
from collections.abc import Iterator
from typing import Any, Literal, get_args, get_origin

from pydantic import BaseModel
from pydantic_core import PydanticUndefined, to_jsonable_python

from megalopta.benchmark.cameras import CamerasSettings
from megalopta.benchmark.design import DesignSettings
from megalopta.benchmark.ranking import RankingSettings
from megalopta.benchmark.trial import Sweep
from megalopta.cli.settings import FILE
from megalopta.config.model import Configuration
from megalopta.config.recipe import Plan
from megalopta.core import files
from megalopta.core.validation import plain_types
from megalopta.flow.detectors.registry import METHODS
from megalopta.scenes.forest.flora import PRESETS
from megalopta.scenes.levels import LEVELS
from megalopta.sensor import IMAGE_SENSORS
from megalopta.stages.importing import DEFAULTS
from megalopta.stages.make import Exposing
from megalopta.stages.registry import STAGES

_MODELS = (
    *(Configuration, Sweep, RankingSettings, CamerasSettings, DesignSettings),
    *(Plan, Exposing),
)
_REGISTRIES = {
    **dict.fromkeys(("light_levels", "lights"), LEVELS),
    "methods": METHODS,
    "sensors": IMAGE_SENSORS,
}
"""Names that fields accept besides those in their types"""


def described() -> dict[str, Any]:
    """Return types, meaning, choices and default of every field of every model, and presets."""
    models: dict[str, Any] = {}
    for model in _MODELS:
        _describe(model, models)
    sensors = {name: sensor.model_dump(mode="json") for name, sensor in IMAGE_SENSORS.items()}
    return {
        "models": models,
        "keys": ["preset", "like"],  # of mappings that name values to change
        "presets": {"scene": dict(PRESETS), "sensors": sensors},
        "pictures": {
            **DEFAULTS,
            "light_levels": "(from --photons, --lux or --luminance)",
            "sensors": [{"preset": "ideal", "exposure_s": "(the time of a frame at most)"}],
        },
        "stages": {name: list(stage.fields) for name, stage in STAGES.items()},
    }


def _describe(model: type[BaseModel], models: dict[str, Any]) -> None:
    if model.__name__ in models:
        return
    models[model.__name__] = fields = dict[str, Any]()
    for name, field in model.model_fields.items():
        default = field.get_default(call_default_factory=True, validated_data={})
        types = list(plain_types(field.annotation))
        fields[name] = {
            "meaning": field.description or "",
            "default": None if default is PydanticUndefined else to_jsonable_python(default),
            "types": [_described(kind, models) for kind in types],
            "choices": [*map(str, _choices(types)), *_REGISTRIES.get(name, ())],
        }


def _described(kind: Any, models: dict[str, Any]) -> Any:
    """Return a type as JSON: "switch", "value", "any", or a model, list or map of types."""
    if isinstance(kind, type) and issubclass(kind, BaseModel):
        _describe(kind, models)
        return {"model": kind.__name__}
    if get_origin(kind) in (tuple, dict):
        name, part = ("list", 0) if get_origin(kind) is tuple else ("map", 1)
        return {name: [_described(inner, models) for inner in plain_types(get_args(kind)[part])]}
    return "any" if kind is Any else "switch" if kind is bool else "value"


def _choices(types: list[Any]) -> Iterator[Any]:
    """Literal values that a field accepts, by itself or in a list."""
    for kind in types:
        if get_origin(kind) is Literal:
            yield from get_args(kind)
        elif get_origin(kind) is tuple:
            yield from _choices(list(plain_types(get_args(kind)[0])))


def _json(value: Any, depth: int) -> str:
    """Return JSON text with a line for each entry, down to a depth."""
    if not (depth and isinstance(value, dict) and value):
        return json.dumps(value, ensure_ascii=False)
    entries = (f"{json.dumps(key)}: {_json(entry, depth - 1)}" for key, entry in value.items())
    return "{\n" + ",\n".join(entries) + "\n}"


if __name__ == "__main__":
    files.write_text(FILE, _json(described(), 3) + "\n")
