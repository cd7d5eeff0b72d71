"""The model with the named effects: for `compare`, as a plain Python module, and as MJCF."""

from collections.abc import Sequence

import numpy as np

from dpr_lab.dynamics.base import RATIOS
from dpr_lab.effects import EFFECTS
from dpr_lab.gap.result.diagnosis import Diagnosis
from dpr_lab.identification.model import Covariance, EstimatedValue, FitSummary, Model, RigFacts, RunUsed, SearchRecord
from dpr_lab.identification.prior_update import update_prior
from dpr_lab.identification.scaling.prior_spread import scale_of, with_intervals
from dpr_lab.rig import Rig
from dpr_lab.run import Run
from dpr_lab.version import __version__

AXES = {"joint1": "theta1", "joint2": "theta2"}


def corrected_model(diagnosis: Diagnosis, runs: Sequence[Run], rig: Rig) -> Model:
    """The diagnosed model as `model.json`, with its effects in the table `effects`.

    Args:
        diagnosis: ratios, covariance and effects
        runs: the diagnosed runs
        rig: measured values and bounds of the nine parameters
    """
    values = np.array([interval.value for interval in diagnosis.ratios.values()])
    covariance = np.array(diagnosis.ratio_covariance)
    nine, base = update_prior(values, covariance, rig)
    factor = diagnosis.scale_b / base["b"].value
    absolute = {
        name: parameter.model_copy(update={"value": parameter.value * factor}) for name, parameter in base.items()
    }
    std = np.sqrt(np.diag(covariance))
    scale = diagnosis.scale or scale_of(absolute["b"], diagnosis.unknowns, rig)
    ratios = {
        name: EstimatedValue(value=interval.value, std=float(s), interval90=interval.interval90)
        for (name, interval), s in zip(diagnosis.ratios.items(), std, strict=True)
    }
    nine, absolute = with_intervals(nine, absolute, ratios, scale, diagnosis.unknowns, rig)
    gap = diagnosis.gap
    return Model(
        rig=RigFacts(name=rig.name, sha256=rig.sha256, L1=rig.rig.L1, g=rig.rig.g),
        ratios=ratios,
        covariance=Covariance(order=list(RATIOS), matrix=covariance.tolist()),
        cramer_rao_std=dict(zip(RATIOS, std.tolist(), strict=True)),
        parameters=nine,
        base=absolute,
        scale=scale,
        fit=FitSummary(
            rms_rad={AXES[k]: float(np.hypot(v, gap.floor_rad[k])) for k, v in gap.after_rad.items()},
            noise_rad={AXES[k]: v for k, v in gap.floor_rad.items()},
            segments=diagnosis.segments,
            chi2_per_dof=diagnosis.chi2_per_dof,
            iterations=0,
            longest_segment_s=0.5,
        ),
        search=SearchRecord(
            algorithm="diagnosis",
            objective="segments",
            seed=0,
            evaluations=0,
            seconds=diagnosis.seconds,
            generations=0,
            best={},
            best_cost=0.0,
            history={},
        ),
        runs=[
            RunUsed(file=str(run.file or run.name), sha256=run.sha256, pose=run.pose, samples=len(run.t))
            for run in runs
        ],
        p_over_b=diagnosis.p_over_b,
        effects={name: values for name, values in diagnosis.model_effects.items() if not EFFECTS[name].event},
        warnings=[] if diagnosis.verdict in ("named", "no_gap") else [diagnosis.sentence],
        version=__version__,
    )
