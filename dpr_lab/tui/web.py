"""The screen as a page in a browser on this computer."""

import asyncio
import os
import secrets
import shlex
import signal
import sys
from asyncio.subprocess import PIPE, Process
from collections.abc import Sequence
from contextlib import suppress
from typing import Any

from dpr_lab.errors import ConfigError, LinkError
from dpr_lab.tui.terminal.signals import ENDING

HOST = "127.0.0.1"
NEEDS = "this option requires textual-serve: pip install 'dpr-lab[web]'"
HEADERS = {"Referrer-Policy": "no-referrer", "X-Frame-Options": "DENY", "Cache-Control": "no-store"}


def serve(command: Sequence[str], port: int) -> None:
    """Serve the screen to browsers on this computer until Ctrl-C.

    Each browser that opens the page runs the command.

    Other computers cannot reach the page. Other users of this computer can reach the port, so every address starts with
    a random token, which is only printed: `http://127.0.0.1:PORT/TOKEN/`. Requests without the token are answered with
    403. Requests from other pages in the same browser are refused. The page cannot load anything from other servers.

    Args:
        command: command that runs the screen
        port: port of the page

    Raises:
        ConfigError: the package textual-serve is not installed.
        LinkError: the port is already in use.
    """
    try:
        page = _page(command, port, secrets.token_urlsafe(32))
    except ImportError as error:
        raise ConfigError(NEEDS) from error
    try:
        page.serve()
    except OSError as error:
        place = f"http://{HOST}:{port}"
        raise LinkError(f"{place}: {error.strerror or error}: choose another port with --serve") from error


def policy(place: str) -> str:
    """Return the content security policy: the page loads only from this server."""
    return (
        f"default-src http://{place} 'unsafe-inline' 'unsafe-eval' data: blob:; connect-src http://{place}"
        f" ws://{place};"
        " frame-ancestors 'none'"
    )


def _page(command: Sequence[str], port: int, token: str) -> Any:
    """Create the server of the page.

    Raises:
        ImportError: textual-serve is not installed.
    """
    import logging

    from aiohttp import web  # pyright: ignore[reportMissingImports]
    from textual_serve.server import Server, to_int  # pyright: ignore[reportMissingImports]

    place, guard = f"{HOST}:{port}", _guard(f"{HOST}:{port}", token)
    may = "operate the device" if "--allow-release" in command else "see the screen, which is read-only"
    screen_type = _screen_type()

    async def keep_in(request: Any, response: Any) -> None:
        response.headers.update({"Content-Security-Policy": policy(place), **HEADERS})

    class Page(Server):
        def __init__(self) -> None:
            super().__init__(shlex.join(command), HOST, port, "dpr-lab")
            self.screens: dict[Any, Any] = {}

        async def _make_app(self) -> Any:
            app = await super()._make_app()
            app.add_subapp(f"/{token}", await super()._make_app())
            app.middlewares.append(guard)
            app.on_response_prepare.append(keep_in)
            app.on_startup.append(self.announce)
            return app

        async def on_startup(self, app: Any) -> None:
            """Do nothing: textual-serve calls this method for both apps, but only the outer app prints the address."""

        async def announce(self, app: Any) -> None:
            logging.getLogger("aiohttp.access").setLevel(logging.WARNING)  # the default logger would log the token
            print(
                f"open http://{place}/{token}/",
                f"anyone who has this address can {may}; Ctrl-C stops the server",
                sep="\n",
            )
            sys.stdout.flush()

        async def on_shutdown(self, app: Any) -> None:
            open_pages, self.screens = self.screens, {}
            closing = [websocket.close(code=1001, message=b"the server ends") for websocket in open_pages]
            ending = [screen.stop() for screen in open_pages.values()]
            await asyncio.gather(*closing, *ending, return_exceptions=True)

        async def handle_index(self, request: Any) -> Any:
            if request.path == "/":
                raise web.HTTPSeeOther(f"/{token}/")
            return await super().handle_index(request)

        async def handle_websocket(self, request: Any) -> Any:
            websocket = web.WebSocketResponse(heartbeat=15)
            await websocket.prepare(request)
            screen = screen_type(
                self.command,
                write_bytes=websocket.send_bytes,
                write_str=websocket.send_str,
                close=websocket.close,
                download_manager=self.download_manager,
            )
            self.screens[websocket] = screen
            try:
                size = (to_int(request.query.get(name, ""), least) for name, least in (("width", 80), ("height", 24)))
                await screen.start(*size)
                await self._process_messages(websocket, screen)
            except (ValueError, LookupError, TypeError, AssertionError):
                pass  # the request was not sent by this page
            finally:
                await screen.stop()
                self.screens.pop(websocket, None)
            return websocket

    return Page()


def _guard(place: str, token: str) -> Any:
    """Create the middleware that refuses requests of other pages and requests without the token.

    A request contains the token in its path or as a parameter.
    """
    from aiohttp import web  # pyright: ignore[reportMissingImports]

    @web.middleware
    async def guard(request: Any, handler: Any) -> Any:
        same_origin = request.host == place and request.headers.get("Origin", f"http://{place}") == f"http://{place}"
        shown = (request.query.get("token", ""), request.path.split("/")[1])
        if not same_origin or not any([secrets.compare_digest(word.encode(), token.encode()) for word in shown]):
            raise web.HTTPForbidden(text="open the address that dpr-lab tui --serve printed\n")
        return await handler(request)

    return guard


def _screen_type() -> type:
    from textual_serve.app_service import AppService  # pyright: ignore[reportMissingImports]

    class ServedScreen(AppService):
        """Screen in a process and session of its own, which ends within a limited time."""

        async def _open_app_process(self, width: int = 80, height: int = 24) -> Process:
            self._process = process = await asyncio.create_subprocess_exec(
                *shlex.split(self.command),
                stdin=PIPE,
                stdout=PIPE,
                stderr=PIPE,
                env=self._build_environment(width=width, height=height),
                start_new_session=True,  # Ctrl-C is for the server, which then ends the screens
            )
            self._stdin = process.stdin
            return process

        async def on_data(self, payload: bytes) -> None:
            with suppress(ConnectionError):  # the output must be read to its end, otherwise the screen would block
                await super().on_data(payload)

        async def on_meta(self, data: bytes) -> None:
            with suppress(ConnectionError):
                await super().on_meta(data)

        async def stop(self) -> None:
            process = self._process
            if process is None:
                return
            with suppress(TimeoutError):
                # A screen limits its own shutdown to `patience_s`.
                async with asyncio.timeout(ENDING.patience_s + 5.0):
                    await super().stop()
                    await process.wait()
            if process.returncode is None:
                with suppress(ProcessLookupError):
                    os.killpg(process.pid, signal.SIGKILL)
                await process.wait()

    return ServedScreen
