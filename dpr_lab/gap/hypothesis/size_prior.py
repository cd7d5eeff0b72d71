"""Prior of the fitted size of an effect on one rig.

The sizes of most effects are compared with those of laboratory rigs (`dpr_lab.effects.plausibility`). A spring and an
error of the encoder scale imitate each other on a single rod, so that their priors decide. Both depend on the rig:

- A spring is relative to gravity, because heavy rods have strong cables.
- A scale is exact, or has a tolerance, or belongs to another common encoder, or is arbitrary (belt, potentiometer).
"""

from dataclasses import dataclass

from dpr_lab.arrays import Array
from dpr_lab.effects import EFFECTS, param_index, plausibility
from dpr_lab.effects.encoder_scale import ENCODER_SCALE, usual_counts
from dpr_lab.effects.quantities import RigConstants
from dpr_lab.effects.spring import SPRING


@dataclass(frozen=True, slots=True)
class SizePrior:
    """Prior of the sizes of springs and scale errors."""

    spring: float = 0.01
    """Scale of a spring's amplitude, as a fraction of its limit (3 % of the gravity torque per radian)."""
    tolerance: float = 5e-3
    """Largest relative error of a scale that counts as a tolerance."""
    other_encoder: float = 0.5
    """Prior weight of the scale of another common encoder, relative to a tolerance."""
    arbitrary: float = 0.03
    """Prior weight of any other scale, for example due to a belt or a potentiometer."""


SIZE_PRIOR = SizePrior()

SCALES, SPRINGS = (tuple(effect.name for effect in pair) for pair in (ENCODER_SCALE, SPRING))
"""Names of the scale errors and of the springs of joints 1 and 2."""


def size_prior(params: Array, effect: str, limits: Array | None, constants: RigConstants) -> float:
    """Return the prior weight of an effect with its fitted size on one rig.

    Args:
        params: (SIZE,) parameters of all effects
        effect: name of the effect
        limits: (SIZE,) maximum sizes on the rig; None: no limits
        constants: encoders of the rig
    """
    if effect in SCALES:
        counts = (constants.counts_per_rev1, constants.counts_per_rev2)[SCALES.index(effect)]
        return EFFECTS[effect].prior_odds * _scale(float(params[param_index(effect, "excess")]), counts)
    if effect in SPRINGS and limits is not None:
        params = params.copy()
        for amplitude in EFFECTS[effect].amplitudes:
            place = param_index(effect, amplitude.name)
            params[place] *= min(amplitude.prior_scale / (SIZE_PRIOR.spring * limits[place]), 1.0)
    return plausibility(params, effect)


def _scale(excess: float, configured: float) -> float:
    """Return the weight of a relative scale error of an encoder with the configured counts per turn."""
    usual = usual_counts(abs(configured) * (1.0 + excess))
    other = usual is not None and usual != usual_counts(abs(configured))
    within = 1.0 / (1.0 + (excess / SIZE_PRIOR.tolerance) ** 4)
    return max(within, SIZE_PRIOR.other_encoder if other else SIZE_PRIOR.arbitrary)
