"""The check of units on forty recordings of machines that differ from their rigs: in right units, and in wrong ones."""

from dataclasses import replace

import machine_cases as cases
import numpy as np
import pytest

from dtbacklash.errors import UserError
from dtbacklash.recording import Recording, read_recording
from dtbacklash.recording.plausible import Scale, scales
from dtbacklash.recording.refusal import Refused
from dtbacklash.recording.wrong_units import FACTORS, check_units, doubts_of, mistaken

#: what people mistake, in both directions
WRONG = {unit: [f for f in all_ if 50 < max(f, 1 / f) < 1e4] for unit, all_ in FACTORS.items()}
#: rpm, revolutions, inches
SMALL = {unit: [f for f in all_ if max(f, 1 / f) < 50] for unit, all_ in FACTORS.items()}
#: recordings in which friction or a stiff spring leaves nothing of the rig's own: nothing is said about them
SILENT = {"oscillator, cubic", "oscillator, nearly stalls"}


@pytest.fixture(scope="module")
def recorded():
    """Every case with its channels, and what they look like in right units."""
    found = []
    for case in cases.all_cases():
        channels = {name: case.frame[name].to_numpy() for name in case.frame if name != "t"}
        found.append((case, channels, scales(case.rig, channels, 1e-3, "held")))
    return found


def test_nothing_in_right_units_is_refused(recorded):
    assert len(recorded) >= 25
    for case, _, found in recorded:
        for name, scale in found.items():
            assert mistaken(case.rig.sensors[name].unit, scale) is None, (case.name, name, scale)


def test_what_missing_physics_does_to_the_factor(recorded):
    """Where the motion says anything, the factor is far from that of any unit."""
    told = [scale.factor for case, _, found in recorded for scale in found.values() if case.name not in SILENT]
    assert len(told) > 60
    assert min(told) > 0.25
    assert max(told) < 2.0


def test_columns_that_have_changed_places_are_not_called_a_wrong_unit(recorded):
    """An angle read as metres looks like micrometres; the columns the other way round need no such factor."""
    case, channels, _ = next(found for found in recorded if found[0].name == "screw, friction")
    swapped = {"u": channels["u"], "theta_m": channels["q3"], "q3": channels["theta_m"]}
    with pytest.raises(Refused, match="channels theta_m and q3 look to have changed places"):
        check_units(case.rig, swapped, 1e-3, "held", {})


def test_wrong_units_are_noticed_in_both_directions(recorded):
    """Of 144 channels in wrong units at most four pass, all of them of the recordings that say nothing."""
    tried, passed = 0, []
    for case, channels, _ in recorded:
        for name in case.rig.sensors:
            for factor in WRONG[case.rig.sensors[name].unit] if name in channels else ():
                near = {n: channels[n] for n in ("u", "theta_m", "theta") if n in channels}
                spoilt = scales(case.rig, {**near, name: factor * channels[name]}, 1e-3, "held")[name]
                found = mistaken(case.rig.sensors[name].unit, spoilt)
                tried += 1
                assert found in (None, factor)
                passed += [(case.name, name, factor)] if found is None else []
    assert tried >= 140
    assert len(passed) <= 4
    assert {case for case, _, _ in passed} <= SILENT


def test_revolutions_and_inches_are_noticed_where_the_motion_is_plain(recorded):
    tried = noticed = 0
    for case, _, found in recorded:
        for name, scale in found.items():
            for factor in SMALL[case.rig.sensors[name].unit]:  # the check knows of sizes only what is in a scale
                wrong = replace(scale, factor=factor * scale.factor, sustained=factor * scale.sustained)
                told = mistaken(case.rig.sensors[name].unit, wrong)
                assert told in (None, factor)
                tried, noticed = tried + 1, noticed + (told == factor)
    assert tried > 100
    assert noticed > 0.6 * tried


def test_all_sensors_in_a_wrong_unit_are_noticed(recorded):
    """A command in mV, or all positions in mm: no sensor contradicts another."""
    for case, channels, _ in recorded:
        if case.name in SILENT or any(s.unit == "A" for n, s in case.rig.sensors.items() if n in channels):
            continue
        spoilt = scales(case.rig, {**channels, "u": 1e3 * channels["u"]}, 1e-3, "held")
        first = next(iter(spoilt))
        if case.rig.sensors[first].unit != "rad":
            assert mistaken(case.rig.sensors[first].unit, spoilt[first]) == 1e-3, case.name


def by_name(recorded, name):
    return next(case for case, _, _ in recorded if case.name == name)


def test_the_refusal_says_what_was_assumed_and_how_to_overrule_it(recorded, tmp_path):
    case = by_name(recorded, "carriage, friction")
    file = tmp_path / "bench.csv"
    case.frame.assign(x=1e3 * case.frame.x).to_csv(file, index=False)
    with pytest.raises(UserError) as caught:
        doubts_of(case.rig, read_recording(file, rig=case.rig))
    line = str(caught.value)
    for words in ("bench.csv: channel x looks to be in a wrong unit", "it was read in m (assumed)", "1000 too large",
                  "mm read as m", "recording.units.x=UNIT", "recording.trust_units=true"):  # fmt: skip
        assert words in line
    assert doubts_of(case.rig, read_recording(file, rig=case.rig, trust_units=True)) == []
    right = read_recording(file, rig=case.rig, units={"x": "mm"})
    assert np.allclose(right.channels["x"], case.frame.x)
    assert doubts_of(case.rig, right) == []


def test_a_frictionless_nominal_motor_that_overshoots_is_no_wrong_unit(recorded):
    """The nominal motor would turn many times as far as the recorded one, which friction nearly holds."""
    case = by_name(recorded, "motor, nearly stalls")
    assert doubts_of(case.rig, Recording.from_frame(case.frame, rig=case.rig)) == []


def test_a_long_recording_is_judged_by_a_part_of_it(recorded):
    case = by_name(recorded, "carriage, plain")
    long = {n: np.tile(case.frame[n].to_numpy(), 20) for n in ("u", "x")}
    assert mistaken("m", scales(case.rig, {**long, "x": 1e3 * long["x"]}, 1e-3, "held")["x"]) == 1e3


@pytest.mark.parametrize(("unit", "nearest"), [("rad", 25.5), ("rad/s", 25.5), ("m", 251), ("m/s", 251), ("A", 251)])
def test_small_factors_are_no_wrong_units_where_more_than_the_motion_is_at_work(unit, nearest):
    """Missing physics makes a machine move 20 times as far: that is no wrong unit."""
    factors = np.geomspace(1.0, 2e3, 2000)
    told = [f for f in factors for s in (f, 1 / f) if mistaken(unit, Scale(s, 0.8, 0.0)) is not None]
    assert min(told) == pytest.approx(nearest, rel=0.01)


def test_what_says_nothing():
    assert mistaken("m", Scale(0.0, 0.0, 0.0)) is None
    assert mistaken("m", Scale(1e3, 0.1, 0.0)) is None
    assert mistaken("V", Scale(1e3, 1.0, 0.0)) is None
    rig = cases.carriage()
    still = np.zeros(500)
    assert scales(rig, {"u": still, "x": np.arange(500.0)}, 1e-3, "held") == {}
    assert scales(rig, {"u": np.sin(np.arange(500.0)), "x": still}, 1e-3, "held") == {}


def test_the_shipped_rig_in_the_units_that_it_declares(recorded, save):
    case = by_name(recorded, "screw, friction and play, q3 alone")
    file = save(case.frame.assign(q3=1e3 * case.frame.q3))
    recording = read_recording(file, rig=case.rig)
    assert recording.assumed_units["q3"] == "mm (declared by the rig)"
    assert np.allclose(recording.channels["q3"], case.frame.q3)
    with pytest.raises(UserError, match=r"read in mm \(declared by the rig\).*too small"):
        doubts_of(case.rig, read_recording(save(case.frame), rig=case.rig))


@pytest.mark.parametrize(
    ("spoilt", "factor", "blamed"),
    [("u", 1e3, "u"), ("u", 204.8, "u"), ("u", 3276.8, "u"), ("theta_m", 4096 / (2 * np.pi), "theta_m"),
     ("theta_m", 180 / np.pi, "theta_m"), ("q3", 1e3, "q3")],
)  # fmt: skip
def test_the_channel_that_is_wrong_is_blamed(recorded, spoilt, factor, blamed):
    """A command in mV or in counts makes all sensors look too small, an angle in counts what it drives."""
    for case, channels, _ in recorded:
        if case.name not in ("screw, friction", "carriage, friction") or spoilt not in channels:
            continue
        read = {n: "m (assumed)" if n == "q3" else "V (assumed)" if n == "u" else "rad (assumed)" for n in channels}
        with pytest.raises(Refused, match=f"channel {blamed} looks to be in a wrong unit"):
            check_units(case.rig, {**channels, spoilt: factor * channels[spoilt]}, 1e-3, "held", read)


def test_whole_numbers_are_counts(recorded):
    case = by_name(recorded, "motor, plain")
    u, theta = (case.frame[n].to_numpy() for n in ("u", "theta"))
    counts = np.round(4096 / (2 * np.pi) * theta)
    with pytest.raises(Refused, match=r"counts of a sensor.*recording.units.theta=rev/4096, for as many counts a rev"):
        check_units(case.rig, {"u": u, "theta": counts}, 1e-3, "held", {"theta": "rad (assumed)"})
    with pytest.raises(Refused, match="as with mrad"):
        check_units(case.rig, {"u": u, "theta": counts + 0.25}, 1e-3, "held", {"theta": "rad (assumed)"})


def test_what_physics_could_do_is_a_doubt(recorded):
    """Revolutions read as radians: a motor whose amplifier is clipped moves as little."""
    case = by_name(recorded, "motor, plain")
    channels = {n: case.frame[n].to_numpy() for n in ("u", "theta")}
    (doubt,) = check_units(case.rig, {**channels, "theta": channels["theta"] / (2 * np.pi)}, 1e-3, "held", {})
    assert doubt.channel == "theta"
    assert "rev read as rad" in doubt.looks


def test_a_rig_that_cannot_be_driven_says_nothing(recorded):
    case = by_name(recorded, "carriage, plain")
    config = replace(case.rig.config, elements={"carriage": {"kind": "carriage", "mass": "M"}})
    from dtbacklash.physics.rig import build_rig

    channels = {"u": case.frame.u.to_numpy(), "x": case.frame.x.to_numpy()}
    assert scales(build_rig(config), channels, 1e-3, "held") == {}


@pytest.mark.nightly
def test_no_drawn_machine_is_refused_in_right_units():
    """Machines, commands and encoders at random: none is refused in right units, most wrong units are noticed."""
    tried = noticed = 0
    for seed in range(1000, 1400):
        case = cases.drawn_case(seed)
        channels = {name: case.frame[name].to_numpy() for name in case.frame if name != "t"}
        for name, scale in scales(case.rig, channels, 1e-3, "held").items():
            unit = case.rig.sensors[name].unit
            assert mistaken(unit, scale) is None, (case.name, name, scale)
            for factor in WRONG[unit]:  # the check knows of sizes only what is in a scale
                wrong = replace(scale, factor=factor * scale.factor, sustained=factor * scale.sustained)
                tried += 1
                noticed += mistaken(unit, wrong) is not None
    assert tried > 1000
    assert noticed > 0.55 * tried
