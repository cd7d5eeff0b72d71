"""`dpr-lab effects`: the effects that `diagnose` can name, including those of plugins."""

from typing import TYPE_CHECKING, Annotated, Any

import typer

from dpr_lab.cli.checks import EFFECT_NAMES, AnyJson, Json
from dpr_lab.cli.console import emit, line, table
from dpr_lab.cli.listing import Listing

if TYPE_CHECKING:
    from dpr_lab.effects.effect import Effect


class EffectCommands(Listing):
    """Command group `dpr-lab effects`.

    If the user gives the name of an effect instead of a command, the error message suggests the command `show`.
    """

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        """Find the command.

        Raises:
            BadParameter: no command has this name.
        """
        if args[0] not in self.list_commands(ctx):
            raise typer.BadParameter(
                f"no command {args[0]!r}. To describe an effect of this name: {ctx.command_path} show {args[0]}", ctx
            )
        return super().resolve_command(ctx, args)


app = typer.Typer(
    help="""List and describe the effects that a diagnosis can name.

    Example: dpr-lab effects list
    """,
    cls=EffectCommands,
    no_args_is_help=True,
)


@app.command("list")
def list_effects(
    as_json: AnyJson = False,
) -> None:
    """List the effects with their equations and the packages that contain them.

    Example: dpr-lab effects list
    """
    from dpr_lab.effects import EFFECTS

    if as_json:
        emit([_described(effect) for effect in EFFECTS.values()])
        return
    rows = [(name, effect.words, effect.equation, _package(name)) for name, effect in EFFECTS.items()]
    table("Effects", ("effect", "name", "equation", "package"), rows)


@app.command("show")
def show_effect(
    name: Annotated[
        str,
        typer.Argument(
            help="Identifier or name of an effect.", callback=EFFECT_NAMES.check, autocompletion=EFFECT_NAMES.complete
        ),
    ],
    as_json: Json = False,
) -> None:
    """Describe one effect: equation, parameters with units and limits, bench check and source.

    Example: dpr-lab effects show coulomb_joint2
    """
    from dpr_lab.effects import EFFECTS

    described = _described(EFFECTS[name])
    if as_json:
        emit(described)
        return
    line(f"{described['words']} [{name}], {described['package']}")
    line(f"symptom: {described['symptom']}")
    line(f"equation: {described['equation']}")
    rows = [(p["name"], p["unit"], p["typical"], p["role"], p["limit"]) for p in described["parameters"]]
    table("Parameters", ("parameter", "unit", "typical", "role", "limit"), rows)
    line(f"check on the bench: {described['bench_check']}")
    line(f"source: {described['source']}")


def _package(name: str) -> str:
    from dpr_lab.plugins.rows import origin
    from dpr_lab.version import __version__

    plugin = origin("effects", name)
    return f"{plugin.package} {plugin.version}" if plugin else f"dpr-lab {__version__}"


def _described(effect: "Effect") -> dict[str, Any]:
    """Return the properties of an effect as JSON values."""
    from dpr_lab.effects.limits import limit_words

    parameters = [
        {
            "name": p.name,
            "unit": p.unit,
            "role": p.role,
            "typical": p.typical,
            "limit": limit_words(p) if p.role == "amplitude" else "",
        }
        for p in effect.parameters
    ]
    return {
        "name": effect.name,
        "words": effect.words,
        "package": _package(effect.name),
        "symptom": effect.symptom,
        "equation": effect.equation,
        "stage": effect.stage,
        "parameters": parameters,
        "indistinguishable_from": effect.twins,
        "bench_check": effect.bench_check,
        "source": effect.source,
    }
