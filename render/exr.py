"""Radiance and ground truth in OpenEXR files: one part each, float32, ZIP.

Radiance follows the spectral layout of Fichet, Pacanowski and Wilkie (JCGT 10(3), 2021): one
channel `S0.<center>nm` per band, with a decimal comma, and the band edges as `bandEdgesNm`. R, G, B
are its picture for viewers: linear sRGB by the CIE 1931 observer, white balanced, times 2 to the
power of `EV`; without a visible band, the gray of the bands' mean.
"""

import errno
import math
import os
from collections.abc import Mapping, Sequence
from operator import attrgetter
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from megalopta.core.bounded import check_count, check_decoded
from megalopta.core.errors import TooLargeError
from megalopta.core.files import atomic_write
from megalopta.render.settings import Bands, channel_names
from megalopta.scenes.spectra.color import linear_srgb
from megalopta.scenes.spectra.spectrum import SPECTRA, Spectrum
from megalopta.scenes.tone_mapping import ToneCurve

if TYPE_CHECKING:
    from megalopta.render.truth.tracer import Truth

VALUE_BYTES = 12
"""Memory of a value of a channel, with its copies."""
RADIANCE_UNIT = "W.m^-2.sr^-1.nm^-1"

TRUTH_CHANNELS: Mapping[str, tuple[str, ...]] = {
    "depth": ("depth.Z",),
    "position": ("position.X", "position.Y", "position.Z"),
    "normal": ("normal.X", "normal.Y", "normal.Z"),
    "object_id": ("objectId",),
    "kind_id": ("kindId",),
    "flow_forward": ("forward.u", "forward.v"),
    "flow_backward": ("backward.u", "backward.v"),
    "occluded_forward": ("forward.occluded",),
    "occluded_backward": ("backward.occluded",),
    "out_of_view_forward": ("forward.outOfView",),
    "out_of_view_backward": ("backward.outOfView",),
    "footprint.purity": ("purity",),
    "footprint.sky": ("sky",),
    "footprint.forward.mean": ("forward.mean.u", "forward.mean.v"),
    "footprint.forward.spread": ("forward.spread",),
    "footprint.forward.hidden": ("forward.hidden",),
    "footprint.backward.mean": ("backward.mean.u", "backward.mean.v"),
    "footprint.backward.spread": ("backward.spread",),
    "footprint.backward.hidden": ("backward.hidden",),
}

_CLUSTER_CHANNEL, _BLUR_CHANNEL = "clusterId", "blur"
_TRUTH_ATTRIBUTES = {
    "depthUnit": "m, inf for the sky",
    "flowUnit": "px of this image, u right, v down, NaN where undefined",
    "normalAxes": "world, toward the camera, NaN for the sky",
    "objectIdMeaning": "1-based index of the placement, 0 for the sky",
    "kindIdMeaning": "1-based index into kindNames, 0 for the sky",
    "purityMeaning": "share of the pixel, 0 to 1, that the object fills which its center sees",
    "skyMeaning": "share of the pixel, 0 to 1, that is sky",
    "meanFlowUnit": "px, mean of the flow over the pixel, NaN where no part of it has one",
    "spreadUnit": "px, root mean square distance of the flow over the pixel from its mean",
    "hiddenMeaning": "share of the pixel, 0 to 1, that is hidden from the other frame's camera",
    "positionUnit": "m, world axes, relative to positionOrigin, NaN for the sky",
}


def write_radiance(
    path: Path,
    radiance: NDArray[np.float32],
    bands_nm: Bands,
    attributes: Mapping[str, str] | None = None,
    dtype: type[np.float32 | np.float16] = np.float32,
    white: Spectrum = SPECTRA["D65"],
    stops: float | None = None,
) -> None:
    """Write spectral radiance (H, W, B), W·m⁻²·sr⁻¹·nm⁻¹, with its band edges (nm).

    Half floats need light scaled to about 1: they cannot represent night. In the picture the
    spectrum `white` is neutral; its exposure, 2 to the power of `stops`, defaults to one that suits
    this light. Raises ValueError if there are not as many bands as edges.
    """
    if radiance.ndim != 3 or radiance.shape[-1] != len(bands_nm):
        raise ValueError(
            f"radiance of shape {radiance.shape} for {len(bands_nm)} bands: give (H, W, bands)"
        )
    channels = {
        name: np.ascontiguousarray(radiance[..., index], dtype)
        for index, name in enumerate(channel_names(bands_nm))
    }
    colors = linear_srgb(radiance, bands_nm, white)
    if stops is None:
        stops = -1.0 - round(math.log2(ToneCurve.of([colors]).level))
    picture = np.minimum(colors * 2.0**stops, np.finfo(np.float16).max).astype(np.float16)
    channels |= {name: np.ascontiguousarray(picture[..., k]) for k, name in enumerate("RGB")}
    edges = " ".join(f"{lower!r}-{upper!r}" for lower, upper in np.asarray(bands_nm).tolist())
    header: dict[str, str | float] = {
        "spectralLayoutVersion": "1.0",
        "emissiveUnits": RADIANCE_UNIT,
        "bandEdgesNm": edges,
        "EV": stops,
        **(attributes or {}),
    }
    _write(path, channels, header)


def read_radiance(path: Path) -> tuple[NDArray[np.float32], tuple[tuple[float, float], ...]]:
    """Read spectral radiance (H, W, B), W·m⁻²·sr⁻¹·nm⁻¹, and its band edges (nm).

    Raises ValueError if the file is not an EXR, not a radiance file of this layout, or has invalid
    values.
    """
    header, channels = read_channels(path)
    try:
        pairs = [edge.split("-") for edge in str(header["bandEdgesNm"]).split()]
        bands = tuple((float(lower), float(upper)) for lower, upper in pairs)
        planes = [channels[name] for name in channel_names(bands)]
    except (KeyError, ValueError):
        raise ValueError(
            f"{path} is not a spectral-radiance EXR of this layout (bandEdgesNm and channels "
            "S0.<center>nm); render it again"
        ) from None
    radiance = np.stack(planes, axis=-1).astype(np.float32, copy=False)
    if not ((radiance >= 0) & (radiance < np.inf)).all():
        raise ValueError(f"{path} holds values that are negative or not finite; render it again")
    return radiance, bands


def read_attributes(path: Path) -> dict[str, str]:
    """Read the text in a file's header: for truth camera, pose, time and names of kinds.

    Raises ValueError if it is not an EXR.
    """
    return {name: value for name, value in read_headers(path)[0].items() if isinstance(value, str)}


def write_truth(
    path: Path,
    truth: "Truth",
    origin_m: Sequence[float] = (0, 0, 0),
    attributes: Mapping[str, str] | None = None,
    leaf_clusters: NDArray[np.uint32] | None = None,
) -> None:
    """Write the ground truth of one frame, with attributes for the header.

    Leaf clusters (H, W) are a further channel. Positions are stored relative to the origin, a world
    position near the camera, so that float32 is precise far from the world's origin.
    """
    origin = np.asarray(origin_m, dtype=np.float64)
    channels: dict[str, NDArray[np.float32] | NDArray[np.uint32]] = {}
    for field, names in TRUTH_CHANNELS.items():
        values = attrgetter(field)(truth)
        values = values.astype(np.uint32) if values.dtype == bool else values
        values = (values - origin).astype(np.float32) if field == "position" else values
        planes = values.reshape(*values.shape[:2], len(names))
        channels |= {name: np.ascontiguousarray(planes[..., i]) for i, name in enumerate(names)}
    header = {"positionOrigin": " ".join(map(repr, origin.tolist())), **(attributes or {})}
    if truth.blur is not None:
        channels[_BLUR_CHANNEL] = truth.blur
        header["blurUnit"] = "px, radius of the disc to which the lens blurs the point; 0 in focus"
    if leaf_clusters is not None:
        channels[_CLUSTER_CHANNEL] = leaf_clusters
    _write(path, channels, {**_TRUTH_ATTRIBUTES, **header})


def read_truth(path: Path) -> "Truth":
    """Read the ground truth of one frame. Raises ValueError for a file without one."""
    from megalopta.render.truth.footprint import FlowSpread, Footprint
    from megalopta.render.truth.tracer import Truth

    header, channels = read_channels(path)
    try:
        planes = {
            field: np.stack([channels[name] for name in names], axis=-1)
            for field, names in TRUTH_CHANNELS.items()
        }
        origin = np.array([float(number) for number in str(header["positionOrigin"]).split()])
    except KeyError as missing:
        raise ValueError(f"{path} is not a truth EXR: {missing} is missing") from None
    values: dict[str, Any] = {
        field: plane[..., 0] if plane.shape[-1] == 1 else plane for field, plane in planes.items()
    }
    for field in values:
        if field.startswith(("occluded", "out_of_view")):
            values[field] = values[field].astype(bool)
    values["position"] = values["position"].astype(np.float64) + origin

    def spread(way: str) -> FlowSpread:
        names = "mean", "spread", "hidden"
        return FlowSpread(*(values.pop(f"footprint.{way}.{name}") for name in names))

    purity, sky = (values.pop(f"footprint.{name}") for name in ("purity", "sky"))
    footprint = Footprint(purity, sky, spread("forward"), spread("backward"))
    blur: Any = channels.get(_BLUR_CHANNEL)
    return Truth(**values, footprint=footprint, blur=blur)


def read_leaf_clusters(path: Path) -> NDArray[np.uint32]:
    """Read the leaf clusters (H, W) of a truth file. Raises ValueError for one without."""
    _, channels = read_channels(path)
    if _CLUSTER_CHANNEL not in channels:
        raise ValueError(f"{path} has no leaf clusters; render with `labels: [clusters]`")
    return channels[_CLUSTER_CHANNEL].astype(np.uint32)


def _write(
    path: Path, channels: Mapping[str, NDArray[np.generic]], header: Mapping[str, str | float]
) -> None:
    import OpenEXR

    form = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    with atomic_write(path) as temporary:
        try:
            OpenEXR.File({**form, **header}, dict(channels)).write(str(temporary))
        except RuntimeError as problem:
            # OpenEXR reports system errors, such as a full disk, as text.
            codes = [code for code in errno.errorcode if os.strerror(code) in str(problem)]
            code = codes[0] if codes else errno.EIO
            raise OSError(code, os.strerror(code), str(path)) from problem


def read_headers(path: Path) -> list[dict[str, Any]]:
    """Read the headers of a file's parts.

    Raises ValueError if it is not an EXR; TooLargeError if they state too many values.
    """
    import OpenEXR

    if not path.is_file():
        raise FileNotFoundError(f"{path}: no such file")
    try:
        with OpenEXR.File(str(path), separate_channels=True, header_only=True) as file:
            headers = [dict(part.header) for part in file.parts]
        channels = sum(len(header["channels"]) for header in headers)
        check_count(path, "channels", channels, 1000)
        for header in headers:  # all parts are decoded
            check_decoded(path, (*size_in(header), channels), VALUE_BYTES)
        return headers
    except TooLargeError:
        raise
    except Exception as problem:  # OpenEXR raises RuntimeError, TypeError and others
        raise ValueError(f"{path} cannot be read as EXR: {problem}") from problem


def size_in(header: Mapping[str, Any]) -> tuple[int, int]:
    """Return rows and columns of the pixels that a header states."""
    (left, top), (right, bottom) = np.asarray(header["dataWindow"]).tolist()
    return bottom - top + 1, right - left + 1


def read_channels(path: Path) -> tuple[dict[str, Any], dict[str, NDArray[np.generic]]]:
    """Read a file's header and its channels (H, W) by name; errors as `read_headers`."""
    import OpenEXR

    header = read_headers(path)[0]
    try:
        with OpenEXR.File(str(path), separate_channels=True) as file:
            return header, {name: np.array(plane.pixels) for name, plane in file.channels().items()}
    except Exception as problem:
        raise ValueError(f"{path} cannot be read as EXR: {problem}") from problem
