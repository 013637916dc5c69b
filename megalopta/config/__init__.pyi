from .model import (
    Configuration,
    LightLevel,
    built_in_names,
    differences,
    level_text,
    load,
    parse,
)
from .yaml_model import mapping, put, read_text, to_yaml, validated

__all__ = [
    "Configuration",
    "LightLevel",
    "built_in_names",
    "differences",
    "level_text",
    "load",
    "mapping",
    "parse",
    "put",
    "read_text",
    "to_yaml",
    "validated",
]
