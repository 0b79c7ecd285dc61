"""Several axes from one command: each is heard, one that dies is started again, none outlives the rest."""

from __future__ import annotations

import os
import re
import signal
import socket
import subprocess
import sys
from pathlib import Path

import pytest
import zenoh

from campaigns.fleet.axes import axes_of, children, listening_at, served
from observer.errors import ConfigError
from observer.fleet.axes import LONGEST_PAUSE_S, START_S, WATCHDOG_S, AxisProcess, check_axes
from observer.publish.session import session_config
from tests.docs.console import blocks
from tests.fleet.machines import configuration
from tests.patience import PATIENCE_S, until
from tests.publish.router import Router, free_port

AXES = 3
PAGE = Path(__file__).parents[2] / "docs" / "how-to" / "fleet.md"


@pytest.mark.system
def test_every_axis_is_heard_through_one_router_and_one_that_dies_comes_back(tmp_path):
    with Router() as router, listening_at(router.endpoint) as heard:
        configs, said = axes_of(tmp_path, AXES, router.endpoint, 600), tmp_path / "said"
        with served(configs, said) as process:
            until(lambda: len(heard.count) == AXES and process.poll() is None, 3 * PATIENCE_S)
            pids = children(process.pid)
            assert set(pids) == {"m00", "m01", "m02"}
            os.kill(pids["m01"], signal.SIGKILL)
            new = until(lambda: children(process.pid).get("m01", pids["m01"]) != pids["m01"])
            assert new
            before = heard.count["m01"]
            until(lambda: heard.count["m01"] > before + 2, 2 * PATIENCE_S)
            now = children(process.pid)
            assert (now["m00"], now["m02"]) == (pids["m00"], pids["m02"]), "the others go on"
            assert '"axis": "m01/x"' in said.read_text()
            process.send_signal(signal.SIGKILL)
            process.wait(PATIENCE_S)
            until(lambda: not any(Path(f"/proc/{pid}").exists() for pid in now.values()))


@pytest.mark.system
@pytest.mark.slow
@pytest.mark.timeout(1800)
def test_fifty_axes_are_heard_through_one_router():
    """Each sends what is due, and none of it is lost on the way."""
    command = [sys.executable, "-m", "campaigns.fleet.axes", "--axes", "50", "--seconds", "10"]
    done = subprocess.run(command, capture_output=True, text=True)
    print(done.stdout)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "50 of 50 axes heard" in done.stdout
    assert " 0 lost on the way" in done.stdout
    assert "exit code 0; 0 axes left over" in done.stdout


def test_two_that_are_the_same_axis_or_listen_at_the_same_place_are_refused(tmp_path):
    one, two = (configuration(tmp_path, 0, name) for name in ("a", "b"))
    with pytest.raises(ConfigError, match=r"a\.toml: a/x is the axis of .*a\.toml already"):
        check_axes([one, one])
    with pytest.raises(
        ConfigError, match=r"b\.toml: publish\.listen: .*a\.toml listens on tcp/127\.0\.0\.1:7447"
    ):
        check_axes([one, two])
    client = configuration(tmp_path, 0, "c", publish={"mode": "client", "connect": ["tcp/127.0.0.1:7447"]})
    assert [config.machine.name for config in check_axes([one, client])] == ["a", "c"]


@pytest.mark.parametrize("table", ["page", "metrics", "opcua"])
def test_two_whose_pages_or_servers_are_at_the_same_place_are_refused(table, tmp_path):
    publish = {"mode": "client", "connect": ["tcp/127.0.0.1:7447"]}
    one, two = (configuration(tmp_path, 0, name, publish=publish) for name in ("a", "b"))
    for path in (one, two):
        path.write_text(path.read_text() + f"\n[{table}]\n")
    with pytest.raises(
        ConfigError, match=rf"b\.toml: {table}\.listen: .*a\.toml listens on .* a port of its own"
    ):
        check_axes([one, two])
    place = "opc.tcp://127.0.0.1:4841" if table == "opcua" else "127.0.0.1:8081"
    two.write_text(two.read_text() + f'listen = "{place}"\n')
    check_axes([one, two])


class Scripted(AxisProcess):
    """An axis whose process is a shell's word."""

    def __init__(self, folder: Path, word: str) -> None:
        super().__init__("m/x", ["sh", "-c", word], folder / "inbox")

    def say(self, text: str, now_s: float) -> None:
        with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as mouth:
            mouth.sendto(text.encode(), self.inbox.getsockname())
        self.receive(now_s)


@pytest.fixture
def short_path(tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder to be in: a socket's path has room for a hundred letters."""
    folder = tmp_path_factory.mktemp("a")
    monkeypatch.chdir(folder)
    return Path()


def _ends(axis: AxisProcess, now_s: float) -> None:
    axis.process.wait(PATIENCE_S)
    axis.supervise(now_s, ending=False)


def test_the_pause_before_a_start_doubles_up_to_a_minute_and_a_steady_life_shortens_it(short_path):
    axis, pauses_s = Scripted(short_path, "exit 1"), []
    now_s = 0.0
    for _ in range(8):
        axis.start(now_s)
        _ends(axis, now_s)
        pauses_s.append(axis.due_s - now_s)
        now_s = axis.due_s
    assert pauses_s == [1, 2, 4, 8, 16, 32, LONGEST_PAUSE_S, LONGEST_PAUSE_S]
    axis.start(now_s)
    _ends(axis, now_s + 3600.0)
    assert axis.due_s == now_s + 3601.0
    axis.inbox.close()


@pytest.mark.parametrize(("code", "over"), [(0, 0), (2, 2), (1, None)])
def test_what_a_person_has_to_mend_is_not_started_again(short_path, code, over):
    axis = Scripted(short_path, f"exit {code}")
    axis.start(0.0)
    _ends(axis, 0.0)
    assert axis.exit_code == over
    axis.inbox.close()


def test_an_axis_that_is_silent_too_long_is_ended(short_path):
    axis = Scripted(short_path, "exec sleep 600")
    axis.start(0.0)
    axis.supervise(START_S, ending=False)
    assert axis.process.poll() is None
    axis.say("READY=1\nSTATUS=good", START_S)
    assert axis.ready
    axis.say("WATCHDOG=1", START_S + WATCHDOG_S)
    axis.say("STATUS=good", START_S + 2 * WATCHDOG_S)  # it speaks, but no cycle ends
    axis.supervise(START_S + 2 * WATCHDOG_S, ending=False)
    assert axis.process.poll() is None
    axis.supervise(START_S + 2 * WATCHDOG_S + 0.1, ending=False)
    assert axis.process.wait(PATIENCE_S) == -signal.SIGKILL
    axis.process.stdin.close()
    axis.inbox.close()


@pytest.mark.system
def test_the_page_s_router_routes(tmp_path):
    (text,) = (body for _, language, body in blocks(PAGE) if language == "json5")
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    text, replaced = re.subn(r'"tcp/[^"]+:7447"', f'"{endpoint}"', text)
    assert replaced == 1
    file = tmp_path / "router.json5"
    file.write_text(text, encoding="utf-8")
    with (
        zenoh.open(zenoh.Config.from_file(str(file))),
        listening_at(endpoint) as heard,
        zenoh.open(session_config("client", (endpoint,), ())) as axis,
    ):

        def told() -> bool:
            axis.put("ballscrew/m/x/heat", b'{"quality": "good", "sequence": 1}')
            return "m" in heard.count

        until(told)
