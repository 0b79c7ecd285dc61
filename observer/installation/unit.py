"""Install the service with systemd, or remove it.

An installation is nothing but files, made from those in `systemd/`; systemd's own tools create the user, the
folders and the running service from them.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path

from observer.errors import UserError
from observer.installation import Installation
from observer.installation.examine import paths_in

NAME = "ballscrew-observer"
CONFIG = Path("/etc") / NAME / "observer.toml"
STATE = Path("/var/lib") / NAME
_UNIT = Path("/etc/systemd/system") / f"{NAME}.service"
_USER = Path("/etc/sysusers.d") / f"{NAME}.conf"
_FOLDERS = Path("/etc/tmpfiles.d") / f"{NAME}.conf"
_HIDDEN = ("/home/", "/root/", "/run/user/", "/tmp/", "/var/tmp/")  # from the service, by its unit
_EXEC_START = re.compile(r"^ExecStart=.*$", re.M)
_MEMORY = re.compile(r"^MemoryMax=(\d+)M$", re.M)
_AXIS_MB = 300  # for each further axis, with what it may keep
_COMMAND_S = 120.0
_PACKAGES = Path(__file__).parents[2]


@dataclass(frozen=True, slots=True)
class ServicePlan:
    """Files with their content (None: to be removed), and the commands to run before and after."""

    files: dict[Path, str | None]
    before: tuple[tuple[str, ...], ...]
    after: tuple[tuple[str, ...], ...]

    @property
    def configurations(self) -> list[Path]:
        """The configurations among the files that are written."""
        return [path for path, content in self.files.items() if path.parent == CONFIG.parent]

    def lines(self) -> Iterator[str]:
        """The plan in words, a line for each file and command."""
        for command in self.before:
            yield "run    " + " ".join(command)
        for path, content in self.files.items():
            yield f"{'remove' if content is None else 'write '} {path}"
        for command in self.after:
            yield "run    " + " ".join(command)


def this_program() -> str:
    """How this program was started, as a service starts it."""
    started = Path(sys.argv[0]).absolute()
    return f"{sys.executable} -m observer" if started.name == "__main__.py" else str(started)


def refuse_unseen(program: str) -> None:
    """Raise `UserError` where the service could not see the program."""
    if program.startswith(_HIDDEN):
        raise UserError(
            f"service: {program} belongs to one user, and the service does not see it; install it for all: "
            "sudo PIPX_HOME=/opt/pipx PIPX_BIN_DIR=/usr/local/bin pipx install ballscrew-observer"
        )


@dataclass(frozen=True, slots=True)
class ServiceAxis:
    """An axis to serve: its configuration, and the file and text it came from."""

    config: Installation
    path: Path
    text: str


def to_install(axes: Sequence[ServiceAxis], program: str) -> ServicePlan:
    """The installation of the service for one axis or several, run by `program`.

    Raises `UserError` where the service could not see a file that it needs.
    """
    placed = {_place(axis, alone=len(axes) == 1): axis for axis in axes}
    for axis in axes:
        _files_are_seen(axis.config)
    options = " ".join(f"--config {path}" for path in placed)
    unit = _EXEC_START.sub(lambda _: f"ExecStart={program} run {options}", _shipped(f"{NAME}.service"))
    unit = _MEMORY.sub(lambda one: f"MemoryMax={int(one[1]) + _AXIS_MB * (len(axes) - 1)}M", unit)
    # systemd-tmpfiles touches no file of root's in a folder that belongs to somebody else
    modes = "".join(f"z {path} 0640 root ballscrew\n" for path in placed)
    content: dict[Path, str | None] = {path: axis.text for path, axis in placed.items()}
    content |= {_UNIT: unit, _USER: _shipped("sysusers.conf"), _FOLDERS: _shipped("tmpfiles.conf") + modes}
    return ServicePlan(
        content,
        (),
        (
            ("systemd-sysusers", str(_USER)),
            ("systemd-tmpfiles", "--create", str(_FOLDERS)),
            ("systemctl", "daemon-reload"),
            ("systemctl", "enable", NAME),
            ("systemctl", "restart", "--no-block", NAME),  # many axes start in turn
        ),
    )


def _place(axis: ServiceAxis, *, alone: bool) -> Path:
    """Where the service reads an axis: where the file is, if it is with the service already."""
    if axis.path.absolute().parent == CONFIG.parent:
        return axis.path.absolute()
    machine = axis.config.machine
    return CONFIG if alone else CONFIG.with_name(f"{machine.name}-{machine.axis}.toml")


def to_remove() -> ServicePlan:
    """What takes the service away; configuration, recordings and user stay."""
    return ServicePlan(
        dict.fromkeys((_UNIT, _USER, _FOLDERS)),
        (("systemctl", "disable", "--now", NAME),),
        (("systemctl", "daemon-reload"),),
    )


def carry_out(plan: ServicePlan, root: Path) -> None:
    """Do it below `root`; commands are run only where that is the system itself.

    Raises `UserError` where a file cannot be written, a command fails, or another configuration is there.
    """
    live = root == Path("/")
    if live and os.geteuid() != 0:
        raise UserError("service: only root may do this; write sudo before it, or look with --dry-run")
    for path in plan.configurations:
        _not_another(root / path.relative_to("/"), plan.files[path])
    if live:
        _run(plan.before)
    for path, content in plan.files.items():
        _put(root / path.relative_to("/"), content)
    if live:
        _run(plan.after)


def _not_another(there: Path, text: str | None) -> None:
    if there.exists() and there.read_text(encoding="utf-8") != text:
        raise UserError(
            f"service: {there} is there already and is another one; give it with --config, or move it away"
        )


def _put(path: Path, content: str | None) -> None:
    try:
        if content is None:
            path.unlink(missing_ok=True)
            return
        path.parent.mkdir(parents=True, exist_ok=True)
        if not path.exists() or path.read_text(encoding="utf-8") != content:
            path.write_text(content, encoding="utf-8")
    except OSError as error:
        raise UserError(f"service: {path} cannot be written ({error.strerror})") from None


def _run(commands: tuple[tuple[str, ...], ...]) -> None:
    for command in commands:
        try:
            done = subprocess.run(command, capture_output=True, text=True, timeout=_COMMAND_S, check=False)
        except (OSError, subprocess.TimeoutExpired) as error:
            raise UserError(f"service: {' '.join(command)}: {error}; systemd is needed here") from None
        if done.returncode:
            last = (done.stderr.strip().splitlines() or ["no word"])[-1]
            raise UserError(f"service: {' '.join(command)} failed: {last}; see journalctl -u {NAME}")


def _files_are_seen(config: Installation) -> None:
    """The service starts in its state's folder, so a file by a relative path is not where it was."""
    for key, path in paths_in(config):
        folder = key.endswith(".directory")
        if not path.is_absolute() and (folder or (_PACKAGES / path).exists()):
            continue  # a folder that it makes there, or a file that comes with the drivers
        if not path.is_absolute() or f"{path}/".startswith(_HIDDEN):
            remedy = (
                f"write a name alone, for a folder in {STATE}"
                if folder
                else f"put it into {CONFIG.parent} and write its whole path"
            )
            raise UserError(f"{key}: the service does not see {path}; {remedy}")


def _shipped(name: str) -> str:
    """The text of a file in `systemd/`."""
    return (files("observer.installation") / "systemd" / name).read_text(encoding="utf-8")
