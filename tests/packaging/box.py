"""A computer of its own for a test, with a systemd that runs and an ordinary user; see `box.sh`."""

from __future__ import annotations

import os
import shutil
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import pytest

from tests.packaging.network import of_network
from tests.patience import until

_BOOTED = {"running", "degraded"}
_LONGEST_S = 900.0  # a line that fetches and installs packages
_SCRIPT = Path(__file__).with_name("box.sh")
_SBIN = "/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin"


@dataclass(frozen=True, slots=True)
class Box:
    """A booted box, by the number of its first process."""

    first: int

    def does(self, line: str, *, code: int | None = 0, fetches: bool = False) -> str:
        """Carry a line out as its user, at home; returns what was printed.

        `fetches` gives that line the network of this computer. Fails the test where it ends with another
        code than `code`, None for any.
        """
        done = subprocess.run(
            [*self._enter(fetches), "/bin/sh", "-c", line],
            stdin=subprocess.DEVNULL, capture_output=True, text=True, timeout=_LONGEST_S,
        )  # fmt: skip
        assert code is None or done.returncode == code, (
            f"$ {line}\n{done.stdout}{done.stderr}exit code {done.returncode}\n{self._journal()}"
        )
        return done.stdout + done.stderr

    def says(self, line: str) -> bool:
        """Whether a line ends with 0."""
        return self.does(f"{line} >/dev/null 2>&1; echo $?", code=None).strip() == "0"

    @contextmanager
    def beside(self, line: str) -> Iterator[None]:
        """Have a line run beside what is done meanwhile."""
        with subprocess.Popen(
            [*self._enter(), "/bin/sh", "-c", f"exec {line}"], stdin=subprocess.DEVNULL
        ) as process:
            try:
                yield
            finally:
                process.kill()

    def _enter(self, fetches: bool = False) -> list[str]:
        who = [f"{name}={value}" for name, value in of_network().items()]
        where = ["--mount", "--pid", "--uts", "--ipc", *(() if fetches else ("--net",)), "--root", "--wd"]
        return [
            "/usr/bin/nsenter", "--target", str(self.first), *where, "--",
            "/usr/sbin/runuser", "-u", "eve", "--",
            "/usr/bin/env", "-i", "-C", "/home/eve", "HOME=/home/eve", "LANG=C.UTF-8", f"PATH={_SBIN}",
            "COLUMNS=110", *who,
        ]  # fmt: skip

    def _journal(self) -> str:
        command = [*self._enter(), "sudo", "journalctl", "--no-pager", "--lines=40", "--boot"]
        return subprocess.run(command, capture_output=True, text=True).stdout


@contextmanager
def box(place: Path, *packages: str) -> Iterator[Box]:
    """Furnish a box with Debian's packages, boot it, and end it; skips the test where that cannot be."""
    missing = [
        name
        for name in ("unshare", "nsenter", "findmnt", "apt-get")
        if shutil.which(name, path=_SBIN) is None
    ]
    if os.geteuid() != 0 or missing or not Path("/lib/systemd/systemd").exists():
        pytest.skip(f"needs root, systemd and {', '.join(missing) or 'namespaces'}")
    with (place / "log").open("w") as log, subprocess.Popen(
        [str(_SCRIPT), str(_made(place / "box")), *packages],
        stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=log, text=True,
    ) as process:  # fmt: skip
        assert process.stdout is not None
        said = [process.stdout.readline().strip() for _ in range(2)]
        if said[0] != "furnished" or not said[1].isdigit():
            process.kill()
            pytest.skip(f"no box can be made here: {(place / 'log').read_text()[-500:]}")
        made = Box(int(said[1]))
        try:
            # until then its files are this computer's
            until(lambda: Path(f"/proc/{made.first}/comm").read_text().strip() == "systemd")
            until(lambda: made.does("systemctl is-system-running", code=None).strip() in _BOOTED)
            yield made
        finally:
            assert process.stdin is not None
            process.stdin.close()  # for it, the end


def _made(folder: Path) -> Path:
    folder.mkdir()
    return folder
