"""Variants of a machine side by side: in the steady state or over a cycle, and the best way to mount each."""

from __future__ import annotations

import csv
import tomllib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, NamedTuple, get_args

import numpy as np

from observer.errors import ConfigError, check_choice
from observer.estimators.design.spread import NotDefined, spread
from observer.files.documents import write_json
from observer.files.folders import results_in
from observer.files.logs import Log
from observer.files.regular import read_toml
from observer.installation import Installation
from observer.installation.variants import Variant, variants_of
from observer.library.cases import CaseFigures, SurveyedCase, as_document, cycle_case, steady_case
from observer.library.given import GivenLog, as_program
from observer.library.packages import in_words
from observer.model.build import build_plant
from observer.model.cycle import standard_shift
from observer.model.rod.mountings import MountedScrew, MountingProblem, best_of_each
from observer.report.sensitivity import few_modes

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_OF_SENSORS = ("sensor", "estimator", "tolerance")
"""Variants that differ in these are also compared by the σ that remain."""
Aim = Literal["error"]
GivenVariants = str | Path | Mapping[str, Any]
"""A variants' file, or the table of one."""


class LeftUnknown(NamedTuple):
    """Mean σ over the standard shift: of each estimated heat, W, of the field, K, of the thermal error, µm,
    None without an expansion coefficient.
    """

    heat_W: dict[str, float]
    field_K: float
    error_um: float | None


@dataclass(frozen=True, eq=False, repr=False)
class Comparison:
    """Variants side by side: `cases`, their figures; `unknown`, the σ that remain of each where variants
    differ in sensors, else none; `mounted`, by variant the best of each mounting, the best first, where that
    was asked for; `sentences` about how; `document`, the content of `compare.json`.
    """

    cases: tuple[CaseFigures, ...]
    unknown: dict[str, LeftUnknown | None]
    mounted: dict[str, list[MountedScrew]]
    sentences: tuple[str, ...]
    document: dict[str, Any]
    _title: str
    _words: str

    def __repr__(self) -> str:
        return f"<Comparison: {self._title}; {', '.join(case.name for case in self.cases)}>"

    @in_words
    def to_pandas(self) -> Any:
        """Return a `pandas.DataFrame` of the figures in `compare.csv`, with the variants' names as its index.

        Raises `UserError` without pandas.
        """
        import pandas

        return pandas.DataFrame(
            self._rows(), pandas.Index([case.name for case in self.cases], name="variant")
        )

    def _rows(self) -> list[dict[str, float]]:
        """The figures of each variant by their columns, with the σ that remain where they are known."""
        return [case.columns | _sigma_columns(self.unknown.get(case.name)) for case in self.cases]

    @in_words
    def plot(self) -> list[Axes]:
        """Draw the picture that the command writes, as a figure of pyplot, and return its axes."""
        from observer.report.comparison import draw_cases
        from observer.report.pictures import shown

        with shown() as figure:
            return draw_cases(figure, self.cases, self._title, self._words)

    @in_words
    def write(self, folder: str | Path) -> None:
        """Write `compare.csv`, `compare.json` and `compare.png` into a folder. Raises `UserError`."""
        from observer.report.comparison import draw_cases
        from observer.report.pictures import written

        rows = self._rows()
        names = list(dict.fromkeys(name for row in rows for name in row))
        with results_in(Path(folder)) as part:
            with (part / "compare.csv").open("w", encoding="utf-8", newline="") as file:
                table = csv.DictWriter(file, ["variant", *names], restval="", lineterminator="\n")
                table.writeheader()
                for case, row in zip(self.cases, rows, strict=True):
                    table.writerow({"variant": case.name, **row})
            write_json(part / "compare.json", self.document)
            with written(part / "compare.png") as figure:
                draw_cases(figure, self.cases, self._title, self._words)


def compared(
    config: Installation,
    source: bytes,
    given: GivenVariants,
    log: GivenLog | None,
    *,
    steady: bool = False,
    minimise: Aim | None = None,
    progress: Callable[[str, float], None] = lambda _text, _done: None,
) -> Comparison:
    """Compare variants of a configuration with its text `source`: those of a file, or of the table of one.

    They are compared in their steady states, or over a log's cycle. Raises `ConfigError` or `LogError`.
    """
    if minimise is not None:
        check_choice("minimise", minimise, get_args(Aim))
    if log is None and not steady:
        raise ConfigError("compare: ask for the steady state, or give a log of a cycle")
    of_file = isinstance(given, str | Path)
    table = read_toml(Path(given), "variants") if isinstance(given, str | Path) else given
    variants = variants_of(table, str(given) if of_file else "variants", tomllib.loads(source.decode()))
    spare = {channel for variant in variants for channel in variant.inputs}
    program = None if log is None else as_program(log, config, "log", spare)
    found, mounted, sentences = [], {}, dict[str, None]()
    for i, variant in enumerate(variants):
        progress(variant.name, i / len(variants))
        case = _case(variant, program, steady=steady)
        found.append(case.figures)
        if minimise is not None:
            mounted[variant.name] = _mounted(variant, case)
            sentences |= dict.fromkeys(_kept_fixed(variant.config))
    unknown = _left_unknown(variants, progress)
    words = "steady state" if steady else "highest over the cycle; heats are means"
    machine = variants[0].config.machine
    document = {
        "steady": steady,
        "log": None if program is None else program.path.name,
        "variants": [_document(v, case, unknown) for v, case in zip(variants, found, strict=True)],
        "minimised": {name: [_as_row(m) for m in best] for name, best in mounted.items()},
        "sentences": list(sentences),
    }
    title = f"{machine.name}, axis {machine.axis}: variants"
    return Comparison(tuple(found), unknown, mounted, tuple(sentences), document, title, words)


def _case(variant: Variant, log: Log | None, *, steady: bool) -> SurveyedCase:
    try:
        if steady or log is None:
            return steady_case(variant.name, variant.config, variant.inputs, log)
        return cycle_case(variant.name, variant.config, variant.inputs, log)
    except ConfigError as error:
        raise ConfigError(f'variant "{variant.name}": {error}') from None


def _mounted(variant: Variant, case: SurveyedCase) -> list[MountedScrew]:
    """The best of each mounting of a variant."""
    screw, growth = variant.config.screw, case.growth
    if growth is None:
        raise ConfigError(
            f'variant "{variant.name}": there is no thermal error to minimise; give screw.expansion_1_K'
        )
    given = variant.config.supports
    permitted_N = None if given is None else given.permitted_load_N
    grid_m = case.figures.position_m
    problem = MountingProblem(screw, grid_m, case.travel, growth.along_um, growth.whole_um, permitted_N)
    return best_of_each(problem, given)


def _kept_fixed(config: Installation) -> Iterator[str]:
    """What a search for the best mounting leaves unchanged, a sentence each."""
    yield "L-I lets the screw slide at both ends: its error counts from the screw's middle"
    for source in config.source:
        if source.nut_friction is not None and source.nut_friction.preload_N:
            yield (
                f"nut_friction.preload_N of {source.name} is the nut's own preload, not the screw's: it "
                "stays as configured, and so does its heat"
            )
        if source.bearing is not None:
            yield (
                f"the heat of {source.name} stays that of its configured load: what the axial force adds "
                "to its friction is not in the errors"
            )
    if (held := config.supports) is None or held.mounting != "L-III" or held.stiffness_first_N_m is None:
        yield "a support without a stiffness is taken as rigid, which overstates force and understates error"


def _left_unknown(
    variants: Sequence[Variant], progress: Callable[[str, float], None]
) -> dict[str, LeftUnknown | None]:
    """The σ that remain, where variants differ in what is measured or known."""
    if not any(key.split(".")[0] in _OF_SENSORS for variant in variants for key in variant.changed):
        return {}
    unknown = dict[str, LeftUnknown | None]()
    for variant in variants:
        progress(f"what {variant.name} leaves unknown", 1.0)
        config = few_modes(variant.config)
        plant = build_plant(config, learns=True)
        every = np.ones((1, len(plant.parameters.kind)))
        found = spread(plant, config.estimator, standard_shift(config, plant), every)
        names = [s.name for s in config.source if s.estimate]
        unknown[variant.name] = (
            None
            if isinstance(found, NotDefined)
            else LeftUnknown(
                dict(zip(names, found.heat_W[0].tolist(), strict=True)),
                float(found.field_K[0]),
                None if found.error_um is None else float(found.error_um[0]),
            )
        )
    return unknown


def _sigma_columns(left: LeftUnknown | None) -> dict[str, float]:
    if left is None:
        return {}
    found = {f"heat_{name}_sigma_W": sigma for name, sigma in left.heat_W.items()}
    found["field_sigma_K"] = left.field_K
    return found if left.error_um is None else found | {"error_sigma_um": left.error_um}


def _document(variant: Variant, case: CaseFigures, unknown: dict[str, LeftUnknown | None]) -> dict[str, Any]:
    left = unknown.get(variant.name)
    return as_document(case) | {
        "inputs": dict(variant.inputs),
        "changed": list(variant.changed),
        "sigma": None if left is None else left._asdict(),
    }


def _as_row(mounted: MountedScrew) -> dict[str, Any]:
    supports = mounted.supports
    return {
        "mounting": supports.mounting,
        "first": supports.first,
        "preload_N": supports.preload_N,
        "gap_m": supports.gap_m,
        "largest_error_um": mounted.error_um,
        "largest_at_m": mounted.position_m,
        "force_N": mounted.force_N,
    }
