"""From Hydra's configuration to a checked one; the fingerprint by which a sweep knows its jobs."""

import json

import pytest
from omegaconf import OmegaConf
from told import refused

from dtbacklash.config import load as loading
from dtbacklash.config.run import ProfileConfig, RecordingOutConfig, RunConfig


@pytest.mark.parametrize(("key", "value", "said"), [
    ("twin.delay_s", -1, "twin.delay_s=-1.0: must be at least 0 s"),
    ("twin.dealy_s", 3, "twin.dealy_s=3: "), ("seed", "${nope}", "seed="),
])  # fmt: skip
def test_what_cannot_be_loaded_is_refused_by_its_key(key, value, said):
    config = OmegaConf.structured(RunConfig)
    OmegaConf.set_struct(config, False)
    OmegaConf.update(config, key, value, force_add=True)
    words = {"twin.dealy_s": "did you mean twin.delay_s?", "seed": "nope"}.get(key, "")
    with refused(words, start=said, key=key):
        loading.load(config, RunConfig)


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
    assert json.loads(json.dumps(loading.plain(RunConfig())))["twin"]["buffer"] == 1000


def test_the_fingerprint_follows_the_content_of_input_files(tmp_path):
    file = tmp_path / "gap.csv"
    file.write_text("t_s,gap_deg\n0,0\n200,90\n")
    config = RunConfig(profile=ProfileConfig(kind="csv", path=str(file)))
    before = loading.fingerprint(config)
    file.write_text("t_s,gap_deg\n0,0\n200,91\n")
    assert loading.fingerprint(config) != before
