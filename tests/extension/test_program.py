"""A new transport, search algorithm, command or screen requires one file and one table entry."""

import pytest

from tests.extension.conftest import Copy, outputs

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def printed(copy: Copy) -> dict[str, str]:
    """Output of the program of each extension."""
    extensions = {
        "transport": transport,
        "search": search,
        "command": command,
        "help": lambda _: DPR_LAB.format(["--help"]),
    }
    return outputs(copy, extensions)


DPR_LAB = "import sys; sys.argv = ['dpr-lab', *{}]; from dpr_lab.cli import main; main()"


def transport(copy: Copy) -> str:
    copy.add(
        "dpr_lab/transports/loopback.py",
        '''
        """A link to itself: what is sent comes back."""

        import time

        from dpr_lab.transports.transport import Received


        class Loopback:
            def __init__(self, url):
                self.url, self.capacities, self._frames, self.errors = url, (), [], {"crc": 0, "framing": 0}

            def send(self, frame):
                self._frames.append(frame)

            def receive(self, timeout):
                frames, self._frames = tuple(self._frames), []
                return Received(time.monotonic(), frames, b"")

            def close(self):
                self._frames = []


        def open_loopback(url, rig_file):
            return Loopback(url.text)
        ''',
    )
    row = '"loop": LinkKind("loopback", "dpr_lab.transports.loopback:open_loopback", "loop://here")'
    copy.row("dpr_lab/transports/__init__.py", "TRANSPORTS", row)
    return """
        from dpr_lab.transports import open_transport
        from firmware_protocol.messages import Frame

        link = open_transport("loop://here")
        link.send(Frame(0x123, b"abc"))
        print(link.url, [bytes(frame.data) for frame in link.receive(0.1).frames])
        """


def test_a_transport_is_a_file_and_a_row(printed: dict[str, str]) -> None:
    assert printed["transport"] == "loop://here [b'abc']\n"


def search(copy: Copy) -> str:
    copy.add(
        "dpr_lab/search/random_search.py",
        '''
        """Random search: keep the best of what chance proposes."""

        from typing import Literal

        from dpr_lab.search.population import merged, ranked
        from dpr_lab.search.settings import SearchSettings


        class RandomSearchSettings(SearchSettings, frozen=True):
            algorithm: Literal["random_search"] = "random_search"
            population: int = 50


        def random_search(problem, settings, rng):
            population = None
            while True:
                genes = rng.uniform(*problem.box, (settings.population, problem.box.shape[1]))
                drawn = ranked(genes, problem.costs(genes))
                population = drawn if population is None else merged(population, drawn).best(settings.population)
                yield population
        ''',
    )
    copy.row(
        "dpr_lab/search/__init__.py",
        "ALGORITHMS",
        '"random_search": Algorithm(RandomSearchSettings, random_search, "random search")',
        "from dpr_lab.search.random_search import RandomSearchSettings, random_search",
    )
    (copy.folder / "settings.toml").write_text('algorithm = "random_search"\ngenerations = 20\n', encoding="utf-8")
    return """
        import numpy as np
        from dpr_lab.search import ALGORITHMS, load_search

        settings = load_search("settings.toml")
        bounds = np.array([[-1.0, -1.0], [1.0, 1.0]])
        sphere = lambda Z: (Z**2).sum(axis=1, keepdims=True)
        found = list(ALGORITHMS[settings.algorithm].run(sphere, bounds, settings, np.random.default_rng(1)))
        print(len(found), found[-1].best_cost < 0.01 < found[0].best_cost or found[-1].best_cost < 1e-3)
        """


def test_a_search_algorithm_is_a_file_and_a_row(printed: dict[str, str]) -> None:
    assert printed["search"] == "21 True\n"


def command(copy: Copy) -> str:
    copy.add(
        "dpr_lab/cli/weigh.py",
        '''
        """`dpr-lab weigh`: what the rig file says of the masses."""

        import typer

        from dpr_lab.cli.console import emit


        def weigh(rig: str = typer.Option(help="Rig file, or the name of a built-in one.")) -> None:
            """Say what the parts of a rig weigh."""
            from dpr_lab.rig import MASSES, load_rig

            emit({name: load_rig(rig).parameters[name].nominal for name in MASSES})
        ''',
    )
    copy.row("dpr_lab/cli/app.py", "COMMANDS", '"weigh": "weigh:weigh"')
    return DPR_LAB.format(["weigh", "--rig", "paper"])


def test_a_command_is_a_file_and_a_row(printed: dict[str, str]) -> None:
    assert "Say what the parts of a rig weigh." in printed["help"]
    assert '"m1": 0.1' in printed["command"]
    assert "exit code" not in printed["command"] + printed["help"]


def test_the_screen_of_a_command_is_a_file_and_a_row(copy: Copy) -> None:
    copy.add(
        "dpr_lab/tui/steps/weigh.py",
        '''
        """The step that shows what the parts of the rig weigh."""

        from textual.app import ComposeResult
        from textual.widgets import Static

        from dpr_lab.rig import MASSES, load_rig
        from dpr_lab.tui.steps.step import Step


        class WeighStep(Step):
            NAME = "Weigh"
            HELP = "What the parts of the rig weigh."

            def compose(self) -> ComposeResult:
                yield Static(id="masses")

            def enter(self) -> None:
                rig = load_rig(self.workspace.rig)
                self.query_one("#masses", Static).update(str([rig.parameters[name].nominal for name in MASSES]))
        ''',
    )
    copy.row("dpr_lab/tui/app.py", "STEPS", "WeighStep", "from dpr_lab.tui.steps.weigh import WeighStep")
    result = copy.run(
        """
        import asyncio
        from pathlib import Path
        from textual.widgets import Static
        from dpr_lab.tui.app import STEPS, DprApp
        from dpr_lab.tui.workspace import Workspace

        async def main():
            app = DprApp(Workspace(), Path("state"))
            async with app.run_test() as pilot:
                await pilot.press(str(len(STEPS)))
                await pilot.pause()
                print(app.current.NAME, app.current.query_one("#masses", Static).content)

        asyncio.run(main())
        """
    )
    assert result == "Weigh [0.1, 0.1, 0.208]\n"
