"""Model of an array of CTIA pixels, and the fixed pattern of one device.

Offset, gain and dark current differ from pixel to pixel and are fixed by the device seed and the
pixel's row and column: the offset and the gain in decibels are normal (§3.2.4), the factor on the
dark current is log-normal with mean 1 (an assumption; the dissertation measured single pixels). The
residual bias depends on how the bias is set (`bias`).

Source: dissertation, Chapter 3, for the pixel; the array is an extension. Presets, three
photodiodes at 300 K and with ideality 1:

- `si`, OSRAM SFH229FA. Two measurements fix saturation current and shunt: 50 pA at 10 V reverse
  (§3.3) and 1.6 pA "10–20 mV" from zero (Table 3.1, adaptive, poor), taken as 15 mV.
- `ingaas`, the custom sample "with unusually high defect densities" of §3.3.1 and Table 3.1. One
  measurement at a known bias: 170 nA at 100 mV reverse. The junction has the 100 pA of the
  dissertation's own simulation (Fig. 3.2), the shunt the rest, 588.6 kΩ. A shunt is the steepest
  curve of the model, and still gives 26 to 34 nA where Table 3.1 has 5.8 nA, 15 to 20 mV from zero.
- `ingaas_quiet`, the "different (less noisy)" diode of §3.4, without published parameters: the
  100 pA of Fig. 3.2 and no shunt.

Quantum efficiencies are typical curves, not measurements of these devices: silicon behind the
daylight filter of the SFH229FA (730 to 1100 nm), InGaAs lattice-matched to InP. The area of a pixel
is that of the diode: 0.31 mm² for the SFH229FA (data sheet), 0.045 mm² for InGaAs (§3.3.4: 2.25 pA
are 4.97 nA/cm²). Amplifier: 10 pF, 3.3 V, 130 ± 3.4 dB, mean offset 18.7 mV (§3.2.4; negative
there, the sign of the amplifier's input). Exposure: 10 ms for the leaky sample, which would
saturate, 100 ms for the others. Assumed, because not given: the spread of the offset, 10 mV
("typical offsets are on the order of 10 mV"), the spread of the dark current, 10 %, the read noise,
100 µV, and the lens.
"""

from pathlib import Path
from typing import Annotated, ClassVar, Literal

import numpy as np
from pydantic import Field

from megalopta.core import strict_yaml
from megalopta.core.arrays import Floats
from megalopta.core.validation import checked
from megalopta.sensor.ctia.bias import Bias, FixedBias, drift_rate, trimmed_bias
from megalopta.sensor.ctia.integration import Pixel, gain_from_db
from megalopta.sensor.ctia.noise import CtiaNoise
from megalopta.sensor.ctia.photodiode import Photodiode
from megalopta.sensor.optics.efficiency import Efficiency
from megalopta.sensor.optics.pixels import PixelOptics
from megalopta.sensor.sampling.streams import pixel_normals


class CtiaSensor(PixelOptics, frozen=True):
    """Array of photodiodes, each with a CTIA, behind a lens."""

    unit: ClassVar[str] = "electrons"
    """Unit of its readings in comparisons with other sensors."""

    kind: Literal["ctia"] = "ctia"
    """Kind of image sensor."""
    fill_factor: Annotated[float, Field(gt=0, le=1)] = 1.0
    """Light-sensitive fraction of the pixel's area (0 to 1)."""
    exposure_s: Annotated[float, Field(gt=0)]
    """Time from reset to reading (s)."""
    efficiency: Efficiency
    """Quantum efficiency over wavelength: electrons per photon on the light-sensitive area."""
    diode: Photodiode
    """Dark current of the photodiode."""
    capacitance_f: Annotated[float, Field(gt=0)] = 10e-12
    """Integration capacitor (F)."""
    swing_v: Annotated[float, Field(gt=0)] = 3.3
    """Discharge at which the output reaches its lower rail and the pixel saturates (V)."""
    gain_db: Annotated[float, Field(ge=20, le=200)] = 130.0
    """Mean open-loop gain of the amplifiers (dB)."""
    gain_sigma_db: Annotated[float, Field(ge=0)] = 0.0
    """Standard deviation of the gain over the pixels (dB)."""
    offset_v: float = 0.0
    """Mean input offset of the amplifiers (V); positive: reverse bias."""
    offset_sigma_v: Annotated[float, Field(ge=0)] = 0.0
    """Standard deviation of the offset over the pixels (V)."""
    dark_sigma: Annotated[float, Field(ge=0)] = 0.0
    """Relative standard deviation of the dark current over the pixels at equal bias."""
    bias: Annotated[Bias, Field(discriminator="kind")] = FixedBias()
    """Circuit that sets the reverse bias of the diodes."""
    noise: CtiaNoise = CtiaNoise()
    """Noise of its readings."""
    device_seed: int = 0
    """Device seed: fixes offset, gain and dark current of every pixel."""


def pixels(sensor: CtiaSensor, shape: tuple[int, int]) -> Pixel:
    """Pixels of a device at its first frame, with its fixed pattern."""
    offset = sensor.offset_v + sensor.offset_sigma_v * _normal(sensor, shape, "offset")
    gain_db = sensor.gain_db + sensor.gain_sigma_db * _normal(sensor, shape, "gain")
    dark, log_variance = _normal(sensor, shape, "dark current"), np.log1p(sensor.dark_sigma**2)
    return Pixel(
        diode=sensor.diode,
        capacitance_f=sensor.capacitance_f,
        swing_v=sensor.swing_v,
        gain=gain_from_db(gain_db),
        bias_v=trimmed_bias(sensor.bias, offset),
        drift_v_s=drift_rate(sensor.bias),
        dark_scale=np.exp(np.sqrt(log_variance) * dark - log_variance / 2),
    )


def _normal(sensor: CtiaSensor, shape: tuple[int, int], purpose: str) -> Floats:
    return pixel_normals(shape, sensor.device_seed, f"ctia {purpose}")


_FIELDS = strict_yaml.load(Path(__file__).with_name("presets.yaml").read_text("utf-8"))
CTIA_PRESETS: dict[str, CtiaSensor] = {
    name: checked(CtiaSensor, {"name": name, **fields}) for name, fields in _FIELDS.items()
}
PHOTODIODES = {name.removeprefix("ctia_"): each.diode for name, each in CTIA_PRESETS.items()}
TYPICAL_OFFSET_V = CTIA_PRESETS["ctia_si"].offset_v


def ctia_preset(name: str) -> CtiaSensor:
    """Return a CTIA sensor by name.

    Raises ValueError if there is no preset of this name.
    """
    if name not in CTIA_PRESETS:
        raise ValueError(f"sensor {name!r}: no such preset; choose from {', '.join(CTIA_PRESETS)}")
    return CTIA_PRESETS[name]
