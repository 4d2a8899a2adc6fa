"""A benchmark of three cases, written by hand."""

import pytest

from dtbacklash.benchmark.files import data_text
from dtbacklash.scoring.truth import Hidden, Truth

TEST = {"x": [0.0, 1.0, 2.0, 1.0]}
TRUTHS = (
    Truth("001", "stage", "single", "development", False, [Hidden("table", "viscous_friction", 20.0, "N s/m")],
          [], {}, TEST, {"x": 0.1}),
    Truth("002", "stage", "nothing", "development", False, [], [("table", "delay")], {}, TEST, {"x": 0.1}),
    Truth("003", "stage", "unlisted", "development", True, [Hidden("spring", "unlisted")], [], {}, TEST, {"x": 0.1}),
)  # fmt: skip


@pytest.fixture
def bench(tmp_path):
    """Its folder."""
    folder = tmp_path / "bench"
    for truth in TRUTHS:
        case = folder / "cases" / truth.case
        case.mkdir(parents=True)
        said = {"case": truth.case, "machine": truth.machine, "split": truth.split}
        (case / "case.yaml").write_text(data_text(said), encoding="utf-8")
        (case / "answer.json").write_text(truth.to_json(), encoding="utf-8")
    (folder / "places.csv").write_text(
        "machine,place,synonyms,what\nstage,table,load;top plate,mass\nstage,spring,,link\n"
    )
    return folder


@pytest.fixture
def answers(tmp_path):
    """Writes a folder of answers: the text of its table, and predictions by case."""

    def write(text, **predictions):
        folder = tmp_path / "tool"
        folder.mkdir(exist_ok=True)
        (folder / "answers.csv").write_bytes(text if isinstance(text, bytes) else text.encode())
        for case, values in predictions.items():
            (folder / f"{case[1:]}.csv").write_text("x\n" + "\n".join(map(str, values)) + "\n")
        return folder

    return write
