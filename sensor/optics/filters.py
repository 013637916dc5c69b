"""Color filters: a mosaic of them in front of the pixels, and its colors at every pixel.

Pixel (y, x) sees light through the filter named by row y and column x of the mosaic, which repeats:
R, G and B are filters with a transmission curve, W is clear unless it has one. Crosstalk of light
between filters, and their dependence on the angle, are not part of it.

`demosaiced` interpolates the colors with OpenCV, bilinearly, for the four Bayer mosaics. Mosaics
with W are left as they are.
"""

from collections.abc import Iterator
from typing import Annotated, ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import Field, model_validator

from megalopta.core.arrays import Floats
from megalopta.sensor.effects.base import Effect, Stage
from megalopta.sensor.optics.lens import WavelengthCurve

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
