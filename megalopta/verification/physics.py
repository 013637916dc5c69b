"""`megalopta check physics`: every effect of the sensor against theory, as a table.

The rows come from `megalopta.verification`: a plain event-by-event simulation that shares no
code with the sensor, integrals and differential equations left to SciPy. Streams are fixed. A row
fails at |z| >= 5.
"""

from collections.abc import Sequence

from rich.console import Console
from rich.table import Table

from megalopta.core.errors import UserError
from megalopta.sensor import ORDER_OF_EFFECTS
from megalopta.verification.cases import CHECKS
from megalopta.verification.comparison import LARGEST_Z, Row, false_alarm, run_checks


def run_check_physics(groups: Sequence[str] = (), console: Console | None = None) -> bool:
    """Run checks and print their table; return whether all passed.

    `groups` are names of `CHECKS`, all where none is given. Raises UserError for a name that is
    none; nothing is checked then.
    """
    for group in groups:
        if group not in CHECKS:
            raise UserError(f"check physics: no group {group!r}; one of {', '.join(CHECKS)}")
    chosen = [check for group in CHECKS if group in (groups or CHECKS) for check in CHECKS[group]]
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
