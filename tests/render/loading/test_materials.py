"""Surfaces as Mitsuba has them, in both kinds of variants, against Lambert's law."""

import numpy as np
import pytest
import trimesh

from megalopta.render import Variant, activate, choose_variant, mi
from megalopta.render.loading.meshes import merge
from megalopta.render.loading.scene import load_scene
from megalopta.scenes.material import Material, Texture
from megalopta.scenes.spectra.spectrum import Spectrum, flat

from ..conftest import scene_of, square

RNG = np.random.default_rng(3)
COUNT = 256
WAVELENGTHS = (450.0, 500.0, 550.0, 600.0)
RISING = Spectrum((400.0, 700.0), (0.1, 0.4))
VARIANTS = sorted({"scalar_spectral", choose_variant().name})
LEAVES = {
    "plain": Material(RISING, transmittance=flat(0.3)),
    "light through alone": Material(flat(0.0), transmittance=flat(0.9)),
    "nothing lost": Material(flat(0.35), transmittance=flat(0.65)),
    "black": Material(flat(0.0), Texture(np.zeros((2, 2), np.float32), flat(0.0), flat(0.5))),
    "textured": Material(
        RISING, Texture(np.full((2, 2), 0.25, np.float32), flat(0.1), RISING), None, flat(0.5)
    ),
    "opaque": Material(RISING),
}


@pytest.fixture(params=VARIANTS)
def variant(request):
    activate(Variant(request.param, "as asked"))
    yield request.param
    activate(choose_variant())


def shares(material):
    """Reflectance and transmittance (2, 4) at the wavelengths, in the middle of a surface."""
    first, texture = (material.reflectance, material.transmittance), material.texture
    weight = float(texture.weight[0, 0]) if texture else 0.0
    second = (texture.reflectance, texture.transmittance) if texture else first
    values = [[(each or flat(0.0))(WAVELENGTHS) for each in pair] for pair in (first, second)]
    return (1 - weight) * np.array(values[0]) + weight * np.array(values[1])


def loaded(material):
    sheet = square(half_width=1)
    sheet.visual = trimesh.visual.TextureVisuals(uv=np.full((4, 2), 0.5))
    scene = scene_of(None, (sheet, material))
    return load_scene(scene, merge(scene))


def directions(count):
    found = RNG.normal(size=(3, count))
    return found / np.linalg.norm(found, axis=0)


def interactions(scene, origins, variant):
    """What rays from directions (3, n) on both sides meet in the middle of the surface."""
    if variant.startswith("scalar"):
        rays = [mi.Ray3f(o.tolist(), (-o).tolist(), 0.0, WAVELENGTHS) for o in origins.T]
        return [scene.ray_intersect(ray) for ray in rays]
    wavelengths = mi.Spectrum(*WAVELENGTHS)
    return scene.ray_intersect(mi.Ray3f(mi.Point3f(origins), mi.Vector3f(-origins), 0, wavelengths))


def each(variant, function, points, *arguments):
    """Values (n, ...) of a function of interactions, whole or one at a time."""
    if not variant.startswith("scalar"):
        kinds = {1: mi.Float, 2: mi.Point2f, 3: mi.Vector3f}
        given = [kinds[len(a) if a.ndim > 1 else 1](a.astype(np.float32)) for a in arguments]
        found = function(points, *given)
        return [np.moveaxis(np.array(value), -1, 0) for value in found]
    rows = zip(points, *(a.T.tolist() for a in arguments), strict=True)
    found = [function(*row) for row in rows]
    return [np.array([np.array(value) for value in column]) for column in zip(*found, strict=True)]


@pytest.mark.parametrize("name", LEAVES)
def test_light_leaves_both_sides_of_a_surface_by_lamberts_law(name, variant):
    scene, expected = loaded(LEAVES[name]), shares(LEAVES[name])
    surface, context = scene.shapes()[0].bsdf(), mi.BSDFContext()
    arriving, leaving = directions(COUNT), directions(COUNT)
    points = interactions(scene, arriving, variant)
    values, density = each(
        variant, lambda si, to: surface.eval_pdf(context, si, si.to_local(to)), points, leaving
    )
    same = arriving[2] * leaving[2] > 0
    law = np.where(same[:, None], *expected[:, None]) * np.abs(leaving[2] / np.pi)[:, None]
    np.testing.assert_allclose(values, law, rtol=1e-5, atol=1e-8)
    assert (density[(law > 0).any(axis=1)] > 0).all()
