"""Model of a frame camera, as plain frozen data, in electrons: its EMVA 1288 sheet and more.

Stages of a frame, in order, each with the unit of what it leaves:

    light, with image lag and PRNU               mean photoelectrons
    dark current, clock-induced charge           electrons, Poisson together with those of light
    full well                                    electrons, at most `full_well_e`
    electron multiplication                      electrons, up to the register's well
    DSNU; telegraph, row, column, read noise     electrons at the amplifier
    ADC                                          DN, whole numbers from 0 to 2ⁿ − 1

A reading is (DN − black)·e_per_dn over the gain of the register: electrons, those of the dark
included. CMOS, sCMOS, qCMOS, CCD and EMCCD differ in numbers alone. Read noise includes what
remains of the noise of resets.

Source: EMVA Standard 1288, Release 4.0 Linear (2021). Its σ_d is `read.median_e` where pixels are
alike, its K 1/`adc.e_per_dn`, its µ_e.sat 2.8·√µ_e.sat below `full_well_e` or the ADC's end.
"""

from functools import lru_cache
from pathlib import Path
from typing import Annotated, ClassVar, Literal, NamedTuple, Self

import numpy as np
from pydantic import Field, model_validator

from megalopta.core.arrays import Floats
from megalopta.core.record import Record
from megalopta.sensor.effects.dark_counts import Telegraph, Traps, draw_traps
from megalopta.sensor.effects.dead_time import MOST_ARRIVALS
from megalopta.sensor.optics import LagShare, PixelOptics
from megalopta.sensor.sampling.streams import pixel_normals

NotNegative = Annotated[float, Field(ge=0)]


class DarkCurrent(Record):
    """Electrons without light; none by default."""

    mean_e_s: NotNegative = 0.0
    """Mean dark current of a pixel at the reference temperature (electrons/s)."""
    log_sigma: Annotated[float, Field(ge=0, le=5)] = 0.0
    """Standard deviation over the pixels of its logarithm: hot pixels are the tail."""
    celsius: Annotated[float, Field(gt=-273.15, le=200)] = 20.0
    """Temperature of the chip (°C)."""
    reference_celsius: Annotated[float, Field(gt=-273.15, le=200)] = 20.0
    """Temperature at which the dark current holds (°C)."""
    doubling_k: Annotated[float, Field(ge=1)] = 8.0
    """Rise in temperature that doubles it (K)."""

    @property
    def now_e_s(self) -> float:
        """Mean dark current at the chip's temperature, electrons/s."""
        rise_k = self.celsius - self.reference_celsius
        return float(self.mean_e_s * np.exp2(rise_k / self.doubling_k))


class FixedPattern(Record):
    """Differences between pixels, as EMVA 1288 release 4 splits them; none by default."""

    dsnu_pixel_e: NotNegative = 0.0
    """Standard deviation over the pixels of the offset (electrons)."""
    dsnu_row_e: NotNegative = 0.0
    """Standard deviation of the offset over the rows (electrons)."""
    dsnu_column_e: NotNegative = 0.0
    """Standard deviation of the offset over the columns (electrons)."""
    prnu_pixel: Annotated[float, Field(ge=0, le=0.2)] = 0.0
    """Relative standard deviation over the pixels of the response."""
    prnu_row: Annotated[float, Field(ge=0, le=0.2)] = 0.0
    """Relative standard deviation of the response over the rows."""
    prnu_column: Annotated[float, Field(ge=0, le=0.2)] = 0.0
    """Relative standard deviation of the response over the columns."""


class EmRegister(Record):
    """Electron-multiplying register; none by default."""

    gain: Annotated[float, Field(ge=1, le=5000)] = 1.0
    """Mean number of electrons that come out for one; 1: no register."""
    stages: Annotated[int, Field(ge=1, le=2000)] = 500
    """Stages, in each of which an electron may free another."""
    well_e: Annotated[float, Field(gt=0)] = 1e9
    """Electrons that the register holds."""

    @model_validator(mode="after")
    def _check_chance(self) -> Self:
        if self.chance > 0.5:
            fewest = int(np.ceil(np.log(self.gain) / np.log(1.5)))
            raise ValueError(
                f"em.stages: {self.stages} for a gain of {self.gain:g}; give {fewest} or more"
            )
        return self

    @property
    def chance(self) -> float:
        """Probability that an electron frees another in a stage."""
        return float(self.gain ** (1 / self.stages) - 1)

    @property
    def excess_noise(self) -> float:
        """F² = 2(G − 1)·G^(−(N + 1)/N) + 1/G (Robbins and Hadwen, IEEE TED 50, 1227, 2003)."""
        gain, stages = self.gain, self.stages
        return float(2 * (gain - 1) * gain ** (-(stages + 1) / stages) + 1 / gain)


class ReadNoise(Record):
    """Noise of the amplifiers; none by default."""

    median_e: NotNegative = 0.0
    """Median over the pixels of the standard deviation (electrons, after a register)."""
    log_sigma: Annotated[float, Field(ge=0, le=3)] = 0.0
    """Standard deviation of its logarithm over the pixels."""
    telegraph_share: Annotated[float, Field(ge=0, le=1)] = 0.0
    """Fraction of pixels whose amplifier switches between two levels."""
    telegraph_e: NotNegative = 0.0
    """Distance of these levels (electrons)."""
    telegraph_s: Annotated[float, Field(gt=0)] = 1.0
    """Correlation time of the switching (s)."""
    row_e: NotNegative = 0.0
    """Standard deviation of noise that a row shares in a frame (electrons)."""
    column_e: NotNegative = 0.0
    """Standard deviation of noise that a column shares in a frame (electrons)."""

    @property
    def telegraph(self) -> Telegraph:
        """Traps of the amplifiers, each of which is full half of the time."""
        times = {"fastest_s": self.telegraph_s, "slowest_s": self.telegraph_s}
        return Telegraph(share=self.telegraph_share * (self.telegraph_e > 0), **times)


class Adc(Record):
    """Analog-to-digital converter."""

    bits: Annotated[int, Field(ge=1, le=24)]
    """Resolution (bits)."""
    e_per_dn: Annotated[float, Field(gt=0)]
    """Electrons at the amplifier for one DN: 1/K of EMVA 1288."""
    black_dn: NotNegative = 0.0
    """Mean reading without light or dark current (DN)."""

    @property
    def largest_dn(self) -> int:
        """Largest code."""
        return int(2**self.bits - 1)


class FrameSensor(PixelOptics, frozen=True):
    """Frame camera behind a lens; the image sets the number of pixels."""

    unit: ClassVar[str] = "electrons"
    """Unit of its readings."""

    kind: Literal["frame"] = "frame"
    """Kind of image sensor."""
    dark: DarkCurrent = DarkCurrent()
    """Dark current; none by default."""
    cic_e: NotNegative = 0.0
    """Mean clock-induced charge of a frame (electrons)."""
    pattern: FixedPattern = FixedPattern()
    """Differences between pixels; none by default."""
    lag_share: LagShare = 0.0
    """Share of a pixel's charge that stays behind for the next frame."""
    full_well_e: Annotated[float, Field(ge=1, le=1e7)]
    """Electrons that a pixel holds."""
    em: EmRegister = EmRegister()
    """Electron-multiplying register; none by default."""
    read: ReadNoise = ReadNoise()
    """Noise of the amplifiers; none by default."""
    adc: Adc
    """Analog-to-digital converter."""
    readout_s: NotNegative = 0.0
    """Time from the start of the first row's exposure to that of the last (rolling shutter, s), for
    light that moves within frames (`sub_frames`); 0: global shutter."""
    device_seed: int = 0
    """Device seed: fixes what differs between pixels."""

    @model_validator(mode="after")
    def _check_black(self) -> Self:
        if self.adc.black_dn >= self.adc.largest_dn:
            raise ValueError(
                f"adc.black_dn: {self.adc.black_dn:g} is no code of {self.adc.bits} bits; give "
                f"less than {self.adc.largest_dn}"
            )
        return self


class FramePixels(NamedTuple):
    """Pixels of one device, each (H, W)."""

    response: Floats
    """Detection efficiency relative to the sensor's curve"""
    dark_e: Floats
    """Mean electrons of dark current and clock-induced charge in an exposure"""
    offset_e: Floats
    """Offset at the amplifier"""
    read_e: Floats
    """Standard deviation of the read noise, without telegraph, row and column noise"""
    traps: Traps
    """Traps of the amplifiers that switch, with steps of 1, and of 0 in others"""


@lru_cache(maxsize=8)
def pixels(sensor: FrameSensor, shape: tuple[int, int]) -> FramePixels:
    """Pixels of a device, with its fixed pattern; arrays are not to be changed."""
    seed, pattern, read, dark = sensor.device_seed, sensor.pattern, sensor.read, sensor.dark

    def spread(pixel: float, row: float, column: float, purpose: str) -> Floats:
        total = pixel * pixel_normals(shape, seed, f"frame {purpose}")
        total += row * pixel_normals((shape[0], 1), seed, f"frame {purpose}, rows")
        total += column * pixel_normals((1, shape[1]), seed, f"frame {purpose}, columns")
        return total

    prnu = spread(pattern.prnu_pixel, pattern.prnu_row, pattern.prnu_column, "response")
    log_dark = spread(dark.log_sigma, 0, 0, "dark current") - dark.log_sigma**2 / 2
    dark_e = np.minimum(dark.now_e_s * sensor.exposure_s * np.exp(log_dark), MOST_ARRIVALS)
    device = FramePixels(
        response=np.maximum(1 + prnu, 0.0),
        dark_e=dark_e + sensor.cic_e,
        offset_e=spread(pattern.dsnu_pixel_e, pattern.dsnu_row_e, pattern.dsnu_column_e, "offset"),
        read_e=read.median_e * np.exp(spread(read.log_sigma, 0, 0, "read noise")),
        traps=draw_traps(read.telegraph, shape, seed, None),
    )
    for values in device[:-1]:
        values.flags.writeable = False
    return device


FRAME_PRESETS = FrameSensor.presets(Path(__file__).with_name("presets.yaml"))
"""Frame cameras by name; `presets.yaml` gives the source of each value."""
