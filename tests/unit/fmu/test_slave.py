"""The slave, called as pythonfmu's library calls it."""

import math

import pytest

pytest.importorskip("pythonfmu")

from dtbacklash.api.rigs import load_rig
from dtbacklash.fmu.interface import Export
from dtbacklash.fmu.slave import CONTENT, RigSlave


@pytest.fixture
def slave(tmp_path):
    """A slave of the paper's rig with its gap of 0.2 rad, initialized."""
    made = make(tmp_path)
    begin(made)
    return made


def make(folder):
    rig = load_rig("lead_screw", "rig.effects.gear.backlash.half_gap=0.2")
    (folder / CONTENT).write_text(Export(rig).text())
    return RigSlave(instance_name="one", resources=str(folder))


def begin(slave, start_s=0.0):
    slave.setup_experiment(start_s, None, None)
    slave.enter_initialization_mode()
    slave.exit_initialization_mode()


def put(slave, **values):
    references = {one.name: vr for vr, one in slave.vars.items()}
    names = {name.replace("__", "."): value for name, value in values.items()}
    slave.set_real([references[name] for name in names], list(names.values()))


def get(slave, name):
    return slave.get_real([next(vr for vr, one in slave.vars.items() if one.name == name)])[0]


def test_it_is_at_rest_and_moves_by_its_command(slave):
    assert get(slave, "q3_mm") == 0.0
    put(slave, u_v=6.0)
    assert all(slave.do_step(k * 1e-3, 1e-3) for k in range(200))
    assert get(slave, "q3_mm") > 0.1
    assert get(slave, "theta_m_rad") - get(slave, "theta_d_rad") == pytest.approx(0.2)


@pytest.mark.parametrize(
    ("t_s", "h_s", "message"),
    [
        (0.0, 0.0015, "must be a multiple of the sample time 0.001 s"), (0.0, 0.0, "must be a multiple"),
        (0.0, -0.001, "must be a multiple"), (0.0, math.nan, "cannot convert float NaN"),
        (0.002, 0.001, "must be 0 s, where the last step has ended"), (math.nan, 0.001, "must be 0 s"),
    ],
)  # fmt: skip
def test_a_step_that_cannot_be_is_refused_and_told(slave, capsys, t_s, h_s, message):
    with pytest.raises(ValueError, match=message):
        slave.do_step(t_s, h_s)
    assert message in capsys.readouterr().err
    assert slave.do_step(0.0, 0.001)


def test_steps_that_are_added_up_are_taken(slave):
    t_s = 0.0
    for _ in range(1000):
        assert slave.do_step(t_s, 0.003)
        t_s += 0.003


@pytest.mark.parametrize(("name", "value"), [("u_v", math.nan), ("gap_deg", -1.0), ("gap_deg", 361.0)])
def test_an_input_that_cannot_be_is_refused(slave, name, value):
    put(slave, **{name: value})
    with pytest.raises(ValueError, match=f"{name}="):
        slave.do_step(0.0, 0.001)


def test_parameters_count_until_the_initialization_ends(tmp_path):
    stiff, soft = make(tmp_path), make(tmp_path)
    put(soft, parameters__k=5e3)
    for one in (stiff, soft):
        begin(one)
        put(one, u_v=6.0)
        assert one.do_step(0.0, 0.3)
    assert get(soft, "parameters.k") == 5e3
    assert abs(get(soft, "q3_mm") - get(stiff, "q3_mm")) > 0.01
    with pytest.raises(ValueError, match="k=10000: is fixed; set it before the initialization ends"):
        put(soft, parameters__k=1e4)


def test_an_output_cannot_be_set(slave):
    with pytest.raises(ValueError, match="is an output"):
        put(slave, q3_mm=1.0)


def test_a_rig_that_runs_away_is_told(tmp_path):
    made = make(tmp_path)
    begin(made)
    put(made, u_v=1e308)
    with pytest.raises(RuntimeError, match="has run away"):
        made.do_step(0.0, 1.0)


def test_its_own_description_says_what_it_needs_and_every_value_has_all_its_digits(tmp_path):
    made = make(tmp_path)
    root = made.to_xml()
    assert "Needs Python 3.11 to 3.13 with dtbacklash" in root.attrib["description"]
    lead = root.find("ModelVariables/ScalarVariable[@name='parameters.p']/Real")
    assert lead.attrib == {"start": "0.0003183098861837907", "unit": "m/rad"}
    assert {one.attrib["name"] for one in root.findall("UnitDefinitions/Unit")} >= {"mm", "V", "kg m^2", "deg"}
    assert root.find("CoSimulation").attrib["canGetAndSetFMUstate"] == "false"
    assert make(tmp_path).guid == made.guid
