"""The files that a configuration names: `observer check` looks for each, before the service is started."""

from __future__ import annotations

from pathlib import Path

import pytest

from observer.errors import ConfigError
from observer.installation import load, parse
from observer.installation.examine import examine, paths_in

DEMO = Path(__file__).parents[2] / "config" / "demo.toml"
TABLES = {
    "page.users_file": '[page]\nlisten = "0.0.0.0:8080"\nusers_file = "{}"\n',
    "page.certificate": '[page]\ncertificate = "{}"\nkey = "{here}"\n',
    "mqtt.password_file": '[mqtt]\nuser = "eve"\npassword_file = "{}"\n',
    "mqtt.ca": '[mqtt]\nca = "{}"\n',
    "opcua.key": '[opcua]\nusers_file = "{here}"\ncertificate = "{here}"\nkey = "{}"\n',
    "publish.login.password_file": '[publish.login]\nuser = "eve"\npassword_file = "{}"\n',
}


@pytest.mark.parametrize("key", TABLES)
def test_a_missing_file_is_reported_with_its_key(key, tmp_path):
    here, config = tmp_path / "here", tmp_path / "observer.toml"
    here.write_text("eve:hers\n")
    config.write_text(DEMO.read_text() + TABLES[key].format("/nowhere/it", here=here))
    with pytest.raises(ConfigError, match=f"{key}: /nowhere/it is not a file; correct the path"):
        examine(config)
    config.write_text(DEMO.read_text() + TABLES[key].format(here, here=here))
    examine(config)


def test_an_unreadable_file_is_reported(tmp_path, monkeypatch):
    config = tmp_path / "observer.toml"
    config.write_text(DEMO.read_text() + TABLES["mqtt.ca"].format(config))
    monkeypatch.setattr("os.access", lambda path, mode: path != config)  # root may read everything
    with pytest.raises(ConfigError, match=r"mqtt\.ca: .*observer\.toml cannot be read by this user"):
        examine(config)


def test_folders_are_made_and_need_not_be_there(tmp_path):
    config = tmp_path / "observer.toml"
    config.write_text(DEMO.read_text() + f'[record]\ndirectory = "{tmp_path}/not-there"\n')
    examine(config)


def test_every_path_is_found_with_its_key():
    table = load(DEMO).model_dump(exclude_none=True, by_alias=True)
    table["drivers"]["axis"]["dbc"] = "/etc/axis.dbc"
    table["record"] = {"directory": "recordings"}
    assert dict(paths_in(parse(table))) == {
        "drivers.axis.dbc": Path("/etc/axis.dbc"),
        "record.directory": Path("recordings"),
    }
