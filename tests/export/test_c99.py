"""The exported C does what the reference in Python does, to the last digits, whatever goes wrong."""

from __future__ import annotations

import ctypes
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, Phase, given, reject, settings
from hypothesis import strategies as st

from observer.errors import ConfigError
from observer.export.data import observer_form
from observer.export.form import Form
from tests.export.made import apart, built, by_c, by_python, compiler, faulty, nut_machine
from tests.logs.machines import machine, table


@pytest.fixture(scope="module")
def form() -> Form:
    return observer_form(nut_machine())


@pytest.fixture(scope="module")
def inputs(form: Form) -> Any:
    """A recording with every fault."""
    return faulty(form, 3000)


@pytest.fixture(scope="module")
def reference(form: Form, inputs: Any) -> Any:
    """What the reference in Python makes of it."""
    return by_python(form, inputs)


def test_the_recording_holds_every_fault(form: Form, reference: Any) -> None:
    """Or else equality would mean little."""
    found = reference
    assert set(found["quality"]) == {1, 2, 3, 4, 0}
    assert set(found["sensor_quality"].ravel()) == {0, 1, 2, 3}
    assert set(found["armed"]) == {0, 1}
    assert np.abs(found["compensation_um"]).max() > 1.0
    assert np.all(found["compensation_um"][-1] == 0.0), "stale inputs take the compensation to zero"
    steps_um = np.abs(np.diff(found["compensation_um"], axis=0))
    assert steps_um.max() <= 0.3 * form.period_s * (1 + 1e-9), "no faster than the rate limit"


@pytest.mark.parametrize("name", ["gcc", "clang"])
def test_c_is_equal_to_python(form: Form, inputs: Any, reference: Any, tmp_path: Path, name: str) -> None:
    program = built(form, tmp_path, name, "-O2")
    assert not apart(reference, by_c(form, program, inputs))


def test_the_exported_c_has_no_undefined_behaviour(
    form: Form, inputs: Any, reference: Any, tmp_path: Path
) -> None:
    program = built(
        form, tmp_path, "gcc", "-O1", "-g", "-fsanitize=address,undefined", "-fno-sanitize-recover=all"
    )
    assert not apart(reference, by_c(form, program, inputs))


def test_single_precision_is_as_near_as_said(form: Form, inputs: Any, tmp_path: Path) -> None:
    """Docs say 0.01 K, 0.1 W and 0.01 µm; a float has seven digits, and heats are differences of readings
    over their gains: 24 °C · 6e-8 · some hundred W/K, again at each step.
    """
    inputs = inputs[:850]  # before the faults, of which the gate may judge one the other way
    program = built(form, tmp_path, "gcc", "-O2", "-DOBSERVER_SINGLE")
    one, other = by_python(form, inputs), by_c(form, program, inputs, ctypes.c_float)
    for name, most in (("field_degC", 0.01), ("heat_W", 0.1), ("error_um", 0.01)):
        assert np.abs(one[name] - other[name]).max() <= most


def test_cppcheck_finds_nothing(form: Form, tmp_path: Path) -> None:
    built(form, tmp_path, "gcc", "-O0")
    found = subprocess.run(
        [compiler("cppcheck"), "--std=c99", "--enable=all", "--suppress=missingIncludeSystem",
         "--suppress=unusedFunction", "--error-exitcode=1", "-q", str(tmp_path / "observer.c")],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert found.returncode == 0, found.stderr


def test_the_code_has_no_state_of_its_own(form: Form, tmp_path: Path) -> None:
    """No data but constants in the object, and no symbol from outside."""
    built(form, tmp_path, "gcc", "-O2")
    made = tmp_path / "observer.o"
    subprocess.run(
        [compiler("gcc"), "-std=c99", "-O2", "-c", str(tmp_path / "observer.c"), "-o", str(made)], check=True
    )
    symbols = subprocess.run(["nm", str(made)], capture_output=True, text=True, check=True).stdout.split("\n")
    kinds = {line.split()[-2]: line.split()[-1] for line in symbols if line}
    assert not kinds.keys() & set("DdBbC"), "data that changes"
    # compilers turn loops into these, which every C environment has
    outside = {line.split()[-1] for line in symbols if " U " in line}
    assert outside <= {"memcpy", "memset", "memmove"}


@settings(
    max_examples=6,
    deadline=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.filter_too_much],
    derandomize=True,
    phases=[Phase.explicit, Phase.generate],
)
@given(
    st.integers(1, 4), st.floats(0.2, 3.0), st.booleans(), st.sampled_from(["kalman", "luenberger"]),
    st.integers(0, 2**16), st.sampled_from([0.1, 0.5, 1.0]),
)  # fmt: skip
def test_c_is_equal_for_any_machine(
    tmp_path: Path, sensors: int, length_m: float, nut: bool, kind: str, seed: int, period_s: float
) -> None:
    places = (np.arange(sensors) + 0.5) / sensors * length_m
    given = table()
    changes = {
        "screw": given["screw"] | {"length_m": length_m},
        "sensor": [
            {"name": f"s{i}", "channel": f"s{i}_degC", "position_m": float(x)} for i, x in enumerate(places)
        ],
        "source": [{"name": "bearing", "shape": "point", "position_m": length_m, "speed_channel": "n_rpm",
                    "heat_W_rpm": 0.005, "time_constant_s": 600.0}],
        "estimator": {"kind": kind, "period_s": period_s},
    }  # fmt: skip
    if nut:
        changes["source"][0] |= {
            "shape": "nut", "length_m": 0.2 * length_m, "stroke_m": [0.2 * length_m, 0.8 * length_m],
            "position_channel": "nut_m",
        }  # fmt: skip
        del changes["source"][0]["position_m"]
    try:
        made = observer_form(machine(**changes))
    except ConfigError:
        reject()  # no gain to be trusted, which is tested elsewhere
    inputs = faulty(made, 60, seed)
    assert not apart(by_python(made, inputs), by_c(made, built(made, tmp_path, "gcc"), inputs))
