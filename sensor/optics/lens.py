"""Lens and color filters: from the radiance of a scene to the photons on the die.

An object at infinity of spectral radiance L, seen through a lens of f-number N and transmission T,
gives on the die the irradiance

    E(λ) = π·L(λ)·T·cos⁴θ / (4·N² + 1)          W·m⁻²·nm⁻¹

and photons arrive at ∫ E(λ)·λ/(h·c) dλ per second and square meter. Radiance is given as its mean
over each band; the integral is exact for a spectrum that is flat inside the band. The falloff is
off unless the lens has the camera's horizontal field of view: a rendered pinhole image has no
vignetting. Source, check value and limits: `docs/theory/light.md`.

**Color filters** are a mosaic in front of the pixels. Pixel (y, x) sees light through the filter
named by row y and column x of the mosaic, which repeats: R, G and B are filters with a transmission
curve, W is clear unless it has one. Crosstalk of light between filters, and their dependence on the
angle, are not part of it.

`demosaiced` interpolates the colors with OpenCV, bilinearly, for the four Bayer mosaics. Mosaics
with W are left as they are.
"""

from collections.abc import Iterator
from itertools import pairwise
from typing import Annotated, ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import Field, model_validator
from scipy.ndimage import correlate1d
from scipy.optimize import brentq
from scipy.special import ndtr

from megalopta.core.arrays import Floats
from megalopta.core.record import Record
from megalopta.sensor.effects.base import Effect, Stage

PLANCK_TIMES_LIGHT_SPEED = 1.98644586e-25
"""h·c in J·m."""


class WavelengthCurve(Record):
    """Fraction of light over wavelength, linear between points."""

    field: ClassVar[str]
    """Field of the sensor that holds the curve, for messages"""

    wavelengths_nm: Annotated[tuple[Annotated[float, Field(gt=0)], ...], Field(min_length=2)]
    """Points of the curve, increasing (nm)."""
    values: tuple[Annotated[float, Field(ge=0, le=1)], ...]
    """Fraction at each point."""

    @model_validator(mode="after")
    def _check_curve(self) -> Self:
        if len(self.wavelengths_nm) != len(self.values):
            raise ValueError(
                f"{self.field}: {len(self.wavelengths_nm)} wavelengths_nm for {len(self.values)} "
                "values; give one value per wavelength"
            )
        for before, after in pairwise(self.wavelengths_nm):
            if after <= before:
                raise ValueError(
                    f"{self.field}.wavelengths_nm: {after:g} follows {before:g}; sort the curve"
                )
        return self

    def __call__(self, wavelength_nm: Floats) -> Floats:
        """Fraction at each wavelength (nm) inside the curve."""
        return np.interp(wavelength_nm, self.wavelengths_nm, self.values)


class Transmission(WavelengthCurve, frozen=True):
    """Transmission over wavelength."""

    field: ClassVar[str] = "lens.transmission_curve"

    values: tuple[Annotated[float, Field(ge=0, le=1)], ...]
    """Fraction of the light that passes at each point."""


class Lens(Effect, frozen=True):
    """Lens in front of the pixels."""

    stage: ClassVar[Stage] = Stage.LIGHT
    statement: ClassVar[str] = "radiance becomes photons per second on the pixel"

    f_number: Annotated[float, Field(gt=0)] = 1.4
    """Focal length over aperture diameter."""
    transmission: Annotated[float, Field(gt=0, le=1)] = 1.0
    """Transmitted fraction of the light, the same at every wavelength."""
    transmission_curve: Transmission | None = None
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


def image_irradiance(radiance: ArrayLike, lens: Lens) -> Floats:
    """Irradiance on the lens's axis, W·m⁻²·nm⁻¹, from radiance, W·m⁻²·sr⁻¹·nm⁻¹; of any shape."""
    factor = np.pi * lens.transmission / (4 * lens.f_number**2 + 1)
    return factor * np.asarray(radiance, np.float64)


def falloff(lens: Lens, shape: tuple[int, int]) -> Floats:
    """Return cos⁴θ at the center of every pixel of a (rows, columns) image; 1 if it is off.

    Pixels are square; the optical axis goes through the center of the image.
    """
    if lens.falloff_fov_deg is None:
        return np.ones(shape)
    rows, columns = shape
    pixel = 2 * np.tan(np.radians(lens.falloff_fov_deg) / 2) / columns
    y = (np.arange(rows)[:, None] + 0.5 - rows / 2) * pixel
    x = (np.arange(columns) + 0.5 - columns / 2) * pixel
    return np.asarray((1 + x**2 + y**2) ** -2.0)


def blurred(images: Floats, blur_px: float) -> Floats:
    """Return images (n, H, W) blurred by the lens's point spread.

    The weights of the pixels around are integrals over them of a Gaussian whose width makes their
    own standard deviation `blur_px`; the difference matters below a pixel. Beyond the border, the
    outermost pixels are repeated. Where edges are sharper than pixels, the light within a pixel is
    unknown: images of dead leaves have errors of 10, 4, 2 and 0.7 % of their contrast (RMS) at 0.5,
    0.7, 1 and 1.5 px.

    `images` (n, H, W): in any unit; `blur_px`: standard deviation along rows and along columns, px;
    0 changes nothing.
    """
    if not blur_px:
        return images
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
    """Photons per second and square meter in each band, for a spectrum flat inside the band.

    `irradiance` (..., B): band means, W·m⁻²·nm⁻¹; `bands_nm` (B, 2): lower and upper edge of each
    band, nm. Returns (..., B) float64 photons·m⁻²·s⁻¹.

    Raises ValueError if the bands are not B pairs of edges.
    """
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


_COLORS = {"R": "red", "G": "green", "B": "blue", "W": "white"}
_BAYER = ("RGGB", "BGGR", "GRBG", "GBRG")
_LARGEST = 65535
"""Largest value that OpenCV interpolates."""


class FilterCurve(WavelengthCurve, frozen=True):
    """Transmission of a filter over wavelength."""

    field: ClassVar[str] = "filters"


class ColorFilters(Effect, frozen=True):
    """Mosaic of color filters; none by default."""

    stage: ClassVar[Stage] = Stage.LIGHT
    statement: ClassVar[str] = "every pixel sees light through its filter of the mosaic"
    switch: ClassVar[str] = "mosaic"

    mosaic: tuple[Annotated[str, Field(pattern="^[RGBW]{1,16}$")], ...] = Field((), max_length=16)
    """Rows of the mosaic, which repeats, such as RG and GB; empty: no filters."""
    red: FilterCurve | None = None
    """Transmission of the filters R over wavelength."""
    green: FilterCurve | None = None
    """Transmission of the filters G."""
    blue: FilterCurve | None = None
    """Transmission of the filters B."""
    white: FilterCurve | None = None
    """Transmission of the filters W; null: clear."""

    @model_validator(mode="after")
    def _check_colors(self) -> Self:
        if len({len(row) for row in self.mosaic}) > 1:
            raise ValueError(f"filters.mosaic: rows {self.mosaic} differ in length; fill them up")
        for letter, color in _COLORS.items():
            has_curve = getattr(self, color) is not None
            if letter != "W" and has_curve != self.has(letter):
                state = "is in no row of" if has_curve else "has no curve, but is in"
                raise ValueError(
                    f"filters.{color}: {letter} {state} the mosaic {self.mosaic}; give both or "
                    "neither"
                )
        return self

    def has(self, letter: str) -> bool:
        """True if a filter is part of the mosaic."""
        return any(letter in row for row in self.mosaic)

    def places(self, shape: tuple[int, int]) -> NDArray[np.str_]:
        """Letter of the filter of every pixel, (rows, columns)."""
        letters = np.array([list(row) for row in self.mosaic])
        repeats = [-(-size // own) for size, own in zip(shape, letters.shape, strict=True)]
        return np.tile(letters, repeats)[: shape[0], : shape[1]]

    def parts(self, shape: tuple[int, int]) -> Iterator[tuple[list[FilterCurve], Floats | float]]:
        """Yield the curves of each filter, one or none, and the pixels (rows, columns) behind it.

        Without a mosaic: no curve, and 1.
        """
        if not self.is_on:
            yield [], 1.0
            return
        letters = self.places(shape)
        for letter in filter(self.has, _COLORS):
            curve = getattr(self, _COLORS[letter])
            yield [curve] if curve else [], (letters == letter).astype(np.float64)

    def check_bayer(self) -> None:
        """Raise ValueError if the mosaic is not one that `demosaiced` can interpolate."""
        if "".join(self.mosaic) not in _BAYER or len(self.mosaic) != 2:
            raise ValueError(
                f"filters.mosaic: {' '.join(self.mosaic) or 'none'}; OpenCV interpolates "
                f"{', '.join(_BAYER)}, in two rows; use the counts as they are"
            )


def demosaiced(readings: ArrayLike, filters: ColorFilters) -> NDArray[np.float32]:
    """Return red, green and blue (T, H, W, 3) of readings (T, H, W), not negative.

    OpenCV computes with 16 bits: values are right to 1e-5 of the largest one. Raises ValueError for
    other mosaics than Bayer's.
    """
    import cv2  # takes a while to load

    filters.check_bayer()
    frames = np.asarray(readings)
    scale = max(float(frames.max(initial=0)), 1e-300) / _LARGEST
    code = getattr(cv2, f"COLOR_Bayer{''.join(filters.mosaic)}2RGB")
    colors = [cv2.cvtColor(np.rint(frame / scale).astype(np.uint16), code) for frame in frames]
    return np.float32(scale) * np.array(colors, np.float32).reshape(*frames.shape, 3)
