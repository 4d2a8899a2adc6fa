"""What a notebook shows of results, rigs and recordings: a line, a small table, a figure."""

from dataclasses import replace
from unittest.mock import Mock

import diagnosed
import numpy as np
import pandas as pd
import pytest
from matplotlib.figure import Figure
from told import refused

import dtbacklash as dtb
from dtbacklash.api.diagnose import Found
from dtbacklash.diagnosis.plot_data import Profile
from dtbacklash.recording import Recording
from dtbacklash.report.diagnosis.residual import autocorrelation


@pytest.fixture(scope="module")
def found():
    return Found(diagnosed.missing())


@pytest.fixture(scope="module")
def run():
    return dtb.run("controller=open_loop", "reference=multisine", "duration_s=1", rig="pendulum")


def test_a_line_says_what_it_is(found, run):
    assert repr(found) == "<Found: missing_physics, coulomb_friction at motor_bearing, backlash at gear>"
    assert repr(run) == "<Run: open_loop on pendulum, 1001 samples, 0 moves>"
    rubbing = run.rig.with_effect("disk", "coulomb_friction", {"torque": 0.02})
    assert repr(rubbing) == "<Rig: pendulum, 3 elements, coulomb_friction at disk>"
    assert repr(run.recording) == "<Recording: open_loop on pendulum, 1001 samples, r, u, theta, omega>"


def test_a_notebook_shows_a_table_and_a_figure_and_no_page(found, run):
    for result, told in ((found, ("backlash", "20.0", "sure")), (run, ("open_loop on pendulum",))):
        html = result._repr_html_()
        assert "data:image/png;base64," in html
        assert not [word for word in told if word not in html]
        assert "<!DOCTYPE" not in html
    for thing, told in ((run.rig, ("K_t", "N m/V")), (run.recording, ("theta", "rad"))):
        html = thing._repr_html_()
        assert html.count("<table") == 1
        assert not [word for word in told if word not in html]


def test_what_stands_in_a_name_is_text_and_no_markup(found):
    recording = Recording.from_frame(
        pd.DataFrame({"t": 1e-3 * np.arange(500), "u": np.ones(500), "x [mm]": np.arange(500.0)}), name="<b>lab</b>"
    )
    assert "<b>lab" not in recording._repr_html_()
    assert "<b>" not in Found(diagnosed.consistent())._repr_html_().replace("<b></b>", "")


def test_the_residual_is_drawn_with_its_autocorrelation_and_spectrum(found):
    figure = found.plot("residual q3")
    assert isinstance(figure, Figure)
    assert [ax.get_ylabel().partition(" ")[0] for ax in figure.axes] == ["left", "autocorrelation", "spectrum"]
    with refused("plot=residual y: choose one of rig, theta_m, q3, residual theta_m, residual q3"):
        found.plot("residual y")


def test_the_profile_of_a_fitted_parameter_is_drawn_with_the_parabola_of_its_error(found):
    title, values = "motor_bearing.coulomb_friction.torque", np.linspace(0.018, 0.022, 11)
    profiles = Mock(
        units={title: "N m"}, return_value=Profile(title, values, ((values - 0.02) / 5e-4) ** 2, 0.02, 5e-4)
    )
    figure = Found(replace(found.diagnosis, profiles=profiles)).plot(f"profile {title}")
    (ax,) = figure.axes
    parabola, drawn = (line.get_xydata() for line in ax.lines[:2])
    assert ax.get_xlabel() == f"{title} [mN m]"
    assert drawn[:, 0] == pytest.approx(np.linspace(18.0, 22.0, 11))
    assert np.interp(drawn[:, 0], *parabola.T) == pytest.approx(drawn[:, 1], abs=0.01)
    with refused("plot=profile q9"):
        found.plot("profile q9")


def test_an_autocorrelation_is_one_at_no_lag_and_that_of_its_period_elsewhere():
    wave = np.sin(2.0 * np.pi * np.arange(20_000) / 50.0)
    found = autocorrelation(wave, 50)
    assert found[0] == pytest.approx(1.0)
    assert found[[25, 50]] == pytest.approx([-1.0, 1.0], abs=0.01)
    assert not autocorrelation(np.zeros(100)).any()
