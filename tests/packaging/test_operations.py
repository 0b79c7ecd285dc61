"""docs/operations.md and docs/how-to/systemd.md, line by line, as an ordinary user beside a systemd.

The lines are read from the pages. Debian's packages and pip get the network settings of this computer.
The thermocouple module is a Modbus server in the box.
"""

from __future__ import annotations

import json
import re
import shlex
import shutil
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import pytest

from tests.docs.console import blocks, commands, matches
from tests.packaging.box import Box, box
from tests.patience import PATIENCE_S, until

pytestmark = [pytest.mark.system, pytest.mark.slow]
ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs" / "operations.md"
SYSTEMD = ROOT / "docs" / "how-to" / "systemd.md"
ACCESS = ROOT / "docs" / "how-to" / "control-access.md"
# A package that a daemon does not need is more than 8 MB as a rule.
DAEMON_MB, SMALL_MB = 305, 215
CONFIG = "/etc/ballscrew-observer/observer.toml"
MODULE = """
import asyncio, itertools, random
from pymodbus.server import ModbusTcpServer
from pymodbus.simulator import DataType, SimData, SimDevice

async def answer(function, first, address, count, current, written):
    current[:16] = [word for k in range(8) for word in (0, 230 + k + random.randint(-1, 1))]

async def main():
    device = SimDevice(1, [SimData(0, values=[0] * 16, datatype=DataType.REGISTERS)], action=answer)
    await ModbusTcpServer(device, address=("127.0.0.1", 17502)).serve_forever()

asyncio.run(main())
"""


@pytest.fixture(scope="module")
def computer(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Box]:
    """The computer in the cabinet, with the wheel in its user's home."""
    (wheel,) = (ROOT / "dist").glob("*.whl")
    with box(tmp_path_factory.mktemp("computer"), "sudo", "dbus", "openssl") as made:
        shutil.copy(wheel, f"/proc/{made.first}/root/home/eve")
        yield made


def _lines(section: str, page: Path = PAGE) -> list[str]:
    """The lines of all blocks of text below a heading, the wheel by its name."""
    text = page.read_text(encoding="utf-8").splitlines()
    start = text.index(f"## {section}") + 1
    end = next((k for k, line in enumerate(text[start:], start) if line.startswith("## ")), len(text))
    found = [b for line, language, b in blocks(page) if language == "text" and start < line <= end]
    (wheel,) = (ROOT / "dist").glob("*.whl")
    return [re.sub(r"ballscrew_observer-\S+\.whl", wheel.name, row) for b in found for row in b.splitlines()]


def _shown(computer: Box, begin: str) -> None:
    """Carry out the page's console commands that begin so; what they print is what it shows."""
    found = [c for c in commands(PAGE) if c.text.startswith(begin)]
    assert found, begin
    for command in found:
        printed = computer.does(command.text)
        assert matches(command.expected, printed), f"{command.text}\n{printed}"


def _property(computer: Box, name: str) -> str:
    return computer.does(f"systemctl show ballscrew-observer --value --property={name}").strip()


def _gives_estimates(computer: Box) -> None:
    """Wait until the service is up, as the page describes."""

    def is_good() -> bool:
        assert _property(computer, "ActiveState") != "failed", computer.does(
            "systemctl status -n 40 ballscrew-observer", code=None
        )
        return computer.says("observer health")

    until(is_good, 2 * PATIENCE_S, pause_s=2.0)
    assert _property(computer, "ActiveState") == "active"


@pytest.mark.timeout(3600)
def test_from_the_box_to_a_running_service_and_back(computer: Box) -> None:
    _install_the_program(computer)
    _configure(computer)
    with computer.beside("/opt/pipx/venvs/ballscrew-observer/bin/python module.py"):
        _try_the_wires(computer)
        _install_the_service(computer)
        _live(computer)
        _change_the_configuration(computer)
        _certify(computer)
        _update(computer)
        _remove(computer)
        _serve_two_axes(computer)


def _install_the_program(computer: Box) -> None:
    """With pipx, for all users, no larger than the page says."""
    apt, install, *_ = _lines("Install the program")
    computer.does(apt.replace(" install ", " install -y -qq "), fetches=True)
    computer.does(install, fetches=True)
    assert "ballscrew-observer" in computer.does("observer --version")
    assert _packages_MB(computer) <= DAEMON_MB


def _packages_MB(computer: Box) -> int:
    size = computer.does(
        "cd /opt/pipx/venvs/*/lib/python3*/site-packages && "
        "du -sm --exclude='pip*' --exclude='setuptools*' --exclude=pkg_resources ."
    )
    print(f"\nthe daemon's packages by pipx: {size.split()[0]} MB")
    return int(size.split()[0])


def _configure(computer: Box) -> None:
    """By the page's own commands; nothing answers yet where the module is said to be."""
    _shown(computer, "observer init ")
    _shown(computer, "observer check ")
    computer.does(f"cat >module.py <<'END'\n{MODULE}\nEND")


def _try_the_wires(computer: Box) -> None:
    """Now the module is there."""
    until(lambda: "exit 0" in computer.does("observer check -c observer.toml --wires; echo exit $?"))


def _install_the_service(computer: Box) -> None:
    """The lines wait for nothing, and the service comes up by itself as its own user."""
    computer.does("; ".join(("set -e", *_lines("Install", SYSTEMD))))
    status, health = _lines("Install the service")
    assert "ballscrew-observer.service" in computer.does(status, code=None)
    _gives_estimates(computer)
    document = json.loads(computer.does(f"{health} --json"))
    assert {channel["quality"] for channel in document["channels"].values()} == {"good"}
    whose = "sudo stat --format='%U:%G %a' /etc/ballscrew-observer /var/lib/ballscrew-observer"
    assert computer.does(f"{whose} {CONFIG}").splitlines() == [
        "root:ballscrew 750", "ballscrew:ballscrew 700", "root:ballscrew 640",
    ]  # fmt: skip
    assert computer.does(f"ps -o user= -p {_property(computer, 'MainPID')}").strip() == "ballscrew"
    computer.does("sudo ls /var/lib/ballscrew-observer/recordings | grep -q lathe-7-z")


def _live(computer: Box) -> None:
    """If killed, it restarts; stopped by a problem that a person has to fix, it stays stopped until then."""
    before = _property(computer, "MainPID")
    computer.does("sudo systemctl kill --signal=KILL --kill-whom=main ballscrew-observer")
    until(lambda: _property(computer, "MainPID") not in {before, "0"})
    _gives_estimates(computer)
    computer.does(f"sudo cp {CONFIG} kept.toml && sudo sed -i 's/^length_m = 1.0/length_m = -1.0/' {CONFIG}")
    computer.does("sudo systemctl restart ballscrew-observer", code=1)
    until(lambda: _property(computer, "ActiveState") == "failed")
    assert _property(computer, "ExecMainStatus") == "2"
    assert "length_m" in computer.does("sudo journalctl -u ballscrew-observer -n 5 --no-pager")
    computer.does(f"sudo cp kept.toml {CONFIG} && sudo systemctl restart ballscrew-observer")
    _gives_estimates(computer)


def _change_the_configuration(computer: Box) -> None:
    """It is taken without a restart; a wrong one is refused whole."""
    edit, check, reload = _lines("Change the configuration")
    assert edit == f"sudoedit {CONFIG}"
    process = _property(computer, "MainPID")
    for old, new, code in (("15.0", "-15.0", 2), ("-15.0", "20.0", 0)):
        computer.does(f"sudo sed -i 's/^convection_W_m2K = {old}/convection_W_m2K = {new}/' {CONFIG}")
        computer.does(check, code=code)
        computer.does(reload)
        until(partial(_is_refused, computer, wanted=bool(code)))
    _gives_estimates(computer)
    assert _property(computer, "MainPID") == process


def _is_refused(computer: Box, *, wanted: bool) -> bool:
    """Whether health says, or says no more, that the key is wrong; while it reads again it may not answer."""
    try:
        reasons = json.loads(computer.does("observer health --json", code=None))["reasons"]
    except json.JSONDecodeError:
        return False
    return any("convection_W_m2K" in reason for reason in reasons) == wanted


def _certify(computer: Box) -> None:
    """The page's lines find root and the service as readers, and the day on which a certificate ends."""
    computer.does(
        "openssl req -x509 -newkey ec -pkeyopt ec_paramgen_curve:P-256 -nodes -days 30 -subj /CN=lathe-7 "
        "-keyout service.key -out service.pem && cp service.pem plant.pem"
    )
    install, ends = _lines("Certificates of a service", ACCESS)
    computer.does(install)
    assert "notAfter=" in computer.does(ends)
    computer.does("sudo -u ballscrew cat /etc/ballscrew-observer/service.key")
    computer.does("cat /etc/ballscrew-observer/service.key", code=1)


def _update(computer: Box) -> None:
    """The configuration stays, with a copy beside it; what a small disk has no room for is not missed.

    The page's extras are left out, because the size is that of the daemon alone.
    """
    lines = [line.replace("[page,plant]", "") for line in _lines("Update, and go back")]
    assert len(lines) == 4
    for line in lines:
        computer.does(line, fetches="pipx" in line)
    computer.does(f"sudo cmp {CONFIG} /etc/ballscrew-observer.before-0.2.0/observer.toml")
    computer.does("sudo systemctl stop ballscrew-observer")
    computer.does(_lines("Install the program")[-1])
    assert _packages_MB(computer) <= SMALL_MB
    computer.does("sudo systemctl start --no-block ballscrew-observer")
    _gives_estimates(computer)


def _remove(computer: Box) -> None:
    """The service goes; configuration and recordings stay, and bring it back."""
    computer.does("; ".join(("set -e", *_lines("Remove", SYSTEMD))))
    assert _property(computer, "LoadState") == "not-found"
    computer.does("sudo ls /var/lib/ballscrew-observer/recordings | grep -q lathe-7-z")
    computer.does("; ".join(("set -e", *_lines("Install", SYSTEMD))))
    _gives_estimates(computer)


def _serve_two_axes(computer: Box) -> None:
    """An instance each: the second goes to the first's router, and its page has a port of its own."""
    edits = (
        's/^axis = .*/axis = "y"/', 's/^mode = .*/mode = "client"/', "s/:8080/:8081/",
        's#^listen = .*7447.*#connect = ["tcp/127.0.0.1:7447"]#',
    )  # fmt: skip
    computer.does(f"sed {' '.join('-e ' + shlex.quote(edit) for edit in edits)} observer.toml >y.toml")
    place = "sudo install -o root -g ballscrew -m 0640"
    computer.does(f"{place} observer.toml {Path(CONFIG).with_name('x.toml')}")
    computer.does(f"{place} y.toml {Path(CONFIG).with_name('y.toml')}")
    computer.does("; ".join(("set -e", *_lines("Several axes", SYSTEMD))))
    for axis in "zy":
        until(partial(computer.says, f"observer health --machine lathe-7 --axis {axis}"), 2 * PATIENCE_S, 2.0)
    computer.does("systemctl is-active ballscrew-observer@x ballscrew-observer@y")
    computer.does("sudo ls /var/lib/ballscrew-observer/recordings | grep -q lathe-7-y")
