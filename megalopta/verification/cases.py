"""Cases of `megalopta check physics` by group, from `cases.yaml`."""

from pathlib import Path
from typing import Any

from megalopta.core import strict_yaml
from megalopta.sensor import IMAGE_SENSORS, CtiaSensor, changed
from megalopta.verification.comparison import Case

_GROUPS = strict_yaml.load(Path(__file__).with_suffix(".yaml").read_text("utf-8"))
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
