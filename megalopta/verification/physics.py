"""`megalopta check physics`: every effect of the sensor against theory, as a table.

The rows come from `megalopta.verification`: a plain event-by-event simulation that shares no
code with the sensor, integrals and differential equations left to SciPy. Streams are fixed. A row
fails at |z| >= 5.
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

from megalopta.core.errors import UserError
from megalopta.core.folders import ensure_directory
from megalopta.plotting.style import PALETTE, house_style, new_canvas
from megalopta.sensor import (
    ORDER_OF_EFFECTS,
    Afterpulsing,
    changed,
    expose_rate,
    generator,
    preset,
)
from megalopta.verification.brute_force import brute_force_counts
from megalopta.verification.cases import CHECKS
from megalopta.verification.comparison import (
    LARGEST_Z,
    Row,
    false_alarm,
    run_checks,
)

EXPOSURES_OF_A_PICTURE = 100_000
_TAU_S, _COUNTS = 1e-6, 30
_TRAPS = Afterpulsing(mean_carriers=0.2, delay_s=2e-6)
_DEAD_TIMES = {
    "ideal": "no dead time",
    "nonparalyzable": "non-paralyzable dead time",
    "paralyzable": "paralyzable dead time",
}


def run_check_physics(
    groups: Sequence[str] = (), plots: Path | None = None, console: Console | None = None
) -> bool:
    """Run checks and print their table; return whether all passed.

    `groups` are names of `CHECKS`, all where none is given; `plots` is a folder for pictures of the
    counting laws. Raises UserError for a name that is none, or where the folder is a file; nothing
    is checked then.
    """
    for group in groups:
        if group not in CHECKS:
            raise UserError(f"check physics: no group {group!r}; one of {', '.join(CHECKS)}")
    chosen = [check for group in CHECKS if group in (groups or CHECKS) for check in CHECKS[group]]
    plots = plots and ensure_directory(plots)
    console = console or Console()
    order = " → ".join(ORDER_OF_EFFECTS)
    console.print(f"order of effects: {order}", highlight=False)
    rows = run_checks(tuple(chosen))
    console.print(table_of(rows))
    failed = sum(not row.passed for row in rows)
    comparisons = sum(row.comparisons for row in rows)
    console.print(
        f"{len(rows)} rows, {failed} failed; behind them are {comparisons} comparisons, of which a "
        f"right program fails any with a probability of at most {false_alarm(rows):.0e}",
        highlight=False,
    )
    if plots is not None:
        for path in draw_pictures(plots):
            console.print(f"wrote {path}", highlight=False)
    return failed == 0


def table_of(rows: list[Row]) -> Table:
    """Rows as a table for a terminal."""
    table = Table(caption=f"pass: |z| < {LARGEST_Z:g}")
    for name in ("term", "quantity"):
        table.add_column(name)
    for name in ("expected", "measured", "z", "pass"):
        table.add_column(name, justify="right")
    for row in rows:
        numbers = f"{row.expected:.5g}", f"{row.measured:.5g}", f"{row.z:+.1f}"
        verdict = "[green]yes[/]" if row.passed else "[bold red]NO[/]"
        table.add_row(row.term, row.quantity, *numbers, verdict)
    return table


def draw_pictures(folder: Path) -> list[Path]:
    """Draw the law of the counts for each kind of dead time: brute force and frames."""
    return [_draw_law(folder, kind) for kind in _DEAD_TIMES]


def _samples(kind: str, a: float) -> list[NDArray[np.int64]]:
    """Counts of exposures, by brute force and as frames are drawn, at a rate of `a` per τ."""
    counted = {"ideal": 1.0, "nonparalyzable": 1 / (1 + a), "paralyzable": np.exp(-a)}[kind]
    sensor = changed(
        preset("ideal"),
        exposure_s=_COUNTS * _TAU_S / (a * counted),
        dead_time={"kind": kind, "dead_time_s": _TAU_S * (kind != "ideal")},
        afterpulsing=_TRAPS,
    )
    rate, exposures = a / _TAU_S, EXPOSURES_OF_A_PICTURE
    frames = expose_rate(np.full((1, exposures, 1), rate), sensor, seed=2, sequence="drawn")
    plain = brute_force_counts(generator(1), rate, sensor.exposure_s, sensor, exposures)
    return [plain, frames.counts.ravel().astype(np.int64)]


def _draw_law(folder: Path, kind: str) -> Path:
    traps = (
        f"Each avalanche traps {_TRAPS.mean_carriers:g} carriers, released after "
        f"{1e6 * _TRAPS.delay_s:g} µs on average"
    )
    with house_style():
        canvas = new_canvas(
            f"Counts of an exposure, {_DEAD_TIMES[kind]}",
            f"{traps}; live start; {_COUNTS} counts on average without afterpulses. r is the rate "
            f"of arrivals, τ = 1 µs{' only a unit here' if kind == 'ideal' else ' the dead time'}. "
            "Steps: event by event; points: as frames are drawn, "
            f"{EXPOSURES_OF_A_PICTURE:,} exposures each.",
            3.4,
        )
        axes = canvas.subplots()
        for a, color in zip((0.01, 0.1, 1.0), PALETTE, strict=False):
            samples = _samples(kind, a)
            n = np.arange(max(int(each.max()) for each in samples) + 1)
            law = [np.bincount(each, minlength=n.size) / each.size for each in samples]
            axes.step(n, law[0], where="mid", color=color, lw=1.2, label=f"r·τ = {a:g}")
            axes.plot(n, law[1], "o", color=color, ms=3)
        axes.set_xlabel("Counts per exposure")
        axes.set_ylabel("Probability")
        axes.legend()
        path = folder / f"counts_{kind}.png"
        canvas.savefig(path)
    return path
