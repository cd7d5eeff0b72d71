import runpy
from pathlib import Path

from dpr_lab.effects import EFFECTS

DOCS = Path(__file__).parents[1] / "docs"


def test_the_page_of_effects_agrees_with_the_library():
    page = runpy.run_path(str(DOCS / "effects.py"))["page"]()
    assert (DOCS / "effects.md").read_text(encoding="utf-8") == page
    assert all(f": `{name}`\n" in page for name in EFFECTS)
