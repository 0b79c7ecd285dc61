"""A real service, a simulated machine and a control: set to zero by a command, and again after a restart."""

from __future__ import annotations

import json

import numpy as np
import pytest

from observer.files.logs import read_log
from tests.bus.router import free_port
from tests.control.a_control import simulated_control
from tests.patience import until
from tests.system.plant import COMPENSATION, Daemon, Subscriber, ask, machine, table_for

pytestmark = pytest.mark.system
AT_M = 0.5
FLOAT32_UM = 1e-4  # of some 100 µm in single precision


def test_the_control_gets_the_error_since_the_zero_before_and_after_a_restart(tmp_path):
    endpoint = f"tcp/127.0.0.1:{free_port()}"

    def give(kind):
        done = ask(kind, endpoint)
        assert done.returncode == 0, done.stdout + done.stderr
        return json.loads(done.stdout)["text"]

    with machine(warm_minutes=20.0) as plant, simulated_control("--rate-um-s", "1000") as control:
        table = table_for(plant.wires, mode="router", listen=[endpoint])
        table["compensation"] = COMPENSATION | {
            "rate_limit_um_s": 1000.0, "gradient_limit_um_m": 1000.0, "zero_at_m": AT_M,
            "control": control.settings,
        }  # fmt: skip

        def newest():
            return heard.documents["compensation"][-1]

        def at_reference(document, status):
            return float(np.interp(AT_M, document["position_m"], status["wanted_um"]))

        def estimated(time_s, at_m):
            (found,) = [e for e in heard.estimates if e["time_s"] == time_s]
            return np.interp(at_m, found["position_m"], found["error_um"])

        def armed():
            heard.wait_until_good()
            give("arm")
            until(lambda: newest()["armed"] and not newest()["limited"] and control.largest_um > 0.2)
            return newest(), control.status()

        with Daemon(tmp_path, table) as daemon, Subscriber(endpoint) as heard:
            document, status = armed()
            assert document["zero"] is None
            before_um = at_reference(document, status)
            assert before_um > 5.0  # a warm screw: there is something to take out
            assert give("zero").startswith(f"zeroed at {AT_M} m on the screw")
            until(lambda: not newest()["armed"])
            until(lambda: control.largest_um == 0.0)
            document, status = armed()
            zero = document["zero"]
            assert "@" in zero["by"]
            assert zero["error_um"] == pytest.approx(estimated(zero["time_s"], AT_M), abs=FLOAT32_UM)
            since = estimated(document["time_s"], document["position_m"]) - zero["error_um"]
            np.testing.assert_allclose(document["error_um"], since, atol=FLOAT32_UM)  # `error` stays absolute
            assert abs(at_reference(document, status)) < 0.1 * before_um  # but for what has grown since
            daemon.stop()
            flags = [f for f in read_log(daemon.recording()).flags if f and f.startswith("!zero")]
            assert [f.split(" ")[0] for f in flags] == ["!zero=done"]
        with Daemon(tmp_path, table) as daemon, Subscriber(endpoint) as heard:
            document, status = armed()
            assert document["zero"] == zero, daemon.said()
            since = estimated(document["time_s"], document["position_m"]) - zero["error_um"]
            np.testing.assert_allclose(document["error_um"], since, atol=FLOAT32_UM)
            assert abs(at_reference(document, status)) < 0.1 * before_um
            daemon.stop()
