"""The package leaves the process as it found it: on import, and when something is run."""

import json
import os
import subprocess
import sys

import pytest

from dtbacklash.campaign.backends import THREADS

#: everything that a library could turn in a process, as text that can be compared
SNAPSHOT = """
import json, logging, os, signal, sys, warnings

KINDS = ("JobRuntime", "VersionBase", "HydraConfig")

def snapshot():
    import matplotlib, numpy, joblib.parallel
    from hydra.core.global_hydra import GlobalHydra
    from hydra.core.singleton import Singleton
    from omegaconf.basecontainer import BaseContainer
    from threadpoolctl import threadpool_info
    known = logging.root.manager.loggerDict.values()
    loggers = [logging.getLogger(), *(one for one in known if isinstance(one, logging.Logger))]
    return {
        "environment": dict(os.environ), "folder": os.getcwd(), "path": list(sys.path), "argv": list(sys.argv),
        "excepthook": repr(sys.excepthook), "signals": repr(signal.getsignal(signal.SIGINT)),
        "matplotlib": {name: repr(dict.__getitem__(matplotlib.rcParams, name)) for name in matplotlib.rcParams},
        "hydra": repr(GlobalHydra.instance().hydra),
        "singletons": sorted(kind.__name__ for kind in Singleton._instances if kind.__name__ in KINDS),
        "resolvers": sorted(BaseContainer._resolvers),
        "handlers": sorted(repr(handler) for one in loggers for handler in one.handlers),
        "levels": {one.name: one.level for one in loggers if one.level},
        "warnings": [repr(entry) for entry in warnings.filters],
        "floating": repr(numpy.geterr()), "random": repr(numpy.random.get_state()[1][:4]),
        "joblib": [type(joblib.parallel.get_active_backend()[0]).__name__, joblib.parallel.get_active_backend()[1]],
        "threads": [(pool["filepath"], pool["num_threads"]) for pool in threadpool_info()],
    }
"""

#: what changes warnings' filters or loads linear algebra when it is imported, by itself
LIBRARIES = """
import control
import hydra, joblib, matplotlib.figure, numpy, pandas, pyarrow.parquet, rich.progress
import scipy.optimize, scipy.signal
import hydra_plugins
from hydra.core.plugins import Plugins
Plugins.instance()
"""


def changed(code: str) -> dict[str, list]:
    """What of a process the code changes, libraries being loaded already: name -> before and after."""
    text = (
        f"{SNAPSHOT}\n{LIBRARIES}\nbefore = snapshot()\n{code}\nafter = snapshot()\n"
        "print(json.dumps({n: [before[n], after[n]] for n in before if before[n] != after[n]}, default=repr))"
    )
    plain = {name: value for name, value in os.environ.items() if name not in THREADS}
    answer = subprocess.run([sys.executable, "-c", text], capture_output=True, text=True, check=False, env=plain)
    assert answer.returncode == 0, answer.stderr
    return json.loads(answer.stdout.splitlines()[-1])


@pytest.mark.nightly
def test_the_snapshot_sees_changes():
    code = (
        "import matplotlib; matplotlib.rcParams['font.size'] = 3; "
        "os.environ['OMP_NUM_THREADS'] = '77'; warnings.simplefilter('error'); logging.getLogger('x').setLevel(10)"
    )
    assert set(changed(code)) == {"matplotlib", "environment", "warnings", "levels"}


@pytest.mark.check
def test_the_import_changes_nothing():
    assert changed("import dtbacklash") == {}


@pytest.mark.nightly
def test_a_run_with_its_figures_and_files_changes_nothing(tmp_path):
    code = (
        "import dtbacklash as dtb\n"
        "result = dtb.run('controller=nimc_twin', 'duration_s=50', rig=dtb.load_rig('lead_screw'), progress=True)\n"
        f"result.plot(); result.save({str(tmp_path / 'run')!r}); str(result); result.recording"
    )
    assert changed(code) == {}


@pytest.mark.nightly
def test_the_simulator_of_concealed_recordings_changes_nothing():
    assert (
        changed("import dtbacklash.prove.simulator.rig, dtbacklash.diagnosis, dtbacklash.report.diagnosis.page") == {}
    )


@pytest.mark.nightly
def test_a_diagnosis_changes_nothing(tmp_path):
    code = (
        "import dtbacklash as dtb\n"
        "words = ['controller=open_loop', 'reference=multisine', 'profile=constant', 'profile.start_deg=0']\n"
        "found = dtb.diagnose(dtb.run(*words, 'sensors=encoder', 'duration_s=6').recording, 'lead_screw', jobs=2)\n"
        f"found.plot(); found.save({str(tmp_path / 'found')!r}); str(found)"
    )
    assert changed(code) == {}
