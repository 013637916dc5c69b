"""Surfaces of Mitsuba's XML: diffuse ones as reflectances, metal, glass and gloss as they are.

Of any other surface the paint says what it is, so that it can be refused by name.
"""

import math
import re
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from megalopta.core.arrays import Floats
from megalopta.core.bounded import check_count, quoted
from megalopta.core.errors import DamagedFileError
from megalopta.scenes.material import SURFACES, TEXTURES, Finish, Material, Part, Rgb
from megalopta.scenes.meshes.pieces import Paint, check_pictures, colored, linear_picture, texels_of
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
_USUAL = Element("spectrum", value="0.5")
"""Mitsuba's reflectance of a surface that states none."""
_SPECTRUM_BYTES, _MOST_VALUES = 4 * 10**6, 10_000
_MOST_PARTS = 200
"""Most plug-ins of one surface, which may name each other many times."""
_NAME, _WORD = re.compile("(?!(type|id)$)[a-z][a-z0-9_]{0,40}"), re.compile("[A-Za-z0-9 _-]{0,40}")


class PlacedPaint(NamedTuple):
    """Paint of a shape, and the map (3, 3) of its texture coordinates to those of the picture."""

    paint: Paint
    to_picture: Floats


class Surfaces:
    """Reads the surfaces of a document, each once."""

    def __init__(self, document: Document, contents: Mapping[str, bytes]) -> None:
        self._document, self._contents = document, contents
        self._read: dict[tuple[int, str], PlacedPaint] = {}
        self._pictures: dict[tuple[str, str], NDArray[np.float32]] = {}
        self._parts = 0

    def of(self, shape: Element, name: str) -> PlacedPaint:
        """Return the surface of a shape, which has the shape's name if it has none."""
        surfaces = self._document.parts(shape, "bsdf")
        if not surfaces:
            return PlacedPaint(Paint(name, _reflecting(self._spectrum(_USUAL))), np.eye(3))
        key = id(surfaces[0]), surfaces[0].get("id") or name
        if key not in self._read:
            self._read[key] = self._coat(surfaces[0], key[1])
        return self._read[key]

    def _coat(self, bsdf: Element, name: str) -> PlacedPaint:
        inner, side = self._document.parts(bsdf, "bsdf"), bsdf
        if bsdf.get("type") == "twosided" and len(inner) == 1:
            name, side = bsdf.get("id") or inner[0].get("id") or name, inner[0]
        self._parts = 0
        try:
            if side.get("type") == "diffuse" and (coat := self._diffuse(side, name)):
                return coat
            finish = self._finish(bsdf, name)
            # viewers that know no finish show gray
            surface = Material(flat(0.5), known_nm=finish.known_nm, finish=finish)
            return PlacedPaint(Paint(name, surface), np.eye(3))
        except _NotKeptError as problem:
            return PlacedPaint(Paint(name, refused=str(problem)), np.eye(3))

    def _diffuse(self, bsdf: Element, name: str) -> PlacedPaint | None:
        """Return a diffuse surface of a color, spectrum or picture of colors; None of others."""
        reflectances = (part for part in bsdf if part.get("name", "reflectance") == "reflectance")
        reflecting = self._document.resolved(next(reflectances, _USUAL))
        if reflecting.tag in ("rgb", "srgb"):
            return PlacedPaint(Paint(name, colored(_color(reflecting))), np.eye(3))
        if reflecting.tag == "spectrum":
            return PlacedPaint(Paint(name, _reflecting(self._spectrum(reflecting))), np.eye(3))
        if reflecting.get("type") != "bitmap" or value_of(reflecting, "boolean", "raw") == "true":
            return None
        file = plain(value_of(reflecting, "string", "filename"))
        surface = colored(np.ones(3), self._picture(file, name))
        # Mitsuba ignores the fourth row and column.
        return PlacedPaint(Paint(name, surface), transform_of(reflecting, "to_uv")[:3, :3])

    def _finish(self, given: Element, material: str) -> Finish:
        """Return a surface, or a texture of one, as it is. Raises _NotKeptError."""
        kind, parts = given.get("type", ""), dict[str, Part]()
        self._parts += 1
        if self._parts > _MOST_PARTS:
            raise _NotKeptError(f"of more than {_MOST_PARTS} parts, or part of itself")
        if kind not in SURFACES + TEXTURES:
            raise _NotKeptError(f"of Mitsuba's type {quoted(kind)!r}")
        textures = self._document.parts(given, "texture")
        is_raw = all(value_of(texture, "boolean", "raw") == "true" for texture in textures)
        if kind in ("bumpmap", "normalmap") and not is_raw:
            raise _NotKeptError(f"a {kind} whose texture is no raw bitmap")
        for number, element in enumerate(given):
            part = self._document.resolved(element)
            name = element.get("name") or part.get("name") or f"part_{number}"
            if not _NAME.fullmatch(name):
                raise _NotKeptError(f"with a parameter {quoted(name)!r}")
            if (kind, name) == ("bitmap", "filename"):
                how = "raw" if value_of(given, "boolean", "raw") == "true" else "coded"
                parts["bitmap"] = self._picture(plain(part.get("value", "")), material, how)
            elif part.tag == "transform":
                parts[name] = transform_of(given, name)
            else:
                parts[name] = self._part(part, material)
        return Finish(kind, parts)

    def _picture(self, file: str, material: str, how: str = "linear") -> NDArray[np.float32]:
        """Return a picture, decoded once; all together have a bounded size."""
        if (file, how) not in self._pictures:
            content = content_of(self._contents, file)
            self._pictures[file, how] = (
                linear_picture(content, material)
                if how == "linear"
                else texels_of(content, material, how == "coded")
            )
            check_pictures(next(iter(self._contents)), self._pictures.values())
        return self._pictures[file, how]

    def _part(self, given: Element, material: str) -> Part:
        value = given.get("value", "")
        match given.tag:
            case "bsdf" | "texture":
                return self._finish(given, material)
            case "float" if math.isfinite(float(value)):
                return float(value)
            case "integer" if abs(int(value)) < 2**31:
                return int(value)
            case "boolean":
                return value == "true"
            case "string" if _WORD.fullmatch(value):
                return value
            case "spectrum":
                return self._spectrum(given)
            case "rgb" if not value.startswith("#"):
                red, green, blue = shares = (numbers_in(value) * np.ones(3)).tolist()
                if np.isfinite(shares).all():
                    return Rgb((red, green, blue))
            case "rgb" | "srgb":
                return Rgb(_color(given))
        raise _NotKeptError(f"with a {quoted(given.tag)} {quoted(value)!r}")

    def radiance(self, shape: Element, name: str) -> Spectrum:
        """Return the radiance of a lamp, W·m⁻²·sr⁻¹·nm⁻¹. Raises DamagedFileError."""
        lamp = self._document.parts(shape, "emitter")[0]
        radiances = (element for element in lamp if element.get("name") == "radiance")
        stated = self._document.resolved(next(radiances, Element("float", value="1")))
        try:
            if lamp.get("type") != "area":
                raise _NotKeptError(f"of type {quoted(lamp.get('type'))}")
            if stated.tag == "spectrum":
                return self._spectrum(stated)
            if stated.tag == "float":
                return _WHITE.scaled(float(stated.get("value", "")))
            if stated.tag != "rgb":
                raise _NotKeptError(f"with a {quoted(stated.tag)} of radiance")
        except _NotKeptError as problem:
            raise DamagedFileError(
                f"object {quoted(name)!r} is a lamp {problem}, which is not read; remove it, or "
                "use lights 'own'"
            ) from None
        shares = (numbers_in(stated.get("value", "")) * np.ones(3)).tolist()
        parts = zip(primaries(_WHITE), shares, strict=True)
        return total([part.scaled(share) for part, share in parts])

    def _spectrum(self, given: Element) -> Spectrum:
        """Return a spectrum of one of Mitsuba's types. Raises _NotKeptError for others."""
        kind, text = given.get("type", ""), given.get("value", "")
        stated = {part.get("name"): part.get("value", "") for part in given}
        scale = float(stated.pop("scale", "1"))
        match kind, sorted(stated, key=str):
            case "", [] if name := given.get("filename"):
                content = self._contents[plain(name)]
                if len(content) > _SPECTRUM_BYTES:
                    limit = f"{_SPECTRUM_BYTES / 1e6:.0f} MB"
                    raise ValueError(f"{quoted(name)} is larger than {limit}")
                lines = content.decode("utf-8").splitlines()
                pairs = numbers_in(" ".join(line.partition("#")[0] for line in lines))
                made = Spectrum.of(*pairs.reshape(-1, 2).T)
            case "", [] if ":" in text:
                made = Spectrum.of(*numbers_in(text.replace(":", " ")).reshape(-1, 2).T)
            case "", []:
                made = flat(float(text))
            case "uniform", ["value"]:
                made = flat(float(stated["value"]))
            case "d65", []:
                made = _WHITE
            case "regular", ["values", "wavelength_max", "wavelength_min"]:
                ends = float(stated["wavelength_min"]), float(stated["wavelength_max"])
                values = numbers_in(stated["values"])
                made = Spectrum.of(np.linspace(*ends, len(values)), values)
            case "irregular", ["values", "wavelengths"]:
                made = Spectrum.of(numbers_in(stated["wavelengths"]), numbers_in(stated["values"]))
            case _:
                names = ", ".join(map(str, stated))
                raise _NotKeptError(f"with a spectrum of type {quoted(kind)!r} ({quoted(names)})")
        name = next(iter(self._contents))
        check_count(name, "values in a spectrum", len(made.values), _MOST_VALUES)
        return made.scaled(scale)


def content_of(contents: Mapping[str, bytes], file: str) -> bytes:
    """Return the content of a named file. Raises ValueError without a name."""
    if not file:
        raise ValueError("it has a mesh or picture without a filename")
    return contents[file]


class _NotKeptError(Exception):
    """Says what a surface is that is not kept."""


def _reflecting(spectrum: Spectrum) -> Material:
    """Surface of a reflectance, which is known between its ends, or of a number everywhere."""
    ends = spectrum.wavelengths_nm[0], spectrum.wavelengths_nm[-1]
    return Material(spectrum, known_nm=ends if len(spectrum.values) > 1 else None)


def _color(given: Element) -> tuple[float, float, float]:
    """Return a color in linear sRGB; with a # it is coded as sRGB."""
    text = given.get("value", "")
    if text.startswith("#"):
        codes = int(text[1:7], 16) >> np.array([16, 8, 0]) & 255
        red, green, blue = linear_of_srgb(codes / 255).tolist()
    else:
        curved = np.clip(numbers_in(text) * np.ones(3), 0, 1)
        red, green, blue = (linear_of_srgb(curved) if given.tag == "srgb" else curved).tolist()
    return red, green, blue
