"""Which C compiler a build takes, and what it asks for where there is none."""

from __future__ import annotations

import shlex
import sys
import sysconfig
from collections.abc import Callable
from pathlib import Path
from types import ModuleType

import pytest

ROOT = Path(__file__).parents[2]


@pytest.fixture
def build(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> ModuleType:
    """The build backend, on a computer with no program at all."""
    monkeypatch.syspath_prepend(str(ROOT))
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.chdir(tmp_path)
    for name in ("CC", "LDSHARED", "KERNELS_TARGET", "_PYTHON_HOST_PLATFORM", "ZIG_GLOBAL_CACHE_DIR"):
        monkeypatch.setenv(name, "")  # so that it is put back
        monkeypatch.delenv(name)
    import build_kernels

    return build_kernels


@pytest.fixture
def install(tmp_path: Path) -> Callable[[str], None]:
    def put(name: str) -> None:
        (tmp_path / name).write_text("#!/bin/sh\n")
        (tmp_path / name).chmod(0o755)

    return put


def test_without_a_compiler_a_build_fetches_one(
    build: ModuleType, install: Callable[[str], None], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(build, "build_meta", _Setuptools)
    assert build.get_requires_for_build_wheel() == ["asked by setup.py", "ziglang>=0.17"]
    assert build.get_requires_for_build_editable() == ["asked by setup.py", "ziglang>=0.17"]
    install("clang")
    assert build.get_requires_for_build_wheel() == ["asked by setup.py"]


class _Setuptools:
    """What setuptools would ask for."""

    @staticmethod
    def get_requires_for_build_wheel(settings: object) -> list[str]:
        return ["asked by setup.py"]

    get_requires_for_build_editable = get_requires_for_build_wheel


@pytest.mark.parametrize("name", ["cc", "gcc", "clang"])
def test_any_compiler_on_the_path_serves(
    name: str, build: ModuleType, install: Callable[[str], None], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sysconfig.get_config_vars(), "CC", "another-cc -pthread")
    install(name)
    assert build._compiler() == name
    install("another-cc")
    assert build._compiler() is None, "the one that Python was built with is setuptools' own choice"
    monkeypatch.setenv("CC", "mine -m32")
    assert build._compiler() == "mine -m32"


def test_zig_builds_for_every_processor_of_the_kind_not_for_the_one_it_runs_on(build: ModuleType) -> None:
    words = shlex.split(build._compiler())
    assert words == [sys.executable, "-m", "ziglang", "cc", "-mcpu=baseline"]


def test_a_target_is_built_for_by_zig_also_beside_a_compiler(
    build: ModuleType, install: Callable[[str], None], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    install("gcc")
    (tmp_path / "Python.h").touch()
    monkeypatch.setattr(sysconfig, "get_path", lambda name: str(tmp_path))
    monkeypatch.setenv("KERNELS_TARGET", "aarch64-linux-gnu.2.28")
    assert build.prepare() == "aarch64"
    assert sysconfig.get_platform() == "linux-aarch64"
    assert build._compiler().endswith("ziglang cc -target aarch64-linux-gnu.2.28")


def test_missing_headers_are_one_sentence(build: ModuleType, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sysconfig, "get_path", lambda name: "/nowhere/include")
    with pytest.raises(SystemExit, match=r"/nowhere/include/Python.h is missing.*python3-dev"):
        build.prepare()
