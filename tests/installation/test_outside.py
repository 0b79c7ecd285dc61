"""Classes from outside, named by module and class or by an entry point of a distribution."""

from __future__ import annotations

import gzip
import itertools
import os
import subprocess
import sys
from pathlib import Path

import pytest
from pydantic import TypeAdapter

from drivers import DriverSettings
from drivers.modbus import ModbusTcpSettings
from observer.config.estimator import EstimatorSettings
from observer.config.outside import entry_names, is_outside, outside

GROUPS = ("drivers", "estimators", "effects")
MODULE = """
from drivers.protocol import DriverTable


class Bus(DriverTable):
    kind: str
    channels: tuple[str, ...]

    def open(self, name):
        raise OSError(f"{name}: there is no such bus")
"""
ENTRIES = "\n".join(f"[ballscrew_observer.{group}]\nmy-{group} = somewhere:Bus\n" for group in GROUPS)
SHADOW = "[ballscrew_observer.drivers]\nmodbus_tcp = somewhere:Bus\nbroken = somewhere:Gone\n"


def _install(folder: Path, name: str, entries: str) -> None:
    (folder / f"{name}.py").write_text(MODULE, encoding="utf-8")
    about = folder / f"{name}-1.0.dist-info"
    about.mkdir()
    (about / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.0\n", encoding="utf-8")
    (about / "entry_points.txt").write_text(entries, encoding="utf-8")


@pytest.fixture
def installed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder on the path with a distribution that has an entry point in each group."""
    _install(tmp_path, "somewhere", ENTRIES)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "somewhere", raising=False)
    return tmp_path


@pytest.mark.parametrize("group", GROUPS)
def test_an_entry_point_s_name_is_its_class(installed: Path, group: str) -> None:
    assert f"my-{group}" in entry_names(group)
    assert is_outside(f"my-{group}", group)
    assert outside(f"my-{group}", group) is outside("somewhere:Bus", group)


def test_names_belong_to_their_group_only(installed: Path) -> None:
    assert not is_outside("my-drivers", "effects")
    assert not is_outside("my-somewhat", "drivers")
    assert not is_outside(7, "drivers")


def test_a_driver_s_table_is_found_by_its_entry_point(installed: Path) -> None:
    adapter: TypeAdapter[DriverSettings] = TypeAdapter(DriverSettings)
    table = adapter.validate_python({"kind": "my-drivers", "channels": ["t1_degC"]})
    assert type(table).__module__ == "somewhere"
    assert table.delivered == ("t1_degC",)


def test_an_estimator_is_found_by_its_entry_point(installed: Path) -> None:
    assert EstimatorSettings(kind="my-estimators").kind == "my-estimators"
    with pytest.raises(ValueError, match="give one of kalman, luenberger, my-estimators, or"):
        EstimatorSettings(kind="my-drivers")


def test_a_kind_of_this_package_cannot_be_replaced(installed: Path) -> None:
    _install(installed, "shadow", SHADOW)
    adapter: TypeAdapter[DriverSettings] = TypeAdapter(DriverSettings)
    table = adapter.validate_python({"kind": "modbus_tcp", "host": "h", "channels": {"t": {"register": 0}}})
    assert type(table) is ModbusTcpSettings


def test_a_class_that_is_not_there_is_named(installed: Path) -> None:
    _install(installed, "shadow", SHADOW)
    with pytest.raises(ValueError, match="somewhere has no class Gone"):
        outside("broken", "drivers")


@pytest.mark.system
def test_check_lists_the_names_of_entry_points(installed: Path) -> None:
    config = installed / "machine.toml"
    config.write_text('[drivers.air]\nkind = "mine"\n', encoding="utf-8")
    done = subprocess.run(
        [sys.executable, "-m", "observer", "check", "--config", str(config)],
        env=os.environ | {"PYTHONPATH": f"{installed}{os.pathsep}{Path(__file__).parents[2]}"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 2
    assert "player, my-drivers, module:Class" in done.stderr


BROKEN = """
from drivers.protocol import DriverTable
from observer.config.effects.base import EffectTable
from observer.estimators.kalman import KalmanEstimator


class Design(KalmanEstimator):
    def __init__(self, plant, settings):
        {}["design"]


class Run:
    def __init__(self, plant, settings):
        self.inner = KalmanEstimator(plant, settings)
        self.layout, self.initial = self.inner.layout, self.inner.initial

    def run(self, state, inputs):
        {}["run"]


class NoArguments:
    pass


class NoRun:
    def __init__(self, plant, settings):
        pass


class Bus(DriverTable):
    kind: str

    def model_post_init(self, context):
        {}["bus"]

    def open(self, name):
        raise OSError(name)


class Effect(EffectTable):
    kind: str
"""
BROKEN_TABLES = {
    "Design": ("[estimator]", "line 9 (KeyError: 'design')"),
    "Run": ("[estimator]", "line 18 (KeyError: 'run')"),
    "NoArguments": ("[estimator]", "give it __init__(self, plant, settings)"),
    "NoRun": ("[estimator]", "has no layout and no initial and no run"),
    "Bus": ("[drivers.mine]", "line 34 (KeyError: 'bus')"),
    "Effect": ("[[effect]]", "has no terms"),
}


@pytest.mark.system
@pytest.mark.parametrize("name", BROKEN_TABLES)
def test_an_error_in_a_class_of_the_user_is_a_sentence_with_its_file_and_line(
    name: str, tmp_path: Path
) -> None:
    table, words = BROKEN_TABLES[name]
    (tmp_path / "broken.py").write_text(BROKEN, encoding="utf-8")
    root = Path(__file__).parents[2]
    text = (root / "tests" / "data" / "rig" / "config.toml").read_text("utf-8")
    text += f'\n{table}\nkind = "broken:{name}"\n'
    (tmp_path / "machine.toml").write_text(text, encoding="utf-8")
    with gzip.open(root / "tests" / "data" / "rig" / "run_c.csv.gz", "rt", encoding="utf-8") as log:
        (tmp_path / "log.csv").write_text("".join(itertools.islice(log, 40)), encoding="utf-8")
    files = ["log.csv", "--config", "machine.toml", "--output", "results"]
    done = subprocess.run(
        [sys.executable, "-m", "observer", "replay", *files],
        cwd=tmp_path,
        env=os.environ | {"PYTHONPATH": f"{tmp_path}{os.pathsep}{root}"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 2, done.stderr
    assert "Traceback" not in done.stderr
    assert f"broken:{name}" in done.stderr
    assert words in done.stderr
