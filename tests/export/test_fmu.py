"""The exported FMUs are valid, and do what the reference and the product's own simulation do."""

from __future__ import annotations

import zipfile
from pathlib import Path
from typing import Any

import fmpy
import numpy as np
import pytest
from fmpy.fmi3 import FMU3Slave
from fmpy.validation import validate_fmu

from observer.export.data import observer_form
from observer.export.fmu import variables
from observer.export.form import Form
from observer.export.model import model_form
from observer.export.write import write_fmus
from observer.model.build import build_plant
from observer.model.simulate import simulate, start
from tests.export.made import apart, by_python, compiler, faulty, nut_machine
from tests.logs.inputs import inputs_of
from tests.logs.machines import machine


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    compiler("gcc")
    folder, config = tmp_path_factory.mktemp("fmu"), nut_machine()
    write_fmus(observer_form(config), model_form(config), folder)
    return folder


def by_fmu(form: Form, path: Path, inputs: list[dict[str, Any]], unzipped: Path) -> dict[str, np.ndarray]:
    """Step an FMU by the functions of the standard, as a simulation tool does."""
    description = fmpy.read_model_description(str(path))
    fmpy.extract(str(path), str(unzipped))
    fmu = FMU3Slave(
        guid=description.guid, unzipDirectory=str(unzipped), instanceName="one",
        modelIdentifier=description.coSimulation.modelIdentifier,
    )  # fmt: skip
    fmu.instantiate()
    fmu.enterInitializationMode(startTime=0.0)
    fmu.exitInitializationMode()
    access = {"real": (fmu.setFloat64, fmu.getFloat64), "int": (fmu.setInt32, fmu.getInt32),
              "bool": (fmu.setBoolean, fmu.getBoolean)}  # fmt: skip
    places, rows = variables(form), []
    outputs = form.of("output")
    for k, row in enumerate(inputs):
        for place in places:
            if place.slot.role == "input":
                value = row[place.slot.name]
                access[place.slot.kind][0](
                    [place.reference], [value[place.at] if place.slot.shape else value]
                )
        fmu.doStep(currentCommunicationPoint=k * form.period_s, communicationStepSize=form.period_s)
        found = {}
        for slot in outputs:
            own = [p.reference for p in places if p.slot.name == slot.name]
            found[slot.name] = np.array(access[slot.kind][1](own), float)
            found[slot.name] = found[slot.name] if slot.shape else found[slot.name][0]
        rows.append(found)
    fmu.terminate()
    fmu.freeInstance()
    return {name: np.array([row[name] for row in rows]) for name in rows[0]}


@pytest.mark.parametrize("name", ["observer", "model"])
def test_an_fmu_is_valid_and_has_source_and_binary(folder: Path, name: str) -> None:
    assert validate_fmu(str(folder / f"{name}.fmu")) == []
    with zipfile.ZipFile(folder / f"{name}.fmu") as archive:
        names = archive.namelist()
    assert {"modelDescription.xml", "sources/buildDescription.xml", "sources/fmi3.c"} < set(names)
    assert any(n.startswith("binaries/") for n in names)


def test_the_observer_fmu_is_equal_to_python(folder: Path, tmp_path: Path) -> None:
    form = observer_form(nut_machine())
    inputs = faulty(form, 800)
    assert not apart(by_python(form, inputs), by_fmu(form, folder / "observer.fmu", inputs, tmp_path))


def test_a_step_of_the_tool_may_hold_several_of_the_fmu(folder: Path) -> None:
    form = observer_form(nut_machine())
    found = fmpy.simulate_fmu(
        str(folder / "observer.fmu"), stop_time=60.0, output_interval=2.0, output=["alive"]
    )
    assert found["alive"].tolist() == [4 * k for k in range(31)]
    assert form.period_s == 0.5


@pytest.mark.parametrize("make", [machine, nut_machine])
def test_the_model_is_the_products_simulation(make: Any, tmp_path: Path) -> None:
    """With inputs held and the nut at a tabulated place, to what rounding makes of some hundred steps."""
    compiler("gcc")
    config, K = make(), 300
    plant, form = build_plant(config), model_form(config)
    write_fmus(observer_form(config), form, tmp_path)
    heat_W, z = np.linspace(5.0, 20.0, len(plant.source_names)), np.full(len(plant.known_names), 20.0)
    nut_m = 0.2 if plant.moving else None
    columns = None if nut_m is None else _columns(plant, form, nut_m, K)
    laws_W, known, read_degC = np.tile(heat_W, (K, 1)), np.tile(z, (K, 1)), np.zeros((K, plant.rows.sensors))
    u = inputs_of(plant, np.full(K, 0.5), read_degC, laws_W, known, columns=columns)
    _, rows = simulate(plant, start(plant, 25.0, heat_W), u)
    given = {
        f"heat_{name.replace('.', '_')}_W": w for name, w in zip(plant.source_names, heat_W, strict=True)
    }
    given |= {f"{name}_degC": 20.0 for name in plant.known_names} | {"start_degC": 25.0}
    given |= {} if nut_m is None else {"nut_m": nut_m}
    found = fmpy.simulate_fmu(
        str(tmp_path / "model.fmu"), stop_time=0.5 * K, output_interval=0.5, start_values=given
    )
    sensors = [found[f"sensor_{name}_degC"][-1] for name in plant.layout.sensors]
    np.testing.assert_allclose(sensors, rows[-1, plant.rows.sensor_slice], atol=1e-9)


def _columns(plant: Any, form: Form, nut_m: float, steps: int) -> Any:
    """The columns of a nut that stands, its lag settling as in the form."""
    c = form.constants
    place = round(nut_m * c["PLACES_1_M"])
    mean, there = c["NUT_C"][0][-1], c["NUT_C"][0][place]
    left = (1.0 - c["SETTLE"][0]) ** np.arange(1, steps + 1)
    C = there + left[:, None] * (mean - there)
    return np.tile(c["NUT_B"][0][place], (steps, 1, 1)), C[:, None]


def test_without_a_compiler_it_has_its_source_and_says_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("observer.export.fmu.shutil.which", lambda _name: None)
    config = machine()
    names, facts = write_fmus(observer_form(config), model_form(config), tmp_path)
    with zipfile.ZipFile(tmp_path / names[0]) as archive:
        assert not any(name.startswith("binaries/") for name in archive.namelist())
        assert "sources/observer.c" in archive.namelist()
    assert "no C compiler was found" in facts[0]
