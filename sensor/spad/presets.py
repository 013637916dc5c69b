"""Sensors by name, as plain data.

`presets.yaml` has their values with sources, and what is assumed.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from megalopta.core import strict_yaml
from megalopta.sensor.effects.crosstalk import with_kernel
from megalopta.sensor.optics import with_curve
from megalopta.sensor.spad.measured import with_hashes
from megalopta.sensor.spad.model import Sensor

TABLE_2_1 = strict_yaml.load(Path(__file__).with_name("table_2_1.yaml").read_text("utf-8"))
"""Columns of Table 2.1 by preset name."""
PRESETS = Sensor.presets(Path(__file__).with_suffix(".yaml"))


def preset(name: str) -> Sensor:
    """Return a sensor by name.

    Raises ValueError if there is no preset of this name.
    """
    if not isinstance(name, str) or name not in PRESETS:
        raise ValueError(f"sensor {name!r}: no such preset; choose from {', '.join(PRESETS)}")
    return PRESETS[name]


def with_files(values: Mapping[str, Any], folder: Path | None) -> dict[str, Any]:
    """Make a sensor's fields independent of the folder to which their paths are relative.

    It is that of the file with these fields; None: they are the user's (`named_path`).

    Maps get absolute paths and hashes; curves and a kernel of crosstalk in files become
    numbers.
    """
    resolved = dict(values)
    for name, values_of_part in values.items():
        if name == "measured":
            resolved[name] = with_hashes(values_of_part, folder)
        elif name == "efficiency":
            resolved[name] = with_curve(values_of_part, folder, name)
        elif name == "crosstalk":
            resolved[name] = with_kernel(values_of_part, folder)
        elif name in ("lens", "filters") and isinstance(values_of_part, Mapping):
            resolved[name] = {
                key: with_curve(value, folder, f"{name}.{key}")
                for key, value in values_of_part.items()
            }
    return resolved
