"""What all tests share."""

import gc
import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest
from hypothesis import settings

from dtbacklash.cli import GARBAGE_AFTER, one_blas_thread

# as the command line does: threads for tiny matrices, two tests at a time, only stand in each other's way
one_blas_thread()
gc.set_threshold(GARBAGE_AFTER)

# repeatable examples, and no deadlines
settings.register_profile("house", deadline=None, derandomize=True)
settings.load_profile("house")


@pytest.fixture
def undrawn(monkeypatch: pytest.MonkeyPatch) -> None:
    """Figures are files of one pixel, for tests of all else: drawing would take most of their time."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from PIL import Image

    from dtbacklash.report.run import page

    def one_pixel(canvas: FigureCanvasAgg, target: object, **_: object) -> None:
        Image.new("RGB", (1, 1)).save(target, format="PNG")

    monkeypatch.setattr(FigureCanvasAgg, "print_png", one_pixel)
    monkeypatch.setattr(page, "kept", lambda make, *arguments: make(*arguments))


#: what a file's tests share: made by the file itself, or for each file by a conftest
SHARED = re.compile(r'scope="module"|\b(broker|served|clean|machine_recordings)\b')


@cache
def shares(path: Path) -> bool:
    return bool(SHARED.search(path.read_text(encoding="utf-8")))


def pytest_xdist_make_scheduler(config: pytest.Config, log: object) -> object:
    """With ``--dist loadscope`` a file whose tests share what is costly stays with one worker; long files come first.

    xdist's own loadgroup groups nothing with pytest 9.2, and its loadscope would keep every file together.
    """
    if config.getoption("dist") != "loadscope":
        return None
    from xdist.scheduler import LoadScopeScheduling

    class Together(LoadScopeScheduling):
        def _split_scope(self, nodeid: str) -> str:
            path = nodeid.split("::", maxsplit=1)[0]
            return path if shares(config.rootpath / path) else nodeid

    return Together(config, log)


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
