from .built_in import built_in_names, built_in_text
from .measuring import CalibrationFrames, FlowSettings, Reference, SequenceBenchmark
from .model import (
    Configuration,
    LightLevel,
    differences,
    level_text,
    load,
    parse,
)
from .settings import Settings, Words, settings_of
from .validation import one_sentence
from .yaml_model import mapping, put, read_text, to_yaml, validated

__all__ = [
    "CalibrationFrames",
    "Configuration",
    "FlowSettings",
    "LightLevel",
    "Reference",
    "SequenceBenchmark",
    "Settings",
    "Words",
    "built_in_names",
    "built_in_text",
    "differences",
    "level_text",
    "load",
    "mapping",
    "one_sentence",
    "parse",
    "put",
    "read_text",
    "settings_of",
    "to_yaml",
    "validated",
]
