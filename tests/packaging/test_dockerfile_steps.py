"""The Dockerfile's own steps in a clean environment, as an unprivileged user, below a read-only root.

No container engine is needed: `dockerfile.py` carries the instructions out below a temporary directory that
stands for the image's root. `docs/how-to/containers.md` says what this shows and what it cannot.
"""

from __future__ import annotations

import os
import pwd
import re
import shutil
import signal
import stat
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.bus.router import free_port
from tests.logs.machines import machine_text
from tests.packaging.dockerfile import Machine, Step, carry_out, parse
from tests.packaging.network import of_network
from tests.patience import PATIENCE_S, until

ROOT = Path(__file__).parents[2]
STEPS = parse(ROOT / "Dockerfile")
# A Python that makes environments, and has the headers to build with.
FIT = """
import ensurepip, os, sys, sysconfig
sys.exit(sys.version_info < (3, 11) or not os.path.exists(sysconfig.get_path("include") + "/Python.h"))
"""
COMPILERS = re.compile(r"^(.*-)?(cc|gcc|clang|g\+\+|c\+\+|c89|c99|cpp|ld)(-[\d.]+)?$")

BEARING = machine_text("bearing", source__0__speed_channel=None, source__0__heat_W_rpm=None, sensor__1=None)
CONFIG = """
[estimator]
period_s = 0.1
[drivers.log]
kind = "player"
path = "{log}"
[publish]
mode = "router"
listen = ["{endpoint}"]
[record]
directory = "{recordings}"
"""


def _only(word: str) -> Step:
    """The last instruction of this kind, the one in force."""
    return [s for s in STEPS if s.word == word][-1]


def test_the_image_runs_as_a_numbered_user_without_rights() -> None:
    uid = _only("USER").text.split(":")[0]
    assert uid.isdigit(), "a name cannot be checked by an orchestrator's runAsNonRoot; give a number"
    assert int(uid) >= 10000, "low numbers belong to users of the host"


def test_nothing_is_installed_that_is_not_locked() -> None:
    for step in STEPS:
        if step.word == "RUN" and re.search(r"pip\b.* install ", step.text):
            assert "--require-hashes" in step.text or "--no-deps" in step.text, step.text


@pytest.fixture(scope="module")
def machine() -> Iterator[Machine]:
    """The image's root after all build steps, nothing below it writable but its volumes."""
    uid, gid = os.geteuid(), os.getegid()
    interpreter = Path(getattr(sys, "_base_executable", sys.executable))
    if uid == 0:
        nobody = pwd.getpwnam("nobody")
        uid, gid = nobody.pw_uid, nobody.pw_gid
        interpreter = _interpreter_for(uid, gid, interpreter)
    root = Path(tempfile.mkdtemp(prefix="image-"))
    root.chmod(0o755)
    try:
        environment = of_network() | {
            "PATH": str(_programs_of_the_base(root.with_name(f"{root.name}-bin"), interpreter)),
            "HOME": "/nonexistent",
            "LANG": "C.UTF-8",
        }
        image = Machine(root, ROOT, uid, gid, environment)
        for name in ("", "tmp", "var", "opt"):
            (root / name).mkdir(exist_ok=True)
            os.chown(root / name, uid, gid)
        (root / "var" / "lib").mkdir()
        os.chown(root / "var" / "lib", uid, gid)
        carry_out(STEPS, image)
        (root / "tmp").mkdir(exist_ok=True)  # every stage begins with the base's own
        os.chown(root / "tmp", uid, gid)
        image.directory = "/"
        _read_only(root, [root / v.strip("/") for v in _only("VOLUME").words()] + [root / "tmp"])
        yield image
    finally:
        _writable_again(root)
        shutil.rmtree(root)
        shutil.rmtree(root.with_name(f"{root.name}-bin"), ignore_errors=True)


def _programs_of_the_base(folder: Path, interpreter: Path) -> Path:
    """The interpreter as python3, and the programs of this machine but for C compilers: the base has none."""
    folder.mkdir()
    folder.chmod(0o755)
    (folder / "python3").symlink_to(interpreter)
    for program in Path("/usr/bin").iterdir():
        if not COMPILERS.search(program.name) and program.name != "python3":
            (folder / program.name).symlink_to(program)
    return folder


def _interpreter_for(uid: int, gid: int, preferred: Path) -> Path:
    """A Python >= 3.11 that the unprivileged user may run."""
    for candidate in (preferred, Path("/usr/local/bin/python3"), Path("/usr/bin/python3")):
        try:
            done = subprocess.run(
                [str(candidate), "-c", FIT],
                user=uid, group=gid, extra_groups=[], capture_output=True, timeout=PATIENCE_S,
                check=False, cwd="/",
            )  # fmt: skip
        except OSError:
            continue
        if done.returncode == 0:
            return candidate
    pytest.skip(
        "run as root, and no Python >= 3.11 with venv and headers is open to the user nobody on this machine"
    )


def _read_only(root: Path, but: list[Path]) -> None:
    for path in root.rglob("*"):
        if not path.is_symlink() and not any(path == b or b in path.parents for b in but):
            path.chmod(path.stat().st_mode & ~0o222)
    root.chmod(0o555)


def _writable_again(root: Path) -> None:
    root.chmod(0o755)
    for path in root.rglob("*"):
        if path.is_dir() and not path.is_symlink():
            path.chmod(path.stat().st_mode | stat.S_IRWXU)


@pytest.fixture(scope="module")
def service(machine: Machine) -> Iterator[tuple[subprocess.Popen[bytes], str]]:
    """The daemon below the read-only root, fed by a player; and where it listens."""
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    volume = machine.root / "var/lib/observer"
    log = machine.root / "tmp/log.csv"
    log.write_text(
        "time_s,t1_degC\n" + "".join(f"{0.1 * k:.1f},{20 + 0.01 * (k % 7):.2f}\n" for k in range(12_000))
    )
    configuration = machine.root / "tmp/observer.toml"
    configuration.write_text(BEARING + CONFIG.format(log=log, endpoint=endpoint, recordings=volume))
    words = [*_only("ENTRYPOINT").words(), "run", "--config", str(configuration)]
    process = subprocess.Popen(
        [str(machine.root / "opt/observer/bin" / words[0]), *words[1:]],
        stdout=subprocess.PIPE, stderr=subprocess.STDOUT, **machine.identity(),
    )  # fmt: skip
    try:
        yield process, endpoint
    finally:
        if process.poll() is None:
            process.kill()
        process.communicate()


def _observer(machine: Machine, *words: str) -> subprocess.CompletedProcess[str]:
    return machine.run([str(machine.root / "opt/observer/bin/observer"), *words], timeout_s=PATIENCE_S)


@pytest.mark.system
@pytest.mark.slow
@pytest.mark.timeout(1800)
class TestBuiltImage:
    """What the built image does; its steps are carried out once for all of these."""

    def test_all_build_steps_work_as_an_unprivileged_user(self, machine: Machine) -> None:
        print("\n".join(machine.log))
        assert machine.uid != 0
        assert len(machine.log) == sum(s.word == "RUN" for s in STEPS)
        refused = machine.run(["/bin/sh", "-c", f"touch {machine.root}/opt/observer/x"])
        assert refused.returncode != 0, "the root is not read-only, so the rest would show nothing"

    def test_commands_work_below_a_read_only_root(self, machine: Machine) -> None:
        done = _observer(machine, "check", "--config", str(machine.root / "config/kim-screw.toml"))
        assert done.returncode == 0, done.stdout + done.stderr

    def test_a_missing_configuration_is_one_sentence(self, machine: Machine) -> None:
        done = _observer(machine, *[machine.moved(w) for w in _only("CMD").words()])
        assert done.returncode == 2, done.stdout + done.stderr
        assert "observer.toml" in done.stderr
        assert "Traceback" not in done.stderr

    def test_the_health_check_distinguishes_a_living_service_from_a_dead_one(
        self, machine: Machine, service: tuple[subprocess.Popen[bytes], str]
    ) -> None:
        process, endpoint = service
        probe = _only("HEALTHCHECK").text.split("CMD", 1)[1].strip()
        words = [*Step("CMD", probe).words()[1:], "--connect", endpoint]

        def is_healthy() -> bool:
            done = _observer(machine, *words)
            assert process.poll() is None, process.communicate()[0].decode() + done.stdout + done.stderr
            return done.returncode == 0

        until(is_healthy, 2 * PATIENCE_S, pause_s=0.5)
        process.send_signal(getattr(signal, _only("STOPSIGNAL").text))
        assert process.wait(PATIENCE_S) == 0
        assert _observer(machine, *words).returncode == 1
        assert list((machine.root / "var/lib/observer").iterdir()), "nothing was recorded in the volume"
