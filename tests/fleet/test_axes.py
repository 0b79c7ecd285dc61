"""Several axes: each is a process of its own, and all are heard through one router."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest
import zenoh

from campaigns.fleet.axes import axes_of, listening_at, served
from observer.bus.session import session_config
from tests.bus.router import Router, free_port
from tests.docs.console import blocks
from tests.patience import PATIENCE_S, until

AXES = 3
PAGE = Path(__file__).parents[2] / "docs" / "how-to" / "fleet.md"


@pytest.mark.system
def test_every_axis_is_heard_through_one_router_and_one_that_dies_harms_no_other(tmp_path):
    with Router() as router, listening_at(router.endpoint) as heard:
        configs = axes_of(tmp_path, AXES, router.endpoint, 600)
        with served(configs, tmp_path, heard) as axes:
            until(lambda: len(heard.count) == AXES, 3 * PATIENCE_S)
            axes["m01"].kill()
            axes["m01"].wait(PATIENCE_S)
            before = dict(heard.count)
            until(lambda: all(heard.count[name] > before[name] + 2 for name in ("m00", "m02")))


def test_one_process_serves_one_axis():
    command = [sys.executable, "-m", "observer", "run", "--config", "x.toml", "--config", "y.toml"]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 2
    assert re.fullmatch(r"observer: run: give one --config, .* or a container for each .*\n", done.stderr)


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
    assert "exit codes [0]" in done.stdout


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

        def is_heard() -> bool:
            axis.put("ballscrew/m/x/heat", b'{"quality": "good", "sequence": 1}')
            return "m" in heard.count

        until(is_heard)
