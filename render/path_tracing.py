"""Path-traced frames, with the data for their error.

The kernel is Mitsuba's own path tracer, random number by random number, in two points different.
Image size, camera and longest path are not constants of the compiled code, which takes seconds to
compile. And rays can intersect two scenes: one at rest, and a small one of moving objects.
"""

import math
from collections.abc import Iterator, Sequence
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from megalopta.core.arrays import Floats
from megalopta.render import Bands, shading
from megalopta.render.film import Look, developed, lens_of, pixel_means
from megalopta.render.loading.meshes import MergedMesh
from megalopta.render.loading.scene import Air, Layers, LoadedScene, MeshIndex
from megalopta.render.loading.sky import sky_of
from megalopta.render.mitsuba_loader import PlugIn, dr, is_scalar, mi, registered
from megalopta.render.settings import RenderSettings, part_seed
from megalopta.scenes.scene import Scene

# Fractional parts of irrational numbers that are independent over the rationals, times 2³²: 1/p and
# 1/p² of the plastic number p (Roberts' R₂ sequence), √2, √3 and √5.
_STEPS = tuple(
    round(2**32 * x)
    for x in (0.7548776662466927, 0.5698402909980532, 2**0.5 - 1, 3**0.5 - 1, 5**0.5 - 2)
)


def hashed(first: Any, second: Any) -> tuple[Any, Any]:
    """Two random 32-bit numbers from two others."""
    values: Any = mi.sample_tea_32(first, second)
    return values[0], values[1]


def recurrence(index: Any, key: Any) -> list[Any]:
    """Points `index` of five additive recurrences modulo 1, shifted by a key.

    They fill the unit hypercube evenly; integers keep them exact.
    """
    shifts = [shift for salt in (1, 2, 3) for shift in hashed(key, mi.UInt(salt))]
    return [
        mi.Float((index * mi.UInt(step) + shift) >> 8) * 2.0**-24
        for step, shift in zip(_STEPS, shifts, strict=False)
    ]


class _KeyedSampler(PlugIn):
    """Random numbers seeded by a key and a sample's index."""

    base = "Sampler"

    def __init__(self, properties: Any) -> None:
        self.above.__init__(self, properties)
        pcg32: Any = mi.PCG32
        self.generator = pcg32()

    def start(self, key: Any, sample: Any) -> None:
        state, stream = mi.sample_tea_64(key, sample), mi.sample_tea_64(sample, key)
        pcg32: Any = mi.PCG32
        self.generator = pcg32(1, state, stream)

    def clone(self) -> Any:
        pcg32: Any = mi.PCG32
        copy = keyed_sampler()
        copy.generator = pcg32(self.generator)
        return copy

    def schedule_state(self) -> None:
        dr.schedule(self.generator)

    def next_1d(self, active: Any = True) -> Any:
        return self.generator.next_float32()

    def next_2d(self, active: Any = True) -> Any:
        return mi.Point2f(self.next_1d(active), self.next_1d(active))


def keyed_sampler() -> Any:
    """Mitsuba sampler that is seeded by a key and a sample's index."""
    return mi.load_dict({"type": registered(_KeyedSampler)})


ROULETTE_DEPTH, _MOST_LIKELY = 2, 0.95
"""Hits after which a path continues by chance. Leaves reflect a tenth of the visible light: 2 in
place of Mitsuba's 5 costs a third and adds a tenth of noise."""
_MOST_RECORDINGS = 4
"""Recordings of the loop that are kept, and number of them after which a failure ends recording."""


class LightPaths:
    """Paths of at most `max_depth` hits in a vectorized variant.

    They intersect the layers, whose moving meshes do not emit; without these, the scene that lights
    them.
    """

    def __init__(self, max_depth: int, layers: Layers | None = None) -> None:
        self._max_depth = dr.opaque(mi.UInt32, max_depth)
        self._layers = layers
        # Python traces the loop once; later frames launch its kernels. Only the kinds of objects
        # among the arguments may be called.
        kinds = [dr.zeros(kind) for kind in (mi.ShapePtr, mi.BSDFPtr, mi.EmitterPtr)]
        self._trace: Any = dr.freeze(
            _traced, state_fn=lambda *_: kinds, limit=_MOST_RECORDINGS, warn_after=10**6
        )

    def move_to(self, time_s: float) -> None:
        """Trace the loop for every frame from here on: a recording has objects where they were."""
        self._trace.clear()
        self._trace.enabled = False

    def radiance(
        self, scene: Any, sampler: Any, rays: Any, active: Any | None = None
    ) -> tuple[Any, Any]:
        """Radiance along N rays at their wavelengths, and True for those that hit something.

        The sampler must be seeded for N.
        """
        active = dr.full(mi.Bool, True, dr.width(rays.d)) if active is None else mi.Bool(active)
        origin = dr.zeros(mi.Point3f, dr.width(rays.d)) + rays.o
        dr.make_opaque(origin, rays.d, rays.wavelengths, active)
        sampler.schedule_state()
        dr.eval()
        first: Any = mi.Ray3f(origin, rays.d)
        first.wavelengths = rays.wavelengths
        scenes = self._layers.scenes if self._layers else (scene,)
        for trace, numbers in (self._trace, sampler), (_traced, sampler.clone()):
            try:
                light, valid = trace(scene, scenes, self._max_depth, numbers, first, active)
                break
            except RuntimeError as problem:
                if _is_interrupt(problem):
                    raise KeyboardInterrupt from problem
                if trace is _traced:
                    raise
                # Mitsuba made tables while it was recorded, as it may not; next time, there are.
                self._trace.enabled &= self._trace.n_recordings < _MOST_RECORDINGS
        dr.eval(light, valid)
        return light, valid


def _is_interrupt(problem: BaseException | None) -> bool:
    """True if Ctrl-C is at the root of a problem."""
    while problem and not isinstance(problem, KeyboardInterrupt):
        problem = problem.__cause__
    return problem is not None


@dr.syntax
def _traced(
    scene: Any, scenes: Any, max_depth: Any, sampler: Any, ray: Any, active: Any
) -> tuple[Any, Any]:
    context = mi.BSDFContext()
    light, throughput = mi.Spectrum(0.0), mi.Spectrum(1.0)
    eta, depth, valid = mi.Float(1.0), mi.UInt32(0), mi.Bool(False)
    before, before_pdf = dr.zeros(mi.SurfaceInteraction3f), mi.Float(1.0)
    before_delta = mi.Bool(True)
    layers = Layers(*scenes)
    while active:
        hit = layers.ray_intersect_preliminary(ray, active=active)
        point = hit.compute_surface_interaction(ray, mi.RayFlags.All, active)
        shining = _shining(scene, point, before, before_pdf, before_delta)
        light = dr.fma(throughput, shining, light)
        goes_on = (depth + 1 < max_depth) & point.is_valid() & active
        surface = point.bsdf(ray)
        smooth = goes_on & mi.has_flag(surface.flags(), mi.BSDFFlags.Smooth)
        toward, weight = scene.sample_emitter_direction(point, sampler.next_2d(), False, smooth)
        smooth &= toward.pdf != 0
        smooth &= ~layers.ray_test(point.spawn_ray_to(toward.p), smooth)
        value, pdf, drawn, drawn_weight = surface.eval_pdf_sample(
            context, point, point.to_local(toward.d), sampler.next_1d(), sampler.next_2d(), goes_on
        )
        share = dr.select(toward.delta, 1.0, _share(toward.pdf, pdf))
        light = dr.select(smooth, dr.fma(throughput, value * weight * share, light), light)
        ray = point.spawn_ray(point.to_world(drawn.wo))
        throughput *= drawn_weight
        eta *= drawn.eta
        valid |= active & point.is_valid()
        before, before_pdf = point, drawn.pdf
        before_delta = mi.has_flag(drawn.sampled_type, mi.BSDFFlags.Delta)
        depth += dr.select(point.is_valid(), mi.UInt32(1), mi.UInt32(0))
        most: Any = dr.max(throughput)
        stays = dr.minimum(most * eta * eta, _MOST_LIKELY)
        roulette = depth >= ROULETTE_DEPTH
        throughput = dr.select(roulette, throughput * dr.rcp(stays), throughput)
        survives = sampler.next_1d() < stays
        active = goes_on & (~roulette | survives) & (most != 0)
    return light, valid


def _shining(scene: Any, point: Any, before: Any, pdf: Any, delta: Any) -> Any:
    """Emission of the hit itself, weighted against next-event estimation."""
    source = mi.DirectionSample3f(scene, point, before)
    looked = scene.pdf_emitter_direction(before, source, ~delta)
    light: Any = source.emitter.eval(point, pdf > 0)
    return light * _share(pdf, dr.select(delta, 0.0, looked))


def _share(pdf: Any, other_pdf: Any) -> Any:
    """Weight of a sample by the power heuristic (Veach, 1997)."""
    pdf, other_pdf = pdf * pdf, other_pdf * other_pdf
    weight = pdf / (pdf + other_pdf)
    return dr.select(dr.isfinite(weight), weight, 0.0)


def wavelength_groups(bands_nm: Bands, place: Any) -> Iterator[tuple[int, int, Any]]:
    """Bands in groups that fit Mitsuba's four wavelengths: first band, bands, wavelengths.

    `place` is the position of the wavelength in each band, 0 to 1.
    """
    for first in range(0, len(bands_nm), 4):
        group = bands_nm[first : first + 4]
        # Unused wavelengths repeat the last band and are not read.
        padded = [*group, *[group[-1]] * (4 - len(group))]
        wavelengths = [lower + (upper - lower) * place for lower, upper in padded]
        yield first, len(group), mi.Spectrum(wavelengths)


class BandPaths:
    """Light paths of selected rays, in bands."""

    def __init__(self, bands_nm: Bands, max_depth: int, layers: Layers | None = None) -> None:
        self._bands = bands_nm
        self._paths, self._sampler = LightPaths(max_depth, layers), keyed_sampler()

    def move_to(self, time_s: float) -> None:
        """Expect that objects are elsewhere from here on."""
        self._paths.move_to(time_s)

    def radiance(self, scene: Any, ray: Any, place: Any, sampler: Any, active: Any) -> list[Any]:
        """Radiance of each band along those of N rays that are active and hit something; else 0.

        `place` is the position of the wavelength in its band. Active rays are traced separately,
        with random numbers derived from one of the sampler's.
        """
        key = mi.UInt(sampler.next_1d() * 2.0**32)
        light = [dr.zeros(mi.Float, dr.width(active)) for _ in self._bands]
        lanes: Any = dr.compress(active)
        if not dr.width(lanes):
            return light
        rays, place = dr.gather(mi.Ray3f, mi.Ray3f(ray), lanes), dr.gather(mi.Float, place, lanes)
        self._sampler.start(dr.gather(mi.UInt, key, lanes), lanes)
        for first, size, wavelengths in wavelength_groups(self._bands, place):
            rays.wavelengths = wavelengths
            values, valid = self._paths.radiance(scene, self._sampler, rays)
            for band in range(size):
                dr.scatter(light[first + band], dr.select(valid, values[band], 0), lanes)
        return light


class Part(NamedTuple):
    """Part of the light, with its share of the samples of a pixel.

    `look` returns the radiance of each band, and 1 where a ray meets the sky; `cost` is that of a
    sample in a dense forest, CPU-µs.
    """

    share: float
    look: Look
    cost: float


def can_split(scene: Scene, meshes: Sequence[MergedMesh]) -> bool:
    """True if a scene's light can be split: of diffuse surfaces in clear air, and of no lamps."""
    materials = [scene.materials[mesh.material] for mesh in meshes]
    is_plain = not any(look.emission or look.finish for look in materials)
    lit = scene.lighting is not None and bool(meshes) and not scene.lamps
    return lit and is_plain and not (scene.haze or is_scalar())


class SplitPaths:
    """Frames of diffuse surfaces that do not emit, in clear air, by vectorized variants.

    The light of the surfaces seen is split into parts, each with its own samples. Their best
    numbers are in proportion to the root of variance over cost. In forests light from the disc of
    sun or moon takes one more ray and is most of the light and noise. Light from the sky takes one
    ray; light from other surfaces a path, ten times as much work, and brings a tenth of the light.
    """

    shares: tuple[float, ...]
    """Samples of each part over those of a pixel: as in forests, if not set."""

    def __init__(
        self, whole: LoadedScene, settings: RenderSettings, layers: Layers | None = None
    ) -> None:
        scene, meshes, loaded = whole.scene, whole.meshes, whole.loaded
        assert scene.lighting is not None
        self._loaded, self._depth = loaded, settings.max_depth
        self._layers = layers or Layers(loaded)
        self._bands, self._sampler = settings.bands_nm, settings.sampler
        self._index = MeshIndex(*self._layers.scenes)
        self._textures = shading.Textures(scene, meshes)
        materials = [scene.materials[mesh.material] for mesh in meshes]
        scattering = shading.Scattering([look.body for look in materials], self._bands)
        shine = shading.Shine(materials)
        self._bounces = shading.Bounces(scattering, len(self._bands), shine)
        self._sky = shading.SkyLight(
            scene.lighting, sky_of(loaded), scattering, self._bounces, self._bands
        )
        sun = scene.lighting.sun if settings.max_depth > 1 else None
        self._sun = shading.SunLight(scene, meshes, sun, self._bands) if sun else None
        self._paths = BandPaths(self._bands, settings.max_depth - 1, self._layers)
        self.shares = (1, 1 / 4, 1 / 16) if sun else (1, 1 / 16)

    # Found anew: a scene in a cycle of references would be freed while paths are traced.
    @property
    def parts(self) -> Sequence[Part]:
        """Parts of the light, which add up."""
        looks = [(self._seen, 0.7), (self._skylit, 1.5), (self._followed, 9.3)][: self._depth]
        if not self._sun and self._depth > 1:
            del looks[0]  # rays toward the sky see it between surfaces, too
        return [Part(share, *look) for share, look in zip(self.shares, looks, strict=False)]

    def move_to(self, time_s: float) -> None:
        """Move objects to a time, where a copy of theirs is traced."""
        self._layers.move_to(time_s)
        self._paths.move_to(time_s)

    def render(self, scene: Any, sensor: Any, seed: int, spp: int) -> NDArray[np.float32]:
        """Radiance (H, W, B) at a sensor, band means, W·m⁻²·sr⁻¹·nm⁻¹."""
        return self.measured(scene, sensor, seed, spp)[..., : len(self._bands)]

    def measured(self, scene: Any, sensor: Any, seed: int, spp: int) -> NDArray[np.float32]:
        """Radiance and the share of the sky (H, W, B + 1)."""
        images = []
        for number, part in enumerate(self.parts):
            samples = {"type": self._sampler, "sample_count": math.ceil(spp * part.share)}
            own_seed = part_seed(seed, "light path", number) if number else seed
            images.append(pixel_means(sensor, mi.load_dict(samples), own_seed, part.look))
        radiance = sum(image[..., :-1] for image in images)
        return np.concatenate([radiance, images[0][..., -1:]], axis=-1)

    def _seen(self, ray: Any, place: Any, sampler: Any) -> list[Any]:
        """Light of the sky behind the surfaces, and of the sun on them."""
        sight, weights = self._look(ray)
        light = self._sky.emitted(ray.d, ~sight.point.is_valid())
        if self._sun:
            direct = self._sun.radiance(self._layers, sight, weights, sampler.next_1d())
            light = [a + b for a, b in zip(light, direct, strict=True)]
        return [*light, sight.sky]

    def _skylit(self, ray: Any, place: Any, sampler: Any) -> list[Any]:
        """Light of the sky on the surfaces seen, and without a sun also behind them."""
        sight, weights = self._look(ray)
        light = self._sky.radiance(self._layers, sight, weights, sampler)
        if not self._sun:
            behind = self._sky.emitted(ray.d, ~sight.point.is_valid())
            light = [a + b for a, b in zip(light, behind, strict=True)]
        return [*light, sight.sky]

    def _followed(self, ray: Any, place: Any, sampler: Any) -> list[Any]:
        """Light of other surfaces on those seen."""
        sight, weights = self._look(ray)
        rays, through = self._bounces.rays(sight, sampler.next_2d())
        place = sampler.next_1d()
        dr.eval(sight, weights, rays, through, place)
        arriving = self._paths.radiance(self._loaded, rays, place, sampler, sight.shaded)
        light = self._bounces.reflected(sight, rays, through, weights, place, arriving)
        return [*light, sight.sky]

    def _look(self, ray: Any) -> tuple[shading.Sight, shading.Weights]:
        hit = self._layers.ray_intersect_preliminary(ray, coherent=True)
        point = hit.compute_surface_interaction(ray, mi.RayFlags.All)
        sight = shading.Sight(point, point.wi.z > 0, point.is_valid(), self._index.of(hit))
        return sight, self._textures.weights(sight)


SCATTERINGS = 64
"""Extension of the longest path of clear air in haze. For 80 trees in fog of 50 m visibility, 16
more miss 0.2 % of the light in the visible and 1.6 % where leaves are bright, 32 miss 0.01 %; at 10
m, 64 miss some 3 % where leaves are bright."""
# Rays per pixel that search the sky in scalar variants, where each takes 10 µs.
_SCALAR_RAYS = 4


class PathIntegrator:
    """Frames by path tracing of any surfaces, in clear air or through haze.

    In haze, scattering by droplets counts as a hit.
    """

    def __init__(self, max_depth: int, air: Air | None = None) -> None:
        self._air = air
        self._is_scalar = is_scalar()
        self._trace: Any
        if air or self._is_scalar:
            # Mitsuba's integrators trace what is not covered here: haze, and one sample at a time.
            kind, depth = ("volpath", max_depth + SCATTERINGS) if air else ("path", max_depth)
            described = {"type": kind, "max_depth": depth, "rr_depth": ROULETTE_DEPTH}
            self._trace = mi.load_dict(described)
        else:
            self._trace = LightPaths(max_depth)

    def move_to(self, time_s: float) -> None:
        """Expect that objects are elsewhere from here on."""
        if isinstance(self._trace, LightPaths):
            self._trace.move_to(time_s)

    def render(self, scene: Any, sensor: Any, seed: int, spp: int) -> NDArray[np.float32]:
        """Radiance (H, W, B) at a sensor, W·m⁻²·sr⁻¹·nm⁻¹.

        In haze, the scene is the one with the medium.
        """
        if self._air:
            scene = self._air.scene
        if not self._is_scalar:
            return developed(sensor, seed, spp, partial(self._radiance, scene))
        if self._air and sensor.get_medium() is None:  # it accepts one only once
            sensor.set_medium(self._air.medium)
        return np.array(self._trace.render(scene, sensor, seed=seed, spp=spp), np.float32)

    def along(
        self, scene: Any, origins: Floats, directions: Floats, wavelengths: Floats, seed: int
    ) -> Floats:
        """Radiance (4, N) along rays at four wavelengths each (4, N), W·m⁻²·sr⁻¹·nm⁻¹.

        Rays start at origins (3, N), m, in unit directions (3, N).
        """
        sampler = mi.load_dict({"type": "independent"})
        sampler.seed(seed, 1 if self._is_scalar else origins.shape[1])
        if self._air:
            scene = self._air.scene

        def light(origin: Any, direction: Any, wavelength: Any) -> Floats:
            start, toward = mi.Point3f(origin), mi.Vector3f(direction)
            rays: Any = mi.RayDifferential3f(start, toward)
            rays.wavelengths = mi.Spectrum(wavelength)
            return np.array(self._radiance(scene, sampler, rays)[0], np.float64)

        if self._is_scalar:
            columns = (values.T.tolist() for values in (origins, directions, wavelengths))
            return np.stack([light(*ray) for ray in zip(*columns, strict=True)], axis=-1)
        return light(*(values.astype(np.float32) for values in (origins, directions, wavelengths)))

    def _radiance(self, scene: Any, sampler: Any, rays: Any) -> tuple[Any, Any]:
        if not self._air and not self._is_scalar:
            traced: tuple[Any, Any] = self._trace.radiance(scene, sampler, rays)
            return traced
        medium = self._air.medium if self._air else None
        light, valid, _ = self._trace.sample(scene, sampler, rays, medium)
        return light, valid

    def measured(self, scene: Any, sensor: Any, seed: int, spp: int) -> NDArray[np.float32]:
        """Radiance and the share of the sky (H, W, B + 1)."""
        radiance = self.render(scene, sensor, seed, spp)
        if self._is_scalar:
            sky = _scalar_sky(scene, sensor, seed)
        else:

            def look(ray: Any, *_: Any) -> list[Any]:
                return [dr.select(scene.ray_test(ray), 0.0, 1.0)]

            sky = pixel_means(sensor, sensor.sampler(), seed, look)
        return np.concatenate([radiance, sky], axis=-1)


def _scalar_sky(scene: Any, sensor: Any, seed: int) -> NDArray[np.float32]:
    width, height = (int(size) for size in sensor.film().crop_size())
    numbers = 3 if lens_of(sensor) is None else 5
    jitter = np.random.default_rng(seed).random((height, width, _SCALAR_RAYS, numbers))

    def free(row: int, column: int) -> Iterator[bool]:
        for x, y, time, *lens in jitter[row, column].tolist():
            place = mi.Point2f((column + x) / width, (row + y) / height)
            ray, _ = sensor.sample_ray(time, 0.5, place, mi.Point2f(lens or 0.5))
            yield not scene.ray_test(ray)

    shares = [[sum(free(row, column)) for column in range(width)] for row in range(height)]
    return np.array(shares, np.float32)[..., None] / np.float32(_SCALAR_RAYS)
