"""Look of a rendered picture against a panorama: contrast, texture and color by height.

    python benchmarks/bench_looks.py forest.hdr PICTURE [--fov 75]

The picture, in linear sRGB (HDR, EXR, .npy) or sRGB (PNG), is as wide as the field of view and
looks ahead. Four such views are cut from the panorama. Both are brought to the panorama's pixels
and the same geometric mean of light. Colors are CIELAB's (D65), in the upper, middle and lower
third; lightness ends at 100. A ratio is the picture's figure over the photograph's, the mean of
four views.
"""

import argparse
from pathlib import Path

import numpy as np
from scipy.ndimage import map_coordinates, zoom

from megalopta.render import read_picture

LUMINANCE = np.array([0.2126, 0.7152, 0.0722])
TO_XYZ = np.array([[0.4125, 0.3576, 0.1804], LUMINANCE, [0.0193, 0.1192, 0.9503]])
GEOMETRIC_MEAN, THIRDS, WITHIN = 0.12, ("upper", "middle", "lower"), 1.5
RINGS, FITTED_CYCLES_PER_PX = 24, (0.02, 0.3)


def ring_means(power: np.ndarray, columns: int) -> tuple[np.ndarray, np.ndarray]:
    """Radial frequencies (cycles/px), (N,), and means over their rings.

    `power` is (H, W//2 + 1) in the order of `numpy.fft.rfft2` of an image of `columns` columns.
    """
    rows = len(power)
    radius = np.hypot(np.fft.fftfreq(rows)[:, np.newaxis], np.fft.rfftfreq(columns))
    edges = np.geomspace(2 / min(rows, columns), 0.5, RINGS + 1)
    ring = np.digitize(radius.ravel(), edges) - 1
    inside = (ring >= 0) & (ring < RINGS)
    count = np.bincount(ring[inside], minlength=RINGS)
    power_sum = np.bincount(ring[inside], power.ravel()[inside], RINGS)
    radius_sum = np.bincount(ring[inside], radius.ravel()[inside], RINGS)
    filled = count > 0
    return radius_sum[filled] / count[filled], power_sum[filled] / count[filled]


def fitted_slope(frequency: np.ndarray, power: np.ndarray) -> float:
    """Return the exponent of a power over frequencies from 0.02 to 0.3 cycles/px."""
    lower, upper = FITTED_CYCLES_PER_PX
    fitted = (frequency >= lower) & (frequency <= upper) & (power > 0)
    return float(np.polyfit(np.log(frequency[fitted]), np.log(power[fitted]), 1)[0])


def cielab(rgb: np.ndarray) -> np.ndarray:
    """L*, a*, b* (..., 3) of linear sRGB, with white at 1."""
    xyz = rgb @ TO_XYZ.T / TO_XYZ.sum(axis=1)
    x, y, z = np.moveaxis(
        np.where(xyz > 216 / 24389, np.cbrt(xyz), xyz * 841 / 108 + 4 / 29), -1, 0
    )
    return np.stack([116 * y - 16, 500 * (x - y), 200 * (y - z)], axis=-1)


def figures(rgb: np.ndarray) -> dict[str, float]:
    """Figures of a view (H, W, 3) in linear sRGB of any exposure."""
    light = np.maximum(rgb @ LUMINANCE, 1e-4 * float((rgb @ LUMINANCE).mean()))
    exposed = rgb * (GEOMETRIC_MEAN / np.exp(np.log(light).mean()))
    lab, logs = cielab(exposed.clip(0, 1)), np.log(light)
    window = np.outer(np.hanning(logs.shape[0] + 2), np.hanning(logs.shape[1] + 2))[1:-1, 1:-1]
    power = np.abs(np.fft.rfft2((logs - logs.mean()) * window)) ** 2
    result = {
        "slope of the spectrum": fitted_slope(*ring_means(power, logs.shape[1])),
        "contrast of log light": float(logs.std()),
        "gradient of log light": float(np.sqrt(np.mean(np.diff(logs, axis=1) ** 2))),
    }
    for third, part in zip(THIRDS, np.array_split(lab, 3), strict=True):
        flat = part.reshape(-1, 3)
        result[f"{third}: lightness"] = float(flat[:, 0].mean())
        result[f"{third}: chroma"] = float(np.hypot(*flat[:, 1:].T).mean())
        result[f"{third}: spread of lightness"] = float(flat[:, 0].std())
        result[f"{third}: spread of color"] = float(np.hypot(*flat[:, 1:].std(axis=0)))
    return result


def cut(panorama: np.ndarray, turn: float, fov_rad: float, shape: tuple[int, int]) -> np.ndarray:
    """Perspective view (H, W, 3) of an equirectangular picture, looking level at an azimuth."""
    rows, columns = shape
    half = np.tan(fov_rad / 2)
    x = np.linspace(-half, half, columns)[None] * np.ones((rows, 1))
    y = np.linspace(half, -half, rows)[:, None] * rows / columns
    azimuth, elevation = np.arctan(x) + turn, np.arctan2(y, np.hypot(1, x))
    place = [(0.5 - elevation / np.pi) * len(panorama), azimuth / (2 * np.pi) * panorama.shape[1]]
    channels = [
        map_coordinates(c, place, order=1, mode="grid-wrap") for c in panorama.T.swapaxes(1, 2)
    ]
    return np.stack(channels, axis=-1)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("panorama")
    parser.add_argument("picture")
    parser.add_argument("--fov", type=float, default=75.0)
    given = parser.parse_args()
    panorama = np.asarray(read_picture(given.panorama), float)
    is_array = Path(given.picture).suffix == ".npy"
    picture = np.load(given.picture) if is_array else np.asarray(read_picture(given.picture))
    columns = round(given.fov / 360 * panorama.shape[1])
    rows = round(columns * picture.shape[0] / picture.shape[1])
    scale = rows / picture.shape[0], columns / picture.shape[1], 1
    small = zoom(picture.astype(float), scale, order=1, grid_mode=True, mode="nearest")
    blocks = picture.shape[0] // rows, picture.shape[1] // columns
    if min(blocks) > 1:  # means of blocks, as a photograph's pixels are
        whole = picture[: rows * blocks[0], : columns * blocks[1]].astype(float)
        small = whole.reshape(rows, blocks[0], columns, blocks[1], -1).mean(axis=(1, 3))
    turns = np.arange(4) * np.pi / 2
    photograph = [
        figures(cut(panorama, turn, np.radians(given.fov), (rows, columns))) for turn in turns
    ]
    for name, value in figures(small).items():
        expected = float(np.mean([view[name] for view in photograph]))
        ratio = value / expected
        told = "" if 1 / WITHIN <= ratio <= WITHIN else f"  beyond a factor of {WITHIN:g}"
        print(f"{name:28} {expected:8.2f} {value:8.2f} {ratio:6.2f}{told}")


if __name__ == "__main__":
    main()
