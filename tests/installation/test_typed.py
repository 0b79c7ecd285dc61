"""What people type for lengths, places, temperatures, screws and names."""

from __future__ import annotations

import pytest

from observer.installation import typed


@pytest.mark.parametrize(
    ("text", "metres"),
    [("1000 mm", 1.0), ("1,0", 1.0), ("1.0 m", 1.0), ("95cm", 0.95), ("9e2 mm", 0.9), ("10 in", 0.254)],
)
def test_a_length_has_the_unit_that_is_written(text: str, metres: float) -> None:
    assert typed.length_m(text) == pytest.approx(metres)


@pytest.mark.parametrize(
    ("text", "count", "places"),
    [
        ("0.15,0.80", 2, (0.15, 0.8)),
        ("0,15 0,80", 2, (0.15, 0.8)),
        ("0,15, 0,80", 2, (0.15, 0.8)),
        ("150,800 mm", 2, (0.15, 0.8)),
        ("150 mm - 800 mm", 2, (0.15, 0.8)),
        ("0,15 bis 0,80 m", 2, (0.15, 0.8)),
        ("0,05;0,95", None, (0.05, 0.95)),
        ("50,500,950 mm", None, (0.05, 0.5, 0.95)),
        ("50mm,950mm", None, (0.05, 0.95)),
        ("0.5", None, (0.5,)),
    ],
)
def test_places_are_separated_as_people_do(text: str, count: int | None, places: tuple[float, ...]) -> None:
    assert typed.places_m(text, count) == pytest.approx(places)


@pytest.mark.parametrize(
    ("read", "text", "words"),
    [
        (typed.places_m, "0,5", "is it 0.5 or 0 5"),
        (typed.places_m, "50 950 px", "px is not a unit of length"),
        (typed.places_m, "", "write the places"),
        (typed.length_m, "1000", "did you mean 1000 mm"),
        (typed.length_m, "-1", "give a length"),
        (typed.length_m, "1.000,5", "give a length"),
        (typed.degC, "warm", "give a temperature"),
        (typed.key_name, "日本", "nothing is left of the name"),
    ],
)
def test_an_ambiguous_answer_is_rejected(read, text, words) -> None:
    with pytest.raises(ValueError, match=words):
        read(text)


def test_temperatures_screws_and_names() -> None:
    assert [typed.degC(t) for t in ("12 °C", "12,5", "68 °F", "293.15 K")] == [12.0, 12.5, 20.0, 20.0]
    assert {typed.screw_name(t) for t in ("40 x 10", "40x10", "Ø40×10 mm", "40 mm x 10 mm")} == {"40x10"}
    names = {
        "Drehmaschine 7": "drehmaschine-7",
        "Fräse Nord": "fraese-nord",
        "PX.1": "PX.1",
        " Größe 5 ": "groesse-5",
    }
    assert {name: typed.key_name(name) for name in names} == names
