"""What `import dpr_lab as dpr` offers, and how results show themselves."""

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
from dpr_lab.run import Run

FRICTION = "coulomb_joint2"


def test_every_public_name_is_there_with_a_docstring() -> None:
    for name in dpr.__all__:
        assert getattr(dpr, name).__doc__, name
    assert set(dpr.__all__) <= set(dir(dpr))
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        _ = dpr.nothing


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
    with pytest.raises(TypeError, match="no table of str"):
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
