"""Estimates of a device as a YAML file and maps, which `sensors: [DEVICE.yaml]` loads."""

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from megalopta.core import strict_yaml
from megalopta.core.arrays import Floats
from megalopta.core.files import atomic_write, write_text
from megalopta.sensor import Sensor
from megalopta.sensor.calibrate.device import Device, Estimate
from megalopta.sensor.calibrate.neighbors import Kernel
from megalopta.sensor.effects import crosstalk
from megalopta.sensor.effects.crosstalk import Crosstalk

_INTERVALS = ("low", "high")
_SLOWEST_DEAD_TIMES = 5.0
"""Delay of afterpulses in dead times, which frames do not tell; a shorter one would hide them."""


def write_device(
    path: Path, device: Device, base: Sensor, wavelength_nm: float | None, preset: str
) -> None:
    """Write a device file, and its maps with their intervals into a folder beside it.

    Parameters
    ----------
    path : Path
        Of the YAML file; maps lie in a folder of its name without the suffix.
    device : Device
    base : Sensor
        What is not measured is its.
    wavelength_nm : float, optional
        Of the light of flat frames; None: it is relative, and so is the efficiency.
    preset : str
        Name of that sensor.
    """
    folder = path.with_suffix("")
    maps = {
        "dark_counts": _primary(device.dark_counts_hz, device.kernel),
        "step": device.step_v,
        "leak": device.leak_v_s,
        "offset": _negative(device.offset_v),
    }
    if device.efficiency is not None:
        nominal = nominal_efficiency(device, base, wavelength_nm)
        maps["efficiency"] = _primary(device.efficiency, device.kernel).scaled(1 / nominal)
    named = {}
    for name, estimate in maps.items():
        if not np.isfinite(estimate.value).any():
            continue
        lowest = 0.0 if name in ("dark_counts", "efficiency") else -np.inf
        _save(folder / f"{name}.npy", np.maximum(_filled(estimate.value), lowest))
        for end in _INTERVALS:
            _save(folder / f"{name}_{end}.npy", getattr(estimate, end))
        named[name] = f"{folder.name}/{name}.npy"
    _save(folder / "hot.npy", device.hot)
    text = strict_yaml.dump(_fields(path, device, base, preset, named))
    write_text(path, f"# Written by megalopta spadcam calibrate.\n{text}")


def nominal_efficiency(device: Device, base: Sensor, wavelength_nm: float | None) -> float:
    """Efficiency that a map is relative to: the base's on a pixel, or the mean of the pixels."""
    if wavelength_nm is None:
        assert device.efficiency is not None
        return float(np.nanmean(device.efficiency.value))
    return float(base.photon_detection_efficiency(np.array(wavelength_nm)))


def _fields(
    path: Path, device: Device, base: Sensor, preset: str, maps: dict[str, str]
) -> dict[str, Any]:
    counter: dict[str, Any] = {"step_v": _median(device.step_v), "step_sigma_v": 0.0}
    if "leak" in maps:
        counter |= {"leak_v_s": max(_median(device.leak_v_s), 0.0), "leak_sigma_v_s": 0.0}
    counter["read_noise_v"] = _median(device.read_noise_v)
    if device.is_slope_seen:
        counter["step_slope"] = device.curve.slope
    fields: dict[str, Any] = {
        "preset": preset,
        "name": path.stem,
        "source": f"calibrated by {device.method} from {len(device.levels)} recordings",
        "counter": counter,
    }
    if device.dead_time_s is not None and device.dead_time_kind is not None:
        seconds = float(np.nanmedian(device.dead_time_s.value))
        fields["dead_time"] = {"kind": device.dead_time_kind, "dead_time_s": seconds}
    if (light := _crosstalk(device.kernel)) is not None:
        fields["crosstalk"] = light.model_dump(exclude_defaults=True)
    if device.kernel is not None and device.kernel.are_afterpulses_seen:
        dead_s = fields.get("dead_time", {}).get("dead_time_s", base.dead_time.dead_time_s)
        fields["afterpulsing"] = _afterpulsing(device.kernel, dead_s, base)
    fields["measured"] = {**maps, "fit": "exact"}
    return fields


def _median(estimate: Estimate) -> float:
    return float(np.nanmedian(estimate.value))


def _negative(estimate: Estimate) -> Estimate:
    """Fall of the output as its rise."""
    return Estimate(-estimate.value, -estimate.high, -estimate.low)


def _crosstalk(kernel: Kernel | None) -> Crosstalk | None:
    """As the sensor stage takes it, where it is seen."""
    if kernel is None or not kernel.is_seen:
        return None
    shares = np.maximum(kernel.share, 0.0)
    orthogonal, diagonal, two = (float(shares[at : at + 2].mean()) for at in (0, 2, 4))
    return Crosstalk(
        mean_fired_neighbors=min(float(2 * shares.sum()), 0.8),  # each offset to either side
        diagonal=min(diagonal / orthogonal, 1.0),
        distance_two=min(two / orthogonal, 1.0),
    )


def _afterpulsing(kernel: Kernel, dead_time_s: float, base: Sensor) -> dict[str, float]:
    """Carriers of which as many find the pixel live as were seen."""
    delay_s = max(base.afterpulsing.delay_s, _SLOWEST_DEAD_TIMES * dead_time_s)
    carriers = kernel.afterpulses * float(np.exp(dead_time_s / delay_s))
    return {"mean_carriers": min(carriers, 0.95), "delay_s": delay_s}


def _primary(estimate: Estimate, kernel: Kernel | None) -> Estimate:
    """Less what neighbors and traps fire, which the simulation adds again."""
    fired = np.zeros_like(estimate.value)
    if kernel is not None and kernel.are_afterpulses_seen:
        fired += kernel.afterpulses * estimate.value
    if (light := _crosstalk(kernel)) is not None:
        fired += crosstalk.fired_mean(_filled(estimate.value), light)
    return Estimate(*(each - fired for each in (estimate.value, estimate.low, estimate.high)))


def _filled(values: Floats) -> Floats:
    """Maps without holes: the median where nothing is known."""
    return np.where(np.isfinite(values), values, np.nanmedian(values))


def _save(path: Path, values: NDArray[Any]) -> None:
    with atomic_write(path) as temporary:
        np.save(temporary, values)
