"""Recordings of a SPADCAM that has one fault, as codes of its ADC."""

import numpy as np

from megalopta.sensor import changed, expose_adc, preset
from megalopta.sensor.compare.model import Model, level_of_codes
from megalopta.sensor.compare.recordings import compare_recordings
from megalopta.sensor.spad.device import draw_fixed_pattern

SHAPE = (16, 16)
NANOMETERS = 700.0
LEVELS = ((0.01, 0.0, 90), (0.05, 0.0, 18), (2e-4, 2e8, 900), (2e-4, 1e9, 900), (2e-4, 5e9, 900))
"""Exposure s, photons per second on a pixel, frames per second"""
TOP = 4095
CODES_PER_COUNT = 0.01 / (3.3 / TOP)


def device(seed=3):
    """The device that is known."""
    return changed(preset("spadcam"), device_seed=seed)


def rates_of(sensor, light_hz):
    """Detection rates under even light, (1, rows, columns) Hz."""
    efficiency = float(sensor.photon_detection_efficiency(np.array(NANOMETERS)))
    factor = draw_fixed_pattern(sensor, SHAPE).efficiency_factor
    return (light_hz * efficiency * factor)[np.newaxis]


def recorded(seed, sensor, known, frames=400, light=None, extra=None, spoil=None, levels=LEVELS):
    """Levels of a sensor, as the known device's values convert its codes.

    `light` returns factors (frames, rows or 1) on the light at times (s); `extra` adds rates (Hz);
    `spoil` turns codes and times into others.
    """
    found = []
    for exposure_s, light_hz, rate_hz in levels:
        own = changed(sensor, exposure_s=exposure_s)
        times = np.arange(frames) / rate_hz
        rng = np.random.default_rng([seed, int(1e6 * exposure_s), int(light_hz)])
        rates = np.broadcast_to(rates_of(own, light_hz), (frames, *SHAPE))
        if light is not None:
            rates = rates * light(times, rng)
        if extra is not None:
            rates = rates + extra(times, rng)
        name = f"faulty {exposure_s} {light_hz}"
        codes = expose_adc(rates, own, seed=seed, sequence=name, together=64)
        if spoil is not None:
            codes, times = spoil(codes, times)
        found.append(level_of_codes(codes, known, exposure_s, light_hz, times))
    return found


def compared(seed, sensor=None, known=None, **fault):
    """Comparison of a faulty recording with the known device."""
    known = known or device()
    levels = recorded(seed, sensor or known, known, **fault)
    rates = [rates_of(known, level.light_hz) for level in levels]
    model = Model(known, rates)
    return compare_recordings(levels, model.drawn(levels, seed + 10_000), model)


def sine(hertz, size, by_row_s=0.0):
    """Light that flickers, later by some time in every row."""

    def factors(times, rng):
        late = by_row_s * np.arange(SHAPE[0])
        phase = 2 * np.pi * (hertz * (times[:, None] + late) + rng.random())
        return 1 + size * np.sin(phase)[:, :, None]

    return factors


def tilted(times, rng):
    """Light that is 10 % brighter at the right than at the left border."""
    return 1 + 0.05 * np.linspace(-1, 1, SHAPE[1])[None, None, :]


def vignetted(times, rng):
    """Light that falls by 20 % to the corners."""
    y, x = np.meshgrid(*(np.linspace(-1, 1, side) for side in SHAPE), indexing="ij")
    fall = 1 - 0.1 * (x**2 + y**2)
    return (fall / fall.mean())[None]


def growing(times, rng):
    """Light that grows by a tenth."""
    return np.linspace(1, 1.1, times.size)[:, None, None]


def of_codes(change):
    """Spoil codes in place."""

    def spoil(codes, times):
        codes = codes.copy()
        return np.asarray(change(codes, np.arange(len(codes))), np.uint16), times

    return spoil


def written(place, value):
    """Write a value to codes."""

    def change(codes, _):
        codes[place] = value if not callable(value) else value(codes[place])
        return codes

    return of_codes(change)


def gain_drift(codes, number):
    """Step that grows by a tenth."""
    factor = np.linspace(1, 1.1, number.size)[:, None, None]
    return np.rint(TOP - (TOP - codes.astype(float)) * factor).clip(0, TOP)


def narrow_odd_codes(codes, number):
    """Odd codes a fifth narrower: a fifth of their readings become even."""
    rng = np.random.default_rng(5)
    return codes - ((codes % 2 == 1) & (rng.random(codes.shape) < 0.2))


def row_noise(codes, number):
    """Rows that fluctuate by up to 5 codes, without a period."""
    return codes - np.random.default_rng(1).integers(-3, 3, (number.size, SHAPE[0], 1))


def bent(codes, number):
    """Output that sags in proportion to the square of its fall, by an unknown effect."""
    fall = TOP - codes.astype(float)
    return np.rint(TOP - fall * (1 - fall / 8000)).clip(0, TOP)


def twice(codes, times):
    """Every frame sent twice."""
    return np.repeat(codes, 2, axis=0)[: len(codes)], times


def lossy(codes, times):
    """Three frames lost in one place."""
    kept = np.r_[0:100, 103 : len(codes)]
    return codes[kept], times[kept]


def switching(times, rng):
    """Telegraph noise of 3000 Hz in three pixels."""
    extra = np.zeros((times.size, *SHAPE))
    for row, column in ((2, 3), (7, 11), (13, 5)):
        state = np.cumsum(rng.random(times.size) < 0.05) % 2
        extra[:, row, column] = 3000.0 * state
    return extra


def hot(times, rng):
    """A pixel of 20 kHz."""
    extra = np.zeros((1, *SHAPE))
    extra[0, 4, 9] = 2e4
    return extra


def noisy_light(times, rng):
    """Light that fluctuates by 3 % from frame to frame."""
    return 1 + 0.03 * rng.standard_normal((times.size, 1, 1))


def _counter(**fields):
    return {"counter": fields}


SPADCAM = device()
FAULTS = {
    "read noise ×2": ("read noise", {"sensor": changed(SPADCAM, **_counter(read_noise_v=2e-3))}),
    "read noise ×4": ("read noise", {"sensor": changed(SPADCAM, **_counter(read_noise_v=4e-3))}),
    "light +10 % to the right": ("uneven light", {"light": tilted}),
    "light -20 % in the corners": ("uneven light", {"light": vignetted}),
    "light +10 %": ("drift of light", {"light": growing}),
    "gain +10 %": ("drift of gain", {"spoil": of_codes(gain_drift)}),
    "flicker 60 Hz": ("flicker", {"light": sine(60, 0.1)}),
    "banding 60 Hz": ("row banding", {"light": sine(60, 0.1, 5e-4)}),
    "noisy light": ("common noise", {"light": noisy_light}),
    "row noise": ("row noise", {"spoil": of_codes(row_noise)}),
    "frames twice": ("repeated frames", {"spoil": twice}),
    "frames lost": ("missing frames", {"spoil": lossy}),
    "dead row": ("dead row", {"spoil": written(np.s_[:, 5], TOP)}),
    "dead column": ("dead column", {"spoil": written(np.s_[:, :, 9], TOP)}),
    "row at the bottom": ("dead row", {"spoil": written(np.s_[:, 5], 124)}),
    "dead pixel": ("dead pixel", {"spoil": written(np.s_[:, 5, 6], TOP)}),
    "stuck pixel": ("stuck pixel", {"spoil": written(np.s_[:, 5, 6], 2000)}),
    "row offset 8 mV": ("row offset", {"spoil": written(np.s_[:, 5], lambda c: c - 10)}),
    "column offset 8 mV": ("column offset", {"spoil": written(np.s_[:, :, 5], lambda c: c - 10)}),
    "telegraph noise": ("telegraph noise", {"extra": switching}),
    "hot pixel": ("hot pixel", {"extra": hot}),
    "stuck bit": ("stuck bit", {"spoil": written(np.s_[:], lambda c: c | 32)}),
    "missing code": (
        "missing codes", {"spoil": written(np.s_[:], lambda c: c + (c % 64 == 0))}
    ),
    "uneven codes": (
        "uneven codes",
        {"spoil": of_codes(narrow_odd_codes)},
    ),
    "mirrored columns": ("order", {"spoil": of_codes(lambda c, _: c[:, :, ::-1])}),
    "swapped columns": (
        "order", {"spoil": of_codes(lambda c, _: c[:, :, [1, 0, *range(2, 16)]])}
    ),
    "afterpulsing": (
        "afterpulsing",
        {"sensor": changed(SPADCAM, afterpulsing={"mean_carriers": 0.05, "delay_s": 5e-6})},
    ),
    "crosstalk": (
        "crosstalk", {"sensor": changed(SPADCAM, crosstalk={"mean_fired_neighbors": 0.05})}
    ),
    "dead time": ("dead time", {"sensor": changed(SPADCAM, dead_time={"dead_time_s": 1.2e-6})}),
    "dead time ×2": ("dead time", {"sensor": changed(SPADCAM, dead_time={"dead_time_s": 2e-6})}),
    "step": ("step", {"sensor": changed(SPADCAM, **_counter(step_v=0.011))}),
    "offset 8 mV": ("offset", {"spoil": written(np.s_[:], lambda c: c - 10)}),
    "efficiency": ("efficiency", {"light": lambda times, rng: np.full((1, 1, 1), 1.2)}),
    "bent output": ("none", {"spoil": of_codes(bent)}),
}  # fmt: skip
"""Name of a fault: what is to be said, and how it is made"""


def said(found):
    """Faults and causes that a comparison names."""
    names = {each.kind for each in found.faults}
    names |= {"order"} if found.arrangement.is_other else set()
    names |= {each.name for each in found.causes}
    return names | ({"none"} if found.explained.is_unexplained else set())
