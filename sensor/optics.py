"""Optics of any image sensor: from the radiance of a scene to detected photons per second.

    E(λ) = π·L(λ)·T·cos⁴θ / (4·N² + 1)          W·m⁻²·nm⁻¹

is the irradiance on the die, for spectral radiance L, f-number N and transmission T. Radiance is
given as its mean over each band; the photon rate is exact for a spectrum that is flat inside it.
A band's photon detection probability (PDP) is the mean of the tabulated curve over its photons:
between points a parabola, or a cubic with the transmission T(λ) of the lens, for which Simpson's
rule is exact, as Gauss and Legendre's of three points is with a color filter, too. Source, check
value and limits: `docs/theory/light.md`.

**Image lag**: a share of the charge that light frees stays behind for the next frame, there again.
Both parts of a Poisson number are independent Poisson numbers, so the mean is filtered over the
frames: exact below a full well. In a SPAD, carriers diffuse or are held where no avalanche frees
them; those in traps of the junction are `afterpulsing`, of an array that is not reset.
"""

from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise, product
from pathlib import Path
from typing import Annotated, Any, ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import Field, model_validator
from scipy.ndimage import correlate1d
from scipy.optimize import brentq
from scipy.special import ndtr

from megalopta.core import strict_yaml
from megalopta.core.arrays import Floats
from megalopta.core.bounded import file_content, named_path
from megalopta.core.curve_file import curve_of
from megalopta.core.record import Record
from megalopta.core.validation import checked, inner_types
from megalopta.sensor.effects.base import Effect
from megalopta.sensor.effects.dead_time import MOST_ARRIVALS

LagShare = Annotated[float, Field(ge=0, le=0.5)]
PLANCK_TIMES_LIGHT_SPEED = 1.98644586e-25
"""h·c in J·m."""


class WavelengthCurve(Record):
    """Fraction of light over wavelength, linear between points."""

    wavelengths_nm: Annotated[tuple[Annotated[float, Field(gt=0)], ...], Field(min_length=2)]
    """Points of the curve, increasing (nm)."""
    values: tuple[Annotated[float, Field(ge=0, le=1)], ...]
    """Fraction at each point."""

    @model_validator(mode="after")
    def _check_curve(self) -> Self:
        if len(self.wavelengths_nm) != len(self.values):
            raise ValueError(
                f"{len(self.wavelengths_nm)} wavelengths_nm for {len(self.values)} values; give "
                "one value per wavelength"
            )
        for before, after in pairwise(self.wavelengths_nm):
            if after <= before:
                raise ValueError(f"wavelengths_nm: {after:g} follows {before:g}; sort the curve")
        return self

    def __call__(self, wavelength_nm: Floats) -> Floats:
        """Fraction at each wavelength (nm) inside the curve."""
        return np.interp(wavelength_nm, self.wavelengths_nm, self.values)


class Lens(Effect, frozen=True):
    """Lens in front of the pixels."""

    f_number: Annotated[float, Field(gt=0)] = 1.4
    """Focal length over aperture diameter."""
    transmission: Annotated[float, Field(gt=0, le=1)] = 1.0
    """Transmitted fraction of the light, the same at every wavelength."""
    transmission_curve: WavelengthCurve | None = None
    """Transmitted fraction over wavelength, on top of `transmission`; null: 1."""
    falloff_fov_deg: Annotated[float, Field(gt=0, lt=180)] | None = None
    """Horizontal field of view (degrees) for cosine-fourth falloff; null: no falloff."""
    blur_m: Annotated[float, Field(ge=0, le=0.01)] = 0.0
    """Standard deviation of the Gaussian point spread on the die (m): 0, sharp, or at least half a
    pixel. Diffraction alone: about 0.45 times wavelength and f-number."""

    @property
    def is_on(self) -> bool:
        """True: there is always a lens."""
        return True

    @property
    def curves(self) -> list[WavelengthCurve]:
        """The transmission over wavelength, if there is one."""
        return [self.transmission_curve] if self.transmission_curve else []


_COLORS = {"R": "red", "G": "green", "B": "blue", "W": "white"}
_BAYER = ("RGGB", "BGGR", "GRBG", "GBRG")


class ColorFilters(Effect, frozen=True):
    """Mosaic of color filters; none by default."""

    switch: ClassVar[str] = "mosaic"

    mosaic: tuple[Annotated[str, Field(pattern="^[RGBW]{1,16}$")], ...] = Field((), max_length=16)
    """Rows of the mosaic, which repeats, such as RG and GB; empty: no filters."""
    red: WavelengthCurve | None = None
    """Transmission of the filters R over wavelength."""
    green: WavelengthCurve | None = None
    """Transmission of the filters G."""
    blue: WavelengthCurve | None = None
    """Transmission of the filters B."""
    white: WavelengthCurve | None = None
    """Transmission of the filters W; null: clear."""

    @model_validator(mode="after")
    def _check_colors(self) -> Self:
        if len({len(row) for row in self.mosaic}) > 1:
            raise ValueError(f"filters.mosaic: rows {self.mosaic} differ in length; fill them up")
        for letter, color in _COLORS.items():
            has_curve = getattr(self, color) is not None
            if letter != "W" and has_curve != (letter in "".join(self.mosaic)):
                state = "is in no row of" if has_curve else "has no curve, but is in"
                raise ValueError(
                    f"filters.{color}: {letter} {state} the mosaic {self.mosaic}; give both or "
                    "neither"
                )
        return self

    def places(self, shape: tuple[int, int]) -> NDArray[np.str_]:
        """Letter of the filter of every pixel, (rows, columns)."""
        letters = np.array([list(row) for row in self.mosaic])
        rows, columns = shape
        repeats = -(-rows // letters.shape[0]), -(-columns // letters.shape[1])
        return np.tile(letters, repeats)[:rows, :columns]

    def parts(
        self, shape: tuple[int, int]
    ) -> Iterator[tuple[list[WavelengthCurve], Floats | float]]:
        """Yield the curves of each filter, one or none, and the pixels (rows, columns) behind it.

        Without a mosaic: no curve, and 1.
        """
        if not self.mosaic:
            yield [], 1.0
            return
        letters = self.places(shape)
        for letter, color in _COLORS.items():
            if letter in "".join(self.mosaic):
                curve = getattr(self, color)
                yield [curve] if curve else [], (letters == letter).astype(np.float64)

    def check_bayer(self) -> None:
        """Raise ValueError if the mosaic is not one that `demosaiced` can interpolate."""
        if "".join(self.mosaic) not in _BAYER or len(self.mosaic) != 2:
            raise ValueError(
                f"filters.mosaic: {' '.join(self.mosaic) or 'none'}; OpenCV interpolates "
                f"{', '.join(_BAYER)}, in two rows; use the counts as they are"
            )


class Efficiency(WavelengthCurve, Effect, frozen=True):
    """Photon detection probability, of photons on the active area (PDP), over wavelength."""

    @property
    def is_on(self) -> bool:
        """True if a photon may be missed."""
        return min(self.values) < 1

    @classmethod
    def off(cls) -> "Efficiency":
        """Return an efficiency of 1."""
        return cls(wavelengths_nm=(1.0, 1e6), values=(1.0, 1.0))


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
    assumed: tuple[str, ...] = Field(default=(), exclude_if=lambda paths: not paths)
    """Fields whose values its source does not give: a path, such as efficiency.values, each, and
    the reason after a colon."""
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
    filters: ColorFilters = Field(default=ColorFilters(), exclude_if=lambda used: not used.is_on)
    """Color filters in front of the pixels; none by default."""

    @classmethod
    def presets(cls, path: Path) -> dict[str, Self]:
        """Return the sensors in a YAML file by name."""
        fields = strict_yaml.load(path.read_text("utf-8"))
        return {name: checked(cls, {"name": name, **values}) for name, values in fields.items()}

    @model_validator(mode="after")
    def _check_assumed(self) -> Self:
        for path in self.assumed:
            kinds: list[Any] = [type(self)]
            for step in path.partition(":")[0].split("."):
                kinds = [kind for outer in kinds for kind in inner_types(outer, step)]
            if not kinds:
                raise ValueError(
                    f"assumed: {path!r} does not begin with a field of a {self.kind} sensor; give "
                    "a path such as efficiency.values, and a reason after a colon"
                )
        return self

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

    @property
    def active_area_m2(self) -> float:
        """Light-sensitive area of a pixel, m²."""
        return self.pixel_area_m2 * self.fill_factor

    def photon_detection_efficiency(self, wavelength_nm: Floats) -> Floats:
        """PDE, of the photons on a whole pixel, at wavelengths (nm): PDP times fill factor."""
        return self.fill_factor * self.efficiency(wavelength_nm)


def photon_rate(radiance: ArrayLike, bands_nm: ArrayLike, sensor: PixelOptics) -> Floats:
    """Photons per second on each pixel, (T, H, W); parameters as for `expose`."""
    passing = band_means(sensor.lens.curves, bands_nm)
    weights = sensor.pixel_area_m2 * (_flux_per_radiance(bands_nm, sensor) * passing)
    radiance = _checked(radiance, weights.size)
    return _on_the_die(radiance, weights, sensor)


def detected_rate(radiance: ArrayLike, bands_nm: ArrayLike, sensor: PixelOptics) -> Floats:
    """Photons per second that pixels detect, (T, H, W); parameters as for `expose`.

    Pixels are identical but for their color filters.

    Raises ValueError if they are too many to be drawn.
    """
    flux = _flux_per_radiance(bands_nm, sensor)
    radiance = _checked(radiance, flux.size)
    rate_hz: Floats | None = None
    for filters, behind in sensor.filters.parts((radiance.shape[1], radiance.shape[2])):
        curves = [sensor.efficiency, *sensor.lens.curves, *filters]
        weights = sensor.active_area_m2 * (flux * band_means(curves, bands_nm))
        filtered_hz = _on_the_die(radiance, weights, sensor)
        filtered_hz *= behind
        rate_hz = filtered_hz if rate_hz is None else rate_hz + filtered_hz
    assert rate_hz is not None
    brightest = float(rate_hz.max(initial=0)) * sensor.exposure_s
    if not brightest <= MOST_ARRIVALS:
        raise ValueError(
            f"radiance: so bright that a pixel detects {brightest:g} photons per exposure; at most "
            f"{MOST_ARRIVALS:g} can be drawn: check its unit, W·m⁻²·sr⁻¹·nm⁻¹"
        )
    return rate_hz


def checked_rate(detections_hz: ArrayLike, sensor: PixelOptics) -> Floats:
    """Detection rates of a SPAD array as (frames, [parts,] rows, columns), Hz.

    Raises ValueError if they have another shape, are negative, not finite or too high to be drawn.
    """
    if getattr(sensor, "kind", None) != "spad":
        raise TypeError(f"sensor: {sensor!r} is not a Sensor; give one, such as preset('spadcam')")
    rate_hz = np.asarray(detections_hz, np.float64)
    if rate_hz.ndim not in (3, 4):
        raise ValueError(
            f"detections_hz: shape {rate_hz.shape}; give (frames, rows, columns), or with parts of "
            "the exposure (frames, parts, rows, columns)"
        )
    most_hz = MOST_ARRIVALS / sensor.exposure_s
    if rate_hz.size and not (rate_hz.min() >= 0 and rate_hz.max() <= most_hz):
        raise ValueError(
            f"detections_hz: from {rate_hz.min():g} to {rate_hz.max():g}; must be finite, not "
            f"negative and at most {most_hz:g} Hz ({MOST_ARRIVALS:g} per exposure)"
        )
    return rate_hz


def with_lag(rate_hz: Floats, sensor: Any, behind: Floats | None) -> tuple[Floats, Floats | None]:
    """Return rates (T, H, W) or (T, S, H, W), Hz, with lag, and mean electrons that stay behind.

    `behind` (H, W): those before the first frame; None: light was as in it.
    """
    share, exposure_s = sensor.lag_share, sensor.exposure_s
    if share == 0 or not len(rate_hz):
        return rate_hz, behind
    lagged_hz = np.empty_like(rate_hz)
    for frame, light_hz in enumerate(rate_hz):
        light_e = (light_hz if rate_hz.ndim == 3 else light_hz.mean(axis=0)) * exposure_s
        behind = light_e * share / (1 - share) if behind is None else behind
        lagged_hz[frame] = (1 - share) * (light_hz * exposure_s + behind) / exposure_s
        behind = share * (light_e + behind)
    return lagged_hz, behind


def _flux_per_radiance(bands_nm: ArrayLike, sensor: PixelOptics) -> Floats:
    """Photons·m⁻²·s⁻¹ on the axis for a radiance of 1 in each band, without the lens's curve."""
    if not isinstance(sensor, PixelOptics):
        raise TypeError(f"sensor: {sensor!r} is not a Sensor; give one, such as preset('spadcam')")
    per_radiance = np.pi * sensor.lens.transmission / (4 * sensor.lens.f_number**2 + 1)
    return photon_flux(per_radiance, bands_nm)


def _on_the_die(radiance: NDArray[np.floating], weights: Floats, sensor: PixelOptics) -> Floats:
    """Weighted sum over the bands, (T, H, W), after the blur and falloff of the lens."""
    total = np.zeros(radiance.shape[:3])
    # band by band, as the rounding of a matrix product depends on the number of frames
    for band, weight in enumerate(weights):
        total += weight * radiance[..., band]
    if sensor.lens.blur_m:
        total = blurred(total, sensor.lens.blur_m / sensor.pitch_m)
    if sensor.lens.falloff_fov_deg is not None:
        total *= falloff(sensor.lens, (radiance.shape[1], radiance.shape[2]))
    return total


def _checked(radiance: ArrayLike, bands: int) -> NDArray[np.floating]:
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


def falloff(lens: Lens, shape: tuple[int, int]) -> Floats:
    """Return cos⁴θ at the center of every pixel of a (rows, columns) image.

    Pixels are square; the optical axis goes through the center of the image.
    """
    rows, columns = shape
    pixel = 2 * np.tan(np.radians(lens.falloff_fov_deg or 0.0) / 2) / columns
    y = (np.arange(rows)[:, None] + 0.5 - rows / 2) * pixel
    x = (np.arange(columns) + 0.5 - columns / 2) * pixel
    return np.asarray((1 + x**2 + y**2) ** -2.0)


def blurred(images: Floats, blur_px: float) -> Floats:
    """Return images (n, H, W) blurred by a point spread of this standard deviation along each side.

    The weights of the pixels around are integrals over them of a Gaussian whose width makes their
    own standard deviation `blur_px`; the difference matters below a pixel. Beyond the border, the
    outermost pixels are repeated. Error at edges sharper than pixels: `docs/theory/light.md`.
    """
    reach = int(np.ceil(5 * blur_px)) + 1
    places = np.arange(-reach, reach + 1)

    def weights(width_px: float) -> Floats:
        within = np.diff(ndtr(np.append(places - 0.5, reach + 0.5) / width_px))
        return np.asarray(within / within.sum())

    def excess(width_px: float) -> float:
        return float(weights(width_px) @ places**2) - blur_px**2

    kernel = weights(brentq(excess, 0.5 * blur_px, 1.01 * blur_px))
    for axis in (1, 2):
        images = correlate1d(images, kernel, axis, mode="nearest")
    return images


def photon_flux(irradiance: ArrayLike, bands_nm: ArrayLike) -> Floats:
    """Photons·m⁻²·s⁻¹ in each band (…, B), for an irradiance in W·m⁻²·nm⁻¹ flat inside the band."""
    lower, upper = check_bands(bands_nm).T
    wavelength_integral = (upper**2 - lower**2) / 2 * 1e-9
    irradiance = np.asarray(irradiance, np.float64)
    return np.asarray(irradiance * (wavelength_integral / PLANCK_TIMES_LIGHT_SPEED))


def check_bands(bands_nm: ArrayLike) -> Floats:
    """Return band edges as (B, 2) float64, nm.

    Raises ValueError if the shape is not (B, 2), an edge is not positive and finite, a band has no
    width, or two bands overlap (their light would be counted twice).
    """
    bands = np.asarray(bands_nm, np.float64)
    if bands.ndim != 2 or bands.shape[1] != 2 or not len(bands):
        raise ValueError(
            f"bands_nm: shape {bands.shape}; give (B, 2), the lower and upper edge of each band"
        )
    if not np.all((bands > 0) & np.isfinite(bands)) or np.any(bands[:, 0] >= bands[:, 1]):
        raise ValueError(
            f"bands_nm: {bands.tolist()}; edges must be positive, finite, lower before upper (nm)"
        )
    ordered = bands[np.argsort(bands[:, 0])]
    if np.any(ordered[1:, 0] < ordered[:-1, 1]):
        raise ValueError(f"bands_nm: {bands.tolist()} overlap; their light would count twice")
    return bands


def band_means(curves: Sequence[WavelengthCurve], bands_nm: ArrayLike) -> Floats:
    """Return the mean of the product of curves over the photons of each band, (B,), from 0 to 1.

    Bands (B, 2) are lower and upper edges, nm. Raises ValueError if one reaches outside a curve.
    """
    bands = check_bands(bands_nm)
    for (lower, upper), curve in product(bands, curves):
        first, last = curve.wavelengths_nm[0], curve.wavelengths_nm[-1]
        if lower < first or upper > last:
            which = "efficiency" if isinstance(curve, Efficiency) else "lens's or a filter's"
            raise ValueError(
                f"bands_nm: {lower:g}–{upper:g} nm reaches outside the {which} curve, {first:g}–"
                f"{last:g} nm; extend the curve or drop the band"
            )

    def photons_seen(wavelength_nm: Floats) -> Floats:
        return np.asarray(np.prod([wavelength_nm, *(curve(wavelength_nm) for curve in curves)], 0))

    means = np.empty(len(bands))
    points = np.unique([point for curve in curves for point in curve.wavelengths_nm])
    for band, (lower, upper) in enumerate(bands):
        nodes = np.concatenate(([lower], points[(points > lower) & (points < upper)], [upper]))
        middle, width = (nodes[:-1] + nodes[1:]) / 2, np.diff(nodes)
        if len(curves) < 3:  # Simpson
            ends = photons_seen(nodes)
            integrals = width * (ends[:-1] + 4 * photons_seen(middle) + ends[1:]) / 6
        else:
            places, weights = np.polynomial.legendre.leggauss(3)
            half = width / 2
            integrals = half * sum(
                weight * photons_seen(middle + place * half)
                for place, weight in zip(places, weights, strict=True)
            )
        means[band] = integrals.sum() / ((upper**2 - lower**2) / 2)
    return means


def demosaiced(readings: ArrayLike, filters: ColorFilters) -> NDArray[np.float32]:
    """Return red, green and blue (T, H, W, 3) of readings (T, H, W), not negative.

    OpenCV computes with 16 bits: values are right to 1e-5 of the largest one. Raises ValueError for
    other mosaics than Bayer's.
    """
    import cv2  # takes a while to load

    filters.check_bayer()
    frames = np.asarray(readings)
    scale = max(float(frames.max(initial=0)), 1e-300) / 65535  # OpenCV's largest
    code = getattr(cv2, f"COLOR_Bayer{''.join(filters.mosaic)}2RGB")
    colors = [cv2.cvtColor(np.rint(frame / scale).astype(np.uint16), code) for frame in frames]
    return np.float32(scale) * np.array(colors, np.float32).reshape(*frames.shape, 3)


def with_curve(curve: Any, folder: Path | None, field: str) -> Any:
    """Return the curve in the file for `{path: FILE}`, and anything else unchanged.

    Raises ValueError if a path and numbers are both given, or the file holds no curve.
    """
    if not isinstance(curve, Mapping) or not isinstance(curve.get("path"), str):
        return curve
    if len(curve) > 1:
        extra = ", ".join(str(name) for name in curve if name != "path")
        raise ValueError(f"{field}: path and {extra} given; give a file or numbers, not both")
    path = named_path(curve["path"], folder)
    return curve_of(file_content(path, field), f"{field}: {path}", "efficiency")
