"""What tests of the physics share; makes the test-only package ``reference`` importable."""

import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))


@pytest.fixture
def as_before(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """What a test adds to the catalogue is taken out again."""
    from dtbacklash import source_hash
    from dtbacklash.physics.catalogue import CATALOGUE

    monkeypatch.setattr(source_hash, "_foreign", set(source_hash._foreign))
    before = dict(CATALOGUE)
    yield
    for key in set(CATALOGUE) - set(before):
        del CATALOGUE[key]
