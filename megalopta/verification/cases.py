"""The table of cases of `megalopta check physics`, by group."""

from typing import Any

from megalopta.sensor import (
    CTIA_PRESETS,
    Afterpulsing,
    AnalogCounter,
    Crosstalk,
    CtiaNoise,
    CtiaSensor,
    DarkCounts,
    DeadTime,
    DigitalCounter,
    Efficiency,
    FixedBias,
    FloatingGateBias,
    Gate,
    Jitter,
    Lens,
    Photodiode,
    changed,
    preset,
)
from megalopta.sensor.optics.lens import Transmission
from megalopta.verification.comparison import Case

_TAU_S = 5e-3
_FULL = (1.0, 12.0, 60.0)
"""Arrivals in an exposure of 20 dead times: from nearly Poisson to nearly always dead"""
_UNEVEN = (8.0, 3.0, 0.5, 10.0, 20.0, 5.0)
"""Arrivals in the pixels of an array of 2 × 3"""


def _spad(term: str, light: Any = _FULL, **changes: Any) -> Case:
    """Return a case of an ideal sensor with changes; names of a case's fields go to the case."""
    own = {name: changes.pop(name) for name in Case.__annotations__ if name in changes}
    return Case(term, changed(preset("ideal"), **changes), light, **own)


def _array(term: str, **changes: Any) -> Case:
    return _spad(term, _UNEVEN, layout=(2, 3), samples=5_000, **changes)


def _ctia(term: str, light_a: Any, diode: Photodiode, **changes: Any) -> Case:
    even = {"pitch_m": 1e-4, "exposure_s": 0.1, "capacitance_f": 1e-12, "efficiency": _CURVE}
    silent = {"noise": CtiaNoise(photon_shot=False, dark_shot=False, reset=False)}
    sensor = CtiaSensor(name="check", diode=diode, **{**even, **silent, **changes})
    return Case(term, sensor, light_a, "volts")


_ACTIVE = DeadTime(kind="nonparalyzable", dead_time_s=_TAU_S)
_PASSIVE = DeadTime(kind="paralyzable", dead_time_s=_TAU_S)
_TWILIGHT = changed(_ACTIVE, twilight_s=_TAU_S / 4)
_TRAPS = Afterpulsing(mean_carriers=0.3, delay_s=_TAU_S)
_TABLE = Afterpulsing(
    mean_carriers=0.3, table_delays_s=(0, 5e-3, 15e-3), table_cumulative=(0, 0.6, 1)
)
_TALK = Crosstalk(mean_fired_neighbors=0.3, diagonal=0.3, distance_two=0.1)
_PAIRS = Crosstalk(
    mean_fired_neighbors=0.3,
    kernel=(
        (((0.0, 0.0, 0.0), (1.0, 0.0, 1.0), (0.5, 3.0, 0.5)),),
        (((0.0, 3.0, 0.0), (1.0, 0.0, 1.0), (0.0, 0.2, 0.0)),),
    ),
)
"""Rows in pairs"""
_GATE = Gate(period_s=17e-3, width_s=11e-3, phase_s=4e-3)
_SHUT = Gate(period_s=10e-3, width_s=2e-3, phase_s=1e-3)
"""Mostly closed: carriers are released meanwhile"""
_BENT = AnalogCounter(
    **{"step_v": 0.1, "swing_v": 1.6, "step_slope": 0.5, "leak_v_s": 1.0},
    **{"step_noise_v": 0.011, "read_noise_v": 0.04},
)
_SPREAD = AnalogCounter(
    **{"step_v": 0.1, "swing_v": 1.6, "adc_bits": 7, "step_sigma_v": 5e-3},
    **{"leak_v_s": 0.5, "leak_sigma_v_s": 0.05, "offset_sigma_v": 0.05},
)
_CURVE = Efficiency(wavelengths_nm=(400, 450, 700), values=(0.1, 0.4, 0.2))
_FILTER = Transmission(wavelengths_nm=(350, 445, 750), values=(0.2, 0.9, 0.5))
_HOT = DarkCounts(
    **{"bulk_mean_hz_um2": 0.02, "bulk_sigma_hz_um2": 0.02, "hot_fraction": 0.2},
    **{"hot_mean_hz_um2": 0.2, "hot_sigma_hz_um2": 0.1},
)
_DEVICE: dict[str, Any] = {
    "efficiency": Efficiency(wavelengths_nm=(400, 500), values=(0.4, 0.6)),
    "dark_counts": DarkCounts(bulk_mean_hz_um2=0.1),
    "bias": {
        **{"excess_v": 0.5, "reference_v": 0.6, "onset_v": 0.2, "efficiency_scale_v": 0.3},
        **{"dark_efold_v": 0.12, "breakdown_sigma_v": 0.08},
    },
}
_MAPS = {
    "dark_counts": (100.0, 20.0, 400.0, 50.0, 0.0, 200.0),
    "efficiency": (0.5, 1.0, 0.8, 0.6, 0.9, 0.7),
    "breakdown": (-0.08, 0.05, -0.02, 0.1, 0.0, -0.05),
}
_FACTORS = {
    "dead_time": (0.6, 0.8, 1.0, 1.2, 1.4, 0.7),
    "afterpulsing": (0.7, 1.3, 1.0, 0.5, 1.5, 0.9),
    "crosstalk": (0.2, 1.8, 1.0, 0.5, 1.5, 0.1),
}
_WARM: dict[str, Any] = {
    "dead_time": _ACTIVE,
    "bias": {"dark_efold_v": 0.2, "afterpulsing_slope": 2.0, "crosstalk_slope": 1.5},
    "dark_counts": DarkCounts(bulk_mean_hz_um2=0.05),
    "afterpulsing": changed(_TRAPS, mean_carriers=0.4),
    "crosstalk": _TALK,
    "temperature": {"celsius": 32.0, "breakdown_v_per_k": 0.02},
}
_JUNCTION = Photodiode(saturation_current_a=1e-13, shunt_ohm=5e11)
_PARTS = ((1.0, 12.0), (0.3, 40.0), (2.0, 3.0))

CASES: dict[str, tuple[Case, ...]] = {
    "counting": (
        _spad("no dead time", (0.05, 3.0, 400.0)),
        _spad("non-paralyzable", dead_time=_ACTIVE),
        _spad("paralyzable", dead_time=_PASSIVE),
        _spad("non-paralyzable, running", dead_time=changed(_ACTIVE, start="stationary")),
        _spad("paralyzable, running", dead_time=changed(_PASSIVE, start="stationary")),
    ),
    "light": (
        _spad(
            "lens, filter, efficiency",
            (30.0, 3000.0),
            **{"readout": "radiance", "pitch_m": 10e-6, "fill_factor": 0.5, "efficiency": _CURVE},
            lens=Lens(f_number=0.95, transmission=0.8, transmission_curve=_FILTER),
        ),
        _array("cos⁴ falloff", readout="radiance", lens=Lens(f_number=100.0, falloff_fov_deg=80.0)),
    ),
    "device": (
        _spad("dark counts, ordinary and hot", (0.0, 10.0), dark_counts=_HOT),
        _spad("bias and breakdown, drawn", (0.0, 60.0), readout="radiance", **_DEVICE),
        _array("bias and breakdown, measured", readout="radiance", maps=_MAPS, **_DEVICE),
        _array("warm chip", **_WARM),
        Case("SPADCAM", preset("spadcam"), (0.0, 30.0, 300.0), "radiance"),
    ),
    "dead-time": (
        _spad("twilight pulses", dead_time=_TWILIGHT),
        _spad("recharging", dead_time=changed(_ACTIVE, recharge_s=_TAU_S / 2)),
        _spad("paralyzable, mismatch", dead_time=changed(_PASSIVE, mismatch_sigma=0.3)),
    ),
    "afterpulsing": (
        _spad("afterpulsing", afterpulsing=_TRAPS),
        _spad("afterpulsing, running", afterpulsing=_TRAPS, dead_time={"start": "stationary"}),
        _spad("afterpulsing, table", afterpulsing=_TABLE),
        _spad("afterpulsing, non-paralyzable", afterpulsing=_TRAPS, dead_time=_ACTIVE),
        _spad(
            "many carriers, paralyzable",
            afterpulsing=changed(_TRAPS, mean_carriers=0.9),
            dead_time=_PASSIVE,
        ),
        _spad(
            "afterpulsing of dark counts, mismatch",
            (0.0, 5.0),
            afterpulsing=changed(_TRAPS, mismatch_sigma=0.2),
            dead_time=_ACTIVE,
            dark_counts=DarkCounts(bulk_mean_hz_um2=0.03),
        ),
    ),
    "crosstalk": (
        _array("crosstalk", crosstalk=_TALK),
        _array("crosstalk, non-paralyzable", crosstalk=_TALK, dead_time=_ACTIVE),
        _array("crosstalk, paralyzable", crosstalk=_TALK, dead_time=_PASSIVE),
        _array("crosstalk, pairs of rows", crosstalk=_PAIRS),
        _array("crosstalk, pairs of rows, non-paralyzable", crosstalk=_PAIRS, dead_time=_ACTIVE),
        _array("crosstalk, pairs of rows, paralyzable", crosstalk=_PAIRS, dead_time=_PASSIVE),
    ),
    "combinations": (
        _array(
            "non-paralyzable, afterpulsing, crosstalk, maps",
            **{"dead_time": _ACTIVE, "afterpulsing": _TRAPS, "crosstalk": _TALK},
            maps=_FACTORS,
        ),
        *(
            _array(
                f"{name}, afterpulsing, gate, crosstalk",
                **{"dead_time": dead, "afterpulsing": _TRAPS, "gate": _GATE, "crosstalk": _TALK},
            )
            for name, dead in (("paralyzable", _PASSIVE), ("twilight pulses", _TWILIGHT))
        ),
    ),
    "gate": (
        _spad("gate", gate=_GATE),
        _spad("gate, paralyzable", gate=_GATE, dead_time=_PASSIVE),
        _spad(
            "gate, carriers released while it is closed",
            gate=_SHUT,
            afterpulsing=changed(_TRAPS, mean_carriers=0.8),
        ),
    ),
    "changing-light": (
        _spad("light in parts, gate", ((2.0, 9.0), (0.5, 40.0), (0.0, 3.0)), gate=_GATE),
        _spad("light in parts, nonparalyzable", _PARTS, dead_time=_ACTIVE),
        _spad("light in parts, paralyzable", _PARTS, dead_time=_PASSIVE),
    ),
    "counters": (
        _spad("counter that saturates", (3.0, 14.0), counter=DigitalCounter(capacity=15)),
        _spad(
            "counter that wraps",
            (3.0, 14.0, 120.0),
            counter=DigitalCounter(capacity=15, overflow="wrap"),
        ),
        _spad("analog, nonlinear and noisy steps, read noise", (3.0, 12.0, 40.0), counter=_BENT),
        _spad("analog, uneven, calibrated", (3.0, 14.0), counter=_SPREAD),
        _spad(
            "analog, uneven, uncalibrated",
            (3.0, 14.0),
            counter=changed(_SPREAD, calibrated=False),
            dead_time=_ACTIVE,
        ),
        _spad(
            "codes of an ADC",
            (3.0, 30.0),
            counter=AnalogCounter(step_v=0.05, swing_v=2.0, leak_v_s=2.0, adc_bits=6),
            readout="codes",
        ),
    ),
    "frames": (
        _spad("binary frames", (0.01, 0.3, 3.0), readout="bits"),
        _spad("binary frames, gate", gate=_GATE, readout="bits"),
        _spad(
            "event times, gate, jitter, afterpulsing",
            (1.0, 60.0),
            **{"gate": _SHUT, "jitter": Jitter(sigma_s=4e-3), "readout": "times"},
            **{"afterpulsing": _TRAPS, "dead_time": _ACTIVE},
        ),
        _spad(
            "event times, gate, jitter with a tail",
            (1.0, 60.0),
            **{"gate": _SHUT, "readout": "times"},
            jitter=Jitter(sigma_s=1e-3, tail_share=0.3, tail_s=8e-3),
        ),
        _spad(
            "consecutive frames",
            (2.0, 10.0),
            **{"afterpulsing": _TRAPS, "dead_time": _PASSIVE, "exposure_s": 0.02},
            readout="running",
        ),
    ),
    "ctia": (
        _ctia("CTIA, electrons", (0.0, 2.5e-13), _JUNCTION, noise=CtiaNoise(reset=False)),
        _ctia(
            "CTIA, reset and readout",
            (0.0, 2.5e-13),
            Photodiode(),
            noise=CtiaNoise(photon_shot=False, read_noise_v=60e-6),
        ),
        _ctia(
            "CTIA, offsets and a leaking gate",
            (0.0, 2.5e-13),
            _JUNCTION,
            **{"offset_v": 18.7e-3, "offset_sigma_v": 1e-2},
            bias=FloatingGateBias(leak_v_s=1e-3),
        ),
        _ctia(
            "CTIA, poor amplifiers",
            (0.0, 1e-11),
            changed(_JUNCTION, saturation_current_a=1e-11, shunt_ohm=1e11),
            **{"gain_db": 30.0, "gain_sigma_db": 2.0, "dark_sigma": 0.3},
            bias=FixedBias(reverse_bias_v=0.01),
        ),
        *(Case(name, each, (0.0, 1e-10), "volts") for name, each in CTIA_PRESETS.items()),
    ),
}
