"""Flow where parts move by up to 18 px against each other: photographs in layers, discs, stereo.

Layers are photographs that come with scikit-image, a ground, a large disk that moves by 8 to 18 px
and a small one by 3 to 8 px. Discs have 12 px radius and move by 4.3 px over still ground. The
stereo pair is scikit-image's motorcycle at a third of its size, with its measured disparity. None
of them was used to set a parameter; gray methods are tuned to the light on other scenes. `boards`
measures the boards of whole frames (median, mean, share beyond 3 px, Fl, WAUC; 95 % CI of the first
two), alone if methods are named: `bench_large_motion.py PF "rife.onnx tuned"`. The shares of pixels
inside the ellipses of PF's covariance leave out 8 px around edges of the motion. Takes some twenty
minutes.
"""

import itertools
import sys
import time
from collections.abc import Iterator, Sequence

import numpy as np
from scipy.ndimage import distance_transform_edt
from skimage import data

from megalopta.assets_gen import generator
from megalopta.assets_gen.dead_leaves_model import dead_leaves
from megalopta.benchmark.clips import SHAPE, FlowClip, leaves_clip, middle, panorama_clips
from megalopta.benchmark.methods import block_detector
from megalopta.benchmark.panoramas import natural_templates
from megalopta.benchmark.whole_frames import MEAN, MEDIAN, METRICS, blocks_of, frame_errors
from megalopta.core.arrays import Floats
from megalopta.flow import optical_flow
from megalopta.flow.detectors.blocks import block_grid, mean_over_blocks
from megalopta.flow.stimuli.known_flow import Layer, MovingLayers

FLUXES = (1.0, 3.0, 10.0, 30.0, 100.0, 1000.0)
PICTURES = "astronaut", "camera", "chelsea", "coffee", "rocket", "gravel"
LUMINANCE, GAMMA = (0.2126, 0.7152, 0.0722), 2.2
CHI_SQUARED = 1.386, 4.605, 5.991
"""50, 90 and 95 % of two degrees of freedom"""

METHODS = ("PF", "PF-fast", "TV-L1 tuned", "DIS tuned", "FB tuned", "LK tuned")
CALIBRATION_PX = (160, 160)


def light_of(picture: Floats) -> Floats:
    gray = picture / 255 if picture.ndim == 2 else picture[..., :3] / 255 @ np.array(LUMINANCE)
    return np.asarray(gray**GAMMA)


def layer(texture: Floats, speed: float, rng: np.random.Generator, disk=None, shear=0.008) -> Layer:
    angle = rng.uniform(0, 2 * np.pi)
    velocity = speed * np.cos(angle), speed * np.sin(angle)
    elsewhere = np.roll(texture, rng.integers(texture.shape), axis=(0, 1))
    return Layer(elsewhere / elsewhere.mean(), velocity, rng.uniform(-shear, shear, (2, 2)), disk)


def clip(name: str, layers: list[Layer], shape: tuple[int, int]) -> FlowClip:
    scene = MovingLayers(layers)
    light = scene.light(shape, (0.0, 1.0))
    return FlowClip(name, light / light.mean(), scene.flow(shape, 0.0))


def photographs(number: int, shape: tuple[int, int] = SHAPE, fastest: float = 18) -> FlowClip:
    rng = generator(number, "large motion, photographs")
    ground, disk = (
        np.tile(light, (2, 2))
        for light in (
            light_of(getattr(data, PICTURES[(number + each) % len(PICTURES)])()) for each in (0, 1)
        )
    )
    x, y = rng.uniform(-80, 80, 2), rng.uniform(-90, 90, 2)
    large, small = (*x, rng.uniform(70, 95)), (*y, rng.uniform(10, 25))
    layers = [
        layer(ground, rng.uniform(0.5, 3), rng),
        layer(disk, rng.uniform(8, 18) * fastest / 18, rng, large),
        layer(ground, rng.uniform(3, 8) * fastest / 18, rng, small),
    ]
    return clip(f"photographs {number}", layers, shape)


def disc(number: int) -> FlowClip:
    rng = generator(number, "large motion, disc")
    leaves = dead_leaves((640, 640), rng, (4.0, 40.0))
    place = (*rng.uniform(-20, 20, 2), 12.0)
    layers = [layer(leaves, 0, rng, shear=0), layer(leaves, 4.3, rng, place, shear=0)]
    return clip(f"disc {number}", layers, (128, 160))


def motorcycle() -> FlowClip:
    left, right, disparity = data.stereo_motorcycle()

    def thirds(image: Floats) -> Floats:
        height, width = (side // 3 for side in image.shape)
        return image[: 3 * height, : 3 * width].reshape(height, 3, width, 3).swapaxes(1, 2)

    light = np.stack([thirds(light_of(each)).mean(axis=(2, 3)) for each in (left, right)])
    known = np.where(np.isfinite(disparity), disparity.astype(float), np.nan)
    right_px = -thirds(known).mean(axis=(2, 3)) / 3
    return FlowClip("motorcycle", light / light.mean(), np.stack((right_px, 0 * right_px), -1))


def errors(flow: Floats, scene: FlowClip) -> list[float]:
    """Median and mean over blocks, and % of pixels beyond 3 px; of a disc its median error."""
    off = np.hypot(*np.moveaxis(np.nan_to_num(flow) - scene.flow, -1, 0))
    if scene.name.startswith("disc"):
        return [float(np.median(off[scene.flow.any(axis=-1)])), np.nan, np.nan]
    blocks = mean_over_blocks(np.nan_to_num(flow), block_grid(off.shape, 24))[1:-1, 1:-1]
    of_blocks = np.hypot(*np.moveaxis(blocks - blocks_of(scene), -1, 0))
    known = np.isfinite(off)
    return [
        float(np.nanmedian(of_blocks)),
        float(np.nanmean(of_blocks)),
        100 * float((off[known] > 3).mean()),
    ]


def inside(counts: Floats, scene: FlowClip) -> list[float]:
    """Shares (%) of pixels inside their ellipses of 50, 90 and 95 %."""
    flow, covariance = optical_flow(*counts, return_covariance=True)
    off = flow - scene.flow
    changes = [
        np.linalg.norm(np.diff(scene.flow, axis=axis, append=np.nan), axis=-1) for axis in (0, 1)
    ]
    away = distance_transform_edt((changes[0] < 0.3) & (changes[1] < 0.3)) > 8
    away[:8], away[:, :8] = False, False
    at = np.linalg.solve(covariance[away], off[away][..., np.newaxis])[..., 0]
    squares = (at * off[away]).sum(axis=-1)
    return [100 * float((squares < each).mean()) for each in CHI_SQUARED]


def rows() -> Iterator[str]:
    kinds = {
        "photographs": [photographs(number) for number in range(len(PICTURES))],
        "motorcycle": [motorcycle()],
        "disc": [disc(number) for number in range(6)],
    }
    for kind, scenes in kinds.items():
        for flux in FLUXES:
            drawn = [middle(scene.counts(flux, 0), 2) for scene in scenes]
            pairs = list(zip(drawn, scenes, strict=True))
            for name in METHODS:
                method = block_detector(name)
                start = time.process_time()
                found = [errors(optical_flow(*counts, method), scene) for counts, scene in pairs]
                spent = (time.process_time() - start) / len(pairs)
                figures = "  ".join(f"{each:6.2f}" for each in np.mean(found, axis=0))
                yield f"{kind:12} {flux:6g}  {name:11} {figures}  {spent:5.2f} s"


def ellipses() -> Iterator[str]:
    """Shares of pixels inside PF's ellipses on four kinds of scenes that set no parameter."""
    forests = list(panorama_clips(natural_templates(), CALIBRATION_PX, headings=2))
    kinds = {
        "leaves": [leaves_clip(100 + number, CALIBRATION_PX) for number in range(4)],
        "forests": forests[::2],
        "photographs": [photographs(number, CALIBRATION_PX, 4.0) for number in range(4)],
        "large motion": [leaves_clip(200 + number, CALIBRATION_PX, 16.0) for number in range(4)],
    }
    for kind, scenes in kinds.items():
        for flux in FLUXES:
            shares = [inside(middle(scene.counts(flux, 0), 2), scene) for scene in scenes]
            found = "  ".join(f"{share:6.1f}" for share in np.mean(shares, axis=0))
            yield f"{kind:12} {flux:6g}  {found}"


def boards(methods: Sequence[str]) -> Iterator[str]:
    kinds = {
        "photographs": [photographs(number) for number in range(len(PICTURES))],
        "leaves": [leaves_clip(number) for number in range(6)],
        "forests": list(panorama_clips(natural_templates(), headings=2)),
    }
    for kind, scenes in kinds.items():
        board = frame_errors(scenes, methods, FLUXES)
        for flux, each in itertools.product(FLUXES, board.detectors):
            found = {name: board.over_scenes(name, each, flux) for name in METRICS}
            figures = "  ".join(f"{of.value:6.3f}" for of in found.values())
            ends = "  ".join(
                f"{found[name].low:.3f} … {found[name].high:.3f}" for name in (MEDIAN, MEAN)
            )
            yield f"{kind:12} {flux:6g}  {each.name:11} {figures}  ({ends})"


if __name__ == "__main__":
    if not sys.argv[1:]:
        print("scenes, photons per pixel, method: median, mean (px), beyond 3 px (%), CPU-s a pair")
        for row in rows():
            print(row, flush=True)
        print("scenes, photons per pixel: % of pixels inside ellipses of 50, 90 and 95 %")
        for row in ellipses():
            print(row, flush=True)
    print("scenes, photons per pixel, method:", ", ".join(METRICS.values()))
    for row in boards(sys.argv[1:] or METHODS):
        print(row, flush=True)
