"""Show the friction torque of each joint against its speed, with a 90 % interval."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from dpr_lab.acceptance.judge import NOT_OF_SPEED
from dpr_lab.estimation.noise import NORMAL_Q90
from dpr_lab.gap.result.diagnosis import Diagnosis
from dpr_lab.gap.result.evidence import JointFriction
from dpr_lab.report import style
from dpr_lab.report.digits import interval, plus_minus, three
from dpr_lab.report.figures import draw_with_intervals, legend_above, new_figure
from dpr_lab.report.gap.section import PAGE, EvidenceSection, evidence_of
from dpr_lab.report.pages.page import Rows, page_table
from dpr_lab.report.words import named
from dpr_lab.shown import listed


def friction_figure(diagnosis: Diagnosis) -> Figure | None:
    """Draw the friction torque of each joint against its speed; None without a curve."""
    friction = evidence_of(diagnosis).friction
    if not friction:
        return None
    figure = new_figure(3.0)
    panels = figure.subplots(1, len(friction), squeeze=False)[0]
    for axes, (joint, curve) in zip(panels, friction.items(), strict=True):
        _draw_joint(axes, joint, curve)
    legend_above(figure)
    return figure


def _draw_joint(axes: Axes, joint: str, curve: JointFriction) -> None:
    speed, torque, std = map(np.array, (curve.speed_rad_per_s, *_in_mNm(curve)))
    draw_with_intervals(axes, speed, torque, NORMAL_Q90 * std, label="friction torque", **style.EVOLUTION)
    axes.set(title=_words(joint), xlabel="speed of the joint (rad/s)", ylabel="torque (mN m)")
    axes.margins(x=0.01)


def friction_words(diagnosis: Diagnosis) -> list[str]:
    """Describe the friction torque of each joint at the smallest and the largest positive speed of its curve."""
    friction = evidence_of(diagnosis).friction
    if not friction:
        return ["No joint moves fast enough in both directions."]
    sentences = []
    for joint, curve in friction.items():
        torque, std = _in_mNm(curve)
        sizes = [
            f"{plus_minus(torque[k], std[k])} mN m at {three(curve.speed_rad_per_s[k])} rad/s"
            + (" (not distinguishable from zero)" if abs(torque[k]) < NORMAL_Q90 * std[k] else "")
            for k in (len(torque) // 2, -1)
        ]
        sentences.append(f"{_words(joint).capitalize()}: {' and '.join(sizes)}.")
    sentences.append("± precedes the standard deviation.")
    other = [named(effect.name) for effect in diagnosis.effects if effect.name in NOT_OF_SPEED]
    if other:
        sentences.append(
            f"This curve does not contain friction that depends on quantities other than the speed: {listed(other)}."
        )
    return sentences


@page_table(
    "joint", "speed (rad/s)", "torque (mN m)", "90 % interval (mN m)", style="prose", title="Values of the curves"
)
def friction_table(diagnosis: Diagnosis) -> Rows:
    """Return rows for some speeds of each joint."""
    rows = []
    for joint, curve in evidence_of(diagnosis).friction.items():
        points = list(zip(curve.speed_rad_per_s, *_in_mNm(curve), strict=True))
        for speed, torque, std in points[:: PAGE.every]:
            within = interval(torque - NORMAL_Q90 * std, torque + NORMAL_Q90 * std, torque, std)
            rows.append((_words(joint), three(speed), plus_minus(torque, std), within))
    return rows


def _in_mNm(curve: JointFriction) -> tuple[list[float], list[float]]:
    """Convert the torques and their standard deviations to mN m."""
    return [1e3 * torque for torque in curve.torque_Nm], [1e3 * std for std in curve.std_Nm]


def _words(joint: str) -> str:
    return f"joint {joint[-1]}"


FRICTION = EvidenceSection(
    name="friction",
    title="Friction torque",
    words=friction_words,
    figure=friction_figure,
    alternative="Line charts of the friction torque of each joint against its speed, with its 90 % interval.",
    caption="Friction torque of each joint, up to the speed that it reaches in both directions: viscous friction, the"
    " named friction laws and a free-form curve, fitted together. The band is the 90 % interval at each speed.",
    symbols="T(u) = c u + sum of the friction laws at the speed u, positive if it opposes a positive u, at the assumed"
    " b (one rod: a). Its variance is g(u)^T C g(u), with C the covariance of the fitted values and g(u) the derivative"
    " of T(u).",
    tables=(friction_table,),
)
