from dataclasses import replace

import numpy as np
import pytest

from dpr_lab.effects import effect_params
from dpr_lab.fitting.gauss_newton import fit
from dpr_lab.gap.hypothesis.hypothesis import free_parameters


@pytest.fixture(scope="module")
def clean(recorded, bare):
    return bare(recorded({}, duration=5.0))


class Simulated:
    """Output model that stores the number of segments of each prediction."""

    def __init__(self, model):
        self.model, self.constants, self.slopes, self.sizes = model, model.constants, model.slopes, []
        self.one_by_one = model.one_by_one

    def predict(self, segments, at):
        self.sizes.append(len(segments))
        return self.model.predict(segments, at)


@pytest.mark.parametrize(
    ("effects", "simulated"),
    [
        ({"coulomb_joint1": {"torque_Nm": 1e-3}, "latency_joint2": {"delay_s": 1e-3}}, 2),
        ({"hysteresis_joint2": {"torque_Nm": 2e-3, "length_rad": 0.1}}, None),  # states pass from segment to segment
    ],
)
def test_only_segments_with_other_initial_states_are_simulated_again(clean, effects, simulated):
    problem, base = clean
    at, changed = base.fit.estimate.changed(params=effect_params(effects)), np.zeros(len(problem.segments), np.bool_)
    changed[[1, 3]] = True
    other = at.changed(initial=at.initial + 1e-3 * changed[:, None])
    model = Simulated(problem.model)
    counted = replace(problem, model=model)
    again = counted.predict_again(other, problem.predict(at), changed)
    assert np.array_equal(again, problem.predict(other))
    assert model.sizes == [simulated or len(problem.segments)]


def test_a_shorter_step_of_some_segments_leaves_the_others_as_they_were(clean):
    problem, base = clean
    start = base.fit.estimate.changed(ratios=base.fit.estimate.ratios * 1.3)
    free, model = free_parameters(start, (), problem), Simulated(problem.model)
    fitted = fit(replace(problem, model=model), start, free)
    model.one_by_one = lambda at: False
    entire = fit(replace(problem, model=model), start, free)
    assert min(model.sizes) < len(problem.segments)
    assert (fitted.chi2, fitted.iterations) == (entire.chi2, entire.iterations)
