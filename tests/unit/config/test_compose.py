"""A configuration from words, wherever Hydra stands in the process."""

import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
import yaml
from hydra import compose as hydra_compose
from hydra import initialize_config_dir, version
from hydra.core.config_store import ConfigStore
from hydra.core.global_hydra import GlobalHydra
from omegaconf import OmegaConf

import dtbacklash
from dtbacklash.config.commands import DiagnoseConfig
from dtbacklash.config.compose import compose, compose_for
from dtbacklash.config.grammar import GRAMMARS
from dtbacklash.errors import UserError

DIAGNOSE = GRAMMARS["diagnose"]

LEAD_SCREW = Path(dtbacklash.__file__).parent / "conf" / "rig" / "lead_screw.yaml"


@pytest.fixture
def mine(tmp_path):
    """The configuration folder of somebody else's application."""
    (tmp_path / "app.yaml").write_text("size: 3\nrun_by: ${hydra:job.name}\n")
    return tmp_path


def test_words_give_a_checked_configuration():
    config = compose("controller=imc", "duration_s=3", "rig.effects.mass_3.ground_friction.force=0.2")
    assert (config.controller.structure, config.duration_s) == ("imc", 3.0)
    assert config.rig.effects == {"mass_3": {"ground_friction": {"force": 0.2}}}


def test_a_rig_that_is_no_file_and_changes_on_top_of_it():
    rig = yaml.safe_load(LEAD_SCREW.read_text()) | {"name": "mine"}
    config = compose("rig.parameters.k.value=9000", rig=rig)
    assert (config.rig.name, config.rig.parameters["k"].value, config.rig.parameters["m"].value) == (
        "mine", 9000.0, 5.2,
    )  # fmt: skip
    assert not [name for name in ConfigStore.instance().repo.get("rig", {}) if "given" in name]
    with pytest.raises(UserError, match="foo"):
        compose(rig=rig | {"foo": 1})


def test_hydra_of_the_caller_stays_as_it_was(mine):
    OmegaConf.register_new_resolver("now", lambda pattern: "never", replace=True)
    try:
        with initialize_config_dir(str(mine), job_name="theirs", version_base="1.2"):
            theirs = GlobalHydra.instance().hydra
            assert compose("controller=imc").controller.structure == "imc"
            with pytest.raises(UserError):
                compose("twin.delay_s=-1")
            assert GlobalHydra.instance().hydra is theirs
            assert str(version.getbase()) == "1.2"
            assert hydra_compose("app").size == 3
        assert not GlobalHydra.instance().is_initialized()
    finally:
        OmegaConf.clear_resolver("now")


def test_threads_do_not_disturb_each_other():
    with ThreadPoolExecutor(4) as pool:
        found = list(pool.map(lambda seed: compose(f"seed={seed}").seed, range(8)))
    assert found == list(range(8))


def test_inside_an_application_of_hydra(mine):
    script = mine / "app.py"
    script.write_text(
        "import hydra, joblib, os, threadpoolctl\nimport dtbacklash as dtb\n"
        "from hydra.core.hydra_config import HydraConfig\n"
        "@hydra.main(version_base='1.3', config_path='.', config_name='app')\n"
        "def main(config):\n"
        "    before = dict(os.environ)\n"
        "    result = dtb.run('controller=imc', f'duration_s={config.size}')\n"
        "    assert dict(os.environ) == before\n"
        "    print(config.run_by, HydraConfig.get().job.name, len(result.trace))\n"
        "main()\n"
    )
    words = [sys.executable, str(script), "size=2"]
    answer = subprocess.run(words, capture_output=True, text=True, cwd=mine, check=False)
    assert answer.returncode == 0, answer.stderr
    assert answer.stdout.split() == ["app", "app", "2001"]


@pytest.mark.parametrize(("written", "read"), [("0.05 mm", "0.05 mm"), ("2 %", "2 %"), ("0.02", "0.02")])
def test_what_is_enough_is_read_as_it_is_written(written, read):
    config = compose_for(DIAGNOSE, DiagnoseConfig, "recording.source=bench.csv", f"enough={{q3: {written}}}")
    assert config.enough == {"q3": read}


@pytest.mark.parametrize("words", [
    ("controller=imc", "seed=3"), ("controller=imc",), ("experiment=aging", "changes=[{at_s:3,parameters:{k:9000}}]"),
    ("rig=pendulum", "controller=open_loop", "+sensors.noise.theta_rad=0.001"), ("model=lead_screw", "twin=unguarded"),
])  # fmt: skip
def test_options_that_were_composed_before_are_as_hydra_composes_them(words, monkeypatch):
    again = [compose(*words), compose(*words)]
    monkeypatch.setattr("dtbacklash.config.compose.has_own", lambda: True)
    assert again == [compose(*words)] * 2
