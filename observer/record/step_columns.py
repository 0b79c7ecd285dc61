"""The columns of a published step, and their places in a stored row.

A row has a fixed size. It has time and number, the value and age of each channel, and the numbers of the
estimate as float32, as in its message. Qualities are codes.
"""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from functools import cached_property
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from observer.frames import (
    FORCE,
    PARTS,
    EstimateBlock,
    EstimateQuality,
    FloatArray,
    FrameBlock,
    Layout,
    Quality,
)

_FORMAT = 1
FIELDS = ("values", "age_s", "numbers", "codes")
"""The fields of a row that hold several columns each."""


@dataclass(frozen=True, slots=True)
class StepRows:
    """Some published steps of one file, in the order of time.

    Attributes:
        source: The common part of the file's steps.
        rows: A structured array (K,) of `source.dtype`.
    """

    source: StepSource
    rows: NDArray[Any]

    def __len__(self) -> int:
        return len(self.rows)

    @property
    def time_s(self) -> FloatArray:
        """The time of each step, (K,), s since 1970."""
        time_s: FloatArray = self.rows["time_s"]
        return time_s

    def at(self, chosen: NDArray[Any] | slice) -> StepRows:
        """Return some of the steps, by a mask (K,), indices or a slice."""
        return StepRows(self.source, self.rows[chosen])

    @property
    def estimates(self) -> EstimateBlock:
        """The estimates of K steps, as they were published: numbers are exact to float32."""
        rows, source = self.rows, self.source
        columns = {
            name: rows["numbers"][:, place].astype(np.float64) for name, place in source.arrays.items()
        }
        codes, parts = rows["codes"], 1 + len(PARTS)
        return EstimateBlock(
            time_s=rows["time_s"],
            quality=codes[:, 0],
            part_quality=codes[:, 1:parts],
            sensor_quality=codes[:, parts : parts + len(source.layout.sensors)],
            **columns,
        )

    @property
    def frames(self) -> FrameBlock:
        """Value, quality and age of each channel in K frames.

        The fields `fresh`, `dt_s` and `path` are not stored: they are False, 0 and empty.
        """
        rows, count = self.rows, len(self.rows)
        quality = rows["codes"][:, 1 + len(PARTS) + len(self.source.layout.sensors) :]
        fresh = np.zeros(rows["values"].shape, np.bool_)
        return FrameBlock(
            self.source.channels,
            rows["time_s"],
            np.zeros(count),
            rows["values"],
            fresh,
            quality,
            rows["age_s"],
            {},
        )

    def column(self, name: str) -> NDArray[Any]:
        """Return a column by its name, (K,); NaN where the file has none of that name.

        Numbers of estimates are float32, values and ages float64, qualities codes.
        """
        if name in ("time_s", "sequence"):
            return self.rows[name]
        if name not in self.source.places:
            return np.full(len(self.rows), np.nan)
        field, place = self.source.places[name]
        column: NDArray[Any] = self.rows[field][:, place]
        return column


@dataclass(frozen=True, eq=False)
class StepSource:
    """The common part of all steps of a file.

    Attributes:
        layout: Names and places of the estimates.
        channels: Names of the channels.
        config: The document `config` of the service, with its hash and instance.
        note: A sentence on steps that are not as they were published; empty otherwise.
    """

    layout: Layout
    channels: tuple[str, ...]
    config: dict[str, Any]
    note: str = ""

    @classmethod
    def of_json(cls, text: bytes | str) -> Self:
        """Read the text of `to_json`.

        Raises:
            ValueError: The text is not JSON, or of another version of the format.
            KeyError: An entry is missing.
            TypeError: An entry has another type.
        """
        document = json.loads(text)
        if document["format"] != _FORMAT:
            raise ValueError(f"format {document['format']} of another version")
        layout: dict[str, Any] = {
            k: tuple(v) if isinstance(v, list) else v for k, v in document["layout"].items()
        }
        layout["position_m"] = np.array(layout["position_m"])
        return cls(Layout(**layout), tuple(document["channels"]), document["config"], document["note"])

    def to_json(self) -> str:
        """Return all of it as one line of text, with the meaning of the quality codes."""
        layout = asdict(self.layout) | {"position_m": self.layout.position_m.tolist()}
        document = {"format": _FORMAT, "layout": layout, "channels": self.channels, "config": self.config}
        labels = {"quality": [q.label for q in EstimateQuality], "sensor_quality": [q.label for q in Quality]}
        return json.dumps(document | {"note": self.note, "codes": labels})

    @property
    def digest(self) -> str:
        """The hash of the configuration that made the steps; empty if unknown."""
        return str(self.config.get("hash", ""))

    @property
    def instance(self) -> str:
        """The instance of the service that published the steps; empty if unknown."""
        return str(self.config.get("instance", ""))

    @cached_property
    def arrays(self) -> dict[str, slice]:
        """The place of each array of an estimate among the numbers of a row.

        An array that the layout lacks has an empty slice.
        """
        layout, arrays, end = self.layout, dict[str, slice](), 0
        g, s = len(layout.position_m), len(layout.sensors)
        error = g if layout.has_error else 0
        widths = dict.fromkeys(("heat_W", "heat_sigma_W", "heat_bound_W", "law_W"), len(layout.sources))
        widths |= dict.fromkeys(("field_degC", "field_sigma_K", "field_bound_K"), g)
        widths |= dict.fromkeys(("error_um", "error_sigma_um", "error_bound_um"), error)
        widths |= dict.fromkeys(FORCE, int(layout.has_force))
        widths |= dict.fromkeys(("innovation_K", "innovation_sigma_K"), s)
        widths |= dict.fromkeys(("learned", "learned_sigma"), len(layout.learned))
        for name, width in widths.items():
            arrays[name] = slice(end, end + width)
            end += width
        return arrays

    @cached_property
    def dtype(self) -> np.dtype[Any]:
        """The type of a row: time, number, values and ages (c,), numbers of the estimate as float32, and
        codes.
        """
        c, numbers = len(self.channels), self.arrays["learned_sigma"].stop
        codes = 1 + len(PARTS) + len(self.layout.sensors) + c
        return np.dtype(
            [
                ("time_s", "<f8"), ("sequence", "<i8"), ("values", "<f8", (c,)), ("age_s", "<f8", (c,)),
                ("numbers", "<f4", (numbers,)), ("codes", "i1", (codes,)),
            ]
        )  # fmt: skip

    @cached_property
    def places(self) -> dict[str, tuple[str, int]]:
        """The field and the place of each column by name: those of `estimates.csv`, and each channel.

        A channel that is called like a column of the estimates gets `reading_` before its name.
        """
        places = {name: ("numbers", k) for k, name in enumerate(self._number_names())}
        places |= {name: ("codes", k) for k, name in enumerate(self._code_names())}
        places |= {name: ("values", k) for k, name in enumerate(self.value_names)}
        return places | {f"age_of_{name}_s": ("age_s", k) for k, name in enumerate(self.channels)}

    def _code_names(self) -> list[str]:
        names = ["quality", *(f"{part}_quality" for part in PARTS)]
        names += [f"quality_{sensor}" for sensor in self.layout.sensors]
        return names + [f"quality_of_{channel}" for channel in self.channels]

    @cached_property
    def value_names(self) -> tuple[str, ...]:
        """The column of the values of each channel, in the order of `channels`."""
        reserved = {"time_s", "sequence", *self._number_names(), *self._code_names()}
        return tuple(f"reading_{name}" if name in reserved else name for name in self.channels)

    def _number_names(self) -> list[str]:
        layout = self.layout
        names = [f"heat_{name}{end}" for end in ("_W", "_sigma_W", "_bound_W") for name in layout.sources]
        names += [f"law_{name}_W" for name in layout.sources]
        curves = {"field": ("degC", "sigma_K", "bound_K"), "error": ("um", "sigma_um", "bound_um")}
        for curve, ends in curves.items():
            if curve == "field" or layout.has_error:
                names += [f"{curve}_{1000 * x_m:.10g}_{end}" for end in ends for x_m in layout.position_m]
        names += FORCE if layout.has_force else ()
        for middle in ("", "sigma_"):
            names += [
                f"innovation_{n}_{middle}{u}" for n, u in zip(layout.sensors, layout.units, strict=True)
            ]
        names += [f"learned_{name}{end}" for end in ("", "_sigma") for name in layout.learned]
        return names

    def rows(self, frames: FrameBlock, estimates: EstimateBlock, sequence: int) -> NDArray[Any]:
        """Return K steps as rows.

        Args:
            frames: The frames, (K, c).
            estimates: The estimates made of them; arrays that are empty become NaN.
            sequence: Number of the first step.
        """
        rows = np.zeros(len(frames), self.dtype)
        rows["time_s"], rows["sequence"] = frames.time_s, sequence + np.arange(len(frames))
        rows["values"], rows["age_s"] = frames.values, frames.age_s
        for name, place in self.arrays.items():
            array = getattr(estimates, name)
            rows["numbers"][:, place] = array if array.size else np.nan
        qualities = estimates.quality[:, None], estimates.part_quality, estimates.sensor_quality
        rows["codes"] = np.hstack([*qualities, frames.quality])
        return rows
