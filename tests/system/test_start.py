"""The first ticks of a daemon on a machine where nothing has been compiled yet."""

from __future__ import annotations

import pytest

from tests.publish.router import free_port
from tests.system.plant import Daemon, Subscriber, machine, table_for

pytestmark = pytest.mark.system


def test_nothing_is_left_to_compile_at_the_first_ticks(tmp_path, monkeypatch):
    """A kernel that is compiled between two ticks holds them up, by half a second where it was seen."""
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "empty"))
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    with machine() as plant:
        table = table_for(plant.wires, mode="router", listen=[endpoint])
        with Daemon(tmp_path, table) as daemon, Subscriber(endpoint) as seen:
            seen.wait_until_good()
            assert daemon.stop() < 2.0
    first_s = daemon.step_times_s()[0]
    # Numba writes a kernel to its cache when it has compiled it.
    compiled = {path.name: path.stat().st_mtime for path in (tmp_path / "empty").rglob("*.nbi")}
    assert len(compiled) > 5
    assert not {name: written_s for name, written_s in compiled.items() if written_s > first_s}
