"""Variants of a machine side by side: in the steady state or over a cycle, and the best way to mount each."""

from __future__ import annotations

import csv
import tomllib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, NamedTuple, get_args

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
    """The mean standard deviations over the standard shift.

    Attributes:
        heat_W: Of each estimated heat, by source.
        field_K: Of the temperature along the screw.
        error_um: Of the thermal error; None without an expansion coefficient.
    """

    heat_W: dict[str, float]
    field_K: float
    error_um: float | None


@dataclass(frozen=True, eq=False, repr=False)
class Comparison:
    """Variants side by side.

    Attributes:
        cases: The figures of each variant, in the order of the file.
        unknown: The σ that remain, by variant; empty unless variants differ in sensors. None for a variant
            whose σ is undefined.
        mounted: By variant the best of each mounting, the best first; empty unless minimised.
        sentences: What the search for mountings leaves unchanged.
        document: The content of `compare.json`.
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
        """Return a `pandas.DataFrame` of the figures in `compare.csv`, with the variants' names as its
        index.

        A figure that a variant lacks is NaN.

        Raises:
            UserError: pandas is not installed.
        """
        import pandas

        return pandas.DataFrame(
            self._rows(), pandas.Index([case.name for case in self.cases], name="variant")
        )

    def _rows(self) -> list[dict[str, float]]:
        """Return the figures of each variant by column, with the σ that remain where they were computed."""
        return [case.columns | _sigma_columns(self.unknown.get(case.name)) for case in self.cases]

    @in_words
    def plot(self) -> list[Axes]:
        """Draw the picture that the command writes, as a figure of pyplot, and return its axes.

        Raises:
            UserError: matplotlib is not installed.
        """
        from observer.report.comparison import draw_cases
        from observer.report.pictures import shown

        with shown() as figure:
            return draw_cases(figure, self.cases, self._title, self._words)

    @in_words
    def write(self, folder: str | Path) -> None:
        """Write `compare.csv`, `compare.json` and `compare.png` into a folder.

        Args:
            folder: Is created if it is missing; files of the same names are replaced.

        Raises:
            UserError: The folder cannot be written; then it is as it was before.
        """
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
    variants_given: GivenVariants,
    log: GivenLog | None,
    *,
    steady: bool = False,
    minimise: Aim | None = None,
    progress: Callable[[str, float], None] = lambda _text, _share: None,
) -> Comparison:
    """Compare variants of a configuration in their steady states, or over a log's cycle.

    Args:
        config: The machine whose channels the log has.
        source: The text of its configuration, which the variants override.
        variants_given: A variants' file, or its table.
        log: The cycle; with `steady` the log whose means are the inputs. None for the inputs of the variants.
        steady: Compare steady states.
        minimise: `"error"` also searches the mounting, preload and gap with the least thermal error.
        progress: Receives the name of the variant and the share of the work that is done, 0 to 1.

    Raises:
        ConfigError: A variant is invalid, has no steady state, or has no thermal error to minimise; the
            sentence names the variant. Also if neither `steady` nor a log is given.
        LogError: The log cannot be read, or an input has no value in it.
        UserError: `minimise` is unknown.
    """
    if minimise is not None:
        check_choice("minimise", minimise, get_args(Aim))
    if log is None and not steady:
        raise ConfigError(
            "compare: give a log, the cycle of each variant, or ask for the steady state (--steady)"
        )
    of_file = isinstance(variants_given, str | Path)
    table = (
        read_toml(Path(variants_given), "variants")
        if isinstance(variants_given, str | Path)
        else variants_given
    )
    variants = variants_of(
        table, str(variants_given) if of_file else "variants", tomllib.loads(source.decode())
    )
    spare = {channel for variant in variants for channel in variant.inputs}
    program = None if log is None else as_program(log, config, "log", spare)
    figures, mounted, sentences = [], {}, dict[str, None]()
    for i, variant in enumerate(variants):
        progress(variant.name, i / len(variants))
        case = _case(variant, program, steady=steady)
        figures.append(case.figures)
        if minimise is not None:
            mounted[variant.name] = _mounted(variant, case)
            sentences |= dict.fromkeys(_kept_fixed(variant.config))
    unknown = _left_unknown(variants, progress)
    words = "steady state" if steady else "highest over the cycle; heats are means"
    machine = variants[0].config.machine
    document = {
        "steady": steady,
        "log": None if program is None else program.path.name,
        "variants": [_document(v, case, unknown) for v, case in zip(variants, figures, strict=True)],
        "minimised": {name: [_as_row(m) for m in best] for name, best in mounted.items()},
        "sentences": list(sentences),
    }
    title = f"{machine.name}, axis {machine.axis}: variants"
    return Comparison(tuple(figures), unknown, mounted, tuple(sentences), document, title, words)


def _case(variant: Variant, log: Log | None, *, steady: bool) -> SurveyedCase:
    try:
        if steady or log is None:
            return steady_case(variant.name, variant.config, variant.inputs, log)
        return cycle_case(variant.name, variant.config, variant.inputs, log)
    except ConfigError as error:
        raise ConfigError(f'variant "{variant.name}": {error}') from None


def _mounted(variant: Variant, case: SurveyedCase) -> list[MountedScrew]:
    """Return the best of each mounting of a variant. Raises `ConfigError` without an expansion
    coefficient.
    """
    screw, growth = variant.config.screw, case.growth
    if growth is None:
        raise ConfigError(
            f'variant "{variant.name}": there is no thermal error to minimise; give screw.expansion_1_K'
        )
    supports = variant.config.supports
    permitted_N = None if supports is None else supports.permitted_load_N
    grid_m = case.figures.position_m
    problem = MountingProblem(screw, grid_m, case.travel, growth.along_um, growth.whole_um, permitted_N)
    return best_of_each(problem, supports)


def _kept_fixed(config: Installation) -> Iterator[str]:
    """Yield a sentence for each thing that a search for the best mounting leaves unchanged."""
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
    if (
        (supports := config.supports) is None
        or supports.mounting != "L-III"
        or supports.stiffness_first_N_m is None
    ):
        yield "a support without a stiffness is taken as rigid, which overstates force and understates error"


def _left_unknown(
    variants: Sequence[Variant], progress: Callable[[str, float], None]
) -> dict[str, LeftUnknown | None]:
    """Return the σ that remain by variant, None where undefined.

    Empty unless variants differ in sensors or in known parameters.
    """
    if not any(key.split(".")[0] in _OF_SENSORS for variant in variants for key in variant.changed):
        return {}
    unknown = dict[str, LeftUnknown | None]()
    for variant in variants:
        progress(f"what {variant.name} leaves unknown", 1.0)
        config = few_modes(variant.config)
        plant = build_plant(config, learns=True)
        sigmas = spread(config, [plant], config.reading_s)
        names = [s.name for s in config.source if s.estimate]
        unknown[variant.name] = (
            None
            if isinstance(sigmas, NotDefined)
            else LeftUnknown(
                dict(zip(names, sigmas.heat_W[0].tolist(), strict=True)),
                float(sigmas.field_K.mean()),
                float(sigmas.error_um.mean()) if sigmas.error_um.size else None,
            )
        )
    return unknown


def _sigma_columns(left: LeftUnknown | None) -> dict[str, float]:
    if left is None:
        return {}
    columns = {f"heat_{name}_sigma_W": sigma for name, sigma in left.heat_W.items()}
    columns["field_sigma_K"] = left.field_K
    return columns if left.error_um is None else columns | {"error_sigma_um": left.error_um}


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
