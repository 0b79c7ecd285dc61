"""An uncertain heat is shown as such at every outlet, also beside a thermal error that is good."""

from __future__ import annotations

import json
import time
from dataclasses import replace

import numpy as np

from observer.bus.codec import decode_estimate
from observer.bus.watch import live_line
from observer.library.messages import documents_of
from tests.outlets.feeding import ENCODER, block

PARTS = np.array([[1, 0, 0]], np.int8)


def payload() -> bytes:
    return ENCODER.cbor(replace(block(time.time()), part_quality=PARTS), 0, 7)


def test_documents_made_of_an_estimate_have_the_quality_of_their_part() -> None:
    documents = documents_of(decode_estimate(payload()))
    qualities = {name: document["quality"] for name, document in documents.items()}
    assert qualities == {"heat": "starting", "field": "good", "error": "good"}


def test_the_live_line_begins_with_the_quality_of_the_error() -> None:
    one = replace(block(time.time()), part_quality=PARTS)
    newest = {part: json.loads(ENCODER.documents[part](one, 0, 7)) for part in ("heat", "field", "error")}
    line = live_line(newest | {"health": {"error_known_to_um": 4.9}})
    assert line.startswith("good to ±5 µm at the nut, but without some (1 of 2 sensors): nut ")
