"""The bodies beside the screw in a first configuration: nut and housings that carry thermocouples."""

from __future__ import annotations

import math

from observer.installation.catalogue import (
    HOUSINGS,
    TYPICAL_LINK,
    TYPICAL_MASS,
    Answers,
    BODY_J_kgK,
    NUT_FILM_W_m2K,
    screw_of,
)
from observer.installation.first_tables import FileTable, Note


def bodies(answers: Answers) -> list[FileTable]:
    """Return the bodies that carry thermocouples, each linked to the screw and to the air."""
    parts: list[FileTable] = []
    for name in answers.housings:
        parts += _body(name, answers)
    return parts


def _body(name: str, answers: Answers) -> list[FileTable]:
    screw, body = screw_of(answers.screw), HOUSINGS[name]
    given_kg, usual_kg = (
        (answers.nut_kg, screw.nut_kg) if name == "nut" else (answers.housing_kg, screw.housing_kg)
    )
    kg = given_kg or usual_kg
    node: dict[str, object] = {"name": body.node, "capacity_J_K": Note(round(kg * BODY_J_kgK), f"{kg:g} kg")}
    if given_kg is None:
        node["capacity_J_K"] = Note(round(kg * BODY_J_kgK), f"look: {kg:g} kg with what is bolted to it")
        node["tolerance"] = TYPICAL_MASS
    if name == "nut":
        area_m2 = math.pi * screw.root_mm * screw.nut_mm / 1e6
        touching = {
            "film_W_m2K": Note(NUT_FILM_W_m2K, "look: a grease film of 0.2 mm, and the balls"),
            "area_m2": Note(round(area_m2, 5), "of the thread within the nut"),
        }
    else:
        touching = {"conductance_W_K": Note(screw.housing_W_K, "look: by balls, rings and seats")}
    air = Note(round(body.air_W_K * kg ** (2.0 / 3.0), 2), "look: by its surface, and what it is bolted to")
    known = {"tolerance": Note(TYPICAL_LINK, "how well that is known")}
    return [
        FileTable("[[node]]", node),
        FileTable("[[link]]", {"between": [body.source, body.node], **touching, **known}),
        FileTable(
            "[[link]]", {"between": [body.node, "ambient"], "conductance_W_K": air, "tolerance": TYPICAL_LINK}
        ),
    ]
