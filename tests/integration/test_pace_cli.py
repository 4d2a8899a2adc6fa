"""`dtb run pace=real` from outside: what it tells of its deadlines, and that Ctrl-C leaves nothing behind."""

import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from network import children, wait_for
from told import without_progress

pytestmark = pytest.mark.check

SHORT = (
    "run", "pace=real", "reference.period_s=1", "twin.buffer=300", "twin.settle=100", "twin.delay_s=1",
    "profile=constant", "profile.start_deg=30", "figures=false", "out=run",
)  # fmt: skip


def test_the_deadlines_are_told_and_the_twin_answers(process, tmp_path):
    done = process(*SHORT, "duration_s=2")
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
    summary = json.loads((tmp_path / "run" / "summary.json").read_text())
    pace = summary["pace"]
    assert pace["deadlines"] == 2001
    assert 0 <= pace["missed"] < 2001
    assert pace["deadline_ms"] == 1.0
    assert summary["n_accepted"] >= 1
    assert f"real time: {2001 - pace['missed']} of 2001 deadlines of 1 ms met" in done.stdout
    page = (tmp_path / "run" / "report.html").read_text(encoding="utf-8")
    assert '<h2 id="pace">Deadlines</h2>' in page
    assert "in real time against the wall clock" in page


@pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")
@pytest.mark.usefixtures("interruptible")
def test_ctrl_c_ends_it_in_one_line_with_nothing_left_and_no_process(tmp_path):
    command = [sys.executable, "-m", "dtbacklash.cli", *SHORT, "duration_s=600"]
    loop = subprocess.Popen(
        command, cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True
    )
    wait_for(lambda: children(loop.pid, "dtbacklash.twin.link.worker"), 120)
    workers, before = children(loop.pid, "dtbacklash.twin.link.worker"), sleeps(loop.pid)
    wait_for(lambda: sleeps(loop.pid) > before + 1000, 120)  # it sleeps before each sample: it runs
    os.killpg(loop.pid, signal.SIGINT)
    out, err = loop.communicate(timeout=60)
    assert loop.returncode == 130
    assert out == ""
    (last,) = without_progress(err).splitlines()
    assert last.startswith("dtb: interrupted")
    wait_for(lambda: not any(Path(f"/proc/{pid}").exists() for pid in workers))
    assert list(tmp_path.iterdir()) == []


def sleeps(pid):
    """How often a process has given up the processor by itself."""
    status = Path(f"/proc/{pid}/status").read_text()
    return int(status.split("\nvoluntary_ctxt_switches:")[1].split()[0])
