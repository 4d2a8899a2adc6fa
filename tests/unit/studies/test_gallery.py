"""The gallery: what may stand in it, how it is made of a diagnosis, and that its images are small."""

import numpy as np
import pytest
from PIL import Image

from dtbacklash import load_rig
from dtbacklash.files import write_json
from dtbacklash.prove.draw import check_choices
from dtbacklash.prove.secret import Secret
from studies import gallery

TRUE = Secret(
    7, "lead_screw", "single", [{"location": "gear", "effect": "backlash", "parameters": {"half_gap": 0.00646}}]
)
FOUND = {
    "verdict": "missing_physics",
    "summary": "The gear has backlash of 0.00643 rad to each side. Left: q 1.2 mm (9 %), v 1 (3 %). "
    "Unknown force left: 0.2 N at the mass 2, 22 % of what acts on it. It is worn.",
    "findings": [{
        "location": "gear", "effect": "backlash", "sentence": "", "when": "",
        "parameters": {"half_gap": {"value": 0.00643, "unit": "rad", "ci95": [0.00599, 0.00687]}},
        "also_fits": [{"location": "sensor_q3", "effect": "delay"}],
    }],
    "recalibrated": {"k": {"nominal": 1e4, "value": 9310.0, "unit": "N/m", "ci95": [9290.0, 9330.0]}},
    "next_experiment": "Record the current too.",
}  # fmt: skip


def draw(path, height, seed=0):
    path.parent.mkdir(parents=True, exist_ok=True)
    noise = np.random.default_rng(seed).integers(0, 255, (height // 8, 180, 3), dtype=np.uint8)
    Image.fromarray(noise).resize((1440, height)).save(path)


def made_up(exhibit, folder):
    found = folder / gallery.FOUND
    draw(found / "figures" / "rig.png", 400)
    draw(found / "figures" / "law_1_gear.png", 800)
    draw(found / "figures" / "law_2_gear.png", 8000)
    write_json(found / "diagnosis.json", FOUND)
    return TRUE


@pytest.mark.parametrize("exhibit", gallery.EXHIBITS, ids=lambda e: e.name)
def test_every_exhibit_can_be_concealed(exhibit):
    chosen = exhibit.chosen
    check_choices(load_rig(gallery.RIG), chosen.get("kind"), chosen.get("effect"), chosen.get("instruments"))
    assert set(chosen) <= {"kind", "effect", "instruments"}


def test_the_exhibits_show_different_things():
    assert len({e.name for e in gallery.EXHIBITS}) == len({e.choices for e in gallery.EXHIBITS}) >= 6


@pytest.mark.check
def test_an_exhibit_says_what_was_hidden_and_what_was_found(tmp_path):
    gallery.make(gallery.EXHIBITS[:1], tmp_path, made_up)
    text = (tmp_path / "gallery.md").read_text(encoding="utf-8")
    for said in (
        "## A worn gear",
        "- Diagnosed: **missing physics**. The gear has backlash of 0.00643 rad to each side. It is worn.",
        "| `gear` half_gap | 6.46 mrad | 6.4 ± 0.4 mrad |",
        "| `k` | 10000 N/m | 9310 ± 20 N/m |",
        "This recording cannot tell it from: delay at sensor_q3.",
        "To record next: Record the current too.",
        "dtb conceal out=hidden seed=7 effect=gear.backlash",
        "(images/gallery_backlash.png)",
    ):
        assert said in text
    with Image.open(tmp_path / "images" / "gallery_backlash.png") as image:
        assert image.width > image.height * 0.6  # the rig, and the first force alone


@pytest.mark.nightly
def test_what_is_made_anew_leaves_the_others(tmp_path):
    gallery.make(gallery.EXHIBITS[:2], tmp_path, made_up)
    before = {path: path.read_bytes() for path in tmp_path.rglob("*.*")}
    gallery.make(gallery.EXHIBITS[:1], tmp_path, made_up)
    assert {path: path.read_bytes() for path in tmp_path.rglob("*.*")} == before


def test_hidden_parameters_and_unknown_physics_have_their_words():
    rig = load_rig(gallery.RIG)
    wrong = Secret(7, "lead_screw", "parameters", parameters={"k": 9300.0})
    assert gallery.hidden_sentences(wrong, rig) == ["k (stiffness between two platforms) is off by -7.0 %."]
    unknown = {"location": "link_1", "name": "x", "description": "a spring with a root in it", "size": 1, "scale": 1}
    assert "a spring with a root in it" in gallery.hidden_sentences(Secret(7, "", "unknown", unknown=unknown), rig)[0]
    assert gallery.hidden_sentences(Secret(7, "", "nothing"), rig) == ["Nothing."]


def test_an_image_of_flat_colours_is_small(tmp_path):
    canvas = Image.new("RGB", (1440, 900), "white")
    canvas.paste((0, 114, 178), (100, 100, 700, 500))
    canvas.save(tmp_path / "a.png")
    gallery.picture([tmp_path / "a.png", tmp_path / "a.png"], tmp_path / "both.png")
    assert (tmp_path / "both.png").stat().st_size < gallery.BYTES_MAX


def test_the_committed_page_is_made_of_the_committed_data():
    docs = gallery.Path(__file__).resolve().parents[3] / "docs"
    assert (docs / gallery.PAGE).read_text(encoding="utf-8") == gallery.page_text(docs)
    images = list((docs / gallery.IMAGES).glob("gallery_*.png"))
    assert {image.stem.removeprefix("gallery_") for image in images} <= {e.name for e in gallery.EXHIBITS}
    assert max((image.stat().st_size for image in images), default=0) <= gallery.BYTES_MAX
