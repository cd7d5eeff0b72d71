"""`dpr-lab identifiability`: identifiable parameters of a rig, and recommended measurements."""

import textwrap
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from dpr_lab.cli.checks import Json, RigName, TorqueKind, require_runs
from dpr_lab.cli.console import emit, line, table

if TYPE_CHECKING:
    from dpr_lab.identification.identifiability import Identifiability
    from dpr_lab.identification.moving_arm.identifiability import ArmIdentifiability


def identifiability(
    rig: RigName,
    runs: Annotated[
        list[Path] | None,
        typer.Argument(help="Run files (.mcap). Default: simulated releases from the poses of the rig file."),
    ] = None,
    torque: TorqueKind = None,
    as_json: Json = False,
) -> None:
    """Find the parameters that the recordings identify.

    For the other parameters, bench measurements are recommended.

    Example: dpr-lab identifiability runs/*.mcap --rig paper
    """
    require_runs(torque, runs)
    from dpr_lab.cli.listener import Listener
    from dpr_lab.identification.moving_arm.identifiability import ArmIdentifiability
    from dpr_lab.workflows.identifiability import identifiability as judge

    with Listener() as listener:
        result = judge(rig, runs or (), torque, listener)
    if as_json:
        request = {"rig": result.rig, "runs": runs or [], "torques": result.torques}
        emit(result.identifiability.to_json() | request)
    else:
        if result.torques:
            _print(f"Runs driven by their {' and '.join(result.torques)} torques.")
        if isinstance(result.identifiability, ArmIdentifiability):
            show_arm(result.identifiability)
        else:
            show(result.identifiability)


def show_arm(analysis: "ArmIdentifiability") -> None:
    """Print the results for a rig with a moving arm as tables and sentences."""
    from dpr_lab.shown import FIXED_BY

    _print(f"{analysis.heading}.")
    if analysis.simulated:
        _print(
            "No runs were given, so the recordings are simulated with the values of the rig file. The values"
            " below are not results."
        )
    columns = ("combination", "value", "relative std")
    values = {name: f"{value:.5g}" for name, value in analysis.values.items()}  # empty if the recordings are simulated
    rows = [(name, values.get(name, ""), f"{std:.1e}") for name, std in analysis.combinations.items()]
    rows += [(name, "", "not determined") for name in analysis.unseen]
    if analysis.simulated:
        columns, rows = columns[::2], [row[::2] for row in rows]
    table("Quantities determined by the recordings", columns, rows)
    table(
        "Parameters and what determines them",
        ("parameter", "relative std", "determined by"),
        [
            (name, f"{analysis.spread[name]:.1e}" if name in analysis.spread else "", FIXED_BY[source])
            for name, source in analysis.fixed_by.items()
        ],
    )
    _show_undetected(analysis)
    _show_advice(analysis)


def show(analysis: "Identifiability") -> None:
    """Print the results as tables and sentences.

    The tables are as wide as the terminal, or 160 columns in a pipe.
    """
    from dpr_lab.identification.identifiability import CRAMER_RAO_NOTE
    from dpr_lab.report.digits import NONE, plus_minus
    from dpr_lab.report.tables import PARAMETER_UNITS, interval_words
    from dpr_lab.rig import PARAMETERS
    from dpr_lab.shown import FIXED_BY

    sizes = ", ".join(f"{value:.2g}" for value in analysis.singular_values)
    _print(
        f"The recordings determine {analysis.rank} of {len(analysis.parameters)} combinations of parameters (singular"
        f" values {sizes}; the other singular values are 0)."
    )
    count = "Nine parameters" if len(analysis.parameters) == len(PARAMETERS) else "Parameters"
    table(
        "Quantities determined by the recordings",
        ("combination", "value ± Cramér-Rao std", "relative std"),
        [
            (name, plus_minus(value, std), f"{std / value:.1e}")
            if isfinite(std)
            else (name, f"{value:.3g}", "not determined")
            for (name, value), std in zip(analysis.unknowns.items(), analysis.cramer_rao_std.values(), strict=True)
        ],
        note=CRAMER_RAO_NOTE,
    )
    table(
        f"{count} and what determines them",
        ("parameter", "value ± std", "90 % interval", "unit", "determined by", "contributing measured values"),
        [
            (
                name,
                plus_minus(parameter.value, parameter.std),
                interval_words(parameter),
                PARAMETER_UNITS[name][0],
                FIXED_BY[parameter.fixed_by],
                ", ".join(measured for measured, helped in analysis.helps.items() if name in helped) or NONE,
            )
            for name, parameter in analysis.parameters.items()
        ],
    )
    _show_undetected(analysis)
    _show_length(analysis)
    _show_advice(analysis)


def _show_undetected(analysis: "Identifiability | ArmIdentifiability") -> None:
    from dpr_lab.identification.directions import described

    if analysis.null_space:
        _print("Parameter changes that neither recordings nor measured values can detect:")
    for direction in analysis.null_space:
        _print(f"- {described(direction)}")


def _show_length(analysis: "Identifiability") -> None:
    if analysis.length_error is None:
        return
    shifts = ", ".join(f"{name} {100 * shift:+.2f} %" for name, shift in analysis.length_error.ratio_shift.items())
    _print(
        "L1 is assumed exact. An error of L1 changes e2 = d g / L1, like an error of g or of the sample clock."
        f" An error of {1e3 * analysis.length_error.error:.2g} mm changes the ratios by {shifts} and leaves a"
        f" residual of {analysis.length_error.residual_over_noise:.1f} times the noise."
    )


def _show_advice(analysis: "Identifiability | ArmIdentifiability") -> None:
    from dpr_lab.report.digits import NONE

    if not analysis.null_space:
        _print("All parameters are determined. A further measurement only reduces their uncertainty.")
    table(
        "Additional measurements on the bench",
        ("measurement", "quantity", "determines", "gain (bits)"),
        [
            (
                advice.name,
                f"{advice.quantity.symbol}, {advice.quantity.unit}",
                ", ".join(advice.frees) or NONE,
                f"{advice.gain_bits:z.1f}",
            )
            for advice in analysis.advice
            if advice.frees or advice.gain_bits >= 0.05
        ],
    )
    if analysis.advice:
        _print(analysis.advice[0].sentence)
    if analysis.sequence:
        _print("Recommended sequence:")
    for number, advice in enumerate(analysis.sequence, 1):
        _print(f"{number}. {advice.how}: determines {', '.join(advice.frees) or 'no single parameter'}")


def _print(text: str) -> None:
    line(textwrap.fill(text, 80, subsequent_indent="  " if text[0] in "-123456789" else ""))
