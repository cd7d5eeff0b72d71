"""Explain the terms in table headers, each in one line.

`docs/glossary.md` contains the full definitions.
"""

TERMS = {
    "effect": "physical cause of a difference between model and rig, for example Coulomb friction of joint 2",
    "cause": "effect that explains the gap",
    "alternatives": "effects that could be the cause instead of the named effect",
    "indistinguishable effects": "effects that no algorithm can separate on these recordings; they share one"
    " probability",
    "probability": (
        "probability that the effect, or an indistinguishable effect, is a cause; calibrated on blind trials"
    ),
    "size, 90 % interval": "amplitude of the effect, with its 90 % interval",
    "90 % interval": "confidence interval that contains the true value in 90 of 100 cases, if the model is correct",
    "unique contribution": "share of the excess chi-square that returns when this effect is removed and the others are"
    " refitted",
    "excess explained": "share of the excess chi-square, which is the sum of squared residuals in units of the noise"
    " minus the contribution of noise alone",
    "share of the excess": "share of the excess chi-square that a torque or reading error at this place explains",
    "cosine similarity": "cosine of the angle between the signatures of two effects: 1 = indistinguishable,"
    " 0 = unrelated",
    "how to distinguish": "check that distinguishes the effects, or 'these recordings' if no check is needed",
    "Bayes factor": "ratio by which the result of a check changes the odds of a cause",
    "minimum detectable size": "smallest size that would be visible in these recordings",
    "confidence": "probability that an effect of this size or larger would have been detected",
    "determined by": (
        "source of a value: the recordings, a measured value in the rig file, or only the bounds in the rig file"
    ),
    "gap reduction": "relative decrease of the gap, which is the rms residual above the noise",
    "horizon (s)": "predictability horizon: time at which the uncertainty of the initial state alone moves an angle by"
    " 0.1 rad",
    "role": "whether a run was fitted, or held out to validate the result",
}
"""Explanation of each column header."""
