"""Draw a dark forest's floor as a SPAD array and an InGaAs CTIA array see it.

The figure night-bands goes to out/figures.

Motion detectors rely on contrast between neighbors. The product of differences in two renderings
with independent noise has the noise-free square as its mean. The information on motion from a
device is the Poisson bound's sum over a block, the squared slope over the variance of the reading
(`flow.metrics`): counts in another band, and in the dark, are noise.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure as Canvas
from numpy.typing import NDArray

from megalopta.core.arrays import Floats
from megalopta.core.progress import progress
from megalopta.plotting.picture import Figure, write_figure
from megalopta.plotting.style import BLACK, BLUE, GRAY, ORANGE
from megalopta.render import RenderSettings, SceneRenderer, frame_seed
from megalopta.reproduction.drawing import Run
from megalopta.scenes import Forest, Light, PerspectiveCamera, Trajectory, build_scene
from megalopta.sensor import IMAGE_SENSORS, ImageSensor, expectation

FLOOR_BANDS_NM = tuple((float(low), float(low + 100)) for low in range(400, 1700, 100))
FLOOR_LIGHT = Light(level="starlight", sky="natural")
_DEPTH = 12
"""Path depth; leaves absorb little beyond 700 nm, and 8 would omit 2 % of the light."""

DEVICES = "array-12x4", "ctia_ingaas_quiet"
EXPOSURE_S = 0.1
"""Exposure of both."""
BLOCK_PX = 8
_CAPTION = (
    "Forest `rainforest` under a natural starlit sky, {0} × {0} px of 60°, in bands of 100 nm; "
    "leaves absorb little beyond 700 nm, so more of the infrared comes down. "
    f"Events in {EXPOSURE_S:g} s per band of the presets {DEVICES[0]} and {DEVICES[1]}, each with "
    "its lens, pixel and efficiency; dotted: in the dark. Contrast is the RMS difference of "
    "neighbors along rows over the mean, without rendering noise."
)
Reals = NDArray[np.float32]
_KINDS = "silicon SPAD", "InGaAs CTIA"
_COLUMNS = "spad_events", "ctia_electrons"


@dataclass(frozen=True)
class SeenFloor:
    """Signal and noise of a device that sees the floor for one exposure."""

    events: Floats
    """(B,): events by light, mean over the pixels; 0 where the device is blind."""
    dark: float
    """Events in the dark."""
    noise: float
    """Root of the mean variance of the reading, in its unit."""
    error_px: float
    """Least standard error of motion along a row, for a block of 8 × 8 px, two frames."""


@cache
def floor_passes(
    size_px: int = 48, samples: int = 576
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Return radiance (H, W, B) of the same view, twice, W·m⁻²·sr⁻¹·nm⁻¹ in `FLOOR_BANDS_NM`."""
    forest = Forest.model_validate({"preset": "rainforest"})
    camera = PerspectiveCamera(width=size_px, height=size_px, fov_deg=60)
    path = Trajectory(frames=2, position_m=(0, 0, 1.5), look_at_m=(6, 0, 0.8))
    settings = RenderSettings(
        samples_per_pixel=samples, max_depth=_DEPTH, bands_nm=FLOOR_BANDS_NM, integrator="path"
    )
    with progress("Rendering the floor of a rain forest", 3, "step") as advance:
        renderer = SceneRenderer(build_scene(forest, FLOOR_LIGHT, camera, path), camera, settings)
        advance()
        passes = []
        for number in range(2):
            passes.append(renderer.radiance(path.poses()[0], frame_seed(0, 0, number)))
            advance()
    return passes[0], passes[1]


def contrast(first: Reals, second: Reals) -> tuple[Floats, Floats]:
    """RMS difference of neighbors along rows over the mean, and its error, (B,).

    From two renderings (H, W, B). The error is for this number of pixels, as if rows were
    independent; both are NaN where noise hides the contrast.
    """
    light = np.sqrt(first.mean(axis=(0, 1)) * second.mean(axis=(0, 1)))
    products = np.diff(first / light, axis=1) * np.diff(second / light, axis=1)
    of_row = products.mean(axis=1, dtype=np.float64)
    square, error = of_row.mean(axis=0), of_row.std(axis=0, ddof=1) / np.sqrt(len(of_row))
    found = np.sqrt(np.where(square > error, square, np.nan))
    return found, error / (2 * found)


def seen_by(passes: tuple[Reals, Reals], sensor: ImageSensor) -> SeenFloor:
    """Return a device's signal and noise at the floor, `passes` (H, W, B) in `FLOOR_BANDS_NM`."""
    curve = sensor.efficiency
    inside = [
        curve.wavelengths_nm[0] <= low and high <= curve.wavelengths_nm[-1]
        for low, high in FLOOR_BANDS_NM
    ]
    bands = [band for band, is_inside in zip(FLOOR_BANDS_NM, inside, strict=True) if is_inside]
    light = [each[np.newaxis, ..., inside].astype(np.float64) for each in passes]
    dark = expectation(0 * light[0], bands, sensor)
    events = np.zeros(len(FLOOR_BANDS_NM))
    for place, index in enumerate(np.flatnonzero(inside)):
        one = np.zeros_like(light[0])
        one[..., place] = light[0][..., place]
        lit = expectation(one, bands, sensor)
        events[index] = (lit.mean_events - dark.mean_events).mean()
    readings = [expectation(each, bands, sensor) for each in light]
    rises = [np.diff(each.mean_reading - dark.mean_reading, axis=2) for each in readings]
    variance = readings[0].reading_variance
    # The difference of two frames has twice the variance.
    information = float(np.mean(rises[0] * rises[1] / (2 * variance[..., 1:])))
    least = 1 / np.sqrt(information * BLOCK_PX**2) if information > 0 else np.inf
    noise = float(np.sqrt(variance.mean()))
    return SeenFloor(events, float(dark.mean_events.mean()), noise, float(least))


def _figure(run: Run) -> Figure:
    passes = floor_passes(24, 64) if run.is_quick else floor_passes()
    seen = [seen_by(passes, IMAGE_SENSORS[name]) for name in DEVICES]
    numbers = _numbers(passes) | {
        name: each.events for name, each in zip(_COLUMNS, seen, strict=True)
    }
    size = len(passes[0])
    return Figure(
        title="The floor of a rain forest by starlight, with silicon and with InGaAs",
        caption=_CAPTION.format(size),
        draw=partial(_draw, numbers=numbers, dark=[each.dark for each in seen]),
        numbers=numbers,
        printed={
            "events of light per pixel": _pair(f"{each.events.sum():.3g}" for each in seen),
            "events in the dark": _pair(f"{each.dark:.3g}" for each in seen),
            "noise of a reading": _pair(f"{each.noise:.3g}" for each in seen),
            f"least error of {BLOCK_PX} × {BLOCK_PX} px, two frames": _pair(
                f"{each.error_px:.2g} px" for each in seen
            ),
        },
        printed_by=_KINDS,
        height_in=3.6,
    )


def _numbers(passes: tuple[Reals, Reals]) -> dict[str, Floats]:
    """Return light and contrast of the bands, from two renderings."""
    light = FLOOR_LIGHT.resolved().spectrum()
    sharp, error = contrast(*passes)
    return {
        "wavelength_nm": np.array(FLOOR_BANDS_NM).mean(axis=1),
        "sky_radiance_W_m2_sr_nm": np.array(
            [light(np.linspace(*band, 101)).mean() / np.pi for band in FLOOR_BANDS_NM]
        ),
        "floor_radiance_W_m2_sr_nm": passes[0].mean(axis=(0, 1), dtype=np.float64),
        "contrast": sharp,
        "contrast_error": error,
    }


def _pair(texts: Iterable[str]) -> tuple[str, str]:
    first, second = texts
    return first, second


def _draw(canvas: Canvas, numbers: Mapping[str, Floats], dark: Sequence[float]) -> None:
    middle, sky, floor, sharp, error, *events = numbers.values()
    light, seen, right = canvas.subplots(1, 3)
    light.semilogy(middle, sky, color=GRAY, label="open sky")
    light.semilogy(middle, floor, color=BLACK, marker="o", label="floor")
    light.set(ylabel="Radiance (W/m²/sr/nm)")
    light.legend(loc="upper left", fontsize="small")
    for each, rest, kind, color in zip(events, dark, _KINDS, (BLUE, ORANGE), strict=True):
        seen.semilogy(middle, np.where(each > 0, each, np.nan), color=color, marker="o", label=kind)
        seen.axhline(rest, color=color, linestyle=":")
    seen.set(ylabel="Events per pixel")
    seen.legend(loc="upper left", bbox_to_anchor=(0, 0.93), fontsize="small")
    right.errorbar(middle, sharp, error, color=BLACK, marker="o")
    right.set(ylabel="Contrast of neighbors", ylim=(0, None))
    for axes in (light, seen, right):
        axes.set_xlabel("Wavelength (nm)")


if __name__ == "__main__":
    write_figure(_figure(Run(False, {}, {})), Path("out/figures"))
