"""A cluster as the how-to secures it: certificates, and nothing beyond loopback."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from ..process_group import in_a_group, listening, members, wait_for

TLS = "DASK_DISTRIBUTED__COMM__TLS"
OURS = ["--no-dashboard", "--dashboard-address", "127.0.0.1:0", "--host", "127.0.0.1"]
RUN = """
import sys
from megalopta.generation.jobs import run_jobs
from megalopta.core.errors import UserError

try:
    print([each.problem for each in run_jobs("Jobs", abs, range(2), scheduler=sys.argv[1])])
except UserError as refusal:
    print(refusal)
"""


@pytest.fixture
def certificates(tmp_path):
    """Makes a certificate for everybody, and returns where it and its key are."""
    if not (openssl := shutil.which("openssl")):
        pytest.skip("no openssl")

    def make(name):
        certificate, key = tmp_path / f"{name}.pem", tmp_path / f"{name}-key.pem"
        words = "req -x509 -newkey rsa:2048 -nodes -days 30 -subj /CN=megalopta".split()
        out = ["-keyout", key, "-out", certificate]
        subprocess.run([openssl, *words, *out], check=True, capture_output=True)
        return certificate, key

    return make


def asked(address, ca=None, certificate=None, key=None):
    """What a program with these certificates is told by a cluster."""
    names = {f"{TLS}__CA_FILE": ca, f"{TLS}__CLIENT__CERT": certificate, f"{TLS}__CLIENT__KEY": key}
    given = {name: str(path) for name, path in names.items() if path}
    command = [sys.executable, "-P", "-c", RUN, address]
    return subprocess.run(
        command, env={**os.environ, **given}, capture_output=True, text=True
    ).stdout


@pytest.mark.slow
def test_a_cluster_with_certificates_serves_who_has_them_and_listens_on_loopback(
    certificates, tmp_path
):
    certificate, key = certificates("ours")
    tls = ["--tls-ca-file", certificate, "--tls-cert", certificate, "--tls-key", key]
    dask = Path(sys.executable).parent / "dask"
    file = tmp_path / "scheduler.json"
    begin = [dask, "scheduler", *tls, *OURS, "--protocol", "tls", "--scheduler-file", file]
    follow = [dask, "worker", *tls, *OURS, "--no-nanny", "--nthreads", "1"]
    quiet = {"stderr": subprocess.DEVNULL, "cwd": tmp_path}
    with in_a_group([*begin, "--port", "0"], **quiet) as scheduler:
        wait_for(file.exists, 120)
        address = json.loads(file.read_text())["address"]
        with in_a_group([*follow, address], **quiet) as worker:
            assert asked(address, certificate, certificate, key) == "[None, None]\n"
            assert "no Dask scheduler answers there" in asked(
                address, certificate, *certificates("x")
            )
            assert "name the certificates by" in asked(address)
            processes = members(scheduler.pid) + members(worker.pid)
            assert listening(processes) == {"127.0.0.1"}
