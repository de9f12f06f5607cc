"""A real browser without a screen, for tests of pages; they skip where there is none."""

import html
import json
import re
import shutil
import subprocess

import pytest

CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser"))), None)
needs_browser = pytest.mark.skipif(
    CHROMIUM is None, reason="needs a browser: Debian's package chromium"
)

# Of a page in a frame: widths, and what lies beyond its right edge without a box that scrolls.
_MEASURE = """
const body = frame.contentDocument.body, root = frame.contentDocument.documentElement;
const boxes = [...body.querySelectorAll(".scroll")];
const boxed = e => boxes.some(box => box !== e && box.contains(e)) || e.closest("pre, svg, .tall");
return {
  width: root.scrollWidth,
  outside: [...body.querySelectorAll("*")]
    .filter(e => !boxed(e) && e.getBoundingClientRect().right > frame.clientWidth + 0.5)
    .map(e => e.outerHTML.slice(0, 80)),
  images: [...body.querySelectorAll("figure img")].map(e => e.getBoundingClientRect().width),
  scrolls: boxes.filter(box => box.scrollWidth > box.clientWidth + 1).length,
  hint: [...body.querySelectorAll(".hint")].some(e => e.offsetHeight > 0),
};
"""
_LUMINANCES = """
const luminance = colour => {
  const [r, g, b] = colour.match(/[0-9.]+/g).map(Number);
  return (0.2126 * r + 0.7152 * g + 0.0722 * b) / 255;
};
const style = getComputedStyle(document.body);
return {
  paper: luminance(style.backgroundColor),
  ink: luminance(style.color),
  open: document.querySelectorAll("details[open]").length,
};
"""


def browse(address, folder, *options):
    """Return what the browser prints about a page."""
    done = subprocess.run(
        [
            CHROMIUM,
            "--headless",
            "--no-sandbox",
            "--disable-gpu",
            f"--user-data-dir={folder / 'profile'}",
            *options,
            address.as_uri(),
        ],
        capture_output=True,
        text=True,
        timeout=120,
        check=True,
    )
    return done.stdout


def dump_dom(file, folder, *options):
    """Return the document of a page after its scripts have run."""
    return browse(file, folder, "--virtual-time-budget=3000", "--dump-dom", *options)


def measured(file, widths, folder):
    """Return measures of a page by width of its window [px]."""
    page = html.escape(file.read_text(), quote=True)
    frames = "".join(
        f'<iframe width="{width}" height="900" style="border:0" srcdoc="{page}"></iframe>'
        for width in widths
    )
    script = (
        "onload = () => { const found = [...document.querySelectorAll('iframe')].map(frame => {"
        f"{_MEASURE}"
        "}); document.body.textContent = JSON.stringify(found); };"
    )
    harness = folder / "harness.html"
    harness.write_text(f"<!doctype html><body>{frames}<script>{script}</script></body>")
    return dict(zip(widths, _result(dump_dom(harness, folder)), strict=True))


def luminances(file, folder, *options):
    """Return the luminances of paper and ink of a page, and how many details are open."""
    script = f"document.body.textContent = JSON.stringify((() => {{{_LUMINANCES}}})());"
    harness = folder / "luminances.html"
    harness.write_text(file.read_text().replace("</body>", f"<script>{script}</script></body>"))
    return _result(dump_dom(harness, folder, *options))


def printed_pages(file, folder):
    """Return the number of pages on paper."""
    paper = folder / "printed.pdf"
    browse(file, folder, f"--print-to-pdf={paper}")
    return len(re.findall(rb"/Type /Page\b(?!s)", paper.read_bytes()))


def _result(document):
    return json.loads(html.unescape(re.search(r"<body>(.*)</body>", document, re.DOTALL)[1]))
