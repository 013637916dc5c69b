"""A scene at one time as GLB, for other programs: shapes, places, and colors in daylight.

Reflectances become linear sRGB in D65; light, cameras, transmittance and haze are not written.
"""

from typing import TYPE_CHECKING, Any

import numpy as np
from PIL import Image

from megalopta.core.arrays import Floats
from megalopta.scenes.material import ColorTexture, Material
from megalopta.scenes.scene import Scene
from megalopta.scenes.spectra.color import band_means, encode_srgb, linear_srgb
from megalopta.scenes.spectra.spectrum import SPECTRA, Spectrum, flat

if TYPE_CHECKING:
    from trimesh.visual.material import PBRMaterial

_BANDS = tuple((float(nm), nm + 10.0) for nm in range(380, 740, 10))
_Y_UP = np.array([[1, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1.0]])


def glb_of(scene: Scene, time_s: float = 0.0) -> bytes:
    """Return the objects of a scene at a time as the content of a GLB file, with y up."""
    import trimesh  # slow
    from trimesh.visual import TextureVisuals

    surfaces = {name: _surface(material) for name, material in scene.materials.items()}
    exported, names = trimesh.Scene(base_frame="world"), set()
    for number, placement in enumerate(scene.placements, 1):
        for part, at_rest in scene.assets[placement.asset].parts.items():
            pose, mesh = placement.to_world, at_rest.copy()
            if placement.motion is not None:  # in the world
                placed = mesh.vertices @ pose[:3, :3].T + pose[:3, 3]
                mesh.vertices, pose = placement.motion.carry(placed, time_s), np.eye(4)
            geometry = f"{placement.asset}/{part}" + (f"/{number}" if placement.motion else "")
            if geometry not in exported.geometry:
                uv, nowhere = getattr(mesh.visual, "uv", None), np.zeros((len(mesh.vertices), 2))
                uv = nowhere if uv is None else uv
                mesh.visual = TextureVisuals(uv=uv, material=surfaces[part])
                exported.geometry[geometry] = mesh
            node = f"{placement.kind} {number}"
            name = f"{node} {part}" if node in names else node
            names.add(name)
            exported.graph.update(name, matrix=_Y_UP @ pose, geometry=geometry)
    return bytes(exported.export(file_type="glb"))


def _surface(material: Material) -> "PBRMaterial":
    """Color or picture of a material, as glTF's."""
    from trimesh.visual.material import PBRMaterial

    color, texture = _color(material.reflectance), material.texture
    if texture is None or material.emission:
        look: dict[str, Any] = {
            "baseColorFactor": np.append(np.rint(color * 255), 255).astype(np.uint8)
        }
    else:
        given = np.array([_color(spectrum) for spectrum, _ in texture.spectra])
        weight = texture.weight.reshape(*texture.weight.shape[:2], -1)
        base = np.zeros(3) if isinstance(texture, ColorTexture) else color
        colors: Floats = base + weight @ (given - base)
        look = {"baseColorTexture": Image.fromarray(encode_srgb(colors[::-1]))}
    return PBRMaterial(**look, metallicFactor=0.0, roughnessFactor=1.0, doubleSided=True)


def _color(reflectance: Spectrum) -> Floats:
    """Color (3,) of a reflectance in D65, in linear sRGB, 0 to 1."""
    white = SPECTRA["D65"]
    light = band_means([white], _BANDS)[0]
    shares = band_means([reflectance, flat(1.0)], _BANDS) * light
    colors = linear_srgb(shares, _BANDS, white)
    return np.asarray(np.clip(colors[0] / colors[1].max(), 0, 1))
