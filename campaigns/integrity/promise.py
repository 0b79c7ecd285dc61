"""What the campaign is asked, fixed before any of its machines was run with the monitor."""

from __future__ import annotations

from campaigns.integrity.catalogue import GROUP_OF, LEGITIMATE

Row = dict[str, str]
MONTH_H = 720.0
MOST_BEYOND, MOST_WRONG = 0.005, 0.01
"""Of the good steps, beyond the bound and beyond 3 σ."""
LEAST_GOOD, MOST_OUT_A_MONTH = 0.97, 1.0
"""Where nothing is wrong."""
MOST_MACHINES_BEYOND = 0.01
"""Of those where nothing is wrong, with a good step beyond the bound."""
MOST_BOUND = 3.0
"""Of the 95 % half width of the error."""
NOTICED_S = 60.0
SLOW_COMMON, TWICE_THE_LEAST = "slow common", "twice the least noticed"


def total(rows: list[Row], column: str) -> float:
    """A column's sum."""
    return float(sum(float(r[column]) for r in rows))


def short_of(rows: list[Row]) -> list[str]:
    """What is not as promised, a sentence each."""
    found = [] if any(r["beyond"] for r in rows) else ["no estimate has a bound"]
    for name, group in GROUP_OF.items():
        own = [r for r in rows if r["fault"] == name]
        if own:
            found += [f"{name}: {words}" for words in _short_of(name, group, own)]
    return found


def _short_of(name: str, group: str, own: list[Row]) -> list[str]:
    good, steps = total(own, "good"), total(own, "steps")
    found = []
    beyond, wrong = sum(float(r["beyond"] or 0) for r in own), total(own, "wrong")
    if beyond > MOST_BEYOND * good:
        found.append(f"{100 * beyond / good:.1f} % of the good steps beyond the bound")
    if group != SLOW_COMMON and wrong > MOST_WRONG * good:
        found.append(f"{100 * wrong / good:.1f} % of the good steps beyond 3 σ")
    if name in LEGITIMATE:
        found += _short_without_fault(own, good / steps, total(own, "out") * MONTH_H * 3600.0 / steps)
    if group == TWICE_THE_LEAST:
        late = [r for r in own if not _noticed(r)]
        found += [f"not noticed in {NOTICED_S:.0f} s on {len(late)} of {len(own)}"] if late else []
    return found


def _short_without_fault(own: list[Row], good: float, out_a_month: float) -> list[str]:
    found = []
    having = sum(float(r["beyond"] or 0) > 0.0 for r in own)
    if having > MOST_MACHINES_BEYOND * len(own):
        found.append(f"a good step beyond the bound on {having} of {len(own)}")
    if good < LEAST_GOOD:
        found.append(f"{100 * good:.1f} % good")
    if out_a_month > MOST_OUT_A_MONTH:
        found.append(f"{out_a_month:.1f} times a month a sensor is taken out")
    wide = [r for r in own if r["bound_um"] and float(r["bound_um"]) > MOST_BOUND * float(r["half_um"])]
    if wide:
        found.append(f"bound beyond {MOST_BOUND:g} times the interval on {len(wide)} of {len(own)}")
    return found


def _noticed(row: Row) -> bool:
    """In time, the sensor at fault and no other."""
    return row["right"] == "yes" and all(float(row[s]) <= NOTICED_S for s in ("bad_s", "named_s") if row[s])
