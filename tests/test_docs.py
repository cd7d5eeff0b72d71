"""Statements in the README and the pages are true: files, links, equations, tests; the site builds."""

import ast
import io
import re
import subprocess
import sys
from pathlib import Path

import pytest
from matplotlib.figure import Figure

from dpr_lab.certificate.document import load_certificate
from tests.pages import blocks

ROOT = Path(__file__).parents[1]
README = (ROOT / "README.md").read_text(encoding="utf-8")


@pytest.mark.long
@pytest.mark.timeout(600)
def test_the_site_builds_without_a_warning_or_a_network(tmp_path: Path) -> None:
    """The test below executes the notebooks, and `make docs` writes the pages with the theme of the site."""
    pytest.importorskip("sphinx")
    cheaper = ["-D", "nb_execution_mode=off", "-D", "html_theme=basic"]
    build = [sys.executable, "-m", "sphinx", "-W", "--keep-going", "-q", "-b", "html", *cheaper]
    done = subprocess.run([*build, str(ROOT / "docs"), "site"], cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    page = (tmp_path / "site" / "reference" / "command-line.html").read_text(encoding="utf-8")
    assert "dpr-lab trials draw" in page
    assert "dpr_lab.diagnose" in (tmp_path / "site" / "reference" / "python.html").read_text(encoding="utf-8")


@pytest.mark.long
@pytest.mark.parametrize("page", sorted((ROOT / "docs" / "notebooks").glob("*.md")), ids=lambda page: page.stem)
def test_every_cell_of_a_notebook_runs_and_its_result_is_shown(
    page: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    from IPython.core.interactiveshell import InteractiveShell  # only this long test needs it

    shell = InteractiveShell()
    code = [block.text for block in blocks(page) if block.language == "{code-cell} ipython3"]
    shown = list[str]()
    for cell in code:
        done = shell.run_cell(re.sub(r"^(:tags: .*|%matplotlib inline)$", "", cell, flags=re.MULTILINE))
        done.raise_error()
        if isinstance(done.result, Figure):
            done.result.savefig(io.BytesIO())
        elif done.result is not None:
            shown.append(done.result._repr_html_() if hasattr(done.result, "_repr_html_") else repr(done.result))
    assert len(code) >= 8
    assert any("coulomb_" in text for text in shown), shown


def test_every_file_the_readme_names_exists() -> None:
    for target in re.findall(r"\]\((?!https?:|#)([^)#]+)\)", README):
        assert (ROOT / target).exists(), target


def test_the_readme_states_the_measured_reliability() -> None:
    def pages(pattern: str, name: str) -> list[tuple[str, ...]]:
        text = (ROOT / "docs" / f"{name}.md").read_text(encoding="utf-8")
        return [match.groups() for match in re.finditer(pattern, text, flags=re.MULTILINE)]

    part = README[README.index("| recordings | outcome | result |") : README.index("On simulated rigs with one effect")]
    stated = re.findall(r"^\| [a-z].* \| (\d.*) \|$", part, flags=re.MULTILINE)
    kinds = (
        "simulated rig with one effect: first|clean simulated rig: false|clean simulated rig with faulty encoders: "
        r"|many effects \(background\): largest|the same: effect that was drawn"
    )
    simulated = pages(rf"^\| (?:{kinds})[^|]+ \| [^|]+ \| (\d+ of \d+)[^|]* \|", "benchmarks")
    sets = pages(r"^\| (?:all|\d\d[:,].*?)" + r" \| (\d+)" * 7 + r" \|$", "benchmarks/unseen-rigs")
    *sums, (total, correct, honest, partly, wrong, refused, incorrect) = sets
    assert [sum(map(int, column)) for column in zip(*sums, strict=True)] == [*map(int, sets[-1])]
    outcomes = "correct: |honest: |partly correct|wrong, |not diagnosed: |incorrect causes with a prob"
    real = pages(rf"^\| (?:{outcomes})[^|]*\| (\d+) (?:of|in) {total} \| [^|]+\|$", "benchmarks")
    assert [count for (count,) in real] == [correct, honest, partly, wrong, refused, incorrect]
    verdicts = pages(r"\| (?:partly explained|unexplained) \| (\d+) % \|", "real-rigs")
    ((median,), (worst,)) = pages(r"^\| \*\*(?:median|worst)\*\* \|  \|  \| (\d+) %", "real-rigs")
    best = max(int(gap) for (gap,) in verdicts)
    assert stated == [
        *(share for (share,) in simulated),
        f"{correct} of {total}",
        f"{honest} of {total}",
        f"{partly}, {wrong} and {refused} of {total}",
        f"{incorrect} on {total} rigs",
        f"{median} % ({worst} to {best} %)",
        f"0 of {len(verdicts)}",
    ]
    assert f"{len(verdicts)} held-out recordings" in part
    assert f"In all {len(verdicts)} published recordings a remainder" in README
    first = f"({simulated[0][0]})"
    assert first in README
    assert first in (ROOT / "docs" / "package.md").read_text(encoding="utf-8")
    index = (ROOT / "docs" / "index.md").read_text(encoding="utf-8")
    assert all(share in index for share in (simulated[0][0], simulated[3][0], f"{correct} of {total}"))
    limits = (ROOT / "docs" / "limits.md").read_text(encoding="utf-8")
    assert f"{incorrect} cases in {total}" in re.sub(r"\s+", " ", limits)


def test_the_worked_example_states_the_claims_of_its_certificate() -> None:
    page = (ROOT / "docs" / "worked-example.md").read_text(encoding="utf-8")
    claims = load_certificate(ROOT / "docs" / "examples" / "multiarm" / "certificate.json").claims
    for name in ("verdict", "share of the gap closed", "a/b", "d/b", "e1/b"):
        match = re.search(rf"\| {name} \| (\S+) \|", page)
        assert match is not None
        value = claims[name].value
        assert match[1] == value if isinstance(value, str) else float(match[1]) == pytest.approx(value, rel=1e-3)
    effects = {
        "Free-form friction curve, joint 2": "friction_curve_joint2",
        "Coulomb friction, joint 1": "coulomb_joint1",
        "Air drag": "air_drag_both",
        "Encoder eccentricity, joint 1": "encoder_eccentricity_joint1",
    }
    for words, effect in effects.items():
        assert f"- **{words} ({100 * claims[f'{effect}: probability'].value:.0f} %)" in page, effect
    amplitudes = {
        "free-form friction curve, joint 2: backward": ("friction_curve_joint2: backward_Nm", 1e3),
        "air drag, all rods": ("air_drag_both: coefficient_kg_per_m2", 1.0),
    }
    for words, (name, per_unit) in amplitudes.items():
        row = re.search(rf"\| {words} \| (\S+) [^|]+ \| (\S+) ", page)
        assert row is not None
        ratio = next(claim for key, claim in claims.items() if key.startswith(f"{name} / b"))
        assert ratio.interval90 is not None
        value = float(claims[name].value)
        tolerance = 0.1 * (ratio.interval90[1] - ratio.interval90[0]) * value / float(ratio.value)
        assert [float(row[1]), float(row[2])] == pytest.approx([per_unit * value, per_unit * tolerance], rel=0.02), name


def test_every_property_has_its_test() -> None:
    page = (ROOT / "docs" / "reference" / "properties.md").read_text(encoding="utf-8")
    promised = re.findall(r"\| `(test_\w+)` \| `([^`]+)` \|", page)
    assert len(promised) >= 20
    for name, file in promised:
        functions = ast.walk(ast.parse((ROOT / file).read_text(encoding="utf-8")))
        (test,) = (
            function for function in functions if isinstance(function, ast.FunctionDef) and function.name == name
        )
        assert "pytest.mark.long" not in map(ast.unparse, test.decorator_list), f"make test leaves out {name}"


def test_every_make_target_the_readme_names_exists() -> None:
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    for target in re.findall(r"`make (\w+)`", README) + re.findall(r"^make (\w+)", README, flags=re.MULTILINE):
        assert re.search(rf"^{target}:", makefile, flags=re.MULTILINE), target


THEORY = (ROOT / "docs" / "theory.md").read_text(encoding="utf-8")
PAGES = ("README.md", "CONTRIBUTING.md", *(f"docs/{path.name}" for path in (ROOT / "docs").glob("*.md")))


def numbered() -> list[int]:
    """Numbers at the ends of lines in the code blocks of the theory."""
    formulas = re.findall(r"```\n(.*?)```", THEORY, flags=re.DOTALL)
    return [int(n) for block in formulas for n in re.findall(r" \((\d+)\)$", block, flags=re.MULTILINE)]


def placed() -> dict[int, list[str]]:
    """Files that the table in the theory names for each equation."""
    result = {}
    for numbers, files in re.findall(r"^\| ([\d, -]+) \| (`.+`) \|$", THEORY, flags=re.MULTILINE):
        for first, last in re.findall(r"(\d+)(?:-(\d+))?", numbers):
            result |= dict.fromkeys(range(int(first), int(last or first) + 1), re.findall(r"`([^`]+)`", files))
    return result


def test_equations_are_numbered_once_and_each_has_a_place() -> None:
    assert numbered() == list(range(1, len(numbered()) + 1))
    assert list(placed()) == numbered()


@pytest.mark.parametrize("file", sorted({file for files in placed().values() for file in files}))
def test_the_file_of_an_equation_exists(file: str) -> None:
    assert (ROOT / file).is_file()


def test_an_equation_that_code_cites_exists() -> None:
    cited = re.compile(r"docs/theory\.md,? (?:equations? )?\(?(\d+)(?:-(\d+))?\)?")
    for folder in ("dpr_lab", "sim_device", "firmware_protocol", "tests", "benchmarks", "configs"):
        for path in (path for path in (ROOT / folder).rglob("*") if path.suffix in (".py", ".toml")):
            for numbers in cited.findall(path.read_text(encoding="utf-8")):
                assert {int(n) for n in numbers if n} <= set(numbered()), f"{path}: equation {numbers}"


def test_links_to_other_sites_are_whole() -> None:
    for page in (*PAGES, *ROOT.glob("docs/*/*.md"), "CITATION.cff", "pyproject.toml"):
        text = (ROOT / page).read_text(encoding="utf-8")
        for link in re.findall(r"\bhttps?:[^\s`\"')>\]]*", text):
            if not link.startswith("http://127.0.0.1"):
                assert re.fullmatch(r"https://[a-z0-9-]+(\.[a-z0-9-]+)+(/[\w./%#?=~-]*)?", link.rstrip(".,;")), (
                    f"{page}: {link}"
                )


def test_the_published_search_is_cited_in_the_same_way_everywhere() -> None:
    (doi,) = re.findall(r"doi:(\S+[^.\s])", THEORY)
    assert f"doi: {doi}\n" in (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    assert f'"https://doi.org/{doi}"' in (ROOT / "pyproject.toml").read_text(encoding="utf-8")


@pytest.mark.parametrize("page", PAGES)
def test_every_file_a_page_links_to_exists(page: str) -> None:
    text = (ROOT / page).read_text(encoding="utf-8")
    for target in re.findall(r"\]\((?!https?:|#)([^)#]+)[^)]*\)", text):
        assert ((ROOT / page).parent / target).exists(), target


def test_every_file_named_in_contributing_exists() -> None:
    text = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
    for target in re.findall(r"`(?:python )?((?:dpr_lab|sim_device|tests|docs|benchmarks|configs)/[\w./-]+)", text):
        assert "NAME" in target or (ROOT / target).exists(), target
