"""A found configuration takes the place of the one that was searched, and nothing is lost by it."""

from __future__ import annotations

import json
import stat
from pathlib import Path

import pytest
import tomlkit

from observer.errors import UserError
from observer.files import folders
from observer.installation import adopt as adopting
from observer.installation.adopt import adopt, adoption_of, before_of, sha256, undo
from tests.logs.machines import table


@pytest.fixture
def config(tmp_path: Path) -> Path:
    path = tmp_path / "machine.toml"
    path.write_text("# by hand\n" + tomlkit.dumps(table()), encoding="utf-8")
    path.chmod(0o640)
    return path


@pytest.fixture
def found(tmp_path: Path, config: Path) -> Path:
    """What a search has written: the configuration with an effect more."""
    folder = tmp_path / "found"
    folder.mkdir()
    text = config.read_text(encoding="utf-8")
    text += '\n[[effect]]\nkind = "end_conduction"\ntarget = "left"\nconductance_W_K = 0.4\n'
    (folder / "config.toml").write_text(text, encoding="utf-8")
    _result(folder, verdict="named", config_sha256=sha256(config))
    return folder


def _result(folder: Path, **document: object) -> None:
    (folder / "result.json").write_text(json.dumps(document), encoding="utf-8")


def _refused(found: Path, config: Path) -> str:
    """Why it is refused; nothing has changed then."""
    before = {p.name: p.read_bytes() for p in config.parent.iterdir() if p.is_file()}
    with pytest.raises(UserError) as refused:
        adopt(found, config, 1e9)
    assert {p.name: p.read_bytes() for p in config.parent.iterdir() if p.is_file()} == before
    sentence = str(refused.value)
    assert "\n" not in sentence
    return sentence


def test_the_found_one_is_in_place_and_the_one_before_beside_it(found, config):
    text = config.read_bytes()
    adoption = adopt(found, config, 1.79e9)
    assert config.read_bytes() == (found / "config.toml").read_bytes()
    assert before_of(config, adoption).read_bytes() == text
    assert adoption_of(config) == adoption
    assert (adoption.state, adoption.adopted_s) == ("adopted", 1.79e9)
    for path in (config, before_of(config, adoption), config.with_name("machine.toml.adopted.json")):
        assert stat.S_IMODE(path.stat().st_mode) == 0o640, path  # a service of another user can read them


def test_it_is_reverted_completely(found, config):
    text = config.read_bytes()
    adopt(found, config, 1.79e9)
    assert undo(config).state == "undone"
    assert config.read_bytes() == text
    assert adoption_of(config).state == "undone"
    with pytest.raises(UserError, match="undone since; to have it again, adopt its folder again"):
        undo(config)


def test_adopted_once_more_it_keeps_both_that_were_before(found, config):
    adopt(found, config, 1.0)
    undo(config)
    again = adopt(found, config, 2.0)
    assert again.before == "machine.toml.before-adopt-2"
    assert (config.parent / "machine.toml.before-adopt").exists()


def test_a_link_to_a_configuration_stays_one(found, config, tmp_path):
    (tmp_path / "place").mkdir()
    link = tmp_path / "place" / "link.toml"
    link.symlink_to(config)
    adopt(found, link, 1.0)
    assert link.is_symlink()
    assert config.read_bytes() == (found / "config.toml").read_bytes()


def test_what_was_changed_since_the_search_is_not_overwritten(found, config):
    config.write_text(config.read_text() + "# and a remark\n", encoding="utf-8")
    assert "no longer the configuration that was searched" in _refused(found, config)


def test_a_file_changed_since_its_adoption_is_not_reverted(found, config):
    adopt(found, config, 1.0)
    config.write_text(config.read_text() + "# by hand since\n", encoding="utf-8")
    text = config.read_bytes()
    with pytest.raises(UserError, match="changed since it was adopted"):
        undo(config)
    assert config.read_bytes() == text
    assert adoption_of(config).state == "adopted"


def test_without_anything_named_there_is_nothing_to_adopt(found, config):
    _result(found, verdict="none", config_sha256=sha256(config))  # and config.toml is of an older search
    assert "holds no configuration to adopt" in _refused(found, config)
    _result(found, verdict="named", config_sha256=sha256(config))
    (found / "config.toml").unlink()
    assert "holds no configuration to adopt" in _refused(found, config)


@pytest.mark.parametrize(
    ("document", "why"),
    [
        (None, "holds no result.json or calibration.json"),
        ("", "is damaged"),
        ("[]", "is damaged"),
        ("[" * 100_000, "is damaged"),
        ('{"verdict": "named"}', "does not say which configuration was searched"),
    ],
)
def test_a_folder_without_results_is_rejected(found, config, document, why):
    (found / "result.json").unlink()
    if document is not None:
        (found / "result.json").write_text(document, encoding="utf-8")
    assert why in _refused(found, config)


def test_the_newer_of_two_results_counts(found, config):
    calibration = found / "calibration.json"
    calibration.write_text(json.dumps({"config_sha256": "of another one"}), encoding="utf-8")
    assert "no longer the configuration that was searched" in _refused(found, config)


@pytest.mark.parametrize(
    ("change", "why"),
    [
        ({"machine": {"name": "other", "axis": "x"}}, "machine.name is other where"),
        ({"machine": {"name": "machine", "axis": "y"}}, "machine.axis is y where"),
        ({"ambient": {"channel": "air_degC"}}, "channels is"),
        ({"surface": {"convection_W_m2K": -1.0}}, "surface.convection_W_m2K"),
    ],
)
def test_another_machine_or_an_invalid_one_is_rejected(found, config, change, why):
    (found / "config.toml").write_text(tomlkit.dumps(table(**change)), encoding="utf-8")
    assert why in _refused(found, config)


def test_adopted_twice_it_is_rejected(found, config):
    adopt(found, config, 1.0)
    assert "no longer the configuration that was searched" in _refused(found, config)


def test_where_nothing_can_be_written_nothing_changes(found, config, monkeypatch):
    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(adopting, "write_together", full)
    assert "No space left on device" in _refused(found, config)


@pytest.mark.parametrize("fits", [0, 1, 2])
def test_where_the_disk_is_full_meanwhile_nothing_changes(found, config, monkeypatch, fits):
    """Neither is a configuration adopted without its record, nor is one undone by half."""
    _full_after(fits, monkeypatch)
    assert "No space left on device" in _refused(found, config)
    monkeypatch.undo()
    adoption = adopt(found, config, 1.0)
    if fits < 2:
        _full_after(fits, monkeypatch)
        with pytest.raises(UserError, match="No space left on device"):
            undo(config)
        monkeypatch.undo()
        assert sha256(config) == adoption.sha256
        assert adoption_of(config) == adoption
        assert undo(config).state == "undone"


def _full_after(count: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Have the disk take so many files more."""
    written: list[int] = []

    def write(fd: int) -> None:
        written.append(fd)
        if len(written) > count:
            raise OSError(28, "No space left on device")

    monkeypatch.setattr(folders.os, "fsync", write)


@pytest.mark.parametrize("text", ["", "[]", "{}", '{"adopted_s": "yesterday"}', "\0"])
def test_an_invalid_record_is_reported(config, text):
    config.with_name("machine.toml.adopted.json").write_text(text, encoding="utf-8")
    with pytest.raises(UserError, match="is not what `observer adopt` has written"):
        adoption_of(config)


def test_a_sentence_describes_its_state(found, config):
    assert adopt(found, config, 1.79e9).sentence() == "adopted 2026-09-21 14:13 UTC"
    assert undo(config).sentence() == "adopted 2026-09-21 14:13 UTC, undone since"


def test_a_candidate_is_adopted_only_on_demand(found, config):
    (found / "config.toml").rename(found / "candidate.toml")
    candidate = {"candidate": "candidate.toml"}
    _result(found, verdict="unknown", partial=candidate, config_sha256=sha256(config))
    assert "holds only a candidate" in _refused(found, config)
    adopt(found, config, 1e9, candidate=True)
    assert config.read_bytes() == (found / "candidate.toml").read_bytes()


def test_where_there_is_no_candidate_none_is_adopted(found, config):
    with pytest.raises(UserError, match="holds no candidate"):
        adopt(found, config, 1e9, candidate=True)
