"""`megalopta check physics`: every effect of the sensor against the plainest simulation."""

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor

from rich.console import Console
from rich.table import Table

from megalopta.core.errors import UserError
from megalopta.sensor import ORDER_OF_EFFECTS
from megalopta.verification.cases import CASES
from megalopta.verification.comparison import LARGEST_Z, Row, check_case, false_alarm


def run_check_physics(groups: Sequence[str] = (), console: Console | None = None) -> bool:
    """Compare cases of some groups, or all; print a table, return True if all passed.

    Raises UserError for an unknown name, before any check.
    """
    for group in groups:
        if group not in CASES:
            raise UserError(f"check physics: no group {group!r}; one of {', '.join(CASES)}")
    chosen = [case for group in CASES if group in (groups or CASES) for case in CASES[group]]
    console = console or Console()
    order = " → ".join(ORDER_OF_EFFECTS)
    console.print(f"order of effects: {order}", highlight=False)
    with ThreadPoolExecutor(2) as pool:
        rows = list(pool.map(check_case, chosen))
    console.print(_table(rows))
    failed = sum(not row.passed for row in rows)
    comparisons = sum(row.comparisons for row in rows)
    console.print(
        f"{len(rows)} rows, {failed} failed, of {comparisons} comparisons; a correct program fails "
        f"any with a probability of at most {false_alarm(rows):.0e}",
        highlight=False,
    )
    return failed == 0


def _table(rows: Sequence[Row]) -> Table:
    table = Table("term", "quantity", caption=f"pass: |z| < {LARGEST_Z:g}")
    for name in ("expected", "measured", "z", "pass"):
        table.add_column(name, justify="right")
    for row in rows:
        numbers = f"{row.expected:.5g}", f"{row.measured:.5g}", f"{row.z:+.1f}"
        verdict = "[green]yes[/]" if row.passed else "[bold red]NO[/]"
        table.add_row(row.term, row.quantity, *numbers, verdict)
    return table
