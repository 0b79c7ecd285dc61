"""An adopted configuration is kept if its gap shrinks, and reverted if it does not."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tomlkit

from observer.errors import UserError
from observer.frames import FrameBlock
from observer.installation import adopt as adopting
from observer.installation import load
from observer.installation.adopt import Adoption, adopt, adoption_of, sha256, undo
from observer.live.trial import AdoptionTrial
from tests.logs.machines import machine, table
from tests.logs.simulated import made_log

EFFECT = {"kind": "end_conduction", "target": "left", "conductance_W_K": 0.4}
WORSE = {"kind": "end_conduction", "target": "right", "conductance_W_K": 0.9}
HOURS = 1.0
TRUE = made_log(machine(effect=[EFFECT]), 1)


@pytest.fixture
def config(tmp_path: Path) -> Path:
    path = tmp_path / "machine.toml"
    path.write_text(tomlkit.dumps(table()), encoding="utf-8")
    return path


def _adopt(config: Path, effect: dict[str, Any], hours: float = HOURS, now_s: float = 1.0) -> Adoption:
    """Adopt the configuration with one effect more."""
    found = config.parent / "found"
    found.mkdir(exist_ok=True)
    (found / "config.toml").write_text(tomlkit.dumps(table(effect=[effect])), encoding="utf-8")
    (found / "result.json").write_text(json.dumps({"verdict": "named", "config_sha256": sha256(config)}))
    return adopt(found, config, hours, now_s)


class Running:
    """A service's part in it: it reads its configuration again when it is asked to, and sees frames."""

    def __init__(self, config: Path) -> None:
        self.config = config
        self.reloads = 0
        self.trial = AdoptionTrial(config, self._reload)
        self.trial.in_force(load(config))

    def _reload(self) -> None:
        self.reloads += 1
        self.trial.in_force(load(self.config))

    def see(self, frames: Iterator[FrameBlock]) -> None:
        """Tick for tick, with a look now and then."""
        for k, frame in enumerate(frames):
            self.trial.see(frame)
            if k % 50 == 49:
                self.trial.look()


def _ticks(block: FrameBlock, begin: int = 0, end: int | None = None) -> Iterator[FrameBlock]:
    rows = ("time_s", "dt_s", "values", "fresh", "quality", "age_s")
    for k in range(begin, len(block) if end is None else end):
        yield replace(block, path={}, **{name: getattr(block, name)[k : k + 1] for name in rows})


def test_a_better_one_is_kept(config):
    service = Running(config)
    adopted = _adopt(config, EFFECT)
    service.trial.look()
    assert service.reloads == 1
    service.see(_ticks(TRUE))
    kept = adoption_of(config)
    assert (kept.state, kept.reason) == ("kept", "the gap has shrunk")
    assert kept.rms_K < 0.1  # the noise of the sensors is 0.05 K
    assert kept.before_rms_K > 10 * kept.rms_K
    assert sha256(config) == adopted.sha256
    assert service.reloads == 1
    assert service.trial.document()["state"] == "kept"
    assert service.trial.notices() == ()


def test_a_worse_configuration_is_reverted_and_reported(config):
    text = config.read_bytes()
    service = Running(config)
    _adopt(config, WORSE)
    service.trial.look()
    service.see(_ticks(TRUE))
    assert adoption_of(config).state == "taken_back"
    assert config.read_bytes() == text
    assert service.reloads == 2
    (notice,) = service.trial.notices()
    assert "reverted" in notice
    assert "the gap has not shrunk" in notice
    service.see(_ticks(TRUE))  # and that was that
    assert service.reloads == 2


def test_one_that_changes_next_to_nothing_is_reverted(config):
    service = Running(config)
    _adopt(config, EFFECT | {"conductance_W_K": 0.001})
    service.trial.look()
    service.see(_ticks(TRUE))
    assert adoption_of(config).state == "taken_back"


def test_hours_at_rest_are_not_counted(config):
    """A machine that stands over the weekend says nothing of either."""
    still = made_log(machine(effect=[EFFECT]), 2, heater_W=0.0, speed_rpm=0.0)
    service = Running(config)
    _adopt(config, EFFECT)
    service.trial.look()
    service.see(_ticks(still))
    document = service.trial.document()
    assert (document["state"], document["watched_h"]) == ("watching", 0.0)


def test_a_restart_continues_the_trial(config):
    service = Running(config)
    _adopt(config, EFFECT)
    service.trial.look()
    half = len(TRUE) // 3
    service.see(_ticks(TRUE, 0, half))
    watched = service.trial.document()["watched_h"]
    assert 0.2 < watched < HOURS
    service.trial.start(load(config))
    service.trial.close(10.0)
    again = Running(config)
    assert again.trial.document()["watched_h"] == watched
    again.see(_ticks(TRUE, half))
    assert again.reloads == 0
    assert adoption_of(config).state == "kept"


def test_both_begin_again_after_a_pause(config):
    """A night without a frame is no gap of either: nobody knows what the screw did."""
    service = Running(config)
    _adopt(config, EFFECT, hours=1000.0)
    service.trial.look()
    half = len(TRUE) // 2  # the heater has just been switched off, and the screw is hot
    service.see(_ticks(TRUE, 0, half))
    before = service.trial.document()
    cold = made_log(machine(effect=[EFFECT]), 3)
    late = replace(cold, time_s=cold.time_s + TRUE.time_s[half] + 40_000.0)
    late.dt_s[0] = 40_000.0
    service.see(_ticks(late, 0, 100))
    assert service.trial.document()["rms_K"] <= before["rms_K"]
    assert service.trial.document()["watched_h"] - before["watched_h"] < 0.1


def test_reverted_by_hand_it_is_reloaded(config):
    service = Running(config)
    _adopt(config, EFFECT)
    service.trial.look()
    undo(config)
    service.trial.look()
    assert service.reloads == 2
    service.see(_ticks(TRUE))
    assert adoption_of(config).state == "undone"


def test_what_somebody_has_written_since_stays(config):
    service = Running(config)
    _adopt(config, WORSE)
    service.trial.look()
    text = config.read_text() + "# mine\n"
    config.write_text(text, encoding="utf-8")
    service.see(_ticks(TRUE))
    assert config.read_text() == text
    assert adoption_of(config).state == "replaced"
    assert service.reloads == 1


def test_a_rejected_adoption_is_not_watched(config):
    """The configuration in force is still the one before: its frames say nothing of a trial."""
    service = Running(config)
    service.trial._reload = lambda: None
    _adopt(config, EFFECT)
    service.trial.look()
    service.see(_ticks(TRUE))
    assert service.trial.document()["watched_h"] == 0.0


def test_an_unwritable_folder_is_reported(config, monkeypatch):
    service = Running(config)
    _adopt(config, WORSE)
    service.trial.look()

    def refuse(*_: object) -> None:
        raise OSError(30, "Read-only file system")

    monkeypatch.setattr(adopting, "write_together", refuse)
    failures: list[str] = []
    _catching(service, _ticks(TRUE), failures)
    assert "the gap has not shrunk, but the configuration cannot be reverted" in failures[-1]
    assert "Read-only file system" in failures[-1]


def test_a_better_one_stays_kept_where_that_cannot_be_written_down(config, monkeypatch):
    """The unit of the installation lets nothing be written there: no reason to watch all over again."""
    service = Running(config)
    _adopt(config, EFFECT)
    service.trial.look()

    def refuse(*_: object) -> None:
        raise OSError(30, "Read-only file system")

    with monkeypatch.context() as patch:
        patch.setattr(adopting, "write_together", refuse)
        service.see(_ticks(TRUE))
        assert service.reloads == 1
        assert service.trial.document()["state"] == "kept"
        (notice,) = service.trial.notices()
        assert "Read-only file system" in notice
    service.trial.look()
    assert adoption_of(config).state == "kept"
    assert service.trial.notices() == ()


def test_what_somebody_has_written_and_put_in_force_at_once_ends_the_watch(config):
    service = Running(config)
    _adopt(config, WORSE)
    service.trial.look()
    config.write_text(tomlkit.dumps(table(effect=[EFFECT])), encoding="utf-8")
    service._reload()
    service.trial.look()
    assert adoption_of(config).state == "replaced"
    assert service.trial.document()["state"] == "replaced"


def test_a_service_that_ends_does_not_overwrite_what_was_done_meanwhile(config):
    service = Running(config)
    _adopt(config, EFFECT)
    service.trial.look()
    service.see(_ticks(TRUE, 0, len(TRUE) // 3))
    undo(config)
    service.trial._closing.set()
    service.trial._supervised()
    assert adoption_of(config).state == "undone"


def _catching(service: Running, frames: Iterator[FrameBlock], failures: list[str]) -> None:
    look: Callable[[], None] = service.trial.look

    def quiet() -> None:
        try:
            look()
        except UserError as error:
            failures.append(str(error))

    service.trial.look = quiet
    service.see(frames)


def test_a_record_that_is_damaged_stops_nothing(config):
    config.with_name("machine.toml.adopted.json").write_text("{", encoding="utf-8")
    service = Running(config)
    service.see(_ticks(TRUE, 0, 100))
    (notice,) = service.trial.notices()
    assert "is not what `observer adopt` has written" in notice
    assert service.trial.document() is None
    config.with_name("machine.toml.adopted.json").unlink()
    service.trial.look()
    assert service.trial.notices() == ()


def test_a_record_that_is_damaged_meanwhile_does_not_end_the_watch(config):
    service = Running(config)
    _adopt(config, EFFECT)
    service.trial.look()
    record = config.with_name("machine.toml.adopted.json")
    whole = record.read_bytes()
    record.write_text("{", encoding="utf-8")
    service.trial.look()
    assert service.reloads == 1
    record.write_bytes(whole)
    service.see(_ticks(TRUE))
    assert service.reloads == 1
    assert adoption_of(config).state == "kept"


def test_gaps_are_those_of_the_same_readings(config):
    """A sensor that is gone for a while is gone for both."""
    gone = replace(TRUE, fresh=TRUE.fresh.copy())
    gone.fresh[:, 1] = False
    service = Running(config)
    _adopt(config, EFFECT, hours=1000.0)
    service.trial.look()
    service.see(_ticks(gone, 0, 1000))
    assert service.trial._adoption.values <= 2 * 1000
    assert np.isfinite(service.trial.document()["before_rms_K"])
