from pathlib import Path

import pytest


@pytest.fixture
def jobs(monkeypatch):
    """The module of jobs, which worker processes find, too."""
    folder = str(Path(__file__).parent)
    monkeypatch.setenv("PYTHONPATH", folder)
    monkeypatch.syspath_prepend(folder)
    import jobs_of_tests

    return jobs_of_tests
