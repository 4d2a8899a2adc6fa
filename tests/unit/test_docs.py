"""The docs stay true: generated pages are current, commands are accepted, links lead somewhere, words are ours."""

import re
import shlex
import tomllib
from pathlib import Path

import pytest
from page_reader import table_cells

from dtbacklash import cli
from dtbacklash.campaign.application import find
from dtbacklash.config.compose import compose_for
from dtbacklash.config.grammar import GRAMMARS, RUN
from dtbacklash.config.groups import packaged_options
from dtbacklash.config.twin import PARTS, read
from dtbacklash.docs import pages as docs
from dtbacklash.physics.catalogue import CATALOGUE
from dtbacklash.physics.element_kinds import KINDS

ROOT = Path(__file__).resolve().parents[2]
PAGES = sorted([*ROOT.glob("*.md"), *ROOT.glob("docs/**/*.md")])
IMAGES = sorted(ROOT.glob("docs/images/*"))
LINK = re.compile(r"!?\[[^\]]*\]\(([^)\s]+)\)")
#: paths of this or that machine, how the work is organised, hosts of package registries
FORBIDDEN = re.compile(
    r"(?<![\w.])/(work|tmp|root|home|Users)/|\bsessions?\b|\bhelpers?\b|issue #?\d|issue tracker|\bTODO\b|\bFIXME\b"
    r"|pypi|pythonhosted|conda\.anaconda|proxy\.golang|npmjs",
    re.IGNORECASE,
)


def test_all_pages_are_looked_at() -> None:
    assert {"README.md", "CHANGELOG.md", "CLAIMS.md", "KNOWN_GAPS.md", "docs/theory.md"} <= {
        str(page.relative_to(ROOT)) for page in PAGES
    }


def test_generated_pages_are_current(tmp_path: Path) -> None:
    made = {path.name: path.read_text(encoding="utf-8") for path in docs.write(tmp_path)}
    assert {"effects.md", "configuration.md", "settings.md"} <= made.keys()
    committed = {name: (ROOT / "docs" / name).read_text(encoding="utf-8") for name in made}
    assert [name for name in made if committed[name] != made[name]] == [], "run: python -m dtbacklash.docs"


def test_every_effect_stands_in_its_table_with_units_and_bounds() -> None:
    sections = re.split(r"^## ", docs.effects_page(), flags=re.MULTILINE)[1:]
    rows = {}
    for section in sections:
        effect = ""
        for line in section.splitlines():
            if line.startswith("| ") and not line.startswith(("| effect", "| ---")):
                cells = table_cells(line)
                effect = cells[0] or effect
                rows[section.split("\n", 1)[0], effect, cells[2].split("`")[0]] = cells[3:6]
    expected = {
        (kind, name, p.name): [p.unit, docs.number(p.low), docs.number(p.high)]
        for (kind, name), effect in CATALOGUE.items()
        for p in effect.listed
    }
    assert rows == expected


def test_every_group_option_setting_and_kind_stands_in_the_configuration() -> None:
    page = docs.configuration_page()
    for group in RUN.groups:
        for option in packaged_options(group):
            assert f"| `{group}` | `{option}` |" in page
    for grammar in GRAMMARS.values():
        assert f"## dtb {grammar.name}\n" in page
        assert all(f"| `{one.word}` " in page for one in grammar.settings.values())
    assert all(f"| `{name}` |" in page for name in KINDS)


def test_the_first_sentence_does_not_end_at_an_abbreviation() -> None:
    assert docs.first_sentence("# Control (Fig. 3 of it): e.g. no gap. More.\na: 1\n") == (
        "Control (Fig. 3 of it): e.g. no gap."
    )


def test_the_readme_names_every_command() -> None:
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    assert all(f"dtb {command}" in text for command in cli.COMMANDS)


def _commands(page: Path) -> list[str]:
    """Every command of a page that is an application, in a block or in a line."""
    text = page.read_text(encoding="utf-8")
    blocks = re.findall(r"```sh\n(.*?)```", text, flags=re.DOTALL)
    lines = [line.split(" #")[0].strip() for b in blocks for line in b.replace("\\\n", " ").splitlines()]
    inline = [code for code in re.findall(r"`(dtb [^`]+)`", text) if not re.search("VALUE|FILE|FOLDER|<", code)]
    found = [line for line in [*lines, *inline] if line.startswith("dtb ") and line.split()[1:2]]
    return [line for line in found if line.split()[1] in GRAMMARS and "..." not in line]


COMMANDS = sorted({command for page in PAGES for command in _commands(page)})


@pytest.mark.check
def test_commands_in_the_docs_are_accepted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    rig = ROOT / "dtbacklash" / "conf" / "rig" / "lead_screw.yaml"
    (tmp_path / "found").mkdir()
    for name in ("my_rig.yaml", "mine.yaml", "arm.yaml", "stage.yaml", "found/rig.yaml"):
        (tmp_path / name).write_text(rig.read_text(encoding="utf-8"), encoding="utf-8")
    (tmp_path / "next").mkdir()
    for name in ("next/command.csv", "second.csv"):
        (tmp_path / name).write_text("t,u\n0,0\n200,1\n", encoding="utf-8")
    (tmp_path / "gap.csv").write_text("t_s,gap_deg\n0,0\n200,50\n", encoding="utf-8")
    assert len(COMMANDS) > 20
    refused = {command: error for command in COMMANDS if (error := _refusal(command))}
    assert not refused, refused


def _refusal(command: str) -> str:
    """Why a command is not accepted, or nothing."""
    grammar, words = GRAMMARS[shlex.split(command)[1]], shlex.split(command)[2:]
    if unknown := {w for w in words if w.startswith("-")} - {"-m", "-v", "--help", "--cfg", *grammar.flags}:
        return f"unknown options {unknown}"
    plain = [w for w in words if not w.startswith(("-", "hydra.", "hydra/", "out=")) and w not in ("job",)]
    plain += [w for w in words if w in grammar.flags]
    try:
        for row in _jobs(plain) if "-m" in words else filter(None, [plain]):
            alone = any("=" not in word for word in row)  # the folder of a diagnosis
            compose_for(grammar, grammar.schema, *(find(grammar.name).complete(list(row)) if alone else row))
    except Exception as error:  # all are gathered
        return repr(error)
    return ""


def _jobs(words: list[str]) -> list[tuple[str, ...]]:
    """Jobs of a sweep in which each value of each word stands once at least: as many as the longest word has values."""
    swept = [
        [f"{key}{equals}{v}" for v in values.split(",")] for key, equals, values in (w.partition("=") for w in words)
    ]
    return [tuple(values[i % len(values)] for values in swept) for i in range(max(map(len, swept), default=0))]


def test_commands_of_the_twin_in_the_docs_are_accepted() -> None:
    found = 0
    for page in PAGES:
        blocks = re.findall(r"```sh\n(.*?)```", page.read_text(encoding="utf-8"), flags=re.DOTALL)
        inline = re.findall(r"`(dtb twin [^`]+)`", page.read_text(encoding="utf-8"))
        for line in [*(line for block in blocks for line in block.splitlines()), *inline]:
            words = line.split(" #")[0].split()
            if words[:2] != ["dtb", "twin"] or "=N" in line:
                continue
            part = PARTS[words[2]]
            if part.schema is None:
                compose_for(RUN, RUN.schema, *(w for w in words[3:] if "my_rig" not in w))
            else:
                read(part.schema, words[3:])
            found += 1
    assert found > 5


def test_every_library_is_accounted_for() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    needed = [*project["dependencies"], *(d for extra in project["optional-dependencies"].values() for d in extra)]
    page = (ROOT / "docs" / "libraries.md").read_text(encoding="utf-8")
    listed = {
        name.strip() for line in page.splitlines() if line.startswith("| ") for name in table_cells(line)[0].split(",")
    }
    assert {re.split(r"[<>=!~\[ ]", need)[0] for need in needed} == listed - {"library", "---"}


def _anchors(file: Path) -> set[str]:
    heads = re.findall(r"^#+ (.*)$", file.read_text(encoding="utf-8"), flags=re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", head.lower()).replace(" ", "-") for head in heads}


def _leads_nowhere(page: Path, target: str) -> bool:
    path, _, anchor = target.partition("#")
    file = (page.parent / path).resolve() if path else page
    return not file.is_file() or bool(anchor and anchor not in _anchors(file))


def test_links_lead_somewhere() -> None:
    links = [(page, target) for page in PAGES for target in LINK.findall(page.read_text(encoding="utf-8"))]
    assert len(links) > 100
    inside = [(page, target) for page, target in links if not target.startswith("https://")]
    assert [(page.name, target) for page, target in inside if _leads_nowhere(page, target)] == []


def test_images_are_small_and_all_shown() -> None:
    shown = {
        (page.parent / target).resolve()
        for page in PAGES
        for target in LINK.findall(page.read_text(encoding="utf-8"))
        if target.endswith(".png")
    }
    assert shown == set(IMAGES)
    assert max(image.stat().st_size for image in IMAGES) < 200_000


def test_the_proofs_named_in_the_claims_exist() -> None:
    named = re.findall(r"`(tests/[\w/.]+)`", (ROOT / "CLAIMS.md").read_text(encoding="utf-8"))
    assert len(named) > 10
    assert [name for name in named if not (ROOT / name).exists()] == []


def test_only_the_projects_own_words() -> None:
    found = {page.name: FORBIDDEN.search(page.read_text(encoding="utf-8")) for page in PAGES}
    assert {name: match.group() for name, match in found.items() if match} == {}


def test_the_forbidden_words_are_found() -> None:
    assert FORBIDDEN.search("see /tmp/x")
    assert FORBIDDEN.search("as in issue 12")
    assert not FORBIDDEN.search("an issue of wear; `~/.cache/dtbacklash`; a/work/b")
