"""Public names of `import dpr_lab as dpr`, and the display of results."""

import dataclasses
import pydoc
import re
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest
from matplotlib.figure import Figure

import dpr_lab as dpr
from dpr_lab.effects import EFFECTS
from dpr_lab.gap.advice import recording
from dpr_lab.gap.advice.check_kind import CheckAnswer
from dpr_lab.gap.result.checks import AdvisedCheck
from dpr_lab.run import Run
from dpr_lab.shown import Shown
from dpr_lab.workflows.accept import judged
from tests.a_diagnosis import CLOCK, made, measurement

FRICTION = "coulomb_joint2"


def test_every_public_name_is_there_with_a_docstring() -> None:
    for name in dpr.__all__:
        assert getattr(dpr, name).__doc__, name
    assert set(dir(dpr)) == {"__doc__", "__version__", *dpr.__all__}
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        _ = dpr.nothing


def test_only_requested_modules_are_imported() -> None:
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
def diagnosis(runs: list[Run]) -> dpr.Diagnosis:
    return dpr.diagnose(runs, dpr.load_rig("paper"), library={FRICTION: EFFECTS[FRICTION]})


@pytest.mark.slow
def test_results_show_themselves_on_a_few_lines(results, diagnosis) -> None:
    rig = dpr.load_rig("paper")
    for result in (rig, dpr.identifiability([results[0]], rig), *results, diagnosis):
        assert str(result) == repr(result)
        outcome, page = repr(result), result._repr_html_()
        assert 1 <= len(outcome.splitlines()) < 25
        assert len(outcome) < 2000
        assert "array(" not in outcome
        assert page.startswith("<p>")
    assert "a/b" in repr(results[1])
    assert diagnosis.effects[0].name in repr(diagnosis)


@pytest.mark.slow
def test_a_name_cannot_write_into_a_notebook(results) -> None:
    assert "<script>" not in replace(results[0], name="<script>")._repr_html_()


def test_a_comparison_has_the_index_of_its_run() -> None:
    t, curves = np.array([0.0, 0.1]), np.array([[0.0, 1.0], [0.0, 1.0]])
    run = Run("X1", t, np.zeros((2, 3)), None, None, "paper", "", 10.0)
    comparison = dpr.Comparison(
        "X1", None, False, t, curves, curves, curves, 1.0, np.ones(2), 1, np.ones(2), np.ones(2)
    )
    frames = [dpr.to_dataframe(run), dpr.to_dataframe(comparison)]
    assert [frame.index.name for frame in frames] == ["t_s", "t_s"]
    assert frames[0].join(frames[1])["tracked_theta2"].tolist() == [1.0, 1.0]


@pytest.mark.slow
def test_results_become_data_frames(results, diagnosis) -> None:
    run, model, comparison = results
    frame = dpr.to_dataframe(run)
    assert list(frame.columns)[:3] == ["theta0_rad", "theta1_rad", "theta2_rad"]
    assert np.array_equal(frame.index, run.t)
    assert dpr.to_dataframe(model).loc["a/b", "value"] == model.ratios["a/b"].value
    assert dpr.to_dataframe(model).index.is_unique
    assert len(dpr.to_dataframe(comparison)) == len(comparison.t)
    assert set(dpr.to_dataframe(diagnosis).index) == {effect.name for effect in diagnosis.effects}
    with pytest.raises(TypeError, match="cannot convert str"):
        dpr.to_dataframe("run")  # type: ignore[arg-type]


@pytest.mark.slow
def test_plots_are_figures(results, diagnosis) -> None:
    run, model, comparison = results
    figures = [
        dpr.plot_run(run),
        dpr.plot_response([comparison]),
        dpr.plot_error([comparison]),
        dpr.plot_search(model),
        dpr.plot_waterfall(diagnosis),
        dpr.plot_where(diagnosis),
        dpr.plot_horizon(diagnosis),
    ]
    assert all(isinstance(figure, Figure) for figure in figures)


def help_of(name: str) -> str:
    """Help text with each signature on one line: Python 3.13 breaks long ones."""
    text = pydoc.render_doc(getattr(dpr, name), renderer=pydoc.plaintext)  # pyright: ignore[reportAttributeAccessIssue]
    text = re.sub(r"\(\n\s+", "(", text)
    text = re.sub(r",\n\s+(?=[\w*/]+[:,=])", ", ", text)
    return text.replace("NDArray[np.float64]", "NDArray[float64]")


@pytest.mark.parametrize("name", [name for name in dpr.__all__ if name[0].islower()])
def test_help_of_a_function_shows_its_public_name_and_plain_types(name: str) -> None:
    signature = help_of(name).splitlines()[2]
    assert signature.startswith(f"{name}(")
    assert len(signature) < 700
    assert not [word for word in ("'Run", "Annotated", "<function", "dpr_lab.", "pathlib.") if word in signature]


@pytest.mark.parametrize("name", ["Comparison", "Diagnosis", "ImportOptions", "Model", "Rig", "Run"])
def test_help_of_a_class_begins_with_its_fields_and_plain_types(name: str) -> None:
    signature = help_of(name).splitlines()[3]
    assert not [word for word in ("**data", "Annotated", "<function", "typing.", "dpr_lab.") if word in signature]


def test_help_of_a_method_has_plain_types() -> None:
    assert " |  theta(self, counts: ArrayLike) -> NDArray[float64]\n" in help_of("Rig")
    assert " |  starting_point(self, rig: Rig) -> NDArray[float64]\n" in help_of("Model")


@pytest.mark.parametrize("cls", [dpr.Comparison, dpr.ImportOptions, dpr.Run])
def test_help_of_a_dataclass_says_what_each_field_is(cls: Any) -> None:
    text = help_of(cls.__name__)
    assert [one.name for one in dataclasses.fields(cls) if f" |  {one.name}\n |      " not in text] == []


def test_help_of_identify_names_run_and_rig() -> None:
    assert (
        help_of("identify")
        .splitlines()[2]
        .startswith("identify(runs: Run | Sequence[Run], rig: Rig, *, objective: str = 'segments'")
    )


@pytest.mark.slow
def test_a_table_in_memory_is_identified_diagnosed_and_compared(runs: list[Run], tmp_path: Path) -> None:
    rig, tables = dpr.load_rig("paper"), []
    for run in runs:
        swing = run.swing
        rows = np.column_stack([swing.t, np.degrees(swing.theta[:, 1:])])
        tables.append(tmp_path / f"{run.name}.csv")
        np.savetxt(tables[-1], rows[::4], fmt="%.6f", delimiter=",", header="t_s,enc1_deg,enc2_deg", comments="")
    options = dpr.ImportOptions(columns={"theta1": "enc1_deg", "theta2": "enc2_deg"})
    imported = [dpr.import_table(table, rig, options) for table in tables]
    model = dpr.identify(imported[:2], rig, seed=0)
    comparisons = [dpr.compare(run, rig, model) for run in imported]
    assert [comparison.held_out for comparison in comparisons] == [False, False, True]
    diagnosis = dpr.diagnose(imported[:2], rig, library={FRICTION: EFFECTS[FRICTION]})
    corrected = dpr.corrected_model(diagnosis, imported[:2], rig)
    corrected.save(tmp_path / "model.json")
    loaded = dpr.load_model(str(tmp_path / "model.json"))
    assert FRICTION in loaded.effects
    before, after = comparisons[2], dpr.compare(imported[2], rig, loaded)
    assert isinstance(before, dpr.Comparison)
    assert isinstance(after, dpr.Comparison)
    assert np.max(after.segment_rms_rad) < np.max(before.segment_rms_rad)


def test_the_reference_describes_every_public_name() -> None:
    page = (Path(__file__).parents[1] / "docs" / "reference" / "python.md").read_text(encoding="utf-8")
    described = {line.rpartition("dpr_lab.")[2] for line in page.splitlines() if line.startswith(".. auto")}
    assert described == set(dpr.__all__)


@pytest.mark.parametrize("runs", ["x1.mcap", Path("x1.mcap"), [Path("x1.mcap")]])
def test_the_name_of_a_file_is_neither_a_run_nor_a_rig(runs: Any) -> None:
    for function in (dpr.identify, dpr.diagnose):
        with pytest.raises(dpr.DprError, match=r"x1.mcap: is the name of a file, not a run: read .* with load_run"):
            function(runs, dpr.load_rig("paper"))
        for rig in ("paper", Path("paper")):
            with pytest.raises(dpr.DprError, match=r"paper: is the name of a rig file, not a rig: .* with load_rig"):
                function([], cast(Any, rig))
    with pytest.raises(dpr.DprError, match=r"x1.mcap: is the name of a file, not a run"):
        dpr.compare(runs, dpr.load_rig("paper"), cast(Any, None))


@pytest.mark.parametrize(
    "name",
    ["diagnose", "identify", "identifiability", "plan", "compare", "corrected_model", "accept", "check", "held_out"],
)
def test_a_run_of_another_rig_is_refused_by_every_function(name: str, runs: list[Run]) -> None:
    rig, unused = dpr.load_rig("furuta"), cast(Any, None)
    foreign = replace(runs[0], file=Path("monday/x.mcap"))
    of_recording = AdvisedCheck.model_validate(measurement(CLOCK, CLOCK, 1) | {"kind": "recording"})
    calls: dict[str, Callable[[], object]] = {
        "diagnose": lambda: dpr.diagnose(foreign, rig),
        "held_out": lambda: dpr.diagnose(replace(runs[1], rig_name=rig.name), rig, held_out=foreign),
        "identify": lambda: dpr.identify(foreign, rig),
        "identifiability": lambda: dpr.identifiability(foreign, rig),
        "plan": lambda: dpr.plan(rig, foreign),
        "compare": lambda: dpr.compare(foreign, rig, unused),
        "corrected_model": lambda: dpr.corrected_model(unused, [foreign], rig),
        "accept": lambda: judged(unused, unused, [foreign], rig),
        "check": lambda: recording.result(made(), of_recording, CheckAnswer((foreign,), rig), {}),
    }
    with pytest.raises(dpr.DprError, match=r"^monday/x.mcap: is a run of another rig: paper, not furuta\."):
        calls[name]()


def test_a_table_that_was_imported_twice_is_one_recording() -> None:
    rig, t = dpr.load_rig("paper"), np.linspace(0.0, 2.0, 401)
    run = Run("side", t, np.outer(np.sin(t), [0.0, 1.0, 1.0]), None, None, "paper", "", 200.0, sha256="1")
    again = replace(run, name="side-2", file=Path("side-2.mcap"), sha256="2", notes=("imported again",))
    message = "side-2.mcap: is the same recording as side; it was given twice: give each run once"
    for function in (dpr.identify, dpr.identifiability, dpr.diagnose):
        with pytest.raises(dpr.DprError, match=message):
            function([run, again], rig)
    with pytest.raises(dpr.DprError, match=message):
        dpr.plan(rig, [run, again])
    with pytest.raises(dpr.DprError, match=message):
        dpr.diagnose(run, rig, held_out=again)


def test_an_unknown_choice_of_an_import_is_refused() -> None:
    with pytest.raises(ValueError, match="zero must be upright or hanging, not 'sideways'"):
        dpr.ImportOptions(zero="sideways")  # type: ignore[arg-type]


def test_a_result_without_rows_shows_no_empty_table() -> None:
    class Nothing(Shown):
        def _heading(self) -> str:
            return "no release is necessary"

    assert Nothing()._repr_html_() == "<p>no release is necessary</p>"
