"""Faults of counting and binary cameras: shares that a comparison names, misnames and misses.

    bench_faults.py [CAMERA [SEEDS [FAULT ...]]]     counts 3: 128 × 128 pixels, three seeds of each

Cameras are counts (128 × 128) and bits (256 × 256, each frame 0 or 1), of 400 frames in the dark
and under two lights. A fault is put into a recording of a known device, which is compared with that
device. "Right" says the fault and nothing else, "wrong" states another cause, too or instead;
"none of the known causes" counts as missed. Of untouched recordings, "wrong" is a false alarm.
SPADCAM's codes are in `tests/sensor/compare/faulty.py`. The first comparison of a camera takes
longer, as its tables are made.
"""

import argparse
import time

import numpy as np

from megalopta.sensor import changed, expose_rate, preset
from megalopta.sensor.calibrate.level import Level
from megalopta.sensor.compare.model import Model
from megalopta.sensor.compare.recordings import compare_recordings
from megalopta.sensor.spad.device import draw_fixed_pattern

FRAMES, RATE_HZ = 400, 900.0
SIDES = {"counts": 128, "bits": 256}
LEVELS = {
    "counts": ((2e-3, 0.0), (1e-4, 2e5), (1e-4, 2e6)),
    "bits": ((1e-4, 0.0), (1e-5, 2e4), (1e-5, 1e5)),
}
"""Exposure s, and detections per second of the mean pixel"""


def camera(kind):
    """The device that is known."""
    return changed(
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
        counter={"kind": "digital", "capacity": 1 if kind == "bits" else 4095},
        dead_time={"kind": "ideal"}
        if kind == "bits"
        else ({"kind": "nonparalyzable", "dead_time_s": 5e-8}),
    )


def growing(times, shape, rng):
    return np.linspace(1, 1.1, times.size)[:, None, None]


def sine(by_row_s):
    def factors(times, shape, rng):
        phase = 60 * (times[:, None] + by_row_s * np.arange(shape[0])) + rng.random()
        return 1 + 0.1 * np.sin(2 * np.pi * phase)[:, :, None]

    return factors


def tilted(times, shape, rng):
    return 1 + 0.05 * np.linspace(-1, 1, shape[1])[None, None, :]


def noisy(times, shape, rng):
    return 1 + 0.05 * rng.standard_normal((times.size, 1, 1))


def noisy_rows(times, shape, rng):
    return 1 + 0.1 * rng.standard_normal((times.size, shape[0], 1))


def brighter(times, shape, rng):
    return np.full((1, 1, 1), 1.2)


def at(value, *places):
    """Write a value, at most the capacity, to places of all frames."""

    def spoil(frames, times):
        for place in places:
            frames[place] = min(value, frames.max()) if frames.max() == 1 else value
        return frames, times

    return spoil


def swapped(frames, times):
    frames[:, :, [10, 20]] = frames[:, :, [20, 10]]
    return frames, times


def lossy(frames, times):
    kept = np.r_[0:100, 103:FRAMES]
    return frames[kept], times[kept]


def switching(frames, shape, rng, more):
    """Rates of three pixels that switch on and off."""
    extra = np.zeros((frames, *shape), np.float32)
    for row, column in ((20, 30), (77, 11), (100, 55)):
        extra[:, row, column] = more * (np.cumsum(rng.random(frames) < 0.05) % 2)
    return extra


def hot(frames, shape, rng, more):
    extra = np.zeros((1, *shape))
    extra[0, 40, 90] = 3 * more
    return extra


FAULTS = {
    "untouched": (None, {}),
    "light +10 %": ("drift of light", {"light": growing}),
    "uneven light": ("uneven light", {"light": tilted}),
    "flicker 60 Hz": ("flicker", {"light": sine(0.0)}),
    "banding 60 Hz": ("row banding", {"light": sine(1e-4)}),
    "noisy light": ("common noise", {"light": noisy}),
    "row noise": ("row noise", {"light": noisy_rows}),
    "frames twice": (
        "repeated frames",
        {"spoil": lambda frames, times: (np.repeat(frames, 2, axis=0)[:FRAMES], times)},
    ),
    "frames lost": ("missing frames", {"spoil": lossy}),
    "dead row": ("dead row", {"spoil": at(0, np.s_[:, 5])}),
    "dead column": ("dead column", {"spoil": at(0, np.s_[:, :, 9])}),
    "dead pixels": ("dead pixel", {"spoil": at(0, np.s_[:, 5, 6], np.s_[:, 50, 16])}),
    "stuck pixel": ("stuck pixel", {"spoil": at(100, np.s_[:, 5, 6])}),
    "telegraph noise": ("telegraph noise", {"extra": switching}),
    "hot pixel": ("hot pixel", {"extra": hot}),
    "mirrored columns": ("order", {"spoil": lambda f, t: (f[:, :, ::-1].copy(), t)}),
    "swapped columns": ("order", {"spoil": swapped}),
    "efficiency": ("efficiency", {"light": brighter}),
    "dark counts": ("dark counts", {"sensor": {"dark_counts": {"bulk_mean_hz_um2": 0.3}}}),
    "dead time": ("dead time", {"sensor": {"dead_time": {"dead_time_s": 1e-7}}}),
    "afterpulsing": (
        "afterpulsing",
        {"sensor": {"afterpulsing": {"mean_carriers": 0.05, "delay_s": 1e-6}}},
    ),
    "crosstalk": ("crosstalk", {"sensor": {"crosstalk": {"mean_fired_neighbors": 0.05}}}),
}
"""Name of a fault: what is to be said, and how it is made"""
NOT_OF_BITS = {"dead time", "afterpulsing", "crosstalk"}


def recorded(kind, seed, light=None, extra=None, spoil=None, sensor=None):
    """Levels with a fault, and their rates without."""
    known, side = camera(kind), SIDES[kind]
    faulty, shape = changed(known, **(sensor or {})), (side, side)
    lit = draw_fixed_pattern(known, shape).efficiency_factor[None]
    levels, rates = [], []
    for number, (exposure_s, light_hz) in enumerate(LEVELS[kind]):
        rng = np.random.default_rng([seed, number])
        times = np.arange(FRAMES) / RATE_HZ
        rate = light_hz * lit
        if light:
            rate = rate * light(times, shape, rng)
        if extra:
            rate = rate + extra(FRAMES, shape, rng, 2.0 / exposure_s)
        rate = np.broadcast_to(rate, (FRAMES, *shape))
        own = changed(faulty, exposure_s=exposure_s)
        frames = np.array(expose_rate(rate, own, seed=seed, sequence=f"{number}").counts)
        if spoil:
            frames, times = spoil(frames, times)
        levels.append(Level(frames, exposure_s, light_hz, times_s=times))
        rates.append(light_hz * lit)
    return levels, Model(known, rates)


def said(found):
    """Faults and causes that a comparison names."""
    names = {each.kind for each in found.faults} | {each.name for each in found.causes}
    return names | ({"order"} if found.arrangement.is_other else set())


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("camera", nargs="?", choices=SIDES, default="counts")
    parser.add_argument("seeds", nargs="?", type=int, default=1)
    parser.add_argument("faults", nargs="*", choices=[*FAULTS, []], metavar="FAULT")
    options = parser.parse_args()
    names = options.faults or [
        each for each in FAULTS if options.camera == "counts" or each not in NOT_OF_BITS
    ]
    print(f"{'fault':18s}{'right':>6s}{'wrong':>6s}{'missed':>7s}{'CPU s':>7s}  said else")
    total = np.zeros(3, int)
    for name in names:
        wanted, how = FAULTS[name]
        score, other, start = np.zeros(3, int), set(), time.process_time()
        for seed in range(1, options.seeds + 1):
            levels, model = recorded(options.camera, seed, **how)
            found = said(compare_recordings(levels, model.drawn(levels, seed + 10_000), model))
            right = {wanted} if wanted else set()
            place = 0 if found == right else 1 if found - right else 2
            score[place] += 1
            other |= found - right
        spent = (time.process_time() - start) / options.seeds
        print(f"{name:18s}{score[0]:6d}{score[1]:6d}{score[2]:7d}{spent:7.1f}  "
              f"{', '.join(sorted(other))}", flush=True)  # fmt: skip
        total += score * (wanted is not None)
    print(f"{'all faults':18s}{total[0]:6d}{total[1]:6d}{total[2]:7d}")


if __name__ == "__main__":
    main()
