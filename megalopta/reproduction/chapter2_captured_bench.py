"""The plate at one speed, recorded twice: simulated, and through a camera's line."""

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

from numpy.typing import NDArray

from megalopta.camera.motion_bench import FRAMES, pixels_per_frame, pooled
from megalopta.core.arrays import Floats
from megalopta.reproduction.chapter2_estimate import Estimate

SIMULATED, CAPTURED = "Simulated", "Captured"
HEADS = (CAPTURED, "Less simulated")
ERRORS = "Errors are standard errors; in parentheses, how many of them a difference is."


class RecordedBench(NamedTuple):
    """Frames (passages · 2·FRAMES, 16, 16) of one speed, simulated and captured."""

    speed_mm_s: float
    counts: Mapping[str, NDArray[Any]]

    @property
    def moves(self) -> str:
        """How fast."""
        speed = f"{self.speed_mm_s:g} mm/s"
        return f"{speed}, {pixels_per_frame(self.speed_mm_s):.2f} px per frame"

    @property
    def passages(self) -> str:
        """Of how many passages numbers are."""
        simulated, captured = (
            len(self.counts[name]) // (2 * FRAMES) for name in (SIMULATED, CAPTURED)
        )
        return f"over {captured} passages captured and {simulated} simulated"

    def rows(self) -> dict[str, Floats]:
        """Pooled frames (2·FRAMES, 12) of the first row in the first passage."""
        return {name: pooled(counts)[:, 0] for name, counts in self.counts.items()}

    def printed(
        self, what: Mapping[str, Callable[[NDArray[Any]], Floats]], unit: str
    ) -> dict[str, tuple[str, str]]:
        """What is a number of each passage, by name, as a table."""
        table = {}
        for name, of_passages in what.items():
            found = {each: Estimate.of(of_passages(self.counts[each])) for each in self.counts}
            table[name] = compared(found[CAPTURED], found[SIMULATED], unit)
        return table


def compared(captured: Estimate, simulated: Estimate, unit: str) -> tuple[str, str]:
    """A number captured, and by how much it differs."""
    return f"{captured} {unit}", (captured - simulated).as_difference()


def numbered(name: str) -> str:
    """A figure's name as its title begins."""
    return f"Figure {name.removeprefix('fig-')}"
