"""When the process is executed anew: after a configuration was checked, or once a set clock has settled."""

import os
import threading

import pytest

from observer.errors import ConfigError
from observer.service.restarts import SETTLED_S, Restarts
from tests.patience import until


def nothing() -> dict:
    """Find every configuration valid."""
    return {}


def test_a_clock_is_believed_once_it_has_settled():
    restarts = Restarts(nothing)
    assert restarts.due(0.0, 0.4) is None
    assert restarts.due(1.0, 3600.0) is None
    assert restarts.due(3.5, 3600.01) is None
    assert restarts.due(3.6, 1800.0) is None  # set once more
    assert restarts.due(3.6 + SETTLED_S - 0.1, 1800.0) is None
    assert "by +1800." in restarts.due(3.7 + SETTLED_S, 1800.05)


def test_a_clock_that_corrects_itself_is_left_alone():
    restarts = Restarts(nothing)
    for k in range(20):
        assert restarts.due(float(k), 5.0 if k % 2 else 0.0) is None


def test_a_valid_configuration_is_a_reason_to_restart():
    restarts = Restarts(lambda: {"new": 1}, {"old": 1})
    assert restarts.table == {"old": 1}
    restarts.reload()
    until(lambda: restarts.due(0.0, 0.0) == "the configuration was read again")
    assert restarts.table == {"new": 1}
    assert restarts.notices() == ()
    # what is asked for now is left to the next process
    assert not restarts.reload_pending
    restarts.reload()
    assert restarts.reload_pending


def test_a_rejected_configuration_is_reported_and_changes_nothing():
    answers = [ConfigError("c.toml: screw.length_m: is missing; add it"), RuntimeError("a defect"), None]

    def check():
        if (answer := answers.pop(0)) is not None:
            raise answer
        return {}

    restarts = Restarts(check)
    assert restarts.notices() == ()
    for words in ("screw.length_m: is missing", "a defect"):
        restarts.reload()
        until(lambda words=words: any(words in notice for notice in restarts.notices()))
        assert restarts.due(0.0, 0.0) is None
    restarts.reload()
    until(lambda: restarts.due(0.0, 0.0) is not None)
    assert restarts.notices() == ()


@pytest.mark.parametrize("change", ["written", "removed"])
def test_an_adopted_configuration_is_checked_without_being_asked(tmp_path, change):
    record = tmp_path / "machine.toml.adopted.json"
    record.write_text("{}")
    restarts = Restarts(nothing, {}, record)
    if change == "written":
        os.utime(record, ns=(1, 1))
    else:
        record.unlink()
    until(lambda: restarts.due(0.0, 0.0) == "a configuration was adopted")


def test_asked_while_it_checks_it_checks_once_more():
    go, count = threading.Event(), []

    def check():
        count.append(1)
        assert go.wait(30.0)
        if len(count) == 1:
            raise ConfigError("half written")
        return {}

    restarts = Restarts(check)
    restarts.reload()
    until(lambda: count)
    for _ in range(5):
        restarts.reload()
    go.set()
    until(lambda: restarts.due(0.0, 0.0) is not None)
    assert len(count) == 2
