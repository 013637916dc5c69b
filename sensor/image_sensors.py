"""Image sensors by name: counting, integrating, frame cameras, or of contrast.

A CTIA array reads volts; `expose` converts them to electrons, C·V/q, including dark ones. They are
float32, exact to 16 electrons at full swing, where shot noise alone is 14 000.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, TypeAlias

from numpy.typing import ArrayLike
from pydantic import Field

from megalopta.core import strict_yaml
from megalopta.core.arrays import Floats
from megalopta.core.bounded import named_path, read_text
from megalopta.core.errors import nearest
from megalopta.core.plug_ins import plug_ins
from megalopta.core.validation import checked, merged
from megalopta.sensor.contrast.model import CONTRAST_PRESETS, ContrastSensor
from megalopta.sensor.ctia.model import CTIA_PRESETS, CtiaSensor, pixels
from megalopta.sensor.frame import model as frame
from megalopta.sensor.optics import PixelOptics, band_means, detected_rate
from megalopta.sensor.spad.array import detection_rate
from megalopta.sensor.spad.device import draw_fixed_pattern
from megalopta.sensor.spad.model import Sensor
from megalopta.sensor.spad.presets import PRESETS, preset, with_files

ImageSensor: TypeAlias = Annotated[
    Sensor | CtiaSensor | frame.FrameSensor | ContrastSensor, Field(discriminator="kind")
]
"""Sensor of any kind, distinguished by `kind`."""
_KINDS: dict[str, Any] = {
    model.model_fields["kind"].default: model
    for model in (Sensor, CtiaSensor, frame.FrameSensor, ContrastSensor)
}
IMAGE_SENSORS: dict[str, ImageSensor] = {
    **PRESETS, **CTIA_PRESETS, **frame.FRAME_PRESETS, **CONTRAST_PRESETS,
}  # fmt: skip
"""Presets of all kinds by name, including entry points of other packages."""


def is_device_file(name: object) -> bool:
    """Return True for the path of a device's YAML file, False for the name of a preset."""
    return str(name).endswith((".yaml", ".yml"))


def spad_named(name: str) -> Sensor:
    """Return a SPAD array's preset, or that of a YAML file. Raises ValueError if unknown."""
    spad: Sensor = load_sensor(name, Sensor) if is_device_file(name) else preset(name)
    return spad


def load_sensor(path: str | Path, model: type[PixelOptics] = PixelOptics) -> Any:
    """Read a sensor, such as a measured device, from a YAML file.

    The file has the fields of a sensor of its `kind`, by default spad and, if given, of that
    `model`; `preset` supplies missing ones. Paths in it are relative to the file.

    Raises ValueError if the file or a map is missing, or a field is unknown or invalid.
    """
    path = Path(path)
    try:
        values = strict_yaml.load(read_text(path))
        if not isinstance(values, dict):
            raise ValueError("a sensor is a mapping of fields to values")
        if is_device_file(values.get("preset")):
            raise ValueError(f"preset {values['preset']!r}: a file; give the name of a preset")
        fields = sensor_fields(values, path.parent)
        if (kind := str(fields["kind"])) not in _KINDS:
            raise ValueError(f"kind {kind!r} is unknown; use {', '.join(_KINDS)}")
        sensor = checked(_KINDS[kind], fields)
        if not isinstance(sensor, model):
            raise ValueError(f"kind: {kind}; this takes SPAD arrays only, kind: spad")
    except OSError as error:
        problem = f"{error.strerror}; give the path of a device's YAML file"
        raise ValueError(f"{path}: {problem}") from error
    except (ValueError, RecursionError) as error:
        raise ValueError(f"{path}: {' '.join(str(error).split())}") from error
    return sensor


def sensor_fields(stated: str | Mapping[str, Any], folder: Path | None) -> dict[str, Any]:
    """Return the fields of a sensor from its preset, a name or a device's file, and changes to it.

    `folder`: as for `with_files`. Raises ValueError if one is unknown or damaged.
    """
    changes = with_files({"preset": stated} if isinstance(stated, str) else stated, folder)
    if (name := changes.pop("preset", None)) is None:
        return {"kind": "spad", **changes}
    base = sensor_named(named_path(str(name), folder) if is_device_file(name) else str(name))
    return merged(base.model_dump(mode="json"), changes)


def sensor_named(sensor: ImageSensor | str | Path) -> ImageSensor:
    """Return a sensor, or the one with a name or of a YAML file. Raises ValueError if unknown."""
    if not isinstance(sensor, str | Path):
        return sensor
    if is_device_file(name := str(sensor)):
        loaded: ImageSensor = load_sensor(name)
        return loaded
    if name not in IMAGE_SENSORS:
        raise ValueError(f"sensor {name!r} is unknown; {nearest(name, IMAGE_SENSORS)}")
    return IMAGE_SENSORS[name]


def _plugged_in(value: Any) -> Any:
    """Return the sensor of an entry point: itself, or the path of its YAML file."""
    sensor = load_sensor(value) if isinstance(value, str | Path) else value
    if not isinstance(sensor, PixelOptics):
        raise TypeError(f"{value!r} is not an image sensor or path of a YAML file; give one")
    return sensor


IMAGE_SENSORS |= plug_ins("megalopta.sensors", _plugged_in, dict(IMAGE_SENSORS))


def check_sensor(sensor: ImageSensor, bands_nm: ArrayLike, shape: tuple[int, int]) -> None:
    """Check that a sensor can expose images of (rows, columns) pixels in these bands.

    Raises ValueError if a band reaches outside its efficiency curve, or the device is impossible: a
    measured map is damaged or does not fit, or its values exceed the limits.
    """
    for filters, _ in sensor.filters.parts(shape):
        band_means([sensor.efficiency, *filters], bands_nm)
    if isinstance(sensor, Sensor):
        draw_fixed_pattern(sensor, shape)
    elif isinstance(sensor, CtiaSensor):
        pixels(sensor, shape)


def detected_photons(radiance: ArrayLike, bands_nm: ArrayLike, sensor: ImageSensor) -> Floats:
    """Photons detected in one exposure without losses, (T, H, W); parameters as for `expose`."""
    return detected_hz(radiance, bands_nm, sensor) * sensor.exposure_s


def detected_hz(radiance: ArrayLike, bands_nm: ArrayLike, sensor: ImageSensor) -> Floats:
    """Photons per second detected without losses, (T, H, W); parameters as for `expose`."""
    rate = detection_rate if isinstance(sensor, Sensor) else detected_rate
    return rate(radiance, bands_nm, sensor)  # type: ignore[arg-type]
