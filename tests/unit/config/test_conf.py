"""Every option in ``conf`` can be chosen, and the conf folder of the plain clone is the packaged one."""

from itertools import zip_longest
from pathlib import Path

import pytest
from hydra import compose, initialize_config_module
from hydra.core.global_hydra import GlobalHydra
from omegaconf import OmegaConf

import dtbacklash
from dtbacklash.config import hydra_app
from dtbacklash.config.grammar import GRAMMARS, RUN
from dtbacklash.config.groups import options
from dtbacklash.config.load import load
from dtbacklash.config.run import RunConfig

FILES = {"profile": "t_s,gap_deg\n0,0\n300,90\n", "reference": "t_s,r_mm\n0,0\n300,1\n"}
#: groups whose options are chosen side by side; tests/integration/test_choices.py runs each option alone
TOGETHER = (
    ("experiment",), ("rig",), ("controller",),
    ("model", "profile", "reference", "twin", "optimizer", "sensors", "solver"),
)  # fmt: skip


def rows():
    """Choices of options, so that each option of each group is in one of them."""
    assert sorted(name for groups in TOGETHER for name in groups) == sorted(RUN.groups)
    return [
        {group: option for group, option in zip(groups, row, strict=True) if option}
        for groups in TOGETHER for row in zip_longest(*map(options, groups))
    ]  # fmt: skip


@pytest.fixture
def hydra_ready():
    GlobalHydra.instance().clear()
    hydra_app.register()
    with initialize_config_module("dtbacklash.conf", version_base="1.3"):
        yield
    GlobalHydra.instance().clear()


@pytest.mark.parametrize("row", rows(), ids=lambda row: ",".join(row.values()))
def test_every_option_gives_a_valid_configuration(hydra_ready, tmp_path, row):
    words = [f"{group}={option}" for group, option in row.items()]
    if row.get("rig", "lead_screw") != "lead_screw":
        words.append("controller=open_loop")  # the paper's controllers are for its kind of rig
    for group, content in FILES.items():
        if row.get(group) == "csv":
            (tmp_path / f"{group}.csv").write_text(content)
            words.append(f"{group}.path={tmp_path / group}.csv")
    config = load(compose("run", overrides=words), RunConfig)
    for group, option in row.items():
        if group in ("profile", "reference"):
            assert getattr(config, group).kind == option
        if group in ("controller", "optimizer", "rig", "model"):
            assert getattr(config, group).name == option


def test_defaults_of_the_files_and_of_the_schema_agree(hydra_ready):
    for name, grammar in GRAMMARS.items():
        words = {"diagnose": ["recording.source=bench.csv"], "design": ["found=found"]}.get(name, [])
        chosen = load(compose(name, overrides=words), grammar.schema)
        schema = compose(f"{name}_schema")
        if "rig" in grammar.groups:
            schema.rig = chosen.rig
        for key, _, value in (word.partition("=") for word in words):
            OmegaConf.update(schema, key, value)
        assert chosen == load(schema, grammar.schema)


def test_the_top_level_conf_is_the_packaged_one():
    package = Path(dtbacklash.__file__).parent
    link = package.parent / "conf"
    if not link.exists():
        pytest.skip("an installed package, not a clone")
    assert link.samefile(package / "conf")
