"""A real service and a simulated machine that probes itself, or has a scale beside its axis: what is known
then, and what is advised.
"""

from __future__ import annotations

import numpy as np
import pytest

from tests.bus.router import free_port
from tests.patience import until
from tests.system.plant import Daemon, Subscriber, machine, table_for
from tests.system.test_recording import assert_replay_is_live

pytestmark = pytest.mark.system
PROBE_M, ZERO_UM, NEEDS_UM = 0.9, 0.5, 8.0
PROBE = {
    "name": "probe", "kind": "displacement", "channel": "probe_um", "position_m": PROBE_M,
    "noise_um": 0.3, "zero_um": ZERO_UM, "occasional": True,
}  # fmt: skip


def test_a_probing_is_asked_for_and_taken_and_nothing_is_missing_without(tmp_path):
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    with machine() as plant:
        table = table_for(plant.wires, mode="router", listen=[endpoint])
        table["sensor"].append(PROBE)
        table["drivers"]["axis"]["channels"]["probe_um"] = {"message": "ProbeResult", "signal": "ScrewGrowth"}
        table["output"] = {"reference_degC": table["ambient"]["temperature_degC"]}
        table["integrity"] = {"enabled": False}  # a bound takes minutes to narrow; without one, 2 σ count
        table["probing"] = {"needs_um": NEEDS_UM}
        with Daemon(tmp_path, table) as daemon, Subscriber(endpoint) as heard:

            def advice():
                return (heard.documents.get("probing") or [None])[-1]

            until(lambda: heard.estimates and heard.estimates[-1]["heat_quality"] == "good")
            before = until(advice)
            probed_um = plant.probe(PROBE_M)
            after = until(lambda: not advice()["probe_now"] and advice())
            heard.wait_for_more(5)
            daemon.stop()
            live = list(heard.estimates)
    assert before["probe_now"]
    assert before["sensor"] == "probe"
    (at,) = [k for k, e in enumerate(live) if np.isfinite(e["innovation_K"][-1])]
    sigma_um = [float(np.max(live[k]["error_sigma_um"])) for k in (at - 1, at)]
    assert 2.0 * sigma_um[0] > NEEDS_UM > 2.0 * sigma_um[1]
    assert after["after_um"] < after["within_um"] <= NEEDS_UM < before["within_um"]
    here = int(np.argmin(np.abs(np.array(live[at]["position_m"]) - PROBE_M)))
    assert abs(live[at]["error_um"][here] - probed_um) < 3.0 * ZERO_UM
    # it is missing until it is there, which makes no estimate worse; between probings nothing is missing, nor
    # does the bus say so
    seen = [(k >= at, e["sensor_quality"][-1]) for k, e in enumerate(live) if e["quality"] == "good"]
    assert set(seen) == {(False, "missing"), (True, "good")}
    assert heard.health()["channels"]["probe_um"]["fault"] is None
    assert_replay_is_live(daemon.recording(), daemon.config, live, tmp_path / "one")


def test_a_scale_counts_at_the_places_that_the_nut_passes(tmp_path):
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    with machine(5.0, "--scale") as plant:
        table = table_for(plant.wires, mode="router", listen=[endpoint])
        scale = {k: v for k, v in PROBE.items() if k not in ("position_m", "occasional")}
        table["sensor"].append(scale | {"along": "nut"})
        table["drivers"]["axis"]["channels"]["probe_um"] = {"message": "ProbeResult", "signal": "ScrewGrowth"}
        table["output"] = {"reference_degC": table["ambient"]["temperature_degC"]}
        with Daemon(tmp_path, table) as daemon, Subscriber(endpoint) as heard:
            heard.wait_until_good()
            until(lambda: sum(np.isfinite(e["innovation_K"][-5:]).sum() for e in heard.estimates) >= 3)
            heard.wait_for_more(5)
            daemon.stop()
            live = list(heard.estimates)
    assert max(np.nanmax(e["error_sigma_um"]) for e in live[:1]) > 2.0 * np.nanmax(live[-1]["error_sigma_um"])
    assert heard.health()["channels"]["probe_um"]["quality"] == "good"
    assert_replay_is_live(daemon.recording(), daemon.config, live, tmp_path / "one")
