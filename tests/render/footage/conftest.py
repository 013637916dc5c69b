import struct
import zlib
from fractions import Fraction

import av
import numpy as np
import OpenEXR
import pytest

from megalopta.core.errors import UserError
from megalopta.render.footage.pictures import open_footage

LOSSLESS = {
    "libx264": {"qp": "0"},
    "libvpx-vp9": {"lossless": "1"},
    "ffv1": {},
    "mpeg4": {"qscale": "1"},
}


def picture_of(planes, format, colors):
    """A frame of the planes (H, W) or of numbers that fill them."""
    height, width = np.shape(planes[0])
    frame = av.VideoFrame(width, height, format)
    for plane, values in zip(frame.planes, planes, strict=True):
        deep = frame.format.components[0].bits > 8
        row = plane.line_size // (2 if deep else 1)
        filled = np.zeros((plane.height, row), np.uint16 if deep else np.uint8)
        filled[:, : plane.width] = values
        plane.update(filled.tobytes())
    for name, value in colors.items():
        setattr(frame, name, value)
    return frame


@pytest.fixture
def film(tmp_path):
    """Writes frames, each of planes, as a film; returns its path."""

    def write(frames, name="film.mp4", codec="libx264", format="yuv420p", stamps=None, **more):
        path, colors = tmp_path / name, more.pop("colors", {})
        height, width = np.shape(frames[0][0])
        with av.open(path, "w", container_options=more.pop("container", {})) as container:
            stream = container.add_stream(
                codec,
                rate=more.pop("rate", 25),
                options={**LOSSLESS[codec], **more.pop("options", {})},
            )
            stream.width, stream.height, stream.pix_fmt = width, height, format
            stream.codec_context.time_base = Fraction(1, 1000)
            if "rotation" in more:
                stream.set_display_rotation(more.pop("rotation"))
            for field, value in colors.items():
                setattr(stream.codec_context, field, value)
            for stamp, planes in zip(stamps or range(0, 40 * len(frames), 40), frames, strict=True):
                frame = picture_of(planes, format, colors)
                frame.pts, frame.time_base = stamp, Fraction(1, 1000)
                container.mux(stream.encode(frame))
            container.mux(stream.encode(None))
        assert not more
        return path

    return write


def gray(code, bits=8, shape=(48, 64)):
    """Planes of one gray."""
    return np.full(shape, code), 1 << (bits - 1), 1 << (bits - 1)


def assert_mean_of_frame(footage, rtol=1e-12):
    np.testing.assert_allclose(footage.mean(0), footage.frame(0).mean((0, 1), dtype=float), rtol)


def exr(path, channels, **stated):
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage, **stated}
    OpenEXR.File(header, channels).write(str(path))
    return path


def chunk(name, data):
    """A part of a PNG."""
    return struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))


def refused(path, unit=None):
    with pytest.raises(UserError) as refusal:
        open_footage(path, unit)
    message = str(refusal.value)
    assert str(path) in message and "\n" not in message
    return message
