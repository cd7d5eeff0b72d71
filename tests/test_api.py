"""What `import dpr_lab as dpr` offers, and how results show themselves."""

import inspect
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure

import dpr_lab as dpr
from dpr_lab.effects import EFFECTS
from dpr_lab.run import Run, as_runs

FRICTION = "coulomb_joint2"


def test_every_public_name_is_there_with_a_docstring() -> None:
    for name in dpr.__all__:
        assert getattr(dpr, name).__doc__, name
    assert set(dir(dpr)) == {"__doc__", "__version__", *dpr.__all__}
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        _ = dpr.nothing


def test_help_shows_the_fields_of_every_result() -> None:
    for shown in (dpr.Rig, dpr.Model, dpr.Diagnosis, dpr.Run, dpr.ImportOptions):
        assert "**data" not in str(inspect.signature(shown)), shown


def test_what_is_not_asked_for_is_not_imported() -> None:
    heavy = "import sys, dpr_lab; print([m for m in ('numpy', 'numba', 'matplotlib', 'scipy') if m in sys.modules])"
    assert subprocess.run([sys.executable, "-c", heavy], capture_output=True, text=True).stdout.strip() == "[]"


def test_the_checker_and_the_import_know_the_same_names() -> None:
    text = Path(dpr.__file__).read_text(encoding="utf-8")
    checked = text[text.index("if TYPE_CHECKING") : text.index("__all__ = ")]
    for name in dpr.__all__:
        assert f" {name}" in checked, name
    assert (Path(dpr.__file__).parent / "py.typed").exists()


@pytest.fixture(scope="module")
def runs(recorded: Callable[..., list[Run]]) -> list[Run]:
    return recorded({FRICTION: {"torque_Nm": 2e-3}}, duration=2.0)


@pytest.fixture(scope="module")
def results(runs: list[Run]):
    rig = dpr.load_rig("paper")
    model = dpr.identify(runs, rig, seed=0)
    return runs[0], model, dpr.compare(runs[0], rig, model)


@pytest.fixture(scope="module")
def found(runs: list[Run]) -> dpr.Diagnosis:
    return dpr.diagnose(runs, dpr.load_rig("paper"), library={FRICTION: EFFECTS[FRICTION]})


@pytest.mark.slow
def test_results_show_themselves_on_a_few_lines(results, found) -> None:
    rig = dpr.load_rig("paper")
    for result in (rig, dpr.identifiability([results[0]], rig), *results, found):
        assert str(result) == repr(result)
        told, page = repr(result), result._repr_html_()
        assert 1 <= len(told.splitlines()) < 25
        assert len(told) < 2000
        assert "array(" not in told
        assert page.startswith("<p>")
    assert "a/b" in repr(results[1])
    assert found.effects[0].name in repr(found)


def test_a_name_cannot_write_into_a_notebook(results) -> None:
    assert "<script>" not in replace(results[0], name="<script>")._repr_html_()


def test_results_become_data_frames(results, found) -> None:
    run, model, comparison = results
    frame = dpr.to_dataframe(run)
    assert list(frame.columns)[:3] == ["theta0_rad", "theta1_rad", "theta2_rad"]
    assert np.array_equal(frame.index, run.t)
    assert dpr.to_dataframe(model).loc["a/b", "value"] == model.ratios["a/b"].value
    assert dpr.to_dataframe(model).index.is_unique
    assert len(dpr.to_dataframe(comparison)) == len(comparison.t)
    assert set(dpr.to_dataframe(found).index) == {effect.name for effect in found.effects}
    with pytest.raises(TypeError, match="cannot convert str"):
        dpr.to_dataframe("run")  # type: ignore[arg-type]


def test_plots_are_figures(results, found) -> None:
    run, model, comparison = results
    figures = [
        dpr.plot_run(run),
        dpr.plot_response([comparison]),
        dpr.plot_error([comparison]),
        dpr.plot_search(model),
        dpr.plot_waterfall(found),
        dpr.plot_where(found),
        dpr.plot_horizon(found),
    ]
    assert all(isinstance(figure, Figure) for figure in figures)


@pytest.mark.parametrize("name", [name for name in dpr.__all__ if name[0].islower()])
def test_help_shows_plain_types(name: str) -> None:
    signature = str(inspect.signature(getattr(dpr, name)))
    assert "numpy.ndarray[tuple" not in signature
    assert "Annotated" not in signature
    assert "<function" not in signature
    assert len(signature) < 700


def test_help_of_identify_names_run_and_rig() -> None:
    parameters = inspect.signature(dpr.identify).parameters
    assert parameters["runs"].annotation == "Run | Sequence[Run]"
    assert parameters["rig"].annotation == "Rig"


def test_one_run_counts_as_a_sequence_of_one(runs: list[Run]) -> None:
    rig = dpr.load_rig("paper")
    alone, listed = dpr.identifiability(runs[0], rig), dpr.identifiability(runs[:1], rig)
    assert alone.to_json() == listed.to_json()
    assert as_runs(runs[0]) == (runs[0],)
    assert as_runs(runs) == tuple(runs)


@pytest.mark.slow
def test_one_run_is_identified_and_diagnosed_without_a_list(runs: list[Run]) -> None:
    rig = dpr.load_rig("paper")
    model = dpr.identify(runs[0], rig, seed=0)
    assert [used.file for used in model.runs] == [str(runs[0].file or runs[0].name)]
    found = dpr.diagnose(runs[0], rig, library={FRICTION: EFFECTS[FRICTION]})
    assert found.basis == "one release"
    assert isinstance(dpr.plot_response(dpr.compare(runs[0], rig, model)), Figure)
