"""`dpr-lab certify` and `dpr-lab verify`: diagnoses that others can verify."""

import sys
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from dpr_lab.cli.checks import Json, RigName
from dpr_lab.cli.console import emit, line, table
from dpr_lab.cli.option_groups import DiagnosisChoices, with_groups

if TYPE_CHECKING:
    from dpr_lab.certificate.lines import Declared
    from dpr_lab.workflows.certify import Certified, VerifiedCertificate


@with_groups
def certify(
    *,
    runs: Annotated[list[Path], typer.Argument(help="Run files (.mcap).")],
    rig: RigName,
    choices: DiagnosisChoices,
    limits: Annotated[
        Path | None, typer.Option(help="Limits file of `accept`: also certify the result of each limit.")
    ] = None,
    sign: Annotated[
        Path | None,
        typer.Option(
            metavar="KEY",
            help="Sign with this Ed25519 private key (extra `signing`). ssh-keygen -t ed25519 creates a key.",
        ),
    ] = None,
    out: Annotated[Path, typer.Option(help="The certificate.")] = Path("certificate.json"),
    as_json: Annotated[bool, typer.Option("--json", help="Also print the certificate on stdout.")] = False,
) -> None:
    """Diagnose runs and write a certificate of the claims.

    The certificate contains all claims, all options, and the hashes of recordings, rig and code. `dpr-lab verify`
    repeats the diagnosis and compares each claim. docs/certificates.md explains what this proves.

    Example: dpr-lab certify runs/*.mcap --rig paper --out certificate.json
    """
    if choices.seed >= 1 << 63:
        raise typer.BadParameter("--seed must be below 2^63 in a certificate")
    from dpr_lab.cli.listener import Listener
    from dpr_lab.workflows.certify import certify as certify_runs

    request = choices.request(runs, rig)
    with Listener() as listener:
        certified = certify_runs(request, out, listener, sign, _ask_passphrase if sys.stdin.isatty() else None, limits)
    if as_json:
        emit(certified.certificate.model_dump(mode="json"))
        return
    _show_certified(certified)
    line(f"certificate: {out}")


def _ask_passphrase() -> str:
    return typer.prompt("Passphrase of the key", hide_input=True, err=True)


def _show_certified(made: "Certified") -> None:
    _show_declared("Choices", made.choices)
    _show_declared("Origin", made.origin)
    rows = [
        [name, _cell(required.claim.value), _interval(required.claim.interval90), _tolerance(required.within)]
        for name, required in made.claims.items()
    ]
    table("Certified", ["claim", "value", "90 % interval", "tolerance"], rows)


def verify(
    certificate: Annotated[
        Path, typer.Argument(help="Certificate file. The recordings must be at the paths that the certificate names.")
    ],
    signed_by: Annotated[
        Path | None,
        typer.Option(
            metavar="PUBKEY",
            help="Fail unless the certificate is signed with this Ed25519 public key (extra `signing`).",
        ),
    ] = None,
    other_code: Annotated[
        bool,
        typer.Option(
            "--other-code", help="Accept a certificate that was made with different code, such as an older version."
        ),
    ] = False,
    same_libraries: Annotated[
        bool,
        typer.Option(
            "--same-libraries", help="Fail unless the versions of Python, NumPy, SciPy and Numba match the certificate."
        ),
    ] = False,
    as_json: Json = False,
) -> None:
    """Repeat a certified diagnosis and compare every claim. The exit code is 1 if a claim does not hold.

    This program, not the file, defines which claims are compared and with which tolerances. A certificate that was made
    with different code fails unless --other-code is given. Repeating the diagnosis cannot confirm its options and its
    origin, so they are shown first.

    Example: dpr-lab verify certificate.json
    """
    from dpr_lab.cli.listener import Listener
    from dpr_lab.workflows.certify import verify as verify_certificate

    with Listener() as listener:
        verification = verify_certificate(
            certificate, listener, signed_by, other_code=other_code, same_libraries=same_libraries
        )
    if as_json:
        from dataclasses import asdict

        emit({"schema": 2, "holds": verification.holds, **asdict(verification)})
    else:
        _show_verified(verification)
    if not verification.holds:
        raise typer.Exit(1)


def _show_verified(done: "VerifiedCertificate") -> None:
    _show_declared("Choices: declared, not verified", done.choices)
    _show_declared("Origin: declared by the certificate", done.origin)
    files, claims = [], []
    for checked in done.lines:
        cells = [checked.claim, _cell(checked.certified), _cell(checked.now)]
        held = ": ".join(filter(None, ("holds" if checked.holds else "FAILS", checked.reason)))
        if checked.within is None:
            files.append([*cells, held])
        else:
            claims.append([*cells, _tolerance(checked.within), held])
    table("Files and signature", ["item", "certified", "now", "result"], files)
    if claims:
        table("Claims", ["claim", "certified", "now", "tolerance", "result"], claims)
    broken = [checked.claim for checked in done.lines if not checked.holds]
    if broken:
        line(f"Not confirmed: {', '.join(broken)}.")
        return
    departures = [choice.name for choice in done.choices if choice.note]
    line(
        "Every claim is confirmed with the choices above."
        if departures
        else "Every claim is confirmed with the default choices."
    )
    if departures:
        line(f"Choices that are not the default: {', '.join(departures)}.")
    if done.names_other_code:
        line("The certificate was made with different code. Its claims were verified with the installed code.")


def _show_declared(title: str, declared: "Sequence[Declared]") -> None:
    table(title, ["item", "value", "note"], [[entry.name, entry.value, entry.note] for entry in declared])


def _interval(ends: tuple[float, float] | None) -> str:
    return "" if ends is None else f"{ends[0]:.5g} to {ends[1]:.5g}"


def _tolerance(within: float) -> str:
    return f"{within:.2g}" if within else "equal"


def _cell(value: Any) -> str:
    """Format a certified value for a table.

    Equal entries of a list, such as several outliers in one recording, are printed once with their count.
    """
    from dpr_lab.report.gap.summary import BASIS

    words = BASIS | {"held-out runs": "held-out runs or pieces of a run"}  # a claim does not distinguish these two
    if not isinstance(value, str):
        return "" if value is None else f"{value:.5g}"
    counts = Counter(words.get(value, value).split(", "))
    return ", ".join(f"{count} x {entry}" if count > 1 else entry for entry, count in counts.items())
