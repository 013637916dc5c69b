"""Plain simulation of pixels, one event after another: an oracle that shares no code with `sensor`.

Every pixel has its next photon and a list of released carriers; the earliest of all is handled
next. Light of crosstalk arrives at once, in the order in which it is sent.
"""

import math

import numpy as np
from numba import njit


@njit
def simulate(rng, frames, rate_hz, exposure_s, pixel, gate, fired):
    """Counts (frames, rows, columns) from a live start, at arrival rates (rows, columns).

    `pixel`: dead time, whether it is paralyzable, twilight, recharging, mean number of carriers
    and mean delay. `gate`: period and width; period 0: always open. `fired`: probability to fire
    each of the four neighbors.
    """
    tau, is_paralyzable, twilight, recharge, carriers, delay = pixel
    period, width = gate
    rows, columns = rate_hz.shape
    counts = np.zeros((frames, rows, columns), np.int64)
    trapped = np.empty((rows * columns, 4096))
    queue = np.empty(4096, np.int64)
    for frame in range(frames):
        ready, due = np.full(rows * columns, -np.inf), np.full(rows * columns, np.inf)
        photon, number = np.empty(rows * columns), np.zeros(rows * columns, np.int64)
        for at in range(rows * columns):
            rate = rate_hz[at // columns, at % columns]
            photon[at] = rng.exponential(1 / rate) if rate > 0 else np.inf
        while True:
            # the earliest of photons, carriers and twilight pulses
            time, at, kind, which = exposure_s, -1, 0, 0
            for other in range(rows * columns):
                if photon[other] < time:
                    time, at, kind = photon[other], other, 0
                if due[other] < time:
                    time, at, kind = due[other], other, 1
                for carrier in range(number[other]):
                    if trapped[other, carrier] < time:
                        time, at, kind, which = trapped[other, carrier], other, 2, carrier
            if at < 0:
                break
            if kind == 0:
                photon[at] += rng.exponential(1 / rate_hz[at // columns, at % columns])
            elif kind == 1:
                due[at] = np.inf
            else:
                number[at] -= 1
                trapped[at, which] = trapped[at, number[at]]
            is_open = period == 0 or time % period < width
            if not is_open:
                continue
            waiting = 1
            queue[0] = at
            while waiting > 0:
                waiting -= 1
                at = queue[waiting]
                since = time - ready[at]
                if since < 0:
                    if is_paralyzable:
                        ready[at] = time + tau
                    elif since >= -twilight:
                        due[at] = ready[at]
                    continue
                if recharge > 0 and rng.random() < math.exp(-since / recharge):
                    continue
                counts[frame, at // columns, at % columns] += 1
                ready[at] = time + tau
                if carriers > 0:
                    for _ in range(rng.poisson(carriers)):
                        trapped[at, number[at]] = time + rng.exponential(delay)
                        number[at] += 1
                if fired > 0:
                    row, column = at // columns, at % columns
                    for down, right in ((-1, 0), (1, 0), (0, -1), (0, 1)):
                        y, x = row + down, column + right
                        if 0 <= y < rows and 0 <= x < columns and rng.random() < fired:
                            queue[waiting] = y * columns + x
                            waiting += 1
    return counts
