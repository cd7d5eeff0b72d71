"""Runs of one rig with both rods, one alone and the elbow clamped, recorded by the simulated device, in one fit."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from dpr_lab.dynamics.base import base_parameters, whole_parameters
from dpr_lab.errors import IdentificationError, RunError
from dpr_lab.fitting.estimate import unknown_ratios
from dpr_lab.identification.compare import compare_run
from dpr_lab.identification.identify import identify, polish
from dpr_lab.identification.preprocess import preprocess
from dpr_lab.identification.uncertainty import uncertainty
from dpr_lab.rig import Rig
from dpr_lab.run import Run, as_mounted
from dpr_lab.search import load_search
from sim_device.plant.config import load_plant
from sim_device.trials.offline_recorder import record

PLANT = load_plant("paper")
TRUE = PLANT.Z
MOUNTED = {"both": {}, "inner": {"mounted": "inner"}, "outer": {"mounted": "outer"}, "clamped": {"elbow": "clamped"}}


@pytest.fixture(scope="module")
def runs(paper: Rig) -> dict[str, list[Run]]:
    recorded = {
        name: record(PLANT, paper.with_rods(**result), duration=3.0, rate_hz=500) for name, result in MOUNTED.items()
    }
    return {
        name: [replace(run, name=f"{name} {run.name}", sha256=f"{name} {run.name}") for run in some]
        for name, some in recorded.items()
    }


@pytest.fixture
def fitted(paper: Rig, runs: dict[str, list[Run]]) -> Callable[..., tuple]:
    def made(*names: str) -> tuple:
        result = polish(paper.nominal, [preprocess(run, paper) for name in names for run in runs[name]], paper)
        return result, uncertainty(result)

    return made


@pytest.mark.slow
@pytest.mark.parametrize("names", [("both", "inner"), ("both", "clamped"), ("outer",)], ids="+".join)
def test_runs_of_different_mountings_share_their_parameters(fitted, paper: Rig, names: tuple[str, ...]) -> None:
    result, sure = fitted(*names)
    truth = unknown_ratios(whole_parameters(TRUE, paper.L1, paper.g))[list(result.visible)]
    assert result.chi2_per_dof == pytest.approx(1.0, abs=0.1)
    assert np.abs((result.unknowns - truth) / sure.std).max() < 4
    assert ("p/b" in sure.names) == ("inner" in names)


@pytest.mark.slow
def test_the_inner_rod_alone_determines_its_own_two_ratios(fitted, paper: Rig) -> None:
    result, sure = fitted("inner")
    a, _, _, e1, c1, _ = base_parameters(TRUE, paper.L1, paper.g)
    p = TRUE[3] * paper.L1**2
    given = unknown_ratios(whole_parameters(paper.nominal, paper.L1, paper.g))
    inertia = given[0] - given[6]
    e1_fit, c1_fit = result.unknowns
    assert sure.names == ("e1/b", "c1/b")
    assert (e1_fit - given[6] * paper.g / paper.L1) / inertia == pytest.approx(
        (e1 - p * paper.g / paper.L1) / (a - p), 1e-4
    )
    assert c1_fit / inertia == pytest.approx(c1 / (a - p), rel=1e-3)


@pytest.mark.slow
def test_a_weighed_outer_rod_and_the_inner_one_alone_fix_the_scale(paper: Rig, runs: dict[str, list[Run]]) -> None:
    weighed = paper.parameters | {"m2": paper.parameters["m2"].model_copy(update={"measured": TRUE[3], "std": 1e-4})}
    rig = paper.model_copy(update={"parameters": weighed})
    quick = load_search("segments").model_copy(update={"generations": 3})
    model = identify([*runs["both"], *runs["inner"]], rig, settings=quick)
    truth = base_parameters(TRUE, paper.L1, paper.g)
    for value, true in zip(model.base.values(), truth, strict=True):
        assert value.fixed_by == "data"
        assert abs(value.value - true) < 4 * value.std
    without = identify(runs["both"], rig, settings=quick)
    assert without.base["b"].fixed_by == "bound"


@pytest.mark.slow
def test_a_rig_with_one_rod_is_captured_identified_and_compared(paper: Rig, runs: dict[str, list[Run]]) -> None:
    quick = load_search("segments").model_copy(update={"generations": 3})
    model = identify(runs["inner"][:2], paper, settings=quick)
    assert model.covariance.order == ["e1/b", "c1/b"]
    assert set(model.ratios) == {"e1/a", "c1/a"}  # nothing of the rod that is not mounted
    a, *_, e1, _, _, p = whole_parameters(TRUE, paper.L1, paper.g)
    gravity = model.ratios["e1/a"]
    assert abs(gravity.value - (e1 - p * paper.g / paper.L1) / (a - p)) < 4 * gravity.std
    assert gravity.std < 0.01 * gravity.value
    assert not any("a/b" in sentence for sentence in (*model.warnings, *model.failures))
    comparison = compare_run(runs["inner"][2], paper, model)
    assert comparison.held_out
    assert comparison.segment_rms_rad[0] < 1.5 * comparison.noise_rad[0]
    assert comparison.horizon_s == pytest.approx(3.0)


@pytest.mark.slow
def test_a_clamped_elbow_is_searched_for_as_one_rod(paper: Rig, runs: dict[str, list[Run]]) -> None:
    from dpr_lab.identification.objectives import OBJECTIVES

    prepared = [preprocess(runs["clamped"][0], paper), preprocess(runs["outer"][0], paper)]
    for choice in OBJECTIVES.values():
        at_truth, elsewhere = choice.build(prepared, paper)(np.stack([TRUE, 0.9 * TRUE + 0.2 * TRUE * np.eye(9)[0]]))
        assert (at_truth < elsewhere).all()


@pytest.mark.slow
def test_a_joint_that_turns_though_no_rod_hangs_there_is_refused(runs: dict[str, list[Run]]) -> None:
    theta = runs["both"][1].theta
    with pytest.raises(RunError, match=r"X2: joint 2 turns by .* although only the inner rod is mounted"):
        as_mounted(theta, "inner", "X2")
    with pytest.raises(RunError, match="although the elbow is specified as clamped"):
        as_mounted(theta, "clamped", "X2")
    resting = np.column_stack([theta[:, :2], np.full(len(theta), np.pi)])
    assert (as_mounted(resting, "inner", "X2")[:, 2] == theta[:, 1]).all()


@pytest.mark.slow
def test_a_gap_too_long_for_a_prediction_is_named(paper: Rig, runs: dict[str, list[Run]]) -> None:
    run = runs["inner"][0]
    apart = replace(run, t=run.t + 500.0 * (run.t > 1.001))
    with pytest.raises(IdentificationError, match=r"has an interruption of 500 s.*--start-s, --duration-s"):
        identify(apart, paper, settings=load_search("segments").model_copy(update={"generations": 1}))
