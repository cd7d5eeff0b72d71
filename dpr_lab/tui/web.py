"""The screen as a page for a browser on this computer."""

import shlex
from collections.abc import Sequence
from typing import Any

from dpr_lab.errors import ConfigError, LinkError

HOST = "127.0.0.1"
NEEDS = "a page needs textual-serve: pip install 'dpr-lab[web]'"


def serve(command: Sequence[str], port: int) -> None:
    """Run a command for every browser that opens the page, until Ctrl-C.

    Other computers cannot reach it; pages of other places that are open in the same browser are refused, and the page
    itself is not let fetch anything from anywhere else.

    Args:
        command: runs the screen
        port: of the page

    Raises:
        ConfigError: what serves it is not installed.
        LinkError: the port is taken.
    """
    try:
        from aiohttp import web  # pyright: ignore[reportMissingImports]
        from textual_serve.server import Server  # pyright: ignore[reportMissingImports]
    except ImportError as error:
        raise ConfigError(NEEDS) from error
    place = f"{HOST}:{port}"

    async def keep_in(request: Any, response: Any) -> None:
        response.headers["Content-Security-Policy"] = policy(place)

    @web.middleware
    async def refuse_others(request: Any, handler: Any) -> Any:
        if request.host != place or request.headers.get("Origin", f"http://{place}") != f"http://{place}":
            raise web.HTTPForbidden(text=f"open http://{place}")
        return await handler(request)

    class Page(Server):
        async def _make_app(self) -> Any:
            app = await super()._make_app()
            app.middlewares.append(refuse_others)
            app.on_response_prepare.append(keep_in)
            return app

    try:
        Page(shlex.join(command), HOST, port, "dpr-lab").serve()
    except OSError as error:
        raise LinkError(f"http://{place}: {error.strerror or error}: name another port with --serve") from error


def policy(place: str) -> str:
    """What a page may load: what this place serves."""
    return (
        f"default-src http://{place} 'unsafe-inline' 'unsafe-eval' data: blob:; connect-src http://{place} ws://{place}"
    )
