"""What is known without simulating avalanches: light on the die, time stamps, CTIA pixels.

Light is an integral over the exit pupil of the lens. The equation of a CTIA pixel is written out
again and left to SciPy; its noise is held against statements that do not come from the model:
electrons that arrive one by one are Poisson, a conductor in equilibrium has the noise of Nyquist,
4·k·T·g, and a capacitor holds k·T/2. Corrected frames are held against the light that made them.
"""

from functools import partial
from typing import Any

import numpy as np
from scipy.constants import e, k
from scipy.integrate import solve_ivp

from megalopta.core.arrays import Floats
from megalopta.sensor import (
    CTIA_PRESETS,
    CtiaNoise,
    CtiaSensor,
    DeadTime,
    DigitalCounter,
    Efficiency,
    FixedBias,
    FloatingGateBias,
    Gate,
    Jitter,
    Lens,
    Photodiode,
    Sensor,
    changed,
    detection_rate,
    expose_events,
    expose_photocurrent,
    expose_rate,
    preset,
    reading_moments,
    volt_moments,
)
from megalopta.sensor.calibrate.correction import correct, simulated_calibration
from megalopta.sensor.optics.lens import Transmission
from megalopta.verification.brute_force import plain_light_hz, seen_pupil
from megalopta.verification.comparison import (
    Check,
    Row,
    Sample,
    exact_row,
    largest_row,
    mean_row,
    variance_row,
    worst,
)

_SEED: dict[str, Any] = {"seed": 4, "sequence": "theory"}
_CURVE = Efficiency(wavelengths_nm=(400, 550, 700), values=(0.1, 0.4, 0.2))
_FILTER = Transmission(wavelengths_nm=(350, 500, 750), values=(0.2, 0.9, 0.5))
_NO_NOISE = CtiaNoise(photon_shot=False, dark_shot=False, reset=False)
_JUNCTION = Photodiode(saturation_current_a=100e-12, temperature_k=300.0)
_SHUNT_OHM = 588.6e3
_ARRAY = (1, 300, 300)


def _optics(**lens: Any) -> Sensor:
    """Sensor of 10 µm pixels, half of them sensitive."""
    return changed(
        preset("ideal"), pitch_m=10e-6, fill_factor=0.5, lens=Lens(**lens), efficiency=_CURVE
    )


def check_lens() -> Row:
    """Detections on the axis through fast, slow and colored lenses."""
    expected, measured = [], []
    for lens in (
        {"f_number": 0.95, "transmission": 0.9},
        {"f_number": 5.6},
        {"f_number": 2.0, "transmission": 0.8, "transmission_curve": _FILTER},
    ):
        sensor = _optics(**lens)
        expected.append(plain_light_hz(1e-6, (400, 700), sensor))
        light = detection_rate(np.full((1, 1, 1, 1), 1e-6), [(400, 700)], sensor)
        measured.append(float(light.item()))
    return largest_row("lens and efficiency", "detections (Hz)", expected, measured, 1e-6)


def check_falloff() -> Row:
    """Light at the edges of an image of 9 × 5 pixels relative to its middle."""
    f_number, fov_deg, rows, columns = 100.0, 80.0, 5, 9
    sensor = _optics(f_number=f_number, falloff_fov_deg=fov_deg)
    image = detection_rate(np.ones((1, rows, columns, 1)), [(400, 700)], sensor)[0]
    pixel = 2 * np.tan(np.radians(fov_deg / 2)) / columns
    places = [(2, 8), (0, 4), (4, 0)]
    due = [seen_pupil(f_number, (x - 4) * pixel, (y - 2) * pixel) for y, x in places]
    found = [image[place] / image[2, 4] for place in places]
    # a pupil of f/100 is wide enough to differ from a point by some 1e-4
    expected = np.array(due) / seen_pupil(f_number)
    return largest_row("cos⁴ falloff", "over the middle", expected, found, 5e-4)


def check_blur() -> Row:
    """A point and a grating through a lens that blurs by so many pixels."""
    point = np.zeros((1, 81, 81, 1))
    point[:, 40, 40] = 1.0
    places = np.arange(81) - 40.0
    grating = 1 + np.cos(2 * np.pi * np.arange(96) / 16) * np.ones((1, 3, 96))
    expected, measured = [], []
    for blur_px in (1.0, 3.0):
        sensor = _optics(f_number=4.0, blur_m=blur_px * 10e-6)
        spot = detection_rate(point, [(400, 700)], sensor)[0]
        bars = detection_rate(grating[..., None], [(400, 700)], sensor)[0, 1, 32:64]
        expected += [blur_px**2, np.exp(-2 * (np.pi * blur_px / 16) ** 2)]
        measured += [places**2 @ spot.sum(1) / spot.sum(), np.ptp(bars) / (bars.max() + bars.min())]
    # tails end at four standard deviations, with a thousandth of the variance
    return largest_row("blur", "variance (px²) or contrast", expected, measured, 2e-3)


def check_jitter() -> Row:
    """Time stamps of events in one window of the gate."""
    opens, width, sigma = 30e-3, 20e-3, 4e-3
    gate = Gate(period_s=0.1, width_s=width, phase_s=opens)
    sensor = changed(preset("ideal"), gate=gate, jitter=Jitter(sigma_s=sigma))
    events = expose_events(np.full((1, 100, 100), 300.0), sensor, **_SEED)
    stamps_ms = 1e3 * events.time_s
    variance = 1e6 * (width**2 / 12 + sigma**2)
    term = "time stamps, gate and jitter"
    return worst(
        [
            mean_row(term, "mean (ms)", 1e3 * (opens + width / 2), stamps_ms),
            variance_row(term, "variance (ms²)", variance, stamps_ms),
        ]
    )


def _ctia(diode: Photodiode, **changes: Any) -> CtiaSensor:
    """An array of even pixels without noise behind a nearly perfect amplifier."""
    sensor = CtiaSensor(
        name="check",
        pitch_m=1e-4,
        exposure_s=0.1,
        efficiency=_CURVE,
        diode=diode,
        gain_db=200.0,
        noise=_NO_NOISE,
    )
    return changed(sensor, **changes)


def check_discharge() -> Row:
    """Output after an exposure: straight, bent by a poor amplifier, forward, held at its rail."""
    both = changed(_JUNCTION, shunt_ohm=_SHUNT_OHM)
    expected, measured = [], []
    for sensor, light_a in (
        (_ctia(_JUNCTION, offset_v=5e-3, exposure_s=0.5, gain_db=130.0), 1e-11),
        (_ctia(_JUNCTION, offset_v=1e-3, capacitance_f=1e-13, exposure_s=8e-3, gain_db=40.0), 0.0),
        (_ctia(both, offset_v=1e-3, exposure_s=1e-3, gain_db=40.0), 1e-12),
        (_ctia(changed(_JUNCTION, shunt_ohm=1e9), offset_v=-10e-3), 1e-10),
        (_ctia(_JUNCTION, bias=FixedBias(reverse_bias_v=0.1)), 1e-9),
    ):
        assert isinstance(sensor.bias, FixedBias)
        expected.append(_integrated(sensor, sensor.offset_v + sensor.bias.reverse_bias_v, light_a))
        measured.append(volt_moments(np.full((1, 1, 1), light_a), sensor)[0].item())
    return largest_row("CTIA discharge", "output (V)", expected, measured, 1e-5)


def check_gate_leak() -> Row:
    """Frames as the gate leaks: the hundredth starts from a bias that has drifted."""
    offset, step, leak = 18.7e-3, 0.5e-3, 1e-3
    shunt = Photodiode(shunt_ohm=1e9)
    sensor = _ctia(shunt, bias=FloatingGateBias(leak_v_s=leak), offset_v=offset)
    while offset >= step:  # pulses as long as the bias stays positive
        offset -= step
    frames = volt_moments(np.zeros((100, 1, 1)), sensor)[0].ravel()
    expected = [
        _integrated(sensor, offset + leak * frame * sensor.exposure_s, 0.0, leak)
        for frame in (0, 99)
    ]
    return largest_row("CTIA gate leak", "output (V)", expected, frames[[0, 99]], 1e-5)


def _integrated(sensor: CtiaSensor, start_v: float, light_a: float, drift_v_s: float = 0) -> float:
    diode, gain = sensor.diode, 10 ** (sensor.gain_db / 20)
    thermal_v = diode.ideality * k * diode.temperature_k / e
    conductance = 0.0 if diode.shunt_ohm is None else 1 / diode.shunt_ohm

    def slope(time_s: float, volts: Floats) -> Floats:
        bias = start_v + drift_v_s * time_s + volts / gain
        dark = -diode.saturation_current_a * np.expm1(-bias / thermal_v) + conductance * bias
        # the upper rail holds an output that a forward current drives against it
        return np.maximum(light_a + dark, 0.0) / sensor.capacitance_f

    span = (0, sensor.exposure_s)
    solution = solve_ivp(slope, span, [0.0], "DOP853", rtol=1e-11, atol=1e-12)
    return float(min(solution.y[0, -1], sensor.swing_v))


def check_ctia_noise() -> Row:
    """Electrons read, each kind of noise alone, drawn and stated."""
    light_a, time_s, farad, kelvin = 1e-13, 0.1, 10e-12, 300.0
    photons, dark = light_a * time_s / e, 100e-12 * time_s / e
    conductance = 100e-12 * e / (k * kelvin) + 1 / _SHUNT_OHM
    nyquist = 2 * k * kelvin * conductance * time_s / e**2
    thermal = changed(_JUNCTION, shunt_ohm=_SHUNT_OHM)
    none = Photodiode(temperature_k=kelvin)
    rows: list[Row] = []
    for name, diode, bias_v, light, noise, mean, variance in (
        ("photon", none, 0.0, light_a, {"photon_shot": True}, photons, photons),
        ("thermal", thermal, 0.0, 0.0, {"dark_shot": True}, 0.0, nyquist),
        ("dark", _JUNCTION, 1.0, 0.0, {"dark_shot": True}, dark, dark),
        ("reset", none, 0.0, 0.0, {"reset": True}, 0.0, k * kelvin * farad / e**2),
        ("read", none, 0.0, 0.0, {"read_noise_v": 1e-4}, 0.0, (1e-4 * farad / e) ** 2),
    ):
        bias = FixedBias(reverse_bias_v=bias_v)
        sensor = _ctia(diode, bias=bias, noise=changed(_NO_NOISE, **noise))
        current = np.full(_ARRAY, light)
        drawn = expose_photocurrent(current, sensor, **_SEED).volts * farad / e
        stated = volt_moments(current[:, :1, :1], sensor)[1].item() * (farad / e) ** 2
        rows += [
            mean_row("CTIA noise", f"electrons, {name}", mean, drawn),
            variance_row("CTIA noise", f"variance (electrons²), {name}", variance, drawn),
            exact_row("CTIA noise", f"stated, {name}", variance, stated, 1e-4 * variance),
        ]
    return worst(rows)


def check_ctia_pattern() -> Row:
    """Offsets, gains and dark currents of an array, found in its readings without noise."""
    shunt, time_s = Photodiode(shunt_ohm=1e9), 0.1
    dark = np.zeros(_ARRAY)
    offsets = _ctia(shunt, offset_v=50e-3, offset_sigma_v=10e-3)
    bias_v = volt_moments(dark, offsets)[0] * 1e9 * offsets.capacitance_f / time_s
    uneven = _ctia(_JUNCTION, dark_sigma=0.3, bias=FixedBias(reverse_bias_v=1.0))
    factor = volt_moments(dark, uneven)[0] * uneven.capacitance_f / (100e-12 * time_s)
    poor = _ctia(shunt, offset_v=1e-3, gain_db=30.0, gain_sigma_db=2.0)
    decibels = np.linspace(15, 45, 3001)
    gains = 10 ** (decibels / 20)
    rise = (
        gains * 1e-3 * np.expm1(time_s / (gains * 1e9 * poor.capacitance_f))
    )  # a shunt on a poor amplifier
    gain_db = np.interp(volt_moments(dark, poor)[0], rise[::-1], decibels[::-1])
    rows: list[Row] = []
    for name, mean, sigma, found in (
        ("offset (mV)", 50.0, 10.0, 1e3 * bias_v),
        ("dark current", 1.0, 0.3, factor),
        ("gain (dB)", 30.0, 2.0, gain_db),
    ):
        rows += [
            mean_row("CTIA pixels", f"mean {name}", mean, found),
            variance_row("CTIA pixels", f"variance, {name}", sigma**2, found),
        ]
    return worst(rows)


def check_ctia_preset(name: str) -> Row:
    """Readings of a preset, at a third of its swing, against what it states."""
    sensor = CTIA_PRESETS[name]
    light = np.full((2, 150, 150), 0.3 * sensor.swing_v * sensor.capacitance_f / sensor.exposure_s)
    volts = expose_photocurrent(light, sensor, first_frame=9, **_SEED).volts
    return _as_stated(name, "V", volts, volt_moments(light, sensor, first_frame=9), (0, 0))


def check_spad_preset(name: str) -> Row:
    """Frames of a preset, of which neighbors count together, against what it states."""
    sensor = preset(name)
    rate = np.full((3000, 4, 12), 40 / sensor.exposure_s)
    counts = expose_rate(rate, sensor, **_SEED).counts
    return _as_stated(name, "counts", counts, reading_moments(rate[:1], sensor), (1e-3, 1e-2))


def _as_stated(
    term: str, unit: str, drawn: Sample, moments: tuple[Floats, Floats], errors: tuple[float, float]
) -> Row:
    """Compare readings with their own mean and variance, which may be off by so much, relative."""
    due, spread = (float(each.mean()) for each in moments)
    off = drawn - moments[0]
    # of many frames in which pixels may go together, frames are what is independent
    each, squares = (x.mean((1, 2)) if len(x) > 2 else x for x in (off, off**2))
    return worst(
        [
            mean_row(term, f"stated mean ({unit})", due, each + due, errors[0] * due),
            mean_row(term, f"stated variance ({unit}²)", spread, squares, errors[1] * spread),
        ]
    )


def check_correction(name: str, sensor: Sensor) -> Row:
    """Corrected frames against their light, and their scatter against what is stated."""
    shape, frames = (16, 16), 400
    calibration = simulated_calibration(sensor, shape, frames=1600)
    curve = calibration.curve
    brightest = float(curve.arrivals_of(np.array([0.7 * curve.largest]))[0][0])
    light = np.broadcast_to(brightest * np.linspace(0.4, 1, shape[1]), shape)
    alike = changed(sensor, bias={"breakdown_sigma_v": 0.0})
    even = detection_rate(np.ones((1, *shape, 1)), [(440, 460)], sensor)[0]
    # what pixels detect of even light, by which `correct` divides
    factor = even / detection_rate(np.ones((1, *shape, 1)), [(440, 460)], alike)[0]
    rate = np.broadcast_to(light * factor / sensor.exposure_s, (frames, *shape))
    exposure = expose_rate(rate, sensor, **_SEED)
    found = correct(exposure.counts, exposure.saturated, calibration)
    good = ~found.filled.any(0)
    ratio = found.detections.mean(0)[good].sum() / light[good].sum()
    known = calibration.dark_variance + light**2 * calibration.gain_variance
    own = found.variance.mean(0) - known / calibration.gain**2
    drawn = found.detections.var(0)[good].sum() / own[good].sum()
    term = f"corrected frames, {name}"
    return worst(
        [
            exact_row(term, "mean over the light", 1, ratio, 0.005),
            exact_row(term, "drawn variance over stated", 1, drawn, 0.05),
        ]
    )


def _corrected(kind: str, **counter: Any) -> Sensor:
    dead = DeadTime.model_validate({"kind": kind, "dead_time_s": 1e-3})
    return changed(preset("ideal"), dead_time=dead, **counter)


THEORY: dict[str, tuple[Check, ...]] = {
    "light": (check_lens, check_falloff, check_blur),
    "gate": (check_jitter,),
    "ctia": (
        check_discharge,
        check_ctia_noise,
        check_ctia_pattern,
        check_gate_leak,
    ),
    "readings": (
        partial(check_spad_preset, "array-12x4"),
        *(partial(check_ctia_preset, name) for name in CTIA_PRESETS),
    ),
    "correction": (
        partial(check_correction, "SPADCAM", preset("spadcam")),
        partial(
            check_correction,
            "non-paralyzable",
            _corrected("nonparalyzable", counter=DigitalCounter(capacity=90)),
        ),
        partial(check_correction, "paralyzable", _corrected("paralyzable")),
    ),
}
"""Checks by their group"""
