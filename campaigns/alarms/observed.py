"""Alarms of rough machines by the real observer: `make alarms-observed`, or go on where it was.

The independent truth works for weeks: each day one of three programmes from another temperature, and an hour
of rest. The daemon's parts make estimates of its logs, a row a second, begun afresh each morning as after a
night; what is known of the gap and of the heats stays. Two weeks and a bit are for learning. Then nothing
happens, or a bearing wears, preload is lost, a sensor drifts slowly or grows noisy, from the same day on.
"""

from __future__ import annotations

import copy
import logging
import math
import sys
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import structlog
from rich.console import Console

from campaigns.resumable import go_on, read_rows, show
from drivers.protocol import DriverStatus
from observer.align.aligner import frames_of_log
from observer.bus.exchange import PublishStatus
from observer.config.publishing import AlarmSettings
from observer.estimate.pipeline import MachineModel
from observer.frames import EstimateBlock, EstimateQuality, FrameBlock
from observer.quality.alarms import AlarmDesk
from observer.quality.conditions import Facts, conditions
from tests.learning.cover import log_of
from tests.learning.machines import CONFIG, Day, Rough, Specimen, config_of, draw, work
from tests.truth.machine.cycles import RUNS, Phase, START_m, programme
from tests.truth.machine.machine import stream

FIRST_SEED, MACHINES = 9700, 8
DAY_S = 86_400.0
REST = Phase(3600.0)
LEARN_DAYS = 22
"""A programme is an hour and a half of running: what is usual has been learnt by then."""
LOOK_ROWS = 60
LIMITS = "\n[limits]\n" + "".join(f"t{n}_degC = {{ above_ambient_K = 90 }}\n" for n in range(1, 6))
"""Some of these machines get hotter than 45 K above the air, which their user has to say."""
DOCS = Path(__file__).parents[2] / "docs"
RESULTS, PAGE = DOCS / "alarms" / "observed.csv", DOCS / "evidence" / "alarms.md"
MARKS = ("<!-- by the real observer, written by make alarms-observed -->", "<!-- its end -->")
NOTHING = "nothing"


def _wears(one: Specimen, hours: float) -> Specimen:
    """The left bearing's friction doubles in 60 h of running."""
    grown = np.array([1.0, 2.0 ** (hours / 60.0), 1.0])
    return _rubs(one, grown)


def _loses_preload(one: Specimen, hours: float) -> Specimen:
    """The nut's preload is lost: 0.6 of its friction is left."""
    return _rubs(one, np.array([0.6, 1.0, 1.0]))


def _wears_loose(one: Specimen, hours: float) -> Specimen:
    """The nut's preload wears away in 60 h of running, and three quarters of its friction with it."""
    return _rubs(one, np.array([1.0 - 0.75 * min(hours / 60.0, 1.0), 1.0, 1.0]))


def _drifts(one: Specimen, hours: float) -> Specimen:
    """The middle sensor reads more by 0.2 K after each week of work."""
    return _reads(one, offset_K=one.machine.offset_K + np.array([0.0, 0.0, 0.02 * hours, 0.0, 0.0]))


def _rubs(one: Specimen, factor: np.ndarray) -> Specimen:
    physics = one.machine.physics
    return replace(
        one,
        machine=replace(
            one.machine, physics=physics._replace(friction_W_rpm=physics.friction_W_rpm * factor)
        ),
    )


def _reads(one: Specimen, **changes: object) -> Specimen:
    return replace(one, machine=replace(one.machine, **changes))  # type: ignore[arg-type]


@dataclass(frozen=True)
class Story:
    """What happens after the days of learning, for how many days of work, and which alarms report it."""

    happens: Callable[[Specimen, float], Specimen] | None
    days: int
    right: tuple[str, ...] = ()
    noise_K: float = 0.0


STORIES = {
    NOTHING: Story(None, 30),
    "bearing wears": Story(_wears, 40, ("heat_high.left_bearing", "model_inconsistent.")),
    "nut loses preload": Story(_loses_preload, 10, ("heat_low.nut", "model_inconsistent.")),
    "nut's preload wears away": Story(_wears_loose, 40, ("heat_low.nut", "model_inconsistent.")),
    "sensor drifts 0.2 K a week": Story(_drifts, 40, ("sensor_disagrees.t3", "model_inconsistent.t3")),
    "sensor grows noisy": Story(lambda one, hours: one, 10, ("sensor_disagrees.t3",), noise_K=0.5),
}


@dataclass
class Watched:
    """A service with `hours` of running behind it, and what it raised, by id, and after how many of them."""

    desk: AlarmDesk
    raised: Counter[str] = field(default_factory=Counter)
    first_h: dict[str, float] = field(default_factory=dict)
    hours: float = 0.0
    good: int = 0
    rows: int = 0


class Rig:
    """The daemon's parts for one configuration."""

    def __init__(self) -> None:
        config = config_of(CONFIG + LIMITS)
        self.machine = MachineModel.of(config, learns=True)
        self.pipeline = self.machine.pipeline(self.machine.estimator())
        self.desk = AlarmDesk(config, self.machine.plant.layout, AlarmSettings(), None)

    def works(self, seen: Watched, day: Day) -> None:
        """One day's log through everything, looked at each minute."""
        self.pipeline.reset()
        for frames in frames_of_log(log_of(day), self.machine.plan, LOOK_ROWS):
            estimates = self.pipeline.step(frames)
            air_degC = self.pipeline.inputs.z_end[:, self.machine.plant.known.ambient]
            for k in range(len(frames)):
                seen.desk.see(_row(estimates, k), _row(frames, k), float(air_degC[k]))
            seen.hours += float(np.sum(self.pipeline.inputs.law_W.any(axis=1))) / 3600.0
            seen.good += int(np.sum(estimates.quality == EstimateQuality.GOOD))
            seen.rows += len(frames)
            self._looks(seen, _row(frames, -1))

    def _looks(self, seen: Watched, frame: FrameBlock) -> None:
        gap = self.pipeline.gap
        facts = Facts(
            float(frame.time_s[0]), frame, {}, EstimateQuality.GOOD, True, None, 0, 0,
            {"log": (DriverStatus(connected=True), 0)}, None, PublishStatus(), 0.0,
            findings=self.pipeline.findings, departure=None if gap is None else gap.departure,
        )  # fmt: skip
        before = {alarm["id"] for alarm in seen.desk.document(0.0)["alarms"] if alarm["state"] != "returned"}
        seen.desk.look(facts.time_s, conditions(facts))
        for alarm in seen.desk.document(0.0)["alarms"]:
            if alarm["state"] != "returned" and alarm["id"] not in before:
                seen.raised[alarm["id"]] += 1
                seen.first_h.setdefault(alarm["id"], seen.hours)


Block = TypeVar("Block", FrameBlock, EstimateBlock)


def _row(block: Block, k: int) -> Block:
    """One row of a block of frames or estimates."""
    part = slice(k, None) if k == -1 else slice(k, k + 1)
    names = (f.name for f in fields(block))
    rows: dict[str, Any] = {n: v[part] for n in names if isinstance(v := getattr(block, n), np.ndarray)}
    return replace(block, **rows)


def _day(one: Specimen, seed: int, number: int, i: int, story: Story | None, hours: float) -> Day:
    rng, run = stream(seed, "observed", str(number), str(i)), RUNS[i % len(RUNS)]
    if story is not None and story.happens is not None:
        one = story.happens(one, hours)
    day = work(one, (*programme("standard", run, rng), REST), START_m[run], rng, 0.0)
    if story is not None and story.noise_K:
        day.sensor_degC[:, 2] += story.noise_K * rng.standard_normal(len(day.time_s))
    return day._replace(time_s=day.time_s + i * DAY_S)


def watched(task: tuple[int, int]) -> list[dict[str, str]]:
    """One machine's rows: the weeks of learning, and each story after them."""
    seed, number = task
    one, rig = draw(seed, number, Rough()), Rig()
    learning = Watched(rig.desk)
    for i in range(LEARN_DAYS):
        rig.works(learning, _day(one, seed, number, i, None, 0.0))
    gap = rig.pipeline.gap
    known = None if gap is None else gap.state
    rows = [_line(number, "learning", LEARN_DAYS, learning, learning.desk, ())]
    for name, story in STORIES.items():
        seen = Watched(copy.deepcopy(learning.desk))
        if gap is not None and known is not None:
            gap.restore(replace(known, time_s=math.nan))
        for i in range(LEARN_DAYS, LEARN_DAYS + story.days):
            rig.works(seen, _day(one, seed, number, i, story, seen.hours))
            if any(alarm.startswith(story.right) for alarm in seen.raised) and story.right:
                break
        rows.append(_line(number, name, i + 1 - LEARN_DAYS, seen, seen.desk, story.right))
    return rows


def _line(
    number: int, name: str, days: int, seen: Watched, desk: AlarmDesk, right: tuple[str, ...]
) -> dict[str, str]:
    own = [alarm for alarm in seen.raised if right and alarm.startswith(right)]
    others = [f"{alarm} {n}x" for alarm, n in sorted(seen.raised.items()) if alarm not in own]
    known = [source for source, band in desk.document(0.0)["bands"].items() if band["known"]]
    first = min(own, key=seen.first_h.__getitem__) if own else ""
    return {
        "machine": str(number), "story": name, "days": str(days), "hours": f"{seen.hours:.1f}",
        "good": f"{seen.good / max(seen.rows, 1):.3f}", "known": " ".join(known), "reported": first,
        "reported_h": f"{seen.first_h[first]:.1f}" if own else "", "others": "; ".join(others),
    }  # fmt: skip


def table(rows: list[dict[str, str]]) -> str:
    """The campaign in a table, a line for each story."""
    lines = [
        "| what happens | machines | days | reported | hours of running until then, median (longest) "
        "| reported as | other alarms |",
        "|---|---|---|---|---|---|---|",
    ]
    for name in ("learning", *STORIES):
        own = [row for row in rows if row["story"] == name]
        if not own:
            continue
        reported = [row for row in own if row["reported"]]
        hours = sorted(float(row["reported_h"]) for row in reported)
        when = f"{hours[len(hours) // 2]:.1f} ({hours[-1]:.1f})" if hours else "–"
        kinds = Counter(row["reported"].split(".")[0] for row in reported)
        words = ", ".join(f"`{kind}` {n}" for kind, n in kinds.most_common()) or "–"
        part = "–" if name in ("learning", NOTHING) else f"{len(reported)} of {len(own)}"
        false: Counter[str] = Counter()
        for one in filter(None, "; ".join(row["others"] for row in own).split("; ")):
            alarm, times = one.rsplit(" ", 1)
            false[alarm.split(".")[0]] += int(times.removesuffix("x"))
        others = ", ".join(f"`{kind}` {n}" for kind, n in false.most_common()) or "none"
        days = sum(int(row["days"]) for row in own)
        lines.append(f"| {name} | {len(own)} | {days} | {part} | {when} | {words} | {others} |")
    return "\n".join(lines)


def tried(number: int) -> list[dict[str, str]]:
    """One machine's rows, by the seed of the page."""
    return watched((FIRST_SEED, number))


def main() -> None:
    """Run what is missing, and write the table into the page."""
    done = {int(row["machine"]) for row in read_rows(RESULTS)}
    todo = [number for number in range(MACHINES) if number not in done]
    go_on(todo, tried, RESULTS, Console(stderr=True), workers=1)
    show(PAGE, table(read_rows(RESULTS)), MARKS)


if __name__ == "__main__":
    logging.disable()
    structlog.configure(wrapper_class=structlog.make_filtering_bound_logger(logging.CRITICAL))
    if len(sys.argv) > 1:
        for row in watched((int(sys.argv[1]), int(sys.argv[2]))):
            print(row)
    else:
        main()
