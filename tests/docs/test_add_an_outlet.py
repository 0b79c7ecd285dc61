"""The outlet of the page that shows how to add one: installed beside the program, it gets estimates."""

from __future__ import annotations

import os
import shutil
import socket
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path

import pytest

from observer.bus.codec import config_json
from observer.errors import ConfigError
from observer.installation import parse
from observer.outlets.start import Start
from tests.outlets.feeding import fed_outlets
from tests.patience import PATIENCE_S

ROOT = Path(__file__).parents[2]
TABLE = tomllib.loads((ROOT / "config" / "demo.toml").read_text("utf-8"))
BROKEN = """
from observer.config.outlets import OutletTable

class Broken(OutletTable):
    async def serve(self, prefix, latest, report_state):
        {}["measured"]

class Unfinished(OutletTable):
    pass
"""
ENTRIES = """
[ballscrew_observer.outlets]
influx-lines = influx_lines:InfluxLines
broken = broken:Broken
unfinished = broken:Unfinished
stranger = pathlib:Path
"""


@pytest.fixture(autouse=True)
def installed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """A package with outlets, installed in a folder on the path of this process and of those it starts."""
    shutil.copy(ROOT / "docs" / "examples" / "influx_lines.py", tmp_path)
    (tmp_path / "broken.py").write_text(BROKEN, encoding="utf-8")
    metadata = tmp_path / "somewhere-1.0.dist-info"
    metadata.mkdir()
    (metadata / "METADATA").write_text("Metadata-Version: 2.1\nName: somewhere\nVersion: 1.0\n", "utf-8")
    (metadata / "entry_points.txt").write_text(ENTRIES, encoding="utf-8")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setenv("PYTHONPATH", f"{tmp_path}{os.pathsep}{ROOT}")
    yield
    for module in ("influx_lines", "broken"):
        sys.modules.pop(module, None)


@pytest.mark.system
@pytest.mark.parametrize("kind", ["influx-lines", "influx_lines:InfluxLines"])
def test_the_page_s_outlet_sends_heats_and_one_that_fails_is_reported(kind: str) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as receiver:
        receiver.bind(("127.0.0.1", 0))
        receiver.settimeout(PATIENCE_S)
        port = receiver.getsockname()[1]
        also = {"workshop": {"kind": kind, "port": port}, "second": {"kind": "broken"}}
        start = Start.of(parse(TABLE | {"outlets": {"also": also}}))
        assert start is not None
        with fed_outlets(also=start.also) as feed:
            states = {state["outlet"]: state for state in (feed.said(), feed.said())}
            assert states["outlets.also.workshop"]["address"] == f"udp 127.0.0.1:{port}"
            reason = states["outlets.also.second"]["reason"]
            assert "broken failed in " in reason
            assert "broken.py, line 6 (KeyError: 'measured')" in reason
            time_s = feed.estimate(time_s=1.5)
            line = receiver.recv(1000).decode()
            axis = "axis=ballscrew/lathe/z,source=nut,quality=good"
            assert line == f"heat,{axis} heat_W=26.5 {round(time_s * 1e9)}"


@pytest.mark.parametrize(
    ("table", "problem"),
    [
        ({"kind": "influx-lines", "prot": 1}, "outlets.also.x.prot: unknown key (did you mean port?)"),
        ({"kind": "influx-lines", "port": "none"}, "outlets.also.x.port"),
        ({"kind": "screen"}, "give one of broken, influx-lines, stranger, unfinished, module:Class"),
        ({"port": 1}, 'kind is "None"'),
        ({"kind": "stranger"}, "name a subclass of observer.config.outlets.OutletTable"),
        ({"kind": "unfinished"}, "unfinished has no serve"),
        ({"kind": "missing:Class"}, "missing:Class cannot be imported"),
    ],
)
def test_a_wrong_table_is_a_sentence_that_names_it(table: dict[str, object], problem: str) -> None:
    with pytest.raises(ConfigError, match=r"outlets\.also\.x") as error:
        parse(TABLE | {"outlets": {"also": {"x": table}}})
    assert problem in str(error.value)


def test_nobody_reads_an_outlet_s_table_on_the_bus() -> None:
    config = parse(TABLE | {"outlets": {"also": {"x": {"kind": "influx-lines", "host": "secret"}}}})
    assert "secret" in config.model_dump_json()
    assert "secret" not in config_json(config, "0a0a0a0a")
