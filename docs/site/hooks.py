"""Hooks of the site: the pages at the repository's root become pages of the site, and links to them lead there.

On the repository's own pages `../KNOWN_GAPS.md` and `docs/paper.md` are right; in the site, whose root is `docs/`, the
first is `known_gaps.md` and the second `paper.md`. The text is otherwise the same.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from mkdocs.config.defaults import MkDocsConfig
    from mkdocs.structure.files import Files
    from mkdocs.structure.pages import Page

#: page of the repository -> page of the site; the README has its own place in each
PAGES = {
    "CLAIMS.md": "claims.md",
    "KNOWN_GAPS.md": "known_gaps.md",
    "CHANGELOG.md": "changelog.md",
    "README.md": "index.md",
}
LINK = re.compile(r"(\]\()([^)\s]+)(\))")


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the pages at the root."""
    from mkdocs.structure.files import File

    root = Path(config.config_file_path).parent
    for source, name in PAGES.items():
        if name != "index.md":
            text = (root / source).read_text(encoding="utf-8")
            files.append(File.generated(config, name, content=LINK.sub(_from_root, text)))
    return files


def on_page_markdown(markdown: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Let links of `docs/` to the root lead to the pages made of it."""
    return LINK.sub(_from_docs, markdown)


def _from_root(found: re.Match[str]) -> str:
    """A link of a page at the root, as seen from the site's root."""
    path, mark, anchor = found[2].partition("#")
    return found[1] + PAGES.get(path, path.removeprefix("docs/")) + mark + anchor + found[3]


def _from_docs(found: re.Match[str]) -> str:
    """A link of a page of `docs/`."""
    path, mark, anchor = found[2].partition("#")
    if not path.startswith("../"):
        return found[0]
    return found[1] + PAGES.get(path.removeprefix("../"), path) + mark + anchor + found[3]
