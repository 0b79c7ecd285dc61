"""The dashboard's queries, run by a real Prometheus that scrapes a real process."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
import urllib.parse
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from observer.config.outlets import Metrics
from tests.bus.router import free_port
from tests.outlets.feeding import fed_outlets, feed_machine
from tests.patience import PATIENCE_S, until

pytestmark = [
    pytest.mark.system,
    pytest.mark.skipif(shutil.which("prometheus") is None, reason="needs Debian's package prometheus"),
]

DASHBOARD = Path(__file__).parents[2] / "config" / "grafana-dashboard.json"
SCRAPES = """
global: {{scrape_interval: 500ms}}
scrape_configs: [{{job_name: observer, static_configs: [{{targets: ["{target}"]}}]}}]
"""


@contextmanager
def prometheus(folder: Path, target: str) -> Iterator[str]:
    """One that scrapes a target twice a second and keeps what it finds in a folder; gives its address."""
    (folder / "prometheus.yml").write_text(SCRAPES.format(target=target))
    listen = f"127.0.0.1:{free_port()}"
    command = ["prometheus", "--config.file=prometheus.yml", f"--web.listen-address={listen}"]
    with (folder / "said").open("wb") as said:
        process = subprocess.Popen(
            [*command, "--storage.tsdb.path=kept"], cwd=folder, stdout=said, stderr=subprocess.STDOUT
        )
    try:
        yield f"http://{listen}/api/v1"
    finally:
        process.terminate()
        process.wait(PATIENCE_S)


def _asked(address: str, path: str, **query: str) -> Any:
    try:
        with urllib.request.urlopen(f"{address}/{path}?{urllib.parse.urlencode(query)}", timeout=10) as reply:
            return json.load(reply)["data"]
    except OSError:  # not there yet; or a query that it refuses, which then never gives anything
        return None


def _found(address: str, query: str) -> list[Any]:
    """What a query of the dashboard gives for the machine: a list of values, or series."""
    if values := re.fullmatch(r"label_values\((.+), (\w+)\)", query):
        return _asked(address, f"label/{values[2]}/values", **{"match[]": values[1]}) or []
    return (_asked(address, "query", query=query) or {}).get("result", [])


def test_every_query_of_the_dashboard_gives_something(tmp_path):
    dashboard = json.loads(DASHBOARD.read_text(encoding="utf-8"))
    queries = [target["expr"] for panel in dashboard["panels"] for target in panel["targets"]]
    queries += [v["query"] for v in dashboard["templating"]["list"] if v["type"] == "query"]
    queries = [query.replace("$machine", "lathe").replace("$axis", "z") for query in queries]
    assert len(queries) > 8
    listen = f"127.0.0.1:{free_port()}"
    with fed_outlets(metrics=Metrics(listen=listen)) as feed, prometheus(tmp_path, listen) as address:
        feed_machine(feed)
        for query in queries:
            until(lambda query=query: _found(address, query))
        assert _found(address, "label_values(ballscrew_up, machine)") == ["lathe"]
        (heat,) = _found(address, 'ballscrew_heat_watts{machine="lathe",axis="z",source="nut"}')
        assert heat["value"][1] == "26.5"
        assert _found(address, "ballscrew_no_such_figure") == []
