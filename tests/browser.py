"""Looks at pages in a real browser: headless Chromium, several widths at once."""

import html
import json
import os
import re
import shutil
import subprocess

import pytest

#: a phone, a notebook, a large screen: px
WIDTHS = (390, 1280, 1920)
HEIGHT = 800

MEASURE = """
function texts(doc) {
  const walker = doc.createTreeWalker(doc.body, NodeFilter.SHOW_TEXT), found = [];
  for (let node; (node = walker.nextNode()); ) {
    if (!node.textContent.trim() || !node.parentElement.checkVisibility()) continue;
    const range = doc.createRange();
    range.selectNodeContents(node);
    for (const r of range.getClientRects()) if (r.width > 1 && r.height > 1) found.push({r, node});
  }
  return found;
}
function overlaps(doc) {
  const all = texts(doc).sort((a, b) => a.r.top - b.r.top), found = [];
  all.forEach((a, i) => {
    for (let j = i + 1; j < all.length && all[j].r.top < a.r.bottom - 3; j++) {
      const b = all[j];
      if (a.node !== b.node && Math.min(a.r.right, b.r.right) - Math.max(a.r.left, b.r.left) > 2)
        found.push(a.node.textContent.trim().slice(0, 40) + " | " + b.node.textContent.trim().slice(0, 40));
    }
  });
  return found;
}
function wider(doc, width) {
  return [...doc.body.querySelectorAll("*")].filter(e => {
    const r = e.getBoundingClientRect();
    for (let box = e.parentElement; box; box = box.parentElement)
      if (getComputedStyle(box).overflowX === "auto") return false;  // it scrolls within the page
    return e.checkVisibility() && r.width > 0 && (r.right > width + 1 || r.left < -1);
  }).map(e => e.tagName + " " + e.textContent.trim().slice(0, 40));
}
window.onload = () => {
  const out = {};
  for (const frame of document.querySelectorAll("iframe")) {
    const doc = frame.contentDocument, width = frame.clientWidth, row = {};
    for (const state of ["folded", "open"]) {
      if (state === "open") doc.querySelectorAll("details").forEach(d => { d.open = true; });
      row[state] = {wider: wider(doc, width), overlaps: overlaps(doc), scroll: doc.documentElement.scrollWidth};
      if (state === "folded") {
        const fold = doc.querySelector("details");
        row.folds_at = fold ? fold.getBoundingClientRect().top : 0;
        row.text = doc.body.innerText;
      }
    }
    out[frame.id] = row;
  }
  document.getElementById("out").textContent = JSON.stringify(out);
};
"""


def look(page, folder):
    """Width -> what is wider than the page or lies on other text, folded and open, and where the first fold is, px.

    Skipped where there is no Chromium, except in CI, which installs it.
    """
    program = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
    if program is None:
        assert not os.environ.get("CI"), "CI has no Chromium: see .ci/run"
        pytest.skip("needs Chromium")
    style, text = f"height:{HEIGHT}px;border:0", html.escape(page)
    frames = "".join(f'<iframe id="{w}" style="width:{w}px;{style}" srcdoc="{text}"></iframe>' for w in WIDTHS)
    harness = folder / "harness.html"
    text = f'<!DOCTYPE html><body>{frames}<pre id="out"></pre><script>{MEASURE}</script>'
    harness.write_text(text, encoding="utf-8")
    options = ["--headless", "--no-sandbox", "--disable-gpu", f"--user-data-dir={folder / 'profile'}"]
    command = [program, *options, "--window-size=2000,900", "--dump-dom", harness.as_uri()]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=True)
    measured = re.search(r'<pre id="out">(.+?)</pre>', done.stdout, re.DOTALL)
    assert measured, done.stderr[-2000:]
    return {int(width): row for width, row in json.loads(html.unescape(measured[1])).items()}
