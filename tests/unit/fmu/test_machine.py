"""The FMU of a rig moves as the run's own plant does, to the last bit, and refuses what cannot be in one line."""

import ctypes
import math
import shutil
import subprocess
import sys
import zipfile
from dataclasses import replace
from functools import cache
from xml.etree import ElementTree as xml

import numpy as np
import pytest

pytest.importorskip("fmpy")

from fmpy.fmi1 import FMICallException
from slaves import Slave

from dtbacklash.api.rigs import load_rig
from dtbacklash.errors import UserError
from dtbacklash.fmu.machine import LATE_SAMPLES, write_machine
from dtbacklash.physics import catalogue
from dtbacklash.physics.effects.c_law import CLaw
from dtbacklash.physics.effects.declare import Effect, Parameter, Role
from dtbacklash.physics.effects.slots import BodyEffort
from dtbacklash.physics.rig import build_rig
from dtbacklash.physics.simulate import simulate

pytestmark = pytest.mark.check

STEP_S = 1e-3
GAP = "rig.effects.gear.backlash.half_gap=0.2"
FRICTION = "rig.effects.motor_bearing.coulomb_friction.torque=0.02"
LATE = "rig.effects.amplifier.delay.time=0.0015"
COMPLIANT = "rig.effects.screw.compliance.compliance=1e-7"


@pytest.fixture(scope="module")
def exported(tmp_path_factory):
    """The FMU of a rig, made once: (name of the rig, words, version of FMI) -> its file."""

    @cache
    def make(name, *words, version=2):
        file = tmp_path_factory.mktemp("fmu") / "rig.fmu"
        write_machine(load_rig(name, *words), STEP_S, 0, 16, version, file)
        return file

    return make


@pytest.fixture
def slaves(exported):
    """Instances, freed at the end: as ``exported``."""
    made = []

    def make(name, *words, version=2):
        made.append(Slave(exported(name, *words, version=version)))
        return made[-1]

    yield make
    for one in made:
        one.close()


def commands(samples=400, seed=1):
    return np.repeat(np.random.default_rng(seed).uniform(-8.0, 8.0, samples // 20), 20)


def moved(slave, u, names, gap=None):
    """(N + 1, names) what it shows at rest and after each sample."""
    rows = [slave.get(*names)]
    for k, voltage in enumerate(u):
        slave.put(u_v=voltage, **({} if gap is None else {"gap_deg": math.degrees(gap[k + 1])}))
        slave.step(STEP_S)
        rows.append(slave.get(*names))
    return np.array(rows)


CASES = {
    "linear": ("lead_screw", ()),
    "gap, friction and delay": ("lead_screw", (GAP, FRICTION, LATE)),
    "compliant screw": ("lead_screw", (COMPLIANT, FRICTION)),
    "belt": ("belt_stage", ()),
    "servo": ("servo_arm", ()),
}


@pytest.mark.parametrize("version", [2, 3])
@pytest.mark.parametrize("case", CASES)
def test_it_moves_as_the_simulation_to_the_last_bit(slaves, case, version):
    name, words = CASES[case]
    rig, u = load_rig(name, *words), commands()
    response, slave = simulate(rig, u, STEP_S), slaves(name, *words, version=version).begin()
    found = moved(slave, u, list(outputs(rig)))
    for column, (output, (sensor, factor)) in enumerate(outputs(rig).items()):
        assert np.abs(found[:, column]).max() > 0.0
        np.testing.assert_array_equal(found[:, column], response.sensors[sensor] * factor, err_msg=output)


def outputs(rig):
    """Output -> its sensor and what makes its unit of SI."""
    from dtbacklash.fmu.interface import OUTPUT, variables

    names = list(rig.sensors)
    own = [one for one in variables(rig) if one.causality == OUTPUT and one.index < len(names)]
    return {one.name: (names[one.index], one.factor) for one in own}


CHANGED = [
    ("lead_screw", (GAP, FRICTION, LATE), {
        "parameters.k": 7e3, "parameters.J": 2e-5, "parameters.p": 4e-4, "effects.gear.backlash.half_gap": 0.1,
        "effects.motor_bearing.coulomb_friction.torque": 0.004, "effects.amplifier.delay.time": 0.0043,
    }),
    ("lead_screw", (COMPLIANT,), {"effects.screw.compliance.compliance": 3e-7, "parameters.m": 2.5}),
    ("belt_stage", (), {}),
]  # fmt: skip


@pytest.mark.parametrize(("name", "words", "values"), CHANGED)
def test_parameters_that_are_set_before_the_start_make_the_machine_that_has_them(slaves, name, words, values):
    """Structural ones as well: masses and springs of the linear plant, a delay, a gap."""
    rig, slave, u = load_rig(name, *words), slaves(name, *words), commands()
    if not values:
        values = {f"parameters.{own}": 1.1 * p.value for own, p in rig.config.parameters.items()}
    before = moved_rig(rig, u)
    for path, value in values.items():
        kind, *rest = path.split(".")
        if kind == "parameters":
            rig = rig.with_parameters({rest[0]: value})
        else:
            rig = rig.with_effect(rest[0], rest[1], {**rig.effects[rest[0]][rest[1]], rest[2]: value})
    slave.put(**{path.replace(".", "__"): value for path, value in values.items()})
    found, wanted = moved(slave.begin(), u, list(outputs(rig))), moved_rig(rig, u)
    np.testing.assert_array_equal(found, wanted)
    assert not np.allclose(found, before)


def moved_rig(rig, u):
    response = simulate(rig, u, STEP_S)
    return np.column_stack([response.sensors[sensor] * factor for sensor, factor in outputs(rig).values()])


def test_a_gap_that_grows_is_that_of_the_simulation(slaves):
    rig, u, gap = load_rig("lead_screw", FRICTION), commands(), np.linspace(0.0, 0.3, 401)
    slave = slaves("lead_screw", FRICTION).begin()
    degrees = np.degrees(gap)
    response = simulate(rig, u, STEP_S, np.radians(degrees))
    found = moved(slave, u, ["theta_m_rad", "theta_d_rad"], gap)
    np.testing.assert_array_equal(found[:, 0], response.sensors["theta_m"])
    np.testing.assert_array_equal(found[:, 1], response.theta_d_rad)


def test_a_positioner_follows_its_command_two_samples_late(slaves):
    """From rest: it begins as if the first command had been there before."""
    rig, u = load_rig("brfd"), np.append(np.zeros(10), np.cumsum(commands()) * 1e-3)
    response, slave = simulate(rig, u, STEP_S), slaves("brfd").begin()
    force = moved(slave, u, ["force_n"])[:, 0]
    assert np.abs(force).max() > 1e3
    np.testing.assert_array_equal(force[LATE_SAMPLES:], response.sensors["force"][:-LATE_SAMPLES])


def test_long_steps_are_short_ones_with_the_command_held(slaves):
    fine, coarse = slaves("lead_screw", FRICTION).begin(), slaves("lead_screw", FRICTION).begin()
    for voltage in (3.0, -2.0, 0.0, 5.0):
        for one in (fine, coarse):
            one.put(u_v=voltage)
        for _ in range(25):
            fine.step(STEP_S)
        coarse.step(25 * STEP_S)
        assert fine.get("q3_mm", "theta_m_rad") == coarse.get("q3_mm", "theta_m_rad")


def test_instances_do_not_know_of_one_another_and_a_reset_begins_anew(slaves):
    u = commands(100)
    first, other = slaves("lead_screw", GAP).begin(), slaves("lead_screw", GAP)
    other.put(parameters__k=5e3)
    other.begin()
    alone = moved(first, u, ["q3_mm"])
    first.fmu.reset()
    first.t_s = 0.0
    if first.two:
        first.fmu.setupExperiment()
    first.fmu.enterInitializationMode()
    first.begin()
    both = []
    for voltage in u:
        for one in (first, other):
            one.put(u_v=voltage)
            one.step(STEP_S)
        both.append([*first.get("q3_mm"), *other.get("q3_mm")])
    np.testing.assert_array_equal(np.array(both)[:, 0], alone[1:, 0])
    assert np.abs(np.diff(both, axis=1)).max() > 1e-3


@pytest.mark.parametrize("version", [2, 3])
def test_a_state_that_is_kept_is_brought_back(slaves, version):
    slave, u = slaves("lead_screw", GAP, FRICTION, LATE, version=version).begin(), commands(100)
    moved(slave, u, ["q3_mm"])
    state = slave.fmu.getFMUState()
    fmu = slave.fmu
    write, read = (
        (fmu.serializeFMUstate, fmu.deSerializeFMUstate)
        if version == 2
        else (fmu.serializeFMUState, fmu.deserializeFMUState)
    )
    state = read(write(state))
    t_s = slave.t_s
    first = moved(slave, u, ["q3_mm", "theta_d_rad"])
    slave.fmu.setFMUState(state)
    slave.t_s = t_s
    np.testing.assert_array_equal(moved(slave, u, ["q3_mm", "theta_d_rad"]), first)
    slave.fmu.freeFMUState(state)


@pytest.mark.parametrize(
    ("t_s", "h_s", "message"),
    [
        (0.0, 0.0015, "must be a multiple of the sample time 0.001 s"), (0.0, 0.0, "must be a multiple"),
        (0.0, -0.001, "must be a multiple"), (0.0, math.nan, "must be a multiple"),
        (0.002, 0.001, "must be 0 s, where the last step has ended"), (math.nan, 0.001, "must be 0 s"),
    ],
)  # fmt: skip
def test_a_step_that_cannot_be_is_refused_and_told(slaves, t_s, h_s, message):
    slave = slaves("lead_screw").begin()
    with pytest.raises(FMICallException):
        slave.fmu.doStep(t_s, h_s)
    assert len(slave.told) == 1
    assert message in slave.told[0]
    slave.fmu.doStep(0.0, 0.001)


def test_steps_that_are_added_up_are_taken(slaves):
    slave = slaves("lead_screw").begin()
    for _ in range(1000):
        slave.step(0.003)


WRONG = [
    ({"u_v": math.nan}, "u_v=nan: must be finite"), ({"gap_deg": -1.0}, "gap_deg=-1: must be at least 0"),
    ({"gap_deg": 361.0}, "gap_deg=361: must be at most 360"),
    ({"parameters__J": 0.0}, "parameters.J=0: must be above 0"),
    ({"parameters__c": -1.0}, "parameters.c=-1: must be at least 0"),
    ({"effects__gear__backlash__half_gap": -0.1}, "effects.gear.backlash.half_gap=-0.1: must be at least 0"),
    ({"effects__amplifier__delay__time": 9.0}, "the amplifier's delay may be 1 s at most"),
]  # fmt: skip


@pytest.mark.parametrize(("values", "message"), WRONG)
def test_a_value_that_cannot_be_is_refused_and_told(slaves, values, message):
    slave = slaves("lead_screw", GAP, FRICTION, LATE)
    slave.put(**values)
    with pytest.raises(FMICallException):
        slave.begin()
    assert slave.told[-1].startswith(message)


def test_what_is_fixed_or_an_output_is_not_set(slaves):
    slave = slaves("lead_screw", GAP).begin()
    for values, message in (({"parameters__k": 1e4}, "is fixed"), ({"q3_mm": 1.0}, "is an output")):
        with pytest.raises(FMICallException):
            slave.put(**values)
        assert message in slave.told[-1]


def test_a_parameter_that_would_make_another_machine_is_refused(slaves):
    slave = slaves("lead_screw", COMPLIANT)
    slave.put(effects__screw__compliance__compliance=0.0)
    with pytest.raises(FMICallException):
        slave.begin()
    assert "effects.screw.compliance.compliance != 0.0" in slave.told[-1]


def test_a_rig_that_runs_away_is_told(slaves):
    slave = slaves("lead_screw").begin()
    slave.put(u_v=1e308)
    with pytest.raises(FMICallException):
        slave.step(1.0)
    assert "has run away" in slave.told[-1]


def test_the_sources_are_whole_and_compile_without_a_warning(exported, tmp_path):
    compiler = shutil.which("cc")
    if compiler is None:
        pytest.skip("no cc")
    for version in (2, 3):
        with zipfile.ZipFile(exported("lead_screw", GAP, FRICTION, LATE, version=version)) as archive:
            archive.extractall(tmp_path / str(version), [n for n in archive.namelist() if n.startswith("sources/")])
        folder = tmp_path / str(version) / "sources"
        words = ["-std=c99", "-Wall", "-Wextra", "-Wconversion", "-Werror", "-fsyntax-only", "slave.c"]
        subprocess.run([compiler, *words], cwd=folder, check=True)


#: two instances, a wrong token, a wrong parameter, a reset, steps, a state written and read into the other instance
DRIVER = r"""
#include "slave.c"
static void show_line(void *i, const char *n, int s, const char *c, const char *f, ...)
{
    (void)i, (void)n, (void)s, (void)c;
    puts(f);
}
int main(void)
{
    Callbacks called = {show_line, calloc, free, NULL, NULL};
    Slave *a = fmi2Instantiate("a", 1, TOKEN, "", &called), *b = fmi2Instantiate("b", 1, TOKEN, "", &called);
    unsigned u_v = COMMAND_V, first = FIRST_PARAMETER, output = INPUTS;
    double wrong = -1.0, u = 6.0, y[2];
    void *state = NULL, *again = NULL;
    size_t n;

    if (fmi2Instantiate("c", 1, "another", "", &called))
        return 1;
    fmi2SetReal(b, &first, 1, &wrong);
    if (fmi2ExitInitializationMode(b) != WRONG || fmi2Reset(b) || fmi2ExitInitializationMode(a) ||
        fmi2ExitInitializationMode(b) || fmi2SetReal(a, &u_v, 1, &u) || fmi2DoStep(a, 0.0, 0.4))
        return 2;
    fmi2GetFMUstate(a, &state);
    fmi2SerializedFMUstateSize(a, state, &n);
    uint8_t *bytes = malloc(n);
    fmi2SerializeFMUstate(a, state, bytes, n);
    Plant *written = &((Slave *)bytes)->P; /* as another process would have it */
    written->slot = NULL, written->first = NULL, written->link_ends = NULL, written->friction_ends = NULL;
    written->sensor = NULL, written->sensor_whole = NULL, written->sensor_tick = NULL, written->sensor_part = NULL;
    written->sensor_play = NULL, written->law = NULL, written->A = NULL, written->E = NULL;
    fmi2DeSerializeFMUstate(b, bytes, n, &again);
    fmi2SetFMUstate(b, again);
    free(bytes), fmi2FreeFMUstate(a, &state), fmi2FreeFMUstate(b, &again);
    if (fmi2DoStep(a, 0.4, 0.1) || fmi2DoStep(b, 0.4, 0.1))
        return 3;
    fmi2GetReal(a, &output, 1, y), fmi2GetReal(b, &output, 1, y + 1);
    fmi2FreeInstance(a), fmi2FreeInstance(b);
    return y[0] == y[1] && y[0] != 0.0 ? 0 : 4;
}
"""


def test_instances_are_clean_under_the_sanitizers(exported, tmp_path):
    compiler = shutil.which("gcc")
    if compiler is None or sys.platform != "linux":
        pytest.skip("no gcc")
    with zipfile.ZipFile(exported("lead_screw", GAP, FRICTION, LATE)) as archive:
        archive.extractall(tmp_path)
    sources = tmp_path / "sources"
    (sources / "driver.c").write_text(DRIVER)
    words = [
        "-std=c99",
        "-g",
        "-fsanitize=address,undefined",
        "-fno-sanitize-recover",
        "driver.c",
        "-o",
        "driver",
        "-lm",
    ]
    subprocess.run([compiler, *words], cwd=sources, check=True)
    done = subprocess.run([sources / "driver"], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.splitlines()[-1] == "parameters.m=-1: must be above 0"


def test_the_library_needs_no_python(exported, tmp_path):
    if sys.platform != "linux" or not shutil.which("ldd"):
        pytest.skip("no ldd")
    with zipfile.ZipFile(exported("lead_screw")) as archive:
        archive.extractall(tmp_path)
    [library] = (tmp_path / "binaries").rglob("*.so")
    needed = subprocess.run(["ldd", library], capture_output=True, text=True, check=True).stdout
    assert "python" not in needed
    assert "libm" in needed or "libc" in needed


def test_every_value_of_the_description_has_all_its_digits(exported):
    with zipfile.ZipFile(exported("lead_screw", GAP)) as archive:
        root = xml.fromstring(archive.read("modelDescription.xml"))
    lead = root.find("ModelVariables/ScalarVariable[@name='parameters.p']/Real")
    assert lead.attrib == {"start": "0.0003183098861837907", "unit": "m/rad"}
    assert {one.attrib["name"] for one in root.findall("UnitDefinitions/Unit")} >= {"mm", "V", "kg m^2", "deg"}


DRAG = {
    "acts_on": "rotor", "law": "-drag*v**3", "source": "a fit",
    "parameters": {"drag": {"unit": "N m s^3/rad^3", "low": 0, "high": 1e3, "start": 0.01}},
}  # fmt: skip


@pytest.mark.usefixtures("as_before")
def test_a_law_of_a_user_and_a_table_work_inside(tmp_path):
    nominal = load_rig("pendulum")
    config = replace(nominal.config, laws={"fan_drag": DRAG}, effects={"disk": {"fan_drag": {"drag": 0.02}}})
    rig, u = build_rig(config), commands()
    table = catalogue.effects_of("rotor")["speed_table"]
    values = {p.name: 1e-3 * k if p.neutral == 0.0 else p.typical for k, p in enumerate(table.parameters)}
    rig = rig.with_effect("disk", "speed_table", values)
    write_machine(rig, STEP_S, 0, 16, 2, tmp_path / "own.fmu")
    slave = Slave(tmp_path / "own.fmu")
    slave.put(effects__disk__fan_drag__drag=0.01)
    rig = rig.with_effect("disk", "fan_drag", {"drag": 0.01})
    found = moved(slave.begin(), u, list(outputs(rig)))
    slave.close()
    np.testing.assert_array_equal(found, moved_rig(rig, u))
    without = rig.with_effect("disk", "speed_table", None)
    assert not np.allclose(found, moved_rig(without, u))


@pytest.mark.usefixtures("as_before")
def test_a_law_that_is_a_function_in_c_cannot_be_exported(tmp_path):
    reads = ctypes.POINTER(ctypes.c_double)
    drag = ctypes.CFUNCTYPE(ctypes.c_double, reads, reads)(lambda at, p: -p[0] * math.tanh(at[0]))
    parameters = (Parameter("size", "N m", 0.0, 1.0, 0.01, 0.0, role=Role.SIZE),)
    slot = BodyEffort(CLaw(drag, "velocity"))
    effect = Effect("tanh_drag", "rotor", parameters, "-size tanh(v)", slot, "here", "{size}.",
                    conceal=lambda place, sign: (0.0, 0.0))  # fmt: skip
    catalogue.register(effect)
    rig = load_rig("disk").with_effect("disk", "tanh_drag", {"size": 0.1})
    with pytest.raises(UserError, match="a function in C"):
        write_machine(rig, STEP_S, 0, 16, 2, tmp_path / "own.fmu")
