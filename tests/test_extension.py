"""What it takes to add one of each: a file and a row of its table, tried on a copy of the packages."""

import ast
import json
import os
import shutil
import subprocess
import sys
import textwrap
from pathlib import Path

import pytest

from tests.a_diagnosis import made

ROOT = Path(__file__).parents[1]


class Copy:
    """The packages in a folder of their own, to be extended and run."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        for name in ("dpr_lab", "firmware_protocol", "sim_device", "configs"):
            shutil.copytree(ROOT / name, folder / name, ignore=shutil.ignore_patterns("__pycache__"))

    def add(self, file: str, text: str) -> None:
        """A new file."""
        path = self.folder / file
        assert not path.exists(), f"{file} is there already"
        path.write_text(textwrap.dedent(text), encoding="utf-8")

    def row(self, file: str, table: str, row: str, imported: str = "") -> None:
        """One more row at the end of a table, and the import that it needs."""
        path = self.folder / file
        text = path.read_text(encoding="utf-8")
        tree = ast.parse(text)
        rows = table_of(tree, table)
        assert rows.end_lineno is not None
        assert rows.end_col_offset is not None
        lines = text.splitlines(keepends=True)
        end = sum(map(len, lines[: rows.end_lineno - 1])) + rows.end_col_offset - 1
        before = text[:end].rstrip()
        text = f"{before}{'' if before.endswith(',') else ','} {row},{text[end:]}"
        last = max(node.end_lineno or 0 for node in tree.body if isinstance(node, ast.Import | ast.ImportFrom))
        lines = text.splitlines(keepends=True)
        path.write_text("".join([*lines[:last], f"{imported}\n" if imported else "", *lines[last:]]), encoding="utf-8")

    def run(self, code: str, timeout: float = 600.0, *, cache: bool = False) -> str:
        """What a program prints that works with this copy; `cache`: its kernels are others, and kept beside it."""
        program = textwrap.dedent(code)
        environment = {**os.environ, "PYTHONPATH": str(self.folder)}
        environment |= {"NUMBA_CACHE_DIR": str(self.folder / "cache")} if cache else {}
        done = subprocess.run(
            [sys.executable, "-c", program],
            cwd=self.folder,
            env=environment,
            capture_output=True,
            text=True,
            timeout=timeout,
        )
        assert done.returncode == 0, done.stderr
        return done.stdout


def table_of(tree: ast.Module, name: str) -> ast.Tuple | ast.Dict:
    """The rows of a module-level table: a tuple or a dict, perhaps inside the expression that makes it."""
    for node in tree.body:
        targets = node.targets if isinstance(node, ast.Assign) else [getattr(node, "target", None)]
        if any(isinstance(target, ast.Name) and target.id == name for target in targets):
            value = node.iter if isinstance(node, ast.For) else getattr(node, "value", None)
            assert isinstance(value, ast.AST)
            return next(part for part in ast.walk(value) if isinstance(part, ast.Tuple | ast.Dict))
    raise AssertionError(f"no table {name}")


@pytest.fixture
def copy(tmp_path: Path) -> Copy:
    return Copy(tmp_path)


def test_a_transport_is_a_file_and_a_row(copy: Copy) -> None:
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
    said = copy.run(
        """
        from dpr_lab.transports import open_transport
        from firmware_protocol.messages import Frame

        link = open_transport("loop://here")
        link.send(Frame(0x123, b"abc"))
        print(link.url, [bytes(frame.data) for frame in link.receive(0.1).frames])
        """
    )
    assert said == "loop://here [b'abc']\n"


def test_a_search_algorithm_is_a_file_and_a_row(copy: Copy) -> None:
    copy.add(
        "dpr_lab/search/random_search.py",
        '''
        """Random search: keep the best of what chance proposes."""

        from functools import partial
        from typing import Literal

        from dpr_lab.search.fitness import cost
        from dpr_lab.search.generations import generations
        from dpr_lab.search.population import merged, ranked
        from dpr_lab.search.problem import SearchProblem
        from dpr_lab.search.settings import SearchSettings


        class RandomSearchSettings(SearchSettings, frozen=True):
            algorithm: Literal["random_search"] = "random_search"
            population: int = 50


        def random_search(objective, bounds, settings, rng):
            problem = SearchProblem(objective, bounds, partial(cost, aggregate=settings.aggregate))
            return generations(problem, _populations(problem, settings, rng), settings)


        def _populations(problem, settings, rng):
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
    said = copy.run(
        """
        import numpy as np
        from dpr_lab.search import ALGORITHMS, load_search

        settings = load_search("settings.toml")
        bounds = np.array([[-1.0, -1.0], [1.0, 1.0]])
        sphere = lambda Z: (Z**2).sum(axis=1, keepdims=True)
        found = list(ALGORITHMS[settings.algorithm].run(sphere, bounds, settings, np.random.default_rng(1)))
        print(len(found), found[-1].best_cost < 0.01 < found[0].best_cost or found[-1].best_cost < 1e-3)
        """
    )
    assert said == "21 True\n"


def test_a_verb_is_a_file_and_a_row(copy: Copy) -> None:
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
    copy.row("dpr_lab/cli/app.py", "command", "weigh", "from dpr_lab.cli.weigh import weigh")
    shell = "import sys; sys.argv = ['dpr-lab', *{}]; from dpr_lab.cli import main; main()"
    assert "Say what the parts of a rig weigh." in copy.run(shell.format(["--help"]))
    assert '"m1": 0.1' in copy.run(shell.format(["weigh", "--rig", "paper"]))


@pytest.mark.slow
def test_the_screen_of_a_verb_is_a_file_and_a_row(copy: Copy) -> None:
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
    said = copy.run(
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
    assert said == "Weigh [0.1, 0.1, 0.208]\n"


@pytest.mark.long
def test_an_effect_with_memory_or_a_continuous_shape_is_a_file_and_a_row(copy: Copy) -> None:
    copy.add(
        "dpr_lab/effects/cable.py",
        '''
        """A cable across joint 2 that springs back, and slips beyond a stretch."""

        from dpr_lab.effects.effect import Effect, EffectParameter, InternalState, shape
        from dpr_lab.effects.quantities import Joint
        from dpr_lab.kernels import njit


        @njit
        def stretched(stretch: float, displacement: float, slip_rad: float) -> float:
            return min(max(stretch + displacement, -slip_rad), slip_rad)


        @njit
        def cable(joint: Joint, stretch: float, stiffness_Nm_per_rad: float, slip_rad: float) -> float:
            return -stiffness_Nm_per_rad * stretched(stretch, joint.displacement, slip_rad)


        CABLE_JOINT2 = Effect(
            name="cable_joint2",
            words="cable that slips, joint 2",
            equation="tau = -k z, z follows the angle of joint 2 and stays within +-slip",
            parameters=(
                EffectParameter("stiffness_Nm_per_rad", "N m/rad", 5e-3, "positive"),
                shape("slip_rad", "rad", 0.5, (0.2, 0.5, 1.0), continuous=True),
            ),
            site="joint torque",
            stage="torque",
            kernel=cable,
            joints=(1,),
            internal=(InternalState("stretch", "rad", after=stretched),),
            dissipative=True,
            bench_check="Take the cable off.",
            source="Prandtl (1928), Z. angew. Math. Mech. 8, 85-106.",
        )
        ''',
    )
    copy.row("dpr_lab/effects/__init__.py", "EFFECTS", "CABLE_JOINT2", "from dpr_lab.effects.cable import CABLE_JOINT2")
    copy.add(
        "dpr_lab/effects/magnet.py",
        '''
        """A magnet near the hanging position of the inner rod."""

        import math

        from dpr_lab.effects.effect import Effect, EffectParameter, shape
        from dpr_lab.effects.quantities import Joint
        from dpr_lab.kernels import njit


        @njit
        def pull(joint: Joint, torque_Nm: float, width_rad: float) -> float:
            x = math.sin(joint.angle) / width_rad
            return -torque_Nm * x * math.exp(-x * x)


        MAGNET_JOINT1 = Effect(
            name="magnet_joint1",
            words="magnet, joint 1",
            equation="tau = -T x exp(-x^2), x = sin(q1) / width",
            parameters=(
                EffectParameter("torque_Nm", "N m", 1e-2, "any"),
                shape("width_rad", "rad", 0.3, (0.1, 0.3, 0.6), continuous=True),
            ),
            site="joint torque",
            stage="torque",
            kernel=pull,
            joints=(0,),
            potential=True,
            bench_check="Look for iron below the rig.",
            source="A dipole's field falls with distance.",
        )
        ''',
    )
    copy.row(
        "dpr_lab/effects/__init__.py", "EFFECTS", "MAGNET_JOINT1", "from dpr_lab.effects.magnet import MAGNET_JOINT1"
    )
    said = copy.run(
        """
        import numpy as np
        from dpr_lab.effects import EFFECTS
        from dpr_lab.gap.diagnose import diagnose
        from dpr_lab.rig import load_rig
        from sim_device.plant.config import load_plant
        from sim_device.trials.offline_recorder import record
        from sim_device.trials.parameters import weighed

        plant, rig = weighed(load_plant("paper", 5), load_rig("paper"))
        bare = record(plant, rig, duration=4.0)
        library = {name: EFFECTS[name] for name in ("cable_joint2", "magnet_joint1")}
        values = {
            "cable_joint2": {"stiffness_Nm_per_rad": 0.02, "slip_rad": 0.3},
            "magnet_joint1": {"torque_Nm": 0.04, "width_rad": 0.4},
        }
        for name in library:
            runs = record(plant.model_copy(update={"effects": {name: values[name]}}), rig, duration=4.0)
            moved = any(not np.array_equal(one.counts, other.counts) for one, other in zip(runs, bare))
            found = diagnose(runs, rig, library=library, max_effects=1)
            fitted = found.effects[0].parameters
            close = all(abs(fitted[p].value / value - 1) < 0.2 for p, value in values[name].items())
            print(name, moved, found.verdict, [effect.name for effect in found.effects], close)
        """,
        timeout=580.0,
        cache=True,
    )
    assert said == "".join(f"{name} True named ['{name}'] True\n" for name in ("cable_joint2", "magnet_joint1"))


def test_an_export_format_is_a_file_and_a_row(copy: Copy) -> None:
    copy.add(
        "dpr_lab/exports/parameter_list.py",
        '''
        """The parameters of the corrected model, one line each."""


        def parameter_list(model, rig, lost):
            return {"parameters.txt": "".join(f"{name} {p.value!r}\\n" for name, p in model.parameters.items())}
        ''',
    )
    copy.row(
        "dpr_lab/exports/__init__.py",
        "FORMATS",
        '"list": ExportFormat("parameter list", "parameters.txt", parameter_list, in_python)',
        "from dpr_lab.exports.parameter_list import parameter_list",
    )
    printed = copy.run(
        """
        from dpr_lab.cli.checks import EXPORT_NAMES
        from dpr_lab.exports import FORMATS
        from dpr_lab.identification.model import Model, ParameterValue
        from dpr_lab.rig import load_rig

        values = {"m1": ParameterValue(value=0.1, std=None, fixed_by="measured")}
        model = Model.model_construct(parameters=values, effects={})
        print(EXPORT_NAMES.check("parameter list"), FORMATS["list"].written(model, load_rig("paper")))
        """
    )
    assert printed == "list {'parameters.txt': 'm1 0.1\\n'}\n"


def test_a_kind_of_check_is_a_file_and_a_row(copy: Copy) -> None:
    copy.add(
        "dpr_lab/gap/advice/observation.py",
        '''
        """A yes or a no as a check: whether the swing sounds different."""

        import math

        from dpr_lab.errors import RunError
        from dpr_lab.gap.advice.check_kind import Result
        from dpr_lab.gap.advice.next_step import NextStep
        from dpr_lab.gap.result.checks import NONE_OF_THEM


        def form(check):
            return "--value yes or --value no"


        def propose(question, proposed):
            check = question.check("observation", "Listen to the joints.", question.causes, 0.5)
            return [NextStep(check.text, (check,))]


        def result(diagnosis, check, answer, prior):
            if answer.value not in ("yes", "no"):
                raise RunError(f"check {check.id}: give {form(check)}, not {answer.value!r}")
            densities = {name: 0.01 for name in (*prior, NONE_OF_THEM)} | {check.about: 0.99}
            return Result(answer.value, {name: math.log(density) for name, density in densities.items()})
        ''',
    )
    copy.row(
        "dpr_lab/gap/advice/advise.py",
        "CHECK_KINDS",
        '"observation": CheckKind(frozenset({"value"}), observation.form, observation.propose, observation.result)',
        "from dpr_lab.gap.advice import observation",
    )
    diagnosis = made().to_json()
    diagnosis["checks"][0]["kind"] = "observation"
    (copy.folder / "diagnosis.json").write_text(json.dumps(diagnosis), encoding="utf-8")
    printed = copy.run(
        """
        from pathlib import Path
        from dpr_lab.errors import RunError
        from dpr_lab.workflows.check import CheckRequest, take_check

        done = take_check(CheckRequest(Path("diagnosis.json"), "1-abcd", value="yes")).checks_done[0]
        print(done.result, done.after[done.check.about] > 0.9 > done.before[done.check.about])
        try:
            take_check(CheckRequest(Path("diagnosis.json"), "1-abcd", value="1 mm", std="1"))
        except RunError as error:
            print(error)
        """
    )
    assert printed.startswith("yes True\n")
    assert "give its result, --value yes or --value no" in printed


def test_a_kind_of_file_to_import_is_a_file_and_a_row(copy: Copy) -> None:
    copy.add(
        "dpr_lab/storage/readers/reversed_text.py",
        '''
        """Numbers written from the right to the left."""

        import numpy as np

        from dpr_lab.storage.readers.arrays import table_of


        def read_reversed(path, take):
            rows = [line[::-1].split() for line in path.read_text().splitlines()[1:]]
            values = zip(("t", "theta1", "theta2"), np.array(rows, dtype=float).T)
            return table_of(path, "reversed text", dict(values), take)
        ''',
    )
    copy.row(
        "dpr_lab/storage/readers/__init__.py",
        "READERS",
        'Reader("reversed text", (b"REVERSED",), read_reversed)',
        "from dpr_lab.storage.readers.reversed_text import read_reversed",
    )
    said = copy.run(
        """
        from pathlib import Path
        from dpr_lab.rig import load_rig
        from dpr_lab.storage.csv_import import ImportOptions
        from dpr_lab.storage.tables.preview import preview
        lines = [f"{k / 100} {3 + k / 200} {3 + k / 100}"[::-1] for k in range(50)]
        (file := Path("a.rev")).write_text("\\n".join(["REVERSED", *lines]))
        found = preview(file, load_rig("paper"), ImportOptions())
        print(found.kind, found.samples, found.rate_hz, found.theta[-1, 2])
        """
    )
    assert said == "reversed text 50 100.0 3.49\n"
