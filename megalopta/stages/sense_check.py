"""Whether the sensors of a configuration can expose its frames."""

from megalopta.config import Configuration
from megalopta.sensor import check_sensor


def check_sense(settings: Configuration) -> None:
    """Refuse sensors that cannot expose the frames, measured devices whose maps are no good too.

    Raises
    ------
    ValueError
        With one sentence that names the sensor.
    """
    period_s = 1 / settings.trajectory.frame_rate_hz
    for sensor in settings.sensors:
        if sensor.exposure_s > period_s * (1 + 1e-9):
            raise ValueError(
                f"sensor {sensor.name!r}: exposure_s {sensor.exposure_s:g} is longer than a "
                f"frame at trajectory.frame_rate_hz {settings.trajectory.frame_rate_hz:g}; "
                f"use at most {period_s:g}"
            )
        try:
            shape = settings.camera.height, settings.camera.width
            check_sensor(sensor, settings.render.bands_nm, shape)
        except ValueError as problem:
            raise ValueError(f"sensor {sensor.name!r}: {problem}") from None
