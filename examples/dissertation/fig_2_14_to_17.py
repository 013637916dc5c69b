"""
Figures 2.14 to 2.17: an edge crosses SPADCAM
=============================================

The edge of a plate moves by 1 mm/s across a row of 12 pooled pixels, with the noise of the light
alone and with the model of SPADCAM: frames, responses of NDM and NDS, and one pixel with its
detectors while the edge passes and returns. Printed counts are means over all rows, ± σ of a row.
``megalopta spadcam figures`` draws recordings.
"""

import matplotlib.pyplot as plt
import numpy as np

from megalopta.camera.motion_bench import FRAME_RATE_HZ, FRAMES, SENSORS, detector, pooled, record

SPEED_MM_S, SHOWN = 1.0, 4
figure, panels = plt.subplots(2, 4, figsize=(13, 8), layout="constrained")
for (left, middle, right, below), (name, sensor) in zip(panels, SENSORS.items(), strict=True):
    rows = pooled(record(SPEED_MM_S, sensor).counts)  # (2·FRAMES, recordings·rows, 12)
    row = rows[:, 0]
    responses = {
        method: detector(method).respond(row[:, np.newaxis])[:, 0, 1:-1]
        for method in ("NDM", "NDS")
    }
    maps = {"2.14: counts": row, "2.15: NDM": responses["NDM"], "2.16: NDS": responses["NDS"]}
    for axes, (title, values) in zip((left, middle, right), maps.items(), strict=True):
        figure.colorbar(axes.imshow(values[:FRAMES], aspect="auto", interpolation="nearest"))
        axes.set(title=f"{title}, {name}", xlabel="pixel or detector", ylabel="frame")
    time_s = np.arange(2 * FRAMES) / FRAME_RATE_HZ
    curves = {"pooled pixel": row[:, SHOWN + 1]}
    curves |= {method: response[:, SHOWN] for method, response in responses.items()}
    for label, curve in curves.items():
        below.plot(time_s, curve / curve.max(), label=label)
    below.set(title=f"2.17: {name}", xlabel="time (s)", ylabel="share of largest")
    levels = {"open": (rows[0], 65), "hidden": (rows[FRAMES - 1], 27)}
    for state, (pixels, stated) in levels.items():
        means = pixels.mean(axis=1)
        print(f"{state} counts per pixel and frame: dissertation about {stated};", end=" ")
        print(f"here, {name}, {means.mean():.1f} ± {means.std():.1f}")
panels[0, 3].legend()
plt.show()
