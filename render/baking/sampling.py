"""Random numbers that follow from a cluster and a sample alone, not from where they are drawn."""

from typing import Any

from megalopta.render import dr, mi

# Fractional parts of irrational numbers that are independent over the rationals, times 2³²:
# 1/p and 1/p² of the plastic number p (Roberts' R₂ sequence), √2, √3 and √5.
_STEPS = tuple(
    round(2**32 * x)
    for x in (0.7548776662466927, 0.5698402909980532, 2**0.5 - 1, 3**0.5 - 1, 5**0.5 - 2)
)


def hashed(first: Any, second: Any) -> tuple[Any, Any]:
    """Two random 32-bit numbers from two."""
    values: Any = mi.sample_tea_32(first, second)
    return values[0], values[1]


def recurrence(index: Any, key: Any) -> list[Any]:
    """Points `index` of five additive recurrences modulo 1, shifted by a key.

    They fill the unit hypercube evenly; whole numbers keep them exact.
    """
    shifts = [shift for salt in (1, 2, 3) for shift in hashed(key, mi.UInt(salt))]
    return [
        mi.Float((index * mi.UInt(step) + shift) >> 8) * 2.0**-24
        for step, shift in zip(_STEPS, shifts, strict=False)
    ]


def cell_sampler() -> Any:
    """Mitsuba sampler to be started from a cluster's key and the index of a sample."""
    pcg32: Any = mi.PCG32

    class CellSampler(mi.Sampler):
        def __init__(self, properties: Any) -> None:
            super().__init__(properties)
            self.generator = pcg32()

        def start(self, key: Any, sample: Any) -> None:
            state, stream = mi.sample_tea_64(key, sample), mi.sample_tea_64(sample, key)
            self.generator = pcg32(1, state, stream)

        def schedule_state(self) -> None:
            dr.schedule(self.generator)

        def next_1d(self, active: Any = True) -> Any:
            return self.generator.next_float32()

        def next_2d(self, active: Any = True) -> Any:
            return mi.Point2f(self.next_1d(active), self.next_1d(active))

    mi.register_sampler("megalopta_cell", CellSampler)
    return mi.load_dict({"type": "megalopta_cell"})
