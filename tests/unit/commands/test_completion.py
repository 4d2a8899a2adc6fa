"""Tab completes commands, settings and choices, in a real bash."""

import shutil
import subprocess
import sys

import pytest

from dtbacklash.commands import completion
from dtbacklash.errors import UserError


@pytest.mark.parametrize(
    ("line", "some"),
    [
        ("dtb ", {"run", "diagnose", "prove", "conceal", "paper", "recordings"}),
        ("dtb r", {"run", "recordings"}),
        ("dtb run contr", {"controller=", "controller."}),
        ("dtb run controller=n", {"controller=nimc_fixed", "controller=nimc_novelty", "controller=nimc_twin"}),
        ("dtb run twin.del", {"twin.delay_s="}),
        ("dtb run hydra/launcher=j", {"hydra/launcher=joblib"}),
        ("dtb run ou", {"out="}),
        ("dtb run figures=", {"figures=true", "figures=false"}),
        ("dtb prove --q", {"--quick"}),
        ("dtb prove backend=", {"backend=loky", "backend=dask"}),
        ("dtb diagnose recording=e", {"recording=emps"}),
        ("dtb diagnose rig=le", {"rig=lead_screw"}),
        ("dtb recordings fetch s", {"silverbox"}),
    ],
)
def test_what_may_stand_there(line, some):
    assert some <= set(completion.answers(line))


def test_what_belongs_to_another_command_is_not_offered():
    assert not any(answer.startswith(("controller", "twin")) for answer in completion.answers("dtb diagnose "))


def test_a_shell_that_is_not_known():
    with pytest.raises(UserError, match="choose one of bash, zsh"):
        completion.main(["--install-completion", "tcsh"])


def test_it_is_put_where_bash_looks(tmp_path, monkeypatch, capsys):
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path))
    assert completion.main(["--install-completion", "bash"]) == 0
    file = tmp_path / "bash-completion" / "completions" / "dtb"
    assert file.read_text() == completion.script("bash")
    assert f"source {file}" in capsys.readouterr().out


@pytest.mark.skipif(not shutil.which("bash"), reason="no bash here")
@pytest.mark.parametrize(
    ("line", "replies"),
    [
        ("dtb diag", ["diagnose"]),
        ("dtb run controller=im", ["imc"]),  # bash replaces what follows the =
        ("dtb run -m controller=imc prof", ["profile.", "profile="]),
        ("dtb prove --qu", ["--quick"]),
    ],
)
def test_bash_completes_a_command(tmp_path, line, replies):
    (tmp_path / "dtb").write_text(f'#!/bin/sh\nexec {sys.executable} -m dtbacklash.cli "$@"\n')
    (tmp_path / "dtb").chmod(0o755)
    (tmp_path / "script").write_text(completion.script("bash"))
    drive = f"""
        PATH={tmp_path}:$PATH; source {tmp_path}/script; complete -p dtb >&2
        COMP_LINE='{line}'; COMP_POINT=${{#COMP_LINE}}; read -ra COMP_WORDS <<< "$COMP_LINE"
        _dtb_completion dtb "${{COMP_WORDS[-1]}}"; printf '%s\\n' "${{COMPREPLY[@]}}"
    """
    answer = subprocess.run(["bash", "-c", drive], capture_output=True, text=True, check=True, timeout=60)
    assert answer.stdout.split() == replies
    assert "-F _dtb_completion dtb" in answer.stderr


def test_a_command_that_writes_one_file_is_completed_behind_its_second_word():
    assert completion.answers("dtb export ") == ["fmu", "controller"]
    assert completion.answers("dtb export fmu rig=lead") == ["rig=lead_screw"]
    assert "out=" in completion.answers("dtb export fmu o")
    assert "sample_time_s=" in completion.answers("dtb export fmu sam")


def test_the_parts_of_dtb_twin_are_completed_with_their_settings():
    assert completion.answers("dtb twin s") == ["serve", "status"]
    assert completion.answers("dtb twin serve wo") == ["workers="]
    assert completion.answers("dtb twin describe rig=lead") == ["rig=lead_screw"]
