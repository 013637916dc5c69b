"""Every effect of a sensor against the plainest simulation (`plainest.py`).

Mean, variance and distribution of the readings agree at every light level, as does the share of
flagged ones, and draws have the mean and variance that the sensor states. Streams are fixed; a
correct change of the code draws other numbers. Each comparison then fails with a probability of at
most 6e-7 (|z| >= 5).
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.stats import chi2, norm

from megalopta import sensor as sensors

from . import plainest

LARGEST_Z = 5.0
BANDS_NM = (460.0, 480.0), (440.0, 460.0)  # the first is dark
TENTHS, CONSECUTIVE, CTIA_FRAME = 10, 3, 99
KEY = {"seed": 4, "stream": "physics"}
Sample = NDArray[Any]


@dataclass(frozen=True)
class Case:
    term: str
    sensor: Any
    light: Any
    """Photons per exposure detected by an always live sensor, at each level; or those of each of
    equal parts of the exposure; for a CTIA, photocurrents (A)"""
    read: Callable[..., tuple[Sample, Sample | None]]
    """Readings and their flags, of light and sensor"""
    layout: tuple[int, int] | None = None
    """Levels are the pixels of such an array, and frames are independent; without it pixels are"""
    samples: int = 20_000
    maps: Mapping[str, Any] = field(default_factory=dict)
    is_slow: bool = True

    @property
    def rates(self) -> Sample:
        """Light of all parts and levels, (S, levels): Hz, for a CTIA A."""
        light = np.atleast_2d(np.array(self.light, np.float64))
        return light if self.read is volts else light * len(light) / self.sensor.exposure_s


def counts(light, sensor):
    drawn = sensors.expose_rate(light, sensor, **KEY)
    return drawn.counts.astype(np.float64), drawn.saturated


def through_the_lens(light, sensor):
    drawn = sensors.expose(banded(light), BANDS_NM, sensor, **KEY)
    return drawn.counts.astype(np.float64), drawn.saturated


def bits(light, sensor):
    packed = sensors.expose_binary(light, sensor, **KEY)
    return np.unpackbits(packed, axis=-1, count=light.shape[-1]).astype(np.float64), None


def times(light, sensor):
    """Events in each tenth of the exposure."""
    events = sensors.expose_events(light, sensor, **KEY)
    counts = np.zeros((light.shape[-2], TENTHS, light.shape[-1]))
    time = np.clip(events.time_s / sensor.exposure_s * TENTHS, 0, TENTHS - 1).astype(np.int64)
    np.add.at(counts, (events.row, time, events.column), 1)
    return counts, None


def codes(light, sensor):
    """Codes of an ADC, converted to counts by the uniform pixels' steps."""
    counter = sensor.counter
    leaked_v = counter.leak_v_s * sensor.exposure_s
    output_v = (
        sensors.expose_adc(light, sensor, **KEY) * counter.supply_v / (2**counter.adc_bits - 1.0)
    )
    steps = np.rint((counter.supply_v - leaked_v - output_v) / counter.step_v)
    return np.clip(steps, 0, np.floor((counter.swing_v - leaked_v) / counter.step_v + 1e-9)), None


def running(light, sensor):
    """Counts of consecutive frames."""
    frames = np.tile(light, (CONSECUTIVE, 1, 1))
    drawn = sensors.expose_rate(frames, sensor, free_running=True, **KEY).counts
    return drawn.transpose(1, 0, 2).astype(np.float64), None


def volts(light, sensor):
    read = sensors.expose_photocurrent(light, sensor, first_frame=CTIA_FRAME, **KEY)
    return read.volts, read.saturated


def banded(light):
    return np.stack([0 * light, light], axis=-1)


# Effects and counters that several cases share; an exposure is 20 dead times.
ACTIVE = {"kind": "nonparalyzable", "dead_time_s": 5e-3}
PASSIVE = {"kind": "paralyzable", "dead_time_s": 5e-3}
TWILIGHT = {**ACTIVE, "twilight_s": 1.25e-3}
TRAPS = {"mean_carriers": 0.3, "delay_s": 5e-3}
TALK = {"mean_fired_neighbors": 0.3, "diagonal": 0.3, "distance_two": 0.1}
PAIRS_OF_ROWS = {
    "mean_fired_neighbors": 0.3,
    "kernel": [
        [[[0.0, 0.0, 0.0], [1.0, 0.0, 1.0], [0.5, 3.0, 0.5]]],
        [[[0.0, 3.0, 0.0], [1.0, 0.0, 1.0], [0.0, 0.2, 0.0]]],
    ],
}
GATE = {"period_s": 17e-3, "width_s": 11e-3, "phase_s": 4e-3}
SHUT = {"period_s": 10e-3, "width_s": 2e-3, "phase_s": 1e-3}  # carriers are released meanwhile
UNEVEN = {
    **{"kind": "analog", "step_v": 0.1, "swing_v": 1.6, "adc_bits": 7, "step_sigma_v": 5e-3},
    **{"leak_v_s": 0.5, "leak_sigma_v_s": 0.05, "offset_sigma_v": 0.05},
}
CURVE = {"wavelengths_nm": [400, 450, 700], "values": [0.1, 0.4, 0.2]}
BIASED = {
    "efficiency": {"wavelengths_nm": [400, 500], "values": [0.4, 0.6]},
    "dark_counts": {"bulk_mean_hz_um2": 0.1},
    "bias": {
        **{"excess_v": 0.5, "reference_v": 0.6, "onset_v": 0.2, "efficiency_scale_v": 0.3},
        **{"dark_efold_v": 0.12, "breakdown_sigma_v": 0.08},
    },
}
WARM = {
    "dead_time": ACTIVE,
    "bias": {"dark_efold_v": 0.2, "afterpulsing_slope": 2.0, "crosstalk_slope": 1.5},
    "dark_counts": {"bulk_mean_hz_um2": 0.05},
    "afterpulsing": {**TRAPS, "mean_carriers": 0.4},
    "crosstalk": TALK,
    "temperature": {"celsius": 32.0, "breakdown_v_per_k": 0.02},
}
LENS = {
    **{"f_number": 0.95, "transmission": 0.8},
    "transmission_curve": {"wavelengths_nm": [350, 445, 750], "values": [0.2, 0.9, 0.5]},
}
ELEMENT = {
    **{"kind": "ctia", "name": "check", "pitch_m": 1e-4, "exposure_s": 0.1, "efficiency": CURVE},
    **{"capacitance_f": 1e-12, "diode": {"saturation_current_a": 1e-13, "shunt_ohm": 5e11}},
    "noise": {"photon_shot": False, "dark_shot": False, "reset": False},
}
FROM_POISSON_TO_DEAD = (1.0, 12.0, 60.0)
FAINT = (0.8, 0.3, 0.05, 1.0, 2.0, 0.5)
PARTS = ((1.0, 12.0), (0.3, 40.0), (2.0, 3.0))


def case(term, light=FROM_POISSON_TO_DEAD, read=counts, preset="ideal", *, quick=False, **effects):
    maps = effects.pop("maps", {})
    return Case(term, sensors.changed(sensors.IMAGE_SENSORS[preset], **effects), light, read,
                maps=maps, is_slow=not quick)  # fmt: skip


def array(term, read=counts, uneven=(8.0, 3.0, 0.5, 10.0, 20.0, 5.0), **effects):
    """2 × 3 pixels in uneven light."""
    return replace(case(term, uneven, read, **effects), layout=(2, 3), samples=5000)


def ctia(term, light=(0.0, 2.5e-13), **changes):
    parts = {name: {**ELEMENT[name], **changes.pop(name, {})} for name in ("diode", "noise")}
    return Case(term, sensors.CtiaSensor.model_validate({**ELEMENT, **parts, **changes}), light, volts,
                is_slow=False)  # fmt: skip


CASES = (
    case("lens, filter, efficiency", (30.0, 3000.0), through_the_lens, pitch_m=10e-6,
         fill_factor=0.5, efficiency=CURVE, lens=LENS),
    array("cos⁴ falloff", through_the_lens,
          lens={"f_number": 100.0, "falloff_fov_deg": 80.0, "transmission": 1.0}),
    case("dark counts, ordinary and hot", (0.0, 10.0),
         dark_counts={"bulk_mean_hz_um2": 0.02, "bulk_sigma_hz_um2": 0.02, "hot_fraction": 0.2,
                      "hot_mean_hz_um2": 0.2, "hot_sigma_hz_um2": 0.1}),
    case("bias and breakdown, drawn", (0.0, 60.0), through_the_lens, **BIASED),
    array("bias and breakdown, measured", through_the_lens, **BIASED,
          maps={"dark_counts": [100.0, 20.0, 400.0, 50.0, 0.0, 200.0],
                "efficiency": [0.5, 1.0, 0.8, 0.6, 0.9, 0.7],
                "breakdown": [-0.08, 0.05, -0.02, 0.1, 0.0, -0.05]}),
    array("warm chip", **WARM),
    case("SPADCAM", (0.0, 30.0, 300.0), through_the_lens, preset="spadcam"),
    case("twilight pulses", dead_time=TWILIGHT),
    case("recharging", dead_time={**ACTIVE, "recharge_s": 2.5e-3}),
    case("paralyzable, mismatch", dead_time={**PASSIVE, "mismatch_sigma": 0.3}),
    case("afterpulsing", afterpulsing=TRAPS),
    case("afterpulsing, running", afterpulsing=TRAPS, dead_time={"start": "stationary"}),
    case("afterpulsing, table",
         afterpulsing={"mean_carriers": 0.3, "table_delays_s": [0, 5e-3, 15e-3],
                       "table_cumulative": [0, 0.6, 1]}),
    case("afterpulsing, non-paralyzable", afterpulsing=TRAPS, dead_time=ACTIVE),
    case("many carriers, paralyzable", afterpulsing={**TRAPS, "mean_carriers": 0.9},
         dead_time=PASSIVE),
    case("afterpulsing of dark counts, mismatch", (0.0, 5.0), dead_time=ACTIVE,
         afterpulsing={**TRAPS, "mismatch_sigma": 0.2}, dark_counts={"bulk_mean_hz_um2": 0.03}),
    array("crosstalk", crosstalk=TALK),
    array("crosstalk, non-paralyzable", crosstalk=TALK, dead_time=ACTIVE),
    array("crosstalk, paralyzable", crosstalk=TALK, dead_time=PASSIVE),
    array("crosstalk, pairs of rows", crosstalk=PAIRS_OF_ROWS),
    array("crosstalk, pairs of rows, non-paralyzable", crosstalk=PAIRS_OF_ROWS, dead_time=ACTIVE),
    array("crosstalk, pairs of rows, paralyzable", crosstalk=PAIRS_OF_ROWS, dead_time=PASSIVE),
    array("non-paralyzable, afterpulsing, crosstalk, maps", dead_time=ACTIVE, afterpulsing=TRAPS,
          crosstalk=TALK, maps={"dead_time": [0.6, 0.8, 1.0, 1.05, 0.9, 0.7],
                                "afterpulsing": [0.7, 1.3, 1.0, 0.5, 1.5, 0.9],
                                "crosstalk": [0.2, 1.8, 1.0, 0.5, 1.5, 0.1]}),
    array("paralyzable, afterpulsing, gate, crosstalk", dead_time=PASSIVE, afterpulsing=TRAPS,
          gate=GATE, crosstalk=TALK),
    array("twilight pulses, afterpulsing, gate, crosstalk", dead_time=TWILIGHT, afterpulsing=TRAPS,
          gate=GATE, crosstalk=TALK),
    case("gate", gate=GATE),
    case("gate, paralyzable", gate=GATE, dead_time=PASSIVE),
    case("gate, carriers released while it is closed", gate=SHUT,
         afterpulsing={**TRAPS, "mean_carriers": 0.8}),
    case("light in parts, gate", ((2.0, 9.0), (0.5, 40.0), (0.0, 3.0)), gate=GATE, quick=True),
    case("light in parts, nonparalyzable", PARTS, dead_time=ACTIVE, quick=True),
    case("light in parts, paralyzable", PARTS, dead_time=PASSIVE, quick=True),
    case("counter that saturates", (3.0, 14.0), counter={"capacity": 15}, quick=True),
    case("counter that wraps", (3.0, 14.0, 120.0), counter={"capacity": 15, "overflow": "wrap"},
         quick=True),
    case("analog, nonlinear and noisy steps, read noise", (3.0, 12.0, 40.0), quick=True,
         counter={"kind": "analog", "step_v": 0.1, "swing_v": 1.6, "step_slope": 0.5,
                  "leak_v_s": 1.0, "step_noise_v": 0.011, "read_noise_v": 0.04}),
    case("analog, uneven, calibrated", (3.0, 14.0), counter=UNEVEN, quick=True),
    case("analog, uneven, uncalibrated", (3.0, 14.0), counter={**UNEVEN, "calibrated": False},
         dead_time=ACTIVE, quick=True),
    case("codes of an ADC", (3.0, 30.0), codes, quick=True,
         counter={"kind": "analog", "step_v": 0.05, "swing_v": 2.0, "leak_v_s": 2.0,
                  "adc_bits": 6}),
    case("binary frames", (0.01, 0.3, 3.0), bits),
    case("binary frames, gate", read=bits, gate=GATE, quick=True),
    case("binary frames, running start, afterpulsing", (0.3, 30.0), bits, quick=True,
         dead_time={**PASSIVE, "start": "stationary"}, afterpulsing=TRAPS),
    array("binary frames, crosstalk", bits, crosstalk=TALK),
    array("binary frames, crosstalk, gate, dead time", bits, crosstalk=TALK, gate=GATE,
          dead_time=ACTIVE),
    array("counter of one event, pairs of rows", uneven=FAINT, crosstalk=PAIRS_OF_ROWS,
          counter={"capacity": 1}),
    array("counter of one event, dead time and afterpulses", uneven=FAINT, crosstalk=TALK, dead_time=ACTIVE,
          afterpulsing=TRAPS, counter={"capacity": 1}),
    case("sums of binary frames", (3.0, 20.0, 90.0), counter={"capacity": 1, "sums": 20}),
    case("sums of few bits, dead time, gate", (3.0, 20.0, 90.0), dead_time=ACTIVE,
         counter={"capacity": 3, "sums": 4}, gate={"period_s": 25e-3, "width_s": 11e-3}),
    case("sums of counts that wrap", (3.0, 20.0), quick=True,
         counter={"capacity": 3, "sums": 4, "overflow": "wrap"}),
    array("sums of binary frames, crosstalk", crosstalk=TALK, counter={"capacity": 1, "sums": 5}),
    case("event times, gate, jitter, afterpulsing", (1.0, 60.0), times, gate=SHUT,
         jitter={"sigma_s": 4e-3}, afterpulsing=TRAPS, dead_time=ACTIVE),
    case("event times, gate, jitter with a tail", (1.0, 60.0), times, gate=SHUT,
         jitter={"sigma_s": 1e-3, "tail_share": 0.3, "tail_s": 8e-3}),
    case("consecutive frames", (2.0, 10.0), running, afterpulsing=TRAPS, dead_time=PASSIVE,
         exposure_s=0.02),
    ctia("CTIA, electrons", noise={"photon_shot": True, "dark_shot": True}),
    ctia("CTIA, reset and readout", diode={"saturation_current_a": 0},
         noise={"dark_shot": True, "reset": True, "read_noise_v": 60e-6}),
    ctia("CTIA, offsets and a leaking gate", offset_v=18.7e-3, offset_sigma_v=1e-2,
         bias={"kind": "floating_gate", "leak_v_s": 1e-3}),
    ctia("CTIA, poor amplifiers", (0.0, 1e-11), gain_db=30.0, gain_sigma_db=2.0, dark_sigma=0.3,
         diode={"saturation_current_a": 1e-11, "shunt_ohm": 1e11},
         bias={"kind": "fixed", "reverse_bias_v": 0.01}),
)  # fmt: skip


@pytest.mark.parametrize(
    "case",
    [pytest.param(case, id=case.term, marks=[pytest.mark.slow] * case.is_slow) for case in CASES],
)
def test_sensors_agree_with_the_plainest_simulation(case, tmp_path):
    quantity, z = worst_comparison(case, tmp_path)
    assert abs(z) < LARGEST_Z, quantity


def worst_comparison(case, folder):
    """Draw the readings of a case and simulate them plainly; return the largest difference, z."""
    sensor = case.sensor
    if case.maps:
        files = {name: str(folder / f"{name}.npy") for name in case.maps}
        for name, path in files.items():
            np.save(path, np.reshape(case.maps[name], case.layout))
        sensor = sensors.changed(sensor, measured=files)
    light = light_of(case, sensor)
    drawn, flags = (
        values if values is None else values.reshape(case.samples, -1)
        for values in case.read(light, sensor)
    )
    plain, plain_flags = simulated(case)
    differences = {
        f"{name}, all": z for name, z in two_sample_z(plain.sum(1), drawn.sum(1)).items()
    }
    moments = stated_moments(case, light, sensor)
    for place in range(drawn.shape[1]):
        differing = two_sample_z(plain[:, place], drawn[:, place])
        if flags is not None:
            pair = plain_flags[:, place] + 0.0, flags[:, place] + 0.0
            differing["flagged"] = two_sample_z(*pair)["mean"]
        if moments:
            differing |= stated_z(drawn[:, place], *(values[:, place] for values in moments))
        differences |= {f"{name}, column {place}": z for name, z in differing.items()}
    assert not np.isnan(list(differences.values())).any()
    return max(differences.items(), key=lambda item: abs(item[1]))


def light_of(case, sensor):
    """Return the light on (frames, rows, columns), or of parts on (frames, S, …)."""
    parts, levels = case.rates.shape
    if case.layout:
        shape = case.samples, parts, *case.layout
        light = np.broadcast_to(case.rates.reshape(parts, *case.layout), shape)
    else:
        light = np.broadcast_to(case.rates[:, np.newaxis], (1, parts, case.samples, levels))
    if case.read is through_the_lens:
        light = light / plainest.plain_light_hz(1.0, BANDS_NM[1], sensor)
    return np.ascontiguousarray(light[:, 0] if parts == 1 else light)


def stated_moments(case, light, sensor):
    """Mean and variance, (samples or 1, places), if the sensor states them exactly."""
    few = light[:1]
    if case.read is volts:
        moments = sensors.volt_moments(few, sensor, CTIA_FRAME)
    elif case.read in (counts, codes) and light.ndim == 3:
        moments = sensors.reading_moments(few, sensor)
    elif case.read is through_the_lens:
        moments = sensors.reading_moments(
            sensors.detection_rate(banded(few), BANDS_NM, sensor), sensor
        )
    else:
        return ()
    return tuple(values.reshape(-1, case.rates.shape[1]) for values in moments)


def simulated(case):
    """Readings and flags, (samples, places), by brute force."""
    rng, sensor = sensors.generator(1, "brute force", case.term), case.sensor
    light = np.tile(case.rates, (case.samples, 1, 1))  # (samples, S, levels)
    if case.read is volts:
        return plainest.plain_volts(rng, sensor, light[:, 0], CTIA_FRAME)
    maps = {name: np.tile(values, (case.samples, 1)) for name, values in case.maps.items()}
    devices = plainest.plain_pixels(rng, sensor, (case.samples, light.shape[2]), maps)
    if case.read is through_the_lens:
        light *= devices.efficiency[:, np.newaxis]
        if case.layout:
            light *= plainest.plain_falloff(sensor.lens, *case.layout)
    light += devices.dark_hz[:, np.newaxis]
    frames = {times: TENTHS, running: CONSECUTIVE}.get(case.read, 1)
    sums = sensor.counter.sums if case.read is counts else 1
    exposure_s = sensor.exposure_s / (frames if case.read is times else sums)
    devices = plainest.PlainPixels(*(np.repeat(values, sums, axis=0) for values in devices))
    light = np.repeat(light, sums, axis=0)  # each from its own live start
    events = plainest.brute_force_events(
        rng, light, exposure_s, sensor, devices, case.layout, frames
    )
    readings, flags = plainest.plain_readings(rng, events.reshape(case.samples * sums, -1), sensor)
    if sums > 1:
        each = flags.reshape(case.samples, sums, -1)
        flags = each.any(axis=1) if sensor.counter.overflow == "wrap" else each.all(axis=1)
        readings = readings.reshape(case.samples, sums, -1).sum(axis=1)
    return np.minimum(readings, 1) if case.read is bits else readings, flags


def stated_z(drawn, means, variances):
    """Compare readings with the stated moments: 0.1 % or 0.003 σ of the mean, 1 % of the variance.

    Each reading has its own mean and variance if pixels differ.
    """
    mean, variance = float(means.mean()), float(variances.mean())
    off, allowed = drawn - means, max(1e-3 * mean, 3e-3 * variance**0.5)
    sigma = drawn.size**-0.5
    return {
        "stated mean": z_of(off.mean(), off.std() * sigma, allowed),
        "stated variance": z_of(
            (off**2).mean() - variance, (off**2).std() * sigma, 0.01 * variance
        ),
    }


def two_sample_z(first, second):
    """Return z of the differences in mean, variance and distribution of two samples (n,)."""
    squares = [(sample - sample.mean()) ** 2 for sample in (first, second)]
    mean_error = (first.var() / first.size + second.var() / second.size) ** 0.5
    variance_error = sum(square.var() / square.size for square in squares) ** 0.5
    return {
        "mean": z_of(second.mean() - first.mean(), mean_error),
        "variance": z_of(squares[1].mean() - squares[0].mean(), variance_error),
        "distribution": distribution_z(first, second),
    }


def distribution_z(first, second):
    """Return Pearson's test of homogeneity, bins of 20 or more, as the z of equal probability."""
    values, place = np.unique(np.concatenate([first, second]), return_inverse=True)
    parts = np.split(place, [first.size])
    table = np.array([np.bincount(part, minlength=values.size) for part in parts])
    # neighboring values share a bin until it is full enough
    bins = (np.cumsum(table.sum(0)) - table.sum(0)) // 40
    table = np.array([np.bincount(bins, row) for row in table])
    table = table[:, table.sum(0) >= 20]
    if table.shape[1] < 2:
        return 0.0
    expected = table.sum(1, keepdims=True) * table.sum(0) / table.sum()
    statistic = ((table - expected) ** 2 / expected).sum()
    chance = chi2.sf(statistic, table.shape[1] - 1)
    return float(norm.isf(np.clip(chance, 1e-300, 1 - 1e-6)))  # 1 of equal samples


def z_of(difference, error, allowed=0.0):
    beyond = max(abs(difference) - allowed, 0.0)
    if error == 0:
        return 0.0 if beyond == 0 else np.inf
    return float(np.copysign(beyond / error, difference))
