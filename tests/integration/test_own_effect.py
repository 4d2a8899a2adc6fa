"""An effect of one's own, whole in this one file: simulated, located, named, refitted, listed in the docs, drawn.

The effect is an off-centre weight on a rotor. The catalogue has it too, as ``gravity``: that entry is taken out first,
so that the story runs in a process of its own: this file as a program.
"""

import json
import math
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.check

TESTS = Path(__file__).resolve().parents[1]
STEP_S, SECONDS = 1e-3, 12
TRUE = {"torque": 0.03, "phase": 0.7}
#: an encoder's and a laser's counts, rad and m, and the laser's noise
COUNTS, NOISE = {"theta_m": 2 * math.pi / 4096, "q3": 5e-7}, {"q3": 1e-6}


def declare() -> None:
    """The effect, and its formula for the independent integrator."""
    from dtbacklash.physics import catalogue
    from dtbacklash.physics.effects.declare import Effect, Parameter, Role
    from dtbacklash.physics.effects.slots import BodyEffort

    del catalogue.CATALOGUE["rotor", "gravity"]
    catalogue.register(
        Effect(
            "eccentric_weight", "rotor",
            (
                Parameter("torque", "N m", 0.0, 10.0, 0.01, 0.0, role=Role.SIZE),
                Parameter("phase", "rad", -3.2, 3.2, 0.0, role=Role.ANGLE),
            ),
            "torque sin(theta + phase)", BodyEffort("torque*sin(position + phase)"), "m g l",
            "A weight of {torque} sits on the {location}.",
            conceal=lambda place, sign: (place.force_most, 0.1 * place.force),
        )
    )  # fmt: skip
    from reference import machines

    machines.EFFORTS["eccentric_weight"] = lambda p: lambda q, v, t: p["torque"] * math.sin(q + p["phase"])


def simulated() -> dict[str, float]:
    """Largest error of the compiled simulation, and what the effect changes, m: against the independent integrator."""
    import numpy as np
    from reference import rigs, solve

    from dtbacklash.physics.simulate import simulate

    plain = rigs.lead_screw()
    rig = plain.with_effect("motor_bearing", "eccentric_weight", TRUE)
    u = rigs.random_steps(1500, 30, 4.0)
    truth = solve(rig, u, STEP_S).sensors["q3"]
    return {
        "error_m": float(np.abs(simulate(rig, u, STEP_S).sensors["q3"] - truth).max()),
        "change_m": float(np.abs(simulate(plain, u, STEP_S).sensors["q3"] - truth).max()),
    }


def diagnosed(folder: Path) -> dict[str, object]:
    """What the diagnosis of a recording says that holds the effect; its page goes into ``folder``."""
    import numpy as np
    import pandas as pd

    import dtbacklash as dtb
    from dtbacklash.physics.simulate import simulate

    nominal = dtb.load_rig("lead_screw")
    t = np.arange(round(SECONDS / STEP_S) + 1) * STEP_S
    rng = np.random.default_rng(5)
    tones = np.arange(1, 150) * 0.1
    u = np.sin(2 * np.pi * tones[:, None] * t + rng.uniform(0, 2 * np.pi, len(tones))[:, None]).sum(axis=0)
    u *= 2.0 / u.std()
    seen = simulate(nominal.with_effect("motor_bearing", "eccentric_weight", TRUE), u[:-1], STEP_S).sensors
    columns = {"t": t, "u": u}
    for name, count in COUNTS.items():
        noisy = seen[name] + rng.normal(0.0, NOISE.get(name, 0.0), len(t))
        columns[name] = count * np.round(noisy / count)
    recording = dtb.Recording.from_frame(pd.DataFrame(columns), units={"theta_m": "rad", "q3": "m"}, rig=nominal)
    found = dtb.diagnose(recording, nominal, jobs=1)
    found.save(folder)
    return json.loads((folder / "diagnosis.json").read_text(encoding="utf-8"))


def story(folder: Path) -> dict[str, object]:
    declare()
    from dtbacklash.docs.pages import effects_page

    return {"simulated": simulated(), "diagnosis": diagnosed(folder), "docs": effects_page()}


@pytest.fixture(scope="module")
def told(tmp_path_factory):
    folder = tmp_path_factory.mktemp("own")
    command = [sys.executable, str(Path(__file__)), str(folder / "found")]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=900)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout), folder / "found"


def test_it_is_simulated_as_newton_would(told):
    found = told[0]["simulated"]
    assert found["error_m"] < 1e-7 < 0.01 * found["change_m"]


def test_it_is_located_named_and_refitted(told):
    diagnosis = told[0]["diagnosis"]
    assert diagnosis["verdict"] == "missing_physics"
    assert [(f["location"], f["effect"]) for f in diagnosis["findings"]] == [("motor_bearing", "eccentric_weight")]
    for name, value in TRUE.items():
        low, high = diagnosis["findings"][0]["parameters"][name]["ci95"]
        assert low < value < high
        assert high - low < 0.25 * value  # a motor's torques are known as well as its constants, here 5 %


def test_it_stands_in_the_docs_table(told):
    assert "| `eccentric_weight` | `torque sin(theta + phase)` | `torque` | N m |" in told[0]["docs"]


def test_its_law_is_drawn_in_the_report(told):
    figures = [path.name for path in (told[1] / "figures").glob("*motor_bearing*.png")]
    assert len(figures) == 1
    assert "Eccentric weight at the motor bearing" in (told[1] / "report.html").read_text(encoding="utf-8")


if __name__ == "__main__":
    sys.path.insert(0, str(TESTS))
    print(json.dumps(story(Path(sys.argv[1]))))
