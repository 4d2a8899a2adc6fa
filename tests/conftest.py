"""What all tests share."""

import gc
import tempfile
from pathlib import Path

import pytest
from hypothesis import settings
from warm import warm

from dtbacklash.cli import GARBAGE_AFTER, one_blas_thread
from dtbacklash.compiled import is_cold
from dtbacklash.experiment.loop import advance

# as the command line does: threads for tiny matrices, two tests at a time, only stand in each other's way
one_blas_thread()
gc.set_threshold(GARBAGE_AFTER)

# repeatable examples, and no deadlines: the first call of a compiled function compiles it
settings.register_profile("house", deadline=None, derandomize=True)
settings.load_profile("house")


def pytest_configure(config: pytest.Config) -> None:
    """Compile before the workers start: each of them would compile the same."""
    if config.getoption("numprocesses", None) and not hasattr(config, "workerinput") and is_cold(advance):
        with tempfile.TemporaryDirectory() as folder:
            warm(Path(folder))


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Function]) -> None:
    """Tests that share what is made once a file stay with one worker, so that it is made once."""
    for item in items:
        fixtures = (one for found in item._fixtureinfo.name2fixturedefs.values() for one in found)
        if any(one.scope == "module" for one in fixtures):
            item.add_marker(pytest.mark.xdist_group(item.module.__name__))
