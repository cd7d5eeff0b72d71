from collections.abc import Callable

import numpy as np
import pytest

from dpr_lab.dynamics.base import BASE
from dpr_lab.identification.compare import Comparison
from dpr_lab.identification.model import (
    Covariance,
    EstimatedValue,
    FitSummary,
    Model,
    ParameterValue,
    RigFacts,
    RunUsed,
    SearchRecord,
)
from dpr_lab.rig import PARAMETERS

NOISE_RAD = np.array([2e-4, 3e-4])


@pytest.fixture(scope="session")
def comparison() -> Callable[..., Comparison]:
    """Create a comparison of sine swings: a free run that diverges, and segments that leave white noise."""

    def make(run="first", *, pose="X1", held_out=False, samples=2000, horizon_s=1.2, residual=1.0) -> Comparison:
        rng = np.random.default_rng(samples)
        t = np.arange(samples) / 1000
        tracked = np.pi + np.stack([0.5 * np.cos(5 * t), 2 * np.cos(4 * t)], axis=1)
        measured = tracked + residual * NOISE_RAD * rng.standard_normal((samples, 2))
        free_run = tracked + 1e-3 * np.expm1(2 * t)[:, None]
        near = t <= horizon_s
        return Comparison(
            run=run,
            pose=pose,
            held_out=held_out,
            t=t,
            measured=measured,
            free_run=free_run,
            tracked=tracked,
            horizon_s=horizon_s,
            noise_rad=NOISE_RAD,
            segments=4,
            segment_rms_rad=residual * NOISE_RAD,
            free_run_rms_rad=np.sqrt(np.mean((measured - free_run)[near] ** 2, axis=0)),
        )

    return make


@pytest.fixture(scope="session")
def model() -> Callable[..., Model]:
    """Create a model whose residual is `times_noise` times its noise floor."""

    def make(times_noise=1.0, **changes) -> Model:
        ratios = {"a/b": 10.2458, "d/b": 1.50094, "e1/b": 263.563, "c1/b": 0.18762, "c2/b": 0.0071234}
        best: dict[str, float] = dict.fromkeys(PARAMETERS, 0.2)
        fixed = {"m1": "measured", "c1": "data", "c2": "data"}
        noise: dict[str, float] = {"theta1": NOISE_RAD[0], "theta2": NOISE_RAD[1]}
        whole = Model(
            rig=RigFacts(name="paper", sha256="ab" * 32, L1=0.4, g=9.81),
            ratios={
                name: EstimatedValue(value=value, std=1e-3 * value, interval90=(0.998 * value, 1.002 * value))
                for name, value in ratios.items()
            },
            covariance=Covariance(order=list(ratios), matrix=np.diag([1e-6] * 5).tolist()),
            cramer_rao_std={name: 1e-3 * value for name, value in ratios.items()},
            base={name: ParameterValue(value=0.01, std=None, fixed_by="bound") for name in BASE},
            parameters={
                name: ParameterValue.model_validate(
                    {"value": value, "std": 0.001 if name in fixed else None, "fixed_by": fixed.get(name, "bound")}
                )
                for name, value in best.items()
            },
            fit=FitSummary(
                rms_rad={axis: times_noise * value for axis, value in noise.items()},
                noise_rad=noise,
                segments=60,
                chi2_per_dof=times_noise**2,
                iterations=14,
                longest_segment_s=2.0,
            ),
            search=SearchRecord(
                algorithm="iga",
                objective="segments",
                seed=7,
                evaluations=48210,
                seconds=6.4,
                generations=3,
                best=best,
                best_cost=1.5,
                history={
                    "evaluations": [40.0, 500.0, 1000.0, 1500.0],
                    "best_cost": [4e4, 300.0, 20.0, 1.5],
                    "best_fitness": [0.01, 1.0, 6.4, 9.6],
                    "population_fitness": [0.3, 0.7, 0.9, 0.99],
                },
            ),
            runs=[RunUsed(file="runs/first.mcap", sha256="cd" * 32, pose="X1", samples=2000, duration_s=2.0)],
            warnings=["c2 lies at its lower bound"],
            version="0.1.0",
        )
        return whole.model_copy(update=changes)

    return make
