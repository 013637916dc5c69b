from .built_in import (
    built_in_names as built_in_names,
    built_in_text as built_in_text,
)
from .light_scale import light_scale as light_scale
from .measuring import (
    CalibrationFrames as CalibrationFrames,
    FlowSettings as FlowSettings,
    Reference as Reference,
    SequenceBenchmark as SequenceBenchmark,
)
from .model import (
    Configuration as Configuration,
    LightLevel as LightLevel,
    differences as differences,
    level_text as level_text,
    load as load,
    parse as parse,
)
from .settings import (
    Settings as Settings,
    Words as Words,
    settings_of as settings_of,
)
from .validation import one_sentence as one_sentence
from .yaml_model import (
    mapping as mapping,
    put as put,
    read_text as read_text,
    to_yaml as to_yaml,
    validated as validated,
)
