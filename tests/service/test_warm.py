"""What is not compiled yet is compiled by another process, which ends before the first tick."""

import textwrap
import threading

import pytest

from observer.service.warm import Compiler
from tests.patience import until

MODULE = """
import sys, threading, os
from tests.patience import until
line = sys.stdin.readline()
with open({said!r}, "a") as file:
    file.write(line)
if line.startswith("hang"):
    sys.stdin.read()
    os._exit(1)
sys.exit(int(line))
"""


@pytest.fixture
def module(tmp_path, monkeypatch):
    """A module that stands in for the compiling one: writes down what it was told, and ends with that."""
    said = tmp_path / "said"
    (tmp_path / "stand_in.py").write_text(textwrap.dedent(MODULE).format(said=str(said)))
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    return "stand_in", said


class _Kernels:
    """Stands in for what uses the kernels; compiles something new at the first call."""

    def __init__(self, *, cached: bool) -> None:
        self.runs = 0
        self._function = None if cached else _new_function()

    def __call__(self) -> None:
        self.runs += 1
        if self._function is not None:
            self._function(1.0)


def _new_function():
    import numba

    return numba.njit(lambda x: x + 1.0)


def test_what_is_in_the_cache_is_only_loaded(module):
    notes, kernels = [], _Kernels(cached=True)
    Compiler(module[0], "0", notes.append).warm(kernels)
    assert (kernels.runs, notes) == (1, [])
    assert not module[1].exists()


@pytest.mark.system
@pytest.mark.parametrize("code", ["0", "3"])
def test_what_is_not_is_compiled_apart_first(module, code):
    """Where that fails, as without a place for a cache, it is compiled here in the end."""
    notes, kernels = [], _Kernels(cached=False)
    Compiler(module[0], code, notes.append).warm(kernels)
    assert module[1].read_text() == f"{code}\n"
    assert kernels.runs == 2
    assert notes[0].startswith("STATUS=compiling")
    assert "EXTEND_TIMEOUT_USEC=30000000" in notes


@pytest.mark.system
def test_ends_at_once_when_the_service_does(module):
    kernels = _Kernels(cached=False)
    compiler = Compiler(module[0], "hang", lambda _: None)
    thread = threading.Thread(target=compiler.warm, args=(kernels,))
    thread.start()
    until(module[1].exists)
    compiler.end()
    thread.join(30.0)
    assert not thread.is_alive()
    assert kernels.runs == 1


@pytest.mark.system
def test_whoever_waits_is_told_that_it_goes_on(module, monkeypatch):
    monkeypatch.setattr("observer.service.warm._LOOK_S", 0.01)
    monkeypatch.setattr("observer.service.warm._TELL_S", 0.05)
    notes = []
    Compiler(module[0], "0", notes.append).warm(_Kernels(cached=False))
    told = [note for note in notes if note.endswith("s so far")]
    assert told
    assert all(note.startswith("STATUS=compiling") for note in told)
    assert notes[-1] == "STATUS="
