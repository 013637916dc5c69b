"""Random numbers derived from keys: the same for a key, whatever else is drawn."""

from typing import Any

from megalopta.render import dr, mi
from megalopta.render.mitsuba_loader import PlugIn, registered

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


def _generator(*state: Any) -> Any:
    pcg32: Any = mi.PCG32
    return pcg32(*state)


class _KeyedSampler(PlugIn):
    """Random numbers seeded by a key and a sample's index."""

    base = "Sampler"

    def __init__(self, properties: Any) -> None:
        self.above.__init__(self, properties)
        self.generator = _generator()

    def start(self, key: Any, sample: Any) -> None:
        state, stream = mi.sample_tea_64(key, sample), mi.sample_tea_64(sample, key)
        self.generator = _generator(1, state, stream)

    def schedule_state(self) -> None:
        dr.schedule(self.generator)

    def next_1d(self, active: Any = True) -> Any:
        return self.generator.next_float32()

    def next_2d(self, active: Any = True) -> Any:
        return mi.Point2f(self.next_1d(active), self.next_1d(active))


def keyed_sampler() -> Any:
    """Mitsuba sampler that is seeded by a key and a sample's index."""
    return mi.load_dict({"type": registered(_KeyedSampler)})
