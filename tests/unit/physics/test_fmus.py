"""An FMU as a rig: what is found in it, and what is refused."""

from __future__ import annotations

import re
import zipfile
from dataclasses import replace
from pathlib import Path

import pytest
from fmus import COLUMNS, EQUATIONS, EXCHANGED, JOINTS, STAGE, Machine

from dtbacklash.api.rigs import load_rig
from dtbacklash.cli import main
from dtbacklash.config.rig import RigConfig
from dtbacklash.errors import UserError
from dtbacklash.physics.fmus import model_of

pytest.importorskip("fmpy")


@pytest.fixture(scope="module")
def exchanged(tmp_path_factory):
    return {2: EQUATIONS.build(tmp_path_factory.mktemp("fmus") / "machine2.fmu")}


def test_an_fmus_states_inputs_and_parameters_are_found(exchanged, capsys):
    assert main(["rig", "new", "fmu", str(exchanged[2])]) == 0
    assert main(["rig", "check", str(exchanged[2].with_suffix(".yaml"))]) == 0
    assert "axle: coulomb_friction" in capsys.readouterr().out
    text = exchanged[2].with_suffix(".yaml").read_text()
    assert "axle: {position: axle.phi, speed: axle.w, force: tau}" in text
    assert "rail: {position: rail.s, speed: rail.v, force: push}" in text
    assert "  cart.m: 10 %" in text


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"joints": {}}, "rig.joints=(none): name at least one, as {rail: {position: rail.s}, axle: "),
        ({"joints": {"axle": {"position": "axle.phy"}}}, "did you mean axle.phi; it has"),
        (
            {"joints": {"axle": {"position": "axle.phi", "speed": "rail.v"}}},
            "is not the derivative of axle.phi, which is",
        ),
        ({"joints": {"axle": {"position": "axle.w"}}}, "no state is its derivative; name the state that is its speed"),
        ({"joints": {"axle": {"position": "axle.phi", "force": "tao"}}}, "did you mean tau; it has"),
        ({"joints": {"axle": {"position": "axle.phi", "force": "push"}}}, "does not push axle.w forward at once"),
        ({"joints": {"axle": {"place": "axle.phi"}}}, "a mapping with position"),
        ({"commands": {"torque": "spun", "push": "rail"}}, "did you mean spin; it has"),
        ({"commands": {}}, "an input of the FMU has a column: {COLUMN: spin}"),
        ({"sensors": {"x": {"of": "ralo", "quantity": "position"}}}, "rig.sensors.x.of"),
        ({"tolerances": {"cart.n": 0.1}}, "did you mean cart.m; it has"),
        ({"model": "nowhere.fmu"}, "no such file"),
        ({"joints": {"my.axle": {"position": "axle.phi"}}}, "a name without dots; it is yours"),
        ({"fixed": ["axle"]}, "leave it out of `joints`"),
        (
            {"joints": {"axle": {"position": ["axle.phi"]}}},
            "rig.joints.axle.position=['axle.phi']: the model has no such",
        ),
        ({"joints": {"axle": {"position": "axle.phi", "force": ["tau"]}}}, "rig.joints.axle.force=['tau']: the model"),
        (
            {"commands": {"torque": ["spin"], "push": "rail"}},
            "rig.commands.torque=['spin']: the model has no such name",
        ),
        (
            {"sensors": {"x": {"of": ["axle"], "quantity": "position"}}},
            "rig.sensors.x.of=['axle']: one name: of a joint",
        ),
        (
            {"joints": {"a": {"position": "axle.phi"}, "b": {"position": "axle.phi"}}},
            "rig.joints.a.position=axle.phi: is of two joints; each has its own",
        ),
        ({"joints": {**JOINTS, "axle": {**JOINTS["axle"], "slides": "no"}}}, "axle.slides=no: true or false"),
        ({"joints": {**JOINTS, "axle": {**JOINTS["axle"], "slides": True}}}, "axle.phi is in rad; leave it out"),
        ({"joints": {**JOINTS, "rail": {**JOINTS["rail"], "slides": False}}}, "rail.s is in m; leave it out"),
        (
            {"tolerances": {"cart.m": "5 %", "parameters.cart.m": "20 %"}},
            "rig.tolerances.parameters.cart.m=20 %: cart.m is named twice",
        ),
        (
            {"sensors": {"watts": {"of": "power", "quantity": "value", "recorded_in": "W"}}},
            "rig.sensors.watts.recorded_in=W: leave it out: a column of power is in what the FMU gives",
        ),
        ({"joints": {"axle": JOINTS["axle"]}}, "rig.commands.push=rail: moves none of the joints"),
    ],
)
def test_what_an_fmu_has_not_is_told_in_one_line(exchanged, change, said):
    with pytest.raises(UserError) as error:
        load_rig({**EXCHANGED, "model": str(exchanged[2]), **change})
    assert said in str(error.value)
    assert "\n" not in str(error.value)


def test_an_fmu_that_cannot_be_a_model_is_refused_in_one_line(exchanged, tmp_path):
    def refused(path: Path) -> str:
        with pytest.raises(UserError) as error:
            load_rig({**EXCHANGED, "model": str(path)})
        return str(error.value)

    (tmp_path / "text.fmu").write_text("no archive")
    assert "is no FMU: " in refused(tmp_path / "text.fmu")
    alone = EQUATIONS.build(tmp_path / "alone.fmu", 2, **{"<ModelExchange": "<CoSimulation"})
    assert "is for Co-Simulation only: it hides its states" in refused(alone)
    still = replace(EQUATIONS, states={}, equations="  power = 0.0;", parameters={}).build(tmp_path / "still.fmu", 3)
    assert "has no continuous states" in refused(still)
    with zipfile.ZipFile(exchanged[2]) as there, zipfile.ZipFile(tmp_path / "other.fmu", "w") as other:
        for name in there.namelist():
            other.writestr(name.replace("linux64/machine.so", "win32/machine.dll"), there.read(name))
    assert re.search(r"is for win32; this one is \w+", refused(tmp_path / "other.fmu"))
    degrees = replace(EQUATIONS, states={**EQUATIONS.states, "axle.phi": (0.0, "deg")}).build(tmp_path / "deg.fmu")
    assert "is in deg; a joint's state must be in m or rad" in refused(degrees)


@pytest.mark.parametrize("version", [2, 3])
@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ({"refuses": "1"}, "machine.fmu: the FMU refuses its derivatives where it begins: "),
        ({"equations": EQUATIONS.equations + " D_rail_v = sqrt(-1.0 - t);"}, "the derivative of rail.v is "),
        ({"again": "1"}, "the FMU does not begin with it: its discrete states do not settle in 100 turns"),
    ],
)
def test_an_fmu_that_does_not_give_its_motion_is_refused_in_one_line(tmp_path, capsys, version, wrong, said):
    path = replace(EQUATIONS, **wrong).build(tmp_path / "machine.fmu", version)
    with pytest.raises(UserError) as error:
        load_rig({**EXCHANGED, "model": str(path)})
    assert said in str(error.value)
    assert main(["rig", "new", "fmu", str(path)]) == 2
    assert said in capsys.readouterr().err
    assert not path.with_suffix(".yaml").exists()


def test_two_joints_have_no_force_in_common(tmp_path):
    both = replace(STAGE, equations=STAGE.equations.replace("(F_t - s)", "(F_t + F_c - s)"))
    path = both.build(tmp_path / "both.fmu")
    joints = {n: {"position": x, "force": "F_c"} for n, x in {"carriage": "x_c", "table": "x_t"}.items()}
    with pytest.raises(UserError, match=r"rig.joints.carriage.force=F_c: is of two joints; each has its own"):
        load_rig({"model": str(path), "commands": {"u": "u"}, "joints": joints})


def test_what_a_library_said_before_is_no_reason(exchanged):
    instance = model_of(replace(RigConfig(), model=str(exchanged[2]))).instance()
    instance.said[:] = ["a text of long ago"]
    with pytest.raises(UserError, match=r"rig.tolerances.cart.m=nan: the FMU does not begin with it: ") as error:
        instance.begin({"cart.m": float("nan")})
    assert "long ago" not in str(error.value)


def test_names_that_are_no_plain_yaml_are_quoted(tmp_path, capsys):
    machine = Machine(
        {"rail.r[1]": (0.0, "m"), "rail.v[1]": (0.0, "m/s")},
        {"no": 2.0, "m[1,2]": 3.0},
        {"u[1]": "V", "F[1]": "N"},
        "  D_rail_r_1_ = rail_v_1_; D_rail_v_1_ = (no * u_1_ + F_1_) / m_1_2_;",
    )
    path = machine.build(tmp_path / "bracket.fmu", 3)
    assert main(["rig", "new", "fmu", str(path)]) == 0
    assert main(["rig", "check", str(path.with_suffix(".yaml"))]) == 0
    assert "m[1,2] = 3" in capsys.readouterr().out
    text = path.with_suffix(".yaml").read_text()
    assert 'rail_r_1: {position: "rail.r[1]", speed: "rail.v[1]", force: "F[1]"}' in text
    with pytest.raises(UserError, match=r'name at least one, as {rail_r_1: {position: "rail.r\[1\]"}}'):
        load_rig({**COLUMNS, "model": str(path)})


def test_a_command_that_acts_through_a_winding_drives_what_that_turns(tmp_path):
    motor = Machine(
        {"i": (0.0, "A"), "cart": (0.0, "m"), "v": (0.0, "m/s"), "phi": (0.0, "rad"), "w": (0.0, "rad/s")},
        {"R": 2.0, "k": 0.5},
        {"volts": "V", "tau": "N.m", "push": "N"},
        "  D_i = (volts - R * i - k * w) / 0.02; D_phi = w; D_w = (k * i + tau) / 0.05; D_cart = v; D_v = push;",
    )
    content = {
        "model": str(motor.build(tmp_path / "motor.fmu", 3)), "commands": {"u": "volts"},
        "joints": {"cart": {"position": "cart", "force": "push"}, "rotor": {"position": "phi", "force": "tau"}},
        "sensors": {"x": {"of": "cart", "quantity": "position"}, "angle": {"of": "rotor", "quantity": "position"},
                    "amps": {"of": "i", "quantity": "value"}},
    }  # fmt: skip
    rig = load_rig(content)
    assert rig.elements["actuator_volts"].neighbours["drives"] == "rotor"
    with pytest.raises(UserError, match=r"rig.sensors.moment.of=actuator_volts: .* name a variable of it"):
        load_rig({**content, "sensors": {"moment": {"of": "actuator_volts", "quantity": "torque"}}})


def test_units_of_parameters_are_read_as_fmus_write_them_and_change_no_number(tmp_path):
    said = {'start="0.2"': 'start="0.2" unit="N.m.s/rad"', 'start="3.0"': 'start="3.0" unit="g"',
            'start="0.3"': 'start="0.3" unit="kg.m2"'}  # fmt: skip
    path = EQUATIONS.build(tmp_path / "units.fmu", 3, **said)
    tolerances = {"axle.d": 0.1, "cart.m": 0.1, "J": 0.1}
    parameters = load_rig({**EXCHANGED, "model": str(path), "tolerances": tolerances}).config.parameters
    assert {n: (p.value, p.unit) for n, p in parameters.items()} == {
        "axle.d": (0.2, "N m s/rad"), "cart.m": (3.0, ""), "J": (0.3, "kg m^2"),
    }  # fmt: skip


def test_an_fmu_without_pairs_of_states_says_so(tmp_path, capsys):
    tank = Machine({"level": (1.0, "m")}, {"area": 2.0}, {"flow": "m3/s"}, "  D_level = (flow - 0.1 * level) / area;")
    path = tank.build(tmp_path / "tank.fmu", 3)
    assert main(["rig", "new", "fmu", str(path)]) == 0
    assert "joints: {}  # no state of the FMU is another's derivative" in path.with_suffix(".yaml").read_text()
    assert main(["rig", "check", str(path.with_suffix(".yaml"))]) == 2
    assert "rig.joints=(none): name at least one" in capsys.readouterr().err
