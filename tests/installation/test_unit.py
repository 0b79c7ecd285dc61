"""`observer service`: the files of an installation, and what is refused before anything is written."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from observer.errors import UserError
from observer.installation import load, parse, unit
from observer.installation.unit import (
    CONFIG,
    NAME,
    ServiceAxis,
    carry_out,
    refuse_unseen,
    this_program,
    to_install,
    to_remove,
)

DEMO = Path(__file__).parents[2] / "config" / "demo.toml"
SHIPPED = Path(unit.__file__).parent / "systemd" / "ballscrew-observer.service"
PROGRAM = "/usr/local/bin/observer"


@pytest.fixture
def plan():
    return to_install([ServiceAxis(load(DEMO), DEMO, DEMO.read_text())], PROGRAM)


def _tree(root: Path) -> set[str]:
    return {str(path.relative_to(root)) for path in root.rglob("*") if path.is_file()}


def test_it_is_files_in_the_usual_places(plan, tmp_path):
    carry_out(plan, tmp_path)
    assert _tree(tmp_path) == {
        "etc/ballscrew-observer/observer.toml",
        "etc/systemd/system/ballscrew-observer.service",
        "etc/sysusers.d/ballscrew-observer.conf",
        "etc/tmpfiles.d/ballscrew-observer.conf",
    }
    assert (tmp_path / "etc/ballscrew-observer/observer.toml").read_text() == DEMO.read_text()
    unit = (tmp_path / "etc/systemd/system/ballscrew-observer.service").read_text()
    assert re.findall("^ExecStart=(.*)$", unit, re.M) == [f"{PROGRAM} run --config {CONFIG}"]


def test_the_service_may_take_an_adopted_configuration_back(plan, tmp_path):
    carry_out(plan, tmp_path)
    unit = (tmp_path / "etc/systemd/system/ballscrew-observer.service").read_text()
    assert f"ReadWritePaths=-{CONFIG.parent}" in unit
    folders = (tmp_path / "etc/tmpfiles.d/ballscrew-observer.conf").read_text().splitlines()
    assert folders == [f"d {CONFIG.parent} 0770 root ballscrew", f"z {CONFIG} 0640 root ballscrew"]


@pytest.mark.skipif(shutil.which("systemd-analyze") is None, reason="no systemd-analyze")
def test_systemd_finds_nothing_wrong(tmp_path):
    carry_out(to_install([ServiceAxis(load(DEMO), DEMO, DEMO.read_text())], "/bin/true"), tmp_path)
    unit = tmp_path / "etc/systemd/system/ballscrew-observer.service"
    command = ["systemd-analyze", "verify", "--man=no", "--recursive-errors=no", str(unit)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60)
    assert unit.name not in done.stderr, done.stderr


def test_again_is_an_update_and_another_configuration_is_not_overwritten(plan, tmp_path):
    carry_out(plan, tmp_path)
    carry_out(to_install([ServiceAxis(load(DEMO), DEMO, DEMO.read_text())], "/usr/bin/observer"), tmp_path)
    assert "ExecStart=/usr/bin/observer" in (tmp_path / f"etc/systemd/system/{NAME}.service").read_text()
    other = tmp_path / "etc/ballscrew-observer/observer.toml"
    other.write_text("mine")
    with pytest.raises(UserError, match="already exists"):
        carry_out(plan, tmp_path)
    assert other.read_text() == "mine"


def _axis(path: Path, name: str, **tables: Any) -> ServiceAxis:
    table = load(DEMO).model_dump(exclude_none=True, by_alias=True) | tables
    table["machine"] = {"name": name, "axis": "x"}
    return ServiceAxis(parse(table), path / f"{name}.toml", f"# {name}")


CLIENT = {"mode": "client", "connect": ["tcp/127.0.0.1:7447"]}


def test_each_of_several_axes_is_an_instance_of_a_template(tmp_path):
    axes = [_axis(tmp_path, "a"), _axis(tmp_path, "b", publish=CLIENT)]
    both = to_install(axes, PROGRAM, tmp_path)
    folder = CONFIG.parent
    assert both.configurations == [folder / "a-x.toml", folder / "b-x.toml"]
    assert both.after[-1] == ("systemctl", "restart", "--no-block", f"{NAME}@a-x", f"{NAME}@b-x")
    carry_out(both, tmp_path)
    text = (tmp_path / f"etc/systemd/system/{NAME}@.service").read_text()
    assert re.findall("^ExecStart=(.*)$", text, re.M) == [f"{PROGRAM} run --config {folder}/%i.toml"]
    start_s = [
        int(re.findall(r"^TimeoutStartSec=(\d+)$", each, re.M)[0]) for each in (SHIPPED.read_text(), text)
    ]
    assert start_s[1] == 2 * start_s[0], "two axes that start at once share the cores"
    modes = (tmp_path / "etc/tmpfiles.d/ballscrew-observer.conf").read_text()
    assert modes.count(" 0640 root ballscrew") == 2


def test_the_last_installation_replaces_the_one_before(plan, tmp_path):
    carry_out(plan, tmp_path)
    assert not plan.before
    assert not to_install([ServiceAxis(load(DEMO), DEMO, DEMO.read_text())], PROGRAM, tmp_path).before
    axes = [_axis(tmp_path, "a"), _axis(tmp_path, "b", publish=CLIENT)]
    both = to_install(axes, PROGRAM, tmp_path)
    assert both.before == (("systemctl", "disable", "--now", NAME),)
    carry_out(both, tmp_path)
    units = tmp_path / "etc/systemd/system"
    assert [path.name for path in units.iterdir()] == [f"{NAME}@.service"]
    stopped = (("systemctl", "stop", f"{NAME}@*"), ("systemctl", "disable", f"{NAME}@.service"))
    assert to_install(axes, PROGRAM, tmp_path).before == stopped
    removal = to_remove(tmp_path)
    assert removal.before == stopped
    carry_out(removal, tmp_path)
    assert not list(units.iterdir())


def test_two_that_are_the_same_axis_or_listen_at_the_same_address_are_rejected(tmp_path):
    one, two = _axis(tmp_path, "a"), _axis(tmp_path, "b")
    again = ServiceAxis(one.config, tmp_path / "c.toml", "")
    with pytest.raises(UserError, match=r"c\.toml: machine: a/x is already used by .*a\.toml"):
        to_install([one, again], PROGRAM, tmp_path)
    with pytest.raises(
        UserError, match=r"b\.toml: publish\.listen: tcp/127\.0\.0\.1:7447 is already used by .*a\.toml"
    ):
        to_install([one, two], PROGRAM, tmp_path)


@pytest.mark.parametrize("table", ["page", "metrics", "opcua"])
def test_two_whose_pages_or_servers_listen_at_the_same_address_are_rejected(table, tmp_path):
    one, two = (_axis(tmp_path, name, publish=CLIENT, **{table: {}}) for name in ("a", "b"))
    with pytest.raises(
        UserError, match=rf"b\.toml: {table}\.listen: .* is already used by .*a\.toml; .* a port of its own"
    ):
        to_install([one, two], PROGRAM, tmp_path)
    place = "opc.tcp://127.0.0.1:4841" if table == "opcua" else "127.0.0.1:8081"
    other = _axis(tmp_path, "b", publish=CLIENT, **{table: {"listen": place}})
    to_install([one, other], PROGRAM, tmp_path)


def test_a_configuration_that_is_with_the_service_stays_where_it_is():
    there = CONFIG.with_name("lathe.toml")
    assert to_install([ServiceAxis(load(DEMO), there, "")], PROGRAM).files[there] == ""


def test_removing_keeps_the_configuration(plan, tmp_path):
    carry_out(plan, tmp_path)
    carry_out(to_remove(tmp_path), tmp_path)
    assert _tree(tmp_path) == {"etc/ballscrew-observer/observer.toml"}
    carry_out(to_remove(tmp_path), tmp_path)  # nothing left to remove is no error


def test_a_program_of_one_user_is_rejected():
    with pytest.raises(UserError, match="install it for all"):
        refuse_unseen("/home/eve/.local/bin/observer")
    refuse_unseen(PROGRAM)


def test_the_service_starts_what_was_started(monkeypatch):
    monkeypatch.setattr("sys.argv", [PROGRAM, "service"])
    assert this_program() == PROGRAM
    monkeypatch.setattr("sys.argv", ["/src/observer/__main__.py"])
    assert this_program() == f"{sys.executable} -m observer"


@pytest.mark.parametrize(
    ("dbc", "seen"), [("{}/axis.dbc", False), ("/home/eve/axis.dbc", False), (None, True)]
)
def test_a_file_that_the_service_cannot_see_is_rejected(dbc, seen, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "axis.dbc").write_text("")
    table = load(DEMO).model_dump(exclude_none=True, by_alias=True)
    if dbc is not None:
        table["drivers"]["axis"]["dbc"] = "axis.dbc" if "{}" in dbc else dbc
    config = parse(table)
    if seen:
        to_install([ServiceAxis(config, DEMO, "")], PROGRAM)
        return
    with pytest.raises(UserError, match=r"drivers\.axis\.dbc: the service does not see"):
        to_install([ServiceAxis(config, DEMO, "")], PROGRAM)


@pytest.mark.parametrize(
    ("section", "key"),
    [("page", "certificate"), ("page", "reports"), ("mqtt", "password_file"), ("opcua", "certificate")],
)
@pytest.mark.parametrize("file", ["here.pem", "/root/here.pem", "/home/eve"])
def test_no_other_file_is_left_where_the_service_does_not_see_it(section, key, file):
    table = load(DEMO).model_dump(exclude_none=True, by_alias=True)
    complete = {"mqtt": {"user": "eve"}}.get(section, {})
    if section == "opcua":
        complete["users_file"] = "/etc/ballscrew-observer/users"
    if key == "certificate":
        complete["key"] = "/etc/ballscrew-observer/key.pem"
    table[section] = {key: file} | complete
    with pytest.raises(UserError, match=rf"^{section}\.{key}: the service does not see {file}; put it in"):
        to_install([ServiceAxis(parse(table), DEMO, "")], PROGRAM)
    table[section][key] = "/etc/ballscrew-observer/here.pem"
    to_install([ServiceAxis(parse(table), DEMO, "")], PROGRAM)


def test_the_files_of_the_plants_session_are_looked_at():
    table = load(DEMO).model_dump(exclude_none=True, by_alias=True)
    table["publish"] = {"listen": ["tls/127.0.0.1:7447"], "tls": {"certificate": "s.pem", "key": "s.key"}}
    with pytest.raises(UserError, match=r"publish\.tls\.certificate: the service does not see s.pem"):
        to_install([ServiceAxis(parse(table), DEMO, "")], PROGRAM)


@pytest.mark.parametrize(
    ("directory", "seen"), [("recordings", True), ("/srv/logs", True), ("/home/eve", False)]
)
def test_recordings_may_lie_in_the_services_own_folder(directory, seen):
    table = load(DEMO).model_dump(exclude_none=True, by_alias=True)
    table["record"] = {"directory": directory}
    if seen:
        to_install([ServiceAxis(parse(table), DEMO, "")], PROGRAM)
        return
    with pytest.raises(UserError, match=r"record\.directory: the service does not see /home/eve"):
        to_install([ServiceAxis(parse(table), DEMO, "")], PROGRAM)


def test_only_root_changes_the_system(plan, monkeypatch):
    monkeypatch.setattr("os.geteuid", lambda: 1000)
    with pytest.raises(UserError, match="sudo"):
        carry_out(plan, Path("/"))


def test_a_failed_command_is_reported_with_its_last_line(plan, monkeypatch, tmp_path):
    with pytest.raises(UserError, match=r"sh -c .* failed: no bus"):
        unit._run((("sh", "-c", "echo no bus >&2; exit 3"),))
    with pytest.raises(UserError, match="systemd is needed"):
        unit._run((("no-such-program-here",),))


def test_a_dry_run_lists_what_would_be_done(plan):
    lines = list(plan.lines())
    assert f"write  {CONFIG}" in lines
    assert lines[-1] == f"run    systemctl restart --no-block {NAME}"
