"""The properties of a configuration, and the readings of its devices, for people: `observer check`."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from observer.report.sensitivity import IN_BOUND, SHIFT_SAID, advice, buys
from observer.units import symbol_of


def as_text(result: dict[str, Any]) -> RenderableType:
    """Return the findings laid out for a terminal: verdict, warnings, what to do, and the figures behind
    them.

    Args:
        result: The document of `observer check --json`.
    """
    table = Table(show_header=False, box=None, pad_edge=False)
    table.add_column(style="bold", no_wrap=True)
    table.add_column()
    steps = ", ".join(f"{e:.2g} K/W after {t}" for t, e in result["transient_error_K_W"].items())
    left_out = result["steady_part_left_out"]
    table.add_row(
        "modes", f"{result['modes']} kept, by {result['criterion']}: {_spans(result['mode_numbers'])}"
    )
    table.add_row("", f"alone they leave out {left_out:.1e} of a steady field; the static correction adds it")
    table.add_row("", f"dropped modes settle within {result['dropped_modes_settle_s']:.3g} s")
    table.add_row("transient error", f"of a heat step: at most {steps}")
    biot = result["biot"]
    table.add_row("Biot number", f"{biot['number']:.2g}, under a film of {biot['film_W_m2K']:.3g} W/m²K")
    table.add_row("weakest mode", _weakest(result))
    table.add_row("estimator", result["estimator"] + _bandwidth(result["bandwidth_1_s"]))
    table.add_row("slowest poles, 1/s", "plant    " + _poles(result["eigenvalues_1_s"]))
    if result["poles_requested_1_s"]:
        table.add_row("", "asked    " + _poles(sorted(result["poles_requested_1_s"], reverse=True)))
    table.add_row("", "reached  " + _poles(result["poles_reached_1_s"]))
    for name, gain in result["noise_gain_W_K"].items():
        text = "not determined" if gain is None else f"{gain:.3g} W of heat per K of sensor noise"
        table.add_row(f"noise gain {name}", text)
    for name, limit_rpm in result["path_told_up_to_rpm"].items():
        table.add_row(f"path of {name}", f"sampled often enough up to {limit_rpm:.0f} rpm, averaged above")
    for name, heartbeat_s in result["heartbeat_s"].items():
        text = f"sends only on change; its last value counts for {heartbeat_s:g} s, and is stale after that"
        table.add_row(name, text)
    if result["supports"] is not None:
        table.add_row("supports", _supports_text(result["supports"]))
    for name, node in result["nodes"].items():
        seconds, rise = node["time_constant_s"], node["rise_K_W"]
        table.add_row(
            f"node {name}",
            f"follows within {seconds:{'.0f' if seconds >= 1000 else '.3g'}} s; 1 W warms it by {rise:.3g} K",
        )
    table.add_row("tolerances", Text(result["tolerances_left_out"] or SHIFT_SAID))
    if result["improve_first"]:
        table.add_row("improve first", Text(advice(result["improve_first"])))
    if result["not_screened"]:
        table.add_row("faults in values", Text(result["not_screened"]))
    if result["predicted_without"]:
        lost = " or ".join(result["predicted_without"])
        table.add_row(
            "if a sensor fails", Text(f"without {lost} some heats are only predicted, by their laws")
        )
    verdict, warnings = (
        result["verdict"],
        [w for w in result["warnings"] if w not in result["verdict"]["text"]],
    )
    style = "red" if not verdict["usable"] else "yellow" if result["warnings"] else "green"
    opening = [Text(verdict["text"], style=style), *(Text(f"warning: {w}", style="yellow") for w in warnings)]
    costs = [_costs(result["tolerances"])] if result["tolerances"] else []
    least = _least(result["minimal_detectable"], result["further_sensor"], result["slow_in_sigma"])
    return Group(*opening, Text(_to_do(result)), Text(), table, *costs, *least)


def _to_do(result: dict[str, Any]) -> str:
    """Whether anything has to be done, before the figures that explain the design."""
    if not result["verdict"]["usable"]:
        return "To do: change the configuration as the first line says."
    if result["warnings"]:
        return "To do: what the warnings name. The figures below explain the design and ask for nothing."
    return "Nothing has to be done. The figures below explain the design."


def _grid(heads: Sequence[str], rows: Iterable[Sequence[str]]) -> Table:
    """A table of a name and numbers."""
    table = Table(show_header=True, box=None, pad_edge=False, header_style="bold")
    for i, head in enumerate(heads):
        table.add_column(head, no_wrap=i == 0, justify="right" if i else "left", overflow="fold")
    for row in rows:
        table.add_row(*map(Text, row))
    return table


def _costs(rows: list[dict[str, Any]]) -> Table:
    """σ over the standard shift: as configured, with one tolerance at zero, with all at zero."""
    has_error = rows[0]["error_sigma_um"] is not None
    heats = [f"{name}, W" for name in rows[0]["heat_sigma_W"]]
    lines = []
    for row in rows:
        values = [*row["heat_sigma_W"].values(), row["field_sigma_K"]]
        values += [row["error_sigma_um"]] if has_error else []
        tolerance = "" if row["tolerance"] is None else f"{row['tolerance']:g}"
        lines.append([row["key"], tolerance, *(f"{value:.3g}" for value in values)])
    return _grid(["σ if known", "now", *heats, "field, K", *["error, µm"] * has_error], lines)


def _least(
    rows: dict[str, dict[str, Any]], further: dict[str, Any] | None, in_sigma: bool
) -> list[RenderableType]:
    """The smallest fault of each sensor that is noticed, where others are allowed for, and what a further
    sensor would gain.
    """
    if not rows:
        return []
    keys = ("fault_K", "time_s", "slow_K")
    lines = [[n, *("–" if r[k] is None else f"{r[k]:.3g}" for k in keys)] for n, r in rows.items()]
    table = _grid(["sensor", "jump noticed, K", "within, s", "slow fault noticed, K"], lines)
    sentences = ["" if in_sigma else IN_BOUND, buys(further)]
    return [table, *(Text(words) for words in sentences if words)]


def _weakest(result: dict[str, Any]) -> str:
    share, sensor = result["weakest_mode_share"], result["weakest_mode_sensor"]
    return f"mode {result['weakest_mode']}, best seen by {sensor}: {share:.0%} of what the best place sees"


def _supports_text(supports: dict[str, Any]) -> str:
    text = f"{supports['mounting']}, {supports['force_at_10_K_N']:.0f} N in a screw 10 K warm"
    lost_K, closed_K = supports["pretension_lost_at_rise_K"], supports["gap_closed_at_rise_K"]
    text += f"; pre-tension lost at {lost_K:.3g} K" if lost_K else ""
    return text + (f"; gap closed at {closed_K:.3g} K" if closed_K > lost_K else "")


def _bandwidth(omega_1_s: float | None) -> str:
    return "" if omega_1_s is None else f", bandwidth {omega_1_s:.3g} 1/s"


def _poles(poles: list[float], most: int = 6) -> str:
    text = "  ".join(f"{p + 0.0:.3g}" for p in poles[:most])
    return text + (f"  … {poles[-1]:.3g}" if len(poles) > most else "") if poles else "none"


def _spans(numbers: list[int]) -> str:
    if numbers == list(range(1, len(numbers) + 1)):
        return f"1 to {len(numbers)}"
    return ", ".join(map(str, numbers))


def wires_as_text(result: dict[str, Any]) -> RenderableType:
    """Return the readings laid out for a terminal: a line for each driver, below it one for each of its
    channels.

    Remedies follow the table, each once with the channels that it concerns.

    Args:
        result: The document of `observer check --wires --json`.
    """
    table = Table(show_header=False, box=None, pad_edge=False)
    for _ in range(4):
        table.add_column(overflow="fold")
    remedies: dict[str, list[str]] = {}
    for name, driver in result["drivers"].items():
        state = "connected" if driver["connected"] else "not connected"
        table.add_row(Text(name, style="bold"), state, _rate(driver), _errors(driver))
        for channel, one in driver["channels"].items():
            style = "" if one["usable"] else "yellow"
            table.add_row(*(Text(cell, style=style) for cell in _cells(channel, one)))
            if one["remedy"]:
                remedies.setdefault(one["remedy"], []).append(channel)
    if not result["drivers"]:
        return Text("no drivers: write a [drivers.…] table for each device", style="yellow")
    verdict = (
        "every channel came" if result["good"] else "warning: not every channel delivered a usable value"
    )
    lines = (Text(f"{', '.join(channels)}: {remedy}") for remedy, channels in remedies.items())
    return Group(table, Text(verdict, style="green" if result["good"] else "yellow"), *lines)


def _cells(channel: str, one: dict[str, Any]) -> tuple[str, str, str, str]:
    value = "–" if one["value"] is None else f"{one['value']:.6g} {symbol_of(channel)}".rstrip()
    age = "" if one["age_s"] is None else f"{one['age_s']:.2f} s old"
    return f"  {channel}", value, age, one["fault"] or one["implausible"] or ""


def _rate(driver: dict[str, Any]) -> str:
    rate, expected = driver["rate_Hz"], 1.0 / driver["period_s"]
    measured = "nothing" if rate is None else f"{rate:.3g} Hz"
    return f"{measured}, {expected:.3g} Hz wanted"


def _errors(driver: dict[str, Any]) -> str:
    if not driver["connected"] or (not driver["errors"] and not driver["last_error"]):
        return ""  # the remedy of its channels is the reason
    return f"{driver['errors']} errors, the last: {driver['last_error'] or 'unknown'}"
