"""Diffuse surfaces of Mitsuba's XML as paints: reflectances, colors and pictures.

Of any other surface the paint says what it is, so that it can be refused by name.
"""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from megalopta.core.arrays import Floats
from megalopta.core.bounded import quoted
from megalopta.scenes.meshes.pictures import linear_picture
from megalopta.scenes.meshes.pieces import Color, Paint
from megalopta.scenes.meshes.xml_document import (
    Document,
    Element,
    numbers_in,
    plain,
    transform_of,
    value_of,
)
from megalopta.scenes.spectra.color import linear_of_srgb, primaries
from megalopta.scenes.spectra.spectrum import SPECTRA, Spectrum, flat, total

_WHITE = SPECTRA["D65"].scaled(1 / 98.9974)
"""Mitsuba's white light of 1, whose luminance is that of 1 at every wavelength"""
_USUAL = 0.5
"""Mitsuba's reflectance of a surface that states none."""


class Coat(NamedTuple):
    """Paint of a shape, and the map (3, 3) of its texture coordinates to those of the picture."""

    paint: Paint
    to_picture: Floats


class Surfaces:
    """Reads the surfaces of a document, each once."""

    def __init__(self, document: Document, contents: Mapping[str, bytes]) -> None:
        self._document, self._contents = document, contents
        self._read: dict[tuple[int, str], Coat] = {}

    def of(self, shape: Element, name: str) -> Coat:
        """Return the surface of a shape, which has the shape's name if it has none."""
        found = self._document.parts(shape, "bsdf")
        if not found:
            return Coat(Paint(name, spectrum=flat(_USUAL)), np.eye(3))
        key = id(found[0]), found[0].get("id") or name
        if key not in self._read:
            self._read[key] = self._coat(found[0], key[1])
        return self._read[key]

    def _coat(self, bsdf: Element, name: str) -> Coat:
        inner = self._document.parts(bsdf, "bsdf")
        if bsdf.get("type") == "twosided" and inner:
            return self._coat(inner[0], bsdf.get("id") or inner[0].get("id") or name)
        if bsdf.get("type") != "diffuse":
            return _refused(name, f"of Mitsuba's type {quoted(bsdf.get('type'))!r}")
        for each in bsdf:
            if each.get("name", "reflectance") == "reflectance":
                return self._reflecting(self._document.resolved(each), name)
        return Coat(Paint(name, spectrum=flat(_USUAL)), np.eye(3))

    def _reflecting(self, given: Element, name: str) -> Coat:
        if given.tag in ("rgb", "srgb"):
            return Coat(Paint(name, _color(given)), np.eye(3))
        if given.tag == "spectrum":
            return Coat(Paint(name, spectrum=self._spectrum(given)), np.eye(3))
        if (given.tag, given.get("type")) != ("texture", "bitmap"):
            what = quoted(given.get("type") or given.tag)
            return _refused(name, f"with a reflectance of type {what!r}")
        if value_of(given, "boolean", "raw") == "true":
            return _refused(name, "with a raw picture")
        picture = linear_picture(self._contents[plain(value_of(given, "string", "filename"))], name)
        # Mitsuba ignores the fourth row and column.
        return Coat(Paint(name, picture=picture), transform_of(given, "to_uv")[:3, :3])

    def glow(self, shape: Element) -> Spectrum | None:
        """Return the radiance of a shape that shines plainly; None for others."""
        lamps = self._document.parts(shape, "emitter")
        for each in lamps[0] if lamps and lamps[0].get("type") == "area" else ():
            if each.get("name") == "radiance" and each.tag == "spectrum":
                return self._spectrum(each)
            if each.get("name") == "radiance" and each.tag == "rgb":
                shares = (numbers_in(each.get("value", "")) * np.ones(3)).tolist()
                parts = zip(primaries(_WHITE), shares, strict=True)
                return total([part.scaled(share) for part, share in parts])
        return None

    def _spectrum(self, given: Element) -> Spectrum:
        """Return a spectrum: a number, or wavelength:value pairs, or lines of both in a file."""
        if name := given.get("filename"):
            lines = self._contents[plain(name)].decode("utf-8").splitlines()
            pairs = numbers_in(" ".join(line.partition("#")[0] for line in lines))
        elif ":" not in (text := given.get("value", "")):
            return flat(float(text))
        else:
            pairs = numbers_in(text.replace(":", " "))
        wavelengths, values = pairs.reshape(-1, 2).T
        return Spectrum.of(wavelengths, values)


def _refused(name: str, what: str) -> Coat:
    return Coat(Paint(name, refused=what), np.eye(3))


def _color(given: Element) -> Color:
    """Return a color in linear sRGB; with a # it is coded as sRGB."""
    text = given.get("value", "")
    if text.startswith("#"):
        codes = int(text[1:7], 16) >> np.array([16, 8, 0]) & 255
        red, green, blue = linear_of_srgb(codes / 255).tolist()
    else:
        curved = np.clip(numbers_in(text) * np.ones(3), 0, 1)
        red, green, blue = (linear_of_srgb(curved) if given.tag == "srgb" else curved).tolist()
    return red, green, blue
