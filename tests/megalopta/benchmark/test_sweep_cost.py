import pytest

from megalopta.benchmark.sweep import Sweep, announce_sweep
from megalopta.core.errors import UserError


def test_a_sweep_of_months_is_refused_and_one_of_minutes_announced(capsys):
    trial = {"search": {"repeats": 100_000, "phases": 251}}
    with pytest.raises(UserError, match=r"sweep: 4 trials would take about .* days"):
        announce_sweep(Sweep.model_validate({"trial": trial}))
    announce_sweep(Sweep.model_validate({"trial": {"size": 240, "search": {"repeats": 20}}}))
    assert capsys.readouterr().err.startswith("sweep: 4 trials, about ")
