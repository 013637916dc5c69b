"""Pixels of any image sensor: from the radiance of a scene to detected photons."""

from typing import Annotated, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import Field, model_validator

from megalopta.core.arrays import Floats
from megalopta.core.record import Record
from megalopta.sensor.effects.dead_time import MOST_ARRIVALS
from megalopta.sensor.optics.efficiency import Efficiency, band_efficiency, band_transmission
from megalopta.sensor.optics.lens import (
    ColorFilters,
    Lens,
    blurred,
    check_bands,
    falloff,
    image_irradiance,
    photon_flux,
)

BLUR_PX = 0.5, 100.0
"""Smallest and largest blur of a lens that is not sharp, px."""


class PixelOptics(Record):
    """Image sensor of any kind: pixels of a given size and efficiency behind a lens."""

    kind: str
    """Kind of image sensor."""
    name: Annotated[str, Field(min_length=1)]
    """Name of the sensor in files and reports."""
    source: str = ""
    """Source of its parameters."""
    pitch_m: Annotated[float, Field(gt=0)]
    """Distance between the centers of neighboring pixels (m); a pixel is pitch × pitch."""
    fill_factor: Annotated[float, Field(gt=0, le=1)]
    """Light-sensitive fraction of the pixel's area (0 to 1)."""
    exposure_s: Annotated[float, Field(gt=0)]
    """Time during which events are counted for one frame (s)."""
    lens: Lens = Lens()
    """Lens in front of the pixels."""
    efficiency: Efficiency
    """Photon detection probability (PDP) of the light-sensitive area over wavelength."""
    filters: ColorFilters = Field(default=ColorFilters(), exclude_if=lambda own: not own.is_on)
    """Color filters in front of the pixels; none by default."""

    @model_validator(mode="after")
    def _check_blur(self) -> Self:
        least, most = (limit * self.pitch_m for limit in BLUR_PX)
        if self.lens.blur_m and not least <= self.lens.blur_m <= most:
            raise ValueError(
                f"lens.blur_m: {self.lens.blur_m:g} m; pixels of {self.pitch_m:g} m show blur from "
                f"{least:.3g} m, half a pixel, to {most:.3g} m; give 0 for a sharp lens"
            )
        return self

    @property
    def pixel_area_m2(self) -> float:
        """Area of a whole pixel, m²."""
        return self.pitch_m**2

    def photon_detection_efficiency(self, wavelength_nm: Floats) -> Floats:
        """PDE, of the photons on a whole pixel, at wavelengths (nm): PDP times fill factor."""
        return self.fill_factor * self.efficiency(wavelength_nm)

    @property
    def active_area_m2(self) -> float:
        """Light-sensitive area of a pixel, m²."""
        return self.pixel_area_m2 * self.fill_factor


def photon_rate(radiance: ArrayLike, bands_nm: ArrayLike, sensor: PixelOptics) -> Floats:
    """Photons per second on each pixel, (T, H, W); parameters as for `expose`."""
    flux = _flux_per_radiance(bands_nm, sensor) * band_transmission(sensor.lens, bands_nm)
    radiance = _check_radiance(radiance, flux.size)
    return _sum_over_bands(radiance, sensor.pixel_area_m2 * flux, sensor)


def detected_rate(
    radiance: ArrayLike,
    bands_nm: ArrayLike,
    sensor: PixelOptics,
) -> Floats:
    """Photons per second that pixels detect, (T, H, W); parameters as for `expose`.

    Pixels are identical but for their color filters.
    """
    per_radiance = _flux_per_radiance(bands_nm, sensor)
    radiance = _check_radiance(radiance, per_radiance.size)
    shape = radiance.shape[1], radiance.shape[2]
    rate: Floats | None = None
    for filters, behind in sensor.filters.parts(shape):
        flux = per_radiance * band_efficiency(sensor.efficiency, bands_nm, sensor.lens, filters)
        filtered = _sum_over_bands(radiance, sensor.active_area_m2 * flux, sensor)
        filtered *= behind
        rate = filtered if rate is None else rate + filtered
    assert rate is not None
    return rate


def check_brightness(rate: Floats, exposure_s: float) -> Floats:
    """Return rates (Hz) of any shape; raise if the radiance behind them is too bright."""
    brightest = float(rate.max(initial=0)) * exposure_s
    if not brightest <= MOST_ARRIVALS:
        raise ValueError(
            f"radiance: so bright that a pixel detects {brightest:g} photons per exposure; at most "
            f"{MOST_ARRIVALS:g} can be drawn: check its unit, W·m⁻²·sr⁻¹·nm⁻¹"
        )
    return rate


def _flux_per_radiance(bands_nm: ArrayLike, sensor: PixelOptics) -> Floats:
    """Photons·m⁻²·s⁻¹ on the axis for a radiance of 1 in each band, without the lens's curve."""
    if not isinstance(sensor, PixelOptics):
        raise TypeError(f"sensor: {sensor!r} is not a Sensor; give one, such as preset('spadcam')")
    irradiance = image_irradiance(np.ones(len(check_bands(bands_nm))), sensor.lens)
    return photon_flux(irradiance, bands_nm)


def _sum_over_bands(radiance: NDArray[np.floating], weights: Floats, sensor: PixelOptics) -> Floats:
    frames, rows, columns, _ = radiance.shape
    total = np.zeros((frames, rows, columns))
    # band by band, as the rounding of a matrix product depends on the number of frames
    for band, weight in enumerate(weights):
        total += weight * radiance[..., band]
    on_die = blurred(total, sensor.lens.blur_m / sensor.pitch_m)
    return on_die * falloff(sensor.lens, (rows, columns))


def _check_radiance(radiance: ArrayLike, bands: int) -> NDArray[np.floating]:
    values = np.asarray(radiance)
    if values.dtype.kind not in "fiu":
        raise ValueError(f"radiance: {values.dtype} values; give real numbers")
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
