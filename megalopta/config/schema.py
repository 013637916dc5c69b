"""JSON schemas of YAML files, with which an editor completes and checks them."""

import json
from pathlib import Path
from typing import Any

from megalopta.config.model import Configuration
from megalopta.config.recipe import Plan
from megalopta.core import files
from megalopta.sensor import IMAGE_SENSORS

_BY_PATH = "path", "sha256"
"""Fields of a file, for which its path is accepted"""


def schema_of(model: type[Configuration] | type[Plan]) -> dict[str, Any]:
    """Return the JSON schema of YAML files of a model."""
    text = json.dumps(model.model_json_schema())
    schema: dict[str, Any] = json.loads(text.replace('"oneOf"', '"anyOf"'))  # kinds have defaults
    definitions = schema.get("$defs", {})
    for name, definition in definitions.items():
        if {*_BY_PATH} <= definition.get("properties", {}).keys():
            by_path = {**definition, "required": ["path"]}
            definitions[name] = {"anyOf": [{"type": "string"}, by_path]}
    if model is Configuration:
        presets = {"description": "A preset, or a device's file", "examples": [*IMAGE_SENSORS]}
        sensors = schema["properties"]["sensors"]["items"]
        kinds = [kind["$ref"].rpartition("/")[2] for kind in sensors.get("anyOf", [sensors])]
        fields = {
            key: value for kind in kinds for key, value in definitions[kind]["properties"].items()
        }
        changes = {
            "type": "object",
            "properties": {"preset": {"type": "string", **presets}, **fields},
        }
        schema["properties"]["sensors"]["items"] = {
            "anyOf": [{"type": "string", **presets}, changes]
        }
    return schema


def write_schemas(folder: Path) -> list[Path]:
    """Write configuration.schema.json and plan.schema.json, and return their paths."""
    paths = []
    for model in (Configuration, Plan):
        paths.append(folder / f"{model.__name__.lower()}.schema.json")
        files.write_text(paths[-1], json.dumps(schema_of(model), indent=1) + "\n")
    return paths
