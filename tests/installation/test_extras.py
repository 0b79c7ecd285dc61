"""Without an extra, what needs it says so in one sentence, and the daemon needs none."""

from __future__ import annotations

import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from observer.errors import EXTRAS, install_remedy
from tests.bus.router import free_port
from tests.system.plant import Daemon, Subscriber, machine, table_for, write

ROOT = Path(__file__).parents[2]
NAMES = {
    "prometheus-client": "prometheus_client", "paho-mqtt": "paho", "charset-normalizer": "charset_normalizer",
    "python-calamine": "python_calamine", "python-dateutil": "dateutil",
}  # fmt: skip
HIDING = f"""
import sys
class Hidden:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in {sorted(m for of in EXTRAS.values() for m in of)!r}:
            raise ModuleNotFoundError(f"No module named {{name!r}}", name=name)
sys.meta_path.insert(0, Hidden())
from observer.cli import main
main()
"""


def without_extras(*arguments: str) -> subprocess.CompletedProcess[str]:
    """The command in a process that finds no package of an extra."""
    return subprocess.run(
        [sys.executable, "-c", HIDING, *arguments], cwd=ROOT, capture_output=True, text=True, timeout=120
    )


def test_the_extras_are_those_of_the_project():
    table = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"]
    declared = {
        extra: {NAMES.get(name, name) for name in (re.split(r"[<>=]", line)[0] for line in lines)}
        for extra, lines in table.items()
        if extra != "all"
    }
    for extra in ("page", "fleet", "logs"):
        declared[extra] -= declared["analysis"]
    assert declared == {extra: set(modules) for extra, modules in EXTRAS.items()}


def test_another_missing_module_is_a_defect():
    assert install_remedy("observer run", ModuleNotFoundError(name="numpy")) is None


@pytest.mark.system
@pytest.mark.parametrize(
    "arguments",
    [
        ("replay", "tests/data/rig/end_conduction-0.1/run_a.csv.gz"),
        ("calibrate", "tests/data/rig/end_conduction-0.1/run_a.csv.gz"),
    ],
)
def test_what_needs_an_extra_says_so(arguments, tmp_path):
    config = "tests/data/rig/config.toml"
    done = without_extras(*arguments, "--config", config, "--output", str(tmp_path / "out"))
    assert done.returncode == 2, done.stderr
    said = done.stderr.strip().splitlines()
    assert said[-1] == (
        f"observer: {arguments[0]} needs the packages of analysis (pyarrow is missing): "
        'install the wheel again as "<wheel>[analysis]"'
    )
    assert "Traceback" not in done.stderr
    assert not (tmp_path / "out").exists()


@pytest.mark.system
@pytest.mark.parametrize(
    "arguments",
    [
        ("check", "--config", "config/kim-screw.toml"),
        ("place", "--config", "config/kim-screw.toml", "--sensors", "1"),
        ("adopt", "--status", "--config", "config/demo.toml"),
    ],
)
def test_what_needs_none_works(arguments):
    done = without_extras(*arguments)
    assert done.returncode == 0, done.stderr


@pytest.mark.system
def test_the_daemon_and_its_wires_need_none(tmp_path):
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    with machine() as plant:
        table = table_for(plant.wires, mode="router", listen=[endpoint])
        looked = without_extras("check", "--wires", "--config", str(write(tmp_path, table)))
        assert looked.returncode == 0, looked.stdout
        with Daemon(tmp_path, table, ("-c", HIDING)) as daemon, Subscriber(endpoint) as seen:
            seen.wait_until_good()
            asked = without_extras("health", "--connect", endpoint)
            assert asked.returncode == 0, asked.stderr
            assert daemon.stop() < 2.0
