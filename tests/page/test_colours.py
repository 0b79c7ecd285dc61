"""The page's colours, computed: contrast after WCAG 2.2, and curves that the colour-blind can distinguish."""

from __future__ import annotations

import itertools
import re
from importlib.resources import files

import numpy as np
import pytest

CSS = (files("observer.outlets") / "assets" / "page.css").read_text(encoding="utf-8")
BLOCKS = re.findall(r"(:root[^{]*)\{([^}]*--ground[^}]*)\}", CSS)
THEMES = {
    selector.strip(): dict(re.findall(r"--([\w-]+):(#[0-9a-f]{3,6})", body)) for selector, body in BLOCKS
}
LIGHT, SYSTEM_DARK, DARK = THEMES
TEXT = [
    *itertools.product(("ink", "soft", "good", "care", "bad"), ("panel", "ground")),
    ("good-ink", "good"), ("care-ink", "care"), ("bad-ink", "bad"), ("panel", "calm"),
]  # fmt: skip
LEAST_TEXT, LEAST_CURVE = 4.5, 3.0  # WCAG 2.2, 1.4.3 and 1.4.11
LEAST_APART = 20.0
"""Of two curves, CIE 1976; some 2 can just be seen side by side, thin lines need several times that."""
BLIND = {  # Machado, Oliveira and Fernandes (2009), table 1, severity 1.0
    "none": np.eye(3),
    "protanopia": [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216],
                   [-0.003882, -0.048116, 1.051998]],
    "deuteranopia": [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413],
                     [-0.011820, 0.042940, 0.968881]],
    "tritanopia": [[1.255528, -0.076749, -0.178779], [-0.078411, 0.930809, 0.147602],
                   [0.004733, 0.691367, 0.303900]],
}  # fmt: skip
XYZ = np.array([[0.4124564, 0.3575761, 0.1804375], [0.2126729, 0.7151522, 0.0721750],
                [0.0193339, 0.1191920, 0.9503041]])  # fmt: skip
WHITE = XYZ.sum(axis=1)


def _linear(colour: str) -> np.ndarray:
    """sRGB, IEC 61966-2-1."""
    digits = colour[1:] if len(colour) == 7 else "".join(2 * c for c in colour[1:])
    value = np.array([int(digits[i : i + 2], 16) for i in (0, 2, 4)]) / 255
    return np.where(value <= 0.04045, value / 12.92, ((value + 0.055) / 1.055) ** 2.4)


def _contrast(one: str, other: str) -> float:
    low, high = sorted(float(XYZ[1] @ _linear(colour)) for colour in (one, other))
    return (high + 0.05) / (low + 0.05)


def _lab(linear: np.ndarray) -> np.ndarray:
    """CIE 15:2004, equation 8.3."""
    t = XYZ @ np.clip(linear, 0.0, 1.0) / WHITE
    f = np.where(t > (6 / 29) ** 3, np.cbrt(t), t / (3 * (6 / 29) ** 2) + 4 / 29)
    return np.array([116 * f[1] - 16, 500 * (f[0] - f[1]), 200 * (f[1] - f[2])])


def test_dark_is_the_same_however_it_is_chosen():
    assert THEMES[DARK] == THEMES[SYSTEM_DARK]
    assert THEMES[DARK].keys() == THEMES[LIGHT].keys()


@pytest.mark.parametrize("theme", [LIGHT, DARK])
def test_text_can_be_read(theme):
    colours = THEMES[theme]
    low = {
        pair: round(ratio, 2)
        for pair in TEXT
        if (ratio := _contrast(colours[pair[0]], colours[pair[1]])) < LEAST_TEXT
    }
    assert low == {}


@pytest.mark.parametrize("theme", [LIGHT, DARK])
@pytest.mark.parametrize("blind", BLIND)
def test_curves_are_visible_and_distinguishable(theme, blind):
    colours = THEMES[theme]
    curves = [colours[f"c{i}"] for i in range(7)]
    assert min(_contrast(curve, colours["panel"]) for curve in curves) >= LEAST_CURVE
    seen = [_lab(np.array(BLIND[blind]) @ _linear(curve)) for curve in curves]
    apart = {
        pair: np.linalg.norm(seen[pair[0]] - seen[pair[1]]) for pair in itertools.combinations(range(7), 2)
    }
    assert min(apart.values()) >= LEAST_APART, min(apart, key=apart.get)
