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
from observer.installation.examine import examine, paths_in

NAME = "ballscrew-observer"
CONFIG = Path("/etc") / NAME / "observer.toml"
STATE = Path("/var/lib") / NAME
_UNIT = Path("/etc/systemd/system") / f"{NAME}.service"
_TEMPLATE = _UNIT.with_name(f"{NAME}@.service")
_USER = Path("/etc/sysusers.d") / f"{NAME}.conf"
_FOLDERS = Path("/etc/tmpfiles.d") / f"{NAME}.conf"
_HIDDEN = ("/home/", "/root/", "/run/user/", "/tmp/", "/var/tmp/")  # from the service, by its unit
_EXEC_START = re.compile(r"^ExecStart=.*$", re.M)
_START = re.compile(r"^TimeoutStartSec=(\d+)$", re.M)
_COMMAND_S = 120.0
_PACKAGES = Path(__file__).parents[2]
Command = tuple[str, ...]


def service(config_paths: Sequence[Path], root: Path, *, dry_run: bool) -> Iterator[str]:
    """Install the service of one axis or several, without any remove it; yields what is done, in words."""
    here = root == Path("/")
    if not config_paths:
        plan = to_remove(root)
    else:
        program = this_program()
        if here and not dry_run:
            refuse_unseen(program)
        axes = [
            ServiceAxis(examine(path, runs_here=here), path, path.read_text(encoding="utf-8"))
            for path in config_paths
        ]
        plan = to_install(axes, program, root)
    if dry_run:
        yield from plan.lines()
        return
    carry_out(plan, root)
    yield from (
        plan.lines()
        if here
        else (f"{'written' if config_paths else 'removed'} below {root}; nothing was run",)
    )
    if not config_paths:
        yield f"kept: {CONFIG.parent} and {STATE}"
        return
    yield f"from now on edit {', '.join(str(path) for path in plan.configurations)}"
    if here:
        yield f"it starts: journalctl -fu {NAME}, then observer health"


@dataclass(frozen=True, slots=True)
class ServicePlan:
    """Files with their content (None: to be removed), and the commands to run before and after."""

    files: dict[Path, str | None]
    before: tuple[Command, ...]
    after: tuple[Command, ...]

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


def to_install(axes: Sequence[ServiceAxis], program: str, root: Path = Path("/")) -> ServicePlan:
    """The installation of a service for one axis, or of an instance of its template for each of several.

    It replaces an earlier installation below `root`. Raises `UserError` where the service could not see a
    file that it needs, or two axes have the same name or listen at the same address.
    """
    _refuse_conflicts(axes)
    for axis in axes:
        _files_are_seen(axis.config)
    alone = len(axes) == 1
    placed = {_place(axis, alone=alone): axis for axis in axes}
    unit, reads = (_UNIT, next(iter(placed))) if alone else (_TEMPLATE, CONFIG.with_name("%i.toml"))
    services = [NAME] if alone else [f"{NAME}@{path.stem}" for path in placed]
    removed, before = _earlier(root, unit)
    # systemd-tmpfiles touches no file of root's in a folder that belongs to somebody else
    modes = "".join(f"z {path} 0640 root ballscrew\n" for path in placed)
    content: dict[Path, str | None] = {path: axis.text for path, axis in placed.items()}
    text = _EXEC_START.sub(lambda _: f"ExecStart={program} run --config {reads}", _shipped(f"{NAME}.service"))
    # all axes start at once after a power cut, and each needs some seconds of a core
    content[unit] = _START.sub(lambda one: f"TimeoutStartSec={int(one[1]) * len(axes)}", text)
    content |= {_USER: _shipped("sysusers.conf"), _FOLDERS: _shipped("tmpfiles.conf") + modes}
    return ServicePlan(
        content | removed,
        before,
        (
            ("systemd-sysusers", str(_USER)),
            ("systemd-tmpfiles", "--create", str(_FOLDERS)),
            ("systemctl", "daemon-reload"),
            ("systemctl", "enable", *services),
            ("systemctl", "restart", "--no-block", *services),
        ),
    )


def _refuse_conflicts(axes: Sequence[ServiceAxis]) -> None:
    """Raise `UserError` where two axes have the same name or listen at the same address."""
    taken: dict[str, Path] = {}
    for axis in axes:
        config = axis.config
        claims = {f"{config.machine.name}/{config.machine.axis}": "machine"}
        claims |= dict.fromkeys(config.publish.listens, "publish.listen")
        for key in ("page", "metrics", "opcua"):
            if (table := getattr(config, key)) is not None:
                claims[table.listen] = f"{key}.listen"
        for claim, key in claims.items():
            if (other := taken.setdefault(claim, axis.path)) is not axis.path:
                raise UserError(f"{axis.path}: {key}: {claim} is already used by {other}; {_REMEDY[key]}")


_OWN_PORT = "give each axis a port of its own"
_REMEDY = {
    "machine": "give each axis a name of its own",
    "publish.listen": "let one of them, or a router, listen there; the others connect to it "
    'with mode = "client"',
    "page.listen": _OWN_PORT,
    "metrics.listen": _OWN_PORT,
    "opcua.listen": _OWN_PORT,
}


def _place(axis: ServiceAxis, *, alone: bool) -> Path:
    """Where the service reads an axis: where the file is, if it is with the service already."""
    path, machine = axis.path.absolute(), axis.config.machine
    if path.parent == CONFIG.parent and path.suffix == ".toml":
        return path
    return CONFIG if alone else CONFIG.with_name(f"{machine.name}-{machine.axis}.toml")


def to_remove(root: Path = Path("/")) -> ServicePlan:
    """What takes the service away; configuration, recordings and user stay."""
    removed, before = _earlier(root)
    return ServicePlan(removed | dict.fromkeys((_USER, _FOLDERS)), before, (("systemctl", "daemon-reload"),))


def _earlier(root: Path, kept: Path | None = None) -> tuple[dict[Path, str | None], tuple[Command, ...]]:
    """The units that are installed, to be removed unless `kept`, and the commands that stop them.

    The template's instances are always stopped: they are those of the earlier installation.
    """
    units = [unit for unit in (_UNIT, _TEMPLATE) if (root / unit.relative_to("/")).exists()]
    before: list[Command] = []
    if _UNIT in units and kept != _UNIT:
        before.append(("systemctl", "disable", "--now", NAME))
    if _TEMPLATE in units:
        before += [("systemctl", "stop", f"{NAME}@*"), ("systemctl", "disable", _TEMPLATE.name)]
    return {unit: None for unit in units if unit != kept}, tuple(before)


def carry_out(plan: ServicePlan, root: Path) -> None:
    """Do it below `root`; commands are run only where that is the system itself.

    Raises `UserError` where a file cannot be written, a command fails, or another configuration is there.
    """
    live = root == Path("/")
    if live and os.geteuid() != 0:
        raise UserError("service: only root may do this; run it with sudo, or preview it with --dry-run")
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
            f"service: {there} already exists and is different; give it with --config, or move it away"
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


def _run(commands: tuple[Command, ...]) -> None:
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
                f"give a name without a path, for a folder in {STATE}"
                if folder
                else f"put it in {CONFIG.parent} and give its full path"
            )
            raise UserError(f"{key}: the service does not see {path}; {remedy}")


def _shipped(name: str) -> str:
    """The text of a file in `systemd/`."""
    return (files("observer.installation") / "systemd" / name).read_text(encoding="utf-8")
