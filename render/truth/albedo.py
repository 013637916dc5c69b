"""Diffuse reflectance of the surfaces that rays see, as band means: from materials, without light.

Textures are interpolated between texels as the renderer does. Transmitted light does not count.
"""

from collections.abc import Mapping, Sequence

import numpy as np

from megalopta.core.arrays import Floats, bilinear
from megalopta.render.loading.meshes import MergedMesh
from megalopta.render.settings import Bands
from megalopta.render.truth.geometry import Geometry, Surface
from megalopta.render.truth.views import of_rays
from megalopta.scenes.material import ColorTexture, Material
from megalopta.scenes.spectra.color import band_means
from megalopta.scenes.spectra.spectrum import Spectrum


def albedo_of(
    surface: Surface,
    geometry: Geometry,
    meshes: Sequence[MergedMesh],
    materials: Mapping[str, Material],
    bands_nm: Bands,
) -> Floats:
    """Albedo (N, B) of the surface points seen by N rays.

    It is 0 for the sky, for emitters and for surfaces that are not diffuse.
    """
    albedo = np.zeros((len(surface.triangle), len(bands_nm)))
    ends = np.cumsum([0, *(len(mesh.faces) for mesh in meshes)])
    mesh_of = np.searchsorted(ends, surface.triangle, side="right") - 1
    for number, mesh in enumerate(meshes):
        mine = np.flatnonzero(mesh_of == number)
        material = materials[mesh.material]
        if not len(mine) or material.emission or material.finish:
            continue
        base, *parts = band_means(_spectra(material), bands_nm)
        albedo[mine] = base
        if material.texture and mesh.uv is not None:
            triangle, time_s = surface.triangle[mine], of_rays(surface.time_s, mine)
            u, v = geometry.inside(triangle, surface.points[mine], time_s).T[..., None]
            first, second, third = np.moveaxis(mesh.uv[mesh.faces[triangle - ends[number]]], 1, 0)
            uv = (1 - u - v) * first + u * second + v * third
            texels = material.texture.weight.astype(np.float64)
            weight = bilinear(texels, *(uv * texels.shape[1::-1] - 0.5).T)
            is_sum = isinstance(material.texture, ColorTexture)
            # A texture of colors is on a black surface, another is mixed with the first spectrum.
            albedo[mine] += weight @ (np.array(parts) - (0 if is_sum else base))
    return albedo


def _spectra(material: Material) -> list[Spectrum]:
    of_texture = material.texture.spectra if material.texture else ()
    return [material.reflectance, *(reflectance for reflectance, _ in of_texture)]
