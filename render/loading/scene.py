"""Scene data to a loaded Mitsuba scene: merged meshes, with their materials, and lights.

Which mesh of a loaded scene was hit, in every vectorized variant. Embree numbers the shapes of a
scene, OptiX does not; what both give is the shape itself, as its number in Dr.Jit's registry of all
shapes of the process.
"""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from megalopta.render import dr, mi
from megalopta.render.loading.materials import bsdf, emission, spectrum
from megalopta.render.loading.meshes import MergedMesh, MovingMesh
from megalopta.render.loading.sky import uneven_sky
from megalopta.scenes.material import Material
from megalopta.scenes.scene import Lighting, Scene

# Points that stand for the disc of sun or moon: at 10 m they blur a shadow's edge in steps of 1 cm.
# They cost no time, since a path looks at one of them.
DISC_POINTS = 64


class LoadedScene(NamedTuple):
    """A scene, and what it has become for Mitsuba."""

    scene: Scene
    meshes: Sequence[MergedMesh]
    loaded: Any
    """Mitsuba's, of the meshes in their order."""


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
    if lighting.patterns:
        lights["sky"] = uneven_sky(lighting)
    elif max(lighting.sky.values):
        lights["sky"] = {"type": "constant", "radiance": spectrum(lighting.sky)}
    if lighting.sun:
        irradiance = spectrum(lighting.sun.irradiance.scaled(1 / DISC_POINTS))
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


def load_again(meshes: Sequence[MergedMesh], shapes: Sequence[Any]) -> Any:
    """Return a scene of meshes with the surfaces of loaded shapes, without light."""
    again = {}
    for index, (mesh, shape) in enumerate(zip(meshes, shapes, strict=True)):
        properties = mi.Properties()
        properties["mesh_bsdf"] = shape.bsdf()
        again[f"mesh_{index:03d}"] = _filled(f"mesh_{index:03d}", mesh, properties)
    return mi.load_dict({"type": "scene", **again})


def bare_mesh(vertices: NDArray[np.float32], faces: NDArray[np.uint32], surface: Any = None) -> Any:
    """Load a mesh of vertices (V, 3) and faces (F, 3) for rays, of a loaded surface."""
    properties = mi.Properties()
    if surface:
        properties["mesh_bsdf"] = surface
    loaded = mi.Mesh("bare", len(vertices), len(faces), props=properties)
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


def move_to(scene: Any, meshes: Mapping[int, MovingMesh], time_s: float) -> None:
    """Put moving meshes of a scene, by their index, where they are at a time."""
    normals = {index: mesh.normals_at(time_s) for index, mesh in meshes.items()}
    vertices = {index: mesh.vertices_at(time_s) for index, mesh in meshes.items()}
    turned = {index: each for index, each in normals.items() if each is not None}
    move_meshes(scene, vertices, turned)


def _mesh(name: str, mesh: MergedMesh, materials: Mapping[str, Material]) -> Any:
    material = materials[mesh.material]
    properties = mi.Properties()
    if material.emission:
        properties["mesh_emitter"] = mi.load_dict(
            {"type": "area", "radiance": emission(material.emission)}
        )
    properties["mesh_bsdf"] = mi.load_dict(bsdf(material))
    return _filled(name, mesh, properties)


def _filled(name: str, mesh: MergedMesh, properties: Any) -> Any:
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


class MeshIndex:
    """The meshes of a loaded scene by their shape; the active variant must be a vectorized one."""

    def __init__(self, loaded: Any) -> None:
        registered = np.array(dr.reinterpret_array(mi.UInt, loaded.shapes_dr()))
        # Entry 0 is what a ray has hit that hit nothing.
        table = np.zeros(1 + int(registered.max(initial=0)), np.uint32)
        table[registered] = np.arange(len(registered))
        self._table = mi.UInt(table)

    def of(self, hit: Any) -> Any:
        """Index of the mesh, as loaded, of each preliminary intersection (N,); 0 of a miss."""
        shape: Any = dr.reinterpret_array(mi.UInt, hit.shape)
        return dr.gather(mi.UInt, self._table, shape)
