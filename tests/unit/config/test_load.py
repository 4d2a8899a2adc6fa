"""From Hydra's configuration to a checked one; the fingerprint by which a sweep knows its jobs."""

import pytest
from omegaconf import OmegaConf

from dtbacklash.config import load as loading
from dtbacklash.config.run import ProfileConfig, RecordingOutConfig, RunConfig
from dtbacklash.errors import UserError


@pytest.fixture
def config():
    return OmegaConf.structured(RunConfig)


def test_runs_the_checks_of_the_dataclasses(config):
    config.twin.delay_s = -1
    with pytest.raises(UserError, match=r"^twin\.delay_s=-1\.0: must be at least 0 s$"):
        loading.load(config, RunConfig)


def test_refuses_a_key_that_nothing_reads(config):
    OmegaConf.set_struct(config, False)
    OmegaConf.update(config, "twin.dealy_s", 3, force_add=True)
    with pytest.raises(UserError, match=r"did you mean twin\.delay_s\?"):
        loading.load(config, RunConfig)


def test_an_interpolation_that_leads_nowhere_names_its_key(config):
    config.seed = "${nope}"
    with pytest.raises(UserError) as caught:
        loading.load(config, RunConfig)
    assert caught.value.key == "seed"
    assert "nope" in str(caught.value)


@pytest.mark.parametrize(
    ("written", "meant"),
    [("twin.dely_s", "twin.delay_s"), ("delay_s", "twin.delay_s"), ("optimiser.name", "optimizer.name")],
)
def test_a_misspelt_key_is_recognised(written, meant):
    assert f"did you mean {meant}?" in loading.unknown_key(written)


def test_a_strange_key_lists_what_there_is():
    assert "duration_s" in loading.unknown_key("xyzzy")
    assert "twin.buffer" in loading.unknown_key("twin.xyzzy")


def test_the_fingerprint_follows_what_decides_the_result():
    first = loading.fingerprint(RunConfig())
    assert loading.fingerprint(RunConfig()) == first
    assert loading.fingerprint(RunConfig(seed=1)) != first
    assert loading.fingerprint(RunConfig(recording=RecordingOutConfig(save="elsewhere.csv"))) == first


def test_the_fingerprint_follows_the_content_of_input_files(tmp_path):
    file = tmp_path / "gap.csv"
    file.write_text("t_s,gap_deg\n0,0\n200,90\n")
    config = RunConfig(profile=ProfileConfig(kind="csv", path=str(file)))
    before = loading.fingerprint(config)
    file.write_text("t_s,gap_deg\n0,0\n200,91\n")
    assert loading.fingerprint(config) != before


def test_plain_is_json_able():
    import json

    assert json.loads(json.dumps(loading.plain(RunConfig())))["twin"]["buffer"] == 1000
