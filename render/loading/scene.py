"""Scene data to a loaded Mitsuba scene: materials, merged meshes and lights.

Every spectral quantity is handed over as it is (spectral variants apply no color conversion).
"""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from megalopta.render import mi
from megalopta.render.loading.meshes import MergedMesh
from megalopta.scenes.spectra import Spectrum, flat
from megalopta.scenes.world import Emission, Lighting, Material, Scene, Texture

# Mitsuba's spectra are zero beyond their table; ours go on at the end values.
_SPECTRUM_LIMITS_NM = (100.0, 4000.0)

# Points that stand for the disc of sun or moon: at 10 m they blur a shadow's edge in steps of 1 cm.
# They cost no time, since a path looks at one of them.
DISC_POINTS = 64


def load_scene(scene: Scene, meshes: Sequence[MergedMesh]) -> Any:
    """Load scene data into Mitsuba; the active variant must be a spectral one."""
    lights = _lights(scene.lighting) if scene.lighting else {}
    shapes = {
        f"mesh_{index:03d}": _mesh(f"mesh_{index:03d}", mesh, scene.materials)
        for index, mesh in enumerate(meshes)
    }
    return mi.load_dict({"type": "scene", **lights, **shapes})


def _lights(lighting: Lighting) -> dict[str, Any]:
    lights: dict[str, Any] = {}
    if max(lighting.sky.values):
        lights["sky"] = {"type": "constant", "radiance": _spectrum(lighting.sky)}
    if lighting.sun:
        irradiance = _spectrum(lighting.sun.irradiance.scaled(1 / DISC_POINTS))
        for index, point in enumerate(lighting.sun.points(DISC_POINTS).tolist()):
            lights[f"sun_{index:02d}"] = {
                "type": "directional",
                "direction": [-x for x in point],
                "irradiance": irradiance,
                "sampling_weight": 1 / DISC_POINTS,  # all of them as often as the sky
            }
    return lights


def part_of_scene(scene: Scene, shapes: Sequence[Any]) -> Any:
    """Return a scene of some loaded shapes, in their order, under the light of the whole."""
    lights = _lights(scene.lighting) if scene.lighting else {}
    names = {f"mesh_{index:03d}": shape for index, shape in enumerate(shapes)}
    return mi.load_dict({"type": "scene", **lights, **names})


def gather(shapes: Sequence[Any]) -> Any:
    """Return a scene of loaded shapes, in their order, to trace rays through."""
    return mi.load_dict(
        {"type": "scene", **{f"mesh_{index:03d}": shape for index, shape in enumerate(shapes)}}
    )


def bare_mesh(vertices: NDArray[np.float32], faces: NDArray[np.uint32]) -> Any:
    """Load a mesh of vertices (V, 3) and faces (F, 3) without any material."""
    loaded = mi.Mesh("bare", len(vertices), len(faces))
    buffers = mi.traverse(loaded)
    buffers["vertex_positions"] = vertices.ravel()
    buffers["faces"] = faces.ravel()
    buffers.update()
    return loaded


def move_meshes(
    scene: Any,
    vertices: Mapping[int, NDArray[np.float32]],
    normals: Mapping[int, NDArray[np.float32]] | None = None,
) -> None:
    """Give some of a scene's meshes, by their index, other vertices and normals (V, 3)."""
    shapes = scene.shapes()
    for index, positions in vertices.items():
        buffers = mi.traverse(shapes[index])
        buffers["vertex_positions"] = positions.ravel()
        buffers.update()
    for index, directions in (normals or {}).items():
        # Only now: with new positions Mitsuba computes normals of its own.
        buffers = mi.traverse(shapes[index])
        buffers["vertex_normals"] = directions.ravel()
        buffers.update()
    scene.parameters_changed([])


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
    if not material.transmits:
        return _reflecting(material, 1.0)
    # Mitsuba has no surface that scatters evenly to both sides. Half of one that reflects twice as
    # much and half of one that transmits twice as much are just that; values above 1 do no harm.
    return {
        "type": "blendbsdf",
        "weight": 0.5,
        "first": _reflecting(material, 2.0),
        "second": _transmitting(material, 2.0),
    }


def _reflecting(material: Material, factor: float) -> dict[str, Any]:
    def diffuse(spectrum: Spectrum) -> dict[str, Any]:
        return {"type": "diffuse", "reflectance": _spectrum(spectrum.scaled(factor))}

    texture = material.texture
    second = texture.reflectance if texture else None
    return {"type": "twosided", "surface": _mixed(diffuse, texture, material.reflectance, second)}


def _transmitting(material: Material, factor: float) -> dict[str, Any]:
    def thin(spectrum: Spectrum | None) -> dict[str, Any]:
        color = _spectrum((spectrum or flat(0.0)).scaled(factor))
        # With 2 all of the diffuse light goes to the other side, and evenly.
        return {"type": "principledthin", "base_color": color, "diff_trans": 2.0, "spec_trans": 0.0}

    texture = material.texture
    second = texture.transmittance if texture else None
    return _mixed(thin, texture, material.transmittance, second)


def _mixed(
    surface: Callable[[Any], dict[str, Any]],
    texture: Texture | None,
    first: Spectrum | None,
    second: Spectrum | None,
) -> dict[str, Any]:
    """Surfaces of two spectra, of the first alone where there is no texture."""
    if texture is None:
        return surface(first)
    weight = bitmap(texture.weight)
    return {
        "type": "blendbsdf",
        "weight": weight,
        "first": surface(first),
        "second": surface(second),
    }


def _emission(emission: Emission) -> dict[str, Any]:
    if emission.pattern is None:
        return {"type": "spectrum", "value": emission.radiance}
    return bitmap(emission.pattern * np.float32(emission.radiance))


def bitmap(values: NDArray[np.float32]) -> dict[str, Any]:
    """Mitsuba texture of values (H, W) that tile the uv square, row 0 at v = 0."""
    # Mitsuba's first row is v = 0, as ours; it takes no array that is read-only.
    image = np.array(values[..., None], dtype=np.float32, order="C")
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
