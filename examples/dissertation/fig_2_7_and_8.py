"""
Figures 2.7 and 2.8: analog counter in low light
================================================

Four of 16 pixels of a simulated row detect 300 photons per second plus dark counts. The output
falls by a step per event, of 10 mV (left) and 30 mV (right), and by leakage. The bend of a real
counter toward the bottom of its swing is not modeled.
"""

import matplotlib.pyplot as plt
import numpy as np
from scipy.stats import linregress

from megalopta.sensor import AnalogCounter, changed, expose_events, preset
from megalopta.sensor.spad.counters import analog_pixels

ROW, LIGHT_HZ = (1, 16), 300.0
figure, panels = plt.subplots(1, 2, sharey=True, figsize=(10, 4), layout="constrained")
for axes, step_v in zip(panels, (10e-3, 30e-3), strict=True):
    sensor = changed(preset("spadcam"), counter={"step_v": step_v}, exposure_s=10e-3 / step_v)
    counter = sensor.counter
    assert isinstance(counter, AnalogCounter)
    stream = expose_events(np.full((1, *ROW), LIGHT_HZ), sensor, seed=0, stream="transient")
    pixels = analog_pixels(counter, ROW, sensor.exposure_s, sensor.device_seed)
    time_s = np.linspace(0, sensor.exposure_s, 4001)
    straightness, falls_v = [], []
    for column in range(ROW[1]):
        times_s = stream.time_s[stream.column == column]
        events = np.searchsorted(times_s, time_s, side="right")
        leaked_v = pixels.leaked_v[0, column] * time_s / sensor.exposure_s
        fallen_v = np.minimum(events * pixels.step_v[0, column] + leaked_v, counter.swing_v)
        output_v = counter.supply_v - fallen_v
        is_up = fallen_v < counter.swing_v
        straightness.append(linregress(events[is_up], output_v[is_up]).rvalue ** 2)
        falls_v.append(fallen_v[is_up][-1] / events[is_up][-1])
        if column < 4:
            axes.step(1e3 * time_s, output_v, where="post", label=f"pixel {column}")
    axes.set(title=f"steps of {1e3 * step_v:g} mV", xlabel="time since reset (ms)")
    fall_mv, sigma_mv = 1e3 * np.mean(falls_v), 1e3 * np.std(falls_v)
    name, least = f"{1e3 * step_v:g} mV", np.floor(1e5 * min(straightness)) / 1e5
    print(f"fall per event: dissertation about {name}; here {fall_mv:.3f} ± {sigma_mv:.3f} mV")
    print(f"R² over events, {name}: dissertation > 0.99; here ≥ {least} in all {ROW[1]} pixels")
panels[0].set_ylabel("output (V)")
panels[0].legend()
plt.show()
