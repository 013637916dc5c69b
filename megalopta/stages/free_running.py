"""Arrays that run on from frame to frame: what `sense` asks of them."""

from megalopta.config.model import Configuration
from megalopta.sensor import Sensor


def check_free_running(settings: Configuration) -> None:
    """Refuse sensors that are reset in every frame, or rest between frames.

    Raises
    ------
    ValueError
        With one sentence that names the sensor and the setting.
    """
    rate_hz = settings.trajectory.frame_rate_hz
    for sensor in settings.sensors if settings.free_running else ():
        if not isinstance(sensor, Sensor):
            raise ValueError(
                f"free_running: sensor {sensor.name!r} integrates and is reset in every frame; "
                "take the setting or the sensor out"
            )
        if abs(sensor.exposure_s * rate_hz - 1) > 1e-9:
            raise ValueError(
                f"free_running: sensor {sensor.name!r} with exposure_s {sensor.exposure_s:g} does "
                f"not fill frames at trajectory.frame_rate_hz {rate_hz:g}; use exposure_s "
                f"{1 / rate_hz:.12g}, or leave the setting out"
            )
