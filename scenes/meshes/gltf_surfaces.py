"""Surfaces of a glTF file: dull ones as reflectances, metal, gloss and glass as Mitsuba has them.

Roughness below 1, metal, a clearcoat or a normal map make a surface `principled`, whose squared
roughness is the width of its highlights, as glTF has it. Light that a surface transmits passes thin
panes straight (`thindielectric`, `principledthin`), and is refracted by what has a volume.
"""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from megalopta.core.arrays import Floats
from megalopta.scenes.material import Finish, Material, Part
from megalopta.scenes.meshes.gltf_file import GltfFile, Json, extension, image_of
from megalopta.scenes.meshes.pieces import Paint, check_pictures, colored, linear_picture, texels_of
from megalopta.scenes.spectra.color import primaries, reflectance_of_color
from megalopta.scenes.spectra.spectrum import SPECTRA, Spectrum, luminous, total

EFFECTIVE = tuple(
    f"KHR_materials_{name}"
    for name in ("clearcoat", "emissive_strength", "ior", "specular", "transmission", "volume")
)
"""Extensions of materials that have an effect."""
_DIELECTRIC = 0.04
"""Share of light that glTF's surfaces without an index of refraction reflect, seen head-on."""
_SPECULAR = 0.08
"""That share for a `specular` of 1 (Mitsuba's `principled`)."""
_MEAN_COAT = 0.086
"""Share of even light that a clearcoat reflects, and what is below does not get."""
_GLOSS = 0.1, 0.001
"""Widths of the highlight of clearcoats with a gloss of 0 and of 1 (the same)."""


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


def pictures_of(material: Json) -> dict[str, Json]:
    """Entries of a material's pictures by what they tell; those that lie as the first are read."""
    model, coat = material.get("pbrMetallicRoughness", {}), _of(material, "clearcoat")
    entries = {
        "color": model.get("baseColorTexture"),
        "metal": model.get("metallicRoughnessTexture"),
        "normal": material.get("normalTexture"),
        "coat": coat.get("clearcoatTexture"),
        "glass": _of(material, "transmission").get("transmissionTexture"),
    }
    return {name: entry for name, entry in entries.items() if entry}


def _of(material: Json, name: str) -> Json:
    return extension(material, f"KHR_materials_{name}")


def _place(entry: Json) -> Json:
    """How a picture lies on surfaces."""
    return {"texCoord": entry.get("texCoord", 0), **extension(entry, "KHR_texture_transform")}


def looks_of(file: GltfFile, shines: bool) -> Iterator[Look]:
    """Yield the look of each material, which emits light if it `shines`."""
    pictures = _Pictures(file)
    for number, material in enumerate(file.header.get("materials", ())):
        name = str(material.get("name") or f"material {number}")
        stated, to_picture = pictures_of(material), np.eye(3)
        change = _place(next(iter(stated.values()), {}))
        entries = {key: entry for key, entry in stated.items() if _place(entry) == change}
        turn = change.get("rotation", 0.0)
        to_picture[:2, :2] = [[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]]
        to_picture[:2, :2] *= np.asarray(change.get("scale", [1, 1]), np.float64)
        to_picture[:2, 2] = change.get("offset", [0, 0])
        surface, glow = _surface(material, name, entries, pictures), None
        if shines and (nits := _emission(material)).any():
            glow = light_of(nits, 1.0)
        paint = Paint(name, surface, radiance=glow)
        yield Look(paint, int(change.get("texCoord", 0)), to_picture)


def _emission(material: Json) -> Floats:
    """Luminance (3,), cd/m², of red, green and blue, over that of white."""
    if "emissiveTexture" in material:
        return np.zeros(3)
    strength = float(_of(material, "emissive_strength").get("emissiveStrength", 1.0))
    return strength * np.asarray(material.get("emissiveFactor", np.zeros(3)), np.float64)


class _Pictures:
    """Decodes pictures, each once; all together have a bounded size."""

    def __init__(self, file: GltfFile) -> None:
        self._file, self._decoded = file, dict[object, NDArray[np.float32]]()

    def colors(self, entry: Json, material: str, color: Floats) -> NDArray[np.float32]:
        """Linear colors (H, W, 3) times a color (3,)."""
        image = image_of(self._file.header, entry)
        key = image, *color.tolist()
        if key not in self._decoded:
            picture = linear_picture(self._file.image(image), material)
            self._keep(key, picture if (color == 1).all() else picture * color.astype(np.float32))
        return self._decoded[key]

    def values(self, entry: Json, material: str) -> NDArray[np.float32]:
        """Values (H, W, 3), which are no colors; row 0 is at v = 0."""
        image = image_of(self._file.header, entry)
        if (image, "values") not in self._decoded:
            texels = texels_of(self._file.image(image), material, is_coded=False)[::-1]
            self._keep((image, "values"), np.broadcast_to(texels, (*texels.shape[:2], 3)))
        return self._decoded[image, "values"]

    def share(self, entry: Json | None, channel: int, factor: float, material: str) -> Part:
        """Number, or texture of the values of a channel times that."""
        if entry is None or not factor:
            return factor
        key = image_of(self._file.header, entry), channel, factor
        if key not in self._decoded:
            values = self.values(entry, material)[..., channel, np.newaxis]
            self._keep(key, values * np.float32(factor))
        return Finish("bitmap", {"bitmap": self._decoded[key], "raw": True})

    def relief(self, entry: Json, material: str) -> Finish:
        """Texture of unit normals, whose slopes are times the entry's scale."""
        scale = np.float32(entry.get("scale", 1.0))
        key = image_of(self._file.header, entry), "relief", float(scale)
        if key not in self._decoded:
            normals = self.values(entry, material) * 2 - 1
            normals[..., :2] *= scale
            normals /= np.maximum(np.linalg.norm(normals, axis=-1, keepdims=True), 1e-6)
            self._keep(key, ((normals + 1) / 2).astype(np.float32))
        return Finish("bitmap", {"bitmap": self._decoded[key], "raw": True})

    def _keep(self, key: object, picture: NDArray[np.float32]) -> None:
        self._decoded[key] = picture
        check_pictures(self._file.name, self._decoded.values())


def _surface(material: Json, name: str, entries: dict[str, Json], pictures: _Pictures) -> Material:
    """Surface of a material; of a picture there is one copy for each color that multiplies it."""
    model, coat = material.get("pbrMetallicRoughness", {}), _of(material, "clearcoat")
    color = np.clip(np.asarray(model.get("baseColorFactor", np.ones(3))[:3], np.float64), 0, 1)
    dull, coated = colored(color), float(coat.get("clearcoatFactor", 0))
    color = color * (1 - _MEAN_COAT * coated)
    look: dict[str, Part] = {"base_color": reflectance_of_color(color)}
    if "color" in entries:
        picture = pictures.colors(entries["color"], name, color)
        dull = colored(np.ones(3), picture)
        look["base_color"] = Finish("bitmap", {"bitmap": picture})
    roughness, metallic = model.get("roughnessFactor", 1.0), model.get("metallicFactor", 1.0)
    through = float(_of(material, "transmission").get("transmissionFactor", 0))
    is_dull = "metal" not in entries and (roughness, metallic) == (1, 0)
    if extension(material, "KHR_materials_unlit"):
        return dull
    side = Finish("diffuse", {"reflectance": look["base_color"]})
    ior = float(_of(material, "ior").get("ior", 1.5)) or 1.5
    if not (is_dull and not coated and not through):
        look["roughness"] = pictures.share(entries.get("metal"), 1, float(roughness), name)
        is_solid = _of(material, "volume").get("thicknessFactor", 0) > 0
        is_clear = (look["roughness"], metallic, through) == (0, 0, 1) and "glass" not in entries
        specular = float(_of(material, "specular").get("specularFactor", 1))
        if through:
            look["spec_trans"] = pictures.share(entries.get("glass"), 0, through, name)
            look["eta"] = ior
        else:
            reflected = ((ior - 1) / (ior + 1)) ** 2 * specular
            look["specular"] = float(np.clip(reflected / _SPECULAR, 1e-3, 1))
        if is_clear and not is_solid:
            side = Finish(
                "thindielectric", {"int_ior": ior, "specular_transmittance": look["base_color"]}
            )
        elif is_clear and (color == 1).all() and "color" not in entries:
            side = Finish("dielectric", {"int_ior": ior})
        elif through and not is_solid:
            side = Finish("principledthin", look)
        else:
            look["metallic"] = pictures.share(entries.get("metal"), 2, float(metallic), name)
            look["clearcoat"] = pictures.share(entries.get("coat"), 0, coated, name)
            width = float(coat.get("clearcoatRoughnessFactor", 0)) ** 2
            low, high = _GLOSS
            look["clearcoat_gloss"] = float(np.clip((low - width) / (low - high), 0, 1))
            side = Finish("principled", look)
    elif "normal" not in entries:
        return dull
    if "normal" in entries:
        relief = pictures.relief(entries["normal"], name)
        side = Finish("normalmap", {"normalmap": relief, "bsdf": side})
    finish = side if through else Finish("twosided", {"bsdf": side})
    return Material(dull.reflectance, dull.texture, known_nm=finish.known_nm, finish=finish)


def unused_of(material: Json, shines: bool) -> Iterator[str]:
    """Yield what of a material has no effect, if it `shines` or not."""
    coat, volume = _of(material, "clearcoat"), _of(material, "volume")
    if material.get("alphaMode", "OPAQUE") != "OPAQUE":
        yield "transparency"
    if any(material.get("emissiveFactor", ())) and not (shines and _emission(material).any()):
        yield "emission" + " in a picture" * ("emissiveTexture" in material)
    if "occlusionTexture" in material:
        yield "occlusion maps"
    if {"attenuationColor", "attenuationDistance"} & volume.keys():
        yield "absorption in glass"
    if {"clearcoatRoughnessTexture", "clearcoatNormalTexture"} & coat.keys():
        yield "pictures of a clearcoat's roughness or normals"
    if {"specularTexture", "specularColorTexture", "specularColorFactor"} & _of(
        material, "specular"
    ).keys():
        yield "colors and pictures of a specular share"
    entries = list(pictures_of(material).values())
    if any(_place(entry) != _place(entries[0]) for entry in entries):
        yield "pictures that lie on other coordinates than the first"
    model = material.get("pbrMetallicRoughness", {})
    if _of(material, "transmission") and not volume and model.get("metallicFactor", 1) > 0:
        yield "metal of panes"
