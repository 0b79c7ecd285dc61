"""The faults of the campaign, by name."""

from __future__ import annotations

from functools import lru_cache

from campaigns.integrity import faults as of
from campaigns.integrity.faults import Fault
from observer.report.sensitivity import detectable
from tests.learning.machines import CONFIG, config_of
from tests.truth.machine.machine import SENSORS

NONE, NEW_PROGRAM = "none", "a new program's strokes"
LEGITIMATE = (NONE, NEW_PROGRAM)
GROUPS = (
    "no fault", "common jump", "slow common", "jump of one", "jump of several", "swap", "gain", "slow single",
    "held", "noise and resolution", "nut position", "ambient", "on housings", "twice the least noticed",
)  # fmt: skip
HOUSINGS = GROUPS[-2]
"""Machines with thermocouples on the nut and on both housings only, links 20 % off."""
ALL = SENSORS
T3, T5 = ("t3",), ("t5",)
SWAPS = (("t1", "t2"), ("t2", "t3"), ("t4", "t5"), ("t1", "t5"), ("t2", "t4"))


def _named(sensors: tuple[str, ...]) -> str:
    return ", ".join(sensors)


def _jumps() -> list[Fault]:
    single = [
        Fault(f"{name} {size:+g} K", "jump of one", (name,), of.offset((name,), size))
        for size in (3.0, 1.0, -2.0)
        for name in SENSORS
    ]
    several = [
        (("t2", "t3"), (1.0,)), (("t1", "t5"), (1.0,)), (("t2", "t3"), (2.0,)), (("t1", "t5"), (2.0,)),
        (("t4", "t5"), (2.0,)), (("t2", "t4"), (2.0, -2.0)), (("t1", "t2", "t3"), (2.0,)),
        (("t1", "t3", "t5"), (2.0,)),
    ]  # fmt: skip
    return single + [
        Fault(
            f"{_named(sensors)} {' and '.join(f'{s:+g}' for s in size)} K",
            "jump of several",
            sensors,
            of.offset(sensors, *size),
        )
        for sensors, size in several
    ]


def _common() -> list[Fault]:
    return [
        *(
            Fault(f"all {size:+g} K", "common jump", ALL, of.offset(ALL, size))
            for size in (1.0, 4.0, 15.0, -3.0)
        ),
        Fault("all +3 K in 10 min", "slow common", ALL, of.drift(ALL, 18.0, 3.0)),
        Fault("all +1 K/h", "slow common", ALL, of.drift(ALL, 1.0)),
    ]


def _slow() -> list[Fault]:
    single = ((T3, 1.0), (T5, 1.0), (("t1",), 3.0), (T3, 3.0), (T5, 3.0), (T3, 10.0), (T5, 10.0))
    pairs = ((("t2", "t4"), 1.0), (("t1", "t5"), 1.0))
    return [
        Fault(f"{_named(sensors)} {rate:+g} K/h", "slow single", sensors, of.drift(sensors, rate))
        for sensors, rate in (*single, *pairs)
    ]


def _other() -> list[Fault]:
    noise = "noise and resolution"
    return [
        *(Fault(f"{a} and {b} swapped", "swap", (a, b), of.exchanged({a: b, b: a})) for a, b in SWAPS),
        Fault("t4 shows t3's value", "swap", ("t4",), of.exchanged({"t4": "t3"})),
        Fault("all at 85 % of their rise", "gain", ALL, of.gain(ALL, 0.85)),
        Fault("all at 110 % of their rise", "gain", ALL, of.gain(ALL, 1.10)),
        Fault("t3 at 85 % of its rise", "gain", T3, of.gain(T3, 0.85)),
        Fault("t5 at 85 % of its rise", "gain", T5, of.gain(T5, 0.85)),
        *(Fault(f"{n} held, with noise", "held", (n,), of.held((n,))) for n in ("t1", "t3", "t5")),
        Fault("all held, with noise", "held", ALL, of.held(ALL)),
        Fault("t3 with ten times its noise", noise, T3, of.noisy(T3, 10.0)),
        Fault("t3 in steps of 1 K", noise, T3, of.coarse(T3, 1.0)),
        Fault("all in steps of 1 K", noise, ALL, of.coarse(ALL, 1.0)),
        Fault("t2 +5 K for 1 s each minute", noise, ("t2",), of.spikes(("t2",), 5.0, 60.0)),
        Fault("t4 +3 K, 2 min on, 5 off", noise, ("t4",), of.now_and_then(("t4",), 3.0, 120.0, 300.0)),
        Fault("nut homed 50 mm off", "nut position", (), of.nut_off(0.05)),
        Fault("nut homed -50 mm off", "nut position", (), of.nut_off(-0.05)),
        Fault("nut's position held", "nut position", (), of.nut_held),
        Fault("a heater at the ambient sensor", "ambient", (), of.air_off(8.0, 180.0)),
        Fault("ambient +5 K", "ambient", (), of.air_off(5.0)),
    ]


def _on_housings() -> list[Fault]:
    """Quiet faults and jumps of the nut's and a housing's only thermocouple."""
    found = [Fault("on housings, none", HOUSINGS, (), of.nothing)]
    for place, name in (("nut", "t1"), ("housing", "t2")):
        changes = {f"{rate:+g} K/h": of.drift((name,), rate) for rate in (1.0, 3.0, 10.0)}
        changes |= {"held": of.held((name,)), "+1 K": of.offset((name,), 1.0)}
        found += [Fault(f"on the {place}, {what}", HOUSINGS, (name,), to) for what, to in changes.items()]
    return found


@lru_cache(maxsize=1)
def minimal_detectable_K() -> dict[str, float]:
    """The smallest fault of each sensor that `check` says is noticed; none where it says nothing of it."""
    said = detectable(config_of(CONFIG))["minimal_detectable"]
    return {name: float(each["fault_K"]) for name, each in said.items()}


def _listed() -> dict[str, Fault]:
    whole = [
        *(Fault(name, "no fault", (), of.nothing) for name in LEGITIMATE),
        *_common(), *_jumps(), *_other(), *_slow(), *_on_housings(),
    ]  # fmt: skip
    whole.sort(key=lambda fault: GROUPS.index(fault.group))
    return {fault.name: fault for fault in whole}


LISTED = _listed()
"""The faults whose size is fixed, by name, in the order of the table."""
TWICE = {f"{name} + twice its least": name for name in SENSORS}
GROUP_OF = {name: fault.group for name, fault in LISTED.items()} | dict.fromkeys(TWICE, GROUPS[-1])
"""Of each fault, also of those whose size `check` says."""


@lru_cache(maxsize=1)
def catalogue() -> dict[str, Fault]:
    """Every fault by its name, in the order of the table; asks `check` for the least that is noticed."""
    least_K = minimal_detectable_K()
    return LISTED | {
        name: Fault(name, GROUPS[-1], (sensor,), of.offset((sensor,), 2.0 * least_K[sensor]))
        for name, sensor in TWICE.items()
        if sensor in least_K
    }
