"""The kernels that run are made of the files here, and mean the same codes."""

from __future__ import annotations

import ast
import math
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from campaigns.mutants.trial import PATHS, PYTEST, Tree, build_checked
from observer import kernels
from observer.frames import EstimateQuality, Quality
from observer.kernels import codes, libc
from observer.kernels.files import APART
from observer.model.learning import Nuisance

ROOT = Path(__file__).parents[2]


def joined(root: Path, build: Path) -> subprocess.CompletedProcess[str]:
    """What `setup.py` makes of the kernels below `root`, put below `build`."""
    code = (
        "import setuptools, pathlib; setuptools.setup = lambda **_: None\n"
        "import Cython.Build; Cython.Build.cythonize = lambda modules, **_: modules\n"
        f"import setup; print(setup.join(pathlib.Path({str(build)!r})))"
    )
    return subprocess.run(
        [sys.executable, "-c", code], cwd=root, env=os.environ | {"PYTHONPATH": str(root)},
        capture_output=True, text=True, timeout=120,
    )  # fmt: skip


def copied(folder: Path) -> Path:
    """The build's own files, in a folder."""
    for path in [ROOT / "setup.py", ROOT / "build_kernels.py", *(ROOT / "observer/kernels").glob("*.p*")]:
        target = folder / path.relative_to(ROOT)
        target.parent.mkdir(parents=True, exist_ok=True)
        target.write_bytes(path.read_bytes())
    return folder


def test_what_runs_is_made_of_the_files_here(tmp_path: Path) -> None:
    done = joined(copied(tmp_path), tmp_path / "build")
    assert done.returncode == 0, done.stderr
    made = re.search(r'MADE_OF = "(\w+)"', Path(tmp_path, done.stdout.strip()).read_text(encoding="utf-8"))
    assert made is not None
    assert made[1] == sys.modules["observer.kernels.core"].MADE_OF, (
        "kernels have changed: `make env` builds them"
    )


@pytest.mark.parametrize("changed", ["step.py", "records.pxd"])
def test_kernels_of_other_files_are_a_sentence_with_the_remedy(tmp_path: Path, changed: str) -> None:
    package = Path(shutil.copytree(ROOT / "observer", tmp_path / "observer"))
    with (package / "kernels" / changed).open("a") as file:
        file.write("# changed\n")
    done = subprocess.run(
        [sys.executable, "-m", "observer", "check", "--config", str(ROOT / "config/kim-rod.toml")],
        cwd=tmp_path, env=os.environ | {kernels.VARIABLE: ""}, capture_output=True, text=True, timeout=120,
    )  # fmt: skip
    assert done.returncode == 2
    assert done.stderr.startswith("observer: the compiled kernels are of other files")
    assert "make env" in done.stderr
    assert "Traceback" not in done.stderr


def test_two_functions_of_one_name_are_rejected(tmp_path: Path) -> None:
    path = copied(tmp_path) / "observer/kernels/path.py"
    path.write_text(path.read_text(encoding="utf-8") + "\n\ndef gate():\n    pass\n", encoding="utf-8")
    done = joined(tmp_path, tmp_path / "build")
    assert done.returncode != 0
    assert "two functions are called gate" in done.stderr


def imported(build: str) -> subprocess.CompletedProcess[str]:
    """The import of the kernels with `OBSERVER_KERNELS` set, which prints the build that runs."""
    code = "from observer import kernels; print(kernels.WAY, kernels.run_kalman)"
    return subprocess.run(
        [sys.executable, "-c", code], env=os.environ | {kernels.VARIABLE: build}, capture_output=True,
        text=True, timeout=120,
    )  # fmt: skip


def test_the_build_for_any_processor_runs() -> None:
    done = imported("any")
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("any <cyfunction")


@pytest.mark.parametrize("build", ["fast", "interpreted"])
def test_an_unknown_build_is_refused_with_the_ones_that_exist(build: str) -> None:
    done = imported(build)
    assert done.returncode == 1
    assert f"OBSERVER_KERNELS={build}: it is one of any, avx2, or not set" in done.stderr


NUMERIC = (
    "tests/bits", "tests/kernels/test_covariance.py", "tests/kernels/test_motion.py", "tests/history",
    "tests/estimators/test_steps.py", "tests/estimators/test_given_gain.py",
    "tests/estimators/test_selftest.py", "tests/estimators/test_following.py", "tests/align/test_align.py",
    "tests/bus/test_codec.py", "tests/model/test_moving.py", "tests/model/test_path.py",
)  # fmt: skip


@pytest.mark.slow
def test_no_kernel_reads_or_writes_out_of_bounds(tmp_path: Path) -> None:
    """Compiled with checked bounds, in a copy of the tree, the kernels pass the numeric tests."""
    tree = Tree(tmp_path)
    built = build_checked(tree.root)
    assert built.returncode == 0, built.stderr
    assert leaves_bounds(tree.root), "an index out of bounds is noticed"
    done = subprocess.run(
        [sys.executable, "-m", "pytest", *PYTEST, "-m", "not slow and not system", *NUMERIC], cwd=tree.root,
        env=os.environ | PATHS | {"PYTHONPATH": str(tree.root)}, capture_output=True, text=True, timeout=550,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr
    assert "IndexError" not in done.stderr


def leaves_bounds(root: Path) -> bool:
    """Whether the kernels of a tree report an index beyond the end of an array."""
    code = (
        "import numpy as np; from observer.kernels import number_steps\n"
        "number_steps(np.ones(3), 0, np.zeros(1, dtype=np.int64), np.zeros(1))"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=root, env=os.environ | PATHS | {"PYTHONPATH": str(root)},
        capture_output=True, text=True, timeout=120,
    )  # fmt: skip
    return "IndexError: Out of bounds" in done.stderr


def test_codes_are_those_of_the_records() -> None:
    for name in Quality.__members__:
        assert getattr(codes, name) == Quality[name]
    for name in EstimateQuality.__members__:
        assert getattr(codes, f"ESTIMATE_{name}") == EstimateQuality[name]
    for name in ("AMBIENT", "LAW", "OFFSET"):
        assert getattr(codes, name) == Nuisance[name]


def test_functions_answer_as_in_c_where_python_raises() -> None:
    for value in (libc.sqrt(-1.0), libc.log(-1.0), libc.sin(math.inf), libc.cos(math.inf)):
        assert math.isnan(value)
    assert libc.log(0.0) == -math.inf
    assert libc.exp(1e4) == libc.expm1(1e4) == math.inf
    assert libc.exp(-1e4) == 0.0
    assert (libc.lrint(2.0), libc.lrint(16.0)) == (2, 16)


def test_no_name_is_in_two_kernel_files():
    """They are compiled as one, so that the second would change what the first means."""
    seen: dict[str, str] = {}
    for path in sorted((ROOT / "observer/kernels").glob("*.py")):
        if path.name in APART:
            continue
        for node in ast.parse(path.read_text()).body:
            targets = node.targets if isinstance(node, ast.Assign) else []
            names = {n.id for t in targets for n in ast.walk(t) if isinstance(n, ast.Name)}
            if isinstance(node, ast.FunctionDef | ast.ClassDef):
                names.add(node.name)
            for name in names:
                assert seen.setdefault(name, path.name) == path.name, f"{name} in {seen[name]}, {path.name}"


def test_no_entry_has_the_name_of_a_file():
    """Importing the file would put the module in the entry's place."""
    files = {path.stem for path in (ROOT / "observer/kernels").glob("*.py")}
    assert not files & set(kernels._loaded)
