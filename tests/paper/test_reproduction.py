import csv
import json
import re
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from dpr_lab.cli.app import app
from dpr_lab.paper.campaign import TRUTHS, SearchCase, SearchResult, run_search, run_searches, search_cases
from dpr_lab.paper.printed import BEST_H, TRUE
from dpr_lab.paper.results import Reproduction, record, reproduce, save
from dpr_lab.paper.swings import READINGS, TERMS
from dpr_lab.paper.tables import verdicts
from dpr_lab.rig import Rig
from dpr_lab.search.settings import IgaSettings

SHORT = IgaSettings(generations=2, population=20)


@pytest.fixture(scope="module")
def result(paper: Rig) -> Reproduction:
    return reproduce(paper, SHORT, seeds=1)


def test_off_the_grid_the_truth_is_inside_the_bounds_and_on_no_grid_point(paper: Rig):
    lower, upper = paper.bounds
    assert ((lower < TRUTHS["off"]) & (TRUTHS["off"] < upper)).all()
    steps = 10 * (TRUTHS["off"] - lower) / (upper - lower)
    assert (np.abs(steps - np.round(steps)) > 0.01).all()
    middle = 10 * (TRUTHS["on"] - lower) / (upper - lower)
    np.testing.assert_allclose(middle, 5.0)


def test_every_reading_grid_and_seed_is_searched_once(paper: Rig, result: Reproduction):
    assert [outcome.case for outcome in result.results] == search_cases(1, tuple(READINGS))
    assert len(set(search_cases(5, tuple(READINGS)))) == 5 * len(READINGS) * len(TRUTHS)
    for outcome in result.results:
        assert outcome.generations == SHORT.generations
        assert outcome.H == outcome.history["best_cost"][-1]
        assert ((paper.bounds[0] <= outcome.best) & (outcome.best <= paper.bounds[1])).all()


def test_same_seed_same_answer_another_seed_another(paper: Rig, result: Reproduction):
    first = result.results[0]
    again = run_search(first.case, paper, SHORT)
    assert np.array_equal(again.best, first.best)
    assert again.history == first.history
    assert not np.array_equal(run_search(SearchCase("sum", "on", 1), paper, SHORT).best, first.best)


@pytest.mark.long
def test_processes_change_nothing(paper: Rig, result: Reproduction):
    side_by_side = {
        outcome.case: outcome for outcome in run_searches(search_cases(1, tuple(READINGS)), paper, SHORT, workers=2)
    }
    for outcome in result.results:
        assert side_by_side[outcome.case].history == outcome.history


def test_percent_errors_are_against_the_truth_of_the_grid(paper: Rig):
    Z = TRUTHS["off"] * 1.01
    outcome = SearchResult(SearchCase("X1", "off", 0), Z, 0.0, {}, 0, 0, None, 0.0, 0.0, {})
    np.testing.assert_allclose(outcome.percent, 1.0)
    l2, m2, c1, J2 = TRUTHS["off"][[1, 3, 5, 8]]
    b, b_found = J2 + m2 * l2**2, 1.01 * J2 + 1.01**3 * m2 * l2**2
    np.testing.assert_allclose(outcome.ratio_percent(paper)[3], 100 * ((1.01 * c1 / b_found) / (c1 / b) - 1))


def test_verdicts_count_what_was_reached(paper: Rig):
    E = {term: np.zeros(3) for term in TERMS}
    good = SearchResult(SearchCase("X1", "on", 0), TRUE, BEST_H, E, 1, 1, None, 0.0, 0.0, {})
    bad = SearchResult(SearchCase("X1", "on", 1), TRUE * 1.02, BEST_H + 1e-6, E, 1, 1, None, 0.0, 0.0, {})
    (sentence,) = verdicts([good, bad], paper)
    assert "reached in 1 of 2 seeds" in sentence
    assert "within 1 % in 1 of 2" in sentence


def test_each_contradiction_in_the_json_is_listed_in_the_theory(paper: Rig, result: Reproduction):
    theory = (Path(__file__).parents[2] / "docs" / "theory.md").read_text(encoding="utf-8")
    points = re.findall("^- ", theory.split("contradict each other")[1].split("## 3.")[0], re.MULTILINE)
    entries = record(result, paper)["contradictions"]
    assert len(entries) == len(points) == 7
    assert {"claim", "evidence"} == set(entries[0])


@pytest.mark.slow
def test_the_folder_holds_page_json_tables_and_figures(tmp_path: Path, paper: Rig, result: Reproduction):
    page = save(result, paper, tmp_path)
    text = page.read_text(encoding="utf-8")
    for table in result.tables:
        with (tmp_path / f"{table.name}.csv").open(encoding="utf-8") as file:
            assert [tuple(row) for row in csv.reader(file)] == [table.columns, *table.rows]
        assert table.title in text
    for name in ("figure2.png", "figure3.png", "figure4.png"):
        assert (tmp_path / name).read_bytes().startswith(b"\x89PNG")
        assert f"({name})" in text
    kept = json.loads((tmp_path / "paper.json").read_text(encoding="utf-8"))
    assert kept == json.loads(json.dumps(record(result, paper)))
    assert np.shape(kept["table3_E"]["angles"]) == (10, 3)
    assert [len(kept["searches"][0][key]) for key in ("best", "percent", "ratio_percent")] == [9, 9, 5]


@pytest.mark.long
def test_the_command_prints_one_json_object(tmp_path: Path):
    done = CliRunner().invoke(
        app,
        ["paper", "--quick", "--seeds", "1", "--generations", "1", "--workers", "1", "--json", "--out", f"{tmp_path}"],
    )
    assert done.exit_code == 0, done.output
    document = json.loads(done.stdout)
    assert document["settings"]["generations"] == 1
    assert document["settings"]["population"] == 200
    assert len(document["searches"]) == len(READINGS) * len(TRUTHS)
    assert Path(document["page"]).is_file()


@pytest.mark.parametrize("wrong", [{"seeds": 0}, {"readings": ()}, {"readings": ("median",)}])
def test_a_wrong_request_is_refused(paper: Rig, wrong: dict):
    with pytest.raises(ValueError, match="at least one seed"):
        reproduce(paper, SHORT, **wrong)
