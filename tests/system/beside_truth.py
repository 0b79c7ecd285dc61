"""The demo in a terminal on a busy computer, and its heats held to the truth published beside them."""

from __future__ import annotations

import json
import time
from typing import Any

import numpy as np

from tests.bus.router import free_port
from tests.system.plant import Subscriber, until
from tests.system.terminal import CTRL_C, Terminal, busy_cores

SETTLED_S = 60.0  # "after the first minute"
SHARE = 0.95
SIGMAS = 3.0


def judged(documents: dict[str, list[dict[str, Any]]]) -> dict[str, Any]:
    """How many steps after the first minute were of which quality, and the share within 3 σ of each heat.

    The truth is interpolated to the time of each estimate; only steps called good are held to it.
    """
    heats, truths = documents["heat"], documents["truth/heat"]
    known_s = [truth["time_s"] for truth in truths]
    settled = [h for h in heats if h["time_s"] > heats[0]["time_s"] + SETTLED_S]
    qualities: dict[str, int] = {}
    for heat in settled:
        qualities[heat["quality"]] = qualities.get(heat["quality"], 0) + 1
    good = [h for h in settled if h["quality"] == "good"]
    within = {}
    for name in truths[0]["sources"]:
        true_W = np.interp(
            [h["time_s"] for h in good], known_s, [t["sources"][name]["heat_W"] for t in truths]
        )
        off = [
            abs(h["sources"][name]["heat_W"] - true) / h["sources"][name]["sigma_W"]
            for h, true in zip(good, true_W, strict=True)
        ]
        within[name] = float(np.mean(np.array(off) < SIGMAS)) if off else 0.0
    return {"steps": len(settled), "qualities": qualities, "within": within}


def watched(seconds: float) -> dict[str, Any]:
    """Run the demo in a terminal with a busy loop on every core for so long after its first estimate."""
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    with busy_cores(), Terminal("-m", "observer", "demo", "--listen", endpoint) as terminal:
        with Subscriber(endpoint, 300.0) as seen:
            until(lambda: "heat" in seen.documents, 300.0)
            end_s = time.monotonic() + seconds
            until(lambda: time.monotonic() > end_s or terminal.process.poll() is not None, seconds + 10.0)
            terminal.type(CTRL_C)
        assert terminal.process.wait(30.0) == 0, terminal.shown()
        terminal.assert_sane()
    found = judged(seen.documents)
    print(json.dumps(found))
    return found
