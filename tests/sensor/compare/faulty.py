"""Recordings of three cameras that have one fault, or two: codes of an ADC, counts, and bits."""

from typing import NamedTuple

import numpy as np

from megalopta.sensor import Sensor, changed, expose_adc, expose_rate, preset
from megalopta.sensor.calibrate.level import Level
from megalopta.sensor.compare.model import Model, level_of_codes
from megalopta.sensor.compare.recordings import compare_levels
from megalopta.sensor.spad.device import draw_fixed_pattern

TOP = 4095
FRAMES = 400


class Camera(NamedTuple):
    """Known device, and how it is recorded."""

    sensor: Sensor
    shape: tuple[int, int]
    levels: tuple[tuple[float, float, int], ...]
    """Exposure s, photons per second on a pixel, frames per second"""
    efficiency: float
    dead: int
    """Reading of a dead pixel"""
    stuck: int
    telegraph_hz: float = 3000.0
    """Rate that a trap adds; in bits, two events in a dark frame"""


_SPADCAM = changed(preset("spadcam"), device_seed=3)
_COUNTING = changed(
    preset("ideal"),
    device_seed=3,
    dark_counts={
        "bulk_mean_hz_um2": 0.2,
        "bulk_sigma_hz_um2": 0.04,
        "hot_fraction": 0.02,
        "hot_mean_hz_um2": 2.0,
        "hot_sigma_hz_um2": 1.0,
    },
    bias={"efficiency_scale_v": 1.0, "breakdown_sigma_v": 0.05},
    efficiency={"wavelengths_nm": (300, 1000), "values": (0.4, 0.4)},
    counter={"kind": "digital", "capacity": 4095},
    dead_time={"kind": "nonparalyzable", "dead_time_s": 5e-8},
)
_FLATS = (2e-4, 2e8, 900), (2e-4, 1e9, 900), (2e-4, 5e9, 900)
CAMERAS = {
    "codes": Camera(
        _SPADCAM,
        (16, 16),
        ((0.01, 0.0, 90), (0.05, 0.0, 18), *_FLATS),
        float(_SPADCAM.photon_detection_efficiency(np.array(700.0))),
        dead=TOP,
        stuck=2000,
    ),
    "counts": Camera(
        _COUNTING,
        (32, 32),
        ((2e-3, 0.0, 450), (1e-4, 5e5, 900), (1e-4, 5e6, 900)),
        0.4,
        dead=0,
        stuck=100,
    ),
    "bits": Camera(
        changed(_COUNTING, counter={"capacity": 1}, dead_time={"kind": "ideal"}),
        (32, 32),
        ((2e-4, 0.0, 900), (1e-5, 5e4, 900), (1e-5, 2.5e5, 900)),
        0.4,
        dead=0,
        stuck=1,
        telegraph_hz=1e4,
    ),
}


def rates_of(camera, light_hz):
    """Detection rates under even light, (1, rows, columns) Hz."""
    factor = draw_fixed_pattern(camera.sensor, camera.shape).efficiency_factor
    return (light_hz * camera.efficiency * factor)[np.newaxis]


def recorded(camera, seed, light=None, extra=None, spoil=None, sensor=None):
    """Levels of a faulty camera, as the known device's values convert its codes.

    `light` returns factors (frames, rows or 1, columns or 1) on the light at times (s); `extra`
    adds rates (Hz); `spoil` changes readings and times; `sensor` holds changed fields.
    """
    levels = []
    for exposure_s, light_hz, rate_hz in camera.levels:
        faulty = changed(camera.sensor, **{"exposure_s": exposure_s, **(sensor or {})})
        times = np.arange(FRAMES) / rate_hz
        rng = np.random.default_rng([seed, int(1e6 * exposure_s), int(light_hz)])
        rates = np.broadcast_to(rates_of(camera, light_hz), (FRAMES, *camera.shape))
        if light is not None:
            rates = rates * light(times, camera.shape, rng)
        if extra is not None:
            rates = rates + extra(times, camera.shape, rng)
        name = f"faulty {exposure_s} {light_hz}"
        has_codes = camera.sensor.counter.kind == "analog"
        if has_codes:
            readings = expose_adc(rates, faulty, seed=seed, stream=name, together=64)
        else:
            readings = np.array(expose_rate(rates, faulty, seed=seed, stream=name).counts)
        if spoil is not None:
            readings, times = spoil(readings.copy(), times)
        if has_codes:
            levels.append(level_of_codes(readings, camera.sensor, exposure_s, light_hz, times))
        else:
            levels.append(Level(readings, exposure_s, light_hz, times_s=times))
    return levels


def compared(seed, camera=CAMERAS["codes"], **fault):
    """Comparison of a faulty recording with the known device."""
    levels = recorded(camera, seed, **fault)
    model = Model(camera.sensor, [rates_of(camera, level.light_hz) for level in levels])
    return compare_levels(levels, model.drawn(levels, seed + 10_000), model)


def sine(by_row_s):
    """Light that flickers at 60 Hz, later by some time from the first row to the last."""

    def factors(times, shape, rng):
        late = by_row_s * np.arange(shape[0]) / shape[0]
        phase = 2 * np.pi * (60 * (times[:, None] + late) + rng.random())
        return 1 + 0.1 * np.sin(phase)[:, :, None]

    return factors


def vignetted(times, shape, rng):
    y, x = np.meshgrid(*(np.linspace(-1, 1, side) for side in shape), indexing="ij")
    relative = 1 - 0.1 * (x**2 + y**2)
    return (relative / relative.mean())[None]


def switching(hertz):
    """Telegraph noise of this rate in three pixels."""

    def rates(times, shape, rng):
        extra = np.zeros((times.size, *shape), np.float32)
        for row, column in ((2, 3), (7, 11), (13, 5)):
            extra[:, row, column] = hertz * (np.cumsum(rng.random(times.size) < 0.05) % 2)
        return extra

    return rates


def hot(times, shape, rng):
    """A pixel of 20 kHz."""
    extra = np.zeros((1, *shape))
    extra[0, 4, 9] = 2e4
    return extra


def of_readings(change):
    """Spoil readings by a function of them and of the frames' numbers."""

    def spoil(readings, times):
        return np.asarray(change(readings, np.arange(len(readings))), readings.dtype), times

    return spoil


def fallen(change):
    """Change the fall of the output below its top, in codes."""
    return of_readings(
        lambda codes, _: np.rint(TOP - change(TOP - codes.astype(float))).clip(0, TOP)
    )


def narrow_odd_codes(codes, _):
    """Odd codes a fifth narrower: a fifth of their readings become even."""
    rng = np.random.default_rng(5)
    return codes - ((codes % 2 == 1) & (rng.random(codes.shape) < 0.2))


def row_noise(codes, _):
    """Rows that fluctuate by up to 5 codes, without a period."""
    shape = len(codes), codes.shape[1], 1
    return codes - np.random.default_rng(1).integers(-3, 3, shape)


def twice(readings, times):
    """Every frame sent twice."""
    return np.repeat(readings, 2, axis=0)[: len(readings)], times


def lossy(readings, times):
    """Three frames lost in one place."""
    kept = np.r_[0:100, 103 : len(readings)]
    return readings[kept], times[kept]


def written(place, value):
    """Write a value to readings."""

    def change(readings, _):
        readings[place] = value if not callable(value) else value(readings[place])
        return readings

    return {"spoil": of_readings(change)}


def shone(factors):
    return {"light": factors}


def moved(order):
    return {"spoil": of_readings(lambda readings, _: order(readings))}


def _common(camera):
    """What is to be named of a fault that every camera may have, and how it is made."""
    return {
        "light +10 %": (
            "drift of light",
            shone(lambda times, _, rng: np.linspace(1, 1.1, times.size)[:, None, None]),
        ),
        "light +10 % to the right": (
            "uneven light",
            shone(lambda _, shape, rng: 1 + 0.05 * np.linspace(-1, 1, shape[1])[None, None]),
        ),
        "light -20 % in the corners": ("uneven light", shone(vignetted)),
        "flicker 60 Hz": ("flicker", shone(sine(0.0))),
        "banding 60 Hz": ("row banding", shone(sine(8e-3))),
        "noisy light": (
            "common noise",
            shone(lambda times, _, rng: 1 + 0.05 * rng.standard_normal((times.size, 1, 1))),
        ),
        "frames twice": ("repeated frames", {"spoil": twice}),
        "frames lost": ("missing frames", {"spoil": lossy}),
        "dead row": ("dead row", written(np.s_[:, 5], camera.dead)),
        "dead column": ("dead column", written(np.s_[:, :, 9], camera.dead)),
        "dead pixel": ("dead pixel", written(np.s_[:, 5, 6], camera.dead)),
        "stuck pixel": ("stuck pixel", written(np.s_[:, 5, 6], camera.stuck)),
        "telegraph noise": ("telegraph noise", {"extra": switching(camera.telegraph_hz)}),
        "hot pixel": ("hot pixel", {"extra": hot}),
        "mirrored columns": ("order", moved(lambda r: r[:, :, ::-1])),
        "swapped columns": ("order", moved(lambda r: r[:, :, [1, 0, *range(2, r.shape[2])]])),
        "efficiency": ("efficiency", shone(lambda *_: np.full((1, 1, 1), 1.2))),
    }


def _counter(**fields):
    return {"sensor": {"counter": fields}}


_OF_CODES = {
    "read noise ×2": ("read noise", _counter(read_noise_v=2e-3)),
    "gain +10 %": (
        "drift of gain",
        {"spoil": fallen(lambda fall: fall * np.linspace(1, 1.1, len(fall))[:, None, None])},
    ),
    "row noise": ("row noise", {"spoil": of_readings(row_noise)}),
    "row offset 8 mV": ("row offset", written(np.s_[:, 5], lambda c: c - 10)),
    "column offset 8 mV": ("column offset", written(np.s_[:, :, 5], lambda c: c - 10)),
    "stuck bit": ("stuck bit", written(np.s_[:], lambda c: c | 32)),
    "missing code": ("missing codes", written(np.s_[:], lambda c: c + (c % 64 == 0))),
    "uneven codes": ("uneven codes", {"spoil": of_readings(narrow_odd_codes)}),
    "afterpulsing": (
        "afterpulsing",
        {"sensor": {"afterpulsing": {"mean_carriers": 0.05, "delay_s": 5e-6}}},
    ),
    "dead time": ("dead time", {"sensor": {"dead_time": {"dead_time_s": 1.2e-6}}}),
    "step": ("step", _counter(step_v=0.011)),
    "offset 8 mV": ("offset", written(np.s_[:], lambda c: c - 10)),
    "bent output": ("none", {"spoil": fallen(lambda fall: fall * (1 - fall / 8000))}),
    "crosstalk": ("crosstalk", {"sensor": {"crosstalk": {"mean_fired_neighbors": 0.05}}}),
}
FAULTS = {
    "codes": {**_common(CAMERAS["codes"]), **_OF_CODES},
    "counts": _common(CAMERAS["counts"]),
    "bits": _common(CAMERAS["bits"]),
}
"""Name of a fault of each camera: what is to be said, and how it is made"""


def together(one, other):
    """Both of two faults."""
    joined = {
        "light": lambda a, b: lambda *seen: a(*seen) * b(*seen),
        "extra": lambda a, b: lambda *seen: a(*seen) + b(*seen),
        "spoil": lambda a, b: lambda *seen: b(*a(*seen)),
        "sensor": lambda a, b: {**a, **b},
    }
    return {
        name: joined[name](one[name], other[name])
        if name in one and name in other
        else one.get(name) or other[name]
        for name in {**one, **other}
    }


def said(found):
    """Faults and causes that a comparison names."""
    kinds = {fault.kind for fault in found.faults}
    # "drift of light or gain" names both
    names = {f"{words[0]}{name}" for kind in kinds for words in [_words(kind)] for name in words[1]}
    names |= {cause.name for cause in found.causes}
    names |= {"order"} if found.arrangement.is_other else set()
    return names | ({"none"} if found.explained.is_unexplained else set())


def _words(kind):
    head, of, names = kind.rpartition(" of ")
    return head + of, names.split(" or ")
