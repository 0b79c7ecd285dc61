"""What the library says of each effect is whole."""

from __future__ import annotations

from observer.config.effects.catalogue import LIBRARY


def test_every_effect_is_described_in_full() -> None:
    for effect in LIBRARY:
        own = effect.model_fields.keys()
        assert effect.parameters.keys() <= own, effect
        assert ("target" in own) == (effect.targets is not None), effect
        for key, known in effect.parameters.items():
            low, high = effect.bounds(key)
            resolved = known.on(1.0)
            assert low <= max(low, resolved.low) < min(high, resolved.high) <= high, key
            assert resolved.scale > 0.0, key
        assert any(p.neutral is not None for p in effect.parameters.values()), effect
