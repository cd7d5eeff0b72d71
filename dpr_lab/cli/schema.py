"""`dpr-lab schema`: JSON Schemas of the results."""

from typing import Annotated

import typer

from dpr_lab.cli.checks import Choices
from dpr_lab.cli.console import emit, table

SCHEMA_NAMES = Choices("schema", "dpr_lab.report.schemas:SCHEMAS")


def schema(
    name: Annotated[
        str | None,
        typer.Argument(
            help="Result: diagnosis, model, check, certificate, drift, accept or plan. Default: list the results.",
            callback=SCHEMA_NAMES.check,
            autocompletion=SCHEMA_NAMES.complete,
        ),
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print the list as JSON. A schema is always JSON.")] = False,
) -> None:
    """Print the JSON Schema (2020-12) of a result.

    Example: dpr-lab schema diagnosis > diagnosis.schema.json
    """
    from dpr_lab.report.schemas import SCHEMAS
    from dpr_lab.report.schemas import schema as schema_of

    if name is not None:
        emit(schema_of(name))
        return
    rows = [(key, published.version, published.printed_by) for key, published in SCHEMAS.items()]
    if as_json:
        emit([{"name": key, "version": version, "printed_by": command} for key, version, command in rows])
    else:
        table("Schemas of results", ("name", "version", "printed by"), rows)
