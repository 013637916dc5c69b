"""One exposure of the sensor: from the radiance of a scene to counts.

The light adds up over the bands, the dark counts join it, dead time takes its share, the counter
reads. The rate is that of the frame's radiance for the whole exposure: motion blur, if wanted, is
in the radiance already.

Every frame has its own random stream, named by seed, sequence and frame number, so the counts of a
frame do not depend on which others are drawn with it. Draws that must be independent, such as those
of two light levels, need different names for `sequence`.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from megalopta.sensor import dead_time
from megalopta.sensor.counter import Counts, read_counter
from megalopta.sensor.dark_counts import dark_count_rate
from megalopta.sensor.efficiency import band_efficiency
from megalopta.sensor.model import Sensor
from megalopta.sensor.optics import check_bands, falloff, image_irradiance, photon_flux
from megalopta.sensor.randomness import generator

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Exposure:
    """Frames as the sensor read them.

    Attributes
    ----------
    counts : (T, H, W) uint16 or uint32
        Detected events per exposure; a lower bound where saturated.
    expected : (T, H, W) float64
        Mean number of events that reach the counter: the noise-free twin.
    saturated : (T, H, W) bool
        Where the counter was full.
    """

    counts: Counts
    expected: Floats
    saturated: NDArray[np.bool_]


def expose(
    radiance: ArrayLike,
    bands_nm: ArrayLike,
    sensor: Sensor,
    *,
    seed: int,
    sequence: str | int,
    first_frame: int = 0,
) -> Exposure:
    """Draw the counts of frames of a scene.

    Parameters
    ----------
    radiance : (T, H, W, B) array
        Band means, W·m⁻²·sr⁻¹·nm⁻¹.
    bands_nm : (B, 2) array
        Lower and upper edge of each band, nm.
    sensor : Sensor
    seed : int
    sequence : str or int
        Name of what is drawn; the counts of a frame are a function of seed, sequence and frame.
    first_frame : int
        Number of the first of these frames in the sequence.

    Raises
    ------
    ValueError
        When the radiance is negative, not finite or of the wrong shape, or a band reaches outside
        the efficiency curve.
    """
    rate = detection_rate(radiance, bands_nm, sensor)
    return expose_rate(rate, sensor, seed=seed, sequence=sequence, first_frame=first_frame)


def expose_rate(
    detections_hz: ArrayLike,
    sensor: Sensor,
    *,
    seed: int,
    sequence: str | int,
    first_frame: int = 0,
) -> Exposure:
    """Draw the counts of frames whose detection rate is known, (T, H, W) in Hz; as `expose`."""
    events_hz = _with_dark_counts(detections_hz, sensor)
    events = np.empty(events_hz.shape, np.int64)
    for frame, rate in enumerate(events_hz):
        rng = generator(seed, "exposure", sequence, first_frame + frame)
        events[frame] = dead_time.draw_counts(rng, rate, sensor.exposure_s, sensor.dead_time)
    counts, saturated = read_counter(events, sensor.counter_capacity)
    expected = dead_time.expected_counts(events_hz, sensor.exposure_s, sensor.dead_time)
    return Exposure(counts, expected, saturated)


def photon_rate(radiance: ArrayLike, bands_nm: ArrayLike, sensor: Sensor) -> Floats:
    """Photons per second that fall on each pixel, (T, H, W); parameters as for `expose`."""
    flux = _flux_per_radiance(bands_nm, sensor)
    return _sum_over_bands(radiance, sensor.pixel_area_m2 * flux, sensor)


def detection_rate(radiance: ArrayLike, bands_nm: ArrayLike, sensor: Sensor) -> Floats:
    """Photons per second that each pixel would detect without dead time, (T, H, W); as `expose`."""
    flux = _flux_per_radiance(bands_nm, sensor) * band_efficiency(sensor.efficiency, bands_nm)
    return _sum_over_bands(radiance, sensor.active_area_m2 * flux, sensor)


def expected_counts(radiance: ArrayLike, bands_nm: ArrayLike, sensor: Sensor) -> Floats:
    """Exact mean number of events per exposure, (T, H, W), dark counts included; as `expose`."""
    events_hz = _with_dark_counts(detection_rate(radiance, bands_nm, sensor), sensor)
    return dead_time.expected_counts(events_hz, sensor.exposure_s, sensor.dead_time)


def signal_to_noise(radiance: ArrayLike, bands_nm: ArrayLike, sensor: Sensor) -> Floats:
    """Ratio of signal counts to the standard deviation of all counts, (T, H, W); as `expose`.

    The signal is what the light adds to the expected count: less than the detections where dead
    time matters, negative where a paralyzable pixel reads less than in the dark, 0 where nothing is
    counted at all. Saturation of the counter is not included.
    """
    light_hz = detection_rate(radiance, bands_nm, sensor)
    exposure_s, law = sensor.exposure_s, sensor.dead_time
    events_hz, dark_hz = (_with_dark_counts(rate, sensor) for rate in (light_hz, 0 * light_hz))
    signal = dead_time.expected_counts(events_hz, exposure_s, law)
    signal -= dead_time.expected_counts(dark_hz, exposure_s, law)
    noise = np.sqrt(dead_time.variance_counts(events_hz, exposure_s, law))
    return np.divide(signal, noise, out=np.zeros_like(signal), where=noise > 0)


def _with_dark_counts(detections_hz: ArrayLike, sensor: Sensor) -> Floats:
    rate = np.asarray(detections_hz, np.float64)
    if rate.ndim != 3:
        raise ValueError(f"detections_hz: shape {rate.shape}; give (frames, rows, columns)")
    _, rows, columns = rate.shape
    return rate + dark_count_rate(
        sensor.dark_counts, (rows, columns), sensor.active_area_m2, sensor.device_seed
    )


def _flux_per_radiance(bands_nm: ArrayLike, sensor: Sensor) -> Floats:
    """Photons·m⁻²·s⁻¹ on the axis for a radiance of 1 in each band."""
    irradiance = image_irradiance(np.ones(len(check_bands(bands_nm))), sensor.lens)
    return photon_flux(irradiance, bands_nm)


def _sum_over_bands(radiance: ArrayLike, weights: Floats, sensor: Sensor) -> Floats:
    radiance = _check_radiance(radiance, weights.size)
    frames, rows, columns, _ = radiance.shape
    total = np.zeros((frames, rows, columns))
    # band by band rather than as a matrix product, whose rounding depends on the number of frames
    for band, weight in enumerate(weights):
        total += weight * radiance[..., band]
    return total * falloff(sensor.lens, (rows, columns))


def _check_radiance(radiance: ArrayLike, bands: int) -> NDArray[np.floating]:
    values = np.asarray(radiance)
    if values.ndim != 4 or values.shape[3] != bands:
        raise ValueError(
            f"radiance: shape {values.shape}; give (frames, rows, columns, {bands}), the last axis "
            "as long as bands_nm"
        )
    if values.size and not (values.min() >= 0 and values.max() < np.inf):
        where = np.argwhere(~((values >= 0) & (values < np.inf)))[0]
        raise ValueError(
            f"radiance: {values[tuple(where)]} at [frame, row, column, band] {where.tolist()}; "
            "must be finite and not negative: render the frame again"
        )
    return values
