"""`megalopta check physics`: every effect of the sensor against the plainest simulation.

Mean, variance and distribution of the readings must agree at every light level, as must the share
of flagged ones, and draws must have the mean and variance that the sensor states. Streams are
fixed, so the result is reproducible; a correct change of the code draws other numbers. Each
comparison then fails with a probability of at most 6e-7 (|z| >= 5). A row is the worst comparison
of a case; `false_alarm` counts them all.
"""

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table
from scipy.stats import chi2, norm

from megalopta.core import strict_yaml
from megalopta.core.arrays import Floats
from megalopta.core.errors import UserError
from megalopta.sensor import (
    IMAGE_SENSORS,
    ORDER_OF_EFFECTS,
    AnalogCounter,
    CtiaSensor,
    changed,
    detection_rate,
    expose,
    expose_adc,
    expose_binary,
    expose_events,
    expose_photocurrent,
    expose_rate,
    generator,
    reading_moments,
    volt_moments,
)
from megalopta.sensor.sampling.bits import unpack
from megalopta.verification.brute_force import (
    brute_force_events,
    plain_falloff,
    plain_light_hz,
    plain_pixels,
    plain_readings,
    plain_volts,
)

LARGEST_Z = 5.0
_BANDS_NM = ((460.0, 480.0), (440.0, 460.0))
"""The first is dark"""
_FRAMES = {"times": 10, "running": 3}
"""Columns per level: tenths of an exposure, or consecutive frames"""
_CTIA_FRAME = 99

Sample = NDArray[Any]
Drawn = tuple[Sample, Sample | None]
"""Readings, and their flags, (samples, places)"""


@dataclass(frozen=True)
class PhysicsCase:
    """One row of the table."""

    term: str
    """The effect"""
    sensor: Any
    light: Any
    """Photons per exposure detected by an always live sensor, at each level; or those of each of
    equal parts of the exposure; for a CTIA, photocurrents (A)"""
    readout: Literal["counts", "radiance", "bits", "times", "codes", "running", "volts"] = "counts"
    """Readout, of `_READ`; "radiance" is counts of light through the lens"""
    layout: tuple[int, int] | None = None
    """Levels are the pixels of such an array (rows, columns), and frames are independent; without
    it pixels are"""
    samples: int = 20_000
    maps: Mapping[str, Any] = field(default_factory=dict)
    """Measured maps of an array, flat like `light`"""

    @property
    def rates(self) -> Floats:
        """Light of all parts and levels, (S, levels): Hz, for a CTIA A."""
        light = np.atleast_2d(np.array(self.light, np.float64))
        return light if self.readout == "volts" else light * len(light) / self.sensor.exposure_s


@dataclass(frozen=True)
class Row:
    """The worst comparison of one case."""

    term: str
    quantity: str
    expected: float
    measured: float
    z: float
    """Difference in standard errors"""
    comparisons: int = 1

    @property
    def passed(self) -> bool:
        """True if the difference can be chance."""
        return abs(self.z) < LARGEST_Z


def run_check_physics(groups: Sequence[str] = (), console: Console | None = None) -> bool:
    """Compare cases of some groups, or all; print a table, return True if all passed.

    Raises UserError for an unknown name, before any check.
    """
    for group in groups:
        if group not in CASES:
            raise UserError(f"check physics: no group {group!r}; one of {', '.join(CASES)}")
    chosen = [case for group in CASES if group in (groups or CASES) for case in CASES[group]]
    console = console or Console()
    order = " → ".join(ORDER_OF_EFFECTS)
    console.print(f"order of effects: {order}", highlight=False)
    with ThreadPoolExecutor(2) as pool:
        rows = list(pool.map(check_case, chosen))
    console.print(_table(rows))
    failed = sum(not row.passed for row in rows)
    comparisons = sum(row.comparisons for row in rows)
    console.print(
        f"{len(rows)} rows, {failed} failed, of {comparisons} comparisons; a correct program fails "
        f"any with a probability of at most {false_alarm(rows):.0e}",
        highlight=False,
    )
    return failed == 0


def _table(rows: Sequence[Row]) -> Table:
    table = Table("term", "quantity", caption=f"pass: |z| < {LARGEST_Z:g}")
    for name in ("expected", "measured", "z", "pass"):
        table.add_column(name, justify="right")
    for row in rows:
        numbers = f"{row.expected:.5g}", f"{row.measured:.5g}", f"{row.z:+.1f}"
        verdict = "[green]yes[/]" if row.passed else "[bold red]NO[/]"
        table.add_row(row.term, row.quantity, *numbers, verdict)
    return table


def check_case(case: PhysicsCase) -> Row:
    """Draw the readings of a case and simulate them plainly; return the worst comparison."""
    with TemporaryDirectory() as folder:
        sensor = _measured(case, Path(folder))
        light = _light(case, sensor)
        drawn, flags = _READ[case.readout](case, light, sensor)
        stated = _stated(case, light, sensor)
    plain, plain_flags = _simulate(case)
    rows = _sample_rows("all", plain.sum(1), drawn.sum(1))
    for place in range(drawn.shape[1]):
        name = f"column {place + 1} of {drawn.shape[1]}"
        rows += _sample_rows(name, plain[:, place], drawn[:, place])
        if flags is not None:
            pair = plain_flags[:, place] + 0.0, flags[:, place] + 0.0
            rows += _sample_rows(f"flagged, {name}", *pair)[:1]
        rows += _stated_rows(name, drawn[:, place], *(each[:, place] for each in stated))
    return replace(worst(rows), term=case.term)


def worst(rows: Sequence[Row]) -> Row:
    """Return the worst row, which represents all of them."""
    largest = max(rows, key=lambda row: np.inf if np.isnan(row.z) else abs(row.z))
    return replace(largest, comparisons=sum(row.comparisons for row in rows))


def false_alarm(rows: Sequence[Row]) -> float:
    """Largest probability that a correct program fails any of the comparisons."""
    return float(2 * norm.sf(LARGEST_Z) * sum(row.comparisons for row in rows))


def _measured(case: PhysicsCase, folder: Path) -> Any:
    files = {name: str(folder / f"{name}.npy") for name in case.maps}
    for name, path in files.items():
        np.save(path, np.reshape(case.maps[name], case.layout))
    return changed(case.sensor, measured=files) if files else case.sensor


def _light(case: PhysicsCase, sensor: Any) -> Floats:
    """Return the light on (frames, rows, columns), or of parts on (frames, S, …)."""
    parts, levels = case.rates.shape
    if case.layout:
        shape = case.samples, parts, *case.layout
        light = np.broadcast_to(case.rates.reshape(parts, *case.layout), shape)
    else:
        light = np.broadcast_to(case.rates[:, np.newaxis], (1, parts, case.samples, levels))
    if case.readout == "radiance":
        light = light / plain_light_hz(1.0, _BANDS_NM[1], sensor)
    return np.ascontiguousarray(light[:, 0] if parts == 1 else light)


def _stated(case: PhysicsCase, light: Floats, sensor: Any) -> tuple[Floats, ...]:
    """Mean and variance, (samples or 1, places), if the sensor states them exactly."""
    few = light[:1]
    if case.readout == "volts":
        moments = volt_moments(few, sensor, _CTIA_FRAME)
    elif case.readout in ("counts", "codes") and light.ndim == 3:
        moments = reading_moments(few, sensor)
    elif case.readout == "radiance":
        moments = reading_moments(detection_rate(_banded(few), _BANDS_NM, sensor), sensor)
    else:
        return ()
    return tuple(each.reshape(-1, case.rates.shape[1]) for each in moments)


def _banded(light: Floats) -> Floats:
    return np.stack([0 * light, light], axis=-1)


def _key(case: PhysicsCase) -> dict[str, Any]:
    return {"seed": 4, "stream": case.term}


def _columns(case: PhysicsCase, readings: Sample) -> Sample:
    return readings.reshape(case.samples, -1)


def _counts(case: PhysicsCase, light: Floats, sensor: Any) -> Drawn:
    if case.readout == "radiance":
        exposure = expose(_banded(light), _BANDS_NM, sensor, **_key(case))
    else:
        exposure = expose_rate(light, sensor, **_key(case))
    return _columns(case, exposure.counts.astype(np.float64)), _columns(case, exposure.saturated)


def _bits(case: PhysicsCase, light: Floats, sensor: Any) -> Drawn:
    packed = expose_binary(light, sensor, **_key(case))
    return _columns(case, unpack(packed, light.shape[-1]).astype(np.float64)), None


def _times(case: PhysicsCase, light: Floats, sensor: Any) -> Drawn:
    """Events in each tenth of the exposure."""
    counts = np.zeros((case.samples, bins := _FRAMES["times"], light.shape[-1]))
    events = expose_events(light, sensor, **_key(case))
    time = np.clip(events.time_s / sensor.exposure_s * bins, 0, bins - 1).astype(np.int64)
    np.add.at(counts, (events.row, time, events.column), 1)
    return _columns(case, counts), None


def _codes(case: PhysicsCase, light: Floats, sensor: Any) -> Drawn:
    """Codes of an ADC, converted to counts by the uniform pixels' steps."""
    counter = sensor.counter
    assert isinstance(counter, AnalogCounter) and counter.adc_bits is not None
    codes = _columns(case, expose_adc(light, sensor, **_key(case))).astype(np.float64)
    leaked_v = counter.leak_v_s * sensor.exposure_s
    volts = codes * counter.supply_v / (2**counter.adc_bits - 1)
    counts = np.rint((counter.supply_v - leaked_v - volts) / counter.step_v)
    largest = np.floor((counter.swing_v - leaked_v) / counter.step_v + 1e-9)
    return np.clip(counts, 0, largest), None


def _running(case: PhysicsCase, light: Floats, sensor: Any) -> Drawn:
    """Counts of consecutive frames."""
    frames = np.tile(light, (_FRAMES["running"], 1, 1))
    counts = expose_rate(frames, sensor, free_running=True, **_key(case)).counts
    return _columns(case, counts.transpose(1, 0, 2)).astype(np.float64), None


def _volts(case: PhysicsCase, light: Floats, sensor: Any) -> Drawn:
    read = expose_photocurrent(light, sensor, first_frame=_CTIA_FRAME, **_key(case))
    return _columns(case, read.volts), _columns(case, read.saturated)


_READ: Mapping[str, Callable[[PhysicsCase, Floats, Any], Drawn]] = {
    "counts": _counts,
    "radiance": _counts,
    "bits": _bits,
    "times": _times,
    "codes": _codes,
    "running": _running,
    "volts": _volts,
}


def _simulate(case: PhysicsCase) -> tuple[Sample, Sample]:
    """Readings and flags, (samples, places), by brute force."""
    rng, sensor = generator(1, "brute force", case.term), case.sensor
    light = np.tile(case.rates, (case.samples, 1, 1))  # (samples, S, levels)
    if case.readout == "volts":
        return plain_volts(rng, sensor, light[:, 0], _CTIA_FRAME)
    maps = {name: np.tile(values, (case.samples, 1)) for name, values in case.maps.items()}
    pixels = plain_pixels(rng, sensor, (case.samples, light.shape[2]), maps)
    if case.readout == "radiance":
        light *= pixels.efficiency[:, np.newaxis]
        if case.layout:
            light *= plain_falloff(sensor.lens, *case.layout)
    light += pixels.dark_hz[:, np.newaxis]
    frames = _FRAMES.get(case.readout, 1)
    exposure_s = sensor.exposure_s / (frames if case.readout == "times" else 1)
    events = brute_force_events(rng, light, exposure_s, sensor, pixels, case.layout, frames)
    readings, flags = plain_readings(rng, _columns(case, events), sensor)
    return np.minimum(readings, 1) if case.readout == "bits" else readings, flags


def _sample_rows(where: str, plain: Sample, drawn: Sample) -> list[Row]:
    """Compare mean, variance and distribution of two samples."""
    mean_z, variance_z, law = two_sample_z(plain, drawn)
    return [
        Row("", f"mean, {where}", float(plain.mean()), float(drawn.mean()), mean_z),
        Row("", f"variance, {where}", float(plain.var()), float(drawn.var()), variance_z),
        Row("", f"distribution as z, {where}", 0.0, law, law),
    ]


def _stated_rows(where: str, drawn: Sample, *moments: Floats) -> list[Row]:
    """Compare readings with the stated moments: 0.1 % or 0.003 σ of the mean, 1 % of the variance.

    Each reading has its own mean and variance if pixels differ.
    """
    if not moments:
        return []
    mean, (due, spread) = moments[0], (float(each.mean()) for each in moments)
    off, allowed = drawn - mean, max(1e-3 * due, 3e-3 * spread**0.5)
    return [
        _mean_row(f"stated mean, {where}", due, off + due, allowed),
        _mean_row(f"stated variance, {where}", spread, off**2, 0.01 * spread),
    ]


def _mean_row(quantity: str, expected: float, sample: Sample, allowed: float) -> Row:
    """Compare the mean of independent draws with a number of known tolerance."""
    mean, error = float(sample.mean()), float(sample.std()) / sample.size**0.5
    return Row("", quantity, expected, mean, _z(mean - expected, error, allowed))


def two_sample_z(first: Sample, second: Sample) -> tuple[float, float, float]:
    """Return z of the differences in mean, variance and distribution of two samples (n,)."""
    n, m = first.size, second.size
    deviations = [(sample - sample.mean()) ** 2 for sample in (first, second)]
    mean_error = (first.var() / n + second.var() / m) ** 0.5
    variance_error = (deviations[0].var() / n + deviations[1].var() / m) ** 0.5
    return (
        _z(second.mean() - first.mean(), mean_error),
        _z(deviations[1].mean() - deviations[0].mean(), variance_error),
        law_z(first, second),
    )


def law_z(first: Sample, second: Sample) -> float:
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
    return float(norm.isf(max(chi2.sf(statistic, table.shape[1] - 1), 1e-300)))


def _z(difference: float, error: float, allowed: float = 0.0) -> float:
    beyond = max(abs(difference) - allowed, 0.0)
    if error == 0:
        return 0.0 if beyond == 0 else np.inf
    return float(np.copysign(beyond / error, difference))


_GROUPS = strict_yaml.load(Path(__file__).with_name("cases.yaml").read_text("utf-8"))
_LIGHT = _GROUPS.pop("_shared")["light"]


def _case(term: str, fields: dict[str, Any]) -> PhysicsCase:
    own = {name: fields.pop(name) for name in PhysicsCase.__annotations__ if name in fields}
    if fields.get("kind") == "ctia":
        sensor: Any = CtiaSensor.model_validate(fields)
    else:
        sensor = changed(IMAGE_SENSORS[fields.pop("preset", "ideal")], **fields)
    return PhysicsCase(term, sensor, **{"light": _LIGHT, **own})


CASES: dict[str, tuple[PhysicsCase, ...]] = {
    group: tuple(_case(*each) for each in cases.items()) for group, cases in _GROUPS.items()
}
