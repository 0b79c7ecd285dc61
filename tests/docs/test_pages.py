"""Links lead somewhere, TOML examples are valid, and every page can be found from the index."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path
from typing import Any, get_args

import pytest
from pydantic import BaseModel, TypeAdapter

from drivers import DriverSettings
from observer import installation
from observer.config import sections, sensors
from observer.config.candidates import SensorCandidate
from observer.config.effects.catalogue import Effect
from observer.config.publishing import Client
from observer.config.quantities import Section
from observer.installation.examine import examine
from observer.installation.variants import variants_of
from tests.docs.console import blocks

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
RIG = ROOT / "tests" / "data" / "rig" / "config.toml"
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted(DOCS.rglob("*.md"))]
SECTIONS: dict[str, type[BaseModel]] = {
    name: kind
    for name, field in installation.Installation.model_fields.items()
    for kind in (field.annotation, *get_args(field.annotation))
    if isinstance(kind, type) and issubclass(kind, BaseModel)
}


def _targets(page: Path) -> list[str]:
    """Targets of the page's links to other files and to its own headings."""
    text = re.sub(r"```.*?```|`[^`\n]*`", "", page.read_text(encoding="utf-8"), flags=re.S)
    return [t for t in re.findall(r"\]\(([^)\s]+)\)", text) if not t.startswith(("http", "mailto"))]


def _links(page: Path) -> list[str]:
    """Targets of the page's relative links, without their anchors."""
    return [target.split("#")[0] for target in _targets(page) if not target.startswith("#")]


def _anchors(page: Path) -> set[str]:
    """The anchors of the page's headings, as the site and the platform that hosts the source make them."""
    text = re.sub(r"^```.*?^```", "", page.read_text(encoding="utf-8"), flags=re.M | re.S)
    headings = re.findall(r"^#+ (.*)$", text, flags=re.M)
    plain = (re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", heading).lower() for heading in headings)
    return {re.sub(r"[^\w\- ]", "", heading).strip().replace(" ", "-") for heading in plain}


@pytest.mark.parametrize("page", PAGES, ids=lambda p: str(p.relative_to(ROOT)))
def test_links_lead_to_files(page: Path) -> None:
    broken = [link for link in _links(page) if not (page.parent / link).exists()]
    assert not broken


@pytest.mark.parametrize("page", [*PAGES, ROOT / "SECURITY.md"], ids=lambda p: str(p.relative_to(ROOT)))
def test_anchors_lead_to_headings(page: Path) -> None:
    split = [(target, *target.partition("#")) for target in _targets(page)]
    wanted = [
        (target, page.parent / file if file else page, anchor) for target, file, _, anchor in split if anchor
    ]
    lost = [target for target, to, anchor in wanted if to.suffix == ".md" and anchor not in _anchors(to)]
    assert not lost


def test_every_page_is_reached_from_the_index() -> None:
    reached, waiting = set[Path](), [DOCS / "index.md"]
    while waiting:
        page = waiting.pop().resolve()
        if page in reached or page.suffix != ".md":
            continue
        reached.add(page)
        waiting += [page.parent / link for link in _links(page)]
    lost = [str(p.relative_to(ROOT)) for p in PAGES if p.is_relative_to(DOCS) and p.resolve() not in reached]
    assert not lost


@pytest.mark.parametrize("page", PAGES, ids=lambda p: str(p.relative_to(ROOT)))
def test_toml_examples_are_valid(page: Path) -> None:
    for line, language, body in blocks(page):
        if language == "toml":
            _check(tomllib.loads(body), f"{page.name}:{line}")


ENTRIES: dict[str, type[Section]] = {
    "source": sections.Source,
    "sensor": sensors.Sensor,
    "candidate": SensorCandidate,
}


def _check(table: dict[str, Any], place: str) -> None:
    """A whole configuration, or some of its sections on their own."""
    if "screw" in table:
        installation.parse(table, place)
        return
    if "variant" in table:
        variants_of(table, place, tomllib.loads(RIG.read_text("utf-8")))
        return
    if table.keys() <= Client.model_fields.keys():
        Client.model_validate(table)
        return
    for name, section in table.items():
        if name == "drivers":
            for settings in section.values():
                TypeAdapter(DriverSettings).validate_python(settings)
        elif name == "limits":
            for limits in section.values():
                SECTIONS[name].model_validate(limits)
        elif name == "effect":
            TypeAdapter(tuple[Effect, ...]).validate_python(section)
        elif name in ENTRIES:
            model = ENTRIES[name]
            for entry in section:
                model.model_validate(entry)
        else:
            SECTIONS[name].model_validate(section)


def test_the_functions_that_compute_the_equations_exist() -> None:
    """`module.py:name`; a name without a module is of the one before it."""
    page = (DOCS / "explanation" / "equations.md").read_text(encoding="utf-8")
    lost, count, source = [], 0, ""
    for paragraph in re.findall(r"^Code: .*?\n\n", page + "\n", flags=re.M | re.S):
        for name in re.findall(r"`([^`]+)`", paragraph):
            module, _, function = name.rpartition(":")
            source = (ROOT / module).read_text(encoding="utf-8") if module else source
            last, count = function.rpartition(".")[2], count + 1
            lost += [] if re.search(rf"^ *(def|class) {last}\b", source, flags=re.M) else [name]
    assert count > 40
    assert not lost


def test_a_page_of_use_fits_two_screens() -> None:
    """Eighty lines; CONTRIBUTING.md and SECURITY.md, which stand there too, are not how-to pages."""
    navigation = (ROOT / "zensical.toml").read_text(encoding="utf-8")
    use = navigation.split('{ "Use" = [', 1)[1].split('{ "Look up" = [', 1)[0]
    pages = [*re.findall(r'"(docs/[^"]+\.md)"', use), "README.md"]
    assert len(pages) > 30
    lines = {page: len((ROOT / page).read_text(encoding="utf-8").splitlines()) for page in pages}
    assert not {page: count for page, count in lines.items() if count > 80}


@pytest.mark.parametrize("path", sorted((DOCS / "examples").glob("*.toml")), ids=lambda p: p.name)
def test_an_example_configuration_is_usable_with_its_files(path: Path) -> None:
    assert examine(path).sensor
