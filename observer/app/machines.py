"""What is done for a machine before it runs: its first configuration, its service, a look at its wires."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

from observer.errors import UserError
from observer.installation import Installation


def init(output: Path, given: dict[str, str | None], ask: Callable[[str, str | None], str] | None) -> str:
    """Write a first configuration from what is given and the answers of `ask`; returns what to do next."""
    from observer.installation.init.compose import checked, write_new
    from observer.installation.init.questions import agreed

    if output.exists():  # before anything is asked
        raise UserError(f"{output}: is there already and is not overwritten; name another file with --output")
    write_new(output, agreed(given, ask, checked))
    return (
        f'written: {output}. What is marked "look" in it is a usual value. Next:\n'
        f"  observer check --config {output}           what it means\n"
        f"  observer check --config {output} --wires   what each device delivers\n"
        f"  observer run --config {output}             the service"
    )


def service(config_paths: Sequence[Path], root: Path, *, dry_run: bool) -> Iterator[str]:
    """Install the service of one axis or several, without any remove it; yields what is done, in words."""
    from observer.installation import unit
    from observer.installation.examine import examine

    here = root == Path("/")
    if not config_paths:
        plan = unit.to_remove(root)
    else:
        program = unit.this_program()
        if here and not dry_run:
            unit.refuse_unseen(program)
        axes = [
            unit.ServiceAxis(examine(path, runs_here=here), path, path.read_text(encoding="utf-8"))
            for path in config_paths
        ]
        plan = unit.to_install(axes, program, root)
    if dry_run:
        yield from plan.lines()
        return
    unit.carry_out(plan, root)
    yield from plan.lines() if here else (f"written below {root}; nothing was run",)
    if not config_paths:
        yield f"kept: {unit.CONFIG.parent} and {unit.STATE}"
        return
    yield f"from now on edit {', '.join(str(path) for path in plan.configurations)}"
    if here:
        yield f"it starts: journalctl -fu {unit.NAME}, then observer health"


def wires(config: Installation) -> dict[str, Any]:
    """Return what every device delivers in a few seconds. Raises `UserError` for a file it cannot use."""
    from observer.align.plausibility import Limits
    from observer.live.one_look import look

    limits, column = Limits.of(config), {name: j for j, name in enumerate(config.channels)}

    def doubt(channel: str, value: float) -> str | None:
        return limits.doubt(column[channel], value) if channel in column else None

    return look([settings.open(key) for key, settings in config.drivers.items()], doubt)
