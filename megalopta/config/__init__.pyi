from .built_in import built_in_names
from .configuration import (
    Configuration,
    LightLevel,
    differences,
    level_text,
    load,
    parse,
)
from .estimate import announce, announce_sweep, refuse_absurd
from .settings import Settings, settings_of
from .validation import one_sentence
from .yaml_model import mapping, put, read_text, to_yaml, validated

__all__ = [
    "Configuration",
    "LightLevel",
    "Settings",
    "announce",
    "announce_sweep",
    "built_in_names",
    "differences",
    "level_text",
    "load",
    "mapping",
    "one_sentence",
    "parse",
    "put",
    "read_text",
    "refuse_absurd",
    "settings_of",
    "to_yaml",
    "validated",
]
