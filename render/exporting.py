"""Export of a scene for plain Mitsuba: one frame as XML, with meshes as PLY and textures as EXR.

`mitsuba.load_file` renders the same radiance in any spectral variant. Leaves become blends of
Mitsuba's own surfaces, as in scalar variants here. Light is spread evenly over the sky: a sky with
a shape, panoramas, haze and other cameras are plug-ins of this program.
"""

import hashlib
from dataclasses import replace
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np

from megalopta.core import files
from megalopta.core.arrays import Floats
from megalopta.render.film import film_and_sampler
from megalopta.render.loading.materials import bsdf, emission
from megalopta.render.loading.meshes import MergedMesh, MovingMesh, merge
from megalopta.render.loading.scene import lights_of, load_mesh
from megalopta.render.mitsuba_loader import activated, mi
from megalopta.render.optics import plugin, sensor_transform
from megalopta.render.path_tracing import ROULETTE_DEPTH
from megalopta.render.settings import RenderSettings
from megalopta.render.variant import choose_variant
from megalopta.scenes.cameras.base import Camera
from megalopta.scenes.cameras.perspective import PerspectiveCamera
from megalopta.scenes.material import SURFACES, TEXTURES
from megalopta.scenes.scene import Scene

_TAGS = {
    **dict.fromkeys(("principledthin", *SURFACES), "bsdf"),
    **dict.fromkeys(TEXTURES, "texture"),
    **dict.fromkeys(("constant", "directional", "area"), "emitter"),
    **{"perspective": "sensor", "specfilm": "film", "box": "rfilter", "path": "integrator"},
    **{"regular": "spectrum", "uniform": "spectrum", "ply": "shape"},
    **dict.fromkeys(("independent", "multijitter", "orthogonal", "ldsampler"), "sampler"),
}
"""XML element of each of Mitsuba's plug-ins that scenes use."""
_NUMBERS = {bool: "boolean", int: "integer", float: "float", str: "string"}


def export_scene(
    scene: Scene,
    camera: Camera,
    settings: RenderSettings,
    pose: Floats,
    folder: Path,
    time_s: float = 0.0,
) -> Path:
    """Write a scene as a camera sees it from a pose (4, 4) at a time, and return the XML file.

    It is `scene.xml` in the folder, and written last. Coordinates are relative to the scene's
    origin.

    Raises ValueError if plain Mitsuba cannot render the scene, or a band is beyond what is known of
    a material.
    """
    lighting = scene.lighting
    if not isinstance(camera, PerspectiveCamera):
        raise ValueError(f"camera.kind {camera.kind!r}: Mitsuba has none; use 'perspective'")
    if scene.environment or (lighting and lighting.panorama):
        raise ValueError("a panorama has spectra that Mitsuba does not read; use an even sky")
    if lighting and lighting.patterns:
        raise ValueError("light.sky 'natural': Mitsuba has no such sky; use 'even'")
    if scene.haze:
        raise ValueError("scene.haze: haze is not exported; omit it")
    scene.check_bands(settings.bands_nm)
    with activated(choose_variant("scalar")):  # whose surfaces are Mitsuba's own
        local = pose.copy()
        local[:3, 3] -= scene.origin_m
        writer = _Writer(folder)
        root = ElementTree.Element("scene", version=str(mi.__version__))
        root.append(ElementTree.Comment(f" relative to {scene.origin_m} m, at {time_s:g} s "))
        path = {"type": "path", "max_depth": settings.max_depth, "rr_depth": ROULETTE_DEPTH}
        writer.add(root, "integrator", path)
        to_world = mi.ScalarTransform4f(sensor_transform(local).tolist())
        samples = settings.samples_per_pixel
        parts = film_and_sampler(camera.shape[::-1], settings.bands_nm, settings.sampler, samples)
        writer.add(root, "sensor", {**plugin(camera), "to_world": to_world, **parts})
        for name, light in (lights_of(scene.lighting) if scene.lighting else {}).items():
            writer.add(root, name, light)
        for number, mesh in enumerate(merge(scene)):
            if isinstance(mesh, MovingMesh):
                vertices, normals = mesh.vertices_at(time_s), mesh.normals_at(time_s)
                mesh = replace(mesh, vertices=vertices, normals=normals)
            writer.add(root, f"mesh_{number:03d}", _shape(scene, mesh, number, folder))
        ElementTree.indent(root)
        text = ElementTree.tostring(root, encoding="unicode", xml_declaration=False)
        files.write_text(folder / "scene.xml", f"{text}\n")
    return folder / "scene.xml"


def _shape(scene: Scene, mesh: MergedMesh, number: int, folder: Path) -> dict[str, Any]:
    """Write a mesh, and return its Mitsuba shape with surface and emitter."""
    material, name = scene.materials[mesh.material], f"meshes/mesh_{number:03d}.ply"
    with files.atomic_write(folder / name) as temporary:
        load_mesh(mesh).write_ply(str(temporary))
    shape = {"type": "ply", "filename": name, "face_normals": mesh.normals is None}
    surface: dict[str, Any] = {"surface": bsdf(material)}
    if material.emission:
        surface["emitter"] = {"type": "area", "radiance": emission(material.emission)}
    return {**shape, **surface}


class _Writer:
    """Writes Mitsuba's dictionaries as XML elements, and their pictures as files."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def add(self, parent: ElementTree.Element, name: str, value: Any) -> None:
        """Add a named value below an element."""
        if isinstance(value, dict):
            self._add_plugin(parent, name, value)
        elif isinstance(value, list):
            place = ", ".join(map(repr, value))
            ElementTree.SubElement(parent, "vector", name=name, value=place)
        elif type(value) in _NUMBERS:
            text = str(value).lower() if isinstance(value, bool) else str(value)
            ElementTree.SubElement(parent, _NUMBERS[type(value)], name=name, value=text)
        else:
            rows = np.array(value.matrix, np.float64).ravel().tolist()
            transform = ElementTree.SubElement(parent, "transform", name=name)
            ElementTree.SubElement(transform, "matrix", value=" ".join(map(repr, rows)))

    def _add_plugin(self, parent: ElementTree.Element, name: str, value: dict[str, Any]) -> None:
        kind = value["type"]
        if kind == "spectrum":
            table = value["value"]
            if isinstance(table, list):
                table = ", ".join(f"{nm!r}:{each!r}" for nm, each in table)
            ElementTree.SubElement(parent, "spectrum", name=name, value=str(table))
            return
        if kind == "rgb":
            ElementTree.SubElement(
                parent, "rgb", name=name, value=", ".join(map(repr, value["value"]))
            )
            return
        element = ElementTree.SubElement(parent, _TAGS[kind], type=kind, name=name)
        for key, each in value.items():
            if key == "bitmap":
                values = np.ascontiguousarray(np.array(each))
                name = f"textures/{hashlib.sha256(values.tobytes()).hexdigest()[:16]}.exr"
                if not (self._folder / name).exists():  # equal pictures share a file
                    with files.atomic_write(self._folder / name) as temporary:
                        each.write(str(temporary))
                self.add(element, "filename", name)
            elif key != "type":
                self.add(element, key, each)
