"""Light paths along rays, traced by one kernel however many they are and wherever they come from.

It is Mitsuba's own path tracer, step by step and random number by random number: next-event
estimation, multiple importance sampling and roulette from the fifth hit on. Two things differ.
Nothing of an image's size, a camera, or the longest path is a constant of the code that is
compiled, so that this, which takes seconds, happens once for a kind of scene and not for each. And
rays can meet two scenes, of which each sees what is nearer: one at rest and a small one of what
moves, which alone is built anew.
"""

from typing import Any

from megalopta.render.mitsuba_loader import dr, mi

_ROULETTE_DEPTH, _MOST_LIKELY = 5, 0.95


class LightPaths:
    """Paths of at most `max_depth` hits in a vectorized variant.

    They meet the layers, scenes of meshes of which those that move do not glow; without layers,
    the scene that lights them.
    """

    def __init__(self, max_depth: int, *layers: Any) -> None:
        self._max_depth = dr.opaque(mi.UInt32, max_depth)
        self._layers = layers

    def radiance(
        self, scene: Any, sampler: Any, rays: Any, active: Any | None = None
    ) -> tuple[Any, Any]:
        """Radiance along N rays at their wavelengths, and which of them meet something.

        The sampler is one that was seeded for N.
        """
        active = dr.full(mi.Bool, True, dr.width(rays.d)) if active is None else mi.Bool(active)
        origin = dr.zeros(mi.Point3f, dr.width(rays.d)) + rays.o
        dr.make_opaque(origin, rays.d, rays.wavelengths, active)
        sampler.schedule_state()
        dr.eval()
        first: Any = mi.Ray3f(origin, rays.d)
        first.wavelengths = rays.wavelengths
        found = self._traced(scene, sampler, first, active)
        dr.eval(found)
        return found

    @dr.syntax
    def _traced(self, scene: Any, sampler: Any, ray: Any, active: Any) -> tuple[Any, Any]:
        context = mi.BSDFContext()
        light, throughput = mi.Spectrum(0.0), mi.Spectrum(1.0)
        eta, depth, valid = mi.Float(1.0), mi.UInt32(0), mi.Bool(False)
        before, before_pdf = dr.zeros(mi.SurfaceInteraction3f), mi.Float(1.0)
        before_delta = mi.Bool(True)
        while active:
            here = self._meet(scene, ray, active)
            shining = _shining(scene, here, before, before_pdf, before_delta)
            light = dr.fma(throughput, shining, light)
            goes_on = (depth + 1 < self._max_depth) & here.is_valid() & active
            surface = here.bsdf(ray)
            smooth = goes_on & mi.has_flag(surface.flags(), mi.BSDFFlags.Smooth)
            toward, weight = scene.sample_emitter_direction(here, sampler.next_2d(), False, smooth)
            smooth &= toward.pdf != 0
            smooth &= ~self._is_blocked(scene, here.spawn_ray_to(toward.p), smooth)
            value, pdf, drawn, drawn_weight = surface.eval_pdf_sample(
                context, here, here.to_local(toward.d), sampler.next_1d(), sampler.next_2d(),
                goes_on,
            )  # fmt: skip
            share = dr.select(toward.delta, 1.0, _share(toward.pdf, pdf))
            light = dr.select(smooth, dr.fma(throughput, value * weight * share, light), light)
            ray = here.spawn_ray(here.to_world(drawn.wo))
            throughput *= drawn_weight
            eta *= drawn.eta
            valid |= active & here.is_valid()
            before, before_pdf = here, drawn.pdf
            before_delta = mi.has_flag(drawn.sampled_type, mi.BSDFFlags.Delta)
            depth += dr.select(here.is_valid(), mi.UInt32(1), mi.UInt32(0))
            most: Any = dr.max(throughput)
            stays = dr.minimum(most * eta * eta, _MOST_LIKELY)
            roulette = depth >= _ROULETTE_DEPTH
            throughput = dr.select(roulette, throughput * dr.rcp(stays), throughput)
            survives = sampler.next_1d() < stays
            active = goes_on & (~roulette | survives) & (most != 0)
        return light, valid

    def _meet(self, scene: Any, ray: Any, active: Any) -> Any:
        if not self._layers:
            return scene.ray_intersect(ray, mi.RayFlags.All, coherent=False, active=active)
        first, second = (
            layer.ray_intersect_preliminary(ray, coherent=False, active=active)
            for layer in self._layers
        )
        nearest = dr.select(second.t < first.t, second, first)
        return nearest.compute_surface_interaction(ray, mi.RayFlags.All, active)

    def _is_blocked(self, scene: Any, ray: Any, active: Any) -> Any:
        if not self._layers:
            return scene.ray_test(ray, active)
        first, second = (layer.ray_test(ray, active) for layer in self._layers)
        return first | second


def _shining(scene: Any, here: Any, before: Any, pdf: Any, delta: Any) -> Any:
    """What is met shines itself, weighed against having been looked for."""
    source = mi.DirectionSample3f(scene, here, before)
    looked = scene.pdf_emitter_direction(before, source, ~delta)
    light: Any = source.emitter.eval(here, pdf > 0)
    return light * _share(pdf, dr.select(delta, 0.0, looked))


def _share(pdf: Any, other: Any) -> Any:
    """Weight of a sample by the power heuristic (Veach, 1997)."""
    pdf, other = pdf * pdf, other * other
    weight = pdf / (pdf + other)
    return dr.select(dr.isfinite(weight), weight, 0.0)
