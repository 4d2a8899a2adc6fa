"""Recordings of which the user says that nothing was commanded."""

import numpy as np
import pytest

from dtbacklash.errors import UserError
from dtbacklash.recording import Recording, read_recording, refined


def test_a_column_u_is_not_needed(frame, save, refusal):
    file = save(frame.drop(columns=["u", "r"]))
    assert "lacks the column u (the command)" in refusal(file)
    assert "give recording.command=none if there was none" in refusal(file)
    recording = read_recording(file, command="none")
    assert np.array_equal(recording.channels["u"], np.zeros(len(frame)))
    assert (recording.units["u"], recording.assumed_units["u"]) == ("V", "V (no command)")
    assert np.array_equal(recording.channels["q3"], frame.q3)
    assert refined(recording)[1] == 1


def test_a_mapping_may_say_it(frame, save, tmp_path):
    save(frame.drop(columns="u"), "swing.csv")
    (tmp_path / "swing.yaml").write_text(
        "file: swing.csv\ntime: t\ncommand: none\nchannels: {theta_m: theta_m, q3: q3}\n"
    )
    recording = read_recording("swing.yaml")
    assert recording.command == "none"
    assert not recording.channels["u"].any()


def test_a_command_that_is_there_is_not_taken_for_none(frame, save, refusal):
    said = refusal(save(frame), command="none")
    assert said.endswith("was said to have no command (command=none), and its column u is not 0")
    still = Recording.from_frame(frame.assign(u=0.0), command="none")
    assert still.assumed_units["u"] == "V (assumed)"


def test_another_word_is_refused(frame):
    with pytest.raises(UserError, match=r"^recording.command=smooth: choose one of held, band_limited, none$"):
        Recording.from_frame(frame, command="smooth")
