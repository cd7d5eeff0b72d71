"""Plugins: the template package, one row for each table, broken packages, and packages that are not installed."""

import importlib
import json
import os
import shutil
import subprocess
import sys
import sysconfig
import textwrap
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from dpr_lab import kernel_cache
from dpr_lab.certificate.code import made_with
from dpr_lab.effects import EFFECTS
from dpr_lab.plugins import fingerprint, installed

ROOT = Path(__file__).parents[1]
TEMPLATE = ROOT / "docs" / "examples" / "plugin"

Announce = Callable[..., Path]


@pytest.fixture
def announce(tmp_path: Path) -> Announce:
    """Write an installed package: its module and its entry points."""

    def write(name: str, code: str, folder: Path | None = None, version: str = "1.0", **entries: str) -> Path:
        folder = folder or tmp_path / "site"
        info = folder / f"{name}-{version}.dist-info"
        info.mkdir(parents=True, exist_ok=True)
        (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: {version}\n", encoding="utf-8")
        groups = "".join(f"[dpr_lab.{group}]\n{entry}\n" for group, entry in entries.items())
        (info / "entry_points.txt").write_text(groups, encoding="utf-8")
        (folder / f"{name}.py").write_text(textwrap.dedent(code), encoding="utf-8")
        return folder

    return write


def run(code: str, site: Path | None, cwd: Path | None = None) -> "subprocess.CompletedProcess[str]":
    """Run a program for which `site` is a folder of installed packages."""
    path = os.pathsep.join([str(ROOT), *([str(site)] if site else [])])
    environment = {**os.environ, "PYTHONPATH": path}
    done = subprocess.run(
        [sys.executable, "-c", textwrap.dedent(code)], cwd=cwd, env=environment, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    return done


OWN_READER = """
from dpr_lab.storage.readers import Reader

def read(path, take):
    return {}["speed"]

READER = Reader("bench log", (b"BENCH1",), read)
"""
COMMAND = "import sys; sys.argv = ['dpr-lab', *{!r}]; from dpr_lab.cli import main; main()"
LAW = (TEMPLATE / "src" / "dpr_lab_magnet.py").read_text(encoding="utf-8")


@pytest.mark.slow
def test_broken_plugins_are_named_and_skipped(announce: Announce) -> None:
    site = announce("raises", "raise RuntimeError('no licence')", effects="a = raises:LAW")
    announce("wrong", "LAW = 3", effects="a = wrong:LAW")
    announce("missing", "", effects="a = missing:LAW")
    announce("taken", LAW.replace("magnet_joint{j}", "coulomb_joint{j}"), effects="a = taken:MAGNETS")
    announce("asks", LAW.replace("joint: Joint", "velocity: Joint"), effects="a = asks:MAGNETS")
    announce("units", LAW.replace('"N m s/rad"', '"furlong"'), effects="a = units:MAGNETS")
    announce("circle", LAW.replace("dpr_lab.kernels", "dpr_lab.effects.effect_kernels"), effects="a = circle:MAGNETS")
    broken_kernels = {
        "typo": ("joint.speed", "joint.sped"),
        "prints": ("    return -damp", "    open('file')\n    return -damp"),
        "half": ("    return -damp", "    if joint.angle > 0.0:\n        return -damp"),
    }
    for name, (before, after) in broken_kernels.items():
        law = LAW.replace("magnet_joint{j}", f"{name}_joint{{j}}").replace(before, after)
        announce(name, law, effects=f"a = {name}:MAGNETS")
    announce("right", LAW, effects="a = right:MAGNETS")
    done = run(COMMAND.format(["effects", "list", "--json"]), site)
    names = {effect["name"]: effect["package"] for effect in json.loads(done.stdout)}
    assert len(names) == len(EFFECTS) + 2
    assert names["magnet_joint2"] == "right 1.0"
    reasons = {line.split(" of ")[1].split(" ")[0]: line for line in done.stderr.splitlines()}
    assert "no licence" in reasons["raises"]
    assert "wrong:LAW is not Effect" in reasons["wrong"]
    assert "LAW" in reasons["missing"]
    assert "'coulomb_joint1' exists already" in reasons["taken"]
    assert "the kernel needs velocity" in reasons["asks"]
    assert "no limit for 'furlong'" in reasons["units"]
    line = LAW.splitlines().index("from dpr_lab.kernels import inlined") + 1
    assert f"circle.py, line {line} imports a module that needs the table of effects" in reasons["circle"]
    line = LAW.splitlines().index(next(line for line in LAW.splitlines() if "joint.speed" in line)) + 1
    assert f"typo.py, line {line}: the kernel magnet cannot be compiled: Unknown attribute 'sped'" in reasons["typo"]
    assert f"prints.py, line {line}: the kernel magnet cannot be compiled" in reasons["prints"]
    assert "must return a number on every path" in reasons["half"]
    assert "Traceback" not in done.stderr
    assert "right" not in reasons


@pytest.mark.slow
def test_no_plugins_turns_them_off(
    forget_plugins: Callable[[], None], announce: Announce, monkeypatch: pytest.MonkeyPatch
) -> None:
    site = announce("right", LAW, effects="a = right:MAGNETS")
    monkeypatch.syspath_prepend(site)
    forget_plugins()
    assert "right 1.0" in installed.packages()
    monkeypatch.setenv("DPR_LAB_NO_PLUGINS", "1")
    assert installed.announced() == ()
    monkeypatch.delenv("DPR_LAB_NO_PLUGINS")
    listed = run(COMMAND.format(["--no-plugins", "effects", "list", "--json"]), site)
    assert len(json.loads(listed.stdout)) == len(EFFECTS)


@pytest.mark.slow
@pytest.mark.parametrize("installed", [pytest.param(False, marks=pytest.mark.long), True])
def test_nothing_is_loaded_from_the_current_folder(announce: Announce, tmp_path: Path, installed: bool) -> None:
    entries = {"effects": "a = right:MAGNETS", "readers": "b = right:READER"}
    site = announce("right", LAW + OWN_READER, **entries) if installed else None
    here = tmp_path / "here"
    announce("right", "open('loaded', 'w')", folder=here, **entries)
    done = run("from dpr_lab.storage.readers import READERS; print(READERS[-1].kind)", site, cwd=here)
    assert (done.stdout == "bench log\n") is installed
    module = [sys.executable, "-m", "dpr_lab", "effects", "list", "--json"]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(ROOT), *([str(site)] if site else [])])}
    listed = subprocess.run(module, cwd=here, env=environment, check=True, capture_output=True, text=True)
    assert ("magnet_joint1" in listed.stdout) is installed
    assert not (here / "loaded").exists()


@pytest.fixture
def forget_plugins() -> Iterator[Callable[[], None]]:
    """Search for plugins again, as a new process does."""

    def forget() -> None:
        importlib.invalidate_caches()
        installed._installed.cache_clear()
        fingerprint._source_hash.cache_clear()

    yield forget
    forget()


def test_the_cache_of_kernels_and_the_certificate_know_plugins(
    forget_plugins: Callable[[], None], announce: Announce, monkeypatch: pytest.MonkeyPatch
) -> None:
    package = Path(kernel_cache.__file__).parent

    def names() -> list[str]:
        forget_plugins()
        return [kernel_cache.cache_name(package), made_with()["code"], made_with()["dpr_lab"]]

    none = names()
    assert none[0] == kernel_cache.source_hash(package)
    site = announce("right", LAW, effects="a = right:MAGNETS")
    monkeypatch.syspath_prepend(site)
    first = names()
    assert first[2].endswith(", right 1.0")
    announce("right", LAW.replace("- 1.0)", "- 1.5)"), effects="a = right:MAGNETS")
    edited = names()
    shutil.rmtree(site)
    announce("right", LAW, version="1.1", effects="a = right:MAGNETS")
    updated = names()
    assert updated[2].endswith(", right 1.1")
    for answers in list(zip(none, first, edited, updated, strict=True))[:2]:
        assert len(set(answers)) == 4


@pytest.mark.slow
def test_readers_links_searches_and_formats_are_loaded_and_a_failure_is_named_with_file_and_line(
    announce: Announce, tmp_path: Path
) -> None:
    site = announce(
        "own_format",
        """
        from dpr_lab.exports import ExportFormat
        from dpr_lab.exports.programs import in_python

        FORMAT = ExportFormat("list", "list.txt", lambda model, rig, lost: {"list.txt": rig.name}, in_python)
        """,
        exports="list = own_format:FORMAT",
    )
    announce("own_reader", OWN_READER, readers="bench = own_reader:READER")
    announce(
        "own_link",
        """
        from dpr_lab.transports import LinkKind

        LINK = LinkKind("loopback", "own_link:open_link", "loop://here")

        def open_link(url, rig_file):
            return url.scheme
        """,
        transports="loop = own_link:LINK",
    )
    announce(
        "own_search",
        """
        from dpr_lab.search.algorithm import Algorithm
        from dpr_lab.search.plain_ga import PlainGaSettings, plain_ga

        SEARCH = Algorithm(PlainGaSettings, plain_ga, "mine")
        """,
        searches="mine = own_search:SEARCH",
    )
    (tmp_path / "swing.log").write_bytes(b"BENCH1")
    code = f"""
    from dpr_lab.exports import FORMATS
    from dpr_lab.plugins.rows import skipped
    from dpr_lab.search import ALGORITHMS
    from dpr_lab.storage.readers import READERS
    from dpr_lab.transports import open_transport
    print(skipped())
    print("list" in FORMATS, READERS[-1].kind, ALGORITHMS["mine"].words, open_transport("loop://here"))
    try:
        {COMMAND.format(["import", "table", "swing.log", "--rig", "paper"])}
    except SystemExit as ended:
        print(ended.code)
    """
    done = run(code, site, cwd=tmp_path)
    assert done.stdout == "()\nTrue bench log mine loop\n70\n"
    reason = "plugin own_reader 1.0 failed (own_reader.py, line 5): KeyError: 'speed': update or remove it"
    assert reason in done.stderr
    assert "Traceback" not in done.stderr


def test_the_help_of_a_command_lists_the_plugins_that_extend_it(announce: Announce) -> None:
    """Without importing them: this one cannot be imported."""
    site = announce("own", "raise RuntimeError", exports="list = own:FORMAT")
    code = """
    from dpr_lab.cli.app import app
    for words in (["export"], ["identify"], ["--no-plugins", "export"]):
        app([*words, "--help"], prog_name="dpr-lab", standalone_mode=False)
        print("END")
    """
    export, identify, without = run(code, site).stdout.split("END\n")[:3]
    assert export.endswith("\nFormats of plugins:\n  list  own 1.0\n")
    assert "own 1.0" not in identify + without


@pytest.fixture(scope="module")
def environment(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """New environment with the template package, installed by pip without a network."""
    folder = tmp_path_factory.mktemp("environment")
    subprocess.run([sys.executable, "-m", "venv", "--system-site-packages", "--without-pip", str(folder)], check=True)
    python = str(folder / "bin" / "python")
    shown = [python, "-c", "import sysconfig; print(sysconfig.get_paths()['purelib'])"]
    site = Path(subprocess.run(shown, check=True, capture_output=True, text=True).stdout.strip())
    (site / "lab.pth").write_text(f"{ROOT}\n{sysconfig.get_paths()['purelib']}\n", encoding="utf-8")
    shutil.copytree(TEMPLATE, folder / "plugin", ignore=shutil.ignore_patterns("__pycache__"))
    install = [
        sys.executable,
        "-m",
        "pip",
        "--python",
        python,
        "install",
        "--quiet",
        "--no-deps",
        "--no-build-isolation",
        "--no-index",
    ]
    subprocess.run([*install, str(folder / "plugin")], check=True, env=_without_path())
    return folder


def _without_path() -> dict[str, str]:
    return {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}


def run_installed(environment: Path, *words: str, timeout: float = 120.0) -> str:
    command = [str(environment / "bin" / "python"), *words]
    done = subprocess.run(
        command, cwd=environment, env=_without_path(), capture_output=True, text=True, timeout=timeout
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.mark.long
def test_the_template_installs_lists_its_law_and_passes_its_own_tests(environment: Path) -> None:
    shown = json.loads(run_installed(environment, "-m", "dpr_lab", "effects", "show", "magnet_joint2", "--json"))
    assert shown["package"] == "dpr-lab-magnet 0.1.0"
    assert [parameter["name"] for parameter in shown["parameters"]] == ["damping_Nms", "width_rad"]
    assert "6 passed" in run_installed(environment, "-m", "pytest", "-q", "-p", "no:cacheprovider", "plugin/tests")


@pytest.mark.long
@pytest.mark.timeout(1800)
def test_the_law_of_the_template_is_compiled_fitted_named_and_exported(environment: Path) -> None:
    (environment / "diagnose.py").write_text(
        textwrap.dedent("""
        import importlib.util
        from pathlib import Path

        from dpr_lab.exports import FORMATS
        from dpr_lab.exports.corrected import corrected_model
        from dpr_lab.gap.diagnose import diagnose
        from dpr_lab.rig import load_rig
        from sim_device.plant.config import load_plant
        from sim_device.trials.offline_recorder import record
        from sim_device.trials.parameters import weighed

        plant, rig = weighed(load_plant("paper", 5), load_rig("paper"))
        own = {"magnet_joint2": {"damping_Nms": 1.5e-3, "width_rad": 0.4}}
        runs = record(plant.model_copy(update={"effects": own}), rig, duration=4.0)
        diagnosis = diagnose(runs, rig)
        print(diagnosis.verdict, [effect.name for effect in diagnosis.effects])
        fitted = diagnosis.effects[0].parameters
        print(all(abs(fitted[p].value / value - 1) < 0.1 for p, value in own["magnet_joint2"].items()))
        model = corrected_model(diagnosis, runs, rig)
        Path("corrected.py").write_text(FORMATS["python"].written(model, rig)["corrected_model.py"])
        spec = importlib.util.spec_from_file_location("corrected", "corrected.py")
        corrected = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(corrected)
        joint = corrected.magnet.__code__.co_varnames[0]
        print(joint, "magnet_joint2_damping_Nms" in dir(corrected))
        """),
        encoding="utf-8",
    )
    lines = run_installed(environment, "diagnose.py", timeout=1700).splitlines()
    assert lines == ["named ['magnet_joint2']", "True", "joint True"]
