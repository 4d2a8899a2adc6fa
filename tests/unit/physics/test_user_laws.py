"""Laws of one's own: from a declaration to an effect, and every mistake in one line."""

import copy
import pickle
import re
from importlib import metadata
from pathlib import Path

import numpy as np
import pytest
import yaml
from reference import rigs
from told import refused

from dtbacklash import yaml_files
from dtbacklash.errors import UserError
from dtbacklash.physics import catalogue, user_laws
from dtbacklash.physics.catalogue import CATALOGUE
from dtbacklash.physics.drawing import drawing_of, law_curve
from dtbacklash.physics.effects import slots
from dtbacklash.physics.effects.declare import Place, Role
from dtbacklash.physics.rig import build_rig
from dtbacklash.physics.rig_file import rig_content, rig_of, rig_yaml

DRAG = {
    "acts_on": ["carriage", "mass"], "law": "-drag*abs(v)**power*sign(v)",
    "parameters": {
        "drag": {"unit": "N", "low": 0, "high": 1e6, "start": 3.0},
        "power": {"unit": "1", "low": 0.2, "high": 4, "start": [1.5, 2.0]},
    },
    "source": "somebody's notebook",
}  # fmt: skip


def made(**changes):
    said = {name: value for name, value in (copy.deepcopy(DRAG) | changes).items() if value is not ...}
    return user_laws.effects_of_declaration("my_drag", said, "rig.laws.my_drag")


def test_a_declaration_becomes_an_effect_at_each_kind():
    carriage, mass = made()
    assert [(e.kind, e.name) for e in (carriage, mass)] == [("carriage", "my_drag"), ("mass", "my_drag")]
    assert carriage.law == "-drag * abs(v) ** power * sign(v)"
    assert isinstance(carriage.slot, slots.BodyEffort)
    assert [(p.name, p.unit, p.neutral, p.role) for p in carriage.parameters] == [
        ("drag", "N", 0.0, Role.SIZE), ("power", "1", None, Role.SHAPE),
    ]  # fmt: skip
    assert carriage.start_values(Place()) == [{"drag": 3.0, "power": 1.5}, {"drag": 3.0, "power": 2.0}]
    assert carriage.sentence.format(location="carriage", drag="3 N") == "My drag of 3 N acts at the carriage."
    state, effort = law_curve(drawing_of(carriage), {"drag": 3.0, "power": 2.0}, {}, (-2.0, 2.0))
    assert effort == pytest.approx(-3.0 * np.abs(state) ** 2.0 * np.sign(state))


#: kind, law, parameter's unit -> slot
SLOTS = {
    ("rotor", "a*sin(3*q)", "N m"): slots.BodyEffort, ("carriage", "a", "N"): slots.BodyEffort,
    ("carriage", "a*exp(-slip_speed)", ""): slots.Contact, ("link", "a*direction**2", "N"): slots.Contact,
    ("link", "a*s**3", "N/m^3"): slots.SpringForce, ("shaft", "a*ds*abs(ds)", "N m s^2/rad^2"): slots.SpringForce,
    ("amplifier", "u + a*u**3", "1/V^2"): slots.Command,
    ("motor_circuit", "a*i**2*sin(q)", "N m/A^2"): slots.MotorTorque,
}  # fmt: skip


@pytest.mark.parametrize("given", SLOTS, ids=":".join)
def test_the_slot_follows_from_the_kind_and_the_states(given):
    kind, law, unit = given
    units_told = ["", unit] if unit else [""]
    for told in units_told:  # where no unit is given, none is checked
        (effect,) = made(acts_on=kind, law=law.replace("exp(-slip_speed)", "exp(-slip_speed/0.1)"),
                         parameters={"a": {"unit": told, "start": 1.0}})  # fmt: skip
        assert type(effect.slot) is SLOTS[given]


def test_a_memory_has_a_rate():
    (effect,) = made(acts_on="carriage", law="-k*z", **{"z'": "v - abs(v)*z/reach"}, parameters={
        "k": {"unit": "N/m", "start": 1e5}, "reach": {"unit": "m", "low": 1e-9, "high": 1, "start": 1e-5}})  # fmt: skip
    assert isinstance(effect.slot, slots.BodyMemory)
    assert effect.law == "-k * z, z' = v - abs(v) * z / reach"
    assert drawing_of(effect) is None  # it depends on what was before


A = {"a": {"unit": "N s/m", "start": 1.0}}
#: (changes of the declaration) -> what the line says
WRONG = [
    ({"acts_on": "wheel"}, "acts_on=wheel: one or several of amplifier, motor_circuit, rotor"),
    ({"acts_on": ...}, "acts_on=(missing): one or several"), ({"acts_on": []}, "acts_on=[]: one or several"),
    ({"acts_on": "gear"}, "acts_on=gear"), ({"acts_on": 3}, "acts_on=3"),
    ({"law": ...}, "law=(missing): a formula"), ({"law": 3}, "law=3: a formula in words"),
    ({"law": "open(drag)*power"}, "law=open(): is no function here"), ({"law": "drag.real"}, "an attribute"),
    ({"law": "drag*power*w"}, "law=w: states position (q), velocity (v)"), ({"law": "drag*z*power"}, "law=z: states"),
    ({"law": "drag*v", "parameters": {"drag": {"unit": "N", "start": 1}}}, "law=drag * v: gives W, must give N"),
    ({"law": "drag"}, "parameters.power=power: does not stand in the law"),
    ({"law": "1 + a*v", "parameters": A}, "1 and N cannot be added or compared"),
    ({"law": "1.5 + a*v", "parameters": A}, "gives 1.5 at velocity = 0; must give nothing where a = 0"),
    ({"law": "a*v/q*1.5", "parameters": A}, "gives nan at velocity = 0, position = 0; must give a finite number"),
    ({"law": "a*v*exp(v*100.5)", "parameters": A}, "gives inf at velocity = 10"),
    ({"law": "a*slip_speed*direction", "parameters": A}, "slip_speed = 10, direction = -1; must give a level"),
    ({"law": "a*slip_speed*q*1.0", "parameters": A}, "law=position: beside the others there: slip_speed, direction"),
    ({"more": 1}, "my_drag.more=1: unknown; a law has acts_on, law"),
    ({"source": 3}, "source=3: a text of at most 500 signs"),
    ({"sentence": "{nobody}"}, "in whose braces stand {location}, {drag}, {power}"),
    ({"sentence": "{drag.__class__}"}, "in whose braces"),
    ({"sentence": "{"}, "in whose braces"),
    ({"sentence": "{drag:>999999999}"}, "in whose braces"),
    ({"parameters": ...}, "parameters=(missing): a mapping"), ({"parameters": [1]}, "parameters=[1]: a mapping"),
    ({"parameters": {f"a{n}": {"start": 1} for n in range(7)}}, "of 1 to 6 parameters"),
    ({"parameters": {"v w": {"start": 1}}}, "parameters.v w=v w: a name of at most"),
    ({"parameters": {"velocity": {"start": 1}}}, "a name that is no state of a carriage"),
    ({"parameters": {"size": {"start": 1}}}, "neither size nor pi"),
    ({"parameters": {"a": 1}}, "a=1: a mapping with at least"),
    ({"parameters": {"a": {"start": 1, "max": 2}}}, "a.max=2: unknown; a parameter has unit, low"),
    ({"parameters": {"a": {"start": 1, "unit": "furlong"}}}, "a.unit=furlong: a unit of 1, rad"),
    ({"parameters": {"a": {"start": 1, "unit": "mm"}}}, "a.unit=mm: a unit of"),
    ({"parameters": {"a": {"start": 1, "unit": 3}}}, "a.unit=3: a unit of"),
    ({"parameters": {"a": {"start": "x"}}}, "a.start=x: a finite number"),
    ({"parameters": {"a": {"start": float("nan")}}}, "a.start=nan: a finite number"),
    ({"parameters": {"a": {"start": 1, "high": float("inf")}}}, "a.high=inf: a finite number"),
    ({"parameters": {"a": {"start": 1, "low": 3, "high": 2}}}, "a.high=2.0: above low"),
    ({"parameters": {"a": {"start": 5, "low": 0, "high": 2}}}, "a.start=5: from 0 to 2"),
    ({"parameters": {"a": {"start": 0}}}, "a number other than neutral"),
    ({"parameters": {"a": {"start": []}}}, "a.start=[]"),
    ({"parameters": {"a": {"start": 1, "role": "shape"}}}, "a.role=shape: size, as it is the first"),
    ({"parameters": {**A, "b": {"start": 1, "role": "time"}}}, "b.role=time: wave, angle, frequency, shape"),
    ({"law": "-a*v*q", "parameters": {**A, "q": {"start": 1}}}, "q=q: a name that is no state of a"),
    ({"parameters": {**A, **{n: {"start": [1, 2, 3, 4]} for n in "bc"}}}, "16 sets of start values: at most 12"),
    ({"acts_on": "link", "z'": "v"}, "z'=v: a link has no memory; a body has"),
]  # fmt: skip


@pytest.mark.parametrize(("changes", "said"), WRONG)
def test_a_mistake_is_one_line_that_names_key_value_and_what_is_allowed(changes, said):
    with refused(said, start="rig.laws.my_drag"):
        made(**changes)


@pytest.mark.parametrize("name", ["My", "a b", "", "2a", "lambda", "a" * 41, "é", 3])
def test_a_name_is_a_word(name):
    with pytest.raises(UserError, match="a name of at most 40 small letters"):
        user_laws.effects_of_declaration(name, DRAG, "rig.laws.x")


@pytest.mark.parametrize("said", [None, 3, [], "x"])
def test_a_declaration_is_a_mapping(said):
    with pytest.raises(UserError, match="a mapping with acts_on, law and parameters"):
        user_laws.effects_of_declaration("x", said, "rig.laws.x")


def with_laws(**laws):
    content = rig_content(rigs.carriage())
    return content | {"laws": laws, "effects": {"carriage": {name: {"drag": 2.0} for name in laws}}}


@pytest.mark.usefixtures("as_before")
def test_a_rig_brings_its_laws_and_its_file_has_them_again():
    rig = rig_of(with_laws(my_drag=DRAG))
    assert rig.effects["carriage"]["my_drag"] == {"drag": 2.0, "power": 1.5}
    again = yaml.safe_load(rig_yaml(rig))
    assert again["laws"] == {"my_drag": DRAG}
    assert rig_of(again).effects == rig.effects  # the same once more is no second law
    assert yaml.safe_load(rig_yaml(rigs.carriage())).keys().isdisjoint({"laws"})


@pytest.mark.usefixtures("as_before")
def test_the_file_of_a_rig_has_the_laws_that_it_uses_from_elsewhere():
    catalogue.declare({"my_drag": DRAG}, "conf/effect")
    rig = rigs.carriage().with_effect("carriage", "my_drag", {"drag": 2.0})
    assert rig.config.laws == {}
    content = rig_content(rig)
    assert content["laws"] == {"my_drag": DRAG}
    for key in [key for key in CATALOGUE if key[1] == "my_drag"]:
        del CATALOGUE[key]
    assert rig_of(content).effects == rig.effects


@pytest.mark.usefixtures("as_before")
def test_a_name_that_exists_is_refused():
    catalogue.declare({"my_drag": DRAG}, "rig.laws")
    with pytest.raises(UserError, match=r"rig\.laws\.my_drag=my_drag: a name that no effect has"):
        catalogue.declare({"my_drag": DRAG | {"law": "-drag*v*power"}}, "rig.laws")
    with pytest.raises(UserError, match="there is cogging already"):
        catalogue.declare({"cogging": DRAG}, "rig.laws")


@pytest.mark.usefixtures("as_before")
def test_another_process_learns_the_laws_with_the_rig():
    rig = rig_of(with_laws(my_drag=DRAG))
    bare = build_rig(rigs.carriage().config).with_effect("carriage", "my_drag", {"drag": 2.0})  # not in its own file
    sent = [pickle.dumps(rig), pickle.dumps(bare)]
    for text in sent:
        for key in [key for key in CATALOGUE if key[1] == "my_drag"]:
            del CATALOGUE[key]
        assert pickle.loads(text).effects == rig.effects
        assert ("carriage", "my_drag") in CATALOGUE


def test_a_folder_is_read_in_order(tmp_path):
    for name in ("b", "a"):
        (tmp_path / f"{name}.yaml").write_text(yaml.safe_dump(DRAG))
    (tmp_path / "readme.txt").write_text("no law")
    found = list(user_laws.folder_declarations(tmp_path))
    assert found == [("a", DRAG), ("b", DRAG)]
    assert list(user_laws.folder_declarations(tmp_path / "none")) == []
    (tmp_path / "c.yaml").write_text("a: [1")
    with pytest.raises(UserError, match=r"effect=.*c\.yaml: is not valid YAML"):
        list(user_laws.folder_declarations(tmp_path))


class Point:
    """An entry point of a package that is not installed."""

    def __init__(self, given, name="theirs"):
        self.given, self.name, self.value = given, name, "their_package:laws"

    def load(self):
        if isinstance(self.given, Exception):
            raise self.given
        return self.given


def test_an_installed_package_brings_laws(monkeypatch):
    (theirs,) = made(acts_on="carriage")
    points = [Point([theirs], "b"), Point({"their_drag": DRAG}, "a"), Point(theirs, "c")]
    monkeypatch.setattr(metadata, "entry_points", lambda group: points if group == "dtbacklash.effects" else [])
    assert [(e.kind, e.name) for e in user_laws.installed()] == [
        ("carriage", "their_drag"), ("mass", "their_drag"), ("carriage", "my_drag"), ("carriage", "my_drag"),
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("given", "said"),
    [
        (ImportError("no module"), "their_package:laws: cannot be loaded: no module"), (3, "an Effect, a list of them"),
        ([3], "an Effect, a list of them"), ({"x": 3}, "dtbacklash.effects.theirs.x=3: a mapping with acts_on"),
    ],
)  # fmt: skip
def test_a_package_that_brings_none_is_named(monkeypatch, given, said):
    monkeypatch.setattr(metadata, "entry_points", lambda group: [Point(given)])
    with refused(said):
        list(user_laws.installed())


PAGE = (Path(__file__).resolve().parents[3] / "docs" / "own_laws.md").read_text(encoding="utf-8")
EXAMPLE = yaml_files.read(re.findall(r"```yaml\n(.*?)```", PAGE, flags=re.DOTALL)[0])
MISTAKES = re.findall(r"^\| `(.*?)` \| `(.*?)` \|$", PAGE.partition("## What is refused")[2], flags=re.MULTILINE)


def test_the_example_of_the_docs_is_a_law():
    assert [e.kind for e in user_laws.effects_of_declaration("air_drag", EXAMPLE, "effect")] == ["rotor"]
    assert len(MISTAKES) == 14


@pytest.mark.parametrize(("changed", "said"), MISTAKES)
def test_the_mistakes_of_the_docs_are_refused_as_they_say(changed, said):
    with refused(said):
        user_laws.effects_of_declaration("air_drag", EXAMPLE | yaml_files.read(changed), "effect")


SHELF = dict(user_laws.folder_declarations(user_laws.SHIPPED))


@pytest.mark.parametrize("name", SHELF)
@pytest.mark.usefixtures("as_before")
def test_a_law_of_the_package_is_there_where_a_rig_asks_for_it(name):
    assert not any(known == name for _, known in CATALOGUE)
    catalogue.declare({name: "packaged"}, "rig.laws")
    made = [e for (_, known), e in CATALOGUE.items() if known == name]
    assert all(e.source != user_laws.UNKNOWN_SOURCE and e.declared == SHELF[name] for e in made)
    assert sorted(e.kind for e in made) == sorted(np.atleast_1d(SHELF[name]["acts_on"]))


def test_a_law_that_the_package_has_not():
    first = "nothing=packaged: no law of the package has that name; choose one of cogging_harmonics"
    with pytest.raises(UserError, match=first):
        catalogue.declare({"nothing": "packaged"}, "rig.laws")


def test_a_unit_may_be_that_of_the_axis():
    said = {"acts_on": ["rotor", "mass"], "law": "-a*v", "parameters": {"a": {"unit": "effort/speed", "start": 1}}}
    with pytest.raises(UserError, match="a unit of 1, rad"):  # N m/rad/s has two bars
        user_laws.effects_of_declaration("x", said, "rig.laws.x")
    said["parameters"]["a"]["unit"] = "effort s/position"
    made = user_laws.effects_of_declaration("x", said, "rig.laws.x")
    assert [e.size.unit for e in made] == ["N m s/rad", "N s/m"]
