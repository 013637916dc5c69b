"""Conversion of materials to Mitsuba's surfaces, emitters, textures and spectra, unchanged."""

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from megalopta.render import dr, mi
from megalopta.render.mitsuba_loader import PlugIn, is_scalar, registered
from megalopta.scenes import material as materials
from megalopta.scenes.material import ColorTexture, Emission, Finish, Material, Part, Rgb, Texture
from megalopta.scenes.spectra.spectrum import Spectrum, flat

_LEAST_SHARE = 0.1

_Surface = Callable[[Spectrum | None], dict[str, Any]]


def bsdf(material: Material) -> dict[str, Any]:
    """Mitsuba surface of a material."""
    if material.finish:
        return _as_it_is(material.finish)
    if material.emission:
        return {"type": "diffuse", "reflectance": {"type": "spectrum", "value": 0.0}}
    if not material.transmits:
        return _reflecting(material, 1.0)
    return _of_parts(material) if is_scalar() else _blade(material)


def _as_it_is(finish: Finish) -> dict[str, Any]:
    """Mitsuba surface, or texture of one, of the same parameters."""
    return {"type": finish.kind, **{name: _part(value) for name, value in finish.parts.items()}}


def _part(of: Part) -> Any:
    match of:
        case Finish():
            return _as_it_is(of)
        case Rgb(values):
            return {"type": "rgb", "value": list(values)}
        case Spectrum():
            return spectrum(of)
        case np.ndarray() if of.ndim > 2:
            return mi.Bitmap(np.array(of, dtype=np.float32, order="C"))
        case np.ndarray():
            return mi.ScalarTransform4f(of.tolist())
    return of


def _blade(material: Material) -> dict[str, Any]:
    body = material.body
    spectra = {
        f"{name}_{end}": spectrum(getattr(part, name, None) or flat(0.0))
        for end, part in enumerate((body, body.texture))
        for name in ("reflectance", "transmittance")
    }
    texture = material.texture
    weight = bitmap(texture.weight) if texture else {"type": "uniform", "value": 0.0}
    slope = {"type": "uniform", "value": material.gloss or 0.0}
    return {"type": registered(_Blade), **spectra, "weight": weight, "slope": slope}


ARCH, VEIN, VEINS = 0.35, 0.15, 7.0
"""Slopes of leaves: at their margins and ends, and beside their veins; number of these."""


def interface(point: Any, to: Any, slope: Any) -> Any:
    """Response (1/sr) of leaves' interface from the local direction `point.wi` to another.

    Facets have a normal distribution of slopes about those of arched leaves with veins, and hide
    each other in V-shaped grooves (Cook and Torrance 1982, ACM TOG 1:7); it is reciprocal. They are
    dull with a slope of 0.
    """
    half = dr.normalize(point.wi + to)
    up, near = dr.maximum(dr.abs(half.z), 0.05), dr.minimum(dr.abs(point.wi.z), dr.abs(to.z))
    far = dr.maximum(dr.abs(point.wi.z), dr.abs(to.z))
    across, along = (x - dr.floor(x) - 0.5 for x in (point.uv * mi.Point2f(*materials.BLADES)))
    vein = VEIN * dr.cos(2 * dr.pi * VEINS * (along - 1.2 * dr.abs(across)))
    half *= dr.select(half.z < 0, -1.0, 1.0) / up
    x, y = half.x - 2 * ARCH * across, half.y - 2 * ARCH * along - vein
    wide = slope * slope
    facets = dr.exp(-(x * x + y * y) / wide) / (dr.pi * wide * up**4)
    seen = dr.minimum(
        dr.rcp(4 * dr.maximum(near, 1e-4) * far),
        up * dr.rcp(2 * far * dr.maximum(dr.abs(dr.dot(point.wi, dr.normalize(half))), 1e-4)),
    )
    same = (point.wi.z * to.z > 0) & (slope > 0)
    return dr.select(same, materials.INTERFACE * facets * seen, 0.0)


def _of_parts(material: Material) -> dict[str, Any]:
    """Blend of Mitsuba's own surfaces, each scaled up by its inverse share, for scalar variants."""
    through = mean(material.transmittance) / (
        mean(material.transmittance) + mean(material.reflectance) or 1.0
    )
    through = min(max(through, _LEAST_SHARE), 1 - _LEAST_SHARE)
    back, beyond = _reflecting(material, 1 / (1 - through)), _transmitting(material, 1 / through)
    return _blend(through, back, beyond)


def _blend(weight: Any, first: dict[str, Any], second: dict[str, Any]) -> dict[str, Any]:
    return {"type": "blendbsdf", "weight": weight, "first": first, "second": second}


def mean(of: Spectrum | None) -> float:
    """Mean from 400 to 1700 nm, for probabilities; 0 without a spectrum."""
    return float(of(np.arange(400, 1700)).mean()) if of else 0.0


def _reflecting(material: Material, factor: float) -> dict[str, Any]:
    def diffuse(of: Spectrum | None) -> dict[str, Any]:
        return {"type": "diffuse", "reflectance": _scaled(of, factor)}

    texture = material.texture
    if isinstance(texture, ColorTexture):
        # The mean of three colors, each three times as bright.
        weights = np.moveaxis(texture.weight, -1, 0)
        red, green, blue = (
            _blend(bitmap(weight), diffuse(flat(0.0)), diffuse(color.scaled(3.0)))
            for weight, color in zip(weights, texture.reflectances, strict=True)
        )
        mean_color = _blend(2 / 3, red, _blend(0.5, green, blue))
        return {"type": "twosided", "surface": mean_color}
    second = texture.spectra[0][0] if texture else None
    return {"type": "twosided", "surface": _mixed(diffuse, texture, material.reflectance, second)}


def _transmitting(material: Material, factor: float) -> dict[str, Any]:
    def thin(of: Spectrum | None) -> dict[str, Any]:
        # With 2, all of the diffuse light is transmitted, uniformly.
        lobes = {"diff_trans": 2.0, "spec_trans": 0.0}
        return {"type": "principledthin", "base_color": _scaled(of, factor), **lobes}

    texture = material.texture
    second = texture.spectra[0][1] if texture else None
    return _mixed(thin, texture, material.transmittance, second)


def _mixed(
    surface: _Surface,
    texture: Texture | ColorTexture | None,
    first: Spectrum | None,
    second: Spectrum | None,
) -> dict[str, Any]:
    """Surfaces of two spectra, or of the first alone without a texture."""
    if texture is None:
        return surface(first)
    return _blend(bitmap(texture.weight), surface(first), surface(second))


def emission(of: Emission) -> dict[str, Any]:
    """Mitsuba texture of the radiance that a surface emits."""
    if isinstance(of.radiance, Spectrum):
        return spectrum(of.radiance)
    if of.pattern is None:
        return {"type": "spectrum", "value": of.radiance}
    return bitmap(of.pattern * np.float32(of.radiance))


def bitmap(values: NDArray[np.float32]) -> dict[str, Any]:
    """Mitsuba texture of values (H, W) or (H, W, 3) that tile the uv square, row 0 at v = 0."""
    # Mitsuba's first row is v = 0, as here; it accepts no read-only array.
    image = np.array(values.reshape(*values.shape[:2], -1), dtype=np.float32, order="C")
    return {"type": "bitmap", "bitmap": mi.Bitmap(image), "raw": True, "wrap_mode": "repeat"}


def _scaled(of: Spectrum | None, factor: float) -> dict[str, Any]:
    return spectrum((of or flat(0.0)).scaled(factor))


def spectrum(of: Spectrum) -> dict[str, Any]:
    """Mitsuba spectrum, with constant values beyond the ends."""
    if not max(of.values):
        return {"type": "spectrum", "value": 0.0}  # a table without any mass is rejected
    table = zip(of.wavelengths_nm, of.values, strict=True)
    ends = (100.0, of.values[0]), (4000.0, of.values[-1])  # else Mitsuba's are zero beyond it
    return {"type": "spectrum", "value": [ends[0], *table, ends[1]]}


class _Blade(PlugIn):
    """Surface that scatters light uniformly to both of its sides.

    In nearly all radiative transfer models of canopies a leaf scatters ρ/π toward the side of the
    light and τ/π toward the other, at any angle. A path continues to either side with a probability
    proportional to the means of ρ and τ over its wavelengths. A blend of Mitsuba's own surfaces has
    two thirds of the speed. `reflectance_0` is where the texture `weight` is 0. Light reflected by
    the interface of glossy leaves is added; a path is as likely to go there as if it were diffuse.
    """

    base = "BSDF"

    def __init__(self, properties: Any) -> None:
        self.above.__init__(self, properties)
        self.weight, self.slope = (properties.get_texture(name) for name in ("weight", "slope"))
        self.spectra = [
            [properties.get_texture(f"{name}_{end}") for end in (0, 1)]
            for name in ("reflectance", "transmittance")
        ]
        flags = mi.BSDFFlags
        both = flags.FrontSide | flags.BackSide
        self.m_components = [flags.DiffuseReflection | both, flags.DiffuseTransmission | both]
        self.m_flags = self.m_components[0] | self.m_components[1]

    def shares(self, point: Any, active: Any) -> tuple[Any, Any, Any, Any]:
        """Reflectance, transmittance, probability that a path is reflected, slope of facets."""
        weight = self.weight.eval_1(point, active)
        back, through = (
            dr.lerp(first.eval(point, active), second.eval(point, active), weight)
            for first, second in self.spectra
        )
        slope = self.slope.eval_1(point, active)
        mean = dr.mean(back) + dr.select(slope > 0, materials.INTERFACE, 0.0)
        total = mean + dr.mean(through)
        return back, through, dr.select(total > 0, mean / total, 0.5), slope

    def lobes(self, point: Any, to: Any, shares: Any, active: Any) -> tuple[Any, Any]:
        back, through, chance, slope = shares
        same = point.wi.z * to.z > 0
        cosine = dr.select(active, dr.abs(to.z) / dr.pi, 0.0)
        shine = dr.pi * interface(point, to, slope)
        value = dr.select(same, back + shine, through) * cosine
        return value, dr.select(same, chance, 1 - chance) * cosine

    def drawn(self, point: Any, first: Any, second: Any, shares: Any, active: Any) -> Any:
        back, through, chance, slope = shares
        same = first < chance
        to = mi.warp.square_to_cosine_hemisphere(second)
        to.z = dr.select(same == (point.wi.z > 0), to.z, -to.z)
        sample: Any = dr.zeros(mi.BSDFSample3f)
        sample.wo, sample.eta = to, 1.0
        sample.pdf = dr.abs(to.z) / dr.pi * dr.select(same, chance, 1 - chance)
        kinds = +mi.BSDFFlags.DiffuseReflection, +mi.BSDFFlags.DiffuseTransmission
        sample.sampled_type = dr.select(same, *map(mi.UInt32, kinds))
        sample.sampled_component = dr.select(same, mi.UInt32(0), mi.UInt32(1))
        shine = dr.pi * interface(point, to, slope)
        weight = dr.select(same, (back + shine) / chance, through / (1 - chance))
        return sample, dr.select(active, weight, 0.0)

    def eval(self, context: Any, si: Any, wo: Any, active: Any = True) -> Any:
        return self.eval_pdf(context, si, wo, active)[0]

    def pdf(self, context: Any, si: Any, wo: Any, active: Any = True) -> Any:
        return self.eval_pdf(context, si, wo, active)[1]

    def eval_pdf(self, context: Any, si: Any, wo: Any, active: Any = True) -> Any:
        return self.lobes(si, wo, self.shares(si, active), active)

    def sample(self, context: Any, si: Any, sample1: Any, sample2: Any, active: Any = True) -> Any:
        return self.drawn(si, sample1, sample2, self.shares(si, active), active)

    def eval_pdf_sample(
        self, context: Any, si: Any, wo: Any, sample1: Any, sample2: Any, active: Any = True
    ) -> Any:
        shares = self.shares(si, active)
        return (
            *self.lobes(si, wo, shares, active),
            *self.drawn(si, sample1, sample2, shares, active),
        )
