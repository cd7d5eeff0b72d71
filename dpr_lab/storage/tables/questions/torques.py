"""Warnings about known torques: other signs, units or columns, and torques that do not act."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from dpr_lab.arrays import Array
from dpr_lab.identification.misread.balance import EnergyFit
from dpr_lab.identification.misread.readings import TORQUE_FACTORS
from dpr_lab.identification.misread.torque_balance import torque_balance
from dpr_lab.shown import percent
from dpr_lab.storage.tables.interpreted import SETTINGS, InterpretedTable, TableQuestion
from dpr_lab.storage.tables.readings import BROKEN, READ, Interpretation, energy_residual, read_otherwise
from dpr_lab.storage.tables.torques import JOINTS, PASSIVE, unit_in


def better_torques(fit: EnergyFit, read: InterpretedTable) -> list[TableQuestion]:
    """Warn if the energy is conserved only with another interpretation of the torques.

    Another interpretation has another sign, unit or order, or no torques. `fit` is the energy fit with the given
    torques. The list is empty if no other interpretation is clearly better.
    """
    residuals = [(energy_residual(replace(read, torques=torques), other), other) for torques, other in _others(read)]
    residual, best = min(residuals, key=lambda pair: pair[0], default=(np.inf, None))
    if best is None or residual >= min(READ.sure, fit.residual / READ.better):
        return []
    return [read_otherwise(BROKEN, [best], read)]


def _others(read: InterpretedTable) -> Iterator[tuple[Array, Interpretation]]:
    """Yield other torques (n, 2), N m, each with an interpretation.

    These torques have other signs or units, are exchanged, or are torques of the table that the options ignore.
    """

    def reading(cause: str, *words: str) -> Interpretation:
        return Interpretation((cause,), words, read.values, read.options)

    if read.ignored is not None:
        kind, torques = read.ignored
        yield torques, reading("the torques of the table act, which --torque none ignores", "--torque", kind)
    if read.torques is None:
        return
    scale = read.options.scale
    converted = any(joint in scale for joint in JOINTS) or any(map(unit_in, read.torque_columns))
    for cause, factors in TORQUE_FACTORS.items():
        scaled = {**scale, **{j: scale.get(j, 1.0) * factor for j, factor in zip(JOINTS, factors, strict=True)}}
        words = ",".join(f"{name}={factor:g}" for name, factor in scaled.items() if factor != 1.0)
        if converted and min(factors) > 0.0:
            cause = f"the torques must be multiplied by {factors[0]:g}"
        yield read.torques * factors, reading(cause, "--scale", words or "1")
    if PASSIVE not in read.torque_columns:
        first, second = read.torque_columns
        cause = "the columns of the two torques are exchanged"
        yield read.torques[:, ::-1], reading(cause, "--columns", f"tau1={second},tau2={first}")


def torque_questions(table: InterpretedTable) -> list[TableQuestion]:
    """Warn about known torques whose rows are too far apart, or that do not influence the rods.

    The input of a driven arm does not act on the rods. For such an input, only the distance between the rows is
    checked.
    """
    if table.torques is None:
        return []
    words = "the input of the arm changes" if table.arm_moves else "the torques change"
    coarse = coarse_torques(table.torques[table.swing], words)
    idle = "" if table.arm_moves else _idle(table.beginning())
    return [TableQuestion(sentence) for sentence in (coarse, idle) if sentence]


def coarse_torques(torques: Array, words: str) -> str:
    """Compose a warning if torques or an input change too much from row to row; otherwise return an empty text.

    Args:
        torques: (n, 2) torques of joints 1 and 2 from the release on, N m
        words: subject and verb of the sentence
    """
    changes, ranges = np.median(np.abs(np.diff(torques, axis=0)), axis=0), np.ptp(torques, axis=0)
    share = float(np.max(changes / np.maximum(ranges, np.finfo(float).tiny)))
    if share <= SETTINGS.torque_step:
        return ""
    return (
        f"{words} by {percent(share)} of the range from row to row. The rows do not show when such a change occurs,"
        " and a diagnosis may name a delay of the input: export the table at the rate of the controller"
    )


def _idle(read: InterpretedTable) -> str:
    """Compose a warning if torques exceed gravity but do not seem to act; otherwise return an empty text."""
    rods, torques, limits = read.rods(read.values, read.options), read.torques, SETTINGS.idle
    acting, idle = (torque_balance(read.t, rods, acting, read.rig) for acting in (torques, None))
    if torques is None or acting is None or idle is None:
        return ""
    residual = acting.residual()
    if not residual > limits[0] or idle.residual() > limits[1] * residual:
        return ""
    joint = int(np.argmax(np.abs(torques).max(axis=0)))
    most, name = float(np.abs(torques[:, joint]).max()), JOINTS[joint]
    return (
        f"the torque {read.torque_columns[joint]!r} reaches {most:.3g} N m, {most / acting.gravity[joint]:.2g} times"
        " the largest torque of gravity on the rod, but the motion agrees better with no torque: check its unit"
        f" (--scale {name}=...) and its column (--columns {name}=...), or ignore it (--torque none)"
    )
