"""What a service has learnt, offered as a configuration."""

from pathlib import Path

import numpy as np
import pytest

import observer
from observer.align.aligner import frames_of_log
from observer.errors import ConfigError
from observer.estimate.checkpoint import CheckpointFit, Snapshot, pack
from observer.estimate.pipeline import MachineModel
from observer.installation import load
from tests.learning.cover import log_of
from tests.learning.machines import CONFIG, Rough, day, draw


@pytest.fixture
def config_path(tmp_path: Path) -> Path:
    path = tmp_path / "machine.toml"
    path.write_text(f'{CONFIG}\n[checkpoint]\ndirectory = "{tmp_path}"\n', encoding="utf-8")
    return path


def run_for_an_hour(config_path: Path) -> dict[str, tuple[float, float]]:
    """Leave the checkpoint of a service that has run for an hour, and return what it published last."""
    config = load(config_path)
    machine = MachineModel.of(config, learns=True)
    estimator = machine.estimator()
    pipeline = machine.pipeline(estimator)
    one = day(draw(1, 3, Rough()), 1, 3, "a")
    frames = next(iter(frames_of_log(log_of(one._replace(time_s=one.time_s + 1.8e9)), machine.plan, 3600)))
    block = pipeline.step(frames)
    snapshot = Snapshot(float(block.time_s[-1]), *pipeline.snapshot())
    file = config.checkpoint_file
    assert file is not None
    file.write_bytes(pack(snapshot, CheckpointFit.of(machine)))
    each = zip(block.learned[-1].tolist(), block.learned_sigma[-1].tolist(), strict=True)
    return dict(zip(machine.plant.layout.learned, each, strict=True))


def test_the_last_published_parameters_are_available_as_a_configuration(
    config_path: Path, tmp_path: Path
) -> None:
    published = run_for_an_hour(config_path)
    learned = observer.load(config_path).learned()
    learned.write(tmp_path / "offer")
    offered = learned.values
    assert set(offered) == set(published)
    np.testing.assert_allclose([*offered.values()], [*published.values()], rtol=1e-12)
    after, before = load(tmp_path / "offer" / "config.toml"), load(config_path)
    film, sigma = published["surface.convection_W_m2K"]
    assert after.surface.convection_W_m2K == pytest.approx(film, rel=1e-4)
    assert after.tolerance.convection == pytest.approx(sigma / film, rel=1e-4)
    plain = {
        s.name: published[f"sensor.{s.name}.offset_K"]
        for s in before.sensor
        if abs(published[f"sensor.{s.name}.offset_K"][0]) > 2 * published[f"sensor.{s.name}.offset_K"][1]
    }
    assert plain  # an offset of 0.3 K is seen in an hour that began at rest, on some sensor
    assert {e.target: e.offset_K for e in after.effect} == {
        name: pytest.approx(value, rel=1e-4) for name, (value, _) in plain.items()
    }
    for sensor in after.sensor:
        assert (sensor.offset_K is not None) == (sensor.name in plain)


def test_a_sensor_that_has_its_offset_keeps_it(config_path: Path, tmp_path: Path) -> None:
    run_for_an_hour(config_path)
    observer.load(config_path).learned().write(tmp_path / "offer")
    again = tmp_path / "offer" / "config.toml"
    run_for_an_hour(again)
    targets = [effect.target for effect in observer.load(again).learned().machine.config.effect]
    assert len(targets) == len(set(targets))


def test_without_a_checkpoint_of_this_configuration_the_sentence_says_so(
    config_path: Path, tmp_path: Path
) -> None:
    with pytest.raises(ConfigError, match=r"there is none yet; run the service by machine\.toml"):
        observer.load(config_path).learned()
    run_for_an_hour(config_path)
    config_path.write_text(config_path.read_text().replace("= 15.0", "= 16.0"), encoding="utf-8")
    with pytest.raises(ConfigError, match="another configuration"):
        observer.load(config_path).learned()
    config_path.write_text(config_path.read_text() + "[estimator]\nlearn = []\n", encoding="utf-8")
    with pytest.raises(ConfigError, match="nothing is learnt"):
        observer.load(config_path).learned()
