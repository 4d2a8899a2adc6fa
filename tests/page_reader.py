"""Reads the pages that the reports write, and tables in Markdown."""

import re
from html.parser import HTMLParser


class Reader(HTMLParser):
    """Collects the text, every address that a browser would fetch, links within the page and what they may lead to;
    checks that tags are closed."""

    VOID = frozenset({"meta", "img", "br", "link", "input", "source"})

    def __init__(self):
        super().__init__()
        self.text, self.addresses, self.open = [], [], []
        self.anchors, self.ids = [], []

    def handle_starttag(self, tag, attrs):
        given = [value for name, value in attrs if name in ("src", "href")]
        self.addresses += [value for value in given if not value.startswith("#")]
        self.anchors += [value[1:] for value in given if value.startswith("#")]
        self.ids += [value for name, value in attrs if name == "id"]
        if tag not in self.VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.text.append(data)


def table_cells(line):
    """The cells of one line of a table in Markdown, without the ticks of code."""
    return [cell.strip().strip("`") for cell in re.split(r"(?<!\\)\|", line)[1:-1]]
