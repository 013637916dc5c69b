"""Paths through a large scene at rest and a small one of what moves, which alone is built anew.

Mitsuba builds what traces rays through a scene as a whole, however little of it has moved. Here
every ray is traced through two scenes and meets what is nearer. Else it is Mitsuba's own path
tracer, step by step and random number by random number: next-event estimation, multiple importance
sampling and roulette from the fifth hit on.
"""

from functools import cache
from typing import Any

from megalopta.render.mitsuba_loader import dr, mi

_ROULETTE_DEPTH, _MOST_LIKELY = 5, 0.95


def layered_paths(max_depth: int, still: Any, moving: Any) -> Any:
    """Return an integrator of two scenes of meshes, of which those that move do not glow.

    The scene that it is told to render lights both. The active variant must be a vectorized one.
    """
    integrator = mi.load_dict({"type": _registered(str(mi.variant())), "max_depth": max_depth})
    integrator.layers = still, moving
    return integrator


@cache
def _registered(variant: str) -> str:
    class LayeredPaths(mi.SamplingIntegrator):
        def __init__(self, properties: Any) -> None:
            super().__init__(properties)
            self.max_depth = properties["max_depth"]
            self.layers: tuple[Any, Any] = (None, None)

        def meet(self, ray: Any, active: Any) -> Any:
            first, second = (
                layer.ray_intersect_preliminary(ray, coherent=False, active=active)
                for layer in self.layers
            )
            nearest = dr.select(second.t < first.t, second, first)
            return nearest.compute_surface_interaction(ray, mi.RayFlags.All, active)

        def is_blocked(self, ray: Any, active: Any) -> Any:
            first, second = (layer.ray_test(ray, active) for layer in self.layers)
            return first | second

        @dr.syntax
        def sample(
            self, scene: Any, sampler: Any, ray: Any, medium: Any = None, active: Any = True
        ) -> tuple[Any, Any, list[Any]]:
            context = mi.BSDFContext()
            ray, active = mi.Ray3f(ray), mi.Bool(active)
            light, throughput = mi.Spectrum(0.0), mi.Spectrum(1.0)
            eta, depth, valid = mi.Float(1.0), mi.UInt32(0), mi.Bool(False)
            before, before_pdf = dr.zeros(mi.SurfaceInteraction3f), mi.Float(1.0)
            before_delta = mi.Bool(True)
            while active:
                here = self.meet(ray, active)
                light += throughput * self.shining(scene, here, before, before_pdf, before_delta)
                goes_on = (depth + 1 < self.max_depth) & here.is_valid() & active
                surface = here.bsdf(ray)
                smooth = goes_on & mi.has_flag(surface.flags(), mi.BSDFFlags.Smooth)
                toward, weight = scene.sample_emitter_direction(
                    here, sampler.next_2d(), False, smooth
                )
                smooth &= toward.pdf != 0
                smooth &= ~self.is_blocked(here.spawn_ray_to(toward.p), smooth)
                value, pdf, drawn, drawn_weight = surface.eval_pdf_sample(
                    context, here, here.to_local(toward.d), sampler.next_1d(), sampler.next_2d(),
                    goes_on,
                )  # fmt: skip
                share = dr.select(toward.delta, 1.0, _share(toward.pdf, pdf))
                light += dr.select(smooth, throughput * value * weight * share, 0.0)
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
            return light, valid, []

        def shining(self, scene: Any, here: Any, before: Any, pdf: Any, delta: Any) -> Any:
            """What is met shines itself, weighed against having been looked for."""
            source = mi.DirectionSample3f(scene, here, before)
            looked = scene.pdf_emitter_direction(before, source, ~delta)
            light: Any = source.emitter.eval(here, pdf > 0)
            return light * _share(pdf, dr.select(delta, 0.0, looked))

    mi.register_integrator("layered_paths", LayeredPaths)
    return "layered_paths"


def _share(pdf: Any, other: Any) -> Any:
    """Weight of a sample by the power heuristic (Veach, 1997)."""
    pdf, other = pdf * pdf, other * other
    weight = pdf / (pdf + other)
    return dr.select(dr.isfinite(weight), weight, 0.0)
