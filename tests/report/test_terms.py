from inspect import getclosurevars
from pathlib import Path

from dpr_lab.report import tables
from dpr_lab.report.gap import check_tables
from dpr_lab.report.gap import tables as gap_tables
from dpr_lab.report.pages.page import PageTable, Section, page_html
from dpr_lab.report.pages.terms import TERMS


def test_every_explained_term_is_a_column() -> None:
    columns = {
        column
        for module in (tables, gap_tables, check_tables)
        for name, table in vars(module).items()
        if name.endswith("_table") and name not in ("page_table", "open_table")
        for column in getclosurevars(table).nonlocals["columns"]
    }
    sections = {"confidence"}
    assert set(TERMS) <= columns | sections


def test_the_page_explains_the_terms_that_it_uses() -> None:
    page = page_html("Title", "Summary.", [Section("PageTable", [PageTable(("probability", "other"), [("1 %", "2")])])])
    assert f'<abbr title="{TERMS["probability"]}">probability</abbr>' in page
    assert page.count(TERMS["probability"]) == 2  # header and list of terms
    assert TERMS["confidence"] not in page


def test_the_page_explains_no_term_of_an_empty_table() -> None:
    page = page_html("Title", "Summary.", [Section("Text", ["Sentence.", PageTable(("probability",), [])])])
    assert TERMS["probability"] not in page


def test_a_section_without_content_is_left_out() -> None:
    assert "Empty" not in page_html("Title", "Summary.", [Section("Empty", [PageTable(("a",), []), None, ""])])


def test_text_is_escaped_and_control_characters_are_spelled_out(tmp_path: Path) -> None:
    page = page_html("a < b", "x\x1b[0m & y", [Section("<i>", ["<script>"])])
    assert "<script>" not in page
    assert "<i>" not in page
    assert "x\\x1b[0m &amp; y" in page
