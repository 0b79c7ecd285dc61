"""The next step after a search, in sentences and commands."""

from __future__ import annotations

from collections.abc import Sequence
from textwrap import fill
from typing import Any

from observer.report.wording import during, kelvin, name_of, um


def look_sentence(partial: dict[str, Any], logs: Sequence[str]) -> str:
    """Return where the largest residual of an effect is: sensor, log and phase, without a full stop.

    Args:
        partial: The entry `partial` of `result.json`.
        logs: The names of the logs, in the order of its `log` numbers.
    """
    doing = "" if partial["phase"] is None else f" {during(partial['phase'])}"
    return f"Look at {partial['most_on']} in {logs[partial['log'] - 1]}{doing}, where most of it remains"


def next_step(result: dict[str, Any], logs: str, config: str, output: str) -> dict[str, str | None]:
    """Return what to do next after a search.

    Args:
        result: The content of `result.json`.
        logs: The logs as in a shell, or `--recent …`.
        config: The configuration's path.
        output: The folder of the results.

    Returns:
        `text`, a sentence without its full stop, and `command`; the command is None where none can be given
            yet.
    """
    search = f"observer discover {logs} --config {config} --output {output}"
    adopt = f"observer adopt {output} --config {config}"
    verdict, partial, test = result["verdict"], result["partial"], result["experiment"]
    text, command = "Record a longer or more varied log, and search again with it", None
    with_more = None if logs.startswith("--") else search.replace(" discover", " discover NEW", 1)
    decides = test is not None and test.get("program") is not None
    if result["suspects"] and not result["effects"]:
        text, command = "Correct what is wrong with the logs, then search again", search
    elif verdict == "named":
        text, command = "Put it in force; --undo restores the previous configuration", adopt
    elif partial is not None:
        text = look_sentence(partial, result["logs"])
        if decides:
            text += f"; to decide, run {test['program']}, record it as a log, NEW, and search again with it"
            command = with_more
        if partial["explains_most"]:
            text += (
                f"; {partial['candidate']} explains most, and can be put in force if you can say what it is"
            )
            command = f"{adopt} --candidate"
    elif test is not None:
        text, command = "Record the test as a log, NEW, and search again with it", with_more
    elif verdict == "none":
        text = "Nothing needs to be added; to keep the calibrated values, write them"
        fitted = f"observer calibrate {logs} --config {config} --output {output}"
        command = None if logs.startswith("--") else fitted
        if result["gap"]["after_rms_K"] > result["gap"]["as_given_rms_K"]:
            text = "Nothing needs to be added, and the calibrated values are no better than those configured"
            command = None
    moved = result["displacements"]
    if moved is not None and moved["verdict"] == "named" and verdict == "none":
        cause = moved["causes"][0]
        text = f"Look at what the displacements show, {cause['key']}: it moves the axis and warms nothing"
        if cause["key"] == "bed.expansion_1_K" and not cause["before"]:
            text = f"Give a [bed] with expansion_1_K = {cause['value']:.3g} and the channel of the air"
        elif cause["key"].startswith(("screw.", "supports.", "bed.")):
            text = f"Put {cause['key']} into [calibrate] free, and calibrate by the same logs"
    return {"text": text, "command": command}


def candidate_comment(partial: dict[str, Any]) -> str:
    """Return the comment at the top of `candidate.toml`: it is not a result, and part stays unexplained.

    Args:
        partial: The entry `partial` of `result.json`.
    """
    proof, worth = partial["proof"], partial["worth"]
    before_K, after_K = (kelvin(proof[f"{key}_rms_K"]) for key in ("before", "after"))
    leaves = f"the gap on data held back goes from {before_K} to {after_K} rms"
    if worth is not None:
        leaves += f", as thermal error from {um(worth['before_rms_um'])} to {um(worth['after_rms_um'])}"
    head = "A candidate, not a result"
    if not partial["explains_most"]:
        head = "A weak candidate, under half explained where fitted or on data held back"
    text = (
        f"{head}: {name_of(partial)} explains {100 * partial['share']:.0f} % of what this "
        f"model lacks, and something else remains; {leaves}. "
        "`observer adopt` takes it only with --candidate."
    )
    return fill(text, 100, initial_indent="# ", subsequent_indent="# ") + "\n\n"
