from __future__ import annotations

import copy
import struct
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure

from observer.errors import UserError
from observer.estimators.kalman import KalmanEstimator
from observer.files.folders import results_in
from observer.model.build import build_plant
from observer.model.drive import Drive
from observer.model.simulate import simulate, start
from observer.report.collect import Decimator, ReplaySamples, simulated
from observer.report.panels import LANE, Panel, duration_text, elapsed, innovations
from observer.report.pictures import draw_overview, draw_simulation, written
from tests.logs.machines import machine, rig
from tests.logs.simulated import made_log

# Tops and bottoms of the four panels, as shares of the height; loose enough for a legend that moves them.
BANDS = ((0.08, 0.24), (0.31, 0.48), (0.56, 0.70), (0.76, 0.90))


@pytest.fixture(scope="module")
def samples() -> tuple[ReplaySamples, Decimator]:
    config, blocks = rig()
    plant = build_plant(config)
    drive, estimator = Drive(config, plant), KalmanEstimator(plant, config.estimator)
    replayed, predicted = ReplaySamples(config, estimator.layout), Decimator()
    driven, state, screw = drive.initial(), estimator.initial(), start(plant, 22.0, np.zeros(3))
    for block in blocks:
        driven, inputs = drive.run(driven, block)
        state, estimates = estimator.run(state, inputs)
        replayed.take(inputs, estimates)
        screw, rows = simulate(plant, screw, inputs)
        predicted.add(simulated(inputs, rows, plant.rows))
    return replayed, predicted


def _size(path: Path) -> tuple[int, int]:
    header = path.read_bytes()[:24]
    assert header.startswith(b"\x89PNG")
    return struct.unpack(">II", header[16:24])


def _pixels(path: Path) -> np.ndarray:
    from matplotlib.image import imread

    return (np.asarray(imread(path))[:, :, :3] * 255).round().astype(np.uint8)


def _shown(pixels: np.ndarray, hex_colour: str) -> int:
    wanted = np.array([int(hex_colour[i : i + 2], 16) for i in (1, 3, 5)], np.uint8)
    return int(np.count_nonzero((pixels == wanted).all(axis=2)))


@pytest.mark.parametrize(
    ("draw", "of"), [(draw_overview, 0), (draw_simulation, 1)], ids=["replay", "simulation"]
)
def test_an_overview_shows_all_its_panels(draw, of: int, samples, tmp_path: Path) -> None:
    path = tmp_path / "overview.png"
    with written(path) as figure:
        draw(figure, rig()[0], samples[of], "title")
    assert _size(path) == (1600, 1200)
    pixels = _pixels(path)
    for top, bottom in BANDS:
        panel = pixels[int(1200 * top) : int(1200 * bottom), 120:1400]
        assert len(np.unique(panel.reshape(-1, 3), axis=0)) > 20  # a blank panel has its frame and grid only
    heats = pixels[: int(1200 * 0.26)]
    for ink in ("#0072B2", "#D55E00", "#009E73"):  # nut and two bearings, in the panel and in its key
        assert draw is draw_simulation or _shown(heats, ink) > 50
    assert list(tmp_path.iterdir()) == [path]


def test_a_long_log_is_drawn_from_few_samples(samples) -> None:
    _, blocks = rig()
    replayed = samples[0]
    assert replayed.rows == sum(map(len, blocks)) > 10_000
    assert len(replayed.last("time_s")) <= 2000


def test_one_sensor_one_step_and_no_expansion_make_a_picture_too(tmp_path: Path) -> None:
    config = machine(sensor=[{"name": "a", "channel": "a_degC", "position_m": 0.05}])
    plant = build_plant(config)
    drive, estimator = Drive(config, plant), KalmanEstimator(plant, config.estimator)
    log = made_log(config, 1, minutes=0.03)
    assert len(log) == 1
    _, inputs = drive.run(drive.initial(), log)
    _, estimates = estimator.run(estimator.initial(), inputs)
    samples = ReplaySamples(config, estimator.layout)
    samples.take(inputs, estimates)
    with written(tmp_path / "one.png") as figure:
        draw_overview(figure, config, samples, "one step")
    assert _size(tmp_path / "one.png") == (1600, 1200)


@contextmanager
def written_in(folder: Path) -> Iterator[Figure]:
    with results_in(folder) as part, written(part / "overview.png") as figure:
        yield figure


def test_nothing_half_written_is_left(samples, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    config, _ = rig()
    broken = copy.copy(samples[0])
    broken._kept = broken._kept | {"heat_sigma_W": broken._kept["heat_sigma_W"][:, :-1]}
    with pytest.raises(ValueError, match="broadcast"), written_in(tmp_path) as figure:
        draw_overview(figure, config, broken, "broken")
    assert list(tmp_path.iterdir()) == []

    def full(_figure: Figure, part: Path, **_options: object) -> None:
        part.write_bytes(b"half a picture")
        raise OSError("no space left on device")

    monkeypatch.setattr(Figure, "savefig", full)
    with pytest.raises(UserError, match="free space"), written_in(tmp_path) as figure:
        draw_overview(figure, config, samples[0], "full disk")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(("seconds", "text"), [(59.6, "60 s"), (3600.0, "1 h 00 min"), (900.0, "15 min")])
def test_durations_read_well(seconds: float, text: str) -> None:
    assert duration_text(seconds) == text


def test_time_is_counted_from_the_start_in_a_unit_that_fits() -> None:
    t, unit = elapsed(np.array([1.7e9, 1.7e9 + 7200.0, 1.7e9 + 36_000.0]))
    assert unit == "h"
    np.testing.assert_array_equal(t, [0.0, 2.0, 10.0])


def test_innovations_are_drawn_in_kelvin_on_one_scale(samples: tuple[ReplaySamples, Decimator]) -> None:
    innovation_K = samples[0].high("innovation_K")
    assert 0.05 < np.nanmedian(innovation_K) < 0.2  # the largest of some steps' noise of 0.05 K, in K
    axes, key = Figure().subplots(1, 2)
    shown_K = np.zeros((200, 2))
    shown_K[100:110, 1] = 0.36
    quality = np.zeros((200, 2))
    innovations(Panel(np.arange(200.0), axes, key), ("a", "b"), (-shown_K, shown_K), quality, 0.05)
    assert [text.get_text() for text in key.get_legend().get_texts()] == ["±0.4 K"]
    lane = axes.collections[1].get_paths()[0].vertices[:, 1]
    assert (lane.min(), lane.max()) == pytest.approx((-LANE * 0.9, LANE * 0.9))
