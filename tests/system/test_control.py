"""A real service, a simulated machine and a simulated control: what is written, and what lets go of it."""

from __future__ import annotations

import signal
import subprocess
import sys

import pytest

from tests.control.a_control import simulated_control
from tests.patience import PATIENCE_S, until
from tests.publish.router import free_port
from tests.system.plant import COMPENSATION, ROOT, Daemon, Subscriber, machine, table_for

pytestmark = pytest.mark.system
RATE_UM_S = 10.0
DEAD_MAN = 1


def test_a_control_is_written_to_while_armed_and_goes_to_zero_whatever_happens_to_the_service(tmp_path):
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    with machine() as plant, simulated_control("--rate-um-s", str(RATE_UM_S)) as control:
        table = table_for(plant.wires, mode="router", listen=[endpoint])
        table["compensation"] = COMPENSATION | {
            "rate_limit_um_s": 50.0, "control": {"kind": "modbus", "host": "127.0.0.1", "port": control.port},
        }  # fmt: skip
        with Daemon(tmp_path, table) as daemon, Subscriber(endpoint) as heard:

            def newest():
                return heard.documents["compensation"][-1]

            def arm():
                heard.wait_until_good()
                command = [sys.executable, "-m", "observer", "arm", "--connect", endpoint]
                command += ["--machine", "demo", "--axis", "x"]
                done = subprocess.run(
                    command, cwd=ROOT, capture_output=True, text=True, timeout=PATIENCE_S, check=False
                )
                assert done.returncode == 0, done.stdout + done.stderr
                until(lambda: control.largest_um > 0.2)
                assert newest()["armed"]

            def zero(reason):
                until(lambda: control.status()["state"] == 0)
                assert control.largest_um == 0.0
                assert control.status()["reason"] == reason

            heard.wait_until_good()
            heard.wait_for_more(10)
            assert control.status()["writes"] == 0

            arm()
            until(lambda: max(map(abs, newest()["error_um"])) < control.largest_um + 0.5)
            status = control.status()
            assert status["wanted_um"] == pytest.approx(newest()["error_um"], abs=0.5)
            assert status["fastest_um_s"] <= RATE_UM_S * (1 + 1e-9)
            plant.fault(open=["t1_degC"])
            zero(0)  # released: its dead-man had not to do it
            assert "arm again" in newest()["reason"]
            plant.fault()

            arm()
            control.command(alter=True)
            status = "reads back something other than was written"
            until(lambda: any(status in reason for reason in heard.health().get("reasons", ())))
            until(lambda: not newest()["armed"])
            assert status in newest()["reason"]
            zero(0)
            control.command(alter=False)

            arm()
            daemon.process.send_signal(signal.SIGSTOP)
            zero(DEAD_MAN)
            daemon.process.send_signal(signal.SIGCONT)
            until(lambda: not newest()["armed"])
            assert "arm again" in newest()["reason"]

            arm()
            daemon.process.kill()
            zero(DEAD_MAN)


@pytest.mark.parametrize(
    ("scan_s", "code", "text"),
    [(0.3, 0, '"text": "armed"'), (1e4, 1, "not armed: switched off at")],
)
def test_arming_is_answered_once_it_is_known_whether_the_control_follows(tmp_path, scan_s, code, text):
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    with machine() as plant, simulated_control("--scan-s", str(scan_s), "--dead-man-s", "20") as control:
        table = table_for(plant.wires, mode="router", listen=[endpoint])
        table["compensation"] = COMPENSATION | {
            "control": {"kind": "modbus", "host": "127.0.0.1", "port": control.port, "follow_s": 2.0},
        }  # fmt: skip
        with Daemon(tmp_path, table) as daemon, Subscriber(endpoint) as heard:
            heard.wait_until_good()
            done = subprocess.run(
                [sys.executable, "-m", "observer", "arm", "--connect", endpoint, "--timeout-s", "30"],
                cwd=ROOT, capture_output=True, text=True, timeout=PATIENCE_S, check=False,
            )  # fmt: skip
            assert done.returncode == code, done.stdout + done.stderr
            assert text in done.stdout
            alarms = heard.documents["alarms"][-1]["alarms"]
            if code == 0:
                assert control.status()["state"] == 1
                assert heard.documents["compensation"][-1]["armed"]
                assert alarms == []
            else:
                assert "it does not follow" in done.stdout
                until(lambda: "it does not follow" in str(heard.documents["alarms"][-1]["alarms"]))
            daemon.stop()
