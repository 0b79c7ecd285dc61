"""The campaign's cases, made from the catalogue and from seeds."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

from tests.truth.machine.catalogue import (
    ALIKE,
    AMBIGUOUS,
    FAULTY,
    OUTSIDE,
    PAIRS,
    POOR,
    Doubtful,
)
from tests.truth.machine.effects import LADDERS, Effect, Ladder
from tests.truth.machine.generate import Case
from tests.truth.machine.housings import BODIES
from tests.truth.machine.machine import ENDS, SENSORS, SOURCES
from tests.truth.machine.troubles import BETWEEN, TROUBLES

FIRST_SEED = 3000
"""Thresholds are set on seeds below, figures come from seeds from here on."""
TYPICAL_SEED = 10_000
SUSPECT_SEED = 9400
ROUGH_SEED, ROUGH_SEEDS = 11_000, 8
HOUSED_SEED = 59_100
STRENGTHS = 5
NULLS, SEEDS, FEW_SEEDS = 200, 8, 4


@dataclass(frozen=True)
class Entry:
    """One case of the campaign. `group` says which figure it counts for, `label` what is hidden.

    `strength` is the ladder's, in its unit; `without` the kinds to be left out of the library; `trouble` what
    is wrong with the logs.
    """

    group: str
    label: str
    case: Case
    rung: int | None = None
    strength: float | None = None
    without: tuple[str, ...] = ()
    doubt: Doubtful | None = None
    trouble: str | None = None

    @property
    def name(self) -> str:
        """A name of its own, fit for a folder."""
        rung = "" if self.rung is None else f".{self.rung + 1}"
        return f"{self.group}.{self.label}{rung}.{self.case.seed}"


def ladder_entries(ladders: Sequence[Ladder], seeds: Sequence[int]) -> Iterator[Entry]:
    """Every strength of every effect for every seed; an effect's ladders take turns.

    The five strengths of a ladder and seed are hidden in one and the same machine.
    """
    for kind in dict.fromkeys(ladder.kind for ladder in ladders):
        own = [ladder for ladder in ladders if ladder.kind == kind]
        for i, seed in enumerate(seeds):
            ladder = own[i % len(own)]
            for rung in range(STRENGTHS):
                case = Case(f"ladder.{kind}", (ladder.effect(rung),), seed, ladder.cycle)
                yield Entry("ladder", ladder.label, case, rung, ladder.strengths[rung])


def absent_entries(seeds: Sequence[int]) -> Iterator[Entry]:
    """A strong effect that the library does not know, nor anything that is the same physics."""
    for entry in ladder_entries(LADDERS, seeds):
        if entry.rung == 3:
            kind = entry.case.effects[0].kind
            case = replace(entry.case, name=f"absent.{kind}")
            gone = (kind, *ALIKE.get(kind, ()))
            yield Entry("absent", entry.label, case, strength=entry.strength, without=gone)


def doubtful_entries(group: str, doubts: Sequence[Doubtful], seeds: Sequence[int]) -> Iterator[Entry]:
    """Machines whose right answer is a doubt."""
    for doubt in doubts:
        for seed in seeds:
            case = Case(f"{group}.{doubt.label}", doubt.effects, seed, doubt.cycle, unknown=doubt.unknown)
            yield Entry(group, doubt.label, case, doubt=doubt)


def plain_entries(group: str, hidden: Sequence[tuple[Effect, ...]], seeds: Sequence[int]) -> Iterator[Entry]:
    """Given effects, on the standard cycle."""
    for number, effects in enumerate(hidden):
        label = "+".join(e.kind for e in effects)
        for seed in seeds:
            yield Entry(group, f"{label}.{number}", Case(f"{group}.{number}", effects, seed))


def faulty_entries(seeds: Sequence[int]) -> Iterator[Entry]:
    """Logs with faults, with nothing hidden and with something."""
    lossy = Effect("end_conduction", "right", {"conductance_W_K": 0.12})
    for faults in FAULTY:
        for effects in ((), (lossy,)):
            label = "-".join(faults) + (".lossy" if effects else ".null")
            for seed in seeds:
                yield Entry("faulty", label, Case(f"faulty.{label}", effects, seed, faults=faults))


def campaign(first_seed: int = FIRST_SEED) -> list[Entry]:
    """Every case of the campaign; with another first seed below 900, one to set thresholds on.

    In the order of seeds, so that a part of it is a small campaign.
    """
    seeds, few = range(first_seed, first_seed + SEEDS), range(first_seed, first_seed + FEW_SEEDS)
    nulls = [Entry("null", "null", Case("null", (), seed)) for seed in range(first_seed, first_seed + NULLS)]
    every = [
        *nulls,
        *ladder_entries(LADDERS, seeds),
        *plain_entries("outside", [(e,) for e in OUTSIDE], seeds),
        *plain_entries("pair", PAIRS, seeds),
        *doubtful_entries("ambiguous", AMBIGUOUS, seeds),
        *doubtful_entries("poor", POOR, seeds),
        *absent_entries(few),
        *faulty_entries(few),
    ]
    per_seed = {"null": NULLS // SEEDS}
    return sorted(every, key=lambda e: (e.case.seed - first_seed) // per_seed.get(e.group, 1))


def typical_campaign(first_seed: int = TYPICAL_SEED) -> list[Entry]:
    """The machines of typical users, with nothing hidden and with every effect at the two highest strengths;
    with three logs, and with one.
    """
    entries = []
    for group, logs, nulls in (("typical", 3, 40), ("one log", 1, 20)):
        seeds = range(first_seed, first_seed + nulls)
        entries += [Entry(group, "null", Case(group, (), seed, typical=True, logs=logs)) for seed in seeds]
        for ladder in LADDERS:
            for rung in (3, 4) if logs == 3 else (4,):
                hidden, name = (ladder.effect(rung),), f"{group}.{ladder.label}"
                case = Case(name, hidden, first_seed, ladder.cycle, typical=True, logs=logs)
                entries.append(Entry(group, ladder.label, case, rung, ladder.strengths[rung]))
    return entries


NOT_ON_HOUSINGS = ("surface_convection", "attached_mass", "end_heat")
"""The machine has a film, bodies and heat at its ends, which these take away or put there."""


def housed_campaign(first_seed: int = HOUSED_SEED, nulls: int = 5) -> list[Entry]:
    """The machines of typical users with sensors on nut and housings only, with nothing hidden, and with the
    strongest of each effect that such a machine can have; in the order of seeds.
    """
    seeds = range(first_seed, first_seed + nulls)
    entries = [Entry("housings", "null", Case("housings", (), s, typical=True, housed=True)) for s in seeds]
    seen = {*SENSORS[: len(BODIES)], *SOURCES, *ENDS, None}
    ladders = {
        ladder.kind: ladder
        for ladder in reversed(LADDERS)
        if ladder.kind not in NOT_ON_HOUSINGS and ladder.target in seen
    }
    for i, ladder in enumerate(ladders.values()):
        hidden, name = (ladder.effect(STRENGTHS - 1),), f"housings.{ladder.label}"
        case = Case(name, hidden, first_seed + i % nulls, ladder.cycle, typical=True, housed=True)
        entries.append(Entry("housings", ladder.label, case, STRENGTHS - 1, ladder.strengths[-1]))
    return sorted(entries, key=lambda e: e.case.seed)


def suspect_campaign(first_seed: int = SUSPECT_SEED, made: int = 10) -> list[Entry]:
    """Logs with each trouble, and others: nothing hidden, on machines as configured and as users have them,
    and every effect at one of the two highest strengths. One, two or three logs.

    In the order of seeds, so that a part of it is a small campaign.
    """
    entries = []
    for i, seed in enumerate(range(first_seed, first_seed + made)):
        few_logs, more_logs = (3, 1, 2, 1)[i % 4], (3, 2, 2, 2)[i % 4]
        for trouble in TROUBLES:
            logs = more_logs if trouble == BETWEEN else few_logs
            case = Case(f"suspect.{trouble}", (), seed, typical=i % 5 > 2, logs=logs)
            entries.append(Entry("suspect", trouble.replace(" ", "_"), case, trouble=trouble))
        for typical in (False, True):
            for more in (0, 100):
                case = Case(f"other.{typical}", (), seed + more, typical=typical, logs=few_logs)
                entries.append(Entry("other", "typical" if typical else "null", case))
        for j, ladder in enumerate(LADDERS):
            if j % made == i:
                case = Case(f"other.{ladder.kind}", (ladder.effect(3 + j % 2),), seed, ladder.cycle)
                entries.append(Entry("other", ladder.label, case, 3 + j % 2, ladder.strengths[3 + j % 2]))
    return entries


NUTS = (
    # capacity, J/K; contact and loss to the air, W/K; the part of the friction's rest that it takes
    (300.0, 8.0, 0.0, 1.0), (300.0, 8.0, 1.5, 1.0), (800.0, 3.0, 0.5, 1.0), (1000.0, 8.0, 0.7, 1.0),
    (1500.0, 8.0, 0.3, 0.7), (2500.0, 8.0, 0.0, 1.0), (2500.0, 8.0, 1.5, 1.0), (800.0, 40.0, 0.5, 1.0),
    (300.0, 8.0, 0.0, 0.0), (1000.0, 8.0, 0.0, 0.0), (2500.0, 2.0, 0.0, 0.0), (1000.0, 40.0, 0.0, 0.0),
)  # fmt: skip
"""Bodies of nuts, held loosely to tightly, with heat of their own and without."""


def nut_entry(number: int, seed: int) -> Entry:
    """A nut with a body."""
    values = zip(("capacity_J_K", "conductance_W_K", "loss_W_K", "heat_share"), NUTS[number], strict=True)
    given = {key: value for key, value in values if value}
    label = "heated" if "heat_share" in given else "plain"
    body = Effect("attached_mass", "nut", given)
    return Entry("nut", f"{label}.{number}", Case(f"nut.{number}", (body,), seed))


LOSSY = Effect("end_conduction", "right", {"conductance_W_K": 0.15})
OFF: dict[str, dict[str, Any]] = {
    "minutes": {"faults": ("minutes",)},
    "gain": {"short": (0.03, 0.02)},
    "torque": {"torque": 0.1},
    "air": {"air_K": 6.0},
}
"""What a configuration does not contain: rows 1 min apart, sensors that read 3 ± 2 % toward the air, torque
that differs by 10 % from run to run; and air that varies by up to 6 K either way in some hours.
"""


def off_entry(group: str, effects: tuple[Effect, ...], seed: int) -> Entry:
    """A machine or its log off in one way, with something hidden or nothing."""
    label = effects[0].kind if effects else "null"
    return Entry(group, label, Case(f"{group}.{label}", effects, seed, **OFF[group]))


def rough_campaign(first_seed: int = ROUGH_SEED) -> list[Entry]:
    """Real nuts, and logs and machines that are off in a way of their own, in the order of seeds."""
    entries = []
    for seed in range(first_seed, first_seed + ROUGH_SEEDS):
        off = [off_entry(group, effects, seed) for effects in ((), (LOSSY,)) for group in OFF]
        nuts = [nut_entry(number, seed) for number in range(len(NUTS))]
        mixed = itertools.zip_longest(nuts[: len(off)], off, nuts[len(off) :])
        entries += [entry for three in mixed for entry in three if entry is not None]
    return entries


def rough_slice(seed: int = 900) -> list[Entry]:
    """One case of each sort of those, but for rows 1 min apart: where that fails is described in the docs."""
    return [nut_entry(3, seed), *(off_entry(group, (), seed) for group in ("gain", "torque", "air"))]


def slice_entries(seed: int = 900) -> list[Entry]:
    """One case of each sort, and one of each class of effect: surface, end, heat, friction, sensor."""
    strong = {(e.case.effects[0].kind, e.rung): e for e in ladder_entries(LADDERS, [seed])}
    kinds = ("speed_convection", "end_conduction", "local_heat", "friction_speed", "sensor_lag")
    return [
        Entry("null", "null", Case("null", (), seed)),
        *(strong[kind, 3] for kind in kinds),
        *plain_entries("outside", [(OUTSIDE[2],)], [seed]),
        *plain_entries("pair", [PAIRS[0]], [seed]),
        *doubtful_entries("ambiguous", [AMBIGUOUS[0]], [seed]),
    ]
