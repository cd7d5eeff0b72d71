"""Gain of a drive with known constants, from the inertia that the recordings determine."""

from collections.abc import Sequence

from dpr_lab.dynamics.base import GAINS
from dpr_lab.gap.result.diagnosis import Diagnosis
from dpr_lab.gap.result.evidence import WiderModel
from dpr_lab.gap.result.saved import Interval
from dpr_lab.identification.moving_arm.setup import drive_gain, rods_measured
from dpr_lab.rig import Rig
from dpr_lab.run import Run


def with_gain(diagnosis: Diagnosis, runs: Sequence[Run], rig: Rig) -> Diagnosis:
    """Return the diagnosis with the ratio of the gain to b, such as kt/b, if the drive determines b.

    The recordings with a drive of known gain K determine K/b. The fit uses K, and states b with the uncertainty of K.
    The interval of K/b follows from that of b, so it is at least as wide as the recordings alone require.

    If the rods were measured too, the ratio is not added: measured masses determine b without the drive, and the
    diagnosis tests an error of the gain as an effect.
    """
    scale, motor = diagnosis.scale, rig.motor
    if scale is None or scale.fixed_by != "data" or motor is None or motor.input not in GAINS:
        return diagnosis
    gain, name = drive_gain(rig), GAINS[motor.input].format(scale.inertia)
    driven = any(run.arm_mode == "driven" for run in runs)
    if not driven or not gain.known or rods_measured(rig) or name in diagnosis.stated_ratios:
        return diagnosis

    def ratio(interval: tuple[float, float]) -> tuple[float, float]:
        low, high = interval
        return gain.value / max(high, scale.b), gain.value / max(min(low, scale.b), 1e-3 * scale.b)

    def widened(model: WiderModel) -> WiderModel:
        if scale.inertia not in model.intervals90:
            return model
        of_gain = {name: ratio(model.intervals90[scale.inertia])}
        return model.model_copy(update={"intervals90": {**model.intervals90, **of_gain}})

    ratio_of_gain = Interval(value=gain.value / scale.b, interval90=ratio(scale.interval90))
    evidence = diagnosis.evidence
    if evidence is not None:
        evidence = evidence.model_copy(update={"wider_models": [widened(model) for model in evidence.wider_models]})
    determined = {**diagnosis.stated_ratios, name: ratio_of_gain}
    return diagnosis.model_copy(update={"determined": determined, "evidence": evidence})
