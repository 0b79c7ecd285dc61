"""From readings to inputs, and the self-test."""

from __future__ import annotations

import itertools
import math

import numpy as np

from observer.align.aligner import Aligner, AlignPlan, Position
from observer.align.plausibility import ChannelKind, Limits
from observer.estimators.kalman import KalmanEstimator
from observer.estimators.selftest import SelfTest
from observer.frames import EstimateBlock, FrameBlock, Inputs, NutPath, Reading
from observer.model.drive import Drive
from observer.model.rod import moving
from observer.model.rod.moving import no_path_yet, reversals
from tests.bits.digests import estimated, given, numbers, words
from tests.bits.shared import (
    Arrays,
    Cases,
    frames_of,
)
from tests.logs.inputs import driven, noise, to_and_fro
from tests.logs.plants import described, rod
from tests.logs.rounding import firm

CASES = Cases()
case, cases_of = CASES.case, CASES.cases_of


# ---- paths of nuts ----


def path_of(time_s, position_m, driven_m_s=None, every=3):
    """Samples as a path, so many in a step; the fifth step has none."""
    n = len(time_s)
    offset = np.minimum(every * np.arange(-(-n // every) + 1), n)
    offset = np.insert(offset, 5, offset[5]) if len(offset) > 6 else offset
    driven_m_s = np.full(n, np.nan) if driven_m_s is None else driven_m_s
    return NutPath(np.asarray(time_s, float), np.asarray(position_m, float), offset, driven_m_s, np.zeros(n))


def _runs():
    """Samples of a nut of 0.2 m/s, fine and coarse, even and not, late, twice, and with its speed given."""
    rng = np.random.default_rng(11)
    gaps = {
        "fine": np.full(120, 0.02),
        "coarse": 0.5 * (0.7 + 0.6 * rng.random(120)),
        "sparse": np.full(60, 1.3),
        "late": np.concatenate(
            [np.full(40, 0.4), [4.0], np.full(10, 0.4), [90.0, 0.4, 5000.0, 0.4, 0.0, 1e-4]]
        ),
        "never known": np.full(30, 7.0),
        "long": np.concatenate([np.full(20, 0.5), np.full(4, 20.0)]),
    }
    for name, gap_s in gaps.items():
        time_s = 100.0 + np.cumsum(gap_s)
        position_m = to_and_fro(0.2 * (time_s - 100.0), 0.2, 0.8)
        yield name, time_s, position_m, None
    gap_s = 0.4 * (0.7 + 0.6 * rng.random(90))
    time_s = np.cumsum(gap_s)
    position_m = to_and_fro(0.2 * time_s, 0.2, 0.8)
    driven_m_s = np.full(90, 0.2)
    driven_m_s[[4, 5, 9, 20]] = np.nan
    yield "driven", time_s, position_m, driven_m_s
    late_s = time_s + np.where(np.arange(90) >= 60, 9.0, 0.0) + np.where(np.arange(90) >= 70, 3.5, 0.0)
    yield "driven and late", late_s, to_and_fro(0.2 * late_s, 0.2, 0.8), driven_m_s
    yield "of another lead", time_s, position_m, 2.5 * driven_m_s
    stands = np.where(np.arange(90) // 20 % 2 == 0, position_m, 0.5)
    yield "standing", time_s, stands, np.where(stands == 0.5, 0.0, 0.2)
    stands = np.full(90, 0.4)
    stands[50:] = 0.4 + 0.001 * np.arange(40)
    yield "creeping", time_s, stands, None
    nowhere = position_m.copy()
    nowhere[[8, 30]] = -0.3, 1.4
    yield "off the screw", time_s, nowhere, None
    brief_s = np.cumsum(np.where(np.arange(90) < 4, 1e-3, gap_s))
    yield "brief at first", brief_s, to_and_fro(0.2 * brief_s, 0.2, 0.8), None


@case
def nut_turns():
    found: Arrays = {}
    for name, time_s, position_m, driven_m_s in _runs():
        state, ends_m = reversals(no_path_yet(), path_of(time_s, position_m, driven_m_s), 0.6)
        found |= {f"{name} ends_m": ends_m, f"{name} state": numbers(state)[0]}
    time_s, nowhere_m = np.arange(6.0), np.array([0.2, 0.3, np.nan, 0.4, 0.5, 0.6])
    state, _ = reversals(no_path_yet(), path_of(time_s, nowhere_m), 0.6)
    return found | {"no number state": numbers(state)[0]}


def _nut(dwell=0.0):
    effects = {"effect": [{"kind": "dwell", "target": "nut", "fraction": dwell}]} if dwell else {}
    config, plant = described(4, 2, 2, moving=True, **effects)
    return config, plant


@case
def nut_columns():
    _, plant = _nut()
    table = plant.moving[0].table
    found: Arrays = {"given": given(table)}
    for name, time_s, position_m, driven_m_s in _runs():
        path = path_of(time_s, position_m, driven_m_s)
        dt_s = np.diff(time_s[np.maximum(path.offset - 1, 0)])
        nut, B, C = moving.columns(table, moving.start(table), dt_s, path)
        found |= {f"{name} B": B, f"{name} C": C, f"{name} state B": nut.sum_B, f"{name} state C": nut.sum_C}
        found |= {f"{name} state": np.append(numbers(nut.path), nut.weight_s)}
    return found


@case
def nut_columns_at_places():
    _, plant = _nut()
    table = plant.moving[0].table
    found: Arrays = {"given": given(table)}
    for name, places_m in {"one": [0.4], "ends": [0.2, 0.8], "edges": [-1.0, 0.0, 0.01, 1.0, 3.0]}.items():
        B, C = moving.columns_at(table, places_m)
        found |= {f"{name} B": B, f"{name} C": C}
    return found


@case
def nut_columns_where_it_turns():
    _, plant = _nut()
    table = plant.moving[0].table
    path = path_of(*next(iter(_runs()))[1:])
    _, B, C = moving.columns_at_ends(table, no_path_yet(), np.full(len(path.offset) - 1, 0.06), path)
    return {"given": given(table), "B": B, "C": C}


# ---- from frames to inputs ----


def _drive(config, plant, frames, parts=(0, 1, 15, 40)) -> Arrays:
    drive = Drive(config, plant)
    state, found = drive.initial(), []
    for begin, end in itertools.pairwise(parts):
        cut = slice(begin, end)
        path = {}
        for name, p in frames.path.items():
            own = slice(p.offset[begin], p.offset[end])
            path[name] = NutPath(
                p.time_s[own],
                p.position_m[own],
                p.offset[begin : end + 1] - p.offset[begin],
                p.driven_m_s[own],
                p.speed_age_s[own],
            )
        part = FrameBlock(
            frames.channels, frames.time_s[cut], frames.dt_s[cut], frames.values[cut], frames.fresh[cut],
            frames.quality[cut], frames.age_s[cut], path,
        )  # fmt: skip
        state, u = drive.run(state, part)
        found.append(u)
    u = Inputs.joined(found)
    rest = {"law_W": state.law_W, "z": state.z, "running_s": state.running_s}
    rest |= {"times_s": np.array([state.begin_s, state.last_s])}
    return {"given": given(plant, frames.values)} | u._asdict() | {f"state.{k}": v for k, v in rest.items()}


EFFECTS_OF_INPUTS = [
    {"kind": "speed_convection", "gain": 1.0},
    {"kind": "coolant", "conductance_W_K": 2.0, "inlet_degC": 15.0},
    {"kind": "ambient_drift", "rate_K_h": 3.0},
    {"kind": "sensor_bias", "target": "t1", "offset_K": 0.3},
    {"kind": "sensor_drift", "target": "t2", "rate_K_h": 2.0},
    {"kind": "run_in", "target": "left", "fraction": 0.3, "time_s": 300.0},
    {"kind": "dwell", "target": "nut", "fraction": 0.2},
]


@cases_of(
    plain={"tables": {}},
    effects={"tables": {"effect": EFFECTS_OF_INPUTS}},
    channels={
        "tables": {
            "ambient": {"channel": "ambient_degC"},
            "boundary": {"left": {"kind": "prescribed", "channel": "left_degC"}},
            "output": {"positions_m": [0.1, 0.9]},
        }
    },
)
def drive(tables):
    """What is missing, held, known late or never, and a nut whose place is not known."""
    screw = described(2, 2, 2)[0].screw.model_dump(exclude_unset=True) | {"expansion_1_K": 11.8e-6}
    config, plant = described(3, 2, 2, moving=True, screw=screw, **tables)
    frames = frames_of(config)
    at = {name: j for j, name in enumerate(config.channels)}
    for name, steps, quality in (
        ("t1_degC", slice(4, 7), 1), ("nut_position_m", slice(9, 12), 2),
        ("screw_speed_rpm", slice(18, 20), 2), ("screw_speed_rpm", slice(0, 2), 1),
        ("ambient_degC", slice(0, 3), 1), ("left_degC", slice(6, 8), 3),
    ):  # fmt: skip
        if name in at:
            frames.quality[steps, at[name]] = quality
            if steps.start == 0 or name == "screw_speed_rpm":
                frames.values[steps, at[name]] = np.nan
    return _drive(config, plant, frames)


@case
def drive_without_a_nut():
    config, plant = described(3, 2, 2)
    return _drive(config, plant, frames_of(config))


@case
def drive_of_two_nuts():
    nuts = [
        {"name": n, "shape": "nut", "length_m": 0.08, "stroke_m": [0.2, 0.8],
         "position_channel": "nut_position_m", "speed_channel": "screw_speed_rpm", "heat_W_rpm": 0.006}
        for n in ("nut", "other")
    ]  # fmt: skip
    config, plant = described(3, 2, 2, source=nuts)
    return _drive(config, plant, frames_of(config))


# ---- from readings to frames ----

CHANNELS = ("t1_degC", "t2_degC", "air_degC", "speed_rpm", "nut_position_m", "slow_degC")


def _plan(*, ambient=2, periods=(0.5, 0.5, math.nan, 0.1, 0.02, math.nan), speed=3):
    inf, c = math.inf, len(CHANNELS)
    low, high = np.full(c, -inf), np.full(c, inf)
    low[0], high[0], high[3] = -40.0, 150.0, 4000.0
    rate, slack = np.full(c, inf), np.zeros(c)
    rate[0], slack[0] = 5.0, 0.5
    above, below = np.full(c, inf), np.full(c, inf)
    above[:2], below[:2] = 45.0, 25.0
    kinds = (ChannelKind.OTHER,) * c
    limits = Limits(kinds, low, high, rate, above, below, slack, np.column_stack([low, high]), ambient, 21.0)
    noise_K = np.array([0.05, 0.05, *(math.nan,) * 4])
    positions = (Position(4, speed, 0.01), Position(5))
    return AlignPlan(CHANNELS, positions, np.array(periods, float), noise_K, 0.5, limits)


def _readings(seed=8, count=900):
    """Readings and ticks (floats) in the order in which they come."""
    rng = np.random.default_rng(seed)
    events: list[Reading | float] = []
    for k in range(count):
        t = 1e6 + 0.1 * k
        late = 0.3 * float(rng.random()) if k % 11 == 0 else 0.0
        if k % 5 == 0:
            one = 20.0 + 0.002 * k + 0.05 * float(noise(rng, ()))
            two = 21.0 + 0.05 * float(noise(rng, ())) if k < 300 or 700 < k < 760 else 21.5
            values, faults = {"t1_degC": one, "t2_degC": two}, {}
            if k % 85 == 0:
                values["t1_degC"] = [200.0, -60.0, 80.0, 30.0, -10.0, one + 4.0][k // 85 % 6]
            if k % 95 == 0:
                values["t1_degC"], faults = (
                    math.nan,
                    {"t1_degC": ["open_circuit", "missing", ""][k // 95 % 3]},
                )
            if k % 120 == 0:
                values = {"t2_degC": math.inf}
            if k % 130 == 0:
                values = {"t2_degC": [90.0, -30.0][k // 130 % 2]}
            events.append(Reading(t - late, values, faults))
        if k % 20 == 0:
            events.append(Reading(t, {"air_degC": 20.0 + 0.01 * k}))
        if k % 37 == 0 or k > 500:
            events.append(Reading(t, {"slow_degC": 20.0 + 0.1 * (k // 100)}))
        if not 200 < k < 240 and k % 3 == 0:
            faults = {"speed_rpm": "timeout"} if 400 < k < 420 else {}
            events.append(Reading(t, {"speed_rpm": 1200.0 if k % 9 else 5000.0}, faults))
        at_m = float(to_and_fro(np.array(0.02 * k), 0.2, 0.8))
        burst = 4 if k % 50 == 0 else 1
        for i in range(burst):
            events.append(Reading(t - late + 1e-4 * i, {"nut_position_m": at_m + 0.001 * (i // 2)}))
        if k % 7 == 0:
            events.append(Reading(t - 0.35, {"nut_position_m": at_m - 0.05}))
        if k % 5 == 4 and not 600 < k < 640:
            events.append(t + 0.05)
    return events


@cases_of(
    usual={},
    fixed_air={"ambient": -1},
    unknown_periods={"periods": (math.nan,) * 6},
    unknown_speed={"speed": -1},
)
def aligned(**plan_):
    aligner = Aligner(_plan(**plan_))
    frames, faults = [aligner.tick(1e6 - 0.5)], []
    for event in _readings():
        if isinstance(event, Reading):
            aligner.ingest(event)
        else:
            frames.append(aligner.tick(event))
            faults.append(aligner.faults)
    names = ("time_s", "dt_s", "values", "fresh", "quality", "age_s")
    found = {name: np.concatenate([getattr(f, name) for f in frames]) for name in names}
    for channel in frames[0].path:
        parts = [f.path[channel] for f in frames]
        found |= {
            f"{channel} {name}": np.concatenate([getattr(p, name) for p in parts]) for name in NutPath._fields
        }
    return found | {"faults": words(faults)}


# ---- the self-test ----


def _judged(K=420):
    """Steps of five seconds in which one thing after the other fails, and a nut that goes its own way."""
    rng, s, m = np.random.default_rng(9), 4, 3
    time_s = 5.0 * np.arange(1, K + 1)
    nu = noise(rng, (K, s))
    nu[40:110, 0] += 2.0
    nu[40:110, 1] = np.where(np.arange(70) // 12 % 2 == 0, 1.5, -1.5)
    nu[40:110, 2] *= 4.0
    nu[150:170, 3] += 40.0
    nu[30:34, 1] = np.nan
    given_quality, seen = np.zeros((K, s), np.int8), np.zeros((K, s), np.int8)
    seen[150:170, 3] = 3
    seen[155:158, 3], nu[155:158, 3] = 3, np.nan
    given_quality[200:205, 0] = seen[200:205, 0] = 1
    law = np.where((np.arange(K) // 30 % 2 == 1)[:, None], 20.0 + 5.0 * np.arange(m), 0.0)
    heat = law + noise(rng, (K, m))
    heat[220:260, 0] += 80.0
    heat[280:330] += 25.0
    heat[335:345, 1] += 400.0
    sigma = np.full((K, m), 3.0)
    sigma[:12], sigma[350:355, 1] = 28.0, 25.0
    quality = np.zeros(K, np.int8)
    quality[60:64], quality[100] = 4, 3
    grid, none = np.zeros((K, 2)), np.zeros((K, 0))
    block = EstimateBlock(
        time_s, heat, sigma, grid, grid, none, none, 0.1 * nu, seen, quality, np.full((K, s), 0.1), law,
        none, none,
    )  # fmt: skip
    at_s = 1.0 * np.arange(5 * K)
    runs_m_s = np.where(at_s < 1500.0, 0.05, 0.2)
    position_m = to_and_fro(np.cumsum(np.where((at_s > 600.0) & (at_s < 640.0), 0.0, runs_m_s)), 0.1, 0.5)
    driven_m_s = np.full(len(at_s), 0.06)
    driven_m_s[(at_s > 900.0) & (at_s < 1000.0)] = 0.25
    driven_m_s[(at_s > 1100.0) & (at_s < 1300.0)] = 0.15
    driven_m_s[[50, 51]] = np.nan
    path = NutPath(at_s, position_m, 5 * np.arange(K + 1), driven_m_s, np.zeros(len(at_s)))
    return time_s, given_quality, block, path


@cases_of(
    with_laws={"laws": ("q0", "q1", "q2")},
    one_law={"laws": ("q1",)},
    a_nut={"laws": ("q0", "q1"), "nut": True},
)
def selftest(laws, nut=False):
    plant = firm(rod(modes=2, moving=(1,) if nut else ()))
    test, (time_s, quality, block, path) = SelfTest(plant, laws), _judged()
    u = driven(plant, len(time_s))._replace(
        time_s=time_s, dt_s=np.diff(time_s, prepend=time_s[0]), quality=quality
    )
    K = len(time_s)
    frames = FrameBlock(
        (), time_s, u.dt_s, np.zeros((K, 0)), np.zeros((K, 0), np.bool_), np.zeros((K, 0), np.int8),
        np.zeros((K, 0)), {"nut_position_m": path},
    )  # fmt: skip
    state, motion, u = test.watch(test.initial(), frames, u)
    state, judged = test.run(state, motion, u, block)
    found = {f"state.{name}": numbers(part) for name, part in state._asdict().items()}
    found |= {"findings": words((test.findings(state), test.history(state)))}
    found |= {"motion": numbers(motion).reshape(K, -1)}
    return found | {"degraded": u.degraded, "quality": judged.quality}


@case
def the_whole_path():
    """Frames, inputs, what is learnt, the self-test: a machine as a service runs it."""
    config, plant = described(4, 3, 3, moving=True, learns=True)
    frames, drive_ = frames_of(config, 30), Drive(config, plant)
    test = SelfTest(plant, plant.source_names)
    _, u = drive_.run(drive_.initial(), frames)
    state, motion, u = test.watch(test.initial(), frames, firm(u))
    estimator = KalmanEstimator(plant, config.estimator)
    last, block = estimator.run(estimator.initial(), u)
    state, judged = test.run(state, motion, u, block)
    return (
        {"given": given(plant, u)}
        | estimated(last, judged)
        | {f"test.{k}": numbers(v) for k, v in state._asdict().items()}
    )
