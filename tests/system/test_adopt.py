"""A running service puts an adopted configuration in force, and the previous one again after `--undo`."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tomlkit
import zenoh

from observer.installation import load
from observer.installation.adopt import sha256
from tests.bus.router import free_port
from tests.system.plant import PERIOD_S, PREFIX, Daemon, Subscriber, machine, run_observer, table_for, until

pytestmark = [pytest.mark.system, pytest.mark.timeout(400)]

LONGEST_PAUSE_S = 5.0
"""Parts end within 1.4 s and begin within some; a busy computer takes longer than a quiet one."""


def _found(folder: Path, config: Path, table: dict[str, Any]) -> Path:
    """A folder as a search would leave it, with this configuration."""
    folder.mkdir()
    (folder / "config.toml").write_text(tomlkit.dumps(table), encoding="utf-8")
    (folder / "result.json").write_text(json.dumps({"verdict": "named", "config_sha256": sha256(config)}))
    return folder


def _with(table: dict[str, Any], torque_Nm: float) -> dict[str, Any]:
    """The configuration with another friction of the nut."""
    sources = [s | ({"torque_Nm": torque_Nm} if s["name"] == "nut" else {}) for s in table["source"]]
    return table | {"source": sources}


def _hash(seen: Subscriber) -> str:
    """The hash of the configuration in force, as published under Zenoh's `config`."""
    (reply,) = seen._session.get(f"{PREFIX}/config", timeout=20.0)
    assert isinstance(reply.ok, zenoh.Sample)
    return str(json.loads(reply.ok.payload.to_bytes())["hash"])


def _begun_anew(seen: Subscriber, since: int) -> int | None:
    """The first estimate of parts that were built anew."""
    instances = [e["instance"] for e in list(seen.estimates)]
    return next((k for k in range(max(1, since), len(instances)) if instances[k] != instances[k - 1]), None)


def _assert_goes_on(seen: Subscriber, begun: int) -> None:
    """The estimates go on from where they stood: soon, and with heats and σ as they were."""
    before, after = seen.estimates[begun - 1], seen.estimates[begun]
    assert after["time_s"] - before["time_s"] < LONGEST_PAUSE_S
    sigma_W = before["heat_sigma_W"]
    assert (np.abs(after["heat_W"] - before["heat_W"]) < sigma_W).all()
    assert (after["heat_sigma_W"] < 1.6 * sigma_W).all()  # a cold start knows 15 W and 8 W
    assert np.abs(after["field_degC"] - before["field_degC"]).max() < 1.0


@pytest.mark.slow
def test_a_service_follows_an_adoption_and_its_undoing(tmp_path):
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    with machine() as plant:
        table = table_for(plant.wires, mode="router", listen=[endpoint])
        with Daemon(tmp_path, _with(table, 1.8)) as daemon, Subscriber(endpoint) as seen:
            config = daemon.config
            before_hash = load(config).digest
            table["record"] = {"directory": str(daemon.recordings)}
            until(lambda: seen.estimates, 120.0)
            enough = len(seen.estimates) + 400  # by then the heats are known to some 2 W
            until(lambda: len(seen.estimates) > enough, 120.0)
            assert _hash(seen) == before_hash

            results = _found(tmp_path / "results", config, table)
            for words, config_hash in (
                ((str(results),), load(results / "config.toml").digest),
                (("--undo",), before_hash),
            ):
                before = len(seen.estimates)
                done = run_observer("adopt", *words, "--config", str(config))
                assert done.returncode == 0, done.stderr
                begun = until(lambda before=before: _begun_anew(seen, before), 90.0)
                until(lambda begun=begun: len(seen.estimates) > begun + 5, 60.0)
                _assert_goes_on(seen, begun)
                assert _hash(seen) == config_hash
            assert daemon.stop() < 2.0
    assert "carried over into another model" in daemon.said()
    assert "cold start" not in daemon.said().replace("there is none yet", "").split("begun anew", 1)[1]
    assert PERIOD_S < LONGEST_PAUSE_S
