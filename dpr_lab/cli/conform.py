"""`dpr-lab conform`: conformance test of a user's device."""

from contextlib import closing
from dataclasses import asdict
from typing import Annotated

import typer

from dpr_lab.cli.checks import Json
from dpr_lab.cli.console import emit, line, progress, table


def conform(
    link: Annotated[str, typer.Argument(help="Link to the device, e.g. serial:///dev/ttyACM0?baud=921600.")],
    rods_off: Annotated[
        bool, typer.Option("--rods-off", help="Confirm that no rods are mounted. The test opens the latch repeatedly.")
    ] = False,
    as_json: Json = False,
) -> None:
    """Test a device against the protocol.

    Every mandatory exchange is run and its timing is measured. The exit code is 1 if an exchange fails.

    Example: dpr-lab conform sim:// --rods-off
    """
    from dpr_lab.acquisition.conformance import ConformanceSettings, Conformity, conformity, refuse_with_rods
    from dpr_lab.cli.listener import Listener
    from dpr_lab.transports import open_transport
    from dpr_lab.transports.simulated import PATIENCE, compiles_first

    refuse_with_rods(rods_off)
    settings = ConformanceSettings(patience_s=PATIENCE.first_start_s) if compiles_first(link) else ConformanceSettings()
    exchanges: list[Conformity] = []
    with Listener(), closing(open_transport(link)) as opened, progress("conform", None) as bar:
        for exchange in conformity(opened, settings):
            exchanges.append(exchange)
            bar(None, exchange.what)
    failed = sum(not exchange.ok for exchange in exchanges)
    if as_json:
        # `said` is the key in earlier versions
        checks = [asdict(exchange) | {"said": exchange.message} for exchange in exchanges]
        emit({"link": link, "ok": not failed, "checks": checks})
    else:
        rows = [(exchange.what, "ok" if exchange.ok else "failed", exchange.message) for exchange in exchanges]
        table(f"Conformity of {link}", ("check", "state", "result"), rows)
        line(
            f"The device does not conform to the protocol: {failed} of {len(exchanges)} checks failed."
            if failed
            else f"The device conforms to the protocol: all {len(exchanges)} checks passed."
        )
    if failed:
        raise typer.Exit(1)
