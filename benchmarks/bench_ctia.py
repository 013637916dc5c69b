"""Speed of reading an array of CTIA pixels, against drawing the same noise with NumPy alone.

Frames of 240 × 240 pixels under half to one and a half times airglow. The reference draws, from
arrays that are ready, what physics asks of every pixel: `Generator.poisson` of the photoelectrons
and of both dark currents and one `Generator.normal`, with the same bit generator. What the array
does beyond: discharge with finite gain and leaking gate, bias in the middle of it, saturation.
Ratios of medians of alternating repeats, one thread; 1 means as fast.

Floors: without shunt 0.45, with shunt 0.35, from radiance 0.4.
"""

import time
from collections.abc import Callable

import numpy as np

from megalopta.scenes.spectra.outdoors import MOONLESS_ZENITH
from megalopta.sensor import CtiaSensor, ctia_preset, expose, expose_photocurrent, photocurrent
from megalopta.sensor.ctia.photodiode import ELEMENTARY_CHARGE_C
from megalopta.sensor.sampling.streams import generator

SHAPE = (4, 240, 240)
REPEATS = 7
BANDS_NM = [(900.0, 1100.0), (1100.0, 1300.0), (1300.0, 1500.0), (1500.0, 1700.0)]


def clock(call: Callable[[], object]) -> float:
    start = time.process_time()
    call()
    return time.process_time() - start


def ratio(ours: Callable[[], object], reference: Callable[[], object]) -> float:
    """Speed of ours over the reference's."""
    ours(), reference()
    seconds = np.array([(clock(ours), clock(reference)) for _ in range(REPEATS)])
    medians = np.median(seconds, axis=0)
    return float(medians[1] / medians[0])


def night() -> np.ndarray:
    """Radiance (T, H, W, B)."""
    means = [MOONLESS_ZENITH(np.linspace(*band, 1025)).mean() for band in BANDS_NM]
    strength = np.random.default_rng(0).uniform(0.5, 1.5, (*SHAPE, 1))
    return np.asarray(strength * means, np.float32)


def noise_alone(sensor: CtiaSensor, current_a: np.ndarray) -> Callable[[], object]:
    """Four draws per pixel with NumPy."""
    rng, per_ampere = generator(0), sensor.exposure_s / ELEMENTARY_CHARGE_C
    signal = current_a * per_ampere
    dark = np.full(SHAPE, sensor.diode.saturation_current_a * per_ampere)
    return lambda: (
        rng.poisson(signal) + rng.poisson(dark) - rng.poisson(dark) + rng.normal(0.0, 1.0, SHAPE)
    )


def report(name: str, value: float) -> None:
    print(f"{name:>34}{value:8.2f}", flush=True)


def main() -> None:
    light = night()
    for label, name in (("ctia, no shunt", "ctia_ingaas_quiet"), ("ctia, shunt", "ctia_si")):
        sensor = ctia_preset(name)
        # both see the same currents, so that only the pixels differ
        current = photocurrent(light, BANDS_NM, ctia_preset("ctia_ingaas_quiet"))
        reference = noise_alone(sensor, current)
        ours = lambda: expose_photocurrent(current, sensor, seed=0, stream="bench")  # noqa: B023, E731
        report(label, ratio(ours, reference))
    quiet = ctia_preset("ctia_ingaas_quiet")
    reference = noise_alone(quiet, photocurrent(light, BANDS_NM, quiet))
    report(
        "ctia, radiance to volts",
        ratio(lambda: expose(light, BANDS_NM, quiet, seed=0, stream="bench"), reference),
    )


if __name__ == "__main__":
    main()
