"""Alarms of a running service: raised by conditions, and kept over a restart."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import structlog

from observer.config.machine import Config
from observer.config.publishing import AlarmSettings
from observer.config.sections import law_channels
from observer.files.state import StateFile, StateWriter
from observer.frames import EstimateBlock, EstimateQuality, FloatArray, FrameBlock, Layout
from observer.quality import alarm_states, bands
from observer.quality.alarm_classes import ALARM_CLASSES, channel_fault
from observer.quality.alarm_states import Alarm, AlarmCause, KnownOffset, acknowledged, advance, alarm_of
from observer.quality.bands import Band, Window
from observer.quality.kinds import Condition, ConditionKind

_KEPT_S = 60.0
_MOST_STEP_S = 30.0
_LOOK_S = 60.0
"""Learnt offsets are checked after this time of good estimates."""
_BELIEVED = (EstimateQuality.GOOD, EstimateQuality.DEGRADED)

log = structlog.get_logger()


class BandedSource(NamedTuple):
    """An estimated source with a law.

    Attributes:
        name: The source's name.
        column: Its index among the estimated sources.
        law: Its table of the configuration as JSON; another table makes the learnt heat invalid.
        channels: The channels that its law reads.
    """

    name: str
    column: int
    law: str
    channels: tuple[str, ...]


class KnownSensor(NamedTuple):
    """A sensor.

    Attributes:
        name: The sensor's name.
        learned: The index of its offset among the learnt parameters; None if that is not learnt.
        table: Its table of the configuration as JSON; another table makes the learnt offset invalid.
    """

    name: str
    learned: int | None
    table: str


class AlarmDesk:
    """Learns usual heats and offsets from every estimate; raises alarms from the conditions of a report.

    It is used in the loop's thread. The state file is written in a thread of its own, so no call but `close`
    waits.
    """

    def __init__(self, config: Config, layout: Layout, settings: AlarmSettings, file: Path | None) -> None:
        """Begin from the state in `file`, if there is one; its alarms are not announced again.

        Learnt heats and offsets are kept as long as the tables of source and sensor are the same.

        Args:
            config: The configuration of sources and sensors.
            layout: The layout of the estimates.
            settings: The table `[alarms]`.
            file: The state file; None keeps nothing.
        """
        self._settings = settings
        self._sensors = {s.channel: s.name for s in config.sensor}
        estimated = [s for s in config.source if s.estimate]
        self._sources = [
            BandedSource(s.name, i, s.model_dump_json(), law_channels(s, config.source))
            for i, s in enumerate(estimated)
            if s.law is not None
        ]
        self._gathered = np.zeros((len(self._sources), 5))
        self._bands = {source.name: bands.nothing_known() for source in self._sources}
        tables = {s.name: s.model_dump_json() for s in config.sensor}
        learned = {name: i for i, name in enumerate(layout.learned)}
        self._known = [
            KnownSensor(name, learned.get(f"sensor.{name}.offset_K"), tables[name]) for name in layout.sensors
        ]
        self._offsets = {sensor.name: KnownOffset() for sensor in self._known}
        self._good_s = 0.0
        self._alarms: dict[str, Alarm] = {}
        self._file = None if file is None else StateFile(file, "alarms and usual heats", version=1)
        self._reported: dict[str, str] = {}
        self._kept_s = -math.inf
        self._writer = None if file is None else StateWriter(file)
        if self._file is not None:
            self._file.restore(self._take)

    def see(self, estimate: EstimateBlock, frame: FrameBlock, air_degC: float) -> None:
        """Take one estimate, to learn the usual heats and offsets.

        Only good and degraded estimates count, and only while the source's law gives enough heat.

        Args:
            estimate: One estimate.
            frame: The frame behind it.
            air_degC: The air's temperature in °C; NaN leaves the heats out.
        """
        dt_s = float(frame.dt_s[0])
        if estimate.quality[0] not in _BELIEVED or not 0.0 < dt_s <= _MOST_STEP_S:
            return
        self._see_sensors(estimate, dt_s)
        rise_K = float(np.mean(estimate.field_degC[0])) - air_degC
        for k, source in enumerate(self._sources):
            heats = (estimate.heat_W, estimate.heat_sigma_W, estimate.law_W)
            heat_W, sigma_W, law_W = (float(values[0, source.column]) for values in heats)
            least_W = bands.LEAST_SHARE * self._bands[source.name].most_W
            if not math.isfinite(heat_W + sigma_W + law_W + rise_K) or law_W <= max(0.0, least_W):
                continue
            self._gathered[k] += dt_s * np.array([1.0, heat_W, sigma_W, law_W, rise_K])
            if self._gathered[k, 0] >= bands.WINDOW_S:
                self._learn(source.name, self._gathered[k] / self._gathered[k, 0], float(estimate.time_s[0]))
                self._gathered[k] = 0.0

    def _learn(self, source: str, means: FloatArray, time_s: float) -> None:
        """Take a whole window: means of 1, heat, its σ, law and rise."""
        heat_W, sigma_W, law_W, rise_K = means[1:].tolist()
        window = Window(time_s, heat_W, sigma_W, law_W, rise_K, law_W)
        settings = self._settings
        self._bands[source] = bands.learnt(self._bands[source], window, settings.learn_h, settings.deadband)

    def _see_sensors(self, estimate: EstimateBlock, dt_s: float) -> None:
        """Take the learnt offset of each sensor periodically."""
        self._good_s += dt_s
        if self._good_s < _LOOK_S:
            return
        hours, self._good_s = self._good_s / 3600.0, 0.0
        for sensor in self._known:
            if sensor.learned is not None:
                self._offsets[sensor.name] = alarm_states.taken(
                    self._offsets[sensor.name],
                    float(estimate.learned[0, sensor.learned]),
                    float(estimate.learned_sigma[0, sensor.learned]),
                    hours, self._settings.learn_h, self._settings.sensor_K,
                )  # fmt: skip

    def look(self, time_s: float, conditions: tuple[Condition, ...]) -> bool:
        """Update the alarms from the conditions of a report.

        Args:
            time_s: The time of the report.
            conditions: All of them.

        Returns:
            Whether a raised alarm has changed, so that the document is to be published at once.
        """
        causes = map(self._cause, (*conditions, *self._disagreeing(), *self._heats()))
        holding = [cause for cause in causes if cause is not None and cause.kind not in self._settings.off]
        self._alarms = advance(self._alarms, holding, time_s)
        raised = self._raised
        changed, before = raised != self._reported, self._reported
        for name, state in raised.items():
            if before.get(name) != state:
                log.warning("alarm", alarm=name, state=state, reason=self._alarms[name].condition.reason)
        self._reported = raised
        self._keep(time_s, now=changed)
        return changed

    @property
    def _raised(self) -> dict[str, str]:
        """The states of the raised alarms, by their ids."""
        return {name: alarm.state for name, alarm in self._alarms.items() if alarm.is_raised}

    def move(self, by_s: float) -> None:
        """Move all times by the step of the computer's clock, in s."""
        self._alarms = {name: alarm_states.moved(alarm, by_s) for name, alarm in self._alarms.items()}
        self._bands = {n: band._replace(at_s=band.at_s + by_s) for n, band in self._bands.items()}

    def acknowledge(self, name: str | None) -> str | None:
        """Acknowledge an alarm.

        Args:
            name: Its id; None for all.

        Returns:
            None if that is done, else a sentence with the alarms that there are.
        """
        raised = [n for n, alarm in self._alarms.items() if alarm.is_raised]
        if name is not None and name not in raised:
            names = ", ".join(raised) or "none"
            return f"there is no alarm {name}; there are: {names}"
        self._alarms = acknowledged(self._alarms, name)
        return None

    def document(self, time_s: float) -> dict[str, Any]:
        """Return the published document: the raised alarms, the worst first, and the state of the heats.

        Args:
            time_s: The time of the document, in s of the service's clock.
        """
        raised = sorted(self._raised, key=lambda name: self._alarms[name].rank)
        return {
            "time_s": time_s,
            "alarms": [_document_of(name, self._alarms[name]) for name in raised],
            "bands": {name: self._band_document(band) for name, band in self._bands.items()},
        }

    def close(self, timeout_s: float) -> bool:
        """Write the file.

        Args:
            timeout_s: The longest wait, in s.

        Returns:
            Whether that was done in time.
        """
        self._keep(math.inf, now=True)
        return self._writer is None or self._writer.wait(timeout_s)

    def _band_document(self, band: Band) -> dict[str, Any]:
        trend = bands.trend_per_day(band)
        learn_h = self._settings.learn_h
        is_known, unsure = band.running_h >= learn_h, bands.why_unsure(band)
        learning = "; ".join(filter(None, (f"{band.running_h:.1f} of {learn_h:g} h of running", unsure)))
        return {
            "known": is_known,
            "learning": None if is_known else learning,
            "unsure": unsure,
            "running_h": round(band.running_h, 2),
            "ratio": round(math.exp(bands.more_than_usual(band)), 4) if is_known else None,
            "sigma": round(bands.sigma_of(band), 4) if is_known else None,
            "trend_per_day": None if trend is None or not is_known else round(trend, 5),
        }

    def _disagreeing(self) -> Iterator[Condition]:
        """Sensors whose learnt offset has moved."""
        for sensor in self._known:
            offset = self._offsets[sensor.name]
            if offset.moved:
                now_K, usual_K = round(offset.now_K, 3), round(offset.usual_K, 3)
                learn_h = f"{self._settings.learn_h:g}"
                yield Condition(
                    ConditionKind.OFFSET_MOVED, sensor.name, learn_h, value=now_K, expected=usual_K
                )

    def _heats(self) -> Iterator[Condition]:
        """Heats that are not within their bands: the ratio to the usual one, and the trend a day."""
        learn_h, sources_of = f"{self._settings.learn_h:g}", self._off_together()
        for channel, names in sources_of.items():
            ratio = math.exp(np.mean([bands.more_than_usual(self._bands[name]) for name in names]))
            yield Condition(ConditionKind.HEATS_TOGETHER, channel, learn_h, value=ratio)
        for name, band in self._bands.items():
            if band.side != 0 and not any(name in names for names in sources_of.values()):
                kind = ConditionKind.HEAT_HIGH if band.side > 0 else ConditionKind.HEAT_LOW
                document = self._band_document(band)
                trend = math.nan if document["trend_per_day"] is None else document["trend_per_day"]
                yield Condition(kind, name, learn_h, value=document["ratio"], expected=trend)

    def _off_together(self) -> dict[str, list[str]]:
        """The channels on which several heats depend that are off together, with the names of these."""
        off_together, settings = {}, self._settings
        for channel in dict.fromkeys(channel for source in self._sources for channel in source.channels):
            names = [source.name for source in self._sources if channel in source.channels]
            if bands.are_off_together([self._bands[n] for n in names], settings.learn_h, settings.deadband):
                off_together[channel] = names
        return off_together

    def _cause(self, condition: Condition) -> AlarmCause | None:
        """The alarm that a condition raises; None if it does not call for somebody at the machine.

        The self-test judges the quality of an estimate, which a hundredth of a kelvin can lower: means
        and correlations of innovations are reasons for the quality, not alarms.
        """
        record = condition.kind.value
        alarm, target, name = record.alarm, condition.about or record.target, record.alarm_name
        if condition.kind is ConditionKind.CHANNEL and condition.quality is not None:
            target, name = self._sensors.get(target, target), condition.detail or condition.quality.label
            alarm = channel_fault(name).alarm
        if alarm is None or condition.value < record.alarm_from:
            return None
        return AlarmCause(alarm.name, target, condition.sentence, name, self._evidence(condition))

    def _evidence(self, condition: Condition) -> dict[str, Any] | None:
        """The figures that an alarm rests on, None where it has none."""
        if condition.kind in (ConditionKind.HEAT_HIGH, ConditionKind.HEAT_LOW):
            return self._band_document(self._bands[condition.about])
        values = (condition.value, condition.expected, condition.since_s)
        pairs = zip(condition.kind.value.figures, values, strict=False)
        return {name: value if math.isfinite(value) else None for name, value in pairs} or None

    def _keep(self, time_s: float, *, now: bool) -> None:
        """Save the state periodically; all but the last one is left out while a slow disk is busy."""
        if self._file is None or self._writer is None or not (now or time_s - self._kept_s >= _KEPT_S):
            return
        if self._writer.wait() or math.isinf(time_s):
            self._kept_s = time_s
            self._writer.replace(partial(self._file.encoded, self._plain()))

    def _plain(self) -> dict[str, Any]:
        return {
            "bands": {s.name: {"law": s.law, **bands.plain_of(self._bands[s.name])} for s in self._sources},
            "offsets": {s.name: {"said": s.table, **self._offsets[s.name]._asdict()} for s in self._known},
            "alarms": {n: asdict(alarm) for n, alarm in self._alarms.items() if alarm.is_raised},
        }

    def _take(self, document: Mapping[str, Any]) -> None:
        """Take over the state of the sources and sensors whose tables of the configuration are unchanged."""
        for source in self._sources:
            if (band := document["bands"].get(source.name)) is not None and band["law"] == source.law:
                self._bands[source.name] = bands.band_of(band)
        for sensor in self._known:
            saved = document["offsets"].get(sensor.name)
            if saved is not None and saved["said"] == sensor.table:
                self._offsets[sensor.name] = alarm_states.offset_of(saved)
        self._alarms = {name: alarm_of(alarm) for name, alarm in document["alarms"].items()}
        self._reported = self._raised


def _document_of(name: str, alarm: Alarm) -> dict[str, Any]:
    condition, alarm_class = alarm.condition, ALARM_CLASSES[alarm.condition.kind]
    return {
        "id": name,
        "kind": condition.kind,
        "target": condition.target,
        "severity": alarm_class.severity,
        "state": alarm.state,
        "since_s": alarm.since_s,
        "reason": condition.reason,
        "remedy": alarm_class.remedy,
        "evidence": condition.evidence,
    }
