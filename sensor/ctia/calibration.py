"""Tuning the floating gate of a pixel: measure, pulse, measure.

The bias cannot be measured: a probe would leak more than the diode. So the dark current is, from
the time between 90 % and 10 % of the swing, and the gate gets a pulse as long as that lowers the
current by more than 1 %. The first pulse that takes the diode into forward bias stops the
discharge, until the leak of the gate has brought the bias back to zero; the discharge that follows
is as slow as this pixel can get, for the bias starts at zero and grows by the leak alone. That
floor is what limits a finely tuned pixel (§3.3.4), and it does not depend on the size of a pulse.
With a conductance g at zero bias, a leak r and a swing S it is

    0.8·S·C / (√1.8 − √0.2) / √(S·C/(g·r))

Source: dissertation §3.3.2 to §3.3.4. Measurements are free of noise here: over the minutes that
they take, the charge of a full swing is 10⁸ electrons.
"""

from dataclasses import dataclass, replace

import numpy as np

from megalopta.sensor.ctia.bias import FloatingGateBias, gate_bias
from megalopta.sensor.ctia.integration import LATE, Pixel, discharge_time, estimate_current

WORTHWHILE = 0.99


@dataclass(frozen=True)
class Measurement:
    """One turn of the loop.

    Attributes
    ----------
    elapsed_s : float
        At the end of the measurement, since the start of the calibration.
    pulses : int
        Given before it.
    bias_v : float
        Reverse bias at its start, which the loop does not know.
    current_a : float
        What it sees: the 90–10 % estimate; 0 where the pixel did not discharge in time.
    """

    elapsed_s: float
    pulses: int
    bias_v: float
    current_a: float


def calibrate(
    gate: FloatingGateBias, pixel: Pixel, *, patience_s: float = 3600.0, most_pulses: int = 1000
) -> list[Measurement]:
    """Pulse the gate until a further pulse no longer lowers the dark current.

    Parameters
    ----------
    gate : FloatingGateBias
    pixel : Pixel
        One pixel with its reverse bias before the calibration; its drift is set to the gate's leak.
    patience_s : float
        A discharge that takes longer is given up, and with it the calibration.
    most_pulses : int
        Ends a calibration that gets nowhere.

    Returns
    -------
    list of Measurement
        In order; the last one saw no improvement, the one before it is the result.

    Raises
    ------
    ValueError
        When the diode is in forward bias from the start, where pulses cannot help.
    """
    bias, elapsed = float(pixel.bias_v), 0.0
    if bias < 0:
        raise ValueError(f"bias_v: {bias:g} V is forward; pulses only lower it, start from reverse")
    log: list[Measurement] = []
    while len(log) <= most_pulses:
        now = replace(pixel, bias_v=bias, drift_v_s=gate.leak_v_s)
        taken = float(discharge_time(now, 0.0, LATE * pixel.swing_v))
        seen = taken <= patience_s
        duration = min(taken, patience_s)
        elapsed += duration
        log.append(
            Measurement(elapsed, len(log), bias, float(estimate_current(now)) if seen else 0.0)
        )
        if len(log) > 1 and not 0 < log[-1].current_a < WORTHWHILE * log[-2].current_a:
            return log
        bias = float(gate_bias(gate, bias, pulses=1, wait_s=duration + gate.pulse_s))
        elapsed += gate.pulse_s
    return log


def leak_floor(pixel: Pixel) -> float:
    """Smallest dark current that a drifting pixel can show between 90 % and 10 %, A.

    From the conductance at zero bias, for an amplifier of infinite gain.
    """
    charge = pixel.capacitance_f * pixel.swing_v
    conductance = pixel.diode.zero_bias_s * float(pixel.dark_scale)
    span = np.sqrt(2 * LATE) - np.sqrt(2 * (1 - LATE))
    return float((2 * LATE - 1) / span * np.sqrt(charge * conductance * pixel.drift_v_s))
