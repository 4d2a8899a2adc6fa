"""The docs as a site: it builds strictly, holds every page, and fetches nothing from elsewhere."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip("material", reason="the extra `docs`")
ROOT = Path(__file__).resolve().parents[3]
#: what a browser fetches by itself; a link that a reader may follow is none
FETCHED = re.compile(r'<(?:script|img|iframe|link)\b[^>]*\b(?:src|href)="(?:https?:)?//[^"]*"')


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The site that `make site` has built since the pages changed; else built here."""
    built = ROOT / "build" / "site"
    pages = [ROOT / "mkdocs.yml", *ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.*")]
    if (built / "index.html").is_file() and (built / "index.html").stat().st_mtime > max(
        p.stat().st_mtime for p in pages
    ):
        return built
    folder = tmp_path_factory.mktemp("site")
    words = [sys.executable, "-m", "mkdocs", "build", "--strict", "--site-dir", str(folder)]
    environment = os.environ | {"NO_MKDOCS_2_WARNING": "1"}
    done = subprocess.run(words, cwd=ROOT, env=environment, capture_output=True, text=True, check=False, timeout=120)
    assert done.returncode == 0, done.stdout + done.stderr
    return folder


@pytest.mark.check
def test_every_page_of_the_docs_and_of_the_root_is_there(site: Path) -> None:
    pages = {path.stem for path in (ROOT / "docs").glob("*.md")} | {"claims", "known_gaps", "changelog"}
    assert pages <= {path.stem for path in site.glob("*.html")}


@pytest.mark.check
def test_the_three_doors_lead_somewhere(site: Path) -> None:
    start = (site / "index.html").read_text(encoding="utf-8")
    for door in ("reproduce", "machine", "controller"):
        assert f'href="{door}.html"' in start
        assert (site / f"{door}.html").is_file()


@pytest.mark.check
def test_nothing_is_fetched_from_elsewhere(site: Path) -> None:
    found = {page.name: FETCHED.findall(page.read_text(encoding="utf-8")) for page in site.rglob("*.html")}
    assert {name: there for name, there in found.items() if there} == {}
    outside = re.compile(r"""url\(["']?https?:""")
    styles = [path for path in site.rglob("*.css") if outside.search(path.read_text(encoding="utf-8"))]
    assert styles == []


@pytest.mark.check
def test_what_is_fetched_is_found() -> None:
    assert FETCHED.search('<script src="https://unpkg.com/x"></script>')
    assert FETCHED.search('<link rel="stylesheet" href="//fonts.example/x.css">')
    assert not FETCHED.search('<a href="https://example.org">there</a><img src="images/x.png">')


@pytest.mark.check
def test_pages_at_the_root_lead_into_the_site(site: Path) -> None:
    claims = (site / "claims.html").read_text(encoding="utf-8")
    assert 'href="proof.html"' in claims
    assert "docs/proof.md" not in re.sub(r"<a[^>]*>docs/proof.md</a>", "", claims)
    assert 'href="known_gaps.html"' in (site / "diagnosis.html").read_text(encoding="utf-8")
