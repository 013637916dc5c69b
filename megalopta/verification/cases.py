"""The table of what `megalopta check physics` compares, group by group.

A case is a sensor in some light. Its readings are drawn as a user draws them, by the public
functions of `megalopta.sensor`, and once more by `brute_force`: mean, variance and law must agree,
at every light level, as must the share of readings that are flagged. What is drawn is held against
the mean and variance that the sensor states, too. What needs no simulation is in `theory`.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from itertools import product
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Literal

import numpy as np

from megalopta.core.arrays import Floats
from megalopta.sensor import (
    PRESETS,
    Afterpulsing,
    AnalogCounter,
    Crosstalk,
    DarkCounts,
    DeadTime,
    DigitalCounter,
    Efficiency,
    Gate,
    Sensor,
    changed,
    detection_rate,
    expose,
    expose_adc,
    expose_binary,
    expose_events,
    expose_rate,
    generator,
    preset,
    reading_moments,
)
from megalopta.sensor.sampling.bits import unpack
from megalopta.verification import GROUPS
from megalopta.verification.brute_force import (
    brute_force_events,
    plain_light_hz,
    plain_pixels,
    plain_readings,
)
from megalopta.verification.comparison import (
    Check,
    Row,
    Sample,
    mean_row,
    sample_rows,
    worst,
)
from megalopta.verification.theory import THEORY

Levels = tuple[float, ...]
Readout = Literal["counts", "bits", "stream", "times", "codes", "running"]

_BAND_NM = (440.0, 460.0)
_TAU_S, _BINS, _RUN = 5e-3, 10, 3
_FULL = (1.0, 12.0, 60.0)
"""Arrivals in an exposure of 20 dead times: from nearly Poisson to nearly always blind"""
_UNEVEN = (8.0, 3.0, 0.5, 10.0, 20.0, 5.0)
"""Arrivals in the pixels of an array of 2 × 3"""


@dataclass(frozen=True)
class Case:
    """One row of the table."""

    term: str
    sensor: Sensor
    arrivals: Any = _FULL
    """Photons in an exposure that a sensor always live detects, at each light level; or those of
    each of so many equal parts of the exposure"""
    layout: tuple[int, int] | None = None
    """The levels are the pixels of such an array (rows, columns), and frames are what is
    independent; without it pixels are"""
    readout: Readout = "counts"
    """How they are drawn, of `_READ`"""
    samples: int = 20_000
    is_stated: bool = True
    """Whether the sensor's own mean and variance are held against the readings"""
    maps: Mapping[str, Levels] = field(default_factory=dict)
    """Measured maps (arrays as flat as `arrivals`) of an array"""
    by_radiance: bool = False
    """Whether the light comes through the lens"""

    @property
    def light(self) -> Floats:
        """Arrivals of all parts and levels, (S, levels)."""
        return np.atleast_2d(np.array(self.arrivals, np.float64))

    @property
    def places(self) -> list[str]:
        """Name of each column of the readings."""
        totals = self.light.sum(0)
        names = [f"{each:g} arrivals" for each in totals]
        if self.readout == "times":
            return [f"{name}, time {bin + 1}" for bin, name in product(range(_BINS), names)]
        if self.readout == "running":
            return [f"{name}, frame {frame + 1}" for frame, name in product(range(_RUN), names)]
        return names


def check_case(case: Case) -> Row:
    """Draw the readings of a case and simulate them plainly; return the comparison farthest off."""
    with TemporaryDirectory() as folder:
        sensor = _measured(case, Path(folder))
        drawn, drawn_flags, moments = _draw(case, sensor)
    plain, plain_flags = _simulate(case)
    places = case.places
    rows = []
    for name, one, other in zip(places, plain.T, drawn.T, strict=True):
        rows += sample_rows(case.term, name, one, other)
    if case.layout:
        rows += sample_rows(case.term, "all pixels", plain.sum(1), drawn.sum(1))
    if drawn_flags is not None and sensor.counter.is_on:
        for name, one, other in zip(places, plain_flags.T, drawn_flags.T, strict=True):
            flagged = sample_rows(case.term, f"flagged, {name}", one + 0.0, other + 0.0)[0]
            rows.append(flagged)
    if moments is not None:
        for place, name in enumerate(places):
            rows += _stated(case.term, name, drawn[:, place], *(m[:, place] for m in moments))
    return worst(rows)


def check_table_2_1() -> Row:
    """Devices of the literature, in the dark and in light: dark counts and efficiency."""
    names = sorted(set(PRESETS) - {"ideal", "spadcam", "array-12x4"})
    light: dict[str, Any] = {"arrivals": (0.0, 30.0), "samples": 2_000, "by_radiance": True}
    rows = [check_case(Case(f"Table 2.1, {name}", PRESETS[name], **light)) for name in names]
    return worst(rows)


def _stated(term: str, name: str, drawn: Sample, mean: Floats, variance: Floats) -> list[Row]:
    """Compare readings with what is stated, to 0.1 % or 0.003 σ of the mean, 1 % of the variance.

    Each reading has a mean and variance of its own where pixels differ.
    """
    due, spread = float(mean.mean()), float(variance.mean())
    allowed = max(1e-3 * due, 3e-3 * spread**0.5)
    return [
        mean_row(term, f"stated mean, {name}", due, drawn - mean + due, allowed),
        mean_row(term, f"stated variance, {name}", spread, (drawn - mean) ** 2, 0.01 * spread),
    ]


def _measured(case: Case, folder: Path) -> Sensor:
    if not case.maps:
        return case.sensor
    files = {name: folder / f"{name}.npy" for name in case.maps}
    for name, values in case.maps.items():
        np.save(files[name], np.reshape(values, case.layout))
    return changed(case.sensor, measured={name: str(path) for name, path in files.items()})


def _draw(case: Case, sensor: Sensor) -> tuple[Sample, Sample | None, Any]:
    """Return readings and flags (samples, places), and moments (samples or 1, places) if stated."""
    rates = case.light * len(case.light) / sensor.exposure_s
    if case.layout:
        light = np.tile(rates.reshape(1, -1, *case.layout), (case.samples, 1, 1, 1))
    else:
        light = np.tile(rates[None, :, None], (1, 1, case.samples, 1))
    light = light[:, 0] if len(rates) == 1 else light
    if case.by_radiance:
        light = light / plain_light_hz(1.0, _BAND_NM, sensor)
    drawn, flags = _READ[case.readout](case, light, sensor)
    moments = None
    if case.is_stated:
        few = light[:1] if case.layout or _differ(sensor) else light[..., :1, :]
        seen = detection_rate(few[..., None], [_BAND_NM], sensor) if case.by_radiance else few
        stated = reading_moments(seen, sensor)
        moments = [each.reshape(-1, len(case.places)) for each in stated]
    return drawn, flags, moments


def _differ(sensor: Sensor) -> bool:
    """Whether its pixels are drawn."""
    dark, names = sensor.dark_counts, ("dead_time", "afterpulsing", "crosstalk")
    analog = isinstance(sensor.counter, AnalogCounter) and (
        sensor.counter.step_sigma_v + sensor.counter.leak_sigma_v_s + sensor.counter.offset_sigma_v
    )
    mismatch = sum(getattr(sensor, name).mismatch_sigma for name in names)
    hot = 0 < dark.hot_fraction < 1 or dark.hot_sigma_hz_um2 > 0
    return bool(
        analog or mismatch or hot or dark.bulk_sigma_hz_um2 > 0 or sensor.bias.breakdown_sigma_v > 0
    )


def _key(case: Case) -> dict[str, Any]:
    return {"seed": 4, "sequence": case.term}


def _counts(case: Case, light: Floats, sensor: Sensor) -> tuple[Sample, Sample | None]:
    if case.by_radiance:
        exposure = expose(light[..., None], [_BAND_NM], sensor, **_key(case))
    else:
        exposure = expose_rate(light, sensor, **_key(case))
    readings = exposure.counts.astype(np.float64)
    return _columns(case, readings), _columns(case, exposure.saturated)


def _bits(case: Case, light: Floats, sensor: Sensor) -> tuple[Sample, Sample | None]:
    packed = expose_binary(light, sensor, **_key(case))
    return _columns(case, unpack(packed, light.shape[-1]).astype(np.float64)), None


def _stream(case: Case, light: Floats, sensor: Sensor) -> tuple[Sample, Sample | None]:
    counts = np.zeros((light.shape[0], *light.shape[-2:]))
    events = expose_events(light, sensor, **_key(case))
    np.add.at(counts, (events.frame, events.row, events.column), 1)
    return _columns(case, counts), None


def _times(case: Case, light: Floats, sensor: Sensor) -> tuple[Sample, Sample | None]:
    """Events in each tenth of the exposure."""
    counts = np.zeros((case.samples, _BINS, light.shape[-1]))
    events = expose_events(light, sensor, **_key(case))
    time = (events.time_s / sensor.exposure_s * _BINS).astype(np.int64)
    np.add.at(counts, (events.row, time, events.column), 1)
    return counts.reshape(case.samples, -1), None


def _codes(case: Case, light: Floats, sensor: Sensor) -> tuple[Sample, Sample | None]:
    """Codes of an ADC, turned into counts by the even pixels' steps."""
    counter = sensor.counter
    assert isinstance(counter, AnalogCounter) and counter.adc_bits is not None
    codes = _columns(case, expose_adc(light, sensor, **_key(case))).astype(np.float64)
    leaked_v = counter.leak_v_s * sensor.exposure_s
    volts = codes * counter.supply_v / (2**counter.adc_bits - 1)
    counts = np.rint((counter.supply_v - leaked_v - volts) / counter.step_v)
    largest = np.floor((counter.swing_v - leaked_v) / counter.step_v + 1e-9)
    return np.clip(counts, 0, largest), None


def _running(case: Case, light: Floats, sensor: Sensor) -> tuple[Sample, Sample | None]:
    """Counts of frames that follow on each other without a gap."""
    frames = np.tile(light, (_RUN, *(1 for _ in light.shape[1:])))
    counts = expose_rate(frames, sensor, free_running=True, **_key(case)).counts
    return counts.transpose(1, 0, 2).reshape(case.samples, -1).astype(np.float64), None


_READ: dict[Readout, Callable[[Case, Floats, Sensor], tuple[Sample, Sample | None]]] = {
    "counts": _counts,
    "bits": _bits,
    "stream": _stream,
    "times": _times,
    "codes": _codes,
    "running": _running,
}


def _columns(case: Case, readings: Sample) -> Sample:
    """Readings (frames, rows, columns) as (samples, places)."""
    return readings.reshape(case.samples, -1)


def _simulate(case: Case) -> tuple[Sample, Sample]:
    """Readings and flags, (samples, places), by brute force."""
    rng, sensor = generator(1, "brute force", case.term), case.sensor
    parts, levels = case.light.shape
    rates = case.light * parts / sensor.exposure_s
    shape = (case.samples, levels) if case.layout else (case.samples * levels, 1)
    maps = {name: np.tile(values, (case.samples, 1)) for name, values in case.maps.items()}
    pixels = plain_pixels(rng, sensor, shape, maps)._replace(layout=case.layout or (1, 1))
    light = np.tile(rates, (case.samples, 1, 1))  # (samples, parts, levels)
    if not case.layout:
        light = light.transpose(0, 2, 1).reshape(-1, parts, 1)
    if case.by_radiance:  # of which a radiance of 1 makes plain_light_hz
        light = light * pixels.efficiency[:, None]
    light = light + pixels.dark_hz[:, None]
    frames = {"times": _BINS, "running": _RUN}.get(case.readout, 1)
    exposure_s = sensor.exposure_s / (_BINS if case.readout == "times" else 1)
    events = brute_force_events(rng, light, exposure_s, sensor, pixels, frames)
    if not case.layout:
        events = events.reshape(case.samples, levels, frames).transpose(0, 2, 1)
    readings, flags = plain_readings(rng, events.reshape(case.samples, -1), sensor)
    return np.minimum(readings, 1) if case.readout == "bits" else readings, flags


def _ideal(**changes: Any) -> Sensor:
    return changed(preset("ideal"), **changes)


_ACTIVE = DeadTime(kind="nonparalyzable", dead_time_s=_TAU_S)
_PASSIVE = DeadTime(kind="paralyzable", dead_time_s=_TAU_S)
_TWILIGHT = changed(_ACTIVE, twilight_s=_TAU_S / 4)
_RECHARGING = changed(_ACTIVE, recharge_s=_TAU_S / 2)
_TRAPS = Afterpulsing(mean_carriers=0.3, delay_s=_TAU_S)
_TABLE = Afterpulsing(
    mean_carriers=0.3, table_delays_s=(0, 5e-3, 15e-3), table_cumulative=(0, 0.6, 1)
)
_TALK = Crosstalk(mean_fired_neighbors=0.3, diagonal=0.3, distance_two=0.1)
_GATE = Gate(period_s=17e-3, width_s=11e-3, phase_s=4e-3)
_SHUT = Gate(period_s=10e-3, width_s=2e-3, phase_s=1e-3)
"""Mostly closed: carriers come out while it is"""
_SPREAD = AnalogCounter(
    step_v=0.1,
    swing_v=1.6,
    adc_bits=7,
    **{"step_sigma_v": 5e-3, "leak_v_s": 0.5, "leak_sigma_v_s": 0.05, "offset_sigma_v": 0.05},
)
_BIAS = {
    **{"excess_v": 0.5, "reference_v": 0.6, "onset_v": 0.2, "efficiency_scale_v": 0.3},
    **{"dark_efold_v": 0.12, "breakdown_sigma_v": 0.08},
}
_HALF = Efficiency(wavelengths_nm=(400, 500), values=(0.4, 0.6))
_DEVICE = _ideal(efficiency=_HALF, bias=_BIAS, dark_counts=DarkCounts(bulk_mean_hz_um2=0.1))
_WARM = _ideal(
    dead_time=_ACTIVE,
    bias={"dark_efold_v": 0.2, "afterpulsing_slope": 2.0, "crosstalk_slope": 1.5},
    dark_counts=DarkCounts(bulk_mean_hz_um2=0.05),
    afterpulsing=Afterpulsing(mean_carriers=0.4, delay_s=_TAU_S),
    crosstalk=_TALK,
    temperature={"celsius": 32.0, "breakdown_v_per_k": 0.02},
)
_MAPS: dict[str, Levels] = {
    "dark_counts": (100.0, 20.0, 400.0, 50.0, 0.0, 200.0),
    "efficiency": (0.5, 1.0, 0.8, 0.6, 0.9, 0.7),
    "breakdown": (-0.08, 0.05, -0.02, 0.1, 0.0, -0.05),
}
_FACTORS: dict[str, Levels] = {
    "dead_time": (0.6, 0.8, 1.0, 1.2, 1.4, 0.7),
    "afterpulsing": (0.7, 1.3, 1.0, 0.5, 1.5, 0.9),
    "crosstalk": (0.2, 1.8, 1.0, 0.5, 1.5, 0.1),
}


def _array(term: str, **changes: Any) -> Case:
    extra = {"samples": 5_000} | {
        name: changes.pop(name) for name in ("maps", "is_stated", "samples") if name in changes
    }
    return Case(term, _ideal(**changes), _UNEVEN, (2, 3), **extra)


CASES: dict[str, tuple[Case, ...]] = {
    "counting": (
        Case("no dead time", _ideal(), (0.05, 3.0, 400.0)),
        Case("non-paralyzable", _ideal(dead_time=_ACTIVE)),
        Case("paralyzable", _ideal(dead_time=_PASSIVE)),
        *(
            Case(
                f"{name}, running",
                _ideal(dead_time=changed(dead, start="stationary")),
                samples=10_000,
            )
            for name, dead in (("non-paralyzable", _ACTIVE), ("paralyzable", _PASSIVE))
        ),
    ),
    "device": (
        Case(
            "dark counts, ordinary and hot",
            _ideal(
                dark_counts=DarkCounts(
                    **{"bulk_mean_hz_um2": 0.02, "bulk_sigma_hz_um2": 0.02, "hot_fraction": 0.2},
                    **{"hot_mean_hz_um2": 0.2, "hot_sigma_hz_um2": 0.1},
                )
            ),
            (0.0, 10.0),
        ),
        Case("bias and breakdown, drawn", _DEVICE, (0.0, 60.0), by_radiance=True),
        Case(
            "bias and breakdown, measured",
            _DEVICE,
            _UNEVEN,
            (2, 3),
            samples=6_000,
            maps=_MAPS,
            by_radiance=True,
        ),
        Case("warm chip", _WARM, _UNEVEN, (2, 3), samples=6_000, is_stated=False),
        Case("SPADCAM", preset("spadcam"), (0.0, 30.0, 300.0), samples=10_000, by_radiance=True),
    ),
    "dead-time": (
        Case("twilight pulses", _ideal(dead_time=_TWILIGHT), is_stated=False),
        Case("recharging", _ideal(dead_time=_RECHARGING)),
        Case("paralyzable, mismatch", _ideal(dead_time=changed(_PASSIVE, mismatch_sigma=0.3))),
    ),
    "afterpulsing": (
        Case("afterpulsing", _ideal(afterpulsing=_TRAPS)),
        Case(
            "afterpulsing, running",
            _ideal(afterpulsing=_TRAPS, dead_time={"start": "stationary"}),
        ),
        Case("afterpulsing, table", _ideal(afterpulsing=_TABLE), is_stated=False),
        Case("afterpulsing, non-paralyzable", _ideal(afterpulsing=_TRAPS, dead_time=_ACTIVE)),
        Case(
            "many carriers, paralyzable",
            _ideal(afterpulsing=changed(_TRAPS, mean_carriers=0.9), dead_time=_PASSIVE),
            is_stated=False,
        ),
        Case(
            "afterpulsing of dark counts, mismatch",
            _ideal(
                afterpulsing=changed(_TRAPS, mismatch_sigma=0.2),
                dead_time=_ACTIVE,
                dark_counts=DarkCounts(bulk_mean_hz_um2=0.03),
            ),
            (0.0, 5.0),
            is_stated=False,
        ),
    ),
    "crosstalk": (
        _array("crosstalk", crosstalk=_TALK, samples=2_500),
        _array("crosstalk, non-paralyzable", crosstalk=_TALK, dead_time=_ACTIVE),
        _array("crosstalk, paralyzable", crosstalk=_TALK, dead_time=_PASSIVE),
    ),
    "combinations": (
        _array(
            "non-paralyzable, afterpulsing, crosstalk, maps",
            **{"dead_time": _ACTIVE, "afterpulsing": _TRAPS, "crosstalk": _TALK},
            maps=_FACTORS,
            is_stated=False,
        ),
        *(
            _array(
                f"{name}, afterpulsing, gate, crosstalk",
                **{"dead_time": dead, "afterpulsing": _TRAPS, "gate": _GATE, "crosstalk": _TALK},
                is_stated=False,
            )
            for name, dead in (
                ("paralyzable", _PASSIVE),
                ("twilight pulses", _TWILIGHT),
            )
        ),
    ),
    "gate": (
        Case("gate", _ideal(gate=_GATE)),
        Case("gate, paralyzable", _ideal(gate=_GATE, dead_time=_PASSIVE)),
        Case(
            "gate, carriers released while it is closed",
            _ideal(gate=_SHUT, afterpulsing=changed(_TRAPS, mean_carriers=0.8)),
            is_stated=False,
        ),
        Case(
            "times of events, gate, afterpulsing",
            _ideal(gate=_SHUT, afterpulsing=_TRAPS, dead_time=_ACTIVE),
            (1.0, 60.0),
            readout="times",
            is_stated=False,
        ),
        Case("binary frames, gate", _ideal(gate=_GATE), readout="bits", is_stated=False),
    ),
    "changing-light": (
        Case("light in parts, gate", _ideal(gate=_GATE), ((2.0, 9.0), (0.5, 40.0), (0.0, 3.0))),
        *(
            Case(
                f"light in parts, {dead.kind}",
                _ideal(dead_time=dead),
                ((1.0, 12.0), (0.3, 40.0), (2.0, 3.0)),
                is_stated=False,
            )
            for dead in (_ACTIVE, _PASSIVE)
        ),
        Case(
            "frames without a gap",
            _ideal(afterpulsing=_TRAPS, dead_time=_PASSIVE, exposure_s=0.02),
            (2.0, 10.0),
            readout="running",
            is_stated=False,
        ),
    ),
    "counters": (
        Case("counter that saturates", _ideal(counter=DigitalCounter(capacity=15)), (3.0, 14.0)),
        Case(
            "counter that wraps",
            _ideal(counter=DigitalCounter(capacity=15, overflow="wrap")),
            (3.0, 14.0, 120.0),
        ),
        Case(
            "analog, steps that shrink and err, read noise",
            _ideal(
                counter=AnalogCounter(
                    **{"step_v": 0.1, "swing_v": 1.6, "step_slope": 0.5, "leak_v_s": 1.0},
                    **{"step_noise_v": 0.011, "read_noise_v": 0.04},
                )
            ),
            (3.0, 12.0, 40.0),
        ),
        Case("analog, uneven, calibrated", _ideal(counter=_SPREAD), (3.0, 14.0)),
        Case(
            "analog, uneven, uncalibrated",
            _ideal(counter=changed(_SPREAD, calibrated=False), dead_time=_ACTIVE),
            (3.0, 14.0),
        ),
        Case(
            "codes of an ADC",
            _ideal(counter=AnalogCounter(step_v=0.05, swing_v=2.0, leak_v_s=2.0, adc_bits=6)),
            (3.0, 30.0),
            readout="codes",
        ),
    ),
    "frames": (
        Case("binary frames", _ideal(), (0.01, 0.3, 3.0), readout="bits", is_stated=False),
        Case(
            "histogram of events",
            _ideal(dead_time=_PASSIVE, dark_counts=DarkCounts(bulk_mean_hz_um2=0.01)),
            readout="stream",
        ),
    ),
}

CHECKS: dict[str, tuple[Check, ...]] = {
    group: (
        *(partial(check_case, case) for case in CASES.get(group, ())),
        *((check_table_2_1,) if group == "device" else ()),
        *THEORY.get(group, ()),
    )
    for group in GROUPS
}
