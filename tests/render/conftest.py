import numpy as np
import pytest
import trimesh
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from megalopta.render import RenderSettings, SceneRenderer, mi
from megalopta.render.film import film_and_sampler, plugin, sensor_transform
from megalopta.render.variant import choose_variant
from megalopta.scenes import Trajectory
from megalopta.scenes.material import Emission, Material
from megalopta.scenes.scene import Asset, Lighting, Placement, Scene
from megalopta.scenes.spectra.spectrum import flat

vectorized = pytest.mark.skipif(
    choose_variant().name.startswith("scalar"), reason="needs a vectorized variant"
)
INTEGRATORS = ["path", pytest.param("baked", marks=[vectorized, pytest.mark.slow])]
GRAY = Material(flat(0.5))
EVEN = Lighting(flat(1e-9))


def quad(corners: NDArray[np.float64]) -> trimesh.Trimesh:
    """Two triangles over four corners given in order."""
    return trimesh.Trimesh(corners, [[0, 1, 2], [0, 2, 3]], process=False)


def sphere_cap(center, radius, toward):
    """The side of a sphere that faces a point, in triangles so fine that facets do not matter.

    With steps of 0.003 rad a facet lies at most radius · 1.2e-6 below the sphere.
    """
    angles = np.arange(-0.75, 0.7501, 0.003)
    u, v = np.meshgrid(angles, angles)
    local = np.stack([np.tan(u), np.tan(v), np.ones_like(u)], axis=-1)
    local /= np.linalg.norm(local, axis=-1, keepdims=True)
    axis = (toward - center) / np.linalg.norm(toward - center)
    side = np.cross(axis, [0, 0, 1.0])
    side /= np.linalg.norm(side)
    frame = np.stack([side, np.cross(axis, side), axis])
    n = len(angles)
    a = (np.arange(n - 1)[:, None] * n + np.arange(n - 1)).ravel()
    faces = np.concatenate(
        [np.column_stack([a, a + 1, a + n]), np.column_stack([a + 1, a + n + 1, a + n])]
    )
    vertices = center + radius * local.reshape(-1, 3) @ frame
    return trimesh.Trimesh(vertices, faces, process=False)


def scene_of(lighting, *things, **more) -> Scene:
    """A scene of meshes, or (mesh, material), or (mesh, material, motion); object k is named k."""
    given = [thing if isinstance(thing, tuple) else (thing,) for thing in things]
    full = {str(k + 1): (*each, *(GRAY, None)[len(each) - 1 :]) for k, each in enumerate(given)}
    return Scene(
        {name: material for name, (_, material, _) in full.items()},
        {name: Asset({name: mesh}) for name, (mesh, _, _) in full.items()},
        tuple(Placement(name, name, np.eye(4), motion) for name, (_, _, motion) in full.items()),
        lighting,
        **more,
    )


def renderer_of(camera, *things, poses=None, lighting=EVEN, more=None, **settings):
    """Renderer of a scene of things in even light; of one sample and one band unless told."""
    given = {"samples_per_pixel": 1, "bands_nm": ((500, 600),), **settings}
    scene = scene_of(lighting, *things, **(more or {}))
    return SceneRenderer(scene, camera, RenderSettings(**given), poses)


def square(height=0.0, half_width=1000.0) -> trimesh.Trimesh:
    """A level square that faces up, 2 km wide unless told."""
    corners = half_width * np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0.0]])
    corners[:, 2] = height
    return quad(corners)


def down(height=2.0):
    """Poses of a camera straight above the origin, or below it, that looks there."""
    above = {"position_m": (0, 0, height), "look_at_m": (0, 0, 0), "up": (1, 0, 0)}
    return Trajectory(frames=2, **above).poses()


@pytest.fixture
def ground() -> trimesh.Trimesh:
    return square()


def band_means(bands, *spectra):
    """Means of a product of spectra; independent of the renderer: fine midpoint sums."""
    grids = [np.linspace(a, b, 20001) for a, b in bands]
    middles = [0.5 * (grid[1:] + grid[:-1]) for grid in grids]
    return np.array([np.prod([s(m) for s in spectra], axis=0).mean() for m in middles])


def glowing_room() -> Scene:
    """Walls all around the origin that glow with noise some degrees wide, without any symmetry."""
    room = trimesh.creation.box((9, 7, 6))
    room.invert()  # surfaces glow to the outside of their mesh
    corners = room.vertices[room.faces].reshape(-1, 3)  # a texture coordinate per face and corner
    axis = np.abs(np.repeat(room.face_normals, 3, axis=0)).argmax(axis=1)
    rows = np.arange(len(corners))
    uv = np.column_stack([corners[rows, (axis + 1) % 3], corners[rows, (axis + 2) % 3]])
    walls = trimesh.Trimesh(corners, rows.reshape(-1, 3), process=False)
    walls.visual = trimesh.visual.TextureVisuals(uv=uv / 9 + np.sign(corners)[:, :1] / 7)
    noise = gaussian_filter(np.random.default_rng(2).normal(size=(512, 512)), 14, mode="wrap")
    pattern = np.maximum(1 + noise / (4 * noise.std()), 0).astype(np.float32)
    return scene_of(None, (walls, Material(flat(0.0), None, Emission(1e-6, pattern))))


def plainly(scene, camera, pose, settings):
    """Radiance by seed of a scene loaded by plain Mitsuba."""
    to_world = mi.ScalarTransform4f(sensor_transform(pose).tolist())
    size, samples = (camera.width, camera.height), settings.samples_per_pixel
    parts = film_and_sampler(size, settings.bands_nm, "independent", samples)
    sensor = mi.load_dict({**plugin(camera), "to_world": to_world, **parts})
    integrator = mi.load_dict({"type": "path", "max_depth": settings.max_depth})
    return lambda seed: mi.render(scene, sensor=sensor, integrator=integrator, seed=seed)
