"""Print SHA-256 of what presets, and effects added to presets, read of fixed light."""

import hashlib
from itertools import product

import numpy as np

from megalopta import sensor as sensors
from megalopta.sensor import IMAGE_SENSORS as PRESETS
from tests.sensor.plainest import sub_frames

LIGHT = np.random.default_rng(0).uniform(0.05, 1.0, (3, 6, 9, 2))
FLOW = np.full((2, 6, 9, 2), (0.7, -0.4))
KEY = {"seed": 5, "stream": "s", "first_frame": 2}
WARM = {"dark_counts": {"bulk_mean_hz_um2": 1.0}, "temperature": {"celsius": 35.0}}
SLOW = {"kind": "nonparalyzable", "dead_time_s": 1e-4, "mismatch_sigma": 0.1}
EFFECTS = {
    "stationary": {"dead_time": {**SLOW, "start": "stationary"}},
    "twilight": {"dead_time": {**SLOW, "twilight_s": 2e-5}},
    "recharge": {"dead_time": {**SLOW, "recharge_s": 5e-5}},
    "paralyzable": {"dead_time": {**SLOW, "kind": "paralyzable"}},
    "gate": {"gate": {"period_s": 1e-2, "width_s": 5e-3, "phase_s": 1e-3}},
    "afterpulses": {"afterpulsing": {"mean_carriers": 0.1, "mismatch_sigma": 0.2}},
    "crosstalk": {"crosstalk": {"mean_fired_neighbors": 0.1, "diagonal": 0.3}},
    "telegraph": {"telegraph": {"share": 0.5, "traps": 2}, **WARM},
    "lens": {"lens": {"falloff_fov_deg": 60.0, "blur_m": 3e-5}, "filters": {"mosaic": ["W"]}},
    "wrap": {"counter": {"kind": "digital", "capacity": 100, "overflow": "wrap"}},
    "times": {"tcspc": {"bins": 8, "period_s": 1e-5}, "jitter": {"sigma_s": 1e-9}},
}


def readings(sensor):
    shortest, *_, longest = sensor.efficiency.wavelengths_nm
    bands_nm = [(shortest, shortest + 50), (longest - 50, longest)]
    light = 200 * LIGHT / sensors.detected_photons(LIGHT, bands_nm, sensor).mean()
    exposure = sensors.expose(light, bands_nm, sensor, **KEY, expectation=True)
    yield "expose", [*vars(exposure).values(), *vars(exposure.expectation).values()]
    if sensor.kind != "spad":
        return
    still_hz = sensors.detection_rate(light, bands_nm, sensor)
    for motion, hz in ("still", still_hz), ("moving", sub_frames(still_hz, FLOW, 3)):
        yield f"{motion} moments", sensors.reading_moments(hz, sensor)
        for runs, kind in (False, motion), (True, f"{motion} running"):
            key = {**KEY, "frame_period_s": 0.2, "free_running": runs}
            yield f"{kind} counts", vars(sensors.expose_rate(hz, sensor, **key)).values()
            yield f"{kind} events", vars(sensors.expose_events(hz, sensor, **key)).values()
            if not sensor.crosstalk.is_on and sensor.dead_time.start == "live":
                yield f"{kind} bits", [sensors.expose_binary(hz, sensor, **key)]
        if sensor.counter.kind == "analog":
            yield f"{motion} codes", [sensors.expose_adc(hz, sensor, **KEY)]
            yield f"{motion} pairs", [sensors.expose_adc(hz, sensor, **KEY, together=2)]
    if sensor.tcspc.is_on:
        yield "histograms", [sensors.expose_histograms(still_hz, sensor, **KEY)]


for name, effect in product(("ideal", "spadcam"), EFFECTS):
    PRESETS[f"{name} {effect}"] = sensors.changed(PRESETS[name], **EFFECTS[effect])
for name, sensor in PRESETS.items():
    for kind, values in readings(sensor):
        content = b"".join(np.asarray(value).tobytes() for value in values if np.ndim(value))
        print(name, kind, hashlib.sha256(content).hexdigest(), flush=True)
