"""Surfaces of a glTF file: dull ones as reflectances, metal, gloss and glass as Mitsuba has them.

Roughness below 1, metal, a clearcoat or a normal map make a surface `principled`, whose squared
roughness is the width of its highlights, as glTF has it. Light that a surface transmits passes thin
panes straight (`thindielectric`, `principledthin`), and is refracted by what has a volume.
"""

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.ndimage import zoom

from megalopta.core.arrays import Floats
from megalopta.scenes.material import Finish, Material, Part
from megalopta.scenes.meshes.gltf_file import GltfFile, Json, extension, image_of
from megalopta.scenes.meshes.pieces import Paint, check_pictures, codes_of, colored
from megalopta.scenes.spectra.color import linear_of_srgb, primaries, reflectance_of_color
from megalopta.scenes.spectra.spectrum import SPECTRA, Spectrum, luminous, total

_NAMES = (
    *("clearcoat", "emissive_strength", "ior", "pbrSpecularGlossiness", "specular"),
    *("transmission", "volume"),
)
EFFECTIVE = tuple(f"KHR_materials_{name}" for name in _NAMES)
"""Extensions of materials that have an effect."""

Image = NDArray[np.float32]
"""Values (H, W, C) over the uv square, row 0 at v = 0, or (1, 1, C) that are the same all over."""


class Look(NamedTuple):
    """Material, and how its pictures lie on surfaces."""

    paint: Paint = Paint()
    coordinates: int = 0
    """Number of the set of coordinates."""
    to_picture: Floats = np.eye(3)
    """(3, 3): map of coordinates, with v downward."""


def light_of(color: Floats, photometric: float) -> Spectrum:
    """Spectrum, in D65's light, of a linear sRGB color (3,) whose white has a photometric value.

    Of luminance, cd/m², it is W·m⁻²·sr⁻¹·nm⁻¹; of lux W·m⁻²·nm⁻¹; of candela W·sr⁻¹·nm⁻¹.
    """
    white = SPECTRA["D65"].scaled(photometric / luminous(SPECTRA["D65"]))
    parts = zip(primaries(white), color.tolist(), strict=True)
    return total([part.scaled(share) for part, share in parts])


def _of(material: Json, name: str) -> Json:
    return extension(material, f"KHR_materials_{name}")


def pictures_of(material: Json) -> dict[str, Json]:
    """Entries of a material's pictures by what they tell; those that lie as the first are read."""
    model, coat = material.get("pbrMetallicRoughness", {}), _of(material, "clearcoat")
    entries = {
        "color": model.get("baseColorTexture"),
        "metal": model.get("metallicRoughnessTexture"),
        "normal": material.get("normalTexture"),
        "coat": coat.get("clearcoatTexture"),
        "coat's roughness": coat.get("clearcoatRoughnessTexture"),
        "glass": _of(material, "transmission").get("transmissionTexture"),
        "specular": _of(material, "specular").get("specularTexture"),
    }
    if gloss := _of(material, "pbrSpecularGlossiness"):
        both = gloss.get("diffuseTexture"), gloss.get("specularGlossinessTexture")
        entries |= {"color": both[0], "metal": both[1]}
    return {name: entry for name, entry in entries.items() if entry}


def _place(entry: Json) -> Json:
    """How a picture lies on surfaces."""
    return {"texCoord": entry.get("texCoord", 0), **extension(entry, "KHR_texture_transform")}


def _emission(material: Json) -> Floats:
    """Luminance (3,), cd/m², of red, green and blue, over that of white."""
    if "emissiveTexture" in material:
        return np.zeros(3)
    strength = float(_of(material, "emissive_strength").get("emissiveStrength", 1.0))
    return strength * np.asarray(material.get("emissiveFactor", np.zeros(3)), np.float64)


class Looks:
    """Looks of a file's materials, which emit light if they shine; decodes every picture once."""

    def __init__(self, file: GltfFile, shines: bool) -> None:
        self._file, self._shines = file, shines
        self._pictures, self._looks = dict[object, Image](), dict[int | None, Look]()
        self._last = -1, np.zeros((0, 0, 4), np.uint8)

    def of(self, number: int | None, colors: Image | None = None) -> Look:
        """Return the look of a material, if any, times colors in a picture."""
        if colors is None and (number is None or number in self._looks):
            return self._looks.get(number, Look())
        material: Json = {"name": "colors", "pbrMetallicRoughness": {"metallicFactor": 0}}
        if number is not None:
            material = self._file.header["materials"][number]
        name, entries = str(material.get("name") or f"material {number}"), pictures_of(material)
        place = _place(next(iter(entries.values()), {}))
        entries = {key: entry for key, entry in entries.items() if _place(entry) == place}
        to_picture, turn = np.eye(3), place.get("rotation", 0.0)
        to_picture[:2, :2] = [[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]]
        to_picture[:2, :2] *= np.asarray(place.get("scale", [1, 1]), np.float64)
        to_picture[:2, 2] = place.get("offset", [0, 0])
        nits = _emission(material) if self._shines else np.zeros(3)
        glow = light_of(nits, 1.0) if nits.any() else None
        paint = Paint(name, self._surface(material, name, entries, colors), radiance=glow)
        look = Look(paint, int(place["texCoord"]), to_picture)
        if colors is None:
            self._looks[number] = look
        return look

    def _values(
        self, name: str, entry: Json | None, factor: ArrayLike, channels: Any, is_color: bool
    ) -> Image:
        """Channels of a picture, if there is one, times factors; kept for others alike."""
        factors = np.atleast_1d(np.asarray(factor, np.float32))
        if entry is None or not factors.any():
            return factors.reshape(1, 1, -1)
        key = image_of(self._file.header, entry), is_color, str(channels), *factors.tolist()
        if key not in self._pictures:
            shares = self._codes(entry, name)[..., np.r_[channels]] / np.float32(255)
            linear = linear_of_srgb(shares) if is_color else shares
            self._pictures[key] = np.asarray(linear * factors, np.float32)
            check_pictures(self._file.name, self._pictures.values())
        return self._pictures[key]

    def _codes(self, entry: Json, name: str) -> NDArray[np.uint8]:
        """Codes (H, W, 4) of a picture, row 0 at v = 0; the last one is kept."""
        number = image_of(self._file.header, entry)
        if self._last[0] != number:
            codes = codes_of(self._file.image(number), name)[::-1]
            codes = (codes >> 8 * (codes.itemsize - 1)).astype(np.uint8)
            if codes.shape[2] == 1:
                codes = np.insert(codes.repeat(3, axis=-1), 3, 255, axis=-1)
            self._last = number, codes
        return self._last[1]

    def _surface(self, material: Json, name: str, entries: Json, colors: Image | None) -> Material:
        """Surface of a material, of which a picture holds the colors if they are given."""

        def values(key: str, factor: ArrayLike, channels: Any) -> Image:
            return self._values(name, entries.get(key), factor, channels, key == "color")

        model, coat = material.get("pbrMetallicRoughness", {}), _of(material, "clearcoat")
        coated = values("coat", coat.get("clearcoatFactor", 0), 0)
        if gloss := _of(material, "pbrSpecularGlossiness"):
            diffuse = values("color", gloss.get("diffuseFactor", np.ones(4))[:3], range(3))
            factor = gloss.get("specularFactor", np.ones(3))
            specular = self._values(name, entries.get("metal"), factor, range(3), True)
            base, metal = _from_gloss(diffuse, specular)
            rough = 1 - values("metal", gloss.get("glossinessFactor", 1.0), 3)
        else:
            color = np.clip(np.asarray(model.get("baseColorFactor", np.ones(3))[:3]), 0, 1)
            # a coat reflects 8.6 % of even light
            color = color * (1 - 0.086 * float(coat.get("clearcoatFactor", 0)))
            base = values("color", color, range(3))
            rough = values("metal", model.get("roughnessFactor", 1.0), 1)
            metal = values("metal", model.get("metallicFactor", 1.0), 2)
        if colors is not None:
            base = (base * colors).clip(0, 1)
        dull = colored(np.ones(3), base) if base.size > 3 else colored(base[0, 0])
        through = values("glass", _of(material, "transmission").get("transmissionFactor", 0), 0)
        is_dull = (rough == 1).all() and not (metal.any() or coated.any() or through.any())
        if extension(material, "KHR_materials_unlit") or (is_dull and "normal" not in entries):
            return dull
        tint: Part = reflectance_of_color(base[0, 0])
        if base.size > 3:
            tint = Finish("bitmap", {"bitmap": base})
        side = Finish("diffuse", {"reflectance": tint})
        is_solid = _of(material, "volume").get("thicknessFactor", 0) > 0
        ior = float(_of(material, "ior").get("ior", 1.5)) or 1.5
        share = values("specular", _of(material, "specular").get("specularFactor", 1), 3)
        low, high = 0.1, 0.001  # widths of highlights of gloss 0 and 1, in Mitsuba's `principled`
        width = values("coat's roughness", coat.get("clearcoatRoughnessFactor", 0), 1) ** 2
        shares = {
            "roughness": rough,
            "metallic": metal,
            "clearcoat": coated,
            "clearcoat_gloss": ((low - width) / (low - high)).clip(0, 1),
            "specular": (((ior - 1) / (ior + 1)) ** 2 * share / 0.08).clip(1e-3, 1),  # as Mitsuba's
        }
        if through.any():
            shares = {"eta": np.full((1, 1, 1), ior, np.float32), "spec_trans": through, **shares}
            del shares["specular"]
        look = {"base_color": tint, **{name: _share(image) for name, image in shares.items()}}
        if (through == 1).all() and not (rough.any() or metal.any() or is_solid):
            side = Finish("thindielectric", {"int_ior": ior, "specular_transmittance": tint})
        elif (through == 1).all() and not (rough.any() or metal.any()) and base.min() == 1:
            side = Finish("dielectric", {"int_ior": ior})
        elif through.any() and not is_solid:
            thin = "base_color", "roughness", "eta", "spec_trans"
            side = Finish("principledthin", {name: look[name] for name in thin})
        elif not is_dull:
            side = Finish("principled", look)
        if "normal" in entries:
            normals = values("normal", np.ones(3), range(3)) * 2 - 1
            normals[..., :2] *= entries["normal"].get("scale", 1.0)
            normals /= np.maximum(np.linalg.norm(normals, axis=-1, keepdims=True), 1e-6)
            side = Finish("normalmap", {"normalmap": _share((normals + 1) / 2), "bsdf": side})
        finish = side if through.any() else Finish("twosided", {"bsdf": side})
        return Material(dull.reflectance, dull.texture, known_nm=finish.known_nm, finish=finish)


def _share(image: NDArray[Any]) -> Part:
    """Number, or texture of values that are no colors."""
    if image.size == 1:
        return float(image[0, 0, 0])
    return Finish("bitmap", {"bitmap": image.astype(np.float32), "raw": True})


def _from_gloss(diffuse: Image, specular: Image) -> tuple[Image, Image]:
    """Base color and metal of diffuse and specular colors (Khronos's glTF repository)."""
    least = 0.04  # of what is no metal
    if min(diffuse.size, specular.size) > 3:
        ratio = np.divide(diffuse.shape[:2], specular.shape[:2])
        specular = zoom(specular, (*ratio, 1), order=0)
    seen, shiny = (
        np.sqrt(color**2 @ np.array([[0.299], [0.587], [0.114]])) for color in (diffuse, specular)
    )
    left = (1 - specular.max(axis=-1, keepdims=True)) / (1 - least)
    slope = seen * left + shiny - 2 * least
    root = np.sqrt(np.maximum(slope**2 - 4 * least * (least - shiny), 0))
    metal = np.where(shiny < least, 0, (root - slope) / (2 * least)).clip(0, 1)
    of_diffuse = diffuse * left / np.maximum(1 - metal, 1e-6)
    of_specular = (specular - least * (1 - metal)) / np.maximum(metal, 1e-6)
    base = (of_diffuse + (of_specular - of_diffuse) * metal**2).clip(0, 1)
    return base.astype(np.float32), metal.astype(np.float32)


_READ = {
    *("name", "extras", "extensions", "doubleSided", "alphaMode", "alphaCutoff"),
    *("pbrMetallicRoughness", "normalTexture", "emissiveFactor", "emissiveTexture"),
    *("clearcoatFactor", "clearcoatTexture", "clearcoatRoughnessFactor"),
    *("clearcoatRoughnessTexture", "emissiveStrength", "ior", "transmissionFactor"),
    *("transmissionTexture", "thicknessFactor", "specularFactor", "specularTexture"),
    *("diffuseFactor", "diffuseTexture", "glossinessFactor", "specularGlossinessTexture"),
}
"""Properties of materials and their extensions that have an effect, or one of their own."""


def unused_of(material: Json, shines: bool) -> Iterator[str]:
    """Yield what of a material has no effect, if it `shines` or not."""
    if material.get("alphaMode", "OPAQUE") != "OPAQUE":
        yield "transparency"
    if any(material.get("emissiveFactor", ())) and not (shines and _emission(material).any()):
        yield "emission" + " in a picture" * ("emissiveTexture" in material)
    effective = (_of(material, name) for name in _NAMES)
    yield from sorted({key for entry in (material, *effective) for key in entry} - _READ)
    entries = list(pictures_of(material).values())
    if any(_place(entry) != _place(entries[0]) for entry in entries):
        yield "pictures that lie on other coordinates than the first"
    model, volume = material.get("pbrMetallicRoughness", {}), _of(material, "volume")
    if _of(material, "transmission") and not volume and model.get("metallicFactor", 1) > 0:
        yield "metal of panes"
