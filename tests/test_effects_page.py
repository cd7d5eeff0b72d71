import re
import runpy
from pathlib import Path

from dpr_lab.effects import EFFECTS

DOCS = Path(__file__).parents[1] / "docs"


def test_the_page_of_effects_agrees_with_the_library():
    page = runpy.run_path(str(DOCS / "effects.py"))["page"]()
    is_current = (DOCS / "effects.md").read_text(encoding="utf-8") == page
    assert is_current, "docs/effects.md is older than the library: run `python docs/effects.py`"
    headings = "\n".join(re.findall("^## .*", page, flags=re.MULTILINE))
    assert all(f"`{name}`" in headings for name in EFFECTS)
