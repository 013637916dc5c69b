"""`megalopta check physics`: every effect of the sensor against the plainest simulation."""

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table

from megalopta.core import strict_yaml
from megalopta.core.errors import UserError
from megalopta.sensor import IMAGE_SENSORS, ORDER_OF_EFFECTS, CtiaSensor, changed
from megalopta.verification.comparison import LARGEST_Z, Case, Row, check_case, false_alarm


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


_GROUPS = strict_yaml.load(Path(__file__).with_name("cases.yaml").read_text("utf-8"))
_LIGHT = _GROUPS.pop("_shared")["light"]


def _case(term: str, fields: dict[str, Any]) -> Case:
    own = {name: fields.pop(name) for name in Case.__annotations__ if name in fields}
    if fields.get("kind") == "ctia":
        sensor: Any = CtiaSensor.model_validate(fields)
    else:
        sensor = changed(IMAGE_SENSORS[fields.pop("preset", "ideal")], **fields)
    return Case(term, sensor, **{"light": _LIGHT, **own})


CASES: dict[str, tuple[Case, ...]] = {
    group: tuple(_case(*each) for each in cases.items()) for group, cases in _GROUPS.items()
}
