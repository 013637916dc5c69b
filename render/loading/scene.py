"""Loaded Mitsuba scene of scene data: merged meshes with materials, and lights."""

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import repeat
from typing import Any
from weakref import WeakValueDictionary

import numpy as np
from numpy.typing import NDArray

from megalopta.core.arrays import Floats, Ints, Mask
from megalopta.core.bounded import printable, quoted
from megalopta.render import dr, mi
from megalopta.render.loading.materials import bsdf, emission, spectrum
from megalopta.render.loading.meshes import MergedMesh, MovingMesh, merge
from megalopta.render.loading.sky import sky_light
from megalopta.render.mitsuba_loader import is_scalar
from megalopta.scenes.material import Material
from megalopta.scenes.scene import Haze, Scene
from megalopta.scenes.spectra.spectrum import flat

# Points that represent the disc of sun or moon: at 10 m they blur a shadow's edge in steps of 1 cm.
# They cost no time, since a path samples only one of them.
DISC_POINTS = 64
_PLACE = re.compile(
    r"\[[\w.]+(:\d+)?\] |(At|While loading) dictionary node \"\w+\": "
    r"|failed to instantiate \w+ plugin of type \"\w+\": "
)
"""Part of Mitsuba's messages that says where in a nested description."""


@dataclass(frozen=True, eq=False)
class LoadedScene:
    """Scene with its loaded Mitsuba version."""

    scene: Scene
    meshes: Sequence[MergedMesh]
    loaded: Any
    """Mitsuba's scene of the meshes, in order."""


_IN_USE: WeakValueDictionary[tuple[int, str, bool], LoadedScene] = WeakValueDictionary()


def whole_scene(scene: Scene, is_plain: bool) -> LoadedScene:
    """Load a scene, or return it as loaded for another renderer, plain or not, if nothing moves.

    Kernels hold Dr.Jit's numbers of shapes: for a second copy they would be compiled again.
    """
    key = id(scene), str(mi.variant()), is_plain
    loaded_scene = None if scene.is_moving else _IN_USE.get(key)
    if loaded_scene is None:
        meshes = merge(scene)
        # Under a sun, paths find the sky by chance: in forests with half of the variance.
        weight = float(is_plain or not (scene.lighting and scene.lighting.sun))
        loaded = load_scene(scene, meshes, weight)
        loaded_scene = _IN_USE[key] = LoadedScene(scene, meshes, loaded)
    return loaded_scene


def load_scene(scene: Scene, meshes: Sequence[MergedMesh], sky_weight: float = 1.0) -> Any:
    """Load scene data into Mitsuba; the active variant must be a spectral one."""
    shapes = []
    for mesh in meshes:
        material = scene.materials[mesh.material]
        parts = {"mesh_bsdf": _loaded(material, mesh.material)}
        if material.emission:
            glow = {"type": "area", "radiance": emission(material.emission)}
            parts = {"mesh_emitter": mi.load_dict(glow), **parts}
        shapes.append(load_mesh(mesh, **parts))
    return of_shapes(shapes, scene, sky_weight)


def lamps_of(scene: Scene) -> dict[str, Any]:
    """Mitsuba's emitters of a scene's lamps, relative to its `origin_m`."""
    lamps = {}
    for index, lamp in enumerate(scene.lamps):
        place = lamp.pose[:3, 3] - scene.origin_m
        along = -lamp.pose[:3, 2] / np.linalg.norm(lamp.pose[:3, 2])
        side = np.eye(3)[np.argmin(np.abs(along))]
        ends = (point.tolist() for point in (place, place + along, side))
        strength = "irradiance" if lamp.kind == "directional" else "intensity"
        light: dict[str, Any] = {"type": lamp.kind, strength: spectrum(lamp.light)}
        light["to_world"] = mi.ScalarTransform4f().look_at(*ends)
        if lamp.kind == "spot":
            light["beam_width"], light["cutoff_angle"] = lamp.cone_deg
        lamps[f"lamp_{index:03d}"] = light
    return lamps


def of_shapes(shapes: Sequence[Any], lit_as: Scene | None = None, sky_weight: float = 1.0) -> Any:
    """Return a scene of loaded shapes, in order, in the light and by the lamps of another."""
    parts: dict[str, Any] = {"type": "scene", **(lamps_of(lit_as) if lit_as else {})}
    lighting = lit_as.lighting if lit_as else None
    sky = sky_light(lighting, sky_weight) if lighting else None
    if sky is not None:
        parts["sky"] = sky
    if lighting and lighting.sun:
        irradiance = spectrum(lighting.sun.irradiance.scaled(1 / DISC_POINTS))
        for index, point in enumerate(lighting.sun.points(DISC_POINTS).tolist()):
            parts[f"sun_{index:02d}"] = {
                "type": "directional",
                "direction": [-x for x in point],
                "irradiance": irradiance,
                "sampling_weight": 1 / DISC_POINTS,  # all of them as often as the sky
            }
    names = {f"mesh_{index:03d}": shape for index, shape in enumerate(shapes)}
    return mi.load_dict({**parts, **names})


def load_mesh(mesh: MergedMesh, **parts: Any) -> Any:
    """Load a mesh with Mitsuba parts, such as a loaded `mesh_bsdf`."""
    properties = mi.Properties()
    for name, part in parts.items():
        properties[name] = part
    loaded = mi.Mesh(
        mesh.material,
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


def _loaded(material: Material, name: str) -> Any:
    """Load a surface. Raises ValueError if Mitsuba does not accept one kept as it is."""
    try:
        return mi.load_dict(bsdf(material))
    except RuntimeError as problem:
        if not material.finish:
            raise
        reason = _PLACE.sub("", " ".join(str(problem).split()))
        raise ValueError(
            f"material {name!r}: Mitsuba does not accept it ({printable(quoted(reason, 200))}); "
            "correct the file, or give its reflectance in `materials`"
        ) from None


def move_meshes(
    scene: Any, moved: Mapping[int, tuple[NDArray[np.float32], NDArray[np.float32] | None]]
) -> None:
    """Set new vertices, and normals if any, (V, 3) of some of a scene's meshes, by index."""
    shapes = scene.shapes()
    for index, parts in moved.items():
        # Normals last, as Mitsuba computes its own for new positions.
        for name, values in zip(("vertex_positions", "vertex_normals"), parts, strict=True):
            if values is not None:
                buffers = mi.traverse(shapes[index])
                buffers[name] = values.ravel()
                buffers.update()
    scene.parameters_changed([])


def move_to(scene: Any, meshes: Mapping[int, MovingMesh], time_s: float) -> None:
    """Move moving meshes of a scene, by index, to a time."""
    move_meshes(
        scene,
        {
            index: (mesh.vertices_at(time_s), mesh.normals_at(time_s))
            for index, mesh in meshes.items()
        },
    )


class MeshIndex:
    """Meshes of loaded scenes by shape, one scene after the other, in a vectorized variant."""

    def __init__(self, *loaded: Any) -> None:
        numbers = [np.array(dr.reinterpret_array(mi.UInt, scene.shapes_dr())) for scene in loaded]
        registered = np.concatenate(numbers)
        # Entry 0 is for rays without a hit.
        table = np.zeros(1 + int(registered.max(initial=0)), np.uint32)
        table[registered] = np.arange(len(registered))
        self._table = mi.UInt(table)

    def of(self, hit: Any) -> Any:
        """Index of the mesh, as loaded, of each preliminary intersection (N,); 0 for a miss."""
        shape: Any = dr.reinterpret_array(mi.UInt, hit.shape)
        return dr.gather(mi.UInt, self._table, shape)


# A visibility ray stops this fraction short of its target, so that the target does not hide itself.
VISIBILITY_MARGIN = 2e-4


class SceneRays:
    """Custom rays through one loaded scene."""

    def __init__(self, scene: Any) -> None:
        self.scene, self._is_scalar = scene, is_scalar()
        self._index = None if self._is_scalar else MeshIndex(scene)

    def nearest(self, origin: Floats, directions: Floats) -> tuple[Floats, Ints, Ints]:
        """Nearest hits of rays from one origin (3,) or N of them, along directions (N, 3).

        Returns distances (N,) in units of these, infinite without a hit, the meshes hit (N,), as
        loaded, and triangles (N,) of these.
        """
        if self._index is None:
            distance = np.full(len(directions), np.inf)
            mesh, triangle = np.zeros((2, len(directions)), np.int64)
            for ray, single in enumerate(_single_rays(origin, directions)):
                hit = self.scene.ray_intersect_preliminary(single)
                if hit.is_valid():
                    distance[ray] = hit.t
                    mesh[ray], triangle[ray] = hit.shape_index, hit.prim_index
            return distance, mesh, triangle
        hits = self.scene.ray_intersect_preliminary(_rays(origin, directions), coherent=True)
        # Other values of rays without a hit are left over from other work: they are set to zero.
        valid = hits.is_valid()
        distance = dr.select(valid, hits.t, dr.inf)
        mesh, triangle = self._index.of(hits), dr.select(valid, hits.prim_index, 0)
        # All at once: delayed evaluation would trace the rays again.
        dr.eval(distance, mesh, triangle)
        return (
            np.array(distance, np.float64),
            np.array(mesh, np.int64),
            np.array(triangle, np.int64),
        )

    def is_hidden(self, origin: Floats, directions: Floats, distances: Floats) -> Mask:
        """True if anything is nearer than distances (N,), in units of directions (N, 3)."""
        limits = visibility_limits(distances)
        if self._is_scalar:
            singles = _single_rays(origin, directions, limits)
            return np.array([self.scene.ray_test(ray) for ray in singles])
        rays = _rays(origin, directions)
        rays.maxt = mi.Float(limits)
        return np.array(self.scene.ray_test(rays, coherent=True), dtype=bool)


def visibility_limits(distances: Floats) -> Floats:
    """End of rays to targets at distances (N,)."""
    return np.minimum(distances * (1 - VISIBILITY_MARGIN), np.finfo(np.float32).max)


def _rays(origin: Floats, directions: Floats) -> Any:
    start, along = (np.ascontiguousarray(part.T) for part in (np.atleast_2d(origin), directions))
    return mi.Ray3f(mi.Point3f(start), mi.Vector3f(along))


def _single_rays(origin: Floats, directions: Floats, limits: Floats | None = None) -> Iterator[Any]:
    starts = np.broadcast_to(origin, directions.shape).tolist()
    ends = repeat(float("inf")) if limits is None else limits.tolist()
    for start, along, end in zip(starts, directions.tolist(), ends, strict=False):
        ray = mi.Ray3f(mi.Point3f(start), mi.Vector3f(along))
        ray.maxt = end
        yield ray


_LARGEST_MOVING_SHARE = 0.5
"""Share of moving triangles above which two scenes do not pay for intersecting each ray twice."""


class Layers:
    """One or two loaded scenes, to be intersected as one."""

    def __init__(self, *scenes: Any) -> None:
        self.scenes = scenes

    def move_to(self, time_s: float) -> None:
        """Do nothing: who loaded the scenes moves their objects."""

    def ray_intersect_preliminary(
        self, rays: Any, coherent: bool = False, active: Any = True
    ) -> Any:
        """Nearest hits of rays."""
        hits = [
            scene.ray_intersect_preliminary(rays, coherent=coherent, active=active)
            for scene in self.scenes
        ]
        nearest = hits[0]
        for hit in hits[1:]:
            nearest = dr.select(hit.t < nearest.t, hit, nearest)
        return nearest

    def ray_test(self, rays: Any, active: Any = True) -> Any:
        """True for rays that hit something."""
        blocked = mi.Bool(False)
        for scene in self.scenes:
            blocked |= scene.ray_test(rays, active)
        return blocked


def is_layered(meshes: Sequence[MergedMesh]) -> bool:
    """True if moving objects are small, and come with objects at rest."""
    moving = sum(len(mesh.faces) for mesh in meshes if isinstance(mesh, MovingMesh))
    return 0 < moving <= _LARGEST_MOVING_SHARE * sum(len(mesh.faces) for mesh in meshes)


class MovingScene(Layers):
    """Scene of the meshes at rest, and a copy of the moving ones with the loaded surfaces."""

    def __init__(self, meshes: Sequence[MergedMesh], loaded: Any, still: Any) -> None:
        self._meshes = [mesh for mesh in meshes if isinstance(mesh, MovingMesh)]
        shapes = loaded.shapes()[len(meshes) - len(self._meshes) :]
        pairs = zip(self._meshes, shapes, strict=True)
        again = [load_mesh(mesh, mesh_bsdf=shape.bsdf()) for mesh, shape in pairs]
        super().__init__(still, of_shapes(again))

    def move_to(self, time_s: float) -> None:
        """Move the moving meshes to a time."""
        move_to(self.scenes[1], dict(enumerate(self._meshes)), time_s)


MARGIN_M = 1.0
"""Margin of the box beyond surfaces and camera."""


@dataclass(frozen=True)
class Air:
    """Haze of a scene, a homogeneous medium in a box around all surfaces and the camera.

    It is a separate scene: ground truth requires nothing between camera and surfaces.
    """

    scene: Any
    """Scene of the surfaces and the box."""
    medium: Any
    """Medium in which sensors in the box start."""
    extinction_per_m: float
    low: Floats
    high: Floats
    """(3,): corners of the box, m."""

    def holds(self, points: Floats) -> bool:
        """True if points (..., 3), m, are all in the box."""
        return bool(((points > self.low) & (points < self.high)).all())

    def transmittance(self, point: Floats, toward: Floats) -> Floats:
        """Share (N,) of light from unit directions (N, 3) that reaches a point (3,) unscattered."""
        with np.errstate(divide="ignore"):
            ends = np.maximum((self.low - point) / toward, (self.high - point) / toward)
        return np.asarray(np.exp(-self.extinction_per_m * ends.min(axis=1)))


def fill(
    scene: Scene, haze: Haze, loaded: Any, meshes: Sequence[MergedMesh], positions: Floats
) -> Air:
    """Fill a loaded scene of meshes with haze, in a box that holds positions (N, 3) too, m.

    Moving shapes are loaded again: if two scenes share one, only the first is updated.
    """
    box = loaded.bbox()
    corners = np.array([box.min, box.max], np.float64)
    points = np.concatenate([corners, positions])
    low, high = points.min(axis=0) - MARGIN_M, points.max(axis=0) + MARGIN_M
    medium = mi.load_dict(
        {
            "type": "homogeneous",
            "sigma_t": _everywhere(haze.extinction_per_m),
            "albedo": _everywhere(haze.albedo),
            "phase": {"type": "hg", "g": haze.asymmetry},
        }
    )
    place = mi.ScalarTransform4f().translate(((low + high) / 2).tolist())
    walls = {
        "type": "cube",
        "to_world": place.scale(((high - low) / 2).tolist()),
        "bsdf": {"type": "null"},
        "interior": medium,
    }
    shapes = load_scene(scene, meshes).shapes() if scene.is_moving else loaded.shapes()
    filled = of_shapes([*shapes, mi.load_dict(walls)], scene)
    return Air(filled, medium, haze.extinction_per_m, low, high)


def _everywhere(value: float) -> dict[str, Any]:
    return {"type": "constvolume", "value": spectrum(flat(value))}
