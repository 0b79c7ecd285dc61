"""The reference pages are what the code says: keys, defaults and meanings; `make reference` writes them."""

from __future__ import annotations

import re
from typing import get_args

import pytest
from pydantic import BaseModel

import drivers
from drivers import places
from observer.config import candidates, laws, quantities, sections, sensors
from observer.config.effects.base import EffectTable
from observer.config.effects.catalogue import LIBRARY
from tests.docs.reference import CONFIGURATION, DEVICES, REFERENCE, TABLES, written


@pytest.mark.parametrize("page", TABLES)
def test_a_page_is_as_written_from_the_code(page: str) -> None:
    assert (REFERENCE / page).read_text(encoding="utf-8") == written(page), "run make reference"


@pytest.mark.parametrize(
    ("page", "title", "model"),
    [(page, title, model) for page, tables in TABLES.items() for title, model in tables.items()],
    ids=lambda v: str(v) if isinstance(v, str) else "",
)
def test_every_key_has_a_meaning(page: str, title: str, model: type[BaseModel]) -> None:
    section = written(page).split(f"\n## {title}\n", 1)[1].split("\n## ", 1)[0]
    rows = re.findall(r"^- `(\w+)`(?: \(.+?\))?: .+$", section, flags=re.M)
    for same in re.findall(r"^- (`.*`, `.*`): as in .+$", section, flags=re.M):
        rows += re.findall(r"\w+", same)
    headed = {"kind"} if issubclass(model, EffectTable) else set()
    assert set(rows) == {field.alias or name for name, field in model.model_fields.items()} - headed


def test_every_section_of_a_configuration_has_its_table() -> None:
    shared = {laws.HeatLaw, sensors.Measuring}
    bases = {sections.Description, sections.Boundaries, candidates.CandidateFile, EffectTable} | shared
    found = set(quantities.Section.__subclasses__()).union(*(one.__subclasses__() for one in shared))
    assert found - bases == set(CONFIGURATION.values())


def test_every_effect_is_in_the_library() -> None:
    ours = {e for e in EffectTable.__subclasses__() if e.__module__.startswith("observer.")}
    assert ours == set(LIBRARY)


def test_every_kind_of_driver_has_its_table() -> None:
    union, *_ = get_args(drivers.DriverSettings)
    assert set(get_args(union)) <= set(DEVICES.values())


def test_every_ready_device_is_listed() -> None:
    text = (REFERENCE / "devices.md").read_text(encoding="utf-8")
    rows = dict(re.findall(r"^\| `(\w+)` \| .* \| (\d+) \|$", text, flags=re.M))
    assert {name: int(inputs) for name, inputs in rows.items()} == places.MODBUS_INPUTS | places.CAN_INPUTS
