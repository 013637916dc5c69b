"""Scene data to a loaded Mitsuba scene: materials, merged meshes, lights, film and sensor.

Every spectral quantity is handed over as it is (spectral variants apply no color conversion). A
film channel is the integral of radiance against a box of height 1/width, so that it reads the band
mean in W·m⁻²·sr⁻¹·nm⁻¹.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import mitsuba as mi
import numpy as np
from numpy.typing import NDArray

from megalopta.render.bands import Bands
from megalopta.render.merge import MergedMesh
from megalopta.scenes.camera import PerspectiveCamera
from megalopta.scenes.scene import Emission, Lighting, Material, Scene
from megalopta.scenes.spectrum import Spectrum

# Mitsuba's spectra are zero beyond their table; ours go on at the end values.
_SPECTRUM_LIMITS_NM = (100.0, 4000.0)


def load_scene(scene: Scene, meshes: Sequence[MergedMesh]) -> Any:
    """Load scene data into Mitsuba; the active variant must be a spectral one."""
    lights = _lights(scene.lighting) if scene.lighting else {}
    shapes = {
        f"mesh_{index:03d}": _mesh(f"mesh_{index:03d}", mesh, scene.materials)
        for index, mesh in enumerate(meshes)
    }
    return mi.load_dict({"type": "scene", **lights, **shapes})


def load_sensor(camera: PerspectiveCamera, bands_nm: Bands, sampler: str, samples: int) -> Any:
    """Return a perspective sensor with one film channel per band; the pose is set later."""
    film: dict[str, Any] = {
        "type": "specfilm",
        "width": camera.width,
        "height": camera.height,
        "component_format": "float32",
        # The only filter that is bit-reproducible in vectorized variants, and a pixel is a box.
        "rfilter": {"type": "box"},
    }
    for index, (lower, upper) in enumerate(bands_nm):
        film[f"band_{index:03d}"] = {
            "type": "regular",
            "wavelength_min": lower,
            "wavelength_max": upper,
            "values": ",".join([repr(1 / (upper - lower))] * 2),
        }
    return mi.load_dict(
        {
            "type": "perspective",
            "fov": camera.fov_deg,
            "fov_axis": "x",
            "near_clip": 1e-3,
            "far_clip": 1e5,
            "film": film,
            "sampler": {"type": sampler, "sample_count": samples},
        }
    )


def sensor_transform(pose: NDArray[np.float64]) -> Any:
    """Mitsuba's sensor transform of a pose: its camera looks along +z with +x left and +y up."""
    matrix = (pose @ np.diag([-1.0, -1.0, 1.0, 1.0])).tolist()
    return mi.Transform4f(matrix)


def _lights(lighting: Lighting) -> dict[str, Any]:
    lights: dict[str, Any] = {}
    if max(lighting.sky.values):
        lights["sky"] = {"type": "constant", "radiance": _spectrum(lighting.sky)}
    if lighting.sun:
        lights["sun"] = {
            "type": "directional",
            "direction": [-x for x in lighting.sun.direction],
            "irradiance": _spectrum(lighting.sun.irradiance),
        }
    return lights


def _mesh(name: str, mesh: MergedMesh, materials: Mapping[str, Material]) -> Any:
    material = materials[mesh.material]
    properties = mi.Properties()
    if material.emission:
        properties["mesh_emitter"] = mi.load_dict(
            {"type": "area", "radiance": _emission(material.emission)}
        )
    properties["mesh_bsdf"] = mi.load_dict(_bsdf(material))
    loaded = mi.Mesh(
        name,
        len(mesh.vertices),
        len(mesh.faces),
        has_vertex_normals=mesh.normals is not None,
        has_vertex_texcoords=mesh.uv is not None,
        props=properties,
    )
    buffers = mi.traverse(loaded)
    buffers["vertex_positions"] = mesh.vertices.ravel()
    buffers["faces"] = mesh.faces.ravel()
    if mesh.normals is not None:
        buffers["vertex_normals"] = mesh.normals.ravel()
    if mesh.uv is not None:
        buffers["vertex_texcoords"] = mesh.uv.ravel()
    buffers.update()
    return loaded


def _bsdf(material: Material) -> dict[str, Any]:
    if material.emission:
        return {"type": "diffuse", "reflectance": {"type": "spectrum", "value": 0.0}}
    diffuse = {"type": "diffuse", "reflectance": _spectrum(material.reflectance)}
    if material.texture:
        diffuse = {
            "type": "blendbsdf",
            "weight": bitmap(material.texture.weight),
            "first": diffuse,
            "second": {"type": "diffuse", "reflectance": _spectrum(material.texture.reflectance)},
        }
    return {"type": "twosided", "surface": diffuse}


def _emission(emission: Emission) -> dict[str, Any]:
    if emission.pattern is None:
        return {"type": "spectrum", "value": emission.radiance}
    return bitmap(emission.pattern * np.float32(emission.radiance))


def bitmap(values: NDArray[np.float32]) -> dict[str, Any]:
    """Mitsuba texture of values (H, W) that tile the uv square, row 0 at v = 0."""
    # Mitsuba's first row is v = 0, as ours.
    image = np.ascontiguousarray(values[..., None], dtype=np.float32)
    return {"type": "bitmap", "bitmap": mi.Bitmap(image), "raw": True, "wrap_mode": "repeat"}


def _spectrum(spectrum: Spectrum) -> dict[str, Any]:
    if not max(spectrum.values):
        return {"type": "spectrum", "value": 0.0}  # a table without any mass is refused
    first, last = _SPECTRUM_LIMITS_NM
    table = [
        (first, spectrum.values[0]),
        *zip(spectrum.wavelengths_nm, spectrum.values, strict=True),
        (last, spectrum.values[-1]),
    ]
    return {"type": "spectrum", "value": table}
