"""Draw flight.gif, the moving picture of README: a flight through a forest while night falls.

    python docs/pictures/flight.py

Every frame is rendered in its own light, as `flight.yaml` says, to `out/pictures/flight`; levels
that are there are not rendered again. The sensor counts the light as rendered; the panel of light
is denoised. Its brightness falls with the logarithm of the illuminance, to a floor.
"""

from pathlib import Path
from typing import Any

import numpy as np
import yaml
from denoised import denoised, fine_albedo, gray_counts
from numpy.typing import NDArray
from PIL import Image
from skimage.measure import block_reduce

from megalopta.config.model import Configuration
from megalopta.flow import flow_to_rgb, optical_flow
from megalopta.flow.color_wheel import wheel_legend
from megalopta.render import SceneRenderer, frame_seed
from megalopta.report.images import Row, gif, sheet
from megalopta.report.text import lux
from megalopta.scenes import ToneCurve
from megalopta.scenes.spectra.color import encode_srgb, linear_srgb
from megalopta.sensor import expose
from megalopta.stages.render import build

HERE, OUT = Path(__file__).parent, Path("out/pictures/flight")
PICTURE = HERE.parent / "flight.gif"
PANEL_PX, LETTERS_PX, FRAME_MS, COLORS, DARKEST = (408, 306), 21, 300, 128, 0.2
ASKED = yaml.safe_load((HERE / "flight.yaml").read_text("utf-8"))
PAIRS, BINNED_PX, FULL_COLOR_PX = (
    ASKED[name] for name in ("pairs_per_level", "binned_px", "full_color_px")
)
Arrays = dict[str, NDArray[Any]]


def render(settings: Configuration, first: int, path: Path) -> Arrays:
    """Return radiance, albedo and true flow of the frames of a level, the first at `first`."""
    if not path.exists():
        scene, poses, frames = build(settings), settings.trajectory.poses(), range(PAIRS + 1)
        renderer = SceneRenderer(scene, settings.camera, settings.render, poses)
        shown = poses[first : first + PAIRS + 1]
        path.parent.mkdir(parents=True, exist_ok=True)
        np.savez(
            path,
            radiance=[renderer.radiance(shown[at], frame_seed(0, first + at)) for at in frames],
            albedo=fine_albedo(scene, settings.camera, settings.render, shown),
            flow=[renderer.truth(poses, first + at).flow_forward for at in frames[:-1]],
        )
    return dict(np.load(path))


def amount(photons: float) -> str:
    """Return a number of photons in words, to two digits."""
    name, unit = next(
        pair for pair in (("million", 1e6), ("thousand", 1e3), ("", 1)) if photons >= pair[1] / 10
    )
    return f"{float(f'{photons / unit:.2g}'):g} {name}".strip()


def colored(flow: NDArray[Any]) -> Image.Image:
    """Return flow as a panel."""
    picture = Image.fromarray(flow_to_rgb(flow, FULL_COLOR_PX))
    return picture.resize(PANEL_PX, Image.Resampling.NEAREST)


def draw_level(name: str, settings: Configuration, seen: Arrays, share: float) -> list[Image.Image]:
    """Return the pictures of a level; `share` of the decades from the darkest are passed."""
    bands_nm, white = settings.render.bands_nm, settings.scene.white(settings.light)
    clean = [linear_srgb(denoised(*pair), bands_nm, white)
             for pair in zip(seen["radiance"], seen["albedo"], strict=True)]  # fmt: skip
    curve, brightness = ToneCurve.of(clean), DARKEST + (1 - DARKEST) * share
    binned = block_reduce(seen["radiance"], (1, BINNED_PX, BINNED_PX, 1), np.mean)
    counts = expose(binned, bands_nm, settings.sensors[0], seed=0, stream=name).counts
    illuminance = lux(settings.light.resolved().illuminance_lux)
    pictures = []
    for at, flow in enumerate(seen["flow"]):
        truth = block_reduce(flow, (BINNED_PX, BINNED_PX, 1), np.mean) / BINNED_PX
        light = Image.fromarray((encode_srgb(curve(clean[at])) * brightness).astype(np.uint8))
        photons = gray_counts(counts[at]).resize(PANEL_PX, Image.Resampling.NEAREST)
        found: Row = [
            (f"motion by {method}: off by {error:.2g} px", colored(estimate))
            for method in ("PF", "DIS")
            for estimate in [optical_flow(counts[at], counts[at + 1], method)]
            for error in [np.nanmedian(np.linalg.norm(estimate - truth, axis=-1))]
        ]
        small = PANEL_PX[0] // 3, PANEL_PX[1] // 3
        wheel = Image.fromarray(wheel_legend(small[1]))
        top: Row = [
            (f"light: {name}, {illuminance}", light.resize(PANEL_PX, Image.Resampling.LANCZOS)),
            (f"photons: {amount(float(counts[at].mean()))} per pixel", photons),
        ]
        below: Row = [("true motion", colored(truth).resize(small)), ("color: direction", wheel)]
        pictures.append(sheet([top, found, below], LETTERS_PX).quantize(COLORS, dither=0))
    return pictures


if __name__ == "__main__":
    levels = {
        name: Configuration.model_validate({**ASKED["configuration"], "light": light})
        for name, light in ASKED["levels"].items()
    }
    decades = [np.log10(each.light.resolved().illuminance_lux) for each in levels.values()]
    images = []
    for index, (name, settings) in enumerate(levels.items()):
        seen = render(settings, index * PAIRS, OUT / f"{name}.npz")
        share = float((decades[index] - decades[-1]) / (decades[0] - decades[-1]))
        images += draw_level(name, settings, seen, share)
        images[-1].convert("RGB").save(OUT / f"{name}.png")
    PICTURE.write_bytes(gif(images, FRAME_MS))
    print(f"{PICTURE}: {PICTURE.stat().st_size / 1e6:.1f} MB, {len(images)} frames")
