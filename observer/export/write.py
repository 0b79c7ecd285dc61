"""Forms as files in a folder."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from importlib.resources import files
from pathlib import Path
from string import Template
from typing import Any
from uuid import NAMESPACE_URL, uuid5

import numpy as np

from observer.export.c99 import c99_files
from observer.export.fmu import write_fmu
from observer.export.form import Form, Slot
from observer.export.structured_text import block_name, structured_text
from observer.export.subset import OperationCount

README = "README.md"


def template(name: str) -> Template:
    """Return a text of `templates/` by its file name, with `$` before the names to fill in."""
    return Template((files("observer.export") / "templates" / name).read_text(encoding="utf-8"))


def write_texts(folder: Path, texts: Mapping[str, str]) -> list[str]:
    """Write texts to files of their names in an existing folder; files of the same names are replaced.

    Returns:
        The names.

    Raises:
        OSError: If a file cannot be written.
    """
    for name, text in texts.items():
        (folder / name).write_text(text, encoding="utf-8")
    return list(texts)


def write_c99(form: Form, folder: Path) -> list[str]:
    """Write header, source and README into an existing folder.

    Returns:
        The files' names.

    Raises:
        OSError: If a file cannot be written.
    """
    labels = {slot.name: slot.labels for slot in form.slots if slot.labels}
    first = f"[{form.name.upper()}_READING_{labels['reading'][0].upper()}]"
    fields = {"first_reading": f"in.reading{first}", "first_fresh": f"in.fresh{first}"}
    return write_texts(folder, c99_files(form) | {README: readme("c99.md", form, fields)})


def readme(name: str, form: Form, fields: Mapping[str, str]) -> str:
    """Return a README from its template: description of the form, its cost, and `fields`.

    The cost is operations a step, and bytes of tables and state in double and single precision.

    Args:
        name: The template's file name.
        form: The step that the README describes.
        fields: Further texts to fill in, by name.
    """
    count = OperationCount(form).count()
    costs = {key: f"{count[key]:,}" for key in ("adds", "multiplies", "divides", "compares")}
    for real in (8, 4):
        costs[f"tables{real}"] = f"{sum(_bytes_of(v, real) for v in form.constants.values()):,}"
        costs[f"state{real}"] = f"{sum(_slot_bytes(slot, real) for slot in form.of('state')):,}"
    facts = "\n".join(f"- {fact}" for fact in form.facts)
    facts_of_form = {"title": form.title, "name": form.name, "NAME": form.name.upper(), "facts": facts}
    return template(name).substitute(facts_of_form, period=f"{form.period_s:g}", **costs, **fields)


def _bytes_of(value: Any, real: int) -> int:
    array = np.asarray(value)
    return 0 if array.ndim == 0 else array.size * (4 if np.issubdtype(array.dtype, np.integer) else real)


def _slot_bytes(slot: Slot, real: int) -> int:
    return int(np.prod(slot.shape, initial=1)) * {"real": real, "int": 4, "bool": 1}[slot.kind]


def write_st(form: Form, folder: Path, real: str = "LREAL") -> list[str]:
    """Write the function block as text and for TwinCAT, and a README.

    Args:
        form: The step.
        folder: An existing folder.
        real: The type of its reals, `LREAL` or `REAL`.

    Returns:
        The files' names.

    Raises:
        ConfigError: If two names differ at most in capitals.
        OSError: If a file cannot be written.
    """
    first = next(slot.labels for slot in form.slots if slot.name == "reading")[0]
    fields = {"first": first, "block": block_name(form), "real": real}
    name, text = block_name(form), structured_text(form, real)
    texts = {
        f"{name}.st": text,
        f"{name}.TcPOU": twincat_file(name, text),
        README: readme("st.md", form, fields),
    }
    return write_texts(folder, texts)


def twincat_file(name: str, text: str) -> str:
    """Return a function block's text as the XML file of a TwinCAT 3 project.

    Its identity is a hash of the text, so the same block gives the same file.

    Args:
        name: The function block's name.
        text: What `structured_text` returns.
    """
    declaration, end, body = text.rpartition("END_VAR\n")
    body = body.removesuffix("END_FUNCTION_BLOCK\n")
    declared, body = (part.replace("]]>", "]]]]><![CDATA[>") for part in (declaration + end, body))
    identity = uuid5(NAMESPACE_URL, text)
    return (
        '<?xml version="1.0" encoding="utf-8"?>\n<TcPlcObject Version="1.1.0.1">\n'
        f'  <POU Name="{name}" Id="{{{identity}}}" SpecialFunc="None">\n'
        f"    <Declaration><![CDATA[{declared}]]></Declaration>\n"
        f"    <Implementation>\n      <ST><![CDATA[{body}]]></ST>\n    </Implementation>\n"
        "  </POU>\n</TcPlcObject>\n"
    )


def write_fmus(observer: Form, model: Form, folder: Path) -> tuple[list[str], list[str]]:
    """Write an FMU of the observer and one of the plant.

    Args:
        observer: The form of the observer.
        model: The form of the plant.
        folder: An existing folder.

    Returns:
        The files' names, and a sentence about the binary of each.

    Raises:
        OSError: If a file cannot be written.
    """
    shim, first = template("fmi3.c"), "    model_step(&own->state, &own->in, &own->out);\n"
    archives = [write_fmu(observer, shim, folder), write_fmu(model, shim, folder, first)]
    return [name for name, _ in archives], [text for _, text in archives]


WRITERS: Mapping[str, Callable[[Form, Path], list[str]]] = {
    "c99": write_c99,
    "st": write_st,
    "st-single": partial(write_st, real="REAL"),
}
"""What writes a form into a folder, by kind of code."""
