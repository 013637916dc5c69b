"""Your pictures as the light of a scene: a video, a folder of pictures or an array.

Values are relative: the mean of all frames reflects a given share of the light.
"""

import math
from pathlib import PurePath
from typing import Annotated, ClassVar, Literal

import numpy as np
from numpy.typing import ArrayLike
from pydantic import Field

from megalopta.core.arrays import Floats
from megalopta.core.record import Record
from megalopta.scenes.base import SceneDescription
from megalopta.scenes.cameras.base import Camera
from megalopta.scenes.hashed_file import HashedFile
from megalopta.scenes.light import Light
from megalopta.scenes.scene import Scene
from megalopta.scenes.spectra import color
from megalopta.scenes.spectra.spectrum import SPECTRA, Spectrum, SpectrumName, check_known, luminous
from megalopta.scenes.trajectories.base import Path

Unit = Literal["srgb", "linear", "cd/m2"]
"""Unit of the values: sRGB codes, linear in light, or luminance."""
Between = Literal["hold", "blend", "flow"]

_HOW: dict[Between, str] = {
    "hold": "holding each picture until the next",
    "blend": "blending neighboring pictures linearly",
    "flow": "moving light along the flow that DIS estimates between pictures",
}


class ColorsAsLight(Record, frozen=True):
    """Conversion of colors of pictures, linear in light, to spectral radiance."""

    reflectance: Annotated[float, Field(gt=0, le=1)] = 0.18
    """Mean reflectance of the pictures: luminance is this share of illuminance over π."""
    spectrum: SpectrumName | Literal["light"] = "D65"
    """Spectrum of white: D65, the CIE standard daylight; equal_energy, the same at every
    wavelength; or that of the light."""

    def white(self, light: Light) -> Spectrum:
        """Spectrum of the light on a white surface, W·m⁻²·nm⁻¹, at the light's illuminance."""
        level = light.resolved()
        if self.spectrum == "light":
            return level.spectrum()
        spectrum = SPECTRA[self.spectrum]
        return spectrum.scaled(level.illuminance_lux / luminous(spectrum))

    def white_name(self, light: Light) -> str:
        """Name of the spectrum of white."""
        return (light.level if self.spectrum == "light" else self.spectrum).replace("_", " ")

    def radiance_of_unit(
        self,
        light: Light,
        bands_nm: color.Bands,
        mean: ArrayLike,
        of_channels_nm: color.Bands | None = None,
    ) -> Floats:
        """Band means (channels, B) of each channel with a value of 1, W·m⁻²·sr⁻¹·nm⁻¹.

        Channels are red, green and blue, or bands of spectral radiance. `mean` (channels,) is the
        mean over all frames, which reflects `reflectance` of the light.
        """
        if of_channels_nm is None:
            name, remedy = f"white {self.white_name(light)!r}", "choose another `spectrum`, or "
            check_known(name, self.white(light).range_nm, bands_nm, remedy)
            of_white = color.band_means(color.primaries(self.white(light)), bands_nm) / math.pi
            return of_white * self.reflectance / float(np.dot(mean, color.LUMINANCE_SHARES))
        lux = math.pi * float(np.dot(mean, color.luminances(of_channels_nm))) / self.reflectance
        return color.rebinned(of_channels_nm, bands_nm) * (light.resolved().illuminance_lux / lux)


class Pictures(ColorsAsLight, SceneDescription, frozen=True):
    """Your pictures, whose motion is unknown."""

    kind: Literal["pictures"] = "pictures"
    file: HashedFile
    """Path, in YAML below the file's folder, of a picture, a folder of pictures, a video, an
    animation or an array."""
    unit: Unit | None = None
    """Unit of the values: `srgb` codes, `linear` in light, or `cd/m2`; null: as stated by the file,
    such as a picture or video."""
    picture_rate_hz: Annotated[float, Field(gt=0, le=1e9)] | None = None
    """Pictures per second, for files without times; null: the frame rate."""
    between: Between = "hold"
    """Light between two pictures, also within an exposure: `hold` the earlier picture, `blend` both
    linearly, or move them along the `flow` that DIS estimates."""
    has_truth: ClassVar[bool] = False
    has_surfaces: ClassVar[bool] = False

    def build(self, light: Light, camera: Camera, trajectory: Path) -> Scene:
        """Raise ValueError: pictures have no geometry."""
        raise ValueError("scene.kind 'pictures' has no geometry to render; use `megalopta sense`")

    def describe(self) -> str:
        """Sentence for the report."""
        return f"Pictures of {PurePath(self.file.path).name}, {_HOW[self.between]}."
