"""Code is exported of every machine that stays constant, however little it has, and agrees with Python."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import fmpy
import pytest
from click.testing import Result
from typer.testing import CliRunner

from observer.cli import app
from observer.errors import ConfigError
from observer.export.data import observer_form
from observer.export.model import model_form
from observer.export.structured_text import structured_text
from observer.export.write import write_fmus
from observer.installation import load
from tests.export.made import apart, built, by_c, by_python, faulty
from tests.export.test_fmu import by_fmu
from tests.export.test_structured_text import by_text
from tests.logs.machines import machine, table

CONFIGURATIONS = sorted((Path(__file__).parents[2] / "config").glob("*.toml"))
MADE = {"c99": "observer.c", "st": "FB_BallscrewObserver.st", "fmu": "observer.fmu"}
FIRST_SOURCE = {"name": "heater", "shape": "point", "position_m": 0.2}
LEFT_END = {"left": {"kind": "prescribed", "channel": "end_degC"}}
DEGENERATE: dict[str, dict[str, Any]] = {
    "a constant heat": {"source": [FIRST_SOURCE | {"heat_W": 12.0}]},
    "a source without a law": {"source": [FIRST_SOURCE]},
    "a known constant heat": {
        "source": [FIRST_SOURCE, {"name": "motor", "shape": "point", "position_m": 0.4, "heat_W": 3.0,
                                  "estimate": False}]
    },
    "one source and one sensor": {"source": [FIRST_SOURCE], "sensor": table()["sensor"][:1]},
    "a prescribed end": {"source": [FIRST_SOURCE], "boundary": LEFT_END},
    "two channels in one law": {
        "source": [FIRST_SOURCE | {"speed_channel": "n_rpm", "heat_W_rpm": 0.01}], "boundary": LEFT_END,
    },
}  # fmt: skip


@pytest.mark.parametrize("name", DEGENERATE)
def test_code_of_a_machine_with_few_parts_agrees_with_python(name: str, tmp_path: Path) -> None:
    config = machine(**DEGENERATE[name])
    form = observer_form(config)
    inputs = faulty(form, 60)
    expected = by_python(form, inputs)
    assert not apart(expected, by_c(form, built(form, tmp_path, "gcc"), inputs))
    assert not apart(expected, by_text(form, structured_text(form), inputs))
    write_fmus(form, model_form(config), tmp_path)
    assert not apart(expected, by_fmu(form, tmp_path / "observer.fmu", inputs, tmp_path / "unpacked"))
    assert fmpy.validation.validate_fmu(str(tmp_path / "model.fmu")) == []


@pytest.mark.parametrize("kind", ["c99", "st", "fmu"])
@pytest.mark.parametrize("path", CONFIGURATIONS, ids=lambda path: path.stem)
def test_a_shipped_configuration_is_exported_or_refused_in_a_sentence(
    path: Path, kind: str, tmp_path: Path
) -> None:
    done: Result = CliRunner().invoke(
        app, ["export", "--config", str(path), "--format", kind, "--output", str(tmp_path)]
    )
    if done.exit_code:
        assert isinstance(done.exception, ConfigError), done.exception
        assert re.search("constant matrices|follows another heat", str(done.exception))
    else:
        assert (tmp_path / MADE[kind]).exists()


def test_code_of_the_lathes_spindle_agrees_with_python(tmp_path: Path) -> None:
    form = observer_form(load(CONFIGURATIONS[0].with_name("lathe-spindle.toml")))
    inputs = faulty(form, 60)
    assert not apart(by_python(form, inputs), by_c(form, built(form, tmp_path, "gcc"), inputs))
