"""A surface that scatters light evenly to both of its sides, inside Mitsuba.

The bidirectional scattering function of a leaf in nearly all radiative transfer models of canopies:
ρ/π toward the side that the light comes from and τ/π toward the other, at any angles. A path goes
on to either side with a chance in proportion to ρ and τ, their means over its wavelengths.

Mitsuba has none. What it has can be blended to the same (`materials`), at two thirds of the
speed in vectorized variants.
"""

from functools import cache
from typing import Any

from megalopta.render import dr, mi


def blade() -> str:
    """Mitsuba's name of the surface, in the active variant, a vectorized one.

    Parameters of the plugin: `reflectance_0` and `transmittance_0` where the texture `weight` is 0,
    `reflectance_1` and `transmittance_1` where it is 1.
    """
    return _registered(str(mi.variant()))


@cache
def _registered(variant: str) -> str:
    flags = mi.BSDFFlags
    both_sides = flags.FrontSide | flags.BackSide

    class Blade(mi.BSDF):
        def __init__(self, properties: Any) -> None:
            super().__init__(properties)
            self.weight = properties.get_texture("weight")
            self.spectra = [
                [properties.get_texture(f"{name}_{end}") for end in (0, 1)]
                for name in ("reflectance", "transmittance")
            ]
            self.m_components = [
                flags.DiffuseReflection | both_sides,
                flags.DiffuseTransmission | both_sides,
            ]
            self.m_flags = self.m_components[0] | self.m_components[1]

        def shares(self, point: Any, active: Any) -> tuple[Any, Any, Any]:
            """Reflectance, transmittance, and the chance that a path is reflected."""
            weight = self.weight.eval_1(point, active)
            back, through = (
                dr.lerp(first.eval(point, active), second.eval(point, active), weight)
                for first, second in self.spectra
            )
            total = dr.mean(back) + dr.mean(through)
            return back, through, dr.select(total > 0, dr.mean(back) / total, 0.5)

        def lobes(self, point: Any, to: Any, shares: Any, active: Any) -> tuple[Any, Any]:
            back, through, chance = shares
            same = point.wi.z * to.z > 0
            cosine = dr.select(active, dr.abs(to.z) / dr.pi, 0.0)
            value = dr.select(same, back, through) * cosine
            return value, dr.select(same, chance, 1 - chance) * cosine

        def drawn(self, point: Any, first: Any, second: Any, shares: Any, active: Any) -> Any:
            back, through, chance = shares
            same = first < chance
            to = mi.warp.square_to_cosine_hemisphere(second)
            to.z = dr.select(same == (point.wi.z > 0), to.z, -to.z)
            sample: Any = dr.zeros(mi.BSDFSample3f)
            sample.wo, sample.eta = to, 1.0
            sample.pdf = dr.abs(to.z) / dr.pi * dr.select(same, chance, 1 - chance)
            kinds = +flags.DiffuseReflection, +flags.DiffuseTransmission
            sample.sampled_type = dr.select(same, *map(mi.UInt32, kinds))
            sample.sampled_component = dr.select(same, mi.UInt32(0), mi.UInt32(1))
            weight = dr.select(same, back / chance, through / (1 - chance))
            return sample, dr.select(active, weight, 0.0)

        def eval(self, context: Any, si: Any, wo: Any, active: Any = True) -> Any:
            return self.eval_pdf(context, si, wo, active)[0]

        def pdf(self, context: Any, si: Any, wo: Any, active: Any = True) -> Any:
            return self.eval_pdf(context, si, wo, active)[1]

        def eval_pdf(self, context: Any, si: Any, wo: Any, active: Any = True) -> Any:
            return self.lobes(si, wo, self.shares(si, active), active)

        def sample(
            self, context: Any, si: Any, sample1: Any, sample2: Any, active: Any = True
        ) -> Any:
            return self.drawn(si, sample1, sample2, self.shares(si, active), active)

        def eval_pdf_sample(
            self,
            context: Any,
            si: Any,
            wo: Any,
            sample1: Any,
            sample2: Any,
            active: Any = True,
        ) -> Any:
            shares = self.shares(si, active)
            return (
                *self.lobes(si, wo, shares, active),
                *self.drawn(si, sample1, sample2, shares, active),
            )

        def to_string(self) -> str:
            return "Blade[]"

    mi.register_bsdf("megalopta_blade", Blade)
    return "megalopta_blade"
