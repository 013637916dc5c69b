"""Bias of the diode: how it is set, and how close to zero it can be trimmed.

Non-adaptive (Fig. 3.1a): a digital-to-analog converter holds the anode, the amplifier's reference
V_P and its offset the cathode, so the reverse bias is V_P + offset − code·LSB, 0.81 mV a step.

Adaptive (Fig. 3.1b, §3.3.3): a floating gate in the amplifier trims the offset itself, which is
then the bias. A tunneling pulse of 1 ms at 14.15 V raises the gate by about 500 µV; the gate leaks
back at 1.5 µV/s, and the offset moves by about 1 mV per °C (simulated in the source). Pulses lower
the reverse bias, the leak raises it again. Before that, ultraviolet light erases the chip and sets
every gate to where pulses are needed; the voltage is not published.

Both are trimmed to the smallest reverse bias not below a target, because a diode in forward bias
cannot discharge the pixel. The residual is uniform over one step. A gate that starts below the
target stays there: pulses cannot raise the bias.

Assumed: one volt on the gate is one volt of offset (the dissertation compares the two directly but
could not measure it); a step is independent of the gate's voltage and proportional to the pulse
length; all pulses are equal.
"""

from typing import Annotated, Literal, TypeAlias

import numpy as np
from pydantic import Field

from megalopta.core.arrays import Floats
from megalopta.core.record import Record
from megalopta.sensor.ctia.photodiode import Reals


class FixedBias(Record):
    """No trimming: every pixel has its amplifier's offset plus a common bias."""

    kind: Literal["fixed"] = "fixed"
    """Kind of bias circuit."""
    reverse_bias_v: float = 0.0
    """Reverse bias of a pixel without offset (V)."""


class DacBias(Record):
    """Non-adaptive: a digital-to-analog converter sets every pixel's anode to the best code."""

    kind: Literal["dac"] = "dac"
    """Kind of bias circuit."""
    bits: Annotated[int, Field(ge=1, le=24)] = 12
    """Resolution of the converter (bits)."""
    rail_v: Annotated[float, Field(gt=0)] = 3.3
    """Full scale of the converter (V)."""
    reference_v: Annotated[float, Field(ge=0)] = 1.65
    """Reference V_P of the amplifier, on the other side of the diode (V)."""
    target_v: float = 0.0
    """Lower limit of the reverse bias, which is as small as possible above it (V)."""

    @property
    def step_v(self) -> float:
        """Voltage between two codes (V)."""
        return float(self.rail_v / 2**self.bits)


class FloatingGateBias(Record):
    """Adaptive: every pixel's offset is trimmed by pulses on a floating gate."""

    kind: Literal["floating_gate"] = "floating_gate"
    """Kind of bias circuit."""
    pulse_rate_v_s: Annotated[float, Field(gt=0)] = 0.5
    """Rise of the gate during a pulse of 14.15 V (V/s); 0.5 is 500 µV in 1 ms."""
    pulse_s: Annotated[float, Field(gt=0)] = 1e-3
    """Length of a pulse (s)."""
    leak_v_s: Annotated[float, Field(ge=0)] = 1.5e-6
    """Rise of the reverse bias as the gate leaks (V/s)."""
    drift_v_k: float = 1e-3
    """Rise of the reverse bias with temperature (V/K)."""
    erased_v: Annotated[float, Field(ge=0)] = 0.1
    """Reverse bias of the erased gate on top of the offset, before the first pulse (V)."""
    target_v: float = 0.0
    """Lower limit of the reverse bias right after calibration (V)."""
    age_s: Annotated[float, Field(ge=0)] = 0.0
    """Time from calibration to the first frame (s)."""
    warming_k: float = 0.0
    """Temperature now minus temperature at calibration (K)."""

    @property
    def step_v(self) -> float:
        """Change of the bias by one pulse (V)."""
        return self.pulse_rate_v_s * self.pulse_s


Bias: TypeAlias = FixedBias | DacBias | FloatingGateBias


def trimmed_bias(bias: Bias, offset_v: Reals) -> Floats:
    """Reverse bias of pixels of any shape with these offsets at the start of the first frame, V."""
    offset = np.asarray(offset_v, np.float64)
    if isinstance(bias, FixedBias):
        return offset + bias.reverse_bias_v
    if isinstance(bias, DacBias):
        codes = np.floor((bias.reference_v + offset - bias.target_v) / bias.step_v)
        if np.any((codes < 0) | (codes >= 2**bias.bits)):
            raise ValueError(
                f"offset_v: {offset.tolist()} V cannot be compensated between 0 and "
                f"{bias.rail_v:g} V around reference_v {bias.reference_v:g} V; choose another "
                "reference"
            )
        return np.asarray(bias.reference_v + offset - codes * bias.step_v)
    above = offset + bias.erased_v - bias.target_v
    trimmed = bias.target_v + np.where(above < 0, above, np.mod(above, bias.step_v))
    return np.asarray(trimmed + (bias.leak_v_s * bias.age_s + bias.drift_v_k * bias.warming_k))


def drift_rate(bias: Bias) -> float:
    """Rise of the reverse bias during an exposure, V/s."""
    return bias.leak_v_s if isinstance(bias, FloatingGateBias) else 0.0
