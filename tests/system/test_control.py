"""A real service, a simulated machine and a simulated control: what is written, and what lets go of it."""

from __future__ import annotations

import signal

import pytest

from tests.control.a_control import simulated_control
from tests.patience import until
from tests.system.plant import COMPENSATION, ask, service

pytestmark = pytest.mark.system
RATE_UM_S = 10.0
DEAD_MAN = 1


def test_a_control_is_written_to_while_armed_and_goes_to_zero_whatever_happens_to_the_service(tmp_path):
    fast = COMPENSATION | {"rate_limit_um_s": 50.0}
    with (
        simulated_control("--rate-um-s", str(RATE_UM_S)) as control,
        service(tmp_path, compensation=fast | {"control": control.settings}) as (plant, daemon, heard),
    ):

        def newest():
            return heard.documents["compensation"][-1]

        def arm():
            heard.wait_until_good()
            done = ask("arm", heard.endpoint)
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
    with simulated_control("--scan-s", str(scan_s), "--dead-man-s", "20") as control:
        patient = COMPENSATION | {"control": control.settings | {"follow_s": 2.0}}
        with service(tmp_path, compensation=patient) as (_, daemon, heard):
            heard.wait_until_good()
            done = ask("arm", heard.endpoint)
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
