"""The lines of docs/operations.md that install, update and go back with pipx: `make pipx-check`.

They are read from the page and carried out below a folder, without `sudo`; pipx fetches the daemon's packages
from a package index. What only a running systemd can do is not here: `systemctl`, and an installation of the
service without `--root`.
"""

from __future__ import annotations

import os
import re
import shlex
import subprocess
from pathlib import Path

import pytest

from tests.docs.console import blocks
from tests.patience import COMPILE_S

pytestmark = [pytest.mark.system, pytest.mark.slow]
ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs" / "operations.md"
TOLD = [line for _, language, body in blocks(PAGE) if language == "text" for line in body.splitlines()]
DAEMON_MB = 500  # the page says 492; a package that a daemon does not need is more than 8 MB as a rule


class Computer:
    """A folder that stands for the root of a computer."""

    def __init__(self, root: Path, wheel: Path) -> None:
        self.root, self.wheel = root, wheel
        self.observer = root / "usr/local/bin/observer"
        self._environment = {k: v for k, v in os.environ.items() if k != "PYTHONPATH"} | {
            "HOME": str(root),
            "PATH": f"{self.observer.parent}:{Path(os.environ['PIPX']).parent}:/usr/bin:/bin",
        }
        self.observer.parent.mkdir(parents=True)

    def does(self, line: str) -> str:
        """Carry a line of the page out; returns what it printed."""
        line = re.sub(r"/(?=(?:opt/pipx|usr/local/bin|etc/ballscrew-observer)\b)", f"{self.root}/", line)
        line = re.sub(
            r"\S*ballscrew_observer-\S+\.whl", shlex.quote(str(self.wheel)), line.removeprefix("sudo ")
        )
        if line.startswith("observer service install"):
            line += f" --root {shlex.quote(str(self.root))}"
        done = subprocess.run(
            ["/bin/sh", "-c", line], cwd=self.root, env=self._environment, stdin=subprocess.DEVNULL,
            capture_output=True, text=True, timeout=COMPILE_S,
        )  # fmt: skip
        assert done.returncode == 0, f"{line}\n{done.stdout}{done.stderr}"
        return done.stdout


@pytest.fixture(scope="module")
def computer(tmp_path_factory) -> Computer:
    """A computer after the page's line that installs the program."""
    (wheel,) = (ROOT / "dist").glob("*.whl")
    made = Computer(tmp_path_factory.mktemp("computer"), wheel)
    (line,) = [line for line in TOLD if "pipx install ./" in line]
    made.does(line)
    return made


def _all_of(section: str) -> list[str]:
    """The lines of the first block of text below a heading."""
    start = PAGE.read_text(encoding="utf-8").splitlines().index(f"## {section}") + 1
    return next(b for line, language, b in blocks(PAGE) if language == "text" and line > start).splitlines()


@pytest.mark.timeout(2 * COMPILE_S)
class TestByPipx:
    """In the page's order; the program is installed once for all of these."""

    def test_the_program_is_there_for_all_users(self, computer: Computer) -> None:
        version = re.search(r'^version = "(.*)"', (ROOT / "pyproject.toml").read_text(), flags=re.M)
        assert version is not None
        assert version[1] in computer.does("observer --version")
        assert computer.observer.resolve().is_relative_to(computer.root / "opt/pipx")

    def test_it_takes_what_the_page_says_on_disk(self, computer: Computer) -> None:
        (packages,) = (computer.root / "opt/pipx/venvs").glob("*/lib/python3*/site-packages")
        command = ["du", "-sm", "--exclude=pip*", "--exclude=setuptools*", "."]
        told = subprocess.run(command, cwd=packages, capture_output=True, text=True, check=True).stdout
        print(f"\nthe daemon's packages by pipx: {told.split()[0]} MB")
        assert int(told.split()[0]) <= DAEMON_MB

    def test_the_service_starts_what_pipx_installed(self, computer: Computer) -> None:
        computer.does(
            "observer init --machine lathe-7 --axis z --screw 40x10 --length-m 1.0 --stroke-m 0.15,0.80"
            " --sensors-m 0.05,0.28,0.50,0.72,0.95 --module wago_750_458 --module-at 127.0.0.1:17502"
            " --ambient 21.5 --control none"
        )
        install, *_ = _all_of("Install the service")
        computer.does(install)
        unit = (computer.root / "etc/systemd/system/ballscrew-observer.service").read_text()
        assert f"ExecStart={computer.observer} run " in unit

    def test_an_update_keeps_the_configuration(self, computer: Computer) -> None:
        before = (computer.root / "etc/ballscrew-observer/observer.toml").read_text()
        lines = _all_of("Update, and go back")
        assert len(lines) == 4
        for line in lines:
            computer.does(line)
        assert (computer.root / "etc/ballscrew-observer/observer.toml").read_text() == before
        assert (computer.root / "etc/ballscrew-observer.before/observer.toml").read_text() == before
