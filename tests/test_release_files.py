"""Files for a release: workflows, recipe and paper agree with the project; nothing publishes with a stored token."""

import re
import tomllib
from pathlib import Path
from typing import Any

import pytest
import yaml

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]


def workflow(name: str) -> dict[Any, Any]:
    return yaml.safe_load((ROOT / ".github/workflows" / name).read_text(encoding="utf-8"))


def test_the_matrix_holds_every_python_that_the_project_names() -> None:
    matrix = workflow("ci.yml")["jobs"]["test"]["strategy"]["matrix"]
    named = re.findall(r"Python :: (3\.\d+)", "\n".join(PROJECT["classifiers"]))
    assert matrix["python"] == named
    assert [system.split("-")[0] for system in matrix["os"]] == ["ubuntu", "macos", "windows"]


@pytest.mark.parametrize("name", ["ci.yml", "publish.yml"])
def test_jobs_are_bounded_and_read_only(name: str) -> None:
    document = workflow(name)
    assert document["permissions"] == {"contents": "read"}
    assert all(job["timeout-minutes"] <= 120 for job in document["jobs"].values())
    assert "secrets." not in (ROOT / ".github/workflows" / name).read_text(encoding="utf-8")


@pytest.mark.parametrize("name", ["ci.yml", "publish.yml"])
def test_actions_are_pinned_by_commit_and_keep_no_credentials(name: str) -> None:
    uses = re.findall(r"uses: (.*)", (ROOT / ".github/workflows" / name).read_text(encoding="utf-8"))
    assert uses
    assert all(re.fullmatch(r"[\w./-]+@[0-9a-f]{40} # v\d+\.\d+\.\d+", use) for use in uses)
    steps = [step for job in workflow(name)["jobs"].values() for step in job["steps"]]
    checkouts = [step for step in steps if step.get("uses", "").startswith("actions/checkout@")]
    assert checkouts
    assert all(step["with"]["persist-credentials"] is False for step in checkouts)


def test_only_the_job_that_publishes_may_ask_for_an_identity() -> None:
    document = workflow("publish.yml")
    assert document[True]["push"] == {"tags": ["v*"]}  # YAML 1.1 reads the key `on` as true
    asked = {name: job.get("permissions") for name, job in document["jobs"].items()}
    assert asked == {"build": None, "publish": {"id-token": "write"}}


def test_commands_of_the_workflow_are_targets_of_make() -> None:
    targets = re.findall(r"^([\w-]+):", (ROOT / "Makefile").read_text(encoding="utf-8"), flags=re.MULTILINE)
    runs = [step.get("run", "") for job in workflow("ci.yml")["jobs"].values() for step in job["steps"]]
    made = [line.split()[1] for run in runs for line in run.splitlines() if line.startswith("make ")]
    assert made
    assert set(made) <= set(targets)


def test_the_recipe_needs_what_the_project_needs() -> None:
    text = (ROOT / "conda/meta.yaml").read_text(encoding="utf-8")
    run = text.partition("  run:\n")[2].partition("\ntest:")[0]
    needed = {
        line.strip().removeprefix("- ").replace("-base", "").replace(" ", "") for line in run.splitlines() if line
    }
    assert needed == {*PROJECT["dependencies"], f"python{PROJECT['requires-python']}"}


def test_every_reference_of_the_paper_is_cited_and_every_citation_is_there() -> None:
    cited = set(re.findall(r"@(\w+)", (ROOT / "paper.md").read_text(encoding="utf-8")))
    listed = set(re.findall(r"^@\w+\{(\w+),", (ROOT / "paper.bib").read_text(encoding="utf-8"), flags=re.MULTILINE))
    assert cited == listed


@pytest.mark.parametrize("form", ["bug", "diagnosis", "feature"])
def test_issue_forms_have_what_the_site_asks_for(form: str) -> None:
    document = yaml.safe_load((ROOT / f".github/ISSUE_TEMPLATE/{form}.yml").read_text(encoding="utf-8"))
    assert {"name", "description", "body"} <= set(document)
    ids = [field["id"] for field in document["body"]]
    assert len(set(ids)) == len(ids)
    assert all(field["attributes"]["label"] for field in document["body"])
