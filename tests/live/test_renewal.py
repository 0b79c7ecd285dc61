"""When the parts are built anew: after a configuration was read again, or once a set clock has settled."""

import os
import threading

from observer.errors import ConfigError
from observer.live.renewal import SETTLED_S, Renewals
from tests.patience import until


def test_a_clock_is_believed_once_it_has_settled():
    renewals = Renewals()
    assert renewals.due(0.0, 0.4) is None
    assert renewals.due(1.0, 3600.0) is None
    assert renewals.due(3.5, 3600.01) is None
    assert renewals.due(3.6, 1800.0) is None  # set once more
    assert renewals.due(3.6 + SETTLED_S - 0.1, 1800.0) is None
    renewal = renewals.due(3.7 + SETTLED_S, 1800.05)
    assert renewal.new_time
    assert "by +1800." in renewal.reason


def test_a_clock_that_corrects_itself_is_left_alone():
    renewals = Renewals()
    for k in range(20):
        assert renewals.due(float(k), 5.0 if k % 2 else 0.0) is None


def test_a_configuration_that_was_read_is_due_once():
    renewals = Renewals(lambda: "prepared")
    renewals.reload()
    found = []
    until(lambda: found.append(renewals.due(0.0, 0.0)) or found[-1] is not None)
    assert found[-1].prepared == "prepared"
    assert not found[-1].new_time
    assert renewals.due(0.0, 0.0) is None


def test_a_rejected_configuration_is_reported_and_changes_nothing():
    answers = [
        ConfigError("c.toml: screw.length_m: is missing; add it"),
        RuntimeError("a defect"),
        "prepared",
    ]

    def reread():
        answer = answers.pop(0)
        if isinstance(answer, Exception):
            raise answer
        return answer

    renewals = Renewals(reread)
    assert renewals.notices() == ()
    for words in ("screw.length_m: is missing", "a defect"):
        renewals.reload()
        until(lambda words=words: any(words in notice for notice in renewals.notices()))
        assert renewals.due(0.0, 0.0) is None
    renewals.reload()
    until(lambda: renewals.due(0.0, 0.0) is not None)
    assert renewals.notices() == ()


def test_a_configuration_is_read_again_when_one_was_adopted(tmp_path):
    record = tmp_path / "machine.toml.adopted.json"
    record.write_text("{}")
    count = []
    renewals = Renewals(lambda: count.append(1) or len(count), record)
    record.write_text('{"state": "undone"}')
    os.utime(record, ns=(1, 1))  # a file system may keep no more than seconds
    until(lambda: (renewal := renewals.due(0.0, 0.0)) is not None and renewal.prepared == 1)
    record.unlink()
    until(lambda: (renewal := renewals.due(0.0, 0.0)) is not None and renewal.prepared == 2)


def test_asked_while_it_reads_it_reads_once_more():
    go, count = threading.Event(), []

    def reread():
        count.append(1)
        assert go.wait(30.0)
        return len(count)

    renewals = Renewals(reread)
    renewals.reload()
    until(lambda: count)
    for _ in range(5):
        renewals.reload()
    go.set()
    until(lambda: (renewal := renewals.due(0.0, 0.0)) is not None and renewal.prepared == 2)
    assert len(count) == 2


def test_without_a_configuration_to_read_there_is_none():
    renewals = Renewals()
    assert not renewals.can_reload
    renewals.reload()
    assert renewals.due(0.0, 0.0) is None
