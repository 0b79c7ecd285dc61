"""FMU 3.0 for co-simulation from a form: C source, a description, and a binary if there is a compiler."""

from __future__ import annotations

import platform
import shutil
import subprocess
import tempfile
import uuid
import zipfile
from dataclasses import dataclass
from pathlib import Path
from string import Template
from xml.etree.ElementTree import Element, SubElement, indent, tostring

from observer.export.c99 import c99_files
from observer.export.form import Form, Kind, Slot
from observer.units import BY_SUFFIX

_TYPES: dict[Kind, tuple[str, str]] = {
    "real": ("Float64", "0.0"),
    "int": ("Int32", "0"),
    "bool": ("Boolean", "false"),
}
_BOTH_WAYS = """
Float32 Int8 UInt8 Int16 UInt16 UInt32 Int64 UInt64 String Binary Clock IntervalDecimal IntervalFraction
ShiftDecimal ShiftFraction ContinuousStates
"""
_ONE_WAY = """
GetNumberOfVariableDependencies GetVariableDependencies SerializedFMUStateSize SerializeFMUState
DeserializeFMUState GetDirectionalDerivative GetAdjointDerivative EnterConfigurationMode
ExitConfigurationMode EvaluateDiscreteStates UpdateDiscreteStates EnterContinuousTimeMode
CompletedIntegratorStep SetTime GetContinuousStateDerivatives GetEventIndicators
GetNominalsOfContinuousStates GetNumberOfEventIndicators GetNumberOfContinuousStates GetOutputDerivatives
ActivateModelPartition
"""
_ABSENT = (*(f"{verb}{kind}" for verb in ("Get", "Set") for kind in _BOTH_WAYS.split()), *_ONE_WAY.split())
"""Functions of the standard that these FMUs do not offer."""
_COMPILERS = ("cc", "gcc", "clang")
_FLAGS = ("-std=c99", "-O2", "-ffp-contract=off", "-fPIC", "-shared", "-fvisibility=hidden")


@dataclass(frozen=True, slots=True)
class FmuVariable:
    """An element of an input or output.

    Attributes:
        name: Its name in the FMU, as a column of the estimates.
        slot: The array it belongs to, or a single number.
        at: Its index in the slot.
        reference: Its value reference, from 1 on.
    """

    name: str
    slot: Slot
    at: int
    reference: int


def variables(form: Form) -> list[FmuVariable]:
    """Return every input and output of a form, inputs first; value reference 0 is the time."""
    places: list[FmuVariable] = []
    for slot in (*form.of("input"), *form.of("output")):
        for at in range(len(slot.labels) or 1):
            name = _name(slot, slot.labels[at]) if slot.labels else slot.name
            places.append(FmuVariable(name, slot, at, len(places) + 1))
    return places


def _name(slot: Slot, label: str) -> str:
    """Return the name of an element, as a column of the estimates has it: field_50_degC, heat_nut_W."""
    if slot.name in ("reading", "z", "value"):
        return label
    if slot.name == "sensor_quality":
        return f"quality_{label}"
    stem, _, unit = {"law_W": "heat_W"}.get(slot.name, slot.name).rpartition("_")
    label = label.removesuffix("_mm")
    return f"{stem}_{label}_{unit}" if slot.units and stem else f"{label}_{slot.name}"


def write_fmu(form: Form, template: Template, folder: Path, begin: str = "") -> tuple[str, str]:
    """Write `<name>.fmu`, an FMU 3.0 for co-simulation.

    It always contains its source. The binary is for this platform, if cc, gcc or clang is on the path and
    compiles it.

    Args:
        form: The step.
        template: The C shim between the step and the functions of the standard.
        folder: An existing folder.
        begin: C code that runs when the initialisation ends.

    Returns:
        The file's name and a sentence about its binary.

    Raises:
        OSError: If the file cannot be written.
    """
    token = f"{{{uuid.uuid5(uuid.NAMESPACE_URL, form.title)}}}"
    places = variables(form)
    shim = template.substitute(
        title=form.title, name=form.name, token=token, period=repr(form.period_s), begin=begin,
        inputs=_ranges(places), absent="\n".join(f"NOT_OFFERED({name})" for name in _ABSENT),
        **{f"{kind}s": _pointers(places, kind) for kind in _TYPES},
    )  # fmt: skip
    sources = {**c99_files(form), "fmi3.c": shim}
    binary = _binary(form.name, sources)
    path = folder / f"{form.name}.fmu"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("modelDescription.xml", _model_description(form, places, token))
        archive.writestr("sources/buildDescription.xml", _build_description(form))
        for name, text in sources.items():
            archive.writestr(f"sources/{name}", text)
        if binary is not None:
            archive.writestr(f"binaries/{binary[0]}", binary[1])
    content = (
        "no C compiler was found, so it has its source only"
        if binary is None
        else f"with a binary, {binary[0]}"
    )
    return path.name, f"{path.name}: {content}."


def _ranges(places: list[FmuVariable]) -> str:
    last = max((p.reference for p in places if p.slot.role == "input"), default=0)
    return f"reference >= 1 && reference <= {last}"


def _pointers(places: list[FmuVariable], kind: str) -> str:
    """Return lines of C that give the address of each variable of a kind, slot by slot."""
    lines = ["    if (reference == 0) return &own->now_s;\n"] if kind == "real" else []
    for slot in dict.fromkeys(p.slot.name for p in places if p.slot.kind == kind):
        elements = [p for p in places if p.slot.name == slot]
        first, last = elements[0].reference, elements[-1].reference
        place = f"own->{'in' if elements[0].slot.role == 'input' else 'out'}.{slot}"
        at = f"{place}[reference - {first}]" if elements[0].slot.shape else place
        lines.append(f"    if (reference >= {first} && reference <= {last}) return &{at};\n")
    return "".join(lines) or "    (void)own; (void)reference;\n"


def _model_description(form: Form, places: list[FmuVariable], token: str) -> bytes:
    root = Element(
        "fmiModelDescription", fmiVersion="3.0", modelName=f"{form.machine}.{form.axis}.{form.name}",
        instantiationToken=token, description=form.title, version=form.version,
        generationTool=f"ballscrew-observer {form.version}",
    )  # fmt: skip
    SubElement(
        root, "CoSimulation", modelIdentifier=form.name, canHandleVariableCommunicationStepSize="true",
        fixedInternalStepSize=repr(form.period_s), canGetAndSetFMUState="true",
    )  # fmt: skip
    units = SubElement(root, "UnitDefinitions")
    for unit in dict.fromkeys(p.slot.unit(p.at) for p in places):
        if unit:
            SubElement(SubElement(units, "Unit", name=unit), "BaseUnit", BY_SUFFIX[unit].si or {})
    SubElement(root, "DefaultExperiment", startTime="0", stepSize=repr(form.period_s))
    listed, structure = SubElement(root, "ModelVariables"), Element("ModelStructure")
    SubElement(
        listed, "Float64", name="time", valueReference="0", causality="independent", variability="continuous"
    )
    for place in places:
        kind, zero = _TYPES[place.slot.kind]
        attributes = {
            "name": place.name, "valueReference": str(place.reference), "causality": place.slot.role,
            "variability": "discrete", "description": place.slot.text,
        }  # fmt: skip
        if place.slot.role == "input":
            attributes["start"] = zero
        if place.slot.kind == "real" and (unit := place.slot.unit(place.at)):
            attributes["unit"] = unit
        SubElement(listed, kind, attributes)
    root.append(structure)
    for tag in ("Output", "InitialUnknown"):
        for place in places:
            if place.slot.role == "output":
                SubElement(structure, tag, valueReference=str(place.reference))
    indent(root)
    return bytes(tostring(root, encoding="UTF-8", xml_declaration=True))


def _build_description(form: Form) -> bytes:
    root = Element("fmiBuildDescription", fmiVersion="3.0")
    files = SubElement(
        SubElement(root, "BuildConfiguration", modelIdentifier=form.name), "SourceFileSet", language="C99"
    )
    for name in (f"{form.name}.c", "fmi3.c"):
        SubElement(files, "SourceFile", name=name)
    indent(root)
    return bytes(tostring(root, encoding="UTF-8", xml_declaration=True))


def _binary(name: str, sources: dict[str, str]) -> tuple[str, bytes] | None:
    """Return the path and content of a binary for this platform; None without a compiler or if it fails."""
    compiler = next(filter(None, map(shutil.which, _COMPILERS)), None)
    system = {"Linux": ("linux", "so"), "Darwin": ("darwin", "dylib")}.get(platform.system())
    if compiler is None or system is None:
        return None
    with tempfile.TemporaryDirectory() as folder:
        for file, text in sources.items():
            (Path(folder) / file).write_text(text, encoding="utf-8")
        library = Path(folder) / f"{name}.{system[1]}"
        c_files = [file for file in sources if file.endswith(".c")]
        run = subprocess.run(
            [compiler, *_FLAGS, *c_files, "-o", library.name], cwd=folder, capture_output=True, check=False
        )
        if run.returncode != 0:
            return None
        machine = {"AMD64": "x86_64", "arm64": "aarch64"}.get(platform.machine(), platform.machine())
        return f"{machine}-{system[0]}/{library.name}", library.read_bytes()
