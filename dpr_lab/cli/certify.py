"""`dpr-lab certify` and `dpr-lab verify`: a diagnosis that others can check."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from dpr_lab.cli.checks import HeldOut, Library, RigName, names_in
from dpr_lab.cli.console import emit, json_mode, line, table

if TYPE_CHECKING:
    from dpr_lab.gap.result.certificate import Verified


def certify(
    runs: Annotated[list[Path], typer.Argument(help="Run files (.mcap).")],
    rig: RigName,
    held_out: HeldOut = None,
    library: Library = None,
    seed: Annotated[int, typer.Option(min=0, help="Same seed, same answer.")] = 0,
    out: Annotated[Path, typer.Option(help="The certificate.")] = Path("certificate.json"),
    as_json: Annotated[bool, typer.Option("--json", help="The certificate on stdout too.")] = False,
) -> None:
    """Diagnose runs and write a certificate: hashes of recordings, rig and code, and every claim with its tolerance.

    Example: dpr-lab certify runs/*.mcap --rig paper --out certificate.json
    """
    json_mode(as_json)
    from dpr_lab.cli.listener import Listener
    from dpr_lab.workflows.certify import certify as certify_runs
    from dpr_lab.workflows.diagnose import DiagnoseRequest

    request = DiagnoseRequest(tuple(runs), rig, tuple(held_out or ()), library=names_in(library), seed=seed)
    with Listener() as listener:
        made = certify_runs(request, out, listener)
    if as_json:
        emit(made.model_dump(by_alias=True))
        return
    table(
        "Certified",
        ["claim", "value", "within"],
        [[k, _said(c.value), _said(c.within)] for k, c in made.claims.items()],
    )
    line(f"certificate: {out}")


def verify(
    certificate: Annotated[Path, typer.Argument(help="A certificate, its recordings where it says.")],
    as_json: Annotated[bool, typer.Option("--json", help="One JSON object on stdout.")] = False,
) -> None:
    """Make a certified diagnosis again and say which claims hold; ends with 1 where one does not.

    Example: dpr-lab verify certificate.json
    """
    json_mode(as_json)
    from dataclasses import asdict

    from dpr_lab.cli.listener import Listener
    from dpr_lab.workflows.certify import verify as verify_certificate

    with Listener() as listener:
        lines = verify_certificate(certificate, listener)
    holds = all(item.holds for item in lines)
    if as_json:
        emit({"schema": 1, "holds": holds, "claims": [asdict(item) for item in lines]})
    else:
        rows = [[i.claim, _said(i.certified), _said(i.found), _held(i)] for i in lines]
        table("Verified", ["claim", "certified", "now", ""], rows)
        broken = [item.claim for item in lines if not item.holds]
        line("Every claim holds." if holds else f"Does not hold: {', '.join(broken)}.")
    if not holds:
        raise typer.Exit(1)


def _held(item: "Verified") -> str:
    return ": ".join(filter(None, ("holds" if item.holds else "", item.reason)))


def _said(value: Any) -> str:
    return "" if value is None else (f"{value:.5g}" if isinstance(value, float) else str(value))
