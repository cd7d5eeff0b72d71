import base64
from html.parser import HTMLParser

import pytest

from dpr_lab.report.figures import save_figures
from dpr_lab.report.html import write_report
from tests.blank_figures import save_blank

VOID = {"meta", "link", "img", "br", "hr"}


class Page(HTMLParser):
    """Parser that collects text, attributes and headings as in a browser; every element must be closed in order."""

    def __init__(self, source: str) -> None:
        super().__init__()
        self.text, self.elements, self._open = "", [], []
        self.feed(source)
        self.close()
        assert not self._open

    def handle_starttag(self, tag, attrs):
        self.elements.append((tag, dict(attrs)))
        if tag not in VOID:
            self._open.append(tag)

    def handle_endtag(self, tag):
        assert self._open.pop() == tag

    def handle_data(self, data):
        self.text += data

    def all(self, tag):
        return [attributes for name, attributes in self.elements if name == tag]


def written(model, comparisons, folder):
    figures = save_figures(model, comparisons, folder)
    return write_report(model, comparisons, folder, figures).read_text(encoding="utf-8")


@pytest.fixture
def report(model, tmp_path, monkeypatch):
    """Function that writes a report with blank pictures."""
    monkeypatch.setattr("dpr_lab.report.figures.save_png", save_blank)

    def write(comparisons=(), **changes):
        source = written(model(**changes), list(comparisons), tmp_path)
        return source, Page(source)

    return write


@pytest.fixture(scope="module")
def one(model, comparison, tmp_path_factory):
    """The report of one comparison: source, page, folder."""
    folder = tmp_path_factory.mktemp("one")
    source = written(model(), [comparison()], folder)
    return source, Page(source), folder


@pytest.mark.parametrize("runs", [1, 6])
def test_the_report_is_well_formed_and_complete(runs, report, comparison):
    source, page = report([comparison(f"run number {i}", held_out=i > 3) for i in range(runs)])

    assert source.startswith("<!DOCTYPE html>")
    assert "$" not in source
    for name in ("a/b", "d/b", "e1/b", "c1/b", "c2/b", "10.246 ± 0.010", "l1", "J2", "first.mcap", "cd" * 32, "48210"):
        assert name in page.text
    assert all(f"run number {i}" in page.text for i in range(runs))
    assert "The residual is at the noise floor" in page.text
    assert "c2 lies at its lower bound" in page.text
    assert [tag for tag, _ in page.elements if tag in ("h1", "h2")] == ["h1"] + ["h2"] * 7


@pytest.mark.slow
def test_the_report_fetches_nothing(one):
    source, page, _ = one

    assert "http://" not in source
    assert "https://" not in source
    assert "url(" not in source
    assert "@import" not in source
    assert not page.all("script")
    fetched = [value for _, each in page.elements for key, value in each.items() if key in ("src", "href", "srcset")]
    assert len(fetched) == 4
    assert all(value.startswith("data:") for value in fetched)


@pytest.mark.slow
def test_pictures_are_inside_and_described(one):
    _, page, folder = one

    pictures = page.all("img")
    inside = [base64.b64decode(picture["src"].removeprefix("data:image/png;base64,")) for picture in pictures]
    assert inside == [(folder / f"{name}.png").read_bytes() for name in ("response", "error", "evolution")]
    assert all(len(picture["alt"]) > 40 for picture in pictures)


@pytest.mark.parametrize("empty", ["runs", "warnings"])
def test_a_report_without_comparisons_runs_or_warnings(empty, report):
    _, page = report([], **{empty: []})

    assert "No run was compared." in page.text
    assert len(page.all("img")) == 1
    assert ("Warnings" in page.text) == (empty != "warnings")


def test_text_from_files_cannot_become_markup(report, model, comparison):
    bad = '<script>alert("1")</script> & $title \udcff'
    whole = model()
    source, page = report(
        [comparison(bad, pose="<b>X1</b>")],
        rig=whole.rig.model_copy(update={"name": bad}),
        runs=[whole.runs[0].model_copy(update={"file": bad, "sha256": '"><img src=x>'})],
        search=whole.search.model_copy(update={"algorithm": "<i>"}),
        warnings=["<img src=x onerror=alert(1)>"],
        version="</html>",
    )

    assert not page.all("script")
    assert not page.all("b")
    assert len(page.all("img")) == 3
    assert source.count("</html>") == 1
    assert page.text.count('<script>alert("1")</script> & $title \\udcff') >= 3


def test_failed_checks_come_first(report):
    _, page = report(failures=["the fit did not converge"])

    assert "Not reliable: the fit did not converge." in page.text
    assert page.text.index("Not reliable") < page.text.index("Identified ratios")
