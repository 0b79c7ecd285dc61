"""`import observer`: quick, complete, typed and documented; a missing package is one sentence."""

from __future__ import annotations

import ast
import inspect
import subprocess
import sys
import uuid
from importlib.metadata import version
from pathlib import Path

import pytest

import observer

ROOT = Path(__file__).parents[2]
PROMISED = {"load", "read_log", "import_log", "extract_log", "discover", "connect", "__version__"}
METHODS = {
    "replay", "simulate", "calibrate", "discover", "identify", "forecast", "place", "check", "state_space",
    "learned", "export", "check_wires", "settle", "compare",
}  # fmt: skip
SCRIPT = """\
import observer

machine: observer.Machine = observer.load("machine.toml")
estimates: observer.Estimates = machine.replay({"time_s": [0.0, 1.0]})
heats = estimates["heat_nut_W"]
found: observer.DiscoveryResult = observer.discover(machine, ["a.csv", "b.csv"])
better: observer.Machine | None = found.machine
values: dict[str, observer.FoundValue] = machine.calibrate("a.csv").values
version: str = observer.__version__
try:
    observer.read_log("a.csv")
except observer.UserError as error:
    print(error)
"""


def test_all_that_is_promised_is_there():
    assert set(observer.__all__) >= PROMISED
    assert set(dir(observer.Machine)) >= METHODS
    assert observer.__version__ == version("ballscrew-observer")
    assert set(observer.__all__) <= set(dir(observer))


def test_the_types_are_those_of_the_objects():
    """What a type checker sees is what `__getattr__` loads."""
    tree = ast.parse((ROOT / "observer" / "__init__.py").read_text(encoding="utf-8"))
    (block,) = (node for node in tree.body if isinstance(node, ast.If))
    seen = {
        alias.name: node.module
        for node in block.body
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
    }
    assert set(seen) | {"__version__"} == set(observer.__all__)
    assert {f"observer.{module}" for module in observer._MODULES} == set(seen.values())
    for name, module in seen.items():
        assert getattr(observer, name).__module__ == module


@pytest.mark.parametrize("name", sorted(set(observer.__all__) - {"__version__"}))
def test_every_name_is_documented(name):
    thing = getattr(observer, name)
    assert inspect.getdoc(thing), name
    if inspect.isclass(thing):
        own = {key: value for key, value in vars(thing).items() if not key.startswith("_")}
        members = [key for key, value in own.items() if callable(value) or isinstance(value, property)]
        assert all(inspect.getdoc(getattr(thing, key)) for key in members)


def test_a_missing_name_is_an_attribute_error():
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        _ = observer.nothing


def test_a_users_script_passes_the_strict_type_check(tmp_path):
    """By the project's own settings, strict as well: what `make lint` keeps of the modules serves here."""
    name = f"study_{uuid.uuid4().hex}"  # mypy keeps errors by the name of a module, with the path of then
    study, wrong = tmp_path / f"{name}.py", tmp_path / f"wrong_{name}.py"
    study.write_text(SCRIPT)
    wrong.write_text(SCRIPT.replace("version: str", "version: int"))
    command = [sys.executable, "-m", "mypy", str(study), str(wrong)]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    (problem, _) = done.stdout.splitlines()
    assert problem.startswith(f"{wrong}:"), done.stdout + done.stderr
    assert '"str", variable has type "int"' in problem


def _python(code: str, folder: Path = ROOT) -> subprocess.CompletedProcess[str]:
    return subprocess.run([sys.executable, "-c", code], cwd=folder, capture_output=True, text=True)


def test_the_import_alone_loads_nothing():
    done = _python(
        "import sys, observer; print(*(m for m in sys.modules if m.startswith(('observer', 'numpy'))))"
    )
    assert done.stdout.split() == ["observer"], done.stderr


ANALYSIS = 'install the wheel again as "<wheel>[analysis]"'
MISSING = [
    (
        "pyarrow",
        "observer.read_log('log.csv')",
        f"needs the packages of analysis (pyarrow is missing): {ANALYSIS}",
    ),
    ("pandas", "estimates().to_pandas()", "to_pandas needs pandas: pip install pandas"),
    ("xarray", "estimates().to_xarray()", "to_xarray needs xarray: pip install xarray"),
    (
        "matplotlib",
        "estimates().plot()",
        f"plot needs the packages of analysis (matplotlib is missing): {ANALYSIS}",
    ),
    ("control", "machine.state_space()", f"needs the packages of analysis (control is missing): {ANALYSIS}"),
]
WITHOUT = """
import sys
hidden = set()
class Hidden:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in hidden:
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)
sys.meta_path.insert(0, Hidden())
import observer
machine = observer.load("machine.toml")
def estimates():
    import pyarrow
    table = pyarrow.table({"time_s": [0.0, 1.0], "heat_nut_W": [1.0, 2.0]})
    return observer.Estimates(table, "a", {}, None, None, None)
for package, call in CALLS:
    hidden.clear()
    hidden.add(package)
    try:
        eval(call)
    except observer.UserError as error:
        print(error)
"""


def test_a_missing_package_is_one_sentence(tmp_path):
    (tmp_path / "log.csv").write_text("time_s,a\n0,1\n1,2\n")
    (tmp_path / "machine.toml").write_bytes((ROOT / "config" / "demo.toml").read_bytes())
    calls = [(package, call) for package, call, _ in MISSING]
    done = _python(WITHOUT.replace("CALLS", repr(calls)), tmp_path)
    said = done.stdout.splitlines()
    assert len(said) == len(MISSING), done.stderr
    for line, (_, _, sentence) in zip(said, MISSING, strict=True):
        assert line.endswith(sentence)


SHORT = {
    "time_s": [0.0, 1.0, 2.0],
    **{f"t{i}_degC": [20.0] * 3 for i in range(1, 6)},
    "nut_position_m": [0.3] * 3,
    "screw_speed_rpm": [0.0] * 3,
}


@pytest.mark.parametrize(
    ("ask", "sentence"),
    [
        (lambda m: m.place(1, by="feild"), "by = 'feild' is not known (did you mean field?)"),
        (lambda m: m.identify("no.csv", method="tikonov"), "method = 'tikonov' is not known (did you mean"),
        (lambda m: m.identify("no.csv", "tikhonov", parameter_choice="x"), "parameter_choice = 'x' is not"),
        (lambda m: m.identify("no.csv", "tikhonov", order=2), "order = 2: give 0 or 1"),
        (lambda m: m.compare({"variant": {"a": {}}}, minimise="force"), "minimise = 'force' is not known"),
        (lambda m: m.forecast(SHORT, hours=0), "forecast: hours = 0: give 0.05 to 24 hours ahead"),
    ],
)
def test_what_is_none_of_the_choices_is_one_sentence(ask, sentence):
    with pytest.raises(observer.UserError) as caught:
        ask(observer.load(ROOT / "config" / "demo.toml"))
    assert str(caught.value).startswith(sentence)
