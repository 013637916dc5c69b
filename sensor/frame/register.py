"""Electron multiplication: in each of N stages an electron frees another with probability p.

p is G^(1/N) − 1 for a mean gain G. Up to a gain of 200, electrons are followed stage by stage until
there are some tens; what these still free is drawn from a Gamma distribution of the same mean and
variance (Basden, Haniff and Mackay, MNRAS 345, 985, 2003). Above, all is.
"""

import math

from megalopta.core.compiling import compiled
from megalopta.sensor.sampling.streams import mixed, uniform

_HIGH_GAIN, _MANY = 200.0, 64.0


@compiled
def multiply(electrons, normals, words, gain, chance, well_e, out):  # type: ignore[no-untyped-def]
    """Draw the charge (N,) behind the register from electrons, normal numbers and random words."""
    for k in range(electrons.size):
        if electrons[k]:
            charge_e = _multiplied(float(electrons[k]), normals[k], words[k], gain, chance)
            out[k] = min(charge_e, well_e)


@compiled
def _multiplied(electrons, z, word, gain, chance):  # type: ignore[no-untyped-def]
    if gain > _HIGH_GAIN:
        excess = (gain - 1) * (1 - chance) / (gain * (1 + chance))  # `excess_noise` less 1
        return gain * excess * _gamma(electrons / excess, z, word)
    per_log = 1 / math.log1p(-chance)
    failures = math.floor(math.log(uniform(word)) * per_log)
    while min(electrons, electrons * (gain - 1)) < _MANY:
        place, freed = failures, 0.0
        while place < electrons:
            word = mixed(word)
            place += 1 + math.floor(math.log(uniform(word)) * per_log)
            freed += 1
        failures = place - electrons
        electrons += freed
        gain /= 1 + chance
        if gain < 1 + chance / 2:  # past the last stage
            return electrons
    scale = (1 - chance) * gain / (1 + chance)
    return electrons + scale * _gamma(electrons * (gain - 1) / scale, z, mixed(word))


@compiled
def _gamma(shape, z, word):  # type: ignore[no-untyped-def]
    """Gamma number of a shape of at least 1, by Marsaglia and Tsang, ACM TOMS 26, 363 (2000)."""
    d = shape - 1 / 3
    c = 1 / math.sqrt(9 * d)
    while True:
        v = (1 + c * z) ** 3
        u = uniform(word)
        if v > 0 and (
            u < 1 - 0.0331 * z**4 or math.log(u) < 0.5 * z * z + d * (1 - v + math.log(v))
        ):
            return d * v
        word = mixed(word)
        radius = math.sqrt(-2 * math.log(uniform(word)))
        word = mixed(word)
        z = radius * math.cos(2 * math.pi * uniform(word))
        word = mixed(word)
