"""Draw flight.gif, the moving picture of README: a flight through a forest while night falls.

    python docs/pictures/flight.py

Every frame is rendered in its own light, as `flight.yaml` says, to `out/pictures/flight`; levels
that are there are not rendered again. The sensor counts the light as rendered; the panel of light
is denoised. Its brightness falls with the logarithm of the illuminance, to a floor. Motion is shown
and its error measured where the content stays in the frame; elsewhere no second frame shows it.
"""

from pathlib import Path
from typing import Any

import numpy as np
import yaml
from denoised import denoised, fine_albedo, gray_counts
from numpy.typing import NDArray
from PIL import Image, ImageDraw
from skimage.measure import block_reduce

from megalopta.config.model import Configuration
from megalopta.core.quantities import number
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
PANEL_PX, FLOW_PX, WHEEL_PX, LETTERS_PX = (408, 306), (272, 204), 80, 23
FRAME_MS, DARKEST, COLORS = 300, 0.35, (72, 96, 64)
METHODS = {"PF": "Poisson flow", "DIS": "DIS"}
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


def colored(flow: NDArray[Any]) -> Image.Image:
    """Return flow as a panel."""
    picture = Image.fromarray(flow_to_rgb(flow, FULL_COLOR_PX))
    return picture.resize(FLOW_PX, Image.Resampling.NEAREST)


def draw_level(name: str, settings: Configuration, seen: Arrays, share: float) -> list[Image.Image]:
    """Return the pictures of a level; `share` of the decades from the darkest are passed."""
    bands_nm, white = settings.render.bands_nm, settings.scene.white(settings.light)
    clean = [linear_srgb(denoised(*pair), bands_nm, white)
             for pair in zip(seen["radiance"], seen["albedo"], strict=True)]  # fmt: skip
    curve, brightness = ToneCurve.of(clean), DARKEST + (1 - DARKEST) * share
    binned = block_reduce(seen["radiance"], (1, BINNED_PX, BINNED_PX, 1), np.mean)
    counts = expose(binned, bands_nm, settings.sensors[0], seed=0, stream=name).counts
    illuminance = lux(settings.light.resolved().illuminance_lux)
    wheel, pictures = Image.fromarray(wheel_legend(WHEEL_PX)), []
    disk = Image.new("L", wheel.size)
    ImageDraw.Draw(disk).ellipse((0, 0, WHEEL_PX - 1, WHEEL_PX - 1), fill=255)
    for at, flow in enumerate(seen["flow"]):
        truth = block_reduce(flow, (BINNED_PX, BINNED_PX, 1), np.mean) / BINNED_PX
        height, width = truth.shape[:2]
        arrives = truth + np.stack(np.meshgrid(np.arange(width), np.arange(height)), axis=-1)
        leaves = ((arrives < 0) | (arrives > (width - 1, height - 1))).any(axis=-1)
        truth[leaves] = np.nan
        light = Image.fromarray((encode_srgb(curve(clean[at])) * brightness).astype(np.uint8))
        photons = gray_counts(counts[at]).resize(PANEL_PX, Image.Resampling.NEAREST)
        above: Row = [
            (f"light: {name}, {illuminance}", light.resize(PANEL_PX, Image.Resampling.LANCZOS)),
            (f"photons: {number(float(counts[at].mean()))} per pixel", photons),
        ]
        motion = colored(truth)
        motion.paste(
            wheel, (0, FLOW_PX[1] - WHEEL_PX), wheel.convert("L").point(lambda v: 255 * (v < 255))
        )
        below = [("true motion", motion)]
        for method, title in METHODS.items():
            estimate = optical_flow(counts[at], counts[at + 1], method)
            estimate[leaves] = np.nan
            error_px = np.nanmedian(np.linalg.norm(estimate - truth, axis=-1))
            below.append((f"{title}: {error_px:.2g} px off", colored(estimate)))
        pictures.append(sheet([above, below], LETTERS_PX))
    return pictures


def few_colors(picture: Image.Image) -> Image.Image:
    """Return a picture of as many colors for light and photons, motion, and the wheel as asked."""
    split = PANEL_PX[1] + 2 * LETTERS_PX
    parts = (0, 0, picture.width, split), (0, split, *picture.size)
    seen = [*(picture.crop(part) for part in parts), Image.fromarray(wheel_legend(WHEEL_PX))]
    palette, colors = Image.new("P", (1, 1)), []
    for part, count in zip(seen, COLORS, strict=True):
        colors += (part.quantize(count).getpalette() or [])[: 3 * count]
    palette.putpalette([255 if value > 247 else value for value in colors])  # the page's white
    return picture.quantize(palette=palette, dither=Image.Dither.NONE)


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
    PICTURE.write_bytes(gif([few_colors(each) for each in images], FRAME_MS))
    print(f"{PICTURE}: {PICTURE.stat().st_size / 1e6:.1f} MB, {len(images)} frames")
